//! Single laws between points, by collocation: over a part of a frame the force of each is the polynomial that meets its
//! law at the three Gauss points, with the exact linear motion of all else between them. Its order is 6, its equations
//! are implicit, and it damps what the laws damp at any slope (Hairer, Nørsett & Wanner, II.7).

use super::basis::{At, dot};
use super::{Fine, Script};
use crate::scheme::Kind;
use crate::state::Body;

/// Gauss points of a part of a frame, and what each weighs.
const STAGES: usize = 3;
const POINTS: [f64; STAGES] = [0.112_701_665_379_258_31, 0.5, 0.887_298_334_620_741_7];
const WEIGHTS: [f64; STAGES] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
/// Rounds until all forces agree, each to this part of the largest; their slopes are looked up again every few.
const ROUNDS: usize = 60;
const AGREE: f64 = 1e-11;
const LOOK_AGAIN: usize = 4;
/// Steps of the differences that tell a law's slopes, relative to what is looked at and at least [m, m/s].
const NEAR: (f64, f64) = (1e-6, 1e-9);

type Square = [[f64; STAGES]; STAGES];

/// What does not change.
#[derive(Clone, Debug)]
pub(super) struct LawScript {
    /// Which of the script's links are laws.
    pub(super) links: Vec<usize>,
    /// Parts of a frame that are solved one after the other.
    parts: usize,
    /// The polynomials at the Gauss points of each part   (parts, 3)
    at: Vec<[At; STAGES]>,
    /// What the force of one law makes of another's elongation and rate at the Gauss points   (n_laws², 3, 3)
    moves: Vec<[Square; 2]>,
    /// The force at the next part's Gauss points by those of this one.
    ahead: Square,
}

/// A law that plays.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LawState {
    /// At the Gauss points of the last part [N], and what is known of this one's.
    force: [f64; STAGES],
    elongation: [f64; STAGES],
    rate: [f64; STAGES],
    /// The inverse of what a change of the forces leaves unmet.
    inverse: Square,
    is_known: bool,
}

/// A law at one instant.
#[derive(Clone, Copy)]
struct LawNow<'a> {
    kind: &'a Kind,
    /// How far its gate is open.
    open: f64,
    /// Of a law whose K and Z are led: [N/m, N·frame/m].
    k: f64,
    z: f64,
}

impl LawScript {
    pub(super) fn new(script: &Script) -> Self {
        let is_law = |index: &usize| !matches!(script.links[*index].kind, Kind::But(_));
        let links: Vec<usize> = (0..script.links.len()).filter(is_law).collect();
        let parts = (script.steps / 2).max(1);
        let (n, h) = (script.basis.n(), 1.0 / parts as f64);
        let at = |part: usize| POINTS.map(|c| At::new(n, (part as f64 + c) * h));
        let pair = |pair: usize| {
            let ends = [pair / links.len(), pair % links.len()].map(|law| script.ends[links[law]]);
            script.coupled(ends, h)
        };
        Self {
            parts,
            at: (0..parts).map(at).collect(),
            moves: (0..links.len() * links.len()).map(pair).collect(),
            ahead: POINTS.map(|c| shares(1.0 + c)),
            links,
        }
    }
}

/// Of the polynomial through the Gauss points: what each value counts at `s`, in parts.
fn shares(s: f64) -> [f64; STAGES] {
    let mut shares = [1.0; STAGES];
    for (own, share) in shares.iter_mut().enumerate() {
        for other in (0..STAGES).filter(|&other| other != own) {
            *share *= (s - POINTS[other]) / (POINTS[own] - POINTS[other]);
        }
    }
    shares
}

impl Script {
    /// What the force of a law between `from` makes of the elongation between `to` and of its rate, at the Gauss points
    /// of a part of `h` frames.
    fn coupled(&self, [to, from]: [(usize, usize); 2], h: f64) -> [Square; 2] {
        let n = self.basis.n();
        let mut found = [[[0.0; STAGES]; STAGES]; 2];
        for (row, c) in POINTS.into_iter().enumerate() {
            let end = At::new(n, c * h);
            // Gauss points again, of the time up to this one: exact for what is smooth to order 6.
            for half in 0..2 {
                for (point, weight) in POINTS.into_iter().zip(WEIGHTS) {
                    let part = 0.5 * (half as f64 + point) * c;
                    let start = At::new(n, part * h);
                    let weight = 0.5 * weight * c * h * self.rate.step();
                    for (sign_to, to) in [(-1.0, to.0), (1.0, to.1)] {
                        for (sign_from, from) in [(1.0, from.0), (-1.0, from.1)] {
                            let [x, v] = self.answer([from, to], [&start, &end]);
                            for (column, share) in shares(part).into_iter().enumerate() {
                                let by = sign_to * sign_from * weight * share;
                                found[0][row][column] += by * x;
                                found[1][row][column] += by * v;
                            }
                        }
                    }
                }
            }
        }
        found
    }

    /// What an impulse at one joint makes of another's position [m/N·s] and velocity [m/frame per N·s].
    fn answer(&self, [from, to]: [usize; 2], [start, end]: [&At; 2]) -> [f64; 2] {
        let n = self.basis.n();
        let mut found = [0.0; 2];
        let moves = &self.moves[from * self.joints.len() + to];
        for (row, share) in moves.chunks(n).zip(&start.value) {
            found[0] += share * dot(row, &end.value);
            found[1] += share * dot(row, &end.slope);
        }
        found
    }
}

impl Fine {
    /// The laws of a frame in which no contact is near.
    pub(super) fn collocate(&mut self, script: &Script, laws: &LawScript, gates: &[f64]) {
        let (n, n_laws) = (script.basis.n(), laws.links.len());
        let h = 1.0 / laws.parts as f64;
        for at in &laws.at {
            for (state, &link) in self.laws.iter_mut().zip(&laws.links) {
                let (a, b) = script.ends[link];
                let [a, b] = [a, b].map(|end| &self.way[end * n..(end + 1) * n]);
                for (stage, at) in at.iter().enumerate() {
                    let rest = script.links[link].rest;
                    state.elongation[stage] = dot(b, &at.value) - dot(a, &at.value) - rest;
                    state.rate[stage] = dot(b, &at.slope) - dot(a, &at.slope);
                }
                state.force = laws.ahead.map(|row| dot(&row, &state.force));
            }
            for round in 0..ROUNDS {
                let mut is_met = true;
                for own in 0..n_laws {
                    is_met &= self.meet(script, laws, (gates, at), (own, round));
                }
                if is_met {
                    break;
                }
            }
            for (own, &link) in laws.links.iter().enumerate() {
                let (a, b) = script.ends[link];
                for (stage, at) in at.iter().enumerate() {
                    let force = self.laws[own].force[stage];
                    let impulse = WEIGHTS[stage] * h * script.rate.step() * force;
                    self.shove(script, a, impulse, at);
                    self.shove(script, b, -impulse, at);
                }
            }
        }
    }

    /// Bring the forces of one law nearer to it, those of all others given; says whether they met it.
    fn meet(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, at): (&[f64], &[At; STAGES]),
        (own, round): (usize, usize),
    ) -> bool {
        let link = laws.links[own];
        let forces = at.map(|at| self.law(script, gates, (link, at.s)));
        let rate = forces[0].rate();
        let n_laws = laws.links.len();
        let (mut e, mut v) = (self.laws[own].elongation, self.laws[own].rate);
        for (other, [by_x, by_v]) in self.laws.iter().zip(&laws.moves[own * n_laws..]) {
            for stage in 0..STAGES {
                e[stage] += dot(&by_x[stage], &other.force);
                v[stage] += dot(&by_v[stage], &other.force);
            }
        }
        self.work.instants += 1;
        let state = &mut self.laws[own];
        let mut unmet = [0.0; STAGES];
        let mut largest = f64::MIN_POSITIVE;
        for stage in 0..STAGES {
            let force = forces[stage].at(e[stage], v[stage] * rate);
            unmet[stage] = force - state.force[stage];
            largest = largest.max(force.abs());
        }
        if !state.is_known || round % LOOK_AGAIN == LOOK_AGAIN - 1 {
            let [by_x, by_v] = &laws.moves[own * n_laws + own];
            let mut left = [[0.0; STAGES]; STAGES];
            for stage in 0..STAGES {
                let force = |e: f64, v: f64| forces[stage].at(e, v);
                let [k, z] = slopes(&force, e[stage], v[stage] * rate);
                for column in 0..STAGES {
                    let one = if column == stage { 1.0 } else { 0.0 };
                    left[stage][column] =
                        one - k * by_x[stage][column] - z * rate * by_v[stage][column];
                }
            }
            state.inverse = inverse(&left);
            state.is_known = true;
            self.work.instants += 1;
        }
        let mut change = 0.0_f64;
        for stage in 0..STAGES {
            let by = dot(&state.inverse[stage], &unmet);
            state.force[stage] += by;
            change = change.max(by.abs());
        }
        change <= AGREE * largest
    }

    /// Forces of all laws at the start of the frame, for those who listen.
    pub(super) fn tell_laws(
        &self,
        script: &Script,
        laws: &LawScript,
        gates: &[f64],
        body: &mut Body,
    ) {
        let at = At::new(script.basis.n(), 0.0);
        for &link in &laws.links {
            let [e, v] = self.elongation(script, link, &at);
            let run = &script.links[link];
            let law = self.law(script, gates, (link, 0.0));
            body.link[run.first] = law.at(e, v * law.rate());
        }
    }

    /// A law as it is at an instant of this frame.
    fn law<'a>(&self, script: &'a Script, gates: &[f64], (link, s): (usize, f64)) -> LawNow<'a> {
        let run = &script.links[link];
        let [k, z] = self.numbers(link, s);
        LawNow {
            kind: &run.kind,
            open: run.gate.map_or(1.0, |gate| gates[gate]),
            k,
            z,
        }
    }

    /// Elongation of a link [m] and its rate [m/frame].
    pub(super) fn elongation(&self, script: &Script, link: usize, at: &At) -> [f64; 2] {
        let n = script.basis.n();
        let (a, b) = script.ends[link];
        let [a, b] = [a, b].map(|end| &self.way[end * n..(end + 1) * n]);
        let e = dot(b, &at.value) - dot(a, &at.value) - script.links[link].rest;
        [e, dot(b, &at.slope) - dot(a, &at.slope)]
    }

    /// A kick of a law that lasts `b` frames, in a frame of contacts.
    pub(super) fn kick_law(
        &mut self,
        script: &Script,
        gates: &[f64],
        link: usize,
        (at, b): (&At, f64),
    ) {
        const AGAIN: usize = 4;
        let [e, v] = self.elongation(script, link, at);
        let (a, b_end) = script.ends[link];
        let jump = script.jump(a, b_end);
        let (own, step) = (self.law(script, gates, (link, at.s)), script.rate.step());
        let mut impulse = 0.0;
        for _ in 0..AGAIN {
            // Halfway through the kick.
            let v = v - 0.5 * jump * impulse;
            impulse = b * step * own.at(e, v * own.rate());
        }
        self.work.instants += 1;
        self.shove(script, a, impulse, at);
        self.shove(script, b_end, -impulse, at);
    }
}

impl LawNow<'_> {
    /// A rate of elongation [m/frame] times this is what the law takes.
    fn rate(&self) -> f64 {
        match self.kind {
            Kind::Lnl { rate, .. } => *rate,
            _ => 1.0,
        }
    }

    /// Its force at an elongation and a rate [N].
    fn at(&self, e: f64, v: f64) -> f64 {
        let force = match self.kind {
            Kind::Lnl { law, .. } => law.force(e, v),
            Kind::Hardening(q) => self.k * e + q * e * e * e + self.z * v,
            _ => 0.0,
        };
        self.open * force
    }
}

/// Slopes of a force in the elongation and in its rate [N/m, N·s/m].
fn slopes(force: &impl Fn(f64, f64) -> f64, e: f64, v: f64) -> [f64; 2] {
    let [by_e, by_v] = [e, v].map(|at| NEAR.0 * at.abs() + NEAR.1);
    [
        (force(e + by_e, v) - force(e - by_e, v)) / (2.0 * by_e),
        (force(e, v + by_v) - force(e, v - by_v)) / (2.0 * by_v),
    ]
}

fn inverse(m: &Square) -> Square {
    let cofactor = |row: usize, column: usize| {
        let [r, s] = [(row + 1) % 3, (row + 2) % 3];
        let [c, d] = [(column + 1) % 3, (column + 2) % 3];
        m[r][c] * m[s][d] - m[r][d] * m[s][c]
    };
    let whole: f64 = (0..STAGES)
        .map(|column| m[0][column] * cofactor(0, column))
        .sum();
    let mut inverse = [[0.0; STAGES]; STAGES];
    for (row, own) in inverse.iter_mut().enumerate() {
        for (column, own) in own.iter_mut().enumerate() {
            *own = cofactor(column, row) / whole;
        }
    }
    inverse
}
