//! Inputs of a sound card, and inputs that are told values: playing gives the samples that a render from a recorded
//! file gives, and both follow the formulas.

use std::f64::consts::PI;
use std::sync::Arc;

use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::{DriveKind, InputSource, SoundInSettings, Timeline};
use ergon_engine::units::Rate;

use super::scene::options;

const RATE: f64 = 44_100.0;
const N: usize = 3_000;

const PUSH: SoundInSettings = SoundInSettings {
    source: InputSource::Channel(1),
    gain: 2e-3,
    highpass: Some(200.0),
    clamp: 0.8e-3,
};
const PLACE: SoundInSettings = SoundInSettings {
    source: InputSource::Channel(0),
    gain: 1e-4,
    highpass: None,
    clamp: 1.0,
};

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

/// A free mass, a point whose position is imposed, and a chain that hangs on this point and is heard.
fn network() -> Network {
    let mut network = Network::new();
    network.part("free", None);
    let free = network.mas("m", 5e-3, 0.0, 0.0).unwrap();
    network.part("chain", None);
    let hand = network.mas("hand", 1.0, 0.0, 0.0).unwrap();
    network.set_imposed(hand);
    let tie = Tie::Physical { k: 4e3, z: 2e-3 };
    let first = network.cel("a", 2e-3, tie, 0.0, 0.0, 0.0).unwrap();
    let second = network.cel("b", 2e-3, tie, 0.0, 0.0, 0.0).unwrap();
    network.spring("h", hand, first, 2e3, 1e-2, 0.0).unwrap();
    network.spring("l", first, second, 2e4, 1e-2, 0.0).unwrap();
    for (name, mat) in [("free", free), ("hand", hand), ("end", second)] {
        let listened = Term::Position {
            first: mat,
            len: 1,
            weight: 1.0,
        };
        network.listen(name, vec![listened]).unwrap();
    }
    network
}

/// Two channels of noise, loud enough for the clamp   (N, 2)
fn noise() -> Vec<f32> {
    let mut x = 7_u32;
    let mut next = || {
        x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (f64::from(x) / f64::from(u32::MAX) * 2.0 - 1.0) as f32
    };
    (0..2 * N).map(|_| next()).collect()
}

fn channel(frames: &[f32], channel: usize) -> Vec<f64> {
    let samples = frames.chunks(2).map(|frame| f64::from(frame[channel]));
    samples.collect()
}

/// The network with inputs: recorded samples, or live.
fn timeline(recorded: Option<&[f32]>) -> (Arc<Network>, Timeline) {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let samples = |position| recorded.map_or(Vec::new(), |frames| channel(frames, position));
    for (settings, position, mat, kind) in [
        (PUSH, 1, 0, DriveKind::Force),
        (PLACE, 0, 1, DriveKind::Position),
        (PUSH, 1, 3, DriveKind::Force),
    ] {
        let index = timeline.add_sound_input(settings, &samples(position)).unwrap();
        timeline.drive_by_sound(mat, kind, index, 1.0).unwrap();
    }
    (network, timeline)
}

fn simulation(recorded: Option<&[f32]>) -> Simulation {
    let (network, timeline) = timeline(recorded);
    Simulation::new(network, &timeline, plain()).unwrap()
}

/// Play frames in blocks of this size   (n_frames, 3)
fn played(simulation: &mut Simulation, frames: &[f32], block: usize) -> Vec<f64> {
    let mut sound = Vec::new();
    for frames in frames.chunks(2 * block) {
        let mut out = vec![0.0; frames.len() / 2 * 3];
        simulation.feed_input_samples(frames, 2);
        simulation.process(&mut out).unwrap();
        sound.extend(out);
    }
    sound
}

fn computed(simulation: &mut Simulation) -> Vec<f64> {
    let mut sound = vec![0.0; 3 * N];
    simulation.process(&mut sound).unwrap();
    sound
}

fn output_sound(sound: &[f64], output: usize) -> Vec<f64> {
    sound.iter().skip(output).step_by(3).copied().collect()
}

#[test]
fn live_input_equals_its_recording() {
    let noise = noise();
    let file = computed(&mut simulation(Some(&noise)));
    assert!(file.iter().any(|x| *x != 0.0));
    for block in [44, 64, 1000] {
        assert!(played(&mut simulation(None), &noise, block) == file, "{block}");
    }
    // The samples of the file are not heard while live samples are given.
    let silence = vec![0.5; 2 * N];
    assert!(played(&mut simulation(Some(&silence)), &noise, 64) == file);
    // With a plan, played and rendered samples are equal as well.
    let planned = |recorded| {
        let (network, timeline) = timeline(recorded);
        let plan = Plan::new(network, &timeline, &Budget::default(), None).unwrap();
        Simulation::from_plan(Arc::new(plan), plain()).unwrap()
    };
    let file = computed(&mut planned(Some(&noise)));
    assert!(played(&mut planned(None), &noise, 64) == file);
}

/// x[n+1] = 2x[n] − x[n−1] + F[n]/(M·rate²); F is the output of an analogue Butterworth filter by the bilinear
/// transform.
#[test]
fn input_force_is_filtered_scaled_and_clamped() {
    let noise = noise();
    let sound = output_sound(&computed(&mut simulation(Some(&noise))), 0);
    let k = libm::tan(PI * 200.0 / RATE);
    let norm = 1.0 / (1.0 + std::f64::consts::SQRT_2 * k + k * k);
    let (a1, a2) = (
        2.0 * (k * k - 1.0) * norm,
        (1.0 - std::f64::consts::SQRT_2 * k + k * k) * norm,
    );
    let (mut x1, mut x2, mut y1, mut y2) = (0.0, 0.0, 0.0, 0.0);
    let (mut now, mut before) = (0.0, 0.0);
    let mut n_clamped = 0;
    for (n, (x, got)) in channel(&noise, 1).into_iter().zip(sound).enumerate() {
        let y = norm * (x - 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
        (x1, x2, y1, y2) = (x, x1, y, y1);
        assert!((got - now).abs() < 1e-9 * now.abs().max(1e-9), "{n}: {got} {now}");
        n_clamped += usize::from((2e-3 * y).abs() > 0.8e-3);
        let force = (2e-3 * y).clamp(-0.8e-3, 0.8e-3);
        let next = 2.0 * now - before + force / (5e-3 * RATE * RATE);
        (now, before) = (next, now);
    }
    assert!(n_clamped > N / 10);
}

#[test]
fn input_position_is_reached_at_end_of_frame() {
    let noise = noise();
    let sound = output_sound(&computed(&mut simulation(Some(&noise))), 1);
    assert_eq!(sound[0], 0.0);
    for (n, (x, got)) in channel(&noise, 0).iter().zip(&sound[1..]).enumerate() {
        assert_eq!(*got, 1e-4 * x, "{n}");
    }
}

#[test]
fn take_over_continues_the_input() {
    let noise = noise();
    let complete = played(&mut simulation(None), &noise, 64);
    let mut old = simulation(None);
    let (first, second) = noise.split_at(2 * 64 * 20);
    let mut sound = played(&mut old, first, 64);
    let (network, timeline) = timeline(None);
    let plan = Plan::plain(network, &timeline, false).unwrap();
    let mut new = Simulation::from_plan_at_frame(Arc::new(plan), plain(), 64 * 20).unwrap();
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    sound.extend(played(&mut new, second, 64));
    assert!(sound == complete);
}

/// If a mesh is stepped finer, an input position is interpolated linearly and an input force is held: the result is
/// near that of whole frames.
#[test]
fn input_with_finer_steps_is_interpolated() {
    let mut noise = noise();
    // Frequencies low enough for steps of a whole frame.
    let mut low = [0.0_f32; 2];
    for frame in noise.chunks_mut(2) {
        for (x, low) in frame.iter_mut().zip(&mut low) {
            *low += 0.02 * (*x - *low);
            *x = *low;
        }
    }
    let (network, timeline) = timeline(Some(&noise));
    let source = |method| {
        let budget = Budget::Method(method);
        let plan = Plan::new(network.clone(), &timeline, &budget, None).unwrap();
        let mut simulation = Simulation::from_plan(Arc::new(plan), plain()).unwrap();
        output_sound(&computed(&mut simulation), 2)
    };
    let (coarse, fine) = (source(Method::Ca), source(Method::Bm4));
    let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
    let error: Vec<f64> = coarse.iter().zip(&fine).map(|(x, y)| x - y).collect();
    assert!(
        rms(&fine) > 0.0 && rms(&error) < 0.02 * rms(&fine),
        "{} of {}",
        rms(&error),
        rms(&fine)
    );
}

#[test]
fn input_with_wrong_settings_is_refused() {
    let (_, mut timeline) = timeline(None);
    for wrong in [
        SoundInSettings { gain: f64::NAN, ..PUSH },
        SoundInSettings { clamp: 0.0, ..PUSH },
        SoundInSettings {
            clamp: f64::INFINITY,
            ..PUSH
        },
        SoundInSettings {
            highpass: Some(0.0),
            ..PUSH
        },
        SoundInSettings {
            highpass: Some(0.5 * RATE),
            ..PUSH
        },
        SoundInSettings {
            gain: 0.0,
            ..value_input(1, 0.1)
        },
        value_input(1, -1.0),
        value_input(1, f64::NAN),
        value_input(1, 61.0),
    ] {
        assert!(timeline.add_sound_input(wrong, &[]).is_err(), "{wrong:?}");
    }
    let index = timeline.add_sound_input(PUSH, &[f64::NAN, 1.0]).unwrap();
    assert!(timeline.drive_by_sound(0, DriveKind::Force, index + 1, 1.0).is_err());
    assert!(timeline.drive_by_sound(0, DriveKind::Force, index, f64::NAN).is_err());
    assert!(timeline.drive_by_sound(1, DriveKind::Position, index, 1.0).is_err());
}

/// Settings of an input that is told its value, by number.
fn value_input(number: u64, glide: f64) -> SoundInSettings {
    SoundInSettings {
        source: InputSource::Value { number, glide },
        gain: -2e-3,
        highpass: None,
        clamp: 3e-3,
    }
}

/// Values told: frame, number, value.
const VALUES: [(usize, u64, f64); 6] = [
    (500, 8, 0.5),
    (700, 8, -0.75),
    (710, 9, 1.0),
    (711, 9, 0.25),
    (1_500, 8, 40.0),
    (2_500, 8, 0.0),
];
const GLIDE: f64 = 0.01;
const BEFORE: [f64; 520] = [0.125; 520];

/// A mass that one input pushes and a point that another moves, each with its output.
fn value_timeline() -> (Arc<Network>, Timeline) {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    for (settings, mat, kind) in [
        (value_input(8, GLIDE), 0, DriveKind::Force),
        (value_input(9, 0.0), 1, DriveKind::Position),
    ] {
        let index = timeline.add_sound_input(settings, &BEFORE).unwrap();
        timeline.drive_by_sound(mat, kind, index, 1.0).unwrap();
    }
    (network, timeline)
}

/// Outputs up to frame `stop`, in blocks of at most `block` frames   (n_frames, 3)
fn as_told(simulation: &mut Simulation, stop: usize, block: usize) -> Vec<f64> {
    let mut sound = Vec::new();
    while (simulation.frame() as usize) < stop {
        let now = simulation.frame() as usize;
        for &(_, number, value) in VALUES.iter().filter(|(at, ..)| *at == now) {
            assert!(simulation.set_input(number, value));
        }
        let next = VALUES.iter().map(|(at, ..)| *at).find(|&at| at > now);
        let until = (now + block).min(stop).min(next.unwrap_or(stop));
        let mut out = vec![0.0; 3 * (until - now)];
        simulation.process(&mut out).unwrap();
        sound.extend(out);
    }
    sound
}

/// The expected value of an input at each frame [m or N], computed frame by frame.
fn walked(number: u64, glide: f64) -> Vec<f64> {
    let (mut now, mut goal, mut left) = (BEFORE[0], None, 0.0);
    let values = (0..N).map(|n| {
        if goal.is_none() {
            now = BEFORE.get(n).copied().unwrap_or(0.0);
        }
        let output = VALUES.iter().filter(|one| (one.0, one.1) == (n, number));
        for &(_, _, value) in output {
            (goal, left) = (Some(value.clamp(-1.5, 1.5)), (glide * RATE).round().max(1.0));
        }
        if let Some(goal) = goal
            && left > 0.0
        {
            now += (goal - now) / left;
            left -= 1.0;
        }
        (-2e-3 * now).clamp(-3e-3, 3e-3)
    });
    values.collect()
}

/// The file is heard up to the first value; then each value is reached on a straight line and held. The clamp still
/// acts.
#[test]
fn input_target_is_reached_linearly_and_constant() {
    let simulation = || {
        let (network, timeline) = value_timeline();
        Simulation::new(network, &timeline, plain()).unwrap()
    };
    let complete = as_told(&mut simulation(), N, 1000);
    assert!(complete == as_told(&mut simulation(), N, 7));
    let (mut now, mut before) = (0.0, 0.0);
    for (n, force) in walked(8, GLIDE).into_iter().enumerate() {
        let got: f64 = complete[3 * n];
        assert!((got - now).abs() < 1e-9 * now.abs().max(1e-6), "{n}: {got} {now}");
        let next = 2.0 * now - before + force / (5e-3 * RATE * RATE);
        (now, before) = (next, now);
    }
    let places = output_sound(&complete, 1);
    for (n, (x, got)) in walked(9, 0.0).iter().zip(&places[1..]).enumerate() {
        assert!((got - x).abs() < 1e-17, "{n}: {got} {x}");
    }
    let mut single = simulation();
    assert!(!single.set_input(7, 1.0), "no input has this number");
    assert!(!single.set_input(8, f64::NAN) && !single.set_input(8, f64::INFINITY));
    assert!(single.n_channels_in() == 0);
}

/// Another version continues the way to the values told, at any frame of it, with and without a plan.
#[test]
fn take_over_continues_towards_input_targets() {
    let plan = |planned: bool| {
        let (network, timeline) = value_timeline();
        let plan = if planned {
            Plan::new(network, &timeline, &Budget::default(), None)
        } else {
            Plan::plain(network, &timeline, false)
        };
        Arc::new(plan.unwrap())
    };
    let complete = as_told(&mut Simulation::from_plan(plan(false), plain()).unwrap(), N, 64);
    for (position, is_planned) in [(400, false), (640, false), (760, false), (2_000, true)] {
        let mut old = Simulation::from_plan(plan(is_planned), plain()).unwrap();
        let mut sound = as_told(&mut old, position, 64);
        let mut new = Simulation::from_plan_at_frame(plan(is_planned), plain(), position as u64).unwrap();
        let mut takeover = Takeover::new(&old, &new);
        assert!(new.take_over(&mut old, &mut takeover));
        sound.extend(as_told(&mut new, N, 64));
        if is_planned {
            let off = sound.iter().zip(&complete).map(|(x, y)| (x - y).abs());
            assert!(off.fold(0.0, f64::max) < 1e-9);
        } else {
            assert!(sound == complete, "{position}");
        }
    }
}
