use proptest::prelude::*;

use super::*;
use crate::emulate::{EmulatedHand, KeyConstants};
use crate::wire::Parsed;

fn board(protocol: Protocol, lockstep: bool) -> BoardConfig {
    BoardConfig {
        protocol,
        lockstep,
        touch_gate: protocol == Protocol::FireFader,
        force_max: 10.0,
        resolution: 0.0,
        noise: 0.0,
        seed: 0,
        force_step: 0.0,
        watchdog: Duration::from_millis(50),
        reported_constants: [0.05, 1.0],
        range: KeyConstants::default().range,
    }
}

fn firmware(board: BoardConfig, n: usize, hand: EmulatedHand) -> Firmware {
    let keys = EmulatedKeys::new(n, KeyConstants::default(), 1000.0, vec![hand; n]).unwrap();
    Firmware::new(board, keys)
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn firefader_reply(firmware: &mut Firmware, force: [f64; 2], now: Duration) -> firefader::FaderReply {
    let mut replies = Vec::new();
    firmware.receive(&firefader::request(force), now, &mut |bytes| {
        replies.push(firefader::parse_reply(bytes));
    });
    let [Parsed::Packet(only_reply, 7)] = replies[..] else {
        panic!("{replies:?}");
    };
    only_reply
}

#[test]
fn untouched_key_gets_no_force() {
    let mut free_firmware = firmware(board(Protocol::FireFader, true), 2, EmulatedHand::Free);
    for _ in 0..100 {
        let reply = firefader_reply(&mut free_firmware, [1.0, -1.0], ms(0));
        assert_eq!((reply.position, reply.capacitance), ([128; 2], [0; 2]));
    }
    let mut touched = firmware(board(Protocol::FireFader, true), 2, EmulatedHand::Resting);
    // The gate is a filter over packets with threshold 20: 5, 9.8, 14.5, 19.1, 23.5.
    for n in 1..=20 {
        firefader_reply(&mut touched, [1.0, -1.0], ms(0));
        let is_pushed = touched.forces()[0] > 0.0;
        assert_eq!(is_pushed, n >= 5, "{n}");
    }
    let reply = firefader_reply(&mut touched, [1.0, -1.0], ms(0));
    assert!(reply.position[0] > 128 && reply.position[1] < 128, "{reply:?}");
    assert!(reply.capacitance[0] > firefader::CAP_TOUCHED);
}

#[test]
fn silent_host_releases_the_key() {
    let mut board = board(Protocol::FireFader, false);
    board.touch_gate = false;
    let mut firmware = firmware(board, 2, EmulatedHand::Resting);
    firefader_reply(&mut firmware, [1.0, 0.0], ms(10));
    assert!(!firmware.run_to(ms(59)));
    assert!(firmware.forces()[0] > 0.9);
    assert!(firmware.run_to(ms(61)), "after 50 ms");
    assert_eq!(firmware.forces()[0], 0.0);
    assert!(!firmware.run_to(ms(200)), "told once");
    assert_eq!(firmware.keys().periods(), 200);
    firefader_reply(&mut firmware, [1.0, 0.0], ms(200));
    assert!(firmware.forces()[0] > 0.9, "and comes back");
}

#[test]
fn firmware_without_lockstep_uses_the_newest_packet() {
    let mut board = board(Protocol::FireFader, false);
    board.touch_gate = false;
    let mut firmware = firmware(board, 2, EmulatedHand::Resting);
    let mut two_packets = firefader::request([-1.0, 0.0]).to_vec();
    two_packets.extend(firefader::request([0.5, 0.0]));
    let mut replies = 0;
    firmware.receive(&two_packets, ms(0), &mut |_| replies += 1);
    assert_eq!(replies, 1);
    assert!(firmware.forces()[0] > 0.4);
}

fn frame_reply(firmware: &mut Firmware, request: frame::FrameRequest) -> Parsed<frame::FrameReply> {
    let mut frame_bytes = [0; frame::FRAME_BYTES_MAX];
    let request_length = request.write(10.0, &mut frame_bytes);
    let mut parsed_reply = Parsed::Incomplete;
    firmware.receive(&frame_bytes[..request_length], ms(7), &mut |frame_bytes| {
        parsed_reply = frame::FrameReply::parse(frame_bytes)
    });
    parsed_reply
}

#[test]
fn frame_with_ask_takes_no_step() {
    let mut firmware = firmware(board(Protocol::Frame, true), 3, EmulatedHand::Resting);
    let mut request = frame::FrameRequest {
        seq: 9,
        axis_count: 3,
        is_wide: true,
        flags: flag::ENABLE | flag::REQUEST,
        force: [1.0; MAX_AXES],
    };
    let Parsed::Packet(reply, _) = frame_reply(&mut firmware, request) else {
        panic!("no reply");
    };
    assert_eq!((reply.seq, reply.clock_us, reply.position[0]), (9, 0, 0.0));
    assert_eq!(firmware.keys().periods(), 0);
    request.flags = flag::ENABLE;
    let Parsed::Packet(reply, _) = frame_reply(&mut firmware, request) else {
        panic!("no reply");
    };
    // F T²/m after one period from rest.
    assert!((reply.position[2] - 1e-6 / 0.05).abs() < 1e-18);
    assert_eq!(
        (reply.clock_us, reply.status),
        (1000, status::TOUCHED | status::ENABLED)
    );
    request.flags = 0;
    frame_reply(&mut firmware, request);
    assert_eq!(firmware.forces()[0], 0.0, "not enabled");
    request.axis_count = 2;
    assert_eq!(
        frame_reply(&mut firmware, request),
        Parsed::Incomplete,
        "not for this board"
    );
}

#[test]
fn device_info_of_a_frame_board() {
    let mut firmware = firmware(board(Protocol::Frame, true), 12, EmulatedHand::Free);
    let request = frame::FrameRequest {
        seq: 3,
        ..frame::FrameRequest::default()
    };
    let mut frame_bytes = [0; frame::FRAME_BYTES_MAX];
    let request_length = request.write(10.0, &mut frame_bytes);
    let mut board_info = Parsed::Incomplete;
    firmware.receive(&frame_bytes[..request_length], ms(0), &mut |frame_bytes| {
        board_info = frame::DeviceInfo::parse(frame_bytes)
    });
    let Parsed::Packet(board_info, _) = board_info else {
        panic!("{board_info:?}");
    };
    assert_eq!(
        (board_info.seq, board_info.axis_count, board_info.trait_flags),
        (3, 12, 4 | 8)
    );
    assert_eq!(board_info.spec_values[..2], [10.0, 10.0]);
    assert_eq!(board_info.spec_values[6..], [0.05, 1.0]);
}

proptest! {
    /// Whatever bytes a host sends, a board does not panic, and does not push harder than its motors can.
    #[test]
    fn firmware_with_random_bytes_stays_within_its_force(
        pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..100), 0..20),
        lockstep in any::<bool>(),
    ) {
        for &protocol in Protocol::ALL {
            let mut firmware = firmware(board(protocol, lockstep), 3, EmulatedHand::Resting);
            for (i, piece) in pieces.iter().enumerate() {
                firmware.receive(piece, ms(i as u64), &mut |_| ());
                firmware.run_to(ms(i as u64));
                prop_assert!(firmware.forces().iter().all(|force| force.abs() <= 10.0));
                prop_assert!(firmware.keys().positions().iter().all(|x| x.abs() <= 0.05));
            }
        }
    }
}
