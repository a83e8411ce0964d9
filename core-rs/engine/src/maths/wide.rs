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
    ($features:tt $(#[$meta:meta])* $visible:vis fn $name:ident($($parameter:ident: $type:ty),* $(,)?)
        $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        $visible fn $name($($parameter: $type),*) $(-> $result)? {
            #[inline(always)]
            fn baseline($($parameter: $type),*) $(-> $result)? $body
            $crate::maths::wide::select_by_feature! { $features ($($parameter: $type),*) $(-> $result)? }
            baseline($($parameter),*)
        }
    };
}
pub(crate) use compiled;

/// Return the result of `baseline`, compiled for the first of some features that the processor has.
macro_rules! select_by_feature {
    ([] $($signature:tt)*) => {};
    ([$feature:tt $($others:tt)*] ($($parameter:ident: $type:ty),*) $(-> $result:ty)?) => {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = $feature)]
            fn with_feature($($parameter: $type),*) $(-> $result)? {
                baseline($($parameter),*)
            }
            if std::arch::is_x86_feature_detected!($feature) {
                // SAFETY: this processor has the feature.
                return unsafe { with_feature($($parameter),*) };
            }
        }
        $crate::maths::wide::select_by_feature! { [$($others)*] ($($parameter: $type),*) $(-> $result)? }
    };
}
pub(crate) use select_by_feature;
