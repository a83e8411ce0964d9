//! Nothing is allocated between the request for a force and the wire: in every driver's send and receive, and in every
//! stage of safety.
#![cfg(unix)]

#[allow(dead_code)] // used by other tests
mod emulator;

use std::time::{Duration, Instant};

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use emulator::{Emulator, RATE, options};
use ergon_live::device::DeviceSample;
use ergon_live::emulate::{EmulatedHand, Protocol, Transport};
use ergon_live::safety::{GuardedDevice, SafetyLimits};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn exchange_with_each_device_does_not_allocate() {
    // The emulators run in threads of their own, and violations are counted per thread.
    for (kind, protocol, transport, how) in [
        ("firefader", Protocol::FireFader, Transport::Terminal, "lockstep"),
        ("firefader", Protocol::FireFader, Transport::Terminal, ""),
        ("frame", Protocol::Frame, Transport::Terminal, ""),
        ("frame+udp", Protocol::Frame, Transport::Udp(0), "lockstep&wide"),
        ("frame+udp", Protocol::Frame, Transport::Udp(0), ""),
        ("haply", Protocol::Haply, Transport::WebSocket(0), ""),
    ] {
        let axes = if protocol == Protocol::Haply { 3 } else { 2 };
        let emulator = Emulator::start(options(protocol, transport, axes, vec![EmulatedHand::Resting; axes]));
        let device = emulator.open(kind, how);
        let limits = SafetyLimits {
            ramp_time: 0.0,
            ..SafetyLimits::from_spec(device.spec())
        };
        let mut device = GuardedDevice::new(device, limits, 1.0 / RATE).with_plausibility();
        let (mut sample, mut fresh) = (DeviceSample::default(), 0);
        reset_violation_count();
        assert_no_alloc(|| {
            for tick in 0..200 {
                let deadline = Instant::now() + Duration::from_millis(1);
                fresh += u32::from(device.receive(&mut sample, deadline).unwrap());
                let wish = if tick == 100 { f64::NAN } else { 3.0 };
                device.send(&[wish, -0.1]).unwrap();
            }
            device.zero();
        });
        assert_eq!(violation_count(), 0, "{kind}?{how}");
        assert!(fresh > 0, "{kind}?{how}");
        drop(device);
        emulator.end();
    }
}
