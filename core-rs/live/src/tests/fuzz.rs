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

use crate::audio::AudioSpec;
use crate::device::DeviceUrl;
use crate::recording::{Header, RecordedAxis, RecordedSample, Recording, decode};
use dice::{Dice, damaged, text};
use wire::{board_bytes, firefader_bytes, frame_bytes, haply_text};

const SHORT: u64 = 2_000;
const LONG: u64 = 1_000_000;

/// An intact recording of two axes and forty rows.
fn recorded() -> Vec<u8> {
    let numbered_axis = |i| RecordedAxis {
        player: format!("remi{i}"),
        key: format!("k{i}"),
    };
    let header = Header {
        rate: 44_100.0,
        frames: 44,
        axes: (0..2).map(numbered_axis).collect(),
        about: "{}".to_owned(),
    };
    let numbered_sample = |i: u64| RecordedSample {
        position: i as f64 * 1e-3,
        force: -(i as f64),
        sent_force: 0.5,
        flags: i as u8,
        clock: i as u32,
    };
    let all_samples = (0..80).map(numbered_sample).collect();
    let mut recording = Recording::new(header, (3..43).collect(), all_samples).unwrap();
    recording.events = vec![(5, "{\"gain\":1}".to_owned())];
    let mut file_bytes = Vec::new();
    recording.write(&mut file_bytes).unwrap();
    file_bytes
}

fn read_recording(bytes: &[u8]) {
    if let Ok(recording) = decode(&mut &bytes[..], bytes.len() as u64, None) {
        assert_eq!(
            recording.samples.len(),
            recording.ticks.len() * recording.header.axes.len()
        );
        assert!(recording.ticks.is_sorted_by(|a, b| a < b));
        drop(recording.positions_filled());
        drop(recording.damage());
        recording.duration();
    }
}

fn recording_bytes(dice: &mut Dice) {
    thread_local!(static WHOLE: Vec<u8> = recorded());
    let mut file_bytes = WHOLE.with(|whole| damaged(dice, whole));
    if dice.below(2) == 0 {
        // Correct the checksums, so that the bytes after them are read too.
        let mut position = 12;
        while let Some(chunk_head) = file_bytes.get(position..position + 9) {
            let payload_length =
                u32::from_le_bytes([chunk_head[0], chunk_head[1], chunk_head[2], chunk_head[3]]) as usize;
            let Some(chunk_end) = (position + 9)
                .checked_add(payload_length)
                .filter(|&chunk_end| chunk_end <= file_bytes.len())
            else {
                break;
            };
            let mut checksum = crc32fast::Hasher::new();
            checksum.update(&file_bytes[position..position + 5]);
            checksum.update(&file_bytes[position + 9..chunk_end]);
            let checksum = checksum.finalize().to_le_bytes();
            file_bytes[position + 5..position + 9].copy_from_slice(&checksum);
            position = chunk_end;
        }
    }
    read_recording(&file_bytes);
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
    if let Err(error) = DeviceUrl::parse(&message) {
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
    if let Err(error) = message.parse::<AudioSpec>() {
        assert!(!error.to_string().is_empty());
    }
}

fn law_text(dice: &mut Dice) {
    const WORDS: [&str; 38] = [
        "d", "v", "k", "q", "+", "-", "*", "/", "**", "(", ")", ",", "max", "min", "abs", "sqrt", "sign", "exp",
        "tanh", "where", "clip", "<", ">=", "==", "1e308", "0", "-1", "1e-308", "2.5", " ", ".", "e", "\u{e9}", "[",
        "\"", "if", "^", "3N/m",
    ];
    let law_lines = [
        "k*d + q*d**3",
        "max(0, d)*k - 3*tanh(d/k)",
        "f*v*exp(-(v/w)**2)",
        "-f/(1 + (d/w)**2)",
    ];
    let (elastic, damping) = (text(dice, &law_lines, &WORDS), text(dice, &law_lines, &WORDS));
    let edge_numbers = [
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
        .map(|name| (name.to_owned(), edge_numbers[dice.below(edge_numbers.len())]))
        .collect();
    let force_points: Vec<(f64, f64)> = (0..dice.below(5))
        .map(|_| {
            (
                edge_numbers[dice.below(edge_numbers.len())],
                edge_numbers[dice.below(edge_numbers.len())],
            )
        })
        .collect();
    let open_constants: Vec<String> = (0..dice.below(3))
        .map(|_| ["k", "q", "f", "w"][dice.below(4)].to_owned())
        .collect();
    let law = LawText {
        law: (dice.below(8) > 0).then_some(elastic.as_str()),
        damping: (dice.below(3) == 0).then_some(damping.as_str()),
        constants,
        points: (dice.below(8) == 0).then_some(force_points.as_slice()),
        open: &open_constants,
    };
    let longest = elastic
        .chars()
        .count()
        .max(damping.chars().count())
        .max(force_points.len());
    let law_reach = edge_numbers[dice.below(edge_numbers.len())];
    match Law::new(&law).and_then(|law| law.behind_lever(law_reach)) {
        Err(error) => {
            assert!(!error.message.is_empty());
            assert!(
                error.offset + error.length <= longest.max(1),
                "{error:?} in {elastic:?} {damping:?}"
            );
        }
        Ok(law) => {
            for x in edge_numbers {
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
    let edge_numbers = [0.0, 1.0, -1.0, 1e-9, 1e9, 1e308, 5e-324, f64::INFINITY, f64::NAN];
    let draw_number = |dice: &mut Dice, usual: f64| match dice.below(12) {
        0 => edge_numbers[dice.below(edge_numbers.len())],
        _ => usual,
    };
    let sample_count = dice.below(12);
    let sample_times: Vec<f64> = (0..sample_count).map(|i| draw_number(dice, i as f64 * 1e-3)).collect();
    let sample_positions: Vec<f64> = (0..sample_count.saturating_sub(dice.below(8) / 7))
        .map(|i| draw_number(dice, i as f64 * 1e-4))
        .collect();
    let preparation = Preparation {
        trim: (dice.below(2) == 0).then(|| (draw_number(dice, 1e-3), draw_number(dice, 5e-3))),
        smooth: (dice.below(2) == 0).then(|| draw_number(dice, 40.0)),
    };
    match Take::new(&sample_times, &sample_positions, preparation) {
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
    let env_number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let (first_case, count) = (
        env_number("FUZZ_FROM").unwrap_or(0),
        env_number("FUZZ_COUNT").unwrap_or(count),
    );
    let asked_target = std::env::var("FUZZ_TARGET").ok();
    let mut failed_cases = Vec::new();
    for &(name, target) in TARGETS {
        if asked_target.as_deref().is_some_and(|asked_target| asked_target != name) {
            continue;
        }
        let target_began = Instant::now();
        for case in first_case..first_case + count {
            if catch_unwind(AssertUnwindSafe(|| target(&mut Dice::seeded(case)))).is_err() {
                failed_cases.push(format!("{name}, case {case}"));
                if failed_cases.len() > 20 {
                    break;
                }
            }
        }
        let seconds = target_began.elapsed().as_secs_f64();
        eprintln!("{name}: {count} cases, {:.0} a second", count as f64 / seconds);
    }
    assert!(failed_cases.is_empty(), "{failed_cases:#?}");
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
        let mut damaged_bytes = complete.clone();
        damaged_bytes[bit / 8] ^= 1 << (bit % 8);
        read_recording(&damaged_bytes);
    }
}
