//! Emulated keys in this process: a device without a wire, always in lockstep.

use std::time::{Duration, Instant};

use super::{Device, DeviceError, Gone, InProcess, Kind, Sample, Spec, Stats, Unit, Url};
use crate::device::MAX_AXES;
use crate::emulate::{Firmware, Hand, Key, Keys, Options};
use crate::safety::SafeForce;

/// Rate of a tick of 44 samples at 44.1 kHz [Hz].
const RATE: f64 = 44_100.0 / 44.0;
/// Greatest force [N].
const FORCE_MAX: f64 = 20.0;

/// What keys without a wire are capable of: exact positions and forces, at `rate` ticks a second [Hz], of a key of a
/// mass
/// [kg] and a damping [N·s/m].
pub(super) fn exact_spec((dof, rate): (usize, f64), pos_range: [f64; 2], (mass, damping): (f64, f64)) -> Spec {
    Spec {
        dof,
        unit: Unit::Metre,
        pos_lsb: 0.0,
        pos_range,
        force_max_continuous: FORCE_MAX,
        force_max_peak: FORCE_MAX,
        force_lsb: 0.0,
        rate_nominal: Some(rate),
        loop_delay_s: Some(0.0),
        inertia: Some(mass),
        damping: Some(damping),
        touch_gated: false,
        can_lockstep: true,
        can_wide: true,
    }
}

/// Keys that advance by one step for every force sent.
pub struct Emulated {
    keys: Keys,
    spec: Spec,
    stats: Stats,
    answered: bool,
}

impl Emulated {
    pub(super) fn open(url: &Url) -> Result<Self, DeviceError> {
        let default_key = Key::default();
        let key_model = Key {
            mass: url.number("mass", default_key.mass)?,
            stiffness: url.number("stiffness", default_key.stiffness)?,
            damping: url.number("damping", default_key.damping)?,
            ..default_key
        };
        let (axis_count, key_rate) = (url.number("axes", 1.0)? as usize, url.number("rate", RATE)?);
        let resting_hands = vec![Hand::Resting; axis_count.min(MAX_AXES)];
        let emulated_keys =
            Keys::new(axis_count, key_model, key_rate, resting_hands).map_err(|error| url.closed(error))?;
        Ok(Self::new(emulated_keys, key_model))
    }

    /// Keys with the hands that are on them.
    pub fn new(keys: Keys, key: Key) -> Self {
        let spec = exact_spec((keys.n(), keys.rate().hertz()), key.range, (key.mass, key.damping));
        Self {
            keys,
            spec,
            stats: Stats::default(),
            answered: false,
        }
    }

    /// The keys.
    pub fn keys(&self) -> &Keys {
        &self.keys
    }
}

/// The driver of a board that is emulated inside this process, in lockstep. After `options.seconds` the board is gone.
///
/// # Errors
/// [`DeviceError`] if the options are impossible, or if this kind cannot be emulated inside the process.
pub fn open_board(options: &Options) -> Result<Box<dyn Device>, DeviceError> {
    let device_kind = Kind::from(options.board.protocol);
    let board_url = Url::in_process(device_kind);
    let firmware = options.firmware().map_err(|error| board_url.closed(error))?;
    let local_board = BoardHere {
        periods: options
            .seconds
            .map(|seconds| (seconds * firmware.keys().rate().hertz()) as u64),
        firmware,
        replies: Vec::new(),
    };
    super::open_in_process(device_kind, Box::new(local_board), true)
}

/// An emulated board, and its replies that were not read yet.
struct BoardHere {
    firmware: Firmware,
    /// Number of periods after which the board is gone.
    periods: Option<u64>,
    replies: Vec<u8>,
}

impl InProcess for BoardHere {
    fn write(&mut self, packet: &[u8]) -> Result<(), Gone> {
        if self
            .periods
            .is_some_and(|periods| self.firmware.keys().periods() >= periods)
        {
            return Err(Gone::Closed);
        }
        let Self { firmware, replies, .. } = self;
        firmware.receive(packet, Duration::ZERO, &mut |reply| replies.extend(reply));
        Ok(())
    }

    fn read(&mut self, into: &mut [u8]) -> Result<usize, Gone> {
        let byte_count = self.replies.len().min(into.len());
        into[..byte_count].copy_from_slice(&self.replies[..byte_count]);
        self.replies.drain(..byte_count);
        Ok(byte_count)
    }
}

impl Device for Emulated {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        let mut forces = [0.0; MAX_AXES];
        forces[..force.newtons().len()].copy_from_slice(force.newtons());
        self.keys.step(&forces);
        self.stats.packets_sent += 1;
        self.answered = false;
        Ok(())
    }

    fn receive(&mut self, into: &mut Sample, _: Instant) -> Result<bool, Gone> {
        into.fresh = !self.answered;
        self.stats.replies_received += u64::from(into.fresh);
        self.answered = true;
        into.position = *self.keys.positions();
        for axis in 0..self.keys.n() {
            into.touch[axis] = self.keys.touched(axis);
            into.force_enabled[axis] = true;
        }
        (into.hot, into.let_go) = (false, false);
        into.seq = self.keys.periods() as u32;
        into.t_dev_us = Some(self.keys.t_us());
        Ok(into.fresh)
    }

    fn in_lockstep(&self) -> bool {
        true
    }

    /// The keys advance only when a force is sent, so there is no force to end.
    fn zero(&mut self) {}

    fn stats(&self) -> Stats {
        self.stats
    }
}
