//! A body between two frames: positions of its ports at instants of a frame, and effects of impulses at such instants.

use std::f64::consts::PI;

use super::{RunningModal, WINDOW_FRAMES, lanes};
use crate::cell::{Cell, Response};
use crate::kernel::bank::{LANES, Lanes};
use crate::kernel::ports::{self, PADDING};
use crate::state::ModuleState;

/// Tables for n instants of a frame, for every group of modes.
#[derive(Clone, Debug)]
pub(super) struct InstantTables {
    /// Weights of a mode's position now and at the next frame that give its position at each instant   (n_groups; modes
    /// of the group, 2, n padded)
    interpolation: Vec<Vec<f64>>,
    /// Corrections of these weights for what strikes within the frame add to the position at the next frame, and 0
    /// (n_groups; modes of the group, 2, n padded)
    strike_paths: Vec<Vec<f64>>,
    /// Displacement of a mode at the next frame by an impulse at each instant, and what has to be added at the one
    /// after so that the motion is exact from then on   (n_groups, n); for complex modes, for each port   (n_ports,
    /// n_groups, n)
    kick_tables: Vec<Vec<Vec<[Lanes; 2]>>>,
}

const UNIT_LANES: Lanes = Lanes([1.0; LANES]);

/// Faster modes move by a strike in a straight line to the next frame. What two samples say of the motion between them
/// holds for free motion: of a strike in the middle of a frame, it would be many times too large for modes near a
/// multiple of half the rate, and up to 1.2 times below this [rad/frame].
const STRUCK_ANGLE_MAX: f64 = 2.0 * PI / 3.0;

impl RunningModal {
    /// Make tables for instants of a frame, 0 to 1; only for continuous modes.
    pub(crate) fn make_tables(&mut self, instants: &[f64]) {
        let plan = &self.script.plan;
        let (modes, rate) = (&plan.modes, plan.rate);
        let step_square = rate.step() * rate.step();
        let n_instants = instants.len();
        let interpolation = |mode: usize| {
            let n_padded = n_instants.next_multiple_of(PADDING);
            let mut weights = vec![0.0; 2 * n_padded];
            let (weight_now, weight_next) = weights.split_at_mut(n_padded);
            if let Some(mode_response) = plan.response(mode) {
                for ((weight_now, weight_next), &instant) in weight_now.iter_mut().zip(weight_next).zip(instants) {
                    (*weight_now, *weight_next) = mode_response.interpolation(instant, rate);
                }
            }
            weights
        };
        let strike_path = |mode: usize| {
            let mut weights = interpolation(mode);
            let is_fast = plan
                .response(mode)
                .is_some_and(|response| response.pole_angle(rate) > STRUCK_ANGLE_MAX);
            let (corrections, next_weights) = weights.split_at_mut(n_instants.next_multiple_of(PADDING));
            for ((correction, next_weight), &instant) in corrections.iter_mut().zip(next_weights).zip(instants) {
                *correction = if is_fast { instant - *next_weight } else { 0.0 };
                *next_weight = 0.0;
            }
            weights
        };
        let split_kick = |port: usize, mode: usize, instant_index: usize| {
            let mode_response = plan.port_response(port, mode);
            mode_response.map_or([0.0; 2], |mode_response| {
                mode_response.split(step_square, instants[instant_index], rate)
            })
        };
        let n_tables = match &plan.complex_responses {
            Some(complex_responses) => complex_responses.port_responses.len(),
            None => 1,
        };
        let kick_table = |group: usize, j: usize, split_of: &dyn Fn(usize, usize) -> [f64; 2]| {
            [0, 1].map(|step_index| lanes(modes, group, |mode| split_of(mode, j)[step_index]))
        };
        let group_range = 0..modes.len().div_ceil(LANES);
        let group_modes = |group: usize| group * LANES..modes.len().min((group + 1) * LANES);
        self.instant_tables = Some(InstantTables {
            interpolation: group_range
                .clone()
                .map(|group| group_modes(group).flat_map(interpolation).collect())
                .collect(),
            strike_paths: group_range
                .clone()
                .map(|group| group_modes(group).flat_map(strike_path).collect())
                .collect(),
            kick_tables: (0..n_tables)
                .map(|port| {
                    let split_kick = |mode: usize, j: usize| split_kick(port, mode, j);
                    let group_range = group_range.clone();
                    group_range
                        .map(|group| (0..n_instants).map(|j| kick_table(group, j, &split_kick)).collect())
                        .collect()
                })
                .collect(),
        });
    }

    /// Displacement of each mode by an impulse at a port, at times [s] after it [m/N·s]; extended to times before it
    /// (n_modes, n_times)
    pub(crate) fn mode_responses(&self, pushed_port: usize, times: &[f64]) -> Vec<f64> {
        let plan = &self.script.plan;
        let mode_responses = |mode: usize| {
            let mode_response = plan.port_response(pushed_port, mode);
            times
                .iter()
                .map(move |&t| mode_response.map_or(0.0, |mode_response| mode_response.two_sided(t)))
        };
        (0..plan.modes.len()).flat_map(mode_responses).collect()
    }

    /// Weights of these displacements in that of another port   (n_modes)
    pub(crate) fn response_weights(&self, pushed_port: usize, moved_port: usize) -> impl Iterator<Item = f64> {
        let plan = &self.script.plan;
        // The responses of complex modes already contain the shares of the port `pushed_port`.
        let is_complex = plan.complex_responses.is_some();
        let shape_pairs = plan.ports[pushed_port].shape.iter().zip(&plan.ports[moved_port].shape);
        shape_pairs.map(move |(a, b)| if is_complex { *b } else { a * b })
    }

    /// The continuous motion of each mode, and of nothing but it; `None` for modes that are complex or discrete
    /// (n_modes)
    pub(crate) fn cells(&self) -> Option<Vec<Cell>> {
        let plan = &self.script.plan;
        let mode_cells = plan.modes.iter().map(|mode| mode.cell);
        mode_cells
            .collect::<Option<Vec<Cell>>>()
            .filter(|_| plan.complex_responses.is_none())
    }

    /// Share of each mode in the position of a port   (n_modes)
    pub(crate) fn shape(&self, port: usize) -> &[f64] {
        &self.script.plan.ports[port].shape
    }

    /// Velocity that an impulse at one port gives another at once [m/s per N·s].
    pub(crate) fn velocity_jump(&self, pushed_port: usize, moved_port: usize) -> f64 {
        let plan = &self.script.plan;
        let ports = &plan.ports;
        if let Some(complex_responses) = &plan.complex_responses {
            let jump_terms = complex_responses.port_responses[pushed_port]
                .iter()
                .zip(&ports[moved_port].shape);
            return jump_terms
                .map(|(response, share)| share * response.velocity_jump())
                .sum();
        }
        let shape_pairs = ports[pushed_port].shape.iter().zip(&ports[moved_port].shape);
        shape_pairs.map(|(a, b)| a * b).sum()
    }

    /// The fastest motion of its modes: |λ| of e^(λt) [1/s].
    pub(crate) fn pole_magnitude_max(&self) -> f64 {
        let plan = &self.script.plan;
        let all_responses: Vec<Response> = match &plan.complex_responses {
            Some(complex_responses) => complex_responses.port_responses.iter().flatten().copied().collect(),
            None => {
                let mode_range = 0..plan.modes.len();
                mode_range.filter_map(|mode| plan.response(mode)).collect()
            }
        };
        all_responses
            .iter()
            .map(Response::pole_magnitude_max)
            .fold(0.0, f64::max)
    }

    /// Write the positions of a port in this frame, at each instant (n), if nothing more pushes it [m].
    pub(crate) fn port_positions(&mut self, port: usize, positions: &mut [f64]) {
        self.restart_window();
        self.contact_free_frames = 0;
        positions.fill(self.script.plan.ports[port].rest_position);
        let Some(instant_tables) = &self.instant_tables else {
            return;
        };
        for ((motion, table), rows) in self
            .window_end_motions
            .iter()
            .zip(&instant_tables.interpolation)
            .zip(&self.script.row_shapes)
        {
            // The motions are one frame ahead: their `previous_positions` are the present.
            ports::add_path(
                &rows[port],
                table,
                &motion.previous_positions,
                &motion.positions,
                positions,
            );
        }
        if self.has_strike_kicks {
            for ((strike_kick, table), rows) in self
                .strike_kicks
                .iter()
                .zip(&instant_tables.strike_paths)
                .zip(&self.script.row_shapes)
            {
                ports::add_path(&rows[port], table, strike_kick, &Lanes::ZERO, positions);
            }
        }
    }

    /// Take impulses [N·s] on a port at the instants of this frame (n).
    pub(crate) fn apply_impulses(&mut self, port: usize, impulses: &[f64], modules: &mut ModuleState) {
        self.restart_window();
        self.contact_free_frames = 0;
        let Some(tables) = &self.instant_tables else { return };
        let is_complex = self.script.plan.complex_responses.is_some();
        for (group, table) in tables.kick_tables[if is_complex { port } else { 0 }].iter().enumerate() {
            let group_rows = &self.script.row_shapes[group];
            // The responses of complex modes already contain these shares.
            let port_share = if is_complex { &UNIT_LANES } else { &group_rows[port] };
            let mode_lanes = [
                &mut self.window_end_motions[group].positions,
                &mut self.pending_kicks[group],
            ];
            let rows_ahead = (&mut self.row_history[self.present_index + 1..], WINDOW_FRAMES);
            ports::apply_impulses(impulses, table, port_share, mode_lanes, group_rows, rows_ahead);
        }
        self.has_pending_kicks = true;
        self.set_ports(modules);
    }
}
