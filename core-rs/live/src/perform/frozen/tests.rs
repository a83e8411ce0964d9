//! Frames of files beside frames of a simulation: each is in its place, or silent and counted.

use std::io::Write;
use std::time::Instant;

use assert_no_alloc::{assert_no_alloc, violation_count};

use super::*;

#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

/// A file for one test, removed when it ends.
struct TempFile(PathBuf);

impl Drop for TempFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// The value of output `o` at frame `i`.
fn sample(o: usize, i: u64) -> f64 {
    o as f64 + 1.0 + i as f64 * 1e-7
}

fn stem(stem_name: &str, n_frames: u64, written: u64, outputs: &[usize]) -> (TempFile, Stem) {
    let stem_name = format!("ergon-frozen-{}-{stem_name}", std::process::id());
    let stem_path = std::env::temp_dir().join(stem_name);
    let mut file_bytes = b"header".to_vec();
    for i in 0..written {
        for &o in outputs {
            file_bytes.extend(sample(o, i).to_le_bytes());
        }
    }
    File::create(&stem_path).unwrap().write_all(&file_bytes).unwrap();
    let stem = Stem {
        path: stem_path.clone(),
        offset: 6,
        n_frames,
        outputs: outputs.to_vec(),
    };
    (TempFile(stem_path), stem)
}

fn until_ready(frozen: &FrozenOutputs, start: u64, n: usize) {
    let wait_start = Instant::now();
    while !frozen.is_ready(start, n) && wait_start.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn frozen_stems_join_a_simulation() {
    let stem_frames = 150_000; // more than the ring holds
    let (_a, first_stem) = stem("a", stem_frames, stem_frames, &[3, 0]);
    let (_b, second_stem) = stem("b", stem_frames, stem_frames, &[2]);
    for start in [0, 1, 70_001] {
        let (mut frozen_stems, _reader) = open(vec![first_stem.clone(), second_stem.clone()], start).unwrap();
        let mut position = start;
        for chunk_frames in [1, 44, 64, 4_096, 333].into_iter().cycle() {
            let chunk_frames = chunk_frames.min((stem_frames - position) as usize);
            if chunk_frames == 0 {
                break;
            }
            until_ready(&frozen_stems, position, chunk_frames);
            let mut joined_frames = vec![-1.0; chunk_frames * 4];
            let violations_before = violation_count();
            let missed_frames = assert_no_alloc(|| frozen_stems.join(&mut joined_frames, 4, position));
            assert_eq!((missed_frames, violation_count()), (0, violations_before));
            for (i, frame) in joined_frames.chunks(4).enumerate() {
                let expected_sample = |o| sample(o, position + i as u64);
                assert_eq!(
                    frame,
                    [expected_sample(0), -1.0, expected_sample(2), expected_sample(3)]
                );
            }
            position += chunk_frames as u64;
        }
    }
}

#[test]
fn frozen_frames_too_late_are_dropped() {
    let stem_frames = 100_000;
    let (_a, single_stem) = stem("late", stem_frames, stem_frames, &[0]);
    let (mut frozen_stems, stem_reader) = open(vec![single_stem], 0).unwrap();
    drop(stem_reader); // the ring keeps only what it held at first
    let ring_frames = frozen_stems.ring.slots() as u64;
    assert!(ring_frames < stem_frames);
    let mut joined_frames = vec![0.0; 100];
    // A tick was skipped: its frames are dropped.
    assert_eq!(frozen_stems.join(&mut joined_frames, 1, 500), 0);
    assert_eq!(joined_frames[0], sample(0, 500));
    let mut joined_frames = vec![0.0; 100];
    assert_eq!(frozen_stems.join(&mut joined_frames, 1, ring_frames - 40), 60);
    assert_eq!(joined_frames[39], sample(0, ring_frames - 1));
    assert_eq!(joined_frames[40], 0.0);
    assert_eq!(frozen_stems.join(&mut joined_frames, 1, ring_frames + 60), 100);
    assert!(frozen_stems.is_ready(ring_frames + 160, 100)); // no further frames will come
}

#[test]
fn frozen_stem_with_a_short_file_is_refused() {
    let (_a, short_stem) = stem("short", 5_000, 10, &[0]);
    let (failed_path, open_error) = open(vec![short_stem.clone()], 0).err().unwrap();
    assert_eq!(failed_path, short_stem.path);
    assert_eq!(open_error.kind(), io::ErrorKind::UnexpectedEof);
    let missing = Stem {
        path: "/nowhere/a.wav".into(),
        ..short_stem
    };
    assert!(open(vec![missing], 0).is_err());
}
