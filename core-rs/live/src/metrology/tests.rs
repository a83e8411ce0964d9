use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use super::*;
use crate::device::{DeviceSpec, EmulatedDevice};
use crate::emulate::{EmulatedKeys, KeyConstants};
use crate::recording::{Header, RecordedAxis, Recorder, flag, read};
use crate::safety::SafeForce;

const RATE: f64 = 44_100.0;
const PERIOD: f64 = 44.0 / RATE;
const HALF: f64 = 0.015;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    Touch,
    Gate,
    NotANumber,
    Unplugged,
    Silent,
}

/// An emulated key that has a fault from a tick on.
struct Faulty {
    keys: EmulatedDevice,
    fault: Fault,
    tick: u64,
    ticks: u64,
    /// The last force of the first axis, as bits.
    last: Arc<AtomicU64>,
}

impl Faulty {
    fn is_on(&self, fault: Fault) -> bool {
        self.fault == fault && self.ticks >= self.tick
    }
}

impl Device for Faulty {
    fn spec(&self) -> &DeviceSpec {
        self.keys.spec()
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.ticks += 1;
        if self.is_on(Fault::Unplugged) {
            return Err(DeviceLoss::Closed);
        }
        self.last.store(force.newtons()[0].to_bits(), Ordering::Relaxed);
        self.keys.send(force)
    }

    fn receive(&mut self, into: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        let is_fresh = self.keys.receive(into, deadline)?;
        into.is_touched[0] = self.is_on(Fault::Touch);
        into.is_force_enabled[0] = !self.is_on(Fault::Gate);
        if self.is_on(Fault::NotANumber) {
            into.position[0] = f64::NAN;
        }
        Ok(is_fresh && !self.is_on(Fault::Silent))
    }

    fn in_lockstep(&self) -> bool {
        true
    }

    fn zero(&mut self) {
        self.last.store(0, Ordering::Relaxed);
    }
}

fn key(fault: Fault, tick: u64) -> (Faulty, Arc<AtomicU64>) {
    let plain_key = KeyConstants {
        mass: 0.4,
        stiffness: 0.0,
        damping: 1.2,
        range: [-HALF, HALF],
    };
    let keys = EmulatedKeys::new(1, plain_key, RATE / 44.0, Vec::new()).unwrap();
    let last_force = Arc::new(AtomicU64::new(1.0_f64.to_bits()));
    let faulty_key = Faulty {
        keys: EmulatedDevice::new(keys, plain_key),
        fault,
        tick,
        ticks: 0,
        last: Arc::clone(&last_force),
    };
    (faulty_key, last_force)
}

fn pushed(forces: &[f64]) -> Excitation<'_> {
    Excitation {
        axis: 0,
        forces,
        unguided_ticks: 100,
        period: PERIOD,
        guide: Guide {
            centre: 0.0,
            half_travel: HALF,
            spring: SpringDamper {
                stiffness: 50.0,
                damping: 7.0,
            },
            brake: SpringDamper {
                stiffness: 150.0,
                damping: 18.0,
            },
            deceleration: 10.0,
        },
        force_step: 0.0,
        reports_touch: true,
        is_gated: true,
    }
}

fn jumps() -> Vec<f64> {
    let position = |n: usize| match n {
        0..100 => 0.0,
        _ if (n / 200).is_multiple_of(2) => 0.3,
        _ => -0.3,
    };
    (0..3000).map(position).collect()
}

#[test]
fn excite_with_faults_ends_force_and_keeps_rows() {
    for (fault, end, n) in [
        (Fault::None, ExcitationEnd::Done, 3000),
        (Fault::Touch, ExcitationEnd::Touched, 700),
        (Fault::Gate, ExcitationEnd::GateClosed, 700),
        (Fault::NotANumber, ExcitationEnd::NotFinite, 700),
        (Fault::Unplugged, ExcitationEnd::Gone(DeviceLoss::Closed), 699),
        (Fault::Silent, ExcitationEnd::Gone(DeviceLoss::Silent), 950),
    ] {
        let jump_forces = jumps();
        let (faulty_key, last_force) = key(fault, 700);
        let take_path = std::env::temp_dir().join(format!("ergon-{fault:?}-{}.take", std::process::id()));
        let header = Header {
            rate: RATE,
            frames: 44,
            axes: vec![RecordedAxis::default()],
            about: String::new(),
        };
        let (mut row_sink, sink_handle) = Recorder::start(&take_path, &header).unwrap();
        let stop_flag = AtomicBool::new(false);
        let outcome = excite(faulty_key, &pushed(&jump_forces), Some(&mut row_sink), &stop_flag);
        drop(row_sink);
        sink_handle.stop().unwrap();
        let read_take = read(&take_path, None).unwrap();
        std::fs::remove_file(&take_path).unwrap();
        assert_eq!(outcome.end, end, "{fault:?}");
        assert!(outcome.rows.len().abs_diff(n) <= 2, "{fault:?} {}", outcome.rows.len());
        assert_eq!(read_take.ticks.len(), outcome.rows.len());
        for (row, sample) in outcome.rows.iter().zip(&read_take.samples) {
            assert_eq!(row.position.to_bits(), sample.position.to_bits());
            assert_eq!(row.sent_force as f32, sample.sent_force);
            assert_eq!(row.is_fresh, sample.flags & flag::FRESH != 0);
        }
        assert_eq!(last_force.load(Ordering::Relaxed), 0, "{fault:?}");
    }
}

#[test]
fn excite_with_a_set_stop_ends_at_once() {
    let (faulty_key, last_force) = key(Fault::None, 0);
    let outcome = excite(faulty_key, &pushed(&jumps()), None, &AtomicBool::new(true));
    assert_eq!((outcome.end, outcome.rows.len()), (ExcitationEnd::Stopped, 0));
    assert_eq!(last_force.load(Ordering::Relaxed), 0);
}

/// A steady push does not take a key without a spring to an end: the brake takes over, then the guide returns the key.
#[test]
fn excite_brakes_the_key_before_its_ends() {
    let mut push_forces = vec![1.5; 4000];
    push_forces[..100].fill(0.0);
    let (faulty_key, _) = key(Fault::None, 0);
    let outcome = excite(faulty_key, &pushed(&push_forces), None, &AtomicBool::new(false));
    assert_eq!(outcome.end, ExcitationEnd::Done);
    let farthest = outcome.rows.iter().map(|row| row.position.abs());
    let farthest = farthest.fold(0.0, f64::max);
    assert!((0.5 * HALF..0.8 * HALF).contains(&farthest), "{farthest}");
    assert!(outcome.rows.iter().any(|row| row.braked));
}
