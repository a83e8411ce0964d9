//! Loudness measurement. It only reports: it does not change samples.
//!
//! Its state is stored beside a stretch, so that a later render continues from there; that of the crate `ebur128`
//! cannot be read. The tests compare both.

use thiserror::Error;

use super::true_peak::magnitude_max;
use crate::archive::state;
use crate::maths;
use crate::maths::wide::wide;

/// Channels that are filtered side by side.
const LANES: usize = 8;
/// Frames that are filtered at a time.
const SPAN_FRAMES: usize = 128;
/// Tenths of a second in the block of which a loudness is measured.
const TENTHS_PER_BLOCK: usize = 4;
/// Quieter blocks do not count [LUFS].
const ABSOLUTE_GATE_LUFS: f64 = -70.0;
/// The relative gate, -10 LU: blocks below this share of the mean energy are left out.
const RELATIVE_GATE: f64 = 0.1;
/// Loudness of the energy 1 [LUFS].
const UNIT_LOUDNESS_LUFS: f64 = -0.691;
/// Smaller numbers in filters are set to 0: denormal numbers, below 1e-308, are slow.
const STATE_MIN: f64 = 1e-200;
/// Rates [Hz], and the most channels.
const RATES_HERTZ: std::ops::RangeInclusive<f64> = 16.0..=2_822_400.0;
const CHANNELS_MAX: usize = 64;

/// A rate or a number of channels that BS.1770's filters do not cover.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("loudness can be measured of 1 to 64 channels at 16 Hz to 2.8 MHz; here {n_channels} at {rate} Hz")]
pub struct MeterError {
    /// Requested rate [Hz].
    pub rate: f64,
    /// Requested number of channels.
    pub n_channels: usize,
}

/// Sample peak and integrated loudness (ITU-R BS.1770-4) of a signal.
///
/// All channels have the same weight: a channel is a loudspeaker of any layout, and BS.1770 gives other weights only to
/// the surround channels of its own layouts. For mono and stereo this is the standard.
///
/// ```
/// use ergon_engine::mix::meter::Meter;
///
/// let mut meter = Meter::new(44_100.0, 1)?;
/// assert_eq!(meter.loudness(), f64::NEG_INFINITY); // nothing yet
/// meter.process(&[0.0, 0.5, -0.25]);
/// assert!((meter.peak() - 0.5).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Meter {
    peak: f64,
    n_channels: usize,
    sections: [Biquad; 2],
    /// Filters of groups of channels   (n_channels / LANES, rounded up)
    groups: Vec<ChannelGroup>,
    /// Frames in a tenth of a second, and those of the current one that have come.
    tenth_frames: usize,
    frames_in_tenth: usize,
    /// Energies of the last tenths of a second, the newest last.
    last_tenths: [f64; TENTHS_PER_BLOCK],
    n_tenths: usize,
    /// Mean energies of the blocks that pass the absolute gate.
    block_energies: Vec<f64>,
}

/// y = b₀·x + b₁·x⁻ + b₂·x⁻⁻ − a₁·y⁻ − a₂·y⁻⁻.
#[derive(Clone, Copy, Debug)]
struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
}

/// The states of the filters of some channels, and the energy of their current tenth of a second.
#[derive(Clone, Debug)]
struct ChannelGroup {
    states: [[f64; LANES]; 4],
    energies: [f64; LANES],
}

// What the loudness of later frames depends on.
state!(ChannelGroup { states, energies });
state!(Meter {
    groups,
    frames_in_tenth,
    last_tenths,
    n_tenths
});

impl Meter {
    /// A meter of `n_channels` at `rate` [Hz].
    ///
    /// # Errors
    /// [`MeterError`] if EBU R 128 is not defined for the rate or the number of channels.
    pub fn new(rate: f64, n_channels: usize) -> Result<Self, MeterError> {
        // Every comparison with NaN is false, so NaN is refused.
        if !(RATES_HERTZ.contains(&rate.round()) && (1..=CHANNELS_MAX).contains(&n_channels)) {
            return Err(MeterError { rate, n_channels });
        }
        let silent_group = ChannelGroup {
            states: [[0.0; LANES]; 4],
            energies: [0.0; LANES],
        };
        Ok(Self {
            peak: 0.0,
            n_channels,
            sections: k_weighting(rate.round()),
            groups: vec![silent_group; n_channels.div_ceil(LANES)],
            tenth_frames: (rate.round() as usize + 5) / 10,
            frames_in_tenth: 0,
            last_tenths: [0.0; TENTHS_PER_BLOCK],
            n_tenths: 0,
            block_energies: Vec::new(),
        })
    }

    /// Frames in a tenth of a second.
    pub(super) fn tenth_frames(&self) -> usize {
        self.tenth_frames
    }

    /// Whether a restored state is one that frames can lead to.
    pub(super) fn is_within_tenth(&self) -> bool {
        self.frames_in_tenth < self.tenth_frames && self.n_tenths <= TENTHS_PER_BLOCK
    }

    /// Number of channels.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// Measure (n_frames, n_channels). For the loudness, a sample that is not finite counts as 0; NaN does not change
    /// the peak.
    pub fn process(&mut self, frames: &[f64]) {
        self.peak = self.peak.max(magnitude_max(frames));
        let mut frames_left = frames;
        while frames_left.len() >= self.n_channels {
            let n_frames = (self.tenth_frames - self.frames_in_tenth).min(SPAN_FRAMES);
            let n_frames = n_frames.min(frames_left.len() / self.n_channels);
            let span;
            (span, frames_left) = frames_left.split_at(n_frames * self.n_channels);
            self.filter(span, n_frames);
            self.frames_in_tenth += n_frames;
            if self.frames_in_tenth == self.tenth_frames {
                self.end_tenth();
            }
        }
    }

    fn filter(&mut self, span: &[f64], n_frames: usize) {
        let n_channels = self.n_channels;
        for (index, group) in self.groups.iter_mut().enumerate() {
            let first_channel = index * LANES;
            let mut rows = [[0.0; LANES]; SPAN_FRAMES];
            if n_channels == LANES {
                rows.as_flattened_mut()[..span.len()].copy_from_slice(span);
            } else {
                let n_lanes = LANES.min(n_channels - first_channel);
                for (row, frame) in rows.iter_mut().zip(span.chunks_exact(n_channels)) {
                    row[..n_lanes].copy_from_slice(&frame[first_channel..first_channel + n_lanes]);
                }
            }
            add_energies(&self.sections, group, &rows, n_frames);
        }
    }

    /// End a tenth of a second.
    fn end_tenth(&mut self) {
        let groups = self.groups.iter_mut();
        let tenth_energy: f64 = groups
            .flat_map(|group| std::mem::take(&mut group.energies))
            .sum::<f64>();
        self.last_tenths.rotate_left(1);
        self.last_tenths[TENTHS_PER_BLOCK - 1] = tenth_energy;
        self.n_tenths = (self.n_tenths + 1).min(TENTHS_PER_BLOCK);
        self.frames_in_tenth = 0;
        let block_energy = self.block_energy();
        if self.n_tenths == TENTHS_PER_BLOCK && loudness_of(block_energy) >= ABSOLUTE_GATE_LUFS {
            self.block_energies.push(block_energy);
        }
    }

    /// Mean energy of the last block; before the first frame there is silence.
    fn block_energy(&self) -> f64 {
        self.last_tenths.iter().sum::<f64>() / (TENTHS_PER_BLOCK * self.tenth_frames) as f64
    }

    /// Largest absolute sample so far.
    pub fn peak(&self) -> f64 {
        self.peak
    }

    /// Loudness of the last four tenths of a second that are complete [LUFS], without gating; -inf for silence.
    pub fn momentary_loudness(&self) -> f64 {
        loudness_of(self.block_energy())
    }

    /// Integrated loudness so far [LUFS]; -inf for silence and before the first 400 ms have passed.
    pub fn loudness(&self) -> f64 {
        let mean = |energies: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = energies.fold((0.0, 0usize), |(sum, count), x| (sum + x, count + 1));
            if count == 0 { 0.0 } else { sum / count as f64 }
        };
        let gate = RELATIVE_GATE * mean(&mut self.block_energies.iter().copied());
        loudness_of(mean(
            &mut self.block_energies.iter().copied().filter(|energy| *energy >= gate),
        ))
    }
}

/// The loudness of a mean energy [LUFS].
fn loudness_of(energy: f64) -> f64 {
    if energy > 0.0 {
        UNIT_LOUDNESS_LUFS + 10.0 * maths::log10(energy)
    } else {
        f64::NEG_INFINITY
    }
}

/// The K-weighting of BS.1770 at a rate [Hz]: a high shelf, then a high-pass.
///
/// BS.1770 gives the coefficients at 48 kHz. Those of other rates follow from the analogue filters behind them, by the
/// bilinear transformation: the corners, gains and Q of libebur128, which are those of B. De Man, "Evaluation of
/// implementations of the EBU R128 loudness measurement" (AES Convention 145, 2018).
fn k_weighting(rate: f64) -> [Biquad; 2] {
    let warped = |f: f64| {
        let half_angle = std::f64::consts::PI * f / rate;
        maths::sin(half_angle) / maths::cos(half_angle)
    };
    let section = |k: f64, q: f64, numerator: [f64; 3]| {
        let a0 = 1.0 + k / q + k * k;
        Biquad {
            b: numerator,
            a: [2.0 * (k * k - 1.0) / a0, (1.0 - k / q + k * k) / a0],
        }
    };
    let (k, q) = (warped(1_681.974_450_955_533), 0.707_175_236_955_419_6);
    let high = maths::amplitude_ratio(3.999_843_853_973_347);
    let band = maths::pow(high, 0.499_666_774_154_541_6);
    let a0 = 1.0 + k / q + k * k;
    let shelf = [
        (high + band * k / q + k * k) / a0,
        2.0 * (k * k - high) / a0,
        (high - band * k / q + k * k) / a0,
    ];
    let highpass = section(warped(38.135_470_876_024_44), 0.500_327_037_323_877_3, [1.0, -2.0, 1.0]);
    [section(k, q, shelf), highpass]
}

wide! {
    /// Filter the first `n_frames` rows, one channel a lane, and add the squares to the energies of the channels.
    #[allow(clippy::needless_range_loop)] // closures would be compiled for the baseline, and called
    fn add_energies(sections: &[Biquad; 2], group: &mut ChannelGroup, rows: &[[f64; LANES]; SPAN_FRAMES], n_frames: usize) {
        let [shelf, highpass] = sections;
        let [mut s0, mut s1, mut s2, mut s3] = group.states;
        let mut energies = group.energies;
        for frame in 0..n_frames.min(SPAN_FRAMES) {
            for lane in 0..LANES {
                let x = rows[frame][lane];
                let x = if x.abs() < f64::INFINITY { x } else { 0.0 };
                let y = shelf.b[0] * x + s0[lane];
                s0[lane] = shelf.b[1] * x - shelf.a[0] * y + s1[lane];
                s1[lane] = shelf.b[2] * x - shelf.a[1] * y;
                let z = highpass.b[0] * y + s2[lane];
                s2[lane] = highpass.b[1] * y - highpass.a[0] * z + s3[lane];
                s3[lane] = highpass.b[2] * y - highpass.a[1] * z;
                energies[lane] += z * z;
            }
        }
        for lane in 0..LANES {
            s0[lane] = if s0[lane].abs() < STATE_MIN { 0.0 } else { s0[lane] };
            s1[lane] = if s1[lane].abs() < STATE_MIN { 0.0 } else { s1[lane] };
            s2[lane] = if s2[lane].abs() < STATE_MIN { 0.0 } else { s2[lane] };
            s3[lane] = if s3[lane].abs() < STATE_MIN { 0.0 } else { s3[lane] };
        }
        group.states = [s0, s1, s2, s3];
        group.energies = energies;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths;

    fn tone(n_channels: usize, level: f64) -> Vec<f64> {
        let frame_rate = 48_000;
        let sine_sample = |i: i32| {
            let sine_phase = std::f64::consts::TAU * 997.0 * f64::from(i) / f64::from(frame_rate);
            maths::amplitude_ratio(level) * maths::sin(sine_phase)
        };
        (0..5 * frame_rate)
            .flat_map(|i| vec![sine_sample(i); n_channels])
            .collect()
    }

    fn measured(frames: &[f64], n_channels: usize) -> Meter {
        let mut meter = Meter::new(48_000.0, n_channels).unwrap();
        frames.chunks(64 * n_channels).for_each(|block| meter.process(block));
        meter
    }

    /// BS.1770: a 997 Hz sine of 0 dBFS in one channel reads -3.01 LKFS; every doubling of
    /// channels adds 3.01.
    #[test]
    fn loudness_of_the_reference_tone() {
        for (n_channels, expected_loudness) in [(1, -23.01), (2, -20.0), (24, -9.21)] {
            let meter = measured(&tone(n_channels, -20.0), n_channels);
            assert!(
                (meter.loudness() - expected_loudness).abs() < 0.02,
                "{}",
                meter.loudness()
            );
            assert!((meter.peak() - 0.1).abs() < 1e-5);
        }
    }

    /// Another implementation of the standard, as an oracle.
    #[test]
    fn loudness_of_noise_beside_another_meter() {
        for (rate, n_channels, block) in [
            (44_100, 8, 4_096),
            (48_000, 2, 77),
            (96_000, 11, 4_410),
            (8_000, 1, 8_000),
        ] {
            let mut state = 1_u64;
            let n_samples = 3 * rate as usize * n_channels;
            let noise = (0..n_samples).map(|i| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let fades = if i < n_samples / 2 { 0.5 } else { 0.02 };
                fades * ((state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0)
            });
            let frames: Vec<f64> = noise.collect();
            let mut meter = Meter::new(f64::from(rate), n_channels).unwrap();
            let mut oracle = ebur128::EbuR128::new(n_channels as u32, rate, ebur128::Mode::I).unwrap();
            oracle
                .set_channel_map(&vec![ebur128::Channel::Center; n_channels])
                .unwrap();
            frames.chunks(block * n_channels).for_each(|block| meter.process(block));
            oracle.add_frames_f64(&frames).unwrap();
            let (loudness, momentary) = (oracle.loudness_global().unwrap(), oracle.loudness_momentary().unwrap());
            assert!(
                (meter.loudness() - loudness).abs() < 1e-9,
                "{} {loudness}",
                meter.loudness()
            );
            assert!(
                (meter.momentary_loudness() - momentary).abs() < 1e-9,
                "{} {momentary}",
                meter.momentary_loudness()
            );
        }
    }

    #[test]
    fn momentary_loudness_of_a_steady_tone() {
        let meter = measured(&tone(1, -40.0), 1);
        assert!((meter.momentary_loudness() + 43.01).abs() < 0.02);
        assert_eq!(measured(&[0.0; 96_000], 2).momentary_loudness(), f64::NEG_INFINITY);
    }

    #[test]
    fn loudness_of_silence() {
        let meter = measured(&[0.0; 96_000], 2);
        assert_eq!((meter.peak(), meter.loudness()), (0.0, f64::NEG_INFINITY));
        assert_eq!(Meter::new(48_000.0, 1).unwrap().loudness(), f64::NEG_INFINITY);
    }

    #[test]
    fn loudness_with_a_non_finite_sample() {
        let mut frames = tone(1, -20.0);
        frames[1000] = f64::NAN;
        let meter = measured(&frames, 1);
        assert!((meter.loudness() + 23.01).abs() < 0.02 && meter.peak() < 0.11);
        frames[1000] = f64::INFINITY;
        assert_eq!(measured(&frames, 1).peak(), f64::INFINITY);
    }

    #[test]
    fn meter_with_wrong_settings_is_refused() {
        for (rate, n_channels) in [(48_000.0, 0), (48_000.0, 65), (0.0, 1), (f64::NAN, 1), (1e9, 2)] {
            assert!(Meter::new(rate, n_channels).is_err());
        }
    }
}
