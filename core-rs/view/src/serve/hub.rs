//! Messages for all viewers, stored once: a late viewer skips frames, and learns how many other messages it missed.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Whether a message still matters after a later one of its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Retention {
    /// Events: every one matters.
    All,
    /// Events with a key state: new viewers begin here.
    KeyState,
    /// Frames: only the latest matters.
    Latest,
}

/// Largest size of the stored messages [bytes]: some seconds of the largest piece.
const STORED_BYTES_MAX: usize = 16 << 20;

/// Numbered messages; their total size is bounded, whatever viewers do.
#[derive(Default)]
pub struct MessageHub {
    state: Mutex<HubState>,
    state_change: Condvar,
}

#[derive(Default)]
struct HubState {
    /// Number of the oldest message in `messages`.
    first_number: u64,
    /// The messages; `None` for a frame that a later one has replaced.
    messages: VecDeque<Option<Arc<[u8]>>>,
    stored_bytes: usize,
    latest_frame: Option<u64>,
    /// Number of the newest key state.
    newest_key_state: Option<u64>,
    greeting: Option<Arc<[u8]>>,
    /// Number of greetings so far, and the number of the first message after the last greeting.
    n_greetings: u64,
    greeting_number: u64,
    is_closed: bool,
}

impl HubState {
    /// Where a new viewer can begin: the newest key state, if it is still stored.
    fn restart_number(&self) -> Option<u64> {
        self.newest_key_state.filter(|key| *key >= self.first_number)
    }
}

/// The progress of one viewer.
#[derive(Debug, Default)]
pub struct ViewerCursor {
    next_number: u64,
    /// Number of the greeting that it was sent.
    n_greetings: u64,
}

/// The next item for a viewer.
#[derive(Debug, PartialEq)]
pub enum NextMessage {
    /// A message.
    Message(Arc<[u8]>),
    /// So many messages were dropped before this viewer got them.
    Lost(u64),
    /// No message came within the time.
    Nothing,
    /// The hub is closed: no message will come.
    Closed,
}

impl MessageHub {
    fn lock_state(&self) -> MutexGuard<'_, HubState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets what every viewer is sent first: the manifest and its tables. Messages from before the greeting are
    /// dropped.
    pub fn set_greeting(&self, bytes: &[u8]) {
        let mut state = self.lock_state();
        state.greeting = Some(bytes.into());
        state.n_greetings += 1;
        state.first_number += state.messages.len() as u64;
        state.greeting_number = state.first_number;
        state.messages.clear();
        state.stored_bytes = 0;
        (state.latest_frame, state.newest_key_state) = (None, None);
        drop(state);
        self.state_change.notify_all();
    }

    /// Sends a message to all viewers.
    pub fn publish(&self, bytes: &[u8], retention: Retention) {
        let mut state = self.lock_state();
        let message_number = state.first_number + state.messages.len() as u64;
        if retention == Retention::Latest
            && let Some(previous_frame) = state.latest_frame.replace(message_number)
            && let Some(latest_offset) = previous_frame.checked_sub(state.first_number)
            && let Some(stale_frame) = state.messages[latest_offset as usize].take()
        {
            state.stored_bytes -= stale_frame.len();
        }
        if retention == Retention::KeyState {
            state.newest_key_state = Some(message_number);
        }
        state.stored_bytes += bytes.len();
        state.messages.push_back(Some(bytes.into()));
        while state.stored_bytes > STORED_BYTES_MAX || state.messages.len() > STORED_BYTES_MAX / 64 {
            let oldest_message = state.messages.pop_front().flatten();
            state.stored_bytes -= oldest_message.map_or(0, |bytes| bytes.len());
            state.first_number += 1;
        }
        drop(state);
        self.state_change.notify_all();
    }

    /// The cursor of a new viewer.
    pub fn new_cursor(&self) -> ViewerCursor {
        let state = self.lock_state();
        let end_number = state.first_number + state.messages.len() as u64;
        ViewerCursor {
            next_number: state.restart_number().unwrap_or(end_number),
            n_greetings: 0,
        }
    }

    /// Waits for the next item of a viewer.
    pub fn next_message(&self, cursor: &mut ViewerCursor, timeout: Duration) -> NextMessage {
        let must_wait = |inner: &mut HubState| {
            !inner.is_closed
                && inner.first_number + inner.messages.len() as u64 == cursor.next_number
                && cursor.n_greetings == inner.n_greetings
        };
        let (state, _) = self
            .state_change
            .wait_timeout_while(self.lock_state(), timeout, must_wait)
            .unwrap_or_else(PoisonError::into_inner);
        if state.is_closed {
            return NextMessage::Closed;
        }
        if cursor.n_greetings != state.n_greetings
            && let Some(greeting) = &state.greeting
        {
            cursor.n_greetings = state.n_greetings;
            cursor.next_number = cursor.next_number.max(state.greeting_number);
            return NextMessage::Message(greeting.clone());
        }
        if cursor.next_number < state.first_number {
            // From the newest key state on, the viewer has a complete state again.
            let next_number = state.restart_number().unwrap_or(state.first_number);
            let lost_messages = next_number - cursor.next_number;
            cursor.next_number = next_number;
            return NextMessage::Lost(lost_messages);
        }
        let message_offset = (cursor.next_number - state.first_number) as usize;
        for message in state.messages.iter().skip(message_offset) {
            cursor.next_number += 1;
            if let Some(message_bytes) = message {
                return NextMessage::Message(message_bytes.clone());
            }
        }
        NextMessage::Nothing
    }

    /// Ends the connections of all viewers.
    pub fn close(&self) {
        self.lock_state().is_closed = true;
        self.state_change.notify_all();
    }

    /// Total size of the stored messages.
    pub fn stored_bytes(&self) -> usize {
        self.lock_state().stored_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(hub: &MessageHub, cursor: &mut ViewerCursor) -> Vec<NextMessage> {
        let mut items_taken = Vec::new();
        loop {
            match hub.next_message(cursor, Duration::ZERO) {
                NextMessage::Nothing => return items_taken,
                next => items_taken.push(next),
            }
        }
    }

    fn message(text: &str) -> NextMessage {
        NextMessage::Message(text.as_bytes().into())
    }

    #[test]
    fn late_viewer_receives_events_and_the_latest_frame() {
        let hub = MessageHub::default();
        hub.set_greeting(b"manifest");
        let mut late_cursor = hub.new_cursor();
        let mut prompt_cursor = hub.new_cursor();
        let mut seen_items = Vec::new();
        for i in 0..5 {
            hub.publish(format!("event {i}").as_bytes(), Retention::All);
            hub.publish(format!("frame {i}").as_bytes(), Retention::Latest);
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
        let hub = MessageHub::default();
        let mut stalled = hub.new_cursor();
        let large_event = vec![7; 1 << 20];
        for _ in 0..100 {
            hub.publish(&large_event, Retention::All);
            assert!(hub.stored_bytes() <= STORED_BYTES_MAX);
        }
        let items_taken = all(&hub, &mut stalled);
        assert_eq!(items_taken[0], NextMessage::Lost(84));
        assert_eq!(items_taken.len(), 17);
    }

    #[test]
    fn late_viewer_begins_with_the_newest_key_state() {
        let hub = MessageHub::default();
        hub.set_greeting(b"manifest");
        let mut stalled = hub.new_cursor();
        hub.publish(b"first key", Retention::KeyState);
        hub.publish(b"event 0", Retention::All);
        hub.publish(b"second key", Retention::KeyState);
        hub.publish(b"event 1", Retention::All);
        let expected = ["manifest", "second key", "event 1"].map(message);
        assert_eq!(all(&hub, &mut hub.new_cursor()), expected);
        // A viewer that missed messages also begins at the key state.
        let large_event = vec![7; 1 << 20];
        for _ in 0..18 {
            hub.publish(&large_event, Retention::All);
        }
        hub.publish(b"third key", Retention::KeyState);
        assert_eq!(
            all(&hub, &mut stalled),
            [message("manifest"), NextMessage::Lost(22), message("third key")]
        );
    }

    #[test]
    fn greet_drops_earlier_messages() {
        let hub = MessageHub::default();
        hub.set_greeting(b"one");
        hub.publish(b"key of one", Retention::KeyState);
        let (mut prompt_cursor, mut slow_cursor) = (hub.new_cursor(), hub.new_cursor());
        assert_eq!(all(&hub, &mut prompt_cursor), ["one", "key of one"].map(message));
        hub.publish(b"event of one", Retention::All);
        hub.set_greeting(b"two");
        assert_eq!(hub.stored_bytes(), 0);
        hub.publish(b"key of two", Retention::KeyState);
        for cursor in [&mut prompt_cursor, &mut slow_cursor, &mut hub.new_cursor()] {
            assert_eq!(all(&hub, cursor), ["two", "key of two"].map(message));
        }
    }

    #[test]
    fn latest_frames_replace_each_other() {
        let hub = MessageHub::default();
        for _ in 0..1000 {
            hub.publish(&vec![1; 500_000], Retention::Latest);
            assert_eq!(hub.stored_bytes(), 500_000);
        }
    }

    #[test]
    fn closed_hub_ends_waiting_viewers() {
        let hub = MessageHub::default();
        let mut viewer_cursor = hub.new_cursor();
        hub.close();
        assert_eq!(hub.next_message(&mut viewer_cursor, Duration::MAX), NextMessage::Closed);
    }
}
