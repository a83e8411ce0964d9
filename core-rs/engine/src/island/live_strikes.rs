//! Live strikes on an island: impulses that arrive while it plays, each applied in the next step.

use crate::scheme::Scheme;
use crate::state::Body;
use crate::timeline::{Drive, Source};

/// A MAT that may be struck while it plays.
#[derive(Clone, Debug)]
pub(super) struct StrikePoint {
    mat: usize,
    /// Number of the point in the scene.
    point: u32,
}

/// The strike points among drives.
pub(super) fn strike_points(drives: &[Drive]) -> Vec<StrikePoint> {
    let strike_point = |drive: &Drive| match drive.source {
        Source::Strikes(point) => Some(StrikePoint {
            mat: drive.mat,
            point,
        }),
        _ => None,
    };
    drives.iter().filter_map(strike_point).collect()
}

/// Adds the forces of the impulses [N·s] to this step. A muted MAT takes none.
pub(super) fn apply(
    strike_points: &[StrikePoint],
    impulses: &mut [f64],
    scheme: &Scheme,
    body: &mut Body,
) {
    for (strike_point, impulse) in strike_points.iter().zip(impulses) {
        let impulse = std::mem::take(impulse);
        if impulse != 0.0 && scheme.w[strike_point.mat] != 0.0 {
            body.push(strike_point.mat, impulse * scheme.rate);
        }
    }
}

impl super::Island {
    /// Strike a point of the scene by an impulse [N·s] in the next step; false if the point is not in this island.
    pub(crate) fn strike(&mut self, point: u32, impulse: f64) -> bool {
        let mut is_here = false;
        for (strike, pending) in self
            .script
            .strike_points
            .iter()
            .zip(&mut self.state.hands.impulses)
        {
            if strike.point == point {
                *pending += impulse;
                is_here = true;
            }
        }
        if is_here {
            self.wake();
        }
        is_here
    }
}
