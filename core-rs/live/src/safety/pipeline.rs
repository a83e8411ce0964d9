//! The stages, in their order. Each leaves a force within its limits as it is, to the last bit.

use super::counts::Counts;
use super::force::SafeForce;
use super::limits::Limits;
use crate::device::{MAX_AXES, Spec};

pub(super) struct Pipeline {
    limits: Limits,
    /// Continuous and peak force of the device [N].
    continuous: f64,
    peak: f64,
    /// Of a tick [s].
    period: f64,
    n: usize,
    axes: [Axis; MAX_AXES],
    counts: Counts,
    /// Since the last position [ticks]; none has come yet.
    age: Option<u32>,
    stopped: bool,
}

#[derive(Clone, Copy, Default)]
struct Axis {
    gain: f64,
    position: Option<f64>,
    velocity: f64,
    /// What the slew limiter let through last.
    slewed: f64,
    sent: f64,
    /// Mean of (force / continuous force)².
    heat: f64,
    /// Energy that went into the hand beyond what it takes for ever [J].
    given: f64,
    /// From the start to full force, 0 to 1.
    ramp: f64,
    /// From a trip to full force, 0 to 1.
    recovered: f64,
    /// The same after stale positions.
    fresh: f64,
    /// How long it is still tripped [s].
    held: f64,
}

/// A factor below 1 is a stage that acts; 1 must not even round.
fn faded(force: f64, factor: f64, count: &mut u64) -> f64 {
    if factor >= 1.0 {
        return force;
    }
    *count += 1;
    force * factor
}

impl Pipeline {
    pub(super) fn new(spec: &Spec, limits: Limits, period: f64) -> Self {
        Self {
            limits,
            continuous: spec.force_max_continuous,
            peak: spec.force_max_peak,
            period,
            n: spec.dof.min(MAX_AXES),
            axes: [Axis {
                gain: 1.0,
                recovered: 1.0,
                fresh: 1.0,
                ..Axis::default()
            }; MAX_AXES],
            counts: Counts::default(),
            age: None,
            stopped: false,
        }
    }

    pub(super) fn pass(&mut self, asked: &[f64]) -> SafeForce {
        self.counts.ticks += 1;
        self.age = self.age.map(|age| age.saturating_add(1));
        let old = self.period * f64::from(self.age.unwrap_or(u32::MAX));
        let stale = self.age.is_none() || old > self.limits.stale;
        let mut out = [0.0; MAX_AXES];
        for (axis, out) in out[..self.n].iter_mut().enumerate() {
            let asked = asked.get(axis).copied().unwrap_or(0.0);
            *out = self.stages(axis, asked, stale);
            self.axes[axis].sent = *out;
        }
        SafeForce::new(out, self.n)
    }

    fn stages(&mut self, axis: usize, asked: f64, stale: bool) -> f64 {
        let Self {
            limits,
            counts,
            period,
            ..
        } = self;
        let (axis, period) = (&mut self.axes[axis], *period);
        let mut force = asked;
        // A force that is no number.
        if !force.is_finite() {
            counts.not_finite += 1;
            counts.trips_not_finite += u64::from(axis.held <= 0.0);
            axis.held = limits.hold;
            force = 0.0;
        }
        // Too great; where the motor is hot, what it bears for long is the greatest.
        let most = limits.force.min(self.peak);
        if force.abs() > most {
            counts.clamped += 1;
            force = most.copysign(force);
        }
        if axis.heat > 1.0 && force.abs() > self.continuous {
            counts.hot += 1;
            force = self.continuous.copysign(force);
        }
        // Too sudden.
        let step = limits.slew * 1e3 * period;
        if (force - axis.slewed).abs() > step {
            counts.slewed += 1;
            force = axis.slewed + step.copysign(force - axis.slewed);
        }
        axis.slewed = force;
        // The start.
        axis.ramp = risen(axis.ramp, period, limits.ramp);
        force = faded(force, axis.ramp, &mut counts.ramped);
        // Too fast.
        if axis.velocity.abs() > limits.velocity {
            counts.trips_speed += u64::from(axis.held <= 0.0);
            axis.held = limits.hold;
        }
        if axis.held > 0.0 {
            axis.held -= period;
            axis.recovered = 0.0;
        } else {
            axis.recovered = risen(axis.recovered, period, limits.fade);
        }
        force = faded(force, axis.recovered, &mut counts.tripped);
        // Nobody knows where it is.
        axis.fresh = if stale {
            0.0
        } else {
            risen(axis.fresh, period, limits.fade)
        };
        force = faded(force, axis.fresh, &mut counts.stale);
        // Too much energy went into the hand: only what brakes it passes.
        if axis.given > limits.energy && force * axis.velocity > 0.0 {
            counts.energy += 1;
            force = 0.0;
        }
        // Too stiff a coupling.
        force = faded(force, axis.gain, &mut counts.stiff);
        // Nobody wants it.
        if self.stopped {
            counts.stopped += 1;
            force = 0.0;
        }
        let load = (force / self.continuous) * (force / self.continuous);
        axis.heat += (load - axis.heat) * (period / limits.heat);
        force
    }

    /// Where the axes are now, in SI units.
    pub(super) fn observe(&mut self, position: &[f64; MAX_AXES]) {
        let since = self.period * f64::from(self.age.unwrap_or(1).max(1));
        let weight = (since / self.limits.velocity_over).min(1.0);
        for (axis, &x) in self.axes[..self.n].iter_mut().zip(position) {
            let moved = x - axis.position.unwrap_or(x);
            axis.position = Some(x);
            axis.velocity += (moved / since - axis.velocity) * weight;
            let given = axis.given + axis.sent * moved - self.limits.power * since;
            axis.given = given.max(0.0);
        }
        self.age = Some(0);
    }

    /// The next force starts from zero, as after a pause.
    pub(super) fn forget(&mut self) {
        for axis in &mut self.axes {
            (axis.slewed, axis.sent) = (0.0, 0.0);
        }
    }

    pub(super) fn stop(&mut self, stopped: bool) {
        if self.stopped && !stopped {
            for axis in &mut self.axes {
                axis.ramp = 0.0;
            }
        }
        self.stopped = stopped;
        self.forget();
    }

    pub(super) fn scale(&mut self, axis: usize, gain: f64) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.gain = if gain.is_nan() {
                0.0
            } else {
                gain.clamp(0.0, 1.0)
            };
        }
    }

    pub(super) fn tripped(&self, axis: usize) -> bool {
        self.axes.get(axis).is_some_and(|axis| axis.held > 0.0)
    }

    pub(super) fn counts(&self) -> &Counts {
        &self.counts
    }
}

/// A ramp over `whole` [s], one tick on.
fn risen(ramp: f64, period: f64, whole: f64) -> f64 {
    if whole > 0.0 {
        (ramp + period / whole).min(1.0)
    } else {
        1.0
    }
}
