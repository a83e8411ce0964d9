//! Timeline: strikes, ergons, gestures, imposed positions and couplings of a piece, by instant [s].

mod cut;
mod delayed_port;
mod drive;
mod gate;
mod glide;
mod hand;
mod lead;
mod pulse;
mod push;
mod sound_in;

use std::sync::Arc;

use crate::chance::Chance;
use crate::gesture::error::GestureError;
use crate::gesture::script::Gesture;
use crate::interrupt;
use crate::network::Network;
use crate::units::{Rate, score_frame};

pub use delayed_port::DelayedPort;
pub use drive::{Drive, DriveKind, DriveSource};
pub use gate::{FADE_SECONDS, GRID_FRAMES};
pub(crate) use gate::{Gate, GateContinuation};
pub(crate) use glide::Glide;
pub use glide::MatParameters;
pub use hand::{Hand, HandInterpolation};
pub use lead::Factors;
pub(crate) use lead::{Lead, next_change, with_first_factors, with_greatest_factors};
pub(crate) use pulse::StrikeTiming;
pub(crate) use push::{StrikeForce, strike_forces};
pub use sound_in::{Conditioner, InputSource, SoundIn, SoundInSettings};

/// Largest number of strikes of one piece. It bounds the memory of their forces: about 750 bytes per strike, for the
/// strike (32 bytes) and nine [`StrikeForce`]s of 40 bytes, which sorting holds twice.
const STRIKES_MAX: u64 = 2_000_000;

/// A rain: random strikes on some MATs.
#[derive(Clone, Copy, Debug)]
pub struct Rain {
    /// Strikes a second for each MAT [Hz].
    pub rate: f64,
    /// First instant [s].
    pub start: f64,
    /// Last instant [s].
    pub stop: f64,
    /// Weakest and strongest impulse [N·s].
    pub impulse: (f64, f64),
    /// How long each strike lasts [s]; none: as [`Timeline::strike`].
    pub duration: Option<f64>,
    /// Strikes outside these two instants [s] are drawn but left out.
    pub window: (f64, f64),
    /// Place in the score.
    pub source: u32,
}

/// Why strikes are refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StrikeError {
    /// A rain of more strikes than a piece can hold.
    #[error("more than {STRIKES_MAX} strikes: lower the rate, the span, or the number of members")]
    TooMany,
    /// An instant before the piece.
    #[error("a strike must be at 0 s or later, not at {0} s")]
    Before(f64),
    /// A strike that is too long [s].
    #[error("a strike lasts 0 to {} ms, not {} ms", 1e3 * pulse::STRIKE_SECONDS_MAX, 1e3 * .0)]
    Lasts(f64),
    /// A MAT that no strike moves.
    #[error("{0} is fixed, so no strike can move it; strike a mass that moves")]
    Fixed(String),
    /// A second path for one MAT.
    #[error("the position of MAT #{0} is imposed already; impose it once, and add further motion as forces")]
    Driven(usize),
    /// A tick that is too long or has no frame.
    #[error("a tick has 1 to {max} frames, not {0}", max = hand::TICK_FRAMES_MAX)]
    Tick(u32),
    /// A tick of another length than that of the hands before: (their length, its own length).
    #[error("all hands must have the same tick: those before have {0} frames, this one has {1}")]
    TickDiffers(u32, u32),
    /// An input that was never declared: (its index, the number of inputs).
    #[error("there is no input {0}: {1} inputs are declared; declare it by `Timeline::sound_in` first")]
    NoInput(usize, usize),
    /// A number that is not finite or out of range.
    #[error("{0} must be a finite number{1}, not {2}")]
    Value(&'static str, &'static str, f64),
}

/// An impulse on a MAT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Strike {
    /// Instant [s], which may lie between frames.
    pub(crate) instant: f64,
    pub(crate) mat: u32,
    pub(crate) source: u32,
    /// How long it lasts, in 1/44,100 s; 1: it acts at one instant.
    pub(crate) n_parts: u32,
    /// [N·s]
    pub(crate) impulse: f64,
}

/// An ergon given by its mass and speed; its impulse depends on the MAT that it hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ergon {
    /// Instant [s].
    pub(crate) instant: f64,
    pub(crate) mat: u32,
    pub(crate) source: u32,
    pub(crate) mass: f64,
    pub(crate) speed: f64,
}

/// A key, and the MAT that its ergons strike.
#[derive(Clone, Debug)]
pub struct Key {
    pub(crate) name: String,
    pub(crate) struck_mat: usize,
}

/// Everything that will happen to a network.
#[derive(Clone, Debug)]
pub struct Timeline {
    /// Frames a second.
    pub rate: Rate,
    pub(crate) keys: Vec<Key>,
    /// Shared, because a plan plays them many times.
    pub(crate) gestures: Vec<Arc<Gesture>>,
    pub(crate) strikes: Vec<Strike>,
    pub(crate) ergons: Vec<Ergon>,
    pub(crate) gates: Vec<Gate>,
    pub(crate) drives: Vec<Drive>,
    /// Inputs; drives hold copies of them.
    pub(crate) sounds_in: Vec<SoundIn>,
    pub(crate) glides: Vec<Glide>,
    pub(crate) leads: Vec<Lead>,
    /// Frames of this rate per frame of the score; an event that acts on a frame falls on the first of them.
    pub(crate) oversampling: u32,
    /// Whether more events may be added while it plays (a session).
    pub(crate) is_open: bool,
    /// The hardest strikes that an open timeline may get, all at instant 0: a plan tries them, and nothing plays them.
    pub(crate) trial_strikes: Vec<Strike>,
    /// Whether frames in which links stiffen too much are stepped like any other.
    pub(crate) is_unguarded: bool,
}

impl Timeline {
    /// MATs whose motion or parameters it determines: struck MATs of keys, MATs with an imposed position, and those
    /// that glide.
    pub(crate) fn determined_mats(&self) -> Vec<usize> {
        let is_position = |drive: &&Drive| drive.kind == DriveKind::Position;
        let driven_mats = self.drives.iter().filter(is_position).map(|drive| drive.mat);
        let key_mats = self.keys.iter().map(|key| key.struck_mat);
        let gliding = self.glides.iter().map(|glide| glide.mat);
        driven_mats.chain(key_mats).chain(gliding).collect()
    }

    /// An empty timeline at `rate`.
    pub fn new(rate: Rate) -> Self {
        Self {
            rate,
            keys: Vec::new(),
            gestures: Vec::new(),
            strikes: Vec::new(),
            ergons: Vec::new(),
            gates: Vec::new(),
            drives: Vec::new(),
            sounds_in: Vec::new(),
            glides: Vec::new(),
            leads: Vec::new(),
            oversampling: 1,
            is_open: false,
            trial_strikes: Vec::new(),
            is_unguarded: false,
        }
    }

    /// Declare that more events may be added while it plays (a session); a plan then omits nothing.
    pub fn open(&mut self) {
        self.is_open = true;
    }

    /// Step every frame once, even if links have stiffened so much that the scheme may diverge.
    pub fn leave_unguarded(&mut self) {
        self.is_unguarded = true;
    }

    /// The frame on which an event at `instant` [s] acts; its instant is the same at any oversampling.
    pub(crate) fn frame_of(&self, instant: f64) -> u64 {
        score_frame(instant, self.rate.hertz(), self.oversampling)
    }

    /// The timeline at `oversampling` times the rate; `None` if there is no such rate.
    pub(crate) fn with_higher_rate(&self, oversampling: u32) -> Option<Self> {
        let rate = Rate::new(self.rate.hertz() * f64::from(oversampling)).ok()?;
        let slow_gates = self.gates.iter();
        let slow_glides = self.glides.iter();
        let slow_leads = self.leads.iter();
        Some(Self {
            rate,
            oversampling: self.oversampling * oversampling,
            gates: slow_gates
                .map(|gate| gate.with_higher_rate(u64::from(oversampling)))
                .collect(),
            glides: slow_glides
                .map(|glide| glide.with_higher_rate(u64::from(oversampling)))
                .collect(),
            leads: slow_leads
                .map(|lead| lead.with_higher_rate(u64::from(oversampling)))
                .collect(),
            drives: self
                .drives
                .iter()
                .map(|drive| drive.with_higher_rate(oversampling))
                .collect(),
            ..self.clone()
        })
    }

    /// The timeline at the rate divided by `rate_divisor`; events fall on the nearest frame. `None` if there is no such
    /// rate, a gesture is too fast for it, or something is played live, because live values come by frames of the
    /// score.
    pub(crate) fn with_lower_rate(&self, rate_divisor: u32) -> Option<Self> {
        let rate = Rate::new(self.rate.hertz() / f64::from(rate_divisor)).ok()?;
        let is_live_drive = |drive: &Drive| drive.hand().is_some() || drive.port().is_some() || drive.is_sound_in();
        let fits_rate = |gesture: &Arc<Gesture>| gesture.check_rate(rate.hertz()).is_ok();
        if self.drives.iter().any(is_live_drive) || !self.gestures.iter().all(fits_rate) {
            return None;
        }
        let rate_divisor = u64::from(rate_divisor);
        Some(Self {
            rate,
            gates: self
                .gates
                .iter()
                .map(|gate| gate.with_lower_rate(rate_divisor))
                .collect(),
            glides: (self.glides.iter())
                .map(|glide| glide.with_lower_rate(rate_divisor))
                .collect(),
            leads: self
                .leads
                .iter()
                .map(|lead| lead.with_lower_rate(rate_divisor))
                .collect(),
            ..self.clone()
        })
    }

    /// Add a key; returns its index.
    pub fn add_key(&mut self, name: &str, struck_mat: usize) -> usize {
        self.keys.push(Key {
            name: name.to_owned(),
            struck_mat,
        });
        self.keys.len() - 1
    }

    /// Add a gesture on one of the keys; returns its index.
    ///
    /// # Errors
    /// [`GestureError`] if the key does not exist or the gesture is too fast for the rate.
    pub fn add_gesture(&mut self, gesture: Gesture) -> Result<usize, GestureError> {
        if gesture.key >= self.keys.len() {
            return Err(GestureError::NoKey(gesture.key));
        }
        gesture.check_rate(self.rate.hertz())?;
        self.gestures.push(Arc::new(gesture));
        Ok(self.gestures.len() - 1)
    }

    /// Lowest and highest position of each gesture's written points and paths [m], (n_gestures).
    pub fn ranges(&self) -> Vec<(f64, f64)> {
        self.gestures.iter().map(|gesture| gesture.range()).collect()
    }

    /// Instants [s] and impulses [N·s] of the strikes on a MAT, in order; the impulse of an ergon is its mass times its
    /// speed.
    pub fn strikes_on(&self, mat: usize) -> Vec<(f64, f64)> {
        self.impulses_on_mat(mat, |strike| vec![(strike.instant, strike.impulse)])
    }

    fn impulses_on_mat(&self, mat: usize, impulses_of: impl Fn(&Strike) -> Vec<(f64, f64)>) -> Vec<(f64, f64)> {
        let strikes = self.strikes.iter().filter(|strike| strike.mat as usize == mat);
        let ergons = self.ergons.iter().filter(|strike| strike.mat as usize == mat);
        let ergons = ergons.map(|ergon| (ergon.instant, ergon.mass * ergon.speed));
        let mut impulses: Vec<_> = strikes.flat_map(impulses_of).chain(ergons).collect();
        impulses.sort_by(|a, b| a.0.total_cmp(&b.0));
        impulses
    }

    /// Instants [s] and impulses [N·s] of which the strikes on a MAT consist, in order; the impulse of an ergon is its
    /// mass times its speed.
    pub fn impulses_on(&self, mat: usize) -> Vec<(f64, f64)> {
        self.impulses_on_mat(mat, |strike| self.impulses_of(strike).collect())
    }

    /// Strike a MAT by `impulse` [N·s] from the instant `time` [s] on; `source`: place in the score.
    ///
    /// The force rises from 0 and falls to 0 over `duration` [s], as Blackman's window, whatever the rate; a strike
    /// of less than 57 µs acts at one instant. Without `duration` it is 0.19 ms, under `ca` one instant.
    ///
    /// ```
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let m = network.mas("m", 1e-3, 0.0, 0.0)?;
    /// let wall = network.sol("wall", 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// timeline.strike(&network, m, 0.5, 1e-3, None, 0)?; // 1 mN·s at 0.5 s
    /// assert!(timeline.strike(&network, wall, 0.5, 1e-3, None, 0).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`StrikeError`] if the MAT is fixed, the instant is negative, a number is not finite, it lasts longer than
    /// 50 ms, or there are too many strikes.
    pub fn strike(
        &mut self,
        network: &Network,
        mat: usize,
        time: f64,
        impulse: f64,
        duration: Option<f64>,
        source: u32,
    ) -> Result<(), StrikeError> {
        let n_parts = self.parts_of_duration(network, mat, duration)?;
        check_finite("impulse", impulse)?;
        check_instant(time)?;
        check_movable(network, mat)?;
        if self.strikes.len() >= STRIKES_MAX as usize {
            return Err(StrikeError::TooMany);
        }
        if impulse != 0.0 {
            self.strikes.push(Strike {
                instant: time,
                mat: mat as u32,
                source,
                n_parts,
                impulse,
            });
        }
        Ok(())
    }

    /// Declare the hardest strike that a MAT may get while the timeline is open. It is never played: the plan chooses
    /// by a trial of it how finely contacts are computed. `duration`: as in [`Timeline::strike`].
    ///
    /// # Errors
    /// As [`Timeline::strike`].
    pub fn add_trial_strike(
        &mut self,
        network: &Network,
        mat: usize,
        impulse: f64,
        duration: Option<f64>,
    ) -> Result<(), StrikeError> {
        let n_strikes = self.strikes.len();
        self.strike(network, mat, 0.0, impulse, duration, 0)?;
        self.trial_strikes.extend(self.strikes.drain(n_strikes..));
        Ok(())
    }

    /// A closed timeline of the trial strikes alone; `None` if there is none, or something else may move the network:
    /// a hand, a key, an input.
    pub(crate) fn closed_for_trial(&self) -> Option<Self> {
        let is_struck_only = |drive: &Drive| matches!(drive.source, DriveSource::Strikes { .. });
        let is_tried = !self.trial_strikes.is_empty() && self.keys.is_empty() && self.drives.iter().all(is_struck_only);
        is_tried.then(|| Self {
            strikes: self.trial_strikes.clone(),
            oversampling: self.oversampling,
            is_unguarded: self.is_unguarded,
            ..Self::new(self.rate)
        })
    }

    /// How long a strike of `duration` [s] on a MAT lasts, in 1/44,100 s.
    fn parts_of_duration(&self, network: &Network, mat: usize, duration: Option<f64>) -> Result<u32, StrikeError> {
        let part_index = network.mats().part[mat] as usize;
        let is_discrete = network.parts()[part_index].ca_rate.is_some();
        let duration = duration.unwrap_or(if is_discrete {
            0.0
        } else {
            pulse::DEFAULT_STRIKE_SECONDS
        });
        if (0.0..=pulse::STRIKE_SECONDS_MAX).contains(&duration) {
            Ok(pulse::n_parts(duration))
        } else {
            Err(StrikeError::Lasts(duration))
        }
    }

    /// Strike each MAT by a Poisson process of its own, of `rate` [Hz] from `start` to `stop` [s], with impulses [N·s]
    /// drawn uniformly between two limits; member i draws from `chance(i)` alone. Returns the number of strikes.
    ///
    /// ```
    /// use ergon_engine::chance::Chance;
    /// use ergon_engine::timeline::Rain;
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let m = network.mas("m", 1e-3, 0.0, 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// let rain = Rain {
    ///     rate: 20.0,
    ///     start: 0.0,
    ///     stop: 5.0,
    ///     impulse: (1e-4, 1e-3),
    ///     duration: None,
    ///     window: (0.0, 5.0),
    ///     source: 0,
    /// };
    /// let chance = |member| Chance::new(7, "strikes", "sky", member, 0);
    /// let n_strikes = timeline.rain(&network, &[m], &rain, chance)?;
    /// assert!((50..150).contains(&n_strikes));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`Timeline::strike`].
    pub fn rain(
        &mut self,
        network: &Network,
        mats: &[usize],
        rain: &Rain,
        chance: impl Fn(u64) -> Chance,
    ) -> Result<u64, StrikeError> {
        let expected = mats.len() as f64 * rain.rate * (rain.stop - rain.start);
        check_finite("rate", rain.rate)?;
        // NaN is refused here too.
        if expected.is_nan() || expected > STRIKES_MAX as f64 {
            return Err(StrikeError::TooMany);
        }
        let mut n_strikes = 0;
        // Strikes are drawn in order of time, so those after the window need not be drawn.
        let stop_time = rain.stop.min(rain.window.1);
        if rain.start >= stop_time || rain.window.0 >= stop_time {
            return Ok(0);
        }
        for (member, &mat) in mats.iter().enumerate() {
            if member % 64 == 0 {
                interrupt::poll();
            }
            let mut chance = chance(member as u64);
            let mut strike_times = chance.poisson_times(rain.rate, rain.start, stop_time);
            while let Some(instant) = strike_times.next() {
                let impulse = strike_times.chance().uniform(rain.impulse.0, rain.impulse.1);
                if (rain.window.0..rain.window.1).contains(&instant) {
                    self.strike(network, mat, instant, impulse, rain.duration, rain.source)?;
                    n_strikes += 1;
                }
            }
        }
        Ok(n_strikes)
    }

    /// Let an ergon of a mass [kg] and a speed [m/s] strike a MAT at the instant `time` [s].
    ///
    /// # Errors
    /// As [`Timeline::strike`], and if the mass is not above 0.
    pub fn add_ergon(
        &mut self,
        network: &Network,
        mat: usize,
        time: f64,
        mass: f64,
        speed: f64,
        source: u32,
    ) -> Result<(), StrikeError> {
        check_instant(time)?;
        check_movable(network, mat)?;
        check_finite("speed", speed)?;
        if !(mass > 0.0 && mass.is_finite()) {
            return Err(StrikeError::Value("mass", " above 0", mass));
        }
        self.ergons.push(Ergon {
            instant: time,
            mat: mat as u32,
            source,
            mass,
            speed,
        });
        Ok(())
    }

    /// Let a MAT be struck while it plays, by impulses that last as in [`Timeline::strike`]; `point` identifies it in
    /// [`Simulation::strike`](crate::simulation::Simulation::strike).
    ///
    /// # Errors
    /// [`StrikeError`] if the MAT is fixed, or for a length as in [`Timeline::strike`].
    pub fn add_strike_point(
        &mut self,
        network: &Network,
        mat: usize,
        point: u32,
        duration: Option<f64>,
    ) -> Result<(), StrikeError> {
        check_movable(network, mat)?;
        let n_parts = self.parts_of_duration(network, mat, duration)?;
        let strike_source = DriveSource::Strikes { point, n_parts };
        self.drive(mat, DriveKind::Force, strike_source, false)
    }

    /// The points that may be struck while it plays, each with its MAT.
    pub fn strike_points(&self) -> impl Iterator<Item = (u32, usize)> {
        self.drives.iter().filter_map(|drive| match drive.source {
            DriveSource::Strikes { point, .. } => Some((point, drive.mat)),
            _ => None,
        })
    }

    /// Impose the position or a force on a MAT by a constant, a take or a hand; `acts_on_free_key`: whether it also
    /// acts on the free copy of a key.
    ///
    /// # Errors
    /// [`StrikeError`] if a constant is not finite, or the position of the MAT is imposed already.
    pub fn drive(
        &mut self,
        mat: usize,
        kind: DriveKind,
        source: DriveSource,
        acts_on_free_key: bool,
    ) -> Result<(), StrikeError> {
        if let DriveSource::Constant(constant) = source {
            check_finite("constant", constant)?;
        }
        let sets_position = |drive: &Drive| drive.mat == mat && drive.kind == DriveKind::Position;
        if kind == DriveKind::Position && self.drives.iter().any(sets_position) {
            return Err(StrikeError::Driven(mat));
        }
        self.drives.push(Drive {
            mat,
            kind,
            source,
            acts_on_free_key,
        });
        Ok(())
    }
}

fn check_movable(network: &Network, mat: usize) -> Result<(), StrikeError> {
    if network.mats().kind[mat].moves() {
        Ok(())
    } else {
        Err(StrikeError::Fixed(network.mat_name(mat)))
    }
}

fn check_finite(quantity: &'static str, value: f64) -> Result<(), StrikeError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(StrikeError::Value(quantity, "", value))
    }
}

fn check_instant(time: f64) -> Result<(), StrikeError> {
    if time >= 0.0 && time.is_finite() {
        Ok(())
    } else {
        Err(StrikeError::Before(time))
    }
}

#[cfg(test)]
mod tests;
