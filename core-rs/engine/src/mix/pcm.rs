//! Conversion of samples to the formats of files.

use crate::maths::wide::wide;

/// Width of an integer sample.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum SampleWidth {
    /// 16-bit, full scale 2¹⁵.
    Sixteen,
    /// 24-bit, full scale 2²³.
    TwentyFour,
}

impl TryFrom<u32> for SampleWidth {
    type Error = u32;

    fn try_from(bits: u32) -> Result<Self, u32> {
        match bits {
            16 => Ok(Self::Sixteen),
            24 => Ok(Self::TwentyFour),
            _ => Err(bits),
        }
    }
}

impl SampleWidth {
    fn bits(self) -> u32 {
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
/// use ergon_engine::mix::pcm::{SampleWidth, pcm};
///
/// let mut codes = [0; 2];
/// pcm(&[0.5, 7.0], 1.0, SampleWidth::Sixteen, &mut codes);
/// assert_eq!(codes.map(|code| code >> 16), [16_384, 32_767]);
/// ```
pub fn pcm(samples: &[f64], gain: f64, bits: SampleWidth, codes: &mut [i32]) {
    let full_scale = f64::from(1 << (bits.bits() - 1));
    round_all(samples, (gain, full_scale, 32 - bits.bits()), codes);
}

wide! {
    #[allow(clippy::needless_range_loop)] // closures would be compiled for the baseline, and called
    fn round_all(samples: &[f64], scales: (f64, f64, u32), codes: &mut [i32]) {
        let (gain, full_scale, code_shift) = scales;
        let codes = &mut codes[..samples.len()];
        for index in 0..samples.len() {
            let rounded_code = (samples[index] * gain * full_scale).round_ties_even();
            // Not `clamp`, whose check of its bounds is in the way of vectors. `as` converts NaN to 0.
            let limited_code = if rounded_code > full_scale - 1.0 { full_scale - 1.0 } else { rounded_code };
            let clipped_code = if limited_code < -full_scale { -full_scale } else { limited_code };
            codes[index] = (clipped_code as i32) << code_shift;
        }
    }
}

/// The top `width` bytes (1 to 4) of each code, the lowest first, as files hold them   (n_codes · `width`).
///
/// ```
/// use ergon_engine::mix::pcm::pack;
///
/// let mut packed = [0; 6];
/// pack(&[0x0102_0300, -0x100], 3, &mut packed);
/// assert_eq!(packed, [3, 2, 1, 255, 255, 255]);
/// ```
pub fn pack(codes: &[i32], width: usize, packed: &mut [u8]) {
    match width {
        // Known widths are copied in registers.
        2 => pack_known::<2>(codes, packed),
        3 => pack_known::<3>(codes, packed),
        4 => pack_known::<4>(codes, packed),
        _ => pack_known::<1>(codes, packed),
    }
}

fn pack_known<const WIDTH: usize>(codes: &[i32], packed: &mut [u8]) {
    let (places, _) = packed.as_chunks_mut::<WIDTH>();
    for (code, place) in codes.iter().zip(places) {
        place.copy_from_slice(&code.to_le_bytes()[4 - WIDTH..]);
    }
}

/// `samples` · `gain` in single precision, both of the same length; the product is computed in double precision.
pub fn to_single(samples: &[f64], gain: f64, singles: &mut [f32]) {
    for (x, y) in samples.iter().zip(singles) {
        *y = (x * gain) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(samples: &[f64], gain: f64, bits: SampleWidth) -> Vec<i32> {
        let mut codes = vec![0; samples.len()];
        pcm(samples, gain, bits, &mut codes);
        let code_shift = 32 - bits.bits();
        assert!(codes.iter().all(|c| c.trailing_zeros() >= code_shift), "left-aligned");
        codes.iter().map(|c| c >> code_shift).collect()
    }

    #[test]
    fn codes_round_half_to_even() {
        let code_step = 1.0 / 32_768.0;
        let tie_samples = [0.5, 1.5, 2.5, -0.5, -1.5, -2.5, 2.500_000_1].map(|x| x * code_step);
        assert_eq!(codes(&tie_samples, 1.0, SampleWidth::Sixteen), [0, 2, 2, 0, -2, -2, 3]);
        let tie_samples = [0.5, 1.5, -2.5].map(|x| x / 8_388_608.0);
        assert_eq!(codes(&tie_samples, 1.0, SampleWidth::TwentyFour), [0, 2, -2]);
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
        assert_eq!(codes(&loud_samples, 1.0, SampleWidth::Sixteen), expected_codes);
        assert_eq!(
            codes(&[0.5, -0.25], 2.0, SampleWidth::TwentyFour),
            [8_388_607, -4_194_304]
        );
    }

    #[test]
    fn pack_of_each_width() {
        let codes = [0x0102_0304, -2];
        for (width, expected_bytes) in [
            (1, &[1, 255][..]),
            (2, &[2, 1, 255, 255]),
            (3, &[3, 2, 1, 255, 255, 255]),
            (4, &[4, 3, 2, 1, 254, 255, 255, 255]),
        ] {
            let mut packed = vec![0; 2 * width];
            pack(&codes, width, &mut packed);
            assert_eq!(packed, expected_bytes);
        }
    }

    #[test]
    fn bits_from_16_24_and_other_widths() {
        assert_eq!(
            (SampleWidth::try_from(16), SampleWidth::try_from(24)),
            (Ok(SampleWidth::Sixteen), Ok(SampleWidth::TwentyFour))
        );
        assert_eq!(SampleWidth::try_from(32), Err(32));
    }

    #[test]
    fn single_rounds_once_after_scaling() {
        let mut single_samples = [0.0f32; 3];
        to_single(&[0.1, 1.0 / 3.0, -2.0], 3.0, &mut single_samples);
        assert_eq!(single_samples, [(0.1 * 3.0) as f32, 1.0, -6.0]);
    }
}
