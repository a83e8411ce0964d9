//! Access control: the key in the address, and the `Host` and `Origin` headers of the browser.

use std::fmt;
use std::net::{IpAddr, SocketAddr};

use super::answer::RefusalStatus;
use super::request::Request;

/// A key of 128 bits that is part of every address.
#[derive(Clone, PartialEq, Eq)]
pub struct AccessKey(String);

impl AccessKey {
    /// The key of 32 hexadecimal digits; `None` for other text.
    pub fn new(digits: &str) -> Option<Self> {
        let is_valid_key = digits.len() == 32 && digits.bytes().all(|b| b.is_ascii_hexdigit());
        is_valid_key.then(|| Self(digits.to_ascii_lowercase()))
    }

    /// Whether `text` is this key; the time of the comparison does not depend on where they differ.
    fn matches(&self, text: &str) -> bool {
        text.len() == self.0.len()
            && text
                .bytes()
                .zip(self.0.bytes())
                .fold(0, |differ, (a, b)| differ | (a ^ b))
                == 0
    }
}

impl fmt::Display for AccessKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Debug for AccessKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key")
    }
}

/// The path below the key; an error if the request is not one of our own page.
///
/// A name in another's domain may resolve to this machine (DNS rebinding): therefore a host must be an address, or
/// `localhost`. A page of another origin may send any request, but the browser then sends its origin.
pub(super) fn check<'a>(request: &'a Request, key: &AccessKey, address: SocketAddr) -> Result<&'a str, RefusalStatus> {
    let request_host = request.host.as_deref().ok_or(RefusalStatus::Malformed)?;
    if !is_server_host(request_host, address) {
        return Err(RefusalStatus::WrongHost);
    }
    let is_own_origin = |origin: &str| origin.strip_prefix("http://") == Some(request_host);
    match request.origin.as_deref() {
        Some(origin) if !is_own_origin(origin) => return Err(RefusalStatus::WrongOrigin),
        // A browser always sends the origin of a WebSocket.
        None if request.upgrade_key.is_some() => return Err(RefusalStatus::WrongOrigin),
        _ => {}
    }
    let path = request.path.strip_prefix('/').ok_or(RefusalStatus::Malformed)?;
    match path.split_once('/') {
        Some((key_text, path)) if key.matches(key_text) => Ok(path),
        _ => Err(RefusalStatus::NotFound),
    }
}

/// Whether a `Host` is this machine: on loopback, a loopback address or `localhost`; otherwise, any address.
fn is_server_host(host: &str, address: SocketAddr) -> bool {
    let (host_name, host_port) = match host.rsplit_once(':') {
        Some((host_name, host_port)) if !host_port.ends_with(']') => (host_name, host_port.parse().ok()),
        _ => (host, Some(80)),
    };
    if host_port != Some(address.port()) {
        return false;
    }
    if host_name.eq_ignore_ascii_case("localhost") {
        return true;
    }
    let bare_address = host_name.strip_prefix('[').and_then(|n| n.strip_suffix(']'));
    let host_ip: Option<IpAddr> = bare_address.unwrap_or(host_name).parse().ok();
    host_ip.is_some_and(|host_ip| !address.ip().is_loopback() || host_ip.is_loopback())
}
