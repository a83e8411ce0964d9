//! The engine's loops for a mesh (`kernel/springs.rs`, `kernel/mats.rs`), for f64 or, with `--cfg single`, for f32.
//!
//! A copy: the engine has no single precision. `benches/precision.py` holds the copy to the engine's samples, and times
//! the copy in f64 beside the engine.

use std::slice::{from_raw_parts, from_raw_parts_mut};

#[cfg(single)]
type Real = f32;
#[cfg(single)]
type Bits = u32;
#[cfg(not(single))]
type Real = f64;
#[cfg(not(single))]
type Bits = u64;

/// Stiffness [N/m], cubic stiffness [N/m³], damping per step [N/m], rest [m] of all links.
type Law = [Real; 4];

/// Go on `n_frames` and listen to `n_taps` masses: `out` (n_frames, n_taps). `a`, `b` and `len`: first points and
/// length of each run (n_runs); `numbers`: w, κ, ζ and rest of each mass, one after the other (4 n).
///
/// # Safety
/// The arrays have these lengths, and the runs lie within the masses.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)]
pub unsafe extern "C" fn mesh(
    n_frames: i64,
    n: i64,
    n_runs: i64,
    a: *const i32,
    b: *const i32,
    len: *const i32,
    law: *const Real,
    numbers: *const Real,
    x: *mut Real,
    d: *mut Real,
    force: *mut Real,
    room: *mut Real,
    n_taps: i64,
    taps: *const i32,
    out: *mut Real,
) {
    let (n, n_runs, n_taps) = (n as usize, n_runs as usize, n_taps as usize);
    // SAFETY: the caller's promise.
    let (a, b, len) = unsafe {
        (
            from_raw_parts(a, n_runs),
            from_raw_parts(b, n_runs),
            from_raw_parts(len, n_runs),
        )
    };
    let runs: Vec<[usize; 3]> = (0..n_runs)
        .map(|i| [a[i] as usize, b[i] as usize, len[i] as usize])
        .collect();
    let longest = runs.iter().map(|run| run[2]).max().unwrap_or(0);
    // SAFETY: the caller's promise.
    unsafe {
        let law = *law.cast::<Law>();
        let numbers = from_raw_parts(numbers, 4 * n);
        let (x, d) = (from_raw_parts_mut(x, n), from_raw_parts_mut(d, n));
        let (force, room) = (
            from_raw_parts_mut(force, n),
            from_raw_parts_mut(room, longest),
        );
        let taps = from_raw_parts(taps, n_taps);
        let out = from_raw_parts_mut(out, n_frames as usize * n_taps);
        for listened in out.chunks_exact_mut(n_taps) {
            for (listened, &tap) in listened.iter_mut().zip(taps) {
                *listened = x[tap as usize];
            }
            if !frame(&runs, law, numbers, x, d, room, force) {
                return;
            }
        }
    }
}

macro_rules! by_width {
    ($($value:ident: $kind:ty),*) => {
        fn frame($($value: $kind),*) -> bool {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f")]
                fn avx512($($value: $kind),*) -> bool {
                    plain($($value),*)
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($value: $kind),*) -> bool {
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
by_width!(
    runs: &[[usize; 3]], law: Law, numbers: &[Real], x: &mut [Real], d: &mut [Real],
    room: &mut [Real], force: &mut [Real]
);

#[inline(always)]
fn plain(
    runs: &[[usize; 3]],
    law: Law,
    numbers: &[Real],
    x: &mut [Real],
    d: &mut [Real],
    room: &mut [Real],
    force: &mut [Real],
) -> bool {
    force.fill(0.0);
    let [k, q, z, rest] = law;
    for &[a, b, len] in runs {
        let (xa, xb, va, vb) = (
            &x[a..][..len],
            &x[b..][..len],
            &d[a..][..len],
            &d[b..][..len],
        );
        if q == 0.0 {
            spread([a, b, len], room, force, |i| {
                k * (xb[i] - xa[i] - rest) + z * (vb[i] - va[i])
            });
        } else {
            spread([a, b, len], room, force, |i| {
                let e = xb[i] - xa[i] - rest;
                k * e + q * (e * e * e) + z * (vb[i] - va[i])
            });
        }
    }
    move_all(numbers, force, x, d)
}

#[inline(always)]
fn spread(
    [a, b, len]: [usize; 3],
    room: &mut [Real],
    force: &mut [Real],
    f: impl Fn(usize) -> Real,
) {
    if b >= a + len {
        let (low, high) = force.split_at_mut(b);
        both(&mut low[a..][..len], &mut high[..len], f);
    } else if a >= b + len {
        let (low, high) = force.split_at_mut(a);
        both(&mut high[..len], &mut low[b..][..len], f);
    } else {
        let room = &mut room[..len];
        for (i, room) in room.iter_mut().enumerate() {
            *room = f(i);
        }
        for (force, f) in force[a..][..len].iter_mut().zip(&*room) {
            *force += f;
        }
        for (force, f) in force[b..][..len].iter_mut().zip(&*room) {
            *force -= f;
        }
    }
}

#[inline(always)]
fn both(fa: &mut [Real], fb: &mut [Real], f: impl Fn(usize) -> Real) {
    let n = fa.len();
    let fb = &mut fb[..n];
    for i in 0..n {
        let f = f(i);
        fa[i] += f;
        fb[i] -= f;
    }
}

#[inline(always)]
fn move_all(numbers: &[Real], force: &[Real], x: &mut [Real], d: &mut [Real]) -> bool {
    let n = force.len();
    let [w, kappa, zeta, rest] = [0, 1, 2, 3].map(|i| &numbers[i * n..][..n]);
    let (x, d) = (&mut x[..n], &mut d[..n]);
    let mut bad: Bits = 0;
    for i in 0..n {
        let step = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
        d[i] += step;
        x[i] += d[i];
        bad |= Bits::from(!(x[i].abs() <= 1e4));
    }
    bad == 0
}
