//! The share of a piece's force with which the loop of key and piece is stable, whoever holds the key.
//!
//! The loop is linear and sampled: the key responds to a force that is held over a tick, the piece responds to the
//! position of each tick. The loop is cut at the force. Where the loop gain is real and negative, the factor that makes
//! it -1 is the border of stability (Nyquist 1932; a sampled loop of a key and a virtual scene: Colgate & Schenkel
//! 1997).

use ergon_engine::maths::{cos, exp, sin, sqrt};

use super::stiffness::Key;

/// Number of frequencies, from 0 to half the tick rate, for each tick of a response: closer than the peaks of anything
/// that rings no longer than the response.
const POINTS_PER_TICK: usize = 4;
/// Least length that a response is padded to [ticks].
const MIN_LENGTH: usize = 512;
/// Stiffness and damping of hands that may hold a key [N/m, N·s/m]: none, soft ones, firm ones.
const HANDS: [(f64, f64); 4] = [(0.0, 0.0), (100.0, 1.0), (400.0, 4.0), (1_500.0, 10.0)];

type Complex = (f64, f64);

/// The frequency response of a piece, from 0 to half the tick rate, without 0.
pub struct FrequencyResponse {
    /// Each frequency as z on the unit circle, and the force against a hand there [N/m].
    points: Vec<(Complex, Complex)>,
    is_nonzero: bool,
}

impl FrequencyResponse {
    /// The frequency response of a piece with this response (n_ticks,) [N/m]: the force against a hand that is
    /// displaced by 1 m for one tick, in that tick and after it.
    pub fn new(response: &[f64]) -> Self {
        let is_nonzero = response.iter().any(|force| *force != 0.0);
        let padded = response.len().next_power_of_two().max(MIN_LENGTH);
        let circle = unit_circle(2 * POINTS_PER_TICK * padded);
        let mut frequency_response = vec![(0.0, 0.0); circle.len()];
        for (value, force) in frequency_response.iter_mut().zip(response) {
            value.0 = *force;
        }
        if is_nonzero {
            transform(&mut frequency_response, &circle);
        }
        let half = circle.len() / 2;
        // 0 is left out because a free key drifts.
        let points = circle
            .into_iter()
            .zip(frequency_response)
            .take(half)
            .skip(1);
        Self {
            points: points.collect(),
            is_nonzero,
        }
    }

    /// Gain margin of the loop of key and piece, with a spring `k` [N/m] and a damper `z` [N·s/m] to the ground beside
    /// the piece: the factor of all forces at the border of stability; infinite if no factor makes the loop unstable.
    pub fn gain_margin(&self, key: Key, k: f64, z: f64) -> f64 {
        if !self.is_nonzero && (k, z) == (0.0, 0.0) {
            return f64::INFINITY;
        }
        let parts = HANDS.map(|hand| self.margin_held_by(hand, key, k, z / key.period));
        parts.into_iter().fold(f64::INFINITY, f64::min)
    }

    fn margin_held_by(&self, hand: (f64, f64), key: Key, k: f64, z: f64) -> f64 {
        let motion = Motion::new(key, hand);
        let mut least = f64::INFINITY;
        let mut before: Option<Complex> = None;
        for &(z_at, scene) in &self.points {
            // The damper acts on the displacement since the previous tick.
            let back = (z_at.0, -z_at.1);
            let stiffness = (scene.0 + k + z * (1.0 - back.0), scene.1 - z * back.1);
            let mut loop_gain = times(stiffness, motion.transfer(z_at));
            for _ in 0..key.delay {
                loop_gain = times(loop_gain, back);
            }
            if let Some(before) = before
                && (before.1 < 0.0) != (loop_gain.1 < 0.0)
            {
                let share = before.1 / (before.1 - loop_gain.1);
                let real = before.0 + (loop_gain.0 - before.0) * share;
                if real < 0.0 {
                    least = least.min(-1.0 / real);
                }
            }
            before = Some(loop_gain);
        }
        // At half the tick rate the loop gain is real.
        match before {
            Some((real, _)) if real < 0.0 => least.min(-1.0 / real),
            _ => least,
        }
    }
}

/// The exact motion of a key that is held by a hand, under a force that is constant over a tick: x⁺ = A·x + B·force.
struct Motion {
    a: [[f64; 2]; 2],
    b: [f64; 2],
}

impl Motion {
    fn new(key: Key, (k, z): (f64, f64)) -> Self {
        let (m, t, z) = (key.mass, key.period, key.damping + z);
        if k == 0.0 {
            let decay = exp(-z * t / m);
            let slide = (1.0 - decay) * m / z;
            let b = [(t - slide) / z, (1.0 - decay) / z];
            return Self {
                a: [[1.0, slide], [0.0, decay]],
                b,
            };
        }
        let fall = 0.5 * z / m;
        let square = k / m - fall * fall;
        let w = sqrt(square.abs());
        let (c, s) = match w * t {
            small if small < 1e-9 => (1.0, t),
            turn if square > 0.0 => (cos(turn), sin(turn) / w),
            turn => {
                let (up, down) = (exp(turn), exp(-turn));
                (0.5 * (up + down), 0.5 * (up - down) / w)
            }
        };
        let e = exp(-fall * t);
        let a = [
            [e * (c + fall * s), e * s],
            [-e * s * k / m, e * (c - fall * s)],
        ];
        Self {
            a,
            b: [(1.0 - a[0][0]) / k, -a[1][0] / k],
        }
    }

    /// Transfer function from force to position at z on the unit circle [m/N].
    fn transfer(&self, (re, im): Complex) -> Complex {
        let Self { a, b } = self;
        let numerator = (b[0] * (re - a[1][1]) + a[0][1] * b[1], b[0] * im);
        let denominator = times((re - a[0][0], im), (re - a[1][1], im));
        let denominator = (denominator.0 - a[0][1] * a[1][0], denominator.1);
        let size = denominator.0 * denominator.0 + denominator.1 * denominator.1;
        let product = times(numerator, (denominator.0, -denominator.1));
        (product.0 / size, product.1 / size)
    }
}

fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// n points evenly on the unit circle, beginning with 1.
fn unit_circle(n: usize) -> Vec<Complex> {
    let angle = |place: usize| 2.0 * std::f64::consts::PI * place as f64 / n as f64;
    (0..n)
        .map(|place| (cos(angle(place)), sin(angle(place))))
        .collect()
}

/// Σ x[j]·z⁻ʲ at all points, in their order: a radix-2 transform (Cooley & Tukey 1965).
fn transform(x: &mut [Complex], circle: &[Complex]) {
    let n = x.len();
    let bits = n.trailing_zeros();
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - bits);
        if i < j {
            x.swap(i, j);
        }
    }
    let mut len = 2;
    while len <= n {
        let step = n / len;
        for block in x.chunks_exact_mut(len) {
            let (low, high) = block.split_at_mut(len / 2);
            for (k, (low, high)) in low.iter_mut().zip(high).enumerate() {
                let (c, s) = circle[k * step];
                let far = times(*high, (c, -s));
                *high = (low.0 - far.0, low.1 - far.1);
                *low = (low.0 + far.0, low.1 + far.1);
            }
        }
        len *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_equals_the_defining_sum() {
        let circle = unit_circle(16);
        let x: Vec<f64> = (0..16).map(|i| f64::from(i * i % 7)).collect();
        let mut transformed: Vec<Complex> = x.iter().map(|&x| (x, 0.0)).collect();
        transform(&mut transformed, &circle);
        for (place, transformed) in transformed.iter().enumerate() {
            let term = |(j, x): (usize, &f64)| {
                let (c, s) = circle[place * j % 16];
                (x * c, -x * s)
            };
            let sum = x.iter().enumerate().map(term);
            let sum = sum.fold((0.0, 0.0), |sum, term| (sum.0 + term.0, sum.1 + term.1));
            assert!((sum.0 - transformed.0).abs() + (sum.1 - transformed.1).abs() < 1e-12);
        }
    }

    /// Compares with the differential equation of key and hand, integrated in very small steps.
    #[test]
    fn motion_of_a_held_key_matches_its_equation() {
        let key = Key {
            mass: 0.05,
            damping: 1.0,
            period: 1e-3,
            delay: 0,
        };
        // Free; underdamped, twice; critically damped; stiff and underdamped.
        for hand in [
            (0.0, 0.0),
            (100.0, 1.0),
            (400.0, 4.0),
            (80.0, 3.0),
            (5_000.0, 1.0),
        ] {
            let Motion { a, b } = Motion::new(key, hand);
            for (x, v, force) in [(1e-3, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 1.0)] {
                let (mut p, mut q, steps) = (x, v, 200_000);
                let dt = key.period / f64::from(steps);
                for _ in 0..steps {
                    let pull = force - hand.0 * p - (key.damping + hand.1) * q;
                    q += dt * pull / key.mass;
                    p += dt * q;
                }
                let state = [
                    a[0][0] * x + a[0][1] * v + b[0] * force,
                    a[1][0] * x + a[1][1] * v + b[1] * force,
                ];
                assert!(
                    (state[0] - p).abs() < 1e-8 && (state[1] - q).abs() < 1e-5,
                    "{hand:?}"
                );
            }
        }
    }

    /// A piece that rings: at the border the loop, simulated for long, neither grows nor decays.
    #[test]
    fn gain_margin_equals_border_of_a_played_loop() {
        let (mass, k, z, period) = (0.02, 800.0, 0.2, 1e-3);
        // A mass on a spring, coupled to the key by 4 kN/m; the response is the coupling's force, tick by tick.
        let (coupling, n) = (4e3, 2_048);
        let (mut x, mut v) = (0.0, 0.0);
        let fine = 400;
        let response: Vec<f64> = (0..n)
            .map(|tick| {
                let pulse = if tick == 0 { 1.0 } else { 0.0 };
                let mut sum = 0.0;
                for _ in 0..fine {
                    let dt = period / f64::from(fine);
                    let force = coupling * (pulse - x);
                    v += dt * (force - k * x - z * v) / mass;
                    x += dt * v;
                    sum += force;
                }
                sum / f64::from(fine)
            })
            .collect();
        for hand in HANDS {
            for delay in [0, 1] {
                let key = Key {
                    mass: 0.05,
                    damping: 1.0,
                    period,
                    delay,
                };
                let border = FrequencyResponse::new(&response).margin_held_by(hand, key, 0.0, 0.0);
                assert!(
                    grows(&response, key, hand, 1.1 * border),
                    "{hand:?} {delay} {border}"
                );
                assert!(
                    !grows(&response, key, hand, 0.9 * border),
                    "{hand:?} {delay} {border}"
                );
            }
        }
    }

    /// Whether the loop grows if a held key gets this part of the piece's force.
    fn grows(response: &[f64], key: Key, hand: (f64, f64), part: f64) -> bool {
        let Motion { a, b } = Motion::new(key, hand);
        let (mut x, mut force, mut v) = (vec![0.0], Vec::new(), 1.0);
        let mut swing = [0.0_f64; 4];
        for k in 0..4_096 {
            let responses = response.iter().take(k + 1).enumerate();
            let scene: f64 = responses.map(|(j, h)| h * x[k - j]).sum();
            force.push(-part * scene);
            let late = k.checked_sub(key.delay).map_or(0.0, |k| force[k]);
            let next = a[0][0] * x[k] + a[0][1] * v + b[0] * late;
            v = a[1][0] * x[k] + a[1][1] * v + b[1] * late;
            x.push(next);
            swing[k / 1_024] = swing[k / 1_024].max(v.abs());
        }
        !swing[3].is_finite() || swing[3] > swing[1]
    }
}
