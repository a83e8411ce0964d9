//! An island that is one linear body, struck and heard: a bank of its normal modes or, if they do not suffice, of its
//! complex modes.

use crate::assembly::audible::{self, BankBody, ImpulsesByMat, ModalBody, ModeKind, impulses_by_point};
use crate::assembly::budget::Budget;
use crate::assembly::cells::add_weight;
use crate::assembly::complex_body;
use crate::assembly::solved_modes::ModeCache;
use crate::assembly::truncate::{self, KeptModes};
use crate::assembly::unit::BankPlan;
use crate::bank::{Oscillator, Strikes};
use crate::body_modes::linear::NoModes;
use crate::body_modes::normal_modes::{Modes, Row};
use crate::cell::Response;
use crate::network::{Network, Subset, Term};
use crate::timeline::{StrikeTiming, Timeline};
use crate::units::Rate;

/// The modes of an island, as many as this score excites and the budget asks for, or those decided before.
pub(crate) fn bank(
    subset: &Subset,
    timeline: &Timeline,
    budget: &Budget,
    pinned: Option<&[u32]>,
    mode_cache: &ModeCache<'_>,
) -> Result<BankBody, NoModes> {
    let is_driven = !timeline.keys.is_empty() || !timeline.drives.is_empty();
    let is_led = !timeline.glides.is_empty() || !timeline.leads.is_empty();
    if is_driven || !timeline.ergons.is_empty() || is_led {
        return Err(NoModes::Driven);
    }
    if !timeline.gates.is_empty() {
        return Err(NoModes::Gated);
    }
    let first_part = subset.network.mats().part.first().map(|&part| part as usize);
    let is_discrete = first_part.is_some_and(|part| subset.network.parts()[part].ca_rate.is_some());
    let strikes = impulses_by_mat(timeline, |_| true, is_discrete);
    match normal_modes_bank(subset, timeline, budget, pinned, &strikes, mode_cache) {
        // A takeover in a session transfers the motion of a bank mass by mass, by normal modes only.
        Err(NoModes::Damping | NoModes::ForceHeard | NoModes::Slow) if !is_discrete && !timeline.is_open => {
            complex_body::bank(subset, timeline.rate, budget, pinned, &strikes, mode_cache)
        }
        normal_result => normal_result,
    }
}

/// The bank of normal modes, which damping does not couple.
fn normal_modes_bank(
    subset: &Subset,
    timeline: &Timeline,
    budget: &Budget,
    pinned: Option<&[u32]>,
    strikes: &ImpulsesByMat,
    mode_cache: &ModeCache<'_>,
) -> Result<BankBody, NoModes> {
    let (network, rate) = (&subset.network, timeline.rate);
    let PositionSums {
        mut position_rows,
        constant_sums,
    } = position_sums_only(network)?;
    let n_outputs = position_rows.len();
    position_rows.extend(strikes.keys().map(|&mat| vec![(mat as usize, 1.0)]));
    let mut body_modes = mode_cache.normal_modes(network, &position_rows, rate)?;
    // What a session will strike is not known: any mode may move.
    let rotation_mats = (!timeline.is_open).then(|| strikes.keys().map(|&mat| mat as usize).collect());
    if rotation_mats.is_some() {
        body_modes.rotate(&(n_outputs..position_rows.len()).collect::<Vec<_>>(), rate);
    }
    if let Some(unfit_reason) = body_modes.unfit_reason(rate) {
        return Err(unfit_reason);
    }
    // A free body goes by complex modes, which also give the forces in it; a session uses normal modes only.
    if body_modes.is_free() && !timeline.is_open {
        return Err(NoModes::Slow);
    }
    let (output_shapes, struck_shapes) = body_modes.shapes.split_at(n_outputs);
    let normal_modes = NormalModeBody {
        modes: &body_modes,
        output_shapes,
        struck_shapes,
        strikes,
        budget,
        rate,
    };
    let chosen_modes = match pinned {
        Some(chosen_modes) => KeptModes::pinned(chosen_modes, body_modes.len()).ok_or(NoModes::Pinned)?,
        None => {
            // What a session will strike is not known: no audible mode is left out.
            let left_out_level_max = budget.left_out_db_max().filter(|_| !timeline.is_open);
            audible::audible_modes(&normal_modes, strikes, network, left_out_level_max, budget, rate)
        }
    };
    let rest_outputs = (0..n_outputs)
        .map(|output| {
            let moving_part: f64 = output_shapes[output]
                .iter()
                .zip(&body_modes.rest)
                .map(|(a, b)| a * b)
                .sum();
            moving_part + constant_sums[output]
        })
        .collect();
    Ok(BankBody {
        bank: BankPlan {
            rotation_mats,
            ..normal_modes.bank(&chosen_modes.modes, &subset.outputs)
        },
        rest_outputs,
        n_modes: body_modes.len(),
        computed_modes: chosen_modes,
        kind: ModeKind::Normal,
    })
}

/// A body by its normal modes, where they are heard and struck.
struct NormalModeBody<'a> {
    modes: &'a Modes,
    /// (n_out, n_modes)
    output_shapes: &'a [Vec<f64>],
    /// (n_struck, n_modes)
    struck_shapes: &'a [Vec<f64>],
    strikes: &'a ImpulsesByMat,
    budget: &'a Budget,
    rate: Rate,
}

impl ModalBody for NormalModeBody<'_> {
    fn n_modes(&self) -> usize {
        self.modes.len()
    }

    fn frequency_hz(&self, mode: usize) -> f64 {
        self.modes.frequency_and_decay(mode, self.rate).0
    }

    fn is_moving(&self) -> bool {
        let modes = self.modes;
        (0..modes.len()).any(|mode| modes.x0[mode] != modes.rest[mode] || modes.v0[mode] != 0.0)
    }

    fn loudest_modes(&self, left_out_level_max: Option<f64>) -> KeptModes {
        let (output_shapes, struck_shapes, impulse_rows) =
            (self.output_shapes, self.struck_shapes, impulses_by_point(self.strikes));
        truncate::loudest_modes(
            self.modes,
            output_shapes,
            struck_shapes,
            &impulse_rows,
            left_out_level_max,
            self.budget,
            self.rate,
        )
    }

    fn bank(&self, chosen_modes: &[usize], outputs: &[u32]) -> BankPlan {
        let output_and_struck_shapes = [self.output_shapes, self.struck_shapes];
        oscillator_bank(
            self.modes,
            chosen_modes,
            output_and_struck_shapes,
            outputs,
            self.strikes,
            self.rate,
        )
    }
}

/// Some of the modes as a bank.
fn oscillator_bank(
    modes: &Modes,
    chosen_modes: &[usize],
    [output_shapes, struck_shapes]: [&[Vec<f64>]; 2],
    outputs: &[u32],
    strikes: &ImpulsesByMat,
    rate: Rate,
) -> BankPlan {
    let mut bank_plan = BankPlan::default();
    for &mode in chosen_modes {
        let mode_ratios = modes.ratios(mode, rate);
        let mut weights = Vec::new();
        for (row, &output) in output_shapes.iter().zip(outputs) {
            add_weight(&mut weights, output, row[mode]);
        }
        bank_plan.oscillators.push(Oscillator {
            a: 2.0 - mode_ratios.kappa - mode_ratios.zeta,
            b: 1.0 - mode_ratios.zeta,
            position: modes.x0[mode] - modes.rest[mode],
            previous_position: modes.position_before(mode, rate),
            outputs: weights,
            blows: Vec::new(),
        });
    }
    for (shape, blows) in struck_shapes.iter().zip(strikes.values()) {
        bank_plan.strikes.push(Strikes {
            members: 0..chosen_modes.len(),
            responses: if modes.is_discrete {
                Vec::new()
            } else {
                let mode_cells = chosen_modes.iter().map(|&mode| modes.resolvable_cell(mode, rate));
                mode_cells.map(Response::Cell).collect()
            },
            member_shares: chosen_modes.iter().map(|&mode| shape[mode]).collect(),
            w: if modes.is_discrete {
                1.0
            } else {
                rate.step() * rate.step()
            },
            blows: blows.frame_impulses.clone(),
        });
    }
    bank_plan
}

/// Strikes on each MAT that pass `is_body_mat`. In a discrete network they act on frames.
pub(crate) fn impulses_by_mat(
    timeline: &Timeline,
    is_body_mat: impl Fn(u32) -> bool,
    is_discrete: bool,
) -> ImpulsesByMat {
    let strike_timing = if is_discrete {
        StrikeTiming::Nearest
    } else {
        StrikeTiming::Exact
    };
    let mut impulses_by_mat = ImpulsesByMat::new();
    for strike in timeline.strikes.iter().filter(|strike| is_body_mat(strike.mat)) {
        let mat_blows = impulses_by_mat.entry(strike.mat).or_default();
        mat_blows.impulses.push(strike.impulse);
        let strike_parts = timeline.strike_parts(strike, strike_timing);
        mat_blows
            .frame_impulses
            .extend(strike_parts.map(|part| (part.frame, part.frame_fraction, part.impulse)));
    }
    for mat_blows in impulses_by_mat.values_mut() {
        mat_blows.frame_impulses.sort_by_key(|part| part.0);
    }
    impulses_by_mat
}

/// What outputs sum.
pub(crate) struct PositionSums {
    /// Positions, by output.
    pub(crate) position_rows: Vec<Row>,
    /// The constant part of each output, from points that never move.
    pub(crate) constant_sums: Vec<f64>,
}

/// What each output of a body sums; refused if one hears a force.
pub(crate) fn position_sums_only(network: &Network) -> Result<PositionSums, NoModes> {
    let mut output_terms = network.outputs().iter().flat_map(|output| &output.terms);
    let has_force = output_terms.any(|term| !matches!(term, Term::Position { .. }));
    if has_force {
        return Err(NoModes::ForceHeard);
    }
    position_and_spring_sums(network)
}

/// The same, with forces of undamped springs as sums of positions; refused if an output hears another force.
pub(crate) fn position_and_spring_sums(network: &Network) -> Result<PositionSums, NoModes> {
    let mats = network.mats();
    let (mut position_rows, mut constant_sums) = (Vec::new(), Vec::new());
    for output in network.outputs() {
        let (mut output_row, mut static_sum) = (Row::new(), 0.0);
        let mut add_mat = |mat: usize, weight: f64| {
            output_row.push((mat, weight));
            if !mats.kind[mat].moves() {
                static_sum += weight * mats.x0[mat];
            }
        };
        let mut rest_forces = 0.0;
        for term in &output.terms {
            match *term {
                Term::Position { first, len, weight } => {
                    (first..first + len).for_each(|mat| add_mat(mat, weight));
                }
                Term::Force { first, len, weight } => {
                    for link in first..first + len {
                        let link_run = network.run_of(link).filter(|link_run| link_run.is_undamped_spring());
                        let (link_run, weight) = (link_run.ok_or(NoModes::ForceHeard)?, -weight);
                        let run_offset = link - link_run.first;
                        add_mat(link_run.b + run_offset, weight * link_run.k);
                        add_mat(link_run.a + run_offset, -weight * link_run.k);
                        rest_forces -= weight * link_run.k * link_run.rest;
                    }
                }
                Term::Ground { .. } | Term::Length { .. } => return Err(NoModes::ForceHeard),
            }
        }
        position_rows.push(output_row);
        constant_sums.push(static_sum + rest_forces);
    }
    Ok(PositionSums {
        position_rows,
        constant_sums,
    })
}
