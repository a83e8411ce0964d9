//! Inputs of a sound card: their samples pass high-pass, gain and clamp here, and go to all islands.

use super::{RunningUnit, Simulation};
use crate::island::FRAMES_MAX;
use crate::plan::Plan;
use crate::timeline::Conditioner;

/// The stages of all inputs, and room for the values of one.
#[derive(Clone, Debug)]
pub(super) struct SoundsIn {
    conditioners: Vec<Conditioner>,
    values: Box<[f64]>,
}

impl SoundsIn {
    pub(super) fn new(plan: &Plan) -> Self {
        let rate = plan.timeline_rate.hertz();
        let new = |settings| Conditioner::new(settings, rate);
        let conditioners: Vec<Conditioner> = plan.sounds_in.iter().copied().map(new).collect();
        let n = if conditioners.is_empty() {
            0
        } else {
            FRAMES_MAX
        };
        Self {
            conditioners,
            values: vec![0.0; n].into(),
        }
    }

    /// Inputs that both have go on where they stand.
    pub(super) fn take_over(&mut self, old: &Self) {
        for (own, old) in self.conditioners.iter_mut().zip(&old.conditioners) {
            own.take_over(old);
        }
    }
}

impl Simulation {
    /// Number of channels of a sound card that its inputs need: 0 where it has none.
    pub fn n_channels_in(&self) -> usize {
        let channels = self.plan.sounds_in.iter();
        channels
            .map(|own| own.channel + 1)
            .max()
            .unwrap_or_default()
    }

    /// What a sound card hears in the frames that are computed next, full scale 1, at the rate of the score,
    /// (n_frames, n_channels) with 4096 frames at most. Silence where a channel is missing; frames that nothing is given for
    /// are heard from the timeline's samples until the first call, and are silent after it.
    pub fn sound_in(&mut self, frames: &[f32], n_channels: usize) {
        let n_channels = n_channels.max(1);
        let n = (frames.len() / n_channels).min(FRAMES_MAX);
        let from = self.frame;
        let SoundsIn {
            conditioners,
            values,
        } = &mut self.sounds_in;
        for (index, conditioner) in conditioners.iter_mut().enumerate() {
            let before = conditioner.last();
            let channel = conditioner.channel();
            for (value, frame) in values.iter_mut().zip(frames.chunks_exact(n_channels)) {
                let sample = frame.get(channel).copied().unwrap_or(0.0);
                *value = conditioner.next(f64::from(sample));
            }
            for running in self.groups.iter_mut().flat_map(|group| &mut group.units) {
                if let RunningUnit::Island(island) = running {
                    island.hear(index, from, before, &values[..n]);
                }
            }
        }
    }
}
