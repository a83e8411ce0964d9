//! A port of a slow body that a hand leads along a path.
//!
//! Its springs pull once in R frames, with the impulse of R frames. Between two pulls a free port is therefore ahead of
//! its true velocity by half a pull at first, and behind by as much before the next. A hand that makes the port pass a
//! point at every frame removes this difference. It is given back each time before the springs pull, and when the hand
//! lets go.

use super::RunningSlow;

impl RunningSlow {
    /// The last pull of a port, per frame between pulls [m a frame].
    fn last_pull(&self, mat: usize) -> f64 {
        let led_port = self.plan.ports.iter().find(|led_port| led_port.1 == mat);
        led_port.map_or(0.0, |&(port_index, _)| {
            self.last_kick[port_index] / f64::from(self.plan.kick_interval)
        })
    }

    /// By how much a free port is ahead of its true velocity `frames_since_kick` frames after a pull, as a multiple of
    /// the last pull.
    pub(super) fn velocity_lead(&self, frames_since_kick: u32) -> f64 {
        0.5 + 0.5 * f64::from(self.plan.kick_interval) - f64::from(frames_since_kick)
    }

    /// Velocity that a port that was led to this frame needs in order to continue as a free one [m a frame].
    pub(crate) fn release_velocity(&self, mat: usize) -> f64 {
        if self.frames_since_kick == 0 {
            return 0.0; // `pull_release_velocity` gave it already
        }
        self.last_pull(mat) * self.velocity_lead(self.frames_since_kick)
    }

    /// The same, if the springs pull in the next frame; else 0.
    pub(crate) fn pull_release_velocity(&self, mat: usize) -> f64 {
        let kick_interval = self.plan.kick_interval;
        if self.frames_since_kick + 1 < kick_interval {
            return 0.0;
        }
        self.last_pull(mat) * self.velocity_lead(kick_interval)
    }

    /// Add a velocity to a port of the island at the end of this frame.
    pub(crate) fn add_velocity(&mut self, mat: usize, velocity: f64) {
        let port_velocities = self.plan.ports.iter().zip(&mut self.hand_velocities);
        for (_, hand_velocity) in port_velocities.filter(|(port, _)| port.1 == mat) {
            *hand_velocity += velocity;
        }
    }

    /// Corrections of a port's velocity [m a frame] and of its change a frame, if both are estimated from successive
    /// frames.
    pub(crate) fn estimate_corrections(&self, mat: usize, is_led: bool) -> [f64; 2] {
        let kick_interval = f64::from(self.plan.kick_interval);
        let pull_velocity = self.last_pull(mat);
        match (self.frames_since_kick, is_led) {
            (0, false) => [0.0, pull_velocity * (1.0 - kick_interval)],
            (0, true) => [
                0.25 * pull_velocity * (1.0 - kick_interval),
                0.5 * pull_velocity * (1.0 - kick_interval),
            ],
            (frames_since_kick, false) => [
                pull_velocity * (f64::from(frames_since_kick) - 0.5 * kick_interval),
                pull_velocity,
            ],
            (_, true) => [0.0, 0.0],
        }
    }
}
