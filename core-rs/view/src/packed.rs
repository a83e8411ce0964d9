//! Displacements of points in a file: each point in steps of its own, as differences from what is foreseen.

use crate::payload::{Bytes, Reading};
use crate::range::{Coder, EVEN, Numbers, Reader, Writer};

/// How far displacements may be off. The first three are of points that are sampled, in frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Share of the point's own amplitude: half the distance between its extremes so far.
    pub amplitude: f64,
    /// \[m\] of a point that moves by less than twice as much in a block.
    pub rest: f64,
    /// \[m\] that nothing is held more exactly than, whatever its amplitude; less where the part moves little.
    pub least: f64,
    /// Share of the amplitude of an oscillation that is continued by a reader.
    pub flight: f64,
}

/// The bound of all files.
pub const BOUND: Bound = Bound {
    amplitude: 3e-3,
    rest: 5e-7,
    least: 1e-8,
    flight: 2e-3,
};
/// Frames in which a point either rests or moves.
const BLOCK: usize = 20;
/// Share of the largest amplitude of a part that no eye sees.
const UNSEEN: f64 = 1.0 / (1 << 20) as f64;
/// A displacement too small to be seen \[m\].
const FAINT: f64 = 1e-12;
/// Steps that the largest displacement may be away at most.
const STEPS_MAX: f64 = (1_u64 << 40) as f64;
/// Largest code of a step.
const CODE_MAX: u64 = 200;

/// What a frame is foreseen as. A point that rests is held in the fine steps of the chunk.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Rest,
    Hold,
    Line,
    Beside,
    Ahead,
}

const MODES: [Mode; 5] = [
    Mode::Rest,
    Mode::Hold,
    Mode::Line,
    Mode::Beside,
    Mode::Ahead,
];
/// Bits of the number of a mode.
const MODE_BITS: u32 = 3;

/// The length of a step in units: 4, 5, 6, 7, 8, 10, 12, 14, 16 …
fn step(code: u64) -> i64 {
    (4 + (code & 3) as i64) << (code >> 2)
}

/// The code of the largest step whose half is within a bound \[m\].
fn code(bound: f64, unit: f64) -> u64 {
    let is_within = |code: &u64| 0.5 * step(*code) as f64 * unit <= bound;
    (1..=CODE_MAX).take_while(is_within).last().unwrap_or(0)
}

/// What is foreseen of a point in the next frame, from its own frames so far, and those of the two points before it.
fn foreseen(mode: Mode, frames: &[i64], before: [&[i64]; 2]) -> i64 {
    let t = frames.len();
    let Some(&last) = frames.last() else { return 0 };
    let moved = |point: &[i64]| point[t].wrapping_sub(point[t - 1]);
    let by = match mode {
        Mode::Rest | Mode::Hold => 0,
        Mode::Line => last.wrapping_sub(frames[t.saturating_sub(2)]),
        Mode::Beside => moved(before[0]),
        Mode::Ahead => (moved(before[0]).wrapping_mul(2)).wrapping_sub(moved(before[1])),
    };
    last.wrapping_add(by)
}

/// What has been learnt so far of the numbers in a chunk.
struct Learnt {
    steps: Numbers,
    firsts: Numbers,
    differences: Numbers,
    modes: [[u16; 1 << MODE_BITS]; MODES.len()],
    code: u64,
    mode: usize,
    /// Sizes of the last two differences, the latest first.
    sizes: [u64; 2],
}

/// Contexts of differences: by the number of bits of the last two.
const CONTEXTS: usize = 15;

impl Learnt {
    fn new() -> Self {
        Self {
            steps: Numbers::new(1),
            firsts: Numbers::new(1),
            differences: Numbers::new(CONTEXTS),
            modes: [[EVEN; 1 << MODE_BITS]; MODES.len()],
            code: 0,
            mode: 0,
            sizes: [0; 2],
        }
    }

    /// The step of a point, as its difference from that of the point before.
    fn step(&mut self, coder: &mut impl Coder, code: u64) -> Option<i64> {
        let zigzag = zigzag(code as i64 - self.code as i64);
        let difference = from_zigzag(self.steps.code(coder, 0, zigzag)?);
        self.code = (self.code).checked_add_signed(difference)?;
        (self.code <= CODE_MAX).then(|| step(self.code))
    }

    /// The mode of a block; it is likelier for being that of the block before.
    fn mode(&mut self, coder: &mut impl Coder, mode: Mode) -> Option<Mode> {
        let chances = &mut self.modes[self.mode];
        let mut number = 1_usize;
        for place in (0..MODE_BITS).rev() {
            let bit = mode as usize >> place & 1 == 1;
            number = number << 1 | usize::from(coder.bit(&mut chances[number], bit));
        }
        self.mode = number - (1 << MODE_BITS);
        MODES.get(self.mode).copied()
    }

    /// A difference from what is foreseen, in steps.
    fn difference(
        &mut self,
        coder: &mut impl Coder,
        difference: i64,
        is_first: bool,
    ) -> Option<i64> {
        let size = difference.unsigned_abs();
        let size = if is_first {
            self.firsts.code(coder, 0, size)?
        } else {
            let [last, before] = self.sizes;
            let bits = u64::BITS - (2 * last + before).div_ceil(2).leading_zeros();
            let size = (self.differences).code(coder, (bits as usize).min(CONTEXTS - 1), size)?;
            self.sizes = [size, last];
            size
        };
        let is_negative = size != 0 && coder.code(EVEN, difference < 0);
        Some(if is_negative {
            -(size as i64)
        } else {
            size as i64
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
const FINE_SHARE: f64 = 3e-4;

/// Append frames (count, n) that are all known; `amplitudes` (n) [m] are those of the points so far, these frames
/// included.
pub(crate) fn pack(out: &mut Bytes, rows: &[f64], amplitudes: &[f64]) {
    let n = amplitudes.len();
    let coarse = |point: usize| BOUND.amplitude * amplitudes[point];
    if rows.len() <= 8 * FINE_BYTES_MAX {
        let finer = |point: usize| {
            let frames = rows[point..].iter().step_by(n);
            coarse(point).min(0.5 * FINE_SHARE * extent(frames))
        };
        let bytes = pack_within(rows, amplitudes, finer);
        if bytes.len() <= FINE_BYTES_MAX {
            out.0.extend(bytes);
            return;
        }
    }
    out.0.extend(pack_within(rows, amplitudes, coarse));
}

/// Frames whose points are each right within a bound [m].
fn pack_within(rows: &[f64], amplitudes: &[f64], bound: impl Fn(usize) -> f64) -> Vec<u8> {
    let (n, mut out) = (amplitudes.len(), Bytes::default());
    let largest = |values: &[f64]| {
        values
            .iter()
            .fold(0.0_f64, |largest, x| largest.max(x.abs()))
    };
    let floor = (largest(amplitudes) * UNSEEN)
        .clamp(FAINT, BOUND.least)
        .max(largest(rows) / STEPS_MAX);
    // The smallest step is four units.
    let unit = power_of_two(0.5 * floor);
    let fine = code(BOUND.rest.max(floor), unit);
    out.f64(unit);
    out.u16(fine as u16);
    let (mut writer, mut learnt) = (Writer::new(), Learnt::new());
    let count = rows.len() / n.max(1);
    let (mut before, mut before_that) = (vec![0; count], vec![0; count]);
    for point in 0..n {
        let actual: Vec<f64> = rows[point..].iter().step_by(n).copied().collect();
        let coarse = code(bound(point).max(floor), unit);
        learnt.step(&mut writer, coarse);
        let mut held: Vec<i64> = Vec::with_capacity(count);
        for block in actual.chunks(BLOCK) {
            let rests = coarse > fine && extent(block.iter()) <= 2.0 * BOUND.rest;
            let trials = if rests { &MODES[..1] } else { &MODES[1..] };
            let size = step(if rests { fine } else { coarse });
            let trials = trials.iter().map(|&mode| {
                let mut frames = held.clone();
                let differences: Vec<i64> = (block.iter())
                    .map(|x| {
                        let from = foreseen(mode, &frames, [&before, &before_that]);
                        let steps = ((x / unit - from as f64) / size as f64).round_ties_even();
                        frames.push(from + steps as i64 * size);
                        steps as i64
                    })
                    .collect();
                (mode, frames, differences)
            });
            let bits = |differences: &[i64]| -> u32 {
                let bits = differences
                    .iter()
                    .map(|x| u64::BITS - x.unsigned_abs().leading_zeros());
                bits.sum()
            };
            let Some((mode, frames, differences)) = trials.min_by_key(|trial| bits(&trial.2))
            else {
                continue;
            };
            learnt.mode(&mut writer, mode);
            for (i, difference) in differences.into_iter().enumerate() {
                learnt.difference(&mut writer, difference, held.len() + i == 0);
            }
            held = frames;
        }
        before_that = std::mem::replace(&mut before, held);
    }
    out.0.extend(writer.finish());
    out.0
}

/// Read frames (count, n) of displacements [m]; `None` if they are damaged.
pub(crate) fn unpack(payload: &[u8], count: usize, n: usize) -> Option<Vec<f64>> {
    let mut head = Reading(payload);
    let (unit, fine) = (head.f64()?, u64::from(head.u16()?));
    if !(unit > 0.0 && unit.is_finite()) || fine > CODE_MAX {
        return None;
    }
    let (mut reader, mut learnt) = (Reader::new(head.0), Learnt::new());
    let mut rows = vec![0.0; count * n];
    let (mut before, mut before_that) = (vec![0; count], vec![0; count]);
    for point in 0..n {
        let size = learnt.step(&mut reader, 0)?;
        let mut held: Vec<i64> = Vec::with_capacity(count);
        while held.len() < count {
            let mode = learnt.mode(&mut reader, Mode::Rest)?;
            let size = if mode == Mode::Rest { step(fine) } else { size };
            for _ in held.len()..count.min(held.len() + BLOCK) {
                let from = foreseen(mode, &held, [&before, &before_that]);
                let steps = learnt.difference(&mut reader, 0, held.is_empty())?;
                held.push(from.wrapping_add(steps.wrapping_mul(size)));
            }
        }
        for (row, x) in rows.chunks_mut(n).zip(&held) {
            row[point] = *x as f64 * unit;
        }
        before_that = std::mem::replace(&mut before, held);
    }
    reader.is_ended().then_some(rows)
}

fn extent<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    let (low, high) = values.fold(ends, |(low, high), x| (low.min(*x), high.max(*x)));
    high - low
}

/// The largest power of two that is not above a positive normal number.
fn power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & !((1 << 52) - 1))
}
