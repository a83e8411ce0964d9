//! Real hands in an island: positions that come in by ticks, forces that go back.

use crate::state::Body;
use crate::timeline::{Drive, Hand, HandWay};

/// A hand, and the MAT that it moves.
#[derive(Clone, Debug)]
pub(crate) struct Grip {
    mat: usize,
    hand: Hand,
}

/// What changes of a hand.
#[derive(Clone, Debug, Default)]
pub(super) struct Touch {
    /// Where it is said to be from the next tick on, and by what step it comes there, where that is known [m].
    given: Option<(f64, Option<f64>)>,
    /// Where it was at the last tick, and where it goes in this one [m].
    from: f64,
    to: f64,
    /// Forces on it so far in this tick [N].
    sum: f64,
    /// Their mean over the last whole tick [N].
    felt: f64,
}

impl Grip {
    /// The MAT that it moves.
    pub(crate) fn mat(&self) -> usize {
        self.mat
    }
}

/// At frame `n` they have gone the way of the timeline.
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

/// Where hands are at frame `n`, and the step that led there.
pub(super) fn arrive(grips: &[Grip], touches: &mut [Touch], n: u64, body: &mut Body) {
    for (grip, touch) in grips.iter().zip(touches) {
        let (x, d) = (&mut body.x[grip.mat], &mut body.d[grip.mat]);
        let every = u64::from(grip.hand.every);
        let within = n % every;
        if within == 0 {
            let (to, step) = touch.given.unwrap_or_else(|| (grip.hand.at(n), None));
            let from = if n == 0 { to } else { touch.to };
            (touch.from, touch.to) = (from, to);
            if every == 1 || grip.hand.way == HandWay::Hold {
                *d = step.unwrap_or(to - from);
                *x = to;
                continue;
            }
        }
        if grip.hand.way == HandWay::Line {
            let way = touch.to - touch.from;
            *d = way / every as f64;
            *x = touch.from + way * ((within + 1) as f64 / every as f64);
        }
    }
}

/// What hands feel of frame `n`, once all its forces are summed.
pub(super) fn feel(grips: &[Grip], touches: &mut [Touch], n: u64, body: &Body) {
    for (grip, touch) in grips.iter().zip(touches) {
        touch.sum += body.force[grip.mat];
        let every = u64::from(grip.hand.every);
        if (n + 1).is_multiple_of(every) {
            touch.felt = touch.sum / every as f64;
            touch.sum = 0.0;
        }
    }
}

impl super::Island {
    /// Say where a hand of the scene is from the next tick on, and by what step it came there [m].
    pub(crate) fn hold(&mut self, hand: usize, x: f64, step: Option<f64>) {
        for (grip, touch) in self.script.grips.iter().zip(&mut self.state.touches) {
            if grip.hand.index == hand {
                touch.given = Some((x, step));
            }
        }
    }

    /// Mean force on a hand of the scene over the last whole tick [N].
    pub(crate) fn felt(&self, hand: usize) -> f64 {
        let pairs = self.script.grips.iter().zip(&self.state.touches);
        let own = pairs.filter(|(grip, _)| grip.hand.index == hand);
        own.map(|(_, touch)| touch.felt).sum()
    }
}
