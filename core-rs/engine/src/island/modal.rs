//! A linear body inside an island: its modes, driven and observed at its ports.
//!
//! The free motion of a body is always computed at least one frame ahead, as a rule many frames at once: a window. The
//! effect of pushes is added to it, because the body is linear: to ports and outputs at once, by their known responses
//! (`pushes`), to the modes at the end of the window. What happens between frames needs the modes themselves, so the
//! computation goes back to that frame. The result depends on frames alone, never on blocks.

mod instants;
mod plan;
mod pushes;
mod script;

pub(crate) use plan::{ComplexResponses, Modal, Mode, Port, StruckPoint};

use std::sync::Arc;

use instants::InstantTables;
use script::{ModalScript, StrikeStep, lanes};

use crate::kernel::bank::{GroupCoefficients, GroupMotion, LANES, LaneSum, Lanes, advance_and_observe, lane_total};
use crate::kernel::ports;
use crate::state::ModuleState;

/// Number of frames that are computed ahead at once: enough to keep the modes in registers, and few enough that
/// discarding them costs little.
const FRAMES_AHEAD: usize = 64;
/// Frames without a contact between frames before [`FRAMES_AHEAD`] frames are computed ahead: one that bounces may push
/// again soon.
const CONTACT_FREE_FRAMES_MIN: u32 = 16;

/// A running body.
#[derive(Clone, Debug)]
pub(crate) struct RunningModal {
    script: Arc<ModalScript>,
    /// The modes at the furthest frame in `row_history`.
    window_end_motions: Vec<GroupMotion>,
    /// The modes at the first frame in `row_history`.
    window_start_motions: Vec<GroupMotion>,
    /// Position of each row (port or output) from some frame up to the furthest   (n_rows, WINDOW_FRAMES)
    row_history: Vec<f64>,
    /// Indices in `row_history` of the present frame and of the furthest, which is at least one later.
    present_index: usize,
    window_end_index: usize,
    /// Positions of the ports one frame ago   (n_ports)
    previous_positions: Vec<f64>,
    sums: Vec<LaneSum>,
    kicks: Vec<Lanes>,
    /// What impulses between frames have still to add to the modes.
    pending_kicks: Vec<Lanes>,
    has_pending_kicks: bool,
    /// What the strikes of this frame add to the modes at the next, and whether there are any.
    strike_kicks: Vec<Lanes>,
    has_strike_kicks: bool,
    instant_tables: Option<InstantTables>,
    port_forces: Vec<f64>,
    /// Positions of the rows at the next frame, while they are pushed   (n_rows)
    row_positions: Vec<f64>,
    /// Forces on the ports in the frames of `row_history` that the modes do not contain yet, and whether there are any
    /// (FRAMES_AHEAD, n_ports)
    window_forces: Vec<f64>,
    has_window_forces: bool,
    /// Frames without a contact between frames, up to [`CONTACT_FREE_FRAMES_MIN`].
    contact_free_frames: u32,
    next_strike_index: usize,
    /// Rates under additional damping, and whether it is on   (n_groups)
    damped_coefficients: Vec<GroupCoefficients>,
    is_damped: bool,
}

crate::archive::state!(RunningModal {
    window_end_motions,
    window_start_motions,
    row_history,
    present_index,
    window_end_index,
    previous_positions,
    kicks,
    pending_kicks,
    has_pending_kicks,
    port_forces,
    window_forces,
    has_window_forces,
    contact_free_frames,
    next_strike_index,
    damped_coefficients,
    is_damped
});

/// Frames in `row_history`: the present, and the frames ahead.
const WINDOW_FRAMES: usize = FRAMES_AHEAD + 1;

impl RunningModal {
    pub(crate) fn new(plan: &Modal) -> Self {
        let mut script = ModalScript::new(plan);
        script.window_responses = pushes::window_responses(&script);
        let group_count = script.coefficients.len();
        let start_motions: Vec<GroupMotion> = (0..group_count)
            .map(|group| GroupMotion {
                positions: lanes(&plan.modes, group, |mode| plan.modes[mode].start_amplitude),
                previous_positions: lanes(&plan.modes, group, |mode| plan.modes[mode].previous_amplitude),
            })
            .collect();
        let n_rows = plan.ports.len() + plan.outputs.len();
        let mode_sum = |shape: &[f64], mode_value: fn(&Mode) -> f64| -> f64 {
            plan.modes
                .iter()
                .zip(shape)
                .map(|(mode, share)| mode_value(mode) * share)
                .sum()
        };
        let mut body = Self {
            window_start_motions: start_motions.clone(),
            row_history: vec![0.0; n_rows * WINDOW_FRAMES],
            present_index: 0,
            window_end_index: 0,
            previous_positions: plan
                .ports
                .iter()
                .map(|port| mode_sum(&port.shape, |mode| mode.previous_amplitude))
                .collect(),
            sums: vec![LaneSum::ZERO; n_rows * FRAMES_AHEAD],
            kicks: vec![Lanes::ZERO; group_count],
            pending_kicks: vec![Lanes::ZERO; group_count],
            has_pending_kicks: false,
            strike_kicks: vec![Lanes::ZERO; group_count],
            has_strike_kicks: false,
            instant_tables: None,
            port_forces: vec![0.0; plan.ports.len()],
            row_positions: vec![0.0; n_rows],
            window_forces: vec![0.0; FRAMES_AHEAD * plan.ports.len()],
            has_window_forces: false,
            contact_free_frames: 0,
            next_strike_index: 0,
            damped_coefficients: script.coefficients.clone(),
            is_damped: false,
            window_end_motions: start_motions,
            script: Arc::new(script),
        };
        let port_shapes = plan.ports.iter().map(|port| &port.shape);
        for (row, shape) in port_shapes
            .chain(plan.outputs.iter().map(|(_, shape)| shape))
            .enumerate()
        {
            body.row_history[row * WINDOW_FRAMES] = mode_sum(shape, |mode| mode.start_amplitude);
        }
        body.compute_ahead(0);
        body
    }

    /// Add the body's outputs now to `out` (n_out).
    pub(crate) fn add_outputs(&self, out: &mut [f64]) {
        self.add_outputs_ahead(0, out);
    }

    /// Add the outputs in `frames` frames to `out` (n_out), if nothing pushes the body until then.
    pub(crate) fn add_outputs_ahead(&self, frames: usize, out: &mut [f64]) {
        let plan = &self.script.plan;
        let (first_output, window_frame) = (plan.ports.len(), self.present_index + frames);
        for (row, ((output, _), rest_output)) in plan.outputs.iter().zip(&plan.rest_outputs).enumerate() {
            out[*output as usize] +=
                self.row_history[(first_output + row) * WINDOW_FRAMES + window_frame] + rest_output;
        }
    }

    /// Set positions, steps and free motion of the ports in the island.
    pub(crate) fn set_ports(&self, modules: &mut ModuleState) {
        self.set_ports_ahead(0, modules);
    }

    /// Set the ports as they will be in `frames` frames, if nothing pushes the body until then.
    pub(crate) fn set_ports_ahead(&self, frames: usize, modules: &mut ModuleState) {
        let window_frame = self.present_index + frames;
        for (row, port) in self.script.plan.ports.iter().enumerate() {
            let port_row = &self.row_history[row * WINDOW_FRAMES..(row + 1) * WINDOW_FRAMES];
            let (position_now, position_next) = (port_row[window_frame], port_row[window_frame + 1]);
            let previous = if frames == 0 {
                self.previous_positions[row]
            } else {
                port_row[window_frame - 1]
            };
            modules.x[port.mat] = position_now + port.rest_position;
            modules.d[port.mat] = position_now - previous;
            modules.free_port_motion[port.mat] = (position_next - position_now) - (position_now - previous);
        }
    }

    /// Number of frames for which the free motion and the step after it are already computed.
    pub(crate) fn frames_ahead(&self) -> usize {
        if self.has_pending_kicks {
            0
        } else {
            self.window_end_index - self.present_index - 1
        }
    }

    /// The frame of its next strike, or `u64::MAX`.
    pub(crate) fn next_strike_frame(&self) -> u64 {
        let next_strike_step = self.script.strike_steps.get(self.next_strike_index);
        next_strike_step.map_or(u64::MAX, |strike_step| strike_step.0)
    }

    /// For a body at rest: move the present by `frames`, which may be negative, within the frames ahead.
    pub(crate) fn shift_frames(&mut self, frames: i64) {
        self.present_index = (self.present_index as i64 + frames).rem_euclid(self.window_end_index as i64) as usize;
    }

    /// Advance by `frames` of the frames that are computed ahead.
    pub(crate) fn advance_ahead(&mut self, frames: usize) {
        if frames == 0 {
            return;
        }
        self.present_index += frames;
        for (row, previous) in self.previous_positions.iter_mut().enumerate() {
            *previous = self.row_history[row * WINDOW_FRAMES + self.present_index - 1];
        }
        self.contact_free_frames = self
            .contact_free_frames
            .saturating_add(frames as u32)
            .min(CONTACT_FREE_FRAMES_MIN);
    }

    /// Apply the strikes of frame `n`, so that contacts know where the ports go with them.
    pub(crate) fn apply_strikes(&mut self, n: u64, modules: &mut ModuleState) {
        if std::mem::take(&mut self.has_strike_kicks) {
            self.strike_kicks.fill(Lanes::ZERO);
        }
        let is_due = |strike_step: &&StrikeStep| strike_step.0 <= n;
        let due_step = self.script.strike_steps.get(self.next_strike_index).filter(is_due);
        if due_step.is_none() && !self.has_pending_kicks {
            return;
        }
        self.restart_window();
        if self.has_pending_kicks {
            std::mem::swap(&mut self.kicks, &mut self.pending_kicks);
            self.apply_kicks();
            self.pending_kicks.fill(Lanes::ZERO);
            self.has_pending_kicks = false;
        }
        while let Some(&due_step) = self.script.strike_steps.get(self.next_strike_index).filter(is_due) {
            self.next_strike_index += 1;
            self.script.write_kicks(due_step, &mut self.kicks);
            self.apply_kicks();
            // What the second step of a strike adds makes the motion free from its frame on.
            if let (.., false) = due_step {
                for (strike_kick, kick) in self.strike_kicks.iter_mut().zip(&self.kicks) {
                    ports::add_scaled(strike_kick, kick, 1.0);
                }
                self.has_strike_kicks = true;
            }
        }
        self.set_ports(modules);
    }

    /// Add the kicks to the modes one frame ahead.
    fn apply_kicks(&mut self) {
        let motions = self.window_end_motions.iter_mut().zip(&self.kicks);
        for ((motion, kick), rows) in motions.zip(&self.script.row_shapes) {
            ports::add_scaled(&mut motion.positions, kick, 1.0);
            for (row, shape) in rows.iter().enumerate() {
                self.row_history[row * WINDOW_FRAMES + self.present_index + 1] += ports::port_displacement(shape, kick);
            }
        }
    }

    /// Number of its modes.
    pub(crate) fn n_modes(&self) -> usize {
        self.script.plan.modes.len()
    }

    /// Raise the squares of the modes (n_modes) to at least those of their amplitudes.
    pub(crate) fn raise_mode_squares(&self, squares: &mut [f64]) {
        let amplitudes = self.squared_amplitudes().zip(squares);
        amplitudes.for_each(|(square_now, square)| *square = square.max(square_now));
    }

    /// The square of the amplitude of each mode.
    fn squared_amplitudes(&self) -> impl Iterator<Item = f64> {
        let indexed_modes = self.script.plan.modes.iter().enumerate();
        let mut group_motion = None;
        indexed_modes.map(move |(mode, oscillator)| {
            if mode.is_multiple_of(LANES) {
                group_motion = Some(self.motion_at_window_end(mode / LANES));
            }
            let Some(group_motion): &Option<GroupMotion> = &group_motion else {
                return 0.0;
            };
            let (x, position_before) = (
                group_motion.positions.0[mode % LANES],
                group_motion.previous_positions.0[mode % LANES],
            );
            if oscillator.b == 0.0 {
                return x * x;
            }
            // b = r² and a = 2r·cos θ: `decayed_position` is that a frame before, less the decay of one frame.
            let (decayed_position, sine_square) = (
                position_before * oscillator.b.sqrt(),
                1.0 - oscillator.a * oscillator.a / (4.0 * oscillator.b),
            );
            if sine_square > 0.0 {
                (x * x + decayed_position * decayed_position - x * position_before * oscillator.a) / sine_square
            } else {
                x * x
            }
        })
    }

    /// How strongly it moves: the sum of the squares of the amplitudes.
    pub(crate) fn motion_level(&self) -> f64 {
        self.squared_amplitudes().sum()
    }

    /// The MATs that are its ports.
    pub(crate) fn ports(&self) -> impl Iterator<Item = usize> + '_ {
        self.script.plan.ports.iter().map(|port| port.mat)
    }

    /// Visit the energy of each of its modes [J], but not of complex or discrete modes.
    pub(crate) fn visit_energies(&self, mut visit: impl FnMut(f64)) {
        let plan = &self.script.plan;
        if plan.complex_responses.is_some() {
            return;
        }
        self.for_each_amplitude(|mode, now, before| {
            let mode_plan = &plan.modes[mode];
            if let Some(mode_cell) = &mode_plan.cell {
                visit(mode_cell.energy([now, mode_plan.a * now - mode_plan.b * before], plan.rate));
            }
        });
    }

    /// Step from frame `n` to the next, under the forces at the ports (n_mat).
    pub(crate) fn step(&mut self, n: u64, force: &[f64]) {
        let mut is_pushed = false;
        for (row, port) in self.script.plan.ports.iter().enumerate() {
            self.previous_positions[row] = self.row_history[row * WINDOW_FRAMES + self.present_index];
            self.port_forces[row] = force[port.mat];
            is_pushed |= self.port_forces[row] != 0.0;
        }
        if is_pushed {
            self.apply_port_forces();
        }
        self.contact_free_frames = (self.contact_free_frames + 1).min(CONTACT_FREE_FRAMES_MIN);
        self.present_index += 1;
        if self.present_index == self.window_end_index {
            self.compute_ahead(n + 1);
        }
    }

    /// Make every mode decay by an additional factor in each frame.
    pub(crate) fn damp(&mut self, decay_factor: f64) {
        // The frames ahead were computed without it.
        self.restart_window();
        self.is_damped = decay_factor < 1.0;
        for (damped, coefficients) in self.damped_coefficients.iter_mut().zip(&self.script.coefficients) {
            coefficients.scale_poles(decay_factor, damped);
        }
    }

    /// Amplitudes of its modes at this frame and the one before   (n_modes each)
    pub(crate) fn write_amplitudes(&mut self, amplitudes: &mut [f64], previous_amplitudes: &mut [f64]) {
        self.restart_window();
        let group_coefficients = if self.is_damped {
            &self.damped_coefficients
        } else {
            &self.script.coefficients
        };
        for mode in 0..self.n_modes() {
            let (group_index, lane) = (mode / LANES, mode % LANES);
            let group_motion = &self.window_end_motions[group_index];
            // The motions are those of the next frame, without what impulses between frames have still to add.
            let next_amplitude = group_motion.positions.0[lane] + self.pending_kicks[group_index].0[lane];
            let (a, b) = (
                group_coefficients[group_index].a.0[lane],
                group_coefficients[group_index].b.0[lane],
            );
            amplitudes[mode] = group_motion.previous_positions.0[lane];
            previous_amplitudes[mode] = if b == 0.0 {
                amplitude_before_decay(amplitudes[mode], a)
            } else {
                (a * amplitudes[mode] - next_amplitude) / b
            };
        }
    }

    /// Visit what [`Self::write_amplitudes`] writes for every mode (mode, now, before), and keep the frames ahead.
    pub(crate) fn for_each_amplitude(&self, mut visit: impl FnMut(usize, f64, f64)) {
        let group_coefficients = if self.is_damped {
            &self.damped_coefficients
        } else {
            &self.script.coefficients
        };
        let n_modes = self.n_modes();
        for (group, group_coefficients) in group_coefficients.iter().enumerate() {
            let mut group_motion = self.window_start_motions[group].clone();
            self.replay(group, &mut group_motion, 0, self.present_index + 1);
            let first_mode = group * LANES;
            for lane in 0..LANES.min(n_modes - first_mode) {
                let (a, b) = (group_coefficients.a.0[lane], group_coefficients.b.0[lane]);
                let next_amplitude = group_motion.positions.0[lane] + self.pending_kicks[group].0[lane];
                let amplitude_now = group_motion.previous_positions.0[lane];
                let amplitude_before = if b == 0.0 {
                    amplitude_now
                } else {
                    (a * amplitude_now - next_amplitude) / b
                };
                visit(first_mode + lane, amplitude_now, amplitude_before);
            }
        }
    }

    /// Set the amplitudes of its modes at this frame and the one before   (n_modes each)
    pub(crate) fn set_amplitudes(&mut self, amplitudes: &[f64], previous_amplitudes: &[f64]) {
        let group_coefficients = if self.is_damped {
            &self.damped_coefficients
        } else {
            &self.script.coefficients
        };
        for mode in 0..self.n_modes() {
            let (group_index, lane) = (mode / LANES, mode % LANES);
            let (a, b) = (
                group_coefficients[group_index].a.0[lane],
                group_coefficients[group_index].b.0[lane],
            );
            let next_amplitude = a * amplitudes[mode] - b * previous_amplitudes[mode];
            let (end_motion, start_motion) = (
                &mut self.window_end_motions[group_index],
                &mut self.window_start_motions[group_index],
            );
            (end_motion.positions.0[lane], end_motion.previous_positions.0[lane]) = (next_amplitude, amplitudes[mode]);
            (start_motion.positions.0[lane], start_motion.previous_positions.0[lane]) =
                (amplitudes[mode], previous_amplitudes[mode]);
        }
        (
            self.present_index,
            self.window_end_index,
            self.contact_free_frames,
            self.has_pending_kicks,
        ) = (0, 1, 0, false);
        self.pending_kicks.fill(Lanes::ZERO);
        self.clear_window_forces();
        for (row, window_row) in self.row_history.chunks_mut(WINDOW_FRAMES).enumerate() {
            (window_row[0], window_row[1]) = (0.0, 0.0);
            for (motion, rows) in self.window_end_motions.iter().zip(&self.script.row_shapes) {
                window_row[0] += ports::port_displacement(&rows[row], &motion.previous_positions);
                window_row[1] += ports::port_displacement(&rows[row], &motion.positions);
            }
        }
        for (row, previous) in self.previous_positions.iter_mut().enumerate() {
            let start_rows = self.window_start_motions.iter().zip(&self.script.row_shapes);
            *previous = start_rows
                .map(|(start_motion, rows)| ports::port_displacement(&rows[row], &start_motion.previous_positions))
                .sum();
        }
    }

    /// Begin at frame `n`.
    pub(crate) fn seek(&mut self, n: u64) {
        self.next_strike_index = self
            .script
            .strike_steps
            .partition_point(|strike_step| strike_step.0 < n);
    }

    /// Take over the state of an equal body; its strikes may differ. How far that body was computed ahead does not
    /// matter.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        std::mem::swap(&mut self.window_end_motions, &mut old.window_end_motions);
        std::mem::swap(&mut self.window_start_motions, &mut old.window_start_motions);
        std::mem::swap(&mut self.row_history, &mut old.row_history);
        std::mem::swap(&mut self.previous_positions, &mut old.previous_positions);
        std::mem::swap(&mut self.pending_kicks, &mut old.pending_kicks);
        std::mem::swap(&mut self.window_forces, &mut old.window_forces);
        self.has_window_forces = old.has_window_forces;
        (self.present_index, self.window_end_index) = (old.present_index, old.window_end_index);
        (self.has_pending_kicks, self.contact_free_frames) = (old.has_pending_kicks, old.contact_free_frames);
    }

    /// Outputs that hear it.
    pub(crate) fn outputs(&self) -> Vec<u32> {
        let outputs = self.script.plan.outputs.iter();
        outputs.map(|&(output, _)| output).collect()
    }

    /// Whether any of some MATs (n_mat) is a port.
    pub(crate) fn has_port_among(&self, mats: &[bool]) -> bool {
        self.script.plan.ports.iter().any(|port| mats[port.mat])
    }

    /// Bring the motions back to one frame ahead of the present, where a new window begins.
    fn restart_window(&mut self) {
        let present_index = self.present_index;
        if self.window_end_index == present_index + 1 && !self.has_window_forces {
            return;
        }
        for group in 0..self.window_end_motions.len() {
            let mut group_motion = self.window_start_motions[group].clone();
            self.replay(group, &mut group_motion, 0, present_index);
            self.window_start_motions[group].clone_from(&group_motion);
            self.replay(group, &mut group_motion, present_index, present_index + 1);
            self.window_end_motions[group] = group_motion;
        }
        self.clear_window_forces();
        for window_row in self.row_history.chunks_mut(WINDOW_FRAMES) {
            (window_row[0], window_row[1]) = (window_row[present_index], window_row[present_index + 1]);
        }
        (self.present_index, self.window_end_index) = (0, 1);
    }

    /// Compute the free motion from the present, frame `n`, up to the next known strike at most.
    fn compute_ahead(&mut self, n: u64) {
        let next_strike_step = self.script.strike_steps.get(self.next_strike_index);
        let free_frames = next_strike_step.map_or(u64::MAX, |next_strike_step| next_strike_step.0.saturating_sub(n));
        // The responses to pushes do not know the damping.
        let frames_ahead = if self.contact_free_frames < CONTACT_FREE_FRAMES_MIN || self.is_damped {
            1
        } else {
            free_frames.clamp(1, FRAMES_AHEAD as u64) as usize
        };
        self.absorb_window_forces();
        for &group in &self.script.groups_with_changing_zeros {
            self.window_end_motions[group].clear_signs_of_zeros();
        }
        self.window_start_motions.clone_from_slice(&self.window_end_motions);
        // Close together: a row of `FRAMES_AHEAD` sums is a page of memory.
        let n_sums = self.row_positions.len() * frames_ahead;
        self.sums[..n_sums].fill(LaneSum::ZERO);
        for (group, motion) in self.window_end_motions.iter_mut().enumerate() {
            let group_coefficients = if self.is_damped {
                &self.damped_coefficients
            } else {
                &self.script.coefficients
            };
            let (group_coefficients, group_rows) = (&group_coefficients[group], &self.script.row_shapes[group]);
            advance_and_observe(
                group_coefficients,
                motion,
                group_rows,
                frames_ahead,
                &mut self.sums[..n_sums],
                frames_ahead,
            );
        }
        for (window_row, sums) in self
            .row_history
            .chunks_mut(WINDOW_FRAMES)
            .zip(self.sums.chunks(frames_ahead))
        {
            window_row[0] = window_row[self.present_index];
            for (position, sum) in window_row[1..].iter_mut().zip(sums) {
                *position = lane_total(sum);
            }
        }
        (self.present_index, self.window_end_index) = (0, frames_ahead);
    }
}

/// What a motion that decays by the factor `decay_factor` a frame was a frame before; itself, if it decays by more than
/// e.
fn amplitude_before_decay(amplitude: f64, decay_factor: f64) -> f64 {
    if decay_factor > 1.0 / std::f64::consts::E {
        amplitude / decay_factor
    } else {
        amplitude
    }
}
