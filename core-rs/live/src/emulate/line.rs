//! The transports of an emulated device: a pseudo-terminal, UDP or a WebSocket, always local to this machine.

#[cfg(unix)]
mod terminal;

use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message, WebSocket};

use crate::wire::haply;

/// The transport by which a host reaches the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// A pseudo-terminal, which a host opens like a serial port.
    Terminal,
    /// UDP at a port of 127.0.0.1; 0: any free port.
    Udp(u16),
    /// A WebSocket at a port of 127.0.0.1; 0: any free port.
    WebSocket(u16),
}

/// An event on the line.
pub(super) enum LineEvent {
    Nothing,
    /// This many bytes came.
    Bytes(usize),
    /// A host has connected.
    Connected,
    /// The host has disconnected.
    Disconnected,
}

/// A line to at most one host.
pub(super) enum HostLine {
    #[cfg(unix)]
    Terminal(terminal::Terminal),
    Udp(UdpLine),
    WebSocket(Box<WebSocketLine>),
}

impl HostLine {
    pub(super) fn open(transport: Transport) -> io::Result<Self> {
        let local_address = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        Ok(match transport {
            #[cfg(unix)]
            Transport::Terminal => Self::Terminal(terminal::Terminal::open()?),
            #[cfg(not(unix))]
            Transport::Terminal => return Err(io::ErrorKind::Unsupported.into()),
            Transport::Udp(port) => Self::Udp(UdpLine {
                socket: UdpSocket::bind(local_address(port))?,
                host: None,
            }),
            Transport::WebSocket(port) => {
                let listener = TcpListener::bind(local_address(port))?;
                listener.set_nonblocking(true)?;
                Self::WebSocket(Box::new(WebSocketLine { listener, host: None }))
            }
        })
    }

    /// The address that a host opens.
    pub(super) fn address(&self) -> io::Result<String> {
        Ok(match self {
            #[cfg(unix)]
            Self::Terminal(terminal) => terminal.path().to_owned(),
            Self::Udp(line) => line.socket.local_addr()?.to_string(),
            Self::WebSocket(line) => format!("ws://{}", line.listener.local_addr()?),
        })
    }

    /// Wait for an event, for at most `wait`.
    pub(super) fn read(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<LineEvent> {
        match self {
            #[cfg(unix)]
            Self::Terminal(terminal) => terminal.read(buffer, wait),
            Self::Udp(line) => line.read(buffer, wait),
            Self::WebSocket(line) => line.read(buffer, wait),
        }
    }

    /// The host has let go: the next sender becomes the host.
    pub(super) fn release_host(&mut self) {
        if let Self::Udp(datagrams) = self {
            datagrams.host = None;
        }
    }

    /// Send a reply; it is lost if the host has gone.
    pub(super) fn write(&mut self, bytes: &[u8]) {
        match self {
            #[cfg(unix)]
            Self::Terminal(terminal) => terminal.write(bytes),
            Self::Udp(line) => {
                if let Some((host, _)) = line.host {
                    let _ = line.socket.send_to(bytes, host);
                }
            }
            Self::WebSocket(line) => {
                if let Some(host) = &mut line.host {
                    let message_text = String::from_utf8_lossy(bytes).into_owned();
                    let _ = host.send(Message::text(message_text));
                }
            }
        }
    }
}

/// A host that was silent for this long may be replaced by another one: in lockstep there is no watchdog.
const HOST_SILENCE_MAX: Duration = Duration::from_secs(1);

pub(super) struct UdpLine {
    socket: UdpSocket,
    /// The host whose forces act, and the time of its last datagram; other senders are ignored.
    host: Option<(SocketAddr, Instant)>,
}

impl UdpLine {
    fn read(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<LineEvent> {
        // A timeout of zero is not allowed.
        self.socket.set_read_timeout(Some(wait.max(Duration::from_micros(1))))?;
        let (byte_count, sender) = match self.socket.recv_from(buffer) {
            Ok(got) => got,
            Err(error) => return ignore_transient(error),
        };
        let read_instant = Instant::now();
        match self.host {
            Some((host, last_received))
                if host != sender && read_instant.duration_since(last_received) < HOST_SILENCE_MAX =>
            {
                return Ok(LineEvent::Nothing);
            }
            _ => self.host = Some((sender, read_instant)),
        }
        Ok(LineEvent::Bytes(byte_count))
    }
}

pub(super) struct WebSocketLine {
    listener: TcpListener,
    host: Option<WebSocket<TcpStream>>,
}

impl WebSocketLine {
    fn read(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<LineEvent> {
        let Some(host_socket) = &mut self.host else {
            return self.accept(wait);
        };
        host_socket
            .get_ref()
            .set_read_timeout(Some(wait.max(Duration::from_micros(1))))?;
        match host_socket.read() {
            Ok(Message::Text(text)) if text.len() <= buffer.len() => {
                buffer[..text.len()].copy_from_slice(text.as_bytes());
                Ok(LineEvent::Bytes(text.len()))
            }
            Ok(Message::Close(_)) => {
                self.host = None;
                Ok(LineEvent::Disconnected)
            }
            Ok(_) => Ok(LineEvent::Nothing),
            Err(tungstenite::Error::Io(error)) if is_transient(&error) => Ok(LineEvent::Nothing),
            Err(_) => {
                self.host = None;
                Ok(LineEvent::Disconnected)
            }
        }
    }

    fn accept(&mut self, wait: Duration) -> io::Result<LineEvent> {
        let tcp_stream = match self.listener.accept() {
            Ok((tcp_stream, _)) => tcp_stream,
            Err(error) => {
                std::thread::sleep(wait.min(Duration::from_millis(1)));
                return ignore_transient(error);
            }
        };
        tcp_stream.set_nonblocking(false)?;
        tcp_stream.set_nodelay(true)?;
        tcp_stream.set_read_timeout(Some(HOST_SILENCE_MAX))?;
        let config = WebSocketConfig::default()
            .max_message_size(Some(haply::MESSAGE_BYTES_MAX))
            .max_frame_size(Some(haply::MESSAGE_BYTES_MAX));
        // A peer that does not complete the handshake is disconnected.
        let Ok(web_socket) = tungstenite::accept_with_config(tcp_stream, Some(config)) else {
            return Ok(LineEvent::Nothing);
        };
        self.host = Some(web_socket);
        Ok(LineEvent::Connected)
    }
}

pub(super) fn is_transient(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, TimedOut, WouldBlock};
    matches!(
        error.kind(),
        WouldBlock | TimedOut | Interrupted | ConnectionRefused | ConnectionReset
    )
}

pub(super) fn ignore_transient(error: io::Error) -> io::Result<LineEvent> {
    if is_transient(&error) {
        Ok(LineEvent::Nothing)
    } else {
        Err(error)
    }
}
