//! Pushes a key with written forces, for the measurement of its model.
//!
//! Nobody touches the key, and nothing about it is known beforehand. A guide, a soft spring and damper, keeps a key
//! that has no spring of its own near the middle. A brake, a firmer spring and damper, replaces the written forces if
//! the key would come near an end of its travel. The forces of both pass every safety stage and are part of the
//! recorded force.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::device::{Device, DeviceLoss, DeviceSample, MAX_AXES};
use crate::realtime;
use crate::recording::{self, RowSink};
use crate::safety::{GuardedDevice, SafetyLimits, TripCause};

/// Time over which the velocity of a key is averaged [s], because one step of a coarse sensor is not a speed.
const VELOCITY_WINDOW: f64 = 5e-3;
/// As parts of `Guide::half_travel`: the position at which the brake takes over, the predicted stopping position at
/// which it takes over, and the position at which it lets go.
const BRAKE_TRAVEL_SHARE: f64 = 0.6;
const BRAKE_STOP_TRAVEL_SHARE: f64 = 0.75;
const RELEASE_TRAVEL_SHARE: f64 = 0.3;
/// Replies that come more than this many ticks after their forces count as lost.
const LATE_TICKS_MAX: usize = 8;
/// Time without a new position after which a device counts as gone [s].
const LOSS_TIMEOUT: f64 = 0.25;
/// Longest wait for a reply, as a part of a tick.
const REPLY_WAIT_SHARE: f64 = 0.6;
/// Time between two checks for room in the recording of a device in lockstep.
const CHECK_INTERVAL: Duration = Duration::from_millis(1);

/// A spring and a damper.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpringDamper {
    /// Stiffness [N/m].
    pub stiffness: f64,
    /// Damping [N·s/m].
    pub damping: f64,
}

/// The springs and dampers that keep a key away from the ends of its travel.
#[derive(Clone, Copy, Debug)]
pub struct Guide {
    /// Position at which the key is kept [m].
    pub centre: f64,
    /// Distance from there to the nearer end [m].
    pub half_travel: f64,
    /// Pulls the key to the centre all the time.
    pub spring: SpringDamper,
    /// Pulls the key back from an end.
    pub brake: SpringDamper,
    /// Deceleration that the brake surely achieves [m/s²].
    pub deceleration: f64,
}

/// The forces on one axis, tick by tick, and the conditions of the take.
#[derive(Clone, Copy, Debug)]
pub struct Excitation<'a> {
    /// The axis of the device.
    pub axis: usize,
    /// Forces [N]   (n_ticks,)
    pub forces: &'a [f64],
    /// Number of ticks at the beginning in which the guide does not act.
    pub unguided_ticks: usize,
    /// Length of a tick [s].
    pub period: f64,
    /// The guide and the brake.
    pub guide: Guide,
    /// Step of the motor's force [N], for a device that does not report it; 0: that of the wire.
    pub force_step: f64,
    /// Whether the device reports touch; if it does, a touch ends the take.
    pub reports_touch: bool,
    /// Whether the take ends if the device lets no force through.
    pub is_gated: bool,
}

/// Why a take ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExcitationEnd {
    /// All forces were sent.
    Done,
    /// A hand touched the key.
    Touched,
    /// The device let no force through.
    GateClosed,
    /// The position was not finite.
    NotFinite,
    /// A safety stage held the axis at zero.
    Tripped(TripCause),
    /// The device went away.
    Gone(DeviceLoss),
    /// A stop was requested.
    Stopped,
}

/// One tick of a take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExcitationRow {
    /// The force asked for, including the guide's, or the brake's instead [N].
    pub requested_force: f64,
    /// The force on the wire after all safety stages, in steps of `Excitation::force_step` [N].
    pub sent_force: f64,
    /// Position in the reply to this force, or the previous position if there was no reply [m].
    pub position: f64,
    /// Whether there was a reply.
    pub is_fresh: bool,
    /// The device's clock in that reply [µs].
    pub clock: u32,
    /// Whether the brake pushed instead of the written force.
    pub braked: bool,
}

/// A take: the response of a key to an excitation.
#[derive(Clone, Debug)]
pub struct ExcitationResult {
    /// Its ticks.
    pub rows: Vec<ExcitationRow>,
    /// Why it ended.
    pub end: ExcitationEnd,
}

/// Push an axis with the forces of an excitation, then release it. Every row also goes into `sink`. The calling
/// thread keeps the priority of the physics thread, so call it in a thread of its own.
pub fn excite<D: Device>(
    device: D,
    excitation: &Excitation<'_>,
    sink: Option<&mut RowSink>,
    stop: &AtomicBool,
) -> ExcitationResult {
    // The written forces may jump, from the first tick on; all other limits hold.
    let limits = SafetyLimits {
        slew_rate_max: f64::INFINITY,
        ramp_time: 0.0,
        fade_time: 0.0,
        ..SafetyLimits::from_spec(device.spec())
    };
    let in_lockstep = device.in_lockstep();
    if !in_lockstep {
        realtime::request(realtime::PHYSICS_PRIORITY);
    }
    let mut run = ExcitationRun {
        guarded_device: GuardedDevice::new(device, limits, excitation.period)
            .with_plausibility()
            .without_probes(),
        excitation,
        sample: DeviceSample::default(),
        rows: Vec::with_capacity(excitation.forces.len()),
        motion: MeasuredMotion::default(),
        is_braking: false,
        silent_seconds: 0.0,
        row_sink: sink,
        n_written: 0,
    };
    let end = run.run(stop).err().unwrap_or(ExcitationEnd::Done);
    run.guarded_device.zero();
    run.write_rows(0);
    ExcitationResult { rows: run.rows, end }
}

/// Position and velocity of a key by the newest reply.
#[derive(Clone, Copy, Debug, Default)]
struct MeasuredMotion {
    x: f64,
    v: f64,
    /// Time since the position was read [s].
    age: f64,
}

struct ExcitationRun<'a, 'b, D: Device> {
    guarded_device: GuardedDevice<D>,
    excitation: &'a Excitation<'a>,
    sample: DeviceSample,
    rows: Vec<ExcitationRow>,
    motion: MeasuredMotion,
    is_braking: bool,
    /// Time since the last reply [s].
    silent_seconds: f64,
    row_sink: Option<&'b mut RowSink>,
    /// Number of rows that were given to the sink.
    n_written: usize,
}

impl<D: Device> ExcitationRun<'_, '_, D> {
    fn run(&mut self, stop: &AtomicBool) -> Result<(), ExcitationEnd> {
        let excitation = self.excitation;
        let pushed_axis = excitation.axis;
        self.receive(Instant::now())?;
        self.motion.x = self.sample.position[pushed_axis];
        if !self.motion.x.is_finite() {
            return Err(ExcitationEnd::NotFinite);
        }
        let mut next_tick = Instant::now();
        for (tick, &force) in excitation.forces.iter().enumerate() {
            if stop.load(Ordering::Relaxed) || crate::stop::are_forces_stopped() {
                return Err(ExcitationEnd::Stopped);
            }
            let requested_force = self.requested_force(force, tick < excitation.unguided_ticks);
            let mut forces = [0.0; MAX_AXES];
            forces[pushed_axis] = requested_force;
            let safe_forces = self.guarded_device.send(&forces).map_err(ExcitationEnd::Gone)?;
            let mut sent_force = self.guarded_device.device().on_wire(&safe_forces)[pushed_axis];
            if excitation.force_step > 0.0 {
                sent_force = (sent_force / excitation.force_step).round() * excitation.force_step;
            }
            self.rows.push(ExcitationRow {
                requested_force,
                sent_force,
                position: self.motion.x,
                braked: self.is_braking,
                ..ExcitationRow::default()
            });
            next_tick += Duration::from_secs_f64(excitation.period);
            let reply_wait = Duration::from_secs_f64(REPLY_WAIT_SHARE * excitation.period);
            self.receive(Instant::now() + reply_wait)?;
            self.apply_reply(force != 0.0)?;
            self.write_rows(LATE_TICKS_MAX);
            if !self.guarded_device.in_lockstep() {
                let lateness = realtime::sleep_until(next_tick);
                if lateness.as_secs_f64() > 10.0 * excitation.period {
                    next_tick = Instant::now();
                }
            }
        }
        Ok(())
    }

    /// The force to ask for: the written force and the guide's, or the brake's instead.
    fn requested_force(&mut self, force: f64, is_unguided: bool) -> f64 {
        let Guide {
            centre,
            half_travel: half,
            spring,
            brake,
            deceleration,
        } = self.excitation.guide;
        let (centre_offset, velocity) = (self.motion.x - centre, self.motion.v);
        let outwards = (velocity * centre_offset.signum()).max(0.0);
        let stopping_offset = centre_offset.abs() + 0.5 * outwards * outwards / deceleration;
        self.is_braking = if self.is_braking {
            centre_offset.abs() > RELEASE_TRAVEL_SHARE * half || stopping_offset > BRAKE_TRAVEL_SHARE * half
        } else {
            centre_offset.abs() > BRAKE_TRAVEL_SHARE * half || stopping_offset > BRAKE_STOP_TRAVEL_SHARE * half
        };
        if self.is_braking {
            return -brake.stiffness * centre_offset - brake.damping * velocity;
        }
        if is_unguided {
            return force;
        }
        force - spring.stiffness * centre_offset - spring.damping * velocity
    }

    fn receive(&mut self, deadline: Instant) -> Result<(), ExcitationEnd> {
        self.sample.is_fresh = false;
        let fresh_result = self.guarded_device.receive(&mut self.sample, deadline);
        self.sample.is_fresh = fresh_result.map_err(ExcitationEnd::Gone)?;
        Ok(())
    }

    /// Take the reply of this tick: enter it in its row, update the motion, and check whether the take must end.
    fn apply_reply(&mut self, is_force_requested: bool) -> Result<(), ExcitationEnd> {
        let (pushed_axis, sample) = (self.excitation.axis, &self.sample);
        let (key_position, tick_period) = (sample.position[pushed_axis], self.excitation.period);
        self.motion.age += tick_period;
        if let Some(trip_cause) = self.guarded_device.trip_cause(pushed_axis) {
            return Err(ExcitationEnd::Tripped(trip_cause));
        }
        if !sample.is_fresh {
            self.silent_seconds += tick_period;
            return if self.silent_seconds > LOSS_TIMEOUT {
                Err(ExcitationEnd::Gone(DeviceLoss::Silent))
            } else {
                Ok(())
            };
        }
        self.silent_seconds = 0.0;
        if !key_position.is_finite() {
            return Err(ExcitationEnd::NotFinite);
        }
        let motion_age = self.motion.age;
        let blend_weight = (motion_age / VELOCITY_WINDOW).min(1.0);
        self.motion.v += ((key_position - self.motion.x) / motion_age - self.motion.v) * blend_weight;
        (self.motion.x, self.motion.age) = (key_position, 0.0);
        let row_index = (self.rows.len() - 1).checked_sub(usize::from(sample.requests_behind));
        if let Some(row_index) = row_index.filter(|&index| index >= self.n_written)
            && let Some(row) = self.rows.get_mut(row_index)
        {
            (row.position, row.is_fresh) = (key_position, true);
            row.clock = sample.t_dev_us.unwrap_or(0);
        }
        if self.excitation.reports_touch && sample.is_touched[pushed_axis] {
            return Err(ExcitationEnd::Touched);
        }
        if self.excitation.is_gated
            && is_force_requested
            && sample.requests_behind == 0
            && !sample.is_force_enabled[pushed_axis]
        {
            return Err(ExcitationEnd::GateClosed);
        }
        Ok(())
    }

    /// Give the sink all rows except the newest `rows_left`, whose replies may still come.
    fn write_rows(&mut self, rows_left: usize) {
        let write_end = self.rows.len().saturating_sub(rows_left);
        let Some(row_sink) = &mut self.row_sink else {
            self.n_written = write_end;
            return;
        };
        while self.n_written < write_end {
            while self.guarded_device.in_lockstep() && !row_sink.has_room() {
                std::thread::sleep(CHECK_INTERVAL);
            }
            let next_row = &self.rows[self.n_written];
            let fresh_flag = if next_row.is_fresh { recording::flag::FRESH } else { 0 };
            let sample = recording::RecordedSample {
                position: next_row.position,
                force: next_row.requested_force,
                sent_force: next_row.sent_force as f32,
                flags: fresh_flag | recording::flag::FORCE_ENABLED,
                clock: next_row.clock,
            };
            row_sink.push_row(self.n_written as u64, &[sample]);
            self.n_written += 1;
        }
    }
}

#[cfg(test)]
mod tests;
