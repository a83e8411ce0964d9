//! All routes and rooms in a span in which no glide begins.

use super::{Mixer, PlacedOutput, Route, RouteTarget, SPAN_FRAMES};
use crate::mix::glide::GainGlide;
use crate::section::{FilterSection, SECTION_LANES, highpass_all};

/// Filtering all lanes at once takes as long as two single high-passes, so fewer high-passes than this are computed one
/// by one.
const SHARED_HIGHPASSES_MIN: usize = 3;

/// The inputs of routes in a span, and the sums to which they add.
struct Span<'a> {
    first_frame: u64,
    n_frames: usize,
    /// Outputs   (n_frames, n_out)
    frames: &'a [f64],
    n_out: usize,
    frozen_outputs: &'a [PlacedOutput],
    frozen_fading_out: &'a [Option<PlacedOutput>],
    frozen_sum: &'a mut [f64],
    group_gains: &'a [GainGlide],
    curve_gains: &'a [f64],
    channel_sums: &'a mut [f64],
    room_inputs: &'a mut [f64],
}

impl Mixer {
    /// Mix a span.
    pub(super) fn mix_span(&mut self, frames: &[f64], mixed: &mut [f64]) {
        let (first_frame, n_out, n_channels) = (self.frame, self.n_out, self.n_channels);
        let n_frames = mixed.len().checked_div(n_channels).unwrap_or(0);
        self.room_inputs.fill(0.0);
        self.channel_sums.fill(0.0);
        let curve_gains = self.curve_gains.chunks_exact_mut(SPAN_FRAMES);
        for (curve, curve_gains) in self.curves.iter().zip(curve_gains) {
            curve.fill(first_frame, &mut curve_gains[..n_frames]);
        }
        let mut span = Span {
            first_frame,
            n_frames,
            frames,
            n_out,
            frozen_outputs: &self.frozen_outputs,
            frozen_fading_out: &self.frozen_outputs_fading_out,
            frozen_sum: &mut self.frozen_sum[..n_frames],
            group_gains: &self.group_gains,
            curve_gains: &self.curve_gains,
            channel_sums: &mut self.channel_sums,
            room_inputs: &mut self.room_inputs,
        };
        let mut unmixed_routes = &mut self.routes[..];
        while !unmixed_routes.is_empty() {
            let (next_routes, later_routes) = unmixed_routes.split_at_mut(shared_route_count(unmixed_routes));
            span.mix_routes(next_routes, &mut self.signals);
            unmixed_routes = later_routes;
        }
        let fading_out = self.fading_out.iter_mut().flatten();
        for route in fading_out.filter(|route| !route.has_faded_out(first_frame)) {
            span.mix_routes(std::slice::from_mut(route), &mut self.signals);
        }
        for (channel, sums) in self.channel_sums.chunks_exact(SPAN_FRAMES).enumerate() {
            let column_samples = mixed.iter_mut().skip(channel).step_by(n_channels);
            column_samples.zip(sums).for_each(|(x, sum)| *x = *sum);
        }
        for (room, sent) in self.rooms.iter_mut().zip(self.room_inputs.chunks(SPAN_FRAMES)) {
            room.process(sent, mixed, n_channels);
        }
        if self.master_curve.is_some() || self.residual_gain.is_some() {
            let frames = mixed.chunks_exact_mut(n_channels.max(1));
            for (frame, n) in frames.zip(first_frame..) {
                let total_gain = self.master_gain(n);
                frame.iter_mut().for_each(|x| *x *= total_gain);
            }
        }
    }
}

/// Number of routes up to the last whose signal fits into the lanes: those that repeat another take none.
fn shared_route_count(routes: &[Route]) -> usize {
    let filtered_indices = (1..routes.len()).filter(|&index| !routes[index].repeats_previous);
    let mut indices_beyond_lanes = filtered_indices.skip(SECTION_LANES - 1);
    indices_beyond_lanes.next().unwrap_or(routes.len())
}

impl Span<'_> {
    /// Add routes to their targets, one after the other; `signals` (2 · SECTION_LANES, SPAN_FRAMES) have a row for each
    /// that does not repeat the one before it.
    fn mix_routes(&mut self, routes: &mut [Route], signals: &mut [f64]) {
        for (route, signal) in non_repeating(routes).zip(signals.chunks_exact_mut(SPAN_FRAMES)) {
            let signal = &mut signal[..self.n_frames];
            self.read_output(route.output, signal);
            route.prepare_input(signal);
        }
        let shares_highpass = non_repeating(routes).filter_map(Route::first_highpass).count() >= SHARED_HIGHPASSES_MIN;
        if shares_highpass {
            highpass_together(routes, signals, self.n_frames);
        }
        for (route, signal) in non_repeating(routes).zip(signals.chunks_exact_mut(SPAN_FRAMES)) {
            route.filter(&mut signal[..self.n_frames], shares_highpass);
        }
        let mut lane = 0;
        for index in 0..routes.len() {
            let (earlier_routes, later_routes) = routes.split_at_mut(index);
            let route = &mut later_routes[0];
            match earlier_routes.last() {
                Some(route_before) if route.repeats_previous => route.copy_filter_states(route_before),
                route_before => lane += usize::from(route_before.is_some()),
            }
            self.add_to_target(route, &signals[lane * SPAN_FRAMES..][..self.n_frames]);
        }
    }

    /// The samples of an output.
    fn read_output(&mut self, out: usize, signal: &mut [f64]) {
        let column_samples = self.frames.iter().skip(out).step_by(self.n_out);
        signal.iter_mut().zip(column_samples).for_each(|(x, y)| *x = *y);
        let fading_out = self.frozen_fading_out.iter().flatten();
        let frozen_outputs = self.frozen_outputs.iter().chain(fading_out);
        let mut frozen_outputs = frozen_outputs.filter(|placed| placed.mixer_output == out).peekable();
        if frozen_outputs.peek().is_some() {
            self.frozen_sum.fill(0.0);
            for placed in frozen_outputs {
                let sums = self.frozen_sum.iter_mut().zip(self.first_frame..);
                sums.for_each(|(sum, n)| *sum += placed.faded_sample(n));
            }
            let sums = self.frozen_sum.iter();
            signal.iter_mut().zip(sums).for_each(|(x, sum)| *x += *sum);
        }
    }

    /// Add the signal of a route to its target.
    fn add_to_target(&mut self, route: &mut Route, signal: &[f64]) {
        let (curve_gains, n_frames) = (self.curve_gains, self.n_frames);
        let shared_curve = route.shared_curve;
        let route_gains = shared_curve.map(|index| &curve_gains[index * SPAN_FRAMES..][..n_frames]);
        let target_sums = match route.target {
            RouteTarget::Channel(channel) => &mut self.channel_sums[channel * SPAN_FRAMES..],
            RouteTarget::Room(room) => &mut self.room_inputs[room * SPAN_FRAMES..],
        };
        let group_glide = &self.group_gains[route.group];
        route.add_signal(
            (group_glide, route_gains),
            self.first_frame,
            signal,
            &mut target_sums[..n_frames],
        );
    }
}

/// The routes that do not repeat the one before them.
fn non_repeating(routes: &mut [Route]) -> impl Iterator<Item = &mut Route> {
    let indexed_routes = routes.iter_mut().enumerate();
    indexed_routes.filter_map(|(index, route)| (index == 0 || !route.repeats_previous).then_some(route))
}

/// Filter the signal of each route whose first filter is a high-pass by that filter.
fn highpass_together(routes: &mut [Route], signals: &mut [f64], n_frames: usize) {
    let (signals, unused_samples) = signals.split_at_mut(SECTION_LANES * SPAN_FRAMES);
    let mut unused_signals = unused_samples.chunks_exact_mut(SPAN_FRAMES);
    let routes_and_signals = non_repeating(routes).zip(signals.chunks_exact_mut(SPAN_FRAMES));
    let mut filter_pairs = routes_and_signals.filter_map(|(route, signal)| Some((route.first_highpass()?, signal)));
    let mut sections = [const { FilterSection::IDENTITY }; SECTION_LANES];
    let mut highpasses: [Option<&mut FilterSection>; SECTION_LANES] = Default::default();
    let mut rows: [&mut [f64]; SECTION_LANES] = Default::default();
    for ((section, highpass_slot), row) in sections.iter_mut().zip(&mut highpasses).zip(&mut rows) {
        if let Some((highpass, signal)) = filter_pairs.next() {
            *section = highpass.clone();
            (*highpass_slot, *row) = (Some(highpass), signal);
        } else if let Some(signal) = unused_signals.next() {
            *row = signal;
        }
    }
    highpass_all(&mut sections, &mut rows, n_frames);
    for (highpass, section) in highpasses.into_iter().flatten().zip(&sections) {
        highpass.take_over(section);
    }
}
