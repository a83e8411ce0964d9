//! Energy that explicit steps create.
//!
//! A contact or a law whose force is that at the present frame gives back what it took only if its own oscillation is
//! slow against the steps. So each has an account of the work that it took, ½(e⁺ − e⁻)·f a step: with this work the
//! scheme balances exactly, whatever else moves the ends. What a link gave or stores beyond the work that it took is
//! created energy.

mod link_work;

use super::energy_account::Gain;
use super::inside::RunningBody;
use super::pair_gain::PairGains;
use super::put_in::PutIn;
use super::{Fault, Island, OnFault};
use crate::law::Law;
use crate::network::SpaceLaw;
use crate::scheme::{Kind, Run, Scheme};
use crate::state::{Body, Target};
use link_work::{LinkWork, Watched};

/// Longest run of laws with accounts: a longer one would take more time for its accounts than for its steps.
pub(super) const LONGEST: usize = 32;
/// Elongations [m] and rates [m/s] at which a law's damping is tested for giving energy.
const ACTIVE: (f64, f64) = (1e-2, 10.0);

/// Hardening springs, if they are few; what makes many create energy is how stiff they become, which the guard bounds.
pub(super) fn hardening_springs(scheme: &Scheme) -> Vec<Run> {
    let springs = scheme.runs.iter().filter(|run| run.is_hardening());
    let are_few = springs.clone().map(|run| run.len).sum::<usize>() <= LONGEST;
    springs.filter(|_| are_few).cloned().collect()
}

/// All links that may create energy.
#[derive(Clone, Debug)]
pub(super) struct Gains {
    link_work: Vec<LinkWork>,
    links: Vec<Watched>,
    pairs: Option<PairGains>,
    put_in: PutIn,
    /// Whether accounts begin at this step.
    is_fresh: bool,
}

crate::archive::option!(Box<Gains>, fixed);

crate::archive::state!(Gains {
    link_work,
    links,
    pairs,
    put_in,
    is_fresh
});

impl Gains {
    /// `None` if nothing can create energy. `fused`: hardening springs that are computed in one pass; `is_led`: whether
    /// K and Z of a link change in time.
    pub(super) fn new(
        scheme: &Scheme,
        fused: &[Run],
        is_led: impl Fn(usize) -> bool,
    ) -> Option<Box<Self>> {
        let may_gain = |run: &&Run| {
            let may = match &run.kind {
                Kind::Ref | Kind::Followed { .. } | Kind::Dry { .. } => false,
                Kind::Pairwise { .. } => false, // all contacts of pairs share one account
                Kind::Hardening(_) => run.len == 1,
                Kind::Bristle { .. } => run.bristle().is_some_and(|(by, _)| by.is_passive()),
                Kind::But(_) => true,
                Kind::Space(space) => match &space.law {
                    law if law.is_contact() => true,
                    SpaceLaw::Lnl { law, .. } => !is_active(law),
                    _ => run.len <= LONGEST,
                },
                Kind::Lnl { law, .. } => run.len <= LONGEST && !law.is_shared() && !is_active(law),
            };
            let is_contact = matches!(run.kind, Kind::But(_));
            // The energy of other links does not change with K alone, or is not that of one link.
            let is_constant = !is_led(run.first);
            let has_energy = matches!(run.kind, Kind::But(_) | Kind::Lnl { .. });
            may && (is_constant || is_contact) && (run.gate.is_none() || has_energy)
        };
        let alone = |run: &Run| {
            let run = run.clone();
            (0..run.len).map(move |i| Run {
                a: run.a + i,
                b: run.b + i,
                first: run.first + i,
                len: 1,
                ..run.clone()
            })
        };
        let runs = scheme.runs.iter().chain(&scheme.exact).chain(fused);
        let runs = runs.filter(may_gain).flat_map(alone);
        let links: Vec<Watched> = runs.map(Watched::new).collect();
        let link_work = links.iter().map(|Watched { run, .. }| {
            let is_fused = fused.iter().any(|own| own.links().contains(&run.first));
            LinkWork::new(run, is_fused, run.gate.is_some() || is_led(run.first))
        });
        let link_work = link_work.collect();
        let pairs = PairGains::new(scheme).filter(|pairs| !is_led(pairs.first_link()));
        (!links.is_empty() || pairs.is_some()).then(|| {
            Box::new(Self {
                link_work,
                links,
                pairs,
                put_in: PutIn::default(),
                is_fresh: true,
            })
        })
    }

    /// Reserve room for this many imposed MATs, so that steps do not allocate.
    pub(super) fn reserve(&mut self, n_targets: usize) {
        self.put_in.reserve(n_targets);
    }

    /// Begin the accounts anew at the next step, because what happened in this one is not known.
    pub(super) fn restart(&mut self) {
        self.is_fresh = true;
    }

    /// Whether a step in which no link pushes and nothing is imposed changes no account.
    pub(super) fn is_idle(&self) -> bool {
        let links = self.link_work.iter();
        !self.is_fresh
            && self.pairs.is_none()
            && self.put_in.is_idle()
            && links.map(LinkWork::force).all(|force| force == 0.0)
    }

    /// Remove links that end on the marked MATs (n_mat).
    pub(super) fn release(&mut self, mats: &[bool]) {
        let stays = |a: usize, b: usize| !mats[a] && !mats[b];
        self.link_work
            .retain(|link_work| stays(link_work.a, link_work.b));
        self.links.retain(|link| stays(link.run.a, link.run.b));
        self.pairs.take_if(|pairs| pairs.touches(mats));
        self.restart();
    }

    /// Account for a step in which all forces are known and MATs have not moved yet.
    #[inline(never)]
    pub(super) fn step(&mut self, scheme: &Scheme, gates: &[f64], targets: &[Target], body: &Body) {
        self.put_in.step(scheme, targets, body);
        if self.is_fresh {
            self.begin(scheme, gates, body);
            return;
        }
        for (link_work, link) in self.link_work.iter_mut().zip(&self.links) {
            link_work.step(link, scheme, gates, body);
        }
        if let Some(pairs) = &mut self.pairs {
            pairs.step(body);
        }
    }

    #[cold]
    fn begin(&mut self, scheme: &Scheme, gates: &[f64], body: &Body) {
        for (link_work, link) in self.link_work.iter_mut().zip(&mut self.links) {
            link_work.begin(link, scheme, gates, body);
        }
        if let Some(pairs) = &mut self.pairs {
            pairs.begin(body);
        }
        self.is_fresh = false;
    }
}

/// Whether a law may give energy, as a bow does.
pub(super) fn is_active(law: &Law) -> bool {
    law.is_active(ACTIVE.0, ACTIVE.1)
}

/// Energy of all MATs, of what ties them to the ground, and of bodies by their modes [J].
fn around(scheme: &Scheme, bodies: &[RunningBody], body: &Body) -> f64 {
    let squared = |i: usize| {
        let (x, d) = (body.x[i] - scheme.rest[i], body.d[i]);
        0.5 * (d * d + scheme.kappa[i] * (x * (x - d))) / scheme.w[i]
    };
    let moving = (0..scheme.n_mat()).filter(|&i| scheme.w[i] > 0.0);
    let mut sum: f64 = moving.map(squared).sum();
    for modal in bodies.iter().filter_map(RunningBody::modal) {
        modal.energies(|energy| sum += energy);
    }
    sum
}

impl Island {
    /// Links that created energy, each with the most that it created; last what no account of a link has seen, if
    /// nothing else was found.
    fn link_gains(&self) -> impl Iterator<Item = (usize, Gain)> {
        let state = &self.state;
        let links = state.watch.gains.iter().flat_map(|gains| &gains.links);
        let links = links.filter_map(|link| Some((link.run.first, link.worst?)));
        let pairs = state.watch.gains.iter().filter_map(|gains| {
            let pairs = gains.pairs.as_ref()?;
            Some((pairs.first_link(), pairs.worst()?))
        });
        let fine = state
            .matter
            .fine
            .iter()
            .filter_map(|fine| fine.sprung().worst());
        let mut all = links.chain(pairs).chain(fine).peekable();
        let rise = match all.peek() {
            Some(_) => None,
            None => state.watch.rise.as_ref().and_then(|rise| rise.worst()),
        };
        all.chain(rise)
    }

    /// Links and bodies that created energy, each with the most that it created.
    pub(crate) fn gains(&self) -> impl Iterator<Item = (String, Gain)> {
        let links = self.link_gains();
        let links = links.map(|(link, gain)| (self.network.link_name(link), gain));
        let bodies = self.state.matter.bodies.iter();
        links.chain(bodies.filter_map(|body| Some((body.first_module()?.0, body.gain()?))))
    }

    /// Whether contacts and laws between frames created energy, or the energy of the whole rose though nothing drove it.
    pub(crate) fn has_risen(&self) -> bool {
        let state = &self.state;
        let fine = state.matter.fine.as_ref();
        let rise = state.watch.rise.as_ref();
        fine.is_some_and(|fine| fine.sprung().worst().is_some())
            || rise.is_some_and(|rise| rise.worst().is_some())
    }

    /// Number of links and bodies that created energy.
    pub(crate) fn n_gains(&self) -> usize {
        let bodies = self.state.matter.bodies.iter();
        self.link_gains().count() + bodies.filter(|body| body.gain().is_some()).count()
    }

    /// The most energy that one link or body has created, as a share of the energy that was there.
    pub(crate) fn created_share(&self) -> f64 {
        let [contacts, others] = self.created_shares();
        contacts.max(others)
    }

    /// The most energy that one contact has created, and that one law or body has, as shares of the energy that was there.
    pub(crate) fn created_shares(&self) -> [f64; 2] {
        let state = &self.state;
        let scheme = state
            .values
            .scheme
            .as_deref()
            .unwrap_or(&self.script.scheme);
        let around = around(scheme, &state.matter.bodies, &state.matter.body);
        let links = state.watch.gains.iter().flat_map(|gains| {
            let put_in = gains.put_in.work_max();
            let links = gains.link_work.iter().zip(&gains.links);
            links.map(move |(link_work, link)| {
                let gain = link_work.gain(link, &state.matter.body, (around, put_in), 0);
                (matches!(link.run.kind, Kind::But(_)), gain)
            })
        });
        let reported = self.gains().map(|(_, gain)| (false, gain));
        let mut shares = [0.0_f64; 2];
        for (is_contact, gain) in links.chain(reported) {
            let share = gain.created / gain.reference;
            let worst = &mut shares[usize::from(!is_contact)];
            *worst = if share.is_finite() {
                worst.max(share)
            } else {
                *worst
            };
        }
        shares
    }

    /// Check the accounts; stop, or mute, if a part created too much.
    #[cold]
    pub(super) fn check_gains(&mut self) -> Result<(), Fault> {
        let n = self.state.frame;
        let mut faults: Vec<(String, usize, Gain)> = Vec::new();
        let state = &mut self.state;
        let scheme = state
            .values
            .scheme
            .as_deref()
            .unwrap_or(&self.script.scheme);
        let (body, bodies) = (&state.matter.body, &state.matter.bodies);
        let around = || around(scheme, bodies, body);
        let hands = &self.script.hand_bindings;
        // A part that a hand plays is not silenced where another one can be: its key would jump.
        let part = |a: usize, b: usize| {
            let is_played = |mat: usize| {
                let mut hands = hands.iter();
                hands.any(|hand| scheme.part[hand.mat()] == scheme.part[mat])
            };
            let rank = |&mat: &usize| (scheme.w[mat] == 0.0, is_played(mat));
            let end = if rank(&b) < rank(&a) { b } else { a };
            scheme.part[end] as usize
        };
        let mut put_in = 0.0;
        if let Some(gains) = &mut state.watch.gains {
            put_in = gains.put_in.work_max();
            for (link_work, link) in gains.link_work.iter_mut().zip(&mut gains.links) {
                let link_gain = link.check(link_work, body, (around, put_in), n);
                if let Some(gain) = link_gain.filter(Gain::is_fault) {
                    let part = part(link_work.a, link_work.b);
                    faults.push((self.network.link_name(link_work.link), part, gain));
                }
            }
            if let Some(pairs) = &mut gains.pairs
                && let Some(gain) = pairs
                    .check(body, (around, put_in), n)
                    .filter(Gain::is_fault)
            {
                let part = scheme.part[pairs.moving_mat(scheme)] as usize;
                faults.push((self.network.link_name(pairs.first_link()), part, gain));
            }
        }
        if let Some(fine) = &mut state.matter.fine
            && let Some((link, mat, gain)) = fine.sprung_mut().check((around, put_in), n)
            && gain.is_fault()
        {
            faults.push((
                self.network.link_name(link),
                scheme.part[mat] as usize,
                gain,
            ));
        }
        for body in &mut self.state.matter.bodies {
            if let Some(gain) = body.check_gain(n).filter(Gain::is_fault)
                && let Some((module, part)) = body.first_module()
            {
                faults.push((module, part, gain));
            }
        }
        if let Some((link, mat, gain)) = self.check_rise()
            && gain.is_fault()
        {
            let part = self.script.scheme.part[mat] as usize;
            faults.push((self.network.link_name(link), part, gain));
        }
        let parts = self.network.parts();
        // Under `units: ca` the time step is part of the instrument: the energy that it creates is intended.
        faults.retain(|(_, part, _)| parts[*part].ca_rate.is_none());
        for (module, part, gain) in faults {
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_of(module, part, Some(gain)));
            }
            if !self.state.watch.mutes.is_mute(part) {
                self.mute(part, n);
            }
        }
        Ok(())
    }
}
