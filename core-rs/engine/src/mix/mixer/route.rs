//! One route of an output to a channel or a room.

use thiserror::Error;

use crate::mix::curve::Curve;
use crate::mix::delay::Delay;
use crate::mix::glide::Glide;
use crate::mix::room::RoomError;
use crate::section::{BUTTERWORTH_2, Section};

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
    #[error("a route's gain is a finite number; here {0}")]
    Gain(f64),
    /// A cutoff that is not between 0 and half of the rate.
    #[error("highpass {cutoff} Hz must lie above 0 and below half of the rate, {rate} Hz")]
    Highpass {
        /// Requested cutoff [Hz].
        cutoff: f64,
        /// Sample rate [Hz].
        rate: f64,
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
    /// The number of frozen outputs differs from the number of outputs that they are added to.
    #[error("{frozen} frozen outputs cannot replace {outputs} outputs; the numbers must be equal")]
    Frozen {
        /// Number of frozen outputs.
        frozen: usize,
        /// Number of outputs named.
        outputs: usize,
    },
    /// A room that cannot be built.
    #[error(transparent)]
    Spec(#[from] RoomError),
}

/// Where a route leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum To {
    /// A channel.
    Channel(usize),
    /// A room, by the index that [`Mixer::room`](super::Mixer::room) returns.
    Room(usize),
}

/// What a route does to its signal besides the gain.
#[derive(Clone, Debug, Default)]
pub struct Treatment {
    /// Cutoff of a Butterworth high-pass of order 2 [Hz].
    pub highpass: Option<f64>,
    /// Delay [frames].
    pub delay: usize,
    /// A gain over the frames of the piece.
    pub curve: Option<Curve>,
}

#[derive(Clone, Debug)]
pub(super) struct Route {
    pub(super) out: usize,
    pub(super) to: To,
    pub(super) group: usize,
    pub(super) gain: f64,
    pub(super) highpass: Option<Section>,
    pub(super) delay: Option<Delay>,
    pub(super) curve: Option<Curve>,
    /// Index of the curve among those that the mixer computes for all routes.
    pub(super) shared_curve: Option<usize>,
    /// A factor that glides since a takeover.
    pub(super) fade: Option<Glide>,
    /// A gain added to its own, which glides to 0 since a takeover; used where a factor cannot lead to the new gain.
    pub(super) residual_gain: Option<Glide>,
}

impl Route {
    /// A route of an output in a group, to a channel or a room; `rate` [Hz] is that of the mixer.
    pub(super) fn new(
        rate: f64,
        [out, group]: [usize; 2],
        to: To,
        gain: f64,
        treatment: Treatment,
    ) -> Result<Self, RouteError> {
        let Treatment {
            highpass,
            delay,
            curve,
        } = treatment;
        if !gain.is_finite() {
            return Err(RouteError::Gain(gain));
        }
        if let Some(cutoff) = highpass.filter(|&f| !(f > 0.0 && f < 0.5 * rate)) {
            return Err(RouteError::Highpass { cutoff, rate });
        }
        if delay > DELAY_MAX {
            return Err(RouteError::Delay(delay));
        }
        Ok(Self {
            out,
            to,
            group,
            gain,
            highpass: highpass.map(|cutoff| Section::new(cutoff, rate, BUTTERWORTH_2)),
            delay: (delay > 0).then(|| Delay::new(delay)),
            curve,
            shared_curve: None,
            fade: None,
            residual_gain: None,
        })
    }

    /// Whether it continues the route `before` of an old mixer, whose output is now `out`.
    pub(super) fn continues(&self, before: &Self, out: Option<usize>) -> bool {
        (out, before.to, before.group) == (Some(self.out), self.to, self.group)
            && before.highpass.is_some() == self.highpass.is_some()
            && before.delay.is_some() == self.delay.is_some()
    }

    /// Whether it has faded out.
    pub(super) fn has_faded_out(&self, frame: u64) -> bool {
        self.fade
            .is_some_and(|fade| fade.steady(frame) == Some(0.0))
    }

    /// Its gain at a frame of the piece, without fades.
    pub(super) fn gain_at(&self, frame: u64) -> f64 {
        self.gain * self.curve.as_ref().map_or(1.0, |curve| curve.at(frame))
    }

    /// Its gain at a frame of the piece, with fades.
    pub(super) fn faded_gain_at(&self, frame: u64) -> f64 {
        let fade = self.fade.map_or(1.0, |fade| fade.at(frame));
        self.gain_at(frame) * fade + self.residual_gain.map_or(0.0, |glide| glide.at(frame))
    }

    /// Glide from one factor of its gain to another.
    pub(super) fn fade(&mut self, rate: f64, from: f64, to: f64) {
        self.fade = Some(Glide::between(rate, from, to));
    }

    /// Add the route's signal to its target; `first` is the first frame in the piece, `gains` are those of its curve
    /// from there on, if they are known.
    pub(super) fn add<'a>(
        &mut self,
        (group, gains): (&Glide, Option<&[f64]>),
        first: u64,
        from: impl Iterator<Item = f64>,
        to: impl Iterator<Item = &'a mut f64>,
    ) {
        let is_plain = self.delay.is_none() && self.curve.is_none() && self.fade.is_none();
        let is_plain = is_plain && self.residual_gain.is_none();
        match (group.steady(first), &mut self.highpass) {
            (Some(gain), None) if is_plain => {
                let gain = self.gain * gain;
                to.zip(from).for_each(|(y, x)| *y += gain * x);
            }
            (Some(gain), Some(section)) if is_plain => {
                let gain = self.gain * gain;
                to.zip(from)
                    .for_each(|(y, x)| *y += gain * high_passed(section, x));
            }
            (_, section) => {
                for (at, ((y, x), n)) in to.zip(from).zip(first..).enumerate() {
                    let x = section
                        .as_mut()
                        .map_or(x, |section| high_passed(section, x));
                    let x = self.delay.as_mut().map_or(x, |delay| {
                        let late = delay.oldest();
                        delay.push(x);
                        late
                    });
                    let curve = match (gains, &self.curve) {
                        (Some(gains), _) => gains[at],
                        (None, Some(curve)) => curve.at(n),
                        (None, None) => 1.0,
                    };
                    let fade = self.fade.map_or(1.0, |fade| fade.at(n));
                    *y += self.gain * group.at(n) * fade * curve * x;
                    if let Some(residual) = self.residual_gain {
                        *y += residual.at(n) * group.at(n) * x;
                    }
                }
            }
        }
    }
}

/// The high-passed sample. A sample that is not finite counts as 0: in the filter it would keep the channel silent long
/// after its cause was muted.
fn high_passed(section: &mut Section, x: f64) -> f64 {
    section.next(if x.is_finite() { x } else { 0.0 }).high
}
