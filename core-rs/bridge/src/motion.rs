//! Motion of a simulation as chunks of bytes; motion files.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ergon_engine::simulation;
use ergon_live::{perform, regular};
use ergon_view::packed::ERROR_BOUNDS;
use ergon_view::read::{MotionFile, ReadError};
use ergon_view::record::{self, Recorder, RecordingSetup};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::plain_error;
use crate::frames::rows;
use crate::named::{LookContact, LookRun, MotionChunk};
use crate::simulation::Simulation;
use crate::timeline::Timeline;

/// What can be seen of a simulation: every mass, whatever computes it.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct MotionLook(simulation::MotionLook, Vec<String>);

#[pymethods]
impl MotionLook {
    /// Look at a simulation, which is not changed.
    #[new]
    fn new(py: Python<'_>, simulation: &Simulation) -> Self {
        let network_parts = simulation.0.network().parts().iter();
        let part_names = network_parts.map(|part| part.name.clone()).collect();
        Self(py.detach(|| simulation.0.make_look()), part_names)
    }

    #[getter]
    fn n_modes(&self) -> usize {
        self.0.n_modes()
    }

    /// The MAT of each point, (n_points,).
    fn mats(&self) -> Vec<usize> {
        self.0.points.iter().map(|point| point.mat).collect()
    }

    /// The points in runs of one kind.
    fn runs(&self) -> Vec<LookRun> {
        let run = |run: record::PointRun| {
            let body = run.body.map(|body| &self.0.bodies[body]);
            LookRun {
                part: self.1[run.part].clone(),
                first: run.points.start,
                count: run.points.len(),
                kind: run.kind,
                why: run.skip_reason,
                modes: body.map(|body| (body.first_mode, body.modes.len(), body.n_modes)),
            }
        };
        record::point_runs(&self.0).into_iter().map(run).collect()
    }

    /// Links that open and close, with their MATs.
    fn contacts(&self) -> Vec<LookContact> {
        let contacts = self.0.contacts.iter();
        contacts
            .map(|contact| LookContact {
                name: contact.name.clone(),
                a: contact.ends.0,
                b: contact.ends.1,
            })
            .collect()
    }
}

/// Writes the motion of a simulation into the chunks of a motion file. Changes no sample.
#[pyclass(module = "ergon._core")]
pub(crate) struct MotionRecorder {
    recorder: Recorder,
    n_speakers: usize,
}

#[pymethods]
impl MotionRecorder {
    #[new]
    #[pyo3(signature = (simulation, look, timeline, *, manifest, places, keys, n_speakers, fps))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        mut simulation: PyRefMut<'_, Simulation>,
        look: &MotionLook,
        timeline: &Timeline,
        manifest: String,
        places: PyReadonlyArray2<'_, f64>,
        keys: Vec<usize>,
        n_speakers: usize,
        fps: f64,
    ) -> PyResult<Self> {
        let engine_simulation = &mut simulation.0;
        let setup = setup(engine_simulation, timeline, manifest, &places, keys, n_speakers, fps)?;
        engine_simulation.start_watching();
        let recorder = Recorder::new(engine_simulation, look.0.clone(), setup).map_err(plain_error)?;
        Ok(Self { recorder, n_speakers })
    }

    /// The next frame of the simulation at which `look` must be called.
    #[getter]
    fn next(&self) -> u64 {
        self.recorder.next_frame()
    }

    /// Record the state of the simulation, which is at frame `next`.
    fn look(&mut self, py: Python<'_>, mut simulation: PyRefMut<'_, Simulation>) {
        let engine_simulation = &mut simulation.0;
        py.detach(|| self.recorder.record_look(engine_simulation));
    }

    /// Measure the sound of the loudspeakers since the last look, (n_frames, n_speakers).
    fn hear(&mut self, mixed: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        self.recorder.add_levels(rows(&mixed, "mixed", self.n_speakers)?);
        Ok(())
    }

    /// The bytes that were completed since the last call.
    fn take<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.recorder.take_bytes())
    }

    /// The last bytes of the file.
    fn finish<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.recorder.finish())
    }
}

fn setup(
    simulation: &ergon_engine::Simulation,
    timeline: &Timeline,
    manifest: String,
    places: &PyReadonlyArray2<'_, f64>,
    key_mats: Vec<usize>,
    n_speakers: usize,
    fps: f64,
) -> PyResult<RecordingSetup> {
    if !(fps >= 1.0 && fps <= simulation.rate()) {
        return Err(plain_error(format!("fps is {fps}: it must be from 1 to the rate")));
    }
    let places = rows(places, "places", 3)?;
    Ok(RecordingSetup {
        manifest,
        point_positions: places
            .chunks(3)
            .map(|position| [position[0], position[1], position[2]])
            .collect(),
        ergons: simulation.written_ergons(&timeline.inner),
        strike_points: timeline.inner.strike_points().collect(),
        key_mats,
        n_speakers,
        looks_per_second: fps,
    })
}

/// The view of a simulation that pages get while it is played: one end for the physics thread, one for the pages.
/// Changes no sample.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Window(Mutex<Option<(perform::DisplayWindow, perform::WindowReader)>>);

#[pymethods]
impl Window {
    #[new]
    #[pyo3(signature = (simulation, look, timeline, *, manifest, places, keys, n_speakers, fps))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        simulation: &Simulation,
        look: &MotionLook,
        timeline: &Timeline,
        manifest: String,
        places: PyReadonlyArray2<'_, f64>,
        keys: Vec<usize>,
        n_speakers: usize,
        fps: f64,
    ) -> PyResult<Self> {
        let engine_simulation = &simulation.0;
        let setup = setup(engine_simulation, timeline, manifest, &places, keys, n_speakers, fps)?;
        let window_ends = py.detach(|| perform::window_pair(engine_simulation, look.0.clone(), setup));
        Ok(Self(Mutex::new(Some(window_ends.map_err(plain_error)?))))
    }
}

impl Window {
    /// Its two ends; EngineError at the second call.
    pub(crate) fn take_ends(&self) -> PyResult<(perform::DisplayWindow, perform::WindowReader)> {
        let mut window_ends = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        window_ends
            .take()
            .ok_or_else(|| plain_error("this window is in use already"))
    }
}

/// A `.motion` file, up to its last whole chunk.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Motion(MotionFile);

/// How far displacements in a file may be off: shares of an amplitude, and metres.
#[pyfunction]
pub(crate) fn motion_bound() -> BTreeMap<&'static str, f64> {
    BTreeMap::from([
        ("amplitude", ERROR_BOUNDS.amplitude_share),
        ("rest", ERROR_BOUNDS.resting_metres),
        ("least", ERROR_BOUNDS.metres_min),
        ("flight", ERROR_BOUNDS.flight_share),
    ])
}

/// Read a `.motion` file up to its last whole chunk.
#[pyfunction]
pub(crate) fn read_motion(py: Python<'_>, path: PathBuf) -> PyResult<Motion> {
    let file_bytes = py.detach(|| read_bytes(&path))?;
    py.detach(|| MotionFile::new(file_bytes))
        .map(Motion)
        .map_err(read_error)
}

fn read_bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut motion_file = regular::open(path)?;
    let mut file_bytes = Vec::new();
    file_bytes.try_reserve_exact(motion_file.metadata()?.len() as usize)?;
    motion_file.read_to_end(&mut file_bytes)?;
    Ok(file_bytes)
}

fn read_error(error: ReadError) -> PyErr {
    plain_error(error)
}

#[pymethods]
impl Motion {
    #[getter]
    fn manifest(&self) -> &str {
        &self.0.manifest
    }

    #[getter]
    fn is_whole(&self) -> bool {
        self.0.is_complete
    }

    #[getter]
    fn is_cut(&self) -> bool {
        self.0.is_truncated()
    }

    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    #[getter]
    fn names(&self) -> Vec<String> {
        self.0.point_names.clone()
    }

    /// x, y, z and rest position of each point [m], (n_points, 4).
    fn places<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let point_places = self.0.point_positions.concat();
        let place_array = Array2::from_shape_vec((self.0.n_points, 4), point_places).map_err(plain_error)?;
        Ok(place_array.into_pyarray(py))
    }

    /// All whole chunks.
    fn chunks(&self) -> Vec<MotionChunk> {
        let file_chunks = self.0.chunks().iter();
        file_chunks
            .map(|chunk| MotionChunk {
                kind: chunk.kind,
                seconds: chunk.seconds,
                size: chunk.n_bytes,
            })
            .collect()
    }

    /// The payload of a chunk.
    fn payload<'py>(&self, py: Python<'py>, chunk: usize) -> PyResult<Bound<'py, PyBytes>> {
        let motion_chunk = self.0.chunks().get(chunk);
        let motion_chunk = motion_chunk.ok_or_else(|| plain_error(format!("there is no chunk {chunk}")))?;
        Ok(PyBytes::new(py, self.0.payload(motion_chunk)))
    }

    /// Displacements of all points [m] at rising instants [s], (n_instants, n_points).
    fn displacements<'py>(&self, py: Python<'py>, instants: Vec<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        if !instants.is_sorted() {
            return Err(plain_error("instants must rise"));
        }
        let flat_displacements = py.detach(|| self.0.displacements(&instants)).map_err(read_error)?;
        let array_shape = (instants.len(), self.0.n_points);
        Ok(Array2::from_shape_vec(array_shape, flat_displacements)
            .map_err(plain_error)?
            .into_pyarray(py))
    }
}
