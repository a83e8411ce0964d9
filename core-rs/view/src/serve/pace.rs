//! Writes to readers that may be slow: a reader that takes nothing, or less than the lowest rate, is dropped.

use std::io::{self, ErrorKind, Write};
use std::net::TcpStream;
use std::time::Instant;

use super::Limits;

/// A stream, with the number of bytes that its reader has taken so far.
pub(super) struct Paced<'a> {
    stream: &'a TcpStream,
    limits: Limits,
    begin: Instant,
    taken: u64,
}

impl<'a> Paced<'a> {
    pub(super) fn new(stream: &'a TcpStream, limits: Limits) -> io::Result<Self> {
        stream.set_write_timeout(Some(limits.stall))?;
        Ok(Self {
            stream,
            limits,
            begin: Instant::now(),
            taken: 0,
        })
    }
}

impl Write for Paced<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let bytes_written = self.stream.write(bytes)?;
        self.taken += bytes_written as u64;
        let time_beyond = self.begin.elapsed().saturating_sub(self.limits.stall);
        if self.taken < time_beyond.as_secs() * self.limits.floor {
            return Err(ErrorKind::TimedOut.into());
        }
        Ok(bytes_written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}
