//! A passivity observer and controller in the time domain (B. Hannaford, J.-H. Ryu, "Time-Domain Passivity Control of
//! Haptic Interfaces", IEEE Trans. Robotics and Automation 18(1), 2002).
//!
//! The observer adds up the work of the motor on the key, f·Δx (their eq. 5). A partner may move a hand, so the work
//! may be positive: there is an allowance, and a power that fills it up. The delay of a force is known to some ticks at
//! best, and a wrong pairing of force and motion hides work. So the work is added up for every delay that can be, and
//! the greatest sum counts. A position is off by half a step of its sensor at most, which hides the work Σ f·Δe, by parts
//! Σ e·Δf: half a step times every change of force, at most. So much is added.
//!
//! Their controller is a damper that takes back what was too much, one tick later. Here forces are under way for some
//! ticks: a damper α that is so late is unstable by itself from α = π·m/(2·delay) on, and the velocity of a coarse sensor
//! makes it push by noise. So this controller acts beforehand: a force passes as far as the work that it and the forces
//! under way can still do fits into the rest of the allowance. A force that brakes the key passes.

use super::super::limits::Limits;
use crate::safety::contract::Spec;
use crate::wire::MAX_AXES;

/// Forces and positions that are remembered.
const HISTORY: usize = 64;
/// Delays beyond the one that the device names: a reply that misses its tick, a queue on the board [ticks].
const MORE: usize = 4;
/// The longest delay that is tried [ticks].
const LONGEST: usize = 31;
/// Most ticks between two positions over which forces are averaged.
const GAP: u64 = (HISTORY - LONGEST - 1) as u64;
/// Mass of a key that does not tell it [kg]. A light key reacts most, so this is lighter than any.
const LIGHT: f64 = 0.01;
/// Part of a mass that is told which is counted on: a force that brakes a lighter key drives it back.
const SURE: f64 = 0.5;
/// A velocity is taken over as many ticks as make one step of the sensor slower than this [m/s].
const SLOW: f64 = 0.05;

/// The work of a device's motors.
#[derive(Clone, Debug)]
pub(in crate::safety) struct Passivity {
    /// What the work may reach [J], and how fast that is filled up [W].
    energy: f64,
    power: f64,
    /// Of a tick [s].
    period: f64,
    /// Moving mass, the least that it may be [kg].
    mass: f64,
    /// Step of the position sensor [m].
    step: f64,
    /// Positions that a velocity is taken over.
    span: u64,
    /// The longest delay of a force [ticks].
    delay: usize,
    /// Forces sent so far, and how many of them when the newest position came.
    sent: u64,
    seen: u64,
    /// Positions so far, and their times [s].
    n: u64,
    times: [f64; HISTORY],
    axes: [Axis; MAX_AXES],
}

#[derive(Clone, Copy, Debug)]
struct Axis {
    forces: [f64; HISTORY],
    positions: [f64; HISTORY],
    /// Work on the key by the delay, less what the power has filled up [J].
    work: [f64; LONGEST + 1],
    /// [m/s], and how far off it may be for the sensor's step.
    velocity: f64,
    blur: f64,
}

/// Where a number's entry is.
fn slot(number: u64) -> usize {
    (number % HISTORY as u64) as usize
}

impl Passivity {
    pub(in crate::safety) fn new(
        spec: &Spec,
        limits: &Limits,
        period: f64,
        in_lockstep: bool,
    ) -> Self {
        let own = (spec.loop_delay_s.unwrap_or(0.0) / period).ceil() as usize;
        // By a clock a reply says where the key was when the force arrived; in lockstep, where the force took it.
        let delay = own + usize::from(!in_lockstep) + MORE;
        let longest = (limits.velocity_over / period).clamp(1.0, GAP as f64);
        let span = (spec.pos_lsb / (SLOW * period)).ceil().clamp(1.0, longest);
        Self {
            energy: limits.energy,
            power: limits.power,
            period,
            mass: spec.inertia.map_or(LIGHT, |told| SURE * told),
            step: spec.pos_lsb,
            span: span as u64,
            delay: delay.min(LONGEST),
            sent: 0,
            seen: 0,
            n: 0,
            times: [0.0; HISTORY],
            axes: [Axis {
                forces: [0.0; HISTORY],
                positions: [0.0; HISTORY],
                work: [0.0; LONGEST + 1],
                velocity: 0.0,
                blur: 0.0,
            }; MAX_AXES],
        }
    }

    /// Forces go out (n_axes,) [N].
    pub(in crate::safety) fn send(&mut self, forces: &[f64]) {
        for (axis, force) in self.axes.iter_mut().zip(forces) {
            axis.forces[slot(self.sent)] = *force;
        }
        self.sent += 1;
    }

    /// The forces that were about to go out did not.
    pub(in crate::safety) fn withdraw(&mut self) {
        for axis in &mut self.axes {
            axis.forces[slot(self.sent.wrapping_sub(1))] = 0.0;
        }
    }

    /// Positions came (n_axes,) [m], `since` [s] after those before.
    pub(in crate::safety) fn receive(&mut self, positions: &[f64], since: f64) {
        let ticks = (self.sent - self.seen).clamp(1, GAP);
        let (last, at) = (slot(self.n.wrapping_sub(1)), slot(self.n));
        self.times[at] = self.times[last] + since;
        let first = slot(self.n - self.span.min(self.n));
        let time = self.times[at] - self.times[first];
        for (axis, &x) in self.axes.iter_mut().zip(positions) {
            let before = if self.n == 0 { x } else { axis.positions[last] };
            axis.positions[at] = x;
            for (delay, work) in axis.work[..=self.delay].iter_mut().enumerate() {
                let newest = self.sent.wrapping_sub(delay as u64);
                let force = |ago: u64| axis.forces[slot(newest.wrapping_sub(ago))];
                let mean = (1..=ticks).map(force).sum::<f64>() / ticks as f64;
                let changed: f64 = (1..=ticks)
                    .map(|ago| (force(ago) - force(ago + 1)).abs())
                    .sum();
                let done = mean * (x - before) + 0.5 * self.step * changed;
                *work = filled_up(*work + done, self.power * since, self.energy);
            }
            if time > 0.0 {
                axis.velocity = (x - axis.positions[first]) / time;
                axis.blur = self.step / time;
            }
        }
        (self.n, self.seen) = (self.n + 1, self.sent);
    }

    /// The work on an axis [J], for the delay that makes it greatest.
    pub(in crate::safety) fn work(&self, axis: usize) -> f64 {
        let works = &self.axes[axis].work[..=self.delay];
        works.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// An axis had done this work [J] before.
    pub(in crate::safety) fn resume(&mut self, axis: usize, work: f64) {
        self.axes[axis].work = [work; LONGEST + 1];
    }

    /// The least and the greatest force that may go out now [N]; zero is between them.
    ///
    /// A force f that acts for a tick T on a mass m which then moves with w does the work f·w·T + f²T²/(2m).
    pub(in crate::safety) fn room(&self, axis: usize) -> [f64; 2] {
        let own = &self.axes[axis];
        let force = |ago: u64| own.forces[slot(self.sent.wrapping_sub(ago))];
        let unseen = (self.delay as u64 + self.sent - self.seen).min(HISTORY as u64);
        let felt = (unseen + self.span).min(HISTORY as u64);
        // How far the forces under way, and those since the velocity was taken, may change it.
        let push: f64 = (1..=felt).map(|ago| force(ago).abs()).sum();
        let change = push * self.period / self.mass + own.blur;
        let towards = |side: f64| side * own.velocity + change;
        let may_do = |force: f64| force.abs() * towards(force.signum()).max(0.0) * self.period;
        let reserved: f64 = (1..=unseen).map(|ago| may_do(force(ago))).sum();
        let left = (self.energy - self.work(axis) - reserved).max(0.0);
        let most = |side: f64| {
            let w = towards(side);
            let reach = (w * w + 2.0 * left / self.mass).sqrt();
            (reach - w).max(0.0) * self.mass / self.period
        };
        [-most(-1.0), most(1.0)]
    }
}

/// Work that is drawn towards zero by what was filled up. What a hand gave pays for what it gets back, as a spring
/// gives it, but up to the allowance and not for long.
fn filled_up(work: f64, filled: f64, allowance: f64) -> f64 {
    if work > 0.0 {
        (work - filled).max(0.0)
    } else {
        (work.max(-allowance) + filled).min(0.0)
    }
}
