//! The pipeline that every force passes: all stages in their order. A stage returns a force within its limits
//! unchanged, to the last bit.
//!
//! * A force that is not finite becomes zero and trips.
//! * The clamp to the greatest force; the limit of a hot motor.
//! * The rise at the start; trips; stale positions and forces; the scale for the stiffness of the loop; stop.
//! * Passivity, which gives an interval around zero; the slew limit within that interval. Nothing changes a force after
//!   it.

use std::time::Duration;

use super::counts::StageCounts;
use super::force::SafeForce;
use super::limits::SafetyLimits;
use super::stages::fade::{Fade, scale_force};
use super::stages::heat::Heat;
use super::stages::passivity::Passivity;
use super::stages::slew::Slew;
use super::stages::stale::DataAges;
use super::stages::travel::Travel;
use super::stages::trip::TripState;
use super::{SafetyMemory, TripCause as Reason};
use crate::safety::contract::{DeviceSample, DeviceSpec};
use crate::wire::MAX_AXES;

/// The interval of a force that has to end now.
const NO_FORCE_INTERVAL: [f64; 2] = [0.0, 0.0];

pub(super) struct Pipeline {
    limits: SafetyLimits,
    /// Continuous and greatest force [N].
    continuous_force: f64,
    force_max: f64,
    /// Period of the ticks [s].
    period: f64,
    n_axes: usize,
    axes: [AxisState; MAX_AXES],
    counts: StageCounts,
    ages: DataAges,
    passivity: Passivity,
    /// Forces sent since the newest position.
    n_unanswered_forces: u32,
    /// Whether the board reports that it is too hot.
    is_hot: bool,
    is_stopped: bool,
}

#[derive(Clone, Copy)]
struct AxisState {
    /// Newest position and mean velocity, for the speed trip.
    position: Option<f64>,
    velocity: f64,
    /// Velocity of the last step, for the travel [m/s].
    last_velocity: f64,
    heat: Heat,
    ramp: Fade,
    travel: Travel,
    trip: TripState,
    force_gain: f64,
    slew_limit: Slew,
}

impl Pipeline {
    /// The stages for a device whose axes have these travels [m].
    pub(super) fn new(
        spec: &DeviceSpec,
        travel: impl Fn(usize) -> [f64; 2],
        limits: SafetyLimits,
        period: f64,
        in_lockstep: bool,
    ) -> Self {
        let new_axis = |axis| AxisState {
            position: None,
            velocity: 0.0,
            last_velocity: 0.0,
            heat: Heat::default(),
            ramp: Fade::ZERO,
            travel: Travel::new(travel(axis), spec, spec.force_max_peak),
            trip: TripState::NONE,
            force_gain: 1.0,
            slew_limit: Slew::default(),
        };
        Self {
            limits,
            continuous_force: spec.force_max_continuous,
            force_max: limits.force_max.min(spec.force_max_peak),
            period,
            n_axes: spec.dof.min(MAX_AXES),
            axes: std::array::from_fn(new_axis),
            counts: StageCounts::default(),
            ages: DataAges::new(limits.position_age_max),
            passivity: Passivity::new(spec, &limits, period, in_lockstep),
            n_unanswered_forces: 0,
            is_hot: false,
            is_stopped: false,
        }
    }

    /// The forces to be sent `now` for the forces `requested_forces`.
    pub(super) fn limit_forces(&mut self, requested_forces: &[f64], now: Duration) -> SafeForce {
        self.counts.ticks += 1;
        self.n_unanswered_forces = self.n_unanswered_forces.saturating_add(1);
        let period_and_fade = [self.period, self.limits.fade_time];
        let is_stale = self.ages.update(now, period_and_fade, &mut self.counts);
        let mut force_output = [0.0; MAX_AXES];
        for (axis, force_output) in force_output[..self.n_axes].iter_mut().enumerate() {
            let requested_force = requested_forces.get(axis).copied().unwrap_or(0.0);
            *force_output = self.apply_stages(axis, requested_force, is_stale);
        }
        self.passivity.send(&force_output[..self.n_axes]);
        SafeForce::new(force_output, self.n_axes)
    }

    fn apply_stages(&mut self, axis_index: usize, requested_force: f64, is_stale: bool) -> f64 {
        let Self {
            limits,
            counts,
            period,
            continuous_force: continuous,
            ..
        } = self;
        let (axis_state, period, continuous) = (&mut self.axes[axis_index], *period, *continuous);
        let mut force = requested_force;
        if !force.is_finite() {
            counts.not_finite += 1;
            let trip_count = &mut counts.trips_not_finite;
            axis_state.trip.start(Reason::NotFinite, limits.trip_time, trip_count);
            force = 0.0;
        }
        if force.abs() > self.force_max {
            counts.clamped += 1;
            force = self.force_max.copysign(force);
        }
        force = axis_state.heat.limit_force(force, continuous, self.is_hot, counts);
        axis_state.ramp.advance(period, limits.ramp_time);
        force = axis_state.ramp.apply(force, &mut counts.ramped);
        if axis_state.velocity.abs() > limits.velocity_max {
            let trip_count = &mut counts.trips_speed;
            axis_state.trip.start(Reason::Speed, limits.trip_time, trip_count);
        }
        let is_held = axis_state.trip.tick(period, limits.fade_time);
        force = axis_state.trip.apply(force, &mut counts.tripped);
        force = self.ages.apply_fade(force, &mut counts.stale);
        force = scale_force(force, axis_state.force_gain, &mut counts.stiff);
        let allowed_range = if is_held || is_stale || self.is_stopped {
            counts.stopped += u64::from(self.is_stopped);
            NO_FORCE_INTERVAL
        } else {
            self.passivity.allowed_forces(axis_index)
        };
        if allowed_range != NO_FORCE_INTERVAL && (force < allowed_range[0] || force > allowed_range[1]) {
            counts.energy += 1;
        }
        let force_step = limits.slew_rate_max * 1e3 * period;
        force = axis_state
            .slew_limit
            .limit_force(force, allowed_range, force_step, &mut counts.slewed);
        axis_state.heat.add_load(force, continuous, period, limits.heat_time);
        force
    }

    /// Take a reply of the device that came `now`.
    pub(super) fn observe(&mut self, sample: &DeviceSample, now: Duration) {
        let elapsed = self.ages.note_position(now, sample.has_let_go, &mut self.counts);
        // Replies may come late and then together; a stopped host sends nothing for a while.
        let reply_interval = (self.period * f64::from(self.n_unanswered_forces.max(1))).max(elapsed.unwrap_or(0.0));
        (self.n_unanswered_forces, self.is_hot) = (0, sample.is_hot);
        let mean_weight = (reply_interval / self.limits.velocity_window).min(1.0);
        let mut positions = sample.position;
        for (axis, x) in self.axes[..self.n_axes].iter_mut().zip(&mut positions) {
            let position_before = axis.position.unwrap_or(*x);
            if !x.is_finite() {
                let trip_count = &mut self.counts.trips_not_finite;
                axis.trip.start(Reason::NotFinite, self.limits.trip_time, trip_count);
                *x = if position_before.is_finite() {
                    position_before
                } else {
                    0.0
                };
                continue;
            }
            let velocities = [axis.velocity, axis.last_velocity];
            if let Some(trip_cause) = axis.travel.fault(*x, position_before, velocities, reply_interval) {
                let trip_count = &mut self.counts.trips_position;
                axis.trip.start(trip_cause, self.limits.trip_time, trip_count);
            }
            axis.position = Some(*x);
            axis.last_velocity = (*x - position_before) / reply_interval;
            axis.velocity += ((*x - position_before) / reply_interval - axis.velocity) * mean_weight;
        }
        self.passivity.receive(&positions[..self.n_axes], reply_interval);
    }

    /// Whether the host was stopped since its last call.
    pub(super) fn was_stopped(&self, now: Duration) -> bool {
        self.ages.was_stopped(now)
    }

    /// Whether forces fade in after a stall, or after the board had let go.
    pub(super) fn is_fading(&self) -> bool {
        self.ages.is_fading()
    }

    /// Replace the forces that have just passed by zero; later forces fade in from zero.
    pub(super) fn withdraw(&mut self) -> SafeForce {
        self.ages.restart();
        self.passivity.withdraw();
        self.reset_previous_force();
        SafeForce::zero(self.n_axes)
    }

    /// Note that the previous force was zero.
    pub(super) fn reset_previous_force(&mut self) {
        for axis in &mut self.axes {
            axis.slew_limit.reset();
        }
    }

    pub(super) fn set_stopped(&mut self, is_stopped: bool) {
        if self.is_stopped && !is_stopped {
            for axis in &mut self.axes {
                axis.ramp = Fade::ZERO;
            }
        }
        self.is_stopped = is_stopped;
        self.reset_previous_force();
    }

    pub(super) fn set_gain(&mut self, axis: usize, gain: f64) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.force_gain = super::clamp_to_unit(gain);
        }
    }

    /// Why a stage holds an axis at zero, if one does.
    pub(super) fn trip_cause(&self, axis: usize) -> Option<Reason> {
        self.axes.get(axis).and_then(|axis| axis.trip.held_cause())
    }

    /// Hold an axis at zero until `release`.
    pub(super) fn latch(&mut self, axis: usize) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.trip.latch();
        }
    }

    /// Let all axes push again; their forces fade in.
    pub(super) fn release(&mut self) {
        for axis in &mut self.axes {
            axis.trip.release();
        }
    }

    /// The greatest force that any stage lets through [N].
    pub(super) fn force_max(&self) -> f64 {
        self.force_max
    }

    /// The limits of force, power and work.
    pub(super) fn limits(&self) -> &SafetyLimits {
        &self.limits
    }

    /// Period of the ticks [s].
    pub(super) fn period(&self) -> f64 {
        self.period
    }

    pub(super) fn counts(&self) -> &StageCounts {
        &self.counts
    }

    /// Heat and work, for the time when the device is opened again.
    pub(super) fn memory(&self, now: Duration) -> SafetyMemory {
        let mut memory = SafetyMemory::new(now);
        for (axis_index, axis) in self.axes[..self.n_axes].iter().enumerate() {
            memory.heat[axis_index] = axis.heat.coil_load;
            memory.work[axis_index] = self.passivity.work(axis_index).max(0.0);
        }
        memory
    }

    /// Continue with the heat and work of `memory`, after `elapsed` [s] without force.
    pub(super) fn restore(&mut self, memory: &SafetyMemory, elapsed: f64) {
        let refill = self.limits.power_max * elapsed;
        for (axis_index, axis) in self.axes[..self.n_axes].iter_mut().enumerate() {
            let saved_heat = Heat {
                coil_load: memory.heat[axis_index],
            };
            axis.heat = saved_heat.cooled(elapsed, self.limits.heat_time);
            let work_left = (memory.work[axis_index] - refill).max(0.0);
            self.passivity.restore_work(axis_index, work_left);
        }
    }
}
