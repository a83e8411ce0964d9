//! The energy of a whole island: while no event falls on it, it may only fall.
//!
//! The accounts of single links (`energy_gain`) see what each gives and takes in steps. This one also sees what
//! contacts and laws do between frames and to bodies by their modes, but only where nothing drives the island: the
//! energy of all masses, bodies and links is added up now and then, and if no event fell between two looks, a rise is
//! created energy.

use super::energy_account::{self, Gain};
use super::fine::Fine;
use super::inside::RunningBody;
use super::{Island, energy_gain};
use crate::cell::Cell;
use crate::network::{Contact, MatKind, Network};
use crate::scheme::{Kind, Run, Scheme, Spring};
use crate::state::Body;
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
enum Motion {
    /// It does not move, or by the modes of a body.
    None,
    /// It moves freely, or as a cell, but for links between frames.
    Free,
    Cell(Cell),
    /// Other links act on it once a step.
    Stepped,
}

/// The watch over the energy of an island.
#[derive(Clone, Debug)]
pub(super) struct EnergyRise {
    motions: Vec<Motion>,
    rate: Rate,
    /// Energy at the first look since the last event, and the least since then [J]; NaN before that look.
    first: f64,
    least: f64,
    /// The sizes of all its parts at that look, added up [J].
    size: f64,
    /// The rise at which links were last computed finer [J].
    refined: f64,
    /// The first step in which an event may fall on the island, as known at the last look.
    due: u64,
    /// The most energy that was created, and the link that pushed most then.
    worst: Option<Gain>,
    link: usize,
}

crate::archive::option!(Box<EnergyRise>, fixed);

crate::archive::state!(EnergyRise {
    first,
    least,
    size,
    refined,
    due,
    worst,
    link
});

/// A sum of energies [J], and the sum of their sizes.
#[derive(Clone, Copy, Debug, Default)]
struct Total {
    sum: f64,
    size: f64,
}

impl Total {
    fn add(&mut self, energy: f64) {
        self.sum += energy;
        self.size += energy.abs();
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
        fine: Option<&Fine>,
        rate: Rate,
    ) -> Option<Box<Self>> {
        let mat_parts = network.mats().part.iter();
        let is_discrete = |part: &u32| network.parts()[*part as usize].ca_rate.is_some();
        let has_energy = |body: &RunningBody| body.modal().is_some_and(|modal| modal.cells().is_some());
        let fine_runs = || fine.into_iter().flat_map(Fine::links);
        let all_runs = || scheme.runs.iter().chain(&scheme.exact).chain(fine_runs());
        let n_springs: usize = all_runs().filter(|run| run.is_hardening()).map(|run| run.len).sum();
        let is_known = scheme.proxies.is_empty()
            && scheme.following_masses.is_empty()
            && scheme.weight.iter().all(|&weight| weight == 0.0)
            && !mat_parts.clone().any(is_discrete)
            && bodies.iter().all(has_energy)
            && all_runs().all(only_loses)
            && all_runs().any(|run| !matches!(run.kind, Kind::Ref))
            && n_springs <= energy_gain::ACCOUNTED_LAWS_MAX;
        if !is_known {
            return None;
        }
        let is_port = |mat: usize| bodies.iter().any(|body| body.has_port(mat));
        let mats = network.mats();
        let mat_motion = |mat: usize| {
            let fine_link_count = fine.map_or(0, |fine| fine.link_ends_on(mat));
            let (m, k, z) = (mats.m[mat], mats.k[mat], mats.z[mat]);
            match mats.kind[mat] {
                _ if scheme.w[mat] == 0.0 || is_port(mat) => Motion::None,
                _ if network.degree(mat) > fine_link_count => Motion::Stepped,
                MatKind::Cel => Motion::Cell(Cell::new(m, k, z)),
                _ => Motion::Free,
            }
        };
        Some(Box::new(Self {
            motions: (0..network.n_mat()).map(mat_motion).collect(),
            rate,
            first: f64::NAN,
            least: f64::NAN,
            size: 0.0,
            refined: 0.0,
            due: 0,
            worst: None,
            link: 0,
        }))
    }

    /// Begin anew: an event fell on the island that was not foreseen.
    pub(super) fn restart(&mut self) {
        self.due = 0;
    }

    /// The first event from step `n` on falls at `next_due`, if none fell between the last look and `n`.
    pub(super) fn foresee(&mut self, n: u64, next_due: u64) {
        if self.due >= n {
            self.due = next_due;
        }
    }

    /// The most energy that was created, and the link that pushed most then.
    pub(super) fn worst(&self) -> Option<(usize, Gain)> {
        Some((self.link, self.worst?))
    }

    /// Steps from step `n` on before the next look.
    pub(super) fn steps_left(n: u64) -> u64 {
        n.next_multiple_of(CHECK_STEPS) - n
    }

    /// The created energy if the energy is `energy_total` after step `n`, and no event fell since the last look if it
    /// `was_quiet`.
    fn gain(&mut self, energy_total: Total, was_quiet: bool, n: u64) -> Option<Gain> {
        if !was_quiet || self.first.is_nan() {
            (self.first, self.least, self.size) = (energy_total.sum, energy_total.sum, energy_total.size);
            self.refined = 0.0;
            return None;
        }
        self.least = self.least.min(energy_total.sum);
        Some(Gain {
            created: energy_total.sum - self.least,
            reference: self.size,
            frame: n,
        })
    }

    /// Whether links are to be computed finer because of this gain.
    fn refines(&mut self, gain: &Gain) -> bool {
        let has_grown = gain.created > self.refined + REFINE_SHARE * gain.reference;
        if has_grown {
            self.refined = gain.created;
        }
        has_grown
    }
}

/// Whether a run can only lose energy, and stores what its elongation says.
fn only_loses(run: &Run) -> bool {
    match &run.kind {
        Kind::Ref | Kind::Hardening(_) | Kind::Dry { .. } => true,
        Kind::But(but) => but.contact != Contact::Magic,
        Kind::Bristle { .. } => run.bristle().is_some_and(|(bristle, _)| bristle.is_passive()),
        Kind::Lnl { law, .. } => !law.is_shared() && !energy_gain::is_active(law),
        Kind::Followed { .. } | Kind::Space(_) | Kind::Pairwise { .. } => false,
    }
}

/// Energy of a link between two steps [J], from its elongation at both [m]: what leapfrog steps keep, but for terms of
/// their fourth order.
fn between(run: &Run, [elongation_now, elongation_before]: [f64; 2]) -> f64 {
    let (middle_elongation, stretch) = (
        0.5 * (elongation_now + elongation_before),
        elongation_now - elongation_before,
    );
    run.potential(middle_elongation) - 0.125 * run.slope(middle_elongation) * stretch * stretch
}

/// The same of springs that are computed in one pass, all of a run.
fn fused(spring: &Spring, body: &Body, total: &mut Total) {
    for i in 0..spring.len {
        let (first_mat, second_mat) = (spring.a + i, spring.b + i);
        let stretch = body.d[second_mat] - body.d[first_mat];
        let middle_elongation = body.x[second_mat] - body.x[first_mat] - spring.rest - 0.5 * stretch;
        let elongation_square = middle_elongation * middle_elongation;
        total.add(0.5 * spring.k * elongation_square + 0.25 * spring.q * elongation_square * elongation_square);
        let stretch_coefficient = 0.125 * (spring.k + 3.0 * spring.q * elongation_square) + 0.25 * spring.z;
        total.add(-stretch_coefficient * stretch * stretch);
    }
}

impl Island {
    /// Look at the energy of the island after a step, and return the link that pushes most, a MAT that it moves, and
    /// what was created, if that is worth reporting.
    pub(super) fn check_rise(&mut self) -> Option<(usize, usize, Gain)> {
        let last_step = self.state.frame - 1;
        if self.state.watch.energy_rise.is_none()
            || !last_step.is_multiple_of(CHECK_STEPS)
            || self.state.values.damped < 1.0
        {
            return None;
        }
        let next_due = self.due(last_step + 1);
        let mut energy_rise = self.state.watch.energy_rise.take()?;
        let was_quiet = energy_rise.due > last_step;
        energy_rise.due = next_due;
        let rise_gain = energy_rise.gain(self.total(&energy_rise), was_quiet, last_step);
        let rise_gain = rise_gain.filter(|rise_gain| rise_gain.created > self.rounding());
        if let (Some(rise_gain), Some(fine_state)) = (&rise_gain, &mut self.state.matter.fine)
            && energy_rise.refines(rise_gain)
        {
            fine_state.refine();
        }
        let reported = rise_gain.filter(Gain::is_reportable).and_then(|rise_gain| {
            let (pushing_link, moved_mat) = self.loudest_link()?;
            if energy_rise.worst != Some(rise_gain.worse_of(energy_rise.worst)) {
                (energy_rise.worst, energy_rise.link) = (Some(rise_gain), pushing_link);
            }
            Some((pushing_link, moved_mat, rise_gain))
        });
        self.state.watch.energy_rise = Some(energy_rise);
        reported
    }

    /// The energy of all MATs, bodies and links.
    fn total(&self, energy_rise: &EnergyRise) -> Total {
        let state = &self.state;
        let body = &state.matter.body;
        let scheme_now = state.values.scheme.as_deref().unwrap_or(&self.script.scheme);
        let mut energy_total = Total::default();
        for (mat, motion) in energy_rise.motions.iter().enumerate() {
            let (w, kappa, zeta) = (scheme_now.w[mat], scheme_now.kappa[mat], scheme_now.zeta[mat]);
            let (x, d) = (body.x[mat] - scheme_now.rest[mat], body.d[mat]);
            // What impulses between frames have still to add.
            let later_step = || {
                w * state
                    .matter
                    .fine
                    .as_ref()
                    .map_or(0.0, |fine_state| fine_state.next_frame_force_at(mat))
            };
            match motion {
                Motion::None => {}
                Motion::Free => {
                    let free_step = d + later_step();
                    energy_total.add(0.5 * free_step * free_step / w);
                }
                Motion::Cell(cell) => {
                    let next_position = x + d - kappa * x - zeta * d + later_step();
                    energy_total.add(cell.energy([x, next_position], energy_rise.rate));
                }
                Motion::Stepped => {
                    energy_total.add((0.5 * (d * d + kappa * x * (x - d)) - 0.25 * zeta * d * d) / w);
                }
            }
        }
        for modal in state.matter.bodies.iter().filter_map(RunningBody::modal) {
            modal.energies(|mode_energy| energy_total.add(mode_energy));
        }
        let gate_opening = |run: &Run| run.gate.map_or(1.0, |gate| state.values.gates[gate]);
        if let Some(fine_state) = &state.matter.fine {
            fine_state.energies(body, gate_opening, |link_energy| energy_total.add(link_energy));
        }
        for run in scheme_now.runs.iter().chain(&scheme_now.exact) {
            let is_exact = matches!(&run.kind, Kind::But(but) if but.contact == Contact::Exact);
            for i in 0..run.len {
                let elongation_now = run.elongation(i, |mat| body.x[mat]);
                let stretch = body.d[run.b + i] - body.d[run.a + i];
                let elongation_pair = [elongation_now, elongation_now - stretch];
                if matches!(run.kind, Kind::Ref) {
                    energy_total.add(-0.25 * run.z * stretch * stretch);
                }
                let link_energy = match run.bristle() {
                    Some((bristle, _)) => bristle.energy(body.memory[run.first + i]),
                    None if is_exact => 0.5 * elongation_pair.map(|e| run.potential(e)).iter().sum::<f64>(),
                    None => between(run, elongation_pair),
                };
                energy_total.add(gate_opening(run) * link_energy);
            }
        }
        scheme_now
            .fused
            .iter()
            .for_each(|spring| fused(spring, body, &mut energy_total));
        energy_total
    }

    /// Energy that rounding alone explains [J].
    fn rounding(&self) -> f64 {
        let body = &self.state.matter.body;
        let largest_position = body
            .x
            .iter()
            .fold(0.0_f64, |largest_position, x| largest_position.max(x.abs()));
        let elongation_error = ELONGATION_ERROR_ULP * f64::EPSILON * largest_position;
        let scheme = &self.script.scheme;
        let scheme_runs = scheme.runs.iter().chain(&scheme.exact);
        let stiffness = scheme_runs.map(|run| run.k * run.len as f64).sum::<f64>()
            + scheme.fused.iter().map(|run| run.k * run.len as f64).sum::<f64>();
        let masses = scheme.w.iter().filter(|w| **w > 0.0).map(|w| 1.0 / w);
        (stiffness + masses.sum::<f64>()) * elongation_error * elongation_error
    }

    /// The contact or law that pushes most now, or the first; and a MAT that it moves.
    fn loudest_link(&self) -> Option<(usize, usize)> {
        let state = &self.state;
        let scheme = &self.script.scheme;
        let fine_runs = state.matter.fine.iter().flat_map(Fine::links);
        let all_runs = scheme.runs.iter().chain(&scheme.exact).chain(fine_runs);
        let link_ends = all_runs
            .filter(|run| !matches!(run.kind, Kind::Ref))
            .flat_map(|run| (0..run.len).map(move |i| (run.first + i, [run.a + i, run.b + i])));
        let push_strength = |pushing_link: usize| state.matter.body.link[pushing_link].abs();
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
