//! Statistics of a device's wire; they are counted here and judged elsewhere.

use std::time::{Duration, Instant};

/// A histogram of durations, by powers of two of a microsecond.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DurationHistogram {
    /// Number of durations of at least 2^i µs and less than 2^(i+1) µs; the first also counts those below 1 µs.
    pub counts: [u64; 24],
    /// The longest duration.
    pub longest: Duration,
}

impl DurationHistogram {
    fn add(&mut self, duration: Duration) {
        let microseconds = u64::try_from(duration.as_micros()).unwrap_or(u64::MAX).max(1);
        let bin_index = (microseconds.ilog2() as usize).min(self.counts.len() - 1);
        self.counts[bin_index] += 1;
        self.longest = self.longest.max(duration);
    }

    /// Number of durations.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// A duration that the share `probability` (0 to 1) of them does not exceed, accurate to a factor of two.
    pub fn quantile(&self, probability: f64) -> Duration {
        let wanted_count = (self.total() as f64 * probability).ceil() as u64;
        let mut cumulative = 0;
        for (bin, count) in self.counts.iter().enumerate() {
            cumulative += count;
            if cumulative >= wanted_count {
                return Duration::from_micros(2 << bin).min(self.longest);
            }
        }
        self.longest
    }
}

/// Statistics of a device's wire so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WireStats {
    /// Packets sent.
    pub packets_sent: u64,
    /// Complete replies.
    pub replies_received: u64,
    /// Requests without a reply.
    pub requests_lost: u64,
    /// Bytes that do not belong to a packet.
    pub garbage_bytes: u64,
    /// Time from a force sent to its reply. For protocols that echo no number: from the latest force sent.
    pub round_trip: DurationHistogram,
    /// How much faster the device's clock runs than the host's [1e-6]; known after a second.
    pub drift_ppm: Option<f64>,
}

impl WireStats {
    /// Add the time that a reply took.
    pub(crate) fn add_round_trip(&mut self, duration: Duration) {
        self.round_trip.add(duration);
    }
}

/// The drift of the device's clock against the host's.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClockDrift {
    /// The instant of the first reading, and the reading before this one [µs].
    first_and_previous: Option<(Instant, u32)>,
    elapsed_us: u64,
}

impl ClockDrift {
    /// Add a reading of the device's clock; returns the drift so far.
    pub(crate) fn add(&mut self, now: Instant, clock_us: u32) -> Option<f64> {
        let Some((first_instant, previous_us)) = self.first_and_previous else {
            self.first_and_previous = Some((now, clock_us));
            return None;
        };
        // The clock wraps every 71 minutes: only differences count.
        self.elapsed_us += u64::from(clock_us.wrapping_sub(previous_us));
        self.first_and_previous = Some((first_instant, clock_us));
        let host_elapsed = now.duration_since(first_instant).as_secs_f64() * 1e6;
        (host_elapsed >= 1e6).then(|| (self.elapsed_us as f64 / host_elapsed - 1.0) * 1e6)
    }
}

/// A reply to one of this many latest requests is late; otherwise it belongs to another program.
const LATE_REQUESTS_MAX: u16 = 8192;
/// Value of `SentRequests::foreign_balance` above which the device is shared; fewer may be leftovers of an earlier
/// session.
const SHARED_BALANCE_MIN: u32 = 32;

/// When the latest requests were sent, by their numbers.
#[derive(Clone, Debug)]
pub(crate) struct SentRequests {
    instants: [Option<Instant>; 256],
    next_number: u16,
    /// Twice the number of replies to requests of others, less the number of replies to our own, at least 0; `None`
    /// before our first reply.
    foreign_balance: Option<u32>,
}

impl Default for SentRequests {
    fn default() -> Self {
        Self {
            instants: [None; 256],
            next_number: 0,
            foreign_balance: None,
        }
    }
}

impl SentRequests {
    /// Number a request that is sent now.
    pub(crate) fn number_request(&mut self, now: Instant, stats: &mut WireStats) -> u16 {
        let request_number = self.next_number;
        let instant_slot = &mut self.instants[usize::from(request_number % 256)];
        stats.requests_lost += u64::from(instant_slot.is_some());
        *instant_slot = Some(now);
        stats.packets_sent += 1;
        self.next_number = request_number.wrapping_add(1);
        request_number
    }

    /// Note a reply; returns whether it answers one of the latest requests, for the first time.
    pub(crate) fn note_reply(&mut self, number: u16, now: Instant, stats: &mut WireStats) -> bool {
        let request_age = self.next_number.wrapping_sub(number);
        if request_age > 256 && request_age <= LATE_REQUESTS_MAX && u64::from(request_age) <= stats.packets_sent {
            // A board that was held up answers old requests, for which nobody waits any more.
            return false;
        }
        if request_age == 0 || request_age > 256 {
            self.foreign_balance = self
                .foreign_balance
                .map(|foreign_balance| foreign_balance.saturating_add(2));
            return false;
        }
        let Some(send_instant) = self.instants[usize::from(number % 256)].take() else {
            return false;
        };
        stats.replies_received += 1;
        stats.add_round_trip(now.duration_since(send_instant));
        self.foreign_balance = Some(self.foreign_balance.unwrap_or(0).saturating_sub(1));
        true
    }

    /// Whether the device answers other programs more than half as often as this one, for some time.
    pub(crate) fn is_shared(&self) -> bool {
        self.foreign_balance
            .is_some_and(|foreign_balance| foreign_balance > SHARED_BALANCE_MIN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stats_count_replies_and_losses() {
        let (mut sent_requests, mut stats) = (SentRequests::default(), WireStats::default());
        let first_instant = Instant::now();
        for i in 0..1000_u64 {
            let send_instant = first_instant + Duration::from_millis(i);
            let request_number = sent_requests.number_request(send_instant, &mut stats);
            let reply_instant = send_instant + Duration::from_micros(100);
            if i % 10 != 0 {
                assert!(sent_requests.note_reply(request_number, reply_instant, &mut stats));
                assert!(
                    !sent_requests.note_reply(request_number, reply_instant, &mut stats),
                    "one again"
                );
            }
        }
        assert_eq!((stats.packets_sent, stats.replies_received), (1000, 900));
        // A lost request is counted when its slot is used again.
        assert_eq!(stats.requests_lost, (0..744).filter(|i| i % 10 == 0).count() as u64);
        assert_eq!(stats.round_trip.total(), 900);
        assert_eq!(stats.round_trip.quantile(0.5), Duration::from_micros(100));
    }

    #[test]
    fn stats_detect_replies_to_another_host() {
        let (mut sent_requests, mut stats) = (SentRequests::default(), WireStats::default());
        let test_instant = Instant::now();
        // Leftover replies of another session come first.
        for request_number in 30_000..30_100 {
            assert!(!sent_requests.note_reply(request_number, test_instant, &mut stats));
        }
        for _ in 0..1000 {
            let request_number = sent_requests.number_request(test_instant, &mut stats);
            assert!(sent_requests.note_reply(request_number, test_instant, &mut stats));
        }
        assert!(!sent_requests.is_shared());
        for other in 0..40 {
            let request_number = sent_requests.number_request(test_instant, &mut stats);
            assert!(!sent_requests.note_reply(40_000 + other, test_instant, &mut stats));
            assert!(sent_requests.note_reply(request_number, test_instant, &mut stats));
        }
        assert!(sent_requests.is_shared());
    }

    #[test]
    fn stats_accept_replies_of_a_stalled_board() {
        let (mut sent_requests, mut stats) = (SentRequests::default(), WireStats::default());
        let test_instant = Instant::now();
        assert_eq!(sent_requests.number_request(test_instant, &mut stats), 0);
        assert!(sent_requests.note_reply(0, test_instant, &mut stats));
        for _ in 0..1000 {
            sent_requests.number_request(test_instant, &mut stats);
        }
        for number in 1..=1000 {
            assert_eq!(sent_requests.note_reply(number, test_instant, &mut stats), number > 744);
        }
        assert!(!sent_requests.is_shared());
    }

    #[test]
    fn drift_across_the_wrap_of_the_clock() {
        let (mut clock_drift, first_instant) = (ClockDrift::default(), Instant::now());
        let mut last_drift = None;
        for ms in 0..5000_u64 {
            let host_instant = first_instant + Duration::from_millis(ms);
            let device_clock = (u64::from(u32::MAX) - 1_000_000 + ms * 1000 + ms / 10) as u32;
            last_drift = clock_drift.add(host_instant, device_clock);
        }
        assert!((last_drift.unwrap() - 100.0).abs() < 1.0, "{last_drift:?}");
    }
}
