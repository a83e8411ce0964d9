//! Responses: status, headers, and a body from memory or from a file.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};

use super::pace::PacedStream;

/// The status with which a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RefusalStatus {
    Malformed,
    WrongOrigin,
    NotFound,
    NotGet,
    TimedOut,
    NoSuchRange,
    WrongHost,
    TooLarge,
    Full,
}

impl RefusalStatus {
    fn status_line(self) -> &'static str {
        match self {
            Self::Malformed => "400 Bad Request",
            Self::WrongOrigin => "403 Forbidden",
            Self::NotFound => "404 Not Found",
            Self::NotGet => "405 Method Not Allowed",
            Self::TimedOut => "408 Request Timeout",
            Self::NoSuchRange => "416 Range Not Satisfiable",
            Self::WrongHost => "421 Misdirected Request",
            Self::TooLarge => "431 Request Header Fields Too Large",
            Self::Full => "503 Service Unavailable",
        }
    }
}

/// Everything on the page comes from this server, and other pages may not frame or read it. Sound is played from memory
/// (`blob:`), because a player that reads ahead on demand would look like a slow reader.
const SECURITY_HEADERS: &str = "Content-Security-Policy: default-src 'self'; media-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    X-Content-Type-Options: nosniff\r\n\
    Referrer-Policy: no-referrer\r\n\
    Cache-Control: no-store\r\n\
    Connection: close\r\n";

pub(super) fn refuse(out: &mut impl Write, status: RefusalStatus) -> io::Result<()> {
    let status_line = status.status_line();
    let allow_header = if status == RefusalStatus::NotGet {
        "Allow: GET\r\n"
    } else {
        ""
    };
    let response_head = format!(
        "HTTP/1.1 {status_line}\r\n{SECURITY_HEADERS}{allow_header}Content-Type: text/plain\r\nContent-Length: {}\r\n\r\n{status_line}\n",
        status_line.len() + 1
    );
    out.write_all(response_head.as_bytes())
}

/// Answers that there is nothing under this name, which is not an error.
pub(super) fn no_content(out: &mut impl Write) -> io::Result<()> {
    out.write_all(format!("HTTP/1.1 204 No Content\r\n{SECURITY_HEADERS}\r\n").as_bytes())
}

pub(super) fn send_bytes(out: &mut impl Write, kind: &str, body: &[u8]) -> io::Result<()> {
    let body_length = body.len();
    let response_head =
        format!("HTTP/1.1 200 OK\r\n{SECURITY_HEADERS}Content-Type: {kind}\r\nContent-Length: {body_length}\r\n\r\n");
    out.write_all(response_head.as_bytes())?;
    out.write_all(body)
}

/// The part of a file of `length` bytes that is read: first byte and number of bytes; an error if the range is outside.
pub(super) fn byte_range(range: Option<(u64, Option<u64>)>, length: u64) -> Result<(u64, u64), RefusalStatus> {
    let Some((first_byte, last_byte)) = range else {
        return Ok((0, length));
    };
    let end_byte = last_byte.map_or(length, |last_byte| last_byte.saturating_add(1).min(length));
    if first_byte >= end_byte {
        return Err(RefusalStatus::NoSuchRange);
    }
    Ok((first_byte, end_byte - first_byte))
}

/// Sends a part of a file, in pieces.
pub(super) fn send_file(
    out: &mut PacedStream,
    kind: &str,
    file: &mut File,
    length: u64,
    (first_byte, n_bytes): (u64, u64),
    is_partial: bool,
) -> io::Result<()> {
    let status_line = if is_partial {
        format!(
            "206 Partial Content\r\nContent-Range: bytes {first_byte}-{}/{length}",
            first_byte + n_bytes - 1
        )
    } else {
        "200 OK".into()
    };
    let response_head = format!(
        "HTTP/1.1 {status_line}\r\n{SECURITY_HEADERS}Accept-Ranges: bytes\r\nContent-Type: {kind}\r\nContent-Length: {n_bytes}\r\n\r\n"
    );
    out.write_all(response_head.as_bytes())?;
    file.seek(SeekFrom::Start(first_byte))?;
    let mut piece_buffer = vec![0; 64 << 10];
    let mut bytes_left = n_bytes;
    while bytes_left > 0 {
        let piece_len = piece_buffer
            .len()
            .min(usize::try_from(bytes_left).unwrap_or(usize::MAX));
        let bytes_read = file.read(&mut piece_buffer[..piece_len])?;
        if bytes_read == 0 {
            // The file became shorter meanwhile: the reader notices that bytes are missing.
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        out.write_all(&piece_buffer[..bytes_read])?;
        bytes_left -= bytes_read as u64;
    }
    Ok(())
}

/// The answer to the upgrade of a WebSocket.
pub(super) fn switch_protocols(out: &mut impl Write, key: &str) -> io::Result<()> {
    let accept_key = tungstenite::handshake::derive_accept_key(key.as_bytes());
    let response_head = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept_key}\r\n\r\n"
    );
    out.write_all(response_head.as_bytes())
}
