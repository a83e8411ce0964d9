//! A linear body inside an island: its modes, pushed and seen at its ports.
//!
//! A body is always followed at least one frame ahead as if nothing pushed it: what does push it is added, for
//! it is linear. While nothing has for a while it is followed many frames ahead at once; where something
//! does after all, it goes back to that frame. What happens depends on frames alone, never on blocks.

mod between;

use std::sync::Arc;

use between::Between;

use crate::cell::Cell;
use crate::kernel::bank::{LANES, Lanes, Motion, Rates, Sum, follow, joined};
use crate::kernel::ports;
use crate::state::Body;
use crate::units::Rate;

/// Frames a body is followed ahead: enough to keep its modes in registers, few enough to lose.
const AHEAD: usize = 64;
/// Frames without a push after which it is: a contact that bounces is not over.
const QUIET: u32 = 16;

/// A point of a body that other modules touch.
#[derive(Clone, Debug)]
pub(crate) struct Port {
    /// The MAT in the island.
    pub(crate) mat: usize,
    /// Where it is when the body rests [m].
    pub(crate) rest: f64,
    /// How much of it each mode gives and feels   (n_modes)
    pub(crate) shape: Vec<f64>,
}

/// Strikes on one point of a body.
#[derive(Clone, Debug)]
pub(crate) struct Struck {
    /// How much of them each mode feels   (n_modes)
    pub(crate) shape: Vec<f64>,
    /// Frame, part of a frame after it, impulse [N·s]; rising.
    pub(crate) blows: Vec<(u64, f64, f64)>,
}

/// A mode of mass 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mode {
    /// x[n+1] = a·x[n] − b·x[n−1]
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// What a newton of one frame moves it by the next [m].
    pub(crate) gain: f64,
    pub(crate) now: f64,
    pub(crate) before: f64,
    /// Its continuous motion; none where a strike acts in one step.
    pub(crate) cell: Option<Cell>,
}

/// What a plan says of a body.
#[derive(Clone, Debug)]
pub(crate) struct Modal {
    pub(crate) modes: Vec<Mode>,
    pub(crate) ports: Vec<Port>,
    /// Outputs that hear it, and how much of each mode   (n_modes)
    pub(crate) heard: Vec<(u32, Vec<f64>)>,
    /// What outputs hear of where it rests.
    pub(crate) still: Vec<f64>,
    pub(crate) struck: Vec<Struck>,
    pub(crate) rate: Rate,
}

impl Modal {
    /// Started against forces that act on its ports at frame 0 (n_mat of the island): as any MAT, each mode
    /// comes from ½·F·gain further back.
    pub(super) fn pushed(&self, force: &[f64]) -> Self {
        let mut own = self.clone();
        for port in &self.ports {
            for (mode, share) in own.modes.iter_mut().zip(&port.shape) {
                if mode.cell.is_some() {
                    mode.before += 0.5 * mode.gain * share * force[port.mat];
                }
            }
        }
        own
    }

    /// Frequency of a mode [Hz], as its recurrence turns.
    pub(crate) fn frequency(&self, mode: usize) -> f64 {
        let Mode { a, b, .. } = self.modes[mode];
        let cosine = (a / (2.0 * b.sqrt())).clamp(-1.0, 1.0);
        let angle = std::f64::consts::FRAC_PI_2 - crate::maths::asin(cosine);
        match self.modes[mode].cell {
            Some(cell) => cell.frequency(),
            None => angle * self.rate.hertz() / std::f64::consts::TAU,
        }
    }

    /// What a newton for ever moves a mode by [m].
    pub(crate) fn compliance(&self, mode: usize) -> f64 {
        let Mode { a, b, gain, .. } = self.modes[mode];
        gain / (1.0 - a + b).max(f64::MIN_POSITIVE)
    }

    /// With some of the modes only.
    pub(crate) fn only(&self, kept: &[usize]) -> Self {
        let some = |shape: &[f64]| kept.iter().map(|&mode| shape[mode]).collect();
        Self {
            modes: kept.iter().map(|&mode| self.modes[mode]).collect(),
            ports: self
                .ports
                .iter()
                .map(|port| Port {
                    shape: some(&port.shape),
                    ..*port
                })
                .collect(),
            heard: self
                .heard
                .iter()
                .map(|(output, shape)| (*output, some(shape)))
                .collect(),
            still: self.still.clone(),
            struck: self
                .struck
                .iter()
                .map(|struck| Struck {
                    shape: some(&struck.shape),
                    blows: struck.blows.clone(),
                })
                .collect(),
            rate: self.rate,
        }
    }

    /// What a newton of one frame at a port moves the port itself by the next [m].
    pub(crate) fn give(&self, port: usize) -> f64 {
        let terms = self.modes.iter().zip(&self.ports[port].shape);
        terms.map(|(mode, share)| mode.gain * share * share).sum()
    }
}

/// What does not change while it plays.
#[derive(Clone, Debug)]
struct Script {
    plan: Modal,
    /// (n_groups)
    rates: Vec<Rates>,
    /// What each row sees of each group: ports first, then outputs   (n_groups, n_rows)
    rows: Vec<Vec<Lanes>>,
    /// What a newton at each port does to each group   (n_groups, n_ports)
    gains: Vec<Vec<Lanes>>,
    /// What a newton at each port moves each row by at the next frame   (n_rows, n_ports)
    moves: Vec<Vec<f64>>,
    /// By rising frame.
    blows: Vec<Blow>,
}

/// Its frame, which strikes, which of them, and whether it is the second step of two.
type Blow = (u64, usize, usize, bool);

/// A body that plays.
#[derive(Clone, Debug)]
pub(crate) struct Playing {
    script: Arc<Script>,
    /// As they are at the last frame of `seen`.
    motions: Vec<Motion>,
    /// As they are at the first.
    saved: Vec<Motion>,
    /// What each row sees, from some frame up to the furthest   (n_rows, ROOM)
    seen: Vec<f64>,
    /// Where the present is in `seen`, and the furthest: at least one more.
    at: usize,
    until: usize,
    /// Where the ports were one frame ago   (n_ports)
    was: Vec<f64>,
    sums: Vec<Sum>,
    kicks: Vec<Lanes>,
    /// What impulses between frames still have to add.
    pending: Vec<Lanes>,
    has_pending: bool,
    between: Option<Between>,
    forces: Vec<f64>,
    quiet: u32,
    next: usize,
}

/// Frames in `seen`: the present, and what follows.
const ROOM: usize = AHEAD + 1;

impl Playing {
    pub(crate) fn new(plan: &Modal) -> Self {
        let script = Script::new(plan);
        let groups = script.rates.len();
        let motions: Vec<Motion> = (0..groups)
            .map(|group| Motion {
                now: lanes(&plan.modes, group, |mode| plan.modes[mode].now),
                before: lanes(&plan.modes, group, |mode| plan.modes[mode].before),
            })
            .collect();
        let n_rows = plan.ports.len() + plan.heard.len();
        let sum = |shape: &[f64], of: fn(&Mode) -> f64| -> f64 {
            plan.modes
                .iter()
                .zip(shape)
                .map(|(mode, share)| of(mode) * share)
                .sum()
        };
        let mut playing = Self {
            saved: motions.clone(),
            seen: vec![0.0; n_rows * ROOM],
            at: 0,
            until: 0,
            was: plan
                .ports
                .iter()
                .map(|port| sum(&port.shape, |mode| mode.before))
                .collect(),
            sums: vec![Sum::ZERO; n_rows * AHEAD],
            kicks: vec![Lanes::ZERO; groups],
            pending: vec![Lanes::ZERO; groups],
            has_pending: false,
            between: None,
            forces: vec![0.0; plan.ports.len()],
            quiet: 0,
            next: 0,
            motions,
            script: Arc::new(script),
        };
        let rows = plan.ports.iter().map(|port| &port.shape);
        for (row, shape) in rows
            .chain(plan.heard.iter().map(|(_, shape)| shape))
            .enumerate()
        {
            playing.seen[row * ROOM] = sum(shape, |mode| mode.now);
        }
        playing.follow(0);
        playing
    }

    /// Add what is heard of the body now to `out` (n_out).
    pub(crate) fn tap(&self, out: &mut [f64]) {
        let plan = &self.script.plan;
        let first = plan.ports.len();
        for (row, ((output, _), still)) in plan.heard.iter().zip(&plan.still).enumerate() {
            out[*output as usize] += self.seen[(first + row) * ROOM + self.at] + still;
        }
    }

    /// Put the ports where they are, as they came there, and where they would go.
    pub(crate) fn place(&self, body: &mut Body) {
        for (row, port) in self.script.plan.ports.iter().enumerate() {
            let seen = &self.seen[row * ROOM + self.at..];
            body.x[port.mat] = seen[0] + port.rest;
            body.d[port.mat] = seen[0] - self.was[row];
            body.inner[port.mat] = (seen[1] - seen[0]) - (seen[0] - self.was[row]);
        }
    }

    /// Take the strikes of frame `n`: contacts are to know where the ports go with them.
    pub(crate) fn strike(&mut self, n: u64, body: &mut Body) {
        let is_due = |blow: &Blow| blow.0 <= n;
        if !self.script.blows.get(self.next).is_some_and(is_due) && !self.has_pending {
            return;
        }
        let script = self.script.clone();
        let due = |next: usize| script.blows.get(next).filter(|blow| is_due(blow));
        self.back(&script);
        if self.has_pending {
            std::mem::swap(&mut self.kicks, &mut self.pending);
            self.kick(&script);
            self.pending.fill(Lanes::ZERO);
            self.has_pending = false;
        }
        while let Some(&blow) = due(self.next) {
            self.next += 1;
            script.strike(blow, &mut self.kicks);
            self.kick(&script);
        }
        self.quiet = 0;
        self.place(body);
    }

    /// Add the kicks to the modes one frame ahead.
    fn kick(&mut self, script: &Script) {
        let motions = self.motions.iter_mut().zip(&self.kicks);
        for ((motion, kick), rows) in motions.zip(&script.rows) {
            ports::add(&mut motion.now, kick, 1.0);
            for (row, shape) in rows.iter().enumerate() {
                self.seen[row * ROOM + self.at + 1] += ports::see(shape, kick);
            }
        }
    }

    /// Raise the square of each mode (n_modes) to that of its amplitude now.
    pub(crate) fn squares(&self, squares: &mut [f64]) {
        let modes = self.script.plan.modes.iter().zip(squares);
        for (mode, (own, square)) in modes.enumerate() {
            let motion = &self.motions[mode / LANES];
            let (x, before) = (motion.now.0[mode % LANES], motion.before.0[mode % LANES]);
            // b = r² and a = 2r·cos θ: the frame before, as if it had not faded since.
            let (y, sine) = (before * own.b.sqrt(), 1.0 - own.a * own.a / (4.0 * own.b));
            let now = if sine > 0.0 {
                (x * x + y * y - x * before * own.a) / sine
            } else {
                x * x
            };
            *square = square.max(now);
        }
    }

    /// The MATs that are its ports.
    pub(crate) fn ports(&self) -> impl Iterator<Item = usize> + '_ {
        self.script.plan.ports.iter().map(|port| port.mat)
    }

    /// From frame `n` to the next, by the forces that the ports feel (n_mat).
    pub(crate) fn step(&mut self, n: u64, force: &[f64]) {
        let mut is_pushed = false;
        for (row, port) in self.script.plan.ports.iter().enumerate() {
            self.was[row] = self.seen[row * ROOM + self.at];
            self.forces[row] = force[port.mat];
            is_pushed |= self.forces[row] != 0.0;
        }
        if is_pushed {
            let script = self.script.clone();
            self.back(&script);
            self.push(&script);
            self.quiet = 0;
        } else {
            self.quiet = self.quiet.saturating_add(1);
        }
        self.at += 1;
        if self.at == self.until {
            self.follow(n + 1);
        }
    }

    /// Outputs that hear it.
    pub(crate) fn outputs(&self) -> Vec<u32> {
        let heard = self.script.plan.heard.iter();
        heard.map(|&(output, _)| output).collect()
    }

    /// Whether any of some MATs (n_mat) is a port.
    pub(crate) fn touches(&self, mats: &[bool]) -> bool {
        self.script.plan.ports.iter().any(|port| mats[port.mat])
    }

    /// To one frame ahead, from wherever the motions are.
    fn back(&mut self, script: &Script) {
        if self.until > self.at + 1 {
            self.until = self.at + 1;
            self.motions.clone_from_slice(&self.saved);
            for (rates, motion) in script.rates.iter().zip(&mut self.motions) {
                follow(rates, motion, &[], self.until, &mut [], 0);
            }
        }
    }

    /// Follow from the present, frame `n`, as far as nothing is known to happen.
    fn follow(&mut self, n: u64) {
        let script = self.script.clone();
        let blow = script.blows.get(self.next);
        let free = blow.map_or(u64::MAX, |blow| blow.0.saturating_sub(n));
        let far = if self.quiet < QUIET {
            1
        } else {
            free.clamp(1, AHEAD as u64) as usize
        };
        self.saved.clone_from_slice(&self.motions);
        for sums in self.sums.chunks_mut(AHEAD) {
            sums[..far].fill(Sum::ZERO);
        }
        for (group, motion) in self.motions.iter_mut().enumerate() {
            let (rates, rows) = (&script.rates[group], &script.rows[group]);
            follow(rates, motion, rows, far, &mut self.sums, AHEAD);
        }
        for (seen, sums) in self.seen.chunks_mut(ROOM).zip(self.sums.chunks(AHEAD)) {
            seen[0] = seen[self.at];
            for (seen, sum) in seen[1..].iter_mut().zip(&sums[..far]) {
                *seen = joined(sum);
            }
        }
        (self.at, self.until) = (0, far);
    }

    /// Add what the forces do by the next frame, which the motions are at.
    fn push(&mut self, script: &Script) {
        for (row, moves) in script.moves.iter().enumerate() {
            for (moves, force) in moves.iter().zip(&self.forces) {
                self.seen[row * ROOM + self.at + 1] += moves * force;
            }
        }
        for (motion, gains) in self.motions.iter_mut().zip(&script.gains) {
            for (gain, &force) in gains.iter().zip(&self.forces) {
                if force != 0.0 {
                    ports::add(&mut motion.now, gain, force);
                }
            }
        }
    }
}

/// One number of each mode of a group.
fn lanes(modes: &[Mode], group: usize, of: impl Fn(usize) -> f64) -> Lanes {
    let mut lanes = Lanes::ZERO;
    let members = group * LANES..modes.len().min((group + 1) * LANES);
    for (lane, mode) in lanes.0.iter_mut().zip(members) {
        *lane = of(mode);
    }
    lanes
}

impl Script {
    fn new(plan: &Modal) -> Self {
        let modes = &plan.modes;
        let groups = 0..modes.len().div_ceil(LANES);
        let ports = plan.ports.iter().map(|port| &port.shape);
        let rows: Vec<&Vec<f64>> = ports
            .chain(plan.heard.iter().map(|(_, shape)| shape))
            .collect();
        let gain = |port: &Port, mode: usize| modes[mode].gain * port.shape[mode];
        let moves = |row: &[f64]| {
            let by = |port| {
                (0..modes.len())
                    .map(|mode| row[mode] * gain(port, mode))
                    .sum()
            };
            plan.ports.iter().map(by).collect()
        };
        let group_rows = |group| {
            rows.iter()
                .map(|row| lanes(modes, group, |mode| row[mode]))
                .collect()
        };
        let group_gains = |group| {
            let ports = plan.ports.iter();
            ports
                .map(|port| lanes(modes, group, |mode| gain(port, mode)))
                .collect()
        };
        Self {
            rates: groups
                .clone()
                .map(|group| Rates {
                    a: lanes(modes, group, |mode| modes[mode].a),
                    b: lanes(modes, group, |mode| modes[mode].b),
                })
                .collect(),
            rows: groups.clone().map(group_rows).collect(),
            gains: groups.map(group_gains).collect(),
            moves: rows.iter().map(|row| moves(row)).collect(),
            blows: blows(plan),
            plan: plan.clone(),
        }
    }

    /// What one blow does to every mode.
    fn strike(&self, (_, strikes, blow, second): Blow, kicks: &mut [Lanes]) {
        let struck = &self.plan.struck[strikes];
        let (_, alpha, impulse) = struck.blows[blow];
        let (rate, step) = (self.plan.rate, self.plan.rate.step());
        for (mode, own) in self.plan.modes.iter().enumerate() {
            let impulse = impulse * struck.shape[mode];
            let by = match own.cell {
                Some(cell) => cell.split(impulse, alpha, rate)[usize::from(second)] * step * step,
                None => impulse * rate.hertz(),
            };
            kicks[mode / LANES].0[mode % LANES] = by;
        }
    }
}

fn blows(plan: &Modal) -> Vec<Blow> {
    let in_two = plan.modes.first().is_some_and(|mode| mode.cell.is_some());
    let mut blows = Vec::new();
    for (strikes, struck) in plan.struck.iter().enumerate() {
        for (blow, &(frame, _, _)) in struck.blows.iter().enumerate() {
            blows.push((frame, strikes, blow, false));
            if in_two {
                blows.push((frame + 1, strikes, blow, true));
            }
        }
    }
    blows.sort_by_key(|blow| blow.0);
    blows
}
