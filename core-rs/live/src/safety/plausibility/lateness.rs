//! The work that the motor does on the hand if force or position come later than the device reports.
//!
//! A spring that acts late drives the key to and fro, and the work by the positions that are reported is about zero
//! meanwhile. So the work is summed for forces that are late by each of some lags. Under a force of angular frequency ω
//! the sum is greatest for a lag of a quarter of the period, whatever the real delay is, so a few lags show any swing.
//! A hand that moves a key on a spring shows the same work, and only a response in time tells that nothing is late.

/// The lags [s], besides the delay that the device reports. Any swing with a period from 36 ms to 1.2 s shows at least
/// four fifths of its work at one of them.
const LAG_SECONDS: [f64; 9] = [0.009, 0.014, 0.021, 0.032, 0.048, 0.075, 0.12, 0.19, 0.3];
/// Number of forces that are kept: the longest lag, and a delay of some milliseconds, at 6,000 steps a second.
const FORCES_STORED: usize = 2_048;

/// Parts of the work that may be done at once. From the first on a test is made early; from the second on it waits
/// until the motion of the key is known, because a swing hides responses or imitates them; at the last the force ends.
const TEST_SHARE: f64 = 0.03;
const SWING_SHARE: f64 = 0.1;
const END_SHARE: f64 = 0.5;
/// The second time within this time is no chance [s]: with a late channel the force ends again after 2 to 4 s, and
/// under the hardest strokes of a healthy hand after more than a minute.
const REPEAT_SECONDS: f64 = 10.0;

/// Time after which nothing that is late by up to 300 ms comes any more [s].
pub(super) const LATE_EFFECTS_SECONDS: f64 = 0.31;

/// The work of late forces on an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lateness {
    /// Forces that were sent [N], in a ring, and the place of the newest.
    sent_forces: [f32; FORCES_STORED],
    newest_index: usize,
    lag_steps: [usize; LAG_SECONDS.len()],
    /// Work for each lag since the latest response in time [J].
    work: [f64; LAG_SECONDS.len()],
    /// Work that may be done at once [J], and in each step for long [J].
    work_max: f64,
    work_refill: f64,
    /// Length of a step, and time since the force ended because of this work [s].
    step_seconds: f64,
    seconds_since_end: f64,
}

impl Lateness {
    /// For steps of `step` [s] of a device that reports a `delay` [s], and the `energy` [J] and `power` [W]
    /// that its motor may give to a hand at once and for long.
    pub(super) fn new(step: f64, delay: f64, energy: f64, power: f64) -> Self {
        let lag_steps = |lag: f64| (((lag + delay) / step).round() as usize).min(FORCES_STORED - 1);
        Self {
            sent_forces: [0.0; FORCES_STORED],
            newest_index: 0,
            lag_steps: LAG_SECONDS.map(lag_steps),
            work: [0.0; LAG_SECONDS.len()],
            work_max: energy,
            work_refill: power * step,
            step_seconds: step,
            seconds_since_end: f64::INFINITY,
        }
    }

    /// Take the force `sent` before a step [N], and the movement in it [m].
    pub(super) fn add_step(&mut self, sent: f64, displacement: f64) {
        self.newest_index = (self.newest_index + 1) % FORCES_STORED;
        self.sent_forces[self.newest_index] = sent as f32;
        self.seconds_since_end += self.step_seconds;
        for (work, lag) in self.work.iter_mut().zip(self.lag_steps) {
            let lagged_force = f64::from(self.sent_forces[(self.newest_index + FORCES_STORED - lag) % FORCES_STORED]);
            *work = (*work + lagged_force * displacement - self.work_refill).max(0.0);
        }
    }

    /// A response came in time.
    pub(super) fn reset_work(&mut self) {
        self.work = [0.0; LAG_SECONDS.len()];
    }

    /// Forget the forces too: motion and forces were missed.
    pub(super) fn restart(&mut self) {
        self.reset_work();
        self.sent_forces = [0.0; FORCES_STORED];
    }

    /// Whether a pulse test is due.
    pub(super) fn is_test_due(&self) -> bool {
        self.exceeds(TEST_SHARE)
    }

    /// Whether the key swings so much that a response may be chance.
    pub(super) fn is_swinging(&self) -> bool {
        self.exceeds(SWING_SHARE)
    }

    /// Whether the force has to end.
    pub(super) fn exceeds_limit(&self) -> bool {
        self.exceeds(END_SHARE)
    }

    /// Note that the force ends because of this work. Returns whether it did so a short time before.
    pub(super) fn record_end(&mut self) -> bool {
        let is_again = self.seconds_since_end <= REPEAT_SECONDS;
        self.seconds_since_end = 0.0;
        is_again
    }

    fn exceeds(&self, energy_share: f64) -> bool {
        self.work.iter().any(|work| *work > energy_share * self.work_max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A swing of 1 N and 10 mm whose force leads by a quarter of a period would do π·F·A in each period.
    #[test]
    fn late_work_of_swings_by_period() {
        for hertz in [0.85, 1.5, 3.0, 5.0, 8.0, 13.0, 20.0, 27.0] {
            let mut lateness = Lateness::new(1e-3, 0.0, 1.0, 0.0);
            let position_at = |t: f64| 0.01 * libm::sin(std::f64::consts::TAU * hertz * t);
            let periods = 12.0;
            let step_count = (periods / hertz * 1e3) as usize;
            for i in 0..step_count {
                let t = i as f64 * 1e-3;
                // The force of a spring in time: no work by the positions.
                lateness.add_step(-100.0 * position_at(t), position_at(t + 1e-3) - position_at(t));
            }
            let greatest_work = lateness.work.iter().copied().fold(0.0, f64::max);
            let full_work = std::f64::consts::PI * 0.01 * periods;
            assert!(
                greatest_work > 0.75 * full_work,
                "{hertz} Hz: {greatest_work} of {full_work}"
            );
        }
    }

    #[test]
    fn forget_late_work_after_an_response() {
        let mut lateness = Lateness::new(1e-3, 0.0, 1.0, 0.5);
        for i in 0..3_000 {
            let position_at = |i: i32| 0.02 * libm::sin(0.03 * f64::from(i));
            lateness.add_step(-500.0 * position_at(i), position_at(i + 1) - position_at(i));
        }
        assert!(lateness.is_test_due() && lateness.is_swinging() && lateness.exceeds_limit());
        assert!(!lateness.record_end() && lateness.record_end());
        lateness.reset_work();
        assert!(!lateness.is_test_due());
    }
}
