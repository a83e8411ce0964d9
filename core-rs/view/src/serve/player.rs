//! A connected page that plays keys: positions of pointers come in, and pointer, finger and key go out.

use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Bytes, Error, Message, WebSocket};

use super::keys::{self, MESSAGE_MAX, Played};
use super::viewer::{End, ended, is_wait};
use super::{Shared, Slot};

/// Longest wait for a message.
const READ_TIMEOUT: Duration = Duration::from_millis(4);
/// Time between two pictures of the points.
const PICTURE_INTERVAL: Duration = Duration::from_millis(12);
/// Silence after which a page counts as gone: its network may be lost although its connection is open. Browsers call a
/// page in the background once a second.
const SILENCE: Duration = Duration::from_millis(2_500);
/// Positions that are refused before the connection is dropped.
const REFUSED_MAX: usize = 10_000;

/// Takes positions from a page until the connection ends.
pub(super) fn take_from_page(stream: TcpStream, rest: Vec<u8>, shared: &Shared, _slot: Slot<'_>) {
    let page_limits = shared.options.limits;
    let stream_ready = stream.set_write_timeout(Some(page_limits.stall)).is_ok()
        && stream.set_read_timeout(Some(READ_TIMEOUT)).is_ok()
        && stream.set_nodelay(true).is_ok();
    let socket_config = WebSocketConfig::default()
        .read_buffer_size(1 << 12)
        .write_buffer_size(0)
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX));
    let mut page = Page {
        socket: WebSocket::from_partially_read(stream, rest, Role::Server, Some(socket_config)),
        shared,
        holds: vec![false; shared.options.keys.len()],
        refused: 0,
    };
    if stream_ready && let End::Dropped = page.run() {
        shared.tally.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

struct Page<'a> {
    socket: WebSocket<TcpStream>,
    shared: &'a Shared,
    /// Which keys this page holds.
    holds: Vec<bool>,
    refused: usize,
}

impl Page<'_> {
    fn run(&mut self) -> End {
        let (mut pictured, mut last_message) = (None::<Instant>, Instant::now());
        loop {
            if self.shared.is_over() {
                let _ = self.socket.close(None);
                return End::Left;
            }
            match self.socket.read() {
                Ok(message) => {
                    last_message = Instant::now();
                    if let Err(end) = self.receive(&message) {
                        return end;
                    }
                }
                Err(Error::Io(error)) if is_wait(&error) => {}
                Err(error) => return ended(&error),
            }
            if last_message.elapsed() > SILENCE {
                self.leave_all();
            }
            if pictured.is_none_or(|last| last.elapsed() >= PICTURE_INTERVAL) {
                pictured = Some(Instant::now());
                let picture = Message::binary(self.picture());
                if let Err(error) = self.socket.send(picture) {
                    return ended(&error);
                }
            }
        }
    }

    fn receive(&mut self, message: &Message) -> Result<(), End> {
        match message {
            Message::Text(text) => self.receive_text(text),
            Message::Binary(bytes) => {
                let played_key = keys::parse(bytes).ok_or(End::Dropped)?;
                self.play(&played_key)
            }
            Message::Ping(_) | Message::Pong(_) => Ok(()),
            Message::Close(_) => Err(End::Left),
            Message::Frame(_) => Err(End::Dropped),
        }
    }

    fn receive_text(&mut self, text: &str) -> Result<(), End> {
        let (message_verb, argument) = text.split_once(' ').ok_or(End::Dropped)?;
        if message_verb == "ping" {
            let sent_time: f64 = argument.parse().map_err(|_| End::Dropped)?;
            return self.send_text(format!("pong {sent_time} {}", self.shared.now()));
        }
        let key_number: usize = argument.parse().map_err(|_| End::Dropped)?;
        let page_key = self.shared.options.keys.get(key_number).ok_or(End::Dropped)?;
        match message_verb {
            "hold" if self.holds[key_number] => Ok(()),
            "hold" if page_key.hold() => {
                self.holds[key_number] = true;
                Ok(())
            }
            "hold" => self.send_text(format!("taken {key_number}")),
            "leave" => {
                if std::mem::take(&mut self.holds[key_number]) {
                    page_key.leave();
                }
                Ok(())
            }
            _ => Err(End::Dropped),
        }
    }

    /// Moves a key by the positions of a pointer, if this page holds it.
    fn play(&mut self, played: &Played) -> Result<(), End> {
        let page_key = self.shared.options.keys.get(played.key).ok_or(End::Dropped)?;
        let time_now = self.shared.now();
        for &(time, x, pressure) in &played.positions {
            let is_taken = if self.holds[played.key] {
                page_key.place(time_now - time, x, pressure)
            } else {
                page_key.refuse();
                false
            };
            self.refused += usize::from(!is_taken);
        }
        if self.refused > REFUSED_MAX {
            return Err(End::Dropped);
        }
        Ok(())
    }

    fn send_text(&mut self, text: String) -> Result<(), End> {
        let send_result = self.socket.send(Message::text(text));
        send_result.map_err(|error| ended(&error))
    }

    /// For each key: whether this page (1), another (2) or none (0) holds it; pointer, finger, key [m] and force [N].
    fn picture(&self) -> Bytes {
        let mut picture_bytes = Vec::with_capacity(17 * self.holds.len());
        for (key, &holds) in self.shared.options.keys.iter().zip(&self.holds) {
            picture_bytes.push(match (holds, key.is_held()) {
                (true, _) => 1,
                (false, true) => 2,
                (false, false) => 0,
            });
            let key_points = key.points();
            for point in [key_points.pointer, key_points.finger, key_points.key, key_points.force] {
                picture_bytes.extend((point as f32).to_le_bytes());
            }
        }
        picture_bytes.into()
    }

    fn leave_all(&mut self) {
        for (key, holds) in self.shared.options.keys.iter().zip(&mut self.holds) {
            if std::mem::take(holds) {
                key.leave();
            }
        }
    }
}

impl Drop for Page<'_> {
    fn drop(&mut self) {
        self.leave_all();
    }
}
