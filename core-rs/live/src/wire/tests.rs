//! The bytes of each protocol, and the reaction to bytes of no protocol.

use proptest::prelude::*;

use super::*;
use crate::wire::MAX_AXES;

#[test]
fn firefader_request_bytes_of_forces() {
    assert_eq!(firefader::request([0.0, 0.0]), [0x7F, 0, 0]);
    // 0.78 N is half of 1.56 N: 63.5 rounds away from zero.
    assert_eq!(firefader::request([0.78, -0.78]), [0x7F, 64, 0xC0]);
    // 127 is the first byte of a request, and -127 is used in its place at the other end of the range.
    assert_eq!(firefader::request([9.0, -9.0]), [0x7F, 126, 0x81]);
    assert_eq!(firefader::request([f64::NAN, 0.0]), [0x7F, 0, 0]);
    assert_eq!(
        firefader::parse_request(&[0x7F, 64, 0xC0]),
        Parsed::Packet([64.0 * 1.56 / 127.0, -64.0 * 1.56 / 127.0], 3)
    );
}

#[test]
fn firefader_reply_bytes_of_positions() {
    let packet_bytes = [0xFF, 128, 0, 1, 2, 31, 30];
    let Parsed::Packet(parsed_reply, 7) = firefader::parse_reply(&packet_bytes) else {
        panic!("{packet_bytes:?}");
    };
    assert_eq!(parsed_reply.metres(0), 0.0);
    assert!((parsed_reply.metres(1) + 0.04992).abs() < 1e-15);
    assert_eq!((parsed_reply.analog, parsed_reply.capacitance), ([1, 2], [31, 30]));
    assert_eq!(parsed_reply.bytes(), packet_bytes);
    assert_eq!(firefader::position_byte(0.0039), 138);
    assert_eq!(firefader::position_byte(1.0), 254);
    assert_eq!(firefader::position_byte(-1.0), 0);
}

#[test]
fn firefader_inbox_finds_the_next_packet() {
    let mut inbox = PacketBuffer::<64>::empty();
    let mut seen_replies = Vec::new();
    // The end of a packet, a packet that is cut by the next one, and a packet in two pieces.
    for bytes in [&[3, 4, 0xFF, 9, 9, 0xFF, 130, 1][..], &[2, 3, 4, 5], &[0xFF, 7]] {
        inbox.add_bytes(bytes, firefader::parse_reply, |reply| seen_replies.push(reply));
    }
    assert_eq!(seen_replies.len(), 1);
    assert_eq!(seen_replies[0].position, [130, 1]);
    assert_eq!(inbox.garbage_bytes, 5);
}

#[test]
fn frame_crc_of_the_check_value() {
    // The check value of CRC-16/CCITT-FALSE.
    assert_eq!(frame::crc(b"123456789"), 0x29B1);
}

fn forces(n: usize) -> frame::FrameRequest {
    let mut force = [0.0; MAX_AXES];
    for (axis, force) in force[..n].iter_mut().enumerate() {
        *force = axis as f64 - 1.0;
    }
    frame::FrameRequest {
        seq: 0x0102,
        axis_count: n,
        is_wide: false,
        flags: frame::flag::ENABLE,
        force,
    }
}

#[test]
fn frame_bytes_of_a_request() {
    let mut frame_buffer = [0; frame::FRAME_BYTES_MAX];
    let frame_length = forces(2).write(2.0, &mut frame_buffer);
    // -1 N of 2 N is -16384 steps (-16383.5 rounds away from zero), 0xC000.
    let body_bytes = [0x02, 0x01, 2, 0x00, 0xC0, 0, 0, 1];
    let body_crc = frame::crc(&body_bytes).to_le_bytes();
    let mut expected = vec![0xA5, 0x5A];
    expected.extend(body_bytes);
    expected.extend(body_crc);
    assert_eq!(&frame_buffer[..frame_length], &expected[..]);
    // A request for twelve keys has 32 bytes, its reply 60.
    assert_eq!(forces(12).write(2.0, &mut frame_buffer), 32);
    let long_reply = frame::FrameReply {
        seq: 7,
        clock_us: 1_000_000,
        axis_count: 12,
        ..frame::FrameReply::default()
    };
    assert_eq!(long_reply.write(&mut frame_buffer), 60);
}

#[test]
fn frame_reply_positions_in_tens_of_nanometres() {
    let mut frame_buffer = [0; frame::FRAME_BYTES_MAX];
    let mut sent_reply = frame::FrameReply {
        axis_count: 1,
        ..frame::FrameReply::default()
    };
    sent_reply.position[0] = -0.001;
    let frame_length = sent_reply.write(&mut frame_buffer);
    assert_eq!(frame_buffer[9..13], (-100_000_i32).to_le_bytes());
    let Parsed::Packet(parsed_reply, complete) = frame::FrameReply::parse(&frame_buffer[..frame_length]) else {
        panic!("{frame_buffer:?}");
    };
    assert_eq!(complete, frame_length);
    assert!((parsed_reply.position[0] + 0.001).abs() < 1e-18);
}

#[test]
fn haply_messages_of_the_service() {
    let message_text = r#"{"session_id":1,"inverse3":[{"device_id":"A14","state":{"cursor_position":
        {"x":0.01,"y":-0.02,"z":0.15},"cursor_velocity":{"x":0,"y":0,"z":0}},"status":{"power":true}}]}"#;
    let device_state = haply::parse_state(message_text, None).unwrap();
    assert_eq!(
        (device_state.id.as_str(), device_state.position),
        ("A14", [0.01, -0.02, 0.15])
    );
    assert_eq!(haply::parse_state(message_text, Some("B2")), None);
    let command = haply::force_message("A14", [0.5, f64::NAN, -1.0]);
    assert_eq!(
        command,
        r#"{"inverse3":[{"commands":{"set_cursor_force":{"execute":true,"vector":{"x":0.5,"y":0.0,"z":-1.0}}},"device_id":"A14"}]}"#
    );
    assert_eq!(haply::parse_command(&command, "A14"), Some([0.5, 0.0, -1.0]));
    assert!(!device_state.in_lockstep, "no real service has the host's time");
    for lockstep in [false, true] {
        let state_message = haply::state_message("A14", [0.1, 0.2, 0.3], [0.0; 3], lockstep);
        let listened = haply::parse_state(&state_message, Some("A14")).unwrap();
        assert_eq!(listened.position, [0.1, 0.2, 0.3]);
        assert_eq!(listened.in_lockstep, lockstep);
    }
}

/// Every one of some random packets with random bytes between them is found, however the bytes are divided.
fn feeds<T: PartialEq + std::fmt::Debug>(
    packets: &[(Vec<u8>, T)],
    noise: &[Vec<u8>],
    piece: usize,
    parse: impl Fn(&[u8]) -> Parsed<T> + Copy,
) {
    let mut stream_bytes = Vec::new();
    for (i, (packet, _)) in packets.iter().enumerate() {
        stream_bytes.extend(noise.get(i).into_iter().flatten());
        stream_bytes.extend(packet);
    }
    let (mut inbox, mut seen_packets) = (PacketBuffer::<512>::empty(), Vec::new());
    for piece in stream_bytes.chunks(piece) {
        inbox.add_bytes(piece, parse, |packet| seen_packets.push(packet));
    }
    let expected: Vec<&T> = packets.iter().map(|(_, packet)| packet).collect();
    assert_eq!(seen_packets.iter().collect::<Vec<_>>(), expected);
}

proptest! {
    #[test]
    fn parsers_accept_random_bytes(bytes in prop::collection::vec(any::<u8>(), 0..600), piece in 1_usize..80) {
        let mut firefader_in = PacketBuffer::<64>::empty();
        let mut frame_in = PacketBuffer::<512>::empty();
        let mut who_in = PacketBuffer::<512>::empty();
        for piece in bytes.chunks(piece) {
            firefader_in.add_bytes(piece, firefader::parse_reply, |reply| {
                assert!((0..2).all(|axis| reply.metres(axis).abs() < 0.05));
            });
            firefader_in.add_bytes(piece, firefader::parse_request, |force| {
                assert!(force.iter().all(|force| force.abs() <= 1.58));
            });
            frame_in.add_bytes(piece, frame::FrameReply::parse, |reply| {
                assert!(reply.position.iter().all(|x| x.is_finite()));
            });
            frame_in.add_bytes(piece, |bytes| frame::FrameRequest::parse(bytes, 2.0), |_| ());
            who_in.add_bytes(piece, frame::DeviceInfo::parse, |_| ());
        }
        let text = String::from_utf8_lossy(&bytes);
        haply::parse_state(&text, None);
        haply::parse_command(&text, "A14");
    }

    #[test]
    fn firefader_replies_are_parsed_from_noise(
        data in prop::collection::vec(prop::array::uniform6(0_u8..255), 1..8),
        noise in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..9), 0..8),
        piece in 1_usize..20,
    ) {
        let packets: Vec<_> = data
            .iter()
            .map(|&[a, b, c, d, e, f]| {
                let reply = firefader::FaderReply { position: [a, b], analog: [c, d], capacitance: [e, f] };
                (reply.bytes().to_vec(), reply)
            })
            .collect();
        // Seven bytes of noise that look like a reply are a reply: FireFader has no checksum.
        let noise: Vec<Vec<u8>> = noise
            .into_iter()
            .map(|noise| noise.into_iter().filter(|&byte| byte != 0xFF).collect())
            .collect();
        feeds(&packets, &noise, piece, firefader::parse_reply);
    }

    #[test]
    fn frames_are_parsed_from_noise(
        positions in prop::collection::vec(
            (prop::collection::vec(-1.0..1.0_f64, 1..MAX_AXES), any::<bool>(), any::<u8>()), 1..6),
        noise in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..9), 0..6),
        piece in 1_usize..200,
    ) {
        let packets: Vec<_> = positions
            .into_iter()
            .enumerate()
            .map(|(i, (positions, is_wide, status))| {
                let mut position = [0.0; MAX_AXES];
                for (to, from) in position.iter_mut().zip(&positions) {
                    // Round the position to a narrow frame's step.
                    *to = if is_wide { *from } else { (from / frame::POSITION_STEP).round() * frame::POSITION_STEP };
                }
                let n = positions.len();
                let reply = frame::FrameReply { seq: i as u16, clock_us: 9, axis_count: n, is_wide, status, position };
                let mut bytes = [0; frame::FRAME_BYTES_MAX];
                let len = reply.write(&mut bytes);
                (bytes[..len].to_vec(), reply)
            })
            .collect();
        // A stray first byte may hide the bytes after it until the buffer is full; other noise hides nothing.
        let noise: Vec<Vec<u8>> = noise
            .into_iter()
            .map(|noise| noise.into_iter().filter(|&byte| byte != 0xA5).collect())
            .collect();
        feeds(&packets, &noise, piece, frame::FrameReply::parse);
    }

    #[test]
    fn frame_with_a_flipped_bit_is_refused(bit in 0_usize..(16 * 8), seq in any::<u16>()) {
        let mut bytes = [0; frame::FRAME_BYTES_MAX];
        let mut request = forces(3);
        request.seq = seq;
        let len = request.write(2.0, &mut bytes);
        prop_assert_eq!(len, 14);
        let bit = bit % (len * 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let is_accepted = matches!(frame::FrameRequest::parse(&bytes[..len], 2.0), Parsed::Packet(..));
        prop_assert!(!is_accepted);
    }

    #[test]
    fn wide_frame_with_non_finite_force_is_garbage(axis in 0_usize..3, infinite in any::<bool>()) {
        let mut request = forces(3);
        request.is_wide = true;
        request.force[axis] = if infinite { f64::INFINITY } else { f64::NAN };
        let mut bytes = [0; frame::FRAME_BYTES_MAX];
        let len = request.write(2.0, &mut bytes);
        prop_assert_eq!(frame::FrameRequest::parse(&bytes[..len], 2.0), Parsed::Skip(len));
    }
}
