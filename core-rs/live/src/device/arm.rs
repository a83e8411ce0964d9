//! A rotary axis as a key: a hand holds it at an arm's length from the axis, so angles are ways along the arc, and
//! forces are torques over that length.

use std::time::Instant;

use super::{
    Device, DeviceError, DeviceLoss, DeviceSample, DeviceSpec, DeviceUrl, MAX_AXES, Unit, WireStats, ZeroForcePacket,
};
use crate::safety::SafeForce;

/// Longest arm [m]; with it a torque in N·m is not greater than the force in N.
const ARM_LENGTH_MAX: f64 = 1.0;

/// A device of rotary axes with an arm on each.
struct LeverDevice {
    device: Box<dyn Device>,
    length: f64,
    spec: DeviceSpec,
}

/// The device, with the arm that its address names.
///
/// # Errors
/// [`DeviceError`] for an arm on an axis that does not rotate, or one that is impossible.
pub(super) fn with_arm(device: Box<dyn Device>, url: &DeviceUrl) -> Result<Box<dyn Device>, DeviceError> {
    if url.option_text("arm").is_none() {
        return Ok(device);
    }
    let arm_length = url.option_number("arm", 0.0)?;
    if device.spec().unit != Unit::Radian {
        return Err(url.unsupported_error("its axes do not rotate, so they have no arm; leave ?arm out"));
    }
    if arm_length <= 0.0 || arm_length > ARM_LENGTH_MAX {
        return Err(url.open_error(format!(
            "arm must be above 0 and at most {ARM_LENGTH_MAX} m, not {arm_length}"
        )));
    }
    Ok(Box::new(LeverDevice::new(device, arm_length)))
}

impl LeverDevice {
    fn new(device: Box<dyn Device>, length: f64) -> Self {
        let axis_spec = device.spec();
        let spec = DeviceSpec {
            unit: Unit::Metre,
            pos_lsb: axis_spec.pos_lsb * length,
            pos_range: axis_spec.pos_range.map(|angle| angle * length),
            force_max_continuous: axis_spec.force_max_continuous / length,
            force_max_peak: axis_spec.force_max_peak / length,
            force_lsb: axis_spec.force_lsb / length,
            // A moment of inertia J about the axis is a mass of J/r² at the arm's end; so is its friction.
            inertia: axis_spec.inertia.map(|inertia| inertia / (length * length)),
            damping: axis_spec.damping.map(|damping| damping / (length * length)),
            ..axis_spec.clone()
        };
        Self { device, length, spec }
    }

    fn torque(&self, force: &SafeForce) -> SafeForce {
        force.with_gains(&[self.length; MAX_AXES])
    }
}

impl Device for LeverDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn range(&self, axis: usize) -> [f64; 2] {
        self.device.range(axis).map(|angle| angle * self.length)
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let torque = self.torque(force);
        self.device.send(&torque)
    }

    fn switch_off(&mut self) -> Result<(), DeviceLoss> {
        self.device.switch_off()
    }

    fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
        let torques = self.device.on_wire(&self.torque(force));
        torques.map(|torque| torque / self.length)
    }

    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        let is_fresh = self.device.receive(sample, deadline)?;
        for position in &mut sample.position {
            *position *= self.length;
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
