//! An island that is one linear body, struck and heard: a bank of its modes.

use std::collections::BTreeMap;

use super::BankPlan;
use super::budget::Budget;
use super::cells::hear;
use super::linear::NoModes;
use super::modes::{ANGLE_MIN, Modes, Row};
use super::truncate::{self, Blow, Kept};
use crate::bank::{Oscillator, Strikes};
use crate::network::{Network, Subset, Term};
use crate::timeline::{Timeline, frame, whole};

/// A body as a bank.
pub(super) struct Body {
    pub(super) bank: BankPlan,
    /// What outputs hear of where it rests   (its n_out)
    pub(super) rest: Vec<f64>,
    pub(super) modes: usize,
    pub(super) kept: Kept,
}

/// The modes of an island, as many as this score excites and the budget asks for.
pub(super) fn bank(subset: &Subset, timeline: &Timeline, budget: &Budget) -> Result<Body, NoModes> {
    let (network, rate) = (&subset.network, timeline.rate);
    if !timeline.keys.is_empty() || !timeline.drives.is_empty() || !timeline.ergons.is_empty() {
        return Err(NoModes::Handled);
    }
    if !timeline.gates.is_empty() {
        return Err(NoModes::Coupled);
    }
    let mut rows = outputs(network)?;
    let n_out = rows.len();
    let mut struck: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, strike) in timeline.strikes.iter().enumerate() {
        struck.entry(strike.mat as usize).or_default().push(index);
    }
    rows.extend(struck.keys().map(|&mat| vec![(mat, 1.0)]));
    let modes = Modes::new(network, &rows, rate)?;
    if (0..modes.len()).any(|mode| modes.ratios(mode, rate).kappa < ANGLE_MIN * ANGLE_MIN) {
        return Err(NoModes::Slow);
    }
    let (heard, felt) = modes.shapes.split_at(n_out);
    let blows: Vec<Vec<Blow>> = struck
        .values()
        .map(|strikes| {
            let strike = |&index: &usize| &timeline.strikes[index];
            strikes
                .iter()
                .map(strike)
                .map(|strike| (strike.at, strike.impulse))
                .collect()
        })
        .collect();
    let kept = truncate::keep(&modes, heard, felt, &blows, budget, rate);
    let rest = (0..n_out)
        .map(|output| {
            let still: f64 = heard[output]
                .iter()
                .zip(&modes.rest)
                .map(|(a, b)| a * b)
                .sum();
            still + held(network, &rows[output])
        })
        .collect();
    let mut bank = BankPlan::default();
    for &mode in &kept.modes {
        let ratios = modes.ratios(mode, rate);
        let mut own = Vec::new();
        for (row, &output) in heard.iter().zip(&subset.outputs) {
            hear(&mut own, output, row[mode]);
        }
        bank.oscillators.push(Oscillator {
            a: 2.0 - ratios.kappa - ratios.zeta,
            b: 1.0 - ratios.zeta,
            now: modes.x0[mode] - modes.rest[mode],
            before: modes.before(mode, rate),
            heard: own,
            blows: Vec::new(),
        });
    }
    for (shape, strikes) in felt.iter().zip(struck.values()) {
        let hertz = rate.hertz();
        let blow = |&index: &usize| {
            let strike = &timeline.strikes[index];
            let at = strike.at * hertz;
            if modes.is_discrete {
                (frame(strike.at, hertz), 0.0, strike.impulse)
            } else {
                let n = whole(at);
                (n, (at - n as f64).clamp(0.0, 1.0), strike.impulse)
            }
        };
        let mut blows: Vec<_> = strikes.iter().map(blow).collect();
        blows.sort_by_key(|&(frame, _, _)| frame);
        bank.strikes.push(Strikes {
            among: 0..kept.modes.len(),
            cells: if modes.is_discrete {
                Vec::new()
            } else {
                kept.modes.iter().map(|&mode| modes.cell(mode)).collect()
            },
            share: kept.modes.iter().map(|&mode| shape[mode]).collect(),
            w: if modes.is_discrete {
                1.0
            } else {
                rate.step() * rate.step()
            },
            blows,
        });
    }
    Ok(Body {
        bank,
        rest,
        modes: modes.len(),
        kept,
    })
}

/// What each output sums.
fn outputs(network: &Network) -> Result<Vec<Row>, NoModes> {
    let sum = |terms: &[Term]| {
        let mut row = Row::new();
        for term in terms {
            match *term {
                Term::Position { first, len, weight } => {
                    row.extend((first..first + len).map(|i| (i, weight)));
                }
                Term::Ground { .. } | Term::Force { .. } => return Err(NoModes::ForceHeard),
            }
        }
        Ok(row)
    };
    network
        .outputs()
        .iter()
        .map(|output| sum(&output.terms))
        .collect()
}

/// What a row sees of points that never move.
fn held(network: &Network, row: &Row) -> f64 {
    let mats = network.mats();
    row.iter()
        .filter(|(mat, _)| !crate::scheme::moves(mats.kind[*mat]))
        .map(|&(mat, weight)| weight * mats.x0[mat])
        .sum()
}
