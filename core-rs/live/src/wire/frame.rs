//! The open frame (docs/open-frame.md): little-endian, `A5 5A` first, a CRC last.
//!
//! host → device `A5 5A seq:u16 n:u8 n×force flags:u8 crc:u16`,
//! device → host `A5 5A seq:u16 t_us:u32 n:u8 n×position status:u8 crc:u16`.
//! A force is an i16 of 1/32767 of the greatest, a position an i32 of 10 nm (or 10 nrad); with bit 7 of n set both
//! are f64 in SI units. A request without axes asks who is there; its answer begins with `A5 5D`.

use super::Parsed;
use crate::wire::MAX_AXES;

const SYNC: [u8; 2] = [0xA5, 0x5A];
const SYNC_WHO: [u8; 2] = [0xA5, 0x5D];
/// A position's step in a narrow frame [m or rad].
pub const POS_LSB: f64 = 1e-8;
/// Steps of a force in a narrow frame.
pub const FORCE_STEPS: f64 = 32767.0;
const WIDE: u8 = 0x80;
/// Longest frame.
pub const LONGEST: usize = 12 + 8 * MAX_AXES;

/// Bits of a request's flags.
pub mod flag {
    /// Motors may push.
    pub const ENABLE: u8 = 1;
    /// Say where you are, keep the forces, and in lockstep take no step.
    pub const ASK: u8 = 2;
}

/// Bits of a reply's status.
pub mod status {
    /// A finger is on it.
    pub const TOUCHED: u8 = 1;
    /// Motors push.
    pub const ENABLED: u8 = 2;
    /// It is hot and pushes less.
    pub const HOT: u8 = 4;
    /// It had heard nothing for too long and let go.
    pub const LET_GO: u8 = 8;
}

/// Forces for a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Request {
    /// Its number, echoed.
    pub seq: u16,
    /// How many axes; none asks who is there.
    pub n: usize,
    /// Whether forces and positions travel whole.
    pub wide: bool,
    /// Bits of [`flag`].
    pub flags: u8,
    /// [N] or [N·m]
    pub force: [f64; MAX_AXES],
}

/// Positions of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reply {
    /// The request's number.
    pub seq: u16,
    /// The device's clock [µs].
    pub t_us: u32,
    /// How many axes.
    pub n: usize,
    /// Whether positions travel whole.
    pub wide: bool,
    /// Bits of [`status`].
    pub status: u8,
    /// [m] or [rad]
    pub position: [f64; MAX_AXES],
}

/// What a device tells of itself. Numbers are those of [`Spec`](crate::safety::contract::Spec); NaN: unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceInfo {
    /// The request's number.
    pub seq: u16,
    /// How many axes.
    pub n: usize,
    /// Bit 0 radians, 1 touch-gated, 2 lockstep, 3 wide.
    pub traits: u8,
    /// Continuous and peak force, position step, least and greatest position, rate, inertia, damping.
    pub numbers: [f32; 8],
}

/// CRC-16/CCITT-FALSE.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ (u16::from(byte) << 8), |crc, _| {
            (crc << 1) ^ (if crc & 0x8000 != 0 { 0x1021 } else { 0 })
        })
    })
}

/// A frame in the making.
struct Frame<'a> {
    bytes: &'a mut [u8; LONGEST],
    len: usize,
}

impl Frame<'_> {
    fn put(&mut self, bytes: &[u8]) {
        self.bytes[self.len..self.len + bytes.len()].copy_from_slice(bytes);
        self.len += bytes.len();
    }

    fn close(mut self) -> usize {
        let crc = crc(&self.bytes[2..self.len]);
        self.put(&crc.to_le_bytes());
        self.len
    }
}

fn count(n: usize, wide: bool) -> u8 {
    n as u8 | if wide { WIDE } else { 0 }
}

/// A force in steps of a narrow frame, `full` [N] being all of it. `as` saturates, and makes a NaN 0.
fn steps(force: f64, full: f64) -> i16 {
    ((force / full * FORCE_STEPS).round() as i16).max(-i16::MAX)
}

/// The force [N] that a narrow frame carries for a force [N].
pub fn carried(force: f64, full: f64) -> f64 {
    f64::from(steps(force, full)) * (full / FORCE_STEPS)
}

impl Request {
    /// Write the bytes, a force of `full` [N] being all of it; returns how many.
    pub fn write(&self, full: f64, bytes: &mut [u8; LONGEST]) -> usize {
        let mut frame = Frame { bytes, len: 0 };
        frame.put(&SYNC);
        frame.put(&self.seq.to_le_bytes());
        frame.put(&[count(self.n, self.wide)]);
        for force in &self.force[..self.n] {
            if self.wide {
                frame.put(&force.to_le_bytes());
            } else {
                frame.put(&steps(*force, full).to_le_bytes());
            }
        }
        frame.put(&[self.flags]);
        frame.close()
    }

    /// A request at the beginning of some bytes.
    pub fn parse(bytes: &[u8], full: f64) -> Parsed<Self> {
        body(bytes, SYNC, 2, 1, [2, 8], |body, n, wide| {
            let mut force = [0.0; MAX_AXES];
            for (axis, force) in force[..n].iter_mut().enumerate() {
                *force = if wide {
                    f64::from_le_bytes(array(body, 3 + 8 * axis))
                } else {
                    f64::from(i16::from_le_bytes(array(body, 3 + 2 * axis))) * (full / FORCE_STEPS)
                };
            }
            let finite = force.iter().all(|force| force.is_finite());
            finite.then(|| Self {
                seq: u16::from_le_bytes(array(body, 0)),
                n,
                wide,
                flags: body[body.len() - 1],
                force,
            })
        })
    }
}

impl Reply {
    /// Write the bytes; returns how many.
    pub fn write(&self, bytes: &mut [u8; LONGEST]) -> usize {
        let mut frame = Frame { bytes, len: 0 };
        frame.put(&SYNC);
        frame.put(&self.seq.to_le_bytes());
        frame.put(&self.t_us.to_le_bytes());
        frame.put(&[count(self.n, self.wide)]);
        for position in &self.position[..self.n] {
            if self.wide {
                frame.put(&position.to_le_bytes());
            } else {
                frame.put(&((position / POS_LSB).round() as i32).to_le_bytes());
            }
        }
        frame.put(&[self.status]);
        frame.close()
    }

    /// A reply at the beginning of some bytes.
    pub fn parse(bytes: &[u8]) -> Parsed<Self> {
        body(bytes, SYNC, 6, 1, [4, 8], |body, n, wide| {
            let mut position = [0.0; MAX_AXES];
            for (axis, position) in position[..n].iter_mut().enumerate() {
                *position = if wide {
                    f64::from_le_bytes(array(body, 7 + 8 * axis))
                } else {
                    f64::from(i32::from_le_bytes(array(body, 7 + 4 * axis))) * POS_LSB
                };
            }
            let finite = position.iter().all(|position| position.is_finite());
            finite.then(|| Self {
                seq: u16::from_le_bytes(array(body, 0)),
                t_us: u32::from_le_bytes(array(body, 2)),
                n,
                wide,
                status: body[body.len() - 1],
                position,
            })
        })
    }
}

impl DeviceInfo {
    /// Write the bytes; returns how many.
    pub fn write(&self, bytes: &mut [u8; LONGEST]) -> usize {
        let mut frame = Frame { bytes, len: 0 };
        frame.put(&SYNC_WHO);
        frame.put(&self.seq.to_le_bytes());
        frame.put(&[self.n as u8, self.traits]);
        for number in self.numbers {
            frame.put(&number.to_le_bytes());
        }
        frame.close()
    }

    /// Such an answer at the beginning of some bytes.
    pub fn parse(bytes: &[u8]) -> Parsed<Self> {
        body(bytes, SYNC_WHO, 2, 33, [0, 0], |body, n, _| {
            let mut numbers = [0.0; 8];
            for (i, number) in numbers.iter_mut().enumerate() {
                *number = f32::from_le_bytes(array(body, 4 + 4 * i));
            }
            (n > 0).then(|| Self {
                seq: u16::from_le_bytes(array(body, 0)),
                n,
                traits: body[3],
                numbers,
            })
        })
    }
}

/// A frame's bytes between its first two and its CRC: `before` the count of axes, then each axis (its size narrow or
/// wide), then `after`. `read` refuses by `None` what a sound frame never holds.
fn body<T>(
    bytes: &[u8],
    sync: [u8; 2],
    before: usize,
    after: usize,
    size: [usize; 2],
    read: impl Fn(&[u8], usize, bool) -> Option<T>,
) -> Parsed<T> {
    match bytes {
        [first, second, ..] if [*first, *second] == sync => {}
        [first] if *first == sync[0] => return Parsed::Incomplete,
        [] => return Parsed::Incomplete,
        _ => {
            let next = bytes[1..].iter().position(|&byte| byte == sync[0]);
            return Parsed::Garbage(next.map_or(bytes.len(), |next| next + 1));
        }
    }
    let Some(&count) = bytes.get(2 + before) else {
        return Parsed::Incomplete;
    };
    let (n, wide) = (usize::from(count & !WIDE), count & WIDE != 0);
    if n > MAX_AXES {
        return Parsed::Garbage(2);
    }
    let end = 2 + before + 1 + n * size[usize::from(wide)] + after;
    let Some(sum) = bytes.get(end..end + 2) else {
        return Parsed::Incomplete;
    };
    let inside = &bytes[2..end];
    if crc(inside).to_le_bytes() != sum {
        // Not all of it: a true frame may begin inside what was taken for one.
        return Parsed::Garbage(2);
    }
    read(inside, n, wide).map_or(Parsed::Garbage(end + 2), |frame| {
        Parsed::Packet(frame, end + 2)
    })
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&bytes[at..at + N]);
    array
}
