//! Energy that contacts of all pairs of points create: one account for all of an island.

use super::energy_account::{EnergyAccount, EnergyGain};
use super::pair_energy::{friction_energy, potential_energy};
use crate::kernel::Neighbours;
use crate::maths::wide::wide;
use crate::network::PairRun;
use crate::scheme::Scheme;
use crate::state::ModuleState;

/// Created energy is ignored up to that of a spring stretched by this many units of the last digit of a coordinate.
const ELONGATION_ERROR_ULP: f64 = 1e4;
/// Number of partial sums: the same on every machine.
const LANES: usize = 8;

/// The account of all these contacts.
#[derive(Clone, Debug)]
pub(super) struct PairEnergyGains {
    pair_contacts: Vec<PairContacts>,
    /// The step before: last steps [m], and forces of the contacts [N]   (n_mat each)
    previous_steps: Vec<f64>,
    previous_forces: Vec<f64>,
    /// Elastic energy of friction when the account began [J].
    start_friction_energy: f64,
    /// Positions [m] and last steps [m] when the account began   (n_mat each)
    start_motion: [Vec<f64>; 2],
    energy_account: EnergyAccount,
    /// Whether the account counts the energy that was stored when it began; that is computed only when needed.
    includes_start_energy: bool,
    worst_gain: Option<EnergyGain>,
}

crate::archive::option!(PairEnergyGains, fixed);

crate::archive::state!(PairEnergyGains {
    previous_steps,
    previous_forces,
    start_friction_energy,
    start_motion,
    energy_account,
    includes_start_energy,
    worst_gain
});

/// One run of contacts of all pairs.
#[derive(Clone, Debug)]
struct PairContacts {
    run: PairRun,
    first_link: usize,
    history_slot: usize,
    stiffness: f64,
    neighbours: Neighbours,
}

impl PairEnergyGains {
    /// `None` if there are no such contacts, or one of them has a gate.
    pub(super) fn new(scheme: &Scheme) -> Option<Self> {
        let pair_runs = scheme.runs.iter().filter_map(|scheme_run| {
            let run = scheme_run.pairwise()?;
            Some((scheme_run, run))
        });
        let pair_contacts: Vec<PairContacts> = pair_runs
            .clone()
            .map(|(scheme_run, run)| PairContacts {
                first_link: scheme_run.first_link,
                history_slot: scheme_run.slot(),
                stiffness: scheme_run.k,
                neighbours: Neighbours::new(&run),
                run,
            })
            .collect();
        let mat_buffer = || vec![0.0; scheme.n_mat()];
        let is_gated = pair_runs.clone().any(|(scheme_run, _)| scheme_run.gate.is_some());
        (!pair_contacts.is_empty() && !is_gated).then(|| Self {
            pair_contacts,
            previous_steps: mat_buffer(),
            previous_forces: mat_buffer(),
            start_friction_energy: 0.0,
            start_motion: [mat_buffer(), mat_buffer()],
            energy_account: EnergyAccount::default(),
            includes_start_energy: false,
            worst_gain: None,
        })
    }

    /// The link by which messages name all of them.
    pub(super) fn first_link(&self) -> usize {
        self.pair_contacts[0].first_link
    }

    pub(super) fn worst_gain(&self) -> Option<EnergyGain> {
        self.worst_gain
    }

    /// A MAT that these contacts move.
    pub(super) fn moving_mat(&self, scheme: &Scheme) -> usize {
        let pair_run = &self.pair_contacts[0].run;
        let first_moving = (pair_run.b..pair_run.b + pair_run.n_second).find(|&mat| scheme.w[mat] > 0.0);
        first_moving.unwrap_or(pair_run.a)
    }

    /// Whether any of the marked MATs (n_mat) is an end of these contacts.
    pub(super) fn has_end_among(&self, is_mat_marked: &[bool]) -> bool {
        let mut mat_spans = self
            .pair_contacts
            .iter()
            .flat_map(|contacts| contacts.run.point_ranges());
        mat_spans.any(|span| is_mat_marked[span].iter().any(|&is_marked| is_marked))
    }

    pub(super) fn begin(&mut self, modules: &ModuleState) {
        self.energy_account = EnergyAccount::default();
        self.previous_steps.copy_from_slice(&modules.d);
        self.previous_forces.copy_from_slice(&modules.pair_forces);
        self.start_friction_energy = self.friction_energy(modules);
        self.start_motion[0].copy_from_slice(&modules.x);
        self.start_motion[1].copy_from_slice(&modules.d);
        self.includes_start_energy = false;
    }

    pub(super) fn step(&mut self, modules: &ModuleState) {
        let steps_and_forces = [&*modules.d, &*modules.pair_forces];
        self.energy_account.add_work(-work(
            &mut self.previous_steps,
            &mut self.previous_forces,
            steps_and_forces,
        ));
    }

    /// The energy created by frame `n`, if that is worth reporting; `motion_energy` is the energy of all masses,
    /// `imposed_work_max` what hands and imposed paths put in.
    pub(super) fn check(
        &mut self,
        modules: &ModuleState,
        (motion_energy, imposed_work_max): (impl Fn() -> f64, f64),
        n: u64,
    ) -> Option<EnergyGain> {
        if self.energy_account.is_overdrawn() && !self.includes_start_energy {
            let start_energy = pair_energy(&mut self.pair_contacts, [&self.start_motion[0], &self.start_motion[1]]);
            self.energy_account
                .add_start_energy(start_energy + self.start_friction_energy);
            self.includes_start_energy = true;
        }
        if !self.energy_account.is_overdrawn() {
            return None;
        }
        let stored_energy =
            pair_energy(&mut self.pair_contacts, [&modules.x, &modules.d]) + self.friction_energy(modules);
        let gain = self
            .energy_account
            .energy_gain(stored_energy, motion_energy(), n)
            .with_reference_energy_min(imposed_work_max);
        if !gain.is_reportable() || gain.created_energy <= self.rounding_energy(modules) {
            return None;
        }
        self.worst_gain = Some(gain.worse_of(self.worst_gain));
        Some(gain)
    }

    /// Elastic energy of friction [J].
    fn friction_energy(&self, modules: &ModuleState) -> f64 {
        let pair_contacts = self.pair_contacts.iter();
        let run_friction_energy = |contacts: &PairContacts| {
            friction_energy(
                &contacts.run,
                contacts.stiffness,
                &modules.contact_histories[contacts.history_slot],
                modules,
            )
        };
        pair_contacts.map(run_friction_energy).sum()
    }

    fn rounding_energy(&self, modules: &ModuleState) -> f64 {
        let run_rounding_energy = |contacts: &PairContacts| {
            let contact_mats = contacts.run.point_ranges().flatten();
            let largest_position = contact_mats.map(|mat| modules.x[mat].abs()).fold(0.0, f64::max);
            let elongation_error = ELONGATION_ERROR_ULP * f64::EPSILON * largest_position;
            contacts.run.n_second as f64 * contacts.stiffness * elongation_error * elongation_error
        };
        self.pair_contacts.iter().map(run_rounding_energy).sum()
    }
}

wide! {
/// Work of the forces of the step before, along half of its step and half of the present one [J]; then replaces `d`
/// and `force` by `present`, the steps and forces of the present step.
fn work(d: &mut [f64], force: &mut [f64], present: [&[f64]; 2]) -> f64 { let (mut lane_sums, mut tail_sum) = ([0.0; LANES], 0.0); let n = d.len(); let (force, [d_now, force_now]) = (&mut force[..n], present.map(|values| &values[..n])); let tail_start = n - n % LANES; for first_lane in (0..tail_start).step_by(LANES) { for (lane, sum) in lane_sums.iter_mut().enumerate() { let i = first_lane + lane; *sum += 0.5 * (d[i] + d_now[i]) * force[i]; } } for i in tail_start..n { tail_sum += 0.5 * (d[i] + d_now[i]) * force[i]; } d.copy_from_slice(d_now); force.copy_from_slice(force_now); lane_sums.iter().sum::<f64>() + tail_sum } }

/// Energy of all pairs between two steps [J], at positions and last steps [m] (n_mat each).
fn pair_energy(pair_contacts: &mut [PairContacts], [x, d]: [&[f64]; 2]) -> f64 {
    let pair_energy = |contacts: &mut PairContacts| {
        let PairContacts {
            run,
            stiffness,
            neighbours,
            ..
        } = contacts;
        0.5 * (potential_energy(run, *stiffness, neighbours, |mat| x[mat])
            + potential_energy(run, *stiffness, neighbours, |mat| x[mat] - d[mat]))
    };
    pair_contacts.iter_mut().map(pair_energy).sum()
}
