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
    let sound_path = std::env::temp_dir().join(format!("ergon-changes-{}.wav", std::process::id()));
    let config = config(&format!("file:{}", sound_path.display()));
    let (tick_frames, tick_count) = (EVERY as u64, 600_u64);
    let mut offline = simulation(&[], 0);
    let piece = PreparedPiece {
        simulation: offline.fork(),
        n_frames: Some(tick_count * tick_frames),
        ..piece()
    };
    let mixer = |gain: f64| {
        let mut mixer = Mixer::new(RATE, 1, 2);
        mixer.add_route(0, 0, gain, None).unwrap();
        mixer.add_route(0, 1, 0.5, Some(8.0)).unwrap();
        mixer
    };
    let change_frames = [100, 250, 90, 300].map(|tick| tick * tick_frames);
    let strike_times = [&[0.15][..], &[0.15, 0.3, 0.35], &[0.2], &[0.4]];
    let (mut performance, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
    let versions = change_frames.map(|from| {
        simulation(
            strike_times[change_frames.iter().position(|position| *position == from).unwrap()],
            from,
        )
    });
    player.receive_first_positions();
    reset_violation_count();
    let mut tick_by_hand = |ticks: u64| {
        assert_no_alloc(|| (0..ticks).for_each(|_| assert!(player.tick())));
    };
    tick_by_hand(50);
    let version_change = |position: usize, old: &Simulation, gain: f64| Change {
        simulation: Some((versions[position].fork(), Takeover::new(old, &versions[position]))),
        mixer: Some(mixer(gain)),
        gain: Some(0.7),
        bars: Some(vec![0, 1_000]),
        ..Change::default()
    };
    let first_ticket = performance
        .change(change_frames[0], version_change(0, &offline, 0.9))
        .unwrap();
    tick_by_hand(70);
    let late_ticket = performance
        .change(change_frames[2], version_change(2, &versions[0], 0.1))
        .unwrap();
    let second_ticket = performance
        .change(change_frames[1], version_change(1, &versions[0], 0.4))
        .unwrap();
    let from_another = performance
        .change(change_frames[3], version_change(3, &simulation(&[], 0), 0.2))
        .unwrap();
    assert!(performance.change(change_frames[1] + 1, Change::default()).is_err());
    assert!(
        performance
            .change(change_frames[1], version_change(0, &offline, 1.0))
            .is_err(),
        "begins elsewhere"
    );
    tick_by_hand(tick_count - 120);
    while player.tick() {}
    assert_eq!(violation_count(), 0);
    assert_eq!(
        events_of(&mut performance),
        [
            (change_frames[0], EventKind::ChangeDone(first_ticket)),
            (120 * tick_frames, EventKind::ChangeMissed(late_ticket)),
            (change_frames[1], EventKind::ChangeDone(second_ticket)),
            (change_frames[3], EventKind::ChangeMissed(from_another)),
        ]
    );
    player.connections.ring_writer.close();
    drop(player);
    performance.close(PATIENCE).unwrap();

    let mut expected_sound = Vec::new();
    let mut limiter = Limiter::new(RATE, 2, 1.0).unwrap();
    let (mut offline_mixer, mut gain) = (mixer(1.0), ergon_engine::mix::glide::GainGlide::new(RATE, 1.0));
    for tick in 0..tick_count {
        for (position, part) in [(0, 0.9), (1, 0.4)] {
            if tick * tick_frames == change_frames[position] {
                let mut next_version = versions[position].fork();
                let mut takeover = Takeover::new(&offline, &next_version);
                assert!(next_version.take_over(&mut offline, &mut takeover));
                offline = next_version;
                let mut new_mixer = mixer(part);
                new_mixer.take_over(&mut offline_mixer, None);
                offline_mixer = new_mixer;
                gain.set(0.7);
            }
        }
        for hand in 0..2 {
            offline.set_hand_position(hand, 1e-6 * (tick % 1_000) as f64, None);
        }
        let (mut listened, mut mixed_sound) = (vec![0.0; EVERY], vec![0.0; 2 * EVERY]);
        offline.process(&mut listened).unwrap();
        offline_mixer.process(&listened, &mut mixed_sound);
        gain.apply(tick * tick_frames, &mut mixed_sound, 2);
        limiter.process(&mut mixed_sound);
        expected_sound.extend(mixed_sound.iter().map(|x| (*x as f32).to_bits()));
    }
    let latency = 2 * limiter.latency();
    let played_sound = taken(&sound_path, expected_sound.len());
    assert_eq!(
        played_sound[..expected_sound.len() - latency],
        expected_sound[latency..]
    );
    assert!(played_sound.iter().any(|x| *x != 0));
}

/// Versions that are withdrawn before their frames: others play on, and no tick allocates.
#[test]
fn changes_are_revoked_before_their_frames() {
    let config = config("null:");
    let tick_frames = EVERY as u64;
    let change_frames = [10, 30, 20, 40].map(|tick| tick * tick_frames);
    let versions = change_frames.map(|from| simulation(&[0.1], from));
    let piece = piece();
    let first_simulation = piece.simulation.fork();
    let (mut performance, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
    player.receive_first_positions();
    reset_violation_count();
    let version_change = |version: usize, old: &Simulation| Change {
        simulation: Some((versions[version].fork(), Takeover::new(old, &versions[version]))),
        ..Change::default()
    };
    let mut tick_by_hand = |ticks: u64| {
        assert_no_alloc(|| (0..ticks).for_each(|_| assert!(player.tick())));
    };
    // Of the tickets at frames 10, 30, 20 and 40 the second and the third are withdrawn, in that order.
    let saved_ticket = performance
        .change(change_frames[0], version_change(0, &first_simulation))
        .unwrap();
    let later_ticket = performance
        .change(change_frames[1], version_change(1, &versions[2]))
        .unwrap();
    let sooner_ticket = performance
        .change(change_frames[2], version_change(2, &versions[0]))
        .unwrap();
    let quieter = Change {
        gain: Some(0.5),
        ..Change::default()
    };
    let from_gain = performance.change(change_frames[1], quieter).unwrap();
    performance.revoke(change_frames[2]).unwrap();
    let renewed_ticket = performance
        .change(change_frames[3], version_change(3, &versions[0]))
        .unwrap();
    tick_by_hand(5);
    performance.revoke(change_frames[0] + 1).unwrap();
    let repeated_ticket = performance
        .change(change_frames[3], version_change(3, &versions[0]))
        .unwrap();
    tick_by_hand(6);
    performance.revoke(0).unwrap(); // the first one was made already
    tick_by_hand(35);
    assert_eq!(violation_count(), 0);
    assert_eq!(
        events_of(&mut performance),
        [
            (0, EventKind::ChangeMissed(later_ticket)),
            (0, EventKind::ChangeMissed(sooner_ticket)),
            (5 * tick_frames, EventKind::ChangeMissed(renewed_ticket)),
            (change_frames[0], EventKind::ChangeDone(saved_ticket)),
            (11 * tick_frames, EventKind::ChangeMissed(repeated_ticket)),
            (change_frames[1], EventKind::ChangeDone(from_gain)),
        ]
    );
    player.connections.ring_writer.close();
    drop(player);
    performance.close(PATIENCE).unwrap();
}

/// A spring that is struck until it is too stiff for one step per frame: it plays on, and this is reported once.
#[test]
fn finer_frames_are_reported_once() {
    let mut network = Network::new();
    network.part("stiff", None);
    let rigid_wall = network.sol("wall", 0.0).unwrap();
    let struck_mass = network.mas("m", 1e-3, 0.0, 0.0).unwrap();
    let hardening_law = Arc::new(Law::hardening(500.0, 1e10, 0.05).unwrap());
    network.lnl("l", rigid_wall, struck_mass, hardening_law, 0.0).unwrap();
    let (first, len, weight) = (struck_mass, 1, 1.0);
    let position_term = Term::Position { first, len, weight };
    network.listen("out", vec![position_term]).unwrap();
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    for instant in [0.01, 0.5] {
        timeline
            .strike(&network, struck_mass, instant, 1.0, Some(0.0), 0)
            .unwrap();
    }
    let plan = Plan::plain(Arc::new(network), &timeline, false).unwrap();
    let piece = PreparedPiece {
        simulation: Simulation::from_plan(Arc::new(plan), OPTIONS).unwrap(),
        hands: Vec::new(),
        ..piece()
    };
    let config = config("null:fast");
    let (mut performance, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
    player.receive_first_positions();
    reset_violation_count();
    assert_no_alloc(|| (0..1_000).for_each(|_| assert!(player.tick())));
    assert_eq!(violation_count(), 0);
    let event_kinds: Vec<_> = std::iter::from_fn(|| performance.event())
        .map(|event| event.kind)
        .collect();
    assert_eq!(event_kinds, [EventKind::PartRefined]);
    assert_eq!(
        (performance.status().n_finer_parts, performance.status().n_muted_parts),
        (1, 0)
    );
    drop(player);
    performance.close(PATIENCE).unwrap();
}
