//! Groups of oscillators over many frames, x[n+1] = a·x[n] − b·x[n−1], and their weighted sums.
//!
//! A group of 32 stays in registers from frame to frame; its sum stays in eight lanes until the last frame. The product
//! b·x[n−1] is rounded first, and a·x[n] minus it is one fused operation. This is so on every processor: with hardware
//! fma if there is one, else with the exact fma of libm (slow, with the same bytes).

/// Number of oscillators in a group.
pub(crate) const LANES: usize = 32;
/// Number of lanes of a partial sum.
pub(crate) const SUMS: usize = 8;

/// One value for each oscillator of a group.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes(pub(crate) [f64; LANES]);

crate::archive::state!(Lanes { 0 });

impl Lanes {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);
}

/// Partial sum of one output at one frame, in lanes.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Sum(pub(crate) [f64; SUMS]);

impl Sum {
    pub(crate) const ZERO: Self = Self([0.0; SUMS]);
}

/// Coefficients of a group.
#[derive(Clone, Debug)]
pub(crate) struct Rates {
    pub(crate) a: Lanes,
    pub(crate) b: Lanes,
}

crate::archive::state!(Rates { a, b });

impl Rates {
    /// Write to `into` the coefficients of the group with the modulus of its poles multiplied by `by`.
    pub(crate) fn faded(&self, by: f64, into: &mut Self) {
        for (into, coefficient) in into.a.0.iter_mut().zip(&self.a.0) {
            *into = coefficient * by;
        }
        for (into, coefficient) in into.b.0.iter_mut().zip(&self.b.0) {
            *into = coefficient * (by * by);
        }
    }
}

/// Positions of a group.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// x[n]
    pub(crate) now: Lanes,
    /// x[n−1]
    pub(crate) before: Lanes,
}

crate::archive::state!(Motion { now, before });

impl Motion {
    /// Let each zero be +0. A mode above a quarter of the rate has a < 0: at rest it is −0 in every third frame, and
    /// would never be seen to rest.
    pub(crate) fn clear_signs_of_zeros(&mut self) {
        for x in self.now.0.iter_mut().chain(&mut self.before.0) {
            *x += 0.0;
        }
    }
}

/// Advance a group by `sums.len()` frames and add its sum at each frame to `sums`.
pub(crate) fn run(rates: &Rates, motion: &mut Motion, sums: &mut [Sum]) {
    run_on(rates, motion, sums);
}

/// Advance a group by `n_frames` frames and add Σ weight·x of each output of `weights` to `sums`, (n_out · n_frames),
/// output by output.
pub(crate) fn run_weighted(
    rates: &Rates,
    motion: &mut Motion,
    weights: &[Lanes],
    n_frames: usize,
    sums: &mut [Sum],
    stride: usize,
) {
    weighted_on(rates, motion, weights, n_frames, sums, stride);
}

/// Advance a group by `n_frames` frames and add Σ weight·x of each row after each frame to `sums`, (n_rows · n_frames),
/// row by row, `stride` entries apart.
pub(crate) fn follow(
    rates: &Rates,
    motion: &mut Motion,
    weights: &[Lanes],
    n_frames: usize,
    sums: &mut [Sum],
    stride: usize,
) {
    follow_on(rates, motion, weights, n_frames, sums, stride);
}

/// Generates the loops for one kind of vector: `$width` numbers in a `$vector`. Whatever the width, the sum of a group
/// has eight lanes, each (x₀ + x₈) + (x₁₆ + x₂₄).
macro_rules! loops {
    ($module:ident, $(#[$feature:meta])? $width:literal, $vector:ty, $load:expr, $store:expr,
     $add:expr, $mul:expr, $fmsub:expr, $fmadd:expr) => {
        mod $module {
            use super::{LANES, Lanes, Motion, Rates, SUMS, Sum};
            #[allow(unused_imports)]
            #[cfg(target_arch = "x86_64")]
            use std::arch::x86_64::*;
            #[allow(unused_imports)]
            #[cfg(target_arch = "aarch64")]
            use std::arch::aarch64::*;

            type Four = [$vector; LANES / SUMS];

            $(#[$feature])?
            #[inline]
            unsafe fn load(lanes: &Lanes, lane_start: usize) -> Four {
                // SAFETY: lane_start + 24 + width ≤ LANES.
                unsafe {
                    let address = lanes.0.as_ptr().add(lane_start);
                    [$load(address), $load(address.add(8)), $load(address.add(16)), $load(address.add(24))]
                }
            }

            $(#[$feature])?
            #[inline]
            unsafe fn store(lanes: &mut Lanes, lane_start: usize, four: Four) {
                // SAFETY: as in `load`.
                unsafe {
                    let address = lanes.0.as_mut_ptr().add(lane_start);
                    $store(address, four[0]);
                    $store(address.add(8), four[1]);
                    $store(address.add(16), four[2]);
                    $store(address.add(24), four[3]);
                }
            }

            /// a·now − b·before.
            $(#[$feature])?
            #[inline]
            fn next(a: &Four, b: &Four, now: &Four, before: &Four) -> Four {
                [
                    $fmsub(a[0], now[0], $mul(b[0], before[0])),
                    $fmsub(a[1], now[1], $mul(b[1], before[1])),
                    $fmsub(a[2], now[2], $mul(b[2], before[2])),
                    $fmsub(a[3], now[3], $mul(b[3], before[3])),
                ]
            }

            $(#[$feature])?
            #[inline]
            unsafe fn add_to(sum: &mut Sum, lane_start: usize, value: $vector) {
                // SAFETY: lane_start + width ≤ SUMS.
                unsafe {
                    let address = sum.0.as_mut_ptr().add(lane_start);
                    $store(address, $add($load(address), value));
                }
            }

            /// Add Σ w·x to a sum, lane by lane.
            $(#[$feature])?
            #[inline]
            unsafe fn add_weighted(sum: &mut Sum, lane_start: usize, w: &Four, x: &Four) {
                // SAFETY: lane_start + width ≤ SUMS.
                unsafe {
                    let address = sum.0.as_mut_ptr().add(lane_start);
                    let low = $fmadd(w[1], x[1], $fmadd(w[0], x[0], $load(address)));
                    $store(address, $fmadd(w[3], x[3], $fmadd(w[2], x[2], low)));
                }
            }

            $(#[$feature])?
            pub(super) unsafe fn run(rates: &Rates, motion: &mut Motion, sums: &mut [Sum]) {
                for lane_start in (0..SUMS).step_by($width) {
                    // SAFETY: lane starts are multiples of the width below SUMS.
                    unsafe {
                        let (a, b) = (load(&rates.a, lane_start), load(&rates.b, lane_start));
                        let mut now = load(&motion.now, lane_start);
                        let mut before = load(&motion.before, lane_start);
                        let mut pairs = sums.chunks_exact_mut(2);
                        for pair in &mut pairs {
                            let sum = $add($add(now[0], now[1]), $add(now[2], now[3]));
                            add_to(&mut pair[0], lane_start, sum);
                            before = next(&a, &b, &now, &before);
                            let sum =
                                $add($add(before[0], before[1]), $add(before[2], before[3]));
                            add_to(&mut pair[1], lane_start, sum);
                            now = next(&a, &b, &before, &now);
                        }
                        // After two frames the newest position is in `now` again.
                        let (mut now, mut before) = (now, before);
                        for last in pairs.into_remainder() {
                            let sum = $add($add(now[0], now[1]), $add(now[2], now[3]));
                            add_to(last, lane_start, sum);
                            before = next(&a, &b, &now, &before);
                            std::mem::swap(&mut now, &mut before);
                        }
                        store(&mut motion.now, lane_start, now);
                        store(&mut motion.before, lane_start, before);
                    }
                }
            }

            $(#[$feature])?
            pub(super) unsafe fn follow(
                rates: &Rates,
                motion: &mut Motion,
                weights: &[Lanes],
                n_frames: usize,
                sums: &mut [Sum],
                stride: usize,
            ) {
                // Up to three rows stay in registers beside the oscillators.
                // SAFETY: what each needs of `sums` is checked there.
                unsafe {
                    match weights {
                        [] => follow_rows(rates, motion, &[], n_frames, sums, stride),
                        [a] => follow_rows(rates, motion, &[a], n_frames, sums, stride),
                        [a, b] => follow_rows(rates, motion, &[a, b], n_frames, sums, stride),
                        [a, b, c] => follow_rows(rates, motion, &[a, b, c], n_frames, sums, stride),
                        [a, b, c, more_rows @ ..] => {
                            let start = motion.clone();
                            let (first, rest) = sums.split_at_mut(3 * stride);
                            follow_rows(rates, motion, &[a, b, c], n_frames, first, stride);
                            let mut motion_copy = start;
                            follow(rates, &mut motion_copy, more_rows, n_frames, rest, stride);
                        }
                    }
                }
            }

            /// [`follow`] for a number of rows known at compile time.
            $(#[$feature])?
            unsafe fn follow_rows<const ROWS: usize>(
                rates: &Rates,
                motion: &mut Motion,
                weights: &[&Lanes; ROWS],
                n_frames: usize,
                sums: &mut [Sum],
                stride: usize,
            ) {
                assert!(ROWS == 0 || sums.len() >= (ROWS - 1) * stride + n_frames);
                for lane_start in (0..SUMS).step_by($width) {
                    // SAFETY: lane starts are multiples of the width below SUMS; the sums are as many as is asserted.
                    unsafe {
                        let (a, b) = (load(&rates.a, lane_start), load(&rates.b, lane_start));
                        let rows = weights.map(|weights| load(weights, lane_start));
                        let mut now = load(&motion.now, lane_start);
                        let mut before = load(&motion.before, lane_start);
                        let first = sums.as_mut_ptr();
                        for frame in 0..n_frames {
                            let new = next(&a, &b, &now, &before);
                            before = now;
                            now = new;
                            for (row, w) in rows.iter().enumerate() {
                                add_weighted(&mut *first.add(row * stride + frame), lane_start, w, &now);
                            }
                        }
                        store(&mut motion.now, lane_start, now);
                        store(&mut motion.before, lane_start, before);
                    }
                }
            }

            $(#[$feature])?
            pub(super) unsafe fn weighted(
                rates: &Rates,
                motion: &mut Motion,
                weights: &[Lanes],
                n_frames: usize,
                sums: &mut [Sum],
                stride: usize,
            ) {
                for lane_start in (0..SUMS).step_by($width) {
                    // SAFETY: lane starts are multiples of the width below SUMS.
                    unsafe {
                        let (a, b) = (load(&rates.a, lane_start), load(&rates.b, lane_start));
                        let mut now = load(&motion.now, lane_start);
                        let mut before = load(&motion.before, lane_start);
                        for frame in 0..n_frames {
                            for (out, weights) in weights.iter().enumerate() {
                                let w = load(weights, lane_start);
                                add_weighted(&mut sums[out * stride + frame], lane_start, &w, &now);
                            }
                            let new = next(&a, &b, &now, &before);
                            before = now;
                            now = new;
                        }
                        store(&mut motion.now, lane_start, now);
                        store(&mut motion.before, lane_start, before);
                    }
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
loops!(
    avx512,
    #[target_feature(enable = "avx512f")]
    8,
    __m512d,
    _mm512_load_pd,
    _mm512_store_pd,
    _mm512_add_pd,
    _mm512_mul_pd,
    _mm512_fmsub_pd,
    _mm512_fmadd_pd
);
#[cfg(target_arch = "x86_64")]
loops!(
    avx2,
    #[target_feature(enable = "avx2,fma")]
    4,
    __m256d,
    _mm256_load_pd,
    _mm256_store_pd,
    _mm256_add_pd,
    _mm256_mul_pd,
    _mm256_fmsub_pd,
    _mm256_fmadd_pd
);
#[cfg(target_arch = "aarch64")]
loops!(
    neon,
    #[target_feature(enable = "neon")]
    2,
    float64x2_t,
    vld1q_f64,
    vst1q_f64,
    vaddq_f64,
    vmulq_f64,
    |a, b, c| vfmaq_f64(vnegq_f64(c), a, b),
    |a, b, c| vfmaq_f64(c, a, b)
);
loops!(
    plain,
    1,
    f64,
    |at: *const f64| *at,
    |at: *mut f64, value: f64| *at = value,
    |a: f64, b: f64| a + b,
    |a: f64, b: f64| a * b,
    |a: f64, b: f64, c: f64| crate::maths::fma(a, b, -c),
    crate::maths::fma
);

/// Defines a function that calls the loop for the widest vectors of this processor.
macro_rules! fastest {
    ($name:ident, $loop:ident, $($value:ident: $kind:ty),*) => {
        fn $name($($value: $kind),*) {
            #[cfg(target_arch = "x86_64")]
            {
                if std::arch::is_x86_feature_detected!("avx512f") {
                    // SAFETY: this processor has it.
                    return unsafe { avx512::$loop($($value),*) };
                }
                if std::arch::is_x86_feature_detected!("avx2")
                    && std::arch::is_x86_feature_detected!("fma")
                {
                    // SAFETY: this processor has both.
                    return unsafe { avx2::$loop($($value),*) };
                }
            }
            #[cfg(target_arch = "aarch64")]
            {
                // SAFETY: every such processor has it.
                return unsafe { neon::$loop($($value),*) };
            }
            #[allow(unreachable_code)]
            // SAFETY: it needs nothing.
            unsafe {
                plain::$loop($($value),*);
            }
        }
    };
}
fastest!(run_on, run, rates: &Rates, motion: &mut Motion, sums: &mut [Sum]);
fastest!(
    weighted_on, weighted, rates: &Rates, motion: &mut Motion, weights: &[Lanes],
    n_frames: usize, sums: &mut [Sum], stride: usize
);
fastest!(
    follow_on, follow, rates: &Rates, motion: &mut Motion, weights: &[Lanes],
    n_frames: usize, sums: &mut [Sum], stride: usize
);

/// Total of a partial sum.
pub(crate) fn lane_total(sum: &Sum) -> f64 {
    let sum_lanes = &sum.0;
    ((sum_lanes[0] + sum_lanes[4]) + (sum_lanes[2] + sum_lanes[6]))
        + ((sum_lanes[1] + sum_lanes[5]) + (sum_lanes[3] + sum_lanes[7]))
}

#[cfg(test)]
mod tests;
