//! A port of a slow body that a hand leads along a path.
//!
//! Its springs pull once in R frames, for R frames. Between two pulls a free port is therefore first ahead of its true
//! velocity by half a pull, and behind by as much before the next. A hand that has it pass a point at every frame
//! takes that away: each time before the springs pull, and where the hand lets go, it is given back.

use super::RunningSlow;

impl RunningSlow {
    /// What a port has of its last pull for each frame [m a frame].
    fn pull(&self, mat: usize) -> f64 {
        let port = self.plan.ports.iter().find(|port| port.1 == mat);
        port.map_or(0.0, |&(own, _)| {
            self.kick[own] / f64::from(self.plan.macrostep)
        })
    }

    /// By how much a free port is ahead of its true velocity, so many frames after a pull [pulls for a frame].
    pub(super) fn ahead(&self, since: u32) -> f64 {
        0.5 + 0.5 * f64::from(self.plan.macrostep) - f64::from(since)
    }

    /// What a port that was led to this frame needs to go on as a free one [m a frame].
    pub(crate) fn release(&self, mat: usize) -> f64 {
        if self.since == 0 {
            return 0.0; // given already
        }
        self.pull(mat) * self.ahead(self.since)
    }

    /// The same, where the next frame is that of a pull.
    pub(crate) fn release_at_pull(&self, mat: usize) -> f64 {
        let every = self.plan.macrostep;
        if self.since + 1 < every {
            return 0.0;
        }
        self.pull(mat) * self.ahead(every)
    }

    /// Give it to a port of the island at the end of this frame.
    pub(crate) fn give(&mut self, mat: usize, velocity: f64) {
        let ports = self.plan.ports.iter().zip(&mut self.given);
        for (_, given) in ports.filter(|(port, _)| port.1 == mat) {
            *given += velocity;
        }
    }

    /// What two frames do not tell of a port's velocity [m a frame] and of its change a frame.
    pub(crate) fn lack(&self, mat: usize, is_led: bool) -> [f64; 2] {
        let every = f64::from(self.plan.macrostep);
        let pull = self.pull(mat);
        match (self.since, is_led) {
            (0, false) => [0.0, pull * (1.0 - every)],
            (0, true) => [0.25 * pull * (1.0 - every), 0.5 * pull * (1.0 - every)],
            (since, false) => [pull * (f64::from(since) - 0.5 * every), pull],
            (_, true) => [0.0, 0.0],
        }
    }
}
