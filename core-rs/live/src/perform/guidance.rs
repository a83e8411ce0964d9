//! Haptic guidance: a spring and a damper that pull a person's hand along a written part, faded in and out tick by
//! tick. For a key that its part drives it holds what drifts, beside the force of the part.

use crate::safety::clamp_to_unit;

/// Time of a fade of the guidance, and of its crossfade to another path [s].
const FADE_SECONDS: f64 = 0.2;

/// A spring and a damper between a hand and the position of the key in its part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guidance {
    /// Stiffness [N/m].
    pub k: f64,
    /// Viscosity [N·s/m].
    pub z: f64,
    /// Whether it starts at zero and follows [`GuidanceStep`]s; otherwise it acts fully all the time.
    pub follows_steps: bool,
}

/// Factors of the two constants of a [`Guidance`], 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GuidanceShare {
    /// Factor of its stiffness.
    pub k: f64,
    /// Factor of its viscosity.
    pub z: f64,
}

/// What a part asks of the key in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct WrittenMotion {
    /// Position [m].
    pub(super) x: f64,
    /// Velocity [m/s]; zero where nothing drives the key, so that a guidance brakes.
    pub(super) v: f64,
    /// Force that moves a free key so [N].
    pub(super) force: f64,
}

/// The factors of a loose [`Guidance`] from one tick on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidanceStep {
    /// In ticks after the change that brings the step; once the change is made, in ticks of the performance.
    pub tick: u64,
    /// The factors that the guidance fades to.
    pub share: GuidanceShare,
}

impl Guidance {
    /// The corners of the range of its factors: a force limit that holds at each of them is assumed to hold between
    /// them.
    pub(super) fn shares(guidance: Option<Self>) -> &'static [GuidanceShare] {
        const NONE: GuidanceShare = GuidanceShare { k: 0.0, z: 0.0 };
        const STIFF: GuidanceShare = GuidanceShare { k: 1.0, z: 0.0 };
        const VISCOUS: GuidanceShare = GuidanceShare { k: 0.0, z: 1.0 };
        const ALL: GuidanceShare = GuidanceShare { k: 1.0, z: 1.0 };
        match guidance {
            None => &[NONE],
            Some(Self {
                follows_steps: false, ..
            }) => &[ALL],
            Some(_) => &[NONE, STIFF, VISCOUS, ALL],
        }
    }

    /// The response of piece and guidance together, in ticks of `period` [s]; see
    /// [`LiveHand::response`](super::Hand::response).
    pub(super) fn total_response(
        guidance: Option<Self>,
        response: &[f64],
        period: f64,
        share: GuidanceShare,
    ) -> Vec<f64> {
        let mut summed_response = response.to_vec();
        if let (Some(guidance), [response_now, response_next, ..]) = (guidance, &mut summed_response[..]) {
            let scaled_damping = share.z * guidance.z / period;
            *response_now += share.k * guidance.k + scaled_damping;
            *response_next -= scaled_damping;
        }
        summed_response
    }
}

impl GuidanceShare {
    const ALL: Self = Self { k: 1.0, z: 1.0 };

    fn clamped(self) -> Self {
        Self {
            k: clamp_to_unit(self.k),
            z: clamp_to_unit(self.z),
        }
    }

    fn interpolated(self, target: Self, progress: f64) -> Self {
        Self {
            k: self.k + progress * (target.k - self.k),
            z: self.z + progress * (target.z - self.z),
        }
    }
}

/// The state of a guidance while it plays.
#[derive(Clone, Debug)]
pub(super) struct GuidanceState {
    guidance: Option<Guidance>,
    /// The factors now, and at both ends of the fade.
    share: GuidanceShare,
    fade_start: GuidanceShare,
    fade_target: GuidanceShare,
    /// Distance from the path of the part [m]: at the beginning of the crossfade, and now.
    offset: f64,
    remaining_offset: f64,
    /// Progress of the fade, 0 to 1, and its increment in a tick.
    fade_progress: f64,
    fade_step: f64,
    /// All steps; index of the next one.
    pub(super) steps: Vec<GuidanceStep>,
    next_step: usize,
}

impl GuidanceState {
    /// A state in ticks of `period` [s].
    pub(super) fn new(guidance: Option<Guidance>, period: f64) -> Self {
        let share = match guidance {
            Some(Guidance {
                follows_steps: false, ..
            }) => GuidanceShare::ALL,
            _ => GuidanceShare::default(),
        };
        Self {
            guidance,
            share,
            fade_start: share,
            fade_target: share,
            offset: 0.0,
            remaining_offset: 0.0,
            fade_progress: 1.0,
            fade_step: period / FADE_SECONDS,
            steps: Vec::new(),
            next_step: 0,
        }
    }

    /// Whether the guidance follows steps.
    pub(super) fn is_loose(&self) -> bool {
        self.guidance.is_some_and(|guidance| guidance.follows_steps)
    }

    /// Start the new `steps`, whose ticks count from `tick`.
    pub(super) fn begin_steps(&mut self, tick: u64) {
        for step in &mut self.steps {
            step.tick = step.tick.saturating_add(tick);
        }
        self.next_step = 0;
    }

    /// Crossfade from a path that was at `old_position` to a path that is at `new_position` [m].
    pub(super) fn crossfade(&mut self, old_position: f64, new_position: f64) {
        let is_unguided = self.share == GuidanceShare::default();
        let offset_left = if is_unguided {
            0.0
        } else {
            self.remaining_offset + old_position - new_position
        };
        self.start_fade(self.fade_target, offset_left);
    }

    fn start_fade(&mut self, target: GuidanceShare, remaining_offset: f64) {
        (self.fade_start, self.fade_target) = (self.share, target);
        (self.offset, self.remaining_offset) = (remaining_offset, remaining_offset);
        self.fade_progress = 0.0;
    }

    /// Advance by a tick.
    pub(super) fn tick(&mut self, tick: u64) {
        while let Some(guidance_step) = self
            .steps
            .get(self.next_step)
            .filter(|guidance_step| guidance_step.tick <= tick)
        {
            let target_share = guidance_step.share.clamped();
            self.next_step += 1;
            if target_share != self.fade_target {
                self.start_fade(target_share, self.remaining_offset);
            }
        }
        if self.fade_progress < 1.0 {
            self.fade_progress = (self.fade_progress + self.fade_step).min(1.0);
            let fade_progress = smooth_step(self.fade_progress);
            self.remaining_offset = self.offset * (1.0 - fade_progress);
            self.share = if self.fade_progress < 1.0 {
                self.fade_start.interpolated(self.fade_target, fade_progress)
            } else {
                self.fade_target
            };
        }
    }

    /// The force [N] on a hand at `x` [m] that moves at `v` [m/s]. Later stages multiply all forces by `scale`; that of
    /// the part is in no loop, so it is not to become weaker.
    pub(super) fn force(&self, written_motion: WrittenMotion, x: f64, v: f64, scale: f64) -> f64 {
        let Some(guidance) = self.guidance else {
            return 0.0;
        };
        let guidance_force = self.share.k * guidance.k * (written_motion.x + self.remaining_offset - x)
            - self.share.z * guidance.z * (v - written_motion.v);
        if written_motion.force == 0.0 || scale <= 0.0 {
            return guidance_force;
        }
        guidance_force + self.share.k * written_motion.force / scale
    }
}

/// A quintic step from 0 to 1: its first and second derivatives are zero at both ends, so velocity and acceleration do
/// not jump.
pub(super) fn smooth_step(t: f64) -> f64 {
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perform::LiveHand;

    const PERIOD: f64 = 1e-3;
    const HALF: GuidanceShare = GuidanceShare { k: 0.5, z: 0.25 };

    fn hand(loose: bool) -> LiveHand {
        LiveHand {
            standin_positions: vec![0.0, 5e-3],
            travel_ratio: 1.0,
            guidance: Some(Guidance {
                k: 100.0,
                z: 2.0,
                follows_steps: loose,
            }),
            ..LiveHand::default()
        }
    }

    fn part(hand: &LiveHand, tick: u64) -> WrittenMotion {
        hand.written_motion(tick, PERIOD, true)
    }

    /// What drives a key is in full where the forces of the piece are scaled, and fades with the spring.
    #[test]
    fn written_force_under_scaled_forces() {
        let driven_hand = LiveHand {
            forces: vec![0.4],
            ..hand(true)
        };
        let mut guidance = GuidanceState::new(driven_hand.guidance, PERIOD);
        let part_force = |guidance: &GuidanceState| {
            let part_motion = part(&driven_hand, 50);
            0.25 * guidance.force(part_motion, part_motion.x, part_motion.v, 0.25)
        };
        assert_eq!(part_force(&guidance), 0.0);
        guidance.steps = vec![GuidanceStep {
            tick: 0,
            share: GuidanceShare { k: 1.0, z: 1.0 },
        }];
        guidance.begin_steps(0);
        (0..500).for_each(|tick| guidance.tick(tick));
        assert!((part_force(&guidance) - 0.4).abs() < 1e-12);
        assert_eq!(guidance.force(part(&driven_hand, 50), 0.0, 0.0, 0.0), 100.0 * 5e-3);
    }

    #[test]
    fn guidance_force_pulls_to_the_part_and_brakes() {
        let hand = hand(false);
        let mut guidance = GuidanceState::new(hand.guidance, PERIOD);
        for tick in [0, 9] {
            guidance.tick(tick);
            assert_eq!(guidance.force(part(&hand, 9), 2e-3, 0.0, 1.0), 100.0 * 3e-3);
            assert_eq!(guidance.force(part(&hand, 0), 0.0, 0.5, 1.0), -1.0);
        }
    }

    #[test]
    fn loose_guidance_fades_by_its_steps() {
        let hand = hand(true);
        let mut guidance = GuidanceState::new(hand.guidance, PERIOD);
        let guidance_step = |at, share| GuidanceStep { tick: at, share };
        guidance.steps = vec![guidance_step(100, HALF), guidance_step(1_000, GuidanceShare::default())];
        guidance.begin_steps(50);
        let (mut last_force, mut full_ticks) = (0.0, 0);
        for tick in 50..2_000 {
            guidance.tick(tick);
            let guidance_force = guidance.force(part(&hand, tick), 0.0, 0.0, 1.0);
            // The steepest slope of a smooth fade over 200 ticks.
            assert!(
                f64::abs(guidance_force - last_force) < 0.25 * 1.9 / 200.0,
                "tick {tick}"
            );
            if !(150..1_250).contains(&tick) {
                assert_eq!(guidance_force, 0.0, "tick {tick}");
                assert_eq!(guidance.force(part(&hand, tick), 0.0, 1.0, 1.0), 0.0);
            }
            if (350..1_050).contains(&tick) {
                assert_eq!(guidance_force, 0.5 * 100.0 * 5e-3);
                assert_eq!(guidance.force(part(&hand, tick), 5e-3, 1.0, 1.0), -0.25 * 2.0);
                full_ticks += 1;
            }
            last_force = guidance_force;
        }
        assert_eq!(full_ticks, 700);
    }

    #[test]
    fn guidance_changes_to_another_path_without_a_jump() {
        let mut hand = hand(true);
        let mut guidance = GuidanceState::new(hand.guidance, PERIOD);
        guidance.steps = vec![GuidanceStep { tick: 0, share: HALF }];
        guidance.begin_steps(0);
        let mut last_force = 0.0;
        for tick in 0..1_000 {
            if tick == 500 {
                let position_before = hand.standin_position(tick);
                hand.standin_positions = vec![-10e-3];
                guidance.crossfade(position_before, hand.standin_position(tick));
            }
            guidance.tick(tick);
            let guidance_force = guidance.force(part(&hand, tick), 0.0, 0.0, 1.0);
            assert!(
                f64::abs(guidance_force - last_force) < 0.75 * 1.9 / 200.0,
                "tick {tick}"
            );
            last_force = guidance_force;
        }
        assert_eq!(last_force, -0.5 * 100.0 * 10e-3);
    }

    #[test]
    fn guidance_with_a_wrong_share_has_no_force() {
        let hand = hand(true);
        let mut guidance = GuidanceState::new(hand.guidance, PERIOD);
        let share = GuidanceShare { k: f64::NAN, z: -3.0 };
        guidance.steps = vec![GuidanceStep { tick: 0, share }];
        guidance.begin_steps(0);
        (0..500).for_each(|tick| guidance.tick(tick));
        assert_eq!(guidance.force(part(&hand, 500), 0.0, 1.0, 1.0), 0.0);
        let share = GuidanceShare { k: 7.0, z: 9.0 };
        guidance.steps = vec![GuidanceStep { tick: 0, share }];
        guidance.begin_steps(500);
        (500..1_000).for_each(|tick| guidance.tick(tick));
        assert_eq!(guidance.force(part(&hand, 1_000), 0.0, 0.0, 1.0), 100.0 * 5e-3);
    }
}
