//! What the key under a real hand bears of a scene.

use super::{Guide, Hand, Keyboard};
use crate::safety::margin::Answer;
use crate::safety::stiffness;

/// A device that says nothing of itself is taken for a light one with little friction [kg, N·s/m].
const LIGHT: (f64, f64) = (0.05, 0.3);
/// A key that gets less of the scene's force than this feels another instrument.
pub const SCALE_MIN: f64 = 0.02;

/// How much of the scene's force a hand gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Borne {
    /// Which hand.
    pub hand: usize,
    /// The part of the force, 0 to 1.
    pub scale: f64,
    /// What the key meets at its stiffest [N/m].
    pub stiffness: f64,
    /// What it bears [N/m].
    pub limit: f64,
}

/// The key under a real hand, as its device is, and what guides the hand.
#[derive(Clone, Copy, Debug)]
pub struct Bearer {
    /// Which hand.
    pub hand: usize,
    key: stiffness::Key,
    guide: Option<Guide>,
}

impl Bearer {
    /// The hands on a keyboard, each with its key.
    pub(super) fn all(board: &Keyboard, hands: &[Hand]) -> Vec<Self> {
        let (key, axes) = (board.key(), board.axes());
        let bearer = |&(_, hand): &(usize, usize)| Self {
            hand,
            key,
            guide: hands[hand].guide,
        };
        axes.iter().map(bearer).collect()
    }

    /// What it bears of a scene that answers it so; see [`Hand::response`].
    pub fn borne(&self, response: &[f64]) -> Borne {
        let answer = Answer::new(response);
        let (mut scale, mut stiffest) = (1.0_f64, 0.0_f64);
        for &share in Guide::shares(self.guide) {
            let (k, z) = self
                .guide
                .map_or((0.0, 0.0), |guide| (share.k * guide.k, share.z * guide.z));
            scale = scale.min(stiffness::part(answer.borne(self.key, k, z)));
            let met = Guide::met(self.guide, response, self.key.period, share);
            stiffest = stiffest.max(stiffness::stiffest(&met));
        }
        Borne {
            hand: self.hand,
            scale,
            stiffness: stiffest,
            limit: scale * stiffest,
        }
    }
}

/// The key of a device by itself, in ticks of `period` [s].
pub(super) fn key(spec: &crate::device::Spec, lockstep: bool, period: f64) -> stiffness::Key {
    let own_delay = spec.loop_delay_s.map(|s| (s / period).ceil() as usize);
    stiffness::Key {
        mass: spec.inertia.unwrap_or(LIGHT.0),
        damping: spec.damping.filter(|b| *b > 0.0).unwrap_or(LIGHT.1),
        period,
        // By a clock the force of a tick goes out with the next.
        delay: own_delay.unwrap_or(0) + usize::from(!lockstep),
    }
}
