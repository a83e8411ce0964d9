//! Takeover of the mixer of one version by that of the next.

use super::{Mixer, Placed, Route, To};
use crate::mix::glide::{Glide, glide_to_zero};

impl Mixer {
    /// Take over the state of `old`: gains of groups, filters and delays of routes that both have, and rooms of the
    /// same name. Over 20 ms from the next multiple of 64 frames on, new routes fade in, routes that are gone fade out,
    /// and changed gains glide, including that of all channels. A route with another filter or delay is a new one, which
    /// has the state of the old one. Frozen outputs that are new, gone or moved fade in the same way. Allocates and
    /// frees nothing: filters, delay and curve of a route that fades out are moved out of `old`.
    ///
    /// `outputs`: for each output of `old`, the output here; `None` if they are the same.
    pub fn take_over(&mut self, old: &mut Self, outputs: Option<&[Option<usize>]>) {
        self.frame = old.frame;
        let groups = self.groups.iter_mut().zip(&old.groups);
        groups.for_each(|(group, old)| *group = *old);
        let out = |before: usize| match outputs {
            Some(outputs) => outputs.get(before).copied().flatten(),
            None => Some(before),
        };
        // The routes of both mixers are in about the same order: start the search after the previous match.
        let in_turn = |next: usize, n: usize| (next..n).chain(0..next.min(n));
        let (mut next, n) = (0, old.routes.len());
        for group in &mut self.routes {
            let is_same =
                |&index: &usize| group.continues(&old.routes[index], out(old.routes[index].out));
            let Some(index) = in_turn(next, n).find(is_same) else {
                // One that is like it, by other values, leads into it; both are heard while they change places.
                let is_like =
                    |&index: &usize| group.is_like(&old.routes[index], out(old.routes[index].out));
                let like = in_turn(next, n)
                    .find(is_like)
                    .map(|index| &old.routes[index]);
                let fade = Glide::between(self.rate, 0.0, 1.0);
                let Some(before) = like else {
                    let is_late = group.delay.is_some();
                    (group.entry, group.fade) =
                        (is_late.then_some(fade), (!is_late).then_some(fade));
                    continue;
                };
                group.take_over(before);
                // A longer delay is silent at first: fade in when its first sample comes out.
                let mut fade = Glide::new(self.rate, 0.0);
                fade.set_later(1.0, group.lag().saturating_sub(before.lag()) as u64);
                (group.entry, group.fade) = (before.entry, Some(fade));
                continue;
            };
            next = index + 1;
            let before = &old.routes[index];
            group.take_over(before);
            (group.entry, group.fade) = (before.entry, before.fade);
            group.residual_gain = before.residual_gain;
            let (old_gain, new_gain) = (before.gain_at(old.frame), group.gain_at(old.frame));
            if new_gain == old_gain {
                continue;
            }
            let gain_before = before.faded_gain_at(old.frame);
            (group.fade, group.residual_gain) = (None, None);
            if new_gain == 0.0 || group.curve.is_some() {
                group.residual_gain = glide_to_zero(self.rate, gain_before - new_gain); // a factor would grow with the curve
            } else {
                group.fade(self.rate, gain_before / new_gain, 1.0);
            }
        }
        for index in 1..self.routes.len() {
            let (earlier, later) = self.routes.split_at_mut(index);
            if let (Some(before), Some(route)) = (earlier.last(), later.first_mut()) {
                route.repeats = route.hears_as(before);
            }
        }
        let new_gain = self.fade.as_ref().map_or(1.0, |fade| fade.value(old.frame));
        let old_gain = old.fade.as_ref().map_or(1.0, |fade| fade.value(old.frame));
        self.residual_gain = old.residual_gain;
        if new_gain != old_gain {
            self.residual_gain = glide_to_zero(self.rate, old.gain_of_all(old.frame) - new_gain);
        }
        for room in &mut self.rooms {
            room.take_over(&old.rooms);
        }
        self.fade_out_missing(old, out);
        self.take_over_frozen(old, out);
        self.is_fading = true;
    }

    /// Frozen outputs at the same place continue, new ones fade in, and those that are gone fade out.
    fn take_over_frozen(&mut self, old: &Self, out: impl Fn(usize) -> Option<usize>) {
        for placed in &mut self.frozen {
            let is_same =
                |other: &&Placed| out(other.out).is_some_and(|here| placed.continues(other, here));
            placed.fade = match old.frozen.iter().find(is_same) {
                Some(before) => before.fade,
                None => Glide::between(self.rate, 0.0, 1.0),
            };
        }
        let gone = old.frozen.iter().filter_map(|before| {
            let here = out(before.out)?;
            let goes_on = self
                .frozen
                .iter()
                .any(|placed| placed.continues(before, here));
            let fade = Glide::between(self.rate, before.fade.value(old.frame), 0.0);
            (!goes_on).then(|| before.fading(here, fade))
        });
        let fading_out = old.frozen_fading_out.iter().flatten();
        let fading_out =
            fading_out.filter_map(|other| Some(other.fading(out(other.out)?, other.fade)));
        for (place, other) in self
            .frozen_fading_out
            .iter_mut()
            .zip(fading_out.chain(gone))
        {
            *place = Some(other);
        }
    }

    /// Routes of `old` without a successor here fade out; `out` maps their outputs to those here.
    fn fade_out_missing(&mut self, old: &mut Self, out: impl Fn(usize) -> Option<usize>) {
        let (mut next, n) = (0, self.routes.len());
        let (n_channels, n_rooms) = (self.n_channels, self.rooms.len());
        let mut places = self.fading_out.iter_mut();
        let sounds = |route: &&mut Route| !route.has_faded_out(old.frame);
        let fading_out = old.fading_out.iter_mut().flatten().filter(sounds);
        for before in fading_out.chain(&mut old.routes) {
            let here = out(before.out);
            let (Some(out_now), true) = (here, before.group < self.groups.len()) else {
                continue;
            };
            let successor = (next..n)
                .chain(0..next)
                .find(|&route_index| self.routes[route_index].continues(before, here));
            if let Some(route_index) = successor {
                next = route_index + 1;
                continue;
            }
            let is_there = match before.to {
                To::Channel(channel) => channel < n_channels,
                To::Room(room) => room < n_rooms,
            };
            if !is_there {
                continue;
            }
            let Some(place) = places.next() else { return };
            let (delay, curve) = (before.delay.take(), before.curve.take());
            let filters = std::mem::take(&mut before.filters);
            let mut route = Route {
                out: out_now,
                filters,
                delay,
                curve,
                shared_curve: None,
                repeats: false,
                ..before.clone()
            };
            let there = before.fade.map_or(1.0, |fade| fade.value(old.frame));
            route.fade(self.rate, there, 0.0);
            *place = Some(route);
        }
    }
}
