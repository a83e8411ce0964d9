//! Displacements of points in a file: each point in steps of its own, as differences from what is foreseen.

use crate::payload::{ByteReader, ByteWriter};
use crate::range::{BitReader, BitWriter, Coder, EVEN_PROBABILITY, NumberModel};

/// Error bounds of displacements. The first three are for sampled points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBounds {
    /// Share of the point's own amplitude: half the distance between its extremes so far.
    pub amplitude_share: f64,
    /// \[m\] of a point that moves by less than twice as much in a block.
    pub resting_metres: f64,
    /// Smallest bound \[m\] of any point, whatever its amplitude; smaller in a part that moves little.
    pub metres_min: f64,
    /// Share of the amplitude of an oscillation that is continued by a reader.
    pub flight_share: f64,
}

/// The bound of all files.
pub const ERROR_BOUNDS: ErrorBounds = ErrorBounds {
    amplitude_share: 3e-3,
    resting_metres: 5e-7,
    metres_min: 1e-8,
    flight_share: 2e-3,
};
/// Frames in which a point either rests or moves.
const BLOCK_FRAMES: usize = 20;
/// Displacements below this share of the largest amplitude of a part cannot be seen.
const INVISIBLE_SHARE: f64 = 1.0 / (1 << 20) as f64;
/// A displacement too small to be seen \[m\].
const INVISIBLE_METRES: f64 = 1e-12;
/// Steps that the largest displacement may be away at most.
const STEPS_MAX: f64 = (1_u64 << 40) as f64;
/// Largest code of a step.
const CODE_MAX: u64 = 200;

/// The predictor of a frame. A point at rest is stored in the fine steps of the chunk.
#[derive(Clone, Copy, PartialEq)]
enum Predictor {
    Rest,
    Hold,
    Line,
    Neighbour,
    NeighbourLine,
}

const PREDICTORS: [Predictor; 5] = [
    Predictor::Rest,
    Predictor::Hold,
    Predictor::Line,
    Predictor::Neighbour,
    Predictor::NeighbourLine,
];
/// Bits of the number of a predictor.
const PREDICTOR_BITS: u32 = 3;

/// The length of a step in units: 4, 5, 6, 7, 8, 10, 12, 14, 16 …
fn step_length(code: u64) -> i64 {
    (4 + (code & 3) as i64) << (code >> 2)
}

/// The code of the largest step whose half is within a bound \[m\].
fn largest_step_code(bound: f64, unit: f64) -> u64 {
    let is_within = |code: &u64| 0.5 * step_length(*code) as f64 * unit <= bound;
    (1..=CODE_MAX).take_while(is_within).last().unwrap_or(0)
}

/// What is foreseen of a point in the next frame, from its own frames so far, and those of the two points before it.
fn predicted_displacement(predictor: Predictor, frames: &[i64], before: [&[i64]; 2]) -> i64 {
    let frame_index = frames.len();
    let Some(&last_displacement) = frames.last() else {
        return 0;
    };
    let movement_of = |point: &[i64]| point[frame_index].wrapping_sub(point[frame_index - 1]);
    let predicted_move = match predictor {
        Predictor::Rest | Predictor::Hold => 0,
        Predictor::Line => last_displacement.wrapping_sub(frames[frame_index.saturating_sub(2)]),
        Predictor::Neighbour => movement_of(before[0]),
        Predictor::NeighbourLine => (movement_of(before[0]).wrapping_mul(2)).wrapping_sub(movement_of(before[1])),
    };
    last_displacement.wrapping_add(predicted_move)
}

/// What has been learnt so far of the numbers in a chunk.
struct CodingModel {
    step_numbers: NumberModel,
    first_displacements: NumberModel,
    differences: NumberModel,
    predictor_probabilities: [[u16; 1 << PREDICTOR_BITS]; PREDICTORS.len()],
    step_code: u64,
    last_predictor: usize,
    /// Sizes of the last two differences, the latest first.
    last_sizes: [u64; 2],
}

/// Contexts of differences: by the number of bits of the last two.
const N_CONTEXTS: usize = 15;

impl CodingModel {
    fn new() -> Self {
        Self {
            step_numbers: NumberModel::new(1),
            first_displacements: NumberModel::new(1),
            differences: NumberModel::new(N_CONTEXTS),
            predictor_probabilities: [[EVEN_PROBABILITY; 1 << PREDICTOR_BITS]; PREDICTORS.len()],
            step_code: 0,
            last_predictor: 0,
            last_sizes: [0; 2],
        }
    }

    /// The step of a point, as its difference from that of the point before.
    fn code_step(&mut self, coder: &mut impl Coder, code: u64) -> Option<i64> {
        let zigzag = zigzag(code as i64 - self.step_code as i64);
        let difference = from_zigzag(self.step_numbers.code(coder, 0, zigzag)?);
        self.step_code = (self.step_code).checked_add_signed(difference)?;
        (self.step_code <= CODE_MAX).then(|| step_length(self.step_code))
    }

    /// The predictor of a block; it is likelier for being that of the block before.
    fn code_predictor(&mut self, coder: &mut impl Coder, predictor: Predictor) -> Option<Predictor> {
        let probabilities = &mut self.predictor_probabilities[self.last_predictor];
        let mut tree_node = 1_usize;
        for bit_index in (0..PREDICTOR_BITS).rev() {
            let predictor_bit = predictor as usize >> bit_index & 1 == 1;
            tree_node = tree_node << 1 | usize::from(coder.bit(&mut probabilities[tree_node], predictor_bit));
        }
        self.last_predictor = tree_node - (1 << PREDICTOR_BITS);
        PREDICTORS.get(self.last_predictor).copied()
    }

    /// A difference from what is foreseen, in steps.
    fn code_difference(&mut self, coder: &mut impl Coder, difference: i64, is_first: bool) -> Option<i64> {
        let magnitude = difference.unsigned_abs();
        let magnitude = if is_first {
            self.first_displacements.code(coder, 0, magnitude)?
        } else {
            let [last_size, size_before] = self.last_sizes;
            let context_bits = u64::BITS - (2 * last_size + size_before).div_ceil(2).leading_zeros();
            let magnitude = (self.differences).code(coder, (context_bits as usize).min(N_CONTEXTS - 1), magnitude)?;
            self.last_sizes = [magnitude, last_size];
            magnitude
        };
        let is_negative = magnitude != 0 && coder.code(EVEN_PROBABILITY, difference < 0);
        Some(if is_negative {
            -(magnitude as i64)
        } else {
            magnitude as i64
        })
    }
}

fn zigzag(x: i64) -> u64 {
    ((x << 1) ^ (x >> 63)) as u64
}

fn from_zigzag(x: u64) -> i64 {
    (x >> 1) as i64 ^ -((x & 1) as i64)
}

/// Where these frames alone take no more bytes than this, points go by finer steps: few points take little, and show
/// a small motion after a large one.
const FINE_BYTES_MAX: usize = 1024;
/// Share of the amplitude in these frames alone that half a finer step is.
const FINE_AMPLITUDE_SHARE: f64 = 3e-4;

/// Append frames (count, n) that are all known; `amplitudes` (n) [m] are those of the points so far, these frames
/// included.
pub(crate) fn pack(out: &mut ByteWriter, rows: &[f64], amplitudes: &[f64]) {
    let n_points = amplitudes.len();
    let coarse_bound = |point: usize| ERROR_BOUNDS.amplitude_share * amplitudes[point];
    if rows.len() <= 8 * FINE_BYTES_MAX {
        let finer_bound = |point: usize| {
            let point_frames = rows[point..].iter().step_by(n_points);
            coarse_bound(point).min(0.5 * FINE_AMPLITUDE_SHARE * value_range(point_frames))
        };
        let packed_bytes = pack_within(rows, amplitudes, finer_bound);
        if packed_bytes.len() <= FINE_BYTES_MAX {
            out.0.extend(packed_bytes);
            return;
        }
    }
    out.0.extend(pack_within(rows, amplitudes, coarse_bound));
}

/// Frames whose points are each right within a bound [m].
fn pack_within(rows: &[f64], amplitudes: &[f64], bound: impl Fn(usize) -> f64) -> Vec<u8> {
    let (n, mut packed_bytes) = (amplitudes.len(), ByteWriter::default());
    let max_magnitude = |values: &[f64]| values.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    let floor_bound = (max_magnitude(amplitudes) * INVISIBLE_SHARE)
        .clamp(INVISIBLE_METRES, ERROR_BOUNDS.metres_min)
        .max(max_magnitude(rows) / STEPS_MAX);
    // The smallest step is four units.
    let unit_length = floor_power_of_two(0.5 * floor_bound);
    let fine_code = largest_step_code(ERROR_BOUNDS.resting_metres.max(floor_bound), unit_length);
    packed_bytes.f64(unit_length);
    packed_bytes.u16(fine_code as u16);
    let (mut writer, mut coding_model) = (BitWriter::new(), CodingModel::new());
    let frame_count = rows.len() / n.max(1);
    let (mut before, mut second_before) = (vec![0; frame_count], vec![0; frame_count]);
    for point in 0..n {
        let point_frames: Vec<f64> = rows[point..].iter().step_by(n).copied().collect();
        let coarse_code = largest_step_code(bound(point).max(floor_bound), unit_length);
        coding_model.code_step(&mut writer, coarse_code);
        let mut coded_frames: Vec<i64> = Vec::with_capacity(frame_count);
        for block in point_frames.chunks(BLOCK_FRAMES) {
            let is_resting = coarse_code > fine_code && value_range(block.iter()) <= 2.0 * ERROR_BOUNDS.resting_metres;
            let predictors = if is_resting { &PREDICTORS[..1] } else { &PREDICTORS[1..] };
            let step_size = step_length(if is_resting { fine_code } else { coarse_code });
            let predictor_trials = predictors.iter().map(|&predictor| {
                let mut trial_frames = coded_frames.clone();
                let differences: Vec<i64> = (block.iter())
                    .map(|x| {
                        let predicted = predicted_displacement(predictor, &trial_frames, [&before, &second_before]);
                        let difference_in_steps =
                            ((x / unit_length - predicted as f64) / step_size as f64).round_ties_even();
                        trial_frames.push(predicted + difference_in_steps as i64 * step_size);
                        difference_in_steps as i64
                    })
                    .collect();
                (predictor, trial_frames, differences)
            });
            let bit_count = |differences: &[i64]| -> u32 {
                let bit_count = differences.iter().map(|x| u64::BITS - x.unsigned_abs().leading_zeros());
                bit_count.sum()
            };
            let Some((predictor, trial_frames, differences)) = predictor_trials.min_by_key(|trial| bit_count(&trial.2))
            else {
                continue;
            };
            coding_model.code_predictor(&mut writer, predictor);
            for (i, difference) in differences.into_iter().enumerate() {
                coding_model.code_difference(&mut writer, difference, coded_frames.len() + i == 0);
            }
            coded_frames = trial_frames;
        }
        second_before = std::mem::replace(&mut before, coded_frames);
    }
    packed_bytes.0.extend(writer.finish());
    packed_bytes.0
}

/// Read frames (count, n) of displacements [m]; `None` if they are damaged.
pub(crate) fn unpack(payload: &[u8], n_frames: usize, n_points: usize) -> Option<Vec<f64>> {
    let mut head_reader = ByteReader(payload);
    let (unit_length, fine_code) = (head_reader.f64()?, u64::from(head_reader.u16()?));
    if !(unit_length > 0.0 && unit_length.is_finite()) || fine_code > CODE_MAX {
        return None;
    }
    let (mut reader, mut coding_model) = (BitReader::new(head_reader.0), CodingModel::new());
    let mut all_rows = vec![0.0; n_frames * n_points];
    let (mut before, mut second_before) = (vec![0; n_frames], vec![0; n_frames]);
    for point in 0..n_points {
        let step_size = coding_model.code_step(&mut reader, 0)?;
        let mut decoded_frames: Vec<i64> = Vec::with_capacity(n_frames);
        while decoded_frames.len() < n_frames {
            let predictor = coding_model.code_predictor(&mut reader, Predictor::Rest)?;
            let step_size = if predictor == Predictor::Rest {
                step_length(fine_code)
            } else {
                step_size
            };
            for _ in decoded_frames.len()..n_frames.min(decoded_frames.len() + BLOCK_FRAMES) {
                let predicted = predicted_displacement(predictor, &decoded_frames, [&before, &second_before]);
                let difference_in_steps = coding_model.code_difference(&mut reader, 0, decoded_frames.is_empty())?;
                decoded_frames.push(predicted.wrapping_add(difference_in_steps.wrapping_mul(step_size)));
            }
        }
        for (row, x) in all_rows.chunks_mut(n_points).zip(&decoded_frames) {
            row[point] = *x as f64 * unit_length;
        }
        second_before = std::mem::replace(&mut before, decoded_frames);
    }
    reader.is_exhausted().then_some(all_rows)
}

fn value_range<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let empty_range = (f64::INFINITY, f64::NEG_INFINITY);
    let (minimum, maximum) = values.fold(empty_range, |(minimum, maximum), x| (minimum.min(*x), maximum.max(*x)));
    maximum - minimum
}

/// The largest power of two that is not above a positive normal number.
fn floor_power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & !((1 << 52) - 1))
}
