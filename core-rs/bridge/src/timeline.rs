//! Timelines: the events of a piece.

use std::sync::Arc;

use ergon_engine::chance::Chance;
use ergon_engine::gesture::script::{Gesture, Manner};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network;
use ergon_engine::timeline::{self, DriveSource, InputSource, Rain, SoundInSettings};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::error::{from_engine, from_gesture, hertz, module_error, parse_choice};
use crate::named::{Impulse, Range};
use crate::network::Network;
use crate::take::Take;
use crate::words;
use crate::work::{self, computing};

/// All events of a piece, by sample index.
#[pyclass(module = "ergon._core")]
pub(crate) struct Timeline {
    pub(crate) inner: timeline::Timeline,
    network: Arc<network::Network>,
}

#[pymethods]
impl Timeline {
    #[new]
    fn new(network: &Network, rate: f64) -> PyResult<Self> {
        let rate = hertz(rate)?;
        Ok(Self {
            inner: timeline::Timeline::new(rate),
            network: Arc::new(network.0.clone()),
        })
    }

    /// Step every frame of CA once, also where links have stiffened beyond stability.
    fn leave_unguarded(&mut self) {
        self.inner.leave_unguarded();
    }

    /// Mark the timeline as incomplete (a session): no plan may rely on what is absent.
    fn open(&mut self) {
        self.inner.open();
    }

    /// Declare the part `name`, whose MAT `struck` gestures move, as a key; its index.
    fn key(&mut self, name: &str, struck: usize) -> PyResult<usize> {
        self.check_mat(name, struck)?;
        Ok(self.inner.add_key(name, struck))
    }

    /// A written gesture, which passes x[i] [m] at t[i] [s] of the piece; its index.
    #[pyo3(signature = (key, t, x, curve, *, touch="open", ergons="event", grain=None, join=0.02, force_limit=None, layer=false, sources=Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn gesture(
        &mut self,
        key: usize,
        t: Vec<f64>,
        x: Vec<f64>,
        curve: Vec<String>,
        touch: &str,
        ergons: &str,
        grain: Option<f64>,
        join: f64,
        force_limit: Option<f64>,
        layer: bool,
        sources: Vec<u32>,
    ) -> PyResult<usize> {
        work::poll(0)?; // a timeline may have many gestures
        let manner = manner(touch, ergons, grain, join, force_limit, layer)?;
        let approaches = curve
            .iter()
            .map(|curve| parse_choice("curve", curve, words::APPROACHES))
            .collect::<PyResult<Vec<Approach>>>()?;
        let written_points = WrittenPoints {
            t: &t,
            x: &x,
            approaches: &approaches,
            sources: &sources,
        };
        Gesture::from_points(key, &written_points, manner)
            .and_then(|gesture| self.inner.add_gesture(gesture))
            .map_err(|error| from_gesture("gesture", &error))
    }

    /// Lowest and highest position [m] of each gesture's written points and paths, by index.
    fn ranges(&self) -> Vec<Range> {
        let gesture_ranges = self.inner.ranges().into_iter();
        gesture_ranges.map(|(low, high)| Range { low, high }).collect()
    }

    /// The strikes on a MAT in order of their instants; an ergon brings mass times speed.
    fn strikes_on(&self, mat: usize) -> Vec<Impulse> {
        let strikes = self.inner.strikes_on(mat).into_iter();
        strikes.map(|(at, impulse)| Impulse { at, impulse }).collect()
    }

    /// The impulses, each at one instant, of which the strikes on a MAT consist; an ergon brings mass times speed.
    fn impulses_on(&self, mat: usize) -> Vec<Impulse> {
        let impulses = self.inner.impulses_on(mat).into_iter();
        impulses.map(|(at, impulse)| Impulse { at, impulse }).collect()
    }

    /// A gesture that plays a take from `start` to `until` [s]: x·scale at t·stretch; its index.
    #[pyo3(signature = (key, take, start, *, scale=1.0, stretch=1.0, reverse=false, until=None, touch="open", ergons="event", grain=None, join=0.02, force_limit=None, layer=false, source=0))]
    #[allow(clippy::too_many_arguments)]
    fn take(
        &mut self,
        key: usize,
        take: &Take,
        start: f64,
        scale: f64,
        stretch: f64,
        reverse: bool,
        until: Option<f64>,
        touch: &str,
        ergons: &str,
        grain: Option<f64>,
        join: f64,
        force_limit: Option<f64>,
        layer: bool,
        source: u32,
    ) -> PyResult<usize> {
        work::poll(0)?;
        let manner = manner(touch, ergons, grain, join, force_limit, layer)?;
        let placed_take = take
            .0
            .placed(start, scale, stretch, reverse)
            .map_err(|error| module_error("take", error))?;
        Gesture::from_take(key, placed_take, until, source, manner)
            .and_then(|gesture| self.inner.add_gesture(gesture))
            .map_err(|error| from_gesture("take", &error))
    }

    /// A strike on a MAT at `start` [s]: an impulse [N·s] that lasts `lasts` [s] (None: as long as the engine says), or
    /// a mass [kg] that arrives at a speed [m/s].
    #[pyo3(signature = (mat, start, *, impulse=None, mass=None, speed=None, lasts=Some(0.0), source=0))]
    #[allow(clippy::too_many_arguments)]
    fn strike(
        &mut self,
        mat: usize,
        start: f64,
        impulse: Option<f64>,
        mass: Option<f64>,
        speed: Option<f64>,
        lasts: Option<f64>,
        source: u32,
    ) -> PyResult<()> {
        work::poll(0)?;
        self.check_mat("strike", mat)?;
        match (impulse, mass, speed) {
            (Some(impulse), None, None) => self.inner.strike(&self.network, mat, start, impulse, lasts, source),
            (None, Some(mass), Some(speed)) => self.inner.add_ergon(&self.network, mat, start, mass, speed, source),
            _ => {
                return Err(module_error(
                    "strike",
                    "a strike takes either an impulse or a mass and a speed",
                ));
            }
        }
        .map_err(|error| module_error("strike", error))
    }

    /// Strikes on each MAT by a Poisson process of its own; their number.
    #[pyo3(signature = (mats, *, start, stop, rate, impulse, seed, name, lasts=Some(0.0), source=0, within=(f64::NEG_INFINITY, f64::INFINITY)))]
    #[allow(clippy::too_many_arguments)]
    fn rain(
        &mut self,
        py: Python<'_>,
        mats: Vec<usize>,
        start: f64,
        stop: f64,
        rate: f64,
        impulse: (f64, f64),
        seed: i128,
        name: &str,
        lasts: Option<f64>,
        source: u32,
        within: (f64, f64),
    ) -> PyResult<u64> {
        mats.iter().try_for_each(|&mat| self.check_mat(name, mat))?;
        computing(py, || {
            let member_chance = |member| Chance::new(seed, "strikes", name, member, 0);
            let rain_strikes = Rain {
                rate,
                start,
                stop,
                impulse,
                duration: lasts,
                window: within,
                source,
            };
            self.inner.rain(&self.network, &mats, &rain_strikes, member_chance)
        })?
        .map_err(|error| module_error(name, error))
    }

    /// Let the LIA act only from `start` to `stop` [s], with fades of `fade` [s].
    #[pyo3(signature = (link, start, stop=None, fade=0.02))]
    fn couple(&mut self, link: usize, start: f64, stop: Option<f64>, fade: f64) -> PyResult<()> {
        self.inner
            .couple_over(&self.network, link, start, stop, fade)
            .map_err(from_engine)
    }

    /// Scale the force of `n` LIAs from `link` on, whole runs: by `before` until `start` [s], by `after` from `stop`
    /// [s] on, linearly between.
    #[pyo3(signature = (link, before, after, start, stop, *, n=1))]
    fn fade(&mut self, link: usize, before: f64, after: f64, start: f64, stop: f64, n: usize) -> PyResult<()> {
        self.inner
            .glide_force(&self.network, (link, n), (before, after), (start, stop))
            .map_err(from_engine)
    }

    /// Give a MAT K, Z and M until `start` [s], and the network's own from `stop` [s] on, linearly between.
    #[pyo3(name = "glide", signature = (mat, k, z, m, start, stop))]
    fn glide(&mut self, mat: usize, k: f64, z: f64, m: f64, start: f64, stop: f64) -> PyResult<()> {
        self.check_mat("glide", mat)?;
        self.inner
            .glide(&self.network, mat, [k, z, m], (start, stop))
            .map_err(from_engine)
    }

    /// Let K, Z and M of a MAT go through points (t [s], K, Z, M).
    fn path(&mut self, mat: usize, points: Vec<(f64, f64, f64, f64)>) -> PyResult<()> {
        self.check_mat("path", mat)?;
        let points: Vec<_> = points.into_iter().map(|(t, k, z, m)| (t, [k, z, m])).collect();
        self.inner
            .glide_through(&self.network, mat, &points)
            .map_err(from_engine)
    }

    /// Let `n` CELs from `mat` on go through points (t [s], square of the factor of their frequencies, factor of their
    /// decay rates).
    #[pyo3(signature = (mat, points, *, n=1))]
    fn retune(&mut self, mat: usize, points: Vec<(f64, f64, f64)>, n: usize) -> PyResult<()> {
        self.check_mat("retune", mat.saturating_add(n).saturating_sub(1))?;
        let points: Vec<_> = points.into_iter().map(|(t, f, s)| (t, [f, s])).collect();
        self.inner.retune(&self.network, (mat, n), &points).map_err(from_engine)
    }

    /// Let K and Z of `n` LIAs from `link` on, whole runs, go through points (t [s], factor of K, factor of Z).
    #[pyo3(signature = (link, points, *, n=1))]
    fn lead(&mut self, link: usize, points: Vec<(f64, f64, f64)>, n: usize) -> PyResult<()> {
        let points: Vec<_> = points.into_iter().map(|(t, k, z)| (t, [k, z])).collect();
        self.inner.lead(&self.network, (link, n), &points).map_err(from_engine)
    }

    /// Declare an input of a sound card; `samples` (n_frames,) are heard from frame 0 on if no live sound is given.
    /// Returns its index.
    #[pyo3(signature = (channel, samples, *, gain, clamp, highpass=None))]
    fn sound_in(
        &mut self,
        py: Python<'_>,
        channel: usize,
        samples: PyReadonlyArray1<'_, f64>,
        gain: f64,
        clamp: f64,
        highpass: Option<f64>,
    ) -> PyResult<usize> {
        let settings = SoundInSettings {
            source: InputSource::Channel(channel),
            gain,
            highpass,
            clamp,
        };
        self.add_input(py, settings, samples)
    }

    /// Declare an input that `Simulation.tell` tells values by its `number`; each is reached within `glide` [s].
    /// `samples` (n_frames,) are heard until the first value. Returns its index.
    #[pyo3(signature = (number, samples, *, gain, clamp, glide))]
    fn controlled_input(
        &mut self,
        py: Python<'_>,
        number: u64,
        samples: PyReadonlyArray1<'_, f64>,
        gain: f64,
        clamp: f64,
        glide: f64,
    ) -> PyResult<usize> {
        let settings = SoundInSettings {
            source: InputSource::Value { number, glide },
            gain,
            highpass: None,
            clamp,
        };
        self.add_input(py, settings, samples)
    }

    /// Impose a MAT's position (ENX) or a force on it (ENF): a constant, a take from `start` [s], or an input.
    #[pyo3(signature = (mat, kind, *, constant=None, take=None, sound=None, start=0.0, scale=1.0, acts_on_free_key=true))]
    #[allow(clippy::too_many_arguments)]
    fn drive(
        &mut self,
        mat: usize,
        kind: &str,
        constant: Option<f64>,
        take: Option<&Take>,
        sound: Option<usize>,
        start: f64,
        scale: f64,
        acts_on_free_key: bool,
    ) -> PyResult<()> {
        self.check_mat("drive", mat)?;
        let kind = parse_choice("kind", kind, words::DRIVE_KINDS)?;
        let drive_source = match (constant, take, sound) {
            (None, None, Some(sound)) => {
                let drive_outcome = self.inner.drive_by_sound(mat, kind, sound, scale);
                return drive_outcome.map_err(|error| module_error("drive", error));
            }
            (Some(constant), None, None) => DriveSource::Constant(constant),
            (None, Some(take), None) => {
                let placed_take = take.0.placed(start, scale, 1.0, false);
                DriveSource::Take(placed_take.map_err(|error| module_error("drive", error))?)
            }
            _ => {
                return Err(module_error(
                    "drive",
                    "a drive takes one of a constant, a take and an input",
                ));
            }
        };
        self.inner
            .drive(mat, kind, drive_source, acts_on_free_key)
            .map_err(|error| module_error("drive", error))
    }

    /// Let a fixed point go where a key goes, and pass the forces on it to the key `delay` seconds later.
    fn delay_forces(&mut self, port: usize, key: usize, delay: f64) -> PyResult<()> {
        self.check_mat("delay_forces", port)?;
        self.check_mat("delay_forces", key)?;
        self.inner
            .delay_forces(port, key, delay)
            .map_err(|error| module_error("delay_forces", error))
    }

    /// Let `Simulation.strike` strike a MAT, which it calls by the number `point`; each strike lasts as in `strike`.
    #[pyo3(signature = (mat, point, *, lasts=Some(0.0)))]
    fn strike_point(&mut self, mat: usize, point: u32, lasts: Option<f64>) -> PyResult<()> {
        self.check_mat("strike_point", mat)?;
        self.inner
            .add_strike_point(&self.network, mat, point, lasts)
            .map_err(|error| module_error("strike_point", error))
    }

    /// Declare the hardest strike [N·s] that a MAT may get while the timeline is open; only trials of plans play it.
    #[pyo3(signature = (mat, impulse, *, lasts=Some(0.0)))]
    fn trial_strike(&mut self, mat: usize, impulse: f64, lasts: Option<f64>) -> PyResult<()> {
        self.check_mat("strike", mat)?;
        self.inner
            .add_trial_strike(&self.network, mat, impulse, lasts)
            .map_err(|error| module_error("strike", error))
    }

    /// The timeline without what begins at `frame` or later; it keeps the gestures of these indices.
    #[pyo3(signature = (frame, gestures, *, stops))]
    fn cut(&self, frame: u64, gestures: Vec<usize>, stops: bool) -> Self {
        Self {
            inner: self.inner.cut(frame, &gestures, stops),
            network: self.network.clone(),
        }
    }

    /// Let nothing move the parameters of MATs and LIAs any more; rows of (first, number).
    fn release(&mut self, mats: Vec<(usize, usize)>, links: Vec<(usize, usize)>) {
        self.inner.remove_glides(&mats, &links);
    }

    /// A real hand that moves a MAT, in ticks of `tick_frames` frames; `positions` (n_ticks,) [m]: a stand-in or a
    /// recording of the hand. Returns its index.
    #[pyo3(signature = (mat, tick_frames, *, interpolation="line", positions=None))]
    fn hand(
        &mut self,
        mat: usize,
        tick_frames: u32,
        interpolation: &str,
        positions: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<usize> {
        self.check_mat("hand", mat)?;
        let interpolation = parse_choice("interpolation", interpolation, words::HAND_INTERPOLATIONS)?;
        let positions = positions.as_ref().map(|x| x.as_slice()).transpose()?;
        self.inner
            .add_hand(
                &self.network,
                mat,
                tick_frames,
                interpolation,
                positions.unwrap_or_default(),
            )
            .map_err(|error| module_error("hand", error))
    }
}

impl Timeline {
    /// EngineError if MATs or LIAs were added to the network after the timeline was made.
    pub(crate) fn check_network(&self, network: &Network) -> PyResult<()> {
        let is_unchanged = network.0.n_mat() == self.network.n_mat() && network.0.n_lia() == self.network.n_lia();
        if is_unchanged {
            return Ok(());
        }
        Err(module_error(
            "timeline",
            "the network was changed after the timeline was made",
        ))
    }

    fn check_mat(&self, name: &str, mat: usize) -> PyResult<()> {
        if mat < self.network.n_mat() {
            return Ok(());
        }
        Err(module_error(
            name,
            format!("MAT #{mat} does not exist: the network has {}", self.network.n_mat()),
        ))
    }

    fn add_input(
        &mut self,
        py: Python<'_>,
        settings: SoundInSettings,
        samples: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<usize> {
        let samples = samples.as_slice()?;
        computing(py, || self.inner.add_sound_input(settings, samples))?
            .map_err(|error| module_error("sound_in", error))
    }
}

fn manner(
    touch: &str,
    ergons: &str,
    grain: Option<f64>,
    join: f64,
    limit: Option<f64>,
    is_layer: bool,
) -> PyResult<Manner> {
    let touch = parse_choice("touch", touch, words::GESTURE_TOUCHES)?;
    let ergon_kind = parse_choice("ergons", ergons, words::ERGON_KINDS)?;
    Ok(Manner {
        touch,
        ergon_kind,
        grain,
        join_seconds: join,
        force_max: limit,
        is_layer,
    })
}
