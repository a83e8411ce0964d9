//! Isolated CELs as oscillators with exactly the poles of the scheme, and free masses, which move at constant speed.

use std::collections::HashMap;

use crate::assembly::islands::IslandMembers;
use crate::assembly::unit::BankPlan;
use crate::bank::{Blow, Kick, Oscillator};
use crate::body_modes::ANGLE_MIN;
use crate::interrupt;
use crate::network::{Error, MatKind, Network, Subset, Term};
use crate::scheme::Scheme;
use crate::start::backward_steps;
use crate::timeline::{Timeline, strike_forces};
use crate::units::Rate;
use crate::units::frame;

/// Most oscillators of one bank: enough to fill vectors, few enough to distribute banks over threads.
const BANK_OSCILLATORS_MAX: usize = 2_048;
/// Memory is given back each time this many oscillators have been moved into banks.
const SHRINK_EVERY: usize = 1 << 16;
/// A part with at least this many CELs has banks of its own, so that its sound does not depend on other parts, bit for
/// bit. Smaller parts share banks: a few CELs would leave most of a vector empty.
const SEPARATE_BANK_CELLS_MIN: usize = 256;

/// Whether an island is a single CEL or MAS that no link, hand or path touches. A CEL so slow that a two-term
/// recurrence would round its pitch does not count.
pub(crate) fn is_uncoupled_cell(network: &Network, island: &IslandMembers, rate: Rate) -> bool {
    let &[mat] = &island.mats[..] else {
        return false;
    };
    let (mats, mat) = (network.mats(), mat as usize);
    let has_weight = mats.weight_of(mat) != 0.0;
    if !island.links.is_empty() || island.is_driven || has_weight || !mats.kind[mat].moves() {
        return false;
    }
    if mats.kind[mat] == MatKind::Mas {
        return true; // x[n+1] = 2x[n] − x[n−1] has no rounded coefficients
    }
    let part = network.parts().get(mats.part[mat] as usize);
    let time_step = part
        .and_then(|part| part.ca_rate)
        .map_or(rate.step(), |ca_rate| rate.step() / ca_rate.step());
    let kappa = mats.k[mat] / mats.m[mat] * time_step * time_step;
    let zeta = mats.z[mat] / mats.m[mat] * time_step;
    // A discrete cell may diverge (Jury); it is refused where it is stepped.
    let is_stable = part.is_none_or(|part| part.ca_rate.is_none()) || kappa + 2.0 * zeta < 4.0;
    is_stable && kappa >= ANGLE_MIN * ANGLE_MIN
}

/// Makes banks of a network of isolated CELs, and adds what outputs hear of their rest positions to `output_offsets`.
pub(crate) fn oscillator_banks(
    subset: &Subset,
    timeline: &Timeline,
    output_offsets: &mut [f64],
) -> Result<Vec<BankPlan>, Error> {
    let network = &subset.network;
    let (mats, rate) = (network.mats(), timeline.rate);
    let scheme = Scheme::new(network, rate)?;
    let backward_steps = backward_steps(network, timeline, &scheme, &mats.x0, &[], &|_| true);
    let mut cell_oscillators: Vec<Oscillator> = (0..network.n_mat())
        .map(|i| {
            let offset = mats.x0[i] - mats.rest[i];
            Oscillator {
                a: 2.0 - scheme.kappa[i] - scheme.zeta[i],
                b: 1.0 - scheme.zeta[i],
                position: offset,
                previous_position: offset - backward_steps[i],
                outputs: Vec::new(),
                blows: Vec::new(),
            }
        })
        .collect();
    for (output, &index) in network.outputs().iter().zip(&subset.outputs) {
        for term in &output.terms {
            let (first, len, weight, is_ground_force) = match *term {
                Term::Position { first, len, weight } => (first, len, weight, false),
                Term::Ground { first, len, weight } => (first, len, weight, true),
                Term::Force { .. } | Term::Length { .. } => continue,
            };
            for i in interrupt::steps(first..first + len) {
                let cell = &mut cell_oscillators[i];
                let weight = weight * if is_ground_force { mats.k[i] } else { 1.0 };
                if !is_ground_force {
                    output_offsets[index as usize] += weight * mats.rest[i];
                }
                add_weight(&mut cell.outputs, index, weight);
            }
        }
    }
    add_blows(network, timeline, &scheme, &mut cell_oscillators);
    let mut part_sizes = HashMap::new();
    for (part, cell) in mats.part.iter().zip(&cell_oscillators) {
        *part_sizes.entry(*part).or_insert(0) += usize::from(!cell.outputs.is_empty());
    }
    let mut cell_banks: Vec<BankPlan> = Vec::new();
    // In reverse, so that memory of moved oscillators can be given back: millions of them are not held twice.
    cell_oscillators.reverse();
    for i in interrupt::steps(0..cell_oscillators.len()) {
        if i % SHRINK_EVERY == 0 {
            cell_oscillators.shrink_to_fit();
        }
        let Some(mut oscillator) = cell_oscillators.pop() else {
            break;
        };
        if oscillator.outputs.is_empty() {
            continue;
        }
        oscillator.blows.sort_by_key(|blow| blow.frame);
        let part = Some(mats.part[i]).filter(|part| part_sizes[part] >= SEPARATE_BANK_CELLS_MIN);
        let has_room =
            |last_bank: &BankPlan| last_bank.part == part && last_bank.mats_and_rests.len() < BANK_OSCILLATORS_MAX;
        if !cell_banks.last().is_some_and(has_room) {
            cell_banks.push(BankPlan {
                part,
                is_open: timeline.is_open,
                ..BankPlan::default()
            });
        }
        if let Some(last_bank) = cell_banks.last_mut() {
            last_bank.mats_and_rests.push((subset.mats[i], mats.rest[i]));
            last_bank.oscillators.push(oscillator);
        }
    }
    Ok(cell_banks)
}

/// Add what strikes and pushes each oscillator (n_mat).
fn add_blows(network: &Network, timeline: &Timeline, scheme: &Scheme, cell_oscillators: &mut [Oscillator]) {
    for push in strike_forces(network, timeline, |_| true) {
        let struck_mat = push.mat as usize;
        cell_oscillators[struck_mat].blows.push(Blow {
            frame: push.frame,
            kick: Kick::Displacement(scheme.w[struck_mat] * push.force),
        });
    }
    for ergon in &timeline.ergons {
        let struck_mat = ergon.mat as usize;
        cell_oscillators[struck_mat].blows.push(Blow {
            frame: frame(ergon.instant, timeline.rate.hertz()),
            kick: Kick::Ergon {
                mass: ergon.mass,
                speed: ergon.speed,
                w: scheme.w[struck_mat],
            },
        });
    }
}

/// Add a weight to what an output hears.
pub(crate) fn add_weight(weights: &mut Vec<(u32, f64)>, output: u32, weight: f64) {
    if weight == 0.0 {
        return;
    }
    match weights.iter_mut().find(|(known_output, _)| *known_output == output) {
        Some((_, known_weight)) => *known_weight += weight,
        None => {
            if weights.is_empty() {
                weights.reserve_exact(1); // most are heard by one output alone
            }
            weights.push((output, weight));
        }
    }
}
