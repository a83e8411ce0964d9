//! Energy that explicit steps create.
//!
//! A contact or a law whose force is that at the present frame gives back what it took only if its own oscillation is
//! slow against the steps. So each has an account of the work that it took, ½(e⁺ − e⁻)·f a step: with this work the
//! scheme balances exactly, however else the ends are moved. What a link gave or stores beyond the work that it took is
//! created energy.

mod link_account;

use super::bodies::RunningBody;
use super::energy_account::EnergyGain;
use super::imposed_work::ImposedWork;
use super::pair_gain::PairEnergyGains;
use super::{Fault, Island, OnFault};
use crate::law::Law;
use crate::network::SpaceLaw;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::{ImposedTarget, ModuleState};
use link_account::{CheckedLink, LinkAccount};

/// Longest run of laws, and most springs in space, with accounts: of more, accounts would take more time than steps.
pub(super) const ACCOUNTED_LAWS_MAX: usize = 32;
/// Elongations [m] and rates [m/s] at which a law's damping is tested for giving energy.
const DAMPING_TEST_MAX: (f64, f64) = (1e-2, 10.0);

/// Hardening springs, if they are few; what makes many create energy is how stiff they become, which the guard bounds.
pub(super) fn hardening_springs(scheme: &Scheme) -> Vec<LinkRun> {
    let springs = scheme.runs.iter().filter(|run| run.is_hardening());
    let has_few_springs = springs.clone().map(|run| run.len).sum::<usize>() <= ACCOUNTED_LAWS_MAX;
    springs.filter(|_| has_few_springs).cloned().collect()
}

/// Whether springs in space are few: a mesh has many, in runs as short as its sides. The certificate bounds their
/// stiffness.
fn has_few_space_springs(scheme: &Scheme) -> bool {
    let is_space_spring = |run: &&LinkRun| match &run.kind {
        LinkRunKind::Space(link) => !link.law.is_contact() && !matches!(link.law, SpaceLaw::Lnl { .. }),
        _ => false,
    };
    let space_springs = scheme.runs.iter().filter(is_space_spring);
    space_springs.map(|run| run.len).sum::<usize>() <= ACCOUNTED_LAWS_MAX
}

/// All links that may create energy.
#[derive(Clone, Debug)]
pub(super) struct EnergyGains {
    link_accounts: Vec<LinkAccount>,
    checked_links: Vec<CheckedLink>,
    pair_gains: Option<PairEnergyGains>,
    imposed_work: ImposedWork,
    /// Whether accounts begin at this step.
    restarts_at_next_step: bool,
}

crate::archive::option!(Box<EnergyGains>, fixed);

crate::archive::state!(EnergyGains {
    link_accounts,
    checked_links,
    pair_gains,
    imposed_work,
    restarts_at_next_step
});

impl EnergyGains {
    /// `None` if nothing can create energy. `fused_runs`: hardening springs that are computed in one pass; `is_led`:
    /// whether K and Z of a link change in time.
    pub(super) fn new(scheme: &Scheme, fused_runs: &[LinkRun], is_led: impl Fn(usize) -> bool) -> Option<Box<Self>> {
        let has_few_space_springs = has_few_space_springs(scheme);
        let may_create_energy = |run: &&LinkRun| {
            let may_kind_create = match &run.kind {
                LinkRunKind::Ref | LinkRunKind::Followed { .. } | LinkRunKind::Dry { .. } => false,
                LinkRunKind::Pairwise { .. } => false, // all contacts of pairs share one account
                LinkRunKind::Hardening(_) => run.len == 1,
                LinkRunKind::Bristle { .. } => run.bristle().is_some_and(|(bristle, _)| bristle.is_passive()),
                LinkRunKind::But(_) => true,
                LinkRunKind::Space(space) => match &space.law {
                    law if law.is_contact() => true,
                    SpaceLaw::Lnl { law, .. } => !is_active(law),
                    _ => has_few_space_springs,
                },
                LinkRunKind::Lnl { law, .. } => run.len <= ACCOUNTED_LAWS_MAX && !law.is_shared() && !is_active(law),
            };
            let is_contact = matches!(run.kind, LinkRunKind::But(_));
            // The energy of other links does not change with K alone, or is not that of one link.
            let is_constant = !is_led(run.first_link);
            let has_energy = matches!(run.kind, LinkRunKind::But(_) | LinkRunKind::Lnl { .. });
            may_kind_create && (is_constant || is_contact) && (run.gate.is_none() || has_energy)
        };
        let single_links = |run: &LinkRun| {
            let run = run.clone();
            (0..run.len).map(move |i| LinkRun {
                a: run.a + i,
                b: run.b + i,
                first_link: run.first_link + i,
                len: 1,
                ..run.clone()
            })
        };
        let candidate_runs = scheme.link_runs().chain(fused_runs);
        let candidate_runs = candidate_runs.filter(may_create_energy).flat_map(single_links);
        let checked_links: Vec<CheckedLink> = candidate_runs.map(CheckedLink::new).collect();
        let new_accounts = checked_links.iter().map(|CheckedLink { run, .. }| {
            let is_fused = fused_runs
                .iter()
                .any(|fused_run| fused_run.links().contains(&run.first_link));
            LinkAccount::new(run, is_fused, run.gate.is_some() || is_led(run.first_link))
        });
        let link_accounts = new_accounts.collect();
        let pair_gains = PairEnergyGains::new(scheme).filter(|pairs| !is_led(pairs.first_link()));
        (!checked_links.is_empty() || pair_gains.is_some()).then(|| {
            Box::new(Self {
                link_accounts,
                checked_links,
                pair_gains,
                imposed_work: ImposedWork::default(),
                restarts_at_next_step: true,
            })
        })
    }

    /// Reserve room for this many imposed MATs, so that steps do not allocate.
    pub(super) fn reserve(&mut self, n_targets: usize) {
        self.imposed_work.reserve(n_targets);
    }

    /// Restart the accounts at the next step, because what happened in this one is not known.
    pub(super) fn restart(&mut self) {
        self.restarts_at_next_step = true;
    }

    /// Whether a step in which no link pushes and nothing is imposed changes no account.
    pub(super) fn is_idle(&self) -> bool {
        let link_accounts = self.link_accounts.iter();
        !self.restarts_at_next_step
            && self.pair_gains.is_none()
            && self.imposed_work.is_idle()
            && link_accounts.map(LinkAccount::previous_force).all(|force| force == 0.0)
    }

    /// Remove links that end on the marked MATs (n_mat).
    pub(super) fn remove_links_of(&mut self, mats: &[bool]) {
        let is_retained = |a: usize, b: usize| !mats[a] && !mats[b];
        self.link_accounts
            .retain(|link_account| is_retained(link_account.a, link_account.b));
        self.checked_links.retain(|link| is_retained(link.run.a, link.run.b));
        self.pair_gains.take_if(|pairs| pairs.has_end_among(mats));
        self.restart();
    }

    /// Account for a step in which all forces are known and MATs have not moved yet.
    #[inline(never)]
    pub(super) fn step(&mut self, scheme: &Scheme, gates: &[f64], targets: &[ImposedTarget], modules: &ModuleState) {
        self.imposed_work.step(scheme, targets, modules);
        if self.restarts_at_next_step {
            self.begin(scheme, gates, modules);
            return;
        }
        for (link_account, link) in self.link_accounts.iter_mut().zip(&self.checked_links) {
            link_account.step(link, scheme, gates, modules);
        }
        if let Some(pair_gains) = &mut self.pair_gains {
            pair_gains.step(modules);
        }
    }

    #[cold]
    fn begin(&mut self, scheme: &Scheme, gates: &[f64], modules: &ModuleState) {
        for (link_account, link) in self.link_accounts.iter_mut().zip(&mut self.checked_links) {
            link_account.begin(link, scheme, gates, modules);
        }
        if let Some(pair_gains) = &mut self.pair_gains {
            pair_gains.begin(modules);
        }
        self.restarts_at_next_step = false;
    }
}

/// Whether a law may give energy, as a bow does.
pub(super) fn is_active(law: &Law) -> bool {
    law.is_active(DAMPING_TEST_MAX.0, DAMPING_TEST_MAX.1)
}

/// Energy of all MATs, of what ties them to the ground, and of bodies by their modes [J].
fn motion_energy(scheme: &Scheme, bodies: &[RunningBody], modules: &ModuleState) -> f64 {
    let mat_energy = |i: usize| {
        let (x, d) = (modules.x[i] - scheme.rest[i], modules.d[i]);
        0.5 * (d * d + scheme.kappa[i] * (x * (x - d))) / scheme.w[i]
    };
    let moving_mats = (0..scheme.n_mat()).filter(|&i| scheme.w[i] > 0.0);
    let mut energy_sum: f64 = moving_mats.map(mat_energy).sum();
    for modal in bodies.iter().filter_map(RunningBody::modal) {
        modal.visit_energies(|energy| energy_sum += energy);
    }
    energy_sum
}

impl Island {
    /// Links that created energy, each with the most that it created. If there is none, the rise of the whole energy
    /// comes last.
    fn link_gains(&self) -> impl Iterator<Item = (usize, EnergyGain)> {
        let state = &self.state;
        let checked_links = state
            .monitors
            .energy_gains
            .iter()
            .flat_map(|gains| &gains.checked_links);
        let watched_links = checked_links.filter_map(|link| Some((link.run.first_link, link.worst_gain?)));
        let pair_gains = state.monitors.energy_gains.iter().filter_map(|gains| {
            let pair_gains = gains.pair_gains.as_ref()?;
            Some((pair_gains.first_link(), pair_gains.worst_gain()?))
        });
        let fine_gain = state
            .motion
            .fine_links
            .iter()
            .filter_map(|fine_links| fine_links.stepped_points().worst_gain());
        let mut account_gains = watched_links.chain(pair_gains).chain(fine_gain).peekable();
        let worst_rise = match account_gains.peek() {
            Some(_) => None,
            None => state
                .monitors
                .energy_rise
                .as_ref()
                .and_then(|energy_rise| energy_rise.worst_gain()),
        };
        account_gains.chain(worst_rise)
    }

    /// Links and bodies that created energy, each with the most that it created.
    pub(crate) fn energy_gains(&self) -> impl Iterator<Item = (String, EnergyGain)> {
        let link_gains = self.link_gains();
        let link_gains = link_gains.map(|(link, gain)| (self.network.link_name(link), gain));
        let bodies = self.state.motion.bodies.iter();
        link_gains.chain(bodies.filter_map(|body| Some((body.first_moving_mat()?.0, body.energy_gain()?))))
    }

    /// Whether contacts and laws between frames created energy, or the energy of the whole rose though nothing drove
    /// it.
    pub(crate) fn has_energy_risen(&self) -> bool {
        let state = &self.state;
        let fine_links = state.motion.fine_links.as_ref();
        let energy_rise = state.monitors.energy_rise.as_ref();
        fine_links.is_some_and(|fine_links| fine_links.stepped_points().worst_gain().is_some())
            || energy_rise.is_some_and(|energy_rise| energy_rise.worst_gain().is_some())
    }

    /// Number of links and bodies that created energy.
    pub(crate) fn n_energy_gains(&self) -> usize {
        let bodies = self.state.motion.bodies.iter();
        self.link_gains().count() + bodies.filter(|body| body.energy_gain().is_some()).count()
    }

    /// The most energy that one link or body has created, as a share of the energy that was there.
    pub(crate) fn created_share(&self) -> f64 {
        let [contact_share, other_share] = self.created_shares();
        contact_share.max(other_share)
    }

    /// The most energy that one contact has created, and that one law or body has, as shares of the energy that was
    /// there.
    pub(crate) fn created_shares(&self) -> [f64; 2] {
        let state = &self.state;
        let frame_scheme = state
            .parameters
            .changing_scheme
            .as_deref()
            .unwrap_or(&self.script.scheme);
        let energy_now = motion_energy(frame_scheme, &state.motion.bodies, &state.motion.modules);
        let watched_links = state.monitors.energy_gains.iter().flat_map(|gains| {
            let imposed_work = gains.imposed_work.work_max();
            let watched_links = gains.link_accounts.iter().zip(&gains.checked_links);
            watched_links.map(move |(link_account, link)| {
                let gain = link_account.energy_gain(link, &state.motion.modules, (energy_now, imposed_work), 0);
                (matches!(link.run.kind, LinkRunKind::But(_)), gain)
            })
        });
        let reported_gains = self.energy_gains().map(|(_, gain)| (false, gain));
        let mut worst_shares = [0.0_f64; 2];
        for (is_contact, gain) in watched_links.chain(reported_gains) {
            let gain_share = gain.created_energy / gain.reference_energy;
            let worst_share = &mut worst_shares[usize::from(!is_contact)];
            *worst_share = if gain_share.is_finite() {
                worst_share.max(gain_share)
            } else {
                *worst_share
            };
        }
        worst_shares
    }

    /// Check the accounts; stop, or mute, if a part created too much.
    #[cold]
    pub(super) fn check_energy_gains(&mut self) -> Result<(), Fault> {
        let island_step = self.state.frame;
        let mut gain_faults: Vec<(String, usize, EnergyGain)> = Vec::new();
        let state = &mut self.state;
        let frame_scheme = state
            .parameters
            .changing_scheme
            .as_deref()
            .unwrap_or(&self.script.scheme);
        let (modules, bodies) = (&state.motion.modules, &state.motion.bodies);
        let energy_now = || motion_energy(frame_scheme, bodies, modules);
        let hand_bindings = &self.script.hand_bindings;
        // A part that a hand plays is not silenced where another one can be: its key would jump.
        let silenced_part = |a: usize, b: usize| {
            let is_played = |moved_mat: usize| {
                let mut hand_bindings = hand_bindings.iter();
                hand_bindings.any(|hand| frame_scheme.part[hand.mat()] == frame_scheme.part[moved_mat])
            };
            let silencing_rank = |&moved_mat: &usize| (frame_scheme.w[moved_mat] == 0.0, is_played(moved_mat));
            let silenced_end = if silencing_rank(&b) < silencing_rank(&a) { b } else { a };
            frame_scheme.part[silenced_end] as usize
        };
        let mut imposed_work = 0.0;
        if let Some(gains) = &mut state.monitors.energy_gains {
            imposed_work = gains.imposed_work.work_max();
            for (link_account, link) in gains.link_accounts.iter_mut().zip(&mut gains.checked_links) {
                let link_gain = link.check(link_account, modules, (energy_now, imposed_work), island_step);
                if let Some(gain) = link_gain.filter(EnergyGain::is_fault) {
                    let part = silenced_part(link_account.a, link_account.b);
                    gain_faults.push((self.network.link_name(link_account.link), part, gain));
                }
            }
            if let Some(pair_gains) = &mut gains.pair_gains
                && let Some(gain) = pair_gains
                    .check(modules, (energy_now, imposed_work), island_step)
                    .filter(EnergyGain::is_fault)
            {
                let part = frame_scheme.part[pair_gains.moving_mat(frame_scheme)] as usize;
                gain_faults.push((self.network.link_name(pair_gains.first_link()), part, gain));
            }
        }
        if let Some(fine_links) = &mut state.motion.fine_links
            && let Some((checked_link, moved_mat, gain)) = fine_links
                .stepped_points_mut()
                .check_energy((energy_now, imposed_work), island_step)
            && gain.is_fault()
        {
            gain_faults.push((
                self.network.link_name(checked_link),
                frame_scheme.part[moved_mat] as usize,
                gain,
            ));
        }
        for body in &mut self.state.motion.bodies {
            if let Some(gain) = body.check_energy_gain(island_step).filter(EnergyGain::is_fault)
                && let Some((module_name, part)) = body.first_moving_mat()
            {
                gain_faults.push((module_name, part, gain));
            }
        }
        if let Some((link, moved_mat, gain)) = self.check_energy_rise()
            && gain.is_fault()
        {
            let part = self.script.scheme.part[moved_mat] as usize;
            gain_faults.push((self.network.link_name(link), part, gain));
        }
        let network_parts = self.network.parts();
        // Under `units: ca` the time step is part of the instrument: the energy that it creates is intended.
        gain_faults.retain(|(_, part, _)| network_parts[*part].ca_rate.is_none());
        for (module_name, part, gain) in gain_faults {
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_in_part(module_name, part, Some(gain)));
            }
            if !self.state.monitors.muted_parts.is_muted(part) {
                self.mute(part, island_step);
            }
        }
        Ok(())
    }
}
