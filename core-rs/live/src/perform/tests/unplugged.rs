//! A device for tests.

use std::time::Instant;

use crate::device::{Device, DeviceLoss, DeviceSample, DeviceSpec};
use crate::safety::SafeForce;

/// A key that is unplugged after `left` forces have been sent.
pub(in crate::perform) struct Unplugged {
    pub(in crate::perform) key: Box<dyn Device>,
    pub(in crate::perform) left: u32,
}

impl Device for Unplugged {
    fn spec(&self) -> &DeviceSpec {
        self.key.spec()
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.left = self.left.checked_sub(1).ok_or(DeviceLoss::Closed)?;
        self.key.send(force)
    }
    fn receive(&mut self, into: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        self.key.receive(into, deadline)
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {}
}
