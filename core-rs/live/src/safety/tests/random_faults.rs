//! Faults of position and force at random ticks, on a key that is emulated here a second time: it shares nothing with
//! `emulate` and `faults` but the trait of a device.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::time::Instant;

use crate::safety::contract::{Device, DeviceLoss, DeviceSample, DeviceSpec, Unit};
use crate::safety::{GuardedDevice, SafeForce, SafetyLimits, TripCause};
use crate::wire::MAX_AXES;

mod promises;

/// Period of the ticks [s], and steps of the key in each.
const TICK: f64 = 1e-3;
const SUBSTEPS: usize = 8;
const FORCE_MAX: f64 = 20.0;
const MASS: f64 = 0.05;
const FRICTION: f64 = 1.0;
const END: f64 = 0.05;
/// A force that is felt [N]: its time is bounded.
const NOTICEABLE_FORCE: f64 = 0.3;
/// How long a key is watched after the fault [s].
const WATCHED: f64 = 4.0;
/// Number of ticks that a channel can be late.
const LATE_MAX: usize = 512;

/// Hands [N/m, N·s/m]: nobody, then ever firmer.
const HANDS: [[f64; 2]; 6] = [
    [0.0, 0.0],
    [100.0, 1.0],
    [400.0, 4.0],
    [800.0, 8.0],
    [1500.0, 10.0],
    [3000.0, 20.0],
];
/// Springs of the piece [N/m, N·s/m].
const PIECES: [[f64; 2]; 6] = [
    [200.0, 0.0],
    [300.0, 0.0],
    [300.0, 0.0],
    [500.0, 0.0],
    [800.0, 1.0],
    [1500.0, 1.0],
];

/// Numbers drawn by xorshift64 (Marsaglia, 2003).
struct Draw(u64);

impl Draw {
    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 >> 11
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() as f64 / (1_u64 << 53) as f64)
    }

    fn choice<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.bits() >> 8) as usize % all.len()]
    }

    /// A number with a standard deviation of 1.
    fn noise(&mut self) -> f64 {
        (0..12).map(|_| self.between(0.0, 1.0)).sum::<f64>() - 6.0
    }
}

/// A path of a hand or of a piece [m].
#[derive(Clone, Copy, Debug)]
enum Path {
    Still(f64),
    /// Amplitude [m] and frequency [Hz].
    Sine(f64, f64),
    /// Time between strokes [s], their depth [m], and a number that varies their lengths.
    Strokes(f64, f64, f64),
}

impl Path {
    fn place(&self, t: f64) -> f64 {
        let smooth_step = |t: f64| {
            let t = t.clamp(0.0, 1.0);
            t * t * t * (10.0 + t * (6.0 * t - 15.0))
        };
        match *self {
            Self::Still(x) => x,
            Self::Sine(far, hertz) => far * libm::sin(TAU * hertz * t),
            Self::Strokes(every, deep, salt) => {
                let stroke_index = libm::floor(t / every);
                let random_share = |k: f64| {
                    let x = libm::sin(stroke_index * 12.9898 + (k + salt) * 78.233) * 43_758.547;
                    x - libm::floor(x)
                };
                let (time_in_stroke, stroke_time) = (t - stroke_index * every, 0.06 + 0.14 * random_share(1.0));
                let release_time = stroke_time + 0.5 * every * random_share(3.0);
                let hand_tremor = 5e-5 * libm::sin(57.0 * t) + 3e-5 * libm::sin(71.3 * t);
                deep * random_share(2.0)
                    * (smooth_step(time_in_stroke / stroke_time)
                        - smooth_step((time_in_stroke - release_time) / stroke_time))
                    + hand_tremor
            }
        }
    }
}

/// A fault of a channel.
#[derive(Clone, Copy, Debug)]
enum Fault {
    Nothing,
    /// Growth [units/s].
    Drift(f64),
    Scale(f64),
    Offset(f64),
    /// [ticks]
    Delay(usize),
    /// Standard deviation.
    Noise(f64),
    Freeze,
}

/// A channel of a device with its fault.
struct Channel {
    fault: Fault,
    past: VecDeque<f64>,
    frozen: Option<f64>,
}

impl Channel {
    fn new(fault: Fault) -> Self {
        Self {
            fault,
            past: VecDeque::from(vec![0.0; LATE_MAX]),
            frozen: None,
        }
    }

    /// What comes out for `value`, `since` [s] after the fault began, if it did.
    fn pass(&mut self, value: f64, since: Option<f64>, draw: &mut Draw) -> f64 {
        self.past.push_front(value);
        self.past.truncate(LATE_MAX);
        let Some(since) = since else { return value };
        match self.fault {
            Fault::Nothing => value,
            Fault::Drift(rate) => value + rate * since,
            Fault::Scale(factor) => factor * value,
            Fault::Offset(by) => value + by,
            Fault::Delay(ticks) => self.past[ticks],
            Fault::Noise(deviation) => value + deviation * draw.noise(),
            Fault::Freeze => *self.frozen.get_or_insert(value),
        }
    }
}

/// A key, a hand, a piece and a fault.
#[derive(Clone, Copy, Debug)]
struct Case {
    hand: [f64; 2],
    /// Mass of the hand that moves with the key [kg].
    hand_mass: f64,
    hand_path: Path,
    piece: [f64; 2],
    piece_path: Path,
    /// Delay of forces that the device does not report [ticks].
    delay: usize,
    resolution: f64,
    position: Fault,
    force: Fault,
    /// When the fault begins [s].
    onset: f64,
    seed: u64,
}

impl Case {
    fn random(hand: [f64; 2], draw: &mut Draw) -> Self {
        let is_firmest = hand[0] >= 3000.0;
        let strokes = Path::Strokes(
            draw.between(0.4, 1.2),
            draw.between(5e-3, 30e-3),
            draw.between(0.0, 100.0),
        );
        // Nobody makes wide strokes with so firm a grip.
        let [greatest_swing, greatest_rate] = if is_firmest { [3e-3, 1.0] } else { [12e-3, 3.0] };
        let sine_path = Path::Sine(draw.between(1e-3, greatest_swing), draw.between(0.3, greatest_rate));
        let still_path = Path::Still(draw.between(-0.01, 0.01));
        let widest_path = if is_firmest { still_path } else { strokes };
        let hand_path = draw.choice(&[still_path, sine_path, widest_path]);
        let target_path = Path::Sine(draw.between(4e-3, 20e-3), draw.between(0.3, 2.0));
        let fixed_path = Path::Still(draw.between(-0.02, 0.02));
        Self {
            hand,
            hand_mass: draw.choice(&[0.0, 0.05, 0.15]),
            hand_path,
            piece: draw.choice(&PIECES),
            piece_path: draw.choice(&[target_path, fixed_path]),
            delay: draw.choice(&[0, 1]),
            resolution: draw.choice(&[1e-8, 1e-8, 1e-5]),
            position: Fault::Nothing,
            force: Fault::Nothing,
            onset: draw.between(3.0, 6.0),
            seed: draw.bits() | 1,
        }
    }
}

struct Key {
    case: Case,
    spec: DeviceSpec,
    x: f64,
    v: f64,
    t: f64,
    /// Forces under way.
    commands: VecDeque<f64>,
    position: Channel,
    force: Channel,
    is_off: bool,
    draw: Draw,
    reported: f64,
    /// Since the fault: work of the motor and its greatest value [J], time with a force that is felt [s], greatest
    /// force.
    work: f64,
    work_max: f64,
    force_time: f64,
    greatest: f64,
}

impl Key {
    fn new(case: Case) -> Self {
        Self {
            spec: DeviceSpec {
                dof: 1,
                unit: Unit::Metre,
                pos_lsb: case.resolution,
                pos_range: [-END, END],
                force_max_continuous: FORCE_MAX,
                force_max_peak: FORCE_MAX,
                force_lsb: 0.0,
                rate_nominal: None,
                loop_delay_s: None,
                inertia: Some(MASS),
                damping: Some(FRICTION),
                is_touch_gated: false,
                can_lockstep: true,
                can_send_wide: true,
            },
            x: 0.0,
            v: 0.0,
            t: 0.0,
            commands: VecDeque::from(vec![0.0; case.delay]),
            position: Channel::new(case.position),
            force: Channel::new(case.force),
            is_off: false,
            draw: Draw(case.seed),
            reported: 0.0,
            work: 0.0,
            work_max: 0.0,
            force_time: 0.0,
            greatest: 0.0,
            case,
        }
    }

    fn since(&self) -> Option<f64> {
        (self.t >= self.case.onset).then_some(self.t - self.case.onset)
    }
}

impl Device for Key {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.commands.push_back(force.newtons()[0]);
        let command = self.commands.pop_front().unwrap_or(0.0);
        let fault_age = self.since();
        let received_force = self.force.pass(command, fault_age, &mut self.draw);
        let motor_force = if self.is_off {
            0.0
        } else {
            received_force.clamp(-FORCE_MAX, FORCE_MAX)
        };
        let substep = TICK / SUBSTEPS as f64;
        let moving_mass = MASS + self.case.hand_mass;
        let [k, z] = self.case.hand;
        for _ in 0..SUBSTEPS {
            let hand_path = self.case.hand_path;
            let (hand_now, hand_before) = (hand_path.place(self.t), hand_path.place(self.t - substep));
            let grip_force = k * (hand_now - self.x) + z * ((hand_now - hand_before) / substep - self.v);
            self.v += (motor_force + grip_force - FRICTION * self.v) / moving_mass * substep;
            let position_before = self.x;
            self.x += self.v * substep;
            if self.x.abs() > END {
                (self.x, self.v) = (END.copysign(self.x), 0.0);
            }
            if fault_age.is_some() {
                self.work += motor_force * (self.x - position_before);
                self.work_max = self.work_max.max(self.work);
            }
            self.t += substep;
        }
        if fault_age.is_some() {
            self.force_time += if motor_force.abs() >= NOTICEABLE_FORCE {
                TICK
            } else {
                0.0
            };
            self.greatest = self.greatest.max(motor_force.abs());
        }
        let fault_age = self.since();
        let sensed_position = self.position.pass(self.x, fault_age, &mut self.draw);
        self.reported = (sensed_position / self.case.resolution).round() * self.case.resolution;
        Ok(())
    }

    fn switch_off(&mut self) -> Result<(), DeviceLoss> {
        self.is_off = true;
        let send_result = self.send(&SafeForce::zero(1));
        self.is_off = false;
        send_result
    }

    fn receive(&mut self, into: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        into.position = [self.reported; MAX_AXES];
        Ok(true)
    }

    fn in_lockstep(&self) -> bool {
        true
    }

    fn zero(&mut self) {}
}

/// What came of a case.
#[derive(Debug)]
struct Outcome {
    force_time: f64,
    work: f64,
    greatest: f64,
    /// Trips, each with its time from the fault [s].
    trips: Vec<(f64, TripCause)>,
}

fn play(case: Case, until: f64) -> Outcome {
    let key = Key::new(case);
    let key_limits = SafetyLimits::from_spec(key.spec());
    let mut guarded_device = GuardedDevice::new(key, key_limits, TICK).with_plausibility();
    // A performance scales a piece that is too stiff for the device.
    let stable_stiffness = 2.0 * FRICTION / (TICK * (1.0 + 2.0 * case.delay as f64));
    guarded_device.scale(0, 0.8 * stable_stiffness / case.piece[0]);
    let (mut device_sample, mut position_before, mut trips) = (DeviceSample::default(), 0.0, Vec::new());
    while guarded_device.device().t < until {
        guarded_device.receive(&mut device_sample, Instant::now()).unwrap();
        let (time_now, key_position) = (guarded_device.device().t, device_sample.position[0]);
        let [k, z] = case.piece;
        let asked_force =
            k * (case.piece_path.place(time_now) - key_position) - z * (key_position - position_before) / TICK;
        position_before = key_position;
        let trip_before = guarded_device.trip_cause(0);
        guarded_device.send(&[asked_force]).unwrap();
        if let Some(trip_cause) = guarded_device.trip_cause(0).filter(|_| trip_before.is_none()) {
            trips.push((time_now - case.onset, trip_cause));
        }
    }
    let key = guarded_device.device();
    Outcome {
        force_time: key.force_time,
        work: key.work_max,
        greatest: key.greatest,
        trips,
    }
}
