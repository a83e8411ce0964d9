//! A device for tests.

use std::time::Instant;

use crate::device::{Device, Gone, Sample, Spec};
use crate::safety::SafeForce;

/// A key that is unplugged after `left` forces have been sent.
pub(in crate::perform) struct Unplugged {
    pub(in crate::perform) key: Box<dyn Device>,
    pub(in crate::perform) left: u32,
}

impl Device for Unplugged {
    fn spec(&self) -> &Spec {
        self.key.spec()
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        self.left = self.left.checked_sub(1).ok_or(Gone::Closed)?;
        self.key.send(force)
    }
    fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        self.key.receive(into, deadline)
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {}
}
