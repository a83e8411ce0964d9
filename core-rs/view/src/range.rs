//! A binary range coder with adaptive probabilities, as in LZMA (I. Pavlov: LZMA specification, 2015), and whole
//! numbers in such bits. Writer and reader go through the same functions, so that they cannot differ.

/// A probability is that of a 0, in steps of 2⁻¹⁵.
const PROBABILITY_BITS: u32 = 15;
/// Both bits are equally likely.
pub(crate) const EVEN_PROBABILITY: u16 = 1 << (PROBABILITY_BITS - 1);
/// A probability moves by 2⁻⁴ of the way with each bit.
const ADAPTATION_SHIFT: u32 = 4;
/// The range is kept above this, by moving on by a byte.
const RANGE_MIN: u32 = 1 << 24;

/// Writes bits, or reads them.
pub(crate) trait Coder {
    /// The next bit. A writer writes `bit` and returns it; a reader returns the bit that it reads.
    fn code(&mut self, probability: u16, bit: bool) -> bool;

    /// The next bit, from which its probability is learnt.
    fn bit(&mut self, probability: &mut u16, bit: bool) -> bool {
        let bit = self.code(*probability, bit);
        if bit {
            *probability -= *probability >> ADAPTATION_SHIFT;
        } else {
            *probability += ((1 << PROBABILITY_BITS) - *probability) >> ADAPTATION_SHIFT;
        }
        bit
    }
}

/// Writes bits.
pub(crate) struct BitWriter {
    low: u64,
    range: u32,
    /// The last byte whose carry is not known, and how many bytes of 255 follow it, itself included.
    pending_byte: u8,
    pending_count: usize,
    bytes: Vec<u8>,
}

impl BitWriter {
    pub(crate) fn new() -> Self {
        Self {
            low: 0,
            range: u32::MAX,
            pending_byte: 0,
            pending_count: 1,
            bytes: Vec::new(),
        }
    }

    fn shift_low(&mut self) {
        let overflow = (self.low >> 32) as u8;
        if overflow != 0 || self.low < 0xff00_0000 {
            let mut pending_byte = self.pending_byte;
            for _ in 0..self.pending_count {
                self.bytes.push(pending_byte.wrapping_add(overflow));
                pending_byte = 0xff;
            }
            self.pending_count = 0;
            self.pending_byte = (self.low >> 24) as u8;
        }
        self.pending_count += 1;
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// All bytes.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift_low();
        }
        self.bytes
    }
}

impl Coder for BitWriter {
    fn code(&mut self, probability: u16, bit: bool) -> bool {
        let split_point = (self.range >> PROBABILITY_BITS) * u32::from(probability);
        if bit {
            self.low += u64::from(split_point);
            self.range -= split_point;
        } else {
            self.range = split_point;
        }
        while self.range < RANGE_MIN {
            self.range <<= 8;
            self.shift_low();
        }
        bit
    }
}

/// Reads bits; zeros after the end of the bytes.
pub(crate) struct BitReader<'a> {
    bytes: &'a [u8],
    position: usize,
    range: u32,
    code_value: u32,
}

impl<'a> BitReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Self {
            bytes,
            position: 0,
            range: u32::MAX,
            code_value: 0,
        };
        for _ in 0..5 {
            reader.next_byte();
        }
        reader
    }

    fn next_byte(&mut self) {
        let next_byte = self.bytes.get(self.position).copied().unwrap_or(0);
        self.code_value = (self.code_value << 8) | u32::from(next_byte);
        self.position += 1;
    }

    /// Whether exactly all bytes were read.
    pub(crate) fn is_exhausted(&self) -> bool {
        self.position == self.bytes.len()
    }
}

impl Coder for BitReader<'_> {
    fn code(&mut self, probability: u16, _: bool) -> bool {
        let split_point = (self.range >> PROBABILITY_BITS) * u32::from(probability);
        let bit = self.code_value >= split_point;
        if bit {
            self.code_value -= split_point;
            self.range -= split_point;
        } else {
            self.range = split_point;
        }
        while self.range < RANGE_MIN {
            self.range <<= 8;
            self.next_byte();
        }
        bit
    }
}

/// Lengths of numbers that have probabilities of their own.
const LENGTH_CONTEXTS: usize = 21;
/// Bits of the largest number.
const LENGTH_BITS_MAX: u32 = 60;

/// Probabilities of the bits of numbers ≥ 0 in several contexts.
pub(crate) struct NumberModel(Vec<[[u16; LENGTH_CONTEXTS]; 2]>);

impl NumberModel {
    pub(crate) fn new(n_contexts: usize) -> Self {
        Self(vec![[[EVEN_PROBABILITY; LENGTH_CONTEXTS]; 2]; n_contexts])
    }

    /// The next number, in Elias' gamma code of `value` + 1: its length in ones and a zero, then its bits after the
    /// first. The ones, the zero and the first of the bits have probabilities. `None`: longer than any number may be.
    pub(crate) fn code(&mut self, coder: &mut impl Coder, context: usize, value: u64) -> Option<u64> {
        let binary = value + 1;
        let [length_probabilities, first_probabilities] = &mut self.0[context];
        let mut code_length = 0;
        while coder.bit(
            &mut length_probabilities[(code_length as usize).min(LENGTH_CONTEXTS - 1)],
            code_length < binary.ilog2(),
        ) {
            code_length += 1;
            if code_length > LENGTH_BITS_MAX {
                return None;
            }
        }
        let mut decoded = 1_u64;
        for bit_index in (0..code_length).rev() {
            let bit = binary >> bit_index & 1 == 1;
            let bit = if bit_index + 1 == code_length {
                coder.bit(
                    &mut first_probabilities[(code_length as usize).min(LENGTH_CONTEXTS - 1)],
                    bit,
                )
            } else {
                coder.code(EVEN_PROBABILITY, bit)
            };
            decoded = decoded << 1 | u64::from(bit);
        }
        Some(decoded - 1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn range_coder_round_trip(values in prop::collection::vec((0..3_usize, 0..60_u32, any::<u64>()), 0..300)) {
            let values: Vec<(usize, u64)> =
                values.into_iter().map(|(context, bits, x)| (context, x & ((1 << bits) - 1))).collect();
            let (mut writer, mut probabilities) = (BitWriter::new(), NumberModel::new(3));
            for (context, value) in &values {
                probabilities.code(&mut writer, *context, *value);
            }
            let bytes = writer.finish();
            let (mut reader, mut probabilities) = (BitReader::new(&bytes), NumberModel::new(3));
            for (context, value) in &values {
                prop_assert_eq!(probabilities.code(&mut reader, *context, 0), Some(*value));
            }
            prop_assert!(reader.is_exhausted());
        }
    }

    #[test]
    fn range_coder_size_of_likely_symbols() {
        let (mut writer, mut probability) = (BitWriter::new(), EVEN_PROBABILITY);
        for _ in 0..8_000 {
            writer.bit(&mut probability, false);
        }
        assert!(writer.finish().len() < 20);
    }
}
