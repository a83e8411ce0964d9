//! Messages for all viewers, stored once: a late viewer skips frames, and learns how many other messages it missed.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Whether a message still matters after a later one of its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Events: every one matters.
    All,
    /// Events with a key state: new viewers begin here.
    Key,
    /// Frames: only the latest matters.
    Latest,
}

/// Largest size of the stored messages [bytes]: some seconds of the largest piece.
const BYTES_MAX: usize = 16 << 20;

/// Numbered messages; their total size is bounded, whatever viewers do.
#[derive(Default)]
pub struct Hub {
    inner: Mutex<Inner>,
    changed: Condvar,
}

#[derive(Default)]
struct Inner {
    /// Number of the oldest message in `held`.
    first: u64,
    /// The messages; `None` for a frame that a later one has replaced.
    held: VecDeque<Option<Arc<[u8]>>>,
    bytes: usize,
    latest: Option<u64>,
    /// Number of the newest key state.
    key: Option<u64>,
    greeting: Option<Arc<[u8]>>,
    /// Number of greetings so far, and the number of the first message after the last greeting.
    greetings: u64,
    begin: u64,
    closed: bool,
}

impl Inner {
    /// Where a new viewer can begin: the newest key state, if it is still stored.
    fn restart_point(&self) -> Option<u64> {
        self.key.filter(|key| *key >= self.first)
    }
}

/// The progress of one viewer.
#[derive(Debug, Default)]
pub struct Cursor {
    next: u64,
    /// Number of the greeting that it was sent.
    greeted: u64,
}

/// The next item for a viewer.
#[derive(Debug, PartialEq)]
pub enum Next {
    /// A message.
    Message(Arc<[u8]>),
    /// So many messages were dropped before this viewer got them.
    Lost(u64),
    /// No message came within the time.
    Nothing,
    /// The hub is closed: no message will come.
    Closed,
}

impl Hub {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets what every viewer is sent first: the manifest and its tables. Messages from before the greeting are
    /// dropped.
    pub fn greet(&self, bytes: &[u8]) {
        let mut inner = self.inner();
        inner.greeting = Some(bytes.into());
        inner.greetings += 1;
        inner.first += inner.held.len() as u64;
        inner.begin = inner.first;
        inner.held.clear();
        inner.bytes = 0;
        (inner.latest, inner.key) = (None, None);
        drop(inner);
        self.changed.notify_all();
    }

    /// Sends a message to all viewers.
    pub fn publish(&self, bytes: &[u8], keep: Keep) {
        let mut inner = self.inner();
        let message_number = inner.first + inner.held.len() as u64;
        if keep == Keep::Latest
            && let Some(latest_before) = inner.latest.replace(message_number)
            && let Some(latest_offset) = latest_before.checked_sub(inner.first)
            && let Some(stale_frame) = inner.held[latest_offset as usize].take()
        {
            inner.bytes -= stale_frame.len();
        }
        if keep == Keep::Key {
            inner.key = Some(message_number);
        }
        inner.bytes += bytes.len();
        inner.held.push_back(Some(bytes.into()));
        while inner.bytes > BYTES_MAX || inner.held.len() > BYTES_MAX / 64 {
            let oldest_message = inner.held.pop_front().flatten();
            inner.bytes -= oldest_message.map_or(0, |bytes| bytes.len());
            inner.first += 1;
        }
        drop(inner);
        self.changed.notify_all();
    }

    /// The cursor of a new viewer.
    pub fn join(&self) -> Cursor {
        let inner = self.inner();
        let end_number = inner.first + inner.held.len() as u64;
        Cursor {
            next: inner.restart_point().unwrap_or(end_number),
            greeted: 0,
        }
    }

    /// Waits for the next item of a viewer.
    pub fn take(&self, cursor: &mut Cursor, within: Duration) -> Next {
        let must_wait = |inner: &mut Inner| {
            !inner.closed && inner.first + inner.held.len() as u64 == cursor.next && cursor.greeted == inner.greetings
        };
        let (inner, _) = self
            .changed
            .wait_timeout_while(self.inner(), within, must_wait)
            .unwrap_or_else(PoisonError::into_inner);
        if inner.closed {
            return Next::Closed;
        }
        if cursor.greeted != inner.greetings
            && let Some(greeting) = &inner.greeting
        {
            cursor.greeted = inner.greetings;
            cursor.next = cursor.next.max(inner.begin);
            return Next::Message(greeting.clone());
        }
        if cursor.next < inner.first {
            // From the newest key state on, the viewer has a complete state again.
            let next_number = inner.restart_point().unwrap_or(inner.first);
            let lost_messages = next_number - cursor.next;
            cursor.next = next_number;
            return Next::Lost(lost_messages);
        }
        let held_offset = (cursor.next - inner.first) as usize;
        for message in inner.held.iter().skip(held_offset) {
            cursor.next += 1;
            if let Some(message_bytes) = message {
                return Next::Message(message_bytes.clone());
            }
        }
        Next::Nothing
    }

    /// Ends the connections of all viewers.
    pub fn close(&self) {
        self.inner().closed = true;
        self.changed.notify_all();
    }

    /// Total size of the stored messages.
    pub fn bytes(&self) -> usize {
        self.inner().bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(hub: &Hub, cursor: &mut Cursor) -> Vec<Next> {
        let mut items_taken = Vec::new();
        loop {
            match hub.take(cursor, Duration::ZERO) {
                Next::Nothing => return items_taken,
                next => items_taken.push(next),
            }
        }
    }

    fn message(text: &str) -> Next {
        Next::Message(text.as_bytes().into())
    }

    #[test]
    fn late_viewer_receives_events_and_the_latest_frame() {
        let hub = Hub::default();
        hub.greet(b"manifest");
        let mut late_cursor = hub.join();
        let mut prompt_cursor = hub.join();
        let mut seen_items = Vec::new();
        for i in 0..5 {
            hub.publish(format!("event {i}").as_bytes(), Keep::All);
            hub.publish(format!("frame {i}").as_bytes(), Keep::Latest);
            seen_items.extend(all(&hub, &mut prompt_cursor));
        }
        assert_eq!(seen_items.len(), 11);
        let event_texts = ["manifest", "event 0", "event 1", "event 2", "event 3"];
        let mut expected: Vec<_> = event_texts.map(message).into();
        expected.extend(["event 4", "frame 4"].map(message));
        assert_eq!(all(&hub, &mut late_cursor), expected);
    }

    #[test]
    fn hub_is_bounded_and_reports_lost_events() {
        let hub = Hub::default();
        let mut stalled = hub.join();
        let large_event = vec![7; 1 << 20];
        for _ in 0..100 {
            hub.publish(&large_event, Keep::All);
            assert!(hub.bytes() <= BYTES_MAX);
        }
        let items_taken = all(&hub, &mut stalled);
        assert_eq!(items_taken[0], Next::Lost(84));
        assert_eq!(items_taken.len(), 17);
    }

    #[test]
    fn late_viewer_begins_with_the_newest_key_state() {
        let hub = Hub::default();
        hub.greet(b"manifest");
        let mut stalled = hub.join();
        hub.publish(b"first key", Keep::Key);
        hub.publish(b"event 0", Keep::All);
        hub.publish(b"second key", Keep::Key);
        hub.publish(b"event 1", Keep::All);
        let expected = ["manifest", "second key", "event 1"].map(message);
        assert_eq!(all(&hub, &mut hub.join()), expected);
        // A viewer that missed messages also begins at the key state.
        let large_event = vec![7; 1 << 20];
        for _ in 0..18 {
            hub.publish(&large_event, Keep::All);
        }
        hub.publish(b"third key", Keep::Key);
        assert_eq!(
            all(&hub, &mut stalled),
            [message("manifest"), Next::Lost(22), message("third key")]
        );
    }

    #[test]
    fn greet_drops_earlier_messages() {
        let hub = Hub::default();
        hub.greet(b"one");
        hub.publish(b"key of one", Keep::Key);
        let (mut prompt_cursor, mut slow_cursor) = (hub.join(), hub.join());
        assert_eq!(all(&hub, &mut prompt_cursor), ["one", "key of one"].map(message));
        hub.publish(b"event of one", Keep::All);
        hub.greet(b"two");
        assert_eq!(hub.bytes(), 0);
        hub.publish(b"key of two", Keep::Key);
        for cursor in [&mut prompt_cursor, &mut slow_cursor, &mut hub.join()] {
            assert_eq!(all(&hub, cursor), ["two", "key of two"].map(message));
        }
    }

    #[test]
    fn latest_frames_replace_each_other() {
        let hub = Hub::default();
        for _ in 0..1000 {
            hub.publish(&vec![1; 500_000], Keep::Latest);
            assert_eq!(hub.bytes(), 500_000);
        }
    }

    #[test]
    fn closed_hub_ends_waiting_viewers() {
        let hub = Hub::default();
        let mut viewer_cursor = hub.join();
        hub.close();
        assert_eq!(hub.take(&mut viewer_cursor, Duration::MAX), Next::Closed);
    }
}
