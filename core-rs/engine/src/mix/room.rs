//! A room: a feedback delay network.
//!
//! J.-M. Jot and A. Chaigne, Digital delay networks for designing artificial reverberators (AES 90th Convention, 1991):
//! the outputs of N delay lines pass through an orthogonal matrix, which conserves energy, and return into the lines. A
//! filter in each line makes a loss in proportion to its length, frequency by frequency, so that all resonances near
//! one frequency decay equally fast.

use thiserror::Error;

use super::delay::DelayLine;
use crate::archive::{Archive, Damaged, State, state, state_of};
use crate::maths::wide::{half_wide, wide};
use crate::maths::{cos, exp, log, pow, sin, sqrt};
use crate::section::{BUTTERWORTH_2, FilterSection};

/// Number of delay lines; a power of two, because the matrix is a Hadamard matrix.
const N_LINES: usize = 16;
/// Speed of sound [m/s].
const SPEED_OF_SOUND: f64 = 343.0;
/// Lengths of the shortest and the longest line, roughly relative to the mean.
const LENGTH_SPREAD: (f64, f64) = (0.5, 1.6);
/// Cutoff of the high-pass at the input [Hz]: the offset of a leaning hand is not sound, and a room would hold it
/// longest.
const HIGHPASS_HERTZ: f64 = 20.0;
/// Smaller samples are set to 0: denormal numbers, below 1e-308, are slow.
const AMPLITUDE_MIN: f64 = 1e-200;
/// Frames that are computed at a time, where no line is shorter.
const BLOCK_FRAMES: usize = 64;
/// Largest number of iterations in the design of a filter.
const ITERATIONS_MAX: usize = 500;

/// Parameters of a room.
#[derive(Clone, Debug, PartialEq)]
pub struct RoomSpec {
    /// Name by which another version of the mix recognises the room.
    pub name: String,
    /// Mean distance that sound travels from wall to wall [m].
    pub size: f64,
    /// Decay times by 60 dB [s] at two frequencies [Hz], the lower one first. At all frequencies, 1/t60 is a linear
    /// function of f²/(f² + f₁·f₂).
    pub t60: [(f64, f64); 2],
    /// Channels in which the room is heard.
    pub channels: Vec<usize>,
    /// Gain of the output: at 1, each channel gets as much energy as a click at the input has, whatever the decay.
    pub gain: f64,
}

/// Why a room cannot be built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RoomError {
    /// A size outside of 0.5 m to 100 m.
    #[error("a room is 0.5 m to 100 m large; here {0} m")]
    Size(f64),
    /// Decay times or frequencies that are out of range.
    #[error("a room needs two decay times above 0.01 s, at two rising frequencies below half of the rate")]
    Decay,
    /// Decay times that a first-order filter cannot have.
    #[error(
        "decays of {0} s and {1} s are impossible at these frequencies in a room of this size; use frequencies that \
         are farther apart, decays that are closer, or a smaller room"
    )]
    Apart(f64, f64),
    /// A gain that is not finite.
    #[error("a room's gain is a finite number; here {0}")]
    Gain(f64),
}

/// First-order filters, y = b₀·x + b₁·x⁻ − a₁·y⁻, one for each line, so that all are computed at once.
#[derive(Clone, Debug)]
struct Filters {
    b0: [f64; N_LINES],
    b1: [f64; N_LINES],
    a1: [f64; N_LINES],
    x: [f64; N_LINES],
    y: [f64; N_LINES],
}

/// A running room.
#[derive(Clone, Debug)]
pub(super) struct Room {
    spec: RoomSpec,
    delays: [DelayLine; N_LINES],
    /// The losses of the lines.
    line_filters: Filters,
    /// Gain of each line in each channel   (n_channels · LINES)
    channel_gains: Vec<f64>,
    /// Whether nothing has come in yet, so that nothing comes out.
    is_silent: bool,
    highpass: FilterSection,
}

state!(Filters { x, y });

/// A silent room has nothing to archive.
impl State for Room {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self.is_silent.archive(archive)?;
        if self.is_silent {
            return Ok(());
        }
        state_of!(self, archive, delays, line_filters, highpass)
    }
}

impl Room {
    pub(super) fn new(spec: RoomSpec, rate: f64) -> Result<Self, RoomError> {
        if !(0.5..=100.0).contains(&spec.size) {
            return Err(RoomError::Size(spec.size));
        }
        if !spec.gain.is_finite() {
            return Err(RoomError::Gain(spec.gain));
        }
        let [(low_frequency, long_decay), (high_frequency, short_decay)] = spec.t60;
        // Every comparison with NaN is false, so NaN is refused.
        let is_decay = long_decay >= 0.01
            && short_decay >= 0.01
            && low_frequency > 0.0
            && low_frequency < high_frequency
            && high_frequency < 0.5 * rate;
        if !is_decay {
            return Err(RoomError::Decay);
        }
        let lengths = line_lengths(spec.size / SPEED_OF_SOUND * rate);
        let slopes = end_log_gains(spec.t60, rate).ok_or(RoomError::Apart(long_decay, short_decay))?;
        let line_filters =
            Filters::new(lengths, slopes, spec.t60, rate).ok_or(RoomError::Apart(long_decay, short_decay))?;
        // Energy of all outputs of the lines after a click of energy 1: a geometric series.
        let mean_length = lengths.iter().sum::<usize>() as f64 / N_LINES as f64;
        let energy_decay = exp(-6.0 * std::f64::consts::LN_10 * mean_length / (long_decay * rate));
        let output_scale = if energy_decay < 1.0 {
            spec.gain * sqrt((1.0 - energy_decay) / energy_decay)
        } else {
            spec.gain
        };
        let line_signs = |channel: usize| (0..N_LINES).map(move |line| line_sign(channel, line));
        let channel_gains = (0..spec.channels.len())
            .flat_map(line_signs)
            .map(|sign| sign * output_scale)
            .collect();
        Ok(Self {
            spec,
            delays: lengths.map(DelayLine::new),
            line_filters,
            channel_gains,
            is_silent: true,
            highpass: FilterSection::new(HIGHPASS_HERTZ.min(0.4 * rate), rate, BUTTERWORTH_2),
        })
    }

    /// Take over the state of the old room of the same name. Does not allocate.
    pub(super) fn take_over(&mut self, old: &[Self]) {
        let Some(old) = old.iter().find(|old| old.spec.name == self.spec.name) else {
            return;
        };
        self.is_silent = old.is_silent;
        self.highpass.take_over(&old.highpass);
        for (delay, old) in self.delays.iter_mut().zip(&old.delays) {
            delay.take_over(old);
        }
        (self.line_filters.x, self.line_filters.y) = (old.line_filters.x, old.line_filters.y);
    }

    /// Process input samples (n_frames), and add the output to (n_frames, n_channels).
    pub(super) fn process(&mut self, input: &[f64], mixed: &mut [f64], n_channels: usize) {
        self.is_silent = self.is_silent && input.iter().all(|x| *x == 0.0);
        if self.is_silent || n_channels == 0 {
            return;
        }
        // No block is longer than the shortest line, so its outputs depend on earlier blocks alone.
        let shortest_delay = self.delays.iter().map(DelayLine::length).min();
        let block_length = shortest_delay.unwrap_or(1).clamp(1, BLOCK_FRAMES);
        let mixed = mixed.chunks_mut(block_length * n_channels);
        for (input, mixed) in input.chunks(block_length).zip(mixed) {
            self.process_block(&input[..mixed.len() / n_channels], mixed, n_channels);
        }
    }

    fn process_block(&mut self, input: &[f64], mixed: &mut [f64], n_channels: usize) {
        let frame_count = input.len();
        let mut block = Block {
            input: [0.0; BLOCK_FRAMES],
            lines: [[0.0; BLOCK_FRAMES]; N_LINES],
            filtered: [[0.0; BLOCK_FRAMES]; N_LINES],
        };
        for (y, &x) in block.input.iter_mut().zip(input) {
            let x = if x.is_finite() { x } else { 0.0 };
            *y = self.highpass.next(x).high / sqrt(N_LINES as f64);
        }
        for (delay, line) in self.delays.iter().zip(&mut block.lines) {
            delay.copy_oldest(&mut line[..frame_count]);
        }
        filter_and_mix(&mut self.line_filters, &mut block, frame_count);
        for (delay, line) in self.delays.iter_mut().zip(&block.lines) {
            delay.push_all(&line[..frame_count]);
        }
        let gain_rows = self.channel_gains.chunks_exact(N_LINES);
        for (&channel, row) in self.spec.channels.iter().zip(gain_rows) {
            let sums = weighted_sums(&block.filtered, row);
            let channel_samples = mixed.iter_mut().skip(channel).step_by(n_channels);
            channel_samples.zip(&sums).for_each(|(x, sum)| *x += *sum);
        }
    }
}

/// The signals of one block of frames.
struct Block {
    /// Input of every line.
    input: [f64; BLOCK_FRAMES],
    /// What leaves the delay of each line, and then what comes into it.
    lines: [[f64; BLOCK_FRAMES]; N_LINES],
    /// What leaves the filter of each line.
    filtered: [[f64; BLOCK_FRAMES]; N_LINES],
}

// In these functions loops use an index: closures would be compiled for the baseline, and called.
half_wide! {
    #[allow(clippy::needless_range_loop)]
    fn filter_and_mix(filters: &mut Filters, block: &mut Block, count: usize) {
        let Filters { b0, b1, a1, x: previous_inputs, y } = filters;
        let scale = 1.0 / sqrt(N_LINES as f64);
        for frame in 0..count.min(BLOCK_FRAMES) {
            let mut line_outputs = [0.0; N_LINES];
            for line in 0..N_LINES {
                let x = block.lines[line][frame];
                let next = b0[line] * x + b1[line] * previous_inputs[line] - a1[line] * y[line];
                previous_inputs[line] = x;
                y[line] = without_denormal(next);
                line_outputs[line] = y[line];
                block.filtered[line][frame] = y[line];
            }
            mix_lines(&mut line_outputs);
            for line in 0..N_LINES {
                block.lines[line][frame] = without_denormal(block.input[frame] + line_outputs[line] * scale);
            }
        }
    }
}

wide! {
    /// The sums of all lines with these gains, in each frame.
    #[allow(clippy::needless_range_loop)]
    fn weighted_sums(filtered: &[[f64; BLOCK_FRAMES]; N_LINES], gains: &[f64]) -> [f64; BLOCK_FRAMES] {
        let mut sums = [0.0; BLOCK_FRAMES];
        for line in 0..N_LINES {
            let gain = gains[line];
            for frame in 0..BLOCK_FRAMES {
                sums[frame] += gain * filtered[line][frame];
            }
        }
        sums
    }
}

/// The sample, or 0 if it would be denormal.
#[inline(always)]
fn without_denormal(x: f64) -> f64 {
    if x.abs() < AMPLITUDE_MIN { 0.0 } else { x }
}

/// Coefficients b₀, b₁ and a₁ of a filter.
type Coefficients = [f64; 3];

impl Filters {
    /// Filters of lines of these lengths [frames] with the required decay times; `None` if no first-order filters have
    /// them.
    fn new(lengths: [usize; N_LINES], slopes: [f64; 2], t60: [(f64, f64); 2], rate: f64) -> Option<Self> {
        let line_filters = lengths.map(|frames| Self::coefficients(frames, slopes, t60, rate));
        let all_filters: Vec<Coefficients> = line_filters.into_iter().collect::<Option<_>>()?;
        let [b0, b1, a1] = std::array::from_fn(|i| std::array::from_fn(|line| all_filters[line][i]));
        let (x, y) = ([0.0; N_LINES], [0.0; N_LINES]);
        Some(Self { b0, b1, a1, x, y })
    }

    /// The coefficients for one line.
    fn coefficients(frames: usize, slopes: [f64; 2], t60: [(f64, f64); 2], rate: f64) -> Option<Coefficients> {
        // Natural logarithms of the gain of one pass at the two frequencies, and of the filter's gains at 0 and at
        // rate/2.
        let target_logs = t60.map(|(_, t60)| -3.0 * std::f64::consts::LN_10 * frames as f64 / (t60 * rate));
        let mut end_logs = slopes.map(|slope| slope * frames as f64);
        let [low, high] = t60.map(|(f, _)| warped(f, rate));
        let (corner_squared, lower_squared, upper_squared) = (low * high, low * low, high * high);
        let mut is_found = false;
        // The logarithm of the filter's gain is only nearly linear in f²/(f² + f₁·f₂): iterate towards the two required
        // gains.
        for _ in 0..ITERATIONS_MAX {
            let log_gain = |square: f64| {
                let gain_ratio = exp(end_logs[0] - end_logs[1]);
                let (zero, pole) = (corner_squared * gain_ratio, corner_squared / gain_ratio);
                end_logs[1] + 0.5 * log((square + zero) / (square + pole))
            };
            let log_errors = [
                target_logs[0] - log_gain(lower_squared),
                target_logs[1] - log_gain(upper_squared),
            ];
            end_logs = [end_logs[0] + log_errors[0], end_logs[1] + log_errors[1]];
            is_found = log_errors[0].abs() + log_errors[1].abs() < 1e-9;
            if is_found {
                break;
            }
        }
        if !is_found || end_logs[0] > 0.0 || end_logs[1] > 0.0 {
            return None;
        }
        let gain_ratio = exp(0.5 * (end_logs[0] - end_logs[1]));
        let corner = sqrt(corner_squared);
        let (zero, pole, high) = (corner * gain_ratio, corner / gain_ratio, exp(end_logs[1]));
        // H(s) = high·(s + zero)/(s + pole), s = (1 − z⁻¹)/(1 + z⁻¹).
        let [b0, b1, a1] = [high * (1.0 + zero), high * (zero - 1.0), pole - 1.0];
        Some([b0, b1, a1].map(|numerator| numerator / (1.0 + pole)))
    }
}

/// tan(π·f/rate): the frequency f after the bilinear transformation.
fn warped(f: f64, rate: f64) -> f64 {
    let half_angle = std::f64::consts::PI * f / rate;
    sin(half_angle) / cos(half_angle)
}

/// Natural logarithms of the gain a frame, at 0 Hz and at half of the rate, if 1/t60 is a linear function of f²/(f² +
/// f₁·f₂) of warped frequencies; `None` if either would not decay.
fn end_log_gains(t60: [(f64, f64); 2], rate: f64) -> Option<[f64; 2]> {
    let [low_warped, high_warped] = t60.map(|(f, _)| warped(f, rate));
    let frequency_share = |f: f64| f * f / (f * f + low_warped * high_warped);
    let (low_share, high_share) = (frequency_share(low_warped), frequency_share(high_warped));
    let [low_slope, high_slope] = t60.map(|(_, t60)| -3.0 * std::f64::consts::LN_10 / (t60 * rate));
    let slope_rise = (high_slope - low_slope) / (high_share - low_share);
    let end_slopes = [
        low_slope - slope_rise * low_share,
        low_slope + slope_rise * (1.0 - low_share),
    ];
    // Without any loss, gains of 1 are allowed.
    let is_lossless = low_slope == 0.0 && high_slope == 0.0;
    (is_lossless || end_slopes.iter().all(|&end| end < 0.0)).then_some(end_slopes)
}

/// Lengths of the lines [frames]: different primes near a geometric series with the mean `mean`.
fn line_lengths(mean: f64) -> [usize; N_LINES] {
    let (least_ratio, greatest) = LENGTH_SPREAD;
    let series_lengths: [f64; N_LINES] =
        std::array::from_fn(|i| least_ratio * pow(greatest / least_ratio, i as f64 / (N_LINES - 1) as f64));
    let mean_row = series_lengths.iter().sum::<f64>() / N_LINES as f64;
    let mut previous_length = 1;
    series_lengths.map(|length| {
        let mut line_length = ((length / mean_row * mean) as usize).max(previous_length + 1);
        while !is_prime(line_length) {
            line_length += 1;
        }
        previous_length = line_length;
        line_length
    })
}

fn is_prime(n: usize) -> bool {
    n > 1 && (2..).take_while(|k| k * k <= n).all(|k| !n.is_multiple_of(k))
}

/// Multiply by the Hadamard matrix, which is √LINES times an orthogonal one, in log₂(LINES) steps.
#[inline(always)]
fn mix_lines(x: &mut [f64; N_LINES]) {
    let mut half_block = 1;
    while half_block < N_LINES {
        let mut block_start = 0;
        while block_start < N_LINES {
            for line in block_start..block_start + half_block {
                (x[line], x[line + half_block]) = (x[line] + x[line + half_block], x[line] - x[line + half_block]);
            }
            block_start += 2 * half_block;
        }
        half_block *= 2;
    }
}

/// Sign of a line in a channel: a row of the Hadamard matrix for each of the first channels, so that they are
/// uncorrelated; a hash (SplitMix64) for later ones.
fn line_sign(channel: usize, line: usize) -> f64 {
    // Row 0 is left out: all lines would have the same sign, and their first echoes would add up.
    let matrix_row = channel + 1;
    let is_negative = if matrix_row < N_LINES {
        (matrix_row & line).count_ones() % 2 == 1
    } else {
        let mut hash_state = ((channel * N_LINES + line) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        hash_state = (hash_state ^ (hash_state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash_state = (hash_state ^ (hash_state >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (hash_state ^ (hash_state >> 31)) & 1 == 1
    };
    if is_negative { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(long_t60: f64, short_t60: f64) -> RoomSpec {
        RoomSpec {
            name: "hall".to_owned(),
            size: 12.0,
            t60: [(200.0, long_t60), (6_000.0, short_t60)],
            channels: vec![0, 1],
            gain: 1.0,
        }
    }

    impl Room {
        fn next(&mut self, x: f64, frame: &mut [f64; 2]) {
            self.process(&[x], frame, 2);
        }
    }

    fn energy(room: &Room) -> f64 {
        room.delays.iter().map(DelayLine::energy).sum()
    }

    #[test]
    fn room_without_loss_keeps_its_energy() {
        let mut room = Room::new(spec(f64::INFINITY, f64::INFINITY), 44_100.0).unwrap();
        let mut frame = [0.0; 2];
        room.next(1.0, &mut frame);
        // Wait until the high-pass has settled.
        (0..44_100).for_each(|_| room.next(0.0, &mut frame));
        let energy_before = energy(&room);
        for _ in 0..1_000_000 {
            room.next(0.0, &mut frame);
        }
        assert!(energy_before > 0.9 && energy_before < 1.1, "{energy_before}");
        assert!(
            (energy(&room) / energy_before - 1.0).abs() < 1e-11,
            "{}",
            energy(&room) / energy_before
        );
    }

    #[test]
    fn room_output_of_a_constant_decays() {
        let mut room = Room::new(spec(20.0, 10.0), 44_100.0).unwrap();
        let mut loudest = 0.0_f64;
        for n in 0..40 * 44_100 {
            let mut frame = [0.0; 2];
            room.next(1.0, &mut frame);
            if n > 30 * 44_100 {
                loudest = loudest.max(frame[0].abs());
            }
        }
        assert!(loudest < 0.01, "{loudest}");
    }

    #[test]
    fn room_recovers_from_a_non_finite_sample() {
        let mut room = Room::new(spec(1.0, 0.5), 44_100.0).unwrap();
        let mut frame = [0.0; 2];
        room.next(f64::NAN, &mut frame);
        (0..5000).for_each(|_| room.next(1.0, &mut frame));
        assert!(frame.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn room_falls_silent_without_subnormal_numbers() {
        let mut room = Room::new(spec(0.3, 0.2), 44_100.0).unwrap();
        let mut frame = [0.0; 2];
        room.next(1.0, &mut frame);
        (0..40 * 44_100).for_each(|_| room.next(0.0, &mut frame));
        assert_eq!(energy(&room), 0.0);
    }

    #[test]
    fn impossible_rooms_are_refused() {
        for (size, t60) in [
            (0.1, [(200.0, 1.0), (6_000.0, 0.5)]),
            (f64::NAN, [(200.0, 1.0), (6_000.0, 0.5)]),
            (12.0, [(6_000.0, 1.0), (200.0, 0.5)]),
            (12.0, [(200.0, 0.0), (6_000.0, 0.5)]),
            (12.0, [(200.0, 1.0), (30_000.0, 0.5)]),
            (12.0, [(200.0, 10.0), (300.0, 0.1)]),
            (12.0, [(200.0, 0.05), (6_000.0, 0.02)]),
        ] {
            let spec = RoomSpec {
                size,
                t60,
                ..spec(1.0, 0.5)
            };
            assert!(Room::new(spec, 44_100.0).is_err(), "{size} {t60:?}");
        }
    }
}
