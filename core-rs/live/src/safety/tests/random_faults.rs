//! Faults of position and force at random ticks, on a key that is emulated here a second time: it shares nothing with
//! `emulate` and `faults` but the trait of a device.

use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::TAU;
use std::time::Instant;

use crate::safety::contract::{Device, Gone, Sample, Spec, Unit};
use crate::safety::{Guarded, Limits, SafeForce, Trip};
use crate::wire::MAX_AXES;

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
    spec: Spec,
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
    /// Since the fault: work of the motor and its greatest value [J], time with a force that is felt [s], greatest force.
    work: f64,
    work_max: f64,
    force_time: f64,
    greatest: f64,
}

impl Key {
    fn new(case: Case) -> Self {
        Self {
            spec: Spec {
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
                touch_gated: false,
                can_lockstep: true,
                can_wide: true,
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
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
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

    fn switch_off(&mut self) -> Result<(), Gone> {
        self.is_off = true;
        let send_result = self.send(&SafeForce::zero(1));
        self.is_off = false;
        send_result
    }

    fn receive(&mut self, into: &mut Sample, _: Instant) -> Result<bool, Gone> {
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
    trips: Vec<(f64, Trip)>,
}

fn play(case: Case, until: f64) -> Outcome {
    let key = Key::new(case);
    let key_limits = Limits::from_spec(key.spec());
    let mut guarded = Guarded::new(key, key_limits, TICK).watched();
    // A performance scales a piece that is too stiff for the device.
    let stable_stiffness = 2.0 * FRICTION / (TICK * (1.0 + 2.0 * case.delay as f64));
    guarded.scale(0, 0.8 * stable_stiffness / case.piece[0]);
    let (mut device_sample, mut position_before, mut trips) = (Sample::default(), 0.0, Vec::new());
    while guarded.device().t < until {
        guarded.receive(&mut device_sample, Instant::now()).unwrap();
        let (time_now, key_position) = (guarded.device().t, device_sample.position[0]);
        let [k, z] = case.piece;
        let asked_force =
            k * (case.piece_path.place(time_now) - key_position) - z * (key_position - position_before) / TICK;
        position_before = key_position;
        let trip_before = guarded.tripped(0);
        guarded.send(&[asked_force]).unwrap();
        if let Some(trip_cause) = guarded.tripped(0).filter(|_| trip_before.is_none()) {
            trips.push((time_now - case.onset, trip_cause));
        }
    }
    let key = guarded.device();
    Outcome {
        force_time: key.force_time,
        work: key.work_max,
        greatest: key.greatest,
        trips,
    }
}

/// What is promised of a fault: longest time for which a force is felt [s], and greatest work on the hand [J].
struct Promise {
    name: &'static str,
    force_time: f64,
    work: f64,
    /// The time is not bounded while less work than this is done [J].
    harmless: f64,
}

/// The work that the passivity stage allows while a case is watched [J].
const ALLOWED: f64 = 1.0 + 0.5 * WATCHED;
/// The work of a channel that is late [J]. An answer that comes 22 to 34 ms late may be taken for one in time: of 2,472
/// cases two pass the allowance, by 0.27 J (24 ms) and 0.002 J (100 ms).
const WORK_IF_LATE: f64 = 1.25 * ALLOWED;
/// A late channel that does more work than this [J] is felt for at most `NOTICEABLE_TIME_IF_LATE` [s].
const HARMLESS_IF_LATE: f64 = 2.0;
const NOTICEABLE_TIME_IF_LATE: f64 = 2.0;

/// A kind of fault, drawn at random, and what is promised of it.
fn faulty(kind: usize, mut case: Case, draw: &mut Draw) -> (Case, Promise) {
    let fault_sign = draw.choice(&[1.0, -1.0]);
    let promise = |name, force_time| Promise {
        name,
        force_time,
        work: ALLOWED,
        harmless: 0.0,
    };
    let promise = match kind {
        0 => {
            let drift_rate = draw.between(0.05, 1.0);
            case.position = Fault::Drift(fault_sign * drift_rate);
            // The drift crosses the travel and its margin, and the hand and the piece may halve its speed.
            promise("position drifts", 0.05 + 2.0 * 1.1 * 2.0 * END / drift_rate)
        }
        1 => {
            case.position = Fault::Scale(-draw.between(1.0, 10.0));
            promise("position reversed and scaled", 1.45)
        }
        2 => {
            case.position = Fault::Offset(fault_sign * draw.between(0.01, 0.1));
            promise("position off", 2e-3)
        }
        3 => {
            case.position = Fault::Noise(draw.between(3e-3, 20e-3));
            promise("position noisy", 0.02)
        }
        4 => {
            case.position = Fault::Freeze;
            promise("position frozen", 0.4)
        }
        5 | 6 => {
            case.force = Fault::Scale(-1.0);
            Promise {
                work: 1.1,
                harmless: 0.05,
                ..promise("motor reversed", 1.45)
            }
        }
        7 => {
            case.position = Fault::Scale(draw.between(2.0, 10.0));
            promise("position scaled", f64::INFINITY)
        }
        8 => {
            case.force = Fault::Freeze;
            promise("motor stuck", f64::INFINITY)
        }
        9 => {
            case.force = Fault::Offset(fault_sign * draw.between(2.0, 10.0));
            promise("motor off", f64::INFINITY)
        }
        10 => {
            case.force = Fault::Drift(fault_sign * draw.between(5.0, 100.0));
            promise("motor drifts", f64::INFINITY)
        }
        11 => {
            // The stages know the force that was commanded.
            let strength = draw.between(1.5, 4.0);
            case.force = Fault::Scale(strength);
            Promise {
                work: strength * ALLOWED,
                ..promise("motor too strong", f64::INFINITY)
            }
        }
        12 => {
            case.force = Fault::Noise(draw.between(1.0, 5.0));
            promise("motor noisy", f64::INFINITY)
        }
        13 => {
            case.position = Fault::Delay(draw.between(20.0, 300.0) as usize);
            Promise {
                work: WORK_IF_LATE,
                harmless: HARMLESS_IF_LATE,
                ..promise("position late", NOTICEABLE_TIME_IF_LATE)
            }
        }
        _ => {
            case.force = Fault::Delay(draw.between(20.0, 300.0) as usize);
            Promise {
                work: WORK_IF_LATE,
                harmless: HARMLESS_IF_LATE,
                ..promise("motor late", NOTICEABLE_TIME_IF_LATE)
            }
        }
    };
    (case, promise)
}

const KINDS: usize = 15;

/// Figures of a kind of fault: felt times [s], works [J], and number of cases that were found.
#[derive(Default)]
struct Figures {
    force_time: Vec<f64>,
    work: Vec<f64>,
    tripped: usize,
}

/// Make `n` faults, print the figures of each kind, and hold the promises.
#[allow(clippy::print_stdout)] // prints a table on request
fn sweep(n: usize, seed: u64, kinds: &[usize]) {
    let mut random_draw = Draw(seed);
    let mut all_figures: BTreeMap<&str, Figures> = BTreeMap::new();
    let mut broken_promises = Vec::new();
    for i in 0..n {
        let case = Case::random(HANDS[i % HANDS.len()], &mut random_draw);
        let (case, promise) = faulty(kinds[i / HANDS.len() % kinds.len()], case, &mut random_draw);
        let case_outcome = play(case, case.onset + WATCHED);
        let tripped_early = case_outcome.trips.iter().any(|trip| trip.0 < 0.0);
        if tripped_early
            || (case_outcome.force_time > promise.force_time + 1e-9 && case_outcome.work > promise.harmless)
            || case_outcome.work > promise.work
            || case_outcome.greatest > FORCE_MAX
        {
            broken_promises.push(format!("{}: {case:?} {case_outcome:?}", promise.name));
        }
        let figures = all_figures.entry(promise.name).or_default();
        figures.force_time.push(case_outcome.force_time);
        figures.work.push(case_outcome.work);
        figures.tripped += usize::from(!case_outcome.trips.is_empty());
    }
    for (name, mut figures) in all_figures {
        figures.force_time.sort_by(f64::total_cmp);
        figures.work.sort_by(f64::total_cmp);
        let (middle_index, last_index) = (figures.force_time.len() / 2, figures.force_time.len() - 1);
        println!(
            "{name:30} {:4} cases, {:4} tripped; force felt {:6.3} s (median), {:6.3} s at most; work {:6.3} J at most",
            last_index + 1,
            figures.tripped,
            figures.force_time[middle_index],
            figures.force_time[last_index],
            figures.work[last_index],
        );
    }
    assert!(
        broken_promises.is_empty(),
        "{} of {n}: {broken_promises:#?}",
        broken_promises.len()
    );
}

#[test]
fn random_faults_end_within_their_bounds() {
    sweep(KINDS * HANDS.len(), 1, &(0..KINDS).collect::<Vec<_>>());
}

#[test]
#[ignore = "a minute: make test-long"]
fn thousand_random_faults_end_within_their_bounds() {
    sweep(1_080, 2, &(0..KINDS).collect::<Vec<_>>());
}

#[test]
#[ignore = "two minutes: make test-long"]
fn reversed_motor_at_random_ticks_under_six_hands() {
    sweep(6_000, 3, &[5]);
}

#[test]
#[ignore = "half a minute: make test-long"]
fn work_of_randomly_late_channels() {
    sweep(2_400, 6, &[13, 14]);
}

/// Trips of hands that play `seconds` each without a fault.
fn healthy(n: usize, seconds: f64, seed: u64) {
    let mut random_draw = Draw(seed);
    for i in 0..n {
        let case = Case {
            onset: f64::INFINITY,
            ..Case::random(HANDS[i % HANDS.len()], &mut random_draw)
        };
        let case_outcome = play(case, seconds);
        assert!(case_outcome.trips.is_empty(), "{case:?} {case_outcome:?}");
    }
}

#[test]
fn healthy_hands_never_trip() {
    healthy(24, 6.0, 4);
}

#[test]
#[ignore = "two minutes: make test-long"]
fn healthy_hands_never_trip_in_ten_hours() {
    healthy(600, 60.0, 5);
}
