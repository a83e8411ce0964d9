//! Live strikes on an island: impulses that arrive while it plays, each applied from the next step on.

use crate::archive::state;
use crate::scheme::Scheme;
use crate::state::ModuleState;
use crate::timeline::{Drive, DriveSource, Timeline};

/// A MAT that may be struck while it plays.
#[derive(Clone, Debug)]
pub(super) struct StrikePoint {
    mat: usize,
    /// Number of the point in the scene.
    point: u32,
    /// Share of an impulse in each step from the next one on   (n_steps)
    step_shares: Vec<f64>,
}

/// The impulses that a point has still to receive.
#[derive(Clone, Debug)]
pub(super) struct PendingStrikes {
    /// In each step from the next one on [N·s]   (n_steps)
    impulses: Vec<f64>,
    /// Steps until the last of them.
    steps_left: usize,
}

state!(PendingStrikes { impulses, steps_left });

/// The strike points among drives.
pub(super) fn strike_points(timeline: &Timeline) -> Vec<StrikePoint> {
    let strike_point = |drive: &Drive| match drive.source {
        DriveSource::Strikes { point, n_parts } => Some(StrikePoint {
            mat: drive.mat,
            point,
            step_shares: timeline.impulse_share_by_step(n_parts),
        }),
        _ => None,
    };
    timeline.drives.iter().filter_map(strike_point).collect()
}

impl PendingStrikes {
    /// For each point.
    pub(super) fn without_impulses(strike_points: &[StrikePoint]) -> Vec<Self> {
        let silent_point = |point: &StrikePoint| Self {
            impulses: vec![0.0; point.step_shares.len()],
            steps_left: 0,
        };
        strike_points.iter().map(silent_point).collect()
    }

    /// Whether anything acts in the next step or later.
    pub(super) fn has_impulses(&self) -> bool {
        self.steps_left > 0
    }

    fn add_strike(&mut self, shares: &[f64], impulse: f64) {
        if impulse != 0.0 {
            let pending_impulses = self.impulses.iter_mut().zip(shares);
            pending_impulses.for_each(|(pending_impulse, share)| *pending_impulse += share * impulse);
            self.steps_left = shares.len();
        }
    }

    /// The impulse of this step [N·s].
    fn take_next(&mut self) -> f64 {
        let next_impulse = self.impulses[0];
        self.impulses.copy_within(1.., 0);
        if let Some(last_impulse) = self.impulses.last_mut() {
            *last_impulse = 0.0;
        }
        self.steps_left -= 1;
        next_impulse
    }
}

/// Adds the forces of the impulses to this step. A muted MAT takes none.
pub(super) fn apply_strikes(
    strike_points: &[StrikePoint],
    pending_strikes: &mut [PendingStrikes],
    scheme: &Scheme,
    modules: &mut ModuleState,
) {
    let points_and_strikes = strike_points.iter().zip(pending_strikes);
    for (strike_point, point_strikes) in points_and_strikes.filter(|(_, point_strikes)| point_strikes.has_impulses()) {
        let impulse = point_strikes.take_next();
        if impulse != 0.0 && scheme.w[strike_point.mat] != 0.0 {
            modules.push(strike_point.mat, impulse * scheme.rate);
        }
    }
}

impl super::ExcitationSources {
    /// Whether live strikes act in the next step or later.
    pub(super) fn has_pending_strikes(&self) -> bool {
        self.pending_strikes.iter().any(PendingStrikes::has_impulses)
    }
}

impl super::Island {
    /// Strike a point of the scene by an impulse [N·s] from the next step on; false if the point is not in this island.
    pub(crate) fn strike_point(&mut self, point: u32, impulse: f64) -> bool {
        let mut has_point = false;
        let strike_points = self.script.strike_points.iter();
        for (strike_point, point_strikes) in strike_points.zip(&mut self.state.sources.pending_strikes) {
            if strike_point.point == point {
                point_strikes.add_strike(&strike_point.step_shares, impulse);
                has_point = true;
            }
        }
        if has_point {
            self.wake();
        }
        has_point
    }

    /// Take over what the points of another island have still to receive, where it has the same points.
    pub(crate) fn continue_strikes(&mut self, old: &Self) {
        let strikes = old.script.strike_points.iter().zip(&old.state.sources.pending_strikes);
        for (old_point, old_pending) in strikes.filter(|(_, old_pending)| old_pending.has_impulses()) {
            let strike_points = self.script.strike_points.iter();
            for (new_point, point_strikes) in strike_points.zip(&mut self.state.sources.pending_strikes) {
                if new_point.point == old_point.point && new_point.step_shares.len() == old_point.step_shares.len() {
                    point_strikes.impulses.copy_from_slice(&old_pending.impulses);
                    point_strikes.steps_left = old_pending.steps_left;
                }
            }
        }
    }
}
