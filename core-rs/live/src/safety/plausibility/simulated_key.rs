//! A key, a hand and a piece in virtual time, for tests of plausibility.

use std::time::Instant;

use crate::safety::contract::{Device, DeviceLoss, DeviceSample, DeviceSpec, Unit};
use crate::safety::{GuardedDevice, SafeForce, SafetyLimits, TripCause};
use crate::wire::MAX_AXES;

pub(super) const PERIOD: f64 = 1e-3;
const SUBSTEPS: usize = 8;

/// A hand that holds a key by a spring and a damper.
#[derive(Clone, Copy)]
pub(super) struct Grip {
    /// [N/m]
    pub(super) k: f64,
    /// [N·s/m]
    pub(super) z: f64,
    /// Position of the hand at an instant [m].
    pub(super) position: fn(f64) -> f64,
}

/// The hand of `tests/support/simulated_board.py`.
pub(super) const TEST_HAND: Grip = Grip {
    k: 400.0,
    z: 4.0,
    position: |_| 0.0,
};

/// A board of one key: 50 g, 1 N·s/m, 20 N, 50 mm to either side.
pub(super) struct SimulatedKey {
    spec: DeviceSpec,
    pub(super) x: f64,
    pub(super) v: f64,
    pub(super) time: f64,
    sensor_reading: f64,
    pub(super) grip: Option<Grip>,
    /// 1, or -1: wired the other way.
    pub(super) motor_sign: f64,
    pub(super) frozen: bool,
    /// Dry friction [N].
    pub(super) friction: f64,
    /// [kg]
    pub(super) mass: f64,
}

impl SimulatedKey {
    pub(super) fn new(resolution: f64, force_max: f64, inertia: Option<f64>) -> Self {
        Self {
            spec: DeviceSpec {
                dof: 1,
                unit: Unit::Metre,
                pos_lsb: resolution,
                pos_range: [-0.05, 0.05],
                force_max_continuous: force_max,
                force_max_peak: force_max,
                force_lsb: 0.0,
                rate_nominal: None,
                loop_delay_s: None,
                inertia,
                damping: Some(1.0),
                is_touch_gated: false,
                can_lockstep: true,
                can_send_wide: true,
            },
            x: 0.0,
            v: 0.0,
            time: 0.0,
            sensor_reading: 0.0,
            grip: Some(TEST_HAND),
            motor_sign: 1.0,
            frozen: false,
            friction: 0.0,
            mass: 0.05,
        }
    }

    fn advance(&mut self, force: f64) {
        let (m, b, substep) = (self.mass, 1.0, PERIOD / SUBSTEPS as f64);
        for _ in 0..SUBSTEPS {
            let grip_force = self.grip.map_or(0.0, |grip| {
                let (hand_position, hand_before) = ((grip.position)(self.time), (grip.position)(self.time - substep));
                grip.k * (hand_position - self.x) + grip.z * ((hand_position - hand_before) / substep - self.v)
            });
            let net_force = force * self.motor_sign + grip_force - b * self.v;
            // Dry friction holds the key up to its level.
            let new_velocity = self.v + net_force / m * substep;
            let friction_limit = self.friction / m * substep;
            self.v = if new_velocity.abs() <= friction_limit {
                0.0
            } else {
                new_velocity - friction_limit.copysign(new_velocity)
            };
            self.x += self.v * substep;
            if self.x.abs() > 0.05 {
                (self.x, self.v) = (0.05_f64.copysign(self.x), 0.0);
            }
            self.time += substep;
        }
        if !self.frozen {
            let sensor_step = self.spec.pos_lsb;
            self.sensor_reading = (self.x / sensor_step).round() * sensor_step;
        }
    }
}

impl Device for SimulatedKey {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.advance(force.newtons()[0]);
        Ok(())
    }
    fn receive(&mut self, sample: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        sample.position = [self.sensor_reading; MAX_AXES];
        Ok(true)
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {}
}

/// The force [N] that a piece asks for, at a time, position and velocity of the key.
pub(super) type PieceForce = fn(f64, f64, f64) -> f64;

/// A key that is played by a hand and a piece.
pub(super) struct PlayedKey {
    pub(super) guarded_device: GuardedDevice<SimulatedKey>,
    pub(super) piece_force: PieceForce,
    position_before: f64,
    sample: DeviceSample,
    /// Trips so far, each with its time.
    pub(super) trips: Vec<(f64, TripCause)>,
    /// What was sent last [N].
    pub(super) sent_force: f64,
}

impl PlayedKey {
    pub(super) fn new(key: SimulatedKey, piece_force: PieceForce) -> Self {
        let key_limits = SafetyLimits::from_spec(key.spec());
        Self {
            guarded_device: GuardedDevice::new(key, key_limits, PERIOD).with_plausibility(),
            piece_force,
            position_before: 0.0,
            sample: DeviceSample::default(),
            trips: Vec::new(),
            sent_force: 0.0,
        }
    }

    pub(super) fn key(&mut self) -> &mut SimulatedKey {
        &mut self.guarded_device.device
    }

    pub(super) fn time(&self) -> f64 {
        self.guarded_device.device.time
    }

    pub(super) fn probes(&self) -> u64 {
        self.guarded_device.plausibility.as_ref().unwrap().axes[0].probes()
    }

    pub(super) fn tick(&mut self) {
        self.guarded_device.receive(&mut self.sample, Instant::now()).unwrap();
        let key_position = self.sample.position[0];
        let key_velocity = (key_position - self.position_before) / PERIOD;
        self.position_before = key_position;
        let asked_force = (self.piece_force)(self.time(), key_position, key_velocity);
        let trip_before = self.guarded_device.trip_cause(0);
        self.sent_force = self.guarded_device.send(&[asked_force]).unwrap().newtons()[0];
        if let Some(trip_cause) = self.guarded_device.trip_cause(0).filter(|_| trip_before.is_none()) {
            self.trips.push((self.time(), trip_cause));
        }
    }

    pub(super) fn run_until(&mut self, time: f64) {
        while self.time() < time {
            self.tick();
        }
    }
}
