//! Anderson mixing: the next guess of an iteration whose rounds converge slowly, from its last rounds. If a round is
//! affine, as it is while all friction holds, there are about as many rounds as independent forces (Anderson 1965;
//! Walker & Ni 2011, "Anderson acceleration for fixed-point iterations", equation 2.1).

/// Most rounds before the last that are combined.
const COMBINED_MAX: usize = 6;
/// A round is left out if its difference from the last is a combination of later ones, up to this share.
const DEPENDENT_SHARE: f64 = 1e-8;
/// After so many guesses that made things worse there are no more.
const FAILURES_MAX: usize = 4;

/// The last rounds of an iteration over `n` values.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mixing {
    n: usize,
    /// Values after each round, and their change in it: the last round first   (COMBINED_MAX + 1, n)
    values: Vec<f64>,
    changes: Vec<f64>,
    /// Orthonormal differences of changes, and the differences of values that belong to them   (COMBINED_MAX, n)
    directions: Vec<f64>,
    steps: Vec<f64>,
    /// (n)
    guess: Vec<f64>,
    n_rounds: usize,
    n_failures: usize,
    /// Square of the last change.
    size: f64,
}

impl Mixing {
    /// Room for `n_max` values.
    pub(crate) fn new(n_max: usize) -> Self {
        Self {
            n: 0,
            values: vec![0.0; (COMBINED_MAX + 1) * n_max],
            changes: vec![0.0; (COMBINED_MAX + 1) * n_max],
            directions: vec![0.0; COMBINED_MAX * n_max],
            steps: vec![0.0; COMBINED_MAX * n_max],
            guess: vec![0.0; n_max],
            ..Self::default()
        }
    }

    /// Begin with the iteration of another frame, over `n` values.
    pub(crate) fn start(&mut self, n: usize) {
        (self.n, self.n_rounds, self.n_failures) = (n, 0, 0);
        self.size = f64::INFINITY;
    }

    /// Make room for a round.
    pub(crate) fn next_round(&mut self) {
        let n_retained = self.n_rounds.min(COMBINED_MAX) * self.n;
        self.values.copy_within(..n_retained, self.n);
        self.changes.copy_within(..n_retained, self.n);
        self.n_rounds += 1;
    }

    /// Record what the round made of a value.
    pub(crate) fn record(&mut self, index: usize, before: f64, after: f64) {
        self.values[index] = after;
        self.changes[index] = after - before;
    }

    /// The values to begin the next round with   (n)
    pub(crate) fn guess(&mut self) -> &[f64] {
        let value_count = self.n;
        let squared_change = dot(&self.changes[..value_count], &self.changes[..value_count]);
        if squared_change > self.size {
            // The last guess made things worse: rounds are not affine here.
            (self.n_rounds, self.n_failures) = (1, self.n_failures + 1);
        }
        self.size = squared_change;
        self.guess[..value_count].copy_from_slice(&self.values[..value_count]);
        if self.n_failures < FAILURES_MAX {
            self.combine();
        }
        &self.guess[..value_count]
    }

    /// Subtract from the guess what makes its change as small as the last rounds can tell, by modified Gram-Schmidt.
    fn combine(&mut self) {
        let value_count = self.n;
        let (values, earlier_values) = self.values.split_at(value_count);
        let (last_change, earlier_changes) = self.changes.split_at(value_count);
        let mut n_directions = 0;
        for round in 0..(self.n_rounds - 1).min(COMBINED_MAX) {
            let used_length = n_directions * value_count;
            let (other_directions, direction) = self.directions.split_at_mut(used_length);
            let (other_steps, value_step) = self.steps.split_at_mut(used_length);
            let (direction, value_step) = (&mut direction[..value_count], &mut value_step[..value_count]);
            let earlier = round * value_count..(round + 1) * value_count;
            subtract(direction, last_change, &earlier_changes[earlier.clone()]);
            subtract(value_step, values, &earlier_values[earlier]);
            let squared_before = dot(direction, direction);
            for (other, other_step) in other_directions
                .chunks(value_count)
                .zip(other_steps.chunks(value_count))
            {
                let projection = dot(other, direction);
                add(direction, -projection, other);
                add(value_step, -projection, other_step);
            }
            let squared_length = dot(direction, direction);
            if squared_length > DEPENDENT_SHARE * DEPENDENT_SHARE * squared_before {
                let normaliser = 1.0 / squared_length.sqrt();
                direction.iter_mut().for_each(|x| *x *= normaliser);
                value_step.iter_mut().for_each(|x| *x *= normaliser);
                let projection = dot(direction, last_change);
                add(&mut self.guess[..value_count], -projection, value_step);
                n_directions += 1;
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// a + by·b into a.
fn add(a: &mut [f64], by: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += by * b;
    }
}

/// a − b into `into`.
fn subtract(into: &mut [f64], a: &[f64], b: &[f64]) {
    for ((into, a), b) in into.iter_mut().zip(a).zip(b) {
        *into = a - b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixing_solves_an_affine_iteration_in_few_rounds() {
        // Gauss-Seidel on a chain of springs, whose plain rounds reduce an error by 0.93.
        const N: usize = 5;
        let right_side = [1.0, -2.0, 0.5, 3.0, 0.1];
        let mut solution = [0.0; N];
        let mut mixing = Mixing::new(N);
        mixing.start(N);
        let mut changes = Vec::new();
        for _ in 0..N + 2 {
            mixing.next_round();
            let mut greatest_change = 0.0_f64;
            for index in 0..N {
                let neighbour_sum =
                    if index > 0 { solution[index - 1] } else { 0.0 } + solution.get(index + 1).unwrap_or(&0.0);
                let updated = (right_side[index] + neighbour_sum) / 2.05;
                mixing.record(index, solution[index], updated);
                greatest_change = greatest_change.max((updated - solution[index]).abs());
                solution[index] = updated;
            }
            changes.push(greatest_change);
            solution.copy_from_slice(mixing.guess());
        }
        assert!(changes[1] > 0.1 && changes[N + 1] < 1e-12, "{changes:?}");
    }

    #[test]
    fn mixing_after_failures_guesses_plainly() {
        let mut mixing = Mixing::new(1);
        mixing.start(1);
        // Changes that grow, whatever is guessed.
        for round in 0..10 {
            mixing.next_round();
            let value_after = (1 << round) as f64;
            mixing.record(0, 0.0, value_after);
            let is_plain = mixing.guess() == [value_after];
            assert!(is_plain || round < FAILURES_MAX + 1);
        }
    }
}
