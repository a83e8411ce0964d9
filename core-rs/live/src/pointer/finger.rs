//! A finger between a pointer and a key: the pointer pulls the finger by a spring and a damper, and the fingertip holds
//! the key by its pulp.
//!
//! A finger is modelled as a mass with a spring and a damper by A. Z. Hajian and R. D. Howe, "Identification of the
//! mechanical impedance at the human finger tip", J. Biomech. Eng. 119 (1997); that its stiffness grows with the force
//! of the muscles is why a pen's pressure scales it here.

use crate::emulate::KeyConstants;

/// Longest step of the computation [s]: at the usual constants, the square of frequency times step is below 5e-4.
const FINGER_STEP_MAX: f64 = 25e-6;
/// Greatest factor of a finger's stiffness.
pub(super) const FIRMNESS_MAX: f64 = 2.0;
/// Time in which a finger that lands on a key goes from there to its pointer [s].
const LANDING_SECONDS: f64 = 0.1;
/// Greatest spring for each kilogram that it moves [N/m/kg]: the square of frequency times step is then below a tenth.
const STIFFNESS_PER_MASS_MAX: f64 = 1e8;

/// The constants of a finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerConstants {
    /// Spring to the pointer [N/m].
    pub stiffness: f64,
    /// Damper to the pointer [N·s/m].
    pub damping: f64,
    /// Moving mass [kg].
    pub mass: f64,
}

/// Spring [N/m] and damper [N·s/m] of the pulp of a fingertip on the key.
pub const FINGERTIP: (f64, f64) = (2_000.0, 2.0);

impl Default for FingerConstants {
    fn default() -> Self {
        Self {
            stiffness: 400.0,
            damping: 2.0,
            mass: 6e-3,
        }
    }
}

impl FingerConstants {
    /// Whether it can be computed in the steps here.
    pub fn is_possible(&self) -> bool {
        self.damping.is_finite()
            && self.damping >= 0.0
            && self.stiffness > 0.0
            && is_slow_enough(self.mass, FIRMNESS_MAX * self.stiffness + FINGERTIP.0)
    }
}

/// Whether a mass [kg] between springs [N/m] swings slowly enough for the steps.
fn is_slow_enough(mass: f64, stiffness: f64) -> bool {
    mass.is_finite() && stiffness <= STIFFNESS_PER_MASS_MAX * mass
}

/// The constants of the key that a finger holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldKey {
    /// Moving mass [kg].
    pub mass: f64,
    /// Damper to the ground [N·s/m].
    pub damping: f64,
    /// Spring to the ground [N/m].
    pub stiffness: f64,
    /// Where that spring has no force [m].
    pub rest: f64,
    /// Its two ends [m].
    pub range: [f64; 2],
}

/// The light fader that is emulated too.
impl Default for HeldKey {
    fn default() -> Self {
        let KeyConstants {
            mass,
            stiffness,
            damping,
            range,
        } = KeyConstants::default();
        Self {
            mass,
            damping,
            stiffness,
            rest: 0.0,
            range,
        }
    }
}

impl HeldKey {
    /// Whether it can be computed in the steps here.
    pub fn is_possible(&self) -> bool {
        let [lower_limit, upper_limit] = self.range;
        let numbers = [self.damping, self.stiffness, self.rest, lower_limit, upper_limit];
        numbers.iter().all(|x| x.is_finite())
            && lower_limit < upper_limit
            && self.damping >= 0.0
            && self.stiffness >= 0.0
            && is_slow_enough(self.mass, self.stiffness + FINGERTIP.0)
    }

    /// Force of its spring at `x` [N].
    fn spring_force(&self, x: f64) -> f64 {
        -self.stiffness * (x - self.rest)
    }
}

/// The pointer during a tick: its positions at both ends [m], and the factor of the finger's stiffness.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointerPull {
    /// At the beginning of the tick.
    pub start_position: f64,
    /// At its end.
    pub end_position: f64,
    /// 1 for an ordinary pressure.
    pub firmness: f64,
}

/// A finger and its key in motion.
#[derive(Clone, Debug)]
pub struct FingerMotion {
    finger: FingerConstants,
    key: HeldKey,
    period: f64,
    steps: u32,
    /// Position [m] and speed [m/s] of finger and key.
    x: [f64; 2],
    v: [f64; 2],
    /// Distance of the key from the pointer when the finger landed [m], and the time since then [s]; `None` while no
    /// finger is on the key.
    landing: Option<(f64, f64)>,
    pointer_position: f64,
    pointer_force: f64,
}

impl FingerMotion {
    /// A key at rest, without a finger, in ticks of `period` [s].
    pub fn new(finger: FingerConstants, key: HeldKey, period: f64) -> Self {
        let [lower_limit, upper_limit] = key.range;
        let start_position = key.rest.clamp(lower_limit, upper_limit);
        Self {
            finger,
            key,
            period,
            steps: (period / FINGER_STEP_MAX).ceil().max(1.0) as u32,
            x: [start_position; 2],
            v: [0.0; 2],
            landing: None,
            pointer_position: start_position,
            pointer_force: 0.0,
        }
    }

    /// Advance by one tick under a force on the key [N]; `pull`: the pointer, if it leads the finger.
    pub fn advance(&mut self, force: f64, pull: Option<PointerPull>) {
        let substep = self.period / f64::from(self.steps);
        self.pointer_force = 0.0;
        let Some(pull) = pull else {
            self.landing = None;
            for _ in 0..self.steps {
                self.move_free_key(force, substep);
            }
            // A finger that is not on the key waits over it.
            (self.x[0], self.v[0]) = (self.x[1], self.v[1]);
            self.pointer_position = self.x[1];
            return;
        };
        let (landing_offset, landed_for) = *self.landing.get_or_insert((self.x[1] - pull.start_position, 0.0));
        let (pointer_now, pointer_next) = (
            pull.start_position + landing_offset * remaining_share(landed_for),
            pull.end_position + landing_offset * remaining_share(landed_for + self.period),
        );
        self.landing = Some((landing_offset, landed_for + self.period));
        let pointer_speed = (pointer_next - pointer_now) / self.period;
        let grip_stiffness = self.finger.stiffness * pull.firmness;
        for step in 0..self.steps {
            let pointer = pointer_now + pointer_speed * substep * (f64::from(step) + 0.5);
            self.move_held_key(force, grip_stiffness, pointer, pointer_speed, substep);
        }
        self.pointer_position = pointer_next;
        self.pointer_force =
            grip_stiffness * (pointer_next - self.x[0]) + self.finger.damping * (pointer_speed - self.v[0]);
    }

    /// One step of the key alone: half of the way, the change of speed in the middle of the step, and the other half. A
    /// damper acts on the mean of the speeds before and after. Forces and the pointer's speed are constant within a
    /// step, so the result is of second order.
    fn move_free_key(&mut self, force: f64, h: f64) {
        let HeldKey { mass, damping, .. } = self.key;
        self.x[1] += 0.5 * h * self.v[1];
        let force = force + self.key.spring_force(self.x[1]);
        self.v[1] += h * (force - damping * self.v[1]) / (mass + 0.5 * h * damping);
        self.x[1] += 0.5 * h * self.v[1];
        self.stop_at_ends();
    }

    /// One such step of finger and key, which the pulp couples; `pointer`: in the middle of the step.
    fn move_held_key(&mut self, force: f64, k: f64, pointer: f64, pointer_speed: f64, h: f64) {
        let (FingerConstants { damping: z, mass, .. }, held_key, (pulp_k, pulp_z)) = (self.finger, self.key, FINGERTIP);
        let half_step = 0.5 * h;
        self.drift(half_step);
        let ([x, x_key], [v, v_key]) = (self.x, self.v);
        let pulp_force = pulp_k * (x - x_key) + pulp_z * (v - v_key);
        let impulses = [
            h * (k * (pointer - x) + z * (pointer_speed - v) - pulp_force),
            h * (force + pulp_force + held_key.spring_force(x_key) - held_key.damping * v_key),
        ];
        // (mass + h/2 · damping) · change = pushed, a system of two equations.
        let (a, b) = (mass + half_step * (z + pulp_z), -half_step * pulp_z);
        let d = held_key.mass + half_step * (pulp_z + held_key.damping);
        let determinant = a * d - b * b;
        self.v[0] += (d * impulses[0] - b * impulses[1]) / determinant;
        self.v[1] += (a * impulses[1] - b * impulses[0]) / determinant;
        self.drift(half_step);
        self.stop_at_ends();
    }

    fn drift(&mut self, time: f64) {
        for (x, v) in self.x.iter_mut().zip(self.v) {
            *x += time * v;
        }
    }

    fn stop_at_ends(&mut self) {
        let [lower_limit, upper_limit] = self.key.range;
        if !(lower_limit..=upper_limit).contains(&self.x[1]) {
            self.x[1] = self.x[1].clamp(lower_limit, upper_limit);
            self.v[1] = 0.0;
        }
    }

    /// Position of the key [m].
    pub fn key_position(&self) -> f64 {
        self.x[1]
    }

    /// Position of the finger [m].
    pub fn finger_position(&self) -> f64 {
        self.x[0]
    }

    /// Position of the pointer as it pulls the finger [m].
    pub fn pointer_position(&self) -> f64 {
        self.pointer_position
    }

    /// Force of the pointer on the finger at the end of the tick [N].
    pub fn pointer_force(&self) -> f64 {
        self.pointer_force
    }

    /// Whether a finger is on the key.
    pub fn is_held(&self) -> bool {
        self.landing.is_some()
    }
}

/// The share of the distance from key to pointer that is left `seconds_since_landing` [s] after the finger landed: 1 to
/// 0, smoothly.
fn remaining_share(seconds_since_landing: f64) -> f64 {
    let landed_share = (seconds_since_landing / LANDING_SECONDS).min(1.0);
    1.0 - landed_share * landed_share * (3.0 - 2.0 * landed_share)
}

#[cfg(test)]
mod tests {
    use ergon_engine::maths::{cos, exp, sin};

    use super::*;

    const KEY: HeldKey = HeldKey {
        mass: 0.05,
        damping: 1.0,
        stiffness: 0.0,
        rest: 0.0,
        range: [-0.05, 0.05],
    };

    fn pull(x: f64) -> Option<PointerPull> {
        Some(PointerPull {
            start_position: x,
            end_position: x,
            firmness: 1.0,
        })
    }

    #[test]
    fn finger_and_pulp_in_series() {
        let mut motion = FingerMotion::new(FingerConstants::default(), KEY, 1e-3);
        (0..5_000).for_each(|_| motion.advance(1.0, pull(0.0)));
        // 1 N on the key: the finger's spring gives way by 1/400 m, its pulp by 1/2000 m.
        assert!(
            (motion.finger_position() - 2.5e-3).abs() < 1e-9,
            "{}",
            motion.finger_position()
        );
        assert!((motion.key_position() - 3e-3).abs() < 1e-9, "{}", motion.key_position());
        assert!(
            (motion.pointer_force() + 1.0).abs() < 1e-6,
            "{}",
            motion.pointer_force()
        );
    }

    #[test]
    fn finger_lands_without_a_jerk() {
        let mut motion = FingerMotion::new(FingerConstants::default(), KEY, 1e-3);
        let mut last_position = motion.key_position();
        for _ in 0..2_000 {
            motion.advance(0.0, pull(0.04));
            assert!((motion.key_position() - last_position).abs() < 1e-3, "{last_position}");
            last_position = motion.key_position();
        }
        assert!((last_position - 0.04).abs() < 1e-6, "{last_position}");
        motion.advance(0.0, None);
        assert!(!motion.is_held());
    }

    #[test]
    fn finger_at_the_ends_of_the_key() {
        let mut motion = FingerMotion::new(FingerConstants::default(), KEY, 1e-3);
        for tick in 0..3_000 {
            motion.advance(-20.0, (tick % 700 < 500).then_some(pull(0.05)).flatten());
            assert!(motion.key_position().abs() <= 0.05, "{}", motion.key_position());
        }
    }

    /// A thrown key swings about its rest as a free CEL does, and never passes its travel.
    #[test]
    fn key_after_the_finger_lifts() {
        let held_key = HeldKey {
            stiffness: 60.0,
            rest: 1e-3,
            range: [-0.015, 0.01],
            ..KEY
        };
        let mut motion = FingerMotion::new(FingerConstants::default(), held_key, 1e-3);
        let mut throw_key = |speed: f64| {
            for tick in 0..40_u32 {
                let pointer_place = speed * 1e-3 * f64::from(tick);
                let pull = PointerPull {
                    start_position: pointer_place,
                    end_position: pointer_place + speed * 1e-3,
                    firmness: 1.0,
                };
                motion.advance(0.0, Some(pull));
            }
            let mut key_path = vec![(motion.x[1], motion.v[1])];
            for _ in 0..2_000 {
                motion.advance(0.0, None);
                key_path.push((motion.x[1], motion.v[1]));
            }
            key_path
        };
        let slow_path = throw_key(-0.05);
        let sigma = 0.5 * KEY.damping / KEY.mass;
        let omega = (60.0 / KEY.mass - sigma * sigma).sqrt();
        let (x, v) = (slow_path[0].0 - held_key.rest, slow_path[0].1);
        for (tick, (place, _)) in slow_path.iter().enumerate() {
            let t = 1e-3 * tick as f64;
            let free_swing = x * cos(omega * t) + (v + sigma * x) / omega * sin(omega * t);
            let exact_place = held_key.rest + exp(-sigma * t) * free_swing;
            assert!((place - exact_place).abs() < 1e-7, "{tick}: {place} {exact_place}");
        }
        let fast_path = throw_key(-2.0);
        assert!(fast_path.iter().any(|(x, _)| *x == -0.015), "it meets its end");
        assert!(fast_path.iter().all(|(x, _)| (-0.015..=0.01).contains(x)));
        assert!((fast_path[2_000].0 - held_key.rest).abs() < 1e-6);
    }

    /// A step twice as long has four times the error: the computation is of second order.
    #[test]
    fn finger_error_by_step() {
        let end_position = |steps: u32| {
            let mut motion = FingerMotion::new(FingerConstants::default(), KEY, 1e-3);
            motion.steps = steps;
            for tick in 0..60_u32 {
                let parabola = |tick: u32| 1e-3 * f64::from(tick) * f64::from(tick) / 60.0;
                let pull = PointerPull {
                    start_position: parabola(tick),
                    end_position: parabola(tick + 1),
                    firmness: 1.0,
                };
                motion.advance(0.0, Some(pull));
            }
            motion.key_position()
        };
        let fine_end = end_position(4_096);
        let (coarse_error, half_error) = ((end_position(16) - fine_end).abs(), (end_position(32) - fine_end).abs());
        assert!(
            (3.5..4.5).contains(&(coarse_error / half_error)),
            "{coarse_error} {half_error}"
        );
    }
}
