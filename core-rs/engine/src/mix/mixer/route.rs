//! One route of an output to a channel or a room.

use thiserror::Error;

use crate::mix::curve::Curve;
use crate::mix::delay::Delay;
use crate::mix::glide::Glide;
use crate::mix::room::RoomError;
use crate::section::{BUTTERWORTH_2, Section};

/// Frames by which a route is delayed at most.
pub(super) const DELAY_MAX: usize = 1 << 20;
/// Groups of routes that a mixer has at most.
pub(super) const GROUPS_MAX: usize = 1 << 16;

/// Why a route cannot be built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RouteError {
    /// No such output.
    #[error("there is no output {out}: the mixer has {n_out}, counted from 0")]
    Out {
        /// Wanted output.
        out: usize,
        /// How many there are.
        n_out: usize,
    },
    /// No such channel.
    #[error("there is no channel {channel}: the mixer has {n_channels}, counted from 0")]
    Channel {
        /// Wanted channel.
        channel: usize,
        /// How many there are.
        n_channels: usize,
    },
    /// Too many groups.
    #[error("a group of routes is counted from 0 up to {most}; here {0}", most = GROUPS_MAX - 1)]
    Group(usize),
    /// NaN or infinite.
    #[error("a route's gain is a finite number; here {0}")]
    Gain(f64),
    /// Outside of what the rate can carry.
    #[error("highpass {cutoff} Hz must lie above 0 and below half of the rate, {rate} Hz")]
    Highpass {
        /// Wanted cutoff [Hz].
        cutoff: f64,
        /// Sample rate [Hz].
        rate: f64,
    },
    /// No such room.
    #[error("there is no room {room}: the mixer has {n_rooms}, counted from 0")]
    Room {
        /// Wanted room.
        room: usize,
        /// How many there are.
        n_rooms: usize,
    },
    /// Too late to be heard.
    #[error("a route is delayed by {DELAY_MAX} frames at most; here {0}")]
    Delay(usize),
    /// Frozen outputs that go to another number of outputs.
    #[error("{frozen} frozen outputs cannot replace {outputs} outputs; the numbers must be equal")]
    Frozen {
        /// How many are frozen.
        frozen: usize,
        /// How many were named.
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
    /// A room, by the order of [`Mixer::room`](super::Mixer::room).
    Room(usize),
}

/// What a route does on its way, beside its gain.
#[derive(Clone, Debug, Default)]
pub struct Treatment {
    /// Cutoff of a Butterworth high-pass of order 2 [Hz].
    pub highpass: Option<f64>,
    /// Frames by which it comes late.
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
    /// A factor on its way, since another mixer was taken over.
    pub(super) fade: Option<Glide>,
    /// What is left of its gain before, beyond its own, where no factor leads from one to the other.
    pub(super) rest: Option<Glide>,
}

impl Route {
    /// Of an output to a channel or a room, in a group, in a mixer at `rate` [Hz].
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
            fade: None,
            rest: None,
        })
    }

    /// Whether it is what a route `before` of another mixer was, whose output is `out` here.
    pub(super) fn is_as(&self, before: &Self, out: Option<usize>) -> bool {
        (out, before.to, before.group) == (Some(self.out), self.to, self.group)
            && before.highpass.is_some() == self.highpass.is_some()
            && before.delay.is_some() == self.delay.is_some()
    }

    /// Whether it has faded out, where it is one that does.
    pub(super) fn is_gone(&self, frame: u64) -> bool {
        self.fade
            .is_some_and(|fade| fade.steady(frame) == Some(0.0))
    }

    /// Its gain at a frame of the piece, by its curve.
    pub(super) fn written(&self, frame: u64) -> f64 {
        self.gain * self.curve.as_ref().map_or(1.0, |curve| curve.at(frame))
    }

    /// Its gain at a frame of the piece, as it is heard.
    pub(super) fn heard(&self, frame: u64) -> f64 {
        let fade = self.fade.map_or(1.0, |fade| fade.at(frame));
        self.written(frame) * fade + self.rest.map_or(0.0, |rest| rest.at(frame))
    }

    /// Fade to a factor of its gain, from another one.
    pub(super) fn fade(&mut self, rate: f64, from: f64, to: f64) {
        self.fade = Some(Glide::between(rate, from, to));
    }

    /// Add the route's share from frame `first` of the piece on.
    pub(super) fn add<'a>(
        &mut self,
        group: &Glide,
        first: u64,
        from: impl Iterator<Item = f64>,
        to: impl Iterator<Item = &'a mut f64>,
    ) {
        let is_plain = self.delay.is_none() && self.curve.is_none() && self.fade.is_none();
        let is_plain = is_plain && self.rest.is_none();
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
                for ((y, x), n) in to.zip(from).zip(first..) {
                    let x = section
                        .as_mut()
                        .map_or(x, |section| high_passed(section, x));
                    let x = self.delay.as_mut().map_or(x, |delay| {
                        let late = delay.oldest();
                        delay.push(x);
                        late
                    });
                    let curve = self.curve.as_ref().map_or(1.0, |curve| curve.at(n));
                    let fade = self.fade.map_or(1.0, |fade| fade.at(n));
                    *y += self.gain * group.at(n) * fade * curve * x;
                    if let Some(rest) = self.rest {
                        *y += rest.at(n) * group.at(n) * x;
                    }
                }
            }
        }
    }
}

/// The high-passed sample. A sample that is not finite counts as 0, for it would stay in the filter for ever and keep
/// the channel silent long after its cause was muted.
fn high_passed(section: &mut Section, x: f64) -> f64 {
    section.next(if x.is_finite() { x } else { 0.0 }).high
}
