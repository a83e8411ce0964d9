//! The ring to the card: without trouble frames are unchanged, with trouble there is no click, and nothing allocates.

use std::time::{Duration, Instant};

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::mix::mixer::Mixer;
use ergon_live::audio::{Drain, Edge, Feed, ring};
use proptest::prelude::*;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// 2 ms and 5 ms at 48 kHz, the default rate of a ring.
const FADE: usize = 96;
const HUSH: usize = 240;

fn filled(drain: &mut Drain, frames: usize) -> Vec<f32> {
    let mut out = vec![f32::NAN; frames * drain.channels()];
    drain.fill(&mut out);
    out
}

/// Both halves of a ring that plays a constant 1; `frames` of it are left in the ring.
fn playing(frames: usize) -> (Feed, Drain) {
    let (mut feed, mut drain) = ring(1, 4096);
    feed.set_prefill(1);
    assert_eq!(feed.push(&vec![1.0; frames + 8]), frames + 8);
    assert_eq!(filled(&mut drain, 8), [1.0; 8]);
    (feed, drain)
}

#[test]
fn silence_before_the_first_frame_is_no_underrun() {
    let (mut feed, mut drain) = ring(2, 64);
    assert_eq!(filled(&mut drain, 10), [0.0; 20]);
    assert_eq!(feed.push(&[0.5; 31 * 2]), 31);
    assert_eq!(filled(&mut drain, 10), [0.0; 20], "it waits until half full");
    feed.push(&[0.5; 2]);
    assert_eq!(filled(&mut drain, 10), [0.5; 20], "and begins at once");
    assert_eq!(feed.filled(), 22);
    assert_eq!((feed.shared().underruns(), feed.shared().played()), (0, 10));
}

#[test]
fn closed_feed_plays_to_its_end() {
    let (mut feed, mut drain) = ring(1, 1000);
    feed.push(&[0.25; 100]);
    feed.close();
    let out = filled(&mut drain, 64);
    assert_eq!(out, [0.25; 64]);
    assert!(!feed.shared().finished());
    let out = filled(&mut drain, 64);
    assert_eq!((&out[..36], &out[36..]), (&[0.25; 36][..], &[0.0; 28][..]));
    let shared = feed.shared();
    assert!(shared.finished() && drain.ended());
    assert_eq!((shared.underruns(), shared.missing()), (0, 0));
}

#[test]
fn underrun_falls_to_silence_and_rises_again() {
    let (mut feed, mut drain) = playing(10);
    let out = filled(&mut drain, 10 + FADE + 20);
    assert_eq!(out[..10], [1.0; 10]);
    let fall: Vec<f32> = (1..=FADE).map(|i| (FADE - i) as f32 / FADE as f32).collect();
    assert_eq!(out[10..10 + FADE], fall);
    assert_eq!(out[10 + FADE..], [0.0; 20]);
    let shared = feed.shared().clone();
    assert_eq!((shared.underruns(), shared.missing()), (1, FADE as u64 + 20));
    filled(&mut drain, 50);
    assert_eq!((shared.underruns(), shared.missing()), (1, FADE as u64 + 70));
    feed.push(&[1.0; 200]);
    let out = filled(&mut drain, 200);
    let rise: Vec<f32> = (1..=FADE).map(|i| i as f32 / FADE as f32).collect();
    assert_eq!(out[..FADE], rise);
    assert_eq!(out[FADE..], [1.0; 200 - FADE]);
    assert_eq!((shared.underruns(), shared.played()), (1, 218));
}

#[test]
fn panic_is_silent_after_five_milliseconds_and_holds() {
    let (mut feed, mut drain) = playing(1000);
    let shared = feed.shared().clone();
    shared.panic();
    let out = filled(&mut drain, HUSH + 10);
    let ramp: Vec<f32> = (1..=HUSH).map(|i| (HUSH - i) as f32 / HUSH as f32).collect();
    assert_eq!((&out[..HUSH], &out[HUSH..]), (&ramp[..], &[0.0; 10][..]));
    let left = 1000 - HUSH - 10;
    assert_eq!(filled(&mut drain, 32), [0.0; 32]);
    // At the pace of the card: later frames sound at the times for which they were computed.
    assert_eq!((feed.filled(), shared.discarded()), (left - 32, 32));
    feed.push(&[1.0; 500]);
    assert_eq!(
        filled(&mut drain, left),
        vec![0.0; left],
        "nothing sounds until it is released"
    );
    assert_eq!(feed.filled(), 468);
    shared.release();
    assert_eq!(filled(&mut drain, 32), [0.0; 32], "what was computed meanwhile is old");
    feed.push(&[1.0; 500]);
    let out = filled(&mut drain, 436 + FADE + 1);
    assert_eq!(out[..436], [0.0; 436]);
    assert_eq!((out[436], out[436 + FADE]), (1.0 / FADE as f32, 1.0));
    assert_eq!((shared.underruns(), shared.missing()), (0, 0));
    let edge = |frame, silent| Edge { frame, silent };
    assert_eq!(shared.edges(0), [edge(8, true), edge(1508, false)]);
    assert_eq!(shared.edges(1), [edge(1508, false)]);
}

#[test]
fn take_with_a_panic_returns_silence() {
    let (mut feed, mut drain) = ring(1, 4096);
    let shared = feed.shared().clone();
    let mut listened = Vec::new();
    let mut frame = [0.0; 100];
    for block in 0..40 {
        feed.push(&[1.0; 100]);
        match block {
            10 => shared.panic(),
            20 => shared.release(),
            _ => {}
        }
        let taken = drain.take(&mut frame);
        listened.extend_from_slice(&frame[..taken]);
    }
    assert_eq!(listened.len(), 4_000, "no frame is left out");
    assert_eq!(listened[..1_000], [1.0; 1_000]);
    assert_eq!(listened[1_000 + HUSH - 1..2_100], [0.0; 1_101 - HUSH]);
    assert_eq!(listened[2_100 + FADE - 1..], vec![1.0; 1_901 - FADE]);
}

#[test]
fn panic_soon_after_a_release_stays_silent() {
    let (mut feed, mut drain) = playing(1000);
    let shared = feed.shared().clone();
    shared.panic();
    filled(&mut drain, HUSH);
    filled(&mut drain, 10);
    shared.release();
    assert_eq!(filled(&mut drain, 10), [0.0; 10]);
    shared.panic();
    assert_eq!(filled(&mut drain, 600), [0.0; 600]);
    feed.push(&[1.0; 100]);
    assert_eq!(filled(&mut drain, 50), [0.0; 50]);
    assert_eq!(shared.edges(0).len(), 1);
}

#[test]
fn sounding_by_the_last_block() {
    let (mut feed, mut drain) = ring(1, 4096);
    feed.set_prefill(1);
    let shared = feed.shared().clone();
    assert_eq!(shared.sounding(), None);
    feed.push(&[1.0; 2000]);
    let began = Instant::now();
    filled(&mut drain, 480);
    assert!(shared.sounding().unwrap() <= began.elapsed());
    // The second block begins with frame 480: 10 ms after frame 0, whenever it is taken.
    let early = Instant::now();
    filled(&mut drain, 480);
    let passed = shared.sounding().unwrap();
    let block = Duration::from_millis(10);
    assert!((block..=block + early.elapsed()).contains(&passed));
    // Frames that a panic discards are gone: frame 2000 comes next.
    shared.panic();
    filled(&mut drain, HUSH);
    filled(&mut drain, 1);
    shared.release();
    filled(&mut drain, 2000 - 960 - HUSH - 1);
    feed.push(&[1.0; 100]);
    let early = Instant::now();
    filled(&mut drain, 1);
    let passed = shared.sounding().unwrap();
    let before = Duration::from_nanos(2000 * 1_000_000_000 / 48_000);
    let longest = before + early.elapsed() + Duration::from_micros(1);
    assert!((before..=longest).contains(&passed), "{passed:?}");
}

#[test]
fn set_gain_does_not_allocate() {
    let mut mixer = Mixer::new(44_100.0, 1, 1);
    mixer.add_route_in_group(1, 0, 0, 1.0, None).expect("both are there");
    let (frames, mut mixed) = ([1.0; 2048], [0.0; 2048]);
    reset_violation_count();
    assert_no_alloc(|| {
        mixer.set_gain(1, 0.5);
        mixer.process(&frames, &mut mixed);
    });
    assert_eq!((mixed[0], mixed[2047]), (1.0, 0.5));
    assert_eq!(violation_count(), 0);
}

#[test]
fn close_after_a_panic_finishes() {
    let (feed, mut drain) = playing(1000);
    feed.shared().panic();
    feed.close();
    filled(&mut drain, HUSH);
    filled(&mut drain, 1);
    assert!(feed.shared().finished());
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Push(usize),
    Fill(usize),
    Panic,
    Release,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        6 => (1..300_usize).prop_map(Step::Push),
        6 => (1..300_usize).prop_map(Step::Fill),
        1 => Just(Step::Panic),
        1 => Just(Step::Release),
    ];
    prop::collection::vec(step, 1..60)
}

proptest! {
    /// Whoever is late, a constant sound never jumps: no step is steeper than both ramps together.
    #[test]
    fn ring_output_never_jumps(steps in steps()) {
        let (mut feed, mut drain) = playing(0);
        let mut heard = vec![1.0_f32];
        for step in steps {
            match step {
                Step::Push(frames) => { feed.push(&vec![1.0; frames]); }
                Step::Fill(frames) => heard.extend(filled(&mut drain, frames)),
                Step::Panic => feed.shared().panic(),
                Step::Release => feed.shared().release(),
            }
        }
        let most = 1.0 / FADE as f32 + 1.0 / HUSH as f32 + 1e-6;
        for (at, pair) in heard.windows(2).enumerate() {
            prop_assert!((pair[1] - pair[0]).abs() <= most, "frame {at}: {pair:?}");
        }
    }

    /// However the frames are divided into blocks, they come out unchanged and complete.
    #[test]
    fn frames_in_blocks_of_any_size_pass_unchanged(
        blocks in prop::collection::vec((1..200_usize, 1..200_usize), 1..80),
        channels in 1..65_usize,
    ) {
        let (mut feed, mut drain) = ring(channels, 256);
        feed.set_prefill(1);
        let sound = |n: usize| f32::from_bits(0x3f80_0000 ^ (n as u32).wrapping_mul(0x9E37_79B9) >> 9);
        let (mut given, mut got) = (0, 0);
        for (push, fill) in blocks {
            let frames: Vec<f32> = (given * channels..(given + push) * channels).map(sound).collect();
            given += feed.push(&frames);
            let fill = fill.min(feed.filled());
            let out = filled(&mut drain, fill);
            for (n, x) in out.into_iter().enumerate() {
                prop_assert_eq!(x.to_bits(), sound(got * channels + n).to_bits());
            }
            got += fill;
            prop_assert_eq!(feed.filled(), given - got);
        }
        prop_assert_eq!(feed.shared().played(), got as u64);
        prop_assert_eq!(feed.shared().underruns(), 0);
    }
}

#[test]
fn ring_does_not_allocate() {
    let (mut feed, mut drain) = ring(24, 1024);
    let frames = vec![0.5; 600 * 24];
    let mut out = vec![0.0; 256 * 24];
    reset_violation_count();
    assert_no_alloc(|| {
        drain.fill(&mut out); // nothing yet
        feed.push(&frames);
        drain.fill(&mut out);
        drain.fill(&mut out);
        drain.fill(&mut out); // an underrun
        feed.push(&frames);
        drain.fill(&mut out); // rising
        feed.shared().panic();
        feed.push(&frames);
        for _ in 0..4 {
            drain.fill(&mut out);
        }
        feed.shared().release();
        feed.push(&frames);
        drain.fill(&mut out);
        feed.close();
        for _ in 0..4 {
            drain.fill(&mut out);
        }
    });
    assert_eq!(violation_count(), 0);
    let shared = feed.shared();
    assert!(shared.finished() && shared.underruns() == 1 && shared.discarded() > 0);
}
