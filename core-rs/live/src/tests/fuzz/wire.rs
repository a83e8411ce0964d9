//! Bytes from devices, and an emulated board that is fed with bytes.

use std::time::Duration;

use crate::device::MAX_AXES;
use crate::emulate::{BoardConfig, EmulatedHand, EmulatedKeys, Firmware, KeyConstants, Protocol};
use crate::wire::{PacketBuffer, Parsed, firefader, frame, haply};

use super::dice::{Dice, damaged, text};

/// Feed bytes in pieces. The calls of the parser are counted, as a measure of its work.
fn fed<T>(bytes: &[u8], piece: usize, parse: impl Fn(&[u8]) -> Parsed<T>, mut each: impl FnMut(T)) {
    let parse_calls = std::cell::Cell::new(0_usize);
    let mut test_inbox = PacketBuffer::<512>::empty();
    let counted = |bytes: &[u8]| {
        parse_calls.set(parse_calls.get() + 1);
        let parse_result = parse(bytes);
        match parse_result {
            Parsed::Packet(_, len) | Parsed::Skip(len) => {
                assert!((1..=bytes.len()).contains(&len), "a length of {len}");
            }
            Parsed::Incomplete => {}
        }
        parse_result
    };
    for piece in bytes.chunks(piece) {
        test_inbox.add_bytes(piece, counted, &mut each);
    }
    // At most one call for each byte that is skipped, and one more for each piece.
    let call_limit = bytes.len() + bytes.len().div_ceil(piece) + 512;
    assert!(
        parse_calls.get() <= call_limit,
        "{} calls of {call_limit}",
        parse_calls.get()
    );
}

/// A stream of valid packets with damage.
fn stream(dice: &mut Dice, packet: impl Fn(&mut Dice) -> Vec<u8>) -> (Vec<u8>, usize) {
    let packets = 1 + dice.below(4);
    let complete: Vec<u8> = (0..packets).flat_map(|_| packet(dice)).collect();
    (damaged(dice, &complete), 1 + dice.below(80))
}

pub(super) fn firefader_bytes(dice: &mut Dice) {
    let (stream_bytes, piece_size) = stream(dice, |dice| {
        if dice.below(2) == 0 {
            let mut reply = [0xFF; 7];
            reply[1..].fill_with(|| dice.byte().min(254));
            reply.to_vec()
        } else {
            vec![0x7F, dice.byte(), dice.byte()]
        }
    });
    fed(&stream_bytes, piece_size, firefader::parse_reply, |reply| {
        assert!((0..2).all(|axis| reply.metres(axis).abs() < 0.05));
    });
    fed(&stream_bytes, piece_size, firefader::parse_request, |force| {
        assert!(force.iter().all(|force| force.abs() <= 1.58));
    });
}

fn frame_packet(dice: &mut Dice) -> Vec<u8> {
    let mut frame_buffer = [0; frame::FRAME_BYTES_MAX];
    let (n, wide, seq) = (dice.below(MAX_AXES + 1), dice.below(2) == 0, 77);
    let frame_length = match dice.below(3) {
        0 => {
            let force = std::array::from_fn(|axis| axis as f64 - 1.0);
            let flags = dice.byte();
            frame::FrameRequest {
                seq,
                axis_count: n,
                is_wide: wide,
                flags,
                force,
            }
            .write(2.0, &mut frame_buffer)
        }
        1 => {
            let position = std::array::from_fn(|axis| axis as f64 * 1e-3);
            let (clock_us, status) = (dice.next() as u32, dice.byte());
            frame::FrameReply {
                seq,
                clock_us,
                axis_count: n,
                is_wide: wide,
                status,
                position,
            }
            .write(&mut frame_buffer)
        }
        _ => {
            let (numbers, traits) = ([1.0; 8], dice.byte());
            frame::DeviceInfo {
                seq,
                axis_count: n.max(1),
                trait_flags: traits,
                spec_values: numbers,
            }
            .write(&mut frame_buffer)
        }
    };
    let mut packet_bytes = frame_buffer[..frame_length].to_vec();
    if dice.below(3) == 0 {
        // Damage that passes the checksum, so that the bytes after it are read too.
        let byte_offset = 2 + dice.below(frame_length - 4);
        packet_bytes[byte_offset] = dice.byte();
        let packet_crc = frame::crc(&packet_bytes[2..frame_length - 2]).to_le_bytes();
        packet_bytes[frame_length - 2..].copy_from_slice(&packet_crc);
    }
    packet_bytes
}

pub(super) fn frame_bytes(dice: &mut Dice) {
    let (stream_bytes, piece_size) = stream(dice, frame_packet);
    fed(&stream_bytes, piece_size, frame::FrameReply::parse, |reply| {
        assert!(reply.position.iter().all(|x| x.is_finite()));
        assert!(reply.axis_count <= MAX_AXES);
    });
    let request = |stream_bytes: &[u8]| frame::FrameRequest::parse(stream_bytes, 2.0);
    fed(&stream_bytes, piece_size, request, |request| {
        assert!(request.force.iter().all(|x| x.is_finite()));
    });
    fed(&stream_bytes, piece_size, frame::DeviceInfo::parse, |who| {
        assert!((1..=MAX_AXES).contains(&who.axis_count));
    });
}

pub(super) fn haply_text(dice: &mut Dice) {
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
    let state = haply::state_message("A14", [0.1, -0.2, 0.0], [1.0, 2.0, 3.0], true);
    let command = haply::force_message("A14", [1.0, 2.0, 3.0]);
    let mut message = text(dice, &[&state, &command], &WORDS);
    if dice.below(500) == 0 {
        message = "[".repeat(60_000);
    }
    for id in [None, Some("A14")] {
        if let Some(state) = haply::parse_state(&message, id) {
            assert!(state.position.iter().all(|x| x.is_finite()));
        }
    }
    if let Some(parsed_force) = haply::parse_command(&message, "A14") {
        assert!(parsed_force.iter().all(|x| x.is_finite()));
    }
}

pub(super) fn board_bytes(dice: &mut Dice) {
    let protocol = Protocol::ALL[dice.below(Protocol::ALL.len())];
    let test_board = BoardConfig {
        protocol,
        lockstep: dice.below(2) == 0,
        touch_gate: protocol == Protocol::FireFader,
        force_max: 10.0,
        resolution: 0.0,
        noise: 0.0,
        seed: 0,
        force_step: 0.0,
        watchdog: Duration::from_millis(50),
        reported_constants: [0.05, 1.0],
        range: KeyConstants::default().range,
    };
    let board_keys = EmulatedKeys::new(3, KeyConstants::default(), 1000.0, vec![EmulatedHand::Resting; 3]).unwrap();
    let mut firmware = Firmware::new(test_board, board_keys);
    let host_bytes = match protocol {
        Protocol::FireFader => damaged(dice, &[0x7F, 9, 200, 0x7F, 1, 2]),
        Protocol::Frame => stream(dice, frame_packet).0,
        Protocol::Haply => damaged(dice, haply::force_message("EMUL", [1.0, 2.0, 3.0]).as_bytes()),
    };
    let piece = if protocol == Protocol::Haply {
        host_bytes.len().max(1)
    } else {
        1 + dice.below(40)
    };
    for (i, piece) in host_bytes.chunks(piece).enumerate() {
        firmware.receive(piece, Duration::from_millis(i as u64), &mut |_| ());
    }
    assert!(firmware.forces().iter().all(|force| force.abs() <= 10.0));
    assert!(firmware.keys().positions().iter().all(|x| x.is_finite()));
}
