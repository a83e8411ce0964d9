//! Plays the beginning of an island, and decides for how long that is worth it.

use crate::assembly::constants::TRIAL_WORK_MAX;
use crate::assembly::cost;
use crate::assembly::cost_table::Costs;
use crate::assembly::unit::IslandPlan;
use crate::derivative::Derivatives;
use crate::island::{Island, OnFault, SimulationOptions, StepNumbers};
use crate::kernel::thread_team::ThreadTeam;
use crate::network::Error;
use crate::plan::constants::{ENERGY_CHECKS_PER_RUN, EXCERPT_SECONDS_MAX, PILOT_SECONDS};
use crate::plan::trial::allowance::{Allowance, TrialError};
use crate::plan::trial::silence::SilentOutputs;
use crate::waveform::is_still;

/// Frames of a block, after each of which the modes are looked at.
pub(in crate::plan) const BLOCK_FRAMES: usize = 64;
/// Frames that it takes to see whether an island rests from its beginning on.
const REST_PROBE_FRAMES: usize = 1024;
/// Frames of a rest that are played at once.
const REST_SKIP_FRAMES: usize = 1 << 14;

/// The frames that trials compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::plan) struct Excerpt {
    /// The first of them: the island rests until then.
    pub(in crate::plan) first_frame: usize,
    /// The number of frames.
    pub(in crate::plan) n_frames: usize,
}

impl Excerpt {
    /// The frame after the last one.
    pub(in crate::plan) fn end(self) -> usize {
        self.first_frame + self.n_frames
    }
}

/// One run of an excerpt.
#[derive(Clone)]
pub(in crate::plan) struct PilotRun {
    /// The first frame of the sound.
    pub(in crate::plan) first_frame: usize,
    /// (n_frames · n_out)
    pub(in crate::plan) sound: Vec<f64>,
    /// Square of the amplitude that each mode of each body reached.
    pub(in crate::plan) mode_amplitudes_squared: Vec<Vec<f64>>,
    /// Work that was drawn for it [s].
    pub(in crate::plan) work_seconds: f64,
    /// Work that depends on the motion, from the first touch on.
    pub(in crate::plan) counted_cost: CountedCost,
    /// A part of the island diverged.
    pub(in crate::plan) has_diverged: bool,
    /// It diverged, or its energy rose although nothing drove it.
    pub(in crate::plan) is_unusable: bool,
    /// The largest share that an output hears of what it would hear if no motion were cancelled.
    pub(in crate::plan) loudest_share: f64,
    pub(in crate::plan) energy_gains: EnergyGainShares,
}

/// The largest gain of energy by the errors of one link, relative to the energy of the island.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::plan) struct EnergyGainShares {
    pub(in crate::plan) contact_share: f64,
    /// In the first half of the run, and in all of it.
    pub(in crate::plan) law_shares: [f64; 2],
}

impl EnergyGainShares {
    fn update(&mut self, island: &Island, is_first_half: bool) {
        let [contacts, law_share] = island.created_shares();
        self.contact_share = self.contact_share.max(contacts);
        let [first_half, full_run] = &mut self.law_shares;
        *full_run = full_run.max(law_share);
        if is_first_half {
            *first_half = first_half.max(law_share);
        }
    }
}

/// Work that depends on the motion: that of contacts and laws, and of finer frames [ns a frame].
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::plan) struct CountedCost {
    pub(in crate::plan) contacts_ns: u32,
    /// Of the modes of the bodies that they touch.
    pub(in crate::plan) bodies_ns: u32,
    /// Of frames that the guard computes finer.
    pub(in crate::plan) finer_ns: u32,
}

impl CountedCost {
    /// The mean over `n_frames` of what was counted since `counted_before` [ns]; `finer_step_seconds` is the work of a
    /// step of a finer frame.
    fn new(island: &Island, counted_before: [f64; 2], n_frames: usize, finer_step_seconds: f64) -> Self {
        let counted = cost::counted_ns(island);
        let mean_cost = |ns: f64| (ns / n_frames.max(1) as f64).round() as u32;
        Self {
            contacts_ns: mean_cost(counted[0] - counted_before[0]),
            bodies_ns: mean_cost(counted[1] - counted_before[1]),
            finer_ns: mean_cost(1e9 * finer_step_seconds * island.finer_evaluations() as f64),
        }
    }

    /// Of contacts, laws, and the bodies that they touch.
    pub(in crate::plan) fn links_ns(self) -> u32 {
        self.contacts_ns.saturating_add(self.bodies_ns)
    }

    pub(in crate::plan) fn total_ns(self) -> u32 {
        self.links_ns().saturating_add(self.finer_ns)
    }
}

/// Seconds of work for a frame, by the table of costs.
pub(in crate::plan) fn frame_cost_seconds(island_plan: &IslandPlan) -> f64 {
    let body_costs: f64 = island_plan.bodies.iter().map(cost::body_ns).sum();
    1e-9 * f64::from(island_plan.oversampling)
        * (cost::stepped_ns(&island_plan.network, &island_plan.timeline) + body_costs)
}

pub(in crate::plan) fn is_affordable(island_plan: &IslandPlan, n_frames: usize) -> bool {
    frame_cost_seconds(island_plan) * n_frames as f64 <= TRIAL_WORK_MAX
}

/// How many frames an island rests from its beginning on; 0 if finding that out would take too long.
///
/// # Errors
///
/// Those of [`play`].
pub(in crate::plan) fn resting_frames(island_plan: &IslandPlan, allowance: &Allowance) -> Result<usize, TrialError> {
    if !is_affordable(island_plan, REST_PROBE_FRAMES) {
        return Ok(0);
    }
    let mut meter = WorkMeter::new(island_plan, allowance);
    let mut island = started_island(island_plan, island_plan.contact_substeps)?;
    let mut rest_sound = vec![0.0; REST_PROBE_FRAMES * island.n_out()];
    // Faults are muted: a pilot does not report them.
    let _ = island.process(&mut rest_sound, REST_PROBE_FRAMES, &mut ThreadTeam::alone());
    meter.spend_block(&island, island.computed_frames() as usize)?;
    // An island that comes to rest later sounds before it does.
    if !is_still(&rest_sound, island.n_out()) {
        return Ok(0);
    }
    let rest_frames = island.rest_end_step().unwrap_or(0) / u64::from(island_plan.oversampling);
    Ok(usize::try_from(rest_frames).unwrap_or(0))
}

/// The excerpt that a pilot plays; it has no frames if that would take too long.
///
/// # Errors
///
/// [`TrialError::Engine`] if the island cannot be played, [`TrialError::AllowanceSpent`] if the allowance ends first.
pub(in crate::plan) fn pilot_excerpt(island_plan: &IslandPlan, allowance: &Allowance) -> Result<Excerpt, TrialError> {
    let longest_excerpt = Excerpt {
        first_frame: resting_frames(island_plan, allowance)?,
        n_frames: frames_max(island_plan),
    };
    let frame_rate = frames_per_second(island_plan);
    let pilot_length = excerpt_length(island_plan, (longest_excerpt, frame_rate), allowance);
    // If no length was found, the decision depends on all of `longest_excerpt`.
    let decided_frames = match pilot_length {
        Ok(n_frames) if n_frames > 0 => n_frames,
        _ => longest_excerpt.n_frames,
    };
    allowance.record_frames(longest_excerpt.first_frame + decided_frames);
    Ok(Excerpt {
        n_frames: pilot_length?,
        ..longest_excerpt
    })
}

/// How many frames a pilot plays after the rest; 0 if that would take too long.
fn excerpt_length(
    island_plan: &IslandPlan,
    (excerpt, rate): (Excerpt, f64),
    allowance: &Allowance,
) -> Result<usize, TrialError> {
    let Excerpt {
        first_frame,
        n_frames: longest,
    } = excerpt;
    let frames_after = (PILOT_SECONDS * rate) as usize;
    if island_plan.contact_substeps > 1 {
        let mut island = started_island(island_plan, island_plan.contact_substeps)?;
        let mut meter = WorkMeter::new(island_plan, allowance);
        let mut block_sound = vec![0.0; BLOCK_FRAMES * island.n_out()];
        meter.play_rest(&mut island, first_frame)?;
        for first_frame in (0..longest).step_by(BLOCK_FRAMES) {
            meter.spend_block(&island, BLOCK_FRAMES)?;
            // Faults are muted: a pilot does not report them.
            let _ = island.process(&mut block_sound, BLOCK_FRAMES, &mut ThreadTeam::alone());
            if island.has_closed_fine_contact() {
                return Ok((first_frame + frames_after).min(longest));
            }
        }
        // Nothing touches: the first event decides instead.
    }
    let event_time = next_event(island_plan, f64::NEG_INFINITY, rate);
    let event_time = if event_time.is_finite() {
        event_time.max(0.0)
    } else {
        0.0
    };
    let event_frame = ((event_time * rate).min(1e12) as usize).saturating_sub(first_frame);
    let n_frames = event_frame.saturating_add(frames_after);
    Ok(if n_frames <= longest { n_frames } else { 0 })
}

/// The first event of an island at `earliest` or later [s]; infinite if there is none.
fn next_event(island_plan: &IslandPlan, earliest: f64, rate: f64) -> f64 {
    let timeline = &island_plan.timeline;
    let gesture_times = timeline.gestures.iter().map(|gesture| gesture.start);
    let strike_times = timeline.strikes.iter().map(|strike| strike.instant);
    let ergon_times = timeline.ergons.iter().map(|ergon| ergon.instant);
    let body_plans = island_plan.bodies.iter();
    let body_strikes = body_plans.map(|body| body.next_strike_frame(earliest * rate) / rate);
    let event_times = gesture_times.chain(strike_times).chain(ergon_times).chain(body_strikes);
    event_times
        .filter(|event_time| *event_time >= earliest)
        .fold(f64::INFINITY, f64::min)
}

/// The excerpt up to a while after the next event, for an island that is silent until then; `None` if there is none, or
/// it would take too long.
pub(in crate::plan) fn extended_to_next_event(island_plan: &IslandPlan, excerpt: Excerpt) -> Option<Excerpt> {
    let frame_rate = frames_per_second(island_plan);
    let event_time = next_event(island_plan, excerpt.end() as f64 / frame_rate, frame_rate);
    let end_frame = ((event_time + PILOT_SECONDS) * frame_rate).min(1e12) as usize;
    let n_frames = end_frame.saturating_sub(excerpt.first_frame);
    (event_time.is_finite() && n_frames <= frames_max(island_plan)).then_some(Excerpt { n_frames, ..excerpt })
}

/// Frames that outputs hear in a second [Hz].
pub(in crate::plan) fn frames_per_second(island_plan: &IslandPlan) -> f64 {
    island_plan.timeline.rate.hertz() / f64::from(island_plan.oversampling)
}

/// Most frames of an excerpt.
fn frames_max(island_plan: &IslandPlan) -> usize {
    let work_frames = (TRIAL_WORK_MAX / frame_cost_seconds(island_plan)) as usize;
    work_frames.min((EXCERPT_SECONDS_MAX * frames_per_second(island_plan)) as usize)
}

/// Draws the work of a trial from an allowance, block by block: frames before they are played, and what contacts and
/// guards added to them afterwards.
struct WorkMeter<'a> {
    allowance: &'a Allowance,
    /// Work of a frame [s].
    frame_cost_seconds: f64,
    /// Work of one step of a frame that a guard computes finer [s].
    finer_step_seconds: f64,
    /// What contacts and guards have cost so far [s].
    added_seconds: f64,
}

impl<'a> WorkMeter<'a> {
    fn new(island_plan: &IslandPlan, allowance: &'a Allowance) -> Self {
        let rows_cost: f64 = island_plan.bodies.iter().map(cost::short_rows_ns).sum();
        let short_cost = rows_cost + cost::lone_laws_ns(&island_plan.network);
        let frame_work = frame_cost_seconds(island_plan) + 1e-9 * f64::from(island_plan.oversampling) * short_cost;
        let comparison = 1e-9 * Costs::nanoseconds("comparison") * island_plan.network.outputs().len() as f64;
        Self {
            allowance,
            frame_cost_seconds: frame_work + comparison,
            finer_step_seconds: 1e-9 * cost::finer_step_ns(island_plan),
            added_seconds: 0.0,
        }
    }

    /// Plays the rest before an excerpt; returns the work that the island has counted by then [ns]. Steps that it skips
    /// are counted, but cost nothing.
    fn play_rest(&mut self, island: &mut Island, n_frames: usize) -> Result<[f64; 2], TrialError> {
        let mut rest_sound = vec![0.0; REST_SKIP_FRAMES.min(n_frames) * island.n_out()];
        for first_frame in (0..n_frames).step_by(REST_SKIP_FRAMES) {
            let block_frames = REST_SKIP_FRAMES.min(n_frames - first_frame);
            let computed_before = island.computed_frames();
            let _ = island.process(
                &mut rest_sound[..block_frames * island.n_out()],
                block_frames,
                &mut ThreadTeam::alone(),
            );
            let computed_frames = (island.computed_frames() - computed_before) as usize;
            let skipped_share = 1.0 - computed_frames as f64 / block_frames as f64;
            self.added_seconds += skipped_share * (self.guard_and_contact_seconds(island) - self.added_seconds);
            self.spend_block(island, computed_frames)?;
        }
        Ok(cost::counted_ns(island))
    }

    /// What contacts and guards have added so far [s].
    fn guard_and_contact_seconds(&self, island: &Island) -> f64 {
        let counted: f64 = cost::counted_ns(island).into_iter().sum();
        1e-9 * counted + self.finer_step_seconds * island.finer_evaluations() as f64
    }

    fn spend_block(&mut self, island: &Island, n_frames: usize) -> Result<(), TrialError> {
        let added_work = self.guard_and_contact_seconds(island);
        let more_work = added_work - self.added_seconds;
        self.added_seconds = added_work;
        self.allowance
            .spend(self.frame_cost_seconds * n_frames as f64 + more_work)
    }
}

fn started_island(island_plan: &IslandPlan, contact_substeps: usize) -> Result<Island, Error> {
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Mute,
        threads: 1,
        is_unchecked: false,
    };
    Island::new(
        island_plan.network.clone(),
        &island_plan.timeline,
        &island_plan.bodies,
        StepNumbers {
            frame_interval: 1,
            ..island_plan.step_numbers(contact_substeps)
        },
        options,
    )
}

/// Plays an excerpt of an island.
///
/// # Errors
///
/// [`TrialError::Engine`] if the island cannot be played, [`TrialError::AllowanceSpent`] if the allowance ends first.
pub(in crate::plan) fn play(
    island_plan: &IslandPlan,
    contact_substeps: usize,
    excerpt: Excerpt,
    allowance: &Allowance,
) -> Result<PilotRun, TrialError> {
    let played_plan = (island_plan, contact_substeps);
    play_perturbed(played_plan, excerpt, (excerpt.n_frames, 1.0), allowance)
}

/// The same, but stops as soon as `should_continue`, given the frames played and their sound, is false; `None` if it
/// was stopped.
///
/// # Errors
///
/// Those of [`play`].
pub(in crate::plan) fn play_while(
    played: (&IslandPlan, usize),
    excerpt: Excerpt,
    allowance: &Allowance,
    should_continue: impl FnMut(usize, &[f64]) -> bool,
) -> Result<Option<PilotRun>, TrialError> {
    play_perturbed_while(played, excerpt, (excerpt.n_frames, 1.0), allowance, should_continue)
}

/// Plays an excerpt to its end; in the block that begins at frame `perturbation.0` all motion fades by the factor
/// `perturbation.1` at each step.
///
/// # Errors
///
/// Those of [`play`].
pub(in crate::plan) fn play_perturbed(
    played: (&IslandPlan, usize),
    excerpt: Excerpt,
    perturbation: (usize, f64),
    allowance: &Allowance,
) -> Result<PilotRun, TrialError> {
    let run = play_perturbed_while(played, excerpt, perturbation, allowance, |_, _| true)?;
    Ok(run.unwrap_or_else(|| unreachable!("nothing ends it")))
}

fn play_perturbed_while(
    (island_plan, contact_substeps): (&IslandPlan, usize),
    excerpt: Excerpt,
    (nudge_frame, damping_factor): (usize, f64),
    allowance: &Allowance,
    mut should_continue: impl FnMut(usize, &[f64]) -> bool,
) -> Result<Option<PilotRun>, TrialError> {
    let n_frames = excerpt.n_frames;
    allowance.record_frames(excerpt.end());
    let spent_before = allowance.spent_seconds();
    let mut meter = WorkMeter::new(island_plan, allowance);
    // A run that the allowance cannot pay for is not begun.
    meter
        .allowance
        .check_affordable(frame_cost_seconds(island_plan) * n_frames as f64)?;
    let mut island = started_island(island_plan, contact_substeps)?;
    let counted_at_rest = meter.play_rest(&mut island, excerpt.first_frame)?;
    let n_outputs = island.n_out();
    let mut sound = vec![0.0; n_frames * n_outputs];
    let mut derivatives = Derivatives::new(&island_plan.network, frames_per_second(island_plan));
    let mut squares: Vec<Vec<f64>> = island_plan
        .bodies
        .iter()
        .map(|body| vec![0.0; body.n_modes()])
        .collect();
    let (mut touched_from, mut silent_outputs) = (None, SilentOutputs::new(island_plan, &island));
    let mut energy_gains = EnergyGainShares::default();
    let check_frames = (n_frames / ENERGY_CHECKS_PER_RUN).max(1);
    for first_frame in (0..n_frames).step_by(BLOCK_FRAMES) {
        if first_frame == nudge_frame {
            island.damp(damping_factor);
        } else if first_frame == nudge_frame + BLOCK_FRAMES {
            island.damp(1.0);
        }
        let block_end = (first_frame + BLOCK_FRAMES).min(n_frames);
        let block_sound = &mut sound[first_frame * n_outputs..block_end * n_outputs];
        meter.spend_block(&island, block_end - first_frame)?;
        let _ = island.process(block_sound, block_end - first_frame, &mut ThreadTeam::alone());
        silent_outputs.update(&island, block_sound);
        if first_frame / check_frames < block_end / check_frames || block_end == n_frames {
            energy_gains.update(&island, 2 * block_end <= n_frames);
        }
        derivatives.process(block_sound, n_outputs);
        island.raise_mode_squares(&mut squares);
        silent_outputs.hold_first_values(block_sound, &squares);
        if touched_from.is_none() && cost::counted_ns(&island)[0] > counted_at_rest[0] {
            touched_from = Some(first_frame);
        }
        if !should_continue(block_end, &sound[..block_end * n_outputs]) {
            return Ok(None);
        }
    }
    Ok(Some(PilotRun {
        first_frame: excerpt.first_frame,
        work_seconds: allowance.spent_seconds() - spent_before,
        loudest_share: silent_outputs.loudest_share(&squares),
        energy_gains,
        sound,
        mode_amplitudes_squared: squares,
        counted_cost: CountedCost::new(
            &island,
            counted_at_rest,
            n_frames - touched_from.unwrap_or(0),
            meter.finer_step_seconds,
        ),
        has_diverged: island.n_muted_parts() > 0,
        is_unusable: island.n_muted_parts() > 0 || island.has_energy_risen(),
    }))
}

#[cfg(test)]
mod tests;
