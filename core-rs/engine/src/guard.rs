//! The guard of links that stiffen: frames in which they would make a scheme diverge are computed in smaller steps.
//! `watch` finds such frames; `finer` computes them, by `kernel_system` or, for meshes, by `integrate/mesh_system`.
//!
//! A certificate uses the slope of every law at rest. Away from rest, λmax(M⁻¹(K + 2Z)) is at most its value at rest
//! plus the largest edge sum of the links' stiffening. If this bound is too near the limit at the end of a frame, the
//! frame is computed again in 2, 4 or 8 steps of CA.

mod cells;
mod finer;
mod kernel_system;
mod watch;

pub(crate) use finer::{MatMotion, SubsteppedSystem};
pub(crate) use kernel_system::KernelSystem;

use crate::archive::{Archive, Damaged, State, state_of};
use std::ops::Range;
use std::sync::Arc;

use crate::network::forest::{Forest, joined_pairs};
use crate::network::{Error, Network};
use crate::scheme::{Scheme, largest_eigenvalue};
use crate::state::PreviousState;
use cells::TieFactors;
use watch::{WatchedRun, least_reach_left, set_reaches, watched_runs};

/// λ up to which steps of CA are trusted; they are stable up to 4. Near 4 the motion between samples overshoots, and
/// the laws turn the overshoot into energy: with 3.6 here, a gong struck at its limit of stability gains a quarter of
/// the energy put in; with 2.0 it gains none (`tests/scenes/stiff.rs`).
const TRUSTED_LAMBDA_MAX: f64 = 2.0;
/// Largest number of steps in a frame.
const STEPS_MAX: u32 = 8;
/// Frames in two steps end when links use at most this share of the allowed stiffening. The margin keeps the number of
/// steps from changing often: each change costs energy.
const CALM_SHARE: f64 = 0.5;
/// Successive frames for which fewer steps must have been enough before their number is halved: an oscillating link is
/// slack each time it passes its middle.
const CALM_FRAMES: u32 = 64;

/// Stability limit of a stepping method.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StabilityLimit {
    /// Weight c of the damping in the guarded quantity λmax(M⁻¹(K + c·Z)).
    pub(crate) damping_weight: f64,
    /// Largest λ up to which the method's energy is trusted.
    pub(crate) trusted_lambda: f64,
    /// Largest λ at rest that the certificate accepts.
    pub(crate) accepted_lambda: f64,
    /// Whether springs to the ground are CELs, whose κ and ζ come from their poles at this rate.
    pub(crate) has_poles: bool,
}

impl StabilityLimit {
    /// The scheme of CORDIS-ANIMA.
    pub(crate) const CA: Self = Self {
        damping_weight: 2.0,
        trusted_lambda: TRUSTED_LAMBDA_MAX,
        accepted_lambda: 4.0,
        has_poles: true,
    };
}

/// How many frames were computed with smaller steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FinerFrames {
    pub(crate) frames: u64,
    /// Largest number of steps in one frame.
    pub(crate) steps_max: u32,
    /// How often the forces of all links were computed for them.
    pub(crate) evaluations: u64,
    /// The MAT whose links had stiffened most when the last series of finer frames began.
    pub(crate) stiffest_mat: usize,
}

crate::archive::state!(FinerFrames {
    frames,
    steps_max,
    evaluations,
    stiffest_mat
});

impl FinerFrames {
    /// The count in whole frames, where one frame has `steps` guarded steps.
    pub(crate) fn per_frame(self, steps: u32) -> Self {
        Self {
            frames: self.frames.div_ceil(u64::from(steps)),
            ..self
        }
    }
}

/// The guard of one network: the links that it watches, and its buffers.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    watched_runs: Vec<WatchedRun>,
    /// From the first to the last MAT that a watched link joins.
    watched_mats: Range<usize>,
    /// MATs whose positions come from outside.
    pub(crate) ports: Vec<usize>,
    /// MATs that no path of links joins with a watched link.
    unrelated_mats: Vec<usize>,
    tie_factors: Option<Arc<TieFactors>>,
    /// 1/M that a force at each MAT meets if there are proxies; empty: the scheme's `w`   (n_mat)
    compliance: Vec<f64>,
    /// λ at rest.
    rest_lambda: f64,
    /// Largest λ at which a frame is computed in one step.
    lambda_limit: f64,
    /// How far elongations may still change before they have to be checked [m].
    elongation_margin: f64,
    /// Steps of this frame; 1: an ordinary frame.
    frame_steps: u32,
    /// Steps of the previous frame.
    previous_frame_steps: u32,
    /// Number of successive frames for which fewer steps would have been enough.
    calm_frames: u32,
    finer_frames: FinerFrames,
    /// Last step of a finer frame minus the mean of its steps [m a frame]   (n_mat)
    last_step_excess: Vec<f64>,
    /// Positions and steps at the beginning of the frame             (n_mat each)
    start_positions: Vec<f64>,
    start_steps: Vec<f64>,
    /// Forces from outside in the frame [N]                          (n_mat)
    outside_forces: Vec<f64>,
    /// Distance over which outside forces act in a finer frame [m]   (n_mat)
    force_travel: Vec<f64>,
    /// Change of the step by links and ties alone over one frame [m a frame]   (n_mat)
    link_steps: Vec<f64>,
    /// Stiffening of all links at each MAT [N/m]                     (n_mat)
    stiffening_sums: Vec<f64>,
    /// Stiffening of the links of one run [N/m]                      (longest run)
    stiffness_rises: Vec<f64>,
    /// κ and ζ of CELs in the steps of this frame                   (n_mat each; empty: no CELs)
    substep_ties: [Vec<f64>; 2],
    /// MATs whose path in the frame is imposed: (MAT, from [m], to [m]).
    imposed_paths: Vec<(usize, f64, f64)>,
}

crate::archive::option!(Guard, fixed);
crate::archive::option!(Box<Guard>, fixed);

impl State for Guard {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        archive.list(&mut self.imposed_paths)?;
        state_of!(
            self,
            archive,
            elongation_margin,
            frame_steps,
            previous_frame_steps,
            calm_frames,
            finer_frames,
            last_step_excess,
            start_positions,
            start_steps,
            outside_forces,
            force_travel,
            link_steps,
            stiffening_sums,
            stiffness_rises,
            substep_ties
        )
    }
}

impl Guard {
    /// The guard of a network stepped by a method with this limit; `ports` are moved from outside. `None`: no link can
    /// stiffen beyond the limit, or the network is unstable at rest.
    ///
    /// # Errors
    /// If the spectrum at rest cannot be computed.
    pub(crate) fn new(
        scheme: &Scheme,
        network: &Network,
        limit: StabilityLimit,
        ports: &[usize],
    ) -> Result<Option<Self>, Error> {
        let compliance = scheme.force_compliances();
        let w = if compliance.is_empty() { &scheme.w } else { &compliance };
        let is_moving = |mat: usize| w[mat] > 0.0 && !ports.contains(&mat);
        let mut runs = watched_runs(&scheme.runs, is_moving);
        if runs.is_empty() {
            return Ok(None);
        }
        let target_lambda = 0.5 * limit.trusted_lambda;
        let rest_lambda = largest_eigenvalue(scheme, network, limit.damping_weight, target_lambda)?.lambda;
        if rest_lambda >= limit.accepted_lambda {
            return Ok(None); // unstable at rest: the certificate refuses it
        }
        // If λ at rest is near or above `trusted_lambda`, links may still use a quarter of the distance from it to
        // `accepted_lambda`.
        let has_poles = limit.has_poles;
        let lambda_limit = f64::max(
            limit.trusted_lambda,
            rest_lambda + 0.25 * (limit.accepted_lambda - rest_lambda),
        );
        set_reaches(&mut runs, lambda_limit - rest_lambda, w);
        if runs.is_empty() {
            return Ok(None);
        }
        let watched_ends = || runs.iter().flat_map(|run| [run.a, run.b]);
        let longest_run = runs.iter().map(|run| run.len).max().unwrap_or(0);
        let last_mats = runs.iter().map(|run| run.a.max(run.b) + run.len);
        let zero_vector = || vec![0.0; scheme.n_mat()];
        let tie_factors = TieFactors::new(scheme, network, has_poles)?.map(Arc::new);
        let tie_buffer = || tie_factors.as_ref().map_or_else(Vec::new, |_| zero_vector());
        Ok(Some(Self {
            substep_ties: [tie_buffer(), tie_buffer()],
            watched_mats: watched_ends().min().unwrap_or(0)..last_mats.max().unwrap_or(0),
            ports: ports.to_vec(),
            unrelated_mats: unrelated_mats(network, scheme, &runs),
            tie_factors,
            rest_lambda,
            lambda_limit,
            elongation_margin: f64::NEG_INFINITY,
            frame_steps: 1,
            previous_frame_steps: 1,
            calm_frames: 0,
            finer_frames: FinerFrames::default(),
            last_step_excess: zero_vector(),
            start_positions: zero_vector(),
            start_steps: zero_vector(),
            outside_forces: zero_vector(),
            force_travel: zero_vector(),
            link_steps: zero_vector(),
            stiffening_sums: zero_vector(),
            stiffness_rises: vec![0.0; longest_run],
            imposed_paths: Vec::new(),
            compliance,
            watched_runs: runs,
        }))
    }

    /// Reserve room for `n_imposed` MATs with an imposed path, beside the ports.
    pub(crate) fn reserve(&mut self, n_imposed: usize) {
        let count_max = n_imposed + self.ports.len();
        self.imposed_paths
            .reserve(count_max.saturating_sub(self.imposed_paths.len()));
    }

    /// The frames computed finer so far; `None`: no frame was.
    pub(crate) fn finer_frames(&self) -> Option<FinerFrames> {
        (self.finer_frames.frames > 0).then_some(self.finer_frames)
    }

    /// Whether frames are computed finer for now.
    pub(crate) fn is_finer(&self) -> bool {
        self.frame_steps > 1
    }

    /// Restore unrelated MATs to where the ordinary frame took them.
    pub(crate) fn restore_unrelated(&mut self, previous: &PreviousState, x: &mut [f64], d: &mut [f64]) {
        for &mat in &self.unrelated_mats {
            (x[mat], d[mat]) = (previous.x[mat], previous.d[mat]);
            self.force_travel[mat] = 0.5 * (self.start_steps[mat] + previous.d[mat]);
        }
    }

    /// Distance over which outside forces acted in the last finer frame [m], for the ledger   (n_mat).
    pub(crate) fn force_travel(&self) -> &[f64] {
        &self.force_travel
    }

    /// Return to ordinary frames and check elongations anew, after MATs were moved.
    pub(crate) fn reset(&mut self) {
        (self.frame_steps, self.previous_frame_steps, self.calm_frames) = (1, 1, 0);
        self.elongation_margin = f64::NEG_INFINITY;
    }

    /// Scale `last_step_excess`, when all velocities are scaled by a factor.
    pub(crate) fn scale_velocities(&mut self, factor: f64) {
        if self.frame_steps > 1 {
            self.last_step_excess.iter_mut().for_each(|excess| *excess *= factor);
        }
    }

    /// Stop watching links of the MATs for which `is_muted` holds.
    pub(crate) fn unwatch(&mut self, is_muted: impl Fn(usize) -> bool) {
        let touches_muted = |first: usize, len| (first..first + len).any(&is_muted);
        self.watched_runs
            .retain(|run| !touches_muted(run.a, run.len) && !touches_muted(run.b, run.len));
        self.reset();
    }

    /// Whether an ordinary frame that ended at `x` by steps `d` has to be computed again, finer   (n_mat each).
    pub(crate) fn needs_finer(&mut self, x: &[f64], d: &[f64], w: &[f64]) -> bool {
        if self.frame_steps > 1 {
            return true;
        }
        self.elongation_margin -= 2.0 * watch::magnitude_max(&d[self.watched_mats.clone()]);
        // A NaN margin counts as used up.
        if self.elongation_margin > 0.0 {
            return false;
        }
        let (lambda_rise, worst_mat) = self.lambda_rise(x, w);
        let needs_steps = self.steps_needed(lambda_rise) > 1;
        if needs_steps {
            self.finer_frames.stiffest_mat = worst_mat;
        }
        needs_steps
    }

    /// A bound on the rise of λ by stiffening at `x`, and the MAT where it is largest; (0, 0) if every elongation is
    /// within its reach.
    fn lambda_rise(&mut self, x: &[f64], w: &[f64]) -> (f64, usize) {
        self.elongation_margin = least_reach_left(&self.watched_runs, x);
        if self.elongation_margin > 0.0 {
            return (0.0, 0);
        }
        self.lambda_rise_exact(x, w)
    }

    /// [`Guard::lambda_rise`] without the shortcut.
    fn lambda_rise_exact(&mut self, x: &[f64], w: &[f64]) -> (f64, usize) {
        let w = if self.compliance.is_empty() {
            w
        } else {
            &self.compliance
        };
        watch::lambda_rise_bound(
            &self.watched_runs,
            &self.watched_mats,
            x,
            w,
            &mut self.stiffening_sums,
            &mut self.stiffness_rises,
        )
    }

    /// Number of steps that a frame needs if links raise λ by `lambda_rise`; above [`STEPS_MAX`] if no number is
    /// enough.
    fn steps_needed(&self, lambda_rise: f64) -> u32 {
        if self.rest_lambda + lambda_rise <= self.lambda_limit {
            return 1;
        }
        let is_enough = |step_count: &u32| {
            let step_count = f64::from(*step_count);
            self.rest_lambda / step_count + lambda_rise / (step_count * step_count) <= TRUSTED_LAMBDA_MAX
        };
        [2, 4, STEPS_MAX].into_iter().find(is_enough).unwrap_or(2 * STEPS_MAX)
    }
}

/// MATs that no path of links joins with a watched link.
fn unrelated_mats(network: &Network, scheme: &Scheme, watched_runs: &[WatchedRun]) -> Vec<usize> {
    let mat_count = scheme.n_mat();
    let mut link_forest = Forest::new(mat_count);
    let is_moving = |mat: usize| scheme.w[mat] > 0.0 || scheme.is_proxy(mat);
    for (a, b) in joined_pairs(network) {
        if is_moving(a) && is_moving(b) {
            link_forest.join(a, b);
        }
    }
    let mut is_watched = vec![false; mat_count];
    for run in watched_runs {
        for first in [run.a, run.b] {
            (first..first + run.len).for_each(|mat| is_watched[link_forest.root(mat)] = true);
        }
    }
    (0..mat_count)
        .filter(|&mat| !is_watched[link_forest.root(mat)])
        .collect()
}

#[cfg(test)]
mod tests;
