//! Haptic devices and the host machine: opening, testing and measuring them. `perform` plays them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use ergon_live::device::calibrate::{self, AxisCalibration, DirectionError, TestPulse};
use ergon_live::device::ports;
use ergon_live::device::{self as live, Device as _, DeviceLoss, DeviceUrl, Unit, WireStats};
use ergon_live::doctor::{self, TimingCheck};
use ergon_live::realtime::GrantedScheduling;
use ergon_live::safety::{GuardedDevice, SafetyLimits};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::error::{UnsureError, module_error, plain_error, with_attributes};
use crate::guardian;
use crate::named::Range;

/// Longest time between two checks for Ctrl-C during a measurement.
const CHECK_INTERVAL: Duration = Duration::from_millis(20);
/// Longest measurement [ticks].
const TICKS_MAX: f64 = 1e8;

/// The fields of an `AxisCalibration`: (number of the axis, sign, zero, gain, range, greatest force).
pub(crate) type AxisTuple = (usize, f64, f64, f64, (f64, f64), f64);
pub(crate) type BoxedDevice = Box<dyn live::Device>;

/// The calibration of an axis; EngineError if its values are impossible.
pub(crate) fn parse_axis(calibration: AxisTuple) -> PyResult<(usize, AxisCalibration)> {
    let (axis_number, sign, offset, gain, (range_low, range_high), force_max) = calibration;
    let is_possible = sign.abs() == 1.0
        && [offset, gain, range_low, range_high, force_max]
            .iter()
            .all(|x| x.is_finite())
        && gain != 0.0
        && range_low < range_high
        && force_max >= 0.0;
    if !is_possible {
        return Err(module_error("calibration", "the calibration of an axis is impossible"));
    }
    let range = [range_low, range_high];
    let calibrated_axis = AxisCalibration {
        sign,
        offset,
        gain,
        range,
        force_max,
    };
    Ok((axis_number, calibrated_axis))
}

/// Run `work` in a separate thread, which Ctrl-C tells to stop.
fn run_in_thread<T: Send>(py: Python<'_>, work: impl FnOnce(&AtomicBool) -> T + Send) -> PyResult<T> {
    let stop_flag = AtomicBool::new(false);
    py.detach(|| {
        thread::scope(|scope| {
            let worker_thread = scope.spawn(|| work(&stop_flag));
            let (mut signal_error, mut poll_interval) = (None, CHECK_INTERVAL / 100);
            while !worker_thread.is_finished() {
                thread::sleep(poll_interval);
                poll_interval = (2 * poll_interval).min(CHECK_INTERVAL);
                if signal_error.is_none() {
                    signal_error = Python::attach(|py| py.check_signals()).err();
                    stop_flag.store(signal_error.is_some(), Ordering::Relaxed);
                }
            }
            let work_outcome = worker_thread.join().map_err(|_| plain_error("the measurement failed"));
            signal_error.map_or(work_outcome, Err)
        })
    })
}

fn tick_count(seconds: f64, period: f64) -> PyResult<usize> {
    let tick_count = (seconds / period).ceil();
    if period > 0.0 && (1.0..=TICKS_MAX).contains(&tick_count) {
        Ok(tick_count as usize)
    } else {
        Err(module_error(
            "seconds",
            "seconds and period must be above zero and finite",
        ))
    }
}

/// Every serial port of this machine.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(crate) fn serial_ports(py: Python<'_>) -> Vec<SerialPort> {
    let port_list = py.detach(ports::serial_ports).into_iter();
    port_list
        .map(|port| SerialPort {
            path: port.path,
            usb: port.usb.map(|usb| UsbBoard {
                vendor: usb.vendor,
                product: usb.product,
                name: usb.name,
                serial: usb.serial,
            }),
        })
        .collect()
}

/// A serial port of this machine.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct SerialPort {
    path: String,
    usb: Option<UsbBoard>,
}

/// What a USB board reports about itself.
#[pyclass(frozen, get_all, from_py_object, module = "ergon._core")]
#[derive(Clone)]
pub(crate) struct UsbBoard {
    vendor: u16,
    product: u16,
    name: String,
    serial: String,
}

/// A name of the board on a serial port that does not depend on the port; None if unknown.
#[pyfunction]
pub(crate) fn serial_identity(py: Python<'_>, path: &str) -> Option<String> {
    py.detach(|| ports::identity(path))
}

/// Wake like the physics thread every `period` [s] for `seconds` [s].
#[pyfunction]
pub(crate) fn checkup(py: Python<'_>, seconds: f64, period: f64) -> PyResult<Checkup> {
    let ticks = tick_count(seconds, period)?;
    let checkup = run_in_thread(py, |stop| {
        doctor::check_timing::<BoxedDevice>(None, period, ticks, stop)
    })?;
    Ok(Checkup::new(checkup.map_err(plain_error)?, WireStats::default()))
}

/// An open device, for tests and calibration.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Device {
    device: Mutex<Option<BoxedDevice>>,
    spec: live::DeviceSpec,
}

#[pymethods]
impl Device {
    #[new]
    #[pyo3(signature = (url, calibration = Vec::new()))]
    fn new(py: Python<'_>, url: &str, calibration: Vec<AxisTuple>) -> PyResult<Self> {
        let url = DeviceUrl::parse(url).map_err(plain_error)?;
        guardian::register_guardian(py);
        let calibrated_axes = calibration.into_iter().map(parse_axis).collect::<PyResult<Vec<_>>>()?;
        let opened_device = py
            .detach(|| {
                live::open(&url).map(|opened_device| calibrate::with_calibration(opened_device, &calibrated_axes))
            })
            .map_err(plain_error)?;
        Ok(Self::from_device(opened_device))
    }

    #[getter]
    fn axes(&self) -> usize {
        self.spec.dof
    }

    /// Unit of positions: m or rad.
    #[getter]
    fn unit(&self) -> &'static str {
        match self.spec.unit {
            Unit::Metre => "m",
            Unit::Radian => "rad",
        }
    }

    /// Step of the position sensor [m or rad].
    #[getter]
    fn resolution(&self) -> f64 {
        self.spec.pos_lsb
    }

    /// Least and greatest position [m or rad].
    #[getter]
    fn range(&self) -> Range {
        let [low, high] = self.spec.pos_range;
        Range { low, high }
    }

    /// Greatest force [N or N·m].
    #[getter]
    fn force_max(&self) -> f64 {
        self.spec.force_max_peak
    }

    /// Force that its motors bear for hours [N or N·m].
    #[getter]
    fn force_continuous(&self) -> f64 {
        self.spec.force_max_continuous
    }

    /// Whether it gives force only while a finger touches it.
    #[getter]
    fn touch_gated(&self) -> bool {
        self.spec.is_touch_gated
    }

    /// Whether it runs in lockstep: it has no clock of its own.
    #[getter]
    fn lockstep(&self) -> bool {
        self.lock_device().as_ref().is_some_and(|device| device.in_lockstep())
    }

    /// The sign of an axis, found by a small force, in ticks of `period` [s]: 1 or -1.
    fn direction(&self, py: Python<'_>, axis: usize, period: f64) -> PyResult<f64> {
        let axis_signs = self.signs(py, &[axis], period)?;
        axis_signs[0].map_err(|unsure| with_attributes(UnsureError::new_err(unsure.to_string()), None, |_| Ok(())))
    }

    /// The signs of axes, found by small forces at the same time; none of an axis that did not move both ways.
    fn directions(&self, py: Python<'_>, axes: Vec<usize>, period: f64) -> PyResult<Vec<Option<f64>>> {
        let axis_signs = self.signs(py, &axes, period)?;
        Ok(axis_signs.into_iter().map(Result::ok).collect())
    }

    /// Least and greatest position of each axis during `seconds` [s] of motion by hand, (n_axes, 2) [m or rad].
    fn ends<'py>(&self, py: Python<'py>, seconds: f64, period: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        tick_count(seconds, period)?;
        let axis_ends = self
            .with_taken_device(py, |device, stop| calibrate::travel_ends(device, seconds, period, stop))?
            .map_err(plain_error)?;
        let end_rows: Vec<_> = axis_ends[..self.spec.dof].iter().map(|row| row.to_vec()).collect();
        PyArray2::from_vec2(py, &end_rows).map_err(plain_error)
    }

    /// Send zero forces every `period` [s] for `seconds` [s], and time the replies.
    fn checkup(&self, py: Python<'_>, seconds: f64, period: f64) -> PyResult<Checkup> {
        let ticks = tick_count(seconds, period)?;
        let (checkup, device_stats) =
            self.with_taken_device(py, |device, stop| -> (Result<_, DeviceLoss>, WireStats) {
                let device_limits = SafetyLimits::from_spec(device.spec());
                let mut guarded_device = GuardedDevice::new(device, device_limits, period);
                let checkup = doctor::check_timing(Some(&mut guarded_device), period, ticks, stop);
                (checkup, guarded_device.device().stats())
            })?;
        Ok(Checkup::new(checkup.map_err(plain_error)?, device_stats))
    }

    /// Close the device; forces are zero.
    fn close(&self, py: Python<'_>) {
        let taken_device = self.lock_device().take();
        py.detach(|| drop(taken_device));
    }
}

impl Device {
    pub(crate) fn from_device(device: BoxedDevice) -> Self {
        Self {
            spec: device.spec().clone(),
            device: Mutex::new(Some(device)),
        }
    }

    fn lock_device(&self) -> std::sync::MutexGuard<'_, Option<BoxedDevice>> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn check_axis(&self, axis: usize) -> PyResult<()> {
        let axis_count = self.spec.dof;
        if axis < axis_count {
            Ok(())
        } else {
            Err(plain_error(format!(
                "axis {axis} does not exist: the device has {axis_count}, counted from 0"
            )))
        }
    }

    fn signs(&self, py: Python<'_>, axes: &[usize], period: f64) -> PyResult<Vec<Result<f64, DirectionError>>> {
        for &axis in axes {
            self.check_axis(axis)?;
        }
        let test_pulse = TestPulse::from_spec(&self.spec);
        self.with_taken_device(py, |device, stop| {
            calibrate::find_directions(device, axes, test_pulse, period, stop)
        })?
        .map_err(plain_error)
    }

    pub(crate) fn with_taken_device<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut BoxedDevice, &AtomicBool) -> T + Send,
    ) -> PyResult<T> {
        // The lock is not held during the work: other callers meanwhile get the error that the device is closed.
        let taken_device = self.lock_device().take();
        let mut taken_device = taken_device.ok_or_else(|| plain_error("the device is closed"))?;
        let work_outcome = run_in_thread(py, |stop| (work(&mut taken_device, stop), taken_device));
        let (work_outcome, taken_device) = work_outcome?;
        *self.lock_device() = Some(taken_device);
        Ok(work_outcome)
    }
}

/// Timings that `check_timing` measured.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct Checkup {
    timing: TimingCheck,
    stats: WireStats,
}

#[pymethods]
impl Checkup {
    /// SCHED_FIFO priority that the thread got; None: no real-time priority.
    #[getter]
    fn priority(&self) -> Option<i32> {
        self.timing.granted.fifo_priority
    }

    /// Whether memory is locked in RAM.
    #[getter]
    fn locked(&self) -> bool {
        let GrantedScheduling {
            is_memory_locked: locked,
            ..
        } = self.timing.granted;
        locked
    }

    /// Duration of the measurement [s].
    #[getter]
    fn seconds(&self) -> f64 {
        self.timing.seconds
    }

    /// Lateness of each tick [s], (n_ticks,); empty in lockstep.
    fn lateness<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        seconds_array(py, &self.timing.lateness)
    }

    /// Time from each force to its reply [s], (n_replies,).
    fn round_trips<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        seconds_array(py, &self.timing.round_trips)
    }

    /// Forces without a reply within 20 ms.
    #[getter]
    fn unanswered(&self) -> u64 {
        self.timing.n_unanswered
    }

    /// Received bytes that belong to no packet.
    #[getter]
    fn garbage(&self) -> u64 {
        self.stats.garbage_bytes
    }

    /// How much faster the device's clock runs than the host's [1e-6].
    #[getter]
    fn drift_ppm(&self) -> Option<f64> {
        self.stats.drift_ppm
    }
}

impl Checkup {
    fn new(timing: TimingCheck, stats: WireStats) -> Self {
        Self { timing, stats }
    }
}

fn seconds_array<'py>(py: Python<'py>, nanoseconds: &[u32]) -> Bound<'py, PyArray1<f64>> {
    let seconds = nanoseconds.iter().map(|&ns| f64::from(ns) * 1e-9);
    PyArray1::from_iter(py, seconds)
}
