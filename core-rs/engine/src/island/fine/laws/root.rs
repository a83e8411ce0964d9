//! The zero of a function by bisection, and the inverse of a 3 × 3 matrix.

use super::{STAGES, StageMatrix};

/// Most evaluations while the interval is widened, and most bisections.
const EVALUATIONS_MAX: u64 = 64;
/// First width of the interval, relative to the value at the guess.
const FIRST_WIDTH: f64 = 0.01;

/// The zero near a guess of a function that rises at large arguments, and the number of evaluations. Returns the guess
/// if no zero is found.
pub(super) fn find_root(function: &dyn Fn(f64) -> f64, guess: f64) -> (f64, u64) {
    let guess_value = function(guess);
    let mut evaluations = 1;
    if guess_value == 0.0 || !guess_value.is_finite() {
        return (guess, evaluations);
    }
    // The zero lies in the direction of the other sign: widen the interval until the sign changes.
    let mut far_end = guess;
    let mut near_end;
    let mut widening = -FIRST_WIDTH * guess_value;
    loop {
        (near_end, far_end) = (far_end, far_end + widening);
        let far_value = function(far_end);
        evaluations += 1;
        if !far_value.is_finite() || evaluations > EVALUATIONS_MAX {
            return (guess, evaluations);
        }
        if (far_value > 0.0) != (guess_value > 0.0) {
            break;
        }
        widening *= 2.0;
    }
    for _ in 0..EVALUATIONS_MAX {
        let midpoint = 0.5 * (near_end + far_end);
        if midpoint == near_end || midpoint == far_end {
            break;
        }
        evaluations += 1;
        if (function(midpoint) > 0.0) == (guess_value > 0.0) {
            near_end = midpoint;
        } else {
            far_end = midpoint;
        }
    }
    (far_end, evaluations)
}

pub(super) fn inverse(matrix: &StageMatrix) -> StageMatrix {
    let cofactor = |row: usize, column: usize| {
        let [next_row, last_row] = [(row + 1) % 3, (row + 2) % 3];
        let [next_column, last_column] = [(column + 1) % 3, (column + 2) % 3];
        matrix[next_row][next_column] * matrix[last_row][last_column]
            - matrix[next_row][last_column] * matrix[last_row][next_column]
    };
    let determinant: f64 = (0..STAGES).map(|column| matrix[0][column] * cofactor(0, column)).sum();
    let (mut inverse, inverse_determinant) = ([[0.0; STAGES]; STAGES], 1.0 / determinant);
    for (row, row_entries) in inverse.iter_mut().enumerate() {
        for (column, entry) in row_entries.iter_mut().enumerate() {
            *entry = cofactor(column, row) * inverse_determinant;
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn root_of_steep_laws() {
        // A smooth bow whose slope at rest is 10⁴ times what Newton's method can solve.
        let bow_force = |v: f64| v * 1e4 / (1.0 + 1e8 * v * v);
        for v in [-0.3, -1e-5, 0.0, 1e-6, 0.02] {
            let force_residual = |f: f64| f - bow_force(v - 0.5 * f);
            let (force, _) = find_root(&force_residual, 0.0);
            assert!(force_residual(force).abs() < 1e-6, "{v}: {force}");
        }
        // Without a zero, the guess is returned.
        assert_eq!(find_root(&|_| 1.0, 7.0).0, 7.0);
    }
}
