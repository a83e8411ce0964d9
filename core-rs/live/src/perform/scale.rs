//! The factor of the piece's force on a hand, tick by tick: it is lowered before a stiffer piece acts, and raised after
//! that piece ends. `prepare` sets its bound at the start, `ergon/live/force_bounds.py` its bounds in a session.

use crate::safety::clamp_to_unit;

/// Time before a lower bound at which the scale begins to fall [s].
pub const FALL_SECONDS: f64 = 0.02;
/// Time of a rise from 0 to 1 [s].
const RISE_SECONDS: f64 = 0.2;

/// A bound of the scale from a tick on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleBound {
    /// Its tick, counted from the change that brings the bound; once the change is made, from the start of the
    /// performance.
    pub tick: u64,
    /// Greatest factor of the force from there on, 0 to 1.
    pub scale: f64,
}

/// The scale of a hand. It changes linearly, and is at or below each bound when the bound begins.
#[derive(Clone, Debug)]
pub(super) struct ForceScale {
    scale: f64,
    /// The value to which it may rise.
    target: f64,
    /// Bounds by rising ticks of the performance, and the index of the next one.
    pub(super) bounds: Vec<ScaleBound>,
    next_bound: usize,
    /// Number of ticks of a fall, and increment of a rise in one tick.
    fall_ticks: u64,
    rise_per_tick: f64,
}

impl ForceScale {
    /// A scale that begins at `scale`, in ticks of `period` [s].
    pub(super) fn new(scale: f64, period: f64) -> Self {
        let scale = clamp_to_unit(scale);
        Self {
            scale,
            target: scale,
            bounds: Vec::new(),
            next_bound: 0,
            fall_ticks: (FALL_SECONDS / period).ceil() as u64,
            rise_per_tick: period / RISE_SECONDS,
        }
    }

    /// Start the new `bounds`, whose ticks count from `tick`.
    pub(super) fn begin(&mut self, tick: u64) {
        for bound in &mut self.bounds {
            bound.tick = bound.tick.saturating_add(tick);
        }
        self.next_bound = 0;
    }

    /// The scale in this tick; `pending_bounds`: bounds of changes that wait, by ticks of the performance.
    pub(super) fn advance(&mut self, tick: u64, pending_bounds: impl Iterator<Item = ScaleBound>) -> f64 {
        // The scale rises to the goal of the previous tick, because the force of that tick is sent now.
        let previous_target = self.target;
        while let Some(scale_bound) = self
            .bounds
            .get(self.next_bound)
            .filter(|scale_bound| scale_bound.tick <= tick)
        {
            self.target = clamp_to_unit(scale_bound.scale);
            self.next_bound += 1;
        }
        let risen_scale = (self.scale + self.rise_per_tick).min(previous_target).max(self.scale);
        let mut scale_now = risen_scale.min(self.target);
        let coming_bounds = self.bounds[self.next_bound..].iter().copied().chain(pending_bounds);
        for scale_bound in coming_bounds.filter(|scale_bound| scale_bound.tick <= tick + self.fall_ticks) {
            let (target_scale, ticks_left) = (
                clamp_to_unit(scale_bound.scale),
                scale_bound.tick.saturating_sub(tick) + 1,
            );
            if target_scale < self.scale {
                scale_now = scale_now.min(self.scale + (target_scale - self.scale) / ticks_left as f64);
            }
        }
        self.scale = scale_now;
        scale_now
    }

    /// The scale now.
    pub(super) fn current(&self) -> f64 {
        self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1e-3;

    fn bound(tick: u64, scale: f64) -> ScaleBound {
        ScaleBound { tick, scale }
    }

    /// The scale falls ahead of a change that waits: without a jump, and completely by the tick of the change.
    #[test]
    fn scale_falls_before_a_stiffer_scene_acts() {
        let mut force_scale = ForceScale::new(1.0, PERIOD);
        let coming_bounds = [bound(100, 0.2)];
        let mut last_scale = 1.0;
        for tick in 0..=100 {
            let scale_now = force_scale.advance(tick, coming_bounds.into_iter());
            assert!(
                last_scale - scale_now < 0.8 / 20.0,
                "tick {tick}: {last_scale} {scale_now}"
            );
            assert!(tick >= 80 || scale_now == 1.0, "tick {tick}");
            last_scale = scale_now;
        }
        assert!((last_scale - 0.2).abs() < 1e-12, "{last_scale}");
    }

    /// A bound that arrives late takes effect over the remaining ticks; one that arrives at its tick acts at once.
    #[test]
    fn scale_with_a_late_bound() {
        for left in [0, 1, 5] {
            let mut force_scale = ForceScale::new(1.0, PERIOD);
            for tick in 0..=left {
                force_scale.advance(tick, [bound(left, 0.1)].into_iter());
            }
            assert!((force_scale.current() - 0.1).abs() < 1e-12, "{left}");
        }
        let mut force_scale = ForceScale::new(1.0, PERIOD);
        force_scale.bounds = vec![bound(0, 0.1)];
        force_scale.begin(7);
        assert_eq!(force_scale.advance(7, std::iter::empty()), 0.1);
    }

    /// The scale rises only after the glide to a softer piece is over; a change that waits meanwhile holds it down.
    #[test]
    fn scale_rises_after_the_stiff_scene_has_ended() {
        let mut force_scale = ForceScale::new(0.2, PERIOD);
        force_scale.bounds = vec![bound(0, 0.2), bound(300, 1.0)];
        force_scale.begin(100);
        let mut last_scale = 0.2;
        for tick in 100..1_000 {
            let scale_now = force_scale.advance(tick, [bound(1_000, 0.5)].into_iter());
            assert!(tick > 400 || scale_now == 0.2, "tick {tick}: {scale_now}");
            assert!((scale_now - last_scale).abs() < 0.5 / 19.0, "tick {tick}");
            assert!(tick != 900 || scale_now == 1.0);
            last_scale = scale_now;
        }
        assert!((force_scale.advance(1_000, [bound(1_000, 0.5)].into_iter()) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn scale_with_a_wrong_bound_is_zero() {
        for invalid_scale in [f64::NAN, -1.0, f64::NEG_INFINITY] {
            let mut force_scale = ForceScale::new(1.0, PERIOD);
            force_scale.bounds = vec![bound(0, invalid_scale)];
            force_scale.begin(0);
            assert_eq!(force_scale.advance(0, std::iter::empty()), 0.0);
        }
        assert_eq!(ForceScale::new(7.0, PERIOD).current(), 1.0);
    }
}
