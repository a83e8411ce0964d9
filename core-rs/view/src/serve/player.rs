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
    let limits = shared.options.limits;
    let fit = stream.set_write_timeout(Some(limits.stall)).is_ok()
        && stream.set_read_timeout(Some(READ_TIMEOUT)).is_ok()
        && stream.set_nodelay(true).is_ok();
    let config = WebSocketConfig::default()
        .read_buffer_size(1 << 12)
        .write_buffer_size(0)
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX));
    let mut page = Page {
        socket: WebSocket::from_partially_read(stream, rest, Role::Server, Some(config)),
        shared,
        holds: vec![false; shared.options.keys.len()],
        refused: 0,
    };
    if fit && let End::Dropped = page.run() {
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
                let played = keys::parse(bytes).ok_or(End::Dropped)?;
                self.play(&played)
            }
            Message::Ping(_) | Message::Pong(_) => Ok(()),
            Message::Close(_) => Err(End::Left),
            Message::Frame(_) => Err(End::Dropped),
        }
    }

    fn receive_text(&mut self, text: &str) -> Result<(), End> {
        let (verb, argument) = text.split_once(' ').ok_or(End::Dropped)?;
        if verb == "ping" {
            let sent: f64 = argument.parse().map_err(|_| End::Dropped)?;
            return self.say(format!("pong {sent} {}", self.shared.now()));
        }
        let number: usize = argument.parse().map_err(|_| End::Dropped)?;
        let key = self.shared.options.keys.get(number).ok_or(End::Dropped)?;
        match verb {
            "hold" if self.holds[number] => Ok(()),
            "hold" if key.hold() => {
                self.holds[number] = true;
                Ok(())
            }
            "hold" => self.say(format!("taken {number}")),
            "leave" => {
                if std::mem::take(&mut self.holds[number]) {
                    key.leave();
                }
                Ok(())
            }
            _ => Err(End::Dropped),
        }
    }

    /// Moves a key by the positions of a pointer, if this page holds it.
    fn play(&mut self, played: &Played) -> Result<(), End> {
        let key = self
            .shared
            .options
            .keys
            .get(played.key)
            .ok_or(End::Dropped)?;
        let now = self.shared.now();
        for &(time, x, pressure) in &played.positions {
            let is_taken = if self.holds[played.key] {
                key.place(now - time, x, pressure)
            } else {
                key.refuse();
                false
            };
            self.refused += usize::from(!is_taken);
        }
        if self.refused > REFUSED_MAX {
            return Err(End::Dropped);
        }
        Ok(())
    }

    fn say(&mut self, text: String) -> Result<(), End> {
        let sent = self.socket.send(Message::text(text));
        sent.map_err(|error| ended(&error))
    }

    /// For each key: whether this page (1), another (2) or none (0) holds it; pointer, finger, key [m] and force [N].
    fn picture(&self) -> Bytes {
        let mut bytes = Vec::with_capacity(17 * self.holds.len());
        for (key, &holds) in self.shared.options.keys.iter().zip(&self.holds) {
            bytes.push(match (holds, key.is_held()) {
                (true, _) => 1,
                (false, true) => 2,
                (false, false) => 0,
            });
            let points = key.points();
            for point in [points.pointer, points.finger, points.key, points.force] {
                bytes.extend((point as f32).to_le_bytes());
            }
        }
        bytes.into()
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
