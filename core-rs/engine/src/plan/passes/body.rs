//! An island that is one linear body, struck and heard: a bank of its modes.

use std::collections::BTreeMap;

use crate::bank::{Oscillator, Strikes};
use crate::network::{Network, Subset, Term};
use crate::plan::BankPlan;
use crate::plan::budget::Budget;
use crate::plan::passes::cells::hear;
use crate::plan::passes::linear::NoModes;
use crate::plan::passes::loudness::Loudness;
use crate::plan::passes::modes::{Modes, Row};
use crate::plan::passes::solved_modes::Memo;
use crate::plan::passes::truncate::{self, KeptModes};
use crate::timeline::Timeline;
use crate::units::Rate;
use crate::units::{floor_frame, frame};

/// Modes are asked to be quieter by at least so much at a time [dB].
const LEAST: f64 = 2.0;

/// A body as a bank.
pub(in crate::plan) struct Body {
    pub(in crate::plan) bank: BankPlan,
    /// What outputs hear of where it rests   (its n_out)
    pub(in crate::plan) rest: Vec<f64>,
    pub(in crate::plan) modes: usize,
    pub(in crate::plan) kept: KeptModes,
}

/// The modes of an island, as many as this score excites and the budget asks for, or those that were decided
/// for before.
pub(in crate::plan) fn bank(
    subset: &Subset,
    timeline: &Timeline,
    budget: &Budget,
    pinned: Option<&[Vec<u32>]>,
    memo: &Memo<'_>,
) -> Result<Body, NoModes> {
    let (network, rate) = (&subset.network, timeline.rate);
    let is_handled = !timeline.keys.is_empty() || !timeline.drives.is_empty();
    if is_handled || !timeline.ergons.is_empty() || !timeline.glides.is_empty() {
        return Err(NoModes::Handled);
    }
    if !timeline.gates.is_empty() {
        return Err(NoModes::Coupled);
    }
    let OutputSums { mut rows, held } = heard(network)?;
    let n_out = rows.len();
    let discrete = network.mats().part.first().map(|&part| part as usize);
    let is_discrete = discrete.is_some_and(|part| network.parts()[part].ca_rate.is_some());
    let strikes = blows(timeline, rate, |_| true, is_discrete);
    rows.extend(strikes.keys().map(|&mat| vec![(mat as usize, 1.0)]));
    let mut modes = memo.modes(network, &rows, rate)?;
    // What a session may bring is not known: all of them may move.
    let turned = (!timeline.is_open).then(|| strikes.keys().map(|&mat| mat as usize).collect());
    if turned.is_some() {
        modes.turn(&(n_out..rows.len()).collect::<Vec<_>>(), rate);
    }
    if let Some(why) = modes.unfit(rate) {
        return Err(why);
    }
    let (seen, felt) = modes.shapes.split_at(n_out);
    let kept = match pinned {
        Some([kept]) => KeptModes::pinned(kept, modes.len()).ok_or(NoModes::Pinned)?,
        Some(_) => return Err(NoModes::Pinned),
        None => {
            // Of what a session may bring nothing is known: nothing that can be heard is left out.
            let allowed = budget.left_out().filter(|_| !timeline.is_open);
            keep(&modes, seen, felt, &strikes, allowed, budget, rate)
        }
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
    let bank = bank_of(
        &modes,
        &kept.modes,
        [seen, felt],
        &subset.outputs,
        &strikes,
        rate,
    );
    Ok(Body {
        bank: BankPlan { turned, ..bank },
        rest,
        modes: modes.len(),
        kept,
    })
}

/// Strikes on each MAT: frame, part of a frame after it, impulse [N·s].
type Blows = BTreeMap<u32, Vec<(u64, f64, f64)>>;

/// The modes that stay: those that sums of energies tell, tested by ear.
fn keep(
    modes: &Modes,
    seen: &[Vec<f64>],
    felt: &[Vec<f64>],
    strikes: &Blows,
    mut allowed: Option<f64>,
    budget: &Budget,
    rate: Rate,
) -> KeptModes {
    let given: Vec<Vec<f64>> = strikes
        .values()
        .map(|blows| blows.iter().map(|&(_, _, impulse)| impulse).collect())
        .collect();
    let mut kept = truncate::keep(modes, seen, felt, &given, allowed, budget, rate);
    let Some(most) = allowed else {
        return kept;
    };
    let bent = |mode: usize| modes.x0[mode] != modes.rest[mode] || modes.v0[mode] != 0.0;
    let frames = strikes.values().flatten().map(|&(frame, _, _)| frame);
    let first = frames.min().filter(|_| !(0..modes.len()).any(bent));
    let outputs: Vec<u32> = (0..seen.len() as u32).collect();
    let loudness = |some: &[usize]| {
        let bank = bank_of(modes, some, [seen, felt], &outputs, strikes, rate);
        Loudness::of(bank, outputs.len(), rate, first.unwrap_or(0))
    };
    let mut all = None;
    loop {
        let stays = |mode: &usize| kept.modes.binary_search(mode).is_ok();
        let is_heard = |mode: &usize| modes.pitch(*mode, rate).0 <= budget.highest();
        let fallen: Vec<usize> = (0..modes.len())
            .filter(|mode| !stays(mode) && is_heard(mode))
            .collect();
        if fallen.is_empty() {
            kept.left_out = None;
            return kept;
        }
        let all = all.get_or_insert_with(|| loudness(&(0..modes.len()).collect::<Vec<_>>()));
        let loud = loudness(&fallen).beside(all);
        kept.left_out = Some(loud);
        if loud <= most {
            return kept;
        }
        allowed = allowed.map(|db| db - (loud - most).max(LEAST));
        kept = truncate::keep(modes, seen, felt, &given, allowed, budget, rate);
    }
}

/// Some of the modes as a bank.
fn bank_of(
    modes: &Modes,
    some: &[usize],
    [seen, felt]: [&[Vec<f64>]; 2],
    outputs: &[u32],
    strikes: &Blows,
    rate: Rate,
) -> BankPlan {
    let mut bank = BankPlan::default();
    for &mode in some {
        let ratios = modes.ratios(mode, rate);
        let mut own = Vec::new();
        for (row, &output) in seen.iter().zip(outputs) {
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
    for (shape, blows) in felt.iter().zip(strikes.values()) {
        bank.strikes.push(Strikes {
            among: 0..some.len(),
            cells: if modes.is_discrete {
                Vec::new()
            } else {
                some.iter().map(|&mode| modes.cell(mode)).collect()
            },
            share: some.iter().map(|&mode| shape[mode]).collect(),
            w: if modes.is_discrete {
                1.0
            } else {
                rate.step() * rate.step()
            },
            blows: blows.clone(),
        });
    }
    bank
}

/// Strikes on each MAT of a timeline that `is_ours`: frame, part of a frame after it, impulse; rising. In a
/// discrete network a strike falls on a frame.
pub(in crate::plan) fn blows(
    timeline: &Timeline,
    rate: Rate,
    is_ours: impl Fn(u32) -> bool,
    is_discrete: bool,
) -> Blows {
    let mut found = Blows::new();
    for strike in timeline.strikes.iter().filter(|strike| is_ours(strike.mat)) {
        let at = strike.at * rate.hertz();
        let (frame, alpha) = if is_discrete {
            (frame(strike.at, rate.hertz()), 0.0)
        } else {
            let n = floor_frame(at);
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
pub(in crate::plan) struct OutputSums {
    /// Positions, by output.
    pub(in crate::plan) rows: Vec<Row>,
    /// Of those, what points say that never move, by output.
    pub(in crate::plan) held: Vec<f64>,
}

/// What each output of a body sums.
pub(in crate::plan) fn heard(network: &Network) -> Result<OutputSums, NoModes> {
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
                if !mats.kind[i].moves() {
                    still += weight * mats.x0[i];
                }
            }
        }
        rows.push(row);
        held.push(still);
    }
    Ok(OutputSums { rows, held })
}
