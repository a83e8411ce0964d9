//! The host's side: the driver of a device whose wire ends in a [`World`].

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::world::World;
use crate::device::haply::{self, ForceCommand};
use crate::device::{Device, Gone, InProcess, MAX_AXES, Sample, Spec};
use crate::safety::SafeForce;

/// The world, shared by the host and the wire of its driver.
#[derive(Clone)]
pub(super) struct Shared(Arc<Mutex<World>>);

impl Shared {
    pub(super) fn new(world: World) -> Self {
        Self(Arc::new(Mutex::new(world)))
    }

    pub(super) fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl InProcess for Shared {
    fn write(&mut self, packet: &[u8]) -> Result<(), Gone> {
        self.world().write(packet)
    }

    fn read(&mut self, into: &mut [u8]) -> Result<usize, Gone> {
        self.world().read(into)
    }
}

/// Defects of the device itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Defect {
    pub(super) wrong_way: bool,
    pub(super) frozen: bool,
    /// The motor keeps the force that it has, whatever is sent, until it is switched off.
    pub(super) motor_stuck: bool,
    /// The reported positions grow by this every tick [m], are this many times too great, and are off by this [m].
    pub(super) drift: f64,
    pub(super) scale: f64,
    pub(super) offset: f64,
    /// No position arrives at the host.
    pub(super) loses_positions: bool,
}

impl Defect {
    const NONE: Self = Self {
        wrong_way: false,
        frozen: false,
        motor_stuck: false,
        drift: 0.0,
        scale: 1.0,
        offset: 0.0,
        loses_positions: false,
    };
}

/// A device with its defects.
pub(super) struct Defective {
    pub(super) device: Box<dyn Device>,
    pub(super) defect: Defect,
    /// Set for a device in this process: its motor gives the force that is sent.
    pub(super) direct: Option<Shared>,
    /// Set for a test before a performance, which paces itself: every force sent is a tick of the host.
    pub(super) ticks: Option<Shared>,
    frozen_at: Option<[f64; MAX_AXES]>,
    last_force: SafeForce,
    spec: Spec,
}

impl Defective {
    pub(super) fn new(device: Box<dyn Device>, direct: Option<Shared>) -> Self {
        let spec = device.spec().clone();
        Self {
            last_force: SafeForce::zero(spec.dof),
            spec,
            device,
            defect: Defect::NONE,
            direct,
            ticks: None,
            frozen_at: None,
        }
    }

    /// Report only this part of the travel.
    pub(super) fn report_travel(&mut self, part: f64) {
        self.spec.pos_range = self.spec.pos_range.map(|end| part * end);
    }

    fn note_force(&mut self, force: f64) {
        if let Some(shared) = &self.direct {
            shared.world().motor.force = force;
        }
        if let Some(shared) = &self.ticks {
            shared.world().advance(super::PERIOD);
        }
    }
}

impl Device for Defective {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        let motor_gain = if self.defect.wrong_way { -1.0 } else { 1.0 };
        let mut force = force.with_gains(&[motor_gain; MAX_AXES]);
        if self.defect.motor_stuck {
            force = self.last_force;
        }
        self.last_force = force;
        self.device.send(&force)?;
        self.note_force(force.newtons()[0]);
        Ok(())
    }

    fn switch_off(&mut self) -> Result<(), Gone> {
        self.device.switch_off()?;
        self.note_force(0.0);
        Ok(())
    }

    fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        if self.defect.loses_positions {
            into.fresh = false;
            return Ok(false);
        }
        let is_fresh = self.device.receive(into, deadline)?;
        if self.defect.frozen {
            into.position = *self.frozen_at.get_or_insert(into.position);
        }
        let Defect {
            drift, scale, offset, ..
        } = &mut self.defect;
        *offset += *drift;
        for position in &mut into.position {
            *position = *scale * *position + *offset;
        }
        Ok(is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.device.in_lockstep() || self.ticks.is_some()
    }

    fn zero(&mut self) {
        self.device.zero();
        self.note_force(0.0);
    }
}

/// Haply's host side without its socket: orders go to the guardian of a world, and states come back.
pub(super) struct HaplyHost {
    shared: Shared,
    spec: Spec,
    number: u16,
    sample: Sample,
    new: bool,
}

impl HaplyHost {
    pub(super) fn new(shared: Shared) -> Self {
        Self {
            shared,
            spec: haply::spec(),
            number: u16::MAX,
            sample: Sample {
                touch: [true; MAX_AXES],
                force_enabled: [true; MAX_AXES],
                ..Sample::default()
            },
            new: true,
        }
    }

    fn order(&mut self, force: [f64; 3]) {
        self.number = self.number.wrapping_add(1);
        let number = self.number;
        self.shared.world().order(ForceCommand { number, force });
    }
}

impl Device for HaplyHost {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        let axis_force = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        self.order([axis_force(0), axis_force(1), axis_force(2)]);
        Ok(())
    }

    fn receive(&mut self, into: &mut Sample, _: Instant) -> Result<bool, Gone> {
        let newest_state = self.shared.world().state()?;
        let fresh = newest_state.is_some() || std::mem::take(&mut self.new);
        if let Some((state_number, position, let_go)) = newest_state {
            self.sample.position[..3].copy_from_slice(&position);
            (self.sample.seq, self.sample.let_go) = (u32::from(state_number), let_go);
        }
        *into = Sample { fresh, ..self.sample };
        Ok(fresh)
    }

    fn in_lockstep(&self) -> bool {
        false
    }

    fn zero(&mut self) {
        self.order([0.0; 3]);
    }
}
