//! Inner loops of IEQ over one run of links.

use crate::maths::sqrt;
use crate::maths::wide::wide;
use crate::scheme::Spring;

wide! {
    /// g, c and the explicit force of a run of springs.
    pub(super) fn set_spring_terms(
        run: &Spring,
        beta: f64,
        motion: [&[f64]; 2],
        psi: &[f64],
        outputs: [&mut [f64]; 3],
    ) {
        let ([x, d], [g, c, f]) = (motion, outputs);
        let Spring { a, b, len, k, q, z, rest, .. } = *run;
        let (xa, xb, da, db) = (&x[a..][..len], &x[b..][..len], &d[a..][..len], &d[b..][..len]);
        let (psi, g, c, f) = (&psi[..len], &mut g[..len], &mut c[..len], &mut f[..len]);
        let (slope_per_metre, constant_term, twice_beta) = (sqrt(2.0 * q), 0.5 * z + beta * k, 2.0 * beta);
        for i in 0..len {
            let e = xb[i] - xa[i] - rest;
            g[i] = slope_per_metre * e;
            c[i] = constant_term + 0.25 * (g[i] * g[i]);
            f[i] = k * (e - twice_beta * (db[i] - da[i])) + g[i] * psi[i];
        }
    }
}

wide! {
    /// Add the values of a run's links to both of their ends.
    pub(super) fn add_at_ends(c: &[f64], a: usize, b: usize, sums: &mut [f64]) {
        for (sum, c) in sums[a..][..c.len()].iter_mut().zip(c) {
            *sum += c;
        }
        for (sum, c) in sums[b..][..c.len()].iter_mut().zip(c) {
            *sum += c;
        }
    }
}

wide! {
    /// ψ += ½g·(s_b − s_a).
    pub(super) fn advance_psi_run(g: &[f64], ends: [&[f64]; 2], psi: &mut [f64]) {
        let [sa, sb] = ends;
        let n = g.len();
        let (sa, sb, psi) = (&sa[..n], &sb[..n], &mut psi[..n]);
        for i in 0..n {
            psi[i] += 0.5 * g[i] * (sb[i] - sa[i]);
        }
    }
}
