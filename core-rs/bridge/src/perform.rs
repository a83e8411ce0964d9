//! Performances: a piece that the physics thread plays.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ergon_engine::mix::limiter::Limiter;
use ergon_engine::mix::silence_detector::SilenceDetector;
use ergon_engine::simulation::Takeover;
use ergon_live::audio::{self, AudioError};
use ergon_live::device::{DeviceUrl, WaitCanceller};
use ergon_live::perform::{
    self, DeviceConfig, Guidance, GuidanceShare, GuidanceStep, InputConfig, Keyboard, LiveHand, MeasuredKey,
    PlaybackConfig, PreparedPiece, ScaleBound, Stem,
};
use ergon_live::recording::{Header, RecordedAxis};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::device::{self, AxisTuple};
use crate::error::{hand_error, module_error, plain_error, unwritten};
use crate::fold::Fold;
use crate::guardian;
use crate::mixer::Mixer;
use crate::named::{PerformanceEvent, SilenceEdge, SoundEvent, SoundInput};
use crate::simulation::{Simulation, damping, finite_input, strike_impulse};
use crate::status::{HandLimit, Status, named_event};

/// Time between two checks for Ctrl-C during a wait.
const CHECK_INTERVAL: Duration = Duration::from_millis(2);
/// Longest wait [s], longer than any piece.
const SECONDS_MAX: f64 = 1e6;

/// The fields of a `LiveHand`.
type HandTuple<'py> = (
    PyReadonlyArray1<'py, f64>,
    f64,
    Option<(f64, f64, bool)>,
    PyReadonlyArray1<'py, f64>,
    Option<(f64, f64, Option<f64>)>,
    PyReadonlyArray1<'py, f64>,
);
/// (ticks after the change, factor of the stiffness, factor of the viscosity)
type StepTuple = (u64, f64, f64);
/// (ticks after the change, greatest factor of the piece's force)
type BoundTuple = (u64, f64);
/// The fields of a `LiveBoard`.
type BoardTuple = (String, Vec<(usize, usize)>, Option<f64>, Vec<AxisTuple>);
/// The fields of a `RecordTarget`.
pub(crate) type RecordTuple = (PathBuf, Vec<(String, String)>, String);

/// The fields of a `FrozenStem`.
type StemTuple = (PathBuf, u64, u64, Vec<usize>);

/// A piece that is being played.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Performance {
    performance: Mutex<Option<perform::Performance>>,
    /// Outside the lock, so that a stop never waits for it.
    control: perform::Control,
}

#[pymethods]
impl Performance {
    #[new]
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (simulation, mixer, *, tick_frames=64, audio="auto", gain=1.0, limit=1.0, n_frames=None, fades_from=None, hands=Vec::new(), boards=Vec::new(), bars=Vec::new(), ahead=None, record=None, frozen=Vec::new(), fold=None, seen=false, audio_in="auto", record_in=None))]
    fn new(
        py: Python<'_>,
        simulation: &Simulation,
        mixer: &Mixer,
        tick_frames: usize,
        audio: &str,
        gain: f64,
        limit: f64,
        n_frames: Option<u64>,
        fades_from: Option<u64>,
        hands: Vec<HandTuple<'_>>,
        boards: Vec<BoardTuple>,
        bars: Vec<u64>,
        ahead: Option<usize>,
        record: Option<RecordTuple>,
        frozen: Vec<StemTuple>,
        fold: Option<&Fold>,
        seen: bool,
        audio_in: &str,
        record_in: Option<PathBuf>,
    ) -> PyResult<Self> {
        let rate = simulation.0.rate();
        let hand = |(standin, reach, guidance, response, measured, forces): &HandTuple<'_>| {
            Ok(LiveHand {
                standin_positions: standin.as_slice()?.to_vec(),
                forces: forces.as_slice()?.to_vec(),
                travel_ratio: *reach,
                guidance: guidance.map(|(k, z, follows_steps)| Guidance { k, z, follows_steps }),
                piece_response: response.as_slice()?.to_vec(),
                measured_key: measured.map(|(mass, damping, delay)| MeasuredKey { mass, damping, delay }),
                ..LiveHand::default()
            })
        };
        let n_channels = mixer.0.n_channels();
        if let Some(fold) = fold
            && fold.0.n_in() != n_channels
        {
            let fold_inputs = fold.0.n_in();
            return Err(plain_error(format!(
                "the fold takes {fold_inputs} channels, and the mixer gives {n_channels}"
            )));
        }
        let output_channels = fold.map_or(n_channels, |fold| fold.0.n_out());
        let prepared_piece = PreparedPiece {
            simulation: simulation.0.fork(),
            mixer: mixer.0.clone(),
            gain,
            fold: fold.map(|fold| fold.0.clone()),
            limiter: Limiter::new(rate, output_channels, limit).map_err(plain_error)?,
            n_frames,
            silence_detector: fades_from.map(|from| SilenceDetector::new(rate, n_channels, from)),
            tick_frames: tick_frames.max(1),
            hands: hands.iter().map(hand).collect::<PyResult<_>>()?,
            bars,
            frozen_stems: checked_stems(frozen, simulation.0.n_out())?,
            is_displayed: seen,
        };
        let playback_config = PlaybackConfig {
            audio: audio.parse().map_err(plain_error)?,
            input: InputConfig {
                source: match audio_in {
                    "none" => None,
                    input_spec => Some(input_spec.parse().map_err(plain_error)?),
                },
                record_path: record_in,
            },
            frames_ahead: ahead,
            recording: record.map(|(path, axes, about)| {
                let recorded_axis = |(player, key)| RecordedAxis { player, key };
                let take_header = Header {
                    rate,
                    frames: tick_frames as u32,
                    axes: axes.into_iter().map(recorded_axis).collect(),
                    about,
                };
                (path, take_header)
            }),
        };
        guardian::register_guardian(py);
        py.detach(|| {
            let tick_period = tick_frames as f64 / rate;
            let boards = boards
                .into_iter()
                .map(|board| open_keyboard(board, tick_period))
                .collect::<PyResult<_>>()?;
            perform::Performance::start(prepared_piece, boards, playback_config).map_err(|error| match error {
                perform::PlayError::Recording(_) | perform::PlayError::Audio(AudioError::File { .. }) => {
                    unwritten(error)
                }
                perform::PlayError::Stiff { hand, .. } => hand_error(error, hand),
                error => plain_error(error),
            })
        })
        .map(|performance| Self {
            control: performance.control(),
            performance: Mutex::new(Some(performance)),
        })
    }

    /// The state now.
    fn status(&self) -> PyResult<Status> {
        self.with(Status::new)
    }

    /// Events since the last call.
    fn events(&self) -> PyResult<Vec<PerformanceEvent>> {
        self.with(|performance| std::iter::from_fn(|| performance.event()).map(named_event).collect())
    }

    /// Events of the sound output and input so far.
    fn sound_events(&self) -> PyResult<Vec<SoundEvent>> {
        let sound_event = |event: &audio::AudioEvent| SoundEvent {
            time: event.time,
            sentence: event.sentence.clone(),
        };
        self.with(|performance| performance.sound_events().iter().map(sound_event).collect())
    }

    /// Edges of the silence of panics, from number `since` on.
    fn silences(&self, since: u64) -> PyResult<Vec<SilenceEdge>> {
        let silence_edge = |edge: audio::SilenceEdge| SilenceEdge {
            frame: edge.frame,
            begins: edge.is_start,
        };
        self.with(|performance| {
            let silence_edges = performance.output().stream_state().edges(since);
            silence_edges.into_iter().map(silence_edge).collect()
        })
    }

    /// The force limit of each real hand in the piece that the performance began with.
    fn hand_limits(&self) -> PyResult<Vec<HandLimit>> {
        self.with(|performance| performance.hand_limits().iter().map(HandLimit::new).collect())
    }

    /// The force limit of a real hand in another piece with this response [N/m], (n_ticks,); None if the hand is not
    /// real.
    fn hand_limit(
        &self,
        py: Python<'_>,
        hand: usize,
        response: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Option<HandLimit>> {
        let response = response.as_slice()?;
        let hand_key = self.with(|performance| performance.hand_key(hand))?;
        Ok(hand_key.map(|hand_key| py.detach(|| HandLimit::new(&hand_key.limit(response)))))
    }

    /// The sound output, as a sentence.
    fn output(&self) -> PyResult<String> {
        self.with(|performance| performance.output().info().description)
    }

    /// The sound input, and what is missing of it.
    fn sound_input(&self) -> PyResult<SoundInput> {
        self.with(|performance| {
            let input_state = performance.input();
            let shared_state = input_state.input.as_ref().map(audio::Input::stream_state);
            let shared_count =
                |counter: fn(&audio::StreamState) -> u64| shared_state.map_or(0, |shared_state| counter(shared_state));
            let tap_status = input_state.recording.as_ref().map(audio::TapHandle::status);
            SoundInput {
                sentence: input_state.description.clone(),
                live: shared_state.is_some(),
                gaps: shared_count(audio::StreamState::underruns),
                missing: shared_count(audio::StreamState::missing_frames),
                discarded: shared_count(audio::StreamState::discarded_frames),
                recorded: tap_status.as_ref().map(|tap_status| tap_status.frames),
                lost: tap_status.as_ref().map_or(0, |tap_status| tap_status.missing_frames),
                error: tap_status.and_then(|tap_status| tap_status.error),
            }
        })
    }

    /// Priority and memory lock of the physics thread, in words; None until it runs.
    fn granted(&self) -> PyResult<Option<String>> {
        self.with(|performance| performance.granted_scheduling().map(|granted| granted.to_string()))
    }

    /// Silence within 5 ms and zero force at the next tick, until `release`.
    fn panic(&self) {
        self.control.panic();
    }

    /// Let sound and force return after `panic`, after `let_go` and after a trip.
    fn release(&self) {
        self.control.release();
    }

    /// Let the gain glide to `gain` in 20 ms, from the next tick on; False if too many commands wait.
    fn gain(&self, gain: f64) -> PyResult<bool> {
        self.with(|performance| performance.gain(gain))
    }

    /// Write what is computed for the loudspeakers to a new WAV file, from the next tick on.
    fn record_audio(&self, path: PathBuf) -> PyResult<()> {
        self.with(|performance| performance.record_audio(&path))?
            .map_err(|error| module_error("audio", error))
    }

    /// End the file of `record_audio`; False if too many commands wait.
    fn end_audio(&self) -> PyResult<bool> {
        self.with(|performance| performance.end_audio())
    }

    /// The state of the file of `record_audio`; None if there was none.
    fn audio_recorded(&self) -> PyResult<Option<AudioRecorded>> {
        let tap_status = self.with(|performance| performance.audio_recorded())?;
        Ok(tap_status.map(|tap_status| AudioRecorded {
            first: tap_status.first_frame,
            frames: tap_status.frames,
            missing: tap_status.missing_frames,
            ended: tap_status.has_ended,
            error: tap_status.error,
        }))
    }

    /// Strike a point of the simulation that plays by an impulse [N·s], at the next tick.
    ///
    /// Returns a ticket, or None if too many commands wait. An event "acted" or "missed" with the ticket tells the
    /// outcome.
    fn strike(&self, point: u32, impulse: f64) -> PyResult<Option<u64>> {
        let impulse = strike_impulse(impulse)?;
        self.with(|performance| performance.strike(point, impulse))
    }

    /// Let an input of `Timeline.controlled_input` go to a value, at the next tick; returns a ticket, as `strike`.
    fn tell(&self, number: u64, value: f64) -> PyResult<Option<u64>> {
        let value = finite_input(value)?;
        self.with(|performance| performance.set_input(number, value))
    }

    /// Let the gain of a group of the mixer's routes glide in 20 ms; False if too many commands wait.
    fn part_gain(&self, group: usize, gain: f64) -> PyResult<bool> {
        self.with(|performance| performance.part_gain(group, gain))
    }

    /// Make a change at frame `frame`, the first of a tick; returns the ticket of the event "changed" or "late".
    ///
    /// `simulation` begins there and takes over from `old`, which plays until then; without `old` it begins anew.
    #[pyo3(signature = (frame, *, simulation=None, old=None, mixer=None, gains=Vec::new(), gain=None, bars=None, standins=None, forces=Vec::new(), guidance=None, bounds=None, damp=None))]
    #[allow(clippy::too_many_arguments)]
    fn change(
        &self,
        py: Python<'_>,
        frame: u64,
        simulation: Option<&Simulation>,
        old: Option<&Simulation>,
        mixer: Option<&Mixer>,
        gains: Vec<(usize, f64)>,
        gain: Option<f64>,
        bars: Option<Vec<u64>>,
        standins: Option<Vec<PyReadonlyArray1<'_, f64>>>,
        forces: Vec<PyReadonlyArray1<'_, f64>>,
        guidance: Option<Vec<Vec<StepTuple>>>,
        bounds: Option<Vec<Vec<BoundTuple>>>,
        damp: Option<f64>,
    ) -> PyResult<u64> {
        if simulation.is_none() && old.is_some() {
            return Err(module_error("change", "`old` requires `simulation`"));
        }
        let new_simulation = simulation.map(|new_simulation| &new_simulation.0);
        let old = old.map(|old| &old.0);
        let to_vector = |values: &PyReadonlyArray1<'_, f64>| Ok(values.as_slice()?.to_vec());
        let to_vectors = |arrays: &Vec<_>| arrays.iter().map(to_vector).collect::<PyResult<Vec<_>>>();
        let mut planned_change = perform::Change {
            simulation: None,
            mixer: mixer.map(|mixer| mixer.0.clone()),
            gains,
            gain,
            bars,
            standin_positions: standins.as_ref().map(to_vectors).transpose()?,
            standin_forces: to_vectors(&forces)?,
            guidance_steps: guidance.map(|all| all.into_iter().map(guidance_steps).collect()),
            scale_bounds: bounds.map(|all| all.into_iter().map(scale_bounds).collect()),
            decay_time: match damp {
                Some(0.0) => Some(None),
                damp => damping(damp)?.map(Some),
            },
        };
        py.detach(|| {
            planned_change.simulation = new_simulation.map(|new_simulation| {
                // Without `old`, the new simulation begins in its own state.
                let takeover = old.map_or_else(Takeover::default, |old| Takeover::new(old, new_simulation));
                (new_simulation.fork(), takeover)
            });
            self.with(|performance| performance.change(frame, planned_change).map_err(plain_error))?
        })
    }

    /// Withdraw the changes of the simulation that are due at `frame` or later; an event "late" reports each of them.
    fn revoke(&self, frame: u64) -> PyResult<()> {
        self.with(|performance| performance.revoke(frame))?.map_err(plain_error)
    }

    /// Stop: zero force at once, silence within 5 ms.
    fn stop(&self) {
        self.control.stop();
    }

    /// Wait until the last frame is computed; False when `seconds` have passed first.
    fn wait(&self, py: Python<'_>, seconds: f64) -> PyResult<bool> {
        let deadline = Instant::now() + Duration::from_secs_f64(seconds.clamp(0.0, SECONDS_MAX));
        while !self.with(|performance| performance.is_done())? {
            let time_left = deadline.saturating_duration_since(Instant::now());
            if time_left.is_zero() {
                return Ok(false);
            }
            py.detach(|| std::thread::sleep(time_left.min(CHECK_INTERVAL)));
            py.check_signals()?;
        }
        Ok(true)
    }

    /// Why the recording cannot be written at present; None if it can, or if there is none.
    fn recording_trouble(&self) -> PyResult<Option<String>> {
        self.with(|performance| performance.recording_trouble())
    }

    /// Wait up to `patience` [s] until everything was heard, and close; returns the remaining events.
    fn close(&self, py: Python<'_>, patience: f64) -> PyResult<Vec<PerformanceEvent>> {
        let Some(performance) = self.lock().take() else {
            return Ok(Vec::new());
        };
        let patience = Duration::from_secs_f64(patience.clamp(0.0, SECONDS_MAX));
        let remaining_events = py.detach(|| performance.close(patience)).map_err(plain_error)?;
        Ok(remaining_events.into_iter().map(named_event).collect())
    }
}

impl Performance {
    fn lock(&self) -> MutexGuard<'_, Option<perform::Performance>> {
        self.performance.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn with<T>(&self, work: impl FnOnce(&mut perform::Performance) -> T) -> PyResult<T> {
        let mut performance = self.lock();
        let performance = performance.as_mut();
        performance
            .map(work)
            .ok_or_else(|| plain_error("the performance is closed"))
    }
}

fn guidance_steps(step_tuples: Vec<StepTuple>) -> Vec<GuidanceStep> {
    let guidance_step = |(frame, k, z)| GuidanceStep {
        tick: frame,
        share: GuidanceShare { k, z },
    };
    step_tuples.into_iter().map(guidance_step).collect()
}

fn scale_bounds(bound_tuples: Vec<BoundTuple>) -> Vec<ScaleBound> {
    let tick_bound = |(tick, scale)| ScaleBound { tick, scale };
    bound_tuples.into_iter().map(tick_bound).collect()
}

fn open_keyboard((url, axes, force_limit, calibration): BoardTuple, period: f64) -> PyResult<Keyboard> {
    let device_config = DeviceConfig {
        url: DeviceUrl::parse(&url).map_err(plain_error)?,
        calibration: calibration
            .into_iter()
            .map(device::parse_axis)
            .collect::<PyResult<_>>()?,
        force_limit,
        period,
        canceller: WaitCanceller::default(),
    };
    Keyboard::open(device_config, axes).map_err(plain_error)
}

fn checked_stems(stem_tuples: Vec<StemTuple>, n_out: usize) -> PyResult<Vec<Stem>> {
    let checked_stem = |(path, offset, n_frames, outputs): StemTuple| {
        if outputs.is_empty() || outputs.iter().any(|&output| output >= n_out) {
            return Err(module_error(
                "frozen",
                "a frozen part names no output, or one that does not exist",
            ));
        }
        Ok(Stem {
            path,
            offset,
            n_frames,
            outputs,
        })
    };
    stem_tuples.into_iter().map(checked_stem).collect()
}

/// The state of a sound file that is being recorded.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct AudioRecorded {
    first: Option<u64>,
    frames: u64,
    missing: u64,
    ended: bool,
    error: Option<String>,
}
