//! The largest value of a sound between its samples. It only reports: it does not change samples.

use crate::maths::wide::wide;

/// Samples that make a value between two of them.
const TAP_COUNT: usize = 12;
/// The interpolation of ITU-R BS.1770-4, Annex 2: phases 0 and 1 of four; 3 and 2 are these reversed.
const PHASES: [[f64; TAP_COUNT]; 2] = [
    [
        0.001708984375,
        0.010986328125,
        -0.0196533203125,
        0.033203125,
        -0.0594482421875,
        0.1373291015625,
        0.97216796875,
        -0.102294921875,
        0.047607421875,
        -0.026611328125,
        0.014892578125,
        -0.00830078125,
    ],
    [
        -0.0291748046875,
        0.029296875,
        -0.0517578125,
        0.089111328125,
        -0.16650390625,
        0.465087890625,
        0.77978515625,
        -0.2003173828125,
        0.1015625,
        -0.0582275390625,
        0.0330810546875,
        -0.0189208984375,
    ],
];
/// Frames that are interpolated together, or not at all.
const SPAN_FRAMES: usize = 64;
/// Samples that are compared side by side.
const LANES: usize = 8;
/// Samples of one channel: the last ones before a span, and those of the span.
const ROW_SAMPLES: usize = TAP_COUNT - 1 + SPAN_FRAMES;

/// The largest absolute value of a sound at four times its rate (ITU-R BS.1770-4, Annex 2).
///
/// ```
/// use ergon_engine::mix::true_peak::TruePeak;
///
/// let mut meter = TruePeak::new(1);
/// // A tone at a quarter of the rate, whose samples all lie 3 dB below its crests.
/// let tone: Vec<f64> = (0..400).map(|n| if n & 2 == 0 { 0.5 } else { -0.5 }).collect();
/// meter.process(&tone);
/// assert!((meter.peak() - 0.5 * 2.0_f64.sqrt()).abs() < 0.02, "{}", meter.peak());
/// ```
#[derive(Clone, Debug)]
pub struct TruePeak {
    peak: f64,
    /// Largest interpolated value where all samples are at most 1.
    interpolation_gain_max: f64,
    /// (n_channels)
    rows: Vec<[f64; ROW_SAMPLES]>,
}

impl TruePeak {
    /// A meter of `n_channels`; before the first frame there is silence.
    #[must_use]
    pub fn new(n_channels: usize) -> Self {
        let absolute_sums = PHASES.map(|phase| phase.iter().map(|factor| factor.abs()).sum());
        Self {
            peak: 0.0,
            interpolation_gain_max: absolute_sums.into_iter().fold(0.0, f64::max),
            rows: vec![[0.0; ROW_SAMPLES]; n_channels],
        }
    }

    /// Number of channels.
    #[must_use]
    pub fn n_channels(&self) -> usize {
        self.rows.len()
    }

    /// Largest absolute value so far.
    #[must_use]
    pub fn peak(&self) -> f64 {
        self.peak
    }

    /// Measure (n_frames, n_channels). NaN does not change the peak.
    pub fn process(&mut self, frames: &[f64]) {
        let n_channels = self.rows.len().max(1);
        for span in frames.chunks(SPAN_FRAMES * n_channels) {
            let n_frames = span.len() / n_channels;
            for (channel, row) in self.rows.iter_mut().enumerate() {
                let new_samples = row[TAP_COUNT - 1..].iter_mut();
                new_samples
                    .zip(span[channel..].iter().step_by(n_channels))
                    .for_each(|(x, y)| *x = *y);
                let samples = &row[..TAP_COUNT - 1 + n_frames];
                self.peak = self.peak.max(magnitude_max(&samples[TAP_COUNT - 1..]));
                // Only near samples that are loud enough may there be a larger value.
                if magnitude_max(samples) * self.interpolation_gain_max > self.peak
                    && samples.iter().all(|x| x.is_finite())
                {
                    self.peak = self.peak.max(interpolated_max(row, n_frames));
                }
                row.copy_within(n_frames..n_frames + TAP_COUNT - 1, 0);
            }
        }
    }
}

wide! {
    /// The largest absolute value of samples; NaN does not count.
    #[allow(clippy::needless_range_loop)] // closures would be compiled for the baseline, and called
    pub(super) fn magnitude_max(samples: &[f64]) -> f64 {
        let mut lanes = [0.0; LANES];
        let (groups, rest) = samples.as_chunks::<LANES>();
        for group in groups {
            for lane in 0..LANES {
                lanes[lane] = if group[lane].abs() > lanes[lane] { group[lane].abs() } else { lanes[lane] };
            }
        }
        let mut largest = 0.0;
        for lane in 0..LANES {
            largest = if lanes[lane] > largest { lanes[lane] } else { largest };
        }
        for index in 0..rest.len() {
            largest = if rest[index].abs() > largest { rest[index].abs() } else { largest };
        }
        largest
    }
}

wide! {
    /// The largest absolute value between the samples of a row, for the first `n_frames` of its span.
    #[allow(clippy::needless_range_loop)] // closures would be compiled for the baseline, and called
    fn interpolated_max(row: &[f64; ROW_SAMPLES], n_frames: usize) -> f64 {
        let mut frame_maxima = [0.0; SPAN_FRAMES];
        for phase in &PHASES {
            let mut forward = [0.0; SPAN_FRAMES];
            let mut backward = [0.0; SPAN_FRAMES];
            for tap in 0..TAP_COUNT {
                for frame in 0..SPAN_FRAMES {
                    forward[frame] += phase[tap] * row[tap + frame];
                    backward[frame] += phase[TAP_COUNT - 1 - tap] * row[tap + frame];
                }
            }
            for frame in 0..SPAN_FRAMES {
                let is_forward_larger = forward[frame].abs() > backward[frame].abs();
                let larger = if is_forward_larger { forward[frame] } else { backward[frame] };
                let largest = frame_maxima[frame];
                frame_maxima[frame] = if larger.abs() > largest { larger.abs() } else { largest };
            }
        }
        let mut peak = 0.0;
        for frame in 0..SPAN_FRAMES.min(n_frames) {
            peak = if frame_maxima[frame] > peak { frame_maxima[frame] } else { peak };
        }
        peak
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths;

    /// All values of the interpolation, one by one.
    fn reference_peak(samples: &[f64]) -> f64 {
        let mut peak = samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
        for n in 0..samples.len() {
            for phase in &PHASES {
                for is_reversed in [false, true] {
                    let factor = |tap: usize| phase[if is_reversed { TAP_COUNT - 1 - tap } else { tap }];
                    let sample = |tap: usize| (n + tap).checked_sub(TAP_COUNT - 1).map_or(0.0, |n| samples[n]);
                    let value = (0..TAP_COUNT).fold(0.0, |sum, tap| sum + factor(tap) * sample(tap));
                    peak = peak.max(value.abs());
                }
            }
        }
        peak
    }

    #[test]
    fn true_peak_of_blocks_of_any_size() {
        let channel = |c: usize| (0..500).map(move |n| maths::sin(((c + 2) * n * n) as f64) / (1 + n % 90) as f64);
        let channels: [Vec<f64>; 2] = std::array::from_fn(|c| channel(c).collect());
        let frames: Vec<f64> = (0..500).flat_map(|n| [channels[0][n], channels[1][n]]).collect();
        let reference = reference_peak(&channels[0]).max(reference_peak(&channels[1]));
        for block_frames in [1, 10, 64, 77, 500] {
            let mut meter = TruePeak::new(2);
            frames.chunks(2 * block_frames).for_each(|block| meter.process(block));
            assert_eq!(meter.peak(), reference, "{block_frames}");
        }
    }

    #[test]
    fn true_peak_ignores_nan() {
        let mut meter = TruePeak::new(1);
        meter.process(&[0.5, f64::NAN, 0.25]);
        assert_eq!(meter.peak(), 0.5);
    }
}
