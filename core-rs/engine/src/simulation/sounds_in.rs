//! Inputs: samples of a sound card pass a high-pass, a gain and a clamp here, then go to all islands; so do the values
//! that [`Simulation::set_input`] gives.

use super::{RunningUnit, Simulation};
use crate::island::{INPUT_FRAMES_MAX, Island};
use crate::plan::Plan;
use crate::timeline::{Conditioner, InputSource};

/// The conditioning stages of all inputs, and a buffer for the values of one input.
#[derive(Clone, Debug)]
pub(super) struct SoundsIn {
    conditioners: Vec<Conditioner>,
    input_values: Box<[f64]>,
}

impl SoundsIn {
    pub(super) fn new(plan: &Plan) -> Self {
        let frame_rate = plan.timeline_rate.hertz();
        let new_conditioner = |settings| Conditioner::new(settings, frame_rate);
        let conditioners: Vec<Conditioner> = plan.sounds_in.iter().copied().map(new_conditioner).collect();
        let buffer_size = if conditioners.is_empty() { 0 } else { INPUT_FRAMES_MAX };
        Self {
            conditioners,
            input_values: vec![0.0; buffer_size].into(),
        }
    }

    /// Inputs that exist in both simulations continue from their current state.
    pub(super) fn take_over(&mut self, old: &Self) {
        for (conditioner, old) in self.conditioners.iter_mut().zip(&old.conditioners) {
            conditioner.take_over(old);
        }
    }
}

impl Simulation {
    /// Number of channels of a sound card that the inputs need; 0 if no input is heard from a sound card.
    pub fn n_channels_in(&self) -> usize {
        let sources = self.plan.sounds_in.iter().map(|sound_in| sound_in.source);
        let channels = sources.filter_map(|source| match source {
            InputSource::Channel(channel) => Some(channel + 1),
            InputSource::Value { .. } => None,
        });
        channels.max().unwrap_or_default()
    }

    /// Let the input of a number ([`InputSource::Value`]) go to a value from the next frame on, full scale 1. Returns
    /// false if no playing input has this number, or the value is not finite. Before its first value, the input is
    /// heard from the timeline's samples.
    pub fn set_input(&mut self, number: u64, value: f64) -> bool {
        if !value.is_finite() {
            return false;
        }
        let start_frame = self.frame;
        let mut has_input = false;
        for island in self.islands_mut() {
            has_input |= island.set_input(number, start_frame, value);
        }
        has_input
    }

    /// An input that is moving towards a value continues as it did in another simulation.
    pub(super) fn continue_ramps(&mut self, old: &Self) {
        for (old_island, _) in old.islands() {
            for (number, ramp) in old_island.input_ramps() {
                self.islands_mut().for_each(|island| island.continue_ramp(number, ramp));
            }
        }
    }

    /// All islands.
    fn islands_mut(&mut self) -> impl Iterator<Item = &mut Island> {
        let running_units = self.groups.iter_mut().flat_map(|group| &mut group.units);
        running_units.filter_map(|running_unit| match running_unit {
            RunningUnit::Island(island) => Some(&mut **island),
            RunningUnit::Bank(_) => None,
        })
    }

    /// Gives the sound card's samples for the frames that are computed next: full scale 1, at the rate of the score,
    /// (n_frames, n_channels), at most 4096 frames. A missing channel is silent. Frames without samples are heard from
    /// the timeline before the first call, and are silent after it.
    pub fn feed_input_samples(&mut self, frames: &[f32], n_channels: usize) {
        let n_channels = n_channels.max(1);
        let frame_count = (frames.len() / n_channels).min(INPUT_FRAMES_MAX);
        let first_frame = self.frame;
        let SoundsIn {
            conditioners,
            input_values,
        } = &mut self.sounds_in;
        for (index, conditioner) in conditioners.iter_mut().enumerate() {
            let Some(channel) = conditioner.channel() else {
                continue;
            };
            let last_input = conditioner.last_value();
            for (value, frame) in input_values.iter_mut().zip(frames.chunks_exact(n_channels)) {
                let input_sample = frame.get(channel).copied().unwrap_or(0.0);
                *value = conditioner.condition_next(f64::from(input_sample));
            }
            for running_unit in self.groups.iter_mut().flat_map(|group| &mut group.units) {
                if let RunningUnit::Island(island) = running_unit {
                    island.receive_samples(index, first_frame, last_input, &input_values[..frame_count]);
                }
            }
        }
    }
}
