//! Takeover of the mixer of one version by that of the next.

use super::{Mixer, PlacedOutput, Route, RouteTarget};
use crate::mix::glide::{GainGlide, glide_to_zero};

impl Mixer {
    /// Take over the state of `old`: gains of groups, filters and delays of routes that both have, and rooms of the
    /// same name. Over 20 ms from the next multiple of 64 frames on, new routes fade in, routes that are gone fade out,
    /// and changed gains glide, including that of all channels. A route with another filter or delay is a new one,
    /// which has the state of the old one. Frozen outputs that are new, gone or moved fade in the same way. Allocates
    /// and frees nothing: filters, delay and curve of a route that fades out are moved out of `old`.
    ///
    /// `outputs`: for each output of `old`, the output here; `None` if they are the same.
    pub fn take_over(&mut self, old: &mut Self, outputs: Option<&[Option<usize>]>) {
        self.frame = old.frame;
        let group_pairs = self.group_gains.iter_mut().zip(&old.group_gains);
        group_pairs.for_each(|(group, old)| *group = *old);
        let new_output = |old_output: usize| match outputs {
            Some(outputs) => outputs.get(old_output).copied().flatten(),
            None => Some(old_output),
        };
        // The routes of both mixers are in about the same order: start the search after the previous match.
        let search_order =
            |search_start: usize, old_count: usize| (search_start..old_count).chain(0..search_start.min(old_count));
        let (mut search_start, old_count) = (0, old.routes.len());
        for route in &mut self.routes {
            let continues_route = |&route_index: &usize| {
                route.is_continuation_of(&old.routes[route_index], new_output(old.routes[route_index].output))
            };
            let Some(route_index) = search_order(search_start, old_count).find(continues_route) else {
                // One that is like it, by other values, leads into it; both are heard while they change places.
                let resembles_route = |&route_index: &usize| {
                    route.has_structure_of(&old.routes[route_index], new_output(old.routes[route_index].output))
                };
                let similar_route = search_order(search_start, old_count)
                    .find(resembles_route)
                    .map(|route_index| &old.routes[route_index]);
                let fade = GainGlide::between(self.rate, 0.0, 1.0);
                let Some(old_route) = similar_route else {
                    let is_delayed = route.delay.is_some();
                    (route.entry_glide, route.fade) = (is_delayed.then_some(fade), (!is_delayed).then_some(fade));
                    continue;
                };
                route.take_over(old_route);
                // A longer delay is silent at first: fade in when its first sample comes out.
                let mut fade = GainGlide::new(self.rate, 0.0);
                fade.set_after(
                    1.0,
                    route.delay_frames().saturating_sub(old_route.delay_frames()) as u64,
                );
                (route.entry_glide, route.fade) = (old_route.entry_glide, Some(fade));
                continue;
            };
            search_start = route_index + 1;
            let old_route = &old.routes[route_index];
            route.take_over(old_route);
            (route.entry_glide, route.fade) = (old_route.entry_glide, old_route.fade);
            route.residual_gain = old_route.residual_gain;
            let (old_gain, new_gain) = (old_route.gain_at(old.frame), route.gain_at(old.frame));
            if new_gain == old_gain {
                continue;
            }
            let gain_before = old_route.faded_gain_at(old.frame);
            (route.fade, route.residual_gain) = (None, None);
            if new_gain == 0.0 || route.curve.is_some() {
                route.residual_gain = glide_to_zero(self.rate, gain_before - new_gain); // a factor would grow with the curve
            } else {
                route.set_fade(self.rate, gain_before / new_gain, 1.0);
            }
        }
        for route_index in 1..self.routes.len() {
            let (earlier_routes, later_routes) = self.routes.split_at_mut(route_index);
            if let (Some(previous_route), Some(next_route)) = (earlier_routes.last(), later_routes.first_mut()) {
                next_route.repeats_previous = next_route.has_same_input_as(previous_route);
            }
        }
        let new_gain = self.master_curve.as_ref().map_or(1.0, |fade| fade.gain_at(old.frame));
        let old_gain = old.master_curve.as_ref().map_or(1.0, |fade| fade.gain_at(old.frame));
        self.residual_gain = old.residual_gain;
        if new_gain != old_gain {
            self.residual_gain = glide_to_zero(self.rate, old.master_gain(old.frame) - new_gain);
        }
        for room in &mut self.rooms {
            room.take_over(&old.rooms);
        }
        self.fade_out_missing(old, new_output);
        self.take_over_frozen(old, new_output);
        self.is_fading = true;
    }

    /// Frozen outputs at the same place continue, new ones fade in, and those that are gone fade out.
    fn take_over_frozen(&mut self, old: &Self, out: impl Fn(usize) -> Option<usize>) {
        for placed in &mut self.frozen_outputs {
            let is_same_place = |other: &&PlacedOutput| {
                out(other.mixer_output).is_some_and(|new_output| placed.is_continuation_of(other, new_output))
            };
            placed.fade = match old.frozen_outputs.iter().find(is_same_place) {
                Some(old_frozen) => old_frozen.fade,
                None => GainGlide::between(self.rate, 0.0, 1.0),
            };
        }
        let gone_outputs = old.frozen_outputs.iter().filter_map(|old_frozen| {
            let new_output = out(old_frozen.mixer_output)?;
            let is_continuing = self
                .frozen_outputs
                .iter()
                .any(|placed| placed.is_continuation_of(old_frozen, new_output));
            let fade_out = GainGlide::between(self.rate, old_frozen.fade.gain_at(old.frame), 0.0);
            (!is_continuing).then(|| old_frozen.with_fade(new_output, fade_out))
        });
        let fading_out = old.frozen_outputs_fading_out.iter().flatten();
        let fading_out = fading_out.filter_map(|other| Some(other.with_fade(out(other.mixer_output)?, other.fade)));
        for (fading_slot, other) in self
            .frozen_outputs_fading_out
            .iter_mut()
            .zip(fading_out.chain(gone_outputs))
        {
            *fading_slot = Some(other);
        }
    }

    /// Routes of `old` without a successor here fade out; `out` maps their outputs to those here.
    fn fade_out_missing(&mut self, old: &mut Self, out: impl Fn(usize) -> Option<usize>) {
        let (mut search_start, route_count) = (0, self.routes.len());
        let (n_channels, n_rooms) = (self.n_channels, self.rooms.len());
        let mut free_places = self.fading_out.iter_mut();
        let is_sounding = |fading_route: &&mut Route| !fading_route.has_faded_out(old.frame);
        let fading_out = old.fading_out.iter_mut().flatten().filter(is_sounding);
        for old_route in fading_out.chain(&mut old.routes) {
            let new_output = out(old_route.output);
            let (Some(output), true) = (new_output, old_route.group < self.group_gains.len()) else {
                continue;
            };
            let successor = (search_start..route_count)
                .chain(0..search_start)
                .find(|&route_index| self.routes[route_index].is_continuation_of(old_route, new_output));
            if let Some(route_index) = successor {
                search_start = route_index + 1;
                continue;
            }
            let is_there = match old_route.target {
                RouteTarget::Channel(channel) => channel < n_channels,
                RouteTarget::Room(room) => room < n_rooms,
            };
            if !is_there {
                continue;
            }
            let Some(free_place) = free_places.next() else {
                return;
            };
            let (delay, curve) = (old_route.delay.take(), old_route.curve.take());
            let filters = std::mem::take(&mut old_route.filters);
            let mut fading_route = Route {
                output,
                filters,
                delay,
                curve,
                shared_curve: None,
                repeats_previous: false,
                ..old_route.clone()
            };
            let gain_before = old_route.fade.map_or(1.0, |fade| fade.gain_at(old.frame));
            fading_route.set_fade(self.rate, gain_before, 0.0);
            *free_place = Some(fading_route);
        }
    }
}
