//! The stream of positions on its way from a pointer to the real-time thread, and the points that come back.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Instant;

use ergon_view::serve::{KeyPoints, PageKey};

use super::arrival::{ArrivalHistograms, ArrivalTimes};
use super::finger::{FIRMNESS_MAX, FingerConstants, HeldKey};
use super::path::PointerPosition;
use super::trace::{TRACE_COLUMNS, Trace};

/// Positions that wait for the real-time thread: at 1,000 a second, those of four seconds.
const WAITING_POSITIONS_MAX: usize = 4_096;
/// Greatest lasting number of positions a second, and how many may come at once.
const POSITION_RATE_MAX: f64 = 4_000.0;
const POSITION_BURST_MAX: f64 = 1_024.0;
/// A time stamp may be this much older or newer than its arrival [s]; others are wrong.
const STAMP_AGE_MAX: f64 = 0.5;
const STAMP_LEAD_MAX: f64 = 0.005;
/// Least distance of two time stamps [s].
const STAMP_GAP_MIN: f64 = 1e-6;
/// Range of the factor of a finger's stiffness.
const FIRMNESS_RANGE: (f64, f64) = (0.1, FIRMNESS_MAX);
/// Gaps between positions that are longer are pauses of the player, not the rate of the pointer [s].
const PAUSE_MIN: f64 = 0.1;

/// How a key is led.
#[derive(Clone, Debug, PartialEq)]
pub struct PointerStreamOptions {
    /// The address of the key, such as `page:ada`.
    pub address: String,
    /// The finger between pointer and key.
    pub finger: FingerConstants,
    /// Delay with which the path is read [s].
    pub delay: f64,
    /// The key that the finger holds.
    pub key: HeldKey,
    /// Whether time is that of the ticks; otherwise it is that of the wall.
    pub in_lockstep: bool,
    /// Number of ticks that are kept for measurements.
    pub traced_ticks: usize,
}

/// Counts of positions, and the statistics of their arrival.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointerTally {
    /// Positions taken.
    pub accepted: u64,
    /// Positions refused: not finite, too many, or another's key.
    pub refused: u64,
    /// Positions whose time stamps were impossible; the time of their arrival counted.
    pub misdated: u64,
    /// Positions that came later than the path needed them.
    pub late: u64,
    /// Mean gap between positions while the pointer moved [s]; 0: none.
    pub mean_interval: f64,
    /// Standard deviation of these gaps [s].
    pub interval_deviation: f64,
}

/// Why a position was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PositionRefusal {
    /// A number is not finite.
    #[error("a position has to be a finite number")]
    NotFinite,
    /// More positions than a pointer can send.
    #[error("more than 4,000 positions a second")]
    TooMany,
}

/// A stream of positions that leads the finger on a key.
#[derive(Debug)]
pub struct PointerStream {
    options: PointerStreamOptions,
    epoch: Instant,
    feeder: Mutex<PointerFeeder>,
    /// Slots for positions; each is time, position and firmness.
    slots: Box<[PositionSlot]>,
    /// Numbers of positions written and read so far.
    n_written: AtomicU64,
    n_read: AtomicU64,
    is_present: AtomicBool,
    n_late: AtomicU64,
    /// Pointer, finger and key [m], and the force of the pointer on the finger [N]; not a number: no finger there.
    points: [AtomicU64; 4],
    trace: Trace,
}

/// A position between its writer and its reader, as bits of numbers.
#[derive(Debug, Default)]
struct PositionSlot {
    time: AtomicU64,
    x: AtomicU64,
    firmness: AtomicU64,
    is_lifted: AtomicBool,
}

impl PositionSlot {
    fn store(&self, position: PointerPosition) {
        let firmness = position.firmness.unwrap_or_default();
        for (cell, number) in [
            (&self.time, position.time),
            (&self.x, position.x),
            (&self.firmness, firmness),
        ] {
            cell.store(number.to_bits(), Ordering::Relaxed);
        }
        self.is_lifted.store(position.firmness.is_none(), Ordering::Relaxed);
    }

    fn load(&self) -> PointerPosition {
        let [time, x, firmness] =
            [&self.time, &self.x, &self.firmness].map(|cell| f64::from_bits(cell.load(Ordering::Relaxed)));
        let is_lifted = self.is_lifted.load(Ordering::Relaxed);
        PointerPosition {
            time,
            x,
            firmness: (!is_lifted).then_some(firmness),
        }
    }
}

#[derive(Debug, Default)]
struct PointerFeeder {
    last_time: f64,
    burst_tokens: f64,
    refill_time: f64,
    tally: PointerTally,
    /// Number, sum and sum of squares of gaps.
    interval_moments: [f64; 3],
    arrivals: ArrivalHistograms,
}

/// The leads of this process by their names, so that a driver finds its stream as it would find a port.
static POINTER_STREAMS: Mutex<BTreeMap<String, Weak<PointerStream>>> = Mutex::new(BTreeMap::new());

fn pointer_streams() -> MutexGuard<'static, BTreeMap<String, Weak<PointerStream>>> {
    POINTER_STREAMS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The lead of a name.
pub fn find(name: &str) -> Option<Arc<PointerStream>> {
    pointer_streams().get(name)?.upgrade()
}

impl PointerStream {
    /// A new stream; `None` if there is one of this name. A page's key waits for its page, others are there at once.
    pub fn new(options: PointerStreamOptions, is_present: bool) -> Option<Arc<Self>> {
        let mut streams = pointer_streams();
        streams.retain(|_, lead| lead.strong_count() > 0);
        if streams.contains_key(&options.address) {
            return None;
        }
        let stream_address = options.address.clone();
        let stream = Arc::new(Self {
            trace: Trace::new(options.traced_ticks),
            options,
            epoch: Instant::now(),
            feeder: Mutex::new(PointerFeeder {
                last_time: f64::NEG_INFINITY,
                burst_tokens: POSITION_BURST_MAX,
                ..PointerFeeder::default()
            }),
            slots: (0..WAITING_POSITIONS_MAX).map(|_| PositionSlot::default()).collect(),
            n_written: AtomicU64::new(0),
            n_read: AtomicU64::new(0),
            is_present: AtomicBool::new(is_present),
            n_late: AtomicU64::new(0),
            points: [f64::NAN, f64::NAN, 0.0, 0.0].map(|x| AtomicU64::new(x.to_bits())),
        });
        streams.insert(stream_address, Arc::downgrade(&stream));
        Some(stream)
    }

    /// Give the name back: another stream may have it.
    pub fn close(&self) {
        let mut streams = pointer_streams();
        let is_this_stream = |lead: &Weak<Self>| std::ptr::eq(lead.as_ptr(), self);
        if streams.get(&self.options.address).is_some_and(is_this_stream) {
            streams.remove(&self.options.address);
        }
    }

    /// How the key is led.
    pub fn options(&self) -> &PointerStreamOptions {
        &self.options
    }

    /// Time of the stream's clock [s]; not for lockstep.
    pub fn now(&self) -> f64 {
        self.epoch.elapsed().as_secs_f64()
    }

    fn feeder(&self) -> MutexGuard<'_, PointerFeeder> {
        self.feeder.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Take a position [m] of `time` [s]; positions beyond the travel are at its end. `firmness` `None`: a lift.
    ///
    /// # Errors
    /// [`PositionRefusal`] if it is not taken.
    pub fn add_position(&self, position: PointerPosition) -> Result<(), PositionRefusal> {
        let mut feeder = self.feeder();
        if !(position.time.is_finite() && position.x.is_finite() && position.firmness.is_none_or(f64::is_finite)) {
            feeder.tally.refused += 1;
            return Err(PositionRefusal::NotFinite);
        }
        let (mut stamp_time, mut arrival_time) = (position.time, position.time);
        if !self.options.in_lockstep {
            arrival_time = self.now();
            feeder.burst_tokens =
                (feeder.burst_tokens + POSITION_RATE_MAX * (arrival_time - feeder.refill_time)).min(POSITION_BURST_MAX);
            feeder.refill_time = arrival_time;
            if !(arrival_time - STAMP_AGE_MAX..=arrival_time + STAMP_LEAD_MAX).contains(&stamp_time) {
                feeder.tally.misdated += 1;
                stamp_time = arrival_time;
            }
        }
        let written_count = self.n_written.load(Ordering::Relaxed);
        let is_full = written_count - self.n_read.load(Ordering::Acquire) >= WAITING_POSITIONS_MAX as u64;
        let is_flood = !self.options.in_lockstep && feeder.burst_tokens < 1.0;
        if is_full || is_flood {
            feeder.tally.refused += 1;
            return Err(PositionRefusal::TooMany);
        }
        feeder.burst_tokens -= 1.0;
        let stamp_gap = stamp_time - feeder.last_time;
        if (STAMP_GAP_MIN..PAUSE_MIN).contains(&stamp_gap) {
            for (sum, interval_power) in feeder
                .interval_moments
                .iter_mut()
                .zip([1.0, stamp_gap, stamp_gap * stamp_gap])
            {
                *sum += interval_power;
            }
            let last_time = feeder.last_time;
            feeder.arrivals.count(last_time, stamp_time, arrival_time);
        }
        stamp_time = stamp_time.max(feeder.last_time + STAMP_GAP_MIN);
        feeder.last_time = stamp_time;
        feeder.tally.accepted += 1;
        let [lower_limit, upper_limit] = self.options.key.range;
        let slot = &self.slots[(written_count % WAITING_POSITIONS_MAX as u64) as usize];
        slot.store(PointerPosition {
            time: stamp_time,
            x: position.x.clamp(lower_limit, upper_limit),
            firmness: position
                .firmness
                .map(|firmness| firmness.clamp(FIRMNESS_RANGE.0, FIRMNESS_RANGE.1)),
        });
        self.n_written.store(written_count + 1, Ordering::Release);
        Ok(())
    }

    /// The next position, for the one reader.
    pub(crate) fn next(&self) -> Option<PointerPosition> {
        let read_count = self.n_read.load(Ordering::Relaxed);
        if read_count == self.n_written.load(Ordering::Acquire) {
            return None;
        }
        let next_slot = &self.slots[(read_count % WAITING_POSITIONS_MAX as u64) as usize];
        let position = next_slot.load();
        self.n_read.store(read_count + 1, Ordering::Release);
        Some(position)
    }

    /// Forget the positions that wait; the key's driver is the one reader, so only where it does not run.
    /// Returns the last of them: the pointer is still there.
    pub fn discard_positions(&self) -> Option<PointerPosition> {
        let mut last_position = None;
        while let Some(position) = self.next() {
            last_position = Some(position);
        }
        last_position
    }

    /// Whether a player is there.
    pub fn is_present(&self) -> bool {
        self.is_present.load(Ordering::Acquire)
    }

    /// The player has come or gone.
    pub fn set_present(&self, is_present: bool) {
        self.is_present.store(is_present, Ordering::Release);
    }

    pub(crate) fn publish(&self, points: [f64; 4], n_late: u64) {
        for (stored_point, point) in self.points.iter().zip(points) {
            stored_point.store(point.to_bits(), Ordering::Relaxed);
        }
        self.n_late.store(n_late, Ordering::Relaxed);
    }

    /// The quantile `probability` of the times in which positions arrived.
    pub fn arrival_times(&self, probability: f64) -> ArrivalTimes {
        self.feeder().arrivals.quantile(probability)
    }

    pub(crate) fn trace_tick(&self, row: [f64; TRACE_COLUMNS]) {
        self.trace.push(row);
    }

    /// What happened in each tick: the pointer at its beginning and end [m] and the factor of stiffness (not numbers:
    /// no finger), the force on the key [N], and finger and key at the end [m].
    pub fn trace(&self) -> Vec<[f64; TRACE_COLUMNS]> {
        self.trace.rows()
    }

    /// Counts so far.
    pub fn tally(&self) -> PointerTally {
        let feeder = self.feeder();
        let [gap_count, gap_sum, square_sum] = feeder.interval_moments;
        let mean_interval = if gap_count > 0.0 { gap_sum / gap_count } else { 0.0 };
        let variance = if gap_count > 0.0 {
            square_sum / gap_count - mean_interval * mean_interval
        } else {
            0.0
        };
        PointerTally {
            late: self.n_late.load(Ordering::Relaxed),
            mean_interval,
            interval_deviation: ergon_engine::maths::sqrt(variance.max(0.0)),
            ..feeder.tally
        }
    }
}

impl PageKey for PointerStream {
    fn name(&self) -> &str {
        let address = self.options.address.as_str();
        let lead_name = address.split_once(':').map_or(address, |(_, lead_name)| lead_name);
        lead_name.split_once('?').map_or(lead_name, |(lead_name, _)| lead_name)
    }

    fn input(&self) -> &str {
        let address = self.options.address.as_str();
        address.split_once(':').map_or(address, |(kind, _)| kind)
    }

    fn range(&self) -> [f64; 2] {
        self.options.key.range
    }

    fn acquire(&self) -> bool {
        !self.is_present.swap(true, Ordering::AcqRel)
    }

    fn is_held(&self) -> bool {
        self.is_present()
    }

    fn release(&self) {
        self.set_present(false);
    }

    fn add_position(&self, age: f64, x: f64, pressure: Option<f64>) -> bool {
        let pointer_place = PointerPosition {
            time: self.now() - age,
            x,
            // A mouse reports 0.5, the pressure of an ordinary finger.
            firmness: pressure.map(|pressure| 2.0 * pressure),
        };
        self.add_position(pointer_place).is_ok()
    }

    fn count_refused(&self) {
        self.feeder().tally.refused += 1;
    }

    fn points(&self) -> KeyPoints {
        let [pointer, finger, key, force] =
            [0, 1, 2, 3].map(|point_index| f64::from_bits(self.points[point_index].load(Ordering::Relaxed)));
        KeyPoints {
            pointer,
            finger,
            key,
            force,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lead(name: &str, lockstep: bool) -> Arc<PointerStream> {
        let options = PointerStreamOptions {
            address: name.into(),
            finger: FingerConstants::default(),
            delay: 0.02,
            key: HeldKey::default(),
            in_lockstep: lockstep,
            traced_ticks: 0,
        };
        PointerStream::new(options, true).expect("a new name")
    }

    fn placed(time: f64, x: f64) -> PointerPosition {
        PointerPosition {
            time,
            x,
            firmness: Some(1.0),
        }
    }

    #[test]
    fn stream_positions_within_travel() {
        let lead = lead("osc:/in-and-out", true);
        for (time, x) in [(0.0, 0.01), (0.1, 9.0), (0.05, -9.0)] {
            lead.add_position(placed(time, x)).unwrap();
        }
        assert_eq!(lead.next(), Some(placed(0.0, 0.01)));
        assert_eq!(lead.next(), Some(placed(0.1, 0.05)));
        assert_eq!(lead.next(), Some(placed(0.1 + STAMP_GAP_MIN, -0.05)), "time rises");
        assert_eq!(lead.next(), None);
    }

    #[test]
    fn stream_forgets_all_but_where_the_pointer_is() {
        let lead = lead("osc:/wait", true);
        assert_eq!(lead.discard_positions(), None);
        for (time, x) in [(0.0, 0.01), (0.1, 0.02), (0.2, 0.03)] {
            lead.add_position(placed(time, x)).unwrap();
        }
        assert_eq!(lead.discard_positions(), Some(placed(0.2, 0.03)));
        assert_eq!(lead.next(), None);
    }

    #[test]
    fn stream_refuses_nonsense_and_floods() {
        let lead = lead("osc:/flood", false);
        for bad_position in [placed(f64::NAN, 0.0), placed(0.0, f64::INFINITY)] {
            assert_eq!(lead.add_position(bad_position), Err(PositionRefusal::NotFinite));
        }
        let refused_count = (0..20_000)
            .filter(|_| lead.add_position(placed(lead.now(), 0.0)).is_err())
            .count();
        assert!(refused_count > 0);
        let lead_tally = lead.tally();
        assert_eq!(lead_tally.refused, refused_count as u64 + 2);
        assert_eq!(lead_tally.accepted, 20_000 - refused_count as u64);
    }

    #[test]
    fn stream_replaces_wrong_stamps() {
        let lead = lead("osc:/stamps", false);
        for stamp_time in [-1e9, 1e9] {
            lead.add_position(placed(stamp_time, 0.0)).unwrap();
            let stamp_time = lead.next().unwrap().time;
            assert!((0.0..=lead.now() + 1e-3).contains(&stamp_time), "{stamp_time}");
        }
        assert_eq!(lead.tally().misdated, 2);
    }

    #[test]
    fn leads_with_equal_names() {
        let first_lead = lead("osc:/name", true);
        let same_options = PointerStreamOptions {
            ..first_lead.options().clone()
        };
        assert!(PointerStream::new(same_options.clone(), true).is_none());
        assert!(find("osc:/name").is_some());
        drop(first_lead);
        assert!(find("osc:/name").is_none());
        let second_lead = PointerStream::new(same_options.clone(), true).expect("the name of one that is gone");
        second_lead.close();
        let third_lead = PointerStream::new(same_options, true).expect("the name of one that is closed");
        second_lead.close();
        assert!(find("osc:/name").is_some_and(|lead| Arc::ptr_eq(&lead, &third_lead)));
    }

    #[test]
    fn page_holds_a_free_key() {
        let lead = lead("page:held", false);
        lead.release();
        assert!(lead.acquire() && !lead.acquire());
        assert!(lead.is_held());
        lead.release();
        assert!(!lead.is_held());
        assert!(lead.acquire() && !lead.acquire());
    }
}
