//! Contacts, single laws and dry friction computed finer than a frame; contacts only while they may be closed.
//!
//! All between these links is linear. Within a frame a link therefore needs of its two points only their free motion,
//! and their response at all later instants to a push at one instant. Both are smooth functions of time, kept as sums
//! of polynomials (`basis`), so pushes may act at any instant: when contacts close and open, and as often as their own
//! oscillation requires (`march`). If no contact is near, laws are solved at a few instants of a frame (`laws`). Dry
//! friction slides or holds up to instants that are located (`slides`). On the rest of the scene the pushes of a frame
//! act as impulses at a few fixed instants.

mod basis;
mod build;
mod crowded;
mod frame;
mod joint;
mod laws;
mod march;
mod order;
mod script;
mod slides;
mod stepped_points;

use std::sync::Arc;

use crate::archive::{Archive, Damaged, State, state_of};
use crate::kernel;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::ModuleState;
use crowded::CrowdedMotion;
use joint::Joint;
use laws::{LawScript, LawState};
pub(crate) use order::ContactOrder;
use order::Stages;
use script::FineScript;
use slides::Frictions;
use stepped_points::SteppedPoints;

/// Most steps a frame to which links that run are refined.
const STEPS_MAX: usize = 64;
/// A refinement multiplies the steps a frame by this.
const REFINEMENT_FACTOR: usize = 4;
/// A contact that is further than this from closing stays open, however its distance is rounded [m].
pub(super) const OPEN_MARGIN: f64 = 1e-9;

/// Running contacts and laws.
#[derive(Clone, Debug)]
pub(crate) struct FineLinks {
    script: Arc<FineScript>,
    law_script: Arc<LawScript>,
    /// Each law   (n_laws)
    laws: Vec<LawState>,
    /// Dry friction; then there are no contacts and no laws.
    frictions: Frictions,
    /// Free path of each joint in this frame, if no link pushes it, at the instants of the frame   (n_joints · n)
    free_paths: Vec<f64>,
    /// Impulses on each joint in this frame, converted to impulses at the instants of the frame   (n_joints · n)
    frame_impulses: Vec<f64>,
    /// Path of each joint in this frame, by coefficients   (n_joints · n)
    paths: Vec<f64>,
    /// Sum of the impulses on each joint in this frame, each times the polynomials at its instant   (n_joints · n)
    impulse_sums: Vec<f64>,
    /// `paths` and `impulse_sums` before a step that may be repeated.
    saved_paths_and_sums: [Vec<f64>; 2],
    /// What the impulses of this frame add to each crowded body.
    crowded_motions: Vec<CrowdedMotion>,
    /// Force that each stepped joint still feels in the next frame   (n_joints)
    carried_forces: Vec<f64>,
    /// Force on each joint that acts over the whole frame [N]   (n_joints)
    steady_forces: Vec<f64>,
    /// Whether each contact may be closed in this frame   (n_links)
    may_close: Vec<bool>,
    /// Whether each contact pushes   (n_links)
    is_pushing: Vec<bool>,
    /// Whether each contact has pushed since the beginning of the frame, or dry friction held at its end.
    has_rested: Vec<bool>,
    /// Whether the instant at which each contact closes or opens in this step is known.
    is_instant_known: Vec<bool>,
    /// Forces of contacts that are solved together [N], and their penetrations before [m]   (n_links)
    forces: Vec<f64>,
    penetrations: Vec<f64>,
    /// K and Z of each link at the start of this frame, and at its end   (n_links)
    link_constants: Vec<[[f64; 2]; 2]>,
    /// 1/M, κ and ζ of each joint at the start of this frame and at its end   (n_joints)
    joint_constants: Vec<[[f64; 3]; 2]>,
    /// Whether each joint has glided since the tables of laws were made   (n_joints)
    has_glided: Vec<bool>,
    /// Points that steps hold too, where energy may be created.
    stepped_points: SteppedPoints,
    /// Stages of the step that is computed.
    step_stages: Stages,
    /// Whether a contact has ever been closed.
    pub(super) has_contact_closed: bool,
    /// Work done so far.
    pub(super) work: FineWork,
}

crate::archive::option!(FineLinks, fixed);

/// All state that is not computed anew in each frame.
impl State for FineLinks {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        let mut step_count = self.script.steps_min;
        step_count.archive(archive)?;
        self.set_steps(step_count.min(STEPS_MAX));
        state_of!(
            self,
            archive,
            laws,
            carried_forces,
            has_rested,
            has_glided,
            has_contact_closed,
            stepped_points,
            work
        )?;
        if matches!(archive, Archive::Read(_)) && self.has_glided.contains(&true) {
            // With NaN, the next frame that needs these joints retunes them.
            let joints = &mut Arc::make_mut(&mut self.script).joints;
            let glided_joints = joints.iter_mut().zip(&self.has_glided);
            for (joint, _) in glided_joints.filter(|(_, has_glided)| **has_glided) {
                joint.constants = [[f64::NAN; 3]; 2];
            }
        }
        Ok(())
    }
}

/// Work of contacts that are computed finely, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FineWork {
    /// Evaluations of contacts and laws.
    pub(crate) evaluations: u64,
    /// Products in sums.
    pub(crate) products: u64,
    /// Forces of laws that other laws felt, round by round.
    pub(crate) couplings: u64,
}

crate::archive::state!(FineWork {
    evaluations,
    products,
    couplings
});

impl FineLinks {
    /// The instants of a frame, 0 to 1, at which bodies give paths and take impulses.
    pub(super) fn instants(&self) -> &[f64] {
        &self.script.basis.instants
    }

    /// Compute contacts and laws finer from now on, if that is possible: their steps have created energy.
    pub(super) fn refine(&mut self) {
        if self.frictions.is_empty() {
            self.set_steps((REFINEMENT_FACTOR * self.script.steps_min).min(STEPS_MAX));
        }
    }

    /// Compute contacts and laws in at least this many steps a frame.
    fn set_steps(&mut self, steps: usize) {
        if steps <= self.script.steps_min {
            return;
        }
        // This happens at most a few times in a run, so copies of the scripts are acceptable.
        let script = Arc::make_mut(&mut self.script);
        script.steps_min = steps;
        self.law_script = Arc::new(LawScript::new(script));
        for law_state in &mut self.laws {
            law_state.forget_previous_forces();
        }
    }

    /// Take over the state of the same contacts and laws in another version.
    pub(super) fn continue_from(&mut self, old: &mut Self) {
        self.set_steps(old.script.steps_min);
        std::mem::swap(&mut self.carried_forces, &mut old.carried_forces);
        if self.has_rested.len() == old.has_rested.len() {
            self.has_rested.copy_from_slice(&old.has_rested);
        }
        if self.laws.len() == old.laws.len() {
            for (law_state, old) in self.laws.iter_mut().zip(&old.laws) {
                law_state.continue_from(old);
            }
        }
        self.has_contact_closed = old.has_contact_closed;
    }

    /// Deflection of the bristles of a link [m]; `None` if it is not computed here.
    pub(super) fn bristle_deflection(&self, link: usize) -> Option<f64> {
        let law_index = self.law_index_of(link)?;
        Some(self.laws[law_index].bristle_at_start())
    }

    /// Set the deflection of the bristles of a link [m], if it is computed here.
    pub(super) fn set_bristle_deflection(&mut self, link: usize, deflection: f64) {
        if let Some(law_index) = self.law_index_of(link) {
            self.laws[law_index].set_bristle_deflection(deflection);
        }
    }

    /// Index of a link among the laws.
    fn law_index_of(&self, link: usize) -> Option<usize> {
        let link_runs = &self.script.links;
        let mut law_links = self.law_script.links.iter();
        law_links.position(|&link_index| link_runs[link_index].first_link == link)
    }

    /// Remove the links on the marked MATs (n_mat), and bodies that leave; returns the removed links. `new_indices`
    /// gives the new index of each body that stays (n_bodies).
    pub(super) fn remove_parts(&mut self, is_muted: &[bool], new_indices: &[Option<usize>]) -> Vec<usize> {
        // A part leaves at most once in a run, so a copy of the script is acceptable.
        let script = Arc::make_mut(&mut self.script);
        for (joint, carried_force) in script.joints.iter_mut().zip(&mut self.carried_forces) {
            joint.port = (joint.port).and_then(|(body_index, port)| Some((new_indices[body_index]?, port)));
            if is_muted[joint.mat] {
                joint.cell = None;
                *carried_force = 0.0;
            }
        }
        let retained_links: Vec<bool> = (script.links.iter())
            .map(|run| !is_muted[run.a] && !is_muted[run.b])
            .collect();
        let removed_links = (script.links.iter().zip(&retained_links))
            .filter(|(_, is_retained)| !**is_retained)
            .map(|(run, _)| run.first_link)
            .collect();
        let law_script = Arc::make_mut(&mut self.law_script);
        let retained_laws: Vec<bool> = law_script.links.iter().map(|&link| retained_links[link]).collect();
        retain_flagged(&mut self.laws, &retained_laws);
        retain_flagged(&mut script.links, &retained_links);
        retain_flagged(&mut script.link_joints, &retained_links);
        retain_flagged(&mut self.may_close, &retained_links);
        retain_flagged(&mut self.is_pushing, &retained_links);
        retain_flagged(&mut self.has_rested, &retained_links);
        retain_flagged(&mut self.is_instant_known, &retained_links);
        retain_flagged(&mut self.forces, &retained_links);
        retain_flagged(&mut self.penetrations, &retained_links);
        retain_flagged(&mut self.link_constants, &retained_links);
        *law_script = LawScript::new(script);
        self.frictions = Frictions::new(script);
        self.stepped_points.remove_points(is_muted);
        removed_links
    }

    /// Multiply K and Z of a link, if it is still here, by factors at the start and at the end of this frame.
    pub(super) fn set_link_constants(&mut self, link: usize, factors: [[f64; 2]; 2]) {
        for (run, constants) in self.script.links.iter().zip(&mut self.link_constants) {
            if run.first_link == link {
                *constants = factors.map(|[k_factor, z_factor]| [run.k * k_factor, run.z * z_factor]);
            }
        }
    }

    /// Set 1/M, κ and ζ of the joint of a MAT that glides, at the start and at the end of this frame.
    pub(super) fn set_joint_constants(&mut self, mat: usize, constants: [[f64; 3]; 2]) {
        let is_stepped = |joint: &Joint| joint.mat == mat && joint.cell.is_some();
        if let Some(joint) = self.script.joints.iter().position(is_stepped) {
            self.joint_constants[joint] = constants;
        }
    }

    /// Retune the joints that have glided since a frame was last computed: where no contact is near, their tables are
    /// not used.
    fn retune(&mut self) {
        for (joint, &constants) in self.joint_constants.iter().enumerate() {
            let tuned_joint = &self.script.joints[joint];
            if tuned_joint.cell.is_some() && tuned_joint.constants != constants {
                // The script is copied once if another version of this simulation shares it.
                let products = Arc::make_mut(&mut self.script).retune(joint, constants);
                self.has_glided[joint] |= products.is_some();
                self.work.products += products.unwrap_or(0);
            }
        }
    }

    /// K and Z of a link at an instant of this frame, 0 to 1.
    fn link_constants_at(&self, link: usize, s: f64) -> [f64; 2] {
        let [start_constants, end_constants] = self.link_constants[link];
        std::array::from_fn(|i| start_constants[i] + (end_constants[i] - start_constants[i]) * s)
    }

    /// Work done so far, counted.
    pub(super) fn work(&self) -> FineWork {
        self.work
    }

    /// The account of points that steps hold too.
    pub(super) fn stepped_points(&self) -> &SteppedPoints {
        &self.stepped_points
    }

    pub(super) fn stepped_points_mut(&mut self) -> &mut SteppedPoints {
        &mut self.stepped_points
    }

    /// Its links.
    pub(super) fn links(&self) -> impl Iterator<Item = &LinkRun> {
        self.script.links.iter()
    }

    /// The force that this frame leaves to the next on a MAT [N].
    pub(super) fn carried_force_at(&self, mat: usize) -> f64 {
        let joint_forces = self.script.joints.iter().zip(&self.carried_forces);
        let mat_forces = joint_forces.filter(|(joint, _)| joint.mat == mat);
        mat_forces.map(|(_, force)| force).sum()
    }

    /// Report the energy that each link stores at the end of the frame [J]; `gate_opening` gives how far its
    /// gate is open.
    pub(super) fn report_energies(
        &self,
        modules: &ModuleState,
        gate_opening: impl Fn(&LinkRun) -> f64,
        mut report_energy: impl FnMut(f64),
    ) {
        for (run, [_, [k, z]]) in self.script.links.iter().zip(&self.link_constants) {
            let link_energy = match (&run.kind, self.bristle_deflection(run.first_link)) {
                (LinkRunKind::Bristle { law, .. }, Some(deflection)) => {
                    law.with_stiffness_and_level(*k, *z).energy(deflection)
                }
                _ => {
                    let stiffness_ratio = if run.k == 0.0 { 1.0 } else { k / run.k };
                    stiffness_ratio * run.potential_energy(run.elongation(0, |mat| modules.x[mat]))
                }
            };
            report_energy(gate_opening(run) * link_energy);
        }
    }

    /// Number of its links that end on a MAT.
    pub(super) fn link_ends_on(&self, mat: usize) -> u32 {
        let link_runs = self.script.links.iter();
        link_runs
            .map(|run| u32::from(run.a == mat) + u32::from(run.b == mat))
            .sum()
    }

    /// Whether the last frame left a force to this one.
    pub(super) fn has_carried_force(&self) -> bool {
        self.carried_forces.iter().any(|force| *force != 0.0)
    }

    /// Whether every contact stays open in this frame, with a margin of `OPEN_MARGIN`, if its points move freely.
    pub(super) fn stays_open(&self, scheme: &Scheme, modules: &ModuleState) -> bool {
        let is_open = |run: &LinkRun| {
            let next_position = |mat: usize| kernel::predict_position(scheme, modules, mat);
            let distance_now = modules.x[run.b] - modules.x[run.a];
            let distance_next = next_position(run.b) - next_position(run.a);
            penetration_bound(run, distance_now - run.rest, distance_next - run.rest) < -OPEN_MARGIN
        };
        self.laws.is_empty() && self.frictions.is_empty() && self.script.links.iter().all(is_open)
    }

    /// Whether no contact closes for as long as its points move freely; `motion_bounds` gives bounds on the
    /// distance of each from its rest position, and on its step [m].
    pub(super) fn cannot_close(&self, scheme: &Scheme, motion_bounds: impl Fn(usize) -> [f64; 2], margin: f64) -> bool {
        let is_open = |run: &LinkRun| {
            let LinkRunKind::But(contact) = &run.kind else {
                return false;
            };
            let [reach_a, step_a] = motion_bounds(run.a);
            let [reach_b, step_b] = motion_bounds(run.b);
            let rest_elongation = scheme.rest[run.b] - scheme.rest[run.a] - run.rest;
            let total_reach = (reach_a + reach_b + step_a + step_b) * (1.0 + margin);
            contact.sign() * rest_elongation + total_reach < -2.0 * OPEN_MARGIN
        };
        let joints = &self.script.joints;
        self.laws.is_empty()
            && self.frictions.is_empty()
            && joints.iter().all(|joint| joint.port.is_none())
            && self.script.links.iter().all(is_open)
    }

    /// Set the state that frames with open contacts leave.
    pub(super) fn set_open(&mut self, modules: &mut ModuleState) {
        self.may_close.fill(false);
        self.has_rested.fill(false);
        for run in &self.script.links {
            modules.link_forces[run.first_link] = 0.0;
        }
    }

    /// Record the forces that act over the whole frame: those of links and drives, before strikes are added.
    pub(super) fn record_steady_forces(&mut self, scheme: &Scheme, modules: &ModuleState) {
        self.stepped_points.count_step_work(scheme, modules);
        for (joint, steady_force) in self.script.joints.iter().zip(&mut self.steady_forces) {
            *steady_force = modules.force[joint.mat];
        }
    }

    /// Add the forces that impulses of the previous frame carry over into this frame.
    pub(super) fn apply_carried_forces(&mut self, modules: &mut ModuleState) {
        self.stepped_points.record_carried_forces(&self.carried_forces, modules);
        for (joint, carried_force) in self.script.joints.iter().zip(&mut self.carried_forces) {
            if *carried_force != 0.0 {
                modules.push(joint.mat, std::mem::take(carried_force));
            }
        }
    }
}

/// Keep the entries of a list that stay.
fn retain_flagged<T>(list: &mut Vec<T>, stay_flags: &[bool]) {
    let mut retain_flags = stay_flags.iter();
    list.retain(|_| *retain_flags.next().unwrap_or(&true));
}

/// Bound on the penetration of a contact between two elongations [m]: the larger of the two, plus the distance between
/// them for what happens in between.
fn penetration_bound(run: &LinkRun, elongation_now: f64, elongation_next: f64) -> f64 {
    let LinkRunKind::But(contact) = &run.kind else {
        return f64::NEG_INFINITY;
    };
    let contact_side = contact.sign();
    let (elongation_now, elongation_next) = (contact_side * elongation_now, contact_side * elongation_next);
    elongation_now.max(elongation_next) + (elongation_next - elongation_now).abs()
}
