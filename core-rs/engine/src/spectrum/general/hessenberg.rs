//! Householder's reduction to Hessenberg form.

use crate::interrupt;
use crate::maths::{copysign, sqrt};
use crate::spectrum::vector::{add, dot};

/// Reduce `matrix` (n, n) to Hessenberg form; returns the product of the reflections, transposed   (n, n).
pub(super) fn reduce(matrix: &mut [f64], n: usize) -> Vec<f64> {
    let mut turned = vec![0.0; n * n];
    for i in 0..n {
        turned[i * n + i] = 1.0;
    }
    let (mut mirror, mut along) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..n.saturating_sub(2) {
        interrupt::spend(4 * n * n);
        let below = k + 1..n;
        for i in below.clone() {
            mirror[i] = matrix[i * n + k];
        }
        let reflector = &mirror[below.clone()];
        let rest = dot(&reflector[1..], &reflector[1..]);
        if rest == 0.0 {
            continue;
        }
        let first = reflector[0];
        let length = copysign(sqrt(rest + first * first), first);
        mirror[k + 1] += length;
        let scale = 2.0 / dot(&mirror[below.clone()], &mirror[below.clone()]);
        // From the left: changes the rows below k.
        along.fill(0.0);
        for i in below.clone() {
            add(mirror[i], &matrix[i * n..(i + 1) * n], &mut along);
        }
        for i in below.clone() {
            add(-scale * mirror[i], &along, &mut matrix[i * n..(i + 1) * n]);
        }
        // From the right: changes the columns beyond k.
        for i in 0..n {
            let row = &mut matrix[i * n + k + 1..(i + 1) * n];
            let by = -scale * dot(row, &mirror[below.clone()]);
            add(by, &mirror[below.clone()], row);
        }
        along.fill(0.0);
        for i in below.clone() {
            add(mirror[i], &turned[i * n..(i + 1) * n], &mut along);
        }
        for i in below {
            add(-scale * mirror[i], &along, &mut turned[i * n..(i + 1) * n]);
        }
        matrix[(k + 1) * n + k] = -length;
        for i in k + 2..n {
            matrix[i * n + k] = 0.0;
        }
    }
    turned
}
