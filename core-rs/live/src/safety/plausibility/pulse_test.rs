//! A pulse test: two faint pulses of force, of opposite signs, and the sign of the key's response.
//!
//! The response is a weighted sum of positions before, during and after the pulses. It is zero for every path that is a
//! polynomial of degree six, so that a hand that moves smoothly adds little. And it is positive for the response of
//! every hand, free, soft or firm, light or heavy, late by up to five steps, because the first movement of a passive
//! body goes the way it is pushed. The weights are the shortest vector in the convex hull of the unit responses of 150
//! such hands (by the algorithm of M. Frank and P. Wolfe, Naval Research Logistics Quarterly 3, 1956), and a test
//! computes the responses of more hands. A motor that pushes the other way gives a negative sum.
//!
//! Where force or position may be late, the sign of the first pulse is drawn for each pulse test, so that a motion that
//! repeats, such as the response to an earlier pulse test that comes late, is right as often as wrong.
//!
//! Only the sum under the known pulses counts, never force and motion as such: with a spring they agree in sign
//! whichever way the motor pushes, since the piece computes the force from the position.

/// Number of positions before the pulses that are weighted.
const LEAD_POSITIONS: usize = 16;
/// The pulse: half a sine.
#[allow(clippy::approx_constant)] // rounded like the others
const PULSE_SHAPE: [f64; 6] = [0.2588, 0.7071, 0.9659, 0.9659, 0.7071, 0.2588];
/// Steps from the beginning of the first pulse to that of the second, which has the opposite sign.
const SECOND_PULSE_STEP: usize = 18;
/// The weights, for the oldest position first.
#[rustfmt::skip]
const WEIGHTS: [f64; 56] = [
    0.236870, 0.017143, -0.112710, -0.171164, -0.175152, -0.140107, -0.080003, -0.007405,
    0.066489, 0.131802, 0.179927, 0.203481, 0.196254, 0.153158, 0.070177, -0.055688,
    -0.178461, -0.212498, -0.135913, -0.003872, 0.089782, 0.066116, -0.042912, -0.130983,
    -0.146108, -0.103598, -0.053330, -0.035001, -0.039043, -0.039960, -0.022896, 0.020674,
    0.095664, 0.205033, 0.302756, 0.303613, 0.186818, 0.009352, -0.132486, -0.156794,
    -0.092218, -0.041590, -0.053439, -0.109189, -0.156097, -0.152168, -0.105422, -0.040737,
    0.026552, 0.086167, 0.130003, 0.150297, 0.138482, 0.084478, -0.023740, -0.200402,
];
/// Number of weighted positions.
const WEIGHTED_POSITIONS: usize = WEIGHTS.len();
/// Steps of a pulse test, from the first pulse on.
const TEST_STEPS: usize = WEIGHTED_POSITIONS - LEAD_POSITIONS;
/// Longest delay that a device may report and that is waited for [steps].
const DELAY_STEPS_MAX: usize = 16;

/// The response of a free mass of 1 kg to a newton [m].
const FREE_RESPONSE: f64 = 9.3e-6;
/// A response this many times greater than that of the free key is no response: a hand moves the key.
const RESPONSE_RATIO_MAX: f64 = 2.5;
/// The response to a newton by a firm hand, which is expected at first, and by the firmest [m].
const FIRM_RESPONSE: f64 = 25e-6;
const FIRMEST_RESPONSE: f64 = 8e-6;
/// How far a pulse of a newton moves a key in the firmest grip [m].
const FIRMEST_DISPLACEMENT: f64 = 2e-5;

/// Least sum that is a response: [m], steps of the sensor, and times the greatest sum without pulses of late.
const RESPONSE_MIN: f64 = 2e-6;
const RESPONSE_SENSOR_STEPS: f64 = 1.5;
const NOISE_FACTOR: f64 = 3.0;
/// Steps without a pulse test in which that sum is taken, where the key swings: a part of a swing.
const CALM_STEPS: usize = 12;
/// A response that is late by 22 to 34 steps has the sign of one in time, but the sum is this many times greater when
/// the window has moved by the same number of steps. For a response in time, by three steps at most, the factor is
/// below
/// 1.9.
const LATE_STEPS: [usize; 2] = [22, 34];
const LATE_FACTOR: f64 = 2.0;
/// Time in which the greatest sum without pulses is forgotten [s].
const NOISE_MEMORY_SECONDS: f64 = 0.25;
/// The force of a pulse is chosen for a response this many times the least.
const PULSE_RESPONSE_FACTOR: f64 = 2.0;
/// Least and greatest force of a pulse [N].
const PULSE_FORCE_RANGE: [f64; 2] = [0.05, 3.0];

/// The first state of the draw of signs: any number but zero.
const SIGN_SEED: u32 = 0x9e37_79b9;

/// The response to a pulse test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PulseResponse {
    /// The key went the way it was pushed.
    Right,
    /// The key went the other way.
    Wrong,
    /// The motion of the hand hides the response.
    Hidden,
    /// The sensor did not change at all, though the pulses would show in it through the firmest grip.
    Unmoved,
}

/// A pulse test under way.
#[derive(Clone, Copy, Debug)]
struct ActiveTest {
    /// Sign of the first pulse.
    sign: f64,
    /// Force of its pulses at the key [N], and the part of a force that reaches the key.
    force: f64,
    pass_share: f64,
    /// Steps since its beginning.
    steps: usize,
    /// Least and greatest force that was sent since then [N].
    sent_range: [f64; 2],
}

/// A right response that has to be greater than what comes later.
#[derive(Clone, Copy, Debug)]
struct PendingResponse {
    /// Its sum, the sign of the pulse test, and the greatest sum since then, as if the pulses had been later [m].
    weighted_sum: f64,
    sign: f64,
    later_sum_max: f64,
    /// Steps since the response.
    steps: usize,
}

/// The pulse tests to an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct PulseTester {
    /// Length of a step [s].
    step_seconds: f64,
    /// Greatest response to a newton [m], and step of the sensor [m].
    greatest_response: f64,
    resolution: f64,
    /// Delay that the device reports [steps].
    delay: usize,
    /// The newest positions, the oldest first, and how many of them came since the last pulse test.
    positions: [f64; WEIGHTED_POSITIONS],
    quiet_steps: usize,
    /// Greatest sum without pulses of late [m].
    noise_sum: f64,
    /// Answer to a newton that is expected [m].
    expected_response: f64,
    active_test: Option<ActiveTest>,
    pending_response: Option<PendingResponse>,
    /// State of the draw of signs.
    sign_state: u32,
}

impl PulseTester {
    /// For steps of `step` [s] and an axis of `mass` [kg] whose sensor has steps of `resolution` [m] and whose
    /// device reports a `delay` [s].
    pub(super) fn new(step: f64, mass: f64, resolution: f64, delay: f64) -> Self {
        Self {
            step_seconds: step,
            greatest_response: RESPONSE_RATIO_MAX * FREE_RESPONSE / mass,
            resolution,
            delay: ((delay / step).round() as usize).min(DELAY_STEPS_MAX),
            positions: [0.0; WEIGHTED_POSITIONS],
            quiet_steps: 0,
            noise_sum: 0.0,
            expected_response: FIRM_RESPONSE,
            active_test: None,
            pending_response: None,
            sign_state: SIGN_SEED,
        }
    }

    /// Forget earlier positions.
    pub(super) fn restart(&mut self) {
        (self.active_test, self.pending_response) = (None, None);
        (self.quiet_steps, self.noise_sum) = (0, 0.0);
    }

    fn is_idle(&self) -> bool {
        self.active_test.is_none() && self.pending_response.is_none()
    }

    /// Whether a pulse test may begin.
    pub(super) fn may_begin(&self) -> bool {
        self.is_idle() && self.quiet_steps >= LEAD_POSITIONS
    }

    /// Whether one may begin, and the noise since the last one is known.
    pub(super) fn is_noise_known(&self) -> bool {
        self.is_idle() && self.quiet_steps > WEIGHTED_POSITIONS
    }

    /// Whether one may begin, and the noise of a swing since the last one is known.
    pub(super) fn is_swing_noise_known(&self) -> bool {
        self.is_idle() && self.quiet_steps > WEIGHTED_POSITIONS + CALM_STEPS
    }

    /// Begin a pulse test with at most `force` [N], if the part `pass_share` of a force reaches the key. Where
    /// `may_be_late`, its sign is drawn.
    pub(super) fn begin(&mut self, force: f64, pass_share: f64, may_be_late: bool) {
        let [least_pulse, greatest_pulse] = PULSE_FORCE_RANGE;
        let clear_force =
            (PULSE_RESPONSE_FACTOR * self.response_min() / self.expected_response).clamp(least_pulse, greatest_pulse);
        let sign = if may_be_late { self.random_sign() } else { 1.0 };
        self.active_test = Some(ActiveTest {
            sign,
            force: clear_force.min(force),
            pass_share,
            steps: 0,
            sent_range: [f64::INFINITY, f64::NEG_INFINITY],
        });
    }

    /// A sign by xorshift32 (Marsaglia, 2003).
    fn random_sign(&mut self) -> f64 {
        self.sign_state ^= self.sign_state << 13;
        self.sign_state ^= self.sign_state >> 17;
        self.sign_state ^= self.sign_state << 5;
        if self.sign_state >> 31 == 0 { 1.0 } else { -1.0 }
    }

    /// The force of the pulses now [N].
    pub(super) fn pulse_force(&self) -> f64 {
        let Some(active_test) = self.active_test else {
            return 0.0;
        };
        let pulse_at = |step: usize| PULSE_SHAPE.get(step).copied().unwrap_or(0.0);
        let second_pulse = active_test.steps.checked_sub(SECOND_PULSE_STEP).map_or(0.0, pulse_at);
        active_test.sign * active_test.force / active_test.pass_share * (pulse_at(active_test.steps) - second_pulse)
    }

    fn response_min(&self) -> f64 {
        RESPONSE_MIN
            .max(RESPONSE_SENSOR_STEPS * self.resolution)
            .max(NOISE_FACTOR * self.noise_sum)
    }

    /// Take the position of a step [m], and the force `sent_force` before it [N]; returns the response when a test is
    /// over. Where `may_be_late`, a right response has to be greater than what comes later.
    pub(super) fn add_step(&mut self, x: f64, sent_force: f64, may_be_late: bool) -> Option<PulseResponse> {
        if self.quiet_steps == 0 && self.active_test.is_none() {
            self.positions = [x; WEIGHTED_POSITIONS];
        }
        self.positions.copy_within(1.., 0);
        self.positions[WEIGHTED_POSITIONS - 1] = x;
        self.quiet_steps = self.quiet_steps.saturating_add(1);
        self.noise_sum *= 1.0 - self.step_seconds / NOISE_MEMORY_SECONDS;
        let Some(active_test) = &mut self.active_test else {
            if self.quiet_steps > WEIGHTED_POSITIONS {
                self.noise_sum = self.noise_sum.max(self.weighted_sum().abs());
            }
            return self.advance_pending();
        };
        active_test.steps += 1;
        active_test.sent_range = [
            active_test.sent_range[0].min(sent_force),
            active_test.sent_range[1].max(sent_force),
        ];
        if active_test.steps < TEST_STEPS + self.delay {
            return None;
        }
        let active_test = *active_test;
        (self.active_test, self.quiet_steps) = (None, 0);
        let response = self.judge(active_test);
        if response == PulseResponse::Right && may_be_late {
            self.pending_response = Some(PendingResponse {
                weighted_sum: self.weighted_sum().abs(),
                sign: active_test.sign,
                later_sum_max: 0.0,
                steps: 0,
            });
            return None;
        }
        Some(response)
    }

    /// Wait until a right response is known to be in time.
    fn advance_pending(&mut self) -> Option<PulseResponse> {
        let mut pending = self.pending_response?;
        let [first_step, last_step] = LATE_STEPS;
        pending.steps += 1;
        if pending.steps >= first_step {
            pending.later_sum_max = pending.later_sum_max.max(pending.sign * self.weighted_sum());
        }
        self.pending_response = (pending.steps < last_step).then_some(pending);
        if self.pending_response.is_some() {
            return None;
        }
        let is_late = pending.later_sum_max > LATE_FACTOR * pending.weighted_sum;
        Some(if is_late {
            PulseResponse::Hidden
        } else {
            PulseResponse::Right
        })
    }

    fn judge(
        &mut self,
        ActiveTest {
            sign,
            force,
            sent_range,
            ..
        }: ActiveTest,
    ) -> PulseResponse {
        let is_unmoved = |x: &f64| x.to_bits() == self.positions[WEIGHTED_POSITIONS - 1].to_bits();
        let force_change = 0.5 * (sent_range[1] - sent_range[0]);
        if force_change.min(force) * FIRMEST_DISPLACEMENT >= 2.0 * self.resolution
            && self.positions[LEAD_POSITIONS..].iter().all(is_unmoved)
        {
            self.expected_response = FIRMEST_RESPONSE;
            return PulseResponse::Unmoved;
        }
        let signed_sum = sign * self.weighted_sum();
        if signed_sum.abs() < self.response_min() || signed_sum.abs() > self.greatest_response * force {
            self.expected_response = (0.5 * self.expected_response).max(FIRMEST_RESPONSE);
            return PulseResponse::Hidden;
        }
        self.expected_response = (signed_sum.abs() / force).max(FIRMEST_RESPONSE);
        if signed_sum > 0.0 {
            PulseResponse::Right
        } else {
            PulseResponse::Wrong
        }
    }

    /// The weighted sum of the newest positions [m].
    fn weighted_sum(&self) -> f64 {
        let first_position = self.positions[0];
        let weighted = self.positions.iter().zip(WEIGHTS);
        weighted.map(|(x, weight)| (x - first_position) * weight).sum()
    }
}

#[cfg(test)]
mod tests;
