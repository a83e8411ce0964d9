//! Between what physics asks for and a motor under a finger.
//!
//! [`Guarded`] owns a device, and nobody else can make a [`SafeForce`] that is not zero. Time here is counted in
//! ticks, never read from a clock: the same positions give the same forces, in lockstep too. A host that is itself
//! late or stopped cannot guard anything; for that a device has its own watchdog.

mod counts;
mod force;
mod last_resort;
mod limits;
pub mod margin;
mod pipeline;
pub mod stiffness;
pub mod tlm;

pub use counts::Counts;
pub use force::SafeForce;
pub use limits::Limits;

use std::time::Instant;

use crate::device::{Device, Gone, Sample, Spec};
use last_resort::Armed;
use pipeline::Pipeline;

/// How often zero forces are sent when all is over: one packet may be lost.
const FAREWELLS: usize = 3;

/// A device and the stages that every force passes. Dropped, by a panic or a signal too, it sends zero forces.
pub struct Guarded<D: Device = Box<dyn Device>> {
    // Disarmed before the device closes its port.
    _armed: Option<Armed>,
    pipeline: Pipeline,
    device: D,
}

impl<D: Device> Guarded<D> {
    /// Guard a device that is sent forces once in every `period` [s].
    pub fn new(device: D, limits: Limits, period: f64) -> Self {
        Self {
            _armed: device.last_resort().and_then(last_resort::arm),
            pipeline: Pipeline::new(device.spec(), limits, period),
            device,
        }
    }

    /// What the device is.
    pub fn spec(&self) -> &Spec {
        self.device.spec()
    }

    /// The device itself, to look at.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// Whether the device's time is the host's.
    pub fn in_lockstep(&self) -> bool {
        self.device.in_lockstep()
    }

    /// Send forces, one for each axis (missing ones are zero), as far as they are safe; returns what was sent.
    ///
    /// # Errors
    /// [`Gone`] when there is nobody to send it to.
    pub fn send(&mut self, forces: &[f64]) -> Result<SafeForce, Gone> {
        let safe = if last_resort::is_over() {
            SafeForce::zero(self.spec().dof)
        } else {
            self.pipeline.pass(forces)
        };
        self.device.send(&safe)?;
        Ok(safe)
    }

    /// Take the newest positions, as [`Device::receive`] does.
    ///
    /// # Errors
    /// [`Gone`] when none will come any more.
    pub fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        let fresh = self.device.receive(into, deadline)?;
        if fresh {
            self.pipeline.observe(&into.position);
        }
        Ok(fresh)
    }

    /// Send zero forces now; what is asked next passes again.
    pub fn zero(&mut self) {
        self.pipeline.forget();
        self.device.zero();
    }

    /// No more forces, until `stop(false)`; then they come back as at the start.
    pub fn stop(&mut self, stopped: bool) {
        self.pipeline.stop(stopped);
        if stopped {
            self.device.zero();
        }
    }

    /// Scale the forces of an axis (0 to 1): what keeps a coupling below [`stiffness::limit`].
    pub fn scale(&mut self, axis: usize, gain: f64) {
        self.pipeline.scale(axis, gain);
    }

    /// Whether an axis has tripped and is held at zero.
    pub fn tripped(&self, axis: usize) -> bool {
        self.pipeline.tripped(axis)
    }

    /// How often each stage did something.
    pub fn counts(&self) -> &Counts {
        self.pipeline.counts()
    }
}

impl<D: Device> Drop for Guarded<D> {
    fn drop(&mut self) {
        for _ in 0..FAREWELLS {
            self.device.zero();
        }
    }
}

#[cfg(test)]
mod tests;
