//! Groups of oscillators over many frames, x[n+1] = a·x[n] − b·x[n−1], and their weighted sums.
//!
//! A group of 32 stays in registers from frame to frame; its sum stays in eight lanes until the last frame. The product
//! b·x[n−1] is rounded first, and a·x[n] minus it is one fused operation. This is so on every processor: with hardware
//! fma if there is one, else with the exact fma of libm (slow, with the same bytes).

/// Number of oscillators in a group.
pub(crate) const LANES: usize = 32;
/// Number of lanes of a partial sum.
pub(crate) const SUM_LANES: usize = 8;

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
pub(crate) struct LaneSum(pub(crate) [f64; SUM_LANES]);

impl LaneSum {
    pub(crate) const ZERO: Self = Self([0.0; SUM_LANES]);
}

/// Coefficients of a group.
#[derive(Clone, Debug)]
pub(crate) struct GroupCoefficients {
    pub(crate) a: Lanes,
    pub(crate) b: Lanes,
}

crate::archive::state!(GroupCoefficients { a, b });

impl GroupCoefficients {
    /// Write to `scaled` the coefficients of the group with the modulus of its poles multiplied by `modulus_factor`.
    pub(crate) fn scale_poles(&self, modulus_factor: f64, scaled: &mut Self) {
        for (scaled, coefficient) in scaled.a.0.iter_mut().zip(&self.a.0) {
            *scaled = coefficient * modulus_factor;
        }
        for (scaled, coefficient) in scaled.b.0.iter_mut().zip(&self.b.0) {
            *scaled = coefficient * (modulus_factor * modulus_factor);
        }
    }
}

/// Positions of a group.
#[derive(Clone, Debug)]
pub(crate) struct GroupMotion {
    /// x[n]
    pub(crate) positions: Lanes,
    /// x[n−1]
    pub(crate) previous_positions: Lanes,
}

crate::archive::state!(GroupMotion {
    positions,
    previous_positions
});

impl GroupMotion {
    /// Let each zero be +0. A mode above a quarter of the rate has a < 0: at rest it is −0 in every third frame, and
    /// would never be seen to rest.
    pub(crate) fn clear_signs_of_zeros(&mut self) {
        for x in self.positions.0.iter_mut().chain(&mut self.previous_positions.0) {
            *x += 0.0;
        }
    }
}

/// Advance a group by `sums.len()` frames and add its sum at each frame to `sums`.
pub(crate) fn advance_and_sum(coefficients: &GroupCoefficients, motion: &mut GroupMotion, sums: &mut [LaneSum]) {
    run_on(coefficients, motion, sums);
}

/// Advance a group by `n_frames` frames and add Σ weight·x of each output of `weights` to `sums`, (n_out · n_frames),
/// output by output.
pub(crate) fn advance_and_sum_weighted(
    coefficients: &GroupCoefficients,
    motion: &mut GroupMotion,
    weights: &[Lanes],
    n_frames: usize,
    sums: &mut [LaneSum],
    stride: usize,
) {
    weighted_on(coefficients, motion, weights, n_frames, sums, stride);
}

/// Advance a group by `n_frames` frames and add Σ weight·x of each row after each frame to `sums`, (n_rows · n_frames),
/// row by row, `stride` entries apart.
pub(crate) fn advance_and_observe(
    coefficients: &GroupCoefficients,
    motion: &mut GroupMotion,
    weights: &[Lanes],
    n_frames: usize,
    sums: &mut [LaneSum],
    stride: usize,
) {
    observe_on(coefficients, motion, weights, n_frames, sums, stride);
}

/// Generates the loops for one kind of vector: `$width` numbers in a `$vector`. Whatever the width, the sum of a group
/// has eight lanes, each (x₀ + x₈) + (x₁₆ + x₂₄).
macro_rules! loops {
    ($module:ident, $(#[$feature:meta])? $width:literal, $vector:ty, $load:expr, $store:expr,
     $add:expr, $mul:expr, $fmsub:expr, $fmadd:expr) => {
        mod $module {
            use super::{LANES, Lanes, GroupMotion, GroupCoefficients, SUM_LANES, LaneSum};
            #[allow(unused_imports)]
            #[cfg(target_arch = "x86_64")]
            use std::arch::x86_64::*;
            #[allow(unused_imports)]
            #[cfg(target_arch = "aarch64")]
            use std::arch::aarch64::*;

            type LaneVectors = [$vector; LANES / SUM_LANES];

            $(#[$feature])?
            #[inline]
            unsafe fn load(lanes: &Lanes, lane_start: usize) -> LaneVectors {
                // SAFETY: lane_start + 24 + width ≤ LANES.
                unsafe {
                    let address = lanes.0.as_ptr().add(lane_start);
                    [$load(address), $load(address.add(8)), $load(address.add(16)), $load(address.add(24))]
                }
            }

            $(#[$feature])?
            #[inline]
            unsafe fn store(lanes: &mut Lanes, lane_start: usize, vectors: LaneVectors) {
                // SAFETY: as in `load`.
                unsafe {
                    let address = lanes.0.as_mut_ptr().add(lane_start);
                    $store(address, vectors[0]);
                    $store(address.add(8), vectors[1]);
                    $store(address.add(16), vectors[2]);
                    $store(address.add(24), vectors[3]);
                }
            }

            /// x[n+1] = a·x[n] − b·x[n−1].
            $(#[$feature])?
            #[inline]
            fn next_positions(a: &LaneVectors, b: &LaneVectors, positions: &LaneVectors, previous: &LaneVectors) -> LaneVectors {
                [
                    $fmsub(a[0], positions[0], $mul(b[0], previous[0])),
                    $fmsub(a[1], positions[1], $mul(b[1], previous[1])),
                    $fmsub(a[2], positions[2], $mul(b[2], previous[2])),
                    $fmsub(a[3], positions[3], $mul(b[3], previous[3])),
                ]
            }

            $(#[$feature])?
            #[inline]
            unsafe fn add_to(sum: &mut LaneSum, lane_start: usize, value: $vector) {
                // SAFETY: lane_start + width ≤ SUM_LANES.
                unsafe {
                    let address = sum.0.as_mut_ptr().add(lane_start);
                    $store(address, $add($load(address), value));
                }
            }

            /// Add Σ w·x to a sum, lane by lane.
            $(#[$feature])?
            #[inline]
            unsafe fn add_weighted(sum: &mut LaneSum, lane_start: usize, w: &LaneVectors, x: &LaneVectors) {
                // SAFETY: lane_start + width ≤ SUM_LANES.
                unsafe {
                    let address = sum.0.as_mut_ptr().add(lane_start);
                    let low = $fmadd(w[1], x[1], $fmadd(w[0], x[0], $load(address)));
                    $store(address, $fmadd(w[3], x[3], $fmadd(w[2], x[2], low)));
                }
            }

            $(#[$feature])?
            pub(super) unsafe fn run(coefficients: &GroupCoefficients, motion: &mut GroupMotion, sums: &mut [LaneSum]) {
                for lane_start in (0..SUM_LANES).step_by($width) {
                    // SAFETY: lane starts are multiples of the width below SUM_LANES.
                    unsafe {
                        let (a, b) = (load(&coefficients.a, lane_start), load(&coefficients.b, lane_start));
                        let mut positions = load(&motion.positions, lane_start);
                        let mut previous = load(&motion.previous_positions, lane_start);
                        let mut pairs = sums.chunks_exact_mut(2);
                        for pair in &mut pairs {
                            let sum = $add($add(positions[0], positions[1]), $add(positions[2], positions[3]));
                            add_to(&mut pair[0], lane_start, sum);
                            previous = next_positions(&a, &b, &positions, &previous);
                            let sum =
                                $add($add(previous[0], previous[1]), $add(previous[2], previous[3]));
                            add_to(&mut pair[1], lane_start, sum);
                            positions = next_positions(&a, &b, &previous, &positions);
                        }
                        // After two frames the newest position is in `positions` again.
                        let (mut positions, mut previous) = (positions, previous);
                        for last_sum in pairs.into_remainder() {
                            let sum = $add($add(positions[0], positions[1]), $add(positions[2], positions[3]));
                            add_to(last_sum, lane_start, sum);
                            previous = next_positions(&a, &b, &positions, &previous);
                            std::mem::swap(&mut positions, &mut previous);
                        }
                        store(&mut motion.positions, lane_start, positions);
                        store(&mut motion.previous_positions, lane_start, previous);
                    }
                }
            }

            $(#[$feature])?
            pub(super) unsafe fn observe(
                coefficients: &GroupCoefficients,
                motion: &mut GroupMotion,
                weights: &[Lanes],
                n_frames: usize,
                sums: &mut [LaneSum],
                stride: usize,
            ) {
                // Up to three rows stay in registers beside the oscillators.
                // SAFETY: what each needs of `sums` is checked there.
                unsafe {
                    match weights {
                        [] => observe_rows(coefficients, motion, &[], n_frames, sums, stride),
                        [a] => observe_rows(coefficients, motion, &[a], n_frames, sums, stride),
                        [a, b] => observe_rows(coefficients, motion, &[a, b], n_frames, sums, stride),
                        [a, b, c] => observe_rows(coefficients, motion, &[a, b, c], n_frames, sums, stride),
                        [a, b, c, more_rows @ ..] => {
                            let initial_motion = motion.clone();
                            let (first_sums, later_sums) = sums.split_at_mut(3 * stride);
                            observe_rows(coefficients, motion, &[a, b, c], n_frames, first_sums, stride);
                            let mut motion_copy = initial_motion;
                            observe(coefficients, &mut motion_copy, more_rows, n_frames, later_sums, stride);
                        }
                    }
                }
            }

            /// [`observe`] for a number of rows known at compile time.
            $(#[$feature])?
            unsafe fn observe_rows<const ROWS: usize>(
                coefficients: &GroupCoefficients,
                motion: &mut GroupMotion,
                weights: &[&Lanes; ROWS],
                n_frames: usize,
                sums: &mut [LaneSum],
                stride: usize,
            ) {
                assert!(ROWS == 0 || sums.len() >= (ROWS - 1) * stride + n_frames);
                for lane_start in (0..SUM_LANES).step_by($width) {
                    // SAFETY: lane starts are multiples of the width below SUM_LANES; the sums are as many as is
                    // asserted.
                    unsafe {
                        let (a, b) = (load(&coefficients.a, lane_start), load(&coefficients.b, lane_start));
                        let rows = weights.map(|weights| load(weights, lane_start));
                        let mut positions = load(&motion.positions, lane_start);
                        let mut previous = load(&motion.previous_positions, lane_start);
                        let first_sum = sums.as_mut_ptr();
                        for frame in 0..n_frames {
                            let next = next_positions(&a, &b, &positions, &previous);
                            previous = positions;
                            positions = next;
                            for (row, w) in rows.iter().enumerate() {
                                add_weighted(&mut *first_sum.add(row * stride + frame), lane_start, w, &positions);
                            }
                        }
                        store(&mut motion.positions, lane_start, positions);
                        store(&mut motion.previous_positions, lane_start, previous);
                    }
                }
            }

            $(#[$feature])?
            pub(super) unsafe fn sum_weighted(
                coefficients: &GroupCoefficients,
                motion: &mut GroupMotion,
                weights: &[Lanes],
                n_frames: usize,
                sums: &mut [LaneSum],
                stride: usize,
            ) {
                for lane_start in (0..SUM_LANES).step_by($width) {
                    // SAFETY: lane starts are multiples of the width below SUM_LANES.
                    unsafe {
                        let (a, b) = (load(&coefficients.a, lane_start), load(&coefficients.b, lane_start));
                        let mut positions = load(&motion.positions, lane_start);
                        let mut previous = load(&motion.previous_positions, lane_start);
                        for frame in 0..n_frames {
                            for (out, weights) in weights.iter().enumerate() {
                                let w = load(weights, lane_start);
                                add_weighted(&mut sums[out * stride + frame], lane_start, &w, &positions);
                            }
                            let next = next_positions(&a, &b, &positions, &previous);
                            previous = positions;
                            positions = next;
                        }
                        store(&mut motion.positions, lane_start, positions);
                        store(&mut motion.previous_positions, lane_start, previous);
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
    |address: *const f64| *address,
    |address: *mut f64, value: f64| *address = value,
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
fastest!(run_on, run, coefficients: &GroupCoefficients, motion: &mut GroupMotion, sums: &mut [LaneSum]);
fastest!(
    weighted_on, sum_weighted, coefficients: &GroupCoefficients, motion: &mut GroupMotion, weights: &[Lanes],
    n_frames: usize, sums: &mut [LaneSum], stride: usize
);
fastest!(
    observe_on, observe, coefficients: &GroupCoefficients, motion: &mut GroupMotion, weights: &[Lanes],
    n_frames: usize, sums: &mut [LaneSum], stride: usize
);

/// Total of a partial sum.
pub(crate) fn lane_total(sum: &LaneSum) -> f64 {
    let sum_lanes = &sum.0;
    ((sum_lanes[0] + sum_lanes[4]) + (sum_lanes[2] + sum_lanes[6]))
        + ((sum_lanes[1] + sum_lanes[5]) + (sum_lanes[3] + sum_lanes[7]))
}

#[cfg(test)]
mod tests;
