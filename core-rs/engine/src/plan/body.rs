//! An island that is one linear body, struck and heard: a bank of its modes.

use std::collections::BTreeMap;

use super::BankPlan;
use super::budget::Budget;
use super::cells::hear;
use super::linear::NoModes;
use super::modes::{Modes, Row};
use super::truncate::{self, Kept};
use crate::bank::{Oscillator, Strikes};
use crate::network::{Network, Subset, Term};
use crate::timeline::{Timeline, frame, whole};
use crate::units::Rate;

/// A body as a bank.
pub(super) struct Body {
    pub(super) bank: BankPlan,
    /// What outputs hear of where it rests   (its n_out)
    pub(super) rest: Vec<f64>,
    pub(super) modes: usize,
    pub(super) kept: Kept,
}

/// The modes of an island, as many as this score excites and the budget asks for, or those that were decided
/// for before.
pub(super) fn bank(
    subset: &Subset,
    timeline: &Timeline,
    budget: &Budget,
    pinned: Option<&[Vec<u32>]>,
) -> Result<Body, NoModes> {
    let (network, rate) = (&subset.network, timeline.rate);
    if !timeline.keys.is_empty() || !timeline.drives.is_empty() || !timeline.ergons.is_empty() {
        return Err(NoModes::Handled);
    }
    if !timeline.gates.is_empty() {
        return Err(NoModes::Coupled);
    }
    let Heard { mut rows, held } = heard(network)?;
    let n_out = rows.len();
    let discrete = network.mats().part.first().map(|&part| part as usize);
    let is_discrete = discrete.is_some_and(|part| network.parts()[part].ca_rate.is_some());
    let strikes = blows(timeline, rate, |_| true, is_discrete);
    rows.extend(strikes.keys().map(|&mat| vec![(mat as usize, 1.0)]));
    let modes = Modes::new(network, &rows, rate)?;
    if let Some(why) = modes.unfit(rate) {
        return Err(why);
    }
    let (seen, felt) = modes.shapes.split_at(n_out);
    let given: Vec<Vec<f64>> = strikes
        .values()
        .map(|blows| blows.iter().map(|&(_, _, impulse)| impulse).collect())
        .collect();
    let kept = match pinned {
        Some([kept]) => Kept::pinned(kept, modes.len()).ok_or(NoModes::Pinned)?,
        Some(_) => return Err(NoModes::Pinned),
        None => truncate::keep(&modes, seen, felt, &given, budget, rate),
    };
    let rest = (0..n_out)
        .map(|output| {
            let still: f64 = seen[output]
                .iter()
                .zip(&modes.rest)
                .map(|(a, b)| a * b)
                .sum();
            still + held[output]
        })
        .collect();
    let mut bank = BankPlan::default();
    for &mode in &kept.modes {
        let ratios = modes.ratios(mode, rate);
        let mut own = Vec::new();
        for (row, &output) in seen.iter().zip(&subset.outputs) {
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
    for (shape, blows) in felt.iter().zip(strikes.into_values()) {
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

/// Strikes on each MAT of a timeline that `is_ours`: frame, part of a frame after it, impulse; rising. In a
/// discrete network a strike falls on a frame.
pub(super) fn blows(
    timeline: &Timeline,
    rate: Rate,
    is_ours: impl Fn(u32) -> bool,
    is_discrete: bool,
) -> BTreeMap<u32, Vec<(u64, f64, f64)>> {
    let mut found: BTreeMap<u32, Vec<(u64, f64, f64)>> = BTreeMap::new();
    for strike in timeline.strikes.iter().filter(|strike| is_ours(strike.mat)) {
        let at = strike.at * rate.hertz();
        let (frame, alpha) = if is_discrete {
            (frame(strike.at, rate.hertz()), 0.0)
        } else {
            let n = whole(at);
            (n, (at - n as f64).clamp(0.0, 1.0))
        };
        let blows = found.entry(strike.mat).or_default();
        blows.push((frame, alpha, strike.impulse));
    }
    for blows in found.values_mut() {
        blows.sort_by_key(|&(frame, _, _)| frame);
    }
    found
}

/// What outputs sum.
pub(super) struct Heard {
    /// Positions, by output.
    pub(super) rows: Vec<Row>,
    /// Of those, what points say that never move, by output.
    pub(super) held: Vec<f64>,
}

/// What each output of a body sums.
pub(super) fn heard(network: &Network) -> Result<Heard, NoModes> {
    let mats = network.mats();
    let (mut rows, mut held) = (Vec::new(), Vec::new());
    for output in network.outputs() {
        let (mut row, mut still) = (Row::new(), 0.0);
        for term in &output.terms {
            let Term::Position { first, len, weight } = *term else {
                return Err(NoModes::ForceHeard);
            };
            for i in first..first + len {
                row.push((i, weight));
                if !crate::scheme::moves(mats.kind[i]) {
                    still += weight * mats.x0[i];
                }
            }
        }
        rows.push(row);
        held.push(still);
    }
    Ok(Heard { rows, held })
}
