//! How far the motion of what is only seen, computed at a lower rate, is from its motion at the rate of the score.

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::budget::Budget;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::solved_modes::ModeCache;
use crate::assembly::split::LocalTimeline;
use crate::assembly::unit::IslandPlan;
use crate::content::island::IslandContent;
use crate::network::{Error, Subset};
use crate::plan::row::MeasuredError;
use crate::plan::trial::allowance::{Allowance, none_if_spent};
use crate::plan::trial::pilot_run::{Excerpt, pilot_excerpt, play};
use crate::plan::trial::record::{TrialSeries, TrialStore, measured_error};
use crate::plan::trial::waveform_error::{ComparedSpans, difference_db};

/// The difference of the two motions over the beginning, in a sum of all positions with a weight of its own each.
/// `None` if it is not known what will happen, if the allowance ends first, or if the island cannot be played at both
/// rates.
pub(in crate::plan) fn lower_rate_error(
    lower_rate_plan: &IslandPlan,
    (subset, island_timeline, budget): (&Subset, &LocalTimeline, &Budget),
    (mode_cache, allowance, store): (&ModeCache<'_>, &Allowance, Option<&dyn TrialStore>),
) -> Result<Option<MeasuredError>, Error> {
    let Some(slower_timeline) = island_timeline
        .with_lower_rate(lower_rate_plan.frame_interval)
        .filter(|_| !island_timeline.timeline.is_open)
    else {
        return Ok(None);
    };
    // Trials count frames of the slower timeline.
    let trial_series = store.map(|store| {
        let rate_numbers = (
            lower_rate_plan.frame_interval,
            lower_rate_plan.oversampling,
            lower_rate_plan.contact_substeps,
        );
        let also_hashed = format_args!("seen {budget:?} {rate_numbers:?}");
        let content = IslandContent::new(&subset.network, &slower_timeline.timeline, also_hashed);
        TrialSeries::new(store, content)
    });
    measured_error(trial_series, allowance, || {
        let assembly_options = AssemblyOptions::between_steps(1, MethodChoice::ByBudget);
        match Assembled::new(subset, island_timeline, budget, assembly_options, None, mode_cache) {
            Ok(assembled) => compare_rates(lower_rate_plan, &assembled.island_plan, allowance),
            Err(_) => Ok(None),
        }
    })
}

/// The difference between an island at the lower rate and the same at every frame, over its beginning.
fn compare_rates(
    lower_rate_plan: &IslandPlan,
    full_rate_plan: &IslandPlan,
    allowance: &Allowance,
) -> Result<Option<MeasuredError>, Error> {
    let excerpt = none_if_spent(pilot_excerpt(lower_rate_plan, allowance))?;
    let Some(excerpt) = excerpt.filter(|excerpt| excerpt.n_frames > 0) else {
        return Ok(None);
    };
    let frame_stride = lower_rate_plan.frame_interval as usize;
    let play_island = |island_plan: &IslandPlan, frame_factor: usize| {
        let excerpt = Excerpt {
            first_frame: excerpt.first_frame * frame_factor,
            n_frames: excerpt.n_frames * frame_factor,
        };
        none_if_spent(play(island_plan, island_plan.contact_substeps, excerpt, allowance))
    };
    let (Some(lower_rate_run), Some(full_rate_run)) = (
        play_island(lower_rate_plan, 1)?,
        play_island(full_rate_plan, frame_stride)?,
    ) else {
        return Ok(None);
    };
    let spans = ComparedSpans::new(lower_rate_plan, excerpt.n_frames);
    let strided_frames = full_rate_run.sound.chunks(spans.n_out).step_by(frame_stride);
    let full_rate_sound: Vec<f64> = strided_frames.flatten().copied().collect();
    let db = difference_db(&lower_rate_run.sound, &full_rate_sound, &spans);
    Ok(db.is_finite().then_some(MeasuredError {
        waveform_db: db,
        duration_seconds: excerpt.end() as f64 / spans.rate,
        third_octave_db: None,
        audible: None,
    }))
}
