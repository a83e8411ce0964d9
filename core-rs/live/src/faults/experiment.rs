//! One fault on one device: a hand holds a key, a piece guides it, the fault begins, and the motor is watched.

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use super::line::{DefectiveDevice, DeviceDefects, HaplyHost, SharedWorld};
use super::world::{LineFaults, SimulatedWorld};
use super::{BOARD_STALL, Emulator, Fault, FaultMeasurement, FaultOutcome, HOST_STALL, PERIOD};
use crate::device::calibrate::{TestPulse, find_directions};
use crate::device::{self, Device, DeviceError, DeviceLoss, DeviceSample, DeviceSpec, EmulatedDevice};
use crate::emulate::{BoardConfig, EmulatedHand, EmulatedKeys, Firmware, KeyConstants, Protocol};
use crate::safety::{GuardedDevice, SafetyLimits};
use crate::wire::firefader;

/// Rate of the board [Hz].
const BOARD_RATE: f64 = 8000.0;
/// Beginning of the fault: forces have risen, and the piece pulls hardest.
const FAULT_TIME: Duration = Duration::from_millis(3250);
/// How long the motor is watched from then on.
const WATCH_TIME: Duration = Duration::from_secs(2);
/// How long the piece asks for 1e300 N.
const HUGE_FORCE_DURATION: Duration = Duration::from_millis(500);
/// Time of the board's own watchdog.
const WATCHDOG_TIMEOUT: Duration = Duration::from_millis(50);
/// A watchdog time that never passes: Haply's service is not known to have a watchdog, so none is emulated.
const WATCHDOG_NEVER: Duration = Duration::from_secs(3600);
/// A motor with less force is weak [N].
const WEAK_FORCE: f64 = 5.0;
/// The hand that holds the key [N/m, N·s/m].
const HAND_SPRING_DAMPER: [f64; 2] = [400.0, 4.0];
/// Drift of a sensor [m in a tick]: 0.5 m/s.
const DRIFT_PER_TICK: f64 = 5e-4;
/// Part of its travel that a device reports, if that is the fault: the guide does not leave it, the greatest force
/// does. A weak motor moves the key less.
const REPORTED_TRAVEL: f64 = 0.08;
const REPORTED_TRAVEL_OF_WEAK: f64 = 0.04;
/// Amplitude and rate of the path along which a written part drives the key [m, Hz].
#[cfg(test)]
const DRIVEN_AMPLITUDE: f64 = 6e-3;
#[cfg(test)]
const DRIVEN_FREQUENCY: f64 = 3.0;
/// Amplitude with which the piece leads the key to and fro, once a second [m].
const GUIDE_AMPLITUDE: f64 = 6e-3;

/// The force that a piece asks for.
#[derive(Clone, Copy)]
pub(super) enum RequestedForce {
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

pub(super) struct SimulatedHost {
    guarded_device: GuardedDevice<DefectiveDevice>,
    pub(super) world: SharedWorld,
    sample: DeviceSample,
    /// The piece's spring [N/m].
    stiffness: f64,
    pub(super) requested_force: RequestedForce,
}

impl SimulatedHost {
    pub(super) fn new(device: DefectiveDevice, world: SharedWorld) -> Self {
        let limits = SafetyLimits::from_spec(device.spec());
        let lockstep = device.in_lockstep();
        let guarded_device = GuardedDevice::new(device, limits, PERIOD.as_secs_f64()).with_plausibility();
        let guarded_device = if lockstep {
            guarded_device
        } else {
            guarded_device.with_clock(world.lock().clock())
        };
        let is_weak = guarded_device.spec().force_max_peak < WEAK_FORCE;
        Self {
            guarded_device,
            world,
            sample: DeviceSample::default(),
            stiffness: if is_weak { 150.0 } else { 500.0 },
            requested_force: RequestedForce::Guide,
        }
    }

    fn tick(&mut self) -> Result<(), DeviceLoss> {
        self.world.lock().advance(PERIOD);
        self.guarded_device.receive(&mut self.sample, Instant::now())?;
        let force = match self.requested_force {
            RequestedForce::Guide => {
                let seconds = self.world.lock().now().as_secs_f64();
                self.stiffness * (GUIDE_AMPLITUDE * wave(seconds) - self.sample.position[0])
            }
            #[cfg(test)]
            RequestedForce::Drive => {
                let seconds = self.world.lock().now().as_secs_f64();
                written_force(seconds, self.sample.position[0])
            }
            RequestedForce::Force(force) => force,
            #[cfg(test)]
            RequestedForce::Wall(stiffness) => -stiffness * self.sample.position[0],
        };
        self.guarded_device.send(&[force]).map(drop)
    }

    pub(super) fn run(&mut self, time: Duration) -> Result<(), DeviceLoss> {
        let end_time = self.world.lock().now() + time;
        while self.world.lock().now() < end_time {
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
    let driven_key = KeyConstants::default();
    let [position_before, position_now, position_after] =
        [-STEP, 0.0, STEP].map(|shift| DRIVEN_AMPLITUDE * wave(DRIVEN_FREQUENCY * (seconds + shift)));
    let acceleration = (position_after - 2.0 * position_now + position_before) / (STEP * STEP);
    let path_speed = (position_after - position_before) / (2.0 * STEP);
    let return_rate = std::f64::consts::TAU;
    driven_key.mass * (acceleration + return_rate * return_rate * (position_now - x)) + driven_key.damping * path_speed
}

/// Make a fault on a device while a piece asks for forces on a key that a hand holds or nobody, and measure its effect.
pub(super) fn measure(
    requested_force: RequestedForce,
    is_held: bool,
    fault: Fault,
    emulator: Emulator,
) -> Result<FaultMeasurement, DeviceError> {
    let measurement = |outcome, peak_force, force_rises| FaultMeasurement {
        fault,
        emulator,
        outcome,
        time_limit: fault.time_limit(emulator),
        peak_force_and_limit: peak_force,
        force_rise_and_limit: force_rises,
        work_max: 0.0,
    };
    if let Some(exclusion) = fault.exclusion_reason(emulator) {
        return Ok(measurement(FaultOutcome::Excluded(exclusion), [0.0; 2], [0.0; 2]));
    }
    let (mut device, world) = if is_held {
        held_device(emulator, hands)?
    } else {
        held_device(emulator, |axes| vec![EmulatedHand::Resting; axes])?
    };
    let device_spec = device.spec().clone();
    let peak_max = device_spec.force_max_peak;
    let rise_limit =
        |device_spec: &DeviceSpec| SafetyLimits::from_spec(device_spec).slew_rate_max + 2.0 * device_spec.force_lsb;
    if fault == Fault::OpenedTwice {
        let outcome = if device::second_opening_is_refused() {
            FaultOutcome::Zero(0.0)
        } else {
            FaultOutcome::Persists
        };
        return Ok(measurement(outcome, [0.0, peak_max], [0.0, rise_limit(&device_spec)]));
    }
    if fault == Fault::WrongTravel {
        let is_weak_motor = peak_max < WEAK_FORCE;
        device.report_travel(if is_weak_motor {
            REPORTED_TRAVEL_OF_WEAK
        } else {
            REPORTED_TRAVEL
        });
    }
    let fault_time = if fault == Fault::Uncalibrated {
        test_direction(device, &world)
    } else {
        run_fault(requested_force, fault, device, &world)
    };
    let motor = world.lock().motor;
    let push_end = if fault.persists() {
        motor.last_push.or(Some(fault_time))
    } else {
        motor.first_zero
    };
    let end_time = world.lock().now();
    let outcome = match push_end {
        Some(end) if end < end_time || fault == Fault::HostResumed => {
            FaultOutcome::Zero(end.saturating_sub(fault_time).as_secs_f64())
        }
        _ => FaultOutcome::Persists,
    };
    let force_share = match fault {
        // The direction is tested with at most a fifth of the greatest force.
        Fault::Uncalibrated => 0.2,
        // The first packet after the stall is zero.
        Fault::HostResumed => 0.0,
        _ => 1.0,
    };
    let peak_max = force_share * (peak_max + device_spec.force_lsb);
    let force_rises = [motor.rise_max, rise_limit(&device_spec)];
    let [_, work] = world.lock().work;
    Ok(FaultMeasurement {
        work_max: work,
        ..measurement(outcome, [motor.force_max, peak_max], force_rises)
    })
}

/// Play until the fault begins, then watch; returns when it began.
fn run_fault(requested_force: RequestedForce, fault: Fault, device: DefectiveDevice, world: &SharedWorld) -> Duration {
    let mut host = SimulatedHost::new(device, world.clone());
    host.requested_force = requested_force;
    let _ = host.run(FAULT_TIME);
    let fault_time = {
        let mut locked_world = world.lock();
        locked_world.begin_record();
        locked_world.now()
    };
    let is_in_process = host.guarded_device.in_lockstep();
    let set_line_fault = |host: &SimulatedHost, set: fn(&mut LineFaults)| set(&mut host.world.lock().line_faults);
    let set_defect =
        |host: &mut SimulatedHost, set: fn(&mut DeviceDefects)| set(&mut host.guarded_device.device_mut().defects);
    match fault {
        Fault::NotANumber => host.requested_force = RequestedForce::Force(f64::NAN),
        Fault::Infinite => host.requested_force = RequestedForce::Force(f64::INFINITY),
        Fault::Huge => return release_huge_force(host),
        Fault::NoReplies if is_in_process => set_defect(&mut host, |defect| defect.loses_positions = true),
        Fault::NoReplies => set_line_fault(&host, |trouble| trouble.replies_lost = true),
        Fault::HostStalled => {
            world.lock().advance(HOST_STALL);
            return fault_time;
        }
        Fault::HostResumed => {
            world.lock().advance(HOST_STALL);
            let fault_time = world.lock().now();
            world.lock().begin_record();
            let _ = host.tick();
            // Until just before the next packet.
            world.lock().advance(PERIOD);
            return fault_time;
        }
        Fault::BoardStalled => {
            set_line_fault(&host, |trouble| trouble.board_stalled = true);
            let _ = host.run(BOARD_STALL);
            set_line_fault(&host, |trouble| trouble.board_stalled = false);
        }
        Fault::WrongWay => set_defect(&mut host, |defect| defect.is_reversed = true),
        Fault::Frozen => set_defect(&mut host, |defect| defect.is_frozen = true),
        Fault::MotorStuck => set_defect(&mut host, |defect| defect.is_motor_stuck = true),
        Fault::SensorDrifts => set_defect(&mut host, |defect| defect.position_drift = DRIFT_PER_TICK),
        Fault::SensorScaled => set_defect(&mut host, |defect| defect.position_scale = 10.0),
        Fault::SensorOffset => set_defect(&mut host, |defect| defect.position_offset = 0.02),
        Fault::WrongTravel => host.requested_force = RequestedForce::Force(f64::MAX),
        Fault::SharedLine => set_line_fault(&host, |trouble| trouble.another_program = true),
        Fault::Unplugged => set_line_fault(&host, |trouble| trouble.is_unplugged = true),
        Fault::GarbageReplies => set_line_fault(&host, |trouble| trouble.replies_random = true),
        Fault::GarbageRequests => set_line_fault(&host, |trouble| trouble.requests_random = true),
        Fault::Uncalibrated | Fault::OpenedTwice => unreachable!("made without a performance"),
    }
    if host.run(WATCH_TIME).is_err() {
        // The device is lost and dropped, as in a performance.
        drop(host);
        world.lock().advance(WATCH_TIME);
    }
    fault_time
}

/// The piece asks for more than any motor gives, then for nothing; returns the time of the latter.
fn release_huge_force(mut host: SimulatedHost) -> Duration {
    host.requested_force = RequestedForce::Force(1e300);
    let _ = host.run(HUGE_FORCE_DURATION);
    host.requested_force = RequestedForce::Force(0.0);
    let release_time = host.world.lock().now();
    let _ = host.run(WATCH_TIME);
    release_time
}

/// Test the direction of the motor before the first note, under a hand on the key; returns the beginning of the test.
fn test_direction(mut device: DefectiveDevice, world: &SharedWorld) -> Duration {
    device.defects.is_reversed = true;
    device.tick_world = Some(world.clone());
    let pulse = TestPulse::from_spec(device.spec());
    let fault_time = world.lock().now();
    world.lock().begin_record();
    let stop_flag = AtomicBool::new(false);
    let _ = find_directions(&mut device, &[0], pulse, PERIOD.as_secs_f64(), &stop_flag);
    device.tick_world = None;
    world.lock().advance(PERIOD);
    fault_time
}

/// A device with these hands on its axes, opened by its own driver.
pub(super) fn held_device(
    emulator: Emulator,
    hands: impl Fn(usize) -> Vec<EmulatedHand>,
) -> Result<(DefectiveDevice, SharedWorld), DeviceError> {
    let open_error = |error| DeviceError::NotOpened {
        url: emulator.name().to_owned(),
        reason: format!("its emulator cannot be made: {error}"),
    };
    let (protocol, axis_count, force_max) = match emulator {
        Emulator::InProcess => {
            let emulated_keys = EmulatedKeys::new(1, KeyConstants::default(), 1.0 / PERIOD.as_secs_f64(), hands(1));
            let device = EmulatedDevice::new(emulated_keys.map_err(open_error)?, KeyConstants::default());
            let world = SharedWorld::new(SimulatedWorld::new(None, false));
            return Ok((DefectiveDevice::new(Box::new(device), Some(world.clone())), world));
        }
        Emulator::Board(Protocol::Frame) => (Protocol::Frame, 1, 20.0),
        Emulator::Board(Protocol::FireFader) => (Protocol::FireFader, 2, firefader::FORCE_MAX),
        Emulator::Board(Protocol::Haply) => (Protocol::Haply, 3, 10.0),
    };
    let plain_key = KeyConstants::default();
    let emulated_keys = EmulatedKeys::new(axis_count, plain_key, BOARD_RATE, hands(axis_count)).map_err(open_error)?;
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
        watchdog: if is_haply { WATCHDOG_NEVER } else { WATCHDOG_TIMEOUT },
        reported_constants: [plain_key.mass, plain_key.damping],
        range: plain_key.range,
    };
    let world = SharedWorld::new(SimulatedWorld::new(Some(Firmware::new(board, emulated_keys)), is_haply));
    let device: Box<dyn Device> = if is_haply {
        Box::new(HaplyHost::new(world.clone()))
    } else {
        device::open_in_process(emulator.kind(), Box::new(world.clone()), false)?
    };
    Ok((DefectiveDevice::new(device, None), world))
}

/// Hands of which the first holds its key at 0 with a spring and damper; the others rest.
fn hands(axes: usize) -> Vec<EmulatedHand> {
    let [stiffness, damping] = HAND_SPRING_DAMPER;
    let mut axis_hands = vec![EmulatedHand::Resting; axes];
    axis_hands[0] = EmulatedHand::OnPath {
        path: vec![0.0; 10 * BOARD_RATE as usize],
        stiffness,
        damping,
    };
    axis_hands
}
