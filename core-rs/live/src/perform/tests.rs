//! Ticks by hand: nothing is allocated in them, whatever happens to the keys meanwhile.

use std::sync::Arc;
use std::time::Duration;

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::law::Law;
use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{OnFault, Options, Takeover};
use ergon_engine::timeline::{DriveKind, HandWay, SoundInSettings, Timeline};
use ergon_engine::units::Rate;

use super::*;
use crate::device::{Ending, Url};
use crate::recording::{Axis, flag, read};

pub(super) mod unplugged;
mod windows;

use unplugged::Unplugged;

const RATE: f64 = 44_100.0;
const EVERY: usize = 44;
const TICKS: u64 = 6_000;
const KEY: &str = "emul:?mass=0.05&damping=1";

fn keyboard(hand: usize, left: u32) -> Keyboard {
    let url = Url::parse(KEY).unwrap();
    let key = crate::device::open(&url).unwrap();
    let brief = Box::new(Unplugged { key, left });
    let known = DeviceConfig {
        url,
        calibration: Vec::new(),
        most: None,
        period: EVERY as f64 / RATE,
        ending: Ending::default(),
    };
    Keyboard::around(brief, known, vec![(0, hand)])
}

const OPTIONS: Options = Options {
    ledger: false,
    record: false,
    on_fault: OnFault::Mute,
    threads: 1,
    unchecked: false,
};

/// Two keys and a mass between them that swings and is heard.
fn network() -> Network {
    let mut network = Network::new();
    network.part("keys", None);
    let tie = Tie::Physical { k: 60.0, z: 1.2 };
    let a = network.cel("a", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    let b = network.cel("b", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    let swinging = Tie::Physical { k: 50.0, z: 0.0 };
    let m = network.cel("m", 0.01, swinging, 4e-3, 0.0, 0.0).unwrap();
    network.spring("am", a, m, 40.0, 0.01, 0.0).unwrap();
    network.spring("bm", b, m, 40.0, 0.01, 0.0).unwrap();
    let heard = Term::Position {
        first: m,
        len: 1,
        weight: 1.0,
    };
    network.listen("out", vec![heard]).unwrap();
    network
}

/// Both keys held, the mass struck at some instants [s].
fn simulation(struck: &[f64], from: u64) -> Simulation {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    for mat in [0, 1] {
        let way = HandWay::Line;
        timeline
            .hand(&network, mat, EVERY as u32, way, &[])
            .unwrap();
    }
    for &at in struck {
        timeline.strike(&network, 2, at, 1e-3, 0).unwrap();
    }
    let plan = Plan::new(network, &timeline, &Budget::default(), None).unwrap();
    Simulation::planned_from(Arc::new(plan), OPTIONS, from).unwrap()
}

fn stage_mixer() -> Mixer {
    let mut mixer = Mixer::new(RATE, 1, 2);
    mixer.route(0, 0, 1.0, None).unwrap();
    mixer.route(0, 1, 0.5, Some(8.0)).unwrap();
    mixer
}

fn stage() -> Stage {
    let mixer = stage_mixer();
    let hand = Hand {
        standin: (0..TICKS).map(|n| 1e-6 * (n % 1_000) as f64).collect(),
        reach: 1.0,
        guidance: Some(Guidance {
            k: 50.0,
            z: 0.5,
            loose: false,
        }),
        ..Hand::default()
    };
    Stage {
        simulation: simulation(&[], 0),
        mixer,
        gain: 1.0,
        fold: None,
        limiter: Limiter::new(RATE, 2, 1.0).unwrap(),
        n_frames: None,
        fades: None,
        tick_frames: EVERY,
        hands: vec![hand; 2],
        bars: (0..).map(|bar| bar * 4_410).take(1_000).collect(),
        frozen: Vec::new(),
        is_seen: false,
    }
}

/// Versions that strike otherwise, one of them too late: what is heard is what a replay of them gives, and no tick
/// allocates.
#[test]
fn changes_are_done_at_their_frames() {
    let path = std::env::temp_dir().join(format!("ergon-changes-{}.wav", std::process::id()));
    let config = PlaybackConfig {
        audio: format!("file:{}", path.display()).parse().unwrap(),
        ahead: None,
        record: None,
        input: InputConfig::default(),
    };
    let (every, n_ticks) = (EVERY as u64, 600_u64);
    let mut offline = simulation(&[], 0);
    let stage = Stage {
        simulation: offline.fork(),
        n_frames: Some(n_ticks * every),
        ..stage()
    };
    let mixer = |gain: f64| {
        let mut mixer = Mixer::new(RATE, 1, 2);
        mixer.route(0, 0, gain, None).unwrap();
        mixer.route(0, 1, 0.5, Some(8.0)).unwrap();
        mixer
    };
    let frames = [100, 250, 90, 300].map(|tick| tick * every);
    let struck = [&[0.15][..], &[0.15, 0.3, 0.35], &[0.2], &[0.4]];
    let (mut this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    let versions = frames.map(|from| {
        simulation(
            struck[frames.iter().position(|at| *at == from).unwrap()],
            from,
        )
    });
    player.begin();
    reset_violation_count();
    let mut tick_by_hand = |ticks: u64| {
        assert_no_alloc(|| (0..ticks).for_each(|_| assert!(player.tick())));
    };
    tick_by_hand(50);
    let change = |at: usize, old: &Simulation, gain: f64| Change {
        simulation: Some((versions[at].fork(), Takeover::new(old, &versions[at]))),
        mixer: Some(mixer(gain)),
        gain: Some(0.7),
        bars: Some(vec![0, 1_000]),
        ..Change::default()
    };
    let first = this.change(frames[0], change(0, &offline, 0.9)).unwrap();
    tick_by_hand(70);
    let late = this
        .change(frames[2], change(2, &versions[0], 0.1))
        .unwrap();
    let second = this
        .change(frames[1], change(1, &versions[0], 0.4))
        .unwrap();
    let of_another = this
        .change(frames[3], change(3, &simulation(&[], 0), 0.2))
        .unwrap();
    assert!(this.change(frames[1] + 1, Change::default()).is_err());
    assert!(
        this.change(frames[1], change(0, &offline, 1.0)).is_err(),
        "begins elsewhere"
    );
    tick_by_hand(n_ticks - 120);
    while player.tick() {}
    assert_eq!(violation_count(), 0);
    let events: Vec<_> = std::iter::from_fn(|| this.event())
        .map(|event| (event.frame, event.kind))
        .collect();
    assert_eq!(
        events,
        [
            (frames[0], EventKind::Changed(first)),
            (120 * every, EventKind::Late(late)),
            (frames[1], EventKind::Changed(second)),
            (frames[3], EventKind::Late(of_another)),
        ]
    );
    player.connections.feed.close();
    drop(player);
    this.close(PATIENCE).unwrap();

    let mut sound = Vec::new();
    let mut limiter = Limiter::new(RATE, 2, 1.0).unwrap();
    let (mut mix, mut gain) = (mixer(1.0), ergon_engine::mix::glide::Glide::new(RATE, 1.0));
    for tick in 0..n_ticks {
        for (at, part) in [(0, 0.9), (1, 0.4)] {
            if tick * every == frames[at] {
                let mut next = versions[at].fork();
                let mut takeover = Takeover::new(&offline, &next);
                assert!(next.take_over(&mut offline, &mut takeover));
                offline = next;
                let mut other = mixer(part);
                other.take_over(&mut mix, None);
                mix = other;
                gain.set(0.7);
            }
        }
        for hand in 0..2 {
            offline.hold(hand, 1e-6 * (tick % 1_000) as f64, None);
        }
        let (mut heard, mut mixed) = (vec![0.0; EVERY], vec![0.0; 2 * EVERY]);
        offline.process(&mut heard).unwrap();
        mix.process(&heard, &mut mixed);
        gain.apply(tick * every, &mut mixed, 2);
        limiter.process(&mut mixed);
        sound.extend(mixed.iter().map(|x| (*x as f32).to_bits()));
    }
    let bytes = std::fs::read(&path).unwrap();
    std::fs::remove_file(path).unwrap();
    let latency = 2 * limiter.latency();
    let data = &bytes[bytes.len() - 4 * sound.len()..];
    let played: Vec<u32> = data
        .chunks(4)
        .map(|x| u32::from_le_bytes(x.try_into().unwrap()))
        .collect();
    assert_eq!(played[..sound.len() - latency], sound[latency..]);
    assert!(played.iter().any(|x| *x != 0));
}

/// What is heard of a fold is the mix through it, to the end of its filters; no tick allocates.
#[test]
fn a_fold_sounds_to_its_end() {
    let path = std::env::temp_dir().join(format!("ergon-fold-{}.wav", std::process::id()));
    let config = PlaybackConfig {
        audio: format!("file:{}", path.display()).parse().unwrap(),
        ahead: None,
        record: None,
        input: InputConfig::default(),
    };
    let n_frames = 100 * EVERY + 7;
    let filters: Vec<f64> = (0..2 * 3 * 150)
        .map(|n| 0.3 * libm::sin(f64::from(n)))
        .collect();
    let mut fold = Fold::new(2, 3, &filters).unwrap();
    let mut offline = simulation(&[0.01, 0.1], 0);
    let stage = Stage {
        simulation: offline.fork(),
        n_frames: Some(n_frames as u64),
        fold: Some(fold.clone()),
        limiter: Limiter::new(RATE, 3, 1.0).unwrap(),
        ..stage()
    };
    let mut mix = stage.mixer.clone();
    let (this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    player.begin();
    reset_violation_count();
    assert_no_alloc(|| while player.tick() {});
    assert_eq!(violation_count(), 0);
    player.connections.feed.close();
    drop(player);
    this.close(PATIENCE).unwrap();

    let mut limiter = Limiter::new(RATE, 3, 1.0).unwrap();
    let n_heard = n_frames + fold.tail();
    let (mut heard, mut mixed) = (vec![0.0; n_frames], vec![0.0; 2 * n_frames]);
    for (tick, heard) in heard.chunks_mut(EVERY).enumerate() {
        for hand in 0..2 {
            offline.hold(hand, 1e-6 * (tick % 1_000) as f64, None);
        }
        offline.process(heard).unwrap();
    }
    mix.process(&heard, &mut mixed);
    mixed.resize(2 * (n_heard + limiter.latency()), 0.0);
    let mut folded = vec![0.0; mixed.len() / 2 * 3];
    fold.process(&mixed, &mut folded);
    limiter.process(&mut folded);
    let wanted = folded[3 * limiter.latency()..].iter();
    let wanted: Vec<u32> = wanted.map(|x| (*x as f32).to_bits()).collect();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::remove_file(path).unwrap();
    let data = bytes[bytes.len() - 4 * wanted.len()..].chunks(4);
    let played: Vec<u32> = data
        .map(|x| u32::from_le_bytes(x.try_into().unwrap()))
        .collect();
    assert_eq!(played.len(), 3 * n_heard);
    assert_eq!(played, wanted);
    assert!(
        played[3 * n_frames..]
            .iter()
            .any(|x| f32::from_bits(*x) != 0.0)
    );
}

/// What may lead a hand counts before it does: a key that could not bear it gets less force.
#[test]
fn a_loose_guide_is_borne() {
    let scale = |guidance: Option<(f64, bool)>| {
        let hand = Hand {
            guidance: guidance.map(|(k, loose)| Guidance { k, z: 0.0, loose }),
            response: vec![0.0; 400],
            ..Hand::default()
        };
        let response = hand.response.clone();
        HandKey::all(&keyboard(0, 0), &[hand])[0]
            .limit(&response)
            .scale
    };
    assert_eq!(scale(None), 1.0);
    assert_eq!(scale(Some((100.0, true))), 1.0);
    // The key bears 2b/T = 2 kN/m.
    let least = scale(Some((5e3, true)));
    assert!((0.3..0.5).contains(&least), "{least}");
    assert_eq!(least, scale(Some((5e3, false))));
}

/// What a calibration says of a key counts where its device tells nothing, and where less is stable by it.
#[test]
fn a_measured_key_bears_what_it_was_measured_for() {
    let limit = |measured: Option<MeasuredKey>| {
        let hand = Hand {
            response: vec![4e3; 1],
            measured,
            ..Hand::default()
        };
        HandKey::all(&keyboard(0, 0), std::slice::from_ref(&hand))[0].limit(&hand.response)
    };
    let measured = |mass, damping, delay| {
        limit(Some(MeasuredKey {
            mass,
            damping,
            delay,
        }))
        .limit
    };
    let told = limit(None).limit;
    // The device tells 1 N·s/m and no delay; a file does not make it safer than that.
    assert_eq!(measured(0.05, 2.0, None), told);
    assert_eq!(measured(10.0, 1.0, Some(0.0)), told);
    assert!(measured(0.05, 0.5, None) < 0.6 * told);
    assert!(measured(0.05, 1.0, Some(1e-3)) < 0.5 * told);
    // A delay that was measured as a little more than a tick is that tick.
    let ticks = |delay| measured(0.05, 1.0, Some(delay));
    assert_eq!(ticks(1.01e-3), ticks(0.99e-3));
    assert!(ticks(2e-3) < ticks(1e-3));
}

/// A swinging mass that an input pushes.
fn pushed_by_sound() -> Simulation {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let settings = SoundInSettings {
        channel: 0,
        gain: 2e-3,
        highpass: Some(20.0),
        clamp: 1e-3,
    };
    let input = timeline.sound_in(settings, &[]).unwrap();
    timeline
        .drive_by_sound(2, DriveKind::Force, input, 1.0)
        .unwrap();
    let plan = Plan::new(network, &timeline, &Budget::default(), None).unwrap();
    Simulation::planned(Arc::new(plan), OPTIONS).unwrap()
}

/// What an input gives, with gaps in it: what is heard is what the file of the input makes of the piece, no tick allocates.
#[test]
fn an_input_is_what_its_recording_says() {
    let path = |what: &str| {
        std::env::temp_dir().join(format!("ergon-input-{what}-{}.wav", std::process::id()))
    };
    let config = PlaybackConfig {
        audio: format!("file:{}", path("out").display()).parse().unwrap(),
        ahead: None,
        record: None,
        input: InputConfig::default(),
    };
    let n_ticks = 500;
    let stage = Stage {
        simulation: pushed_by_sound(),
        n_frames: Some((n_ticks * EVERY) as u64),
        hands: Vec::new(),
        ..stage()
    };
    let (this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    assert!(this.heard().sentence.starts_with("no input"));
    let (mut feed, drain) = audio::ring(1, 8 * EVERY);
    feed.set_prefill(2 * EVERY);
    let counts = feed.shared().clone();
    let (tap, handle) = audio::tap(&path("in"), RATE as u32, 1).unwrap();
    let intake = audio::Intake::new(drain, 2 * EVERY, RATE as u32);
    player.connections.hearing = Some(hearing::Hearing::by_hand(intake, EVERY, tap));
    player.begin();
    reset_violation_count();
    let mut noise = 1_u32;
    for tick in 0..n_ticks {
        let block: Vec<f32> = (0..EVERY)
            .map(|_| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                noise as f32 / u32::MAX as f32 - 0.5
            })
            .collect();
        // The card is late now and then, and too early once.
        if tick % 100 < 90 {
            feed.push(&block);
        }
        assert_no_alloc(|| assert!(player.tick()));
    }
    while player.tick() {}
    assert_eq!(violation_count(), 0);
    assert!(counts.underruns() > 0);
    player.connections.feed.close();
    drop(player);
    drop(handle);
    this.close(PATIENCE).unwrap();
    let floats = |path: &std::path::Path, n: usize| -> Vec<f32> {
        let bytes = std::fs::read(path).unwrap();
        std::fs::remove_file(path).unwrap();
        let data = &bytes[bytes.len() - 4 * n..];
        let samples = data.chunks_exact(4);
        samples
            .map(|x| f32::from_le_bytes(x.try_into().unwrap()))
            .collect()
    };
    let n_frames = n_ticks * EVERY;
    let (heard, sound) = (
        floats(&path("in"), n_frames),
        floats(&path("out"), 2 * n_frames),
    );
    assert!(heard.iter().any(|x| *x != 0.0));
    let mut offline = pushed_by_sound();
    let mut mixer = stage_mixer();
    let mut limiter = Limiter::new(RATE, 2, 1.0).unwrap();
    let (mut outputs, mut mixed) = (vec![0.0; n_frames], vec![0.0; 2 * n_frames]);
    for (block, out) in heard.chunks(EVERY).zip(outputs.chunks_mut(EVERY)) {
        offline.sound_in(block, 1);
        offline.process(out).unwrap();
    }
    mixer.process(&outputs, &mut mixed);
    limiter.process(&mut mixed);
    let late = 2 * limiter.latency();
    assert!(sound.iter().any(|x| *x != 0.0));
    for (at, (x, y)) in mixed[late..].iter().zip(&sound).enumerate() {
        assert_eq!(*x as f32, *y, "sample {at}");
    }
}

/// A guide that is taken up and let go: the key goes where it leads, and back.
#[test]
fn a_key_is_led_and_let_go() {
    let config = PlaybackConfig {
        audio: "null:fast".parse().unwrap(),
        input: InputConfig::default(),
        ahead: None,
        record: None,
    };
    let mut stage = stage();
    for hand in &mut stage.hands {
        hand.standin = vec![0.0];
        hand.reach = 0.0; // the scene is out of it
        hand.guidance = Some(Guidance {
            k: 500.0,
            z: 1.0,
            loose: true,
        });
    }
    let (mut this, mut player) =
        Performance::prepare(stage, vec![keyboard(0, u32::MAX)], config).unwrap();
    player.begin();
    let step = |at, share| GuidanceStep { at, share };
    let all = GuidanceShare { k: 1.0, z: 1.0 };
    let change = |x: f64, steps: Vec<GuidanceStep>| Change {
        standins: Some(vec![vec![x], vec![0.0]]),
        guidance_steps: Some(vec![steps, Vec::new()]),
        ..Change::default()
    };
    let at = |tick: u64| tick * EVERY as u64;
    let led = change(
        4e-3,
        vec![step(0, all), step(3_000, GuidanceShare::default())],
    );
    this.change(at(500), led).unwrap();
    this.change(at(2_000), change(-3e-3, vec![step(0, all)]))
        .unwrap();
    this.change(
        at(4_000),
        change(-3e-3, vec![step(0, GuidanceShare::default())]),
    )
    .unwrap();
    let mut x = Vec::new();
    reset_violation_count();
    for _ in 0..TICKS {
        assert!(assert_no_alloc(|| player.tick()));
        x.push(player.movers[0].x);
    }
    assert_eq!(violation_count(), 0);
    let status = this.status();
    drop(player);
    this.close(PATIENCE).unwrap();
    assert!(x[..500].iter().all(|x| *x == 0.0));
    assert!((x[1_990] - 4e-3).abs() < 1e-5, "{}", x[1_990]);
    // The second change took the steps of the first away.
    assert!((x[3_990] + 3e-3).abs() < 1e-5, "{}", x[3_990]);
    // Nothing but the lead moves it: it stays, and gets no force.
    assert!((x[5_990] - x[4_300]).abs() < 1e-5, "{}", x[5_990]);
    assert_eq!(status.hands[0].sent, 0.0);
    assert!(status.hands[0].real);
}

/// A spring that is struck until it stiffens beyond what a frame bears: it plays on, and it is told once.
#[test]
fn what_is_computed_finer_is_told_once() {
    let mut network = Network::new();
    network.part("stiff", None);
    let wall = network.sol("wall", 0.0).unwrap();
    let mass = network.mas("m", 1e-3, 0.0, 0.0).unwrap();
    let law = Arc::new(Law::hardening(500.0, 1e10, 0.05).unwrap());
    network.lnl("l", wall, mass, law, 0.0).unwrap();
    let (first, len, weight) = (mass, 1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen("out", vec![term]).unwrap();
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    for at in [0.01, 0.5] {
        timeline.strike(&network, mass, at, 1.0, 0).unwrap();
    }
    let plan = Plan::plain(Arc::new(network), &timeline, false).unwrap();
    let stage = Stage {
        simulation: Simulation::planned(Arc::new(plan), OPTIONS).unwrap(),
        hands: Vec::new(),
        ..stage()
    };
    let config = PlaybackConfig {
        audio: "null:fast".parse().unwrap(),
        input: InputConfig::default(),
        ahead: None,
        record: None,
    };
    let (mut this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    player.begin();
    reset_violation_count();
    assert_no_alloc(|| (0..1_000).for_each(|_| assert!(player.tick())));
    assert_eq!(violation_count(), 0);
    let events: Vec<_> = std::iter::from_fn(|| this.event())
        .map(|event| event.kind)
        .collect();
    assert_eq!(events, [EventKind::Finer]);
    assert_eq!((this.status().finer, this.status().muted), (1, 0));
    drop(player);
    this.close(PATIENCE).unwrap();
}

/// Strikes that were not known act in the tick after they came; what is heard goes into a file for so many ticks.
#[test]
fn strikes_and_a_file_of_sound_do_not_allocate() {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    timeline.strike_point(&network, 2, 7).unwrap();
    let plan = Plan::plain(network, &timeline, false).unwrap();
    let stage = Stage {
        simulation: Simulation::planned(Arc::new(plan), OPTIONS).unwrap(),
        hands: Vec::new(),
        ..stage()
    };
    let latency = stage.limiter.latency() as u64;
    let config = PlaybackConfig {
        audio: "null:fast".parse().unwrap(),
        input: InputConfig::default(),
        ahead: None,
        record: None,
    };
    let path = std::env::temp_dir().join(format!("ergon-heard-{}.wav", std::process::id()));
    let (mut this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    player.begin();
    reset_violation_count();
    let mut ticks = |n: u64| assert_no_alloc(|| (0..n).for_each(|_| assert!(player.tick())));
    ticks(100);
    this.record_audio(&path).unwrap();
    assert!(this.record_audio(&path).is_err(), "one at a time");
    let struck = this.strike(7, 1e-3).unwrap();
    let missed = this.strike(8, 1e-3).unwrap();
    ticks(50);
    assert!(this.end_audio());
    ticks(10);
    assert_eq!(violation_count(), 0);
    let every = EVERY as u64;
    let events: Vec<_> = std::iter::from_fn(|| this.event())
        .map(|event| (event.frame, event.kind))
        .collect();
    assert_eq!(
        events,
        [
            (100 * every, EventKind::Struck(struck)),
            (100 * every, EventKind::Missed(missed)),
        ]
    );
    while !this.audio_recorded().unwrap().ended {
        std::thread::sleep(Duration::from_millis(1));
    }
    let status = this.audio_recorded().unwrap();
    assert_eq!(status.first, Some(100 * every - latency));
    assert_eq!((status.frames, status.missing), (50 * every, 0));
    drop(player);
    this.close(PATIENCE).unwrap();
    std::fs::remove_file(&path).unwrap();
}

/// A key is pulled out and comes back, a panic is called and taken back, the gain changes, all is recorded.
#[test]
fn a_tick_does_not_allocate() {
    let path = std::env::temp_dir().join(format!("ergon-ticks-{}.take", std::process::id()));
    let axis = |player: &str| Axis {
        player: player.into(),
        key: "k".into(),
    };
    let header = Header {
        rate: RATE,
        frames: EVERY as u32,
        axes: vec![axis("ada"), axis("remi")],
        about: "{}".into(),
    };
    let config = PlaybackConfig {
        audio: "null:fast".parse().unwrap(),
        input: InputConfig::default(),
        ahead: None,
        record: Some((path.clone(), header)),
    };
    let boards = vec![keyboard(0, u32::MAX), keyboard(1, 1_000)];
    let (mut this, mut player) = Performance::prepare(stage(), boards, config).unwrap();
    player.begin();
    // From here on the second key gets no force: nor does the one that comes back in its place.
    let none = vec![Bound { at: 0, scale: 0.0 }];
    let change = Change {
        bounds: Some(vec![Vec::new(), none]),
        ..Change::default()
    };
    this.change(500 * EVERY as u64, change).unwrap();
    reset_violation_count();
    assert_no_alloc(|| {
        for tick in 0..TICKS {
            assert!(player.tick());
            match tick {
                // The key is looked for by a thread that waits; ticks here do not, until it is found.
                2_000 => {
                    while !player.slots[1].is_there() && player.connections.commands.is_empty() {
                        std::thread::yield_now();
                    }
                }
                3_000 => assert!(this.gain(0.5)),
                4_000 => this.panic(),
                4_500 => this.release(),
                _ => {}
            }
        }
    });
    assert_eq!(violation_count(), 0);
    assert_eq!(this.status().ticks, TICKS);
    let events: Vec<_> = std::iter::from_fn(|| this.event())
        .map(|event| event.kind)
        .collect();
    let changed = EventKind::Changed(1);
    assert_eq!(
        events,
        [
            changed,
            EventKind::Gone(1),
            EventKind::Back(1),
            EventKind::TookOver(1)
        ]
    );
    drop(player);
    this.close(PATIENCE).unwrap();
    let recording = read(&path, None).unwrap();
    std::fs::remove_file(path).unwrap();
    assert_eq!(recording.dropped, 0);
    assert_eq!(recording.ticks.len() as u64, TICKS);
    let stood_in: Vec<_> = recording
        .samples
        .chunks(2)
        .map(|row| {
            row.iter()
                .map(|axis| axis.flags & flag::STAND_IN)
                .sum::<u8>()
        })
        .collect();
    let from = stood_in.iter().position(|stood| *stood != 0).unwrap();
    let to = stood_in.iter().rposition(|stood| *stood != 0).unwrap();
    // The first position comes without a force; a bar is 4,410 frames.
    assert_eq!(from, 1_001);
    assert!((to + 1) * EVERY % 4_410 < EVERY, "{to}");
    assert!(stood_in[from..=to].iter().all(|stood| *stood != 0));
    assert!(recording.samples.iter().any(|axis| axis.sent.abs() > 1e-3));
    let second = recording.samples.iter().skip(1).step_by(2);
    assert!(second.clone().take(480).any(|axis| axis.sent != 0.0));
    assert!(second.skip(501).all(|axis| axis.sent == 0.0));
}
