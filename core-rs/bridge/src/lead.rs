//! Streams of positions that lead the fingers on keys without a device.

use std::collections::BTreeMap;
use std::sync::Arc;

use ergon_live::pointer::path::{PathReader, PointerPosition};
use ergon_live::pointer::{FingerConstants, HeldKey, PointerStream as Stream, PointerStreamOptions, TRACE_COLUMNS};
use ergon_view::serve::PageKey;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::error::{module_error, plain_error};

const IMPOSSIBLE: &str = "masses, the finger's stiffness and the length of the travel must be above zero, dampings, \
    the key's stiffness and the delay at least zero; per kilogram no spring may have more than 1e8 N/m";

/// A stream of positions that leads the finger on a key.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Lead(pub(crate) Arc<Stream>);

#[pymethods]
impl Lead {
    #[new]
    #[pyo3(signature = (name, *, finger, delay, range, spring=(0.0, 0.0), lockstep=false, present=true, traced_ticks=0))]
    #[expect(clippy::too_many_arguments)]
    fn new(
        name: String,
        finger: (f64, f64, f64),
        delay: f64,
        range: (f64, f64),
        spring: (f64, f64),
        lockstep: bool,
        present: bool,
        traced_ticks: usize,
    ) -> PyResult<Self> {
        let (stiffness, damping, mass) = finger;
        let finger = FingerConstants {
            stiffness,
            damping,
            mass,
        };
        let key = HeldKey {
            stiffness: spring.0,
            rest: spring.1,
            range: [range.0, range.1],
            ..HeldKey::default()
        };
        if !(finger.is_possible() && key.is_possible() && delay.is_finite() && delay >= 0.0) {
            return Err(module_error("finger", IMPOSSIBLE));
        }
        let options = PointerStreamOptions {
            address: name,
            finger,
            delay,
            key,
            in_lockstep: lockstep,
            traced_ticks,
        };
        let refusal = format!("{} is in use", options.address);
        let lead_stream = Stream::new(options, present);
        lead_stream.map(Self).ok_or_else(|| plain_error(refusal))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.options().address
    }

    /// The two ends of the key's travel [m].
    #[getter]
    fn range(&self) -> (f64, f64) {
        let [lower_end, upper_end] = self.0.options().key.range;
        (lower_end, upper_end)
    }

    /// The force of the pointer on the finger at the end of the last tick [N].
    #[getter]
    fn force(&self) -> f64 {
        self.0.points().force
    }

    /// Time of the stream's clock [s].
    fn now(&self) -> f64 {
        self.0.now()
    }

    /// The pointer was at `x` [m] at `time` [s of the stream's clock]; False if that is refused.
    #[pyo3(signature = (time, x, firmness=1.0))]
    fn place(&self, time: f64, x: f64, firmness: f64) -> bool {
        let firmness = Some(firmness);
        self.0.add_position(PointerPosition { time, x, firmness }).is_ok()
    }

    /// The pointer was lifted at `time` [s].
    fn lift(&self, time: f64) -> bool {
        let (x, firmness) = (0.0, None);
        self.0.add_position(PointerPosition { time, x, firmness }).is_ok()
    }

    /// Whether a player is there.
    #[getter]
    fn present(&self) -> bool {
        self.0.is_present()
    }

    /// The player has come or gone.
    fn set_present(&self, present: bool) {
        self.0.set_present(present);
    }

    /// Give the name back: another stream may have it.
    fn close(&self) {
        self.0.close();
    }

    /// What happened in each tick so far, (n_ticks, 6).
    fn trace<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let trace_rows: Vec<Vec<f64>> = self.0.trace().iter().map(|row| row.to_vec()).collect();
        if trace_rows.is_empty() {
            return PyArray2::zeros(py, [0, TRACE_COLUMNS], false);
        }
        PyArray2::from_vec2(py, &trace_rows).expect("rows of equal length")
    }

    /// Discard the positions that wait, where no performance reads them.
    fn discard(&self) {
        let _ = self.0.discard_positions();
    }

    /// The quantile `part` of the gap between positions while the pointer moves, of the time from stamp to arrival, and
    /// of the delay that a path would need [s], to 0.25 ms upwards.
    fn arrival_times(&self, part: f64) -> (f64, f64, f64) {
        let time_quantiles = self.0.arrival_times(part);
        (
            time_quantiles.interval,
            time_quantiles.transit,
            time_quantiles.needed_delay,
        )
    }

    /// Counts of positions, and mean and deviation of the gaps between them [s].
    #[getter]
    fn tally(&self) -> BTreeMap<&'static str, f64> {
        let position_tally = self.0.tally();
        BTreeMap::from([
            ("taken", position_tally.accepted as f64),
            ("refused", position_tally.refused as f64),
            ("misdated", position_tally.misdated as f64),
            ("late", position_tally.late as f64),
            ("gap", position_tally.mean_interval),
            ("deviation", position_tally.interval_deviation),
        ])
    }
}

/// The even path that a finger follows, at rising instants `times` [s], (n_times,) [m], and the number of positions
/// that came too late. The pointer was at `positions` [m] at the instants `stamps` [s], which became known at
/// `arrivals` [s].
#[pyfunction]
pub(crate) fn even_path<'py>(
    py: Python<'py>,
    stamps: PyReadonlyArray1<'_, f64>,
    arrivals: PyReadonlyArray1<'_, f64>,
    positions: PyReadonlyArray1<'_, f64>,
    times: PyReadonlyArray1<'_, f64>,
    delay: f64,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (stamps, arrivals) = (stamps.as_slice()?, arrivals.as_slice()?);
    let (positions, times) = (positions.as_slice()?, times.as_slice()?);
    if stamps.len() != arrivals.len() || stamps.len() != positions.len() {
        return Err(module_error(
            "stamps",
            "stamps, arrivals and positions must be equally many",
        ));
    }
    let (mut path_reader, mut read_count) = (PathReader::new(delay), 0);
    let path_positions = times.iter().map(|&time| {
        let mut next_position = || {
            let has_arrived = arrivals.get(read_count).is_some_and(|&arrival| arrival <= time);
            has_arrived.then(|| {
                read_count += 1;
                PointerPosition {
                    time: stamps[read_count - 1],
                    x: positions[read_count - 1],
                    firmness: Some(1.0),
                }
            })
        };
        let path_reading = path_reader.read(time - delay, &mut next_position);
        path_reading.map_or(f64::NAN, |(x, _)| x)
    });
    let path_positions: Vec<_> = path_positions.collect();
    Ok((PyArray1::from_vec(py, path_positions), path_reader.n_late()))
}
