//! Writes to readers that may be slow: a reader that takes nothing, or less than the lowest rate, is dropped.

use std::io::{self, ErrorKind, Write};
use std::net::TcpStream;
use std::time::Instant;

use super::ConnectionLimits;

/// A stream, with the number of bytes that its reader has taken so far.
pub(super) struct PacedStream<'a> {
    stream: &'a TcpStream,
    limits: ConnectionLimits,
    start_instant: Instant,
    bytes_taken: u64,
}

impl<'a> PacedStream<'a> {
    pub(super) fn new(stream: &'a TcpStream, limits: ConnectionLimits) -> io::Result<Self> {
        stream.set_write_timeout(Some(limits.stall_timeout))?;
        Ok(Self {
            stream,
            limits,
            start_instant: Instant::now(),
            bytes_taken: 0,
        })
    }
}

impl Write for PacedStream<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let bytes_written = self.stream.write(bytes)?;
        self.bytes_taken += bytes_written as u64;
        let paced_time = self.start_instant.elapsed().saturating_sub(self.limits.stall_timeout);
        if self.bytes_taken < paced_time.as_secs() * self.limits.byte_rate_min {
            return Err(ErrorKind::TimedOut.into());
        }
        Ok(bytes_written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}
