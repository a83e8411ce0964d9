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
    springs: Vec<Spring>,
}

impl Springs {
    /// The matrix of some springs on `n` points.
    pub(crate) fn new(n: usize, springs: Vec<Spring>) -> Self {
        let pattern = Pattern::new(n, pairs(&springs));
        let values = values(&pattern, &springs);
        Self {
            pattern,
            values,
            springs,
        }
    }

    pub(crate) fn springs(&self) -> &[Spring] {
        &self.springs
    }

    pub(crate) fn n(&self) -> usize {
        self.pattern.n()
    }

    /// The product A x.
    pub(crate) fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut image_vector = vec![0.0; x.len()];
        self.values.times(&self.pattern, x, &mut image_vector);
        image_vector
    }

    /// xᵀ A x: twice the energy, summed over springs. The elongations of a slow mode are small, so no large numbers
    /// cancel.
    pub(crate) fn energy(&self, x: &[f64]) -> f64 {
        let spring_energy = |&((a, share), other, k): &Spring| {
            let elongation = share * x[a] - other.map_or(0.0, |(b, share)| share * x[b]);
            k * elongation * elongation
        };
        self.springs.iter().map(spring_energy).sum()
    }

    /// LDLᵀ of A − shift; the shift is raised a little if a pivot is 0 there.
    pub(crate) fn factor(&self, shift: &mut f64) -> Factor<'_, f64> {
        let shift_step = 1e-13 * f64::max(shift.abs(), 1e-3 * self.scale());
        loop {
            if let Some(factor) = Factor::new(&self.pattern, &self.values, *shift) {
                return factor;
            }
            *shift += shift_step;
        }
    }

    /// The mean absolute value of the diagonal; 1 if that is 0.
    pub(crate) fn scale(&self) -> f64 {
        let diagonal_sum: f64 = self.values.diagonal.iter().map(|x| x.abs()).sum();
        if diagonal_sum > 0.0 {
            diagonal_sum / self.n() as f64
        } else {
            1.0
        }
    }

    /// A lower bound of all eigenvalues, at most 0 (Gershgorin).
    pub(crate) fn bottom(&self) -> f64 {
        let mut row_bounds = vec![0.0; self.n()];
        for &((a, lever), other, k) in &self.springs {
            let Some((other_end, other_lever)) = other else {
                row_bounds[a] += k * lever * lever;
                continue;
            };
            let coupling = (k * lever * other_lever).abs();
            row_bounds[a] += k * lever * lever - coupling;
            row_bounds[other_end] += k * other_lever * other_lever - coupling;
        }
        row_bounds.into_iter().fold(0.0, f64::min)
    }
}

/// The ends of springs that join two points.
pub(crate) fn pairs(springs: &[Spring]) -> impl Iterator<Item = (usize, usize)> {
    springs
        .iter()
        .filter_map(|&((a, _), other, _)| other.map(|(b, _)| (a, b)))
}

/// The matrix of springs on a pattern.
pub(crate) fn values(pattern: &Pattern, springs: &[Spring]) -> Values<f64> {
    let mut values = Values::new(pattern);
    for &((a, lever), other, k) in springs {
        values.diagonal[a] += k * lever * lever;
        if let Some((other_end, other_lever)) = other {
            values.diagonal[other_end] += k * other_lever * other_lever;
            values.add(pattern, a, other_end, -k * lever * other_lever);
        }
    }
    values
}
