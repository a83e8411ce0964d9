//! Simulations: computation of frames from a network, a timeline and a plan.

use ergon_engine::simulation;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::error::{from_engine, from_fault, module_error, parse_choice};
use crate::frames::rows_mut;
use crate::named::{EnergyGain, FinerPart, MutedPart};
use crate::network::Network;
use crate::plan::Plan;
use crate::timeline::Timeline;
use crate::words;
use crate::work::computing;

/// The state of a simulation at one frame.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Snapshot(simulation::Snapshot);

/// Computes a network and its timeline by a plan; without a plan, every module as written.
#[pyclass(module = "ergon._core")]
pub(crate) struct Simulation(pub(crate) simulation::Simulation, IsStopped);

/// Whether `process` was stopped in the middle of a frame: the state is then undefined and the simulation cannot go on.
type IsStopped = bool;

#[pymethods]
impl Simulation {
    #[new]
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (network, timeline, *, plan=None, ledger=false, record=false, on_fault="stop", threads=1,
        unchecked=false, start=0))]
    fn new(
        py: Python<'_>,
        network: &Network,
        timeline: &Timeline,
        plan: Option<&Plan>,
        ledger: bool,
        record: bool,
        on_fault: &str,
        threads: usize,
        unchecked: bool,
        start: u64,
    ) -> PyResult<Self> {
        timeline.check_network(network)?;
        let on_fault = parse_choice("on_fault", on_fault, words::FAULT_RESPONSES)?;
        let options = simulation::SimulationOptions {
            keeps_ledger: ledger,
            records_ergons: record,
            on_fault,
            threads,
            is_unchecked: unchecked,
        };
        if let Some(plan) = plan {
            if ledger {
                return Err(module_error("plan", "`ledger` is not available with a plan"));
            }
            if record && !plan.0.records_every_ergon(&timeline.inner) {
                let message = "`record` is not available with this plan: ergons strike inside bodies";
                return Err(module_error("plan", message));
            }
            let plan = plan.0.clone();
            return computing(py, || simulation::Simulation::from_plan_at_frame(plan, options, start))?
                .map(|simulation| Self(simulation, false))
                .map_err(from_engine);
        }
        // The network that was passed, not the timeline's copy: it may have new outputs.
        let network = std::sync::Arc::new(network.0.clone());
        computing(py, || {
            let plan = ergon_engine::plan::Plan::plain(network, &timeline.inner, options.is_unchecked)?;
            simulation::Simulation::from_plan_at_frame(std::sync::Arc::new(plan), options, start)
        })?
        .map(|simulation| Self(simulation, false))
        .map_err(from_engine)
    }

    #[getter]
    fn rate(&self) -> f64 {
        self.0.rate()
    }

    #[getter]
    fn frame(&self) -> u64 {
        self.0.frame()
    }

    #[getter]
    fn n_out(&self) -> usize {
        self.0.n_out()
    }

    /// Fill out (n_frames, n_out) with the next frames.
    fn process(&mut self, py: Python<'_>, mut out: PyReadwriteArray2<'_, f64>) -> PyResult<()> {
        let (n_frames, n_out) = (out.shape()[0], self.0.n_out());
        let samples = rows_mut(&mut out, "out", n_out)?;
        let Self(simulation, is_stopped) = self;
        if std::mem::replace(is_stopped, true) {
            return Err(module_error(
                "process",
                "the simulation was stopped in the middle of a frame and cannot go on",
            ));
        }
        let run_outcome = computing(py, || {
            if n_out == 0 {
                simulation.skip(n_frames as u64)
            } else {
                simulation.process(samples)
            }
        })?;
        *is_stopped = false;
        run_outcome.map_err(from_fault)
    }

    /// Positions now [m], (n_mat,).
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.positions().into_pyarray(py)
    }

    /// Velocities now [m/s], (n_mat,): backward differences.
    fn velocities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let sample_rate = self.0.rate();
        let velocities: Vec<f64> = self.0.steps().iter().map(|step| step * sample_rate).collect();
        velocities.into_pyarray(py)
    }

    /// The position that each key's gesture asks for now [m], (n_keys,).
    fn asked<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.gesture_positions().into_pyarray(py)
    }

    /// Set the position x [m] of a real hand from the next tick on, and its movement in the last frame of the tick,
    /// `step` [m].
    #[pyo3(signature = (hand, x, step=None))]
    fn hold(&mut self, hand: usize, x: f64, step: Option<f64>) {
        self.0.set_hand_position(hand, x, step);
    }

    /// Strike a point of `Timeline.strike_point` by an impulse [N·s] at the next frame; False if there is no such
    /// point.
    fn strike(&mut self, point: u32, impulse: f64) -> PyResult<bool> {
        Ok(self.0.strike(point, strike_impulse(impulse)?))
    }

    /// Let an input of `Timeline.controlled_input` go to a value from the next frame on; False if there is no such
    /// input.
    fn tell(&mut self, number: u64, value: f64) -> PyResult<bool> {
        Ok(self.0.set_input(number, finite_input(value)?))
    }

    /// Give what a sound card hears in the next frames, (n_frames, n_channels), at most 4096 frames.
    fn sound_in(&mut self, frames: PyReadonlyArray2<'_, f32>) -> PyResult<()> {
        let n_channels = frames.shape()[1];
        self.0.feed_input_samples(frames.as_slice()?, n_channels);
        Ok(())
    }

    /// Channels of a sound card that the inputs of the timeline need.
    #[getter]
    fn n_channels_in(&self) -> usize {
        self.0.n_channels_in()
    }

    /// Mean force of the piece on a real hand over the last whole tick [N].
    fn hand_force(&self, hand: usize) -> f64 {
        self.0.hand_force(hand)
    }

    /// An independent copy in the same state.
    fn fork(&self, py: Python<'_>) -> Self {
        Self(py.detach(|| self.0.fork()), self.1)
    }

    /// Add a damping with decay t60 [s] to everything from this frame on; None: remove it.
    #[pyo3(signature = (t60))]
    fn damp(&mut self, t60: Option<f64>) -> PyResult<()> {
        self.0.damp(damping(t60)?);
        Ok(())
    }

    /// Take the state of `old` over, which must be at the same frame and must not be used afterwards. Returns, for each
    /// output of `old`, the index of the output here.
    fn take_over(&mut self, py: Python<'_>, old: &mut Self) -> PyResult<Vec<Option<usize>>> {
        let takeover_outcome = py.detach(|| {
            let mut takeover = simulation::Takeover::new(&old.0, &self.0);
            let takeover_outcome = self.0.take_over(&mut old.0, &mut takeover);
            takeover_outcome.then(|| takeover.outputs().to_vec())
        });
        if let Some(outputs) = takeover_outcome {
            return Ok(outputs);
        }
        let (current_frame, old) = (self.0.frame(), old.0.frame());
        let message =
            format!("both simulations must be at one frame: this one is at {current_frame}, the other at {old}");
        Err(module_error("take_over", message))
    }

    fn snapshot(&self) -> Snapshot {
        Snapshot(self.0.snapshot())
    }

    fn restore(&mut self, snapshot: &Snapshot) {
        self.0.restore(&snapshot.0);
    }

    /// The ledger.
    fn energy(&self) -> PyResult<Energy> {
        let energy_ledger = self
            .0
            .energy()
            .ok_or_else(|| module_error("energy", "the simulation was made without ledger=True"))?;
        Ok(Energy {
            start: energy_ledger.start,
            stored: energy_ledger.stored,
            injected: energy_ledger.injected,
            lost: energy_ledger.lost,
            produced: energy_ledger.produced,
            residual: energy_ledger.residual,
            flow: energy_ledger.flow,
        })
    }

    /// A report of each gesture, in the timeline's order.
    fn reports(&self) -> Vec<Report> {
        let reports = self.0.reports().into_iter().enumerate();
        reports
            .map(|(gesture, report)| Report {
                gesture,
                n_ergons: report.n_ergons,
                start: report.start,
                stop: report.stop,
                worst: report.deviation_max,
                worst_at: report.deviation_max_instant,
                pushed_by: report.pushed_by_mat.map(|mat| self.0.mat_name(mat)),
                compared: report.n_compared_frames,
                rms: report.rms(),
                low: report.position_min,
                high: report.position_max,
                strongest: report.velocity_step_max,
                force_max: report.force_max,
                missed: report.n_missed_steps,
                first_point_missed: report.is_first_point_missed,
            })
            .collect()
    }

    /// Ergons since the last call, as columns (n_ergons,).
    fn ergons<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let records = self.0.take_ergons();
        let columns = PyDict::new(py);
        let set_column = |name: &str, column_value: &dyn Fn(&simulation::ErgonRecord) -> f64| {
            let column_numbers: Vec<f64> = records.iter().map(column_value).collect();
            columns.set_item(name, column_numbers.into_pyarray(py))
        };
        set_column("time", &|record| record.time)?;
        set_column("mat", &|record| f64::from(record.mat))?;
        set_column("mass", &|record| record.mass)?;
        set_column("speed", &|record| record.speed)?;
        set_column("impulse", &|record| record.impulse)?;
        set_column("source", &|record| f64::from(record.source))?;
        Ok(columns)
    }

    /// Steps of islands so far that were skipped because nothing moved.
    fn steps_at_rest(&self) -> u64 {
        self.0.steps_at_rest()
    }

    /// Work so far whose amount depends on the motion, by the table of costs [s].
    fn counted_work(&self) -> f64 {
        self.0.counted_work()
    }

    /// The parts that were muted.
    fn muted(&self) -> Vec<MutedPart> {
        let muted_parts = self.0.muted_parts().into_iter();
        muted_parts.map(|(name, frame)| MutedPart { name, frame }).collect()
    }

    /// Links and meshes that made energy.
    fn gains(&self) -> Vec<EnergyGain> {
        let energy_gains = self.0.energy_gains().into_iter();
        energy_gains
            .map(|(name, frame, sentence)| EnergyGain { name, frame, sentence })
            .collect()
    }

    /// The most energy that one link or mesh has made, as a share of the energy that was there.
    fn created_share(&self) -> f64 {
        self.0.created_share()
    }

    /// The islands whose stretches can be stored.
    fn storable(&self, py: Python<'_>) -> Vec<StorableIsland> {
        let islands = py.detach(|| self.0.storable());
        islands.into_iter().map(StorableIsland).collect()
    }

    /// A hash of everything that determines an island from frame 0 to `stop` (64 hex digits); `before` is the hash up
    /// to `start`.
    fn island_key(&self, py: Python<'_>, island: &StorableIsland, start: u64, stop: u64, before: &str) -> String {
        py.detach(|| self.0.island_key(&island.0, (start, stop), before))
    }

    /// Hashes of everything that determines each output up to each of the rising frames `stops` (n_stops; n_out); empty
    /// where it is silent up to there.
    fn output_keys(&self, py: Python<'_>, stops: Vec<u64>) -> Vec<Vec<String>> {
        py.detach(|| self.0.output_keys(&stops))
    }

    /// Use `sound` (n_frames · its n_out,) for an island from here on instead of computing it.
    fn recall(&mut self, island: &StorableIsland, sound: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let sound = sound
            .as_slice()
            .map_err(|error| module_error("recall", error.to_string()))?;
        self.0.recall_sound(&island.0, sound.to_vec());
        Ok(())
    }

    /// Leave an island silent, and do not compute it, until its state is set.
    fn silence(&mut self, island: &StorableIsland) {
        self.0.silence(&island.0);
    }

    /// Compute an island from here on, and record its sound.
    fn record(&mut self, island: &StorableIsland) {
        self.0.record_sound(&island.0);
    }

    /// The sound of an island since `record`, and its state now; the recording ends.
    fn recorded(&mut self, py: Python<'_>, island: &StorableIsland) -> IslandStretch {
        let (island_sound, island_state) = self.0.take_recording(&island.0);
        IslandStretch {
            sound: island_sound.into_pyarray(py).unbind(),
            state: PyBytes::new(py, &island_state).unbind(),
        }
    }

    /// The next frames of one island (n_frames · its n_out,); everything else stands still.
    fn advance<'py>(
        &mut self,
        py: Python<'py>,
        island: &StorableIsland,
        n_frames: usize,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let engine_simulation = &mut self.0;
        let advance_outcome = computing(py, || engine_simulation.advance_island(&island.0, n_frames))?;
        Ok(advance_outcome.map_err(from_fault)?.into_pyarray(py))
    }

    /// Put an island into the state that an equal island had at this frame, and compute it from here on.
    fn set_state(&mut self, island: &StorableIsland, state: &[u8]) -> PyResult<()> {
        let state_outcome = self.0.set_state(&island.0, state);
        state_outcome.map_err(|error| module_error("set_state", error.to_string()))
    }

    /// The parts with frames of more than one step.
    fn finer(&self) -> Vec<FinerPart> {
        let finer_parts = self.0.finer_parts().into_iter();
        finer_parts
            .map(|(name, frames, steps)| FinerPart { name, frames, steps })
            .collect()
    }
}

/// An island whose stretches can be stored.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct StorableIsland(simulation::StorableIsland);

#[pymethods]
impl StorableIsland {
    #[getter]
    fn n_out(&self) -> usize {
        self.0.n_out
    }

    #[getter]
    fn cost(&self) -> f64 {
        self.0.cost
    }
}

/// A stretch of an island: its sound (n_frames · n_out,), and its state at the end.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct IslandStretch {
    sound: Py<PyArray1<f64>>,
    state: Py<PyBytes>,
}

/// An impulse [N·s]; EngineError if it is not finite.
pub(crate) fn strike_impulse(impulse: f64) -> PyResult<f64> {
    if impulse.is_finite() {
        Ok(impulse)
    } else {
        Err(module_error("strike", "an impulse is a finite number"))
    }
}

/// A value of an input; EngineError if it is not finite.
pub(crate) fn finite_input(value: f64) -> PyResult<f64> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(module_error("tell", "a value is a finite number"))
    }
}

/// A decay time [s] or None; EngineError if it is not above zero.
pub(crate) fn damping(t60: Option<f64>) -> PyResult<Option<f64>> {
    match t60 {
        Some(t60) if !(t60.is_finite() && t60 > 0.0) => {
            Err(module_error("damp", format!("t60 must be above 0 s, not {t60}")))
        }
        t60 => Ok(t60),
    }
}

/// How one gesture went, over the frames that it ran.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct Report {
    gesture: usize,
    n_ergons: u64,
    start: f64,
    stop: f64,
    worst: f64,
    worst_at: f64,
    pushed_by: Option<String>,
    compared: u64,
    rms: f64,
    low: f64,
    high: f64,
    strongest: f64,
    force_max: f64,
    missed: u64,
    first_point_missed: bool,
}

/// The energies of a simulation [J]: the ledger.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct Energy {
    start: f64,
    stored: f64,
    injected: f64,
    lost: f64,
    produced: f64,
    residual: f64,
    flow: f64,
}
