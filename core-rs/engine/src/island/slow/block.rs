//! A running slow body of linear springs: its motion in the present block of frames.

use std::sync::Arc;

use super::block_flow::{BlockFlow, PresentState};
use crate::archive;
use crate::kernel::dense;

/// A body whose displacements [m] and velocities [m a frame] are all smaller than this rests: 280 dB below a
/// micrometre.
const REST_BOUND: f64 = 1e-20;

/// A running body.
#[derive(Clone, Debug)]
pub(super) struct SlowBlock {
    flow: Arc<BlockFlow>,
    /// Displacements and velocities at its first frame   (2n)
    state: Vec<f64>,
    /// The observed displacements in its frames, after the inputs so far   (n_observed, B + 1)
    observed_displacements: Vec<f64>,
    /// Inputs so far   (n_inputs, B), and which of them are not all 0
    inputs: Vec<f64>,
    is_pushed: Vec<bool>,
    /// Frames since its first.
    frame_index: u32,
    /// Whether nothing moved at its first frame.
    is_resting: bool,
    /// (2n)
    next_state: Vec<f64>,
}

archive::state!(SlowBlock {
    state,
    observed_displacements,
    inputs,
    is_pushed,
    frame_index,
    is_resting
});

impl SlowBlock {
    pub(super) fn new(flow: &Arc<BlockFlow>) -> Self {
        let (n_state, n_frames, n_inputs) = (flow.frame_map.n, flow.n_frames, flow.inputs.len());
        Self {
            state: vec![0.0; n_state],
            observed_displacements: vec![0.0; flow.observed_weights.len() * (n_frames + 1)],
            inputs: vec![0.0; n_inputs * n_frames],
            is_pushed: vec![false; n_inputs],
            frame_index: 0,
            is_resting: true,
            next_state: vec![0.0; n_state],
            flow: flow.clone(),
        }
    }

    /// Frames of a block.
    pub(super) fn n_frames(&self) -> u32 {
        self.flow.n_frames as u32
    }

    pub(super) fn flow(&self) -> &BlockFlow {
        &self.flow
    }

    /// Whether this is the first frame of a block.
    pub(super) fn is_first(&self) -> bool {
        self.frame_index == 0
    }

    /// Displacements and velocities at the first frame   (2n).
    pub(super) fn state(&self) -> &[f64] {
        &self.state
    }

    /// The same, to be changed; [`Self::begin`] has to follow.
    pub(super) fn state_mut(&mut self) -> &mut [f64] {
        &mut self.state
    }

    /// Begin a block with the present state.
    pub(super) fn begin(&mut self) {
        for (inputs, is_pushed) in self
            .inputs
            .chunks_exact_mut(self.flow.n_frames)
            .zip(&mut self.is_pushed)
        {
            if std::mem::take(is_pushed) {
                inputs.fill(0.0);
            }
        }
        self.frame_index = 0;
        self.observed_displacements.fill(0.0);
        self.is_resting = self.state.iter().all(|x| *x == 0.0);
        if !self.is_resting {
            dense::add_matrix_vector(&self.flow.free_responses, &self.state, &mut self.observed_displacements);
        }
    }

    /// Add an input of this frame.
    fn add_input(&mut self, input: usize, input_value: f64) {
        let (n_frames, frame_index) = (self.flow.n_frames, self.frame_index as usize);
        self.is_pushed[input] = true;
        self.inputs[input * n_frames + frame_index] += input_value;
        let responses = self.flow.inputs[input].observed_response.chunks_exact(n_frames);
        for (observed_row, response) in self
            .observed_displacements
            .chunks_exact_mut(n_frames + 1)
            .zip(responses)
        {
            for (displacement, response) in observed_row[frame_index + 1..].iter_mut().zip(response) {
                *displacement += input_value * response;
            }
        }
    }

    /// Add a force on a port in this frame [N].
    pub(super) fn push_port(&mut self, port: usize, force: f64) {
        if force != 0.0 {
            self.add_input(port, force);
        }
    }

    /// Note that a force on a port in this frame is that of a strike [N].
    pub(super) fn record_strike(&mut self, port: usize, force: f64) {
        if let Some(input_index) = self.flow.strike_inputs[port] {
            self.add_input(input_index, force);
        }
    }

    /// Go to the next frame. `velocity_factor` is a factor on velocities for each block.
    pub(super) fn step(&mut self, velocity_factor: f64) {
        self.frame_index += 1;
        if self.frame_index < self.flow.n_frames as u32 {
            return;
        }
        let is_pushed = self.is_pushed.contains(&true);
        if self.is_resting && !is_pushed {
            self.frame_index = 0;
            return;
        }
        self.end_block();
        if velocity_factor < 1.0 {
            let mat_count = self.state.len() / 2;
            self.state[mat_count..].iter_mut().for_each(|v| *v *= velocity_factor);
        }
        if !is_pushed && self.state.iter().all(|x| x.abs() < REST_BOUND) {
            self.state.fill(0.0);
        }
        self.begin();
    }

    /// The state after all frames of the block.
    fn end_block(&mut self) {
        let Self {
            flow,
            state,
            inputs,
            is_pushed,
            next_state: buffer,
            ..
        } = self;
        buffer.fill(0.0);
        dense::add_matrix_vector(&flow.block_map.entries, state, buffer);
        let pushed_inputs = inputs.chunks_exact(flow.n_frames).zip(&*is_pushed);
        for ((pushed_inputs, _), input) in pushed_inputs
            .zip(&flow.inputs)
            .filter(|((_, is_pushed), _)| **is_pushed)
        {
            dense::add_matrix_vector(&input.end_response, pushed_inputs, buffer);
        }
        std::mem::swap(state, buffer);
    }

    /// An observed displacement at this frame [m]: of a port, or of an output after the ports.
    pub(super) fn displacement(&self, observed_row: usize) -> f64 {
        self.observed_displacements[observed_row * (self.flow.n_frames + 1) + self.frame_index as usize]
    }

    /// By how much it would move to the next frame without further forces [m].
    pub(super) fn velocity(&self, observed_row: usize) -> f64 {
        let observed_index = observed_row * (self.flow.n_frames + 1) + self.frame_index as usize;
        self.observed_displacements[observed_index + 1] - self.observed_displacements[observed_index]
    }

    /// Displacement of an output at this frame [m].
    pub(super) fn output(&self, output: usize) -> f64 {
        self.displacement(self.flow.strike_inputs.len() + output)
    }

    /// Displacements and velocities at this frame.
    pub(super) fn present_state(&self) -> PresentState {
        let n_state = self.state.len();
        let (mut present, mut next_state) = (PresentState::default(), PresentState::default());
        present.0[..n_state].copy_from_slice(&self.state);
        for k in 0..self.frame_index as usize {
            let next_state = &mut next_state.0[..n_state];
            next_state.fill(0.0);
            dense::add_matrix_vector(&self.flow.frame_map.entries, &present.0[..n_state], next_state);
            let frame_inputs = self.inputs.iter().skip(k).step_by(self.flow.n_frames);
            for (input, input_value) in self.flow.inputs.iter().zip(frame_inputs) {
                let state_pairs = next_state.iter_mut().zip(&input.state_response);
                state_pairs.for_each(|(next_state, state)| *next_state += input_value * state);
            }
            present.0[..n_state].copy_from_slice(next_state);
        }
        present
    }

    /// Displacement of a mass at that frame, and its step to there [m].
    pub(super) fn motion(&self, present: &PresentState, index: usize) -> (f64, f64) {
        let n_state = self.state.len();
        let step_row = self.flow.step_rows.iter().skip(index).step_by(n_state / 2);
        let mat_step = step_row.zip(&present.0[..n_state]).map(|(a, x)| a * x).sum();
        (present.0[index], mat_step)
    }

    /// Set the velocity of one mass at the first frame, to which it came in a step of that length [m].
    pub(super) fn set_velocity(&mut self, index: usize, step: f64) {
        let mat_count = self.state.len() / 2;
        let pull_row = self
            .flow
            .frame_flow
            .position_pull
            .entries
            .iter()
            .skip(index)
            .step_by(mat_count);
        let spring_pull: f64 = pull_row.zip(&self.state[..mat_count]).map(|(a, u)| a * u).sum();
        self.state[mat_count + index] = step - spring_pull;
    }

    /// Set the velocities of all masses at the first frame, to which they came in such steps [m]   (n).
    pub(super) fn set_velocities(&mut self, steps: &[f64]) {
        let (u, v) = self.state.split_at_mut(steps.len());
        v.fill(0.0);
        dense::add_matrix_vector(&self.flow.frame_flow.position_pull.entries, u, v);
        v.iter_mut().for_each(|v| *v = -*v);
        dense::add_matrix_vector(&self.flow.frame_flow.velocity_factor.entries, steps, v);
    }

    /// End the block at this frame. [`Self::begin`] has to follow.
    pub(super) fn end_at_present(&mut self) {
        let present = self.present_state();
        let n_state = self.state.len();
        self.state.copy_from_slice(&present.0[..n_state]);
        self.frame_index = 0;
    }

    /// Whether another block moves by the same numbers, so that its motion can be continued to the bit.
    pub(super) fn has_same_numbers(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.flow, &other.flow) || self.flow.has_same_numbers(&other.flow)
    }

    /// Take over another's motion without allocating.
    pub(super) fn copy_motion(&mut self, other: &Self) {
        self.state.copy_from_slice(&other.state);
        self.observed_displacements
            .copy_from_slice(&other.observed_displacements);
        self.inputs.copy_from_slice(&other.inputs);
        self.is_pushed.copy_from_slice(&other.is_pushed);
        self.frame_index = other.frame_index;
        self.is_resting = other.is_resting;
    }

    /// For a body at rest: advance by `frames`, which may be negative.
    pub(super) fn shift_frames(&mut self, frames: i64) {
        let frames_since = i64::from(self.frame_index) + frames;
        self.frame_index = frames_since.rem_euclid(i64::from(self.n_frames())) as u32;
    }

    /// Its energy at the first frame of the block [in units of a frame].
    pub(super) fn energy(&self, w: &[f64]) -> f64 {
        let (u, v) = self.state.split_at(w.len());
        let columns = self.flow.frame_flow.position_pull.entries.chunks_exact(w.len());
        let potential_terms = columns.zip(u).map(|(column, x)| {
            let pull_terms = column.iter().zip(u).zip(w);
            x * pull_terms.map(|((pull, u), w)| u * pull / w).sum::<f64>()
        });
        let kinetic_terms = v.iter().zip(w).map(|(v, w)| v * v / w);
        0.5 * (potential_terms.sum::<f64>() + kinetic_terms.sum::<f64>())
    }
}

#[cfg(test)]
mod tests {
    use super::super::block_flow::BodyInterface;
    use super::*;
    use crate::integrate::flow::{Flow, frame_map, row_of_three};

    /// A row of three masses; the last one may be struck.
    fn row_of_masses(n_frames: usize) -> SlowBlock {
        let (k, z) = row_of_three();
        let frame_map = frame_map(&k, &z, false);
        let flow = Flow::new(&frame_map).unwrap();
        let mut moved_state = vec![0.0; 6];
        moved_state[5] = 1.0;
        let missing = flow.push_deficit(2, &frame_map.times_vector(&moved_state));
        let interface = BodyInterface {
            inverse_masses: &[0.5, 0.25, 2.0],
            ports: vec![(0, None), (2, Some(missing))],
            outputs: vec![vec![(0, 1.0), (1, -0.5)]],
        };
        let mut block = SlowBlock::new(&Arc::new(BlockFlow::new(flow, interface, n_frames)));
        block.state_mut().copy_from_slice(&[1.0, -0.5, 2.0, 0.01, 0.03, -0.02]);
        block.begin();
        block
    }

    /// Forces, a strike, an end ahead of time and an output, beside blocks of a single frame.
    #[test]
    fn block_of_any_length_gives_the_motion_of_every_frame() {
        for n_frames in [2, 7, 30] {
            let (mut long_blocks, mut single_frames) = (row_of_masses(n_frames), row_of_masses(1));
            for n in 0..200_usize {
                for block in [&mut long_blocks, &mut single_frames] {
                    let port_force = if n % 3 == 0 { 0.0 } else { 1e-3 * n as f64 };
                    block.push_port(0, port_force);
                    block.push_port(1, if n == 41 { 0.7 } else { 0.0 });
                    if n == 41 {
                        block.record_strike(1, 0.7);
                    }
                    block.step(1.0);
                    if n == 95 {
                        block.end_at_present();
                        block.begin();
                    }
                }
                let seen = [0, 1, 2].map(|seen| (long_blocks.displacement(seen), single_frames.displacement(seen)));
                assert!(seen.iter().all(|(a, b)| (a - b).abs() < 1e-9 * b.abs().max(1.0)));
                let present = (long_blocks.present_state(), single_frames.present_state());
                for mass in 0..3 {
                    let (x, step) = long_blocks.motion(&present.0, mass);
                    let (x_by_frame, step_by_frame) = single_frames.motion(&present.1, mass);
                    assert!((x - x_by_frame).abs() < 1e-9 * x.abs().max(1.0));
                    assert!((step - step_by_frame).abs() < 1e-9 * x.abs().max(1.0));
                }
            }
        }
    }

    #[test]
    fn slow_body_without_pushes_stays_at_rest() {
        let mut block = row_of_masses(4);
        block.state_mut().fill(0.0);
        block.begin();
        (0..9).for_each(|_| block.step(1.0));
        assert!((0..3).all(|seen| block.displacement(seen) == 0.0 && block.velocity(seen) == 0.0));
    }
}
