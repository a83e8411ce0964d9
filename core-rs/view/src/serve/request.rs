//! One request: its head, with limits, and the fields that are used.

use std::io::{ErrorKind, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::answer::RefusalStatus;

/// Largest size of a head [bytes]; that of a browser has a few hundred.
const HEAD_BYTES_MAX: usize = 8 << 10;
const HEADERS_MAX: usize = 64;

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
    pub(super) upgrade_key: Option<String>,
    /// Bytes that came after the head.
    pub(super) unread_bytes: Vec<u8>,
}

/// Why there is no request.
pub(super) enum RequestError {
    /// The connection is closed: nobody can be answered.
    Closed,
    Refused(RefusalStatus),
}

/// Reads the head of a request within a time.
pub(super) fn read_request(mut stream: &TcpStream, time_limit: Duration) -> Result<Request, RequestError> {
    let deadline = Instant::now() + time_limit;
    let mut head_bytes = [0; HEAD_BYTES_MAX];
    let mut bytes_read = 0;
    loop {
        let time_left = deadline.saturating_duration_since(Instant::now());
        if time_left.is_zero() || stream.set_read_timeout(Some(time_left)).is_err() {
            return Err(RequestError::Refused(RefusalStatus::TimedOut));
        }
        match stream.read(&mut head_bytes[bytes_read..]) {
            Ok(0) => return Err(RequestError::Closed),
            Ok(read_count) => bytes_read += read_count,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Err(RequestError::Refused(RefusalStatus::TimedOut));
            }
            Err(_) => return Err(RequestError::Closed),
        }
        if let Some(request) = parse(&head_bytes[..bytes_read]).map_err(RequestError::Refused)? {
            return Ok(request);
        }
        if bytes_read == HEAD_BYTES_MAX {
            return Err(RequestError::Refused(RefusalStatus::TooLarge));
        }
    }
}

/// Parses a request; `None` if its head is incomplete.
pub(super) fn parse(bytes: &[u8]) -> Result<Option<Request>, RefusalStatus> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut request_head = httparse::Request::new(&mut headers);
    let head_length = match request_head.parse(bytes) {
        Ok(httparse::Status::Complete(head_length)) => head_length,
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(httparse::Error::TooManyHeaders) => return Err(RefusalStatus::TooLarge),
        Err(_) => return Err(RefusalStatus::Malformed),
    };
    if request_head.method != Some("GET") {
        return Err(RefusalStatus::NotGet);
    }
    let request_target = request_head.path.unwrap_or_default();
    let single_header = |name: &str| -> Result<Option<&str>, RefusalStatus> {
        let mut matching_headers = request_head
            .headers
            .iter()
            .filter(|header| header.name.eq_ignore_ascii_case(name));
        let header_text = matching_headers.next().map(|header| str::from_utf8(header.value));
        match (header_text, matching_headers.next()) {
            (None, _) => Ok(None),
            (Some(Ok(header_text)), None) => Ok(Some(header_text.trim())),
            _ => Err(RefusalStatus::Malformed),
        }
    };
    // A GET has no body: it could be taken for a second request.
    if single_header("content-length")?.is_some_and(|length_text| length_text != "0")
        || single_header("transfer-encoding")?.is_some()
    {
        return Err(RefusalStatus::Malformed);
    }
    Ok(Some(Request {
        path: request_target.split('?').next().unwrap_or_default().to_owned(),
        host: single_header("host")?.map(str::to_owned),
        origin: single_header("origin")?.map(str::to_owned),
        range: single_header("range")?.map(parse_range).transpose()?,
        upgrade_key: parse_upgrade(&single_header, request_head.version)?,
        unread_bytes: bytes[head_length..].to_vec(),
    }))
}

/// The key of a WebSocket upgrade by RFC 6455; `None` if no upgrade is requested.
fn parse_upgrade<'a>(
    single_header: &impl Fn(&str) -> Result<Option<&'a str>, RefusalStatus>,
    version: Option<u8>,
) -> Result<Option<String>, RefusalStatus> {
    let Some(upgrade_header) = single_header("upgrade")? else {
        return Ok(None);
    };
    let connection_header = single_header("connection")?.unwrap_or_default();
    let is_upgrade = connection_header
        .split(',')
        .any(|word| word.trim().eq_ignore_ascii_case("upgrade"));
    let socket_key = single_header("sec-websocket-key")?.unwrap_or_default();
    // The form of 16 bytes in base64.
    let is_valid_key = socket_key.len() == 24 && socket_key.ends_with("==") && socket_key.is_ascii();
    let is_known_version = single_header("sec-websocket-version")? == Some("13");
    if upgrade_header.eq_ignore_ascii_case("websocket")
        && is_upgrade
        && is_valid_key
        && is_known_version
        && version == Some(1)
    {
        Ok(Some(socket_key.to_owned()))
    } else {
        Err(RefusalStatus::Malformed)
    }
}

fn parse_range(text: &str) -> Result<(u64, Option<u64>), RefusalStatus> {
    let (first_byte, last_byte) = text
        .strip_prefix("bytes=")
        .and_then(|text| text.split_once('-'))
        .ok_or(RefusalStatus::NoSuchRange)?;
    let parse_number = |text: &str| text.parse().map_err(|_| RefusalStatus::NoSuchRange);
    let last_byte = if last_byte.is_empty() {
        None
    } else {
        Some(parse_number(last_byte)?)
    };
    Ok((parse_number(first_byte)?, last_byte))
}
