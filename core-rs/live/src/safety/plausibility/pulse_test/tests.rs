//! Responses of bodies and hands to a pulse test.

use super::*;

/// A body in a hand, moved step by step.
struct Body {
    mass: f64,
    damping: f64,
    stiffness: f64,
    x: f64,
    v: f64,
}

impl Body {
    fn new(mass: f64, damping: f64, stiffness: f64) -> Self {
        let (x, v) = (0.0, 0.0);
        Self {
            mass,
            damping,
            stiffness,
            x,
            v,
        }
    }

    /// Its position after a step under `force` [N].
    fn step(&mut self, force: f64) -> f64 {
        const SUBSTEPS: usize = 16;
        let substep_time = 1e-3 / SUBSTEPS as f64;
        for _ in 0..SUBSTEPS {
            self.v += (force - self.damping * self.v - self.stiffness * self.x) / self.mass * substep_time;
            self.x += self.v * substep_time;
        }
        self.x
    }
}

/// The weighted sum of the response of a body to pulses of one newton [m].
fn response(mass: f64, damping: f64, stiffness: f64, delay: usize) -> f64 {
    let mut pulse_tester = PulseTester::new(1e-3, mass, 0.0, 0.0);
    pulse_tester.active_test = Some(ActiveTest {
        sign: 1.0,
        force: 1.0,
        pass_share: 1.0,
        steps: 0,
        sent_range: [0.0; 2],
    });
    let mut body = Body::new(mass, damping, stiffness);
    let mut delayed_forces = vec![0.0; delay];
    for step in 0..TEST_STEPS {
        delayed_forces.push(pulse_tester.pulse_force());
        pulse_tester.positions.copy_within(1.., 0);
        pulse_tester.positions[WEIGHTED_POSITIONS - 1] = body.step(delayed_forces[step]);
        pulse_tester.active_test.as_mut().unwrap().steps += 1;
    }
    pulse_tester.weighted_sum()
}

#[test]
fn response_sum_of_polynomial_paths() {
    for degree in 0..=6 {
        let mut pulse_tester = PulseTester::new(1e-3, 0.05, 0.0, 0.0);
        for (i, x) in pulse_tester.positions.iter_mut().enumerate() {
            *x = libm::pow(i as f64 / 55.0 - 0.4, f64::from(degree));
        }
        assert!(
            pulse_tester.weighted_sum().abs() < 1e-5,
            "{degree}: {}",
            pulse_tester.weighted_sum()
        );
    }
}

#[test]
fn response_of_all_hands_is_positive() {
    let hand_loads = [
        [0.1, 0.0],
        [1.0, 0.0],
        [2.0, 100.0],
        [5.0, 400.0],
        [5.0, 1000.0],
        [9.0, 800.0],
        [11.0, 1500.0],
        [16.0, 2000.0],
        [21.0, 3000.0],
        [31.0, 5000.0],
        [41.0, 10_000.0],
    ];
    for mass in [0.03, 0.05, 0.1, 0.2, 0.4] {
        for [damping, stiffness] in hand_loads {
            for delay in 0..=5 {
                let response_sum = response(mass, damping, stiffness, delay);
                let case_text = format!("{mass} kg, {damping} N·s/m, {stiffness} N/m, {delay} steps");
                assert!(response_sum > 4e-6, "{case_text}: {response_sum}");
                assert!(
                    response_sum < RESPONSE_RATIO_MAX * FREE_RESPONSE / mass,
                    "{case_text}: {response_sum}"
                );
            }
        }
    }
}

/// The reply of a body whose response is `delay` steps late, to a pulse test whose response may be late.
fn late_response([damping, stiffness]: [f64; 2], mass: f64, delay: usize) -> PulseResponse {
    let mut pulse_tester = PulseTester::new(1e-3, mass, 0.0, 0.0);
    while !pulse_tester.is_noise_known() {
        pulse_tester.add_step(0.0, 0.0, true);
    }
    pulse_tester.begin(3.0, 1.0, true);
    let mut body = Body::new(mass, damping, stiffness);
    let mut delayed_forces = std::collections::VecDeque::from(vec![0.0; delay]);
    loop {
        delayed_forces.push_back(pulse_tester.pulse_force());
        let delayed_force = delayed_forces.pop_front().unwrap();
        if let Some(reply) = pulse_tester.add_step(body.step(delayed_force), delayed_force, true) {
            return reply;
        }
    }
}

#[test]
fn response_of_late_bodies() {
    let hand_loads = [
        [0.1, 0.0],
        [1.0, 0.0],
        [2.0, 100.0],
        [5.0, 400.0],
        [9.0, 800.0],
        [11.0, 1500.0],
        [21.0, 3000.0],
    ];
    for hand in hand_loads {
        for mass in [0.05, 0.1, 0.2] {
            for delay in 0..=2 {
                let response = late_response(hand, mass, delay);
                assert_eq!(response, PulseResponse::Right, "{hand:?} {mass} kg, {delay} steps");
            }
        }
    }
    // Without the comparison all of these are right.
    let late_replies = hand_loads.map(|hand| late_response(hand, 0.1, 26));
    let right_count = late_replies
        .iter()
        .filter(|response| **response == PulseResponse::Right)
        .count();
    assert!(right_count <= 2, "{late_replies:?}");
}
