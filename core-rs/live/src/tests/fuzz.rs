//! Seeded fuzzers of all Rust readers of bytes and text from outside: devices, recordings, laws.
//!
//! `TARGETS` lists them. Each case has its own seed, so that a failing case can be run alone by the number in its
//! message. `make test` runs `SHORT` cases of each target, `make test-long` `LONG` (docs/fuzzing.md). FUZZ_TARGET,
//! FUZZ_FROM and FUZZ_COUNT choose one target and its cases.

mod dice;
mod wire;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use ergon_engine::gesture::take::{Preparation, Take};
use ergon_engine::law::{Constants, Law, LawText};

use crate::audio::Spec;
use crate::device::Url;
use crate::recording::{Axis, Header, Recording, Sample, decode};
use dice::{Dice, damaged, text};
use wire::{board_bytes, firefader_bytes, frame_bytes, haply_text};

const SHORT: u64 = 2_000;
const LONG: u64 = 1_000_000;

/// An intact recording of two axes and forty rows.
fn recorded() -> Vec<u8> {
    let axis = |i| Axis {
        player: format!("remi{i}"),
        key: format!("k{i}"),
    };
    let header = Header {
        rate: 44_100.0,
        frames: 44,
        axes: (0..2).map(axis).collect(),
        about: "{}".to_owned(),
    };
    let sample = |i: u64| Sample {
        position: i as f64 * 1e-3,
        force: -(i as f64),
        sent: 0.5,
        flags: i as u8,
        clock: i as u32,
    };
    let rows = (0..80).map(sample).collect();
    let mut recording = Recording::new(header, (3..43).collect(), rows).unwrap();
    recording.events = vec![(5, "{\"gain\":1}".to_owned())];
    let mut bytes = Vec::new();
    recording.write(&mut bytes).unwrap();
    bytes
}

fn read_recording(bytes: &[u8]) {
    if let Ok(result) = decode(&mut &bytes[..], bytes.len() as u64, None) {
        assert_eq!(
            result.samples.len(),
            result.ticks.len() * result.header.axes.len()
        );
        assert!(result.ticks.is_sorted_by(|a, b| a < b));
        drop(result.positions_filled());
        drop(result.damage());
        result.duration();
    }
}

fn recording_bytes(dice: &mut Dice) {
    thread_local!(static WHOLE: Vec<u8> = recorded());
    let mut bytes = WHOLE.with(|whole| damaged(dice, whole));
    if dice.below(2) == 0 {
        // Correct the checksums, so that the bytes after them are read too.
        let mut position = 12;
        while let Some(head) = bytes.get(position..position + 9) {
            let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
            let Some(end) = (position + 9)
                .checked_add(length)
                .filter(|&end| end <= bytes.len())
            else {
                break;
            };
            let mut sum = crc32fast::Hasher::new();
            sum.update(&bytes[position..position + 5]);
            sum.update(&bytes[position + 9..end]);
            let sum = sum.finalize().to_le_bytes();
            bytes[position + 5..position + 9].copy_from_slice(&sum);
            position = end;
        }
    }
    read_recording(&bytes);
}

fn device_url(dice: &mut Dice) {
    const WORDS: [&str; 22] = [
        "firefader",
        "frame",
        "frame+udp",
        "haply",
        "emul",
        "hapi",
        ":",
        "//",
        "/dev/ttyACM0",
        "127.0.0.1:9",
        "?",
        "#",
        "3",
        "&",
        "=",
        "id",
        "rate",
        "lockstep",
        "wide",
        "nan",
        "-1",
        "\u{e9}",
    ];
    let message = text(
        dice,
        &[
            "frame:/dev/ttyACM0?lockstep&wide#3",
            "haply:127.0.0.1:10001?id=A14",
            "emul:",
        ],
        &WORDS,
    );
    if let Err(error) = Url::parse(&message) {
        assert!(!error.to_string().is_empty());
    }
}

fn audio_spec(dice: &mut Dice) {
    const WORDS: [&str; 18] = [
        "auto",
        "jack",
        "pulse",
        "system",
        "null",
        "fast",
        "file",
        "clock",
        ":",
        ",",
        "=",
        "block",
        "channels",
        "256",
        "-1",
        "99999999999999999999",
        "a.wav",
        " ",
    ];
    let message = text(
        dice,
        &[
            "jack:system:playback_[12],block=64,channels=2",
            "null:fast",
            "file:a,b.wav",
        ],
        &WORDS,
    );
    if let Err(error) = message.parse::<Spec>() {
        assert!(!error.to_string().is_empty());
    }
}

fn law_text(dice: &mut Dice) {
    const WORDS: [&str; 38] = [
        "d", "v", "k", "q", "+", "-", "*", "/", "**", "(", ")", ",", "max", "min", "abs", "sqrt",
        "sign", "exp", "tanh", "where", "clip", "<", ">=", "==", "1e308", "0", "-1", "1e-308",
        "2.5", " ", ".", "e", "\u{e9}", "[", "\"", "if", "^", "3N/m",
    ];
    let lines = [
        "k*d + q*d**3",
        "max(0, d)*k - 3*tanh(d/k)",
        "f*v*exp(-(v/w)**2)",
        "-f/(1 + (d/w)**2)",
    ];
    let (elastic, damping) = (text(dice, &lines, &WORDS), text(dice, &lines, &WORDS));
    let edges = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e308,
        -1e308,
        5e-324,
        f64::INFINITY,
        f64::NAN,
        1e-3,
    ];
    let constants: Constants = ["k", "q", "f", "w"]
        .into_iter()
        .map(|name| (name.to_owned(), edges[dice.below(edges.len())]))
        .collect();
    let points: Vec<(f64, f64)> = (0..dice.below(5))
        .map(|_| {
            (
                edges[dice.below(edges.len())],
                edges[dice.below(edges.len())],
            )
        })
        .collect();
    let open: Vec<String> = (0..dice.below(3))
        .map(|_| ["k", "q", "f", "w"][dice.below(4)].to_owned())
        .collect();
    let law = LawText {
        law: (dice.below(8) > 0).then_some(elastic.as_str()),
        damping: (dice.below(3) == 0).then_some(damping.as_str()),
        constants,
        points: (dice.below(8) == 0).then_some(points.as_slice()),
        open: &open,
    };
    let longest = elastic
        .chars()
        .count()
        .max(damping.chars().count())
        .max(points.len());
    let reach = edges[dice.below(edges.len())];
    match Law::new(&law).and_then(|law| law.through(reach)) {
        Err(error) => {
            assert!(!error.message.is_empty());
            assert!(
                error.offset + error.length <= longest.max(1),
                "{error:?} in {elastic:?} {damping:?}"
            );
        }
        Ok(law) => {
            for x in edges {
                law.force(x, -x);
                law.potential(x);
                law.slope(x);
                law.damping_slope(x);
            }
            law.is_active(1e-2, 1.0);
            law.rows();
        }
    }
}

fn take_numbers(dice: &mut Dice) {
    let edges = [
        0.0,
        1.0,
        -1.0,
        1e-9,
        1e9,
        1e308,
        5e-324,
        f64::INFINITY,
        f64::NAN,
    ];
    let number = |dice: &mut Dice, usual: f64| match dice.below(12) {
        0 => edges[dice.below(edges.len())],
        _ => usual,
    };
    let n = dice.below(12);
    let t: Vec<f64> = (0..n).map(|i| number(dice, i as f64 * 1e-3)).collect();
    let x: Vec<f64> = (0..n.saturating_sub(dice.below(8) / 7))
        .map(|i| number(dice, i as f64 * 1e-4))
        .collect();
    let preparation = Preparation {
        trim: (dice.below(2) == 0).then(|| (number(dice, 1e-3), number(dice, 5e-3))),
        smooth: (dice.below(2) == 0).then(|| number(dice, 40.0)),
    };
    match Take::new(&t, &x, preparation) {
        Ok(take) => assert!(take.duration() >= 0.0),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

type Case = fn(&mut Dice);

/// Name of a target, and the function that runs one case.
const TARGETS: &[(&str, Case)] = &[
    ("firefader bytes", firefader_bytes),
    ("frame bytes", frame_bytes),
    ("haply text", haply_text),
    ("emulated board", board_bytes),
    ("recording bytes", recording_bytes),
    ("device url", device_url),
    ("audio spec", audio_spec),
    ("law text", law_text),
    ("take numbers", take_numbers),
];

/// Run `count` cases of each target, from a first number on; report every failure with the number of its case.
#[allow(clippy::print_stdout)] // cases per second, for docs/fuzzing.md
fn fuzzed(count: u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let (first, count) = (
        number("FUZZ_FROM").unwrap_or(0),
        number("FUZZ_COUNT").unwrap_or(count),
    );
    let asked = std::env::var("FUZZ_TARGET").ok();
    let mut faults = Vec::new();
    for &(name, target) in TARGETS {
        if asked.as_deref().is_some_and(|asked| asked != name) {
            continue;
        }
        let began = Instant::now();
        for case in first..first + count {
            if catch_unwind(AssertUnwindSafe(|| target(&mut Dice::seeded(case)))).is_err() {
                faults.push(format!("{name}, case {case}"));
                if faults.len() > 20 {
                    break;
                }
            }
        }
        let seconds = began.elapsed().as_secs_f64();
        eprintln!(
            "{name}: {count} cases, {:.0} a second",
            count as f64 / seconds
        );
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn readers_survive_random_bytes() {
    fuzzed(SHORT);
}

#[test]
#[ignore = "a million cases of each target: make test-long"]
fn readers_survive_a_million_random_cases() {
    fuzzed(LONG);
}

#[test]
fn recordings_with_cuts_and_flipped_bits_are_read() {
    let complete = recorded();
    for end in 0..complete.len() {
        read_recording(&complete[..end]);
    }
    for bit in 0..complete.len() * 8 {
        let mut bytes = complete.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        read_recording(&bytes);
    }
}
