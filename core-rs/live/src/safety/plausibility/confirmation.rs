//! Whether the motor still pushes the way it is commanded: questions are asked again and again, and answers counted.

use super::AxisSpec;
use super::lateness::{LATE_EFFECTS_SECONDS, Lateness};
use super::observations::AxisParameters;
use super::question::{QuestionAnswer, Questions};
use crate::safety::TripCause;

/// Time for which a right answer counts [s].
const CONFIRMATION_TIME: f64 = 0.2;
/// Work that the motor takes out of the key after which a question is asked early [J]: a motor that pushes the wrong
/// way does that work instead.
const QUESTION_WORK: f64 = 0.01;
/// Work that it may take out until a right answer; then the force ends until there is one [J].
const DOUBT_WORK: f64 = 0.75;
/// A force less than this is not judged [N].
const JUDGED_FORCE_MIN: f64 = 0.3;
/// Longest time with a greater force and without a right answer, from the end of a confirmation on [s].
const UNANSWERED_SECONDS_MAX: f64 = 1.25;
/// Time without a right answer after which questions no longer wait until the motion of a swing is known [s]: a healthy
/// hand that makes hard strokes needs more frequent ones, to be answered before `UNANSWERED_SECONDS_MAX` is over.
const SWING_WAIT_SECONDS: f64 = 0.5;
/// A sensor of greater steps is too coarse for questions [m].
const RESOLUTION_MAX: f64 = 3e-5;
/// Number of wrong answers more than right ones that end the force.
const WRONG_BALANCE_MAX: u32 = 2;
/// Number of answers without any change of the sensor that mean that it is frozen.
const UNMOVED_ANSWERS_MAX: u32 = 2;
/// Part of the greatest force that is left for questions, and the greatest such force [N].
const PULSE_FORCE_RESERVE: (f64, f64) = (0.15, 3.0);
/// Least part of a force that is taken to reach the key.
const PASS_SHARE_MIN: f64 = 0.05;
/// A force less than this does not show what part of it passes [N].
const PASS_FORCE_MIN: f64 = 0.1;

/// What is done with the force of the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// The piece's force acts, and questions are asked.
    Playing,
    /// A probe is under way.
    Probing,
    /// Only questions act: their answers decide.
    Doubting,
    /// No force acts.
    Off,
}

/// What follows from a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Nothing.
    Continue,
    /// The force has to end until an answer is right.
    Doubt,
    /// While in doubt: an answer was right.
    Right,
    /// The fault is certain.
    Fault(TripCause),
}

/// A step as it is judged.
#[derive(Clone, Copy, Debug)]
pub(super) struct JudgedStep {
    /// Position, and movement since the step before [m].
    pub(super) position: f64,
    pub(super) displacement: f64,
    /// Force that was sent [N].
    pub(super) sent_force: f64,
    pub(super) phase: Phase,
    /// Whether the key is at a stop, where pulses do not move it.
    pub(super) is_at_stop: bool,
    /// Whether the sensor may be frozen.
    pub(super) may_be_frozen: bool,
}

/// The confirmations of an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Confirmation {
    questions: Questions,
    /// Whether questions are asked, and the force that is left for them [N].
    pub(super) is_asking: bool,
    pulse_force_max: f64,
    /// Greatest force [N].
    force_max: f64,
    /// Length of a step [s].
    step_seconds: f64,
    /// The force that was asked for last [N], and the part of a force that passes the later stages.
    last_force: f64,
    pass_share: f64,
    /// Time since the last right answer [s]; time without one in which a force was judged [s]; work that the motor took
    /// out since then [J].
    seconds_since_right: f64,
    unanswered_seconds: f64,
    work_taken_out: f64,
    lateness: Lateness,
    /// Whether questions in doubt wait until nothing late comes any more; time since a force or a pulse there [s].
    waits_for_late: bool,
    seconds_since_pulse: f64,
    /// Wrong answers less right ones, and answers without any change in a row.
    wrong_balance: u32,
    unmoved_count: u32,
    /// Whether a probe has interrupted the questions since the last answer.
    was_interrupted: bool,
}

impl Confirmation {
    pub(super) fn new(axis: AxisSpec, parameters: &AxisParameters) -> Self {
        let force_max = axis.force_max.max(0.0);
        let is_asking = parameters.resolution <= RESOLUTION_MAX;
        let (room_share, room_max) = PULSE_FORCE_RESERVE;
        let pulse_room = (room_share * force_max).min(room_max);
        let AxisParameters {
            step_seconds: step,
            mass,
            resolution,
            ..
        } = *parameters;
        Self {
            questions: Questions::new(step, mass, resolution, axis.delay_seconds),
            is_asking,
            pulse_force_max: if is_asking { pulse_room } else { 0.0 },
            force_max,
            step_seconds: step,
            last_force: 0.0,
            pass_share: 1.0,
            seconds_since_right: f64::INFINITY,
            unanswered_seconds: 0.0,
            work_taken_out: 0.0,
            lateness: Lateness::new(step, axis.delay_seconds, axis.energy_max, axis.power_max),
            waits_for_late: false,
            seconds_since_pulse: 0.0,
            wrong_balance: 0,
            unmoved_count: 0,
            was_interrupted: false,
        }
    }

    /// Forget earlier answers.
    pub(super) fn reset(&mut self) {
        self.questions.restart();
        (self.wrong_balance, self.unmoved_count, self.was_interrupted) = (0, 0, false);
        (self.seconds_since_right, self.unanswered_seconds, self.work_taken_out) = (f64::INFINITY, 0.0, 0.0);
        self.lateness.reset_work();
    }

    /// Forget earlier positions and forces: both were missed.
    pub(super) fn restart(&mut self) {
        self.interrupt();
        self.lateness.restart();
    }

    /// Forget earlier positions: a probe moves the key.
    pub(super) fn interrupt(&mut self) {
        self.questions.restart();
        self.was_interrupted = true;
    }

    /// Begin a time without the piece's force.
    pub(super) fn begin_doubt(&mut self) {
        self.questions.restart();
        self.wrong_balance = 0;
        (self.waits_for_late, self.seconds_since_pulse) = (self.lateness.is_swinging(), 0.0);
        self.lateness.reset_work();
    }

    /// What a doubt means that no answer has ended.
    pub(super) fn fault_of_doubt(&self) -> TripCause {
        if self.waits_for_late {
            TripCause::Late
        } else {
            TripCause::WrongWay
        }
    }

    /// The part of a force that passes the later stages, by the last force `sent_force` [N].
    pub(super) fn update_pass_share(&mut self, sent_force: f64) -> f64 {
        if self.last_force.abs() > PASS_FORCE_MIN {
            self.pass_share = (sent_force / self.last_force).clamp(PASS_SHARE_MIN, 1.0);
        }
        self.pass_share
    }

    /// Note the force that is asked for [N].
    pub(super) fn note_force(&mut self, force: f64) {
        self.last_force = if force.is_finite() {
            force.clamp(-self.force_max, self.force_max)
        } else {
            0.0
        };
    }

    /// The force with the pulses of a question [N]. A force near the greatest is lowered, so that pulses are not
    /// clamped.
    pub(super) fn with_pulses(&self, asked_force: f64) -> f64 {
        let force_limit = self.force_max - self.pulse_force_max;
        let lowered_force = if self.is_asking && asked_force.abs() > force_limit {
            force_limit.copysign(asked_force)
        } else {
            asked_force
        };
        let pulse_force = self.questions.pulse_force();
        if pulse_force == 0.0 {
            lowered_force
        } else {
            lowered_force + pulse_force
        }
    }

    /// Whether an answer is overdue that probes have prevented: they have to wait.
    pub(super) fn comes_first(&self, is_at_stop: bool) -> bool {
        self.is_asking && self.was_interrupted && self.seconds_since_right >= CONFIRMATION_TIME && !is_at_stop
    }

    /// Advance by a step.
    pub(super) fn advance(&mut self, judged_step: JudgedStep) -> Verdict {
        let answer = self.questions.add_step(
            judged_step.position,
            judged_step.sent_force,
            self.lateness.is_question_due(),
        );
        self.seconds_since_right += self.step_seconds;
        self.work_taken_out = (self.work_taken_out - judged_step.sent_force * judged_step.displacement).max(0.0);
        self.lateness.add_step(judged_step.sent_force, judged_step.displacement);
        if let Some(answer) = answer {
            self.seconds_since_pulse = 0.0;
            // Pulses do not move a key that is held at its stop.
            let is_blocked_by_stop = answer == QuestionAnswer::Unmoved && judged_step.is_at_stop;
            let answer = if is_blocked_by_stop {
                QuestionAnswer::Hidden
            } else {
                answer
            };
            let verdict = self.note_answer(answer, judged_step.phase);
            if verdict != Verdict::Continue {
                return verdict;
            }
        }
        if !self.is_asking || judged_step.phase == Phase::Off {
            return Verdict::Continue;
        }
        if judged_step.phase == Phase::Doubting {
            self.seconds_since_pulse += self.step_seconds;
            let is_past_lateness = !self.waits_for_late || self.seconds_since_pulse > LATE_EFFECTS_SECONDS;
            if self.questions.is_calm() && is_past_lateness {
                self.questions
                    .begin(self.pulse_force_max, self.pass_share, self.waits_for_late);
            }
            return Verdict::Continue;
        }
        if self.lateness.is_too_great() {
            return if self.lateness.note_end() {
                Verdict::Fault(TripCause::Late)
            } else {
                Verdict::Doubt
            };
        }
        if judged_step.sent_force.abs() < JUDGED_FORCE_MIN || judged_step.is_at_stop {
            return Verdict::Continue;
        }
        if self.work_taken_out > DOUBT_WORK {
            return Verdict::Doubt;
        }
        let is_overdue = self.seconds_since_right >= CONFIRMATION_TIME;
        if is_overdue {
            self.unanswered_seconds += self.step_seconds;
            if self.unanswered_seconds >= UNANSWERED_SECONDS_MAX {
                return Verdict::Fault(TripCause::Unanswered);
            }
        }
        let is_question_due = is_overdue
            || self.work_taken_out > QUESTION_WORK
            || self.lateness.is_question_due()
            || judged_step.may_be_frozen;
        let may_begin = if self.lateness.is_swinging() && self.unanswered_seconds < SWING_WAIT_SECONDS {
            self.questions.is_very_calm()
        } else {
            self.questions.may_begin()
        };
        if is_question_due && judged_step.phase == Phase::Playing && may_begin {
            self.questions
                .begin(self.pulse_force_max, self.pass_share, self.lateness.is_question_due());
        }
        Verdict::Continue
    }

    fn note_answer(&mut self, answer: QuestionAnswer, phase: Phase) -> Verdict {
        self.was_interrupted = false;
        self.unmoved_count = if answer == QuestionAnswer::Unmoved {
            self.unmoved_count + 1
        } else {
            0
        };
        let is_in_doubt = phase == Phase::Doubting;
        match answer {
            QuestionAnswer::Right if is_in_doubt => return Verdict::Right,
            // A right answer after a wrong one is not enough.
            QuestionAnswer::Right if self.wrong_balance > 0 => self.wrong_balance -= 1,
            QuestionAnswer::Right => self.confirm(),
            QuestionAnswer::Wrong => {
                self.wrong_balance += 1;
                if self.wrong_balance >= WRONG_BALANCE_MAX {
                    return if is_in_doubt {
                        Verdict::Fault(TripCause::WrongWay)
                    } else {
                        Verdict::Doubt
                    };
                }
            }
            QuestionAnswer::Unmoved if self.unmoved_count >= UNMOVED_ANSWERS_MAX => {
                return Verdict::Fault(TripCause::Frozen);
            }
            QuestionAnswer::Unmoved | QuestionAnswer::Hidden => {}
        }
        Verdict::Continue
    }

    /// An answer was right and in time.
    pub(super) fn confirm(&mut self) {
        self.lateness.reset_work();
        (self.seconds_since_right, self.unanswered_seconds, self.work_taken_out) = (0.0, 0.0, 0.0);
    }
}
