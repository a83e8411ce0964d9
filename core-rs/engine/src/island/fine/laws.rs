//! Single laws between points, by collocation: over a part of a frame the force of each is the polynomial that meets
//! its law at the three Gauss points, with the exact linear motion of all else between them. The method is implicit, of
//! order 6, and dissipates what the laws dissipate at any slope (Hairer, Nørsett & Wanner, II.7).

mod root;
mod state;
mod tables;

use super::basis::{Instant, dot};
use super::{Fine, Script};
use crate::maths::pow;
use crate::state::Body;
use root::{inverse, root};
use state::LawNow;
pub(super) use state::LawState;
use tables::Division;
pub(super) use tables::LawScript;
pub(super) use tables::shares;

/// Gauss points of a part of a frame, and their weights.
pub(super) const STAGES: usize = 3;
pub(super) const POINTS: [f64; STAGES] = [0.112_701_665_379_258_31, 0.5, 0.887_298_334_620_741_7];
pub(super) const WEIGHTS: [f64; STAGES] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
/// Most rounds until all forces agree; most rounds over a whole frame if it may be divided into parts; relative change
/// of a force, as a share of the largest, at which they agree.
const ROUNDS: usize = 60;
const FEW_ROUNDS: usize = 8;
const AGREE: f64 = 1e-9;

/// A frame that may be divided is taken as a whole if the polynomial of its forces, through the Gauss points, deviates
/// from the laws at both ends of the frame by less than this share of the largest force. A larger value divides fewer
/// frames, but unequal steps lose the cancellation of errors that equal steps have (a cubic spring: -72 dB at 1e-3,
/// -104 dB with whole frames alone).
const SMOOTH: f64 = 1e-6;
/// More parts than these come with a smaller share, by the cube of their number: else a trial that asks for them would
/// compute the same parts as one that does not, and see no error.
const PARTS: usize = 32;
/// Newton's method has failed if forces still change by more than this share of the largest.
const LOST: f64 = 1e-3;
/// Rounds over laws that are solved by bisection.
const BRACKET_ROUNDS: usize = 20;
/// Share of the largest force that is kept from frame to frame.
const FADE: f64 = 0.999;

pub(super) type Stages = [f64; STAGES];
pub(super) type Square = [Stages; STAGES];

impl Fine {
    /// Compute the laws of a frame in which no contact is near.
    pub(super) fn collocate(&mut self, script: &Script, laws: &LawScript, gates: &[f64]) {
        self.laws
            .iter_mut()
            .for_each(|state| state.look_ahead(laws));
        let finest = laws.divisions.len() - 1;
        let rounds = if finest == 0 { ROUNDS } else { FEW_ROUNDS };
        let left = self.solve(script, laws, (gates, 0), (0, rounds));
        if finest == 0 {
            if left > LOST {
                self.bracket(script, laws, (gates, 0, 0));
            }
            return self.give_laws(script, laws, (0, 0));
        }
        let is_met = left == 0.0;
        let missed = if is_met {
            self.missed(script, laws, gates)
        } else {
            1.0
        };
        if missed <= laws.smooth {
            return self.give_laws(script, laws, (0, 0));
        }
        // The deviation falls with the cube of the number of parts.
        let wanted = pow(missed / laws.smooth, 1.0 / 3.0);
        let finer = laws
            .divisions
            .partition_point(|division_index| (division_index.parts as f64) < wanted);
        let division_index = finer.clamp(1, finest);
        let division = &laws.divisions[division_index];
        for state in &mut self.laws {
            let first = [0, 1, 2].map(|stage: usize| shares(division.s[stage]));
            state.before = None;
            state.force = if is_met {
                first.map(|row| dot(&row, &state.force))
            } else {
                [state.begin; STAGES]
            };
        }
        for part in 0..division.parts {
            if part > 0 {
                for state in &mut self.laws {
                    state.look_ahead(laws);
                }
            }
            for state in &mut self.laws {
                state.see(division, part);
            }
            if self.solve(script, laws, (gates, division_index), (part, ROUNDS)) > LOST {
                self.bracket(script, laws, (gates, division_index, part));
            }
            self.give_laws(script, laws, (division_index, part));
            self.push_paths(script, division, part);
        }
        // Forces of parts of different lengths are not extrapolated together.
        self.laws.iter_mut().for_each(|state| state.before = None);
    }

    /// Solve for the forces of all laws in a part of a frame; returns their last change, relative to the largest, or 0
    /// if they agree.
    fn solve(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, law_index): (&[f64], usize),
        (part, rounds): (usize, usize),
    ) -> f64 {
        let mut last = 0.0;
        for _ in 0..rounds {
            let mut change = 0.0_f64;
            for law in 0..laws.links.len() {
                change = change.max(self.meet(script, laws, (gates, law_index, part), law));
            }
            // Estimate of the change still to come, from the ratio of the last two rounds: Newton's method squares the
            // change of one law, several laws approach each other step by step.
            let pace = change / last;
            let to_come = if laws.links.len() == 1 {
                pace * pace
            } else {
                pace
            };
            if change <= AGREE || (pace < 0.5 && change * to_come <= AGREE) {
                return 0.0;
            }
            last = change;
        }
        last
    }

    /// Find one force for each law over a part of a frame, equal to the law halfway, for laws so steep that Newton's
    /// method does not converge. It is of order 2; the force does not exceed the law, and its slope is not needed.
    fn bracket(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, division_index, part): (&[f64], usize, usize),
    ) {
        const MIDDLE: usize = 1;
        let (n_laws, division) = (laws.links.len(), &laws.divisions[division_index]);
        let s = division.s[STAGES * part + MIDDLE];
        for state in &mut self.laws {
            // The last forces of Newton's method may be arbitrary.
            (state.force, state.before) = ([state.begin; STAGES], None);
        }
        for _ in 0..BRACKET_ROUNDS {
            self.work.couplings += (n_laws * (n_laws - 1)) as u64;
            let mut change = 0.0_f64;
            for law in 0..n_laws {
                let state = &self.laws[law];
                let (mut e, mut v) = (state.elongation[MIDDLE], state.rate[MIDDLE]);
                let mut give = [0.0; 2];
                let pairs = self.laws.iter().zip(&division.moves[law * n_laws..]);
                for (other, (state, [by_x, by_v])) in pairs.enumerate() {
                    let [x, v_by] = [by_x, by_v].map(|by| by[MIDDLE].iter().sum::<f64>());
                    if other == law {
                        give = [x, v_by];
                    } else {
                        e += x * state.force[MIDDLE];
                        v += v_by * state.force[MIDDLE];
                    }
                }
                let now = self.law(script, laws, gates, (law, s));
                let taken = 1.0 / division.parts as f64;
                let halfway = |f: f64| (e + give[0] * f, (v + give[1] * f) * now.rate());
                let unmet = |f: f64| {
                    let (e, v) = halfway(f);
                    f - now.halfway(e, v, taken)
                };
                let old = state.force[MIDDLE];
                let (force, evaluations) = root(&unmet, old);
                self.work.instants += evaluations / STAGES as u64;
                change = change.max((force - old).abs() - AGREE * force.abs());
                if let Some(by) = now.bristle() {
                    let (_, v) = halfway(force);
                    let bristle = by.halfway(now.bristle, v, taken / now.rate());
                    self.laws[law].bristle_at_end = 2.0 * bristle - now.bristle;
                }
                self.laws[law].force = [force; STAGES];
            }
            if change <= 0.0 {
                break;
            }
        }
    }

    /// Push by the forces that were found for a part of a frame.
    fn give_laws(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (division_index, part): (usize, usize),
    ) {
        let (n, division) = (script.basis.n(), &laws.divisions[division_index]);
        let h = script.rate.step() / division.parts as f64;
        for (state, &link) in self.laws.iter_mut().zip(&laws.links) {
            let (a, b) = script.ends[link];
            let first = 3 * part;
            let forces = WEIGHTS.iter().zip(&state.force);
            for (stage, (weight, force)) in forces.enumerate() {
                let impulse = weight * h * force;
                let row = &division.value[(first + stage) * n..(first + stage + 1) * n];
                for (instant, share) in row.iter().enumerate() {
                    self.pushed[a * n + instant] += impulse * share;
                    self.pushed[b * n + instant] -= impulse * share;
                }
            }
            let greatest = state
                .force
                .iter()
                .fold(0.0_f64, |greatest, force| greatest.max(force.abs()));
            state.bristle = state.bristle_at_end;
            state.largest = greatest.max(if part == 0 { FADE } else { 1.0 } * state.largest);
        }
    }

    /// Add the effect of a part's forces to the paths of the laws in later parts.
    fn push_paths(&mut self, script: &Script, division: &Division, part: usize) {
        let (n, n_laws) = (script.basis.n(), self.laws.len());
        let h = script.rate.step() / division.parts as f64;
        self.work.products += (n_laws * n_laws * STAGES * n) as u64;
        for to in 0..n_laws {
            let mut path = std::mem::take(&mut self.laws[to].path);
            for (from, other) in self.laws.iter().enumerate() {
                let first = (to * n_laws + from) * division.parts + part;
                let rows = &division.later[3 * first * n..3 * (first + 1) * n];
                for (stage, row) in rows.chunks(n).enumerate() {
                    let impulse = WEIGHTS[stage] * h * other.force[stage];
                    for (x, by) in path.iter_mut().zip(row) {
                        *x += impulse * by;
                    }
                }
            }
            self.laws[to].path = path;
        }
    }

    /// Deviation of the forces of a whole frame from their laws at its two ends, relative to the largest.
    fn missed(&mut self, script: &Script, laws: &LawScript, gates: &[f64]) -> f64 {
        let n_laws = laws.links.len();
        let mut missed = 0.0_f64;
        for law_index in 0..n_laws {
            let state = &self.laws[law_index];
            let [mut e, mut v] = [0, 1].map(|which| dot(&laws.end[which], &state.path));
            for (other, [by_x, by_v]) in self.laws.iter().zip(&laws.moves_end[law_index * n_laws..])
            {
                e += dot(by_x, &other.force);
                v += dot(by_v, &other.force);
            }
            let law = LawNow {
                bristle: state.bristle_at_end,
                ..self.law(script, laws, gates, (law_index, 1.0))
            };
            let end_forces = [state.begin, law.force(e, v * law.rate())];
            let largest = (state.force.iter().chain(&end_forces))
                .fold(state.largest, |most, force| most.max(force.abs()));
            for (row, force) in laws.end_weights.iter().zip(end_forces) {
                let apart = (dot(row, &state.force) - force).abs();
                missed = missed.max(apart / largest.max(f64::MIN_POSITIVE));
            }
        }
        self.work.instants += n_laws as u64;
        self.work.couplings += (n_laws * (n_laws - 1)) as u64;
        missed
    }

    /// Newton's step for the forces of one law, with those of all others given; returns the change, relative to the
    /// largest.
    fn meet(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, division_index, part): (&[f64], usize, usize),
        law: usize,
    ) -> f64 {
        let n_laws = laws.links.len();
        let division = &laws.divisions[division_index];
        let (mut e, mut v) = (self.laws[law].elongation, self.laws[law].rate);
        for (other, [by_x, by_v]) in self.laws.iter().zip(&division.moves[law * n_laws..]) {
            for stage in 0..STAGES {
                e[stage] += dot(&by_x[stage], &other.force);
                v[stage] += dot(&by_v[stage], &other.force);
            }
        }
        let now = [0, 1, 2]
            .map(|stage| self.law(script, laws, gates, (law, division.s[3 * part + stage])));
        let h = 1.0 / division.parts as f64;
        self.work.instants += 1;
        self.work.couplings += n_laws as u64 - 1;
        let rate = now[0].rate();
        let v = v.map(|v| v * rate);
        let state = &mut self.laws[law];
        let moves = &division.moves[law * n_laws + law];
        let (force, left) = state.answer(&now, (&e, &v), (h, moves));
        let unmet: Stages = std::array::from_fn(|stage| force[stage] - state.force[stage]);
        let by = inverse(&left).map(|row| dot(&row, &unmet));
        let (mut change, mut largest) = (0.0_f64, f64::MIN_POSITIVE);
        for stage in 0..STAGES {
            state.force[stage] += by[stage];
            change = change.max(by[stage].abs());
            largest = largest.max(force[stage].abs());
        }
        change / largest
    }

    /// Compute elongation, rate and force of each law at the start of the frame, but not the force of an expression if
    /// the frame is collocated: `collocate` computes it together with those at the Gauss points.
    pub(super) fn start_laws(
        &mut self,
        script: &Script,
        laws: &LawScript,
        gates: &[f64],
        is_collocated: bool,
    ) {
        let n = script.basis.n();
        for (law_index, &link) in laws.links.iter().enumerate() {
            let ((a, b), rest) = (script.ends[link], script.links[link].rest);
            let [a, b] = [a, b].map(|end| &self.values[end * n..(end + 1) * n]);
            let law = self.law(script, laws, gates, (law_index, 0.0));
            let state = &mut self.laws[law_index];
            for ((x, a), b) in state.path.iter_mut().zip(a).zip(b) {
                *x = b - a - rest;
            }
            let [e, v] = state.see(&laws.divisions[0], 0);
            state.start = [e, v * law.rate()];
            if !(is_collocated && law.is_expression()) {
                state.begin = law.force(state.start[0], state.start[1]);
            }
        }
    }

    /// Write the force of each law at the start of the frame into `body.link`.
    pub(super) fn tell_laws(&self, script: &Script, laws: &LawScript, body: &mut Body) {
        for (state, &link) in self.laws.iter().zip(&laws.links) {
            body.link[script.links[link].first] = state.begin;
        }
    }

    /// A law as it is at an instant of this frame.
    fn law<'a>(
        &self,
        script: &'a Script,
        laws: &LawScript,
        gates: &[f64],
        (law_index, s): (usize, f64),
    ) -> LawNow<'a> {
        let link = laws.links[law_index];
        let run = &script.links[link];
        let [k, z] = self.numbers(link, s);
        LawNow {
            kind: &run.kind,
            open: run.gate.map_or(1.0, |gate| gates[gate]),
            k,
            z,
            bristle: self.laws[law_index].bristle,
        }
    }

    /// Move the bristles of laws on by `h` frames, at the rate of their ends at an instant of a frame of contacts.
    pub(super) fn slide_bristles(
        &mut self,
        script: &Script,
        (laws, gates): (&LawScript, &[f64]),
        (instant, h): (&Instant, f64),
    ) {
        for law_index in 0..laws.links.len() {
            let now = self.law(script, laws, gates, (law_index, instant.s));
            if let Some(by) = now.bristle() {
                let [_, v] = self.elongation(script, laws.links[law_index], instant);
                self.laws[law_index].bristle =
                    by.slide(now.bristle, v * now.rate(), h / now.rate());
            }
        }
    }

    /// Elongation of a link [m] and its rate [m/frame].
    pub(super) fn elongation(&self, script: &Script, link: usize, instant: &Instant) -> [f64; 2] {
        let n = script.basis.n();
        let (a, b) = script.ends[link];
        let [a, b] = [a, b].map(|end| &self.paths[end * n..(end + 1) * n]);
        let e = dot(b, &instant.value) - dot(a, &instant.value) - script.links[link].rest;
        [e, dot(b, &instant.slope) - dot(a, &instant.slope)]
    }

    /// A kick of a law that lasts `b` frames, in a frame of contacts.
    pub(super) fn kick_law(
        &mut self,
        script: &Script,
        (laws, gates): (&LawScript, &[f64]),
        law: usize,
        (instant, b): (&Instant, f64),
    ) {
        let link = laws.links[law];
        const AGAIN: usize = 4;
        let [e, v] = self.elongation(script, link, instant);
        let (a, b_end) = script.ends[link];
        let jump = script.jump(a, b_end);
        let (link_now, step) = (
            self.law(script, laws, gates, (law, instant.s)),
            script.rate.step(),
        );
        let mut impulse = 0.0;
        for _ in 0..AGAIN {
            // The rate halfway through the kick.
            let v = v - 0.5 * jump * impulse;
            impulse = b * step * link_now.force(e, v * link_now.rate());
        }
        self.work.instants += 1;
        self.shove(script, a, impulse, instant);
        self.shove(script, b_end, -impulse, instant);
    }
}
