//! Whether the motor still pushes the way it is commanded: pulse tests are made again and again, and responses counted.

use super::AxisSpec;
use super::lateness::{LATE_EFFECTS_SECONDS, Lateness};
use super::observations::AxisParameters;
use super::pulse_test::{PulseResponse, PulseTester};
use crate::safety::TripCause;

/// Time for which a right response counts [s].
const CONFIRMATION_TIME: f64 = 0.2;
/// Work that the motor takes out of the key after which a pulse test is made early [J]: a motor that pushes the wrong
/// way does that work instead.
const TEST_WORK: f64 = 0.01;
/// Work that it may take out until a right response; then the force ends until there is one [J].
const UNVERIFIED_WORK_MAX: f64 = 0.75;
/// A force less than this is not judged [N].
const JUDGED_FORCE_MIN: f64 = 0.3;
/// Longest time with a greater force and without a right response, from the end of a confirmation on [s].
const UNANSWERED_SECONDS_MAX: f64 = 1.25;
/// Time without a right response after which tests no longer wait until the motion of a swing is known [s]: a healthy
/// hand that makes hard strokes needs more frequent ones, to be answered before `UNANSWERED_SECONDS_MAX` is over.
const SWING_WAIT_SECONDS: f64 = 0.5;
/// A sensor of greater steps is too coarse for pulse tests [m].
const RESOLUTION_MAX: f64 = 3e-5;
/// Number of wrong responses more than right ones that end the force.
const WRONG_BALANCE_MAX: u32 = 2;
/// Number of responses without any change of the sensor that mean that it is frozen.
const UNMOVED_RESPONSES_MAX: u32 = 2;
/// Part of the greatest force that is left for pulse tests, and the greatest such force [N].
const PULSE_FORCE_RESERVE: (f64, f64) = (0.15, 3.0);
/// Least part of a force that is taken to reach the key.
const PASS_SHARE_MIN: f64 = 0.05;
/// A force less than this does not show what part of it passes [N].
const PASS_FORCE_MIN: f64 = 0.1;

/// What is done with the force of the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// The piece's force acts, and pulse tests are made.
    Playing,
    /// A probe is under way.
    Probing,
    /// Only pulse tests act: their responses decide.
    Verifying,
    /// No force acts.
    Off,
}

/// What follows from a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Nothing.
    Continue,
    /// The force has to end until a response is right.
    Verify,
    /// While in verification: a response was right.
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
    pulse_tester: PulseTester,
    /// Whether pulse tests are made, and the force that is left for them [N].
    pub(super) has_pulse_tests: bool,
    pulse_force_max: f64,
    /// Greatest force [N].
    force_max: f64,
    /// Length of a step [s].
    step_seconds: f64,
    /// The force that was asked for last [N], and the part of a force that passes the later stages.
    last_force: f64,
    pass_share: f64,
    /// Time since the last right response [s]; time without one in which a force was judged [s]; work that the motor
    /// took out since then [J].
    seconds_since_right: f64,
    unanswered_seconds: f64,
    work_taken_out: f64,
    lateness: Lateness,
    /// Whether tests in verification wait until nothing late comes any more; time since a force or a pulse there [s].
    waits_for_late: bool,
    seconds_since_pulse: f64,
    /// Wrong responses less right ones, and responses without any change in a row.
    wrong_balance: u32,
    unmoved_count: u32,
    /// Whether a probe has interrupted the pulse tests since the last response.
    was_interrupted: bool,
}

impl Confirmation {
    pub(super) fn new(axis: AxisSpec, parameters: &AxisParameters) -> Self {
        let force_max = axis.force_max.max(0.0);
        let has_pulse_tests = parameters.resolution <= RESOLUTION_MAX;
        let (room_share, room_max) = PULSE_FORCE_RESERVE;
        let pulse_room = (room_share * force_max).min(room_max);
        let AxisParameters {
            step_seconds: step,
            mass,
            resolution,
            ..
        } = *parameters;
        Self {
            pulse_tester: PulseTester::new(step, mass, resolution, axis.delay_seconds),
            has_pulse_tests,
            pulse_force_max: if has_pulse_tests { pulse_room } else { 0.0 },
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

    /// Forget earlier responses.
    pub(super) fn reset(&mut self) {
        self.pulse_tester.restart();
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
        self.pulse_tester.restart();
        self.was_interrupted = true;
    }

    /// Begin a time without the piece's force.
    pub(super) fn begin_verification(&mut self) {
        self.pulse_tester.restart();
        self.wrong_balance = 0;
        (self.waits_for_late, self.seconds_since_pulse) = (self.lateness.is_swinging(), 0.0);
        self.lateness.reset_work();
    }

    /// What a verification means that no response has ended.
    pub(super) fn unverified_fault(&self) -> TripCause {
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

    /// The force with the pulses of a pulse test [N]. A force near the greatest is lowered, so that pulses are not
    /// clamped.
    pub(super) fn add_pulses(&self, asked_force: f64) -> f64 {
        let force_limit = self.force_max - self.pulse_force_max;
        let lowered_force = if self.has_pulse_tests && asked_force.abs() > force_limit {
            force_limit.copysign(asked_force)
        } else {
            asked_force
        };
        let pulse_force = self.pulse_tester.pulse_force();
        if pulse_force == 0.0 {
            lowered_force
        } else {
            lowered_force + pulse_force
        }
    }

    /// Whether a response is overdue that probes have prevented: they have to wait.
    pub(super) fn precedes_probes(&self, is_at_stop: bool) -> bool {
        self.has_pulse_tests && self.was_interrupted && self.seconds_since_right >= CONFIRMATION_TIME && !is_at_stop
    }

    /// Advance by a step.
    pub(super) fn advance(&mut self, judged_step: JudgedStep) -> Verdict {
        let response = self.pulse_tester.add_step(
            judged_step.position,
            judged_step.sent_force,
            self.lateness.is_test_due(),
        );
        self.seconds_since_right += self.step_seconds;
        self.work_taken_out = (self.work_taken_out - judged_step.sent_force * judged_step.displacement).max(0.0);
        self.lateness.add_step(judged_step.sent_force, judged_step.displacement);
        if let Some(response) = response {
            self.seconds_since_pulse = 0.0;
            // Pulses do not move a key that is held at its stop.
            let is_blocked_by_stop = response == PulseResponse::Unmoved && judged_step.is_at_stop;
            let response = if is_blocked_by_stop {
                PulseResponse::Hidden
            } else {
                response
            };
            let verdict = self.count_response(response, judged_step.phase);
            if verdict != Verdict::Continue {
                return verdict;
            }
        }
        if !self.has_pulse_tests || judged_step.phase == Phase::Off {
            return Verdict::Continue;
        }
        if judged_step.phase == Phase::Verifying {
            self.seconds_since_pulse += self.step_seconds;
            let is_lateness_over = !self.waits_for_late || self.seconds_since_pulse > LATE_EFFECTS_SECONDS;
            if self.pulse_tester.is_noise_known() && is_lateness_over {
                self.pulse_tester
                    .begin(self.pulse_force_max, self.pass_share, self.waits_for_late);
            }
            return Verdict::Continue;
        }
        if self.lateness.exceeds_limit() {
            return if self.lateness.record_end() {
                Verdict::Fault(TripCause::Late)
            } else {
                Verdict::Verify
            };
        }
        if judged_step.sent_force.abs() < JUDGED_FORCE_MIN || judged_step.is_at_stop {
            return Verdict::Continue;
        }
        if self.work_taken_out > UNVERIFIED_WORK_MAX {
            return Verdict::Verify;
        }
        let is_overdue = self.seconds_since_right >= CONFIRMATION_TIME;
        if is_overdue {
            self.unanswered_seconds += self.step_seconds;
            if self.unanswered_seconds >= UNANSWERED_SECONDS_MAX {
                return Verdict::Fault(TripCause::Unanswered);
            }
        }
        let is_test_due =
            is_overdue || self.work_taken_out > TEST_WORK || self.lateness.is_test_due() || judged_step.may_be_frozen;
        let may_begin = if self.lateness.is_swinging() && self.unanswered_seconds < SWING_WAIT_SECONDS {
            self.pulse_tester.is_swing_noise_known()
        } else {
            self.pulse_tester.may_begin()
        };
        if is_test_due && judged_step.phase == Phase::Playing && may_begin {
            self.pulse_tester
                .begin(self.pulse_force_max, self.pass_share, self.lateness.is_test_due());
        }
        Verdict::Continue
    }

    fn count_response(&mut self, response: PulseResponse, phase: Phase) -> Verdict {
        self.was_interrupted = false;
        self.unmoved_count = if response == PulseResponse::Unmoved {
            self.unmoved_count + 1
        } else {
            0
        };
        let is_verifying = phase == Phase::Verifying;
        match response {
            PulseResponse::Right if is_verifying => return Verdict::Right,
            // A right response after a wrong one is not enough.
            PulseResponse::Right if self.wrong_balance > 0 => self.wrong_balance -= 1,
            PulseResponse::Right => self.confirm(),
            PulseResponse::Wrong => {
                self.wrong_balance += 1;
                if self.wrong_balance >= WRONG_BALANCE_MAX {
                    return if is_verifying {
                        Verdict::Fault(TripCause::WrongWay)
                    } else {
                        Verdict::Verify
                    };
                }
            }
            PulseResponse::Unmoved if self.unmoved_count >= UNMOVED_RESPONSES_MAX => {
                return Verdict::Fault(TripCause::Frozen);
            }
            PulseResponse::Unmoved | PulseResponse::Hidden => {}
        }
        Verdict::Continue
    }

    /// A response was right and in time.
    pub(super) fn confirm(&mut self) {
        self.lateness.reset_work();
        (self.seconds_since_right, self.unanswered_seconds, self.work_taken_out) = (0.0, 0.0, 0.0);
    }
}
