//! Loops compiled for several vector widths; the processor that runs them selects one.

/// Define a function that is compiled three times (baseline, AVX2, AVX-512) and selected at each call.
///
/// Every width gives the same bits: lanes are independent of each other, and Rust fuses no operations. A sum over lanes
/// would depend on the width; so each sum is written with explicit lanes.
macro_rules! wide {
    ($($function:tt)*) => {
        $crate::maths::wide::compiled! { ["avx512f" "avx2"] $($function)* }
    };
}
pub(crate) use wide;

/// The same without AVX-512, for loops that read from memory what they have just written: a processor that writes such
/// a vector in two halves is slow at that (AMD EPYC: a law takes twice the time).
macro_rules! half_wide {
    ($($function:tt)*) => {
        $crate::maths::wide::compiled! { ["avx2"] $($function)* }
    };
}
pub(crate) use half_wide;

/// Define a function that is compiled for the baseline and for each of some features, the best first.
macro_rules! compiled {
    ($features:tt $(#[$meta:meta])* $visible:vis fn $name:ident($($value:ident: $kind:ty),* $(,)?)
        $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        $visible fn $name($($value: $kind),*) $(-> $result)? {
            #[inline(always)]
            fn plain($($value: $kind),*) $(-> $result)? $body
            $crate::maths::wide::on! { $features ($($value: $kind),*) $(-> $result)? }
            plain($($value),*)
        }
    };
}
pub(crate) use compiled;

/// Return the result of `plain`, compiled for the first of some features that the processor has.
macro_rules! on {
    ([] $($signature:tt)*) => {};
    ([$feature:tt $($others:tt)*] ($($value:ident: $kind:ty),*) $(-> $result:ty)?) => {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = $feature)]
            fn compiled($($value: $kind),*) $(-> $result)? {
                plain($($value),*)
            }
            if std::arch::is_x86_feature_detected!($feature) {
                // SAFETY: this processor has the feature.
                return unsafe { compiled($($value),*) };
            }
        }
        $crate::maths::wide::on! { [$($others)*] ($($value: $kind),*) $(-> $result)? }
    };
}
pub(crate) use on;
