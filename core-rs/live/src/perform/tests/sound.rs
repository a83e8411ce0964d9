//! The sound: a fold, an input, a file of the sound.

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::timeline::{DriveKind, InputSource, SoundInSettings};

use super::*;

/// The sound through a fold is the folded mix, to the end of its filters; no tick allocates.
#[test]
fn fold_sounds_to_its_end() {
    let path = std::env::temp_dir().join(format!("ergon-fold-{}.wav", std::process::id()));
    let config = config(&format!("file:{}", path.display()));
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
    let (mut listened, mut mixed) = (vec![0.0; n_frames], vec![0.0; 2 * n_frames]);
    for (tick, listened) in listened.chunks_mut(EVERY).enumerate() {
        for hand in 0..2 {
            offline.hold(hand, 1e-6 * (tick % 1_000) as f64, None);
        }
        offline.process(listened).unwrap();
    }
    mix.process(&listened, &mut mixed);
    mixed.resize(2 * (n_heard + limiter.latency()), 0.0);
    let mut folded = vec![0.0; mixed.len() / 2 * 3];
    fold.process(&mixed, &mut folded);
    limiter.process(&mut folded);
    let wanted = folded[3 * limiter.latency()..].iter();
    let wanted: Vec<u32> = wanted.map(|x| (*x as f32).to_bits()).collect();
    let played = taken(&path, wanted.len());
    assert_eq!(played.len(), 3 * n_heard);
    assert_eq!(played, wanted);
    assert!(
        played[3 * n_frames..]
            .iter()
            .any(|x| f32::from_bits(*x) != 0.0)
    );
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
    let input = timeline.sound_in(settings, &[]).unwrap();
    timeline
        .drive_by_sound(2, DriveKind::Force, input, 1.0)
        .unwrap();
    let plan = Plan::new(network, &timeline, &Budget::default(), None).unwrap();
    Simulation::planned(Arc::new(plan), OPTIONS).unwrap()
}

/// An input with gaps: the sound equals that of the piece with the recorded file as its input, and no tick allocates.
#[test]
fn input_with_gaps_equals_its_recording() {
    let path = |what: &str| {
        std::env::temp_dir().join(format!("ergon-input-{what}-{}.wav", std::process::id()))
    };
    let config = config(&format!("file:{}", path("out").display()));
    let n_ticks = 500;
    let stage = Stage {
        simulation: pushed_by_sound(),
        n_frames: Some((n_ticks * EVERY) as u64),
        hands: Vec::new(),
        ..stage()
    };
    let (this, mut player) = Performance::prepare(stage, Vec::new(), config).unwrap();
    assert!(this.input().sentence.starts_with("no input"));
    let (mut feed, drain) = audio::ring(1, 8 * EVERY);
    feed.set_prefill(2 * EVERY);
    let counts = feed.shared().clone();
    let (tap, handle) = audio::tap(&path("in"), RATE as u32, 1).unwrap();
    let reader = audio::InputReader::new(drain, 2 * EVERY, RATE as u32);
    player.connections.sound_input = Some(sound_input::SoundInput::fed_by_test(reader, EVERY, tap));
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
    let floats = |path: &Path, n: usize| -> Vec<f32> {
        let bits = taken(path, n).into_iter();
        bits.map(f32::from_bits).collect()
    };
    let n_frames = n_ticks * EVERY;
    let (listened, sound) = (
        floats(&path("in"), n_frames),
        floats(&path("out"), 2 * n_frames),
    );
    assert!(listened.iter().any(|x| *x != 0.0));
    let mut offline = pushed_by_sound();
    let mut mixer = stage_mixer();
    let mut limiter = Limiter::new(RATE, 2, 1.0).unwrap();
    let (mut outputs, mut mixed) = (vec![0.0; n_frames], vec![0.0; 2 * n_frames]);
    for (block, out) in listened.chunks(EVERY).zip(outputs.chunks_mut(EVERY)) {
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

/// Live strikes act in the tick after they were sent; the sound of some ticks is written to a file.
#[test]
fn strikes_and_a_file_of_sound_do_not_allocate() {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    timeline.strike_point(&network, 2, 7, Some(0.0)).unwrap();
    let plan = Plan::plain(network, &timeline, false).unwrap();
    let stage = Stage {
        simulation: Simulation::planned(Arc::new(plan), OPTIONS).unwrap(),
        hands: Vec::new(),
        ..stage()
    };
    let latency = stage.limiter.latency() as u64;
    let config = config("null:fast");
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
            (100 * every, EventKind::Acted(struck)),
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
