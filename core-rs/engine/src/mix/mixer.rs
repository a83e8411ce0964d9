//! Routes of outputs to channels.

mod route;
mod span;
mod stored;
mod takeover;

use std::sync::Arc;

use super::curve::Curve;
use super::filter::FilterKind;
use super::frozen::{FrozenOutputs, PlacedOutput};
use super::glide::{GainGlide, frames_to_next_grid_frame, update_fading_gain};
use super::room::{Room, RoomSpec};
use crate::section::SECTION_LANES;
use route::{GROUPS_MAX, Route};
pub use route::{RouteError, RouteTarget, RouteTreatment};

/// Frames that are mixed at a time.
const SPAN_FRAMES: usize = 256;
/// Largest number of routes that fade out at once; further routes stop without a fade.
const FADING_OUT_MAX: usize = 32;
/// Largest number of frozen outputs that fade out at once; further ones stop without a fade.
const FROZEN_FADING_OUT_MAX: usize = 128;

/// Routes of outputs to channels, with gains, filters and delays.
///
/// A channel is the sum of its routes in the order in which they were added, so the last bit of a mix does not depend
/// on how it is cut into blocks. Each route belongs to a group (0 by default); the gain of a group can be changed
/// during playback.
///
/// ```
/// use ergon_engine::mix::mixer::Mixer;
///
/// let mut mixer = Mixer::new(44_100.0, 2, 1);
/// mixer.add_route(0, 0, 0.5, None)?;
/// mixer.add_route(1, 0, 2.0, None)?;
/// let mut mixed = [0.0; 2];
/// mixer.process(&[1.0, 0.25, 0.0, 1.0], &mut mixed); // two frames of two outputs
/// assert_eq!(mixed, [1.0, 2.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Mixer {
    rate: f64,
    n_out: usize,
    n_channels: usize,
    routes: Vec<Route>,
    group_gains: Vec<GainGlide>,
    rooms: Vec<Room>,
    /// Curves of routes, each once, and their gains in the present span   (n_curves · SPAN_FRAMES)
    curves: Vec<Curve>,
    curve_gains: Vec<f64>,
    /// Input of the rooms   (n_rooms · SPAN_FRAMES)
    room_inputs: Vec<f64>,
    /// Gain of all channels over the frames of the piece.
    master_curve: Option<Curve>,
    /// Difference between the earlier gain of all channels and the current one, since a takeover; it glides to 0.
    residual_gain: Option<GainGlide>,
    /// Routes of an earlier mixer that fade out. Those that have ended stay here, because freeing them would take time.
    fading_out: [Option<Route>; FADING_OUT_MAX],
    /// Outputs that were computed earlier.
    frozen_outputs: Vec<PlacedOutput>,
    /// Frozen outputs of an earlier mixer that fade out   (FROZEN_FADING_OUT_MAX)
    frozen_outputs_fading_out: Vec<Option<PlacedOutput>>,
    /// Sum of the frozen outputs of one route in a span   (SPAN_FRAMES)
    frozen_sum: Vec<f64>,
    /// What some routes add to their targets in a span, before their gains   (2 · SECTION_LANES · SPAN_FRAMES)
    signals: Vec<f64>,
    /// Sums of the routes to each channel in a span   (n_channels · SPAN_FRAMES)
    channel_sums: Vec<f64>,
    /// Whether any fade may be running.
    is_fading: bool,
    frame: u64,
}

impl Mixer {
    /// A silent mixer of `n_out` outputs into `n_channels` channels at `rate` [Hz].
    pub fn new(rate: f64, n_out: usize, n_channels: usize) -> Self {
        Self {
            rate,
            n_out,
            n_channels,
            routes: Vec::new(),
            group_gains: vec![GainGlide::new(rate, 1.0)],
            rooms: Vec::new(),
            curves: Vec::new(),
            curve_gains: Vec::new(),
            room_inputs: Vec::new(),
            master_curve: None,
            residual_gain: None,
            fading_out: [const { None }; FADING_OUT_MAX],
            frozen_outputs: Vec::new(),
            frozen_outputs_fading_out: vec![None; FROZEN_FADING_OUT_MAX],
            frozen_sum: vec![0.0; SPAN_FRAMES],
            signals: vec![0.0; 2 * SECTION_LANES * SPAN_FRAMES],
            channel_sums: vec![0.0; n_channels * SPAN_FRAMES],
            is_fading: false,
            frame: 0,
        }
    }

    /// Number of outputs that come in.
    pub fn n_out(&self) -> usize {
        self.n_out
    }

    /// Number of channels that go out.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// Add a route of output `out` to a channel, with a gain, in group 0; `highpass` [Hz] is the cutoff of a
    /// Butterworth filter of order 2.
    ///
    /// # Errors
    /// [`RouteError`] if an index, the gain or the cutoff is out of range.
    pub fn add_route(
        &mut self,
        out: usize,
        channel: usize,
        gain: f64,
        highpass: Option<f64>,
    ) -> Result<(), RouteError> {
        self.add_route_in_group(0, out, channel, gain, highpass)
    }

    /// [`Mixer::add_route`] in a group; missing groups up to `group` are created.
    ///
    /// # Errors
    /// [`RouteError`] if an index, the gain or the cutoff is out of range.
    pub fn add_route_in_group(
        &mut self,
        group: usize,
        out: usize,
        channel: usize,
        gain: f64,
        highpass: Option<f64>,
    ) -> Result<(), RouteError> {
        let treatment = RouteTreatment {
            filters: highpass.map(|f| FilterKind::Highpass { f }).into_iter().collect(),
            ..RouteTreatment::default()
        };
        self.add_treated_route(group, out, RouteTarget::Channel(channel), gain, treatment)
    }

    /// [`Mixer::add_route_in_group`] to a channel or a room, with a treatment of the signal.
    ///
    /// # Errors
    /// [`RouteError`] if an index, the gain, the cutoff or the delay is out of range.
    pub fn add_treated_route(
        &mut self,
        group: usize,
        out: usize,
        target: RouteTarget,
        gain: f64,
        treatment: RouteTreatment,
    ) -> Result<(), RouteError> {
        if group >= GROUPS_MAX {
            return Err(RouteError::Group(group));
        }
        let (n_out, rate) = (self.n_out, self.rate);
        if out >= n_out {
            return Err(RouteError::Out { out, n_out });
        }
        self.check_target(target)?;
        let curve = treatment.curve.clone();
        let mut new_route = Route::new(rate, [out, group], target, gain, treatment)?;
        new_route.shared_curve = curve.map(|curve| self.add_curve(curve));
        new_route.repeats_previous = self.routes.last().is_some_and(|last| new_route.has_same_input_as(last));
        let n_groups = self.group_gains.len().max(group + 1);
        self.group_gains.resize(n_groups, GainGlide::new(rate, 1.0));
        self.routes.push(new_route);
        Ok(())
    }

    /// Add a curve if no route has it yet; returns its index among those of all routes.
    fn add_curve(&mut self, curve: Curve) -> usize {
        let known_index = self.curves.iter().position(|known_curve| *known_curve == curve);
        known_index.unwrap_or_else(|| {
            self.curves.push(curve);
            self.curve_gains.resize(self.curves.len() * SPAN_FRAMES, 0.0);
            self.curves.len() - 1
        })
    }

    fn check_target(&self, target: RouteTarget) -> Result<(), RouteError> {
        let (n_channels, n_rooms) = (self.n_channels, self.rooms.len());
        match target {
            RouteTarget::Channel(channel) if channel >= n_channels => Err(RouteError::Channel { channel, n_channels }),
            RouteTarget::Room(room) if room >= n_rooms => Err(RouteError::Room { room, n_rooms }),
            _ => Ok(()),
        }
    }

    /// Add a room, heard by some channels; returns its index.
    ///
    /// ```
    /// use ergon_engine::mix::mixer::{Mixer, RouteTarget, RouteTreatment};
    /// use ergon_engine::mix::room::RoomSpec;
    ///
    /// let mut mixer = Mixer::new(44_100.0, 1, 2);
    /// let hall = mixer.add_room(RoomSpec {
    ///     name: "hall".to_owned(),
    ///     size: 12.0,
    ///     t60: [(200.0, 2.0), (6_000.0, 2.0)],
    ///     channels: vec![0, 1],
    ///     gain: 1.0,
    /// })?;
    /// mixer.add_treated_route(0, 0, RouteTarget::Room(hall), 1.0, RouteTreatment::default())?;
    /// let (mut click, mut heard) = (vec![0.0; 44_100], vec![0.0; 88_200]);
    /// click[0] = 1.0;
    /// mixer.process(&click, &mut heard);
    /// let energy: f64 = heard.iter().map(|x| x * x).sum();
    /// assert!((energy - 2.0).abs() < 0.3, "{energy}"); // that of the click in each channel
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`RouteError`] if a channel does not exist or the room cannot be built.
    pub fn add_room(&mut self, spec: RoomSpec) -> Result<usize, RouteError> {
        for &channel in &spec.channels {
            self.check_target(RouteTarget::Channel(channel))?;
        }
        self.rooms.push(Room::new(spec, self.rate)?);
        self.room_inputs.resize(self.rooms.len() * SPAN_FRAMES, 0.0);
        Ok(self.rooms.len() - 1)
    }

    /// Add frozen outputs to `outputs`, one to each; their first frame is heard at frame `start_frame`.
    ///
    /// ```
    /// use ergon_engine::mix::frozen::FrozenOutputs;
    /// use ergon_engine::mix::mixer::Mixer;
    ///
    /// let mut mixer = Mixer::new(44_100.0, 1, 1);
    /// mixer.add_route(0, 0, 0.5, None)?;
    /// mixer.add_frozen_outputs(&FrozenOutputs::new(vec![1.0, 2.0], 1).into(), &[0], 1)?;
    /// let mut mixed = [0.0; 4];
    /// mixer.process(&[0.0, 0.0, 4.0, 4.0], &mut mixed);
    /// assert_eq!(mixed, [0.0, 0.5, 3.0, 2.0]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`RouteError`] if an output does not exist, or the numbers of outputs differ.
    pub fn add_frozen_outputs(
        &mut self,
        source: &Arc<FrozenOutputs>,
        outputs: &[usize],
        start_frame: i64,
    ) -> Result<(), RouteError> {
        let n_out = self.n_out;
        if let Some(&out) = outputs.iter().find(|&&out| out >= n_out) {
            return Err(RouteError::Out { out, n_out });
        }
        if outputs.len() != source.n_out() {
            return Err(RouteError::Frozen {
                frozen: source.n_out(),
                outputs: outputs.len(),
            });
        }
        for (column, &out) in outputs.iter().enumerate() {
            let placed_output = PlacedOutput::new(source.clone(), column, out, start_frame, self.rate);
            self.frozen_outputs.push(placed_output);
        }
        Ok(())
    }

    /// Set a gain over the frames of the piece for all channels.
    pub fn set_master_curve(&mut self, curve: Curve) {
        self.master_curve = Some(curve);
    }

    /// Number of groups of routes.
    pub fn n_groups(&self) -> usize {
        self.group_gains.len()
    }

    /// Begin fades that are due at the next frame, and end those that are over; returns whether no fade is left.
    fn begin_fades(&mut self) -> bool {
        if self.is_fading {
            let next_frame = self.frame;
            self.is_fading = false;
            let fading_out = self.fading_out.iter_mut().flatten();
            for route in self.routes.iter_mut().chain(fading_out) {
                self.is_fading |= update_fading_gain(&mut route.residual_gain, next_frame);
                if let Some(entry_glide) = &mut route.entry_glide {
                    entry_glide.begin_requested(next_frame);
                    let entry_is_over = entry_glide.constant_gain(next_frame).is_some();
                    self.is_fading |= !entry_is_over;
                    route.entry_glide.take_if(|_| entry_is_over);
                }
                let Some(route_fade) = &mut route.fade else {
                    continue;
                };
                route_fade.begin_requested(next_frame);
                self.is_fading |= route_fade.constant_gain(next_frame).is_none();
                if route_fade.constant_gain(next_frame) == Some(1.0) {
                    route.fade = None;
                }
            }
            self.is_fading |= update_fading_gain(&mut self.residual_gain, next_frame);
            let fading_out = self.frozen_outputs_fading_out.iter_mut().flatten();
            for frozen_output in self.frozen_outputs.iter_mut().chain(fading_out) {
                frozen_output.fade.begin_requested(next_frame);
                self.is_fading |= frozen_output.fade.constant_gain(next_frame).is_none();
            }
            for fading_slot in &mut self.frozen_outputs_fading_out {
                fading_slot.take_if(|placed| placed.fade.constant_gain(next_frame).is_some());
            }
        }
        !self.is_fading
    }

    /// Set the number of the next frame in the piece.
    pub fn seek(&mut self, n: u64) {
        self.frame = n;
    }

    /// Let the gain of a group glide to `gain`, over 20 ms from the next multiple of 64 frames on; a group that does
    /// not exist is ignored. Does not allocate.
    pub fn set_gain(&mut self, group: usize, gain: f64) {
        if let Some(group_glide) = self.group_gains.get_mut(group) {
            group_glide.set(gain);
        }
    }

    /// Fill `mixed` (n_frames, n_channels) from `frames` (n_frames, n_out), both row by row.
    ///
    /// # Panics
    /// If the two do not hold the same number of frames.
    pub fn process(&mut self, frames: &[f64], mixed: &mut [f64]) {
        let n_frames = mixed.len().checked_div(self.n_channels).unwrap_or(0);
        assert_eq!(mixed.len(), n_frames * self.n_channels);
        assert_eq!(frames.len(), n_frames * self.n_out);
        let mut frames_done = 0;
        while frames_done < n_frames {
            let next_frame = self.frame;
            self.group_gains
                .iter_mut()
                .for_each(|glide| glide.begin_requested(next_frame));
            let no_fades = self.begin_fades();
            let is_steady = no_fades
                && self
                    .group_gains
                    .iter()
                    .all(|glide| glide.constant_gain(next_frame).is_some());
            let span_length = frames_to_next_grid_frame(next_frame, is_steady)
                .min((n_frames - frames_done) as u64)
                .min(SPAN_FRAMES as u64) as usize;
            let frame_span = frames_done..frames_done + span_length;
            self.mix_span(
                &frames[frame_span.start * self.n_out..frame_span.end * self.n_out],
                &mut mixed[frame_span.start * self.n_channels..frame_span.end * self.n_channels],
            );
            frames_done += span_length;
            self.frame += span_length as u64;
        }
    }

    /// The gain of all channels at a frame.
    fn master_gain(&self, n: u64) -> f64 {
        let residual = self.residual_gain.map_or(0.0, |glide| glide.gain_at(n));
        self.master_curve.as_ref().map_or(1.0, |curve| curve.gain_at(n)) + residual
    }
}

#[cfg(test)]
mod tests;
