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

fn stem(name: &str, n_frames: u64, written: u64, outputs: &[usize]) -> (TempFile, Stem) {
    let name = format!("ergon-frozen-{}-{name}", std::process::id());
    let path = std::env::temp_dir().join(name);
    let mut bytes = b"header".to_vec();
    for i in 0..written {
        for &o in outputs {
            bytes.extend(sample(o, i).to_le_bytes());
        }
    }
    File::create(&path).unwrap().write_all(&bytes).unwrap();
    let stem = Stem {
        path: path.clone(),
        offset: 6,
        n_frames,
        outputs: outputs.to_vec(),
    };
    (TempFile(path), stem)
}

fn until_ready(frozen: &Frozen, start: u64, n: usize) {
    let asked = Instant::now();
    while !frozen.is_ready(start, n) && asked.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn frozen_stems_join_a_simulation() {
    let n = 150_000; // more than the ring holds
    let (_a, a) = stem("a", n, n, &[3, 0]);
    let (_b, b) = stem("b", n, n, &[2]);
    for start in [0, 1, 70_001] {
        let (mut frozen, _reader) = open(vec![a.clone(), b.clone()], start).unwrap();
        let mut position = start;
        for size in [1, 44, 64, 4_096, 333].into_iter().cycle() {
            let size = size.min((n - position) as usize);
            if size == 0 {
                break;
            }
            until_ready(&frozen, position, size);
            let mut frames = vec![-1.0; size * 4];
            let before = violation_count();
            let missed = assert_no_alloc(|| frozen.join(&mut frames, 4, position));
            assert_eq!((missed, violation_count()), (0, before));
            for (i, frame) in frames.chunks(4).enumerate() {
                let single = |o| sample(o, position + i as u64);
                assert_eq!(frame, [single(0), -1.0, single(2), single(3)]);
            }
            position += size as u64;
        }
    }
}

#[test]
fn frozen_frames_too_late_are_dropped() {
    let n = 100_000;
    let (_a, a) = stem("late", n, n, &[0]);
    let (mut frozen, reader) = open(vec![a], 0).unwrap();
    drop(reader); // the ring keeps only what it held at first
    let held = frozen.ring.slots() as u64;
    assert!(held < n);
    let mut frames = vec![0.0; 100];
    // A tick was skipped: its frames are dropped.
    assert_eq!(frozen.join(&mut frames, 1, 500), 0);
    assert_eq!(frames[0], sample(0, 500));
    let mut frames = vec![0.0; 100];
    assert_eq!(frozen.join(&mut frames, 1, held - 40), 60);
    assert_eq!(frames[39], sample(0, held - 1));
    assert_eq!(frames[40], 0.0);
    assert_eq!(frozen.join(&mut frames, 1, held + 60), 100);
    assert!(frozen.is_ready(held + 160, 100)); // no further frames will come
}

#[test]
fn frozen_stem_with_a_short_file_is_refused() {
    let (_a, a) = stem("short", 5_000, 10, &[0]);
    let (path, error) = open(vec![a.clone()], 0).err().unwrap();
    assert_eq!(path, a.path);
    assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    let missing = Stem {
        path: "/nowhere/a.wav".into(),
        ..a
    };
    assert!(open(vec![missing], 0).is_err());
}
