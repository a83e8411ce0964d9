//! Forces of springs and their sums in rows, by vectors of each width.
//!
//! Whatever the width, every force has the operations of [`super::total`], and every MAT the order of its sums: the
//! bits are the same. A force times 1 or −1 is exact, so a fused operation adds it as a sum would.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

use super::ForcePart;
use super::rows::{CacheLine, PADDING, Rows, RunPlace, RunTerm};
use crate::scheme::Spring;

/// A vector of numbers, at most [`PADDING`]. Only processors with its instructions may use it. Of the pointers, `WIDTH`
/// numbers are read or written, or `count`, fewer than that.
trait Vector: Copy {
    const WIDTH: usize;

    unsafe fn splat(number: f64) -> Self;
    unsafe fn load(numbers: *const f64) -> Self;
    /// Some numbers, and 0 behind them.
    unsafe fn load_first(numbers: *const f64, count: usize) -> Self;
    unsafe fn store(self, numbers: *mut f64);
    unsafe fn store_first(self, numbers: *mut f64, count: usize);
    /// The vector with 0 behind its first numbers.
    unsafe fn first_lanes(self, count: usize) -> Self;
    unsafe fn plus(self, other: Self) -> Self;
    unsafe fn minus(self, other: Self) -> Self;
    unsafe fn times(self, other: Self) -> Self;
    /// self + other·sign, for signs 1 and −1.
    unsafe fn plus_signed(self, other: Self, sign: Self) -> Self;
}

/// Implements [`Vector`] by functions in the order of its own.
macro_rules! vector {
    ($vector:ty, $width:literal, $splat:expr, $load:expr, $load_first:expr, $store:expr, $store_first:expr,
     $first:expr, $plus:expr, $minus:expr, $times:expr, $plus_signed:expr) => {
        #[allow(unused_unsafe)] // for plain numbers
        impl Vector for $vector {
            const WIDTH: usize = $width;

            #[inline(always)]
            unsafe fn splat(number: f64) -> Self {
                // SAFETY: as the trait says, here and below.
                unsafe { $splat(number) }
            }

            #[inline(always)]
            unsafe fn load(numbers: *const f64) -> Self {
                // SAFETY: see `splat`.
                unsafe { $load(numbers) }
            }

            #[inline(always)]
            unsafe fn load_first(numbers: *const f64, count: usize) -> Self {
                // SAFETY: see `splat`.
                unsafe { $load_first(numbers, count) }
            }

            #[inline(always)]
            unsafe fn store(self, numbers: *mut f64) {
                // SAFETY: see `splat`.
                unsafe { $store(numbers, self) }
            }

            #[inline(always)]
            unsafe fn store_first(self, numbers: *mut f64, count: usize) {
                // SAFETY: see `splat`.
                unsafe { $store_first(numbers, count, self) }
            }

            #[inline(always)]
            unsafe fn first_lanes(self, count: usize) -> Self {
                // SAFETY: see `splat`.
                unsafe { $first(self, count) }
            }

            #[inline(always)]
            unsafe fn plus(self, other: Self) -> Self {
                // SAFETY: see `splat`.
                unsafe { $plus(self, other) }
            }

            #[inline(always)]
            unsafe fn minus(self, other: Self) -> Self {
                // SAFETY: see `splat`.
                unsafe { $minus(self, other) }
            }

            #[inline(always)]
            unsafe fn times(self, other: Self) -> Self {
                // SAFETY: see `splat`.
                unsafe { $times(self, other) }
            }

            #[inline(always)]
            unsafe fn plus_signed(self, other: Self, sign: Self) -> Self {
                // SAFETY: see `splat`.
                unsafe { $plus_signed(other, sign, self) }
            }
        }
    };
}

/// The lowest bits of a mask, `count` of at most eight.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn low_bits(count: usize) -> u8 {
    (0xff_u32 >> (8 - count)) as u8
}

/// A mask for the first numbers of four.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn low_lanes(count: usize) -> __m256i {
    const LANES: [i64; 8] = [-1, -1, -1, -1, 0, 0, 0, 0];
    // SAFETY: as count ≤ 4, four numbers are there; AVX2 as for the vectors that use the mask.
    unsafe { _mm256_loadu_si256(LANES.as_ptr().add(4 - count).cast()) }
}

#[cfg(target_arch = "x86_64")]
vector!(
    __m512d,
    8,
    _mm512_set1_pd,
    _mm512_loadu_pd,
    |numbers, count| _mm512_maskz_loadu_pd(low_bits(count), numbers),
    _mm512_storeu_pd,
    |numbers, count, vector| _mm512_mask_storeu_pd(numbers, low_bits(count), vector),
    |vector, count| _mm512_maskz_mov_pd(low_bits(count), vector),
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_fmadd_pd
);
#[cfg(target_arch = "x86_64")]
vector!(
    __m256d,
    4,
    _mm256_set1_pd,
    _mm256_loadu_pd,
    |numbers, count| _mm256_maskload_pd(numbers, low_lanes(count)),
    _mm256_storeu_pd,
    |numbers, count, vector| _mm256_maskstore_pd(numbers, low_lanes(count), vector),
    |vector, count| _mm256_and_pd(vector, _mm256_castsi256_pd(low_lanes(count))),
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_fmadd_pd
);
vector!(
    f64,
    1,
    |number| number,
    |numbers: *const f64| *numbers,
    |_, _| 0.0, // fewer than one number
    |numbers: *mut f64, number| *numbers = number,
    |numbers: *mut f64, count, number| {
        if count == 1 {
            *numbers = number;
        }
    },
    |number, count| if count == 1 { number } else { 0.0 },
    |a: f64, b: f64| a + b,
    |a: f64, b: f64| a - b,
    |a: f64, b: f64| a * b,
    |other: f64, sign: f64, number: f64| number + other * sign
);

/// The constants of a run, each as a vector.
struct RunConstants<V> {
    k: V,
    q: V,
    z: V,
    rest: V,
}

/// The forces of links: `PART` as in [`Part`], and whether they harden.
struct ForceFormula<const PART: u8, const HARDENS: bool>;

pub(super) const ELASTIC: u8 = ForcePart::Elastic as u8;
pub(super) const VISCOUS: u8 = ForcePart::Viscous as u8;
pub(super) const TOTAL: u8 = ForcePart::Total as u8;

impl<const PART: u8, const HARDENS: bool> ForceFormula<PART, HARDENS> {
    #[inline(always)]
    unsafe fn force<V: Vector>(constants: &RunConstants<V>, [xa, xb]: [V; 2], [va, vb]: [V; 2]) -> V {
        // SAFETY: as the caller's.
        unsafe {
            let drag = constants.z.times(vb.minus(va));
            if PART == VISCOUS {
                return drag;
            }
            let e = xb.minus(xa).minus(constants.rest);
            let mut force = constants.k.times(e);
            if HARDENS {
                force = force.plus(constants.q.times(e.times(e).times(e)));
            }
            if PART == ELASTIC { force } else { force.plus(drag) }
        }
    }

    /// Write the forces of a run into `forces`, with 0 behind them up to a multiple of the width.
    #[inline(always)]
    unsafe fn write_run_forces<V: Vector>(
        place: &RunPlace,
        spring: &Spring,
        motion: [*const f64; 2],
        forces: *mut f64,
    ) {
        // SAFETY: see `set_forces`.
        unsafe {
            let constants = RunConstants {
                k: V::splat(spring.k),
                q: V::splat(spring.q),
                z: V::splat(spring.z),
                rest: V::splat(spring.rest),
            };
            let [x, v] = motion;
            let (xa, xb) = (x.add(place.a), x.add(place.b));
            let (va, vb) = (v.add(place.a), v.add(place.b));
            let forces = forces.add(place.first_force);
            let mut i = 0;
            while i + V::WIDTH <= place.len {
                let positions = [V::load(xa.add(i)), V::load(xb.add(i))];
                let velocities = [V::load(va.add(i)), V::load(vb.add(i))];
                Self::force(&constants, positions, velocities).store(forces.add(i));
                i += V::WIDTH;
            }
            let n_left = place.len - i;
            if n_left > 0 {
                let positions = [V::load_first(xa.add(i), n_left), V::load_first(xb.add(i), n_left)];
                let velocities = [V::load_first(va.add(i), n_left), V::load_first(vb.add(i), n_left)];
                let force = Self::force(&constants, positions, velocities);
                force.first_lanes(n_left).store(forces.add(i));
            }
        }
    }
}

/// Sum the terms of N vectors of MATs; `n_last` numbers of the last one are written.
#[inline(always)]
unsafe fn sum_vectors<V: Vector, const N: usize>(terms: &[RunTerm], forces: *const f64, sums: *mut f64, n_last: usize) {
    // SAFETY: see `set_forces`.
    unsafe {
        let mut mat_sums = [V::splat(0.0); N];
        for term in terms {
            let (sign, forces) = (V::splat(term.sign), forces.offset(term.shift));
            for (i, mat_sum) in mat_sums.iter_mut().enumerate() {
                *mat_sum = mat_sum.plus_signed(V::load(forces.add(i * V::WIDTH)), sign);
            }
        }
        for (i, mat_sum) in mat_sums[..N - 1].iter().enumerate() {
            mat_sum.store(sums.add(i * V::WIDTH));
        }
        mat_sums[N - 1].store_first(sums.add((N - 1) * V::WIDTH), n_last);
    }
}

#[inline(always)]
unsafe fn set_forces<V: Vector, const PART: u8>(
    rows: &Rows,
    springs: &[Spring],
    motion: [&[f64]; 2],
    forces: &mut [CacheLine],
    sums: &mut [f64],
) {
    assert!(
        springs.len() == rows.run_places.len()
            && motion.iter().all(|numbers| numbers.len() >= rows.motion_count)
            && forces.len() * PADDING >= rows.force_count
            && sums.len() == rows.mat_count
    );
    let motion = motion.map(<[f64]>::as_ptr);
    let (forces, sums) = (forces.as_mut_ptr().cast::<f64>(), sums.as_mut_ptr());
    // SAFETY: the processor has the instructions of V (the caller's duty). Places, rows and terms are those that
    // `Rows` made for arrays of the lengths that are asserted: a run reads below `motion_count` and writes less than
    // PADDING numbers behind its own, a row reads at most PADDING before and 2·PADDING behind the forces of a run.
    unsafe {
        for tile in &rows.tiles {
            let places = &rows.run_places[tile.runs.clone()];
            for (place, spring) in places.iter().zip(&springs[tile.runs.clone()]) {
                if spring.q == 0.0 {
                    ForceFormula::<PART, false>::write_run_forces::<V>(place, spring, motion, forces);
                } else {
                    ForceFormula::<PART, true>::write_run_forces::<V>(place, spring, motion, forces);
                }
            }
            for row in &rows.rows[tile.rows.clone()] {
                let terms = &rows.terms[row.terms.clone()];
                let (mut mat, mut n_left) = (row.mats.start, row.mats.len());
                while n_left > 4 * V::WIDTH {
                    sum_vectors::<V, 4>(terms, forces.wrapping_add(mat), sums.add(mat), V::WIDTH);
                    mat += 4 * V::WIDTH;
                    n_left -= 4 * V::WIDTH;
                }
                let (forces, sums) = (forces.wrapping_add(mat), sums.add(mat));
                let vectors = n_left.div_ceil(V::WIDTH);
                let n_last = n_left - (vectors - 1) * V::WIDTH;
                match vectors {
                    1 => sum_vectors::<V, 1>(terms, forces, sums, n_last),
                    2 => sum_vectors::<V, 2>(terms, forces, sums, n_last),
                    3 => sum_vectors::<V, 3>(terms, forces, sums, n_last),
                    _ => sum_vectors::<V, 4>(terms, forces, sums, n_last),
                }
            }
        }
    }
}

/// Set `force` to the sum of forces on each MAT [N], for springs in rows.
pub(super) fn forces(
    rows: &Rows,
    part: ForcePart,
    springs: &[Spring],
    motion: [&[f64]; 2],
    link_forces: &mut [CacheLine],
    force: &mut [f64],
) {
    match part {
        ForcePart::Elastic => part_forces::<ELASTIC>(rows, springs, motion, link_forces, force),
        ForcePart::Viscous => part_forces::<VISCOUS>(rows, springs, motion, link_forces, force),
        ForcePart::Total => part_forces::<TOTAL>(rows, springs, motion, link_forces, force),
    }
}

fn part_forces<const PART: u8>(
    rows: &Rows,
    springs: &[Spring],
    motion: [&[f64]; 2],
    link_forces: &mut [CacheLine],
    force: &mut [f64],
) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: this processor has it.
            return unsafe { eight_lanes::<PART>(rows, springs, motion, link_forces, force) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: this processor has both.
            return unsafe { four_lanes::<PART>(rows, springs, motion, link_forces, force) };
        }
    }
    scalar_lanes::<PART>(rows, springs, motion, link_forces, force);
}

/// Whether the processor has vectors by which rows are faster than one run after the other.
pub(super) fn are_supported() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_x86_feature_detected!("avx512f") || is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
pub(super) fn eight_lanes<const PART: u8>(
    rows: &Rows,
    springs: &[Spring],
    motion: [&[f64]; 2],
    link_forces: &mut [CacheLine],
    force: &mut [f64],
) {
    // SAFETY: the processor has the instructions.
    unsafe { set_forces::<__m512d, PART>(rows, springs, motion, link_forces, force) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
pub(super) fn four_lanes<const PART: u8>(
    rows: &Rows,
    springs: &[Spring],
    motion: [&[f64]; 2],
    link_forces: &mut [CacheLine],
    force: &mut [f64],
) {
    // SAFETY: the processor has the instructions.
    unsafe { set_forces::<__m256d, PART>(rows, springs, motion, link_forces, force) }
}

pub(super) fn scalar_lanes<const PART: u8>(
    rows: &Rows,
    springs: &[Spring],
    motion: [&[f64]; 2],
    link_forces: &mut [CacheLine],
    force: &mut [f64],
) {
    // SAFETY: every processor has the instructions.
    unsafe { set_forces::<f64, PART>(rows, springs, motion, link_forces, force) }
}
