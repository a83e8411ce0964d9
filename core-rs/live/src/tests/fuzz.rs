//! Seeded fuzzers of the Rust readers of bytes and text that come from outside: devices, recordings, laws.
//!
//! One table, `TARGETS`. Each case has its own seed, so that a case that fails runs alone: its number is in the message.
//! `make test` runs `SHORT` cases of each target, `make test-long` `LONG` (docs/fuzzing.md). FUZZ_TARGET, FUZZ_FROM and
//! FUZZ_COUNT choose one target and its cases.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use ergon_engine::gesture::take::{Preparation, Take};
use ergon_engine::law::{Constants, Law, LawText};

use crate::audio::Spec;
use crate::device::{MAX_AXES, Url};
use crate::emulate::{Board, Firmware, Hand, Key, Keys, Protocol};
use crate::recording::{Axis, Header, Recording, Sample, decode};
use crate::wire::{Inbox, Parsed, firefader, frame, haply};

const SHORT: u64 = 2_000;
const LONG: u64 = 1_000_000;

/// Splitmix64: the same numbers on every machine.
struct Dice(u64);

impl Dice {
    fn of(case: u64) -> Self {
        Self(case.wrapping_mul(0xD134_2543_DE82_EF95))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ (x >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn one_of<'a, T: ?Sized>(&mut self, all: &[&'a T]) -> &'a T {
        all[self.below(all.len())]
    }

    fn byte(&mut self) -> u8 {
        self.next() as u8
    }
}

/// A copy with one to four damages: bits flipped, bytes set, cut, removed, doubled, numbers at their edges.
fn damaged(dice: &mut Dice, whole: &[u8]) -> Vec<u8> {
    const EDGES: [&[u8]; 6] = [
        &[0; 8],
        &[0xFF; 8],
        &[0, 0, 0, 0x80],
        &[0xFF, 0xFF, 0xFF, 0x7F],
        &[0, 0, 0, 0, 0, 0, 0xF0, 0x7F],
        &[1, 0, 0, 0],
    ];
    let mut bytes = whole.to_vec();
    for _ in 0..1 + dice.below(4) {
        if bytes.is_empty() {
            bytes.push(dice.byte());
        }
        let at = dice.below(bytes.len());
        let end = bytes.len().min(at + 1 + dice.below(24));
        match dice.below(8) {
            0 | 1 => bytes[at] ^= 1 << dice.below(8),
            2 => bytes[at] = dice.byte(),
            3 => bytes.truncate(at),
            4 => drop(bytes.drain(at..end)),
            5 => {
                let part = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, part));
            }
            6 => {
                for (to, from) in bytes[at..].iter_mut().zip(dice.one_of(&EDGES)) {
                    *to = *from;
                }
            }
            _ => {
                let part: Vec<u8> = (0..dice.below(9)).map(|_| dice.byte()).collect();
                drop(bytes.splice(at..at, part));
            }
        }
    }
    bytes
}

/// Words in no order, or a line with damaged bytes.
fn text(dice: &mut Dice, lines: &[&str], words: &[&str]) -> String {
    if dice.below(2) == 0 {
        let line = dice.one_of(lines);
        return String::from_utf8_lossy(&damaged(dice, line.as_bytes())).into_owned();
    }
    (0..dice.below(24)).map(|_| dice.one_of(words)).collect()
}

/// Feed bytes in pieces; the calls of the parser are counted, for they are its work.
fn fed<T>(bytes: &[u8], piece: usize, parse: impl Fn(&[u8]) -> Parsed<T>, mut each: impl FnMut(T)) {
    let calls = std::cell::Cell::new(0_usize);
    let mut inbox = Inbox::<512>::new();
    let counted = |bytes: &[u8]| {
        calls.set(calls.get() + 1);
        let found = parse(bytes);
        match found {
            Parsed::Packet(_, len) | Parsed::Garbage(len) => {
                assert!((1..=bytes.len()).contains(&len), "a length of {len}");
            }
            Parsed::Incomplete => {}
        }
        found
    };
    for piece in bytes.chunks(piece) {
        inbox.feed(piece, counted, &mut each);
    }
    // At most one call for each byte that is passed over, and one more for each piece.
    let most = bytes.len() + bytes.len().div_ceil(piece) + 512;
    assert!(calls.get() <= most, "{} calls of {most}", calls.get());
}

/// A stream of sound packets, damaged.
fn stream(dice: &mut Dice, packet: impl Fn(&mut Dice) -> Vec<u8>) -> (Vec<u8>, usize) {
    let packets = 1 + dice.below(4);
    let whole: Vec<u8> = (0..packets).flat_map(|_| packet(dice)).collect();
    (damaged(dice, &whole), 1 + dice.below(80))
}

fn firefader_bytes(dice: &mut Dice) {
    let (bytes, piece) = stream(dice, |dice| {
        if dice.below(2) == 0 {
            let mut reply = [0xFF; 7];
            reply[1..].fill_with(|| dice.byte().min(254));
            reply.to_vec()
        } else {
            vec![0x7F, dice.byte(), dice.byte()]
        }
    });
    fed(&bytes, piece, firefader::parse_reply, |reply| {
        assert!((0..2).all(|axis| reply.metres(axis).abs() < 0.05));
    });
    fed(&bytes, piece, firefader::parse_request, |force| {
        assert!(force.iter().all(|force| force.abs() <= 1.58));
    });
}

fn frame_packet(dice: &mut Dice) -> Vec<u8> {
    let mut bytes = [0; frame::LONGEST];
    let (n, wide, seq) = (dice.below(MAX_AXES + 1), dice.below(2) == 0, 77);
    let len = match dice.below(3) {
        0 => {
            let force = std::array::from_fn(|axis| axis as f64 - 1.0);
            let flags = dice.byte();
            frame::Request {
                seq,
                n,
                wide,
                flags,
                force,
            }
            .write(2.0, &mut bytes)
        }
        1 => {
            let position = std::array::from_fn(|axis| axis as f64 * 1e-3);
            let (t_us, status) = (dice.next() as u32, dice.byte());
            frame::Reply {
                seq,
                t_us,
                n,
                wide,
                status,
                position,
            }
            .write(&mut bytes)
        }
        _ => {
            let (numbers, traits) = ([1.0; 8], dice.byte());
            frame::DeviceInfo {
                seq,
                n: n.max(1),
                traits,
                numbers,
            }
            .write(&mut bytes)
        }
    };
    let mut packet = bytes[..len].to_vec();
    if dice.below(3) == 0 {
        // Damage that the check sum does not tell: what stands behind it is read too.
        let at = 2 + dice.below(len - 4);
        packet[at] = dice.byte();
        let crc = frame::crc(&packet[2..len - 2]).to_le_bytes();
        packet[len - 2..].copy_from_slice(&crc);
    }
    packet
}

fn frame_bytes(dice: &mut Dice) {
    let (bytes, piece) = stream(dice, frame_packet);
    fed(&bytes, piece, frame::Reply::parse, |reply| {
        assert!(reply.position.iter().all(|x| x.is_finite()));
        assert!(reply.n <= MAX_AXES);
    });
    let request = |bytes: &[u8]| frame::Request::parse(bytes, 2.0);
    fed(&bytes, piece, request, |request| {
        assert!(request.force.iter().all(|x| x.is_finite()));
    });
    fed(&bytes, piece, frame::DeviceInfo::parse, |who| {
        assert!((1..=MAX_AXES).contains(&who.n));
    });
}

fn haply_text(dice: &mut Dice) {
    const WORDS: [&str; 22] = [
        "{",
        "}",
        "[",
        "]",
        ":",
        ",",
        "\"inverse3\"",
        "\"device_id\"",
        "\"A14\"",
        "\"state\"",
        "\"commands\"",
        "\"cursor_position\"",
        "\"set_cursor_force\"",
        "\"vector\"",
        "\"x\"",
        "\"y\"",
        "\"z\"",
        "1e999",
        "null",
        "-0.0",
        "[[[[",
        "\\ud800",
    ];
    let state = haply::state("A14", [0.1, -0.2, 0.0], [1.0, 2.0, 3.0], true);
    let command = haply::command("A14", [1.0, 2.0, 3.0]);
    let mut said = text(dice, &[&state, &command], &WORDS);
    if dice.below(500) == 0 {
        said = "[".repeat(60_000);
    }
    for id in [None, Some("A14")] {
        if let Some(state) = haply::parse_state(&said, id) {
            assert!(state.position.iter().all(|x| x.is_finite()));
        }
    }
    if let Some(force) = haply::parse_command(&said, "A14") {
        assert!(force.iter().all(|x| x.is_finite()));
    }
}

fn board_bytes(dice: &mut Dice) {
    let protocol = match dice.below(3) {
        0 => Protocol::FireFader,
        1 => Protocol::Frame,
        _ => Protocol::Haply,
    };
    let board = Board {
        protocol,
        lockstep: dice.below(2) == 0,
        touch_gate: protocol == Protocol::FireFader,
        force_max: 10.0,
        resolution: 0.0,
        watchdog: Duration::from_millis(50),
        known: [0.05, 1.0],
        range: Key::default().range,
    };
    let keys = Keys::new(3, Key::default(), 1000.0, vec![Hand::Resting; 3]).unwrap();
    let mut firmware = Firmware::new(board, keys);
    let bytes = match protocol {
        Protocol::FireFader => damaged(dice, &[0x7F, 9, 200, 0x7F, 1, 2]),
        Protocol::Frame => stream(dice, frame_packet).0,
        Protocol::Haply => damaged(dice, haply::command("EMUL", [1.0, 2.0, 3.0]).as_bytes()),
    };
    let piece = if protocol == Protocol::Haply {
        bytes.len().max(1)
    } else {
        1 + dice.below(40)
    };
    for (i, piece) in bytes.chunks(piece).enumerate() {
        firmware.hear(piece, Duration::from_millis(i as u64), &mut |_| ());
    }
    assert!(firmware.forces().iter().all(|force| force.abs() <= 10.0));
    assert!(firmware.keys().positions().iter().all(|x| x.is_finite()));
}

/// A recording of two axes and forty rows, whole.
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
    if let Ok(found) = decode(&mut &bytes[..], bytes.len() as u64, None) {
        assert_eq!(
            found.samples.len(),
            found.ticks.len() * found.header.axes.len()
        );
        assert!(found.ticks.is_sorted_by(|a, b| a < b));
        drop(found.held());
        drop(found.damage());
        found.duration();
    }
}

fn recording_bytes(dice: &mut Dice) {
    thread_local!(static WHOLE: Vec<u8> = recorded());
    let mut bytes = WHOLE.with(|whole| damaged(dice, whole));
    if dice.below(2) == 0 {
        // Check sums made right again, so that what stands behind them is read too.
        let mut at = 12;
        while let Some(head) = bytes.get(at..at + 9) {
            let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
            let Some(end) = (at + 9)
                .checked_add(length)
                .filter(|&end| end <= bytes.len())
            else {
                break;
            };
            let mut sum = crc32fast::Hasher::new();
            sum.update(&bytes[at..at + 5]);
            sum.update(&bytes[at + 9..end]);
            let sum = sum.finalize().to_le_bytes();
            bytes[at + 5..at + 9].copy_from_slice(&sum);
            at = end;
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
    let said = text(
        dice,
        &[
            "frame:/dev/ttyACM0?lockstep&wide#3",
            "haply:127.0.0.1:10001?id=A14",
            "emul:",
        ],
        &WORDS,
    );
    if let Err(error) = Url::parse(&said) {
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
    let said = text(
        dice,
        &[
            "jack:system:playback_[12],block=64,channels=2",
            "null:fast",
            "file:a,b.wav",
        ],
        &WORDS,
    );
    if let Err(error) = said.parse::<Spec>() {
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
    let law = LawText {
        law: (dice.below(8) > 0).then_some(elastic.as_str()),
        damping: (dice.below(3) == 0).then_some(damping.as_str()),
        constants,
        points: (dice.below(8) == 0).then_some(points.as_slice()),
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

/// Name, and what one case does.
const TARGETS: [(&str, Case); 9] = [
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

/// Run so many cases of each target, from a first one on; every fault is told, with the number of its case.
#[allow(clippy::print_stdout)] // cases per second, for docs/fuzzing.md
fn fuzzed(count: u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let (first, count) = (
        number("FUZZ_FROM").unwrap_or(0),
        number("FUZZ_COUNT").unwrap_or(count),
    );
    let asked = std::env::var("FUZZ_TARGET").ok();
    let mut faults = Vec::new();
    for (name, target) in TARGETS {
        if asked.as_deref().is_some_and(|asked| asked != name) {
            continue;
        }
        let began = Instant::now();
        for case in first..first + count {
            if catch_unwind(AssertUnwindSafe(|| target(&mut Dice::of(case)))).is_err() {
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
fn no_bytes_break_a_reader() {
    fuzzed(SHORT);
}

#[test]
#[ignore = "a million cases of each target: make test-long"]
fn no_million_of_cases_breaks_a_reader() {
    fuzzed(LONG);
}

#[test]
fn every_cut_and_every_bit_of_a_recording() {
    let whole = recorded();
    for end in 0..whole.len() {
        read_recording(&whole[..end]);
    }
    for bit in 0..whole.len() * 8 {
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        read_recording(&bytes);
    }
}
