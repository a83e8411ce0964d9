//! The account of one link: the work that it took in steps, and what it stores.

use crate::island::energy_account::{EnergyAccount, EnergyGain};
use crate::network::{AXES_MAX, SpaceLink};
use crate::scheme::{LinkRun, LinkRunKind, Scheme, Spring};
use crate::state::ModuleState;

/// The account of one link, added to at every step.
#[derive(Clone, Debug)]
pub(super) struct LinkAccount {
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) link: usize,
    /// In the step before: the stretch [m a step], and the force [N].
    previous_stretch: f64,
    previous_force: f64,
    pub(super) energy_account: EnergyAccount,
    /// The same along each axis, for a link in space.
    axis_history: Option<AxisHistory>,
    /// A spring that is computed in one pass with others: its force is not known apart from theirs.
    fused_spring: Option<Spring>,
    /// For a link whose strength changes in time, by a gate or a lead: its strength in the step before, as a factor.
    strength_factor: Option<f64>,
}

crate::archive::state!(LinkAccount {
    previous_stretch,
    previous_force,
    energy_account,
    axis_history,
    strength_factor
});

/// What a link in space did in the step before, along each axis.
#[derive(Clone, Debug)]
struct AxisHistory {
    link: SpaceLink,
    /// [m a step], and the force that pulls its ends together [N].
    previous_stretches: [f64; AXES_MAX],
    previous_forces: [f64; AXES_MAX],
}

crate::archive::option!(AxisHistory, fixed);

crate::archive::state!(AxisHistory {
    previous_stretches,
    previous_forces
});

impl AxisHistory {
    fn new(link: SpaceLink) -> Self {
        let (previous_stretches, previous_forces) = ([0.0; AXES_MAX], [0.0; AXES_MAX]);
        Self {
            link,
            previous_stretches,
            previous_forces,
        }
    }

    /// The work that the link took since the step before [J], if it pulls with `force` [N] now.
    fn step(&mut self, ends: (usize, usize), force: f64, modules: &ModuleState) -> f64 {
        let (_, direction) = self.link.length_and_direction(ends, |mat| modules.x[mat]);
        let mut step_work = 0.0;
        for (axis, direction) in direction.into_iter().enumerate().take(self.link.n_axes) {
            let (first_mat, second_mat) = self.link.pair(ends, axis);
            let stretch = modules.d[second_mat] - modules.d[first_mat];
            step_work += 0.5 * (self.previous_stretches[axis] + stretch) * self.previous_forces[axis];
            (self.previous_stretches[axis], self.previous_forces[axis]) = (stretch, force * direction);
        }
        step_work
    }
}

/// A link whose account is checked.
#[derive(Clone, Debug)]
pub(super) struct CheckedLink {
    /// A run of only this link.
    pub(super) run: LinkRun,
    /// Elongations [m] when the account began, and a step before; of bristles, their bend, twice.
    start_elongations: [f64; 2],
    /// Whether the account counts the energy that was stored when it began; that is computed only when needed.
    pub(super) includes_start_energy: bool,
    pub(super) worst_gain: Option<EnergyGain>,
}

crate::archive::state!(CheckedLink {
    start_elongations,
    includes_start_energy,
    worst_gain
});

impl CheckedLink {
    pub(super) fn new(run: LinkRun) -> Self {
        Self {
            run,
            start_elongations: [0.0; 2],
            includes_start_energy: false,
            worst_gain: None,
        }
    }

    /// The energy created by frame `n`, if that is worth reporting; `motion_energy` is the energy of all masses,
    /// `imposed_work_max` what hands and imposed paths put in.
    pub(super) fn check(
        &mut self,
        link_account: &mut LinkAccount,
        modules: &ModuleState,
        (motion_energy, imposed_work_max): (impl Fn() -> f64, f64),
        n: u64,
    ) -> Option<EnergyGain> {
        if link_account.energy_account.is_overdrawn() && !self.includes_start_energy {
            let start_energy = link_account.start_energy(self);
            link_account.energy_account.add_start_energy(start_energy);
            self.includes_start_energy = true;
        }
        if !link_account.energy_account.is_overdrawn() {
            return None;
        }
        let energy_now = motion_energy();
        link_account.energy_account.add_work_of_masses(0.0, energy_now);
        let gain = link_account.energy_gain(self, modules, (energy_now, imposed_work_max), n);
        if !gain.is_reportable() || gain.created_energy <= rounding_energy(&self.run, modules) {
            return None;
        }
        self.worst_gain = Some(gain.worse_of(self.worst_gain));
        Some(gain)
    }
}

impl LinkAccount {
    /// The account of a run of one link; `is_fused`: it is computed in one pass with others; `strength_varies`: its
    /// strength changes in time.
    pub(super) fn new(run: &LinkRun, is_fused: bool, strength_varies: bool) -> Self {
        Self {
            a: run.a,
            b: run.b,
            link: run.first_link,
            previous_stretch: 0.0,
            previous_force: 0.0,
            energy_account: EnergyAccount::default(),
            axis_history: match &run.kind {
                LinkRunKind::Space(link) => Some(AxisHistory::new(link.clone())),
                _ => None,
            },
            fused_spring: is_fused.then(|| run.spring()).flatten(),
            strength_factor: strength_varies.then_some(0.0),
        }
    }

    /// The force in the step before [N].
    pub(super) fn previous_force(&self) -> f64 {
        self.previous_force
    }

    /// Restart the account.
    pub(super) fn begin(&mut self, link: &mut CheckedLink, scheme: &Scheme, gates: &[f64], modules: &ModuleState) {
        self.energy_account = EnergyAccount::default();
        self.previous_stretch = modules.d[self.b] - modules.d[self.a];
        self.previous_force = self.force_now(modules);
        if self.strength_factor.is_some() {
            self.strength_factor = Some(strength_factor(&link.run, scheme, gates));
        }
        if let Some(axis_history) = &mut self.axis_history {
            axis_history.step((self.a, self.b), self.previous_force, modules);
        }
        (link.start_elongations, link.includes_start_energy) = (elongations(&link.run, modules), false);
    }

    /// Account for a step in which all forces are known and MATs have not moved yet.
    pub(super) fn step(&mut self, link: &CheckedLink, scheme: &Scheme, gates: &[f64], modules: &ModuleState) {
        let link_force = self.force_now(modules);
        if let Some(strength_before) = self.strength_factor {
            let strength_now = strength_factor(&link.run, scheme, gates);
            if strength_now != strength_before {
                let stored_energy = link_energy(&link.run, elongations(&link.run, modules));
                self.energy_account
                    .add_work((strength_now - strength_before) * stored_energy);
                self.strength_factor = Some(strength_now);
            }
        }
        if link_force == 0.0 && self.previous_force == 0.0 {
            return;
        }
        let link_ends = (self.a, self.b);
        let (step_work, kinetic_energy) = if let Some(axis_history) = &mut self.axis_history {
            let step_work = axis_history.step(link_ends, link_force, modules);
            let axis_pairs = (0..axis_history.link.n_axes).map(|axis| axis_history.link.pair(link_ends, axis));
            (
                step_work,
                axis_pairs
                    .map(|link_ends| kinetic_energy(link_ends, scheme, modules))
                    .sum(),
            )
        } else {
            let stretch = modules.d[self.b] - modules.d[self.a];
            let step_work = 0.5 * (self.previous_stretch + stretch) * self.previous_force;
            self.previous_stretch = stretch;
            (step_work, kinetic_energy(link_ends, scheme, modules))
        };
        self.energy_account.add_work_of_masses(step_work, kinetic_energy);
        self.previous_force = link_force;
    }

    /// The energy created so far, by frame `n`; `motion_energy` is the energy of all masses, `imposed_work_max` what
    /// hands and imposed paths put in.
    pub(super) fn energy_gain(
        &self,
        link: &CheckedLink,
        modules: &ModuleState,
        (motion_energy, imposed_work_max): (f64, f64),
        n: u64,
    ) -> EnergyGain {
        let mut account = self.energy_account;
        if !link.includes_start_energy {
            account.add_start_energy(self.start_energy(link));
        }
        let stored_energy = self.stored_energy(&link.run, modules);
        account
            .energy_gain(stored_energy, motion_energy, n)
            .with_reference_energy_min(imposed_work_max)
    }

    /// The energy that its link stored when the account began [J].
    fn start_energy(&self, link: &CheckedLink) -> f64 {
        self.strength_factor.unwrap_or(1.0) * link_energy(&link.run, link.start_elongations)
    }

    /// The energy that its link stored between the two frames up to which the account goes: MATs have moved on since
    /// [J].
    fn stored_energy(&self, run: &LinkRun, modules: &ModuleState) -> f64 {
        let [elongation_next, elongation_now] = elongations(run, modules);
        let elongation_pair = if run.n_axes() > 1 || run.bristle().is_some() {
            [elongation_next, elongation_now]
        } else {
            [elongation_now, elongation_now - self.previous_stretch]
        };
        self.strength_factor.unwrap_or(1.0) * link_energy(run, elongation_pair)
    }

    /// The force of the link now [N].
    fn force_now(&self, modules: &ModuleState) -> f64 {
        match &self.fused_spring {
            None => modules.link_forces[self.link],
            Some(spring) => {
                let e = modules.x[self.b] - modules.x[self.a] - spring.rest;
                let stretch = modules.d[self.b] - modules.d[self.a];
                spring.k * e + spring.q * (e * e * e) + spring.z * stretch
            }
        }
    }
}

/// The strength of a link in this step, as a factor of what it is as written.
fn strength_factor(run: &LinkRun, scheme: &Scheme, gates: &[f64]) -> f64 {
    let gate_opening = run.gate.map_or(1.0, |gate| gates[gate]);
    let mut scheme_runs = scheme.link_runs();
    let run_now = scheme_runs.find(|scheme_run| scheme_run.links().contains(&run.first_link));
    let stiffness_ratio = run_now.map_or(1.0, |run_now| run_now.k / run.k);
    if stiffness_ratio.is_finite() {
        gate_opening * stiffness_ratio
    } else {
        gate_opening
    }
}

/// Elongations of a link now and a step before [m]; of bristles, their bend.
fn elongations(run: &LinkRun, modules: &ModuleState) -> [f64; 2] {
    if run.bristle().is_some() {
        return [modules.link_memories[run.first_link]; 2];
    }
    let elongation_now = run.elongation(0, |mat| modules.x[mat]);
    if run.n_axes() > 1 {
        let permanent_stretch = if run.has_permanent_stretch() {
            modules.link_memories[run.first_link]
        } else {
            0.0
        };
        let elongation_before = run.elongation(0, |mat| modules.x[mat] - modules.d[mat]);
        return [
            elongation_now - permanent_stretch,
            elongation_before - permanent_stretch,
        ];
    }
    [elongation_now, elongation_now - (modules.d[run.b] - modules.d[run.a])]
}

/// Energy of a link in space that rounding alone explains [J]: its elongation is a difference of coordinates.
fn rounding_energy(run: &LinkRun, modules: &ModuleState) -> f64 {
    /// Error of the elongation in units of the last digit: rounding adds up from step to step.
    const ELONGATION_ERROR_ULP: f64 = 1e4;
    if run.n_axes() == 1 {
        return 0.0; // a contact that is open has no force at all
    }
    let end_positions = run.pairs(0).flat_map(|(a, b)| [modules.x[a], modules.x[b]]);
    let elongation_error = ELONGATION_ERROR_ULP * f64::EPSILON * end_positions.map(f64::abs).fold(0.0, f64::max);
    run.k * elongation_error * elongation_error
}

/// Energy of a link between two steps [J].
fn link_energy(run: &LinkRun, [elongation_now, elongation_before]: [f64; 2]) -> f64 {
    match run.bristle() {
        Some((bristle, _)) => bristle.energy(elongation_now),
        None => 0.5 * (run.potential_energy(elongation_now) + run.potential_energy(elongation_before)),
    }
}

/// Kinetic energy of the two ends of a link along one axis [J], without ends that are imposed.
fn kinetic_energy((a, b): (usize, usize), scheme: &Scheme, modules: &ModuleState) -> f64 {
    let mat_energy = |mat: usize| {
        let (d, w) = (modules.d[mat], scheme.w[mat]);
        if w > 0.0 { 0.5 * d * d / w } else { 0.0 }
    };
    mat_energy(a) + mat_energy(b)
}
