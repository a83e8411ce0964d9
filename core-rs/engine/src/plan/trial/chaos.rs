//! Runs that part for good (chaos): if the smallest difference grows, no two methods or rates give the same waveform.
//!
//! Chaos is detected by a nudge: for a moment all speeds are reduced slightly, far below the error of any method. In a
//! linear system the difference stays small; if pitches depend on amplitudes, it grows with time or its square; if it
//! grows faster, the motion is chaotic. Waveforms are then compared only until the runs part, and spectra after that.

use crate::island::inside::BodyPlan;
use crate::maths::{log10, sqrt};
use crate::network::{LinkKind, Network};
use crate::plan::IslandPlan;
use crate::plan::constants::{
    ATTACK, ATTACK_ERROR_MIN, DOUBLING, NUDGE, PARTED, QUIET, REGULAR, STRETCH,
};
use crate::plan::trial::allowance::{Allowance, TrialError};
use crate::plan::trial::pilot_run::{BLOCK, Excerpt, PilotRun, nudged};
use crate::plan::trial::third_octaves::level_difference;
use crate::plan::trial::waveform_error::Spans;

/// Stretches of time after the first sound, each ending at twice the time of the one before.
#[derive(Clone, Debug)]
pub(in crate::plan) struct Stretches {
    n_out: usize,
    /// Where the first begins, and where each ends [frames].
    edges: Vec<usize>,
}

/// How far two runs are apart, stretch by stretch [dB], over all outputs, each normalised to the same loudness.
struct Profile {
    /// Over each stretch alone; `None` if it is too quiet.
    alone: Vec<Option<f64>>,
    /// From the start of the first to the end of each.
    upto: Vec<f64>,
}

/// The comparison of two runs that part for good.
#[derive(Clone, Debug)]
pub(in crate::plan) struct Parting {
    /// Error from the first sound to the end of each stretch [dB].
    upto: Vec<f64>,
    /// The error over the attack [dB].
    pub(in crate::plan) attack: f64,
    /// How much a nudge grows over the attack [dB].
    growth: f64,
    /// Mean difference of third octaves [dB].
    pub(in crate::plan) spectral: f64,
}

/// Two runs of an island, the second more exact, with the spans and stretches over which they are compared.
#[derive(Clone, Copy)]
pub(in crate::plan) struct Pair<'a> {
    pub(in crate::plan) run: &'a PilotRun,
    pub(in crate::plan) finer: &'a PilotRun,
    pub(in crate::plan) spans: &'a Spans,
    pub(in crate::plan) stretches: &'a Stretches,
}

impl Stretches {
    /// Stretches from the first sound after the event.
    pub(in crate::plan) fn new(sound: &[f64], spans: &Spans) -> Self {
        let (n_out, from) = (spans.n_out.max(1), spans.event());
        let start = &sound[(from * n_out).min(sound.len())..];
        let size = |frame: &[f64], output: usize| (frame[output] - start[output]).abs();
        let mut peak = vec![0.0_f64; n_out];
        for frame in start.chunks_exact(n_out) {
            (0..n_out).for_each(|output| peak[output] = peak[output].max(size(frame, output)));
        }
        let is_heard =
            |frame: &[f64]| (0..n_out).any(|output| size(frame, output) > 1e-3 * peak[output]);
        let silent = start.chunks_exact(n_out).position(is_heard).unwrap_or(0);
        Self::from(from + silent, sound.len() / n_out, spans)
    }

    fn from(start: usize, n_frames: usize, spans: &Spans) -> Self {
        let mut edges = vec![start];
        let mut length = STRETCH * spans.rate;
        while ((start as f64 + 1.5 * length) as usize) < n_frames {
            edges.push(start + length as usize);
            length *= 2.0;
        }
        edges.push(n_frames.max(start));
        Self {
            n_out: spans.n_out,
            edges,
        }
    }

    /// When the first begins [frames].
    fn start(&self) -> usize {
        self.edges[0]
    }

    fn profile(&self, a: &[f64], b: &[f64]) -> Profile {
        let n = self.edges.len() - 1;
        // For each stretch: squared difference, and squared sound.
        let mut sums = vec![(0.0, 0.0); n];
        for output in 0..self.n_out {
            let levels = |x: &[f64], edges: &[usize]| -> Vec<f64> {
                let samples = x.iter().skip(output).step_by(self.n_out);
                samples
                    .skip(edges[0])
                    .take(edges[1] - edges[0])
                    .copied()
                    .collect()
            };
            let all = levels(b, &[self.edges[0], self.edges[n]]);
            let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
            let loud: f64 = all.iter().map(|x| (x - mean) * (x - mean)).sum();
            if loud <= 0.0 {
                continue;
            }
            for (sum, edges) in sums.iter_mut().zip(self.edges.windows(2)) {
                let (a, b) = (levels(a, edges), levels(b, edges));
                let apart: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
                let energy: f64 = b.iter().map(|x| (x - mean) * (x - mean)).sum();
                *sum = (sum.0 + apart / loud, sum.1 + energy / loud);
            }
        }
        let db = |(apart, energy): (f64, f64)| {
            let ratio = if apart > 0.0 { apart / energy } else { 0.0 };
            20.0 * log10(sqrt(ratio).clamp(1e-15, 1e15))
        };
        let power = |at: usize| sums[at].1 / (self.edges[at + 1] - self.edges[at]).max(1) as f64;
        let loudest = (0..n).map(power).fold(0.0, f64::max);
        let mut so_far = (0.0, 0.0);
        Profile {
            alone: (0..n)
                .map(|at| (power(at) > QUIET * loudest).then(|| db(sums[at])))
                .collect(),
            upto: sums
                .iter()
                .map(|sum| {
                    so_far = (so_far.0 + sum.0, so_far.1 + sum.1);
                    db(so_far)
                })
                .collect(),
        }
    }

    /// How many stretches end within `seconds`; at least one.
    fn count_within(&self, seconds: f64, spans: &Spans) -> usize {
        let last = self.start() + (seconds * spans.rate) as usize;
        let ends = self.edges.iter().skip(1);
        ends.take_while(|end| **end <= last).count().max(1)
    }
}

impl Pair<'_> {
    /// How much a nudge of `run` grows over the attack [dB], if that shows chaos; `None` otherwise.
    pub(in crate::plan) fn chaos(
        &self,
        island_plan: &IslandPlan,
        contact_substeps: usize,
        allowance: &Allowance,
    ) -> Result<Option<f64>, TrialError> {
        if self.run.is_lost || is_linear(island_plan) {
            return Ok(None);
        }
        let grown = self.nudge(island_plan, contact_substeps, allowance)?;
        if !is_chaotic(&grown) {
            return Ok(None);
        }
        let last = self.stretches.count_within(ATTACK, self.spans) - 1;
        let growth_of = |stretch: usize| grown.get(stretch).copied().flatten();
        Ok(Some(
            growth_of(0)
                .zip(growth_of(last))
                .map_or(0.0, |(first, last)| last - first),
        ))
    }

    /// Compares the runs, given that a nudge grows by `growth` over the attack [dB]. The finer one parts from the true
    /// motion too, so errors of the waveform count twice.
    pub(in crate::plan) fn compare(&self, growth: f64) -> Parting {
        let (run, finer) = (&self.run.sound, &self.finer.sound);
        let mut upto = self.stretches.profile(run, finer).upto;
        upto.iter_mut().for_each(|db| *db += DOUBLING);
        let from = self.stretches.start() * self.spans.n_out;
        let (n_out, rate) = (self.spans.n_out, self.spans.rate);
        Parting {
            attack: upto[self.stretches.count_within(ATTACK, self.spans) - 1],
            upto,
            growth,
            spectral: level_difference(&run[from..], &finer[from..], n_out, rate),
        }
    }

    /// How far a nudge takes the run from itself, stretch by stretch [dB].
    fn nudge(
        &self,
        island_plan: &IslandPlan,
        contact_substeps: usize,
        allowance: &Allowance,
    ) -> Result<Vec<Option<f64>>, TrialError> {
        let n_frames = self.run.sound.len() / self.spans.n_out.max(1);
        let from = self.stretches.start().next_multiple_of(BLOCK);
        let nudged = nudged(
            (island_plan, contact_substeps),
            Excerpt {
                from: self.run.from,
                n_frames,
            },
            (from, 1.0 - NUDGE),
            allowance,
        )?;
        // After the nudged block the run goes on freely.
        let after = Stretches::from(from + BLOCK, n_frames, self.spans);
        Ok(after.profile(&nudged.sound, &self.run.sound).alone)
    }
}

/// Whether a nudge grows faster than in any regular motion.
fn is_chaotic(grown: &[Option<f64>]) -> bool {
    let (a_stretch, chance) = REGULAR;
    let grows = |(i, early): (usize, &Option<f64>)| {
        let later = grown.iter().enumerate().skip(i + 1);
        let apart_max = |j: usize, early: f64| early + a_stretch * (j - i) as f64 + chance;
        later.into_iter().any(|(j, late)| {
            early
                .zip(*late)
                .is_some_and(|(early, late)| late > apart_max(j, early))
        })
    };
    grown.iter().enumerate().any(grows)
}

impl Parting {
    /// Whether an attack with an error as small as `attack` [dB] is attainable: errors of the first stretch, at least
    /// `ATTACK_ERROR_MIN`, grow by `growth`.
    pub(in crate::plan) fn is_attainable(&self, attack: f64) -> bool {
        attack - self.growth > ATTACK_ERROR_MIN
    }

    /// Returns an error [dB] and the frame until which it holds: as long as the error is at most `asked`; if it never
    /// is, as long as the runs agree at all.
    pub(in crate::plan) fn valid_span(&self, asked: f64, stretches: &Stretches) -> (f64, usize) {
        let count_below = |most: f64| self.upto.iter().take_while(|db| **db <= most).count();
        let n = [count_below(asked), count_below(PARTED), 1]
            .into_iter()
            .find(|n| *n > 0)
            .unwrap_or(1);
        (self.upto[n - 1], stretches.edges[n])
    }
}

/// Whether nothing makes the motion depend on how strongly it is excited: no law, no contact, no link in space, and no
/// hand whose force is limited.
pub(in crate::plan) fn is_linear(island_plan: &IslandPlan) -> bool {
    let is_linear = |network: &Network| {
        network
            .runs()
            .iter()
            .all(|run| matches!(run.kind, LinkKind::Ref))
    };
    let meshes = island_plan.bodies.iter().filter_map(|body| match body {
        BodyPlan::Mesh(mesh) => Some(&*mesh.network),
        BodyPlan::Slow(slow) => (!slow.is_linear()).then_some(&*slow.network),
        BodyPlan::Modal(_) => None,
    });
    let gestures = &island_plan.timeline.gestures;
    gestures
        .iter()
        .all(|gesture| gesture.manner.limit.is_none())
        && meshes.chain([&*island_plan.network]).all(is_linear)
}
