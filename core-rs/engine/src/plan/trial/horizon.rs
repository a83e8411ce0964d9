//! How long an error holds: if keys meet what sounds again and again, runs may part long after the end of a pilot.

use crate::assembly::budget::Budget;
use crate::assembly::unit::IslandPlan;
use crate::content::hash_hex;
use crate::content::island::Content;
use crate::gesture::script::Gesture;
use crate::hearing::Scatter;
use crate::hearing::third_octaves::level_difference;
use crate::island::bodies::BodyPlan;
use crate::maths::log10;
use crate::network::LinkKind;
use crate::plan::constants::{
    EQUAL_ERRORS_DB, ERROR_CHECK_SECONDS, HARDER_EVENT_RATIO, LAST_EVENT_SECONDS, RESERVE_PLANNED_SHARE,
    RESERVE_USABLE_SHARE, SPECTRUM_NOISE_DB, UNCORRELATED_DB,
};
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, TrialError, none_if_spent};
use crate::plan::trial::chaos::is_linear;
use crate::plan::trial::pilot_run::{Excerpt, frame_cost_seconds, frames_per_second, play, resting_frames};
use crate::plan::trial::record::{self, TrialRecord, TrialStore};
use crate::plan::trial::waveform_error::ComparedSpans;
use crate::timeline::{Gate, Lead, Timeline};

/// A way to play an island.
#[derive(Clone, Copy)]
pub(in crate::plan) struct PlannedRun<'a> {
    pub(in crate::plan) island_plan: &'a IslandPlan,
    /// Contact substeps a step.
    pub(in crate::plan) contact_substeps: usize,
}

/// Whether errors may grow after a pilot: if keys are led to contacts, so that each contact begins where the one before
/// it ended, if parts are slow, or if parameters or couplings change in time.
pub(in crate::plan) fn error_may_grow(island_plan: &IslandPlan) -> bool {
    let link_runs = island_plan.network.runs().iter();
    let has_contacts = link_runs.clone().any(|run| !matches!(run.kind, LinkKind::Ref));
    let mut body_plans = island_plan.bodies.iter();
    let has_slow_body = body_plans.any(|body| matches!(body, BodyPlan::Slow(_)));
    let timeline = &island_plan.timeline;
    has_slow_body || (has_contacts && !timeline.gestures.is_empty()) || last_change_time(timeline).is_some()
}

/// Whether runs may part by chance after a pilot that saw none. In a linear motion, and where no hand leads a key to its
/// next contact, errors of pitch add up, and the waveform is as wrong as measured.
fn may_part_by_chance(island_plan: &IslandPlan) -> bool {
    let timeline = &island_plan.timeline;
    !is_linear(island_plan) && (!timeline.gestures.is_empty() || last_change_time(timeline).is_none())
}

/// When parameters of links and masses, or the opening of a coupling, have changed for the last time [s]; `None` if none
/// changes.
fn last_change_time(timeline: &Timeline) -> Option<f64> {
    let lead_ends = timeline.leads.iter().filter_map(Lead::last_change_frame);
    let glide_ends = timeline.glides.iter().filter_map(|glide| {
        let &(frame, _) = glide.points.last()?;
        (frame > 0).then_some(frame)
    });
    let gate_ends = timeline.gates.iter().filter_map(Gate::last_change_frame);
    let last_frame = lead_ends.chain(glide_ends).chain(gate_ends).max()?;
    Some(last_frame as f64 / timeline.rate.hertz())
}

/// The first strike or written gesture after `measured_until` [s] that is harder than all until then, so that its error
/// is not known [s]; `None` if there is none, or if the motion does not depend on how hard it is excited.
pub(in crate::plan) fn harder_event_time(
    island_plan: &IslandPlan,
    timeline: &Timeline,
    measured_until: f64,
) -> Option<f64> {
    if is_linear(island_plan) {
        return None;
    }
    let strikes = timeline.strikes.iter();
    let gestures = timeline.gestures.iter();
    let harder_events = [
        first_harder_event(
            strikes.map(|strike| (strike.instant, strike.impulse.abs())),
            measured_until,
        ),
        first_harder_event(
            gestures.map(|gesture| (gesture.start, speed_bound(gesture))),
            measured_until,
        ),
    ];
    harder_events.into_iter().flatten().reduce(f64::min)
}

/// The first instant after `measured_until` whose strength exceeds all until then by more than `HARDER_EVENT_RATIO`, of
/// pairs (instant [s], strength); `None` if there is none, or nothing until then.
fn first_harder_event(events: impl Iterator<Item = (f64, f64)> + Clone, measured_until: f64) -> Option<f64> {
    let tried_events = events.clone().filter(|event| event.0 <= measured_until);
    let hardest = tried_events.map(|event| event.1).reduce(f64::max)?;
    let harder_events = events.filter(|event| event.0 > measured_until && event.1 > HARDER_EVENT_RATIO * hardest);
    harder_events.map(|event| event.0).reduce(f64::min)
}

/// A bound on the speed of a gesture: its range in the shortest time between two written points [m/s]; 0 for a take.
fn speed_bound(gesture: &Gesture) -> f64 {
    let point_intervals = gesture.points.windows(2).map(|pair| pair[1].0 - pair[0].0);
    let (range_low, range_high) = gesture.range();
    (range_high - range_low) / point_intervals.fold(f64::INFINITY, f64::min)
}

/// Measures how long the error of a pilot holds: plays both runs on, to the end of the score or as far as the reserve
/// of work allows. Returns the error and the time until which it stays within the budget or close to what the pilot
/// measured. An error by ear is that of all that was played.
pub(in crate::plan) fn extend_error(
    measured: MeasuredError,
    budget: &Budget,
    [coarse, finer]: [PlannedRun<'_>; 2],
    (allowance, store): (&Allowance, Option<&dyn TrialStore>),
) -> Result<MeasuredError, TrialError> {
    let frame_rate = frames_per_second(coarse.island_plan);
    if measured.waveform_db > UNCORRELATED_DB {
        return Ok(measured); // the runs have no waveform in common
    }
    // The reserve is separate: if it runs out, the pilot's result stands as it is.
    let reserve = allowance.reserve();
    let frame_work = frame_cost_seconds(coarse.island_plan) + frame_cost_seconds(finer.island_plan);
    // The pilot has already drawn the work of finding this rest.
    let Some(first_frame) = none_if_spent(resting_frames(coarse.island_plan, &allowance.reserve()))? else {
        return Ok(measured);
    };
    let n_frames = (end_seconds(coarse.island_plan) * frame_rate - first_frame as f64)
        .min(RESERVE_PLANNED_SHARE * reserve.total_seconds() / frame_work) as usize;
    let pilot_frames = ((measured.duration_seconds * frame_rate) as usize).saturating_sub(first_frame);
    let check_interval = ((ERROR_CHECK_SECONDS * frame_rate) as usize).max(1);
    if n_frames < pilot_frames + check_interval {
        return Ok(measured);
    }
    let longest_excerpt = Excerpt { first_frame, n_frames };
    let key = store.map(|_| horizon_key(measured, budget, [coarse, finer], longest_excerpt.end()));
    let store_and_key = store.zip(key.as_deref());
    let recalled = store_and_key.and_then(|(store, key)| record::find_record(store, key, &reserve));
    if let Some((taken_work, trial_record)) = recalled
        && let Some(Some(recalled_error)) = trial_record.sole_error()
    {
        allowance.spend_reserve(taken_work.spent_seconds);
        return Ok(recalled_error);
    }
    let reserve_left = reserve.begin_series();
    let extended = extend_error_over(
        measured,
        budget,
        [coarse, finer],
        (longest_excerpt, check_interval),
        &reserve,
    )?;
    if let Some((store, key)) = store_and_key {
        let trial_record = TrialRecord::from_error(Some(extended));
        record::store_record(store, key, (&reserve, reserve_left), trial_record);
    }
    allowance.spend_reserve(reserve.spent_seconds());
    Ok(extended)
}

/// A hash of all that the result of [`extend_error_over`] depends on.
fn horizon_key(measured: MeasuredError, budget: &Budget, played: [PlannedRun<'_>; 2], end_frame: usize) -> String {
    let [run_key, other_key] = played.map(|run| {
        let content = Content::new(run.island_plan).hash_of_span(run.island_plan, (0, end_frame as u64), "");
        (content, run.contact_substeps)
    });
    hash_hex(format_args!(
        "horizon {measured:?} {budget:?} {run_key:?} {other_key:?} {end_frame}"
    ))
}

/// Plays both runs over `longest` or its beginning, and extends the error, which is checked every
/// `check_interval` frames.
fn extend_error_over(
    measured: MeasuredError,
    budget: &Budget,
    [coarse, finer]: [PlannedRun<'_>; 2],
    (longest, check_interval): (Excerpt, usize),
    reserve: &Allowance,
) -> Result<MeasuredError, TrialError> {
    let frame_rate = frames_per_second(coarse.island_plan);
    let seconds = |n_frames: usize| (longest.first_frame + n_frames) as f64 / frame_rate;
    let pilot_frames = ((measured.duration_seconds * frame_rate) as usize).saturating_sub(longest.first_frame);
    let played_runs = play(coarse.island_plan, coarse.contact_substeps, longest, reserve).and_then(|coarse_run| {
        // What contacts added to the first run is assumed to add to each step of the finer one too.
        let step_ratio = f64::from(finer.island_plan.oversampling) / f64::from(coarse.island_plan.oversampling);
        let reserve_share = reserve.share_left(step_ratio * reserve.spent_seconds() / RESERVE_USABLE_SHARE);
        let n_frames = (reserve_share * longest.n_frames as f64) as usize;
        if n_frames < pilot_frames + check_interval {
            return Err(TrialError::AllowanceSpent);
        }
        let shorter = Excerpt { n_frames, ..longest };
        let finer_run = play(finer.island_plan, finer.contact_substeps, shorter, reserve)?;
        Ok((coarse_run, finer_run, n_frames))
    });
    let (coarse_run, finer_run, n_frames) = match played_runs {
        Ok(played_runs) => played_runs,
        Err(TrialError::AllowanceSpent) => return Ok(measured),
        Err(error) => return Err(error),
    };
    let spans = ComparedSpans::new(coarse.island_plan, n_frames);
    let changes = relative_changes_db(&coarse_run.sound, &finer_run.sound, spans.n_out, check_interval);
    let change_at = |frames_played: usize| changes[frames_played.div_ceil(check_interval).min(changes.len()) - 1];
    // By how much the measured error exceeds the change between the two runs [dB].
    let error_excess = measured.waveform_db - change_at(pilot_frames);
    // The first run may have been played further.
    let sound_pair = (&coarse_run.sound[..finer_run.sound.len()], &*finer_run.sound);
    let audible = spans.audible_error(budget, sound_pair, Scatter::Deducted);
    let audible_error = measured.audible.zip(audible).map(|(pilot_error, audible)| {
        // The finer run has up to as large an error as the change.
        MeasuredError {
            waveform_db: measured.waveform_db.max(change_at(n_frames) + error_excess),
            duration_seconds: seconds(n_frames),
            audible: Some(audible.plus(audible).with(pilot_error)),
            ..measured
        }
    });
    let is_allowed = |error: &MeasuredError| error.budget_excess(budget) <= 1.0;
    if let Some(error) = audible_error.filter(is_allowed) {
        return Ok(error);
    }
    let grown_error_limit_db = budget.waveform_error_db().max(measured.waveform_db + EQUAL_ERRORS_DB);
    let (mut valid_frames, mut error_db) = (pilot_frames, measured.waveform_db);
    let mut checked_frames = pilot_frames;
    while checked_frames < n_frames {
        checked_frames = (checked_frames + check_interval).min(n_frames);
        let error_now = change_at(checked_frames) + error_excess;
        if error_now > grown_error_limit_db && may_part_by_chance(coarse.island_plan) {
            let first_sample = valid_frames * spans.n_out.max(1);
            let spectral = level_difference(
                &coarse_run.sound[first_sample..finer_run.sound.len()],
                &finer_run.sound[first_sample..],
                spans.n_out,
                spans.rate,
            );
            // Runs that differ by rounding alone have parted for good.
            let is_noise = spectral <= SPECTRUM_NOISE_DB;
            return Ok(audible_error.filter(|_| !is_noise).unwrap_or(MeasuredError {
                waveform_db: error_db,
                duration_seconds: seconds(valid_frames),
                third_octave_db: Some(spectral),
                ..measured
            }));
        }
        (valid_frames, error_db) = (checked_frames, error_db.max(error_now));
    }
    Ok(audible_error.unwrap_or(MeasuredError {
        waveform_db: error_db,
        duration_seconds: seconds(n_frames),
        ..measured
    }))
}

/// ‖sound − reference‖ / ‖reference‖ [dB] of the worst output, from the start to each check; the mean of the reference
/// does not count as sound.
fn relative_changes_db(sound: &[f64], reference: &[f64], n_outputs: usize, check_interval: usize) -> Vec<f64> {
    let n_outputs = n_outputs.max(1);
    // Sums so far for each output: the squared difference, and the reference and its square, both less its first
    // frame.
    let mut output_sums = vec![[0.0; 3]; n_outputs];
    let mut frame_count = 0.0;
    let mut changes = Vec::new();
    let checked_chunks = sound
        .chunks(check_interval * n_outputs)
        .zip(reference.chunks(check_interval * n_outputs));
    for (sound_chunk, reference_chunk) in checked_chunks {
        for (sound_frame, reference_frame) in sound_chunk.chunks(n_outputs).zip(reference_chunk.chunks(n_outputs)) {
            frame_count += 1.0;
            for (output, output_sums) in output_sums.iter_mut().enumerate() {
                let deviation_from_first = reference_frame[output] - reference[output];
                let difference = sound_frame[output] - reference_frame[output];
                *output_sums = [
                    output_sums[0] + difference * difference,
                    output_sums[1] + deviation_from_first,
                    output_sums[2] + deviation_from_first * deviation_from_first,
                ];
            }
        }
        let worst_ratio = output_sums
            .iter()
            .fold(0.0_f64, |worst_ratio, [error_energy, sum, square]| {
                let variance = square - sum * sum / frame_count;
                worst_ratio.max(if *error_energy > 0.0 {
                    error_energy / variance
                } else {
                    0.0
                })
            });
        changes.push(10.0 * log10(worst_ratio.max(1e-30)));
    }
    changes
}

/// From when on the error of an island may be larger than a pilot measured [s]: it may grow, and events follow the time
/// over which it was checked. `None` if it holds for all that is played.
pub(in crate::plan) fn unchecked_from(island_plan: &IslandPlan, error: MeasuredError) -> Option<f64> {
    let last_event = end_seconds(island_plan) - LAST_EVENT_SECONDS;
    let is_unchecked =
        error.third_octave_db.is_none() && error_may_grow(island_plan) && error.duration_seconds < last_event;
    is_unchecked.then_some(error.duration_seconds)
}

/// When the last event has been played and heard [s].
pub(in crate::plan) fn end_seconds(island_plan: &IslandPlan) -> f64 {
    let timeline = &island_plan.timeline;
    let gestures = timeline.gestures.iter();
    let gesture_ends = gestures.filter_map(|gesture| gesture.points.last().map(|point| point.0));
    let strike_times = timeline.strikes.iter().map(|strike| strike.instant);
    let ergon_times = timeline.ergons.iter().map(|ergon| ergon.instant);
    let event_times = gesture_ends
        .chain(strike_times)
        .chain(ergon_times)
        .chain(last_change_time(timeline));
    event_times.fold(0.0, f64::max) + LAST_EVENT_SECONDS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_from_the_start_to_each_look() {
        let reference: Vec<f64> = (0..400).map(|n| 3.0 + f64::from(n % 7)).collect();
        let changed_sound: Vec<f64> = (0..400)
            .map(|n| reference[n] + if n < 200 { 1e-3 } else { 1.0 })
            .collect();
        let change_levels = relative_changes_db(&changed_sound, &reference, 1, 100);
        assert_eq!(change_levels.len(), 4);
        // The values 0 … 6 have a variance of 4.
        assert!((change_levels[0] + 66.0).abs() < 0.1, "{}", change_levels[0]);
        assert!((change_levels[1] + 66.0).abs() < 0.1, "{}", change_levels[1]);
        assert!((change_levels[3] + 9.0).abs() < 0.1, "{}", change_levels[3]);
        assert!(
            relative_changes_db(&reference, &reference, 1, 100)
                .iter()
                .all(|error_db| *error_db <= -290.0)
        );
    }
}
