//! How loud some modes of a body are relative to all of them. They are played, because modes that fade as fast as they
//! swing may add up or cancel, which sums of energies do not show.

use crate::bank::Bank;
use crate::derivative::Derivatives;
use crate::maths::log10;
use crate::network::Network;
use crate::plan::BankPlan;
use crate::units::Rate;

/// Loudness is compared over this time and over two, three … `TIMES` times as long, from the first sound [s].
const FIRST: f64 = 0.1;
const TIMES: usize = 10;
/// Frames at once.
const BLOCK: usize = 256;

/// Energy that each output heard, up to the end of each span   (TIMES, n_out)
pub(in crate::plan) struct Loudness(Vec<Vec<f64>>);

impl Loudness {
    /// Plays a bank; outputs are numbered as in `network`.
    pub(in crate::plan) fn of(
        mut bank: BankPlan,
        network: &Network,
        rate: Rate,
        from: u64,
    ) -> Self {
        let n_out = network.outputs().len();
        let mut derivatives = Derivatives::of(network, rate.hertz());
        for strikes in &mut bank.strikes {
            for blow in &mut strikes.blows {
                blow.0 -= from;
            }
        }
        let mut playing = Bank::new(&bank.oscillators, bank.strikes, rate, BLOCK, false);
        let span = (FIRST * rate.hertz()) as usize;
        let mut sound = vec![0.0; BLOCK * n_out];
        let mut sums = vec![0.0; n_out];
        let spans = (0..TIMES).map(|_| {
            for at in (0..span).step_by(BLOCK) {
                let n_frames = BLOCK.min(span - at);
                let sound = &mut sound[..n_frames * n_out];
                sound.fill(0.0);
                playing.process(sound, n_out, n_frames);
                derivatives.process(sound, n_out);
                for frame in sound.chunks_exact(n_out.max(1)) {
                    sums.iter_mut()
                        .zip(frame)
                        .for_each(|(sum, x)| *sum += x * x);
                }
            }
            sums.clone()
        });
        Self(spans.collect())
    }

    /// The loudness of these modes relative to all, the largest over outputs and spans [dB].
    pub(in crate::plan) fn relative_to(&self, all: &Self) -> f64 {
        let ratios = self.0.iter().flatten().zip(all.0.iter().flatten());
        let heard = ratios.filter(|(_, all)| **all > 0.0);
        10.0 * log10(heard.map(|(some, all)| some / all).fold(1e-40, f64::max))
    }
}
