//! The exact flow of slow masses, as kicks once every R frames and straight ways between them (E4).
//!
//! Let E = [[a, b], [c, d]] take positions and velocities of the slow masses, alone, R frames on. Split as half a
//! kick, a straight way and half a kick so that it stays exact, and with the half kicks that meet taken together,
//! it reads v ← B·v − A·x, x += R·v, with B = b·d·b⁻¹·a − b·c and A = −((a − 1) + b·c + b·d·b⁻¹·(1 − a))/R.
//! What is not slow kicks the same velocities at any frame between. Velocities are in metres a frame.

use super::square::Square;

/// B and A of some masses.
#[derive(Clone, Debug)]
pub(crate) struct Flow {
    /// Frames between two kicks.
    pub(crate) every: u32,
    /// What a kick leaves of the velocities, and what it takes from them for where the masses are   (n, n)
    pub(crate) keep: Square,
    pub(crate) pull: Square,
    /// (a − 1)/R and b/R: the velocity of the first straight way
    start: [Square; 2],
}

impl Flow {
    /// Of masses with M⁻¹K and M⁻¹Z in units of a frame. `is_discrete`: the CA network itself, R frames of it;
    /// else its continuous motion. `None` where a mode swings as often as every other kick.
    pub(crate) fn new(k: &Square, z: &Square, every: u32, is_discrete: bool) -> Option<Self> {
        let n = k.n;
        let steps = f64::from(every);
        let mut one_frame = Square::zero(2 * n);
        for column in 0..n {
            for row in 0..n {
                let own = if row == column { 1.0 } else { 0.0 };
                let (k, z) = (k.get(row, column), z.get(row, column));
                let [a, b, c, d] = if is_discrete {
                    [own - k, own - z, -k, own - z]
                } else {
                    [0.0, own, -k, -z]
                };
                *one_frame.at(row, column) = a;
                *one_frame.at(row, n + column) = b;
                *one_frame.at(n + row, column) = c;
                *one_frame.at(n + row, n + column) = d;
            }
        }
        let whole = if is_discrete {
            one_frame.power(every)
        } else {
            one_frame.scaled(steps).exponential()
        };
        let [a, b] = [whole.block(0, 0, n), whole.block(0, n, n)];
        let [c, d] = [whole.block(n, 0, n), whole.block(n, n, n)];
        let turned = b.times(&d).over(&b)?;
        let moved = a.plus(&Square::one(n), -1.0);
        let bc = b.times(&c);
        // b·d·b⁻¹·a = b·d·b⁻¹ + b·d·b⁻¹·(a − 1): a − 1 is small, and keeps its digits.
        let turned_moved = turned.times(&moved);
        let keep = turned.plus(&turned_moved, 1.0).plus(&bc, -1.0);
        let pull = moved.clone().plus(&bc, 1.0).plus(&turned_moved, -1.0);
        Some(Self {
            every,
            keep,
            pull: pull.scaled(-1.0 / steps),
            start: [moved.scaled(1.0 / steps), b.scaled(1.0 / steps)],
        })
    }

    /// The velocity of the first straight way, from where the masses are and how they move.
    pub(crate) fn start(&self, x: &[f64], v: &[f64]) -> Vec<f64> {
        let [by_x, by_v] = &self.start;
        let pairs = by_x.apply(x).into_iter().zip(by_v.apply(v));
        pairs.map(|(from_x, from_v)| from_x + from_v).collect()
    }
}
