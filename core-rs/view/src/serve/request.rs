//! One request: its head, with limits, and the fields that are used.

use std::io::{ErrorKind, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::answer::Status;

/// Largest size of a head [bytes]; that of a browser has a few hundred.
const HEAD: usize = 8 << 10;
const HEADERS: usize = 64;

/// The fields of a request that are used.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Request {
    /// Without the query string.
    pub(super) path: String,
    pub(super) host: Option<String>,
    pub(super) origin: Option<String>,
    /// `bytes=a-b`: the first byte, and the last one if it is given.
    pub(super) range: Option<(u64, Option<u64>)>,
    /// The key of a WebSocket upgrade, from which the answer is derived.
    pub(super) upgrade: Option<String>,
    /// Bytes that came after the head.
    pub(super) rest: Vec<u8>,
}

/// Why there is no request.
pub(super) enum RequestError {
    /// The connection is closed: nobody can be answered.
    Gone,
    Refused(Status),
}

/// Reads the head of a request within a time.
pub(super) fn read(mut stream: &TcpStream, within: Duration) -> Result<Request, RequestError> {
    let until = Instant::now() + within;
    let mut bytes = [0; HEAD];
    let mut n = 0;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return Err(RequestError::Refused(Status::TimedOut));
        }
        match stream.read(&mut bytes[n..]) {
            Ok(0) => return Err(RequestError::Gone),
            Ok(more) => n += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Err(RequestError::Refused(Status::TimedOut));
            }
            Err(_) => return Err(RequestError::Gone),
        }
        if let Some(request) = parse(&bytes[..n]).map_err(RequestError::Refused)? {
            return Ok(request);
        }
        if n == HEAD {
            return Err(RequestError::Refused(Status::TooLarge));
        }
    }
}

/// Parses a request; `None` if its head is incomplete.
pub(super) fn parse(bytes: &[u8]) -> Result<Option<Request>, Status> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS];
    let mut head = httparse::Request::new(&mut headers);
    let length = match head.parse(bytes) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(httparse::Error::TooManyHeaders) => return Err(Status::TooLarge),
        Err(_) => return Err(Status::Malformed),
    };
    if head.method != Some("GET") {
        return Err(Status::NotGet);
    }
    let target = head.path.unwrap_or_default();
    let once = |name: &str| -> Result<Option<&str>, Status> {
        let mut header_lines = head
            .headers
            .iter()
            .filter(|h| h.name.eq_ignore_ascii_case(name));
        let value = header_lines.next().map(|h| str::from_utf8(h.value));
        match (value, header_lines.next()) {
            (None, _) => Ok(None),
            (Some(Ok(value)), None) => Ok(Some(value.trim())),
            _ => Err(Status::Malformed),
        }
    };
    // A GET has no body: it could be taken for a second request.
    if once("content-length")?.is_some_and(|n| n != "0") || once("transfer-encoding")?.is_some() {
        return Err(Status::Malformed);
    }
    Ok(Some(Request {
        path: target.split('?').next().unwrap_or_default().to_owned(),
        host: once("host")?.map(str::to_owned),
        origin: once("origin")?.map(str::to_owned),
        range: once("range")?.map(range).transpose()?,
        upgrade: upgrade(&once, head.version)?,
        rest: bytes[length..].to_vec(),
    }))
}

/// The key of a WebSocket upgrade by RFC 6455; `None` if no upgrade is requested.
fn upgrade<'a>(
    once: &impl Fn(&str) -> Result<Option<&'a str>, Status>,
    version: Option<u8>,
) -> Result<Option<String>, Status> {
    let Some(to) = once("upgrade")? else {
        return Ok(None);
    };
    let connection = once("connection")?.unwrap_or_default();
    let named = connection
        .split(',')
        .any(|word| word.trim().eq_ignore_ascii_case("upgrade"));
    let key = once("sec-websocket-key")?.unwrap_or_default();
    // The form of 16 bytes in base64.
    let is_key = key.len() == 24 && key.ends_with("==") && key.is_ascii();
    let is_known = once("sec-websocket-version")? == Some("13");
    if to.eq_ignore_ascii_case("websocket") && named && is_key && is_known && version == Some(1) {
        Ok(Some(key.to_owned()))
    } else {
        Err(Status::Malformed)
    }
}

fn range(text: &str) -> Result<(u64, Option<u64>), Status> {
    let (first, last) = text
        .strip_prefix("bytes=")
        .and_then(|text| text.split_once('-'))
        .ok_or(Status::NoSuchRange)?;
    let number = |text: &str| text.parse().map_err(|_| Status::NoSuchRange);
    let last = if last.is_empty() {
        None
    } else {
        Some(number(last)?)
    };
    Ok((number(first)?, last))
}
