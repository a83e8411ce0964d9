//! Energy that contacts of all pairs of points create: one account for all of an island.

use super::energy_account::{Account, Gain};
use super::pair_energy::{held, potential};
use crate::kernel::Neighbours;
use crate::maths::wide::wide;
use crate::network::PairRun;
use crate::scheme::Scheme;
use crate::state::Body;

/// Created energy is ignored up to that of a spring stretched by this many units of the last digit of a coordinate.
const ELONGATION_ERROR_ULP: f64 = 1e4;
/// Number of partial sums: the same on every machine.
const LANES: usize = 8;

/// The account of all these contacts.
#[derive(Clone, Debug)]
pub(super) struct PairGains {
    pair_contacts: Vec<PairContacts>,
    /// The step before: last steps [m], and forces of the contacts [N]   (n_mat each)
    d: Vec<f64>,
    force: Vec<f64>,
    /// Elastic energy of friction when the account began [J].
    held: f64,
    /// Positions [m] and last steps [m] when the account began   (n_mat each)
    from: [Vec<f64>; 2],
    account: Account,
    /// Whether the account counts the energy that was stored when it began; that is computed only when needed.
    is_whole: bool,
    worst: Option<Gain>,
}

crate::archive::option!(PairGains, fixed);

crate::archive::state!(PairGains {
    d,
    force,
    held,
    from,
    account,
    is_whole,
    worst
});

/// One run of contacts of all pairs.
#[derive(Clone, Debug)]
struct PairContacts {
    run: PairRun,
    first: usize,
    slot: usize,
    k: f64,
    neighbours: Neighbours,
}

impl PairGains {
    /// `None` if there are no such contacts, or one of them has a gate.
    pub(super) fn new(scheme: &Scheme) -> Option<Self> {
        let pair_runs = scheme.runs.iter().filter_map(|scheme_run| {
            let run = scheme_run.pairwise()?;
            Some((scheme_run, run))
        });
        let pair_contacts: Vec<PairContacts> = pair_runs
            .clone()
            .map(|(scheme_run, run)| PairContacts {
                first: scheme_run.first,
                slot: scheme_run.slot(),
                k: scheme_run.k,
                neighbours: Neighbours::new(&run),
                run,
            })
            .collect();
        let mat_buffer = || vec![0.0; scheme.n_mat()];
        let is_gated = pair_runs.clone().any(|(scheme_run, _)| scheme_run.gate.is_some());
        (!pair_contacts.is_empty() && !is_gated).then(|| Self {
            pair_contacts,
            d: mat_buffer(),
            force: mat_buffer(),
            held: 0.0,
            from: [mat_buffer(), mat_buffer()],
            account: Account::default(),
            is_whole: false,
            worst: None,
        })
    }

    /// The link whose name stands for all of them in messages.
    pub(super) fn first_link(&self) -> usize {
        self.pair_contacts[0].first
    }

    pub(super) fn worst(&self) -> Option<Gain> {
        self.worst
    }

    /// A MAT that these contacts move.
    pub(super) fn moving_mat(&self, scheme: &Scheme) -> usize {
        let pair_run = &self.pair_contacts[0].run;
        let first_moving = (pair_run.b..pair_run.b + pair_run.n_second).find(|&mat| scheme.w[mat] > 0.0);
        first_moving.unwrap_or(pair_run.a)
    }

    /// Whether any of the marked MATs (n_mat) is an end of these contacts.
    pub(super) fn touches(&self, mats: &[bool]) -> bool {
        let mut mat_spans = self
            .pair_contacts
            .iter()
            .flat_map(|contacts| contacts.run.point_ranges());
        mat_spans.any(|span| mats[span].iter().any(|&is_marked| is_marked))
    }

    pub(super) fn begin(&mut self, body: &Body) {
        self.account = Account::default();
        self.d.copy_from_slice(&body.d);
        self.force.copy_from_slice(&body.pair_force);
        self.held = self.held(body);
        self.from[0].copy_from_slice(&body.x);
        self.from[1].copy_from_slice(&body.d);
        self.is_whole = false;
    }

    pub(super) fn step(&mut self, body: &Body) {
        let motion_now = [&*body.d, &*body.pair_force];
        self.account.take(-work(&mut self.d, &mut self.force, motion_now));
    }

    /// The energy created by frame `n`, if that is worth reporting; `moving_energy` is the energy of all masses.
    pub(super) fn check(
        &mut self,
        body: &Body,
        (moving_energy, hand_work): (impl Fn() -> f64, f64),
        n: u64,
    ) -> Option<Gain> {
        if self.account.is_overdrawn() && !self.is_whole {
            let start_energy = stored(&mut self.pair_contacts, [&self.from[0], &self.from[1]]);
            self.account.add_start(start_energy + self.held);
            self.is_whole = true;
        }
        if !self.account.is_overdrawn() {
            return None;
        }
        let stored = stored(&mut self.pair_contacts, [&body.x, &body.d]) + self.held(body);
        let gain = self
            .account
            .gain(stored, moving_energy(), n)
            .with_reference_min(hand_work);
        if !gain.is_reportable() || gain.created <= self.rounding(body) {
            return None;
        }
        self.worst = Some(gain.worse_of(self.worst));
        Some(gain)
    }

    /// Elastic energy of friction [J].
    fn held(&self, body: &Body) -> f64 {
        let pair_contacts = self.pair_contacts.iter();
        let pair_energy =
            |contacts: &PairContacts| held(&contacts.run, contacts.k, &body.histories[contacts.slot], body);
        pair_contacts.map(pair_energy).sum()
    }

    fn rounding(&self, body: &Body) -> f64 {
        let pair_energy = |contacts: &PairContacts| {
            let contact_mats = contacts.run.point_ranges().flatten();
            let largest_position = contact_mats.map(|mat| body.x[mat].abs()).fold(0.0, f64::max);
            let elongation_error = ELONGATION_ERROR_ULP * f64::EPSILON * largest_position;
            contacts.run.n_second as f64 * contacts.k * elongation_error * elongation_error
        };
        self.pair_contacts.iter().map(pair_energy).sum()
    }
}

wide! {
    /// Work of the forces of the step before, along half of its step and half of the present one [J]; then replaces `d`
    /// and `force` by `now`.
    fn work(d: &mut [f64], force: &mut [f64], now: [&[f64]; 2]) -> f64 {
        let (mut sums, mut rest) = ([0.0; LANES], 0.0);
        let n = d.len();
        let (force, [d_now, force_now]) = (&mut force[..n], now.map(|now| &now[..n]));
        let whole = n - n % LANES;
        for at in (0..whole).step_by(LANES) {
            for (lane, sum) in sums.iter_mut().enumerate() {
                let i = at + lane;
                *sum += 0.5 * (d[i] + d_now[i]) * force[i];
            }
        }
        for i in whole..n {
            rest += 0.5 * (d[i] + d_now[i]) * force[i];
        }
        d.copy_from_slice(d_now);
        force.copy_from_slice(force_now);
        sums.iter().sum::<f64>() + rest
    }
}

/// Energy of all pairs between two steps [J], at positions and last steps [m] (n_mat each).
fn stored(pair_contacts: &mut [PairContacts], [x, d]: [&[f64]; 2]) -> f64 {
    let pair_energy = |contacts: &mut PairContacts| {
        let PairContacts { run, k, neighbours, .. } = contacts;
        0.5 * (potential(run, *k, neighbours, |mat| x[mat]) + potential(run, *k, neighbours, |mat| x[mat] - d[mat]))
    };
    pair_contacts.iter_mut().map(pair_energy).sum()
}
