//! What trials found, kept from one plan to the next, so that an island whose beginning did not change is not tried
//! again.
//!
//! A series of trials plays the beginning of an island, and how far it plays is known only afterwards. So there are two
//! keys: the hash of all that does not depend on time leads to the lengths that earlier series of the island played,
//! and the hash of that and of the events up to one such length leads to what the series found.

use crate::content::hash_hex;
use crate::content::island::IslandContent;
use crate::hearing::{Audible, JUST_NOTICEABLE};
use crate::network::Error;
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, RemainingWork, ReplayCondition, SeriesWork};

/// Most lengths that are remembered for one island.
const LENGTHS_MAX: usize = 8;

/// What a series of trials took and found, as numbers that can be written and read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrialRecord {
    /// Work, errors and loudness; each finite, or `None`.
    pub numbers: Vec<Option<f64>>,
    /// Steps, then the kept modes of each body.
    pub counts: Vec<Vec<u32>>,
    /// Why a body cannot be computed by modes.
    pub reason: Option<String>,
}

/// The reason of a record that holds no result of a trial.
const NO_TRIAL_REASON: &str = "no trial";

/// Where records are kept. A record may be damaged or belong to something else: the caller has to check it.
pub trait TrialStore {
    /// The record that was kept under a key (64 hex digits).
    fn get(&self, key: &str) -> Option<TrialRecord>;

    /// Keep a record.
    fn put(&self, key: &str, record: TrialRecord);
}

impl TrialRecord {
    /// A record of what a plan computed without a trial.
    pub(in crate::plan) fn without_trial(numbers: Vec<Option<f64>>, counts: Vec<Vec<u32>>) -> Self {
        Self {
            numbers,
            counts,
            reason: Some(NO_TRIAL_REASON.to_owned()),
        }
    }

    /// Whether it holds what a plan computed without a trial.
    pub(in crate::plan) fn is_without_trial(&self) -> bool {
        self.reason.as_deref() == Some(NO_TRIAL_REASON)
    }

    /// The record with `series_work` at its head.
    fn with_header(mut self, series_work: &SeriesWork) -> Self {
        let (needed_seconds, left_at_start) = match series_work.condition {
            ReplayCondition::EnoughLeft(seconds) => (Some(seconds), None),
            ReplayCondition::SameLeft(work_left) => (None, Some(work_left.to_number())),
        };
        let header_numbers = [Some(series_work.spent_seconds), needed_seconds, left_at_start];
        self.numbers.splice(0..0, header_numbers);
        self.counts.insert(0, vec![u32::from(series_work.ended_early)]);
        self
    }

    /// Splits a record into what was taken and the rest; `None` if it is not valid.
    fn split_header(mut self) -> Option<(SeriesWork, Self)> {
        let numbers = self.numbers.iter().flatten();
        let are_finite = numbers.clone().all(|number| number.is_finite());
        if !are_finite || self.numbers.len() < 3 || self.counts.is_empty() {
            return None;
        }
        let header_numbers: Vec<Option<f64>> = self.numbers.drain(..3).collect();
        let series_work = SeriesWork {
            spent_seconds: header_numbers[0].filter(|seconds| *seconds >= 0.0)?,
            condition: match (header_numbers[1], header_numbers[2]) {
                (Some(seconds), None) => ReplayCondition::EnoughLeft(seconds),
                (None, Some(number)) => ReplayCondition::SameLeft(RemainingWork::from_number(number)),
                _ => return None,
            },
            ended_early: match self.counts.remove(0)[..] {
                [0] => false,
                [1] => true,
                _ => return None,
            },
            frames_played: 0,
        };
        Some((series_work, self))
    }

    /// An error as numbers.
    pub(in crate::plan) fn error_numbers(error: Option<MeasuredError>) -> Vec<Option<f64>> {
        let audible = error.and_then(|error| error.audible);
        let mut numbers = vec![
            error.map(|error| error.waveform_db),
            error.map(|error| error.duration_seconds),
            error.and_then(|error| error.third_octave_db),
        ];
        numbers.extend(match audible {
            Some(audible) => audible.values().map(Some),
            None => [None; JUST_NOTICEABLE.len()],
        });
        numbers
    }

    /// A record of an error and nothing else.
    pub(in crate::plan) fn from_error(error: Option<MeasuredError>) -> Self {
        Self {
            numbers: Self::error_numbers(error),
            ..Self::default()
        }
    }

    /// The error, if the record holds nothing else.
    pub(in crate::plan) fn sole_error(&self) -> Option<Option<MeasuredError>> {
        let (error, numbers_left) = self.error()?;
        let is_alone = numbers_left.is_empty() && self.counts.is_empty() && self.reason.is_none();
        is_alone.then_some(error)
    }

    /// The error at the head of the record, and the numbers after it.
    pub(in crate::plan) fn error(&self) -> Option<(Option<MeasuredError>, &[Option<f64>])> {
        let ([waveform_db, duration, third_octave_db], numbers_left) = self.numbers.split_first_chunk()?;
        let (audible, numbers_left) = numbers_left.split_first_chunk::<{ JUST_NOTICEABLE.len() }>()?;
        let audible_numbers: Vec<f64> = audible.iter().filter_map(|value| *value).collect();
        let audible = <[f64; JUST_NOTICEABLE.len()]>::try_from(audible_numbers)
            .ok()
            .map(Audible::from);
        let measured_error = waveform_db.zip(*duration).map(|(db, seconds)| MeasuredError {
            waveform_db: db,
            duration_seconds: seconds,
            third_octave_db: *third_octave_db,
            audible,
        });
        Some((measured_error, numbers_left))
    }
}

/// The series of trials of one island, and the store of their results.
pub(in crate::plan) struct TrialSeries<'a> {
    store: &'a dyn TrialStore,
    content: IslandContent<'a>,
    series_key: String,
}

impl<'a> TrialSeries<'a> {
    pub(in crate::plan) fn new(store: &'a dyn TrialStore, content: IslandContent<'a>) -> Self {
        let series_key = content.static_hash();
        Self {
            store,
            content,
            series_key,
        }
    }

    fn key(&self, frames: u64) -> String {
        hash_hex(format_args!("{} {}", self.series_key, self.content.hash_until(frames)))
    }

    fn recorded_lengths(&self) -> Vec<u64> {
        let length_index = self.store.get(&self.series_key).unwrap_or_default();
        if length_index.reason.is_some() || !length_index.numbers.is_empty() || length_index.counts.len() != 1 {
            return Vec::new();
        }
        let lengths = length_index.counts.first().cloned().unwrap_or_default();
        lengths.into_iter().map(u64::from).collect()
    }

    /// Finds an earlier series that would go the same way now: what it took and its record.
    pub(in crate::plan) fn find_series(&self, allowance: &Allowance) -> Option<(SeriesWork, TrialRecord)> {
        let mut lengths = self.recorded_lengths().into_iter();
        lengths.find_map(|frames| find_record(self.store, &self.key(frames), allowance))
    }

    /// Keeps the record of the current series, which began with `work_left` of the allowance.
    pub(in crate::plan) fn store(&self, allowance: &Allowance, work_left: RemainingWork, record: TrialRecord) {
        let series_frames = allowance.series_work(work_left).frames_played;
        store_record(self.store, &self.key(series_frames), (allowance, work_left), record);
        let mut lengths = self.recorded_lengths();
        if !lengths.contains(&series_frames) {
            lengths.insert(0, series_frames);
            lengths.truncate(LENGTHS_MAX);
            let lengths = lengths.into_iter().map(|series_frames| series_frames as u32).collect();
            let length_index = TrialRecord {
                counts: vec![lengths],
                ..TrialRecord::default()
            };
            self.store.put(&self.series_key, length_index);
        }
    }
}

/// Returns the error that `measure` finds in a series of trials, or that an earlier plan recorded for the same series.
pub(in crate::plan) fn measured_error(
    series: Option<TrialSeries<'_>>,
    allowance: &Allowance,
    measure: impl FnOnce() -> Result<Option<MeasuredError>, Error>,
) -> Result<Option<MeasuredError>, Error> {
    let recalled = series.as_ref().and_then(|series| series.find_series(allowance));
    let known_error = recalled.and_then(|(series_work, record)| Some((series_work, record.sole_error()?)));
    if let Some((series_work, recorded_error)) = known_error {
        allowance.replay(&series_work);
        return Ok(recorded_error);
    }
    let work_left = allowance.begin_series();
    let measurement = measure()?;
    if let Some(series) = &series {
        series.store(allowance, work_left, TrialRecord::from_error(measurement));
    }
    Ok(measurement)
}

/// Finds the record of trials of known length, if they would go the same way now, and what they took.
pub(in crate::plan) fn find_record(
    store: &dyn TrialStore,
    key: &str,
    allowance: &Allowance,
) -> Option<(SeriesWork, TrialRecord)> {
    let work_left = allowance.begin_series();
    [key.to_owned(), key_with_remaining_work(key, work_left)]
        .iter()
        .find_map(|key| {
            let work_and_record = store.get(key)?.split_header()?;
            allowance.can_replay(&work_and_record.0).then_some(work_and_record)
        })
}

/// Keeps the record of trials of known length, which began with `work_left` of the allowance.
pub(in crate::plan) fn store_record(
    store: &dyn TrialStore,
    key: &str,
    (allowance, work_left): (&Allowance, RemainingWork),
    record: TrialRecord,
) {
    let work_taken = allowance.series_work(work_left);
    let record_key = match work_taken.condition {
        ReplayCondition::EnoughLeft(_) => key.to_owned(),
        ReplayCondition::SameLeft(work_left) => key_with_remaining_work(key, work_left),
    };
    store.put(&record_key, record.with_header(&work_taken));
}

/// The key for trials whose results depend on what was left.
fn key_with_remaining_work(key: &str, work_left: RemainingWork) -> String {
    hash_hex(format_args!("{key} {:016x}", work_left.to_number().to_bits()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_of_trials_with_a_refused_share() {
        let allowance = Allowance::with_seconds(1.0);
        let work_left = allowance.begin_series();
        let share = allowance.split_off(0.5);
        assert!(share.spend(0.75).is_err());
        allowance.spend_split(&share, 0.5);
        let series_work = allowance.series_work(work_left);
        assert_eq!(series_work.condition, ReplayCondition::SameLeft(work_left));
        let record = TrialRecord::default().with_header(&series_work);
        assert!(record.numbers.iter().flatten().all(|number| number.is_finite()));
        let (read_work, rest) = record.split_header().unwrap();
        assert_eq!((read_work, rest), (series_work, TrialRecord::default()));
    }
}
