//! One connected page: it receives messages and may send `ping` to compare clocks.

use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use super::hub::NextMessage;
use super::{ConnectionSlot, ServerState};

/// Largest message from a page, which is `ping` and a number [bytes].
const MESSAGE_BYTES_MAX: usize = 64;
/// Messages that are read before the next one is sent: a page may send without end.
const READS_PER_SEND: usize = 16;
/// Longest wait for news, during which messages from the page are not read; and longest wait for such a message.
const HUB_TIMEOUT: Duration = Duration::from_millis(10);
const READ_TIMEOUT: Duration = Duration::from_millis(1);

/// How the connection to a viewer ended.
pub(super) enum ConnectionEnd {
    /// The page was closed, or the server.
    Closed,
    /// The client read too slowly, or sent a message that the protocol does not have.
    Dropped,
}

/// Sends messages to a page until the connection ends.
pub(super) fn serve_viewer(stream: TcpStream, unread_bytes: Vec<u8>, state: &ServerState, _slot: ConnectionSlot<'_>) {
    let page_limits = state.options.limits;
    let is_stream_ready = stream.set_write_timeout(Some(page_limits.stall_timeout)).is_ok()
        && stream.set_read_timeout(Some(READ_TIMEOUT)).is_ok()
        && stream.set_nodelay(true).is_ok();
    let socket_config = WebSocketConfig::default()
        .read_buffer_size(1 << 10)
        .write_buffer_size(0)
        .max_message_size(Some(MESSAGE_BYTES_MAX))
        .max_frame_size(Some(MESSAGE_BYTES_MAX));
    let mut page_socket = WebSocket::from_partially_read(stream, unread_bytes, Role::Server, Some(socket_config));
    if is_stream_ready && let ConnectionEnd::Dropped = send_until_closed(&mut page_socket, state) {
        state.counts.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

fn send_until_closed(socket: &mut WebSocket<TcpStream>, state: &ServerState) -> ConnectionEnd {
    let mut viewer_cursor = state.hub.new_cursor();
    loop {
        let message = match state.hub.next_message(&mut viewer_cursor, HUB_TIMEOUT) {
            NextMessage::Message(bytes) => Some(Message::binary(tungstenite::Bytes::from_owner(bytes))),
            NextMessage::Lost(n) => Some(Message::text(format!("lost {n}"))),
            NextMessage::Nothing => None,
            NextMessage::Closed => {
                let _ = socket.close(None);
                return ConnectionEnd::Closed;
            }
        };
        // If the reader takes nothing, this times out. A message that was sent in part cannot be taken back, so the
        // connection ends.
        if let Some(message) = message
            && let Err(error) = socket.send(message)
        {
            return connection_end(&error);
        }
        if let Err(end) = answer_messages(socket, state) {
            return end;
        }
    }
}

/// Reads and answers messages of the page.
fn answer_messages(socket: &mut WebSocket<TcpStream>, state: &ServerState) -> Result<(), ConnectionEnd> {
    for _ in 0..READS_PER_SEND {
        let message = match socket.read() {
            Ok(message) => message,
            Err(Error::Io(error)) if is_timeout(&error) => return Ok(()),
            Err(error) => return Err(connection_end(&error)),
        };
        match message {
            Message::Text(text) => {
                let ping_time = text.strip_prefix("ping ").and_then(|t| t.parse().ok());
                let ping_time: f64 = ping_time.ok_or(ConnectionEnd::Dropped)?;
                let pong_text = format!("pong {ping_time} {}", state.now());
                socket
                    .send(Message::text(pong_text))
                    .map_err(|error| connection_end(&error))?;
            }
            Message::Ping(_) | Message::Pong(_) => {}
            Message::Close(_) => return Err(ConnectionEnd::Closed),
            Message::Binary(_) | Message::Frame(_) => return Err(ConnectionEnd::Dropped),
        }
    }
    Ok(())
}

pub(super) fn is_timeout(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

pub(super) fn connection_end(error: &Error) -> ConnectionEnd {
    match error {
        Error::ConnectionClosed | Error::AlreadyClosed => ConnectionEnd::Closed,
        Error::Io(error) if !is_timeout(error) => ConnectionEnd::Closed,
        _ => ConnectionEnd::Dropped,
    }
}
