//! Versions that take over, and parts that are computed in finer steps.

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::law::Law;
use ergon_engine::simulation::Takeover;

use super::*;

/// The events so far: frame and kind.
fn events_of(performance: &mut Performance) -> Vec<(u64, EventKind)> {
    std::iter::from_fn(|| performance.event())
        .map(|event| (event.frame, event.kind))
        .collect()
}

/// Versions with other strikes, one of them too late: the sound equals that of a replay, and no tick allocates.
#[test]
fn changes_act_at_their_frames() {
    let path = std::env::temp_dir().join(format!("ergon-changes-{}.wav", std::process::id()));
    let config = config(&format!("file:{}", path.display()));
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
            struck[frames
                .iter()
                .position(|position| *position == from)
                .unwrap()],
            from,
        )
    });
    player.begin();
    reset_violation_count();
    let mut tick_by_hand = |ticks: u64| {
        assert_no_alloc(|| (0..ticks).for_each(|_| assert!(player.tick())));
    };
    tick_by_hand(50);
    let change = |position: usize, old: &Simulation, gain: f64| Change {
        simulation: Some((
            versions[position].fork(),
            Takeover::new(old, &versions[position]),
        )),
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
    let from_another = this
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
    assert_eq!(
        events_of(&mut this),
        [
            (frames[0], EventKind::Changed(first)),
            (120 * every, EventKind::Late(late)),
            (frames[1], EventKind::Changed(second)),
            (frames[3], EventKind::Late(from_another)),
        ]
    );
    player.connections.feed.close();
    drop(player);
    this.close(PATIENCE).unwrap();

    let mut sound = Vec::new();
    let mut limiter = Limiter::new(RATE, 2, 1.0).unwrap();
    let (mut mix, mut gain) = (mixer(1.0), ergon_engine::mix::glide::Glide::new(RATE, 1.0));
    for tick in 0..n_ticks {
        for (position, part) in [(0, 0.9), (1, 0.4)] {
            if tick * every == frames[position] {
                let mut next = versions[position].fork();
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
        let (mut listened, mut mixed) = (vec![0.0; EVERY], vec![0.0; 2 * EVERY]);
        offline.process(&mut listened).unwrap();
        mix.process(&listened, &mut mixed);
        gain.apply(tick * every, &mut mixed, 2);
        limiter.process(&mut mixed);
        sound.extend(mixed.iter().map(|x| (*x as f32).to_bits()));
    }
    let latency = 2 * limiter.latency();
    let played = taken(&path, sound.len());
    assert_eq!(played[..sound.len() - latency], sound[latency..]);
    assert!(played.iter().any(|x| *x != 0));
}

/// Versions that are withdrawn before their frames: others play on, and no tick allocates.
#[test]
fn changes_are_revoked_before_their_frames() {
    let config = config("null:");
    let every = EVERY as u64;
    let frames = [10, 30, 20, 40].map(|tick| tick * every);
    let versions = frames.map(|from| simulation(&[0.1], from));
    let stage = stage();
    let first = stage.simulation.fork();
    let (mut this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    player.begin();
    reset_violation_count();
    let change = |version: usize, old: &Simulation| Change {
        simulation: Some((
            versions[version].fork(),
            Takeover::new(old, &versions[version]),
        )),
        ..Change::default()
    };
    let mut tick_by_hand = |ticks: u64| {
        assert_no_alloc(|| (0..ticks).for_each(|_| assert!(player.tick())));
    };
    // Of the tickets at frames 10, 30, 20 and 40 the second and the third are withdrawn, in that order.
    let saved = this.change(frames[0], change(0, &first)).unwrap();
    let later = this.change(frames[1], change(1, &versions[2])).unwrap();
    let sooner = this.change(frames[2], change(2, &versions[0])).unwrap();
    let quieter = Change {
        gain: Some(0.5),
        ..Change::default()
    };
    let from_gain = this.change(frames[1], quieter).unwrap();
    this.revoke(frames[2]).unwrap();
    let anew = this.change(frames[3], change(3, &versions[0])).unwrap();
    tick_by_hand(5);
    this.revoke(frames[0] + 1).unwrap();
    let again = this.change(frames[3], change(3, &versions[0])).unwrap();
    tick_by_hand(6);
    this.revoke(0).unwrap(); // the first one was made already
    tick_by_hand(35);
    assert_eq!(violation_count(), 0);
    assert_eq!(
        events_of(&mut this),
        [
            (0, EventKind::Late(later)),
            (0, EventKind::Late(sooner)),
            (5 * every, EventKind::Late(anew)),
            (frames[0], EventKind::Changed(saved)),
            (11 * every, EventKind::Late(again)),
            (frames[1], EventKind::Changed(from_gain)),
        ]
    );
    player.connections.feed.close();
    drop(player);
    this.close(PATIENCE).unwrap();
}

/// A spring that is struck until it is too stiff for one step per frame: it plays on, and this is reported once.
#[test]
fn finer_frames_are_reported_once() {
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
    for instant in [0.01, 0.5] {
        timeline
            .strike(&network, mass, instant, 1.0, Some(0.0), 0)
            .unwrap();
    }
    let plan = Plan::plain(Arc::new(network), &timeline, false).unwrap();
    let stage = Stage {
        simulation: Simulation::planned(Arc::new(plan), OPTIONS).unwrap(),
        hands: Vec::new(),
        ..stage()
    };
    let config = config("null:fast");
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
