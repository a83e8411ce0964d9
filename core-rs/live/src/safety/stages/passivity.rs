//! A passivity observer and controller in the time domain (B. Hannaford, J.-H. Ryu, "Time-Domain Passivity Control of
//! Haptic Interfaces", IEEE Trans. Robotics and Automation 18(1), 2002).
//!
//! The observer sums the work of the motor on the key, f·Δx (their eq. 5). A partner may move a hand, so the work may
//! be positive: there is an allowance, and a power that refills it. The delay of a force is known to some ticks at
//! best, and a wrong pairing of force and motion hides work. So the work is summed for every possible delay, and the
//! greatest sum counts. A position is off by at most half a step of its sensor, which hides the work Σ f·Δe, by parts Σ
//! e·Δf: at most half a step times every change of force. This amount is added.
//!
//! Their controller is a damper that removes excess work one tick later. Here forces are under way for some ticks: such
//! a late damper α is itself unstable from α = π·m/(2·delay) on, and the velocity of a coarse sensor makes it push by
//! noise. So this controller acts in advance: a force passes as far as the work that it and the forces under way can
//! still do fits into the rest of the allowance. A force that brakes the key passes.

use super::super::limits::SafetyLimits;
use crate::safety::contract::DeviceSpec;
use crate::wire::MAX_AXES;

/// Number of forces and positions that are remembered.
const HISTORY: usize = 64;
/// Delays tried beyond the one that the device reports [ticks]: a reply may miss its tick, a board may have a queue.
const EXTRA_DELAYS: usize = 4;
/// The longest delay that is tried [ticks].
const DELAY_TICKS_MAX: usize = 31;
/// Greatest number of ticks between two positions over which forces are averaged.
const POSITION_GAP_MAX: u64 = (HISTORY - DELAY_TICKS_MAX - 1) as u64;
/// Mass of a key whose device does not report it [kg]. A light key reacts most, so this is lighter than any real key.
const DEFAULT_MASS: f64 = 0.01;
/// Part of a reported mass that is relied on: a braking force drives a key back if it is lighter than assumed.
const TRUSTED_MASS_SHARE: f64 = 0.5;
/// Velocity is taken over as many ticks as are needed for one sensor step to be slower than this [m/s].
const SENSOR_STEP_VELOCITY: f64 = 0.05;

/// The work of a device's motors on the hands.
#[derive(Clone, Debug)]
pub(in crate::safety) struct Passivity {
    /// The allowance for the work [J], and the power that refills it [W].
    work_max: f64,
    refill_power: f64,
    /// Period of the ticks [s].
    period: f64,
    /// Assumed moving mass, a lower bound of the real one [kg].
    mass: f64,
    /// Step of the position sensor [m].
    sensor_step: f64,
    /// Number of positions over which a velocity is taken.
    velocity_span: u64,
    /// The longest delay of a force [ticks].
    delay_max: usize,
    /// Number of forces sent so far, and how many of them had been sent when the newest position came.
    n_forces: u64,
    n_seen_forces: u64,
    /// Number of positions so far, and their times [s].
    n_positions: u64,
    times: [f64; HISTORY],
    axes: [AxisHistory; MAX_AXES],
}

#[derive(Clone, Copy, Debug)]
struct AxisHistory {
    forces: [f64; HISTORY],
    positions: [f64; HISTORY],
    /// Work on the key for each delay, less what the power has refilled [J].
    work: [f64; DELAY_TICKS_MAX + 1],
    /// Velocity [m/s], and its possible error by the sensor's step.
    velocity: f64,
    velocity_error: f64,
}

/// Index of an entry in the ring of `HISTORY` entries.
fn ring_index(number: u64) -> usize {
    (number % HISTORY as u64) as usize
}

impl Passivity {
    pub(in crate::safety) fn new(spec: &DeviceSpec, limits: &SafetyLimits, period: f64, in_lockstep: bool) -> Self {
        let delay_ticks = (spec.loop_delay_s.unwrap_or(0.0) / period).ceil() as usize;
        // Outside lockstep a reply has the position at which the force arrived; in lockstep the position to which the
        // force moved the key.
        let total_delay = delay_ticks + usize::from(!in_lockstep) + EXTRA_DELAYS;
        let span_max = (limits.velocity_window / period).clamp(1.0, POSITION_GAP_MAX as f64);
        let velocity_span = (spec.pos_lsb / (SENSOR_STEP_VELOCITY * period))
            .ceil()
            .clamp(1.0, span_max);
        Self {
            work_max: limits.work_max,
            refill_power: limits.power_max,
            period,
            mass: spec
                .inertia
                .map_or(DEFAULT_MASS, |reported| TRUSTED_MASS_SHARE * reported),
            sensor_step: spec.pos_lsb,
            velocity_span: velocity_span as u64,
            delay_max: total_delay.min(DELAY_TICKS_MAX),
            n_forces: 0,
            n_seen_forces: 0,
            n_positions: 0,
            times: [0.0; HISTORY],
            axes: [AxisHistory {
                forces: [0.0; HISTORY],
                positions: [0.0; HISTORY],
                work: [0.0; DELAY_TICKS_MAX + 1],
                velocity: 0.0,
                velocity_error: 0.0,
            }; MAX_AXES],
        }
    }

    /// Note the forces that are sent (n_axes,) [N].
    pub(in crate::safety) fn send(&mut self, forces: &[f64]) {
        for (axis, force) in self.axes.iter_mut().zip(forces) {
            axis.forces[ring_index(self.n_forces)] = *force;
        }
        self.n_forces += 1;
    }

    /// Note that the latest forces were replaced by zero.
    pub(in crate::safety) fn withdraw(&mut self) {
        for axis in &mut self.axes {
            axis.forces[ring_index(self.n_forces.wrapping_sub(1))] = 0.0;
        }
    }

    /// Take positions (n_axes,) [m], received `elapsed` [s] after the previous ones.
    pub(in crate::safety) fn receive(&mut self, positions: &[f64], elapsed: f64) {
        let ticks_passed = (self.n_forces - self.n_seen_forces).clamp(1, POSITION_GAP_MAX);
        let (last_slot, now_slot) = (
            ring_index(self.n_positions.wrapping_sub(1)),
            ring_index(self.n_positions),
        );
        self.times[now_slot] = self.times[last_slot] + elapsed;
        let first_slot = ring_index(self.n_positions - self.velocity_span.min(self.n_positions));
        let span_time = self.times[now_slot] - self.times[first_slot];
        for (axis, &x) in self.axes.iter_mut().zip(positions) {
            let position_before = if self.n_positions == 0 {
                x
            } else {
                axis.positions[last_slot]
            };
            axis.positions[now_slot] = x;
            for (delay, work) in axis.work[..=self.delay_max].iter_mut().enumerate() {
                let newest_tick = self.n_forces.wrapping_sub(delay as u64);
                let force_ago = |ticks_ago: u64| axis.forces[ring_index(newest_tick.wrapping_sub(ticks_ago))];
                let mean_force = (1..=ticks_passed).map(force_ago).sum::<f64>() / ticks_passed as f64;
                let change_sum: f64 = (1..=ticks_passed)
                    .map(|ticks_ago| (force_ago(ticks_ago) - force_ago(ticks_ago + 1)).abs())
                    .sum();
                let work_done = mean_force * (x - position_before) + 0.5 * self.sensor_step * change_sum;
                *work = refilled(*work + work_done, self.refill_power * elapsed, self.work_max);
            }
            if span_time > 0.0 {
                axis.velocity = (x - axis.positions[first_slot]) / span_time;
                axis.velocity_error = self.sensor_step / span_time;
            }
        }
        (self.n_positions, self.n_seen_forces) = (self.n_positions + 1, self.n_forces);
    }

    /// The work on an axis [J], for the delay with the greatest work.
    pub(in crate::safety) fn work(&self, axis: usize) -> f64 {
        let work_by_delay = &self.axes[axis].work[..=self.delay_max];
        work_by_delay.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Continue with work [J] that was done on an axis before.
    pub(in crate::safety) fn restore_work(&mut self, axis: usize, work: f64) {
        self.axes[axis].work = [work; DELAY_TICKS_MAX + 1];
    }

    /// The least and the greatest force that may be sent now [N]; zero lies between them.
    ///
    /// A force f that acts for a tick T on a mass m which then moves with w does the work f·w·T + f²T²/(2m).
    pub(in crate::safety) fn allowed_forces(&self, axis: usize) -> [f64; 2] {
        let axis_state = &self.axes[axis];
        let force = |ticks_ago: u64| axis_state.forces[ring_index(self.n_forces.wrapping_sub(ticks_ago))];
        let unseen_ticks = (self.delay_max as u64 + self.n_forces - self.n_seen_forces).min(HISTORY as u64);
        let n_unseen = (unseen_ticks + self.velocity_span).min(HISTORY as u64);
        // Greatest change of the velocity by forces under way and by forces since it was taken.
        let force_sum: f64 = (1..=n_unseen).map(|ticks_ago| force(ticks_ago).abs()).sum();
        let velocity_change = force_sum * self.period / self.mass + axis_state.velocity_error;
        let speed_towards = |side: f64| side * axis_state.velocity + velocity_change;
        let possible_work = |force: f64| force.abs() * speed_towards(force.signum()).max(0.0) * self.period;
        let reserved_work: f64 = (1..=unseen_ticks)
            .map(|ticks_ago| possible_work(force(ticks_ago)))
            .sum();
        let energy_left = (self.work_max - self.work(axis) - reserved_work).max(0.0);
        let force_limit = |side: f64| {
            let speed = speed_towards(side);
            let reached_speed = (speed * speed + 2.0 * energy_left / self.mass).sqrt();
            (reached_speed - speed).max(0.0) * self.mass / self.period
        };
        [-force_limit(-1.0), force_limit(1.0)]
    }
}

/// Draw work towards zero by the refilled amount. Work that a hand put in (negative) may be returned to it, as a spring
/// returns it, but only up to the allowance and not for long.
fn refilled(work: f64, refill: f64, allowance: f64) -> f64 {
    if work > 0.0 {
        (work - refill).max(0.0)
    } else {
        (work.max(-allowance) + refill).min(0.0)
    }
}
