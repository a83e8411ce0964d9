//! A key, a hand and a piece in virtual time, for tests of plausibility.

use std::time::Instant;

use crate::safety::contract::{Device, Gone, Sample, Spec, Unit};
use crate::safety::{Guarded, Limits, SafeForce, Trip};
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
pub(super) const HAND: Grip = Grip {
    k: 400.0,
    z: 4.0,
    position: |_| 0.0,
};

/// A board of one key: 50 g, 1 N·s/m, 20 N, 50 mm to either side.
pub(super) struct Key {
    spec: Spec,
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

impl Key {
    pub(super) fn new(resolution: f64, force_max: f64, inertia: Option<f64>) -> Self {
        Self {
            spec: Spec {
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
                touch_gated: false,
                can_lockstep: true,
                can_wide: true,
            },
            x: 0.0,
            v: 0.0,
            time: 0.0,
            sensor_reading: 0.0,
            grip: Some(HAND),
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

impl Device for Key {
    fn spec(&self) -> &Spec {
        &self.spec
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        self.advance(force.newtons()[0]);
        Ok(())
    }
    fn receive(&mut self, into: &mut Sample, _: Instant) -> Result<bool, Gone> {
        into.position = [self.sensor_reading; MAX_AXES];
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
pub(super) struct Play {
    pub(super) guarded: Guarded<Key>,
    pub(super) piece_force: PieceForce,
    position_before: f64,
    sample: Sample,
    /// Trips so far, each with its time.
    pub(super) trips: Vec<(f64, Trip)>,
    /// What was sent last [N].
    pub(super) sent: f64,
}

impl Play {
    pub(super) fn new(key: Key, piece_force: PieceForce) -> Self {
        let key_limits = Limits::from_spec(key.spec());
        Self {
            guarded: Guarded::new(key, key_limits, PERIOD).watched(),
            piece_force,
            position_before: 0.0,
            sample: Sample::default(),
            trips: Vec::new(),
            sent: 0.0,
        }
    }

    pub(super) fn key(&mut self) -> &mut Key {
        &mut self.guarded.device
    }

    pub(super) fn time(&self) -> f64 {
        self.guarded.device.time
    }

    pub(super) fn probes(&self) -> u64 {
        self.guarded.watched.as_ref().unwrap().axes[0].probes()
    }

    pub(super) fn tick(&mut self) {
        self.guarded.receive(&mut self.sample, Instant::now()).unwrap();
        let key_position = self.sample.position[0];
        let key_velocity = (key_position - self.position_before) / PERIOD;
        self.position_before = key_position;
        let asked_force = (self.piece_force)(self.time(), key_position, key_velocity);
        let trip_before = self.guarded.tripped(0);
        self.sent = self.guarded.send(&[asked_force]).unwrap().newtons()[0];
        if let Some(trip_cause) = self.guarded.tripped(0).filter(|_| trip_before.is_none()) {
            self.trips.push((self.time(), trip_cause));
        }
    }

    pub(super) fn run_until(&mut self, time: f64) {
        while self.time() < time {
            self.tick();
        }
    }
}
