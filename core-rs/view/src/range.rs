//! A binary range coder with adaptive chances, as in LZMA (I. Pavlov: LZMA specification, 2015), and whole numbers in
//! such bits. Writer and reader go through the same functions, so that they cannot differ.

/// A chance is that of a 0, in steps of 2⁻¹⁵.
const CHANCE_BITS: u32 = 15;
/// Both bits are equally likely.
pub(crate) const EVEN: u16 = 1 << (CHANCE_BITS - 1);
/// A chance moves by 2⁻⁴ of the way with each bit.
const RATE: u32 = 4;
/// The range is kept above this, by moving on by a byte.
const RANGE_MIN: u32 = 1 << 24;

/// Writes bits, or reads them.
pub(crate) trait Coder {
    /// The next bit. A writer writes `bit` and returns it; a reader returns the bit that it reads.
    fn code(&mut self, chance: u16, bit: bool) -> bool;

    /// The next bit, from which its chance is learnt.
    fn bit(&mut self, chance: &mut u16, bit: bool) -> bool {
        let bit = self.code(*chance, bit);
        if bit {
            *chance -= *chance >> RATE;
        } else {
            *chance += ((1 << CHANCE_BITS) - *chance) >> RATE;
        }
        bit
    }
}

/// Writes bits.
pub(crate) struct Writer {
    low: u64,
    range: u32,
    /// The last byte whose carry is not known, and how many bytes of 255 follow it, itself included.
    last: u8,
    waiting: usize,
    out: Vec<u8>,
}

impl Writer {
    pub(crate) fn new() -> Self {
        Self {
            low: 0,
            range: u32::MAX,
            last: 0,
            waiting: 1,
            out: Vec::new(),
        }
    }

    fn shift(&mut self) {
        let overflow = (self.low >> 32) as u8;
        if overflow != 0 || self.low < 0xff00_0000 {
            let mut pending_byte = self.last;
            for _ in 0..self.waiting {
                self.out.push(pending_byte.wrapping_add(overflow));
                pending_byte = 0xff;
            }
            self.waiting = 0;
            self.last = (self.low >> 24) as u8;
        }
        self.waiting += 1;
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// All bytes.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        self.out
    }
}

impl Coder for Writer {
    fn code(&mut self, chance: u16, bit: bool) -> bool {
        let split_point = (self.range >> CHANCE_BITS) * u32::from(chance);
        if bit {
            self.low += u64::from(split_point);
            self.range -= split_point;
        } else {
            self.range = split_point;
        }
        while self.range < RANGE_MIN {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// Reads bits; zeros after the end of the bytes.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    position: usize,
    range: u32,
    code: u32,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Self {
            bytes,
            position: 0,
            range: u32::MAX,
            code: 0,
        };
        for _ in 0..5 {
            reader.next();
        }
        reader
    }

    fn next(&mut self) {
        let next_byte = self.bytes.get(self.position).copied().unwrap_or(0);
        self.code = (self.code << 8) | u32::from(next_byte);
        self.position += 1;
    }

    /// Whether exactly all bytes were read.
    pub(crate) fn is_ended(&self) -> bool {
        self.position == self.bytes.len()
    }
}

impl Coder for Reader<'_> {
    fn code(&mut self, chance: u16, _: bool) -> bool {
        let split_point = (self.range >> CHANCE_BITS) * u32::from(chance);
        let bit = self.code >= split_point;
        if bit {
            self.code -= split_point;
            self.range -= split_point;
        } else {
            self.range = split_point;
        }
        while self.range < RANGE_MIN {
            self.range <<= 8;
            self.next();
        }
        bit
    }
}

/// Lengths of numbers that have chances of their own.
const LENGTHS: usize = 21;
/// Bits of the largest number.
const LENGTH_MAX: u32 = 60;

/// Chances of the bits of numbers ≥ 0 in several contexts.
pub(crate) struct Numbers(Vec<[[u16; LENGTHS]; 2]>);

impl Numbers {
    pub(crate) fn new(n_contexts: usize) -> Self {
        Self(vec![[[EVEN; LENGTHS]; 2]; n_contexts])
    }

    /// The next number, in Elias' gamma code of `value` + 1: its length in ones and a zero, then its bits after the
    /// first. The ones, the zero and the first of the bits have chances. `None`: longer than any number may be.
    pub(crate) fn code(&mut self, coder: &mut impl Coder, context: usize, value: u64) -> Option<u64> {
        let binary = value + 1;
        let [lengths, first_chances] = &mut self.0[context];
        let mut code_length = 0;
        while coder.bit(
            &mut lengths[(code_length as usize).min(LENGTHS - 1)],
            code_length < binary.ilog2(),
        ) {
            code_length += 1;
            if code_length > LENGTH_MAX {
                return None;
            }
        }
        let mut decoded = 1_u64;
        for bit_index in (0..code_length).rev() {
            let bit = binary >> bit_index & 1 == 1;
            let bit = if bit_index + 1 == code_length {
                coder.bit(&mut first_chances[(code_length as usize).min(LENGTHS - 1)], bit)
            } else {
                coder.code(EVEN, bit)
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
            let (mut writer, mut chances) = (Writer::new(), Numbers::new(3));
            for (context, value) in &values {
                chances.code(&mut writer, *context, *value);
            }
            let bytes = writer.finish();
            let (mut reader, mut chances) = (Reader::new(&bytes), Numbers::new(3));
            for (context, value) in &values {
                prop_assert_eq!(chances.code(&mut reader, *context, 0), Some(*value));
            }
            prop_assert!(reader.is_ended());
        }
    }

    #[test]
    fn range_coder_size_of_likely_symbols() {
        let (mut writer, mut chance) = (Writer::new(), EVEN);
        for _ in 0..8_000 {
            writer.bit(&mut chance, false);
        }
        assert!(writer.finish().len() < 20);
    }
}
