//! Bytes of each protocol: pure functions, both directions, for the host and for the emulators.

pub mod firefader;
pub mod frame;
pub mod haply;

/// Axes that one device has at most.
pub const MAX_AXES: usize = 16;

/// What stands at the beginning of some bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parsed<T> {
    /// A whole packet, and how long it is.
    Packet(T, usize),
    /// The beginning of one.
    Incomplete,
    /// So many bytes (at least one) that belong to none.
    Garbage(usize),
}

/// Bytes that have come and make no packet yet. N is at least the longest packet.
#[derive(Clone, Debug)]
pub(crate) struct Inbox<const N: usize> {
    bytes: [u8; N],
    len: usize,
    /// Bytes that belonged to no packet.
    pub(crate) garbage: u64,
}

impl<const N: usize> Inbox<N> {
    pub(crate) fn new() -> Self {
        Self {
            bytes: [0; N],
            len: 0,
            garbage: 0,
        }
    }

    /// Take bytes and hand on every packet that is whole; whatever came before it is passed over.
    pub(crate) fn feed<T>(
        &mut self,
        mut new: &[u8],
        parse: impl Fn(&[u8]) -> Parsed<T>,
        mut each: impl FnMut(T),
    ) {
        while !new.is_empty() {
            let n = new.len().min(N - self.len);
            self.bytes[self.len..self.len + n].copy_from_slice(&new[..n]);
            self.len += n;
            new = &new[n..];
            let mut at = 0;
            while at < self.len {
                match parse(&self.bytes[at..self.len]) {
                    Parsed::Packet(packet, len) => {
                        each(packet);
                        at += len;
                    }
                    Parsed::Garbage(len) => {
                        self.garbage += len as u64;
                        at += len;
                    }
                    // A packet that fills the room and is not whole is none.
                    Parsed::Incomplete if self.len - at == N => {
                        self.garbage += 1;
                        at += 1;
                    }
                    Parsed::Incomplete => break,
                }
            }
            self.bytes.copy_within(at..self.len, 0);
            self.len -= at;
        }
    }
}

#[cfg(test)]
mod tests;
