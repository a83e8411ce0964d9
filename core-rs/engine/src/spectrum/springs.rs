//! A network of springs as one sparse matrix M^-½ K M^-½; also the energy of a motion, computed without cancellation.

use super::sparse::{Factor, Pattern, Values};

/// A point, and its factor M^-½ in an elongation.
pub(crate) type End = (usize, f64);

/// A spring or damper: one end, the other end (`None`: fixed), and the coefficient.
pub(crate) type Spring = (End, Option<End>, f64);

/// The matrix of springs.
#[derive(Debug)]
pub(crate) struct Springs {
    pub(crate) pattern: Pattern,
    pub(crate) values: Values<f64>,
    each: Vec<Spring>,
}

impl Springs {
    /// The matrix of the springs `each` on `n` points.
    pub(crate) fn new(n: usize, each: Vec<Spring>) -> Self {
        let pattern = Pattern::new(n, pairs(&each));
        let values = values(&pattern, &each);
        Self {
            pattern,
            values,
            each,
        }
    }

    pub(crate) fn each(&self) -> &[Spring] {
        &self.each
    }

    pub(crate) fn n(&self) -> usize {
        self.pattern.n()
    }

    /// The product A x.
    pub(crate) fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        self.values.times(&self.pattern, x, &mut y);
        y
    }

    /// xᵀ A x: twice the energy, summed over springs. The elongations of a slow mode are small, so no large numbers
    /// cancel.
    pub(crate) fn energy(&self, x: &[f64]) -> f64 {
        let pull = |&((a, share), other, k): &Spring| {
            let long = share * x[a] - other.map_or(0.0, |(b, share)| share * x[b]);
            k * long * long
        };
        self.each.iter().map(pull).sum()
    }

    /// LDLᵀ of A − shift; the shift is raised a little if a pivot is 0 there.
    pub(crate) fn factor(&self, shift: &mut f64) -> Factor<'_, f64> {
        let step = 1e-13 * f64::max(shift.abs(), 1e-3 * self.scale());
        loop {
            if let Some(factor) = Factor::new(&self.pattern, &self.values, *shift) {
                return factor;
            }
            *shift += step;
        }
    }

    /// The mean absolute value of the diagonal; 1 if that is 0.
    pub(crate) fn scale(&self) -> f64 {
        let sum: f64 = self.values.diagonal.iter().map(|x| x.abs()).sum();
        if sum > 0.0 {
            sum / self.n() as f64
        } else {
            1.0
        }
    }

    /// A lower bound of all eigenvalues, at most 0 (Gershgorin).
    pub(crate) fn bottom(&self) -> f64 {
        let mut least = vec![0.0; self.n()];
        for &((a, lever), other, k) in &self.each {
            let Some((b, there)) = other else {
                least[a] += k * lever * lever;
                continue;
            };
            let across = (k * lever * there).abs();
            least[a] += k * lever * lever - across;
            least[b] += k * there * there - across;
        }
        least.into_iter().fold(0.0, f64::min)
    }
}

/// The ends of springs that join two points.
pub(crate) fn pairs(each: &[Spring]) -> impl Iterator<Item = (usize, usize)> {
    each.iter()
        .filter_map(|&((a, _), other, _)| other.map(|(b, _)| (a, b)))
}

/// The matrix of springs on a pattern.
pub(crate) fn values(pattern: &Pattern, each: &[Spring]) -> Values<f64> {
    let mut values = Values::new(pattern);
    for &((a, lever), other, k) in each {
        values.diagonal[a] += k * lever * lever;
        if let Some((b, there)) = other {
            values.diagonal[b] += k * there * there;
            values.add(pattern, a, b, -k * lever * there);
        }
    }
    values
}
