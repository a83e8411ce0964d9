//! Loops compiled for wide vectors as well, chosen by the processor that runs them.

/// Define a function whose loops are compiled three times (as they are, for AVX2, for AVX-512) and
/// chosen at each call.
///
/// Lanes do not depend on each other and Rust fuses no operations, so every width gives the same
/// bits; only a sum of lanes would not, and such a sum has its lanes written out.
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
                    // SAFETY: this processor has it.
                    return unsafe { avx512($($value),*) };
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: this processor has it.
                    return unsafe { avx2($($value),*) };
                }
            }
            plain($($value),*)
        }
    };
}
pub(crate) use wide;
