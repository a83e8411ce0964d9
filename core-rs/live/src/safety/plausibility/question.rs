//! A question: two faint pulses of force, of opposite signs, and the sign of the key's answer.
//!
//! The answer is a weighted sum of positions before, during and after the pulses. It is zero for every path that is a
//! polynomial of degree six, so that a hand that moves smoothly adds little. And it is positive for the answer of every
//! hand, free, soft or firm, light or heavy, late by up to five steps, because the first movement of a passive body
//! goes the way it is pushed. The weights are the shortest vector in the convex hull of the unit answers of 150 such
//! hands (by the algorithm of M. Frank and P. Wolfe, Naval Research Logistics Quarterly 3, 1956), and a test computes
//! the answers of more hands. A motor that pushes the other way gives a negative sum.
//!
//! Where force or position may be late, the sign of the first pulse is drawn for each question, so that a motion that
//! repeats, such as the answer to an earlier question that comes late, is right as often as wrong.
//!
//! Only the sum under the known pulses counts, never force and motion as such: with a spring they agree in sign
//! whichever way the motor pushes, since the piece computes the force from the position.

/// Number of positions before the pulses that are weighted.
const LEAD_POSITIONS: usize = 16;
/// The pulse: half a sine.
#[allow(clippy::approx_constant)] // rounded like the others
const PULSE: [f64; 6] = [0.2588, 0.7071, 0.9659, 0.9659, 0.7071, 0.2588];
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
const SPAN: usize = WEIGHTS.len();
/// Steps of a question, from the first pulse on.
const STEPS: usize = SPAN - LEAD_POSITIONS;
/// Longest delay that a device may report and that is waited for [steps].
const DELAY_MAX: usize = 16;

/// The answer of a free mass of 1 kg to a newton [m].
const FREE_RESPONSE: f64 = 9.3e-6;
/// An answer this many times greater than that of the free key is no answer: a hand moves the key.
const ANSWER_RATIO_MAX: f64 = 2.5;
/// The answer to a newton by a firm hand, which is expected at first, and by the firmest [m].
const FIRM_RESPONSE: f64 = 25e-6;
const FIRMEST_RESPONSE: f64 = 8e-6;
/// How far a pulse of a newton moves a key in the firmest grip [m].
const FIRMEST_PATH: f64 = 2e-5;

/// Least sum that is an answer: [m], steps of the sensor, and times the greatest sum without pulses of late.
const FAINTEST: f64 = 2e-6;
const SENSOR_STEPS: f64 = 1.5;
const NOISE_FACTOR: f64 = 3.0;
/// Steps without a question in which that sum is taken, where the key swings: a part of a swing.
const CALM_STEPS: usize = 12;
/// An answer that is late by 22 to 34 steps has the sign of one in time, but the sum is this many times greater when
/// the window has moved by the same number of steps. For an answer in time, by three steps at most, the factor is below
/// 1.9.
const LATE_STEPS: [usize; 2] = [22, 34];
const LATE_FACTOR: f64 = 2.0;
/// Time in which the greatest sum without pulses is forgotten [s].
const NOISE_MEMORY: f64 = 0.25;
/// The force of a pulse is chosen for an answer this many times the least.
const PULSE_FACTOR: f64 = 2.0;
/// Least and greatest force of a pulse [N].
const PULSE_FORCES: [f64; 2] = [0.05, 3.0];

/// The first state of the draw of signs: any number but zero.
const DRAW: u32 = 0x9e37_79b9;

/// The answer to a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// The key went the way it was pushed.
    Right,
    /// The key went the other way.
    Wrong,
    /// The motion of the hand hides the answer.
    Hidden,
    /// The sensor did not change at all, though the pulses would show in it through the firmest grip.
    Unmoved,
}

/// A question under way.
#[derive(Clone, Copy, Debug)]
struct Asked {
    /// Sign of the first pulse.
    sign: f64,
    /// Force of its pulses at the key [N], and the part of a force that reaches the key.
    force: f64,
    passes: f64,
    /// Steps since its beginning.
    steps: usize,
    /// Least and greatest force that was sent since then [N].
    sent: [f64; 2],
}

/// A right answer that has to be greater than what comes later.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    /// Its sum, the sign of the question, and the greatest sum since then, as if the pulses had been later [m].
    sum: f64,
    sign: f64,
    later: f64,
    /// Steps since the answer.
    steps: usize,
}

/// The questions to an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Questions {
    /// Length of a step [s].
    step: f64,
    /// Greatest answer to a newton [m], and step of the sensor [m].
    greatest_response: f64,
    resolution: f64,
    /// Delay that the device reports [steps].
    delay: usize,
    /// The newest positions, the oldest first, and how many of them came since the last question.
    past: [f64; SPAN],
    quiet: usize,
    /// Greatest sum without pulses of late [m].
    noise: f64,
    /// Answer to a newton that is expected [m].
    response: f64,
    asked: Option<Asked>,
    waiting: Option<Waiting>,
    /// State of the draw of signs.
    draw: u32,
}

impl Questions {
    /// For steps of `step` [s] and an axis of `mass` [kg] whose sensor has steps of `resolution` [m] and whose device
    /// reports a `delay` [s].
    pub(super) fn new(step: f64, mass: f64, resolution: f64, delay: f64) -> Self {
        Self {
            step,
            greatest_response: ANSWER_RATIO_MAX * FREE_RESPONSE / mass,
            resolution,
            delay: ((delay / step).round() as usize).min(DELAY_MAX),
            past: [0.0; SPAN],
            quiet: 0,
            noise: 0.0,
            response: FIRM_RESPONSE,
            asked: None,
            waiting: None,
            draw: DRAW,
        }
    }

    /// Forget earlier positions.
    pub(super) fn restart(&mut self) {
        (self.asked, self.waiting) = (None, None);
        (self.quiet, self.noise) = (0, 0.0);
    }

    fn is_idle(&self) -> bool {
        self.asked.is_none() && self.waiting.is_none()
    }

    /// Whether a question may begin.
    pub(super) fn may_begin(&self) -> bool {
        self.is_idle() && self.quiet >= LEAD_POSITIONS
    }

    /// Whether one may begin, and the noise since the last one is known.
    pub(super) fn is_calm(&self) -> bool {
        self.is_idle() && self.quiet > SPAN
    }

    /// Whether one may begin, and the noise of a swing since the last one is known.
    pub(super) fn is_very_calm(&self) -> bool {
        self.is_idle() && self.quiet > SPAN + CALM_STEPS
    }

    /// Begin a question with at most `force` [N], if the part `passes` of a force reaches the key. Where `is_doubtful`,
    /// its sign is drawn.
    pub(super) fn begin(&mut self, force: f64, passes: f64, is_doubtful: bool) {
        let [least_pulse, greatest_pulse] = PULSE_FORCES;
        let clear_force = (PULSE_FACTOR * self.least_answer() / self.response).clamp(least_pulse, greatest_pulse);
        let sign = if is_doubtful { self.drawn_sign() } else { 1.0 };
        self.asked = Some(Asked {
            sign,
            force: clear_force.min(force),
            passes,
            steps: 0,
            sent: [f64::INFINITY, f64::NEG_INFINITY],
        });
    }

    /// A sign by xorshift32 (Marsaglia, 2003).
    fn drawn_sign(&mut self) -> f64 {
        self.draw ^= self.draw << 13;
        self.draw ^= self.draw >> 17;
        self.draw ^= self.draw << 5;
        if self.draw >> 31 == 0 { 1.0 } else { -1.0 }
    }

    /// The force of the pulses now [N].
    pub(super) fn offset(&self) -> f64 {
        let Some(open_question) = self.asked else {
            return 0.0;
        };
        let pulse_at = |step: usize| PULSE.get(step).copied().unwrap_or(0.0);
        let second_pulse = open_question.steps.checked_sub(SECOND_PULSE_STEP).map_or(0.0, pulse_at);
        open_question.sign * open_question.force / open_question.passes * (pulse_at(open_question.steps) - second_pulse)
    }

    fn least_answer(&self) -> f64 {
        FAINTEST
            .max(SENSOR_STEPS * self.resolution)
            .max(NOISE_FACTOR * self.noise)
    }

    /// Take the position of a step [m], and the force `sent` before it [N]; returns the answer when a question is over.
    /// Where `is_doubtful`, a right answer has to be greater than what comes later.
    pub(super) fn take(&mut self, x: f64, sent: f64, is_doubtful: bool) -> Option<Answer> {
        if self.quiet == 0 && self.asked.is_none() {
            self.past = [x; SPAN];
        }
        self.past.copy_within(1.., 0);
        self.past[SPAN - 1] = x;
        self.quiet = self.quiet.saturating_add(1);
        self.noise *= 1.0 - self.step / NOISE_MEMORY;
        let Some(open_question) = &mut self.asked else {
            if self.quiet > SPAN {
                self.noise = self.noise.max(self.sum().abs());
            }
            return self.wait();
        };
        open_question.steps += 1;
        open_question.sent = [open_question.sent[0].min(sent), open_question.sent[1].max(sent)];
        if open_question.steps < STEPS + self.delay {
            return None;
        }
        let open_question = *open_question;
        (self.asked, self.quiet) = (None, 0);
        let judged_answer = self.judge(open_question);
        if judged_answer == Answer::Right && is_doubtful {
            self.waiting = Some(Waiting {
                sum: self.sum().abs(),
                sign: open_question.sign,
                later: 0.0,
                steps: 0,
            });
            return None;
        }
        Some(judged_answer)
    }

    /// Wait until a right answer is known to be in time.
    fn wait(&mut self) -> Option<Answer> {
        let mut waiting = self.waiting?;
        let [first_step, last_step] = LATE_STEPS;
        waiting.steps += 1;
        if waiting.steps >= first_step {
            waiting.later = waiting.later.max(waiting.sign * self.sum());
        }
        self.waiting = (waiting.steps < last_step).then_some(waiting);
        if self.waiting.is_some() {
            return None;
        }
        let is_late = waiting.later > LATE_FACTOR * waiting.sum;
        Some(if is_late { Answer::Hidden } else { Answer::Right })
    }

    fn judge(&mut self, Asked { sign, force, sent, .. }: Asked) -> Answer {
        let is_unmoved = |x: &f64| x.to_bits() == self.past[SPAN - 1].to_bits();
        let force_change = 0.5 * (sent[1] - sent[0]);
        if force_change.min(force) * FIRMEST_PATH >= 2.0 * self.resolution
            && self.past[LEAD_POSITIONS..].iter().all(is_unmoved)
        {
            self.response = FIRMEST_RESPONSE;
            return Answer::Unmoved;
        }
        let signed_sum = sign * self.sum();
        if signed_sum.abs() < self.least_answer() || signed_sum.abs() > self.greatest_response * force {
            self.response = (0.5 * self.response).max(FIRMEST_RESPONSE);
            return Answer::Hidden;
        }
        self.response = (signed_sum.abs() / force).max(FIRMEST_RESPONSE);
        if signed_sum > 0.0 { Answer::Right } else { Answer::Wrong }
    }

    /// The weighted sum of the newest positions [m].
    fn sum(&self) -> f64 {
        let first_position = self.past[0];
        let weighted = self.past.iter().zip(WEIGHTS);
        weighted.map(|(x, weight)| (x - first_position) * weight).sum()
    }
}

#[cfg(test)]
mod tests;
