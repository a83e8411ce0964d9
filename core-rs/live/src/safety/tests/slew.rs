//! Whatever happens, no force rises faster than the slew limit.

use std::time::Instant;

use super::{Bench, PERIOD};
use crate::safety::contract::{Device, DeviceLoss, DeviceSample, DeviceSpec};
use crate::safety::{GuardedDevice, SafeForce, SafetyLimits};

/// Numbers drawn by xorshift64 (Marsaglia, 2003).
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A number between -1 and 1.
    fn even(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// True once in `n` draws on average.
    fn once_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }
}

/// A board with all kinds of faults at random.
struct FaultyBoard {
    spec: DeviceSpec,
    sample: DeviceSample,
    answers: bool,
}

impl Device for FaultyBoard {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }
    fn send(&mut self, _: &SafeForce) -> Result<(), DeviceLoss> {
        Ok(())
    }
    fn receive(&mut self, into: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        *into = self.sample;
        Ok(self.answers)
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {}
}

/// Number of ticks in which a force rose, or changed its sign, by more than the limit.
fn too_fast(ticks: u64, seed: u64) -> u64 {
    let mut random_draw = Draw(seed);
    let mut board = FaultyBoard {
        spec: DeviceSpec {
            force_max_peak: 20.0,
            force_max_continuous: 10.0,
            ..Bench::new().spec
        },
        sample: DeviceSample::default(),
        answers: true,
    };
    let board_limits = SafetyLimits {
        trip_time: 0.02,
        fade_time: 0.02,
        ramp_time: 0.02,
        heat_time: 0.5,
        ..SafetyLimits::from_spec(&board.spec)
    };
    let force_step = board_limits.slew_rate_max * 1e3 * PERIOD * (1.0 + 1e-12);
    let mut guarded_device = GuardedDevice::new(&mut board, board_limits, PERIOD);
    let mut device_sample = DeviceSample::default();
    let (mut asked_force, mut travel_per_tick, mut last_force, mut stopped) = (0.0, 0.0, 0.0_f64, false);
    let mut fast_changes = 0;
    for _ in 0..ticks {
        if random_draw.once_in(50) {
            asked_force = match random_draw.next() % 8 {
                0 => 0.0,
                1 => f64::NAN,
                2 => 1e300 * random_draw.even(),
                _ => 25.0 * random_draw.even(),
            };
            travel_per_tick = if random_draw.once_in(20) { 20.0 } else { 2.0 } * PERIOD * random_draw.even();
        }
        let board = &mut guarded_device.device;
        let next_position = board.sample.position[0] + travel_per_tick;
        board.sample.position[0] = if next_position.abs() < 0.05 { next_position } else { 0.0 };
        board.answers = !random_draw.once_in(10) && (board.answers || random_draw.once_in(10));
        board.sample.has_let_go = random_draw.once_in(500);
        board.sample.is_hot = random_draw.once_in(30);
        match random_draw.next() % 1_000 {
            0 => {
                stopped = !stopped;
                guarded_device.set_stopped(stopped);
                last_force = 0.0;
            }
            1 => {
                guarded_device.zero();
                last_force = 0.0;
            }
            2 => guarded_device.scale(0, random_draw.even()),
            _ => {}
        }
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        let sent_force = guarded_device.send(&[asked_force]).unwrap().newtons()[0];
        let is_falling = sent_force * last_force >= 0.0 && sent_force.abs() <= last_force.abs();
        fast_changes += u64::from(!is_falling && (sent_force - last_force).abs() > force_step);
        last_force = sent_force;
    }
    let guarded_counts = guarded_device.counts();
    for (name, count) in guarded_counts.named() {
        let by_the_wall = name == "stalls of the host";
        assert!(count > 0 || by_the_wall, "{name}: never in {ticks} ticks");
    }
    fast_changes
}

#[test]
fn slew_limit_bounds_rises() {
    assert_eq!(too_fast(300_000, 1), 0);
}

#[test]
#[ignore = "seconds: make test-long"]
fn slew_limit_bounds_rises_in_ten_million_ticks() {
    assert_eq!(too_fast(10_000_000, 2), 0);
}
