//! What leads a hand along a part: how much of it acts now, and the way from how it acted before.

use crate::safety::unit;

/// A lead comes and goes in this time, and passes over to another path [s]: no hand is snatched.
const GLIDE: f64 = 0.2;

/// A spring and a damper between a hand and where its part takes the key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guide {
    /// [N/m]
    pub k: f64,
    /// [N·s/m]
    pub z: f64,
    /// It begins let go, and [`Step`]s take it up; else all of it acts all the time.
    pub loose: bool,
}

/// How much of a guide acts, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Of its stiffness.
    pub k: f64,
    /// Of its viscosity.
    pub z: f64,
}

/// How much of a loose guide is to act from a tick on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Ticks after the change that brought it.
    pub at: u64,
    /// What it glides to.
    pub share: Share,
}

impl Guide {
    /// The shares between which it may act: what a key bears at all of these, it is taken to bear between them.
    pub(super) fn shares(this: Option<Self>) -> &'static [Share] {
        const NONE: Share = Share { k: 0.0, z: 0.0 };
        const STIFF: Share = Share { k: 1.0, z: 0.0 };
        const VISCOUS: Share = Share { k: 0.0, z: 1.0 };
        const ALL: Share = Share { k: 1.0, z: 1.0 };
        match this {
            None => &[NONE],
            Some(Self { loose: false, .. }) => &[ALL],
            Some(_) => &[NONE, STIFF, VISCOUS, ALL],
        }
    }

    /// All that answers a hand: the scene, and what guides the hand by `share`, in ticks of `period` [s]; see
    /// [`Hand::response`](super::Hand::response).
    pub(super) fn met(this: Option<Self>, response: &[f64], period: f64, share: Share) -> Vec<f64> {
        let mut met = response.to_vec();
        if let (Some(guide), [now, next, ..]) = (this, &mut met[..]) {
            let z = share.z * guide.z / period;
            *now += share.k * guide.k + z;
            *next -= z;
        }
        met
    }
}

impl Share {
    const ALL: Self = Self { k: 1.0, z: 1.0 };

    /// What is no share is none.
    fn sound(self) -> Self {
        Self {
            k: unit(self.k),
            z: unit(self.z),
        }
    }

    fn towards(self, to: Self, part: f64) -> Self {
        Self {
            k: self.k + part * (to.k - self.k),
            z: self.z + part * (to.z - self.z),
        }
    }
}

/// How a guide acts.
#[derive(Clone, Debug)]
pub(super) struct Lead {
    guide: Option<Guide>,
    /// How much of it now.
    share: Share,
    from: Share,
    to: Share,
    /// Farther than the part is [m]: what is left of the way from another path.
    offset: f64,
    left: f64,
    /// How far it is on its way, 0 to 1, and how much of that a tick is.
    done: f64,
    by: f64,
    /// What comes, by ticks of the performance; the next of them.
    pub(super) steps: Vec<Step>,
    next: usize,
}

impl Lead {
    /// By a guide, in ticks of `period` [s].
    pub(super) fn new(guide: Option<Guide>, period: f64) -> Self {
        let share = match guide {
            Some(Guide { loose: false, .. }) => Share::ALL,
            _ => Share::default(),
        };
        Self {
            guide,
            share,
            from: share,
            to: share,
            offset: 0.0,
            left: 0.0,
            done: 1.0,
            by: period / GLIDE,
            steps: Vec::new(),
            next: 0,
        }
    }

    /// Whether steps take it up and let it go.
    pub(super) fn is_loose(&self) -> bool {
        self.guide.is_some_and(|guide| guide.loose)
    }

    /// Other steps came, by ticks after `tick`.
    pub(super) fn begin(&mut self, tick: u64) {
        for step in &mut self.steps {
            step.at = step.at.saturating_add(tick);
        }
        self.next = 0;
    }

    /// The part was at `before` and is at `now`: it goes there without a jump.
    pub(super) fn change(&mut self, before: f64, now: f64) {
        let is_free = self.share == Share::default();
        let left = if is_free {
            0.0
        } else {
            self.left + before - now
        };
        self.glide(self.to, left);
    }

    fn glide(&mut self, to: Share, left: f64) {
        (self.from, self.to) = (self.share, to);
        (self.offset, self.left) = (left, left);
        self.done = 0.0;
    }

    /// How it acts in this tick.
    pub(super) fn tick(&mut self, tick: u64) {
        while let Some(step) = self.steps.get(self.next).filter(|step| step.at <= tick) {
            let to = step.share.sound();
            self.next += 1;
            if to != self.to {
                self.glide(to, self.left);
            }
        }
        if self.done < 1.0 {
            self.done = (self.done + self.by).min(1.0);
            let part = smooth(self.done);
            self.left = self.offset * (1.0 - part);
            self.share = if self.done < 1.0 {
                self.from.towards(self.to, part)
            } else {
                self.to
            };
        }
    }

    /// What leads a person's hand at `x`, moving at `v`, towards its part, which is at `part` [N].
    pub(super) fn force(&self, part: f64, x: f64, v: f64) -> f64 {
        let Some(guide) = self.guide else {
            return 0.0;
        };
        let goal = part + self.left;
        self.share.k * guide.k * (goal - x) - self.share.z * guide.z * v
    }
}

/// From 0 to 1 without a jolt at either end: the quintic whose first two derivatives are zero there.
pub(super) fn smooth(t: f64) -> f64 {
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perform::Hand;

    const PERIOD: f64 = 1e-3;
    const HALF: Share = Share { k: 0.5, z: 0.25 };

    fn hand(loose: bool) -> Hand {
        Hand {
            standin: vec![0.0, 5e-3],
            reach: 1.0,
            guide: Some(Guide {
                k: 100.0,
                z: 2.0,
                loose,
            }),
            ..Hand::default()
        }
    }

    #[test]
    fn a_guide_pulls_towards_the_part_and_brakes() {
        let hand = hand(false);
        let mut lead = Lead::new(hand.guide, PERIOD);
        for tick in [0, 9] {
            lead.tick(tick);
            assert_eq!(lead.force(hand.stands_at(9), 2e-3, 0.0), 100.0 * 3e-3);
            assert_eq!(lead.force(hand.stands_at(0), 0.0, 0.5), -1.0);
        }
    }

    #[test]
    fn a_loose_guide_comes_and_goes_by_its_steps() {
        let hand = hand(true);
        let mut lead = Lead::new(hand.guide, PERIOD);
        let step = |at, share| Step { at, share };
        lead.steps = vec![step(100, HALF), step(1_000, Share::default())];
        lead.begin(50);
        let (mut last, mut full) = (0.0, 0);
        for tick in 50..2_000 {
            lead.tick(tick);
            let force = lead.force(hand.stands_at(tick), 0.0, 0.0);
            // The steepest of a smooth way of 200 ticks.
            assert!(f64::abs(force - last) < 0.25 * 1.9 / 200.0, "tick {tick}");
            if !(150..1_250).contains(&tick) {
                assert_eq!(force, 0.0, "tick {tick}");
                assert_eq!(lead.force(hand.stands_at(tick), 0.0, 1.0), 0.0);
            }
            if (350..1_050).contains(&tick) {
                assert_eq!(force, 0.5 * 100.0 * 5e-3);
                assert_eq!(lead.force(hand.stands_at(tick), 5e-3, 1.0), -0.25 * 2.0);
                full += 1;
            }
            last = force;
        }
        assert_eq!(full, 700);
    }

    #[test]
    fn another_path_is_gone_over_to() {
        let mut hand = hand(true);
        let mut lead = Lead::new(hand.guide, PERIOD);
        lead.steps = vec![Step { at: 0, share: HALF }];
        lead.begin(0);
        let mut last = 0.0;
        for tick in 0..1_000 {
            if tick == 500 {
                let before = hand.stands_at(tick);
                hand.standin = vec![-10e-3];
                lead.change(before, hand.stands_at(tick));
            }
            lead.tick(tick);
            let force = lead.force(hand.stands_at(tick), 0.0, 0.0);
            assert!(f64::abs(force - last) < 0.75 * 1.9 / 200.0, "tick {tick}");
            last = force;
        }
        assert_eq!(last, -0.5 * 100.0 * 10e-3);
    }

    #[test]
    fn what_is_no_share_leads_nobody() {
        let hand = hand(true);
        let mut lead = Lead::new(hand.guide, PERIOD);
        let share = Share {
            k: f64::NAN,
            z: -3.0,
        };
        lead.steps = vec![Step { at: 0, share }];
        lead.begin(0);
        (0..500).for_each(|tick| lead.tick(tick));
        assert_eq!(lead.force(hand.stands_at(500), 0.0, 1.0), 0.0);
        let share = Share { k: 7.0, z: 9.0 };
        lead.steps = vec![Step { at: 0, share }];
        lead.begin(500);
        (500..1_000).for_each(|tick| lead.tick(tick));
        assert_eq!(lead.force(hand.stands_at(1_000), 0.0, 0.0), 100.0 * 5e-3);
    }
}
