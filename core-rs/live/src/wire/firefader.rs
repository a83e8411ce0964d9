//! FireFader (Berdahl and Kontogeorgakopoulos): two faders, a byte for each quantity.
//!
//! host → device `7F fA fB`, device → host `FF posA posB analog1 analog2 capA capB`. Data never contains the first byte
//! of its packet.

use super::Parsed;

/// Force of byte 127 [N], with 12 V.
pub const FORCE_MAX: f64 = 1.56;
/// Step of a force byte [N].
pub const FORCE_LSB: f64 = FORCE_MAX / 127.0;
/// Step of a position byte [m].
pub const POSITION_STEP: f64 = 0.000_39;
/// Position byte at the middle of the travel.
const MIDDLE_BYTE: f64 = 128.0;
/// Capacitance above which a finger touches.
pub const CAP_TOUCHED: u8 = 30;

const REQUEST_START: u8 = 0x7F;
const REPLY_START: u8 = 0xFF;
/// Length of a reply.
pub const REPLY_BYTES: usize = 7;

/// The packet of two forces [N].
pub fn request(force: [f64; 2]) -> [u8; 3] {
    let [first_force, second_force] = force.map(|force| force_steps(force).cast_unsigned());
    [REQUEST_START, first_force, second_force]
}

/// The forces [N] as rounded by their packet.
pub fn rounded_forces(force: [f64; 2]) -> [f64; 2] {
    force.map(|force| f64::from(force_steps(force)) * FORCE_LSB)
}

/// A force in steps. `as` makes a NaN 0; 127 is excluded because it is the first byte.
fn force_steps(force: f64) -> i8 {
    (force / FORCE_LSB).round().clamp(-127.0, 126.0) as i8
}

/// The forces [N] of a packet.
pub fn parse_request(bytes: &[u8]) -> Parsed<[f64; 2]> {
    let force_of = |byte: u8| f64::from(byte.cast_signed()) * FORCE_LSB;
    match *bytes {
        [] | [REQUEST_START] => Parsed::Incomplete,
        // A first byte in the place of data: that packet was cut.
        [REQUEST_START, REQUEST_START, ..] => Parsed::Skip(1),
        [REQUEST_START, _] => Parsed::Incomplete,
        [REQUEST_START, _, REQUEST_START, ..] => Parsed::Skip(2),
        [REQUEST_START, a, b, ..] => Parsed::Packet([force_of(a), force_of(b)], 3),
        _ => Parsed::Skip(1),
    }
}

/// The reply of the faders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaderReply {
    /// 0 to 254, 128 in the middle.
    pub position: [u8; 2],
    /// Two free inputs.
    pub analog: [u8; 2],
    /// Capacitance at the fader, greater under a finger.
    pub capacitance: [u8; 2],
}

impl FaderReply {
    /// Position of a fader [m].
    pub fn metres(&self, axis: usize) -> f64 {
        (f64::from(self.position[axis]) - MIDDLE_BYTE) * POSITION_STEP
    }

    /// The bytes of the packet; data bytes are limited so that none equals the first byte.
    pub fn bytes(&self) -> [u8; REPLY_BYTES] {
        let (positions, analog_bytes, cap_bytes) = (self.position, self.analog, self.capacitance);
        let [p0, p1, a0, a1, c0, c1] = [
            positions[0],
            positions[1],
            analog_bytes[0],
            analog_bytes[1],
            cap_bytes[0],
            cap_bytes[1],
        ]
        .map(|byte| byte.min(REPLY_START - 1));
        [REPLY_START, p0, p1, a0, a1, c0, c1]
    }
}

/// The position byte of a fader at x [m].
pub fn position_byte(x: f64) -> u8 {
    (x / POSITION_STEP + MIDDLE_BYTE).round().clamp(0.0, 254.0) as u8
}

/// Parse a reply at the beginning of some bytes.
pub fn parse_reply(bytes: &[u8]) -> Parsed<FaderReply> {
    if bytes.first() != Some(&REPLY_START) {
        let next_start = bytes.iter().position(|&byte| byte == REPLY_START);
        return match (bytes.is_empty(), next_start) {
            (true, _) => Parsed::Incomplete,
            (false, next_start) => Parsed::Skip(next_start.unwrap_or(bytes.len())),
        };
    }
    let data_bytes = &bytes[1..bytes.len().min(REPLY_BYTES)];
    if let Some(cut_offset) = data_bytes.iter().position(|&byte| byte == REPLY_START) {
        return Parsed::Skip(1 + cut_offset);
    }
    match *data_bytes {
        [a, b, c, d, e, f] => Parsed::Packet(
            FaderReply {
                position: [a, b],
                analog: [c, d],
                capacitance: [e, f],
            },
            REPLY_BYTES,
        ),
        _ => Parsed::Incomplete,
    }
}
