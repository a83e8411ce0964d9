//! An island that is one linear body, as a bank of its complex modes.

use std::sync::Arc;

use crate::assembly::audible::{self, BankBody, ImpulsesByMat, ModalBody, ModeKind, impulses_by_point};
use crate::assembly::budget::Budget;
use crate::assembly::cells::add_weight;
use crate::assembly::constants::{ENERGY_SECONDS, TRUNCATED_COST_RATIO_MAX};
use crate::assembly::solved_modes::ModeCache;
use crate::assembly::truncate::{self, KeptModes};
use crate::assembly::unit::BankPlan;
use crate::bank::{Oscillator, Strikes};
use crate::body_modes::complex_modes::ComplexPart;
use crate::body_modes::complex_modes::{ComplexModes, Pole, Sum};
use crate::body_modes::linear::NoModes;
use crate::cell::{Response, recurrence};
use crate::kernel::bank::LANES;
use crate::maths::{exp, expm1};
use crate::network::{Network, Subset, Term};
use crate::units::Rate;

/// The complex modes of an island, as many as this score excites and the budget asks for, or those decided before.
pub(crate) fn bank(
    subset: &Subset,
    rate: Rate,
    budget: &Budget,
    pinned: Option<&[u32]>,
    strikes: &ImpulsesByMat,
    mode_cache: &ModeCache<'_>,
) -> Result<BankBody, NoModes> {
    let network = &subset.network;
    let (sum_rows, static_sums) = motion_sums(network);
    let struck_mats: Vec<usize> = strikes.keys().map(|&mat| mat as usize).collect();
    let body_modes = mode_cache.complex_modes(network, &sum_rows, &struck_mats, rate)?;
    let mode_body = ComplexModeBody {
        modes: &body_modes,
        strikes,
        budget,
        rate,
    };
    let chosen_modes = match pinned {
        Some(chosen_modes) => KeptModes::pinned(chosen_modes, body_modes.len()).ok_or(NoModes::Pinned)?,
        None => {
            let left_out_level_max = budget.left_out_db_max();
            let chosen_modes = audible::audible_modes(&mode_body, strikes, network, left_out_level_max, budget, rate);
            mode_body.all_if_cheap(chosen_modes)
        }
    };
    let mut bank = mode_body.bank(&chosen_modes.modes, &subset.outputs);
    let complex_parts = complex_parts(&audible_sequences(&body_modes, &chosen_modes.modes, rate));
    bank.complex = Some((Arc::new(network.clone()), complex_parts));
    Ok(BankBody {
        bank,
        rest_outputs: body_modes.rest.iter().zip(static_sums).map(|(a, b)| a + b).collect(),
        n_modes: body_modes.len(),
        computed_modes: chosen_modes,
        kind: ModeKind::Complex,
    })
}

/// What each output sums of positions and velocities, and its constant part from fixed points and the rest lengths of
/// links.
fn motion_sums(network: &Network) -> (Vec<Sum>, Vec<f64>) {
    let mats = network.mats();
    let (mut sum_rows, mut static_sums) = (Vec::new(), Vec::new());
    for output in network.outputs() {
        let (mut output_sum, mut static_sum) = (Sum::default(), 0.0);
        for term in &output.terms {
            match *term {
                Term::Position { first, len, weight } => {
                    output_sum.positions.extend((first..first + len).map(|i| (i, weight)));
                }
                Term::Ground { first, len, weight } => {
                    for i in first..first + len {
                        output_sum.positions.push((i, weight * mats.k[i]));
                        static_sum -= weight * mats.k[i] * mats.rest[i];
                    }
                }
                Term::Length { .. } => {} // a body has no links in space
                Term::Force { first, len, weight } => {
                    for run in network.runs() {
                        let run_links = run.first.max(first)..(run.first + run.len).min(first + len);
                        for link in run_links {
                            let (first_end, second_end) = run.pair(link - run.first, 0);
                            for (end, sign) in [(first_end, weight), (second_end, -weight)] {
                                output_sum.positions.push((end, sign * run.k));
                                output_sum.velocities.push((end, sign * run.z));
                            }
                            static_sum += weight * run.k * run.rest;
                        }
                    }
                }
            }
        }
        for &(mat, weight) in &output_sum.positions {
            if !mats.kind[mat].moves() {
                static_sum += weight * mats.x0[mat];
            }
        }
        sum_rows.push(output_sum);
        static_sums.push(static_sum);
    }
    (sum_rows, static_sums)
}

/// A body by its complex modes, where they are heard and struck.
struct ComplexModeBody<'a> {
    modes: &'a ComplexModes,
    strikes: &'a ImpulsesByMat,
    budget: &'a Budget,
    rate: Rate,
}

/// A real sequence of a mode with a recurrence of its own: its real or its imaginary part.
pub(crate) struct ModeSequence {
    pub(crate) mode: usize,
    /// Index of the part, in the mode's number and in what an output sees of it.
    pub(crate) component: usize,
    /// Sign of the part in what an output hears.
    pub(crate) sign: f64,
    /// a and b of x[n+1] = a·x[n] − b·x[n−1]
    pub(crate) recurrence: (f64, f64),
    /// x[0] and x[−1]
    pub(crate) now: f64,
    pub(crate) before: f64,
}

/// The parts of a mode.
fn sequences_of_mode(modes: &ComplexModes, mode: usize, rate: Rate) -> Vec<ModeSequence> {
    let [x, y] = modes.start[mode];
    let time_step = rate.step();
    let new_sequence = |recurrence, [now, before]: [f64; 2], part, sign| ModeSequence {
        mode,
        component: part,
        sign,
        recurrence,
        now,
        before,
    };
    let pole = modes.poles[mode].resolvable_at(rate);
    let [previous_x, previous_y] = pole.backward_step(time_step).apply([x, y]);
    match pole {
        Pole::Pair { decay, omega } => {
            let (a, b) = recurrence(decay, omega, rate);
            vec![
                new_sequence((a, b), [x, previous_x], 0, 1.0),
                new_sequence((a, b), [y, previous_y], 1, -1.0),
            ]
        }
        Pole::Real { decay } => vec![new_sequence((exp(-(decay * time_step)), 0.0), [x, previous_x], 0, 1.0)],
        Pole::Free => vec![
            new_sequence((2.0, 1.0), [x, previous_x], 0, 1.0),
            new_sequence((1.0, 0.0), [y, previous_y], 1, 1.0),
        ],
    }
}

/// The parts of some modes that outputs see.
pub(crate) fn audible_sequences(modes: &ComplexModes, mode_indices: &[usize], rate: Rate) -> Vec<ModeSequence> {
    let sequences = mode_indices
        .iter()
        .flat_map(|&mode| sequences_of_mode(modes, mode, rate));
    let is_audible = |sequence: &ModeSequence| {
        modes
            .output_shapes
            .iter()
            .any(|row| row[sequence.mode][sequence.component] != 0.0)
    };
    sequences.filter(is_audible).collect()
}

/// The response of a part to an impulse at a point.
pub(crate) fn impulse_response(modes: &ComplexModes, sequence: &ModeSequence, point: usize, rate: Rate) -> Response {
    let mode_gain = modes.struck_shapes[point][sequence.mode];
    match modes.poles[sequence.mode].resolvable_at(rate) {
        // Im z = Re(−i·z).
        Pole::Pair { decay, omega } => Response::Pair {
            decay,
            omega,
            gain: if sequence.component == 0 {
                mode_gain
            } else {
                [mode_gain[1], -mode_gain[0]]
            },
        },
        Pole::Real { decay } => Response::Real {
            decay,
            gain: mode_gain[0],
        },
        Pole::Free if sequence.component == 0 => Response::Free { gain: mode_gain[1] },
        Pole::Free => Response::Real {
            decay: 0.0,
            gain: mode_gain[1],
        },
    }
}

/// Which parts of which modes the oscillators are.
pub(crate) fn complex_parts(sequences: &[ModeSequence]) -> Vec<ComplexPart> {
    let to_part = |part: &ModeSequence| ComplexPart {
        mode: part.mode,
        sequence: part.component,
        sign: part.sign,
    };
    sequences.iter().map(to_part).collect()
}

impl ComplexModeBody<'_> {
    /// All modes, unless those that were kept are cheaper by enough.
    fn all_if_cheap(&self, modes_kept: KeptModes) -> KeptModes {
        let all_modes: Vec<usize> = (0..self.modes.len()).collect();
        let bank_cost = |mode_indices: &[usize]| audible_sequences(self.modes, mode_indices, self.rate).len() as f64;
        // A group of lanes costs the same whether it is full or not.
        if bank_cost(&all_modes) > LANES as f64
            && bank_cost(&modes_kept.modes) <= TRUNCATED_COST_RATIO_MAX * bank_cost(&all_modes)
        {
            return modes_kept;
        }
        KeptModes {
            modes: all_modes,
            left_out_db: None,
        }
    }
}

impl ModalBody for ComplexModeBody<'_> {
    fn n_modes(&self) -> usize {
        self.modes.len()
    }

    fn frequency_hz(&self, mode: usize) -> f64 {
        self.modes.frequency_and_decay(mode).0
    }

    fn is_moving(&self) -> bool {
        self.modes.start.iter().flatten().any(|x| *x != 0.0)
    }

    fn loudest_modes(&self, left_out_level_max: Option<f64>) -> KeptModes {
        let body_modes = self.modes;
        let point_impulses = impulses_by_point(self.strikes);
        let squared_norm = |[re, im]: [f64; 2]| re * re + im * im;
        let mode_energy = |mode: usize| {
            let blow_energies =
                body_modes
                    .struck_shapes
                    .iter()
                    .zip(&point_impulses)
                    .flat_map(|(struck_row, point_impulses)| {
                        point_impulses.iter().map(|p| p * p * squared_norm(struck_row[mode]))
                    });
            let (_, decay) = body_modes.frequency_and_decay(mode);
            // ∫ e^(−2σt) over the first moments.
            let decay_integral = if decay * ENERGY_SECONDS > 1e-9 {
                -expm1(-2.0 * decay * ENERGY_SECONDS) / (2.0 * decay)
            } else {
                ENERGY_SECONDS
            };
            (squared_norm(body_modes.start[mode]) + blow_energies.sum::<f64>()) * decay_integral
        };
        let energies: Vec<f64> = (0..body_modes.len()).map(mode_energy).collect();
        let row_norms = |row: &Vec<[f64; 2]>| row.iter().map(|&c| squared_norm(c).sqrt()).collect();
        let output_rows: Vec<Vec<f64>> = body_modes.output_shapes.iter().map(row_norms).collect();
        let output_rows: Vec<&[f64]> = output_rows.iter().map(Vec::as_slice).collect();
        let frequency = |mode: usize| body_modes.frequency_and_decay(mode).0;
        let mut selected_modes =
            truncate::loudest_by_energy(&[energies], &output_rows, left_out_level_max, self.budget, frequency);
        // Rigid motion stays, however quiet it is.
        let is_free_mode = |mode: &usize| body_modes.poles[*mode] == Pole::Free;
        selected_modes.modes.extend((0..body_modes.len()).filter(is_free_mode));
        selected_modes.modes.sort_unstable();
        selected_modes.modes.dedup();
        selected_modes
    }

    fn bank(&self, mode_indices: &[usize], outputs: &[u32]) -> BankPlan {
        let body_modes = self.modes;
        let mut bank_plan = BankPlan::default();
        let sequences = audible_sequences(body_modes, mode_indices, self.rate);
        for part in &sequences {
            let mut weights = Vec::new();
            for (row, &output) in body_modes.output_shapes.iter().zip(outputs) {
                add_weight(&mut weights, output, part.sign * row[part.mode][part.component]);
            }
            let (a, b) = part.recurrence;
            bank_plan.oscillators.push(Oscillator {
                a,
                b,
                position: part.now,
                previous_position: part.before,
                outputs: weights,
                blows: Vec::new(),
            });
        }
        for (point, blows) in self.strikes.values().enumerate() {
            bank_plan.strikes.push(Strikes {
                members: 0..sequences.len(),
                responses: sequences
                    .iter()
                    .map(|part| impulse_response(body_modes, part, point, self.rate))
                    .collect(),
                member_shares: vec![1.0; sequences.len()],
                w: self.rate.step() * self.rate.step(),
                blows: blows.frame_impulses.clone(),
            });
        }
        bank_plan
    }
}
