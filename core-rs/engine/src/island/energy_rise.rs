//! The energy of a whole island: while no event falls on it, it may only fall.
//!
//! The accounts of single links (`energy_gain`) see what each gives and takes in steps. This one also sees what
//! contacts and laws do between frames and to bodies by their modes, but only where nothing drives the island: the
//! energy of all masses, bodies and links is added up now and then, and if no event fell between two checks, a rise is
//! created energy.

use super::bodies::RunningBody;
use super::energy_account::{self, EnergyGain};
use super::fine::FineLinks;
use super::{Island, energy_gain};
use crate::cell::Cell;
use crate::network::{Contact, MatKind, Network};
use crate::scheme::{LinkRun, LinkRunKind, Scheme, Spring};
use crate::state::ModuleState;
use crate::units::Rate;

/// Steps between two checks: what is computed ahead of bodies has to be gone through again for each.
const CHECK_STEPS: u64 = energy_account::RARE_CHECK_STEPS;
/// Error of an elongation in units of the last digit of a position.
const ELONGATION_ERROR_ULP: f64 = 1e4;
/// Contacts and laws between frames are computed finer from each rise by this share of the energy on, so that what is
/// worth reporting (0.01) is not reached.
const REFINE_SHARE: f64 = 0.002;

/// How the energy of a MAT follows from its positions.
#[derive(Clone, Debug)]
enum MotionKind {
    /// It does not move, or by the modes of a body.
    Uncounted,
    /// It moves freely, or as a cell, but for links between frames.
    Free,
    Cell(Cell),
    /// Other links act on it once a step.
    Stepped,
}

/// The watch over the energy of an island.
#[derive(Clone, Debug)]
pub(super) struct EnergyRise {
    motion_kinds: Vec<MotionKind>,
    rate: Rate,
    /// Energy at the first check since the last event, and the least since then [J]; NaN before that check.
    first_energy: f64,
    least_energy: f64,
    /// The sum of the absolute energies of all its parts at that check [J].
    energy_scale: f64,
    /// The rise at which links were last computed finer [J].
    refined_rise: f64,
    /// The first step in which an event may fall on the island, as known at the last check.
    next_event_step: u64,
    /// The most energy that was created, and the link that pushed most then.
    worst_gain: Option<EnergyGain>,
    worst_link: usize,
}

crate::archive::option!(Box<EnergyRise>, fixed);

crate::archive::state!(EnergyRise {
    first_energy,
    least_energy,
    energy_scale,
    refined_rise,
    next_event_step,
    worst_gain,
    worst_link
});

/// A sum of energies [J], and the sum of their sizes.
#[derive(Clone, Copy, Debug, Default)]
struct EnergyTotal {
    energy_sum: f64,
    absolute_sum: f64,
}

impl EnergyTotal {
    fn add(&mut self, energy: f64) {
        self.energy_sum += energy;
        self.absolute_sum += energy.abs();
    }
}

impl EnergyRise {
    /// `None` for an island whose energy may rise, or is not known: with links that give energy (a bow), laws that
    /// follow MATs, links in space, weights, rows of hardening springs, or bodies that do not go by undamped modes; and
    /// for one that is linear.
    pub(super) fn new(
        network: &Network,
        scheme: &Scheme,
        bodies: &[RunningBody],
        fine_links: Option<&FineLinks>,
        rate: Rate,
    ) -> Option<Box<Self>> {
        let mat_parts = network.mats().part.iter();
        let is_discrete = |part: &u32| network.parts()[*part as usize].ca_rate.is_some();
        let has_energy = |body: &RunningBody| body.modal().is_some_and(|modal| modal.cells().is_some());
        let fine_runs = || fine_links.into_iter().flat_map(FineLinks::links);
        let all_runs = || scheme.link_runs().chain(fine_runs());
        let n_springs: usize = all_runs().filter(|run| run.is_hardening()).map(|run| run.len).sum();
        let has_known_energy = scheme.proxies.is_empty()
            && scheme.following_masses.is_empty()
            && scheme.weight.iter().all(|&weight| weight == 0.0)
            && !mat_parts.clone().any(is_discrete)
            && bodies.iter().all(has_energy)
            && all_runs().all(is_dissipative)
            && all_runs().any(|run| !matches!(run.kind, LinkRunKind::Ref))
            && n_springs <= energy_gain::ACCOUNTED_LAWS_MAX;
        if !has_known_energy {
            return None;
        }
        let is_port = |mat: usize| bodies.iter().any(|body| body.has_port(mat));
        let mats = network.mats();
        let mat_motion = |mat: usize| {
            let fine_link_count = fine_links.map_or(0, |fine_links| fine_links.link_ends_on(mat));
            let (m, k, z) = (mats.m[mat], mats.k[mat], mats.z[mat]);
            match mats.kind[mat] {
                _ if scheme.w[mat] == 0.0 || is_port(mat) => MotionKind::Uncounted,
                _ if network.degree(mat) > fine_link_count => MotionKind::Stepped,
                MatKind::Cel => MotionKind::Cell(Cell::new(m, k, z)),
                _ => MotionKind::Free,
            }
        };
        Some(Box::new(Self {
            motion_kinds: (0..network.n_mat()).map(mat_motion).collect(),
            rate,
            first_energy: f64::NAN,
            least_energy: f64::NAN,
            energy_scale: 0.0,
            refined_rise: 0.0,
            next_event_step: 0,
            worst_gain: None,
            worst_link: 0,
        }))
    }

    /// Begin again: an event fell on the island that was not foreseen.
    pub(super) fn restart(&mut self) {
        self.next_event_step = 0;
    }

    /// The first event from step `n` on falls at `event_step`, if none fell between the last check and `n`.
    pub(super) fn set_next_event(&mut self, n: u64, event_step: u64) {
        if self.next_event_step >= n {
            self.next_event_step = event_step;
        }
    }

    /// The most energy that was created, and the link that pushed most then.
    pub(super) fn worst_gain(&self) -> Option<(usize, EnergyGain)> {
        Some((self.worst_link, self.worst_gain?))
    }

    /// Steps from step `n` on before the next check.
    pub(super) fn steps_to_check(n: u64) -> u64 {
        n.next_multiple_of(CHECK_STEPS) - n
    }

    /// The created energy if the energy is `energy_total` after step `n`, and no event fell since the last check if
    /// `had_no_event`.
    fn energy_gain(&mut self, energy_total: EnergyTotal, had_no_event: bool, n: u64) -> Option<EnergyGain> {
        if !had_no_event || self.first_energy.is_nan() {
            (self.first_energy, self.least_energy, self.energy_scale) = (
                energy_total.energy_sum,
                energy_total.energy_sum,
                energy_total.absolute_sum,
            );
            self.refined_rise = 0.0;
            return None;
        }
        self.least_energy = self.least_energy.min(energy_total.energy_sum);
        Some(EnergyGain {
            created_energy: energy_total.energy_sum - self.least_energy,
            reference_energy: self.energy_scale,
            step: n,
        })
    }

    /// Whether links are to be computed finer because of this gain.
    fn needs_refinement(&mut self, gain: &EnergyGain) -> bool {
        let has_risen = gain.created_energy > self.refined_rise + REFINE_SHARE * gain.reference_energy;
        if has_risen {
            self.refined_rise = gain.created_energy;
        }
        has_risen
    }
}

/// Whether a run can only lose energy, and stores what its elongation says.
fn is_dissipative(run: &LinkRun) -> bool {
    match &run.kind {
        LinkRunKind::Ref | LinkRunKind::Hardening(_) | LinkRunKind::Dry { .. } => true,
        LinkRunKind::But(but) => but.contact != Contact::Magic,
        LinkRunKind::Bristle { .. } => run.bristle().is_some_and(|(bristle, _)| bristle.is_passive()),
        LinkRunKind::Lnl { law, .. } => !law.is_shared() && !energy_gain::is_active(law),
        LinkRunKind::Followed { .. } | LinkRunKind::Space(_) | LinkRunKind::Pairwise { .. } => false,
    }
}

/// Energy of a link between two steps [J], from its elongation at both [m]: what leapfrog steps keep, but for terms of
/// their fourth order.
fn midpoint_energy(run: &LinkRun, [elongation_now, elongation_before]: [f64; 2]) -> f64 {
    let (middle_elongation, stretch) = (
        0.5 * (elongation_now + elongation_before),
        elongation_now - elongation_before,
    );
    run.potential_energy(middle_elongation) - 0.125 * run.slope(middle_elongation) * stretch * stretch
}

/// The same of springs that are computed in one pass, all of a run.
fn add_spring_energies(spring: &Spring, modules: &ModuleState, total: &mut EnergyTotal) {
    for i in 0..spring.len {
        let (first_mat, second_mat) = (spring.a + i, spring.b + i);
        let stretch = modules.d[second_mat] - modules.d[first_mat];
        let middle_elongation = modules.x[second_mat] - modules.x[first_mat] - spring.rest - 0.5 * stretch;
        let elongation_square = middle_elongation * middle_elongation;
        total.add(0.5 * spring.k * elongation_square + 0.25 * spring.q * elongation_square * elongation_square);
        let stretch_coefficient = 0.125 * (spring.k + 3.0 * spring.q * elongation_square) + 0.25 * spring.z;
        total.add(-stretch_coefficient * stretch * stretch);
    }
}

impl Island {
    /// Check the energy of the island after a step, and return the link that pushes most, a MAT that it moves, and what
    /// was created, if that is worth reporting.
    pub(super) fn check_energy_rise(&mut self) -> Option<(usize, usize, EnergyGain)> {
        let last_step = self.state.frame - 1;
        if self.state.monitors.energy_rise.is_none()
            || !last_step.is_multiple_of(CHECK_STEPS)
            || self.state.parameters.velocity_factor < 1.0
        {
            return None;
        }
        let event_step = self.next_event_step(last_step + 1);
        let mut energy_rise = self.state.monitors.energy_rise.take()?;
        let had_no_event = energy_rise.next_event_step > last_step;
        energy_rise.next_event_step = event_step;
        let gain = energy_rise.energy_gain(self.total_energy(&energy_rise), had_no_event, last_step);
        let gain = gain.filter(|gain| gain.created_energy > self.rounding_energy());
        if let (Some(gain), Some(fine_links)) = (&gain, &mut self.state.motion.fine_links)
            && energy_rise.needs_refinement(gain)
        {
            fine_links.refine();
        }
        let reported_gain = gain.filter(EnergyGain::is_reportable).and_then(|gain| {
            let (pushing_link, moved_mat) = self.strongest_link()?;
            if energy_rise.worst_gain != Some(gain.worse_of(energy_rise.worst_gain)) {
                (energy_rise.worst_gain, energy_rise.worst_link) = (Some(gain), pushing_link);
            }
            Some((pushing_link, moved_mat, gain))
        });
        self.state.monitors.energy_rise = Some(energy_rise);
        reported_gain
    }

    /// The energy of all MATs, bodies and links.
    fn total_energy(&self, energy_rise: &EnergyRise) -> EnergyTotal {
        let state = &self.state;
        let modules = &state.motion.modules;
        let current_scheme = state
            .parameters
            .changing_scheme
            .as_deref()
            .unwrap_or(&self.script.scheme);
        let mut energy_total = EnergyTotal::default();
        for (mat, motion) in energy_rise.motion_kinds.iter().enumerate() {
            let (w, kappa, zeta) = (
                current_scheme.w[mat],
                current_scheme.kappa[mat],
                current_scheme.zeta[mat],
            );
            let (x, d) = (modules.x[mat] - current_scheme.rest[mat], modules.d[mat]);
            // What impulses between frames have still to add.
            let carried_step = || {
                w * state
                    .motion
                    .fine_links
                    .as_ref()
                    .map_or(0.0, |fine_links| fine_links.carried_force_at(mat))
            };
            match motion {
                MotionKind::Uncounted => {}
                MotionKind::Free => {
                    let free_step = d + carried_step();
                    energy_total.add(0.5 * free_step * free_step / w);
                }
                MotionKind::Cell(cell) => {
                    let next_position = x + d - kappa * x - zeta * d + carried_step();
                    energy_total.add(cell.energy([x, next_position], energy_rise.rate));
                }
                MotionKind::Stepped => {
                    energy_total.add((0.5 * (d * d + kappa * x * (x - d)) - 0.25 * zeta * d * d) / w);
                }
            }
        }
        for modal in state.motion.bodies.iter().filter_map(RunningBody::modal) {
            modal.visit_energies(|mode_energy| energy_total.add(mode_energy));
        }
        let gate_opening = |run: &LinkRun| run.gate.map_or(1.0, |gate| state.parameters.gate_openings[gate]);
        if let Some(fine_links) = &state.motion.fine_links {
            fine_links.report_energies(modules, gate_opening, |link_energy| energy_total.add(link_energy));
        }
        for run in current_scheme.link_runs() {
            let is_exact = matches!(&run.kind, LinkRunKind::But(but) if but.contact == Contact::Exact);
            for i in 0..run.len {
                let elongation_now = run.elongation(i, |mat| modules.x[mat]);
                let stretch = modules.d[run.b + i] - modules.d[run.a + i];
                let elongation_pair = [elongation_now, elongation_now - stretch];
                if matches!(run.kind, LinkRunKind::Ref) {
                    energy_total.add(-0.25 * run.z * stretch * stretch);
                }
                let link_energy = match run.bristle() {
                    Some((bristle, _)) => bristle.energy(modules.link_memories[run.first_link + i]),
                    None if is_exact => 0.5 * elongation_pair.map(|e| run.potential_energy(e)).iter().sum::<f64>(),
                    None => midpoint_energy(run, elongation_pair),
                };
                energy_total.add(gate_opening(run) * link_energy);
            }
        }
        current_scheme
            .fused_springs
            .iter()
            .for_each(|spring| add_spring_energies(spring, modules, &mut energy_total));
        energy_total
    }

    /// Energy that rounding alone explains [J].
    fn rounding_energy(&self) -> f64 {
        let modules = &self.state.motion.modules;
        let largest_position = modules
            .x
            .iter()
            .fold(0.0_f64, |largest_position, x| largest_position.max(x.abs()));
        let elongation_error = ELONGATION_ERROR_ULP * f64::EPSILON * largest_position;
        let scheme = &self.script.scheme;
        let scheme_runs = scheme.link_runs();
        let stiffness = scheme_runs.map(|run| run.k * run.len as f64).sum::<f64>()
            + scheme
                .fused_springs
                .iter()
                .map(|run| run.k * run.len as f64)
                .sum::<f64>();
        let masses = scheme.w.iter().filter(|w| **w > 0.0).map(|w| 1.0 / w);
        (stiffness + masses.sum::<f64>()) * elongation_error * elongation_error
    }

    /// The contact or law that pushes most now, or the first; and a MAT that it moves.
    fn strongest_link(&self) -> Option<(usize, usize)> {
        let state = &self.state;
        let scheme = &self.script.scheme;
        let fine_runs = state.motion.fine_links.iter().flat_map(FineLinks::links);
        let all_runs = scheme.link_runs().chain(fine_runs);
        let link_ends = all_runs
            .filter(|run| !matches!(run.kind, LinkRunKind::Ref))
            .flat_map(|run| (0..run.len).map(move |i| (run.first_link + i, [run.a + i, run.b + i])));
        let push_strength = |pushing_link: usize| state.motion.modules.link_forces[pushing_link].abs();
        let stronger_of_two = |strongest: (usize, [usize; 2]), link_push: (usize, [usize; 2])| {
            if push_strength(link_push.0) > push_strength(strongest.0) {
                link_push
            } else {
                strongest
            }
        };
        let (pushing_link, [first_mat, second_mat]) = link_ends.reduce(stronger_of_two)?;
        Some((
            pushing_link,
            if scheme.w[first_mat] > 0.0 {
                first_mat
            } else {
                second_mat
            },
        ))
    }
}
