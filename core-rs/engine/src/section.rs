//! A second-order filter with a low-pass and a high-pass output.

use crate::archive::state;
use crate::maths;
use crate::maths::wide::wide;

/// A state-variable section by the trapezoidal rule with prewarped cutoff (Zavalishin, *The Art of VA Filter Design*,
/// 2012, ch. 4). It has the response of the bilinear transform, without the cancellation of the direct form at low
/// cutoffs such as 8 Hz at 44.1 kHz.
#[derive(Clone, Debug)]
pub(crate) struct FilterSection {
    g: f64,
    damping: f64,
    scale: f64,
    band: f64,
    low: f64,
}

state!(FilterSection { band, low });

/// The outputs of a section for one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilterOutputs {
    /// Low-pass.
    pub(crate) low: f64,
    /// Band-pass, of gain Q at the cutoff.
    pub(crate) band: f64,
    /// High-pass.
    pub(crate) high: f64,
}

/// 1/Q of a Butterworth filter of order 2: √2.
pub(crate) const BUTTERWORTH_2: f64 = std::f64::consts::SQRT_2;

impl FilterSection {
    /// A section whose high-pass output is its input, if that is finite.
    pub(crate) const IDENTITY: Self = Self {
        g: 0.0,
        damping: 0.0,
        scale: 1.0,
        band: 0.0,
        low: 0.0,
    };

    /// A section at rest: `cutoff` and `rate` [Hz], 0 < cutoff < rate/2; `damping` is 1/Q.
    pub(crate) fn new(cutoff: f64, rate: f64, damping: f64) -> Self {
        Self::scaled(cutoff, rate, damping, 1.0)
    }

    /// A section whose analogue cutoff, after prewarping, is `scale` times as high.
    pub(crate) fn scaled(cutoff: f64, rate: f64, damping: f64, scale: f64) -> Self {
        let (sin, cos) = maths::sincos(std::f64::consts::PI * cutoff / rate);
        let g = sin / cos * scale;
        Self {
            g,
            damping,
            scale: 1.0 / (1.0 + g * (g + damping)),
            band: 0.0,
            low: 0.0,
        }
    }

    /// Copy the state of another section.
    pub(crate) fn take_over(&mut self, other: &Self) {
        (self.band, self.low) = (other.band, other.low);
    }

    /// Whether both remember the same, to the bit.
    pub(crate) fn is_in_state_of(&self, other: &Self) -> bool {
        let state_bits = |section: &Self| [section.band, section.low].map(f64::to_bits);
        state_bits(self) == state_bits(other)
    }

    /// Set the state to which a constant input `x` leads.
    pub(crate) fn settle(&mut self, x: f64) {
        (self.band, self.low) = (0.0, x);
    }

    /// Filter the next sample.
    #[inline]
    pub(crate) fn next(&mut self, x: f64) -> FilterOutputs {
        let high = (x - (self.damping + self.g) * self.band - self.low) * self.scale;
        let increment = self.g * high;
        let band = increment + self.band;
        self.band = increment + band;
        let increment = self.g * band;
        let low = increment + self.low;
        self.low = increment + low;
        FilterOutputs { low, band, high }
    }
}

/// Sections that are computed side by side.
pub(crate) const SECTION_LANES: usize = 8;

wide! {
    /// Filter the first `n_frames` of a signal by the high-pass of each section, in place   (SECTION_LANES).
    ///
    /// A section has to wait for its last frame, so eight take hardly longer than one. The bits are those of
    /// [`FilterSection::next`].
    #[allow(clippy::needless_range_loop)] // closures would be compiled for the baseline, and called
    pub(crate) fn highpass_all(
        sections: &mut [FilterSection; SECTION_LANES],
        signals: &mut [&mut [f64]; SECTION_LANES],
        n_frames: usize,
    ) {
        let mut numbers = [[0.0; SECTION_LANES]; 5];
        let [g, weight, scale, bands, lows] = &mut numbers;
        for lane in 0..SECTION_LANES {
            let section = &sections[lane];
            (g[lane], weight[lane]) = (section.g, section.damping + section.g);
            (scale[lane], bands[lane], lows[lane]) = (section.scale, section.band, section.low);
            assert!(signals[lane].len() >= n_frames);
        }
        for frame in 0..n_frames {
            let mut x = [0.0; SECTION_LANES];
            for lane in 0..SECTION_LANES {
                x[lane] = signals[lane][frame];
            }
            for lane in 0..SECTION_LANES {
                let high = (x[lane] - weight[lane] * bands[lane] - lows[lane]) * scale[lane];
                let up = g[lane] * high;
                let band = up + bands[lane];
                bands[lane] = up + band;
                let up = g[lane] * band;
                let low = up + lows[lane];
                lows[lane] = up + low;
                x[lane] = high;
            }
            for lane in 0..SECTION_LANES {
                signals[lane][frame] = x[lane];
            }
        }
        for lane in 0..SECTION_LANES {
            (sections[lane].band, sections[lane].low) = (bands[lane], lows[lane]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Gain of an analogue Butterworth high-pass of order 2 at the prewarped frequency.
    fn exact_gain(f: f64, cutoff: f64, rate: f64) -> f64 {
        let prewarped = |f: f64| maths::sin(0.5 * TAU * f / rate) / maths::cos(0.5 * TAU * f / rate);
        let warp_ratio = prewarped(f) / prewarped(cutoff);
        1.0 / maths::sqrt(1.0 + 1.0 / (warp_ratio * warp_ratio * warp_ratio * warp_ratio))
    }

    /// Gain of the high-pass output at `f`, by a Fourier sum of its impulse response.
    fn gain(cutoff: f64, rate: f64, f: f64) -> f64 {
        let mut section = FilterSection::new(cutoff, rate, BUTTERWORTH_2);
        let sample_count = 1000 + (20.0 * rate / cutoff) as usize;
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..sample_count {
            let response = section.next(if i == 0 { 1.0 } else { 0.0 }).high;
            let (sin, cos) = maths::sincos(TAU * f * i as f64 / rate);
            re += response * cos;
            im += response * sin;
        }
        maths::sqrt(re * re + im * im)
    }

    #[test]
    fn high_pass_section_is_butterworth() {
        for (cutoff, rate, f) in [
            (8.0, 44_100.0, 8.0),
            (8.0, 44_100.0, 1.0),
            (8.0, 44_100.0, 100.0),
            (1000.0, 48_000.0, 300.0),
            (20_000.0, 44_100.0, 21_000.0),
        ] {
            let (measured, expected) = (gain(cutoff, rate, f), exact_gain(f, cutoff, rate));
            assert!(
                (measured - expected).abs() < 1e-9,
                "{cutoff} {f}: {measured} {expected}"
            );
        }
    }

    #[test]
    fn highpass_all_has_the_bits_of_next() {
        let mut sections: [FilterSection; SECTION_LANES] =
            std::array::from_fn(|lane| FilterSection::new(8.0 + 30.0 * lane as f64, 44_100.0, BUTTERWORTH_2));
        sections[3] = FilterSection::IDENTITY;
        let mut alone = sections.clone();
        let signal = |lane: usize| (0..300).map(move |i| maths::sin((i * (lane + 1)) as f64));
        let mut signals: [Vec<f64>; SECTION_LANES] = std::array::from_fn(|l| signal(l).collect());
        for n_frames in [300, 1, 64] {
            let mut rows = signals.each_mut().map(Vec::as_mut_slice);
            highpass_all(&mut sections, &mut rows, n_frames);
        }
        for (lane, filtered) in signals.iter().enumerate() {
            let mut expected: Vec<f64> = signal(lane).collect();
            for n_frames in [300, 1, 64] {
                let next = |x: &mut f64| *x = alone[lane].next(*x).high;
                expected[..n_frames].iter_mut().for_each(next);
            }
            assert_eq!(*filtered, expected);
        }
        assert_eq!(signals[3], signal(3).collect::<Vec<f64>>());
    }

    #[test]
    fn settled_section_keeps_a_constant() {
        let mut section = FilterSection::new(8.0, 44_100.0, BUTTERWORTH_2);
        section.settle(0.3);
        for _ in 0..1000 {
            let FilterOutputs { low, high, .. } = section.next(0.3);
            assert!((low - 0.3).abs() < 1e-15 && high.abs() < 1e-15);
        }
    }
}
