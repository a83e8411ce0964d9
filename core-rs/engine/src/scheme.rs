//! Network → Scheme: the numbers of the CA scheme at one rate.
//!
//! The scheme is in delta form: with the state d = x[n] − x[n−1], d += F/M − κ(x − rest) − ζd, x += d. It equals x⁺ =
//! 2x − x⁻ + F/M, and is more accurate if positions are large and steps small.

mod certify;
mod discretise;
mod equal_ranges;
mod force_sums;
mod link;
mod lone_links;
mod spring;
mod springs;
mod taps;

pub use certify::{BoundMethod, Certificate, StabilityGuarantee};
pub(crate) use certify::{LargestEigenvalue, RefusalDetail, largest_eigenvalue, largest_eigenvalue_up_to};
pub(crate) use force_sums::{ForceSums, LINK_LANES, SUM_LANES};
pub(crate) use link::tension_energy;
pub(crate) use lone_links::{LinkBlock, LoneLinks, are_lone};
pub(crate) use spring::{ForceEnds, Spring};
pub(crate) use springs::FusedSprings;
pub(crate) use taps::Tap;

use std::sync::Arc;

use discretise::TieDiscretisation;
use equal_ranges::EqualRange;

use crate::law::{Hardening, Law};
use crate::network::forest::Forest;
use crate::network::{
    Bristle, But, Dry, Error, Followed, FollowingMass, Network, Output, PairRun, Pairwise, Proxy, SpaceLink,
};
use crate::units::Rate;

/// The law of a run of links, with numbers per step.
#[derive(Clone, Debug)]
pub(crate) enum LinkRunKind {
    Ref,
    /// A hardening spring whose K and Z can change in time: f = k·e + q·e³ + z·(e − e⁻), q [N/m³].
    Hardening(f64),
    But(But),
    Lnl {
        law: Arc<Law>,
        /// Per-sample velocity times this is the law's v: 1/T, or T_ca/T under `ca`.
        velocity_factor: f64,
        /// Index of the law in the scratch memory; runs with the same law share it.
        slot: usize,
    },
    /// A law with constants that follow MATs.
    Followed {
        law: Followed,
        /// As for `Lnl`.
        velocity_factor: f64,
        /// Index of the law with the current values of its constants.
        slot: usize,
    },
    /// Friction with memory; K of the run is σ0, Z is Fc [N].
    Bristle {
        law: Bristle,
        /// As for `Lnl`.
        velocity_factor: f64,
    },
    /// Dry friction, solved after all other forces are known; Z of the run is F [N].
    Dry {
        law: Dry,
        /// As for `Lnl`.
        velocity_factor: f64,
    },
    /// Spring or contact between points in space.
    Space(SpaceLink),
    /// Contacts between all pairs of points of two groups.
    Pairwise {
        pairs: Pairwise,
        /// Index of its neighbour list and of its contact history.
        slot: usize,
    },
}

/// A run of links in numbers per step: f = k·e + z·(e − e⁻) for springs.
#[derive(Clone, Debug)]
pub(crate) struct LinkRun {
    pub(crate) kind: LinkRunKind,
    pub(crate) a: usize,
    pub(crate) b: usize,
    pub(crate) len: usize,
    pub(crate) first_link: usize,
    pub(crate) k: f64,
    pub(crate) z: f64,
    pub(crate) rest: f64,
    /// Index of the gate that opens and closes the run (a coupling), if any.
    pub(crate) gate: Option<usize>,
}

impl LinkRun {
    /// Turn a hardening law into numbers K and Z of this run, which can then change.
    pub(crate) fn make_adjustable(&mut self) {
        if let LinkRunKind::Lnl {
            law, velocity_factor, ..
        } = &self.kind
            && let Some(Hardening { k, q, z }) = law.hardening_spring()
        {
            (self.k, self.z) = (k, z.unwrap_or(0.0) * velocity_factor);
            self.kind = LinkRunKind::Hardening(q);
        }
    }

    /// Number of axes along which its links act.
    pub(crate) fn n_axes(&self) -> usize {
        match &self.kind {
            LinkRunKind::Space(space) => space.n_axes,
            LinkRunKind::Pairwise { pairs, .. } => pairs.link.n_axes,
            _ => 1,
        }
    }

    /// The MATs that its i-th link joins along an axis.
    pub(crate) fn pair(&self, i: usize, axis: usize) -> (usize, usize) {
        let link_ends = (self.a + i, self.b + i);
        match &self.kind {
            LinkRunKind::Space(space) => space.pair(link_ends, axis),
            LinkRunKind::Pairwise { pairs, .. } => pairs.pair((self.a, self.b), i, axis),
            _ => link_ends,
        }
    }

    /// The MATs that its i-th link joins, axis by axis.
    pub(crate) fn pairs(&self, i: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.n_axes()).map(move |axis| self.pair(i, axis))
    }

    /// The index of the memory of a pairwise run; 0 for other kinds.
    pub(crate) fn slot(&self) -> usize {
        match &self.kind {
            LinkRunKind::Pairwise { slot, .. } => *slot,
            _ => 0,
        }
    }

    /// The run as contacts between all pairs; `None` for other kinds.
    pub(crate) fn pairwise(&self) -> Option<PairRun> {
        match &self.kind {
            LinkRunKind::Pairwise { pairs, .. } => Some(PairRun {
                pairs: pairs.clone(),
                a: self.a,
                b: self.b,
                n_second: self.len,
                rest: self.rest,
            }),
            _ => None,
        }
    }

    /// Length of its i-th link minus the rest length, at positions `x` [m].
    pub(crate) fn elongation(&self, i: usize, x: impl Fn(usize) -> f64) -> f64 {
        let (first_end, second_end) = (self.a + i, self.b + i);
        match &self.kind {
            LinkRunKind::Space(space) => space.length_and_direction((first_end, second_end), x).0 - self.rest,
            _ => x(second_end) - x(first_end) - self.rest,
        }
    }

    /// Change of the length of its i-th link [m], at positions `x`, if each MAT moves by `displacement` [m].
    pub(crate) fn stretch(&self, i: usize, x: impl Fn(usize) -> f64, displacement: impl Fn(usize) -> f64) -> f64 {
        let link_ends = (self.a + i, self.b + i);
        match &self.kind {
            LinkRunKind::Space(space) => {
                space.length_step(link_ends, space.length_and_direction(link_ends, x).1, displacement)
            }
            _ => displacement(link_ends.1) - displacement(link_ends.0),
        }
    }

    /// Indices of its links.
    pub(crate) fn links(&self) -> std::ops::Range<usize> {
        self.first_link..self.first_link + self.len
    }

    /// Whether it is of hardening springs.
    pub(crate) fn is_hardening(&self) -> bool {
        !matches!(self.kind, LinkRunKind::Ref) && self.spring().is_some()
    }

    /// Whether it is a law, with or without a state of its own.
    fn is_law(&self) -> bool {
        matches!(self.kind, LinkRunKind::Lnl { .. } | LinkRunKind::Bristle { .. })
    }

    /// Whether its rest length changes permanently.
    pub(crate) fn has_permanent_stretch(&self) -> bool {
        matches!(&self.kind, LinkRunKind::Space(space) if space.law.yields())
    }

    /// Whether it is dry friction.
    pub(crate) fn is_dry(&self) -> bool {
        matches!(self.kind, LinkRunKind::Dry { .. })
    }

    /// The bristle law with K and Z of the run, and the time step [s]; `None` for other links.
    pub(crate) fn bristle(&self) -> Option<(Bristle, f64)> {
        match &self.kind {
            LinkRunKind::Bristle { law, velocity_factor } => {
                Some((law.with_stiffness_and_level(self.k, self.z), 1.0 / velocity_factor))
            }
            _ => None,
        }
    }
}

/// Coefficients of every step, constant during a simulation unless parameters follow or are led.
#[derive(Clone, Debug)]
pub struct Scheme {
    /// Frames a second [Hz].
    pub rate: f64,
    /// κ = K/M of the tie to the ground     (n_mat)
    pub(crate) kappa: Vec<f64>,
    /// ζ = Z/M of the tie to the ground     (n_mat)
    pub(crate) zeta: Vec<f64>,
    /// Stiffness of the tie [N/m], for outputs of its force   (n_mat)
    pub(crate) tie_stiffness: Vec<f64>,
    /// 1/M [m/N]: T²/m; 0 for fixed points  (n_mat)
    pub(crate) w: Vec<f64>,
    /// Rest position of the tie [m]         (n_mat)
    pub(crate) rest: Vec<f64>,
    /// Ranges of MATs with equal coefficients; empty if there are too many ranges, or if the coefficients change.
    pub(crate) equal_ranges: Vec<EqualRange>,
    /// Constant force [N]                   (n_mat at most; 0 for the MATs after its end)
    pub(crate) weight: Vec<f64>,
    /// The part to which the MAT belongs    (n_mat)
    pub(crate) part: Vec<u32>,
    /// Points between masses, which have no 1/M of their own.
    pub(crate) proxies: Vec<Proxy>,
    /// Masses that follow MATs; `w` holds the value of the lightest mass of each.
    pub(crate) following_masses: Vec<FollowingMass>,
    /// Springs whose individual forces are not needed: computed in one pass.
    pub(crate) fused_springs: FusedSprings,
    /// Runs whose forces are functions of the current state, in order of declaration.
    pub(crate) runs: Vec<LinkRun>,
    /// Exact contacts, followed by dry friction: solved after all other forces are known.
    pub(crate) exact_runs: Vec<LinkRun>,
    /// Whether any two runs of `exact_runs` share a MAT that moves.
    pub(crate) has_coupled_exact_runs: bool,
    pub(crate) outputs: Vec<Output>,
    /// The terms of each output, grouped for summation   (n_out)
    pub(crate) taps: Vec<Vec<Tap>>,
    pub(crate) n_lia: usize,
    pub(crate) n_parts: usize,
    /// Whether the network is linear: its response to a force is proportional to the force.
    pub(crate) is_linear: bool,
}

impl Scheme {
    /// The numbers of the CA scheme of a network at `rate`.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of a `magic` contact that cannot be exact.
    pub fn new(network: &Network, rate: Rate) -> Result<Self, Error> {
        discretise::build_scheme(network, rate, TieDiscretisation::Poles)
    }

    /// The numbers of a network whose ties are discretised like springs and dampers: κ = kT²/m, ζ = zT/m. For methods
    /// that do not have the poles of the CA scheme.
    pub(crate) fn physical(network: &Network, rate: Rate) -> Result<Self, Error> {
        discretise::build_scheme(network, rate, TieDiscretisation::Physical)
    }

    /// The stability certificate of the scheme.
    ///
    /// ```
    /// use ergon_engine::scheme::Scheme;
    /// use ergon_engine::{Network, Rate};
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 0.0, 0.0)?, network.sol("b", 0.0)?);
    /// network.spring("s", a, b, 500.0, 0.0, 0.0)?;
    /// let rate = Rate::new(44_100.0)?;
    /// assert!(Scheme::new(&network, rate)?.certify(&network)?.lambda_max < 4.0);
    /// network.spring("stiff", a, b, 1e9, 0.0, 0.0)?;
    /// assert!(Scheme::new(&network, rate)?.certify(&network).is_err()); // it would diverge
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error`] where a force at rest is not finite.
    pub fn certify(&self, network: &Network) -> Result<Certificate, Error> {
        certify::certify(self, network, RefusalDetail::Full)
    }

    /// Remove laws whose force far from rest is small against their slopes at rest, as that of a bow. Motion that such
    /// slopes excite stays bounded.
    pub(crate) fn drop_softening_laws(&mut self) {
        self.runs.retain(|run| match &run.kind {
            LinkRunKind::Lnl { law, .. } => !law.is_bounded_far_from_rest(),
            LinkRunKind::Followed { law: followed_law, .. } => {
                !followed_law.end_value_laws().all(|law| law.is_bounded_far_from_rest())
            }
            _ => true,
        });
    }

    /// Whether the scheme is stable without its damping; if so, a refusal means that only the damping is too strong.
    pub(crate) fn is_stable_undamped(&self, network: &Network) -> bool {
        certify::is_stable_undamped(self, network)
    }

    /// The stability certificate; `refusal_detail` says how much is computed if the scheme is unstable.
    pub(crate) fn certify_with_detail(
        &self,
        network: &Network,
        refusal_detail: RefusalDetail,
    ) -> Result<Certificate, Error> {
        certify::certify(self, network, refusal_detail)
    }

    /// Largest number of laws that are computed in substeps: the cost grows with its square, as each law is coupled to
    /// all others.
    pub(crate) const SUBSTEPPED_LAWS_MAX: usize = 32;
    /// Largest number of dry frictions whose ends are located between frames: all their forces are one system of
    /// equations.
    const LOCATED_FRICTIONS_MAX: usize = 8;

    /// Whether it has contacts, and whether it has laws or dry friction, that can be computed in substeps;
    /// `steered_mats`: those whose motion or parameters a timeline determines.
    pub(crate) fn has_substepped(&self, steered_mats: &[usize]) -> (bool, bool) {
        let is_law = |run: &&LinkRun| run.is_law();
        let law_count = self.substepped().filter(is_law).count();
        let has_laws = (1..=Self::SUBSTEPPED_LAWS_MAX).contains(&law_count);
        let has_contacts = self.substepped().any(|run| !is_law(&run));
        (has_contacts, has_laws || self.can_locate_friction(steered_mats))
    }

    /// All runs of links that it computes.
    pub(crate) fn link_runs(&self) -> impl Iterator<Item = &LinkRun> + Clone {
        self.runs.iter().chain(&self.exact_runs)
    }

    /// Contacts and laws that can be computed in substeps, however many laws there are.
    fn substepped(&self) -> impl Iterator<Item = &LinkRun> {
        let substeps_springs = self.substeps_springs();
        self.link_runs()
            .filter(move |run| self.can_substep_run(run, substeps_springs))
    }

    /// Whether the ends of slides and holds of all its dry friction can be located between frames: beside no contacts
    /// and laws that can be computed in substeps, not on proxies and masses that change, nor in parts with steered
    /// MATs.
    fn can_locate_friction(&self, steered_mats: &[usize]) -> bool {
        let is_free_end = |mat: usize| {
            let mut steered_mats = steered_mats.iter();
            let is_steered = steered_mats.any(|&other| self.part[other] == self.part[mat]);
            !is_steered && self.can_end_substepped(mat)
        };
        let dry_runs = || self.exact_runs.iter().filter(|run| run.is_dry());
        (1..=Self::LOCATED_FRICTIONS_MAX).contains(&dry_runs().count())
            && self.substepped().next().is_none()
            && dry_runs().all(|run| run.len == 1 && is_free_end(run.a) && is_free_end(run.b))
            && self.is_forest(dry_runs())
    }

    /// Whether the ends of runs make no circle, with all fixed points as one: holds in a circle can share their forces
    /// in many ways.
    fn is_forest<'a>(&self, mut runs: impl Iterator<Item = &'a LinkRun>) -> bool {
        let ground_node = self.n_mat();
        let node_of = |mat: usize| if self.w[mat] == 0.0 { ground_node } else { mat };
        let mut node_sets = Forest::new(ground_node + 1);
        runs.all(|run| {
            let (first_node, second_node) = (node_of(run.a), node_of(run.b));
            let is_apart = node_sets.root(first_node) != node_sets.root(second_node);
            node_sets.join(first_node, second_node);
            is_apart
        })
    }

    /// Whether a MAT is a proxy.
    pub(crate) fn is_proxy(&self, mat: usize) -> bool {
        self.proxies.iter().any(|proxy| proxy.mat == mat)
    }

    /// Whether a run can be computed in substeps.
    fn can_substep_run(&self, run: &LinkRun, substeps_springs: bool) -> bool {
        let is_taken = substeps_springs || !run.is_hardening();
        let has_free_ends = self.can_end_substepped(run.a) && self.can_end_substepped(run.b);
        is_taken && run.can_substep() && has_free_ends
    }

    /// Whether hardening springs that are single links are computed in substeps: they are few, and no rows of such
    /// springs are left to the scheme. Beside these the others would gain nothing.
    fn substeps_springs(&self) -> bool {
        let mut springs = self.runs.iter().filter(|run| run.is_hardening());
        springs.clone().count() <= Self::SUBSTEPPED_LAWS_MAX && springs.all(|run| run.len == 1)
    }

    /// Whether a MAT may be the end of a run that is computed in substeps: proxies and masses that change are known at
    /// frames only.
    fn can_end_substepped(&self, mat: usize) -> bool {
        let mut changing = self.following_masses.iter();
        !self.is_proxy(mat) && !changing.any(|mass| mass.mat == mat)
    }

    /// 1/M that a force on each MAT sees [m/N]; for a proxy an upper bound   (n_mat; empty if there are no proxies, so
    /// that `w` applies).
    pub(crate) fn force_compliances(&self) -> Vec<f64> {
        if self.proxies.is_empty() {
            return Vec::new();
        }
        let mut compliances = self.w.clone();
        for proxy in &self.proxies {
            let largest_weight = proxy.masses().map(|mat| self.w[mat]).fold(0.0, f64::max);
            compliances[proxy.mat] = proxy.share_sum_max() * proxy.share_sum_max() * largest_weight;
        }
        compliances
    }

    /// Whether any link is dry friction.
    pub(crate) fn has_dry_friction(&self) -> bool {
        self.exact_runs.iter().any(LinkRun::is_dry)
    }

    /// Whether there are contacts between all pairs of points.
    pub(crate) fn has_pairwise(&self) -> bool {
        let mut link_runs = self.runs.iter();
        link_runs.any(|run| matches!(run.kind, LinkRunKind::Pairwise { .. }))
    }

    /// The index of the memory of a pairwise run, by its first link.
    pub(crate) fn slot_of(&self, link: usize) -> Option<usize> {
        let mut link_runs = self.runs.iter();
        let pairwise_run =
            link_runs.find(|pairwise_run| pairwise_run.first_link == link && pairwise_run.pairwise().is_some())?;
        Some(pairwise_run.slot())
    }

    /// The initial state of all LIAs that have one, such as bristles; empty if none has   (n_lia).
    pub(crate) fn initial_memory(&self) -> Vec<f64> {
        let remembers = |run: &LinkRun| run.bristle().is_some() || run.has_permanent_stretch();
        let any_remembers = self.runs.iter().any(remembers);
        vec![0.0; if any_remembers { self.n_lia } else { 0 }]
    }

    /// Move springs to the list that is computed in one pass, except those whose individual force `is_observed`. Returns
    /// the first link of each run of that list.
    pub(crate) fn fuse_springs(&mut self, is_observed: impl Fn(usize) -> bool) -> Vec<usize> {
        let (fused_runs, other_runs): (Vec<LinkRun>, Vec<LinkRun>) =
            std::mem::take(&mut self.runs).into_iter().partition(|run| {
                let run_links = run.first_link..run.first_link + run.len;
                run.gate.is_none() && run.spring().is_some() && !run_links.into_iter().any(&is_observed)
            });
        self.runs = other_runs;
        self.fused_springs = FusedSprings::new(fused_runs.iter().filter_map(LinkRun::spring).collect());
        fused_runs.iter().map(|run| run.first_link).collect()
    }

    /// Remove and return the contacts and laws that are computed in substeps, laws only if there are few; if there are
    /// none, dry friction. `steered_mats` as in [`Self::has_substepped`].
    pub(crate) fn take_substepped(&mut self, steered_mats: &[usize]) -> Vec<LinkRun> {
        let takes_springs = self.substeps_springs();
        if self.can_locate_friction(steered_mats) {
            let exact_runs = std::mem::take(&mut self.exact_runs).into_iter();
            let (dry_runs, other_exact) = exact_runs.partition(LinkRun::is_dry);
            self.exact_runs = other_exact;
            return dry_runs;
        }
        let (explicit_runs, exact_runs) = (std::mem::take(&mut self.runs), std::mem::take(&mut self.exact_runs));
        let is_law = |run: &LinkRun| run.is_law() && self.can_substep_run(run, takes_springs);
        let are_laws_few = explicit_runs.iter().filter(|run| is_law(run)).count() <= Self::SUBSTEPPED_LAWS_MAX;
        let is_substepped = |run: &LinkRun| self.can_substep_run(run, takes_springs) && (are_laws_few || !is_law(run));
        let (mut substepped_runs, explicit_runs) = explicit_runs.into_iter().partition::<Vec<_>, _>(is_substepped);
        let (substepped_exact_runs, remaining_exact_runs) =
            exact_runs.into_iter().partition::<Vec<_>, _>(is_substepped);
        substepped_runs.extend(substepped_exact_runs);
        substepped_runs.sort_by_key(|run| run.first_link);
        (self.runs, self.exact_runs) = (explicit_runs, remaining_exact_runs);
        substepped_runs
    }

    /// 1/M, κ, ζ and rest position of every MAT   (n_mat each).
    pub(crate) fn mat_coefficients(&self) -> [&[f64]; 4] {
        [&self.w, &self.kappa, &self.zeta, &self.rest]
    }

    /// Number of MATs.
    pub fn n_mat(&self) -> usize {
        self.w.len()
    }

    /// Number of outputs.
    pub fn n_out(&self) -> usize {
        self.outputs.len()
    }
}

#[cfg(test)]
mod tests;
