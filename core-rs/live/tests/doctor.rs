//! A checkup counts correctly, and allocates nothing while it measures.
#![cfg(unix)]

#[allow(dead_code)] // used by other tests
mod emulator;

use std::sync::atomic::AtomicBool;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use emulator::{Emulator, options};
use ergon_live::device::calibrate::{AxisCalibration, with_calibration};
use ergon_live::device::{Device, DeviceLoss, DeviceSample};
use ergon_live::doctor::check_timing;
use ergon_live::emulate::{EmulatedHand, Protocol, Transport};
use ergon_live::safety::{GuardedDevice, SafetyLimits};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const PERIOD: f64 = 1e-3;
static GO: AtomicBool = AtomicBool::new(false);

fn udp(lockstep: bool) -> Emulator {
    let mut options = options(Protocol::Frame, Transport::Udp(0), 1, vec![EmulatedHand::Resting]);
    options.board.lockstep = lockstep;
    Emulator::start(options)
}

fn guarded_device(device: Box<dyn Device>) -> GuardedDevice {
    let limits = SafetyLimits::from_spec(device.spec());
    GuardedDevice::new(device, limits, PERIOD)
}

#[test]
fn checkup_clock_is_never_early() {
    let result = std::thread::spawn(|| check_timing::<Box<dyn Device>>(None, PERIOD, 300, &GO));
    let result = result.join().unwrap().unwrap();
    assert_eq!(result.lateness.len(), 300);
    assert!(result.seconds >= 0.299, "{}", result.seconds);
    assert_eq!((result.round_trips.len(), result.n_unanswered), (0, 0));
}

#[test]
fn checkup_counts_answered_and_lost_forces() {
    let emulator = udp(true);
    let mut device = guarded_device(emulator.open("frame+udp", "lockstep&wide"));
    let result = check_timing(Some(&mut device), PERIOD, 500, &GO).unwrap();
    assert_eq!((result.round_trips.len(), result.n_unanswered), (500, 0));
    assert!(result.lateness.is_empty(), "lockstep has no clock");
    drop(device);
    // The forces, and the zero forces at the end; none of them moved the key.
    assert!(emulator.end().packets >= 500);
    let emulator = udp(false);
    let mut device = guarded_device(emulator.open("frame+udp", ""));
    let result = check_timing(Some(&mut device), PERIOD, 200, &GO).unwrap();
    assert_eq!(result.round_trips.len() as u64 + result.n_unanswered, 200);
    assert_eq!(result.lateness.len(), 200);
    assert!(result.round_trips.iter().all(|&ns| (1_000..25_000_000).contains(&ns)));
    // Whatever its length, only its beginning allocates.
    let mut allocated = [0; 2];
    for (allocated, ticks) in allocated.iter_mut().zip([2, 50]) {
        reset_violation_count();
        assert_no_alloc(|| check_timing(Some(&mut device), PERIOD, ticks, &GO)).unwrap();
        *allocated = violation_count();
    }
    assert_eq!(allocated[0], allocated[1]);
    emulator.end();
    // The device is gone: each force waits in vain.
    let result = check_timing(Some(&mut device), PERIOD, 5, &GO).unwrap();
    assert_eq!((result.round_trips.len(), result.n_unanswered), (0, 5));
    assert!(result.seconds > 0.1, "{}", result.seconds);
}

#[test]
fn with_calibration_applies_known_axes() {
    let emulator = udp(true);
    let device = emulator.open("frame+udp", "lockstep&wide");
    let plain = AxisCalibration::without_corrections(device.spec());
    let known = AxisCalibration {
        offset: 0.01,
        gain: 2.0,
        force_max: 3.0,
        ..plain
    };
    let mut device = with_calibration(device, &[(0, known), (7, plain)]);
    assert_eq!(device.spec().force_max_peak, 3.0);
    let mut sample = DeviceSample::default();
    device.receive(&mut sample, std::time::Instant::now()).unwrap();
    assert_eq!(sample.position[0], -0.02);
    emulator.end();
}

#[test]
fn checkup_with_a_set_stop_ends() {
    let stop = AtomicBool::new(true);
    let result = check_timing::<Box<dyn Device>>(None, PERIOD, 1000, &stop).unwrap();
    assert!(result.lateness.is_empty());
    let emulator = udp(true);
    let mut device = emulator.open("frame+udp", "lockstep");
    let ended = ergon_live::device::calibrate::travel_ends(&mut device, 1.0, PERIOD, &stop);
    assert_eq!(ended, Err(DeviceLoss::Closed));
    emulator.end();
}
