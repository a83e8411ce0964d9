//! Loops compiled for several vector widths; the processor that runs them selects one.

/// Define a function that is compiled three times (baseline, AVX2, AVX-512) and selected at each call.
///
/// Every width gives the same bits: lanes are independent of each other, and Rust fuses no operations. A sum over lanes
/// would depend on the width; so each sum is written with explicit lanes.
macro_rules! wide {
    ($(#[$meta:meta])* $visible:vis fn $name:ident($($value:ident: $kind:ty),* $(,)?)
        $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        $visible fn $name($($value: $kind),*) $(-> $result)? {
            #[inline(always)]
            fn plain($($value: $kind),*) $(-> $result)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f")]
                fn avx512($($value: $kind),*) $(-> $result)? {
                    plain($($value),*)
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($value: $kind),*) $(-> $result)? {
                    plain($($value),*)
                }
                if std::arch::is_x86_feature_detected!("avx512f") {
                    // SAFETY: this processor has the feature.
                    return unsafe { avx512($($value),*) };
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: this processor has the feature.
                    return unsafe { avx2($($value),*) };
                }
            }
            plain($($value),*)
        }
    };
}
pub(crate) use wide;
