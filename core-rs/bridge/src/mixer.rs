//! Mixer from outputs to channels.

use std::sync::Arc;

use ergon_engine::mix::curve::{Curve, Pan, PanChannel, Point, Segment};
use ergon_engine::mix::delay::Echo;
use ergon_engine::mix::filter::FilterKind;
use ergon_engine::mix::frozen;
use ergon_engine::mix::mixer;
use ergon_engine::mix::room::RoomSpec;
use numpy::{PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::plain_error;
use crate::frames::{rows, rows_mut};

/// Samples of outputs that were computed before; mixers share them.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct FrozenOutputs(Arc<frozen::FrozenOutputs>);

#[pymethods]
impl FrozenOutputs {
    /// Copy samples (n_frames, n_out).
    #[new]
    fn new(samples: PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        let n_outputs = samples.shape()[1];
        let rows = rows(&samples, "samples", n_outputs)?;
        Ok(Self(Arc::new(frozen::FrozenOutputs::new(rows.to_vec(), n_outputs))))
    }
}

/// Routes of outputs to channels, with gains, second-order filters and delays.
#[pyclass(module = "ergon._core")]
pub(crate) struct Mixer(pub(crate) mixer::Mixer);

#[pymethods]
impl Mixer {
    #[new]
    fn new(rate: f64, n_out: usize, n_channels: usize) -> Self {
        Self(mixer::Mixer::new(rate, n_out, n_channels))
    }

    /// Add gain · output to a channel or a room (from 0). `highpass` [Hz] is a Butterworth of order 2, `tones` are
    /// filters after it: (what, frequency [Hz], level [dB]). `delay` is in frames, `echo` what of it goes in again:
    /// (frames, ratio). `curve` is a gain over the frames of the piece: (frame, ratio, whether it is reached smoothly),
    /// `pan` a place between two channels in the same way, and whether this is the second. `set_gain` changes the gain
    /// of a `group` of routes. With `squared` the square of the output is heard.
    #[pyo3(signature = (out, channel, gain = 1.0, highpass = None, group = 0, *, tones = Vec::new(), delay = 0,
        echo = None, curve = None, pan = None, to_room = false, squared = false))]
    #[expect(clippy::too_many_arguments)]
    fn route(
        &mut self,
        out: usize,
        channel: usize,
        gain: f64,
        highpass: Option<f64>,
        group: usize,
        tones: Vec<(String, f64, f64)>,
        delay: usize,
        echo: Option<(usize, f64)>,
        curve: Option<Points>,
        pan: Option<(Points, bool)>,
        to_room: bool,
        squared: bool,
    ) -> PyResult<()> {
        let target = if to_room {
            mixer::RouteTarget::Room(channel)
        } else {
            mixer::RouteTarget::Channel(channel)
        };
        let highpass = highpass.map(|f| Ok(FilterKind::Highpass { f }));
        let tones = tones.iter().map(|(word, f, level)| tone_of(word, *f, *level));
        let pan = pan.map(|(pan_points, is_second)| {
            let pan_side = if is_second {
                PanChannel::Second
            } else {
                PanChannel::First
            };
            Pan::new(points_of(pan_points), pan_side)
        });
        let treatment = mixer::RouteTreatment {
            is_squared: squared,
            filters: highpass.into_iter().chain(tones).collect::<PyResult<_>>()?,
            delay,
            echo: echo.map(|(frames, ratio)| Echo {
                delay_frames: frames,
                feedback_ratio: ratio,
            }),
            curve: match (curve, pan) {
                (curve, Some(pan)) => Some(curve_of(curve.unwrap_or_default()).with_pan(pan)),
                (curve, None) => curve.map(curve_of),
            },
        };
        self.0
            .add_treated_route(group, out, target, gain, treatment)
            .map_err(plain_error)
    }

    /// Add a room that some channels (from 0) hear: `size` [m], `t60` as two pairs (frequency [Hz], decay time [s]);
    /// its index.
    #[pyo3(signature = (name, channels, *, size, t60, gain = 1.0))]
    fn room(
        &mut self,
        name: String,
        channels: Vec<usize>,
        size: f64,
        t60: [(f64, f64); 2],
        gain: f64,
    ) -> PyResult<usize> {
        let room_spec = RoomSpec {
            name,
            size,
            t60,
            channels,
            gain,
        };
        self.0.add_room(room_spec).map_err(plain_error)
    }

    /// Add frozen outputs to `outputs`, one each; their first frame is heard at frame `begins`.
    fn freeze(&mut self, frozen: &FrozenOutputs, outputs: Vec<usize>, begins: i64) -> PyResult<()> {
        self.0
            .add_frozen_outputs(&frozen.0, &outputs, begins)
            .map_err(plain_error)
    }

    /// Set a gain of all channels over the frames of the piece, as the `curve` of a route.
    fn fade(&mut self, curve: Points) {
        self.0.set_master_curve(curve_of(curve));
    }

    /// Let the gain of a group glide to `gain` in 20 ms, from the next multiple of 64 frames on.
    fn set_gain(&mut self, group: usize, gain: f64) {
        self.0.set_gain(group, gain);
    }

    /// Take the gains and filters of `old` over; `outputs`: for each output of `old` the output here, if they differ.
    #[pyo3(signature = (old, outputs = None))]
    fn take_over(&mut self, old: &mut Self, outputs: Option<Vec<Option<usize>>>) {
        self.0.take_over(&mut old.0, outputs.as_deref());
    }

    /// The state of routes and rooms as bytes; `None` while a gain glides, or with frozen outputs.
    fn state<'py>(&mut self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        self.0.write_state().map(|state| PyBytes::new(py, &state))
    }

    /// Go on after the frames that an equal mixer has mixed.
    fn set_state(&mut self, state: &[u8]) -> PyResult<()> {
        self.0.read_state(state).map_err(plain_error)
    }

    /// Mix frames (n_frames, n_out) into mixed (n_frames, n_channels).
    fn process(
        &mut self,
        py: Python<'_>,
        frames: PyReadonlyArray2<'_, f64>,
        mut mixed: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        let (input_frames, mixed_frames) = (frames.shape()[0], mixed.shape()[0]);
        if input_frames != mixed_frames {
            let message = format!("`frames` has {input_frames} frames and `mixed` has {mixed_frames}");
            return Err(plain_error(message));
        }
        let frames = rows(&frames, "frames", self.0.n_out())?;
        let mixed = rows_mut(&mut mixed, "mixed", self.0.n_channels())?;
        py.detach(|| self.0.process(frames, mixed));
        Ok(())
    }
}

/// Points of a curve: frame, value, whether the way to it is smooth.
type Points = Vec<(i64, f64, bool)>;

fn points_of(points: Points) -> Vec<Point> {
    let curve_point = |(frame, value, is_smooth): (i64, f64, bool)| Point {
        frame,
        value,
        segment: if is_smooth { Segment::Smooth } else { Segment::Line },
    };
    points.into_iter().map(curve_point).collect()
}

fn curve_of(points: Points) -> Curve {
    Curve::new(points_of(points))
}

fn tone_of(word: &str, f: f64, level: f64) -> PyResult<FilterKind> {
    match word {
        "highpass" => Ok(FilterKind::Highpass { f }),
        "lowpass" => Ok(FilterKind::Lowpass { f }),
        "lowshelf" => Ok(FilterKind::Lowshelf { f, level }),
        "highshelf" => Ok(FilterKind::Highshelf { f, level }),
        _ => Err(plain_error(format!(
            "a route has no filter `{word}`; it has highpass, lowpass, lowshelf and highshelf"
        ))),
    }
}
