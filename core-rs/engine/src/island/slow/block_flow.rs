//! Linear springs of a slow body, exactly, a block of frames at a time.
//!
//! Its state s, displacements and velocities, follows s ← P·(s + inputs) from frame to frame. At the beginning of a
//! block the observed displacements (ports, outputs) are computed for all its frames, as if nothing pushed: C·Pᵏ·s. An
//! input adds its response, C·Pᵏ·b, to the frames that follow it. The state itself is computed once a block: Pᴮ·s + Σ
//! Pᴮ⁻ʲ·b·input. The result is that of every frame, to rounding, for any number B of frames in a block.

use crate::integrate::flow::Flow;
use crate::integrate::square::SquareMatrix;
use crate::interrupt;

/// Most masses that hang together.
pub(crate) const MASSES_MAX: usize = 120;
/// Most frames in a block.
const FRAMES_MAX: usize = 64;

/// A weighted sum of displacements: index in the body, and weight.
pub(crate) type Weights = Vec<(usize, f64)>;

/// How a body moves in a block of frames.
#[derive(Clone, Debug)]
pub(crate) struct BlockFlow {
    pub(crate) frame_flow: Flow,
    /// P   (2n, 2n), and its power for a block
    pub(super) frame_map: SquareMatrix,
    pub(super) block_map: SquareMatrix,
    /// The step that led to each displacement, from displacements and velocities   (n, 2n)
    pub(super) step_rows: Vec<f64>,
    /// B
    pub(super) n_frames: usize,
    /// Ports, then outputs.
    pub(super) observed_weights: Vec<Weights>,
    /// Their values at frames 0 … B for each number of the state   (n_observed · (B + 1), 2n)
    pub(super) free_responses: Vec<f64>,
    /// Forces on ports, then strikes on those that may be struck.
    pub(super) inputs: Vec<InputResponse>,
    /// For each port, its strikes among the inputs.
    pub(super) strike_inputs: Vec<Option<usize>>,
}

/// The response to an input of 1 in one frame.
#[derive(Clone, Debug)]
pub(super) struct InputResponse {
    /// What it adds to the state after its frame   (2n)
    pub(super) state_response: Vec<f64>,
    /// The observed displacements after it, frame by frame   (n_observed, B)
    pub(super) observed_response: Vec<f64>,
    /// The state at the end of a block, for an input in each of its frames   (2n, B)
    pub(super) end_response: Vec<f64>,
}

/// The inputs and outputs of a body.
#[derive(Clone, Debug)]
pub(crate) struct BodyInterface<'a> {
    /// 1/M of each mass   (n)
    pub(crate) inverse_masses: &'a [f64],
    /// MATs that something pushes; for those that are struck, what a kick and straight motion lack after a push by a
    /// metre a frame   (n_ports; 2n)
    pub(crate) ports: Vec<(usize, Option<Vec<f64>>)>,
    pub(crate) outputs: Vec<Weights>,
}

/// The number of frames in a block that costs least: a block's product of the state, against responses of half a block
/// to forces on one or two ports.
pub(crate) fn best_block_length(n: usize, n_ports: usize) -> usize {
    let (n, port_count) = (n as f64, n_ports.max(1) as f64);
    let block_frames = (8.0 * n * n / (port_count * port_count.min(2.0))).sqrt();
    (block_frames as usize).clamp(1, FRAMES_MAX)
}

impl BlockFlow {
    pub(crate) fn new(flow: Flow, interface: BodyInterface<'_>, n_frames: usize) -> Self {
        let mat_count = flow.velocity_factor.n;
        let frame_map = flow.frame_map();
        let BodyInterface {
            inverse_masses,
            ports,
            outputs,
        } = interface;
        let mut observed_weights: Vec<Weights> = ports.iter().map(|port| vec![(port.0, 1.0)]).collect();
        observed_weights.extend(outputs);
        let mut block_flow = Self {
            block_map: frame_map.power(n_frames as u32),
            step_rows: step_map(&flow),
            free_responses: Vec::new(),
            inputs: Vec::new(),
            strike_inputs: vec![None; ports.len()],
            n_frames,
            observed_weights,
            frame_map,
            frame_flow: flow,
        };
        block_flow.free_responses = block_flow.compute_free_responses();
        for &(port, _) in &ports {
            let mut pushed_state = vec![0.0; 2 * mat_count];
            pushed_state[mat_count + port] = inverse_masses[port];
            let input_response = block_flow.input_response(block_flow.frame_map.times_vector(&pushed_state));
            block_flow.inputs.push(input_response);
        }
        for (index, (port, strike_correction)) in ports.into_iter().enumerate() {
            let Some(mut struck_state) = strike_correction else {
                continue;
            };
            struck_state.iter_mut().for_each(|x| *x *= inverse_masses[port]);
            block_flow.strike_inputs[index] = Some(block_flow.inputs.len());
            let input_response = block_flow.input_response(struck_state);
            block_flow.inputs.push(input_response);
        }
        block_flow
    }

    /// The same with other ports (their indices here) and outputs, without strikes, or with blocks of another length.
    pub(crate) fn with_interface(&self, interface: BodyInterface<'_>, n_frames: usize) -> Self {
        Self::new(self.frame_flow.clone(), interface, n_frames)
    }

    fn compute_free_responses(&self) -> Vec<f64> {
        let (n_state, n_rows) = (self.frame_map.n, self.n_frames + 1);
        let mut free_responses = vec![0.0; self.observed_weights.len() * n_rows * n_state];
        for (index, weights) in self.observed_weights.iter().enumerate() {
            let mut observed_row = vec![0.0; n_state];
            weights.iter().for_each(|&(mass, weight)| observed_row[mass] += weight);
            for k in 0..n_rows {
                interrupt::spend(n_state * n_state);
                for (column, x) in observed_row.iter().enumerate() {
                    free_responses[column * self.observed_weights.len() * n_rows + index * n_rows + k] = *x;
                }
                // Row times matrix: its columns lie one after the other.
                let columns = self.frame_map.entries.chunks_exact(n_state);
                let product = |column: &[f64]| observed_row.iter().zip(column).map(|(r, p)| r * p).sum();
                observed_row = columns.map(product).collect();
            }
        }
        free_responses
    }

    fn input_response(&self, state_response: Vec<f64>) -> InputResponse {
        let (n_state, n_frames) = (self.frame_map.n, self.n_frames);
        let mut observed_response = vec![0.0; self.observed_weights.len() * n_frames];
        let mut end_response = vec![0.0; n_state * n_frames];
        let mut moved_state = state_response.clone();
        for k in 0..n_frames {
            interrupt::spend(n_state * n_state);
            for (index, weights) in self.observed_weights.iter().enumerate() {
                observed_response[index * n_frames + k] = weighted_sum(weights, &moved_state);
            }
            let block_column = n_frames - 1 - k;
            end_response[block_column * n_state..][..n_state].copy_from_slice(&moved_state);
            moved_state = self.frame_map.times_vector(&moved_state);
        }
        InputResponse {
            state_response,
            observed_response,
            end_response,
        }
    }

    /// Whether another flow has the same numbers: its map, block, ports, outputs and responses.
    pub(super) fn has_same_numbers(&self, other: &Self) -> bool {
        let mut input_pairs = self.inputs.iter().zip(&other.inputs);
        self.n_frames == other.n_frames
            && self.frame_map.entries == other.frame_map.entries
            && self.step_rows == other.step_rows
            && self.observed_weights == other.observed_weights
            && self.strike_inputs == other.strike_inputs
            && input_pairs.all(|(input, other)| input.state_response == other.state_response)
    }

    /// Number of products of a frame, on average, while one port is pushed.
    pub(crate) fn n_products(&self) -> f64 {
        let (n_state, n_frames) = (self.frame_map.n as f64, self.n_frames as f64);
        let n_observed = self.observed_weights.len() as f64;
        n_state * (n_observed + 1.0) + n_state * n_state / n_frames + 0.5 * n_observed * n_frames
    }
}

fn weighted_sum(weights: &[(usize, f64)], x: &[f64]) -> f64 {
    weights.iter().map(|&(mass, weight)| weight * x[mass]).sum()
}

/// The map from displacements and velocities to the steps that led there: B⁻¹·(v + A·u); the velocities themselves if B
/// has no inverse, as when a damper stops a mass within a frame.
fn step_map(flow: &Flow) -> Vec<f64> {
    let mat_count = flow.velocity_factor.n;
    let identity = SquareMatrix::identity(mat_count);
    match identity.times_inverse(&flow.velocity_factor) {
        Some(inverse) => [inverse.times(&flow.position_pull).entries, inverse.entries].concat(),
        None => [vec![0.0; mat_count * mat_count], identity.entries].concat(),
    }
}

/// Displacements and velocities of all masses at one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PresentState(pub(super) [f64; 2 * MASSES_MAX]);

impl Default for PresentState {
    fn default() -> Self {
        Self([0.0; 2 * MASSES_MAX])
    }
}
