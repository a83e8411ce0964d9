//! The open frame (docs/open-frame.md): little-endian, `A5 5A` first, a CRC last.
//!
//! host → device `A5 5A seq:u16 n:u8 n×force flags:u8 crc:u16`, device → host `A5 5A seq:u16 t_us:u32 n:u8 n×position
//! status:u8 crc:u16`. A force is an i16 in 1/32767 of the greatest force, a position an i32 in 10 nm (or 10 nrad); if
//! bit 7 of n is set, both are f64 in SI units. A request without axes asks for the properties of the device; the
//! answer begins with `A5 5D`.

use super::Parsed;
use crate::wire::MAX_AXES;

const SYNC: [u8; 2] = [0xA5, 0x5A];
const SYNC_INFO: [u8; 2] = [0xA5, 0x5D];
/// Step of a position in a narrow frame [m or rad].
pub const POSITION_STEP: f64 = 1e-8;
/// Number of steps of the greatest force in a narrow frame.
pub const FORCE_STEPS: f64 = 32767.0;
const WIDE_FLAG: u8 = 0x80;
/// Longest frame.
pub const FRAME_BYTES_MAX: usize = 12 + 8 * MAX_AXES;

/// Bits of a request's flags.
pub mod flag {
    /// Enable the motors.
    pub const ENABLE: u8 = 1;
    /// Ask for positions: the forces stay, and in lockstep no step is made.
    pub const REQUEST: u8 = 2;
}

/// Bits of a reply's status.
pub mod status {
    /// A finger is on a key.
    pub const TOUCHED: u8 = 1;
    /// The motors are enabled.
    pub const ENABLED: u8 = 2;
    /// The motors are hot and their force is reduced.
    pub const HOT: u8 = 4;
    /// The device had received nothing for too long and had set its forces to zero.
    pub const LET_GO: u8 = 8;
}

/// Bits of the traits that a device reports.
pub mod trait_flag {
    /// Positions are in radians, not in metres.
    pub const RADIANS: u8 = 1;
    /// There is force only while a finger touches the key.
    pub const TOUCH_GATED: u8 = 2;
    /// The device can run in lockstep.
    pub const LOCKSTEP: u8 = 4;
    /// The device understands wide frames.
    pub const WIDE: u8 = 8;
}

/// A request with forces for a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameRequest {
    /// Number of the request, which the reply echoes.
    pub seq: u16,
    /// Number of axes; 0 asks for the properties of the device.
    pub axis_count: usize,
    /// Whether forces and positions are f64.
    pub is_wide: bool,
    /// Bits of [`flag`].
    pub flags: u8,
    /// Force of each axis [N] or [N·m].
    pub force: [f64; MAX_AXES],
}

/// A reply with the positions of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameReply {
    /// Number of the request.
    pub seq: u16,
    /// The device's clock [µs].
    pub clock_us: u32,
    /// Number of axes.
    pub axis_count: usize,
    /// Whether positions are f64.
    pub is_wide: bool,
    /// Bits of [`status`].
    pub status: u8,
    /// Position of each axis [m] or [rad].
    pub position: [f64; MAX_AXES],
}

/// The properties that a device reports, with the numbers of [`Spec`](crate::safety::contract::Spec); NaN: unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceInfo {
    /// Number of the request.
    pub seq: u16,
    /// Number of axes.
    pub axis_count: usize,
    /// Bits of [`trait_flag`].
    pub trait_flags: u8,
    /// Continuous and peak force, position step, least and greatest position, rate, inertia, damping.
    pub spec_values: [f32; 8],
}

/// CRC-16/CCITT-FALSE.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ (u16::from(byte) << 8), |crc, _| {
            (crc << 1) ^ (if crc & 0x8000 != 0 { 0x1021 } else { 0 })
        })
    })
}

/// A frame that is being written.
struct FrameBytes<'a> {
    bytes: &'a mut [u8; FRAME_BYTES_MAX],
    n_bytes: usize,
}

impl FrameBytes<'_> {
    fn append(&mut self, bytes: &[u8]) {
        self.bytes[self.n_bytes..self.n_bytes + bytes.len()].copy_from_slice(bytes);
        self.n_bytes += bytes.len();
    }

    fn append_crc(mut self) -> usize {
        let crc = crc(&self.bytes[2..self.n_bytes]);
        self.append(&crc.to_le_bytes());
        self.n_bytes
    }
}

fn count_byte(axis_count: usize, is_wide: bool) -> u8 {
    axis_count as u8 | if is_wide { WIDE_FLAG } else { 0 }
}

/// A force in steps of a narrow frame, for a greatest force of `force_max` [N]. `as` saturates, and makes a NaN 0.
fn force_steps(force: f64, force_max: f64) -> i16 {
    ((force / force_max * FORCE_STEPS).round() as i16).max(-i16::MAX)
}

/// A force [N] as rounded by a narrow frame.
pub fn rounded_force(force: f64, force_max: f64) -> f64 {
    f64::from(force_steps(force, force_max)) * (force_max / FORCE_STEPS)
}

impl FrameRequest {
    /// Write the bytes, for a greatest force of `force_max` [N]; returns their number.
    pub fn write(&self, force_max: f64, bytes: &mut [u8; FRAME_BYTES_MAX]) -> usize {
        let mut request_frame = FrameBytes { bytes, n_bytes: 0 };
        request_frame.append(&SYNC);
        request_frame.append(&self.seq.to_le_bytes());
        request_frame.append(&[count_byte(self.axis_count, self.is_wide)]);
        for force in &self.force[..self.axis_count] {
            if self.is_wide {
                request_frame.append(&force.to_le_bytes());
            } else {
                request_frame.append(&force_steps(*force, force_max).to_le_bytes());
            }
        }
        request_frame.append(&[self.flags]);
        request_frame.append_crc()
    }

    /// Parse a request at the beginning of some bytes.
    pub fn parse(bytes: &[u8], force_max: f64) -> Parsed<Self> {
        parse_frame(bytes, SYNC, 2, 1, [2, 8], |body, n, wide| {
            let mut force = [0.0; MAX_AXES];
            for (axis, force) in force[..n].iter_mut().enumerate() {
                *force = if wide {
                    f64::from_le_bytes(bytes_at(body, 3 + 8 * axis))
                } else {
                    f64::from(i16::from_le_bytes(bytes_at(body, 3 + 2 * axis))) * (force_max / FORCE_STEPS)
                };
            }
            let are_finite = force.iter().all(|force| force.is_finite());
            are_finite.then(|| Self {
                seq: u16::from_le_bytes(bytes_at(body, 0)),
                axis_count: n,
                is_wide: wide,
                flags: body[body.len() - 1],
                force,
            })
        })
    }
}

impl FrameReply {
    /// Write the bytes; returns their number.
    pub fn write(&self, bytes: &mut [u8; FRAME_BYTES_MAX]) -> usize {
        let mut reply_frame = FrameBytes { bytes, n_bytes: 0 };
        reply_frame.append(&SYNC);
        reply_frame.append(&self.seq.to_le_bytes());
        reply_frame.append(&self.clock_us.to_le_bytes());
        reply_frame.append(&[count_byte(self.axis_count, self.is_wide)]);
        for position in &self.position[..self.axis_count] {
            if self.is_wide {
                reply_frame.append(&position.to_le_bytes());
            } else {
                reply_frame.append(&((position / POSITION_STEP).round() as i32).to_le_bytes());
            }
        }
        reply_frame.append(&[self.status]);
        reply_frame.append_crc()
    }

    /// Parse a reply at the beginning of some bytes.
    pub fn parse(bytes: &[u8]) -> Parsed<Self> {
        parse_frame(bytes, SYNC, 6, 1, [4, 8], |body, n, wide| {
            let mut position = [0.0; MAX_AXES];
            for (axis, position) in position[..n].iter_mut().enumerate() {
                *position = if wide {
                    f64::from_le_bytes(bytes_at(body, 7 + 8 * axis))
                } else {
                    f64::from(i32::from_le_bytes(bytes_at(body, 7 + 4 * axis))) * POSITION_STEP
                };
            }
            let are_finite = position.iter().all(|position| position.is_finite());
            are_finite.then(|| Self {
                seq: u16::from_le_bytes(bytes_at(body, 0)),
                clock_us: u32::from_le_bytes(bytes_at(body, 2)),
                axis_count: n,
                is_wide: wide,
                status: body[body.len() - 1],
                position,
            })
        })
    }
}

impl DeviceInfo {
    /// Write the bytes; returns their number.
    pub fn write(&self, bytes: &mut [u8; FRAME_BYTES_MAX]) -> usize {
        let mut info_frame = FrameBytes { bytes, n_bytes: 0 };
        info_frame.append(&SYNC_INFO);
        info_frame.append(&self.seq.to_le_bytes());
        info_frame.append(&[self.axis_count as u8, self.trait_flags]);
        for number in self.spec_values {
            info_frame.append(&number.to_le_bytes());
        }
        info_frame.append_crc()
    }

    /// Parse an answer with the properties at the beginning of some bytes.
    pub fn parse(bytes: &[u8]) -> Parsed<Self> {
        parse_frame(bytes, SYNC_INFO, 2, 33, [0, 0], |body, n, _| {
            let mut numbers = [0.0; 8];
            for (i, number) in numbers.iter_mut().enumerate() {
                *number = f32::from_le_bytes(bytes_at(body, 4 + 4 * i));
            }
            (n > 0).then(|| Self {
                seq: u16::from_le_bytes(bytes_at(body, 0)),
                axis_count: n,
                trait_flags: body[3],
                spec_values: numbers,
            })
        })
    }
}

/// Parse a frame: `bytes_before` bytes between the sync bytes and the count of axes, then each axis (of one of
/// `axis_sizes`: narrow, wide), then `bytes_after` bytes, then the CRC. `read_body` gets all bytes between sync and
/// CRC, and returns `None` for values that no valid frame has.
fn parse_frame<T>(
    bytes: &[u8],
    sync: [u8; 2],
    bytes_before: usize,
    bytes_after: usize,
    axis_sizes: [usize; 2],
    read_body: impl Fn(&[u8], usize, bool) -> Option<T>,
) -> Parsed<T> {
    match bytes {
        [first, second, ..] if [*first, *second] == sync => {}
        [first] if *first == sync[0] => return Parsed::Incomplete,
        [] => return Parsed::Incomplete,
        _ => {
            let next_sync = bytes[1..].iter().position(|&byte| byte == sync[0]);
            return Parsed::Skip(next_sync.map_or(bytes.len(), |next_sync| next_sync + 1));
        }
    }
    let Some(&count_byte) = bytes.get(2 + bytes_before) else {
        return Parsed::Incomplete;
    };
    let (axis_count, is_wide) = (usize::from(count_byte & !WIDE_FLAG), count_byte & WIDE_FLAG != 0);
    if axis_count > MAX_AXES {
        return Parsed::Skip(2);
    }
    let crc_offset = 2 + bytes_before + 1 + axis_count * axis_sizes[usize::from(is_wide)] + bytes_after;
    let Some(crc_bytes) = bytes.get(crc_offset..crc_offset + 2) else {
        return Parsed::Incomplete;
    };
    let body_bytes = &bytes[2..crc_offset];
    if crc(body_bytes).to_le_bytes() != crc_bytes {
        // Only the sync bytes are skipped: a valid frame may begin inside the bytes after them.
        return Parsed::Skip(2);
    }
    read_body(body_bytes, axis_count, is_wide).map_or(Parsed::Skip(crc_offset + 2), |frame| {
        Parsed::Packet(frame, crc_offset + 2)
    })
}

fn bytes_at<const N: usize>(bytes: &[u8], offset: usize) -> [u8; N] {
    let mut fixed_bytes = [0; N];
    fixed_bytes.copy_from_slice(&bytes[offset..offset + N]);
    fixed_bytes
}
