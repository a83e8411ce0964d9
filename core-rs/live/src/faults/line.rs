//! The host's side: the driver of a device whose wire ends in a [`SimulatedWorld`].

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::world::SimulatedWorld;
use crate::device::haply::{self, ForceCommand};
use crate::device::{Device, DeviceLoss, DeviceSample, DeviceSpec, InProcessPort, MAX_AXES};
use crate::safety::SafeForce;

/// The world, shared by the host and the wire of its driver.
#[derive(Clone)]
pub(super) struct SharedWorld(Arc<Mutex<SimulatedWorld>>);

impl SharedWorld {
    pub(super) fn new(world: SimulatedWorld) -> Self {
        Self(Arc::new(Mutex::new(world)))
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, SimulatedWorld> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl InProcessPort for SharedWorld {
    fn write(&mut self, packet: &[u8]) -> Result<(), DeviceLoss> {
        self.lock().write(packet)
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, DeviceLoss> {
        self.lock().read(buffer)
    }
}

/// Defects of the device itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeviceDefects {
    pub(super) is_reversed: bool,
    pub(super) is_frozen: bool,
    /// The motor keeps the force that it has, whatever is sent, until it is switched off.
    pub(super) is_motor_stuck: bool,
    /// The reported positions grow by this every tick [m], are this many times too great, and are off by this [m].
    pub(super) position_drift: f64,
    pub(super) position_scale: f64,
    pub(super) position_offset: f64,
    /// No position arrives at the host.
    pub(super) loses_positions: bool,
}

impl DeviceDefects {
    const NONE: Self = Self {
        is_reversed: false,
        is_frozen: false,
        is_motor_stuck: false,
        position_drift: 0.0,
        position_scale: 1.0,
        position_offset: 0.0,
        loses_positions: false,
    };
}

/// A device with its defects.
pub(super) struct DefectiveDevice {
    pub(super) device: Box<dyn Device>,
    pub(super) defects: DeviceDefects,
    /// Set for a device in this process: its motor gives the force that is sent.
    pub(super) motor_world: Option<SharedWorld>,
    /// Set for a test before a performance, which paces itself: every force sent is a tick of the host.
    pub(super) tick_world: Option<SharedWorld>,
    frozen_position: Option<[f64; MAX_AXES]>,
    last_force: SafeForce,
    spec: DeviceSpec,
}

impl DefectiveDevice {
    pub(super) fn new(device: Box<dyn Device>, motor_world: Option<SharedWorld>) -> Self {
        let spec = device.spec().clone();
        Self {
            last_force: SafeForce::zero(spec.dof),
            spec,
            device,
            defects: DeviceDefects::NONE,
            motor_world,
            tick_world: None,
            frozen_position: None,
        }
    }

    /// Report only this part of the travel.
    pub(super) fn report_travel(&mut self, share: f64) {
        self.spec.pos_range = self.spec.pos_range.map(|end| share * end);
    }

    fn apply_force(&mut self, force: f64) {
        if let Some(world) = &self.motor_world {
            world.lock().motor.force = force;
        }
        if let Some(world) = &self.tick_world {
            world.lock().advance(super::PERIOD);
        }
    }
}

impl Device for DefectiveDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let motor_gain = if self.defects.is_reversed { -1.0 } else { 1.0 };
        let mut force = force.with_gains(&[motor_gain; MAX_AXES]);
        if self.defects.is_motor_stuck {
            force = self.last_force;
        }
        self.last_force = force;
        self.device.send(&force)?;
        self.apply_force(force.newtons()[0]);
        Ok(())
    }

    fn switch_off(&mut self) -> Result<(), DeviceLoss> {
        self.device.switch_off()?;
        self.apply_force(0.0);
        Ok(())
    }

    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        if self.defects.loses_positions {
            sample.is_fresh = false;
            return Ok(false);
        }
        let is_fresh = self.device.receive(sample, deadline)?;
        if self.defects.is_frozen {
            sample.position = *self.frozen_position.get_or_insert(sample.position);
        }
        let DeviceDefects {
            position_drift: drift,
            position_scale: scale,
            position_offset: offset,
            ..
        } = &mut self.defects;
        *offset += *drift;
        for position in &mut sample.position {
            *position = *scale * *position + *offset;
        }
        Ok(is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.device.in_lockstep() || self.tick_world.is_some()
    }

    fn zero(&mut self) {
        self.device.zero();
        self.apply_force(0.0);
    }
}

/// Haply's host side without its socket: orders go to the guardian of a world, and states come back.
pub(super) struct HaplyHost {
    world: SharedWorld,
    spec: DeviceSpec,
    last_number: u16,
    sample: DeviceSample,
    is_first_receive: bool,
}

impl HaplyHost {
    pub(super) fn new(world: SharedWorld) -> Self {
        Self {
            world,
            spec: haply::spec(),
            last_number: u16::MAX,
            sample: DeviceSample {
                is_touched: [true; MAX_AXES],
                is_force_enabled: [true; MAX_AXES],
                ..DeviceSample::default()
            },
            is_first_receive: true,
        }
    }

    fn order(&mut self, force: [f64; 3]) {
        self.last_number = self.last_number.wrapping_add(1);
        let number = self.last_number;
        self.world.lock().pass_order(ForceCommand { number, force });
    }
}

impl Device for HaplyHost {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let axis_force = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        self.order([axis_force(0), axis_force(1), axis_force(2)]);
        Ok(())
    }

    fn receive(&mut self, sample: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        let newest_state = self.world.lock().take_state()?;
        let is_fresh = newest_state.is_some() || std::mem::take(&mut self.is_first_receive);
        if let Some((state_number, position, let_go)) = newest_state {
            self.sample.position[..3].copy_from_slice(&position);
            (self.sample.seq, self.sample.has_let_go) = (u32::from(state_number), let_go);
        }
        *sample = DeviceSample {
            is_fresh,
            ..self.sample
        };
        Ok(is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        false
    }

    fn zero(&mut self) {
        self.order([0.0; 3]);
    }
}
