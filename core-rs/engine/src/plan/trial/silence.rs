//! Outputs that hear nothing but rounding: a node of a body, or what friction holds apart from a blow.
//!
//! Two runs differ there by as much as they sound, however fine they are, so such an output counts as silent.

use crate::assembly::unit::IslandPlan;
use crate::island::Island;
use crate::island::bodies::BodyPlan;
use crate::maths::sqrt;
use crate::network::{Output, Term};
use crate::plan::constants::SILENT_OUTPUT_SHARE;

/// Outputs that have heard nothing but rounding so far in a run.
pub(in crate::plan) struct SilentOutputs<'a> {
    island_plan: &'a IslandPlan,
    outputs: Vec<OutputRange>,
    /// Positions at the start [m]   (n_mat)
    start_positions: Vec<f64>,
    /// Largest distance of a mass from its start [m].
    distance_max: f64,
}

/// What an output has heard.
#[derive(Clone, Copy)]
struct OutputRange {
    /// Lowest and highest value before it is differentiated.
    range: [f64; 2],
    /// Its first value.
    first_value: Option<f64>,
    is_silent: bool,
}

impl<'a> SilentOutputs<'a> {
    /// Begins with an island as it is now.
    pub(in crate::plan) fn new(island_plan: &'a IslandPlan, island: &Island) -> Self {
        let output_range = OutputRange {
            range: [f64::INFINITY, f64::NEG_INFINITY],
            first_value: None,
            is_silent: true,
        };
        Self {
            island_plan,
            outputs: vec![output_range; island.n_out()],
            start_positions: island.positions().to_vec(),
            distance_max: 0.0,
        }
    }

    /// Notes a block of sound before it is differentiated, (n_frames · n_out), and the island after it.
    pub(in crate::plan) fn update(&mut self, island: &Island, sound: &[f64]) {
        for frame in sound.chunks_exact(self.outputs.len().max(1)) {
            for (output_state, x) in self.outputs.iter_mut().zip(frame) {
                let [range_low, range_high] = output_state.range;
                output_state.range = [range_low.min(*x), range_high.max(*x)];
            }
        }
        let position_pairs = island.positions().iter().zip(&self.start_positions);
        self.distance_max = position_pairs.fold(self.distance_max, |distance_max, (x, start)| {
            distance_max.max((x - start).abs())
        });
    }

    /// Lets outputs that are still silent keep their first value in that block; `squares` are those of the amplitudes
    /// of the modes so far.
    pub(in crate::plan) fn hold_first_values(&mut self, sound: &mut [f64], squares: &[Vec<f64>]) {
        let n_outputs = self.outputs.len();
        for output in 0..n_outputs {
            if !self.outputs[output].is_silent {
                continue;
            }
            let output_share = self.audible_share(output, squares);
            let output_state = &mut self.outputs[output];
            output_state.is_silent = output_share <= SILENT_OUTPUT_SHARE;
            let first_sample = *output_state.first_value.get_or_insert(sound[output]);
            if output_state.is_silent {
                let samples = sound.iter_mut().skip(output).step_by(n_outputs);
                samples.for_each(|x| *x = first_sample);
            }
        }
    }

    /// The largest share that an output has heard of what it would hear if no motion were cancelled.
    pub(in crate::plan) fn loudest_share(&self, squares: &[Vec<f64>]) -> f64 {
        let output_shares = (0..self.outputs.len()).map(|output| self.audible_share(output, squares));
        output_shares.fold(0.0, f64::max)
    }

    /// The share that an output has heard of what it would hear if no motion were cancelled.
    fn audible_share(&self, output: usize, squares: &[Vec<f64>]) -> f64 {
        let [range_low, range_high] = self.outputs[output].range;
        if range_low >= range_high {
            return 0.0;
        }
        let output_plan = &self.island_plan.network.outputs()[output];
        let uncancelled =
            self.distance_max * position_weight_sum(output_plan) + uncancelled_sum(output, self.island_plan, squares);
        (range_high - range_low) / uncancelled
    }
}

/// The sum of the weights that an output gives to positions.
fn position_weight_sum(output: &Output) -> f64 {
    let term_weights = output.terms.iter().map(|term| match term {
        Term::Position { len, weight, .. } => *len as f64 * weight.abs(),
        Term::Force { .. } | Term::Length { .. } | Term::Ground { .. } => 0.0,
    });
    term_weights.sum()
}

/// What an output would hear of modal bodies if no modes cancelled each other.
fn uncancelled_sum(output: usize, island_plan: &IslandPlan, squares: &[Vec<f64>]) -> f64 {
    let mut uncancelled = 0.0;
    for (body, squares) in island_plan.bodies.iter().zip(squares) {
        let BodyPlan::Modal(modal_body) = body else {
            continue;
        };
        let output_shapes = modal_body
            .outputs
            .iter()
            .filter(|(output_index, _)| *output_index as usize == output);
        for (_, shape) in output_shapes {
            let shape_squares = shape.iter().zip(squares);
            uncancelled += shape_squares
                .map(|(mode_weight, square)| mode_weight.abs() * sqrt(*square))
                .sum::<f64>();
        }
    }
    uncancelled
}
