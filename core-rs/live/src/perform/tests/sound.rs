//! The sound: a fold, an input, a file of the sound.

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::timeline::{DriveKind, InputSource, SoundInSettings};

use super::*;

/// The sound through a fold is the folded mix, to the end of its filters; no tick allocates.
#[test]
fn fold_sounds_to_its_end() {
    let sound_path = std::env::temp_dir().join(format!("ergon-fold-{}.wav", std::process::id()));
    let config = config(&format!("file:{}", sound_path.display()));
    let n_frames = 100 * EVERY + 7;
    let filters: Vec<f64> = (0..2 * 3 * 150).map(|n| 0.3 * libm::sin(f64::from(n))).collect();
    let mut channel_fold = Fold::new(2, 3, &filters).unwrap();
    let mut offline = simulation(&[0.01, 0.1], 0);
    let piece = PreparedPiece {
        simulation: offline.fork(),
        n_frames: Some(n_frames as u64),
        fold: Some(channel_fold.clone()),
        limiter: Limiter::new(RATE, 3, 1.0).unwrap(),
        ..piece()
    };
    let mut offline_mixer = piece.mixer.clone();
    let (performance, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
    player.receive_first_positions();
    reset_violation_count();
    assert_no_alloc(|| while player.tick() {});
    assert_eq!(violation_count(), 0);
    player.connections.ring_writer.close();
    drop(player);
    performance.close(PATIENCE).unwrap();

    let mut limiter = Limiter::new(RATE, 3, 1.0).unwrap();
    let frames_heard = n_frames + channel_fold.tail_frames();
    let (mut listened, mut mixed_sound) = (vec![0.0; n_frames], vec![0.0; 2 * n_frames]);
    for (tick, listened) in listened.chunks_mut(EVERY).enumerate() {
        for hand in 0..2 {
            offline.set_hand_position(hand, 1e-6 * (tick % 1_000) as f64, None);
        }
        offline.process(listened).unwrap();
    }
    offline_mixer.process(&listened, &mut mixed_sound);
    mixed_sound.resize(2 * (frames_heard + limiter.latency()), 0.0);
    let mut folded_sound = vec![0.0; mixed_sound.len() / 2 * 3];
    channel_fold.process(&mixed_sound, &mut folded_sound);
    limiter.process(&mut folded_sound);
    let expected_sound = folded_sound[3 * limiter.latency()..].iter();
    let expected_sound: Vec<u32> = expected_sound.map(|x| (*x as f32).to_bits()).collect();
    let played_sound = taken(&sound_path, expected_sound.len());
    assert_eq!(played_sound.len(), 3 * frames_heard);
    assert_eq!(played_sound, expected_sound);
    assert!(played_sound[3 * n_frames..].iter().any(|x| f32::from_bits(*x) != 0.0));
}

/// A swinging mass that an input pushes.
fn pushed_by_sound() -> Simulation {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let settings = SoundInSettings {
        source: InputSource::Channel(0),
        gain: 2e-3,
        highpass: Some(20.0),
        clamp: 1e-3,
    };
    let sound_input = timeline.add_sound_input(settings, &[]).unwrap();
    timeline.drive_by_sound(2, DriveKind::Force, sound_input, 1.0).unwrap();
    let plan = Plan::new(network, &timeline, &Budget::default(), None).unwrap();
    Simulation::from_plan(Arc::new(plan), OPTIONS).unwrap()
}

/// An input with gaps: the sound equals that of the piece with the recorded file as its input, and no tick allocates.
#[test]
fn input_with_gaps_equals_its_recording() {
    let wav_path = |what: &str| std::env::temp_dir().join(format!("ergon-input-{what}-{}.wav", std::process::id()));
    let config = config(&format!("file:{}", wav_path("out").display()));
    let tick_count = 500;
    let piece = PreparedPiece {
        simulation: pushed_by_sound(),
        n_frames: Some((tick_count * EVERY) as u64),
        hands: Vec::new(),
        ..piece()
    };
    let (performance, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
    assert!(performance.input().description.starts_with("no input"));
    let (mut ring_feed, ring_drain) = audio::ring(1, 8 * EVERY);
    ring_feed.set_prefill(2 * EVERY);
    let shared_counts = ring_feed.stream_state().clone();
    let (sound_tap, tap_handle) = audio::tap(&wav_path("in"), RATE as u32, 1).unwrap();
    let input_reader = audio::InputReader::new(ring_drain, 2 * EVERY, RATE as u32);
    player.connections.sound_input = Some(sound_input::SoundInput::fed_by_test(input_reader, EVERY, sound_tap));
    player.receive_first_positions();
    reset_violation_count();
    let mut noise_state = 1_u32;
    for tick in 0..tick_count {
        let input_block: Vec<f32> = (0..EVERY)
            .map(|_| {
                noise_state = noise_state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                noise_state as f32 / u32::MAX as f32 - 0.5
            })
            .collect();
        // The card is late now and then, and too early once.
        if tick % 100 < 90 {
            ring_feed.push(&input_block);
        }
        assert_no_alloc(|| assert!(player.tick()));
    }
    while player.tick() {}
    assert_eq!(violation_count(), 0);
    assert!(shared_counts.underruns() > 0);
    player.connections.ring_writer.close();
    drop(player);
    drop(tap_handle);
    performance.close(PATIENCE).unwrap();
    let file_samples = |wav_path: &Path, n: usize| -> Vec<f32> {
        let sample_bits = taken(wav_path, n).into_iter();
        sample_bits.map(f32::from_bits).collect()
    };
    let n_frames = tick_count * EVERY;
    let (listened, output_sound) = (
        file_samples(&wav_path("in"), n_frames),
        file_samples(&wav_path("out"), 2 * n_frames),
    );
    assert!(listened.iter().any(|x| *x != 0.0));
    let mut offline = pushed_by_sound();
    let mut offline_mixer = stage_mixer();
    let mut limiter = Limiter::new(RATE, 2, 1.0).unwrap();
    let (mut outputs, mut mixed_sound) = (vec![0.0; n_frames], vec![0.0; 2 * n_frames]);
    for (input_block, out) in listened.chunks(EVERY).zip(outputs.chunks_mut(EVERY)) {
        offline.feed_input_samples(input_block, 1);
        offline.process(out).unwrap();
    }
    offline_mixer.process(&outputs, &mut mixed_sound);
    limiter.process(&mut mixed_sound);
    let latency_samples = 2 * limiter.latency();
    assert!(output_sound.iter().any(|x| *x != 0.0));
    for (at, (x, y)) in mixed_sound[latency_samples..].iter().zip(&output_sound).enumerate() {
        assert_eq!(*x as f32, *y, "sample {at}");
    }
}

/// Live strikes act in the tick after they were sent; the sound of some ticks is written to a file.
#[test]
fn strikes_and_a_file_of_sound_do_not_allocate() {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    timeline.add_strike_point(&network, 2, 7, Some(0.0)).unwrap();
    let plan = Plan::plain(network, &timeline, false).unwrap();
    let piece = PreparedPiece {
        simulation: Simulation::from_plan(Arc::new(plan), OPTIONS).unwrap(),
        hands: Vec::new(),
        ..piece()
    };
    let latency = piece.limiter.latency() as u64;
    let config = config("null:fast");
    let sound_path = std::env::temp_dir().join(format!("ergon-heard-{}.wav", std::process::id()));
    let (mut performance, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
    player.receive_first_positions();
    reset_violation_count();
    let mut advance_ticks = |n: u64| assert_no_alloc(|| (0..n).for_each(|_| assert!(player.tick())));
    advance_ticks(100);
    performance.record_audio(&sound_path).unwrap();
    assert!(performance.record_audio(&sound_path).is_err(), "one at a time");
    let strike_ticket = performance.strike(7, 1e-3).unwrap();
    let missed_ticket = performance.strike(8, 1e-3).unwrap();
    advance_ticks(50);
    assert!(performance.end_audio());
    advance_ticks(10);
    assert_eq!(violation_count(), 0);
    let tick_frames = EVERY as u64;
    let frame_events: Vec<_> = std::iter::from_fn(|| performance.event())
        .map(|event| (event.frame, event.kind))
        .collect();
    assert_eq!(
        frame_events,
        [
            (100 * tick_frames, EventKind::ActionDone(strike_ticket)),
            (100 * tick_frames, EventKind::ActionMissed(missed_ticket)),
        ]
    );
    while !performance.audio_recorded().unwrap().has_ended {
        std::thread::sleep(Duration::from_millis(1));
    }
    let file_status = performance.audio_recorded().unwrap();
    assert_eq!(file_status.first_frame, Some(100 * tick_frames - latency));
    assert_eq!((file_status.frames, file_status.missing_frames), (50 * tick_frames, 0));
    drop(player);
    performance.close(PATIENCE).unwrap();
    std::fs::remove_file(&sound_path).unwrap();
}
