//! Unstable loops of a key and a host: the work of the motor on the hand must not exceed the allowance.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::sampled::{MASS, Sampled, Setup};
use crate::safety::clock::SafetyClock;
use crate::safety::contract::{Device, DeviceSample};
use crate::safety::{GuardedDevice, SafetyLimits, StageCounts};

/// The force that the host computes from the positions now and one tick ago, and the tick.
pub(super) type Scene = fn(x: f64, before: f64, tick: u32) -> f64;

/// The forces are unlimited; the stages clamp them.
pub(super) const SCENES: [(&str, Scene); 10] = [
    ("spring 300 N/m", |x, _, _| -300.0 * x),
    ("spring 3 kN/m", |x, _, _| -3e3 * x),
    ("spring 30 kN/m", |x, _, _| -3e4 * x),
    ("wall 10 kN/m", |x, _, _| (-1e4 * x).max(0.0)),
    ("damper 30 N·s/m", |x, before, _| -3e4 * (x - before)),
    ("spring and damper", |x, before, _| -2e3 * x - 2e4 * (x - before)),
    ("relay", |x, _, _| -20.0 * x.signum()),
    ("driven by its velocity", |x, before, _| 5e3 * (x - before)),
    ("pushed where it goes", |x, before, _| 20.0 * (x - before).signum()),
    (
        "pushed at 15 Hz",
        |_, _, tick| {
            if tick / 33 % 2 == 0 { 20.0 } else { -20.0 }
        },
    ),
];

/// The outcome of a run.
pub(super) struct Outcome {
    /// Greatest work beyond the allowance [J].
    pub(super) beyond: f64,
    /// Total work [J], and greatest deflection [m].
    pub(super) work: f64,
    pub(super) widest: f64,
    pub(super) counts: StageCounts,
}

/// Run a loop for a number of ticks.
pub(super) fn play(setup: Setup, scene: Scene, ticks: u32) -> Outcome {
    let mut key = Sampled::new(setup);
    let loop_limits = SafetyLimits {
        ramp_time: 0.0,
        velocity_max: f64::INFINITY,
        ..SafetyLimits::from_spec(key.spec())
    };
    let loop_time = Arc::new(AtomicU64::new(0));
    let mut guarded_device = GuardedDevice::new(&mut key, loop_limits, setup.period);
    guarded_device.clock = SafetyClock::External(Arc::clone(&loop_time));
    let mut device_sample = DeviceSample::default();
    let (mut position_before, mut beyond, mut widest) = (0.0, 0.0_f64, 0.0_f64);
    let period_nanos = Duration::from_secs_f64(setup.period).as_nanos() as u64;
    for tick in 0..ticks {
        loop_time.fetch_add(period_nanos, Ordering::Relaxed);
        let key_position = device_sample.position[0];
        guarded_device
            .send(&[scene(key_position, position_before, tick)])
            .unwrap();
        position_before = key_position;
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        let key = guarded_device.device();
        let allowed = loop_limits.work_max + loop_limits.power_max * f64::from(tick + 1) * setup.period;
        beyond = beyond.max(key.work - allowed);
        widest = widest.max(key.x.abs());
    }
    let counts = *guarded_device.counts();
    drop(guarded_device);
    Outcome {
        beyond,
        work: key.work,
        widest,
        counts,
    }
}

/// The greatest work beyond the allowance [J], and the number of loops in which the stage acted.
fn sweep(mass: f64, steps: &[f64], delays: &[usize], seconds: u32) -> (f64, usize) {
    let (mut worst_work, mut acting_loops) = (0.0_f64, 0);
    for (name, scene) in SCENES {
        for &step in steps {
            for hand in [None, Some([400.0, 4.0])] {
                for [tells, lockstep] in [[true, true], [true, false], [false, true], [false, false]] {
                    for friction in [0.02, 0.1, 0.3, 1.0, 3.0] {
                        for &delay in delays {
                            let loop_setup = Setup {
                                period: 1e-3,
                                mass,
                                friction,
                                delay,
                                tells,
                                lockstep,
                                hand,
                                sine: [0.0; 2],
                                step,
                            };
                            let loop_outcome = play(loop_setup, scene, 1000 * seconds);
                            assert!(
                                loop_outcome.beyond <= 0.1,
                                "{name}, {loop_setup:?}: {} J",
                                loop_outcome.beyond
                            );
                            worst_work = worst_work.max(loop_outcome.beyond);
                            acting_loops += usize::from(loop_outcome.counts.energy > 0);
                        }
                    }
                }
            }
        }
    }
    (worst_work, acting_loops)
}

#[test]
fn work_of_loops_stays_within_the_allowance() {
    let (_, acting_loops) = sweep(MASS, &[1e-5], &[0, 1, 4], 4);
    assert!(acting_loops > 200, "{acting_loops}: loops that swing up were tried");
}

#[test]
#[ignore = "a minute: make test-long"]
fn work_of_many_loops_stays_within_the_allowance() {
    // The mass that the device reports, a smaller one, and one with the mass of a hand added.
    for mass in [MASS, 0.03, 0.2] {
        let (worst_work, acting_loops) = sweep(mass, &[0.0, 1e-5, 0.39e-3], &[0, 1, 2, 3, 4], 10);
        eprintln!("{mass} kg: at most {worst_work} J beyond, {acting_loops} loops held back");
        assert!(acting_loops > 1000, "{acting_loops}");
    }
}

/// Normal playing is not held back: springs and walls that a key bears, and a partner who leads a hand, under hands
/// that move to and fro.
#[test]
fn usual_playing_loops_are_not_limited() {
    let playing_scenes: [(&str, Scene); 4] = [
        ("a spring", |x, _, _| -300.0 * x),
        ("a wall", |x, _, _| if x > 2e-3 { -500.0 * (x - 2e-3) } else { 0.0 }),
        ("a spring and a damper", |x, before, _| {
            -200.0 * x - 400.0 * (x - before)
        }),
        ("a partner", |x, _, tick| {
            let partner_position = 15e-3 * libm::sin(1.9e-3 * std::f64::consts::TAU * f64::from(tick));
            200.0 * (partner_position - x)
        }),
    ];
    for (name, scene) in playing_scenes {
        for step in [0.0, 1e-5, 0.39e-3] {
            for lockstep in [true, false] {
                for sine in [[0.0, 0.0], [5e-3, 5.0], [15e-3, 2.0], [10e-3, 4.0]] {
                    let loop_setup = Setup {
                        period: 1e-3,
                        mass: MASS,
                        friction: 1.0,
                        delay: 0,
                        tells: true,
                        lockstep,
                        hand: Some([400.0, 4.0]),
                        sine,
                        step,
                    };
                    let loop_outcome = play(loop_setup, scene, 20_000);
                    assert_eq!(
                        loop_outcome.counts.energy, 0,
                        "{name}, {loop_setup:?}: {} J",
                        loop_outcome.work
                    );
                    assert!(loop_outcome.widest > 1e-3 || sine == [0.0; 2]);
                }
            }
        }
    }
}
