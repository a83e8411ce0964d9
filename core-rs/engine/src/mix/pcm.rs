//! Conversion of samples to the formats of files.

/// Width of an integer sample.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Bits {
    /// 16-bit, full scale 2¹⁵.
    Sixteen,
    /// 24-bit, full scale 2²³.
    TwentyFour,
}

impl TryFrom<u32> for Bits {
    type Error = u32;

    fn try_from(bits: u32) -> Result<Self, u32> {
        match bits {
            16 => Ok(Self::Sixteen),
            24 => Ok(Self::TwentyFour),
            _ => Err(bits),
        }
    }
}

impl Bits {
    fn width(self) -> u32 {
        match self {
            Self::Sixteen => 16,
            Self::TwentyFour => 24,
        }
    }
}

/// `samples` · `gain` as integers in the top bits of `codes`, which has the same length.
///
/// 1.0 is one step above the largest code, as is usual for such files. Values are rounded half to even and clipped to
/// the range of codes; NaN becomes 0.
///
/// ```
/// use ergon_engine::mix::pcm::{Bits, pcm};
///
/// let mut codes = [0; 2];
/// pcm(&[0.5, 7.0], 1.0, Bits::Sixteen, &mut codes);
/// assert_eq!(codes.map(|code| code >> 16), [16_384, 32_767]);
/// ```
pub fn pcm(samples: &[f64], gain: f64, bits: Bits, codes: &mut [i32]) {
    let full_scale = f64::from(1 << (bits.width() - 1));
    let code_shift = 32 - bits.width();
    for (x, code) in samples.iter().zip(codes) {
        let rounded_code = (x * gain * full_scale)
            .round_ties_even()
            .clamp(-full_scale, full_scale - 1.0);
        // `as` converts NaN to 0.
        *code = (rounded_code as i32) << code_shift;
    }
}

/// `samples` · `gain` in single precision, both of the same length; the product is computed in double precision.
pub fn single(samples: &[f64], gain: f64, singles: &mut [f32]) {
    for (x, y) in samples.iter().zip(singles) {
        *y = (x * gain) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(samples: &[f64], gain: f64, bits: Bits) -> Vec<i32> {
        let mut codes = vec![0; samples.len()];
        pcm(samples, gain, bits, &mut codes);
        let code_shift = 32 - bits.width();
        assert!(codes.iter().all(|c| c.trailing_zeros() >= code_shift), "left-aligned");
        codes.iter().map(|c| c >> code_shift).collect()
    }

    #[test]
    fn codes_round_half_to_even() {
        let code_step = 1.0 / 32_768.0;
        let tie_samples = [0.5, 1.5, 2.5, -0.5, -1.5, -2.5, 2.500_000_1].map(|x| x * code_step);
        assert_eq!(codes(&tie_samples, 1.0, Bits::Sixteen), [0, 2, 2, 0, -2, -2, 3]);
        let tie_samples = [0.5, 1.5, -2.5].map(|x| x / 8_388_608.0);
        assert_eq!(codes(&tie_samples, 1.0, Bits::TwentyFour), [0, 2, -2]);
    }

    #[test]
    fn codes_clip_at_the_last_values() {
        let loud_samples = [
            1.0,
            -1.0,
            0.999_99,
            7.0,
            -7.0,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
        ];
        let top_code = 32_767;
        let expected_codes = [top_code, -32_768, top_code, top_code, -32_768, top_code, -32_768, 0];
        assert_eq!(codes(&loud_samples, 1.0, Bits::Sixteen), expected_codes);
        assert_eq!(codes(&[0.5, -0.25], 2.0, Bits::TwentyFour), [8_388_607, -4_194_304]);
    }

    #[test]
    fn bits_from_16_24_and_other_widths() {
        assert_eq!(
            (Bits::try_from(16), Bits::try_from(24)),
            (Ok(Bits::Sixteen), Ok(Bits::TwentyFour))
        );
        assert_eq!(Bits::try_from(32), Err(32));
    }

    #[test]
    fn single_rounds_once_after_scaling() {
        let mut single_samples = [0.0f32; 3];
        single(&[0.1, 1.0 / 3.0, -2.0], 3.0, &mut single_samples);
        assert_eq!(single_samples, [(0.1 * 3.0) as f32, 1.0, -6.0]);
    }
}
