//! Between what physics asks for and a motor under a finger.
//!
//! [`Guarded`] owns a device, and nobody else can make a [`SafeForce`] that is not zero. Time here is counted in
//! ticks, never read from a clock: the same positions give the same forces, in lockstep too. A host that is itself
//! late or stopped cannot guard anything; for that a device has its own watchdog.

mod counts;
mod force;
mod last_resort;
mod limits;
mod pipeline;
mod plausibility;
pub mod stiffness;
pub mod tlm;

pub use counts::Counts;
pub use force::SafeForce;
pub use limits::Limits;
pub use plausibility::Trip;

use std::time::Instant;

use crate::device::{Device, Gone, MAX_AXES, Sample, Spec};
use last_resort::Armed;
use pipeline::Pipeline;
use plausibility::{Built, Watched};

/// How often zero forces are sent when all is over: one packet may be lost.
const FAREWELLS: usize = 3;

/// A device and the stages that every force passes. Dropped, by a panic or a signal too, it sends zero forces.
pub struct Guarded<D: Device = Box<dyn Device>> {
    // Disarmed before the device closes its port.
    _armed: Option<Armed>,
    pipeline: Pipeline,
    /// Whether force and motion agree, if that is watched.
    watched: Option<Watched>,
    period: f64,
    force: f64,
    /// Why each axis tripped, if it did.
    trips: [Option<Trip>; MAX_AXES],
    device: D,
}

impl<D: Device> Guarded<D> {
    /// Guard a device that is sent forces once in every `period` [s].
    pub fn new(device: D, limits: Limits, period: f64) -> Self {
        let spec = device.spec();
        Self {
            _armed: device.last_resort().and_then(last_resort::arm),
            pipeline: Pipeline::new(spec, limits, period),
            watched: None,
            period,
            force: limits.force.min(spec.force_max_peak),
            trips: [None; MAX_AXES],
            device,
        }
    }

    /// The same, and force and motion have to agree: for a device that is played, not for one that is found out about.
    #[must_use]
    pub fn watched(mut self) -> Self {
        let spec = self.device.spec();
        let built: Vec<Built> = (0..spec.dof)
            .map(|axis| Built {
                range: self.device.range(axis),
                resolution: spec.pos_lsb,
                inertia: spec.inertia,
                force: self.force,
            })
            .collect();
        self.watched = Some(Watched::new(&built, self.period));
        self
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
            self.pass(forces)
        };
        self.device.send(&safe)?;
        Ok(safe)
    }

    fn pass(&mut self, forces: &[f64]) -> SafeForce {
        let safe = match &mut self.watched {
            Some(watched) => {
                let safe = self.pipeline.pass(&watched.pass(forces));
                watched.sent(safe.newtons());
                safe
            }
            None => self.pipeline.pass(forces),
        };
        for (axis, trip) in self.trips.iter_mut().enumerate() {
            let asked = forces.get(axis).copied().unwrap_or(0.0);
            *trip = if let Some(own) = self.watched.as_ref().and_then(|own| own.trip(axis)) {
                Some(own)
            } else if !self.pipeline.tripped(axis) {
                None
            } else if asked.is_finite() {
                trip.or(Some(Trip::Speed))
            } else {
                Some(Trip::NotFinite)
            };
        }
        safe
    }

    /// Take the newest positions, as [`Device::receive`] does.
    ///
    /// # Errors
    /// [`Gone`] when none will come any more.
    pub fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        let fresh = self.device.receive(into, deadline)?;
        if fresh {
            self.pipeline.observe(&into.position);
            if let Some(watched) = &mut self.watched {
                watched.observe(&into.position);
            }
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
        } else {
            self.release();
        }
    }

    /// Axes that tripped because force and motion disagreed may push again.
    pub fn release(&mut self) {
        if let Some(watched) = &mut self.watched {
            watched.release();
        }
    }

    /// Scale the forces of an axis (0 to 1): what keeps a coupling below [`stiffness::limit`].
    pub fn scale(&mut self, axis: usize, gain: f64) {
        self.pipeline.scale(axis, gain);
    }

    /// Why an axis has tripped and is held at zero, if it is.
    pub fn tripped(&self, axis: usize) -> Option<Trip> {
        self.trips.get(axis).copied().flatten()
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
