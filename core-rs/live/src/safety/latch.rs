//! Why the force of an axis is held at zero, and which trips only the player can end.

use std::time::Duration;

/// Why the forces of an axis are held at zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TripCause {
    /// The force asked for, or the position, is not finite.
    NotFinite,
    /// The key was too fast.
    Speed,
    /// The motor pushes in the opposite direction of its command.
    WrongWay,
    /// The key rests at its stop, and the force pushes it further.
    AtStop,
    /// The sensor shows the same position whatever the force.
    Frozen,
    /// The key does not answer its motor.
    Unanswered,
    /// The force or the position comes late.
    Late,
    /// The position is outside the travel of the key.
    OutsideTravel,
    /// The position jumped as no force could move the key.
    Jump,
}

impl TripCause {
    /// Whether the motor may not do what it is commanded.
    pub(super) fn is_of_motor(self) -> bool {
        matches!(self, Self::WrongWay | Self::Unanswered | Self::Late | Self::Frozen)
    }

    /// Whether only the player can let the axis push again, after the first trip already.
    pub(super) fn is_permanent(self) -> bool {
        matches!(
            self,
            Self::WrongWay | Self::Unanswered | Self::Late | Self::OutsideTravel | Self::Jump
        )
    }
}

/// An axis that trips this often within `TRIP_WINDOW` stays off.
const TRIPS_MAX: usize = 3;
const TRIP_WINDOW: Duration = Duration::from_secs(60);

/// The latest trips of an axis, and why it stays off, if it does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct TripLatch {
    /// Times of the trips before, the newest first.
    earlier_trip_times: [Option<Duration>; TRIPS_MAX - 1],
    permanent_trip: Option<TripCause>,
}

impl TripLatch {
    /// Note a trip: a fault of motor, sensor or travel stays at once, any other with the third trip within a minute.
    pub(super) fn record_trip(&mut self, trip: TripCause, now: Duration) {
        let oldest_trip = self.earlier_trip_times[TRIPS_MAX - 2];
        let is_frequent = oldest_trip.is_some_and(|trip_time| now.saturating_sub(trip_time) <= TRIP_WINDOW);
        if trip.is_permanent() || is_frequent {
            self.permanent_trip = self.permanent_trip.or(Some(trip));
        }
        self.earlier_trip_times.rotate_right(1);
        self.earlier_trip_times[0] = Some(now);
    }

    /// Why the axis stays off, if it does.
    pub(super) fn permanent_trip(&self) -> Option<TripCause> {
        self.permanent_trip
    }

    /// The same latch, with the times of earlier trips forgotten: for another clock.
    pub(super) fn without_times(&self) -> Self {
        Self {
            permanent_trip: self.permanent_trip,
            ..Self::default()
        }
    }
}
