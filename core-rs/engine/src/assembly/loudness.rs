//! How loud some modes of a body are relative to all of them. They are played, because modes that fade as fast as they
//! swing may add up or cancel, which sums of energies do not show.

use crate::assembly::constants::LOUDNESS_SPANS;
use crate::assembly::unit::BankPlan;
use crate::bank::Bank;
use crate::derivative::Derivatives;
use crate::hearing::SHORTEST_SECONDS;
use crate::maths::log10;
use crate::network::Network;
use crate::units::Rate;

/// Frames at once.
const BLOCK_FRAMES: usize = 256;

/// What an output heard up to the end of a span.
#[derive(Clone, Copy, Default)]
struct OutputSums {
    n_frames: usize,
    sum: f64,
    energy: f64,
}

impl OutputSums {
    /// Energy without that of the mean: a body that drifts away would hide all modes. 0 if the rest is rounding.
    fn energy_about_mean(&self) -> f64 {
        const ROUNDING: f64 = 1e-26;
        let about_mean = self.energy - self.sum * self.sum / self.n_frames as f64;
        if about_mean > ROUNDING * self.energy {
            about_mean
        } else {
            0.0
        }
    }
}

/// What each output heard, up to the end of each span   (LOUDNESS_SPANS, n_out)
pub(crate) struct Loudness(Vec<Vec<OutputSums>>);

impl Loudness {
    /// Plays a bank; outputs are numbered as in `network`.
    pub(crate) fn new(mut bank: BankPlan, network: &Network, rate: Rate, first_frame: u64) -> Self {
        let n_outputs = network.outputs().len();
        let mut derivatives = Derivatives::new(network, rate.hertz());
        for strikes in &mut bank.strikes {
            for blow in &mut strikes.blows {
                blow.0 -= first_frame;
            }
        }
        let mut running_bank = Bank::new(&bank.oscillators, bank.strikes, rate, BLOCK_FRAMES, false);
        let span_frames = (SHORTEST_SECONDS * rate.hertz()) as usize;
        let mut sound_block = vec![0.0; BLOCK_FRAMES * n_outputs];
        let mut output_sums = vec![OutputSums::default(); n_outputs];
        let span_sums = (0..LOUDNESS_SPANS).map(|_| {
            for start in (0..span_frames).step_by(BLOCK_FRAMES) {
                let n_frames = BLOCK_FRAMES.min(span_frames - start);
                let sound_block = &mut sound_block[..n_frames * n_outputs];
                sound_block.fill(0.0);
                running_bank.process(sound_block, (n_outputs, n_frames), |output| output as usize);
                derivatives.process(sound_block, n_outputs);
                for frame in sound_block.chunks_exact(n_outputs.max(1)) {
                    for (output_sum, x) in output_sums.iter_mut().zip(frame) {
                        output_sum.n_frames += 1;
                        output_sum.sum += x;
                        output_sum.energy += x * x;
                    }
                }
            }
            output_sums.clone()
        });
        Self(span_sums.collect())
    }

    /// The loudness of these modes relative to all, the largest over outputs and spans [dB]: ‖x‖/‖all − mean‖, as
    /// errors are measured.
    pub(crate) fn relative_db(&self, all: &Self) -> f64 {
        let output_pairs = self.0.iter().flatten().zip(all.0.iter().flatten());
        let energy_ratios = output_pairs.filter_map(|(partial, all)| {
            let reference = all.energy_about_mean();
            (reference > 0.0).then(|| partial.energy / reference)
        });
        10.0 * log10(energy_ratios.fold(1e-40, f64::max))
    }
}
