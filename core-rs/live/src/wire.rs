//! The bytes of each protocol: pure functions, in both directions, for the host and for the emulators.

pub mod firefader;
pub mod frame;
pub mod haply;

/// Greatest number of axes of a device.
pub const MAX_AXES: usize = 16;

/// The result of parsing the beginning of some bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parsed<T> {
    /// A whole packet, and its length.
    Packet(T, usize),
    /// The beginning of a packet.
    Incomplete,
    /// The number of bytes (at least one) that do not belong to a packet.
    Skip(usize),
}

/// Received bytes that are not a whole packet yet. N is at least the length of the longest packet.
#[derive(Clone, Debug)]
pub(crate) struct PacketBuffer<const N: usize> {
    bytes: [u8; N],
    len: usize,
    /// Number of bytes that did not belong to a packet.
    pub(crate) garbage_bytes: u64,
}

impl<const N: usize> PacketBuffer<N> {
    pub(crate) fn empty() -> Self {
        Self {
            bytes: [0; N],
            len: 0,
            garbage_bytes: 0,
        }
    }

    /// Take bytes, and pass every whole packet to `take_packet`; other bytes are skipped.
    pub(crate) fn add_bytes<T>(
        &mut self,
        mut received_bytes: &[u8],
        parse: impl Fn(&[u8]) -> Parsed<T>,
        mut take_packet: impl FnMut(T),
    ) {
        while !received_bytes.is_empty() {
            let n_copied = received_bytes.len().min(N - self.len);
            self.bytes[self.len..self.len + n_copied].copy_from_slice(&received_bytes[..n_copied]);
            self.len += n_copied;
            received_bytes = &received_bytes[n_copied..];
            let mut packet_offset = 0;
            while packet_offset < self.len {
                match parse(&self.bytes[packet_offset..self.len]) {
                    Parsed::Packet(packet, len) => {
                        take_packet(packet);
                        packet_offset += len;
                    }
                    Parsed::Skip(len) => {
                        self.garbage_bytes += len as u64;
                        packet_offset += len;
                    }
                    // A packet that fills the buffer and is still incomplete is not a packet.
                    Parsed::Incomplete if self.len - packet_offset == N => {
                        self.garbage_bytes += 1;
                        packet_offset += 1;
                    }
                    Parsed::Incomplete => break,
                }
            }
            self.bytes.copy_within(packet_offset..self.len, 0);
            self.len -= packet_offset;
        }
    }
}

#[cfg(test)]
mod tests;
