//! The ring to the card: without trouble frames are unchanged, with trouble there is no click, and nothing allocates.

use std::time::{Duration, Instant};

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::mix::mixer::Mixer;
use ergon_live::audio::{RingReader, RingWriter, SilenceEdge, ring};
use proptest::prelude::*;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// 2 ms and 5 ms at 48 kHz, the default rate of a ring.
const FADE: usize = 96;
const HUSH: usize = 240;

fn filled(ring_reader: &mut RingReader, frames: usize) -> Vec<f32> {
    let mut out = vec![f32::NAN; frames * ring_reader.channels()];
    ring_reader.fill(&mut out);
    out
}

/// Both halves of a ring that plays a constant 1; `frames` of it are left in the ring.
fn playing(frames: usize) -> (RingWriter, RingReader) {
    let (mut ring_writer, mut ring_reader) = ring(1, 4096);
    ring_writer.set_prefill(1);
    assert_eq!(ring_writer.push(&vec![1.0; frames + 8]), frames + 8);
    assert_eq!(filled(&mut ring_reader, 8), [1.0; 8]);
    (ring_writer, ring_reader)
}

#[test]
fn silence_before_the_first_frame_is_no_underrun() {
    let (mut ring_writer, mut ring_reader) = ring(2, 64);
    assert_eq!(filled(&mut ring_reader, 10), [0.0; 20]);
    assert_eq!(ring_writer.push(&[0.5; 31 * 2]), 31);
    assert_eq!(filled(&mut ring_reader, 10), [0.0; 20], "it waits until half full");
    ring_writer.push(&[0.5; 2]);
    assert_eq!(filled(&mut ring_reader, 10), [0.5; 20], "and begins at once");
    assert_eq!(ring_writer.filled_frames(), 22);
    assert_eq!(
        (
            ring_writer.stream_state().underruns(),
            ring_writer.stream_state().played_frames()
        ),
        (0, 10)
    );
}

#[test]
fn closed_feed_plays_to_its_end() {
    let (mut ring_writer, mut ring_reader) = ring(1, 1000);
    ring_writer.push(&[0.25; 100]);
    ring_writer.close();
    let out = filled(&mut ring_reader, 64);
    assert_eq!(out, [0.25; 64]);
    assert!(!ring_writer.stream_state().has_finished());
    let out = filled(&mut ring_reader, 64);
    assert_eq!((&out[..36], &out[36..]), (&[0.25; 36][..], &[0.0; 28][..]));
    let stream_state = ring_writer.stream_state();
    assert!(stream_state.has_finished() && ring_reader.has_ended());
    assert_eq!((stream_state.underruns(), stream_state.missing_frames()), (0, 0));
}

#[test]
fn underrun_falls_to_silence_and_rises_again() {
    let (mut ring_writer, mut ring_reader) = playing(10);
    let out = filled(&mut ring_reader, 10 + FADE + 20);
    assert_eq!(out[..10], [1.0; 10]);
    let fall: Vec<f32> = (1..=FADE).map(|i| (FADE - i) as f32 / FADE as f32).collect();
    assert_eq!(out[10..10 + FADE], fall);
    assert_eq!(out[10 + FADE..], [0.0; 20]);
    let stream_state = ring_writer.stream_state().clone();
    assert_eq!(
        (stream_state.underruns(), stream_state.missing_frames()),
        (1, FADE as u64 + 20)
    );
    filled(&mut ring_reader, 50);
    assert_eq!(
        (stream_state.underruns(), stream_state.missing_frames()),
        (1, FADE as u64 + 70)
    );
    ring_writer.push(&[1.0; 200]);
    let out = filled(&mut ring_reader, 200);
    let rise: Vec<f32> = (1..=FADE).map(|i| i as f32 / FADE as f32).collect();
    assert_eq!(out[..FADE], rise);
    assert_eq!(out[FADE..], [1.0; 200 - FADE]);
    assert_eq!((stream_state.underruns(), stream_state.played_frames()), (1, 218));
}

#[test]
fn panic_is_silent_after_five_milliseconds_and_holds() {
    let (mut ring_writer, mut ring_reader) = playing(1000);
    let stream_state = ring_writer.stream_state().clone();
    stream_state.panic();
    let out = filled(&mut ring_reader, HUSH + 10);
    let ramp: Vec<f32> = (1..=HUSH).map(|i| (HUSH - i) as f32 / HUSH as f32).collect();
    assert_eq!((&out[..HUSH], &out[HUSH..]), (&ramp[..], &[0.0; 10][..]));
    let left = 1000 - HUSH - 10;
    assert_eq!(filled(&mut ring_reader, 32), [0.0; 32]);
    // At the pace of the card: later frames sound at the times for which they were computed.
    assert_eq!(
        (ring_writer.filled_frames(), stream_state.discarded_frames()),
        (left - 32, 32)
    );
    ring_writer.push(&[1.0; 500]);
    assert_eq!(
        filled(&mut ring_reader, left),
        vec![0.0; left],
        "nothing sounds until it is released"
    );
    assert_eq!(ring_writer.filled_frames(), 468);
    stream_state.release();
    assert_eq!(
        filled(&mut ring_reader, 32),
        [0.0; 32],
        "what was computed meanwhile is old"
    );
    ring_writer.push(&[1.0; 500]);
    let out = filled(&mut ring_reader, 436 + FADE + 1);
    assert_eq!(out[..436], [0.0; 436]);
    assert_eq!((out[436], out[436 + FADE]), (1.0 / FADE as f32, 1.0));
    assert_eq!((stream_state.underruns(), stream_state.missing_frames()), (0, 0));
    let edge = |frame, silent| SilenceEdge {
        frame,
        is_start: silent,
    };
    assert_eq!(stream_state.edges(0), [edge(8, true), edge(1508, false)]);
    assert_eq!(stream_state.edges(1), [edge(1508, false)]);
}

#[test]
fn take_with_a_panic_returns_silence() {
    let (mut ring_writer, mut ring_reader) = ring(1, 4096);
    let stream_state = ring_writer.stream_state().clone();
    let mut listened = Vec::new();
    let mut frame = [0.0; 100];
    for block in 0..40 {
        ring_writer.push(&[1.0; 100]);
        match block {
            10 => stream_state.panic(),
            20 => stream_state.release(),
            _ => {}
        }
        let taken = ring_reader.take_waiting(&mut frame);
        listened.extend_from_slice(&frame[..taken]);
    }
    assert_eq!(listened.len(), 4_000, "no frame is left out");
    assert_eq!(listened[..1_000], [1.0; 1_000]);
    assert_eq!(listened[1_000 + HUSH - 1..2_100], [0.0; 1_101 - HUSH]);
    assert_eq!(listened[2_100 + FADE - 1..], vec![1.0; 1_901 - FADE]);
}

#[test]
fn panic_soon_after_a_release_stays_silent() {
    let (mut ring_writer, mut ring_reader) = playing(1000);
    let stream_state = ring_writer.stream_state().clone();
    stream_state.panic();
    filled(&mut ring_reader, HUSH);
    filled(&mut ring_reader, 10);
    stream_state.release();
    assert_eq!(filled(&mut ring_reader, 10), [0.0; 10]);
    stream_state.panic();
    assert_eq!(filled(&mut ring_reader, 600), [0.0; 600]);
    ring_writer.push(&[1.0; 100]);
    assert_eq!(filled(&mut ring_reader, 50), [0.0; 50]);
    assert_eq!(stream_state.edges(0).len(), 1);
}

#[test]
fn sounding_by_the_last_block() {
    let (mut ring_writer, mut ring_reader) = ring(1, 4096);
    ring_writer.set_prefill(1);
    let stream_state = ring_writer.stream_state().clone();
    assert_eq!(stream_state.first_frame_age(), None);
    ring_writer.push(&[1.0; 2000]);
    let began = Instant::now();
    filled(&mut ring_reader, 480);
    assert!(stream_state.first_frame_age().unwrap() <= began.elapsed());
    // The second block begins with frame 480: 10 ms after frame 0, whenever it is taken.
    let early = Instant::now();
    filled(&mut ring_reader, 480);
    let passed = stream_state.first_frame_age().unwrap();
    let block = Duration::from_millis(10);
    assert!((block..=block + early.elapsed()).contains(&passed));
    // Frames that a panic discards are gone: frame 2000 comes next.
    stream_state.panic();
    filled(&mut ring_reader, HUSH);
    filled(&mut ring_reader, 1);
    stream_state.release();
    filled(&mut ring_reader, 2000 - 960 - HUSH - 1);
    ring_writer.push(&[1.0; 100]);
    let early = Instant::now();
    filled(&mut ring_reader, 1);
    let passed = stream_state.first_frame_age().unwrap();
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
    let (ring_writer, mut ring_reader) = playing(1000);
    ring_writer.stream_state().panic();
    ring_writer.close();
    filled(&mut ring_reader, HUSH);
    filled(&mut ring_reader, 1);
    assert!(ring_writer.stream_state().has_finished());
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
        let (mut ring_writer, mut ring_reader) = playing(0);
        let mut heard = vec![1.0_f32];
        for step in steps {
            match step {
                Step::Push(frames) => { ring_writer.push(&vec![1.0; frames]); }
                Step::Fill(frames) => heard.extend(filled(&mut ring_reader, frames)),
                Step::Panic => ring_writer.stream_state().panic(),
                Step::Release => ring_writer.stream_state().release(),
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
        let (mut ring_writer, mut ring_reader) = ring(channels, 256);
        ring_writer.set_prefill(1);
        let sound = |n: usize| f32::from_bits(0x3f80_0000 ^ (n as u32).wrapping_mul(0x9E37_79B9) >> 9);
        let (mut given, mut got) = (0, 0);
        for (push, fill) in blocks {
            let frames: Vec<f32> = (given * channels..(given + push) * channels).map(sound).collect();
            given += ring_writer.push(&frames);
            let fill = fill.min(ring_writer.filled_frames());
            let out = filled(&mut ring_reader, fill);
            for (n, x) in out.into_iter().enumerate() {
                prop_assert_eq!(x.to_bits(), sound(got * channels + n).to_bits());
            }
            got += fill;
            prop_assert_eq!(ring_writer.filled_frames(), given - got);
        }
        prop_assert_eq!(ring_writer.stream_state().played_frames(), got as u64);
        prop_assert_eq!(ring_writer.stream_state().underruns(), 0);
    }
}

#[test]
fn ring_does_not_allocate() {
    let (mut ring_writer, mut ring_reader) = ring(24, 1024);
    let frames = vec![0.5; 600 * 24];
    let mut out = vec![0.0; 256 * 24];
    reset_violation_count();
    assert_no_alloc(|| {
        ring_reader.fill(&mut out); // nothing yet
        ring_writer.push(&frames);
        ring_reader.fill(&mut out);
        ring_reader.fill(&mut out);
        ring_reader.fill(&mut out); // an underrun
        ring_writer.push(&frames);
        ring_reader.fill(&mut out); // rising
        ring_writer.stream_state().panic();
        ring_writer.push(&frames);
        for _ in 0..4 {
            ring_reader.fill(&mut out);
        }
        ring_writer.stream_state().release();
        ring_writer.push(&frames);
        ring_reader.fill(&mut out);
        ring_writer.close();
        for _ in 0..4 {
            ring_reader.fill(&mut out);
        }
    });
    assert_eq!(violation_count(), 0);
    let stream_state = ring_writer.stream_state();
    assert!(stream_state.has_finished() && stream_state.underruns() == 1 && stream_state.discarded_frames() > 0);
}
