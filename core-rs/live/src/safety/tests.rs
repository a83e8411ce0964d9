//! Each stage by itself, all stages together, and that no other force reaches a motor.

mod late;
mod loops;
mod random_faults;
mod sampled;
mod slew;

use std::time::Instant;

use proptest::prelude::*;

use super::*;
use crate::safety::contract::Unit;
use crate::wire::MAX_AXES;

const PERIOD: f64 = 1e-3;

/// A device at a position that the test sets, which keeps the forces that it was sent.
struct Bench {
    spec: DeviceSpec,
    position: Option<f64>,
    sent: Vec<f64>,
    zeroed: usize,
}

impl Bench {
    fn new() -> Self {
        Self {
            spec: DeviceSpec {
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
            },
            position: Some(0.0),
            sent: Vec::new(),
            zeroed: 0,
        }
    }
}

impl Device for Bench {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.sent.extend(force.newtons());
        Ok(())
    }
    fn receive(&mut self, into: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        into.position[0] = self.position.unwrap_or(into.position[0]);
        Ok(self.position.is_some())
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {
        self.zeroed += 1;
    }
}

/// Limits with which no stage acts; a test changes one of them.
fn open() -> SafetyLimits {
    SafetyLimits {
        force_max: f64::INFINITY,
        slew_rate_max: f64::INFINITY,
        ramp_time: 0.0,
        velocity_max: f64::INFINITY,
        velocity_window: 5e-3,
        position_age_max: 0.02,
        trip_time: 0.1,
        fade_time: 0.0,
        work_max: f64::INFINITY,
        power_max: 0.0,
        heat_time: 1e6,
    }
}

/// The forces sent for each tick's asked force and position; `None`: the device does not reply.
fn play(
    guarded_device: &mut GuardedDevice<&mut Bench>,
    ticks: impl IntoIterator<Item = (f64, Option<f64>)>,
) -> Vec<f64> {
    let mut device_sample = DeviceSample::default();
    let mut sent_forces = Vec::new();
    for (asked, place) in ticks {
        guarded_device.device.position = place;
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        sent_forces.push(guarded_device.send(&[asked]).unwrap().newtons()[0]);
    }
    sent_forces
}

fn still(asked: f64, n: usize) -> impl Iterator<Item = (f64, Option<f64>)> {
    std::iter::repeat_n((asked, Some(0.0)), n)
}

#[test]
fn safe_forces_are_sent_bitwise() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        ramp_time: 0.0,
        ..SafetyLimits::from_spec(&bench.spec)
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    let asked_forces: Vec<f64> = (0..3000).map(|i| 0.7 * libm::sin(0.01 * f64::from(i))).collect();
    let asked_ticks = asked_forces.iter().map(|&asked| (asked, Some(0.0)));
    assert_eq!(play(&mut guarded_device, asked_ticks), asked_forces);
    let guarded_counts = *guarded_device.counts();
    assert_eq!(
        guarded_counts,
        StageCounts {
            ticks: 3000,
            ..StageCounts::default()
        }
    );
    drop(guarded_device);
    assert_eq!(bench.sent, asked_forces);
    assert_eq!(bench.zeroed, 3, "sent on parting");
}

#[test]
fn non_finite_force_trips() {
    let mut bench = Bench::new();
    let mut guarded_device = GuardedDevice::new(&mut bench, open(), PERIOD);
    let mut asked_ticks: Vec<_> = still(0.5, 300).collect();
    asked_ticks[100].0 = f64::NAN;
    asked_ticks[101].0 = f64::NEG_INFINITY;
    let sent_forces = play(&mut guarded_device, asked_ticks);
    assert_eq!(sent_forces[99], 0.5);
    assert!(sent_forces[100..200].iter().all(|&force| force == 0.0));
    assert_eq!(sent_forces[205..], [0.5; 95]);
    let guarded_counts = guarded_device.counts();
    assert_eq!((guarded_counts.not_finite, guarded_counts.trips_not_finite), (2, 1));
    assert!(
        (100..=102).contains(&guarded_counts.tripped),
        "{}",
        guarded_counts.tripped
    );
}

#[test]
fn force_is_limited_by_player_and_device() {
    let mut bench = Bench::new();
    let sent_forces = play(&mut GuardedDevice::new(&mut bench, open(), PERIOD), still(-9.0, 1));
    assert_eq!(sent_forces, [-2.0]);
    let gentle_limits = SafetyLimits {
        force_max: 0.25,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, gentle_limits, PERIOD);
    assert_eq!(play(&mut guarded_device, still(9.0, 2)), [0.25, 0.25]);
    assert_eq!(guarded_device.counts().clamped, 2);
}

#[test]
fn hot_motor_force_falls_to_the_continuous_limit() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        heat_time: 0.1,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    let sent_forces = play(&mut guarded_device, still(2.0, 2000));
    assert_eq!(sent_forces[0], 2.0);
    // At twice the continuous force the heat tends to 4 and reaches 1 after -ln(3/4) of its time constant.
    let first_limited = sent_forces.iter().position(|&force| force == 1.0).unwrap();
    assert!((27..=31).contains(&first_limited), "{first_limited}");
    let mean_square = sent_forces[1000..].iter().map(|f| f * f).sum::<f64>() / 1000.0;
    assert!((mean_square - 1.0).abs() < 0.05, "{mean_square}");
    assert!(guarded_device.counts().hot > 500);
}

#[test]
fn force_rises_within_the_slew_limit() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        slew_rate_max: 0.1,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    let sent_forces = play(&mut guarded_device, still(1.0, 12));
    for (i, force) in sent_forces[..10].iter().enumerate() {
        assert!((force - 0.1 * (i + 1) as f64).abs() < 1e-12, "{sent_forces:?}");
    }
    assert_eq!(sent_forces[10..], [1.0, 1.0]);
    assert!((9..=10).contains(&guarded_device.counts().slewed));
}

#[test]
fn force_ramps_up_over_two_seconds() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        ramp_time: 2.0,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    let sent_forces = play(&mut guarded_device, still(1.0, 2500));
    for position in [0, 499, 999, 1500] {
        assert!(
            (sent_forces[position] - (position + 1) as f64 / 2000.0).abs() < 1e-9,
            "{position}: {}",
            sent_forces[position]
        );
    }
    assert_eq!(sent_forces[2001..], [1.0; 499]);
}

#[test]
fn fast_key_trips_by_velocity() {
    let mut bench = Bench::new();
    bench.spec.pos_range = [-0.2, 0.2];
    let limits = SafetyLimits {
        velocity_max: 1.0,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    // 0.5 m/s, then 4 m/s, then at rest.
    let asked_ticks = (0..400).map(|i| {
        let key_position = match i {
            0..100 => 0.5e-3 * f64::from(i),
            100..110 => 0.05 + 4e-3 * f64::from(i - 100),
            _ => 0.09,
        };
        (0.5, Some(key_position))
    });
    let sent_forces = play(&mut guarded_device, asked_ticks);
    assert_eq!(sent_forces[..101], [0.5; 101]);
    assert!(sent_forces[105..200].iter().all(|&force| force == 0.0));
    assert_eq!(sent_forces[250..], [0.5; 150]);
    assert_eq!(guarded_device.counts().trips_speed, 1);
}

/// Positions that a key cannot have end the force at once, and only `release` lets it return.
#[test]
fn positions_outside_the_travel_and_jumps_stay_off() {
    let rising_path = |i: i32| 1e-3 * f64::from(i);
    let jumping_path = |i: i32| if i < 20 { 0.0 } else { -0.02 };
    for (positions, why) in [
        (rising_path as fn(i32) -> f64, TripCause::OutsideTravel),
        (jumping_path, TripCause::Jump),
    ] {
        let mut bench = Bench::new();
        bench.spec.pos_range = [-0.05, 0.05];
        let mut guarded_device = GuardedDevice::new(&mut bench, open(), PERIOD);
        let sent_forces = play(&mut guarded_device, (0..100).map(|i| (0.5, Some(positions(i)))));
        // 10 % of the travel beyond its end; the next force is zero.
        let last_forced = sent_forces.iter().rposition(|&force| force != 0.0).unwrap();
        assert_eq!(last_forced, if why == TripCause::Jump { 19 } else { 60 }, "{why:?}");
        assert_eq!(guarded_device.trip_cause(0), Some(why));
        // It stays off for longer than any trip that ends by itself.
        assert!(
            play(&mut guarded_device, still(0.5, 5_000))
                .iter()
                .all(|&force| force == 0.0)
        );
        guarded_device.release();
        assert_eq!(guarded_device.trip_cause(0), None);
        assert_eq!(play(&mut guarded_device, still(0.5, 1_000)).last(), Some(&0.5));
    }
}

/// Every trip that ends by itself stays with the third within a minute; a slower sequence does not.
#[test]
fn third_trip_within_a_minute_persists() {
    for (pause, stays) in [(20_000, true), (40_000, false)] {
        for asked in [Some(f64::NAN), None] {
            let mut bench = Bench::new();
            let limits = SafetyLimits {
                velocity_max: 1.0,
                ..open()
            };
            let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
            for trip in 1..=3 {
                match asked {
                    Some(force) => drop(play(&mut guarded_device, still(force, 1))),
                    // To and fro by 1.5 m/s.
                    None => {
                        let fast_path = (0..20).map(|i| 1.5e-3 * f64::from(10 - (10_i32 - i).abs()));
                        play(&mut guarded_device, fast_path.map(|x| (0.5, Some(x))));
                    }
                }
                let trip_cause = if asked.is_some() {
                    TripCause::NotFinite
                } else {
                    TripCause::Speed
                };
                assert_eq!(guarded_device.trip_cause(0), Some(trip_cause), "trip {trip}");
                let sent_forces = play(&mut guarded_device, still(0.5, pause));
                let is_off = sent_forces.last() == Some(&0.0);
                assert_eq!(is_off, stays && trip == 3, "trip {trip}, pause {pause}");
            }
            guarded_device.release();
            assert_eq!(play(&mut guarded_device, still(0.5, 1_000)).last(), Some(&0.5));
        }
    }
}

/// A device that was lost and returns keeps the trips that stay.
#[test]
fn persistent_trip_survives_a_reconnection() {
    let mut first_bench = Bench::new();
    let mut lost_guarded = GuardedDevice::new(&mut first_bench, open(), PERIOD);
    play(&mut lost_guarded, (0..100).map(|i| (0.5, Some(1e-2 * f64::from(i)))));
    assert!(lost_guarded.trip_cause(0).is_some());
    let mut second_bench = Bench::new();
    let mut guarded_device = GuardedDevice::new(&mut second_bench, open(), PERIOD);
    guarded_device.restore_memory(&lost_guarded.memory());
    assert!(
        play(&mut guarded_device, still(0.5, 1_000))
            .iter()
            .all(|&force| force == 0.0)
    );
    assert_eq!(guarded_device.trip_cause(0), lost_guarded.trip_cause(0));
}

#[test]
fn force_is_zero_without_positions_and_fades_in() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        fade_time: 0.1,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    // No position in the first 5 ticks, and for 50 ticks in the middle.
    let asked_ticks = (0..500).map(|i| {
        let has_position = !(0..5).contains(&i) && !(200..250).contains(&i);
        (1.0, has_position.then_some(0.0))
    });
    let sent_forces = play(&mut guarded_device, asked_ticks);
    assert_eq!(sent_forces[..5], [0.0; 5], "no position yet");
    assert!(sent_forces[6] > 0.0 && sent_forces[6] < sent_forces[50], "fades in");
    assert_eq!(sent_forces[215], 1.0, "20 ms are no matter");
    assert!(sent_forces[221..250].iter().all(|&force| force == 0.0));
    assert!(
        sent_forces[300] > 0.4 && sent_forces[300] < 0.6,
        "fades in again: {}",
        sent_forces[300]
    );
    assert_eq!(sent_forces[360], 1.0);
    assert!(guarded_device.counts().stale > 30);
}

/// A key with a host's spring that is too stiff for the rate: without the observer it swings ever further.
fn runaway(energy: f64) -> (f64, StageCounts) {
    let mut bench = Bench::new();
    bench.spec.force_max_peak = 1e9;
    bench.spec.force_max_continuous = 1e9;
    let limits = SafetyLimits {
        work_max: energy,
        power_max: 1e-3,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    let (m, b, k) = (0.05, 0.1, 2000.0);
    let (mut x, mut v, mut worst_swing) = (1e-3, 0.0, 0.0_f64);
    let mut device_sample = DeviceSample::default();
    for _ in 0..1500 {
        guarded_device.device.position = Some(x);
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        let sent_force = guarded_device.send(&[-k * x]).unwrap().newtons()[0];
        for _ in 0..20 {
            v += (sent_force - b * v) / m * (PERIOD / 20.0);
            x += v * (PERIOD / 20.0);
        }
        worst_swing = worst_swing.max(x.abs());
    }
    (worst_swing, *guarded_device.counts())
}

#[test]
fn created_energy_of_a_loop_is_limited() {
    let (free_swing, _) = runaway(f64::INFINITY);
    let (watched, guarded_counts) = runaway(2e-3);
    assert!(free_swing > 0.5, "it does run away: {free_swing}");
    assert!(watched < 5e-3, "{watched}");
    assert!(guarded_counts.energy > 0);
}

#[test]
fn scale_of_a_stiff_coupling_halves_its_force() {
    let mut bench = Bench::new();
    let mut guarded_device = GuardedDevice::new(&mut bench, open(), PERIOD);
    guarded_device.scale(
        0,
        stiffness::coupling_scale(400.0, stiffness::stable_stiffness_max(0.3, PERIOD, 1)),
    );
    assert_eq!(play(&mut guarded_device, still(1.0, 2)), [0.5, 0.5]);
    assert_eq!(guarded_device.counts().stiff, 2);
}

#[test]
fn stop_by_the_player_ends_force() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        ramp_time: 0.1,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    assert_eq!(play(&mut guarded_device, still(1.0, 200))[150], 1.0);
    guarded_device.set_stopped(true);
    assert_eq!(play(&mut guarded_device, still(1.0, 50)), [0.0; 50]);
    guarded_device.set_stopped(false);
    let sent_forces = play(&mut guarded_device, still(1.0, 120));
    assert!(
        sent_forces[0] < 0.02 && sent_forces[119] == 1.0,
        "as at the start: {}",
        sent_forces[0]
    );
    assert_eq!(guarded_device.counts().stopped, 50);
}

#[test]
fn panic_sends_zero_forces() {
    let mut bench = Bench::new();
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let mut guarded_device = GuardedDevice::new(&mut bench, open(), PERIOD);
        guarded_device.send(&[1.0]).unwrap();
        panic!("physics failed");
    }));
    assert!(panicked.is_err());
    assert_eq!(bench.zeroed, 3);
}

#[test]
fn with_gains_never_increases_a_force() {
    let unit_force = SafeForce::new([1.0; MAX_AXES], 3);
    let mut axis_gains = [1.0; MAX_AXES];
    (axis_gains[0], axis_gains[1], axis_gains[2]) = (-1.0, 5.0, f64::NAN);
    assert_eq!(unit_force.with_gains(&axis_gains).newtons(), [-1.0, 1.0, 0.0]);
}

proptest! {
    /// Whatever is asked and observed, forces stay finite, within the limit, and within the slew limit while nothing
    /// trips.
    #[test]
    fn random_forces_and_positions_stay_within_limits(
        wishes in prop::collection::vec(prop_oneof![
            4 => -5.0..5.0_f64, 1 => any::<f64>()], 1..300),
        places in prop::collection::vec(prop::option::weighted(0.9, -0.05..0.05_f64), 300),
    ) {
        let mut bench = Bench::new();
        let limits = SafetyLimits::from_spec(&bench.spec);
        let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
        let ticks = wishes.iter().copied().zip(places);
        for force in play(&mut guarded_device, ticks) {
            prop_assert!(force.is_finite() && force.abs() <= 2.0);
        }
    }
}
