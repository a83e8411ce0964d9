//! Excitation of real and emulated keys by given forces, to measure their models.

use std::time::Duration;

use ergon_engine::key_model::KeyModel;
use ergon_live::device::calibrate::{self, AxisCalibration, CalibratedDevice};
use ergon_live::device::{self as live, Device as _, DeviceLoss};
use ergon_live::emulate::{BoardConfig, EmulatedHand, EmulationOptions, KeyConstants, Protocol};
use ergon_live::metrology::{self, Excitation, ExcitationEnd, ExcitationRow, Guide, SpringDamper};
use ergon_live::recording::{self, Header, Recorder};
use numpy::{Element, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::device::{AxisTuple, Device, parse_axis};
use crate::emulator::PROTOCOLS;
use crate::error::{module_error, parse_choice, plain_error};
use crate::perform::RecordTuple;
use crate::status::trip_text;

/// The guide: (centre, where the key is kept [m]; distance from there to the nearer end [m]; (stiffness, damping) of
/// the guide; the same of the brake; deceleration by the brake [m/s²]).
type GuideTuple = (f64, f64, (f64, f64), (f64, f64), f64);

/// Push an axis of a device by forces (n_ticks,) [N], then let go of it.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
#[pyo3(signature = (device, axis, force, rate, frames_per_tick, guide, *, sign=1, unguided_ticks=0, force_step=0.0,
    tells_touch=true, is_gated=true, record=None))]
pub(crate) fn excite(
    py: Python<'_>,
    device: &Device,
    axis: usize,
    force: PyReadonlyArray1<'_, f64>,
    rate: f64,
    frames_per_tick: u32,
    guide: GuideTuple,
    sign: i32,
    unguided_ticks: usize,
    force_step: f64,
    tells_touch: bool,
    is_gated: bool,
    record: Option<RecordTuple>,
) -> PyResult<ExcitationRecord> {
    let (centre, half_travel, guide_spring, brake_spring, deceleration) = guide;
    let spring_damper = |(stiffness, damping)| SpringDamper { stiffness, damping };
    let is_positive = |x: f64| x.is_finite() && x > 0.0;
    if !(is_positive(half_travel) && is_positive(deceleration) && is_positive(rate) && frames_per_tick > 0) {
        return Err(module_error(
            "excite",
            "rate, frames, half the travel and the deceleration must be above zero",
        ));
    }
    let excitation = Excitation {
        axis,
        forces: force.as_slice()?,
        unguided_ticks,
        period: f64::from(frames_per_tick) / rate,
        guide: Guide {
            centre,
            half_travel,
            spring: spring_damper(guide_spring),
            brake: spring_damper(brake_spring),
            deceleration,
        },
        force_step,
        reports_touch: tells_touch,
        is_gated,
    };
    device.check_axis(axis)?;
    let recorder = record.map(|(path, axes, about)| {
        let recorded_axis = |(player, key)| recording::RecordedAxis { player, key };
        let take_header = Header {
            rate,
            frames: frames_per_tick,
            axes: axes.into_iter().map(recorded_axis).collect(),
            about,
        };
        Recorder::start(&path, &take_header).map_err(crate::recording::from_recording)
    });
    let (mut record_sink, record_handle) = recorder.transpose()?.unzip();
    let excitation_result = device.with_taken_device(py, |port, stop| {
        let excited_axis = AxisCalibration {
            sign: f64::from(sign),
            range: port.range(axis),
            ..AxisCalibration::without_corrections(port.spec())
        };
        let mut axes = vec![AxisCalibration::without_corrections(port.spec()); port.spec().dof];
        axes[axis] = excited_axis;
        metrology::excite(
            CalibratedDevice::new(port, axes),
            &excitation,
            record_sink.as_mut(),
            stop,
        )
    });
    drop(record_sink);
    let stop_result = record_handle.map(|record_handle| py.detach(|| record_handle.stop()));
    let excitation_result = excitation_result?;
    stop_result.transpose().map_err(crate::recording::from_recording)?;
    Ok(ExcitationRecord(excitation_result))
}

/// The record of a key that `excite` pushed: its ticks as columns, and why they ended.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct ExcitationRecord(metrology::ExcitationResult);

#[pymethods]
impl ExcitationRecord {
    /// Why the ticks ended: done, touched, gate closed, not finite, unplugged, silent, shared, stopped or a trip.
    #[getter]
    fn end(&self) -> &'static str {
        match self.0.end {
            ExcitationEnd::Done => "done",
            ExcitationEnd::Touched => "touched",
            ExcitationEnd::GateClosed => "gate closed",
            ExcitationEnd::NotFinite => "not finite",
            ExcitationEnd::Tripped(cause) => trip_text(cause),
            ExcitationEnd::Gone(DeviceLoss::Silent) => "silent",
            ExcitationEnd::Gone(DeviceLoss::Shared) => "shared",
            ExcitationEnd::Gone(_) => "unplugged",
            ExcitationEnd::Stopped => "stopped",
        }
    }

    /// Forces that were asked for, with those of guide and brake (n,) [N].
    fn requested_forces<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |row| row.requested_force)
    }

    /// Forces as they went over the wire, after all safety stages (n,) [N].
    fn sent<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |row| row.sent_force)
    }

    /// Positions of the replies to the forces (n,) [m].
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |row| row.position)
    }

    /// Whether there was a reply to each force (n,).
    fn are_fresh<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.column(py, |row| row.is_fresh)
    }

    /// The device's clock in each reply (n,) [µs].
    fn clocks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.column(py, |row| row.clock)
    }

    /// Whether the brake pushed instead of the written force (n,).
    fn braked<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.column(py, |row| row.braked)
    }
}

impl ExcitationRecord {
    fn column<'py, T: Element>(&self, py: Python<'py>, row_value: fn(&ExcitationRow) -> T) -> Bound<'py, PyArray1<T>> {
        PyArray1::from_iter(py, self.0.rows.iter().map(row_value))
    }
}

/// An emulated device in this process, in lockstep, behind the driver of its protocol; its keys move by `model`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
#[pyo3(signature = (protocol, model, *, rate, travel=0.1, force_max=20.0, resolution=0.0, noise=0.0, force_step=0.0, seed=0,
    path=None, hand=(400.0, 4.0), touch_gate=false, seconds=None, calibration=Vec::new()))]
pub(crate) fn emulated_device(
    py: Python<'_>,
    protocol: &str,
    model: PyReadonlyArray1<'_, f64>,
    rate: f64,
    travel: f64,
    force_max: f64,
    resolution: f64,
    noise: f64,
    force_step: f64,
    seed: u64,
    path: Option<PyReadonlyArray1<'_, f64>>,
    hand: (f64, f64),
    touch_gate: bool,
    seconds: Option<f64>,
    calibration: Vec<AxisTuple>,
) -> PyResult<Device> {
    let model = KeyModel::from_row(model.as_slice()?);
    let model = model.map_err(|error| module_error("emulated_device", error))?;
    let protocol = parse_choice("protocol", protocol, PROTOCOLS)?;
    let half_travel = 0.5 * travel;
    let key = KeyConstants {
        mass: model.mass,
        stiffness: model.stiffness,
        damping: model.damping,
        range: [-half_travel, half_travel],
    };
    let hands = path.map_or(Vec::new(), |path| {
        let (stiffness, damping) = hand;
        vec![EmulatedHand::OnPath {
            path: path.as_array().to_vec(),
            stiffness,
            damping,
        }]
    });
    let options = EmulationOptions {
        board: BoardConfig {
            protocol,
            lockstep: true,
            touch_gate,
            force_max,
            resolution,
            noise,
            seed,
            force_step,
            watchdog: Duration::from_secs(1),
            reported_constants: [key.mass, key.damping],
            range: key.range,
        },
        transport: ergon_live::emulate::Transport::Udp(0),
        axes: if protocol == Protocol::FireFader { 2 } else { 1 },
        key,
        network: None,
        model: Some(model),
        rate,
        hands,
        seconds,
        ends_with_host: false,
    };
    let calibrated_axes = calibration.into_iter().map(parse_axis).collect::<PyResult<Vec<_>>>()?;
    let open_device = || live::open_board(&options).map(|device| calibrate::with_calibration(device, &calibrated_axes));
    Ok(Device::from_device(py.detach(open_device).map_err(plain_error)?))
}
