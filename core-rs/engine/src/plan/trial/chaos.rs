//! Runs that part for good (chaos): if the smallest difference grows, no two methods or rates give the same waveform.
//!
//! Chaos is detected by a nudge: for a moment all speeds are reduced slightly, far below the error of any method. In a
//! linear system the difference stays small; if pitches depend on amplitudes, it grows with time or its square; if it
//! grows faster, the motion is chaotic. Waveforms are then compared only until the runs part, and spectra after that.

use crate::assembly::unit::IslandPlan;
use crate::hearing::QUIET_POWER_RATIO;
use crate::hearing::third_octaves::level_difference;
use crate::island::bodies::BodyPlan;
use crate::maths::{log10, sqrt};
use crate::network::{LinkKind, Network};
use crate::plan::constants::{
    ATTACK_ERROR_MIN_DB, ATTACK_SECONDS, FIRST_STRETCH_SECONDS, GROWTH_MARGIN_DB, PERTURBATION_SHARE, UNCORRELATED_DB,
};
use crate::plan::trial::allowance::{Allowance, TrialError};
use crate::plan::trial::pilot_run::{BLOCK_FRAMES, Excerpt, PilotRun, play_perturbed};
use crate::plan::trial::waveform_error::{ComparedSpans, FACTOR_TWO_DB};

/// Stretches of time after the first sound, each ending at twice the time of the one before.
#[derive(Clone, Debug)]
pub(in crate::plan) struct ComparedStretches {
    n_out: usize,
    /// Where the first begins, and where each ends [frames].
    frame_edges: Vec<usize>,
}

/// How far two runs are apart, stretch by stretch [dB], over all outputs, each normalised to the same loudness.
struct DifferenceProfile {
    /// Over each stretch alone; `None` if it is too quiet.
    stretch_db: Vec<Option<f64>>,
    /// From the start of the first to the end of each.
    cumulative_db: Vec<f64>,
}

/// The comparison of two runs that part for good.
#[derive(Clone, Debug)]
pub(in crate::plan) struct ChaoticComparison {
    /// Error from the first sound to the end of each stretch [dB].
    cumulative_errors_db: Vec<f64>,
    /// The error over the attack [dB].
    pub(in crate::plan) attack_error_db: f64,
    /// How much a nudge grows over the attack [dB].
    perturbation_growth_db: f64,
    /// Mean difference of third octaves [dB].
    pub(in crate::plan) third_octave_db: f64,
}

/// Two runs of an island, the second more exact, with the spans and stretches over which they are compared.
#[derive(Clone, Copy)]
pub(in crate::plan) struct RunPair<'a> {
    pub(in crate::plan) coarse_run: &'a PilotRun,
    pub(in crate::plan) fine_run: &'a PilotRun,
    pub(in crate::plan) spans: &'a ComparedSpans,
    pub(in crate::plan) stretches: &'a ComparedStretches,
}

impl ComparedStretches {
    /// Stretches from the first sound after the event.
    pub(in crate::plan) fn new(sound: &[f64], spans: &ComparedSpans) -> Self {
        let (n_outputs, event_frame) = (spans.n_out.max(1), spans.event_frame());
        let event_sound = &sound[(event_frame * n_outputs).min(sound.len())..];
        let displacement = |frame: &[f64], output: usize| (frame[output] - event_sound[output]).abs();
        let mut peak_motion = vec![0.0_f64; n_outputs];
        for frame in event_sound.chunks_exact(n_outputs) {
            (0..n_outputs)
                .for_each(|output| peak_motion[output] = peak_motion[output].max(displacement(frame, output)));
        }
        let is_heard =
            |frame: &[f64]| (0..n_outputs).any(|output| displacement(frame, output) > 1e-3 * peak_motion[output]);
        let silent_frames = event_sound.chunks_exact(n_outputs).position(is_heard).unwrap_or(0);
        Self::from_start(event_frame + silent_frames, sound.len() / n_outputs, spans)
    }

    fn from_start(start: usize, n_frames: usize, spans: &ComparedSpans) -> Self {
        let mut edges = vec![start];
        let mut stretch_length = FIRST_STRETCH_SECONDS * spans.rate;
        while ((start as f64 + 1.5 * stretch_length) as usize) < n_frames {
            edges.push(start + stretch_length as usize);
            stretch_length *= 2.0;
        }
        edges.push(n_frames.max(start));
        Self {
            n_out: spans.n_out,
            frame_edges: edges,
        }
    }

    /// When the first begins [frames].
    fn first_frame(&self) -> usize {
        self.frame_edges[0]
    }

    fn profile(&self, a: &[f64], b: &[f64]) -> DifferenceProfile {
        let stretch_count = self.frame_edges.len() - 1;
        // For each stretch: squared difference, and squared sound.
        let mut stretch_sums = vec![(0.0, 0.0); stretch_count];
        for output in 0..self.n_out {
            let stretch_samples = |x: &[f64], edges: &[usize]| -> Vec<f64> {
                let samples = x.iter().skip(output).step_by(self.n_out);
                samples.skip(edges[0]).take(edges[1] - edges[0]).copied().collect()
            };
            let all_samples = stretch_samples(b, &[self.frame_edges[0], self.frame_edges[stretch_count]]);
            let sample_mean = all_samples.iter().sum::<f64>() / all_samples.len().max(1) as f64;
            let total_energy: f64 = all_samples.iter().map(|x| (x - sample_mean) * (x - sample_mean)).sum();
            if total_energy <= 0.0 {
                continue;
            }
            for (sum, edges) in stretch_sums.iter_mut().zip(self.frame_edges.windows(2)) {
                let (a, b) = (stretch_samples(a, edges), stretch_samples(b, edges));
                let difference_energy: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
                let sound_energy: f64 = b.iter().map(|x| (x - sample_mean) * (x - sample_mean)).sum();
                *sum = (
                    sum.0 + difference_energy / total_energy,
                    sum.1 + sound_energy / total_energy,
                );
            }
        }
        let ratio_level = |(difference_energy, sound_energy): (f64, f64)| {
            let energy_ratio = if difference_energy > 0.0 {
                difference_energy / sound_energy
            } else {
                0.0
            };
            20.0 * log10(sqrt(energy_ratio).clamp(1e-15, 1e15))
        };
        let stretch_power = |stretch: usize| {
            stretch_sums[stretch].1 / (self.frame_edges[stretch + 1] - self.frame_edges[stretch]).max(1) as f64
        };
        let loudest_power = (0..stretch_count).map(stretch_power).fold(0.0, f64::max);
        let mut running_sums = (0.0, 0.0);
        DifferenceProfile {
            stretch_db: (0..stretch_count)
                .map(|stretch| {
                    (stretch_power(stretch) > QUIET_POWER_RATIO * loudest_power)
                        .then(|| ratio_level(stretch_sums[stretch]))
                })
                .collect(),
            cumulative_db: stretch_sums
                .iter()
                .map(|sum| {
                    running_sums = (running_sums.0 + sum.0, running_sums.1 + sum.1);
                    ratio_level(running_sums)
                })
                .collect(),
        }
    }

    /// How many stretches end within `seconds`; at least one.
    fn count_within(&self, seconds: f64, spans: &ComparedSpans) -> usize {
        let last_frame = self.first_frame() + (seconds * spans.rate) as usize;
        let stretch_ends = self.frame_edges.iter().skip(1);
        stretch_ends.take_while(|end| **end <= last_frame).count().max(1)
    }
}

impl RunPair<'_> {
    /// How much a nudge of `coarse_run` grows over the attack [dB], if that shows chaos; `None` otherwise.
    pub(in crate::plan) fn chaotic_growth_db(
        &self,
        island_plan: &IslandPlan,
        contact_substeps: usize,
        allowance: &Allowance,
    ) -> Result<Option<f64>, TrialError> {
        if self.coarse_run.is_unusable || is_linear(island_plan) {
            return Ok(None);
        }
        let growth_levels = self.perturbation_difference_db(island_plan, contact_substeps, allowance)?;
        if !is_chaotic(&growth_levels) {
            return Ok(None);
        }
        let last_stretch = self.stretches.count_within(ATTACK_SECONDS, self.spans) - 1;
        let growth_of = |stretch: usize| growth_levels.get(stretch).copied().flatten();
        Ok(Some(
            growth_of(0)
                .zip(growth_of(last_stretch))
                .map_or(0.0, |(first_growth, last_growth)| last_growth - first_growth),
        ))
    }

    /// Compares the runs, given that a nudge grows by `growth_db` over the attack [dB]. The finer one parts from the
    /// true motion too, so errors of the waveform count twice.
    pub(in crate::plan) fn compare(&self, growth_db: f64) -> ChaoticComparison {
        let (run_sound, finer_sound) = (&self.coarse_run.sound, &self.fine_run.sound);
        let mut cumulative_errors = self.stretches.profile(run_sound, finer_sound).cumulative_db;
        cumulative_errors.iter_mut().for_each(|db| *db += FACTOR_TWO_DB);
        let first_sample = self.stretches.first_frame() * self.spans.n_out;
        let (n_outputs, frame_rate) = (self.spans.n_out, self.spans.rate);
        ChaoticComparison {
            attack_error_db: cumulative_errors[self.stretches.count_within(ATTACK_SECONDS, self.spans) - 1],
            cumulative_errors_db: cumulative_errors,
            perturbation_growth_db: growth_db,
            third_octave_db: level_difference(
                &run_sound[first_sample..],
                &finer_sound[first_sample..],
                n_outputs,
                frame_rate,
            ),
        }
    }

    /// How far a nudge takes the run from itself, stretch by stretch [dB].
    fn perturbation_difference_db(
        &self,
        island_plan: &IslandPlan,
        contact_substeps: usize,
        allowance: &Allowance,
    ) -> Result<Vec<Option<f64>>, TrialError> {
        let n_frames = self.coarse_run.sound.len() / self.spans.n_out.max(1);
        let perturbed_frame = self.stretches.first_frame().next_multiple_of(BLOCK_FRAMES);
        let perturbed_run = play_perturbed(
            (island_plan, contact_substeps),
            Excerpt {
                first_frame: self.coarse_run.first_frame,
                n_frames,
            },
            (perturbed_frame, 1.0 - PERTURBATION_SHARE),
            allowance,
        )?;
        // After the nudged block the run goes on freely.
        let free_stretches = ComparedStretches::from_start(perturbed_frame + BLOCK_FRAMES, n_frames, self.spans);
        Ok(free_stretches
            .profile(&perturbed_run.sound, &self.coarse_run.sound)
            .stretch_db)
    }
}

/// Whether a nudge grows faster than in any regular motion.
fn is_chaotic(growth_levels: &[Option<f64>]) -> bool {
    // The difference of a regular motion grows at most with the square of time.
    let growth_per_stretch = 2.0 * FACTOR_TWO_DB;
    let grows_fast = |(i, early_level): (usize, &Option<f64>)| {
        let later_growths = growth_levels.iter().enumerate().skip(i + 1);
        let regular_level_max =
            |j: usize, early_level: f64| early_level + growth_per_stretch * (j - i) as f64 + GROWTH_MARGIN_DB;
        later_growths.into_iter().any(|(j, late_level)| {
            early_level
                .zip(*late_level)
                .is_some_and(|(early_level, late_level)| late_level > regular_level_max(j, early_level))
        })
    };
    growth_levels.iter().enumerate().any(grows_fast)
}

impl ChaoticComparison {
    /// Whether an attack with an error as small as `error_limit_db` is attainable: errors of the first stretch, at
    /// least `ATTACK_ERROR_MIN_DB`, grow by `perturbation_growth_db`.
    pub(in crate::plan) fn is_attainable(&self, error_limit_db: f64) -> bool {
        error_limit_db - self.perturbation_growth_db > ATTACK_ERROR_MIN_DB
    }

    /// Returns an error [dB] and the frame until which it holds: as long as the error is at most `error_allowed`; if it
    /// never is, as long as the runs agree at all.
    pub(in crate::plan) fn valid_span(&self, error_allowed: f64, stretches: &ComparedStretches) -> (f64, usize) {
        let count_below = |error_max: f64| {
            self.cumulative_errors_db
                .iter()
                .take_while(|db| **db <= error_max)
                .count()
        };
        let stretch_count = [count_below(error_allowed), count_below(UNCORRELATED_DB), 1]
            .into_iter()
            .find(|stretch_count| *stretch_count > 0)
            .unwrap_or(1);
        (
            self.cumulative_errors_db[stretch_count - 1],
            stretches.frame_edges[stretch_count],
        )
    }
}

/// Whether nothing makes the motion depend on how strongly it is excited: no law, no contact, no link in space, and no
/// hand whose force is limited.
pub(in crate::plan) fn is_linear(island_plan: &IslandPlan) -> bool {
    let is_linear = |network: &Network| network.runs().iter().all(|run| matches!(run.kind, LinkKind::Ref));
    let body_networks = island_plan.bodies.iter().filter_map(|body| match body {
        BodyPlan::Mesh(mesh) => Some(&*mesh.network),
        BodyPlan::Slow(slow) => (!slow.is_linear()).then_some(&*slow.network),
        BodyPlan::Modal(_) => None,
    });
    let gestures = &island_plan.timeline.gestures;
    gestures.iter().all(|gesture| gesture.manner.force_max.is_none())
        && body_networks.chain([&*island_plan.network]).all(is_linear)
}
