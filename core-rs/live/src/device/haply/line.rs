//! The line between a host and its guardian: messages of fixed length over a local stream.

use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use crate::device::DeviceLoss;

#[cfg(unix)]
pub(super) type LineStream = std::os::unix::net::UnixStream;
#[cfg(not(unix))]
pub(super) type LineStream = std::net::TcpStream;

/// Length of an order and of a reply [bytes].
pub(super) const MESSAGE_BYTES: usize = 32;
/// Messages that are read at once.
const BATCH_MESSAGES: usize = 64;
/// Longest text at the beginning of the connection [bytes].
const TEXT_BYTES_MAX: usize = 4096;
/// Time between two checks of a stream, on systems without poll(2).
#[cfg(not(unix))]
const POLL_INTERVAL: Duration = Duration::from_micros(200);

pub(super) type MessageBytes = [u8; MESSAGE_BYTES];

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
    Gone(DeviceLoss),
}

/// Kinds of a reply.
const STATE: u8 = 0;
const CLOSED: u8 = 1;
const SILENT: u8 = 2;
const SYSTEM: u8 = 3;
const SHARED: u8 = 4;

impl ForceCommand {
    pub(super) fn bytes(&self) -> MessageBytes {
        pack_message(self.number, 0, false, 0, self.force)
    }

    pub(super) fn parse(bytes: &MessageBytes) -> Self {
        Self {
            number: read_number(bytes),
            force: read_vector(bytes),
        }
    }

    pub(super) fn is_zero(&self) -> bool {
        self.force == [0.0; 3]
    }
}

impl GuardianReply {
    pub(super) fn bytes(&self) -> MessageBytes {
        let gone_bytes = |kind, error| pack_message(0, kind, false, error, [0.0; 3]);
        match *self {
            Self::State {
                number,
                position,
                let_go,
            } => pack_message(number, STATE, let_go, 0, position),
            Self::Gone(DeviceLoss::Closed) => gone_bytes(CLOSED, 0),
            Self::Gone(DeviceLoss::Silent) => gone_bytes(SILENT, 0),
            Self::Gone(DeviceLoss::Shared) => gone_bytes(SHARED, 0),
            Self::Gone(DeviceLoss::System(error)) => gone_bytes(SYSTEM, error),
        }
    }

    pub(super) fn parse(bytes: &MessageBytes) -> Self {
        match bytes[2] {
            STATE => Self::State {
                number: read_number(bytes),
                position: read_vector(bytes),
                let_go: bytes[3] != 0,
            },
            SILENT => Self::Gone(DeviceLoss::Silent),
            SHARED => Self::Gone(DeviceLoss::Shared),
            SYSTEM => Self::Gone(DeviceLoss::System(i32::from_le_bytes(message_part(bytes, 4)))),
            _ => Self::Gone(DeviceLoss::Closed),
        }
    }
}

/// Number (2 bytes), kind, flag, error (4 bytes), three f64; all little-endian.
fn pack_message(number: u16, kind: u8, flag: bool, error: i32, vector: [f64; 3]) -> MessageBytes {
    let mut packed_bytes = [0; MESSAGE_BYTES];
    packed_bytes[..2].copy_from_slice(&number.to_le_bytes());
    (packed_bytes[2], packed_bytes[3]) = (kind, u8::from(flag));
    packed_bytes[4..8].copy_from_slice(&error.to_le_bytes());
    for (byte_slice, number) in packed_bytes[8..].chunks_exact_mut(8).zip(vector) {
        byte_slice.copy_from_slice(&number.to_le_bytes());
    }
    packed_bytes
}

fn message_part<const N: usize>(bytes: &MessageBytes, offset: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[offset + i])
}

fn read_number(bytes: &MessageBytes) -> u16 {
    u16::from_le_bytes(message_part(bytes, 0))
}

fn read_vector(bytes: &MessageBytes) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from_le_bytes(message_part(bytes, 8 + 8 * axis)))
}

/// One end of the line. Neither `send` nor `receive` blocks or allocates.
pub(super) struct GuardianLine {
    stream: LineStream,
    bytes: [u8; MESSAGE_BYTES * BATCH_MESSAGES],
    filled_bytes: usize,
}

impl GuardianLine {
    pub(super) fn new(stream: LineStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self {
            stream,
            bytes: [0; MESSAGE_BYTES * BATCH_MESSAGES],
            filled_bytes: 0,
        })
    }

    /// Send a message. It is dropped if the stream is full: then the other end is stopped and does not read.
    pub(super) fn send(&mut self, message: &MessageBytes) -> Result<(), DeviceLoss> {
        match self.stream.write(message) {
            Ok(MESSAGE_BYTES) => Ok(()),
            // Only part of the message was written: the following messages would be read wrongly.
            Ok(_) => Err(DeviceLoss::Closed),
            Err(error) => is_transient(&error).then_some(()).ok_or(DeviceLoss::Closed),
        }
    }

    /// Hand all messages that are there to `visit`; fails once the other end is gone and all its messages are read.
    pub(super) fn receive(&mut self, mut visit: impl FnMut(&MessageBytes)) -> Result<(), DeviceLoss> {
        loop {
            let bytes_read = match self.stream.read(&mut self.bytes[self.filled_bytes..]) {
                Ok(0) => return Err(DeviceLoss::Closed),
                Ok(bytes_read) => bytes_read,
                Err(error) if is_transient(&error) => return Ok(()),
                Err(_) => return Err(DeviceLoss::Closed),
            };
            self.filled_bytes += bytes_read;
            let (messages, partial_bytes) = self.bytes[..self.filled_bytes].as_chunks::<MESSAGE_BYTES>();
            messages.iter().for_each(&mut visit);
            let (partial_start, partial_length) = (self.filled_bytes - partial_bytes.len(), partial_bytes.len());
            self.bytes.copy_within(partial_start..self.filled_bytes, 0);
            self.filled_bytes = partial_length;
            if partial_start + partial_length < self.bytes.len() {
                return Ok(());
            }
        }
    }

    /// Wait until there is something to read here.
    pub(super) fn wait(&self, deadline: Instant) {
        wait([&self.stream], deadline);
    }

    pub(super) fn stream(&self) -> &LineStream {
        &self.stream
    }
}

pub(super) fn is_transient(error: &io::Error) -> bool {
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

/// Wait until one of the streams can be read, or until `deadline`.
pub(super) fn wait<const N: usize>(streams: [&dyn Waitable; N], deadline: Instant) {
    let time_left = deadline.saturating_duration_since(Instant::now());
    if time_left.is_zero() {
        return;
    }
    #[cfg(unix)]
    crate::device::port::unix::poll(streams.map(|stream| stream.as_raw_fd()), time_left);
    #[cfg(not(unix))]
    {
        let _ = streams;
        std::thread::sleep(time_left.min(POLL_INTERVAL));
    }
}

/// Send a text over a blocking stream.
pub(super) fn write_text(stream: &mut LineStream, text: &str) -> io::Result<()> {
    let text_length = text.len().min(TEXT_BYTES_MAX);
    let mut framed_text = (text_length as u32).to_le_bytes().to_vec();
    framed_text.extend(&text.as_bytes()[..text_length]);
    stream.write_all(&framed_text)
}

/// Read a text from a blocking stream, for at most `timeout`.
pub(super) fn read_text(stream: &mut LineStream, timeout: Duration) -> io::Result<String> {
    let deadline = Instant::now() + timeout;
    let mut text_length = [0; 4];
    fill(stream, &mut text_length, deadline)?;
    let text_length = u32::from_le_bytes(text_length) as usize;
    if text_length > TEXT_BYTES_MAX {
        return Err(ErrorKind::InvalidData.into());
    }
    let mut text_bytes = vec![0; text_length];
    fill(stream, &mut text_bytes, deadline)?;
    String::from_utf8(text_bytes).map_err(|_| ErrorKind::InvalidData.into())
}

fn fill(stream: &mut LineStream, mut bytes: &mut [u8], deadline: Instant) -> io::Result<()> {
    while !bytes.is_empty() {
        let time_left = deadline.saturating_duration_since(Instant::now());
        if time_left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(time_left))?;
        match stream.read(bytes) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(n_read) => bytes = &mut bytes[n_read..],
            Err(error) if is_transient(&error) => {}
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
        let sent_order = ForceCommand {
            number: 0xABCD,
            force: [0.1, -0.0, f64::MIN_POSITIVE],
        };
        let parsed_order = ForceCommand::parse(&sent_order.bytes());
        assert_eq!(parsed_order.number, sent_order.number);
        assert_eq!(parsed_order.force.map(f64::to_bits), sent_order.force.map(f64::to_bits));
        for answer in [
            GuardianReply::State {
                number: 7,
                position: [0.1, 0.2, -0.3],
                let_go: true,
            },
            GuardianReply::Gone(DeviceLoss::Closed),
            GuardianReply::Gone(DeviceLoss::Silent),
            GuardianReply::Gone(DeviceLoss::Shared),
            GuardianReply::Gone(DeviceLoss::System(-32)),
        ] {
            assert_eq!(GuardianReply::parse(&answer.bytes()), answer);
        }
    }

    #[cfg(unix)]
    #[test]
    fn line_finds_messages_in_any_pieces() {
        let (mut writer_end, reader_end) = LineStream::pair().unwrap();
        let mut host_line = GuardianLine::new(reader_end).unwrap();
        let numbered_order = |number| ForceCommand {
            number,
            force: [f64::from(number); 3],
        };
        let sent_bytes: Vec<u8> = (0..300).flat_map(|number| numbered_order(number).bytes()).collect();
        let mut commands = Vec::new();
        for piece in sent_bytes.chunks(37) {
            writer_end.write_all(piece).unwrap();
            host_line
                .receive(|bytes| commands.push(ForceCommand::parse(bytes)))
                .unwrap();
        }
        assert_eq!(commands, (0..300).map(numbered_order).collect::<Vec<_>>());
        // Everything at once, more than one batch, followed by the end of the stream.
        writer_end.write_all(&sent_bytes).unwrap();
        drop(writer_end);
        let mut message_count = 0;
        while host_line.receive(|_| message_count += 1).is_ok() {}
        assert_eq!(message_count, 300);
    }

    #[cfg(unix)]
    #[test]
    fn take_text_with_wrong_length_is_refused() {
        let (mut writer_end, mut reader_end) = LineStream::pair().unwrap();
        write_text(&mut writer_end, "ws://127.0.0.1").unwrap();
        let patience = Duration::from_secs(10);
        assert_eq!(read_text(&mut reader_end, patience).unwrap(), "ws://127.0.0.1");
        writer_end.write_all(&[0xFF; 8]).unwrap();
        assert!(read_text(&mut reader_end, patience).is_err(), "four gigabytes");
        drop(writer_end);
        assert!(read_text(&mut reader_end, patience).is_err());
    }
}
