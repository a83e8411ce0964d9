//! A recording from the real-time side: it allocates nothing, and survives the death of its process.

use std::io::{BufRead, BufReader, Write, stdin};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, fs, thread};

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use ergon_live::recording::{Header, RecordedAxis, RecordedSample, Recorder, read};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const PATH: &str = "ERGON_TEST_RECORDING";

fn header() -> Header {
    Header {
        rate: 44_100.0,
        frames: 44,
        axes: vec![RecordedAxis::default(); 2],
        about: "{}".to_owned(),
    }
}

fn row(tick: u64) -> [RecordedSample; 2] {
    [1.0, 2.0].map(|axis| RecordedSample {
        position: axis * tick as f64 / 3.0,
        ..RecordedSample::default()
    })
}

fn file(name: &str) -> PathBuf {
    let path = env::temp_dir().join(format!("ergon-{name}-{}.take", std::process::id()));
    fs::remove_file(&path).ok();
    path
}

#[test]
fn recorder_does_not_allocate_in_real_time() {
    let path = file("no-alloc");
    let (mut sink, handle) = Recorder::start(&path, &header()).unwrap();
    reset_violation_count();
    // Also when the ring is full.
    assert_no_alloc(|| {
        for tick in 0..50_000 {
            sink.push_row(tick, &row(tick));
            sink.push_event(tick, format_args!(r#"{{"gain":{},"why":{:?}}}"#, 0.1, "a"));
        }
    });
    assert_eq!(violation_count(), 0);
    assert!(sink.dropped_count() > 0);
    drop((sink, handle));
    fs::remove_file(&path).unwrap();
}

/// Number of rows that are recorded at once.
const ROWS: u64 = 100;

/// Records some rows for every input line; run by the next test in a process of its own.
#[test]
#[ignore = "the next test runs and kills it"]
fn records_until_it_is_killed() {
    let path = env::var(PATH).expect("the next test says where");
    let (mut sink, _handle) = Recorder::start(Path::new(&path), &header()).unwrap();
    for (first, _) in (0..).step_by(ROWS as usize).zip(stdin().lines()) {
        for tick in first..first + ROWS {
            assert!(sink.push_row(tick, &row(tick)));
        }
        eprintln!("{}", first + ROWS);
    }
}

#[test]
fn killed_recording_keeps_its_rows() {
    let path = file("killed");
    let mut child = Command::new(env::current_exe().unwrap())
        .args(["--exact", "records_until_it_is_killed", "--ignored", "--nocapture"])
        .env(PATH, &path)
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut asked = child.stdin.take().unwrap();
    let mut output = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut record = |rows: u64| {
        writeln!(asked).unwrap();
        assert!(output.any(|line| line.unwrap() == rows.to_string()));
    };
    (1..=10).for_each(|n| record(n * ROWS));
    // The file is read while it is being written, until it has some chunks.
    let before = loop {
        let result = read(&path, None).unwrap();
        if result.ticks.len() > 500 {
            break result;
        }
        thread::yield_now();
    };
    (11..=20).for_each(|n| record(n * ROWS));
    child.kill().unwrap();
    child.wait().unwrap();
    let after = read(&path, None).unwrap();
    fs::remove_file(&path).unwrap();
    assert!(!after.is_finished);
    assert!(after.ticks.starts_with(&before.ticks));
    let wanted = after.ticks.iter().flat_map(|&tick| row(tick));
    assert!(after.samples.iter().copied().eq(wanted));
}
