//! The contents of each kind of payload, as bytes. They are documented in `docs/motion.md`.

use crate::motion::{self, Chunk};

/// Version of every payload in this file.
pub const VERSION: u16 = 2;
/// Marks a missing source or track.
pub const NO_INDEX: u32 = u32::MAX;

/// Kinds of chunks.
pub mod kind {
    /// JSON.
    pub const MANIFEST: u16 = 1;
    /// Table of points.
    pub const POINTS: u16 = 2;
    /// Flights: free oscillations from an instant on.
    pub const FLIGHTS: u16 = 3;
    /// Sampled displacements.
    pub const FRAMES: u16 = 4;
    /// Ergons and strikes.
    pub const ERGONS: u16 = 5;
    /// Pushes of contacts.
    pub const CONTACTS: u16 = 6;
    /// Levels of loudspeakers.
    pub const LEVELS: u16 = 7;
    /// Positions of keys, and those that their gestures ask for.
    pub const HANDS: u16 = 8;
    /// The instant of the piece that is heard, by the server's clock.
    pub const CLOCK: u16 = 9;
    /// Key state: all running flights.
    pub const STATE: u16 = 10;
    /// Where segments begin in the file.
    pub const INDEX: u16 = 11;
    /// Links, as pairs of points.
    pub const LINKS: u16 = 12;
    /// Mode shapes of a part.
    pub const SHAPES: u16 = 13;
    /// Names of points.
    pub const NAMES: u16 = 14;
    /// Largest displacements of parts.
    pub const PEAKS: u16 = 15;
    /// Links that broke.
    pub const BROKEN: u16 = 16;
    /// Who made the file.
    pub const MAKER: u16 = 17;
    /// Chunks of other kinds, deflated.
    pub const BUNDLE: u16 = 18;
    /// The last kind that is known.
    pub const LAST: u16 = BUNDLE;
}

/// Bytes to which numbers are appended.
#[derive(Clone, Debug, Default)]
pub struct ByteWriter(pub Vec<u8>);

impl ByteWriter {
    /// Append a number.
    pub fn u16(&mut self, value: u16) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// Append a number.
    pub fn u32(&mut self, value: u32) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// Append a number.
    pub fn u64(&mut self, value: u64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// Append a number, rounded to single precision.
    pub fn f32(&mut self, value: f64) {
        self.0.extend_from_slice(&(value as f32).to_le_bytes());
    }

    /// Append a number.
    pub fn f64(&mut self, value: f64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }
}

/// Reads numbers from the front of bytes; `None` at their end.
#[derive(Clone, Copy, Debug)]
pub struct ByteReader<'a>(pub &'a [u8]);

impl<'a> ByteReader<'a> {
    /// The next `n` bytes.
    pub fn take_bytes(&mut self, n: usize) -> Option<&'a [u8]> {
        let (next_bytes, bytes_left) = self.0.split_at_checked(n)?;
        self.0 = bytes_left;
        Some(next_bytes)
    }

    fn take_array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take_bytes(N)?.try_into().ok()
    }

    /// The next number.
    pub fn u16(&mut self) -> Option<u16> {
        self.take_array().map(u16::from_le_bytes)
    }

    /// The next number.
    pub fn u32(&mut self) -> Option<u32> {
        self.take_array().map(u32::from_le_bytes)
    }

    /// The next number.
    pub fn u64(&mut self) -> Option<u64> {
        self.take_array().map(u64::from_le_bytes)
    }

    /// The next number, of single precision.
    pub fn f32(&mut self) -> Option<f64> {
        self.take_array().map(f32::from_le_bytes).map(f64::from)
    }

    /// The next number.
    pub fn f64(&mut self) -> Option<f64> {
        self.take_array().map(f64::from_le_bytes)
    }
}

/// Append a chunk of a kind.
pub fn write_chunk(out: &mut Vec<u8>, kind: u16, seconds: f64, payload: &[u8]) {
    let chunk = Chunk {
        kind,
        version: VERSION,
        seconds,
        payload,
    };
    motion::write_chunk(out, &chunk);
}

/// A number in half precision (IEEE 754), rounded to nearest, ties to even; a value that is too large becomes the
/// largest finite one.
pub fn half_bits(value: f64) -> u16 {
    let sign_bit = if value.is_sign_negative() { 0x8000 } else { 0 };
    let magnitude = value.abs();
    if magnitude.is_nan() {
        return 0x7e00;
    }
    if magnitude >= 65_504.0 {
        return sign_bit | 0x7bff;
    }
    // Below 2^−14: multiples of 2^−24; above: eleven significant bits.
    let exponent = if magnitude < 6.103_515_625e-5 {
        -14
    } else {
        ((magnitude.to_bits() >> 52) as i32) - 1023
    };
    let last_place = f64::from_bits(((exponent - 10 + 1023) as u64) << 52);
    let steps = (magnitude / last_place).round_ties_even() as u16; // 1024 ≤ steps ≤ 2048 where it is normal
    // A carry of the fraction increments the exponent.
    sign_bit | ((((exponent + 14) as u16) << 10) + steps)
}

/// The value of a half-precision number.
pub fn half_value(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let power_of_two = |exponent: i32| f64::from_bits(((exponent + 1023) as u64) << 52);
    let magnitude = match exponent {
        0 => fraction * power_of_two(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        normal => (1024.0 + fraction) * power_of_two(normal - 25),
    };
    if bits & 0x8000 == 0 { magnitude } else { -magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn to_half_keeps_eleven_bits() {
        for (value, bits) in [
            (0.0, 0x0000),
            (1.0, 0x3c00),
            (-2.0, 0xc000),
            (65_504.0, 0x7bff),
            (1e9, 0x7bff),
            (6.103_515_625e-5, 0x0400),
            (5.960_464_477_539_063e-8, 0x0001),
            (0.333_251_953_125, 0x3555),
            (2047.5, 0x6800), // a tie, to even: 2048
        ] {
            assert_eq!(half_bits(value), bits, "{value}");
        }
        for bits in 0..0x7c00_u16 {
            assert_eq!(half_bits(half_value(bits)), bits);
            assert_eq!(half_bits(-half_value(bits)), bits | 0x8000);
            let between = 0.5 * (half_value(bits) + half_value((bits + 1).min(0x7bff)));
            assert_eq!(half_bits(between) & 1, if bits == 0x7bff { 1 } else { 0 }, "{bits}");
        }
    }
}
