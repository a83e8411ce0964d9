//! Between what physics asks for and a motor under a finger.
//!
//! [`Guarded`] owns a device, and nobody else can make a [`SafeForce`] that is not zero. Time is counted in ticks where
//! the device is in lockstep: the same positions give the same forces. Elsewhere it is read from a clock, for the device
//! goes on while the host is stopped. A host that is stopped cannot guard anything; for that a device has its own
//! watchdog. When the host goes on, it finds by the clock that it was stopped.

mod clock;
pub mod contract;
mod counts;
mod force;
mod last_resort;
mod limits;
pub mod margin;
mod pipeline;
mod plausibility;
mod stages;
pub mod stiffness;

pub use counts::Counts;
pub use force::SafeForce;
pub use limits::Limits;
pub use plausibility::Trip;

use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::{Duration, Instant};

use crate::safety::contract::{Device, Gone, Sample, Spec};
use crate::stop;
use crate::wire::MAX_AXES;
use clock::Clock;
use last_resort::Armed;
pub use last_resort::{leave_signals, look_for_signals, watch, watch_ends};
use pipeline::Pipeline;
use plausibility::{AxisSpec, Watched};

/// A factor from 0 to 1: NaN and negative numbers are 0, greater ones are 1.
pub(crate) fn unit(factor: f64) -> f64 {
    if factor > 0.0 { factor.min(1.0) } else { 0.0 }
}

/// How often zero forces are sent when all is over: one packet may be lost.
const FAREWELLS: usize = 3;

/// A device and the stages that every force passes. Dropped, by a panic or a signal too, it sends zero forces.
pub struct Guarded<D: Device = Box<dyn Device>> {
    // Disarmed before the device closes its port.
    _armed: Option<Armed>,
    pipeline: Pipeline,
    /// Whether force and motion agree, if that is watched.
    watched: Option<Watched>,
    /// Why each axis tripped, if it did.
    trips: [Option<Trip>; MAX_AXES],
    /// By [`Guarded::stop`]; and whether the pipeline is, by that or by the stop of the process.
    stopped: bool,
    held: bool,
    clock: Clock,
    device: D,
}

/// What the motors of a device, and the hands on them, have borne; for the same device when it is opened again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Memory {
    heat: [f64; MAX_AXES],
    work: [f64; MAX_AXES],
    at: Duration,
}

impl Memory {
    /// Heat of each motor: the mean of (force / continuous force)²   (16,)
    pub fn heat(&self) -> &[f64; MAX_AXES] {
        &self.heat
    }

    fn new(at: Duration) -> Self {
        Self {
            heat: [0.0; MAX_AXES],
            work: [0.0; MAX_AXES],
            at,
        }
    }
}

impl<D: Device> Guarded<D> {
    /// Guard a device that is sent forces once in every `period` [s].
    pub fn new(device: D, limits: Limits, period: f64) -> Self {
        let in_lockstep = device.in_lockstep();
        let spec = device.spec();
        Self {
            _armed: device.last_resort().and_then(last_resort::arm),
            pipeline: Pipeline::new(spec, limits, period, in_lockstep),
            watched: None,
            trips: [None; MAX_AXES],
            stopped: false,
            held: false,
            clock: Clock::new(in_lockstep, period),
            device,
        }
    }

    /// The same, and force and motion have to agree: for a device that is played, not for one that is found out about.
    #[must_use]
    pub fn watched(mut self) -> Self {
        let spec = self.device.spec();
        let built: Vec<AxisSpec> = (0..spec.dof)
            .map(|axis| AxisSpec {
                range: self.device.range(axis),
                resolution: spec.pos_lsb,
                inertia: spec.inertia,
                force: self.pipeline.force_max(),
            })
            .collect();
        self.watched = Some(Watched::new(&built, self.pipeline.period()));
        self
    }

    /// The same, and nothing is added to the forces that are asked for: for a key of which nothing is known, which a
    /// probe might send to the end of its travel.
    #[must_use]
    pub(crate) fn without_probes(mut self) -> Self {
        if let Some(watched) = &mut self.watched {
            watched.probe_nothing();
        }
        self
    }

    /// The same, and ages are judged by a clock that is set from elsewhere [ns].
    #[must_use]
    pub(crate) fn by_clock(mut self, nanoseconds: Arc<AtomicU64>) -> Self {
        self.clock = Clock::Set(nanoseconds);
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

    /// The device itself, to make a fault on.
    pub(crate) fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// Whether the device's time is the host's.
    pub fn in_lockstep(&self) -> bool {
        self.device.in_lockstep()
    }

    /// Send forces, one for each axis (missing ones are zero), as far as they are safe; returns what was sent.
    ///
    /// A host may be stopped at any instruction. Between the last look at the clock and write(2) are some hundred
    /// nanoseconds; a force that is stopped there goes out when the host goes on. The look after it finds that, and zero
    /// follows at once; a board that had let go meanwhile has felt the old force for some microseconds.
    ///
    /// # Errors
    /// [`Gone`] when there is nobody to send it to.
    pub fn send(&mut self, forces: &[f64]) -> Result<SafeForce, Gone> {
        self.hold();
        self.clock.tick();
        let mut safe = self.pass(forces);
        if stop::has_let_go() || self.pipeline.was_stopped(self.clock.now()) {
            safe = self.pipeline.withdraw();
        }
        self.device.send(&safe)?;
        if self.pipeline.was_stopped(self.clock.now()) {
            safe = self.pipeline.withdraw();
            self.device.zero();
        }
        if let Some(watched) = &mut self.watched {
            watched.sent(safe.newtons());
        }
        Ok(safe)
    }

    fn pass(&mut self, forces: &[f64]) -> SafeForce {
        let now = self.clock.now();
        let safe = if let Some(watched) = &mut self.watched {
            if self.pipeline.is_fading() {
                watched.restart();
            }
            self.pipeline.pass(&watched.pass(forces), now)
        } else {
            self.pipeline.pass(forces, now)
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
            self.pipeline.observe(into, self.clock.now());
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
        self.stopped = stopped;
        self.hold();
        if stopped {
            self.device.zero();
        }
    }

    /// Axes that tripped because force and motion disagreed may push again.
    pub fn release(&mut self) {
        if let Some(watched) = &mut self.watched {
            watched.release();
        }
    }

    fn hold(&mut self) {
        let held = self.stopped || stop::has_let_go();
        if held != self.held {
            self.held = held;
            self.pipeline.stop(held);
            if !held {
                self.release();
            }
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

    /// What motors and hands have borne so far.
    pub fn memory(&self) -> Memory {
        self.pipeline.memory(clock::wall())
    }

    /// Motors and hands have borne this already; motors have cooled since then.
    pub fn recall(&mut self, memory: &Memory) {
        let elapsed = clock::wall().saturating_sub(memory.at);
        self.pipeline.recall(memory, elapsed.as_secs_f64());
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
