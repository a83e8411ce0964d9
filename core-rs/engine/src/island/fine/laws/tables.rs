//! Constant tables of laws between frames: the response of each law's elongation to the forces of the others.

use super::state::LawState;
use super::{PARTS, POINTS, SMOOTH, STAGES, Square, WEIGHTS};
use crate::island::fine::Script;
use crate::island::fine::basis::{At, dot};
use crate::scheme::Kind;

/// A frame in `parts` parts, which are solved one after the other.
#[derive(Clone, Debug)]
pub(super) struct Division {
    pub(super) parts: usize,
    /// Instants of the Gauss points   (parts·3)
    pub(super) s: Vec<f64>,
    /// Weights of the values at the instants of a frame in the value, and in the slope, at each Gauss point   (parts·3,
    /// n)
    pub(super) value: Vec<f64>,
    pub(super) slope: Vec<f64>,
    /// Response of one law's elongation and rate at the Gauss points of a part to the force of another in that part
    /// (n_laws²)
    pub(super) moves: Vec<[Square; 2]>,
    /// Response of one law's elongation at the instants of a frame to an impulse of another at each Gauss point, for
    /// the parts after it   (n_laws², parts·3, n)
    pub(super) later: Vec<f64>,
}

/// The constant data of laws.
#[derive(Clone, Debug)]
pub(in crate::island::fine) struct LawScript {
    /// Indices of the script's links that are laws.
    pub(in crate::island::fine) links: Vec<usize>,
    /// Parts of a frame: 1, 2, 4, and so on.
    pub(super) divisions: Vec<Division>,
    /// Largest deviation with which a frame is taken as a whole, relative to the largest force.
    pub(super) smooth: f64,
    /// Weights of the values at the instants of a frame in the value, and in the slope, at its ends   (n each)
    pub(super) ends: [[Vec<f64>; 2]; 2],
    /// Response of one law's elongation and rate at the end of a whole frame to the force of another   (n_laws²)
    pub(super) moves_end: Vec<[[f64; STAGES]; 2]>,
    /// Weights of a part's forces in their extrapolation to the next part's Gauss points.
    pub(super) ahead: Square,
    /// Weights of a part's forces in their extrapolation to both its ends.
    pub(super) at_ends: [[f64; STAGES]; 2],
}

impl LawScript {
    pub(in crate::island::fine) fn new(script: &Script) -> Self {
        let is_law =
            |index: &usize| !matches!(script.links[*index].kind, Kind::But(_) | Kind::Dry { .. });
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
        let excess = (most as f64 / PARTS as f64).max(1.0);
        let rows = |s: f64| {
            let at = At::new(script.basis.n(), s);
            [&at.value, &at.slope].map(|values| script.basis.weights(values))
        };
        Self {
            divisions: parts
                .take_while(|&parts| parts <= most)
                .map(divide)
                .collect(),
            smooth: SMOOTH / (excess * excess * excess),
            ends: [rows(0.0), rows(1.0)],
            moves_end: pairs.iter().map(at_end).collect(),
            ahead: POINTS.map(|c| shares(1.0 + c)),
            at_ends: [0.0, 1.0].map(shares),
            links,
        }
    }

    pub(in crate::island::fine) fn states(&self, script: &Script) -> Vec<LawState> {
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

/// Weights of the values at the Gauss points in the value at `s` of the polynomial through them, in parts.
pub(in crate::island::fine) fn shares(s: f64) -> [f64; STAGES] {
    let mut shares = [1.0; STAGES];
    for (own, share) in shares.iter_mut().enumerate() {
        for other in (0..STAGES).filter(|&other| other != own) {
            *share *= (s - POINTS[other]) / (POINTS[own] - POINTS[other]);
        }
    }
    shares
}

impl Script {
    /// Response of the elongation between `to`, and of its rate, to the force of a law between `from`, at the Gauss
    /// points of a part of `h` frames.
    fn coupled(&self, [to, from]: [(usize, usize); 2], h: f64) -> [Square; 2] {
        let n = self.basis.n();
        let mut found = [[[0.0; STAGES]; STAGES]; 2];
        for (row, c) in POINTS.into_iter().enumerate() {
            let end = At::new(n, c * h);
            // Gauss quadrature over each half of the time up to this point: of order 6.
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

    /// Response of the elongation between `to` [m/N·s] and of its rate [m/frame per N·s] to an impulse of a law between
    /// `from`.
    pub(in crate::island::fine) fn between(
        &self,
        [to, from]: [(usize, usize); 2],
        instants: [&At; 2],
    ) -> [f64; 2] {
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

    /// Response of one joint's position [m/N·s] and velocity [m/frame per N·s] to an impulse on another.
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
