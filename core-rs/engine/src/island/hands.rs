//! Real hands in an island: positions in, mean forces out, once a tick.

use crate::state::Body;
use crate::timeline::{Drive, Hand, HandWay};

/// A hand, and the MAT that it moves.
#[derive(Clone, Debug)]
pub(crate) struct Grip {
    mat: usize,
    hand: Hand,
}

/// State of a hand.
#[derive(Clone, Debug, Default)]
pub(super) struct Touch {
    /// Position that a device has sent for the next tick, and its last step where the device knows it [m].
    sent: Option<(f64, Option<f64>)>,
    /// Positions at the last tick and at the end of this one [m].
    from: f64,
    to: f64,
    /// Sum of the forces in this tick [N].
    sum: f64,
    /// Mean force over the last complete tick [N].
    mean_force: f64,
}

impl Grip {
    /// The MAT that it moves.
    pub(crate) fn mat(&self) -> usize {
        self.mat
    }
}

/// Set the hands to the timeline's positions at frame `n`.
pub(super) fn seek(grips: &[Grip], touches: &mut [Touch], n: u64) {
    for (grip, touch) in grips.iter().zip(touches) {
        touch.to = grip.hand.at(n.saturating_sub(1));
    }
}

/// The hands among drives.
pub(super) fn grips(drives: &[Drive]) -> Vec<Grip> {
    let grip = |drive: &Drive| {
        Some(Grip {
            mat: drive.mat,
            hand: drive.hand()?.clone(),
        })
    };
    drives.iter().filter_map(grip).collect()
}

/// Set positions and last steps of the hands' MATs at frame `n`.
pub(super) fn arrive(grips: &[Grip], touches: &mut [Touch], n: u64, body: &mut Body) {
    for (grip, touch) in grips.iter().zip(touches) {
        let (x, d) = (&mut body.x[grip.mat], &mut body.d[grip.mat]);
        let tick_frames = u64::from(grip.hand.tick_frames);
        let within = n % tick_frames;
        if within == 0 {
            let (to, step) = touch.sent.unwrap_or_else(|| (grip.hand.at(n), None));
            let from = if n == 0 { to } else { touch.to };
            (touch.from, touch.to) = (from, to);
            if tick_frames == 1 || grip.hand.way == HandWay::Hold {
                *d = step.unwrap_or(to - from);
                *x = to;
                continue;
            }
        }
        if grip.hand.way == HandWay::Line {
            let way = touch.to - touch.from;
            *d = way / tick_frames as f64;
            *x = touch.from + way * ((within + 1) as f64 / tick_frames as f64);
        }
    }
}

/// Add the forces of frame `n`, once they are summed, to the mean of the tick.
pub(super) fn feel(grips: &[Grip], touches: &mut [Touch], n: u64, body: &Body) {
    for (grip, touch) in grips.iter().zip(touches) {
        touch.sum += body.force[grip.mat];
        let tick_frames = u64::from(grip.hand.tick_frames);
        if (n + 1).is_multiple_of(tick_frames) {
            touch.mean_force = touch.sum / tick_frames as f64;
            touch.sum = 0.0;
        }
    }
}

impl super::Island {
    /// Set the position of a hand of the scene from the next tick on, and its last step [m].
    pub(crate) fn hold(&mut self, hand: usize, x: f64, step: Option<f64>) {
        for (grip, touch) in self.script.grips.iter().zip(&mut self.state.touches) {
            if grip.hand.index == hand {
                touch.sent = Some((x, step));
            }
        }
    }

    /// Mean force on a hand of the scene over the last complete tick [N].
    pub(crate) fn felt(&self, hand: usize) -> f64 {
        let pairs = self.script.grips.iter().zip(&self.state.touches);
        let own = pairs.filter(|(grip, _)| grip.hand.index == hand);
        own.map(|(_, touch)| touch.mean_force).sum()
    }
}
