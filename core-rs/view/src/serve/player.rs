//! A connected page that plays keys: positions of pointers come in, and pointer, finger and key go out.

use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Bytes, Error, Message, WebSocket};

use super::keys::{self, KeyInput, MESSAGE_MAX};
use super::viewer::{ConnectionEnd, connection_end, is_timeout};
use super::{ConnectionSlot, ServerState};

/// Longest wait for a message.
const READ_TIMEOUT: Duration = Duration::from_millis(4);
/// Time between two pictures of the points.
const KEY_STATE_INTERVAL: Duration = Duration::from_millis(12);
/// Silence after which a page counts as gone: its network may be lost although its connection is open. Browsers call a
/// page in the background once a second.
const SILENCE_TIMEOUT: Duration = Duration::from_millis(2_500);
/// Positions that are refused before the connection is dropped.
const REFUSED_MAX: usize = 10_000;

/// Takes positions from a page until the connection ends.
pub(super) fn serve_player(stream: TcpStream, unread_bytes: Vec<u8>, state: &ServerState, _slot: ConnectionSlot<'_>) {
    let page_limits = state.options.limits;
    let is_stream_ready = stream.set_write_timeout(Some(page_limits.stall_timeout)).is_ok()
        && stream.set_read_timeout(Some(READ_TIMEOUT)).is_ok()
        && stream.set_nodelay(true).is_ok();
    let socket_config = WebSocketConfig::default()
        .read_buffer_size(1 << 12)
        .write_buffer_size(0)
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX));
    let mut page = PlayerPage {
        socket: WebSocket::from_partially_read(stream, unread_bytes, Role::Server, Some(socket_config)),
        state,
        held_keys: vec![false; state.options.page_keys.len()],
        n_refused: 0,
    };
    if is_stream_ready && let ConnectionEnd::Dropped = page.exchange_until_closed() {
        state.counts.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

struct PlayerPage<'a> {
    socket: WebSocket<TcpStream>,
    state: &'a ServerState,
    /// Which keys this page holds.
    held_keys: Vec<bool>,
    n_refused: usize,
}

impl PlayerPage<'_> {
    fn exchange_until_closed(&mut self) -> ConnectionEnd {
        let (mut last_sent, mut last_message) = (None::<Instant>, Instant::now());
        loop {
            if self.state.is_stopping() {
                let _ = self.socket.close(None);
                return ConnectionEnd::Closed;
            }
            match self.socket.read() {
                Ok(message) => {
                    last_message = Instant::now();
                    if let Err(end) = self.receive(&message) {
                        return end;
                    }
                }
                Err(Error::Io(error)) if is_timeout(&error) => {}
                Err(error) => return connection_end(&error),
            }
            if last_message.elapsed() > SILENCE_TIMEOUT {
                self.release_all();
            }
            if last_sent.is_none_or(|last| last.elapsed() >= KEY_STATE_INTERVAL) {
                last_sent = Some(Instant::now());
                let key_states = Message::binary(self.key_state_bytes());
                if let Err(error) = self.socket.send(key_states) {
                    return connection_end(&error);
                }
            }
        }
    }

    fn receive(&mut self, message: &Message) -> Result<(), ConnectionEnd> {
        match message {
            Message::Text(text) => self.receive_text(text),
            Message::Binary(bytes) => {
                let played_key = keys::parse_input(bytes).ok_or(ConnectionEnd::Dropped)?;
                self.apply_input(&played_key)
            }
            Message::Ping(_) | Message::Pong(_) => Ok(()),
            Message::Close(_) => Err(ConnectionEnd::Closed),
            Message::Frame(_) => Err(ConnectionEnd::Dropped),
        }
    }

    fn receive_text(&mut self, text: &str) -> Result<(), ConnectionEnd> {
        let (message_verb, argument) = text.split_once(' ').ok_or(ConnectionEnd::Dropped)?;
        if message_verb == "ping" {
            let sent_time: f64 = argument.parse().map_err(|_| ConnectionEnd::Dropped)?;
            return self.send_text(format!("pong {sent_time} {}", self.state.now()));
        }
        let key_number: usize = argument.parse().map_err(|_| ConnectionEnd::Dropped)?;
        let page_key = self
            .state
            .options
            .page_keys
            .get(key_number)
            .ok_or(ConnectionEnd::Dropped)?;
        match message_verb {
            "hold" if self.held_keys[key_number] => Ok(()),
            "hold" if page_key.acquire() => {
                self.held_keys[key_number] = true;
                Ok(())
            }
            "hold" => self.send_text(format!("taken {key_number}")),
            "leave" => {
                if std::mem::take(&mut self.held_keys[key_number]) {
                    page_key.release();
                }
                Ok(())
            }
            _ => Err(ConnectionEnd::Dropped),
        }
    }

    /// Moves a key by the positions of a pointer, if this page holds it.
    fn apply_input(&mut self, input: &KeyInput) -> Result<(), ConnectionEnd> {
        let page_key = self
            .state
            .options
            .page_keys
            .get(input.key)
            .ok_or(ConnectionEnd::Dropped)?;
        let time_now = self.state.now();
        for &(time, x, pressure) in &input.positions {
            let is_taken = if self.held_keys[input.key] {
                page_key.add_position(time_now - time, x, pressure)
            } else {
                page_key.count_refused();
                false
            };
            self.n_refused += usize::from(!is_taken);
        }
        if self.n_refused > REFUSED_MAX {
            return Err(ConnectionEnd::Dropped);
        }
        Ok(())
    }

    fn send_text(&mut self, text: String) -> Result<(), ConnectionEnd> {
        let send_result = self.socket.send(Message::text(text));
        send_result.map_err(|error| connection_end(&error))
    }

    /// For each key: whether this page (1), another (2) or none (0) holds it; pointer, finger, key [m] and force [N].
    fn key_state_bytes(&self) -> Bytes {
        let mut state_bytes = Vec::with_capacity(17 * self.held_keys.len());
        for (key, &is_held) in self.state.options.page_keys.iter().zip(&self.held_keys) {
            state_bytes.push(match (is_held, key.is_held()) {
                (true, _) => 1,
                (false, true) => 2,
                (false, false) => 0,
            });
            let key_points = key.points();
            for point in [key_points.pointer, key_points.finger, key_points.key, key_points.force] {
                state_bytes.extend((point as f32).to_le_bytes());
            }
        }
        state_bytes.into()
    }

    fn release_all(&mut self) {
        for (key, is_held) in self.state.options.page_keys.iter().zip(&mut self.held_keys) {
            if std::mem::take(is_held) {
                key.release();
            }
        }
    }
}

impl Drop for PlayerPage<'_> {
    fn drop(&mut self) {
        self.release_all();
    }
}
