//! Calibration: how one device differs from the specification of its kind. It is measured once, kept as plain data, and
//! applied to every exchange.
//!
//! A common fault is a motor with reversed polarity: every force then pushes the key further away. Therefore
//! [`find_directions`] are measured before a device plays for the first time.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::{Device, DeviceLoss, DeviceSample, DeviceSpec, MAX_AXES, WireStats, ZeroForcePacket};
use crate::safety::{GuardedDevice, SafeForce, SafetyLimits};

/// The calibration of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisCalibration {
    /// 1 if a positive force moves the axis towards positive positions as the device reports them; -1 if not.
    pub sign: f64,
    /// The reported position that is mapped to 0.
    pub offset: f64,
    /// Factor from reported to true metres; negative if the axis is reversed.
    pub gain: f64,
    /// Least and greatest true position [m or rad].
    pub range: [f64; 2],
    /// Greatest force [N or N·m].
    pub force_max: f64,
}

impl AxisCalibration {
    /// An axis without corrections.
    pub fn without_corrections(spec: &DeviceSpec) -> Self {
        Self {
            sign: 1.0,
            offset: 0.0,
            gain: 1.0,
            range: spec.pos_range,
            force_max: spec.force_max_peak,
        }
    }

    /// The axis with its ends at the reported positions `ends`, `distance` [m] from each other, and its zero in the
    /// middle.
    #[must_use]
    pub fn from_ends(self, ends: [f64; 2], distance: f64) -> Self {
        Self {
            offset: 0.5 * (ends[0] + ends[1]),
            gain: distance / (ends[1] - ends[0]),
            range: [-0.5 * distance.abs(), 0.5 * distance.abs()],
            ..self
        }
    }

    fn position(&self, reported_position: f64) -> f64 {
        (reported_position - self.offset) * self.gain
    }
}

/// A device with calibrated axes.
pub struct CalibratedDevice<D> {
    device: D,
    axes: Vec<AxisCalibration>,
    spec: DeviceSpec,
    signs: [f64; MAX_AXES],
}

impl<D: Device> CalibratedDevice<D> {
    /// Apply `axes`; axes beyond them are not corrected.
    pub fn new(device: D, mut axes: Vec<AxisCalibration>) -> Self {
        let mut spec = device.spec().clone();
        axes.resize(spec.dof.min(MAX_AXES), AxisCalibration::without_corrections(&spec));
        let mut signs = [1.0; MAX_AXES];
        for (sign, axis) in signs.iter_mut().zip(&axes) {
            *sign = axis.sign.signum() * axis.gain.signum();
        }
        let least_limit =
            |axis_limit: fn(&AxisCalibration) -> f64| axes.iter().map(axis_limit).fold(f64::INFINITY, f64::min);
        spec.force_max_peak = spec.force_max_peak.min(least_limit(|axis| axis.force_max.abs()));
        spec.force_max_continuous = spec.force_max_continuous.min(spec.force_max_peak);
        spec.pos_range = [least_limit(|axis| axis.range[0]), -least_limit(|axis| -axis.range[1])];
        Self {
            device,
            axes,
            spec,
            signs,
        }
    }
}

/// The device, with the calibrations of some of its axes, each with the number of the axis.
pub fn with_calibration(device: Box<dyn Device>, calibrations: &[(usize, AxisCalibration)]) -> Box<dyn Device> {
    if calibrations.is_empty() {
        return device;
    }
    let mut all_axes = vec![AxisCalibration::without_corrections(device.spec()); device.spec().dof];
    for &(number, axis) in calibrations {
        if let Some(axis_slot) = all_axes.get_mut(number) {
            *axis_slot = axis;
        }
    }
    Box::new(CalibratedDevice::new(device, all_axes))
}

impl<D: Device> Device for CalibratedDevice<D> {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn range(&self, axis: usize) -> [f64; 2] {
        self.axes.get(axis).map_or(self.spec.pos_range, |axis| axis.range)
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.device.send(&force.with_gains(&self.signs))
    }

    fn switch_off(&mut self) -> Result<(), DeviceLoss> {
        self.device.switch_off()
    }

    fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
        let mut wire_forces = self.device.on_wire(&force.with_gains(&self.signs));
        for (force, sign) in wire_forces.iter_mut().zip(&self.signs) {
            *force *= sign;
        }
        wire_forces
    }

    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        let is_fresh = self.device.receive(sample, deadline)?;
        for (position, axis) in sample.position.iter_mut().zip(&self.axes) {
            *position = axis.position(*position);
        }
        Ok(is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.device.in_lockstep()
    }

    fn zero(&mut self) {
        self.device.zero();
    }

    fn stats(&self) -> WireStats {
        self.device.stats()
    }

    fn zero_force_packet(&self) -> Option<ZeroForcePacket> {
        self.device.zero_force_packet()
    }
}

/// A small push to one side and to the other. The force grows from zero, so that static friction is overcome gently.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestPulse {
    /// Force at the end of the push [N or N·m].
    pub force: f64,
    /// Greatest length of the push, and least length of the rest after it [s].
    pub duration_max: f64,
    /// The push ends as soon as the axis has moved this far [m or rad].
    pub stop_distance: f64,
}

impl TestPulse {
    /// A fifth of the greatest force for at most an eighth of a second, until the axis has moved by ten steps of the
    /// sensor or a hundredth of its range, whichever is longer.
    pub fn from_spec(spec: &DeviceSpec) -> Self {
        let travel_range = spec.pos_range[1] - spec.pos_range[0];
        Self {
            force: 0.2 * spec.force_max_peak,
            duration_max: 0.125,
            stop_distance: (10.0 * spec.pos_lsb).max(0.01 * travel_range),
        }
    }
}

/// Why a direction could not be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DirectionError {
    /// The axis did not move.
    #[error("the axis did not move: check the power of its motor, and touch the key without holding it")]
    NoMotion,
    /// The axis moved the same way both times.
    #[error("the axis moved the same way for both directions of the force: do not hold the key")]
    SameDirection,
}

/// The directions in which positive forces move `axes`: 1 or -1 each, for [`AxisCalibration::sign`]. All axes are
/// pushed at the same time, so that they take no longer than one. Exchanges every `period` [s]; once `stop` is set, the
/// device counts as closed.
///
/// # Errors
/// [`DeviceLoss`] when the device goes away; for an axis [`DirectionError`] if it does not move both ways.
pub fn find_directions<D: Device>(
    device: &mut D,
    axes: &[usize],
    pulse: TestPulse,
    period: f64,
    stop: &AtomicBool,
) -> Result<Vec<Result<f64, DirectionError>>, DeviceLoss> {
    let limits = SafetyLimits {
        force_max: pulse.force,
        ramp_time: 0.0,
        ..SafetyLimits::from_spec(device.spec())
    };
    let least_motion = 3.0 * device.spec().pos_lsb;
    let mut tick_loop = TickLoop::new(GuardedDevice::new(device, limits, period), period, stop);
    tick_loop.wait_for_rest(axes, pulse.duration_max)?;
    let mut displacement = [[0.0; MAX_AXES]; 2];
    for (displacement, side) in displacement.iter_mut().zip([1.0, -1.0]) {
        let start_position = tick_loop.sample.position;
        let tick_count = tick_loop.tick_count(pulse.duration_max);
        let mut is_pushed = [false; MAX_AXES];
        axes.iter().for_each(|&axis| is_pushed[axis] = true);
        for tick in 1..=tick_count {
            let ramp_force = side * pulse.force * (tick as f64 / tick_count as f64);
            tick_loop.tick(&is_pushed.map(|is_pushed| if is_pushed { ramp_force } else { 0.0 }))?;
            for &axis in axes.iter().filter(|&&axis| is_pushed[axis]) {
                displacement[axis] = tick_loop.sample.position[axis] - start_position[axis];
            }
            for (is_pushed, displacement) in is_pushed.iter_mut().zip(&*displacement) {
                *is_pushed &= displacement.abs() < pulse.stop_distance;
            }
            if is_pushed == [false; MAX_AXES] {
                break;
            }
        }
        tick_loop.wait_for_rest(axes, pulse.duration_max)?;
    }
    let axis_sign = |&axis: &usize| {
        let [forward, backward] = displacement.map(|displacement| displacement[axis]);
        if forward.abs() <= least_motion || backward.abs() <= least_motion {
            return Err(DirectionError::NoMotion);
        }
        if forward * backward > 0.0 {
            return Err(DirectionError::SameDirection);
        }
        Ok(forward.signum())
    };
    Ok(axes.iter().map(axis_sign).collect())
}

/// Least and greatest position of every axis during `length` [s], while a player moves it and no force acts.
///
/// # Errors
/// [`DeviceLoss`] when the device goes away.
pub fn travel_ends<D: Device>(
    device: &mut D,
    length: f64,
    period: f64,
    stop: &AtomicBool,
) -> Result<[[f64; 2]; MAX_AXES], DeviceLoss> {
    let limits = SafetyLimits::from_spec(device.spec());
    let mut tick_loop = TickLoop::new(GuardedDevice::new(device, limits, period), period, stop);
    let mut axis_ends = [[f64::INFINITY, f64::NEG_INFINITY]; MAX_AXES];
    for _ in 0..tick_loop.tick_count(length).max(1) {
        tick_loop.tick(&[0.0; MAX_AXES])?;
        for (axis_ends, x) in axis_ends.iter_mut().zip(tick_loop.sample.position) {
            *axis_ends = [axis_ends[0].min(x), axis_ends[1].max(x)];
        }
    }
    Ok(axis_ends)
}

/// Exchanges with the device at regular times.
struct TickLoop<'a, D: Device> {
    guarded_device: GuardedDevice<D>,
    period: f64,
    next_tick: Instant,
    sample: DeviceSample,
    stop: &'a AtomicBool,
}

impl<'a, D: Device> TickLoop<'a, D> {
    fn new(guarded_device: GuardedDevice<D>, period: f64, stop: &'a AtomicBool) -> Self {
        Self {
            guarded_device,
            period,
            next_tick: Instant::now(),
            sample: DeviceSample::default(),
            stop,
        }
    }

    fn tick_count(&self, length: f64) -> usize {
        (length / self.period).ceil() as usize
    }

    fn tick(&mut self, forces: &[f64; MAX_AXES]) -> Result<(), DeviceLoss> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(DeviceLoss::Closed);
        }
        self.guarded_device.send(forces)?;
        self.next_tick += Duration::from_secs_f64(self.period);
        self.guarded_device.receive(&mut self.sample, self.next_tick)?;
        // A device in lockstep answers at once and needs no waiting.
        if !self.guarded_device.in_lockstep() {
            crate::realtime::sleep_until(self.next_tick);
        }
        Ok(())
    }

    /// Send no force until the axes stand still, for at least `length` [s] and at most eight times that.
    fn wait_for_rest(&mut self, axes: &[usize], length: f64) -> Result<(), DeviceLoss> {
        let still_limit = self.guarded_device.spec().pos_lsb.max(1e-6);
        for _ in 0..8 {
            let start_position = self.sample.position;
            for _ in 0..self.tick_count(length) {
                self.tick(&[0.0; MAX_AXES])?;
            }
            let position = self.sample.position;
            if (axes.iter()).all(|&axis| (position[axis] - start_position[axis]).abs() <= still_limit) {
                break;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
