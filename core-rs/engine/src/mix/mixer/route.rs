//! One route of an output to a channel or a room.

use thiserror::Error;

use crate::archive::{Archive, Damaged, State};
use crate::mix::curve::Curve;
use crate::mix::delay::{DelayLine, Echo};
use crate::mix::filter::{Filter, FilterKind};
use crate::mix::glide::GainGlide;
use crate::mix::room::RoomError;
use crate::section::FilterSection;

/// Largest delay of a route [frames].
pub(super) const DELAY_MAX: usize = 1 << 20;
/// Largest number of groups of a mixer.
pub(super) const GROUPS_MAX: usize = 1 << 16;

/// Why a route cannot be built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RouteError {
    /// No such output.
    #[error("there is no output {out}: the mixer has {n_out}, counted from 0")]
    Out {
        /// Requested output.
        out: usize,
        /// Number of outputs.
        n_out: usize,
    },
    /// No such channel.
    #[error("there is no channel {channel}: the mixer has {n_channels}, counted from 0")]
    Channel {
        /// Requested channel.
        channel: usize,
        /// Number of channels.
        n_channels: usize,
    },
    /// Too many groups.
    #[error("a group of routes is counted from 0 up to {most}; here {0}", most = GROUPS_MAX - 1)]
    Group(usize),
    /// A gain that is NaN or infinite.
    #[error("a route's gain must be a finite number; here {0}")]
    Gain(f64),
    /// A filter whose cutoff is not between 0 and half of the rate.
    #[error("{word} {cutoff} Hz must lie above 0 and below half of the rate, {rate} Hz")]
    Cutoff {
        /// What the filter does.
        word: &'static str,
        /// Requested cutoff [Hz].
        cutoff: f64,
        /// Sample rate [Hz].
        rate: f64,
    },
    /// A shelf without a level.
    #[error("the level of a {word} must be a finite number of decibels; here {level}")]
    Shelf {
        /// What the filter does.
        word: &'static str,
        /// Requested level [dB].
        level: f64,
    },
    /// No such room.
    #[error("there is no room {room}: the mixer has {n_rooms}, counted from 0")]
    Room {
        /// Requested room.
        room: usize,
        /// Number of rooms.
        n_rooms: usize,
    },
    /// A delay that is too long.
    #[error("a route is delayed by {DELAY_MAX} frames at most; here {0}")]
    Delay(usize),
    /// An echo that does not fall, or that comes later than the delay.
    #[error(
        "an echo must come after 1 frame at least and the route's delay at most, with a ratio between -1 and 1; \
         here {} frames and {}", .0.delay_frames, .0.feedback_ratio
    )]
    Echo(Echo),
    /// The number of frozen outputs differs from the number of outputs that they replace.
    #[error("{frozen} frozen outputs cannot replace {outputs} outputs; the numbers must be equal")]
    Frozen {
        /// Number of frozen outputs.
        frozen: usize,
        /// Number of outputs named.
        outputs: usize,
    },
    /// A room that cannot be built.
    #[error(transparent)]
    InvalidRoom(#[from] RoomError),
}

/// Where a route leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RouteTarget {
    /// A channel.
    Channel(usize),
    /// A room, by the index that [`Mixer::room`](super::Mixer::room) returns.
    Room(usize),
}

/// What a route does to its signal besides the gain.
#[derive(Clone, Debug, Default)]
pub struct RouteTreatment {
    /// Whether the square of the signal is heard; everything else acts on the square.
    pub is_squared: bool,
    /// Filters, one after the other.
    pub filters: Vec<FilterKind>,
    /// Delay [frames].
    pub delay: usize,
    /// The feedback of the delay.
    pub echo: Option<Echo>,
    /// A gain over the frames of the piece.
    pub curve: Option<Curve>,
}

#[derive(Clone, Debug)]
pub(super) struct Route {
    pub(super) output: usize,
    pub(super) target: RouteTarget,
    pub(super) group: usize,
    pub(super) gain: f64,
    pub(super) is_squared: bool,
    pub(super) filters: Box<[Filter]>,
    pub(super) delay: Option<DelayLine>,
    pub(super) curve: Option<Curve>,
    /// Index of the curve among those that the mixer computes for all routes.
    pub(super) shared_curve: Option<usize>,
    /// A factor that glides since a takeover.
    pub(super) fade: Option<GainGlide>,
    /// A factor of what goes into the delay, which glides from 0 since a takeover: else the echoes of the beginning
    /// would be heard as steps.
    pub(super) entry_glide: Option<GainGlide>,
    /// A gain added to its own, which glides to 0 since a takeover; used where a factor cannot lead to the new gain.
    pub(super) residual_gain: Option<GainGlide>,
    /// Whether its filters have the same input and the same state as those of the route before it, so that their output
    /// is the same.
    pub(super) repeats_previous: bool,
}

/// The state of its filters and its delay, without fades.
impl State for Route {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self.filters[..].archive(archive)?;
        self.delay.as_mut().map_or(Ok(()), |delay| delay.archive(archive))
    }
}

impl Route {
    /// A route of an output in a group, to a channel or a room; `rate` [Hz] is that of the mixer.
    pub(super) fn new(
        rate: f64,
        [out, group]: [usize; 2],
        target: RouteTarget,
        gain: f64,
        treatment: RouteTreatment,
    ) -> Result<Self, RouteError> {
        let RouteTreatment {
            is_squared,
            filters: tones,
            delay,
            echo,
            curve,
        } = treatment;
        if !gain.is_finite() {
            return Err(RouteError::Gain(gain));
        }
        tones.iter().try_for_each(|tone| check_filter(tone, rate))?;
        if delay > DELAY_MAX {
            return Err(RouteError::Delay(delay));
        }
        let echo_falls = |echo: &Echo| {
            (1..=delay).contains(&echo.delay_frames) && -1.0 < echo.feedback_ratio && echo.feedback_ratio < 1.0
        };
        if let Some(echo) = echo.filter(|echo| !echo_falls(echo)) {
            return Err(RouteError::Echo(echo));
        }
        Ok(Self {
            output: out,
            target,
            group,
            gain,
            is_squared,
            filters: tones.into_iter().map(|tone| Filter::new(tone, rate)).collect(),
            delay: (delay > 0).then(|| DelayLine::with_echo(delay, echo)),
            curve,
            shared_curve: None,
            fade: None,
            entry_glide: None,
            residual_gain: None,
            repeats_previous: false,
        })
    }

    /// Whether the route has the same structure as `old_route` of an old mixer, whose output is now `out`; values may
    /// differ.
    pub(super) fn has_structure_of(&self, old_route: &Self, out: Option<usize>) -> bool {
        (out, old_route.target, old_route.group) == (Some(self.output), self.target, self.group)
            && self.is_squared == old_route.is_squared
            && self.delay.is_some() == old_route.delay.is_some()
            && self.filters_match(old_route, Filter::is_same_kind)
    }

    /// Whether it continues `old_route` without a step: only gains differ.
    pub(super) fn is_continuation_of(&self, old_route: &Self, out: Option<usize>) -> bool {
        let delay_and_echo = |route: &Self| {
            let delay = route.delay.as_ref();
            delay.map(|delay| (delay.length(), delay.echo()))
        };
        self.has_structure_of(old_route, out)
            && delay_and_echo(self) == delay_and_echo(old_route)
            && self.filters_match(old_route, Filter::is_equal)
    }

    /// Whether the filters of both are as many, and `agree` one by one.
    fn filters_match(&self, other_route: &Self, agree: impl Fn(&Filter, &Filter) -> bool) -> bool {
        let mut filter_pairs = self.filters.iter().zip(&other_route.filters);
        self.filters.len() == other_route.filters.len() && filter_pairs.all(|(filter, old)| agree(filter, old))
    }

    /// Frames by which it delays.
    pub(super) fn delay_frames(&self) -> usize {
        self.delay.as_ref().map_or(0, DelayLine::length)
    }

    /// Continue with the state of filters and delay of a route that is like it. Allocates nothing.
    pub(super) fn take_over(&mut self, old_route: &Self) {
        let filter_pairs = self.filters.iter_mut().zip(&old_route.filters);
        filter_pairs.for_each(|(filter, old)| filter.take_over(old));
        if let (Some(delay), Some(old_delay)) = (&mut self.delay, &old_route.delay) {
            delay.take_over(old_delay);
        }
    }

    /// Whether it has faded out.
    pub(super) fn has_faded_out(&self, frame: u64) -> bool {
        self.fade.is_some_and(|fade| fade.constant_gain(frame) == Some(0.0))
    }

    /// Its gain at a frame of the piece, without fades.
    pub(super) fn gain_at(&self, frame: u64) -> f64 {
        self.gain * self.curve.as_ref().map_or(1.0, |curve| curve.gain_at(frame))
    }

    /// Its gain at a frame of the piece, with fades.
    pub(super) fn faded_gain_at(&self, frame: u64) -> f64 {
        let fade = self.fade.map_or(1.0, |fade| fade.gain_at(frame));
        self.gain_at(frame) * fade + self.residual_gain.map_or(0.0, |glide| glide.gain_at(frame))
    }

    /// Glide from one factor of its gain to another.
    pub(super) fn set_fade(&mut self, rate: f64, start_gain: f64, target_gain: f64) {
        self.fade = Some(GainGlide::between(rate, start_gain, target_gain));
    }

    /// Whether its filters have the same input as those of another route, and the same state.
    pub(super) fn has_same_input_as(&self, other: &Self) -> bool {
        (self.output, self.is_squared) == (other.output, other.is_squared)
            && self.filters_match(other, |filter, other| {
                filter.is_equal(other) && filter.has_same_state(other)
            })
    }

    /// Make samples of its output ready for its filters. A sample that is not finite counts as 0 for a filter: it would
    /// keep the channel silent long after its cause was muted.
    pub(super) fn prepare_input(&self, signal: &mut [f64]) {
        if self.is_squared {
            signal.iter_mut().for_each(|x| *x *= *x);
        }
        if !self.filters.is_empty() {
            for x in signal.iter_mut().filter(|x| !x.is_finite()) {
                *x = 0.0;
            }
        }
    }

    /// The section of its first filter, if that is a high-pass.
    pub(super) fn first_highpass(&mut self) -> Option<&mut FilterSection> {
        self.filters.first_mut()?.highpass_section()
    }

    /// Filter samples in place; `is_highpassed` says that a first filter that is a high-pass has been applied.
    pub(super) fn filter(&mut self, signal: &mut [f64], is_highpassed: bool) {
        let n_applied = usize::from(is_highpassed && self.first_highpass().is_some());
        for filter in &mut self.filters[n_applied..] {
            filter.process(signal);
        }
    }

    /// Copy the state of the filters of a route with the same input.
    pub(super) fn copy_filter_states(&mut self, leader: &Self) {
        let filter_pairs = self.filters.iter_mut().zip(&leader.filters);
        filter_pairs.for_each(|(filter, leader_filter)| filter.take_over(leader_filter));
    }

    /// Add a filtered signal to the route's target; `first` is the first frame in the piece, `gains` are those of its
    /// curve from there on, if they are known.
    pub(super) fn add_signal(
        &mut self,
        (group, gains): (&GainGlide, Option<&[f64]>),
        first: u64,
        signal: &[f64],
        mixed: &mut [f64],
    ) {
        let is_gliding = self.fade.is_some() || self.residual_gain.is_some();
        let is_plain = self.delay.is_none() && self.entry_glide.is_none() && !is_gliding;
        let steady_gain = group.constant_gain(first).filter(|_| is_plain);
        let route_gain = steady_gain.map(|group| self.gain * group);
        match (route_gain, &self.curve, gains) {
            (Some(route_gain), None, _) => {
                let sample_pairs = mixed.iter_mut().zip(signal);
                sample_pairs.for_each(|(y, x)| *y += route_gain * x);
            }
            (Some(route_gain), Some(_), Some(curve)) => {
                let curved_samples = mixed.iter_mut().zip(signal).zip(curve);
                curved_samples.for_each(|((y, x), curve)| *y += route_gain * curve * x);
            }
            _ => self.add_gliding((group, gains), first, signal, mixed),
        }
    }

    fn add_gliding(
        &mut self,
        (group, gains): (&GainGlide, Option<&[f64]>),
        first: u64,
        signal: &[f64],
        mixed: &mut [f64],
    ) {
        for (index, ((y, &x), frame)) in mixed.iter_mut().zip(signal).zip(first..).enumerate() {
            let x = self.entry_glide.map_or(x, |entry| entry.gain_at(frame) * x);
            let x = self.delay.as_mut().map_or(x, |delay| delay.delay_sample(x));
            let curve = match (gains, &self.curve) {
                (Some(gains), _) => gains[index],
                (None, Some(curve)) => curve.gain_at(frame),
                (None, None) => 1.0,
            };
            let fade = self.fade.map_or(1.0, |fade| fade.gain_at(frame));
            *y += self.gain * group.gain_at(frame) * fade * curve * x;
            if let Some(residual) = self.residual_gain {
                *y += residual.gain_at(frame) * group.gain_at(frame) * x;
            }
        }
    }
}

fn check_filter(tone: &FilterKind, rate: f64) -> Result<(), RouteError> {
    let (word, cutoff) = (tone.score_word(), tone.frequency());
    if !(cutoff > 0.0 && cutoff < 0.5 * rate) {
        return Err(RouteError::Cutoff { word, cutoff, rate });
    }
    match *tone {
        FilterKind::Lowshelf { level, .. } | FilterKind::Highshelf { level, .. } if !level.is_finite() => {
            Err(RouteError::Shelf { word, level })
        }
        _ => Ok(()),
    }
}
