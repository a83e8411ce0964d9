//! The share of a piece's force with which the loop of key and piece is stable, whoever holds the key.
//!
//! The loop is linear and sampled: the key responds to a force that is held over a tick, the piece responds to the
//! position of each tick. The loop is cut at the force. Where the loop gain is real and negative, the factor that makes
//! it -1 is the border of stability (Nyquist 1932; a sampled loop of a key and a virtual scene: Colgate & Schenkel
//! 1997).

use ergon_engine::maths::{cos, exp, sin, sqrt};

use super::stiffness::HapticLoop;

/// Number of frequencies, from 0 to half the tick rate, for each tick of a response: closer than the peaks of anything
/// that rings no longer than the response.
const POINTS_PER_TICK: usize = 4;
/// Least length that a response is padded to [ticks].
const LENGTH_MIN: usize = 512;
/// Stiffness and damping of hands that may hold a key [N/m, N·s/m]: none, soft ones, firm ones.
const HAND_SPRING_DAMPERS: [(f64, f64); 4] = [(0.0, 0.0), (100.0, 1.0), (400.0, 4.0), (1_500.0, 10.0)];

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
        let padded_length = response.len().next_power_of_two().max(LENGTH_MIN);
        let circle_points = unit_circle(2 * POINTS_PER_TICK * padded_length);
        let mut frequency_response = vec![(0.0, 0.0); circle_points.len()];
        for (sample, force) in frequency_response.iter_mut().zip(response) {
            sample.0 = *force;
        }
        if is_nonzero {
            fourier_transform(&mut frequency_response, &circle_points);
        }
        let half_length = circle_points.len() / 2;
        // 0 is left out because a free key drifts.
        let response_points = circle_points
            .into_iter()
            .zip(frequency_response)
            .take(half_length)
            .skip(1);
        Self {
            points: response_points.collect(),
            is_nonzero,
        }
    }

    /// Gain margin of the loop of key and piece, with a spring `k` [N/m] and a damper `z` [N·s/m] to the ground beside
    /// the piece: the factor of all forces at the border of stability; infinite if no factor makes the loop unstable.
    pub fn gain_margin(&self, key: HapticLoop, k: f64, z: f64) -> f64 {
        if !self.is_nonzero && (k, z) == (0.0, 0.0) {
            return f64::INFINITY;
        }
        let hand_margins = HAND_SPRING_DAMPERS.map(|hand| self.held_margin(hand, key, k, z / key.tick_period));
        hand_margins.into_iter().fold(f64::INFINITY, f64::min)
    }

    fn held_margin(&self, hand: (f64, f64), key: HapticLoop, k: f64, z: f64) -> f64 {
        let key_motion = HeldKeyMotion::new(key, hand);
        let mut least_margin = f64::INFINITY;
        let mut previous_gain: Option<Complex> = None;
        for &(circle_point, piece_response) in &self.points {
            // The damper acts on the displacement since the previous tick.
            let unit_delay = (circle_point.0, -circle_point.1);
            let stiffness = (
                piece_response.0 + k + z * (1.0 - unit_delay.0),
                piece_response.1 - z * unit_delay.1,
            );
            let mut loop_gain = multiply(stiffness, key_motion.transfer(circle_point));
            for _ in 0..key.delay_ticks {
                loop_gain = multiply(loop_gain, unit_delay);
            }
            if let Some(previous_gain) = previous_gain
                && (previous_gain.1 < 0.0) != (loop_gain.1 < 0.0)
            {
                let crossing_share = previous_gain.1 / (previous_gain.1 - loop_gain.1);
                let real_gain = previous_gain.0 + (loop_gain.0 - previous_gain.0) * crossing_share;
                if real_gain < 0.0 {
                    least_margin = least_margin.min(-1.0 / real_gain);
                }
            }
            previous_gain = Some(loop_gain);
        }
        // At half the tick rate the loop gain is real.
        match previous_gain {
            Some((real_gain, _)) if real_gain < 0.0 => least_margin.min(-1.0 / real_gain),
            _ => least_margin,
        }
    }
}

/// The exact motion of a key that is held by a hand, under a force that is constant over a tick: x⁺ = A·x + B·force.
struct HeldKeyMotion {
    state_matrix: [[f64; 2]; 2],
    input_vector: [f64; 2],
}

impl HeldKeyMotion {
    fn new(key: HapticLoop, (k, z): (f64, f64)) -> Self {
        let (m, t, z) = (key.mass, key.tick_period, key.damping + z);
        if k == 0.0 {
            let velocity_decay = exp(-z * t / m);
            let slide_time = (1.0 - velocity_decay) * m / z;
            let b = [(t - slide_time) / z, (1.0 - velocity_decay) / z];
            return Self {
                state_matrix: [[1.0, slide_time], [0.0, velocity_decay]],
                input_vector: b,
            };
        }
        let decay_rate = 0.5 * z / m;
        let squared_omega = k / m - decay_rate * decay_rate;
        let damped_rate = sqrt(squared_omega.abs());
        let (cosine_term, sine_term) = match damped_rate * t {
            small_angle if small_angle < 1e-9 => (1.0, t),
            scaled_time if squared_omega > 0.0 => (cos(scaled_time), sin(scaled_time) / damped_rate),
            scaled_time => {
                let (growing_exp, fading_exp) = (exp(scaled_time), exp(-scaled_time));
                (
                    0.5 * (growing_exp + fading_exp),
                    0.5 * (growing_exp - fading_exp) / damped_rate,
                )
            }
        };
        let envelope = exp(-decay_rate * t);
        let a = [
            [envelope * (cosine_term + decay_rate * sine_term), envelope * sine_term],
            [
                -envelope * sine_term * k / m,
                envelope * (cosine_term - decay_rate * sine_term),
            ],
        ];
        Self {
            state_matrix: a,
            input_vector: [(1.0 - a[0][0]) / k, -a[1][0] / k],
        }
    }

    /// Transfer function from force to position at z on the unit circle [m/N].
    fn transfer(&self, (re, im): Complex) -> Complex {
        let Self {
            state_matrix: a,
            input_vector: b,
        } = self;
        let numerator = (b[0] * (re - a[1][1]) + a[0][1] * b[1], b[0] * im);
        let denominator = multiply((re - a[0][0], im), (re - a[1][1], im));
        let denominator = (denominator.0 - a[0][1] * a[1][0], denominator.1);
        let squared_norm = denominator.0 * denominator.0 + denominator.1 * denominator.1;
        let product = multiply(numerator, (denominator.0, -denominator.1));
        (product.0 / squared_norm, product.1 / squared_norm)
    }
}

fn multiply(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// n points evenly on the unit circle, beginning with 1.
fn unit_circle(n: usize) -> Vec<Complex> {
    let angle_of = |point_index: usize| 2.0 * std::f64::consts::PI * point_index as f64 / n as f64;
    (0..n)
        .map(|point_index| (cos(angle_of(point_index)), sin(angle_of(point_index))))
        .collect()
}

/// Σ x[j]·z⁻ʲ at all points, in their order: a radix-2 transform (Cooley & Tukey 1965).
fn fourier_transform(x: &mut [Complex], circle: &[Complex]) {
    let point_count = x.len();
    let index_bits = point_count.trailing_zeros();
    for i in 0..point_count {
        let reversed_index = i.reverse_bits() >> (usize::BITS - index_bits);
        if i < reversed_index {
            x.swap(i, reversed_index);
        }
    }
    let mut block_length = 2;
    while block_length <= point_count {
        let circle_step = point_count / block_length;
        for block in x.chunks_exact_mut(block_length) {
            let (low, high) = block.split_at_mut(block_length / 2);
            for (k, (low, high)) in low.iter_mut().zip(high).enumerate() {
                let (c, s) = circle[k * circle_step];
                let rotated = multiply(*high, (c, -s));
                *high = (low.0 - rotated.0, low.1 - rotated.1);
                *low = (low.0 + rotated.0, low.1 + rotated.1);
            }
        }
        block_length *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_equals_the_defining_sum() {
        let circle_points = unit_circle(16);
        let x: Vec<f64> = (0..16).map(|i| f64::from(i * i % 7)).collect();
        let mut transformed: Vec<Complex> = x.iter().map(|&x| (x, 0.0)).collect();
        fourier_transform(&mut transformed, &circle_points);
        for (point_index, transformed) in transformed.iter().enumerate() {
            let term = |(j, x): (usize, &f64)| {
                let (c, s) = circle_points[point_index * j % 16];
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
        let held_key = HapticLoop {
            mass: 0.05,
            damping: 1.0,
            tick_period: 1e-3,
            delay_ticks: 0,
        };
        // Free; underdamped, twice; critically damped; stiff and underdamped.
        for hand in [(0.0, 0.0), (100.0, 1.0), (400.0, 4.0), (80.0, 3.0), (5_000.0, 1.0)] {
            let HeldKeyMotion {
                state_matrix: a,
                input_vector: b,
            } = HeldKeyMotion::new(held_key, hand);
            for (x, v, force) in [(1e-3, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 1.0)] {
                let (mut fine_position, mut fine_velocity, step_count) = (x, v, 200_000);
                let dt = held_key.tick_period / f64::from(step_count);
                for _ in 0..step_count {
                    let net_force = force - hand.0 * fine_position - (held_key.damping + hand.1) * fine_velocity;
                    fine_velocity += dt * net_force / held_key.mass;
                    fine_position += dt * fine_velocity;
                }
                let exact_state = [
                    a[0][0] * x + a[0][1] * v + b[0] * force,
                    a[1][0] * x + a[1][1] * v + b[1] * force,
                ];
                assert!(
                    (exact_state[0] - fine_position).abs() < 1e-8 && (exact_state[1] - fine_velocity).abs() < 1e-5,
                    "{hand:?}"
                );
            }
        }
    }

    /// A piece that rings: at the border the loop, simulated for long, neither grows nor decays.
    #[test]
    fn gain_margin_equals_border_of_a_played_loop() {
        let (ringing_mass, k, z, period) = (0.02, 800.0, 0.2, 1e-3);
        // A mass on a spring, coupled to the key by 4 kN/m; the response is the coupling's force, tick by tick.
        let (coupling, tick_count) = (4e3, 2_048);
        let (mut x, mut v) = (0.0, 0.0);
        let fine_steps = 400;
        let response: Vec<f64> = (0..tick_count)
            .map(|tick| {
                let pulse_height = if tick == 0 { 1.0 } else { 0.0 };
                let mut force_sum = 0.0;
                for _ in 0..fine_steps {
                    let dt = period / f64::from(fine_steps);
                    let coupling_force = coupling * (pulse_height - x);
                    v += dt * (coupling_force - k * x - z * v) / ringing_mass;
                    x += dt * v;
                    force_sum += coupling_force;
                }
                force_sum / f64::from(fine_steps)
            })
            .collect();
        for hand in HAND_SPRING_DAMPERS {
            for delay in [0, 1] {
                let held_key = HapticLoop {
                    mass: 0.05,
                    damping: 1.0,
                    tick_period: period,
                    delay_ticks: delay,
                };
                let stable_border = FrequencyResponse::new(&response).held_margin(hand, held_key, 0.0, 0.0);
                assert!(
                    grows(&response, held_key, hand, 1.1 * stable_border),
                    "{hand:?} {delay} {stable_border}"
                );
                assert!(
                    !grows(&response, held_key, hand, 0.9 * stable_border),
                    "{hand:?} {delay} {stable_border}"
                );
            }
        }
    }

    /// Whether the loop grows if a held key gets this part of the piece's force.
    fn grows(response: &[f64], key: HapticLoop, hand: (f64, f64), force_share: f64) -> bool {
        let HeldKeyMotion {
            state_matrix: a,
            input_vector: b,
        } = HeldKeyMotion::new(key, hand);
        let (mut positions, mut sent_forces, mut v) = (vec![0.0], Vec::new(), 1.0);
        let mut swing_peaks = [0.0_f64; 4];
        for tick_index in 0..4_096 {
            let responses = response.iter().take(tick_index + 1).enumerate();
            let scene_force: f64 = responses.map(|(j, h)| h * positions[tick_index - j]).sum();
            sent_forces.push(-force_share * scene_force);
            let delayed_force = tick_index
                .checked_sub(key.delay_ticks)
                .map_or(0.0, |tick_index| sent_forces[tick_index]);
            let next_position = a[0][0] * positions[tick_index] + a[0][1] * v + b[0] * delayed_force;
            v = a[1][0] * positions[tick_index] + a[1][1] * v + b[1] * delayed_force;
            positions.push(next_position);
            swing_peaks[tick_index / 1_024] = swing_peaks[tick_index / 1_024].max(v.abs());
        }
        !swing_peaks[3].is_finite() || swing_peaks[3] > swing_peaks[1]
    }
}
