//! A network of springs as one sparse matrix M^-½ K M^-½; also the energy of a motion, computed without cancellation.

use super::sparse::{Factor, Pattern, Values};

/// A point, and M^-½ of its mass, by which its coordinate enters an elongation.
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
        let pattern = Pattern::new(n, coupled_points(&springs));
        let values = assemble_values(&pattern, &springs);
        Self {
            pattern,
            values,
            springs,
        }
    }

    pub(crate) fn springs(&self) -> &[Spring] {
        &self.springs
    }

    pub(crate) fn dimension(&self) -> usize {
        self.pattern.dimension()
    }

    /// The product A x.
    pub(crate) fn multiply(&self, x: &[f64]) -> Vec<f64> {
        let mut image_vector = vec![0.0; x.len()];
        self.values.multiply(&self.pattern, x, &mut image_vector);
        image_vector
    }

    /// xᵀ A x: twice the energy, summed over springs. The elongations of a slow mode are small, so no large numbers
    /// cancel.
    pub(crate) fn energy(&self, x: &[f64]) -> f64 {
        let spring_energy = |&((a, inverse_sqrt_mass), other, k): &Spring| {
            let elongation =
                inverse_sqrt_mass * x[a] - other.map_or(0.0, |(b, inverse_sqrt_mass)| inverse_sqrt_mass * x[b]);
            k * elongation * elongation
        };
        self.springs.iter().map(spring_energy).sum()
    }

    /// LDLᵀ of A − shift; the shift is raised a little if a pivot is 0 there.
    pub(crate) fn factor(&self, shift: &mut f64) -> Factor<'_, f64> {
        let shift_step = 1e-13 * f64::max(shift.abs(), 1e-3 * self.mean_diagonal());
        loop {
            if let Some(factor) = Factor::new(&self.pattern, &self.values, *shift) {
                return factor;
            }
            *shift += shift_step;
        }
    }

    /// The mean absolute value of the diagonal; 1 if that is 0.
    pub(crate) fn mean_diagonal(&self) -> f64 {
        let diagonal_sum: f64 = self.values.diagonal.iter().map(|x| x.abs()).sum();
        if diagonal_sum > 0.0 {
            diagonal_sum / self.dimension() as f64
        } else {
            1.0
        }
    }

    /// A lower bound of all eigenvalues, at most 0 (Gershgorin).
    pub(crate) fn eigenvalue_lower_bound(&self) -> f64 {
        let mut row_bounds = vec![0.0; self.dimension()];
        for &((a, inverse_sqrt_mass), other, k) in &self.springs {
            let Some((other_end, other_inverse_sqrt_mass)) = other else {
                row_bounds[a] += k * inverse_sqrt_mass * inverse_sqrt_mass;
                continue;
            };
            let coupling = (k * inverse_sqrt_mass * other_inverse_sqrt_mass).abs();
            row_bounds[a] += k * inverse_sqrt_mass * inverse_sqrt_mass - coupling;
            row_bounds[other_end] += k * other_inverse_sqrt_mass * other_inverse_sqrt_mass - coupling;
        }
        row_bounds.into_iter().fold(0.0, f64::min)
    }
}

/// The ends of springs that join two points.
pub(crate) fn coupled_points(springs: &[Spring]) -> impl Iterator<Item = (usize, usize)> {
    springs
        .iter()
        .filter_map(|&((a, _), other, _)| other.map(|(b, _)| (a, b)))
}

/// The matrix of springs on a pattern.
pub(crate) fn assemble_values(pattern: &Pattern, springs: &[Spring]) -> Values<f64> {
    let mut assembled_values = Values::new(pattern);
    for &((a, inverse_sqrt_mass), other, k) in springs {
        assembled_values.diagonal[a] += k * inverse_sqrt_mass * inverse_sqrt_mass;
        if let Some((other_end, other_inverse_sqrt_mass)) = other {
            assembled_values.diagonal[other_end] += k * other_inverse_sqrt_mass * other_inverse_sqrt_mass;
            assembled_values.add(pattern, a, other_end, -k * inverse_sqrt_mass * other_inverse_sqrt_mass);
        }
    }
    assembled_values
}
