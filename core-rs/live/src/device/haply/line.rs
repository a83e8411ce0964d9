//! The line between a host and its guardian: messages of fixed length over a local stream.

use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use crate::device::Gone;

#[cfg(unix)]
pub(super) type Stream = std::os::unix::net::UnixStream;
#[cfg(not(unix))]
pub(super) type Stream = std::net::TcpStream;

/// Length of an order and of a reply [bytes].
pub(super) const LEN: usize = 32;
/// Messages that are read at once.
const BATCH: usize = 64;
/// Longest text at the beginning of the connection [bytes].
const TEXT: usize = 4096;
/// Time between two checks of a stream, on systems without poll(2).
#[cfg(not(unix))]
const POLL: Duration = Duration::from_micros(200);

pub(super) type Bytes = [u8; LEN];

/// A message to the guardian: the force of all axes [N].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ForceCommand {
    pub(crate) number: u16,
    pub(crate) force: [f64; 3],
}

/// A message from the guardian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum GuardianReply {
    /// A state that the service reported.
    State {
        /// Number of the latest order that was passed on before it.
        number: u16,
        /// [m]
        position: [f64; 3],
        /// Whether the guardian had set the force to zero by itself.
        let_go: bool,
    },
    /// The service is gone; no more states will come.
    Gone(Gone),
}

/// Kinds of a reply.
const STATE: u8 = 0;
const CLOSED: u8 = 1;
const SILENT: u8 = 2;
const SYSTEM: u8 = 3;
const SHARED: u8 = 4;

impl ForceCommand {
    pub(super) fn bytes(&self) -> Bytes {
        pack(self.number, 0, false, 0, self.force)
    }

    pub(super) fn parse(bytes: &Bytes) -> Self {
        Self {
            number: number(bytes),
            force: vector(bytes),
        }
    }

    pub(super) fn is_zero(&self) -> bool {
        self.force == [0.0; 3]
    }
}

impl GuardianReply {
    pub(super) fn bytes(&self) -> Bytes {
        let gone = |kind, error| pack(0, kind, false, error, [0.0; 3]);
        match *self {
            Self::State {
                number,
                position,
                let_go,
            } => pack(number, STATE, let_go, 0, position),
            Self::Gone(Gone::Closed) => gone(CLOSED, 0),
            Self::Gone(Gone::Silent) => gone(SILENT, 0),
            Self::Gone(Gone::Shared) => gone(SHARED, 0),
            Self::Gone(Gone::System(error)) => gone(SYSTEM, error),
        }
    }

    pub(super) fn parse(bytes: &Bytes) -> Self {
        match bytes[2] {
            STATE => Self::State {
                number: number(bytes),
                position: vector(bytes),
                let_go: bytes[3] != 0,
            },
            SILENT => Self::Gone(Gone::Silent),
            SHARED => Self::Gone(Gone::Shared),
            SYSTEM => Self::Gone(Gone::System(i32::from_le_bytes(part(bytes, 4)))),
            _ => Self::Gone(Gone::Closed),
        }
    }
}

/// Number (2 bytes), kind, flag, error (4 bytes), three f64; all little-endian.
fn pack(number: u16, kind: u8, flag: bool, error: i32, vector: [f64; 3]) -> Bytes {
    let mut bytes = [0; LEN];
    bytes[..2].copy_from_slice(&number.to_le_bytes());
    (bytes[2], bytes[3]) = (kind, u8::from(flag));
    bytes[4..8].copy_from_slice(&error.to_le_bytes());
    for (place, number) in bytes[8..].chunks_exact_mut(8).zip(vector) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    bytes
}

fn part<const N: usize>(bytes: &Bytes, at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[at + i])
}

fn number(bytes: &Bytes) -> u16 {
    u16::from_le_bytes(part(bytes, 0))
}

fn vector(bytes: &Bytes) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from_le_bytes(part(bytes, 8 + 8 * axis)))
}

/// One end of the line. Neither `put` nor `take` blocks or allocates.
pub(super) struct Line {
    stream: Stream,
    bytes: [u8; LEN * BATCH],
    len: usize,
}

impl Line {
    pub(super) fn new(stream: Stream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self {
            stream,
            bytes: [0; LEN * BATCH],
            len: 0,
        })
    }

    /// Send a message. It is dropped if the stream is full: then the other end is stopped and does not read.
    pub(super) fn put(&mut self, message: &Bytes) -> Result<(), Gone> {
        match self.stream.write(message) {
            Ok(LEN) => Ok(()),
            // Only part of the message was written: the following messages would be read wrongly.
            Ok(_) => Err(Gone::Closed),
            Err(error) => is_quiet(&error).then_some(()).ok_or(Gone::Closed),
        }
    }

    /// Hand all messages that are there to `each`; fails once the other end is gone and all its messages are read.
    pub(super) fn take(&mut self, mut each: impl FnMut(&Bytes)) -> Result<(), Gone> {
        loop {
            let got = match self.stream.read(&mut self.bytes[self.len..]) {
                Ok(0) => return Err(Gone::Closed),
                Ok(got) => got,
                Err(error) if is_quiet(&error) => return Ok(()),
                Err(_) => return Err(Gone::Closed),
            };
            self.len += got;
            let (messages, rest) = self.bytes[..self.len].as_chunks::<LEN>();
            messages.iter().for_each(&mut each);
            let (from, left) = (self.len - rest.len(), rest.len());
            self.bytes.copy_within(from..self.len, 0);
            self.len = left;
            if from + left < self.bytes.len() {
                return Ok(());
            }
        }
    }

    /// Wait until there is something to read here.
    pub(super) fn wait(&self, until: Instant) {
        wait([&self.stream], until);
    }

    pub(super) fn stream(&self) -> &Stream {
        &self.stream
    }
}

pub(super) fn is_quiet(error: &io::Error) -> bool {
    use ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

/// A stream that `wait` can wait for.
#[cfg(unix)]
pub(super) trait Waitable: std::os::fd::AsRawFd {}
#[cfg(unix)]
impl<T: std::os::fd::AsRawFd> Waitable for T {}
#[cfg(not(unix))]
pub(super) trait Waitable {}
#[cfg(not(unix))]
impl<T> Waitable for T {}

/// Wait until one of the streams can be read, or until `until`.
pub(super) fn wait<const N: usize>(streams: [&dyn Waitable; N], until: Instant) {
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return;
    }
    #[cfg(unix)]
    crate::device::port::unix::poll(streams.map(|stream| stream.as_raw_fd()), left);
    #[cfg(not(unix))]
    {
        let _ = streams;
        std::thread::sleep(left.min(POLL));
    }
}

/// Send a text over a blocking stream.
pub(super) fn put_text(stream: &mut Stream, text: &str) -> io::Result<()> {
    let len = text.len().min(TEXT);
    let mut bytes = (len as u32).to_le_bytes().to_vec();
    bytes.extend(&text.as_bytes()[..len]);
    stream.write_all(&bytes)
}

/// Read a text from a blocking stream, for at most `patience`.
pub(super) fn take_text(stream: &mut Stream, patience: Duration) -> io::Result<String> {
    let until = Instant::now() + patience;
    let mut len = [0; 4];
    fill(stream, &mut len, until)?;
    let len = u32::from_le_bytes(len) as usize;
    if len > TEXT {
        return Err(ErrorKind::InvalidData.into());
    }
    let mut bytes = vec![0; len];
    fill(stream, &mut bytes, until)?;
    String::from_utf8(bytes).map_err(|_| ErrorKind::InvalidData.into())
}

fn fill(stream: &mut Stream, mut bytes: &mut [u8], until: Instant) -> io::Result<()> {
    while !bytes.is_empty() {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(bytes) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(got) => bytes = &mut bytes[got..],
            Err(error) if is_quiet(&error) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_parse_to_the_same_bits() {
        let order = ForceCommand {
            number: 0xABCD,
            force: [0.1, -0.0, f64::MIN_POSITIVE],
        };
        let back = ForceCommand::parse(&order.bytes());
        assert_eq!(back.number, order.number);
        assert_eq!(back.force.map(f64::to_bits), order.force.map(f64::to_bits));
        for answer in [
            GuardianReply::State {
                number: 7,
                position: [0.1, 0.2, -0.3],
                let_go: true,
            },
            GuardianReply::Gone(Gone::Closed),
            GuardianReply::Gone(Gone::Silent),
            GuardianReply::Gone(Gone::Shared),
            GuardianReply::Gone(Gone::System(-32)),
        ] {
            assert_eq!(GuardianReply::parse(&answer.bytes()), answer);
        }
    }

    #[cfg(unix)]
    #[test]
    fn line_finds_messages_in_any_pieces() {
        let (mut from, to) = Stream::pair().unwrap();
        let mut line = Line::new(to).unwrap();
        let order = |number| ForceCommand {
            number,
            force: [f64::from(number); 3],
        };
        let sent: Vec<u8> = (0..300).flat_map(|number| order(number).bytes()).collect();
        let mut commands = Vec::new();
        for piece in sent.chunks(37) {
            from.write_all(piece).unwrap();
            line.take(|bytes| commands.push(ForceCommand::parse(bytes)))
                .unwrap();
        }
        assert_eq!(commands, (0..300).map(order).collect::<Vec<_>>());
        // Everything at once, more than one batch, followed by the end of the stream.
        from.write_all(&sent).unwrap();
        drop(from);
        let mut n = 0;
        while line.take(|_| n += 1).is_ok() {}
        assert_eq!(n, 300);
    }

    #[cfg(unix)]
    #[test]
    fn take_text_with_wrong_length_is_refused() {
        let (mut from, mut to) = Stream::pair().unwrap();
        put_text(&mut from, "ws://127.0.0.1").unwrap();
        let patience = Duration::from_secs(10);
        assert_eq!(take_text(&mut to, patience).unwrap(), "ws://127.0.0.1");
        from.write_all(&[0xFF; 8]).unwrap();
        assert!(take_text(&mut to, patience).is_err(), "four gigabytes");
        drop(from);
        assert!(take_text(&mut to, patience).is_err());
    }
}
