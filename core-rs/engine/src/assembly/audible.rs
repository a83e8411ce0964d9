//! Which modes of a body are computed: chosen by sums of energies, then checked by playing them.

use std::collections::BTreeMap;

use crate::assembly::budget::Budget;
use crate::assembly::constants::QUIETER_STEP_DB;
use crate::assembly::loudness::Loudness;
use crate::assembly::truncate::KeptModes;
use crate::assembly::unit::BankPlan;
use crate::network::Network;
use crate::units::Rate;

/// Kinds of modes of a linear body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeKind {
    /// Modes of the body without damping; its damping does not couple them.
    Normal,
    /// Complex modes: those of the body with its damping, each a pole or a pair.
    Complex,
}

/// A body as a bank.
pub(crate) struct BankBody {
    pub(crate) bank: BankPlan,
    /// What outputs hear of its rest position   (its n_out)
    pub(crate) rest_outputs: Vec<f64>,
    pub(crate) n_modes: usize,
    pub(crate) computed_modes: KeptModes,
    pub(crate) kind: ModeKind,
}

/// Strikes on one MAT.
#[derive(Clone, Debug, Default)]
pub(crate) struct MatImpulses {
    /// Impulse of each strike [N·s].
    pub(crate) impulses: Vec<f64>,
    /// Their parts: frame, fraction of a frame after it, impulse [N·s]; by rising frame.
    pub(crate) frame_impulses: Vec<(u64, f64, f64)>,
}

/// Strikes on each MAT.
pub(crate) type ImpulsesByMat = BTreeMap<u32, MatImpulses>;

/// A body by its modes.
pub(crate) trait ModalBody {
    fn n_modes(&self) -> usize;
    /// Of a mode [Hz].
    fn frequency_hz(&self, mode: usize) -> f64;
    /// Whether anything moves or is displaced at t = 0.
    fn is_moving(&self) -> bool;
    /// The loudest modes; the others together stay below `left_out_level_max` [dB].
    fn loudest_modes(&self, left_out_level_max: Option<f64>) -> KeptModes;
    /// A bank of chosen modes, heard by outputs.
    fn bank(&self, chosen_modes: &[usize], outputs: &[u32]) -> BankPlan;
}

/// Chooses the modes that are kept.
pub(crate) fn audible_modes(
    body: &impl ModalBody,
    strikes: &ImpulsesByMat,
    network: &Network,
    mut left_out_db_max: Option<f64>,
    budget: &Budget,
    rate: Rate,
) -> KeptModes {
    let mut selected_modes = body.loudest_modes(left_out_db_max);
    let Some(level_max) = left_out_db_max else {
        return selected_modes;
    };
    let strike_frames = strikes
        .values()
        .flat_map(|impulses| &impulses.frame_impulses)
        .map(|part| part.0);
    let first_strike_frame = strike_frames.min().filter(|_| !body.is_moving());
    let outputs: Vec<u32> = (0..network.outputs().len() as u32).collect();
    let loudness = |mode_indices: &[usize]| {
        let mode_bank = body.bank(mode_indices, &outputs);
        Loudness::new(mode_bank, network, rate, first_strike_frame.unwrap_or(0))
    };
    let mut total_loudness = None;
    loop {
        let is_kept_mode = |mode: &usize| selected_modes.modes.binary_search(mode).is_ok();
        let is_audible = |mode: &usize| body.frequency_hz(*mode) <= budget.highest_audible_hz();
        let dropped_modes: Vec<usize> = (0..body.n_modes())
            .filter(|mode| !is_kept_mode(mode) && is_audible(mode))
            .collect();
        if dropped_modes.is_empty() {
            selected_modes.left_out_db = None;
            return selected_modes;
        }
        let total_loudness = total_loudness.get_or_insert_with(|| loudness(&(0..body.n_modes()).collect::<Vec<_>>()));
        let dropped_level = loudness(&dropped_modes).relative_db(total_loudness);
        selected_modes.left_out_db = Some(dropped_level);
        if dropped_level <= level_max {
            return selected_modes;
        }
        left_out_db_max = left_out_db_max.map(|db| db - (dropped_level - level_max).max(QUIETER_STEP_DB));
        selected_modes = body.loudest_modes(left_out_db_max);
    }
}

/// Impulses at each struck point [N·s].
pub(crate) fn impulses_by_point(strikes: &ImpulsesByMat) -> Vec<Vec<f64>> {
    strikes.values().map(|impulses| impulses.impulses.clone()).collect()
}
