//! A hand while it plays, moved by a person or by its stand-in, and the transition between them.

use super::guidance::{Guidance, WrittenMotion, smooth_step};
use super::hand_limit::MeasuredKey;

/// Largest motion of the key in one tick of a transition [m].
const STEP_METRES_MAX: f64 = 5e-5;
/// Least and greatest number of ticks of a transition.
const TICKS_RANGE: (f64, f64) = (20.0, 4_000.0);
/// Greatest slope of [`smooth_step`], the transition from 0 to 1 over a length of 1.
const SMOOTH_SLOPE_MAX: f64 = 1.875;

/// A hand of the piece.
#[derive(Clone, Debug, Default)]
pub struct LiveHand {
    /// Position at each tick while no person plays [m of the key]; the last one holds.
    pub standin_positions: Vec<f64>,
    /// Force that moves the measured key along these positions, in each tick that begins at one of them [N]; the last
    /// one holds. Empty: nothing drives the key.
    pub forces: Vec<f64>,
    /// Tick of the first of these positions.
    pub start_tick: u64,
    /// Factor from the travel of the key to that in the piece, and from the force of the piece to that on the key.
    pub travel_ratio: f64,
    /// The guidance of the hand.
    pub guidance: Option<Guidance>,
    /// Force of the piece against the key [N/m] in each tick after the key was displaced by 1 m for one tick,
    /// (n_ticks,); empty: not computed.
    pub piece_response: Vec<f64>,
    /// The measured key, if there is a calibration.
    pub measured_key: Option<MeasuredKey>,
}

/// Who moves a key, and the state of the transition from the source before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HandSource {
    /// Whether a person moves the key; otherwise its stand-in does.
    pub(super) is_real: bool,
    /// Position of the key [m].
    pub(super) x: f64,
    /// Distance between both sources at the beginning of a transition [m]; the ticks that the transition takes, and
    /// those done.
    offset: f64,
    transition_ticks: f64,
    transition_progress: f64,
}

impl LiveHand {
    /// Position of the stand-in at a tick [m].
    pub(super) fn standin_position(&self, tick: u64) -> f64 {
        self.value_at(&self.standin_positions, tick)
    }

    /// The written motion for a force that is sent in `tick`, in ticks of `period` [s]: the newest position is of the
    /// tick before. In lockstep the force acts from that position on, else from the next one on.
    pub(super) fn written_motion(&self, tick: u64, period: f64, lockstep: bool) -> WrittenMotion {
        if self.forces.is_empty() {
            let x = self.standin_position(tick);
            return WrittenMotion {
                x,
                ..WrittenMotion::default()
            };
        }
        let newest_tick = tick.saturating_sub(1);
        let x = self.standin_position(newest_tick);
        WrittenMotion {
            x,
            v: (x - self.standin_position(newest_tick.saturating_sub(1))) / period,
            force: self.value_at(&self.forces, if lockstep { newest_tick } else { tick }),
        }
    }

    /// The value of a tick; the last one holds.
    fn value_at(&self, values: &[f64], tick: u64) -> f64 {
        let value_index = usize::try_from(tick.saturating_sub(self.start_tick)).unwrap_or(usize::MAX);
        let last_index = values.len().saturating_sub(1);
        values.get(value_index.min(last_index)).copied().unwrap_or(0.0)
    }
}

impl HandSource {
    /// Begin a transition to another source of the key, who is at `x`.
    pub(super) fn change_source(&mut self, is_real: bool, x: f64) {
        self.is_real = is_real;
        self.offset = self.x - x;
        self.transition_ticks =
            (SMOOTH_SLOPE_MAX * self.offset.abs() / STEP_METRES_MAX).clamp(TICKS_RANGE.0, TICKS_RANGE.1);
        self.transition_progress = 0.0;
    }

    /// Position of the key in this tick, if its source is at `x`.
    pub(super) fn follow(&mut self, x: f64) -> f64 {
        self.x = if self.transition_progress < self.transition_ticks {
            self.transition_progress += 1.0;
            x + self.offset * (1.0 - self.progress())
        } else {
            x
        };
        self.x
    }

    /// Progress of the transition, 0 to 1; a person feels this share of the force.
    pub(super) fn progress(&self) -> f64 {
        if self.transition_progress < self.transition_ticks {
            smooth_step(self.transition_progress / self.transition_ticks)
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A driven key: its position is compared with that of the same tick, and the force that is sent acts in the tick
    /// after it, or a tick later where the device does not wait for it.
    #[test]
    fn written_motion_by_tick_and_lockstep() {
        let driven_hand = LiveHand {
            standin_positions: vec![0.0, 1e-3, 3e-3],
            forces: vec![0.1, 0.2, 0.3],
            start_tick: 10,
            ..LiveHand::default()
        };
        let motion = |tick, lockstep| driven_hand.written_motion(tick, 1e-3, lockstep);
        let third_motion = motion(12, true);
        assert_eq!((third_motion.x, third_motion.force), (1e-3, 0.2));
        assert!((third_motion.v - 1.0).abs() < 1e-12);
        assert_eq!(motion(12, false).force, 0.3);
        let final_motion = motion(20, true);
        assert_eq!((final_motion.x, final_motion.v, final_motion.force), (3e-3, 0.0, 0.3));
        let guided_hand = LiveHand {
            forces: Vec::new(),
            ..driven_hand
        };
        let motion = guided_hand.written_motion(11, 1e-3, true);
        assert_eq!((motion.x, motion.v, motion.force), (1e-3, 0.0, 0.0));
    }

    #[test]
    fn hand_source_changes_without_a_jump() {
        for apart in [1e-5, 3e-3, -12e-3, 60e-3] {
            let mut hand_source = HandSource::default();
            hand_source.follow(0.0);
            hand_source.change_source(true, apart);
            let mut last_position = 0.0;
            let mut tick_count = 0;
            while hand_source.progress() < 1.0 {
                let followed_position = hand_source.follow(apart);
                assert!(
                    (followed_position - last_position).abs() < 1e-4,
                    "{} mm",
                    1e3 * (followed_position - last_position)
                );
                last_position = followed_position;
                tick_count += 1;
            }
            assert_eq!(last_position, apart);
            assert!((20..=4_000).contains(&tick_count), "{tick_count} ticks");
        }
    }
}
