//! Everything between the forces that physics asks for and a motor under a finger.
//!
//! [`GuardedDevice`] owns a device, and only this module can make a [`SafeForce`] that is not zero. For a device in
//! lockstep, time is counted in ticks, so that the same positions give the same forces. For any other device, time is
//! read from a clock, because the device keeps running while the host is stopped. A stopped host cannot guard anything;
//! a device has its own watchdog for that. When the host continues, the clock shows that it was stopped.

mod clock;
pub mod contract;
mod counts;
mod force;
mod last_resort;
mod latch;
mod limits;
pub mod margin;
mod pipeline;
mod plausibility;
mod stages;
pub mod stiffness;

pub use counts::StageCounts;
pub use force::SafeForce;
pub use latch::TripCause;
pub use limits::SafetyLimits;

use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::{Duration, Instant};

use crate::safety::contract::{Device, DeviceLoss, DeviceSample, DeviceSpec};
use crate::stop;
use crate::wire::MAX_AXES;
use clock::SafetyClock;
use last_resort::Armed;
pub use last_resort::{block_signals, check_signals, watch, watch_termination};
use latch::TripLatch;
use pipeline::Pipeline;
use plausibility::{AxisSpec, PlausibilityChecks};

/// A factor from 0 to 1: NaN and negative numbers are 0, greater ones are 1.
pub(crate) fn clamp_to_unit(factor: f64) -> f64 {
    if factor > 0.0 { factor.min(1.0) } else { 0.0 }
}

/// How often zero forces are sent at the end: one packet may be lost.
const ZERO_REPEATS: usize = 3;

/// A device and the stages that every force passes. It sends zero forces when it is dropped, and also after a panic or
/// a signal.
pub struct GuardedDevice<D: Device = Box<dyn Device>> {
    // First field: it is disarmed before the device closes its port.
    _zeroing: Option<Armed>,
    pipeline: Pipeline,
    /// Checks whether force and motion agree, if the device is watched.
    plausibility: Option<PlausibilityChecks>,
    /// Why each axis is tripped, if it is; and which only the player can let push again.
    trips: [Option<TripCause>; MAX_AXES],
    latches: [TripLatch; MAX_AXES],
    /// Whether [`GuardedDevice::set_stopped`] stopped the forces; and whether the pipeline is stopped, by that call or
    /// by the stop of the process.
    is_stopped: bool,
    is_pipeline_stopped: bool,
    clock: SafetyClock,
    device: D,
}

/// Heat of the motors of a device, work on the hands and trips that stay, for the same device when it is opened again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyMemory {
    heat: [f64; MAX_AXES],
    work: [f64; MAX_AXES],
    latches: [TripLatch; MAX_AXES],
    instant: Duration,
}

impl SafetyMemory {
    /// Heat of each motor: the mean of (force / continuous force)²   (16,)
    pub fn heat(&self) -> &[f64; MAX_AXES] {
        &self.heat
    }

    fn new(instant: Duration) -> Self {
        Self {
            heat: [0.0; MAX_AXES],
            work: [0.0; MAX_AXES],
            latches: [TripLatch::default(); MAX_AXES],
            instant,
        }
    }
}

impl<D: Device> GuardedDevice<D> {
    /// Guard a device that is sent forces once in every `period` [s].
    pub fn new(device: D, limits: SafetyLimits, period: f64) -> Self {
        let in_lockstep = device.in_lockstep();
        let device_spec = device.spec();
        Self {
            _zeroing: device.zero_force_packet().and_then(last_resort::arm),
            pipeline: Pipeline::new(device_spec, |axis| device.range(axis), limits, period, in_lockstep),
            plausibility: None,
            trips: [None; MAX_AXES],
            latches: [TripLatch::default(); MAX_AXES],
            is_stopped: false,
            is_pipeline_stopped: false,
            clock: SafetyClock::new(in_lockstep, period),
            device,
        }
    }

    /// The same, with a check that force and motion agree: for a device that is played, not for one that is being
    /// measured.
    #[must_use]
    pub fn with_plausibility(mut self) -> Self {
        let device_spec = self.device.spec();
        let axis_specs: Vec<AxisSpec> = (0..device_spec.dof)
            .map(|axis| AxisSpec {
                range: self.device.range(axis),
                resolution: device_spec.pos_lsb,
                inertia: device_spec.inertia,
                force_max: self.pipeline.force_max(),
                delay_seconds: device_spec.loop_delay_s.unwrap_or(0.0),
                energy_max: self.pipeline.limits().work_max,
                power_max: self.pipeline.limits().power_max,
            })
            .collect();
        self.plausibility = Some(PlausibilityChecks::new(&axis_specs, self.pipeline.period()));
        self
    }

    /// The same, without probes: for a key of which nothing is known, because a probe might send it to the end of its
    /// travel.
    #[must_use]
    pub(crate) fn without_probes(mut self) -> Self {
        if let Some(checks) = &mut self.plausibility {
            checks.disable_probes();
        }
        self
    }

    /// The same, with ages judged by a clock that is set from outside [ns].
    #[must_use]
    pub(crate) fn with_clock(mut self, nanoseconds: Arc<AtomicU64>) -> Self {
        self.clock = SafetyClock::External(nanoseconds);
        self
    }

    /// The properties of the device.
    pub fn spec(&self) -> &DeviceSpec {
        self.device.spec()
    }

    /// The device itself, for reading.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// The device itself, for injecting a fault.
    pub(crate) fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// Whether the device runs in lockstep with the host.
    pub fn in_lockstep(&self) -> bool {
        self.device.in_lockstep()
    }

    /// Send forces, one for each axis (missing ones are zero), limited by the safety stages; return what was sent.
    ///
    /// A host may be stopped at any instruction. Some hundred nanoseconds pass between the last check of the clock and
    /// write(2); if the host is stopped there, an old force goes out when it continues. The check after the write finds
    /// this, and zero follows at once: a board that had let go meanwhile feels the old force for some microseconds.
    ///
    /// # Errors
    /// [`DeviceLoss`] if the device cannot receive them.
    pub fn send(&mut self, forces: &[f64]) -> Result<SafeForce, DeviceLoss> {
        self.update_stop();
        self.clock.tick();
        let mut safe_force = self.pass_stages(forces);
        if stop::are_forces_stopped() || self.pipeline.was_stopped(self.clock.now()) {
            safe_force = self.pipeline.withdraw();
        }
        if self.has_disobeying_motor() {
            safe_force = self.pipeline.withdraw();
            self.device.switch_off()?;
        } else {
            self.device.send(&safe_force)?;
        }
        if self.pipeline.was_stopped(self.clock.now()) {
            safe_force = self.pipeline.withdraw();
            self.device.zero();
        }
        if let Some(checks) = &mut self.plausibility {
            checks.note_sent_forces(safe_force.newtons());
        }
        Ok(safe_force)
    }

    fn pass_stages(&mut self, forces: &[f64]) -> SafeForce {
        let time_now = self.clock.now();
        let safe_force = if let Some(checks) = &mut self.plausibility {
            if self.pipeline.is_fading() {
                checks.restart();
            }
            self.pipeline.limit_forces(&checks.check_forces(forces), time_now)
        } else {
            self.pipeline.limit_forces(forces, time_now)
        };
        self.note_trips(time_now);
        safe_force
    }

    /// Whether a motor may not do what it is commanded: then zero force does not end its force, and all motors of the
    /// device are switched off.
    fn has_disobeying_motor(&self) -> bool {
        let disobeys = |trip: &Option<TripCause>| trip.is_some_and(TripCause::is_of_motor);
        self.trips.iter().any(disobeys)
    }

    /// Note which axes are tripped, and hold those that tripped too often.
    fn note_trips(&mut self, now: Duration) {
        for (axis, latch) in self.latches.iter_mut().enumerate() {
            let check_trip = self.plausibility.as_ref().and_then(|trips| trips.trip(axis));
            let trip_cause = check_trip.or_else(|| self.pipeline.trip_cause(axis));
            if let Some(trip_cause) = trip_cause.filter(|_| self.trips[axis].is_none()) {
                latch.record_trip(trip_cause, now);
            }
            if latch.permanent_trip().is_some() {
                self.pipeline.latch(axis);
            }
            self.trips[axis] = latch.permanent_trip().or(trip_cause);
        }
    }

    /// Take the newest positions, as [`Device::receive`] does.
    ///
    /// # Errors
    /// [`DeviceLoss`] if no positions will come any more.
    pub fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        let is_fresh = self.device.receive(sample, deadline)?;
        if is_fresh {
            self.pipeline.observe(sample, self.clock.now());
            if let Some(checks) = &mut self.plausibility {
                checks.observe(&sample.position);
            }
        }
        Ok(is_fresh)
    }

    /// Send zero forces now; later forces pass again.
    pub fn zero(&mut self) {
        self.pipeline.reset_previous_force();
        self.device.zero();
    }

    /// Stop all forces until `set_stopped(false)`; they then rise as at the start.
    pub fn set_stopped(&mut self, is_stopped: bool) {
        self.is_stopped = is_stopped;
        self.update_stop();
        if is_stopped {
            self.device.zero();
        }
    }

    /// Let every axis that tripped push again, whatever was found.
    pub fn release(&mut self) {
        (self.latches, self.trips) = ([TripLatch::default(); MAX_AXES], [None; MAX_AXES]);
        self.pipeline.release();
        if let Some(checks) = &mut self.plausibility {
            checks.release();
        }
    }

    fn update_stop(&mut self) {
        let is_stopped = self.is_stopped || stop::are_forces_stopped();
        if is_stopped != self.is_pipeline_stopped {
            self.is_pipeline_stopped = is_stopped;
            self.pipeline.set_stopped(is_stopped);
            if !is_stopped {
                self.release();
            }
        }
    }

    /// Scale the forces of an axis (0 to 1), to keep a coupling below [`stiffness::limit`].
    pub fn scale(&mut self, axis: usize, gain: f64) {
        self.pipeline.set_gain(axis, gain);
    }

    /// The reason for which an axis has tripped and is held at zero, if it has.
    pub fn trip_cause(&self, axis: usize) -> Option<TripCause> {
        self.trips.get(axis).copied().flatten()
    }

    /// Heat of the motors, work on the hands and trips that stay, so far.
    pub fn memory(&self) -> SafetyMemory {
        SafetyMemory {
            latches: self.latches.map(|latch| latch.without_times()),
            ..self.pipeline.memory(clock::wall())
        }
    }

    /// Continue with the heat, work and trips of `memory`; motors have cooled since then.
    pub fn restore_memory(&mut self, memory: &SafetyMemory) {
        let elapsed = clock::wall().saturating_sub(memory.instant);
        self.pipeline.restore(memory, elapsed.as_secs_f64());
        self.latches = memory.latches;
        for (axis, latch) in self.latches.iter().enumerate() {
            if latch.permanent_trip().is_some() {
                self.pipeline.latch(axis);
            }
        }
    }

    /// How often each stage acted.
    pub fn counts(&self) -> &StageCounts {
        self.pipeline.counts()
    }
}

impl<D: Device> Drop for GuardedDevice<D> {
    fn drop(&mut self) {
        for _ in 0..ZERO_REPEATS {
            self.device.zero();
        }
    }
}

#[cfg(test)]
mod tests;
