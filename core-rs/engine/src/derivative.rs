//! Derivatives of sampled outputs: speed and acceleration from positions.
//!
//! Both formulas are maximally flat at 0 Hz, of order 16. With s = sin(π·f/rate) the first has the terms up to s¹⁵ of
//! ω·T = 2·arcsin s, the second those up to s¹⁶ of (ω·T)² = 4·arcsin² s. Their gain is too low by 0.0006 dB and 0.0016
//! dB at a quarter of the rate, and by 0.55 dB and 1.18 dB at 20 kHz of 44.1 kHz. The phase is that of a pure delay at
//! every frequency.

use crate::maths::wide::wide;
use crate::network::Network;

/// Number of frames on each side of the instant for which the derivative is computed.
const SIDE: usize = 8;
/// Number of frames that a formula uses, including the newest.
pub const SPAN: usize = 2 * SIDE + 1;
/// Number of frames that are computed together: few enough for the nearest cache, and each with a sum of its own.
const BLOCK: usize = 64;

/// A derivative of one output.
#[derive(Clone, Debug)]
struct Differentiator {
    output: usize,
    /// Whether it is the second derivative, not the first.
    is_second: bool,
    /// Weights of pairs of frames, the innermost pair first   [1/s or 1/s²]
    weights: [f64; SIDE],
    /// The last frames, oldest first.
    past: [f64; SPAN - 1],
    has_started: bool,
}

/// The outputs that are differentiated, in place. A first derivative is delayed by 7.5 frames, a second by 8 frames.
#[derive(Clone, Debug, Default)]
pub struct Derivatives(Vec<Differentiator>);

impl Derivatives {
    /// Derivatives for the outputs of a network with frames at `rate` [Hz]. All frames before the first are taken to
    /// equal it.
    pub fn new(network: &Network, rate: f64) -> Self {
        let outputs = network.outputs().iter().enumerate();
        let differentiated = outputs.filter(|(_, output)| output.order > 0);
        let differentiators = differentiated.map(|(index, output)| Differentiator {
            output: index,
            is_second: output.order == 2,
            weights: if output.order == 2 {
                second_weights().map(|weight| weight * rate * rate)
            } else {
                first_weights().map(|weight| weight * rate)
            },
            past: [0.0; SPAN - 1],
            has_started: false,
        });
        Self(differentiators.collect())
    }

    /// Whether no output is differentiated.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Replace each output in `frames` that is differentiated by its derivative, (n_frames, n_out).
    pub fn process(&mut self, frames: &mut [f64], n_out: usize) {
        for block in frames.chunks_mut(BLOCK * n_out.max(1)) {
            for differentiator in &mut self.0 {
                differentiator.process(block, n_out.max(1));
            }
        }
    }

    /// Copy the past frames from `old`; `outputs` gives for each old output its index here. Allocates nothing.
    pub fn take_over(&mut self, old: &Self, outputs: &[Option<usize>]) {
        for differentiator in &mut self.0 {
            let is_same_output = |old_differentiator: &&Differentiator| {
                outputs.get(old_differentiator.output).copied().flatten() == Some(differentiator.output)
            };
            if let Some(old_differentiator) = old.0.iter().find(is_same_output) {
                (differentiator.past, differentiator.has_started) =
                    (old_differentiator.past, old_differentiator.has_started);
            }
        }
    }
}

impl Differentiator {
    /// Process at most [`BLOCK`] frames, (n_frames, n_out).
    fn process(&mut self, frames: &mut [f64], n_out: usize) {
        const PAST: usize = SPAN - 1;
        let n_frames = frames.len() / n_out;
        let mut x = [0.0; PAST + BLOCK];
        let samples = frames.iter().skip(self.output).step_by(n_out);
        x[PAST..].iter_mut().zip(samples).for_each(|(x, sample)| *x = *sample);
        if !self.has_started {
            self.past = [x[PAST]; PAST];
            self.has_started = true;
        }
        x[..PAST].copy_from_slice(&self.past);
        self.past.copy_from_slice(&x[n_frames..n_frames + PAST]);
        // Each frame sums its pairs in the same order, whatever the length of the block.
        let mut derivative_block = [-0.0; BLOCK];
        let derivative_block = &mut derivative_block[..n_frames];
        add_pairs(&self.weights, self.is_second, &x, derivative_block);
        let samples = frames.iter_mut().skip(self.output).step_by(n_out);
        samples.zip(derivative_block).for_each(|(x, rate)| *x = *rate);
    }
}

wide! {
    /// Add the weighted pairs of `x` to each frame's derivative; `x` begins `SPAN` − 1 frames before the first frame.
    fn add_pairs(weights: &[f64; SIDE], is_second: bool, x: &[f64], rates: &mut [f64]) {
        let n = rates.len();
        let from = |at: usize| &x[at..at + n];
        for (w, k) in weights.iter().zip(1..) {
            let after = rates.iter_mut().zip(from(SIDE + k));
            if is_second {
                let sides = after.zip(from(SIDE).iter().zip(from(SIDE - k)));
                sides.for_each(|((rate, b), (now, a))| *rate += w * ((b - now) - (now - a)));
            } else {
                // The instant lies between the two middle frames of the last 16.
                let sides = after.zip(from(SIDE + 1 - k));
                sides.for_each(|((rate, b), a)| *rate += w * (b - a));
            }
        }
    }
}

/// Weights of x(k − ½) − x(½ − k) in the first derivative at 0, k from 1.
fn first_weights() -> [f64; SIDE] {
    std::array::from_fn(|i| {
        let k = (i + 1) as f64;
        let odd_number = 2.0 * k - 1.0;
        // The slope of the Lagrange polynomial through all frames.
        let lagrange_factors = (1..=SIDE).filter(|&m| m != i + 1).map(|m| {
            let other_odd = 2.0 * m as f64 - 1.0;
            other_odd * other_odd / (other_odd * other_odd - odd_number * odd_number)
        });
        lagrange_factors.product::<f64>() / odd_number
    })
}

/// Weights of x(k) − 2·x(0) + x(−k) in the second derivative at 0, k from 1.
fn second_weights() -> [f64; SIDE] {
    std::array::from_fn(|i| {
        let k = (i + 1) as f64;
        let lagrange_factors = (1..=SIDE).filter(|&m| m != i + 1).map(|m| {
            let other_offset = m as f64;
            other_offset * other_offset / (other_offset * other_offset - k * k)
        });
        lagrange_factors.product::<f64>() / (k * k)
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::maths::{log10, sincos};
    use crate::network::Term;

    const RATE: f64 = 44_100.0;

    fn derivatives(order: u8) -> Derivatives {
        let mut network = Network::new();
        let mass_index = network.mas("m", 1.0, 0.0, 0.0).unwrap();
        let position_term = Term::Position {
            first: mass_index,
            len: 1,
            weight: 1.0,
        };
        network.listen_to("m", vec![position_term], order).unwrap();
        Derivatives::new(&network, RATE)
    }

    /// Largest difference from the derivative of a sine `delay` frames before, relative to the derivative's amplitude
    /// [dB].
    fn error(order: u8, f: f64, delay: f64) -> f64 {
        let mut derivative = derivatives(order);
        let omega = TAU * f;
        let sine_at_frame = |n: f64| sincos(omega * n / RATE);
        let mut worst_error = 0.0_f64;
        for n in 0..2000 {
            let mut frame_samples = [sine_at_frame(f64::from(n)).0];
            derivative.process(&mut frame_samples, 1);
            let (sin, cos) = sine_at_frame(f64::from(n) - delay);
            let exact_derivative = if order == 1 { omega * cos } else { -omega * omega * sin };
            if n >= SPAN as i32 {
                let peak_derivative = if order == 1 { omega } else { omega * omega };
                worst_error = worst_error.max(((frame_samples[0] - exact_derivative) / peak_derivative).abs());
            }
        }
        20.0 * log10(worst_error)
    }

    #[test]
    fn derivatives_of_a_sine() {
        for (f, first, second) in [
            (220.0, -130.0, -130.0),
            (2_000.0, -130.0, -130.0),
            (5_000.0, -130.0, -130.0),
            (11_025.0, -82.9, -74.6),
            (15_000.0, -49.2, -41.6),
            (20_000.0, -24.2, -17.9),
        ] {
            let (speed_error, acceleration) = (error(1, f, 7.5), error(2, f, 8.0));
            assert!(speed_error < first, "{f} Hz: speed {speed_error} dB");
            assert!(acceleration < second, "{f} Hz: acceleration {acceleration} dB");
        }
    }

    #[test]
    fn derivatives_of_a_constant_are_zero() {
        for order in [1, 2] {
            let mut constant_frames = [0.3; 100];
            derivatives(order).process(&mut constant_frames, 1);
            assert_eq!(constant_frames, [0.0; 100]);
        }
    }

    #[test]
    fn derivatives_in_blocks_of_any_size() {
        let noise_frames: Vec<f64> = (0..1000).map(|i| sincos(f64::from(i * i % 7919)).0).collect();
        let mut single_block = noise_frames.clone();
        derivatives(2).process(&mut single_block, 1);
        for block in [1, 7, 64, 333] {
            let mut derivative = derivatives(2);
            let mut block_frames = noise_frames.clone();
            block_frames.chunks_mut(block).for_each(|x| derivative.process(x, 1));
            assert_eq!(block_frames, single_block);
        }
    }
}
