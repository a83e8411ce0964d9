//! Single laws between points, by collocation: over a part of a frame the force of each is the polynomial that meets its
//! law at the three Gauss points, with the exact linear motion of all else between them. Its order is 6, its equations
//! are implicit, and it damps what the laws damp at any slope (Hairer, Nørsett & Wanner, II.7).

use super::basis::{At, dot};
use super::{Fine, Script};
use crate::law::Scratch;
use crate::maths::pow;
use crate::scheme::Kind;
use crate::state::Body;

/// Gauss points of a part of a frame, and what each weighs.
const STAGES: usize = 3;
const POINTS: [f64; STAGES] = [0.112_701_665_379_258_31, 0.5, 0.887_298_334_620_741_7];
const WEIGHTS: [f64; STAGES] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
/// Rounds until all forces agree, each to this part of the largest; rounds of a frame as a whole, where it may be taken
/// in parts; slopes are looked up again every few rounds.
const ROUNDS: usize = 60;
const FEW_ROUNDS: usize = 8;
const AGREE: f64 = 1e-9;
const LOOK_AGAIN: usize = 3;
/// Steps of the differences that tell a law's slopes, relative to what is looked at and at least [m, m/s].
const NEAR: (f64, f64) = (1e-6, 1e-9);
/// A frame that may be taken in parts is taken as a whole where its forces, by the polynomial through its Gauss points,
/// miss their laws at both its ends by less than this part of the largest. Not by more: steps that follow the swing lose
/// the balance of errors that even steps have (a cubic spring: -72 dB at 1e-3, -104 dB by whole frames alone).
const SMOOTH: f64 = 1e-6;
/// Forces that still change by more than this part of the largest are not found by Newton's steps.
const LOST: f64 = 1e-3;
/// Rounds over laws that are found by halving, how often an interval is doubled and halved, and the first one relative to
/// what is unmet.
const BRACKET_ROUNDS: usize = 20;
const HALVINGS: u64 = 64;
const FIRST_LOOK: f64 = 0.01;
/// Of the largest force so much stays from frame to frame.
const FADE: f64 = 0.999;

type Stages = [f64; STAGES];
type Square = [Stages; STAGES];

/// A frame in so many parts, which are solved one after the other.
#[derive(Clone, Debug)]
struct Division {
    parts: usize,
    /// Instants of the Gauss points   (parts·3)
    s: Vec<f64>,
    /// What each value at the instants of a frame counts in the value, and in the slope, at each Gauss point   (parts·3, n)
    value: Vec<f64>,
    slope: Vec<f64>,
    /// What the force of one law makes of another's elongation and rate at the Gauss points of its part   (n_laws²)
    moves: Vec<[Square; 2]>,
    /// What an impulse of one law at each Gauss point makes of another's elongation at the instants of a frame, for the
    /// parts after it   (n_laws², parts·3, n)
    later: Vec<f64>,
}

/// What does not change.
#[derive(Clone, Debug)]
pub(super) struct LawScript {
    /// Which of the script's links are laws.
    pub(super) links: Vec<usize>,
    /// Parts of a frame: 1, 2, 4, and so on.
    divisions: Vec<Division>,
    /// What each value at the instants of a frame counts in the value, and in the slope, at its ends   (n each)
    ends: [[Vec<f64>; 2]; 2],
    /// What the force of one law makes of another's elongation and rate at the end of a frame that is taken as a
    /// whole   (n_laws²)
    moves_end: Vec<[[f64; STAGES]; 2]>,
    /// Of the polynomial of a part's forces: what each counts at the next part's Gauss points.
    ahead: Square,
    /// The same, at both ends of the part.
    at_ends: [[f64; STAGES]; 2],
}

/// A law that plays.
#[derive(Clone, Debug, Default)]
pub(super) struct LawState {
    /// At the Gauss points of the last part [N], and what is known of this one's.
    force: [f64; STAGES],
    elongation: [f64; STAGES],
    rate: [f64; STAGES],
    /// At the start of the frame [N].
    begin: f64,
    /// The largest of the last frames [N].
    largest: f64,
    /// Elongation at the instants of the frame if the forces of the parts to come are zero [m]   (n)
    path: Vec<f64>,
    /// The inverse of what a change of the forces leaves unmet, and for which division it was found.
    inverse: Square,
    known: Option<usize>,
    scratch: Scratch,
    room: Vec<f64>,
}

crate::archive::state!(LawState {
    force,
    elongation,
    rate,
    begin,
    largest,
    inverse,
    known,
});

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
        let most = if links.is_empty() {
            1
        } else {
            (script.steps / 2).max(1)
        };
        let parts = std::iter::successors(Some(1), |parts| Some(2 * parts));
        let pairs: Vec<_> = (0..links.len() * links.len())
            .map(|pair| [pair / links.len(), pair % links.len()].map(|law| script.ends[links[law]]))
            .collect();
        let divide = |parts: usize| Division::new(script, &pairs, parts);
        let end = At::new(script.basis.n(), 1.0);
        let at_end = |ends: &[(usize, usize); 2]| {
            let mut found = [[0.0; STAGES]; 2];
            for stage in 0..STAGES {
                let start = At::new(script.basis.n(), POINTS[stage]);
                let weight = WEIGHTS[stage] * script.rate.step();
                let [x, v] = script.between(*ends, [&start, &end]);
                (found[0][stage], found[1][stage]) = (weight * x, weight * v);
            }
            found
        };
        let rows = |s: f64| {
            let at = At::new(script.basis.n(), s);
            [&at.value, &at.slope].map(|values| script.basis.weights(values))
        };
        Self {
            divisions: parts
                .take_while(|&parts| parts <= most)
                .map(divide)
                .collect(),
            ends: [rows(0.0), rows(1.0)],
            moves_end: pairs.iter().map(at_end).collect(),
            ahead: POINTS.map(|c| shares(1.0 + c)),
            at_ends: [0.0, 1.0].map(shares),
            links,
        }
    }

    pub(super) fn states(&self, script: &Script) -> Vec<LawState> {
        let state = |&link: &usize| {
            let mut state = LawState {
                path: vec![0.0; script.basis.n()],
                ..LawState::default()
            };
            if let Kind::Lnl { law, .. } = &script.links[link].kind {
                state.scratch = law.scratch_alone();
                state.room = vec![0.0; law.room()];
            }
            state
        };
        self.links.iter().map(state).collect()
    }
}

impl Division {
    fn new(script: &Script, pairs: &[[(usize, usize); 2]], parts: usize) -> Self {
        let (n, h) = (script.basis.n(), 1.0 / parts as f64);
        let s: Vec<f64> = (0..parts)
            .flat_map(|part| POINTS.map(|c| (part as f64 + c) * h))
            .collect();
        let at: Vec<At> = s.iter().map(|&s| At::new(n, s)).collect();
        let mut later = Vec::new();
        if parts > 1 {
            let instants: Vec<At> = (script.basis.instants.iter())
                .map(|&s| At::new(n, s))
                .collect();
            for &ends in pairs {
                for start in &at {
                    later.extend(
                        instants
                            .iter()
                            .map(|end| script.between(ends, [start, end])[0]),
                    );
                }
            }
        }
        Self {
            parts,
            value: at
                .iter()
                .flat_map(|at| script.basis.weights(&at.value))
                .collect(),
            slope: at
                .iter()
                .flat_map(|at| script.basis.weights(&at.slope))
                .collect(),
            moves: pairs.iter().map(|&ends| script.coupled(ends, h)).collect(),
            later,
            s,
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
                    let [x, v] = self.between([to, from], [&start, &end]);
                    for (column, share) in shares(part).into_iter().enumerate() {
                        found[0][row][column] += weight * share * x;
                        found[1][row][column] += weight * share * v;
                    }
                }
            }
        }
        found
    }

    /// What an impulse of a law between `from` makes of the elongation between `to` [m/N·s] and of its rate
    /// [m/frame per N·s].
    fn between(&self, [to, from]: [(usize, usize); 2], instants: [&At; 2]) -> [f64; 2] {
        let mut found = [0.0; 2];
        for (sign_to, to) in [(-1.0, to.0), (1.0, to.1)] {
            for (sign_from, from) in [(1.0, from.0), (-1.0, from.1)] {
                let [x, v] = self.answer([from, to], instants);
                found[0] += sign_to * sign_from * x;
                found[1] += sign_to * sign_from * v;
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
        let n = script.basis.n();
        for (state, &link) in self.laws.iter_mut().zip(&laws.links) {
            let ((a, b), rest) = (script.ends[link], script.links[link].rest);
            let [a, b] = [a, b].map(|end| &self.values[end * n..(end + 1) * n]);
            for ((x, a), b) in state.path.iter_mut().zip(a).zip(b) {
                *x = b - a - rest;
            }
            state.force = laws.ahead.map(|row| dot(&row, &state.force));
        }
        let most = laws.divisions.len() - 1;
        let rounds = if most == 0 { ROUNDS } else { FEW_ROUNDS };
        let left = self.solve(script, laws, (gates, 0), (0, rounds));
        if most == 0 {
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
        if missed <= SMOOTH {
            return self.give_laws(script, laws, (0, 0));
        }
        // What it misses falls by the cube of the parts.
        let wanted = pow(missed / SMOOTH, 1.0 / 3.0);
        let finer = laws
            .divisions
            .partition_point(|own| (own.parts as f64) < wanted);
        let own = finer.clamp(1, most);
        let division = &laws.divisions[own];
        for state in &mut self.laws {
            let first = [0, 1, 2].map(|stage: usize| shares(division.s[stage]));
            state.force = if is_met {
                first.map(|row| dot(&row, &state.force))
            } else {
                [state.begin; STAGES]
            };
        }
        for part in 0..division.parts {
            if part > 0 {
                for state in &mut self.laws {
                    state.force = laws.ahead.map(|row| dot(&row, &state.force));
                }
            }
            if self.solve(script, laws, (gates, own), (part, ROUNDS)) > LOST {
                self.bracket(script, laws, (gates, own, part));
            }
            self.give_laws(script, laws, (own, part));
            self.bend_paths(script, division, part);
        }
    }

    /// Find the forces of all laws in a part of a frame; how far they miss them, relative to the largest; 0 where they agree.
    fn solve(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, own): (&[f64], usize),
        (part, rounds): (usize, usize),
    ) -> f64 {
        let (n, division) = (script.basis.n(), &laws.divisions[own]);
        let rows = 3 * part * n..3 * (part + 1) * n;
        let (value, slope) = (&division.value[rows.clone()], &division.slope[rows]);
        for state in &mut self.laws {
            for (stage, (value, slope)) in value.chunks(n).zip(slope.chunks(n)).enumerate() {
                state.elongation[stage] = dot(value, &state.path);
                state.rate[stage] = dot(slope, &state.path);
            }
        }
        let mut last = f64::INFINITY;
        for round in 0..rounds {
            let mut change = 0.0_f64;
            for law in 0..laws.links.len() {
                change = change.max(self.meet(script, laws, (gates, own, part), (law, round)));
            }
            // What is still to come, at the pace of the last two rounds.
            let pace = change / last;
            if change <= AGREE || (round > 0 && pace < 0.5 && change * pace <= AGREE) {
                // Slopes that took so long to lead there are looked up again.
                if round >= LOOK_AGAIN {
                    self.laws.iter_mut().for_each(|state| state.known = None);
                }
                return 0.0;
            }
            last = change;
        }
        last
    }

    /// One force for each law over a part of a frame, equal to the law halfway, for laws so steep that Newton's steps do
    /// not end: of order 2, and it neither grows beyond the law nor depends on its slope.
    fn bracket(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, own, part): (&[f64], usize, usize),
    ) {
        const MIDDLE: usize = 1;
        let (n_laws, division) = (laws.links.len(), &laws.divisions[own]);
        let s = division.s[STAGES * part + MIDDLE];
        for state in &mut self.laws {
            // Newton's last forces may be anything.
            (state.force, state.known) = ([state.begin; STAGES], None);
        }
        for _ in 0..BRACKET_ROUNDS {
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
                let now = self.law(script, gates, (laws.links[law], s));
                let unmet = |f: f64| f - now.at(e + give[0] * f, (v + give[1] * f) * now.rate());
                let old = state.force[MIDDLE];
                let (force, evaluations) = root(&unmet, old);
                self.work.instants += evaluations / STAGES as u64;
                change = change.max((force - old).abs() - AGREE * force.abs());
                self.laws[law].force = [force; STAGES];
            }
            if change <= 0.0 {
                break;
            }
        }
    }

    /// Push by the forces that were found for a part of a frame.
    fn give_laws(&mut self, script: &Script, laws: &LawScript, (own, part): (usize, usize)) {
        let (n, division) = (script.basis.n(), &laws.divisions[own]);
        let h = script.rate.step() / division.parts as f64;
        for (state, &link) in self.laws.iter_mut().zip(&laws.links) {
            let (a, b) = script.ends[link];
            let first = 3 * part;
            for stage in 0..STAGES {
                let impulse = WEIGHTS[stage] * h * state.force[stage];
                let row = &division.value[(first + stage) * n..(first + stage + 1) * n];
                for (at, share) in row.iter().enumerate() {
                    self.pushed[a * n + at] += impulse * share;
                    self.pushed[b * n + at] -= impulse * share;
                }
            }
            let most = state
                .force
                .iter()
                .fold(0.0_f64, |most, force| most.max(force.abs()));
            state.largest = most.max(if part == 0 { FADE } else { 1.0 } * state.largest);
        }
    }

    /// Where the laws take their points after a part of a frame.
    fn bend_paths(&mut self, script: &Script, division: &Division, part: usize) {
        let (n, n_laws) = (script.basis.n(), self.laws.len());
        let h = script.rate.step() / division.parts as f64;
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

    /// How far the forces of a frame that was taken as a whole are from their laws at its two ends, relative to the
    /// largest.
    fn missed(&mut self, script: &Script, laws: &LawScript, gates: &[f64]) -> f64 {
        let n_laws = laws.links.len();
        let mut missed = 0.0_f64;
        for (own, &link) in laws.links.iter().enumerate() {
            let state = &self.laws[own];
            let [mut e, mut v] = [0, 1].map(|which| dot(&laws.ends[1][which], &state.path));
            for (other, [by_x, by_v]) in self.laws.iter().zip(&laws.moves_end[own * n_laws..]) {
                e += dot(by_x, &other.force);
                v += dot(by_v, &other.force);
            }
            let law = self.law(script, gates, (link, 1.0));
            let at_ends = [state.begin, law.at(e, v * law.rate())];
            let largest = (state.force.iter().chain(&at_ends))
                .fold(state.largest, |most, force| most.max(force.abs()));
            for (row, force) in laws.at_ends.iter().zip(at_ends) {
                let apart = (dot(row, &state.force) - force).abs();
                missed = missed.max(apart / largest.max(f64::MIN_POSITIVE));
            }
        }
        self.work.instants += n_laws as u64;
        missed
    }

    /// Bring the forces of one law nearer to it, those of all others given; the change, relative to the largest.
    fn meet(
        &mut self,
        script: &Script,
        laws: &LawScript,
        (gates, own, part): (&[f64], usize, usize),
        (law, round): (usize, usize),
    ) -> f64 {
        let (link, n_laws) = (laws.links[law], laws.links.len());
        let division = &laws.divisions[own];
        let (mut e, mut v) = (self.laws[law].elongation, self.laws[law].rate);
        for (other, [by_x, by_v]) in self.laws.iter().zip(&division.moves[law * n_laws..]) {
            for stage in 0..STAGES {
                e[stage] += dot(&by_x[stage], &other.force);
                v[stage] += dot(&by_v[stage], &other.force);
            }
        }
        let now =
            [0, 1, 2].map(|stage| self.law(script, gates, (link, division.s[3 * part + stage])));
        self.work.instants += 1;
        let rate = now[0].rate();
        let v = v.map(|v| v * rate);
        let state = &mut self.laws[law];
        let force = state.forces(&now, &e, &v);
        let largest = (force.iter()).fold(f64::MIN_POSITIVE, |most, force| most.max(force.abs()));
        if state.known != Some(own) || round % LOOK_AGAIN == LOOK_AGAIN - 1 {
            let (k, z) = state.slopes(&now, (&e, &v), &force);
            let [by_x, by_v] = &division.moves[law * n_laws + law];
            let mut left = [[0.0; STAGES]; STAGES];
            for stage in 0..STAGES {
                for column in 0..STAGES {
                    let one = if column == stage { 1.0 } else { 0.0 };
                    left[stage][column] = one
                        - k[stage] * by_x[stage][column]
                        - z[stage] * rate * by_v[stage][column];
                }
            }
            state.inverse = inverse(&left);
            state.known = Some(own);
            self.work.instants += 1;
        }
        let unmet: [f64; STAGES] = std::array::from_fn(|stage| force[stage] - state.force[stage]);
        let mut change = 0.0_f64;
        for stage in 0..STAGES {
            let by = dot(&state.inverse[stage], &unmet);
            state.force[stage] += by;
            change = change.max(by.abs());
        }
        change / largest
    }

    /// Forces of all laws at the start of the frame, for those who listen.
    pub(super) fn tell_laws(
        &mut self,
        script: &Script,
        laws: &LawScript,
        gates: &[f64],
        body: &mut Body,
    ) {
        let n = script.basis.n();
        for (own, &link) in laws.links.iter().enumerate() {
            let (a, b) = script.ends[link];
            let run = &script.links[link];
            let [a, b] = [a, b].map(|end| &self.values[end * n..(end + 1) * n]);
            let [e, v] = [0, 1].map(|which| {
                let row = &laws.ends[0][which];
                dot(row, b) - dot(row, a)
            });
            let law = self.law(script, gates, (link, 0.0));
            let force = law.at(e - run.rest, v * law.rate());
            body.link[run.first] = force;
            self.laws[own].begin = force;
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

impl LawState {
    /// Go on as the same law of another version stands.
    pub(super) fn continue_from(&mut self, old: &Self) {
        (self.force, self.elongation, self.rate) = (old.force, old.elongation, old.rate);
        (self.begin, self.largest) = (old.begin, old.largest);
        (self.inverse, self.known) = (old.inverse, old.known);
    }

    /// Forces of the law at three instants, at their elongations and rates [N].
    fn forces(&mut self, now: &[LawNow<'_>; STAGES], e: &Stages, v: &Stages) -> Stages {
        match now[0].kind {
            Kind::Lnl { law, .. } if law.is_native() => {
                let mut forces = [0.0; STAGES];
                law.eval_in(e, v, &mut forces, &mut self.scratch, &mut self.room);
                forces.map(|force| now[0].open * force)
            }
            _ => std::array::from_fn(|stage| now[stage].at(e[stage], v[stage])),
        }
    }

    /// Slopes of the law at three instants, in the elongation and in its rate [N/m, N·s/m].
    fn slopes(
        &mut self,
        now: &[LawNow<'_>; STAGES],
        (e, v): (&Stages, &Stages),
        force: &Stages,
    ) -> (Stages, Stages) {
        if let Kind::Hardening(q) = now[0].kind {
            let k = |stage: usize| {
                let own = &now[stage];
                own.open * (own.k + 3.0 * q * e[stage] * e[stage])
            };
            return ([0, 1, 2].map(k), now.each_ref().map(|own| own.open * own.z));
        }
        let (has_spring, has_drag) = match now[0].kind {
            Kind::Lnl { law, .. } => (!law.is_damping_alone(), law.is_damped()),
            _ => (true, true),
        };
        let mut found = [[0.0; STAGES]; 2];
        for (which, is_there) in [has_spring, has_drag].into_iter().enumerate() {
            if !is_there {
                continue;
            }
            let mut places = [*e, *v];
            let by = places[which].map(|at| NEAR.0 * at.abs() + NEAR.1);
            for stage in 0..STAGES {
                places[which][stage] += by[stage];
            }
            let ahead = self.forces(now, &places[0], &places[1]);
            found[which] = std::array::from_fn(|stage| (ahead[stage] - force[stage]) / by[stage]);
        }
        (found[0], found[1])
    }
}

/// Where a function that rises in the end is zero, near a guess; and how often it was asked. The guess where it is zero
/// nowhere.
fn root(f: &dyn Fn(f64) -> f64, guess: f64) -> (f64, u64) {
    let at_guess = f(guess);
    let mut asked = 1;
    if at_guess == 0.0 || !at_guess.is_finite() {
        return (guess, asked);
    }
    // It is zero towards where it has the other sign: look ever further.
    let mut far = guess;
    let mut near;
    let mut by = -FIRST_LOOK * at_guess;
    loop {
        (near, far) = (far, far + by);
        let at_far = f(far);
        asked += 1;
        if !at_far.is_finite() || asked > HALVINGS {
            return (guess, asked);
        }
        if (at_far > 0.0) != (at_guess > 0.0) {
            break;
        }
        by *= 2.0;
    }
    for _ in 0..HALVINGS {
        let half = 0.5 * (near + far);
        if half == near || half == far {
            break;
        }
        asked += 1;
        if (f(half) > 0.0) == (at_guess > 0.0) {
            near = half;
        } else {
            far = half;
        }
    }
    (far, asked)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_is_found_however_steep_a_law_is() {
        // A smooth bow whose slope at rest is 10⁴ times what Newton's step bears.
        let bow = |v: f64| v * 1e4 / (1.0 + 1e8 * v * v);
        for v in [-0.3, -1e-5, 0.0, 1e-6, 0.02] {
            let unmet = |f: f64| f - bow(v - 0.5 * f);
            let (force, _) = root(&unmet, 0.0);
            assert!(unmet(force).abs() < 1e-6, "{v}: {force}");
        }
        // Nothing is zero: what was known stays.
        assert_eq!(root(&|_| 1.0, 7.0).0, 7.0);
    }
}
