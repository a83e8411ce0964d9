//! The stiffest coupling with which a sampled key is stable.
//!
//! Each position is held for a tick and each force is late, so a virtual spring adds energy, and only the damping of
//! the key removes it. The limit is on the stiffness of everything that is coupled to the key.

/// Greatest stable stiffness [N/m] of a key with `damping` [N·s/m], for ticks of `period` [s] and forces that are
/// `delay` ticks late: 2b/(T(1+2d)), independent of the mass if the key is light.
pub fn stable_stiffness_max(damping: f64, period: f64, delay: u32) -> f64 {
    2.0 * damping / (period * (1.0 + 2.0 * f64::from(delay)))
}

/// The factor that keeps a coupling's force below the limit: 1 if it is below, else less.
pub fn coupling_scale(k: f64, limit: f64) -> f64 {
    if k > limit { limit / k } else { 1.0 }
}

/// Part of the greatest stable gain that a loop gets, because at the border of stability an oscillation never decays.
const GAIN_RESERVE: f64 = 0.8;

/// A key by itself, and the delay of its forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HapticLoop {
    /// Moving mass [kg].
    pub mass: f64,
    /// Damping of the key itself [N·s/m].
    pub damping: f64,
    /// Period of the ticks [s].
    pub tick_period: f64,
    /// Delay of a force [ticks], besides the tick in which it is computed.
    pub delay_ticks: usize,
}

/// The factor of a force, 0 to 1, that keeps a loop of this gain margin stable with a reserve.
pub fn safe_scale(gain_margin: f64) -> f64 {
    super::clamp_to_unit(GAIN_RESERVE * gain_margin)
}

/// The greatest stiffness that a hand meets if it moves once and stays there: the greatest partial sum of a response
/// [N/m].
pub fn stiffness_max(response: &[f64]) -> f64 {
    let partial_sums = response.iter().scan(0.0, |sum, force| {
        *sum += force;
        Some(*sum)
    });
    partial_sums.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::safety::margin::FrequencyResponse;

    /// Spectral radius of a mass of 50 g with damper b and spring k, whose position is held over T and late by d ticks.
    fn radius(b: f64, k: f64, period: f64, delay: usize) -> f64 {
        let m = 0.05;
        // Exact for a force that is constant over a tick: v decays by e^{-bT/m}.
        let velocity_decay = libm::exp(-b * period / m);
        let slide_time = (1.0 - velocity_decay) * m / b;
        let state_size = 2 + delay;
        let mut state_matrix = DMatrix::<f64>::zeros(state_size, state_size);
        (state_matrix[(0, 0)], state_matrix[(0, 1)]) = (1.0, slide_time);
        state_matrix[(1, 1)] = velocity_decay;
        // State: x, v, then x of 1, 2, … ticks ago. The force is -k times the oldest.
        let delayed_index = if delay == 0 { 0 } else { 1 + delay };
        state_matrix[(0, delayed_index)] -= k * (period - slide_time) / b;
        state_matrix[(1, delayed_index)] -= k * (1.0 - velocity_decay) / b;
        for i in 0..delay {
            state_matrix[(2 + i, if i == 0 { 0 } else { 1 + i })] = 1.0;
        }
        let eigenvalues = state_matrix.complex_eigenvalues();
        eigenvalues.iter().map(|root| root.norm()).fold(0.0, f64::max)
    }

    /// Greatest k whose loop is stable, by bisection.
    fn numerically(b: f64, period: f64, delay: usize) -> f64 {
        let (mut stable_bound, mut unstable_bound) = (0.1, 1e7);
        for _ in 0..60 {
            let mean_stiffness = libm::sqrt(stable_bound * unstable_bound);
            if radius(b, mean_stiffness, period, delay) < 1.0 {
                stable_bound = mean_stiffness;
            } else {
                unstable_bound = mean_stiffness;
            }
        }
        stable_bound
    }

    #[test]
    fn limit_of_a_sampled_loop_matches_simulation() {
        // Damping, rate, delay, and the greatest stable stiffness in a simulation of such a loop with 50 g.
        for (b, rate, delay, reference_limit) in [
            (0.3, 1e3, 0, 645.0),
            (0.3, 1e3, 1, 208.0),
            (0.3, 1e3, 2, 124.0),
            (1.0, 1e3, 1, 686.0),
            (3.0, 1e3, 2, 1245.0),
            (0.3, 1e4, 1, 2074.0),
            (1.0, 44_100.0, 1, 30_078.0),
        ] {
            let (formula, simulated) = (
                stable_stiffness_max(b, 1.0 / rate, delay),
                numerically(b, 1.0 / rate, delay as usize),
            );
            let case_text = format!("b {b}, {rate} Hz, delay {delay}: said {formula}, found {simulated}");
            assert!(formula <= simulated && formula > 0.88 * simulated, "{case_text}");
            assert!(
                (simulated / reference_limit - 1.0).abs() < 0.1,
                "{case_text}, known {reference_limit}"
            );
            // At the limit the spring takes as much energy from the key as the delay gives: b = kT(½ + d).
            let delay_damping = formula / rate * (0.5 + f64::from(delay));
            assert!((delay_damping / b - 1.0).abs() < 1e-3, "{case_text}");
        }
    }

    #[test]
    fn scale_only_beyond_the_limit() {
        assert_eq!(coupling_scale(100.0, 200.0), 1.0);
        assert_eq!(coupling_scale(400.0, 200.0), 0.5);
    }

    /// A spring alone: the border equals that of the eigenvalues of the loop.
    #[test]
    fn gain_margin_of_a_spring_equals_its_limit() {
        for (damping, delay) in [(0.3, 0), (1.0, 0), (1.0, 1), (3.0, 2)] {
            let period = 1e-3;
            let stable_border = numerically(damping, period, delay);
            let key = HapticLoop {
                mass: 0.05,
                damping,
                tick_period: period,
                delay_ticks: delay,
            };
            for k in [
                0.05 * stable_border,
                0.5 * stable_border,
                2.0 * stable_border,
                8.0 * stable_border,
            ] {
                let scaled_border = k * FrequencyResponse::new(&[k]).gain_margin(key, 0.0, 0.0);
                let case_text = format!("{damping} {delay} {k}: {scaled_border} {stable_border}");
                assert!((scaled_border / stable_border - 1.0).abs() < 0.05, "{case_text}");
                assert_eq!(
                    safe_scale(scaled_border / k),
                    (GAIN_RESERVE * (scaled_border / k)).min(1.0),
                    "{case_text}"
                );
            }
        }
    }

    /// Heavy keys on soft springs swing slowly and settle: their force is not reduced.
    #[test]
    fn safe_scale_of_slow_swings_is_one() {
        let period = 44.0 / 44_100.0;
        let key_cases = [
            (0.05, 0.3, 5.0, 0),
            (0.4, 0.3, 40.0, 0),
            (0.4, 1.2, 40.0, 1),
            (0.2, 0.5, 20.0, 1),
        ];
        for (mass, damping, k, delay) in key_cases {
            let key = HapticLoop {
                mass,
                damping,
                tick_period: period,
                delay_ticks: delay,
            };
            assert_eq!(
                safe_scale(FrequencyResponse::new(&[0.5 * k, 0.5 * k]).gain_margin(key, 0.0, 0.0)),
                1.0,
                "{mass} kg, {k} N/m"
            );
        }
    }
}
