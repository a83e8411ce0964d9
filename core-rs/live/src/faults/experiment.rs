//! One fault on one device: a hand holds a key, a piece guides it, the fault begins, and the motor is watched.

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use super::line::{Defect, Defective, HaplyHost, Shared};
use super::world::{Trouble, World};
use super::{BOARD_STALL, Emulator, Fault, HOST_STALL, Measurement, Outcome, PERIOD};
use crate::device::calibrate::{Pulse, directions};
use crate::device::{self, Device, DeviceError, Emulated, Gone, Sample, Spec};
use crate::emulate::{BoardConfig, Firmware, Hand, Key, Keys, Protocol};
use crate::safety::{Guarded, Limits};
use crate::wire::firefader;

/// Rate of the board [Hz].
const RATE: f64 = 8000.0;
/// Beginning of the fault: forces have risen, and the piece pulls hardest.
const ONSET: Duration = Duration::from_millis(3250);
/// How long the motor is watched from then on.
const WATCH_TIME: Duration = Duration::from_secs(2);
/// How long the piece asks for 1e300 N.
const HUGE_LASTS: Duration = Duration::from_millis(500);
/// Time of the board's own watchdog.
const WATCHDOG: Duration = Duration::from_millis(50);
/// A watchdog time that never passes: Haply's service is not known to have a watchdog, so none is emulated.
const NEVER: Duration = Duration::from_secs(3600);
/// A motor with less force is weak [N].
const WEAK_FORCE: f64 = 5.0;
/// The hand that holds the key [N/m, N·s/m].
const HAND: [f64; 2] = [400.0, 4.0];
/// Drift of a sensor [m in a tick]: 0.5 m/s.
const DRIFT: f64 = 5e-4;
/// Part of its travel that a device reports, if that is the fault: the guide does not leave it, the greatest force
/// does. A weak motor moves the key less.
const REPORTED_TRAVEL: f64 = 0.08;
const REPORTED_TRAVEL_WEAK: f64 = 0.04;
/// Amplitude and rate of the path along which a written part drives the key [m, Hz].
#[cfg(test)]
const DRIVEN_SWING: f64 = 6e-3;
#[cfg(test)]
const DRIVEN_RATE: f64 = 3.0;
/// Amplitude with which the piece leads the key to and fro, once a second [m].
const SWING: f64 = 6e-3;

/// The force that a piece asks for.
#[derive(Clone, Copy)]
pub(super) enum Ask {
    /// A spring that holds the key at 0 [N/m].
    #[cfg(test)]
    Wall(f64),
    /// A spring towards a point that moves to and fro.
    Guide,
    /// The force of a written part that drives the key along a path, by its measured model, and a weak spring.
    #[cfg(test)]
    Drive,
    Force(f64),
}

pub(super) struct Host {
    guarded: Guarded<Defective>,
    pub(super) shared: Shared,
    sample: Sample,
    /// The piece's spring [N/m].
    stiffness: f64,
    pub(super) ask: Ask,
}

impl Host {
    pub(super) fn new(device: Defective, shared: Shared) -> Self {
        let limits = Limits::from_spec(device.spec());
        let lockstep = device.in_lockstep();
        let guarded = Guarded::new(device, limits, PERIOD.as_secs_f64()).watched();
        let guarded = if lockstep {
            guarded
        } else {
            guarded.by_clock(shared.world().clock())
        };
        let is_weak = guarded.spec().force_max_peak < WEAK_FORCE;
        Self {
            guarded,
            shared,
            sample: Sample::default(),
            stiffness: if is_weak { 150.0 } else { 500.0 },
            ask: Ask::Guide,
        }
    }

    fn tick(&mut self) -> Result<(), Gone> {
        self.shared.world().advance(PERIOD);
        self.guarded.receive(&mut self.sample, Instant::now())?;
        let asked_force = match self.ask {
            Ask::Guide => {
                let seconds = self.shared.world().now().as_secs_f64();
                self.stiffness * (SWING * wave(seconds) - self.sample.position[0])
            }
            #[cfg(test)]
            Ask::Drive => {
                let seconds = self.shared.world().now().as_secs_f64();
                written_force(seconds, self.sample.position[0])
            }
            Ask::Force(asked_force) => asked_force,
            #[cfg(test)]
            Ask::Wall(stiffness) => -stiffness * self.sample.position[0],
        };
        self.guarded.send(&[asked_force]).map(drop)
    }

    pub(super) fn run(&mut self, time: Duration) -> Result<(), Gone> {
        let end_time = self.shared.world().now() + time;
        while self.shared.world().now() < end_time {
            self.tick()?;
        }
        Ok(())
    }
}

/// A wave between 1 and -1 with a period of a second, made of two parabolas.
fn wave(seconds: f64) -> f64 {
    let phase = 2.0 * (seconds - seconds.floor()) - 1.0;
    -4.0 * phase * (1.0 - phase.abs())
}

/// The force that drives the emulated key along its path, and the spring that brings it back if it is at `x` [m].
#[cfg(test)]
pub(super) fn written_force(seconds: f64, x: f64) -> f64 {
    const STEP: f64 = 1e-3;
    let driven_key = Key::default();
    let [place_before, place_now, place_after] =
        [-STEP, 0.0, STEP].map(|by| DRIVEN_SWING * wave(DRIVEN_RATE * (seconds + by)));
    let acceleration = (place_after - 2.0 * place_now + place_before) / (STEP * STEP);
    let swing_speed = (place_after - place_before) / (2.0 * STEP);
    let return_rate = std::f64::consts::TAU;
    driven_key.mass * (acceleration + return_rate * return_rate * (place_now - x)) + driven_key.damping * swing_speed
}

/// Make a fault on a device while a piece asks for forces on a key that a hand holds or nobody, and measure its effect.
pub(super) fn measure(ask: Ask, is_held: bool, fault: Fault, emulator: Emulator) -> Result<Measurement, DeviceError> {
    let measurement = |outcome, greatest, force_rises| Measurement {
        fault,
        emulator,
        outcome,
        bound: fault.bound(emulator),
        greatest,
        rise: force_rises,
        work: 0.0,
    };
    if let Some(exclusion) = fault.excluded(emulator) {
        return Ok(measurement(Outcome::Excluded(exclusion), [0.0; 2], [0.0; 2]));
    }
    let (mut device, shared) = if is_held {
        held_device(emulator, hands)?
    } else {
        held_device(emulator, |axes| vec![Hand::Resting; axes])?
    };
    let device_spec = device.spec().clone();
    let peak_max = device_spec.force_max_peak;
    let allowed = |device_spec: &Spec| Limits::from_spec(device_spec).slew + 2.0 * device_spec.force_lsb;
    if fault == Fault::OpenedTwice {
        let outcome = if device::second_opening_is_refused() {
            Outcome::Zero(0.0)
        } else {
            Outcome::Persists
        };
        return Ok(measurement(outcome, [0.0, peak_max], [0.0, allowed(&device_spec)]));
    }
    if fault == Fault::WrongTravel {
        let is_weak_motor = peak_max < WEAK_FORCE;
        device.report_travel(if is_weak_motor {
            REPORTED_TRAVEL_WEAK
        } else {
            REPORTED_TRAVEL
        });
    }
    let fault_time = if fault == Fault::Uncalibrated {
        test_direction(device, &shared)
    } else {
        run_fault(ask, fault, device, &shared)
    };
    let motor = shared.world().motor;
    let push_end = if fault.persists() {
        motor.last_push.or(Some(fault_time))
    } else {
        motor.first_zero
    };
    let end_time = shared.world().now();
    let outcome = match push_end {
        Some(end) if end < end_time || fault == Fault::HostResumed => {
            Outcome::Zero(end.saturating_sub(fault_time).as_secs_f64())
        }
        _ => Outcome::Persists,
    };
    let force_share = match fault {
        // The direction is tested with at most a fifth of the greatest force.
        Fault::Uncalibrated => 0.2,
        // The first packet after the stall is zero.
        Fault::HostResumed => 0.0,
        _ => 1.0,
    };
    let peak_max = force_share * (peak_max + device_spec.force_lsb);
    let force_rises = [motor.rise, allowed(&device_spec)];
    let [_, work] = shared.world().work;
    Ok(Measurement {
        work,
        ..measurement(outcome, [motor.greatest, peak_max], force_rises)
    })
}

/// Play until the fault begins, then watch; returns when it began.
fn run_fault(ask: Ask, fault: Fault, device: Defective, shared: &Shared) -> Duration {
    let mut host = Host::new(device, shared.clone());
    host.ask = ask;
    let _ = host.run(ONSET);
    let fault_time = {
        let mut world = shared.world();
        world.begin_record();
        world.now()
    };
    let device_is_here = host.guarded.in_lockstep();
    let line = |host: &Host, make: fn(&mut Trouble)| make(&mut host.shared.world().trouble);
    let device = |host: &mut Host, make: fn(&mut Defect)| make(&mut host.guarded.device_mut().defect);
    match fault {
        Fault::NotANumber => host.ask = Ask::Force(f64::NAN),
        Fault::Infinite => host.ask = Ask::Force(f64::INFINITY),
        Fault::Huge => return let_go_of_a_huge_force(host),
        Fault::NoReplies if device_is_here => device(&mut host, |defect| defect.loses_positions = true),
        Fault::NoReplies => line(&host, |trouble| trouble.replies_lost = true),
        Fault::HostStalled => {
            shared.world().advance(HOST_STALL);
            return fault_time;
        }
        Fault::HostResumed => {
            shared.world().advance(HOST_STALL);
            let fault_time = shared.world().now();
            shared.world().begin_record();
            let _ = host.tick();
            // Until just before the next packet.
            shared.world().advance(PERIOD);
            return fault_time;
        }
        Fault::BoardStalled => {
            line(&host, |trouble| trouble.board_stalled = true);
            let _ = host.run(BOARD_STALL);
            line(&host, |trouble| trouble.board_stalled = false);
        }
        Fault::WrongWay => device(&mut host, |defect| defect.wrong_way = true),
        Fault::Frozen => device(&mut host, |defect| defect.frozen = true),
        Fault::MotorStuck => device(&mut host, |defect| defect.motor_stuck = true),
        Fault::SensorDrifts => device(&mut host, |defect| defect.drift = DRIFT),
        Fault::SensorScaled => device(&mut host, |defect| defect.scale = 10.0),
        Fault::SensorOffset => device(&mut host, |defect| defect.offset = 0.02),
        Fault::WrongTravel => host.ask = Ask::Force(f64::MAX),
        Fault::SharedLine => line(&host, |trouble| trouble.another_program = true),
        Fault::Unplugged => line(&host, |trouble| trouble.unplugged = true),
        Fault::GarbageReplies => line(&host, |trouble| trouble.replies_random = true),
        Fault::GarbageRequests => line(&host, |trouble| trouble.requests_random = true),
        Fault::Uncalibrated | Fault::OpenedTwice => unreachable!("made without a performance"),
    }
    if host.run(WATCH_TIME).is_err() {
        // The device is lost and dropped, as in a performance.
        drop(host);
        shared.world().advance(WATCH_TIME);
    }
    fault_time
}

/// The piece asks for more than any motor gives, then for nothing; returns the time of the latter.
fn let_go_of_a_huge_force(mut host: Host) -> Duration {
    host.ask = Ask::Force(1e300);
    let _ = host.run(HUGE_LASTS);
    host.ask = Ask::Force(0.0);
    let release_time = host.shared.world().now();
    let _ = host.run(WATCH_TIME);
    release_time
}

/// Test the direction of the motor before the first note, under a hand on the key; returns the beginning of the test.
fn test_direction(mut device: Defective, shared: &Shared) -> Duration {
    device.defect.wrong_way = true;
    device.ticks = Some(shared.clone());
    let pulse = Pulse::from_spec(device.spec());
    let fault_time = shared.world().now();
    shared.world().begin_record();
    let stop_flag = AtomicBool::new(false);
    let _ = directions(&mut device, &[0], pulse, PERIOD.as_secs_f64(), &stop_flag);
    device.ticks = None;
    shared.world().advance(PERIOD);
    fault_time
}

/// A device with these hands on its axes, opened by its own driver.
pub(super) fn held_device(
    emulator: Emulator,
    hands: impl Fn(usize) -> Vec<Hand>,
) -> Result<(Defective, Shared), DeviceError> {
    let refused = |error| DeviceError::Closed {
        url: emulator.name().to_owned(),
        reason: format!("its emulator cannot be made: {error}"),
    };
    let (protocol, axis_count, force_max) = match emulator {
        Emulator::InProcess => {
            let emulated_keys = Keys::new(1, Key::default(), 1.0 / PERIOD.as_secs_f64(), hands(1));
            let device = Emulated::new(emulated_keys.map_err(refused)?, Key::default());
            let shared = Shared::new(World::new(None, false));
            return Ok((Defective::new(Box::new(device), Some(shared.clone())), shared));
        }
        Emulator::Board(Protocol::Frame) => (Protocol::Frame, 1, 20.0),
        Emulator::Board(Protocol::FireFader) => (Protocol::FireFader, 2, firefader::FORCE_MAX),
        Emulator::Board(Protocol::Haply) => (Protocol::Haply, 3, 10.0),
    };
    let plain_key = Key::default();
    let emulated_keys = Keys::new(axis_count, plain_key, RATE, hands(axis_count)).map_err(refused)?;
    let is_haply = protocol == Protocol::Haply;
    let board = BoardConfig {
        protocol,
        lockstep: false,
        touch_gate: false,
        force_max,
        resolution: if is_haply { 1e-5 } else { 0.0 },
        noise: 0.0,
        seed: 0,
        force_step: 0.0,
        watchdog: if is_haply { NEVER } else { WATCHDOG },
        reported: [plain_key.mass, plain_key.damping],
        range: plain_key.range,
    };
    let shared = Shared::new(World::new(Some(Firmware::new(board, emulated_keys)), is_haply));
    let device: Box<dyn Device> = if is_haply {
        Box::new(HaplyHost::new(shared.clone()))
    } else {
        device::open_in_process(emulator.kind(), Box::new(shared.clone()), false)?
    };
    Ok((Defective::new(device, None), shared))
}

/// Hands of which the first holds its key at 0 with a spring and damper; the others rest.
fn hands(axes: usize) -> Vec<Hand> {
    let [stiffness, damping] = HAND;
    let mut axis_hands = vec![Hand::Resting; axes];
    axis_hands[0] = Hand::OnPath {
        path: vec![0.0; 10 * RATE as usize],
        stiffness,
        damping,
    };
    axis_hands
}
