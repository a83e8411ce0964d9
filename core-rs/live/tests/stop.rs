//! The stop of the whole process. All tests would share it, so this binary has a single test.
#![cfg(unix)]

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use ergon_live::device::{Device, DeviceLoss, DeviceSample, DeviceSpec, Unit};
use ergon_live::safety::{GuardedDevice, SafeForce, SafetyLimits, block_signals, check_signals, watch};
use ergon_live::stop::{self, StopScope};

struct Still(DeviceSpec);

impl Device for Still {
    fn spec(&self) -> &DeviceSpec {
        &self.0
    }
    fn send(&mut self, _: &SafeForce) -> Result<(), DeviceLoss> {
        Ok(())
    }
    fn receive(&mut self, _: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        Ok(true)
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {}
}

fn still() -> Still {
    Still(DeviceSpec {
        dof: 1,
        unit: Unit::Metre,
        pos_lsb: 1e-6,
        pos_range: [-0.05, 0.05],
        force_max_continuous: 1.0,
        force_max_peak: 2.0,
        force_lsb: 0.0,
        rate_nominal: None,
        loop_delay_s: None,
        inertia: None,
        damping: None,
        is_touch_gated: false,
        can_lockstep: true,
        can_send_wide: true,
    })
}

/// The force that is sent when 1 N is asked for.
fn sent(guarded_device: &mut GuardedDevice<Still>) -> f64 {
    let mut sample = DeviceSample::default();
    guarded_device.receive(&mut sample, Instant::now()).unwrap();
    guarded_device.send(&[1.0]).unwrap().newtons()[0]
}

static SIGNALS: AtomicU32 = AtomicU32::new(0);

extern "C" fn on_signal(_: i32) {
    SIGNALS.fetch_add(1, Ordering::SeqCst);
}

fn handle(signal: i32) {
    // SAFETY: the handler only counts.
    unsafe { libc::signal(signal, on_signal as *const () as usize) };
}

fn raise(signal: i32) {
    // SAFETY: a handler is set.
    unsafe { libc::raise(signal) };
}

#[test]
fn stop_holds_all_hands_until_release() {
    let device = still();
    let ramp = 0.1;
    let limits = SafetyLimits {
        ramp_time: ramp,
        ..SafetyLimits::from_spec(&device.0)
    };
    let mut guarded_device = GuardedDevice::new(device, limits, 1e-3);
    let ticks =
        |guarded_device: &mut GuardedDevice<Still>, n: usize| (0..n).map(|_| sent(guarded_device)).last().unwrap();
    let complete = ticks(&mut guarded_device, 300);
    assert_eq!(complete, 1.0);
    // Forces stop, and return as at the start.
    stop::stop(StopScope::Forces);
    assert_eq!(ticks(&mut guarded_device, 1), 0.0);
    assert_eq!(ticks(&mut guarded_device, 300), 0.0);
    assert!(!stop::is_silenced());
    stop::release();
    let first = ticks(&mut guarded_device, 1);
    assert!(0.0 < first && first <= 1.5e-3 / ramp, "{first}");
    assert_eq!(ticks(&mut guarded_device, 300), 1.0);
    // A device that is stopped by itself stays stopped after the stop of the process is released.
    stop::stop(StopScope::Forces);
    guarded_device.set_stopped(true);
    stop::release();
    assert_eq!(ticks(&mut guarded_device, 10), 0.0);
    guarded_device.set_stopped(false);
    assert_eq!(ticks(&mut guarded_device, 300), 1.0);
    // A signal first stops the forces and is then handled, each time that it comes.
    handle(libc::SIGTERM);
    watch(libc::SIGTERM, StopScope::Forces);
    for times in 1..=2 {
        raise(libc::SIGTERM);
        assert_eq!(SIGNALS.load(Ordering::SeqCst), times);
        assert_eq!(ticks(&mut guarded_device, 1), 0.0);
        stop::release();
        assert_eq!(ticks(&mut guarded_device, 300), 1.0);
    }
    // Another handler replaces ours until `watch` is called again.
    handle(libc::SIGTERM);
    raise(libc::SIGTERM);
    assert!(!stop::are_forces_stopped());
    watch(libc::SIGTERM, StopScope::Nothing);
    raise(libc::SIGTERM);
    assert!(!stop::are_forces_stopped());
    assert_eq!(SIGNALS.load(Ordering::SeqCst), 4);
    // After `StopScope::All` nothing returns, whoever releases.
    watch(libc::SIGTERM, StopScope::All);
    raise(libc::SIGTERM);
    stop::release();
    assert!(stop::is_silenced());
    assert_eq!(ticks(&mut guarded_device, 300), 0.0);
    stop::reset();
    assert_eq!(ticks(&mut guarded_device, 300), 1.0);
    // A pending signal is seen by a thread that leaves signals to others.
    watch(libc::SIGTERM, StopScope::Forces);
    block_signals();
    raise(libc::SIGTERM);
    assert!(!stop::are_forces_stopped());
    check_signals();
    assert!(stop::are_forces_stopped());
    assert_eq!(ticks(&mut guarded_device, 1), 0.0);
    stop::reset();
    // An ignored signal is left alone.
    // SAFETY: the call only ignores the signal.
    unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) };
    watch(libc::SIGHUP, StopScope::All);
    raise(libc::SIGHUP);
    assert!(!stop::are_forces_stopped());
}
