//! A host that is stopped, a board that lets go, a hot motor: with a clock that the test sets.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::{Bench, PERIOD, open};
use crate::safety::clock::SafetyClock;
use crate::safety::contract::{Device, DeviceLoss, DeviceSample, DeviceSpec};
use crate::safety::{GuardedDevice, SafeForce, SafetyLimits};

/// A board of 20 N with a clock of its own: it lets go after 50 ms of silence.
struct Board {
    spec: DeviceSpec,
    /// Time [ns].
    time: Arc<AtomicU64>,
    last_force: u64,
    /// Whether it reports its own state, such as heat and letting go.
    reports_let_go: bool,
    /// Time for which the host is stopped right before its next write [ns].
    stop: u64,
    sample: DeviceSample,
    answers: bool,
    /// The force of the motor after each packet [N].
    forces: Vec<f64>,
}

const WATCHDOG: u64 = 50_000_000;

impl Board {
    fn new() -> Self {
        Self {
            spec: DeviceSpec {
                force_max_continuous: 4.0,
                force_max_peak: 20.0,
                can_lockstep: false,
                ..Bench::new().spec
            },
            time: Arc::default(),
            last_force: 0,
            reports_let_go: true,
            stop: 0,
            sample: DeviceSample::default(),
            answers: true,
            forces: Vec::new(),
        }
    }

    fn take_force(&mut self, force: f64) {
        let board_time = self.time.load(Ordering::Relaxed);
        self.sample.has_let_go = self.reports_let_go && board_time - self.last_force > WATCHDOG;
        self.last_force = board_time;
        self.forces.push(force);
    }
}

impl Device for Board {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.time.fetch_add(std::mem::take(&mut self.stop), Ordering::Relaxed);
        self.take_force(force.newtons()[0]);
        Ok(())
    }
    fn receive(&mut self, into: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        *into = self.sample;
        Ok(self.answers)
    }
    fn in_lockstep(&self) -> bool {
        false
    }
    fn zero(&mut self) {
        self.take_force(0.0);
    }
}

fn limits(board: &Board) -> SafetyLimits {
    SafetyLimits {
        ramp_time: 0.0,
        ..SafetyLimits::from_spec(&board.spec)
    }
}

/// A host and its board, after a constant force for a second.
struct Host {
    guarded_device: GuardedDevice<Board>,
    time: Arc<AtomicU64>,
    sample: DeviceSample,
}

impl Host {
    fn new(board: Board, force: f64) -> Self {
        let time = Arc::clone(&board.time);
        let limits = limits(&board);
        let guarded_device = GuardedDevice::new(board, limits, PERIOD).with_clock(Arc::clone(&time));
        let mut new_host = Self {
            guarded_device,
            time,
            sample: DeviceSample::default(),
        };
        new_host.look();
        (0..1000).for_each(|_| new_host.tick(force));
        assert_eq!(new_host.last(), force);
        new_host
    }

    fn wait(&self, seconds: f64) {
        let nanoseconds = Duration::from_secs_f64(seconds).as_nanos() as u64;
        self.time.fetch_add(nanoseconds, Ordering::Relaxed);
    }

    fn put(&mut self, force: f64) {
        self.guarded_device.send(&[force]).unwrap();
    }

    fn look(&mut self) {
        self.guarded_device.receive(&mut self.sample, Instant::now()).unwrap();
    }

    fn tick(&mut self, force: f64) {
        self.wait(PERIOD);
        self.put(force);
        self.look();
    }

    fn forces(&self) -> &[f64] {
        &self.guarded_device.device().forces
    }

    fn last(&self) -> f64 {
        *self.forces().last().unwrap()
    }

    /// From packet `from` on the force begins at zero and returns in small steps.
    fn fades_in(&mut self, from: usize, force: f64) {
        (0..400).for_each(|_| self.tick(force));
        let forces_sent = &self.forces()[from..];
        assert!(forces_sent[0].abs() <= 0.05, "{:?}", &forces_sent[..5]);
        let force_steps = forces_sent.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let greatest = force_steps.fold(0.0, f64::max);
        assert!(greatest <= 0.1, "{greatest}");
        assert_eq!(self.last(), force, "it comes back");
    }
}

const STOPS: [f64; 5] = [0.03, 0.06, 0.3, 2.0, 10.0];
/// The last force is more than the slew limit can remove in a tick.
const FORCES: [f64; 3] = [2.03, -4.0, 10.0];

#[test]
fn stall_between_ticks_fades_in() {
    for stop in STOPS {
        for force in FORCES {
            let mut host = Host::new(Board::new(), force);
            host.wait(stop);
            let packet_start = host.forces().len();
            host.fades_in(packet_start, force);
            assert_eq!(host.forces()[packet_start], 0.0);
            assert_eq!(host.guarded_device.counts().stalls, 1);
        }
    }
}

/// The reply that is read after the stop was sent before it.
#[test]
fn stall_before_the_reply_fades_in() {
    for stop in STOPS {
        for force in FORCES {
            let mut host = Host::new(Board::new(), force);
            host.wait(PERIOD);
            host.put(force);
            host.wait(stop);
            host.look();
            let packet_start = host.forces().len();
            host.fades_in(packet_start, force);
            assert_eq!(host.forces()[packet_start], 0.0);
            assert_eq!(host.guarded_device.counts().stalls, 1);
        }
    }
}

/// The only place where nothing can be done in advance: zero follows at once.
#[test]
fn stall_at_the_write_sends_zero_at_once() {
    for stop in STOPS {
        let mut host = Host::new(Board::new(), 4.0);
        host.guarded_device.device.stop = Duration::from_secs_f64(stop).as_nanos() as u64;
        host.wait(PERIOD);
        let packet_start = host.forces().len() + 1;
        host.put(4.0);
        assert_eq!(host.forces()[packet_start..], [0.0], "in the same call");
        host.look();
        host.fades_in(packet_start, 4.0);
    }
}

#[test]
fn slightly_late_host_keeps_its_force() {
    let mut host = Host::new(Board::new(), 4.0);
    host.wait(0.015);
    (0..50).for_each(|_| host.tick(4.0));
    assert!(host.forces()[1000..].iter().all(|force| *force == 4.0));
}

#[test]
fn old_positions_by_the_clock_end_the_force() {
    let mut host = Host::new(Board::new(), 4.0);
    host.guarded_device.device.answers = false;
    // With ticks of 10 ms, an age of two ticks is allowed, one of three is not.
    let forces_sent: Vec<f64> = (0..4)
        .map(|_| {
            host.wait(0.009);
            host.tick(4.0);
            host.last()
        })
        .collect();
    assert_eq!(forces_sent, [4.0, 4.0, 0.0, 0.0]);
    host.guarded_device.device.answers = true;
    host.tick(4.0);
    let packet_start = host.forces().len() - 1;
    host.fades_in(packet_start, 4.0);
}

/// A board may let go for reasons of its own, although its host was never late.
#[test]
fn board_with_released_force_fades_in() {
    for force in FORCES {
        let mut host = Host::new(Board::new(), force);
        host.wait(PERIOD);
        host.put(force);
        host.guarded_device.device.sample.has_let_go = true;
        host.look();
        let packet_start = host.forces().len();
        host.fades_in(packet_start, force);
        assert_eq!(host.forces()[packet_start], 0.0);
        let guarded_counts = host.guarded_device.counts();
        assert_eq!((guarded_counts.let_go, guarded_counts.stalls), (1, 0));
    }
}

#[test]
fn hot_board_receives_its_continuous_force() {
    let board = Board::new();
    let mut host = Host::new(board, 10.0);
    host.guarded_device.device.sample.is_hot = true;
    (0..3).for_each(|_| host.tick(10.0));
    assert_eq!(host.last(), 4.0);
    (0..100).for_each(|_| host.tick(-10.0));
    assert_eq!(host.last(), -4.0, "as long as it says so");
    host.guarded_device.device.sample.is_hot = false;
    (0..5).for_each(|_| host.tick(-10.0));
    assert_eq!(host.last(), -10.0);
}

/// In lockstep the wall clock does not count: the run is the same, however long the machine was held up.
#[test]
fn lockstep_ignores_the_wall_clock() {
    let mut bench = Bench::new();
    let mut guarded_device = GuardedDevice::new(&mut bench, open(), PERIOD);
    assert!(matches!(guarded_device.clock, SafetyClock::Ticks { .. }));
    let mut device_sample = DeviceSample::default();
    for tick in 0..40 {
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        if tick == 20 {
            std::thread::sleep(Duration::from_millis(30));
        }
        guarded_device.send(&[1.0]).unwrap();
    }
    drop(guarded_device);
    assert_eq!(bench.sent, [1.0; 40]);
}

#[test]
fn heat_is_recalled_and_cools() {
    let mut bench = Bench::new();
    let limits = SafetyLimits {
        heat_time: 1.0,
        power_max: 0.1,
        ..open()
    };
    let mut guarded_device = GuardedDevice::new(&mut bench, limits, PERIOD);
    let mut device_sample = DeviceSample::default();
    let mut tick = |guarded_device: &mut GuardedDevice<&mut Bench>| {
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        guarded_device.send(&[2.0]).unwrap().newtons()[0]
    };
    let sent_forces: Vec<f64> = (0..400).map(|_| tick(&mut guarded_device)).collect();
    assert_eq!((sent_forces[0], sent_forces[399]), (2.0, 1.0), "hot");
    let heat_memory = guarded_device.memory();
    drop(guarded_device);
    for (elapsed, force) in [(0.0, 1.0), (0.2, 2.0)] {
        let mut reopened = GuardedDevice::new(&mut bench, limits, PERIOD);
        reopened.pipeline.restore(&heat_memory, elapsed);
        reopened.receive(&mut device_sample, Instant::now()).unwrap();
        assert_eq!(reopened.send(&[2.0]).unwrap().newtons(), [force], "{elapsed} s");
    }
}

/// A position of NaN must not enter the means, where it would stay for ever.
#[test]
fn non_finite_position_trips_and_recovers() {
    let mut host = Host::new(Board::new(), 4.0);
    host.guarded_device.device.sample.position[0] = f64::NAN;
    host.tick(4.0);
    host.guarded_device.device.sample.position[0] = 0.0;
    host.tick(4.0);
    assert_eq!(host.last(), 0.0);
    (0..500).for_each(|_| host.tick(4.0));
    let packet_start = host.forces().len() - 1;
    host.fades_in(packet_start, 4.0);
    assert_eq!(host.guarded_device.counts().trips_not_finite, 1);
    // The velocity is finite again: a key that jumps trips.
    host.guarded_device.device.sample.position[0] = 0.05;
    (0..2).for_each(|_| host.tick(4.0));
    assert_eq!(host.last(), 0.0);
    assert_eq!(host.guarded_device.counts().trips_position, 1);
}
