//! Energy that explicit steps create.
//!
//! A contact or a law whose force is that at the present frame gives back what it took only if its own oscillation is
//! slow against the steps. So each has an account of the work that it took, ½(e⁺ − e⁻)·f a step: with this work the
//! scheme balances exactly, whatever else moves the ends. What a link gave or stores beyond the work that it took is
//! created energy.

use super::energy_account::{Account, Gain};
use super::pair_gain::PairGains;
use super::{Fault, Island, OnFault};
use crate::kernel;
use crate::network::{AXES_MAX, SpaceLaw, SpaceLink};
use crate::scheme::{Kind, Run, Scheme};
use crate::state::Body;

/// Steps between two looks at the accounts.
pub(super) const BLOCK: u64 = 256;
/// Longest run of laws with accounts: a longer one would take more time for its accounts than for its steps.
const LONGEST: usize = 32;
/// Elongations [m] and rates [m/s] at which a law's damping is tested for giving energy.
const ACTIVE: (f64, f64) = (1e-2, 10.0);

/// The account of one link, added to at every step.
#[derive(Clone, Debug)]
struct LinkWork {
    a: usize,
    b: usize,
    link: usize,
    /// In the step before: the stretch [m a step], and the force [N].
    stretch: f64,
    force: f64,
    account: Account,
    /// The same along each axis, for a link in space.
    space: Option<SpaceWork>,
}

crate::archive::state!(LinkWork {
    stretch,
    force,
    account,
    space
});

/// What a link in space did in the step before, along each axis.
#[derive(Clone, Debug)]
struct SpaceWork {
    link: SpaceLink,
    /// [m a step], and the force that pulls its ends together [N].
    stretch: [f64; AXES_MAX],
    force: [f64; AXES_MAX],
}

crate::archive::option!(SpaceWork, fixed);

crate::archive::state!(SpaceWork { stretch, force });

impl SpaceWork {
    fn new(link: SpaceLink) -> Self {
        let (stretch, force) = ([0.0; AXES_MAX], [0.0; AXES_MAX]);
        Self {
            link,
            stretch,
            force,
        }
    }

    /// The work that the link took since the step before [J], if it pulls with `force` [N] now.
    fn step(&mut self, ends: (usize, usize), force: f64, body: &Body) -> f64 {
        let (_, along) = self.link.line(ends, |mat| body.x[mat]);
        let mut work = 0.0;
        for (axis, along) in along.into_iter().enumerate().take(self.link.n_axes) {
            let (a, b) = self.link.pair(ends, axis);
            let stretch = body.d[b] - body.d[a];
            work += 0.5 * (self.stretch[axis] + stretch) * self.force[axis];
            (self.stretch[axis], self.force[axis]) = (stretch, force * along);
        }
        work
    }
}

/// A link whose account is checked.
#[derive(Clone, Debug)]
struct Watched {
    /// A run of only this link.
    run: Run,
    /// Elongations [m] when the account began, and a step before.
    from: [f64; 2],
    /// Whether the account counts the energy that was stored when it began; that is computed only when needed.
    is_whole: bool,
    worst: Option<Gain>,
}

crate::archive::state!(Watched {
    from,
    is_whole,
    worst
});

/// All links that may create energy.
#[derive(Clone, Debug)]
pub(super) struct Gains {
    link_work: Vec<LinkWork>,
    links: Vec<Watched>,
    pairs: Option<PairGains>,
    /// Whether accounts begin at this step.
    is_fresh: bool,
}

crate::archive::option!(Box<Gains>, fixed);

crate::archive::state!(Gains {
    link_work,
    links,
    pairs,
    is_fresh
});

impl Gains {
    /// `None` if nothing can create energy.
    pub(super) fn new(scheme: &Scheme) -> Option<Box<Self>> {
        let may_gain = |run: &&Run| {
            let may = match &run.kind {
                Kind::Ref
                | Kind::Hardening(_)
                | Kind::Followed { .. }
                | Kind::Bristle { .. }
                | Kind::Dry { .. } => false,
                Kind::Pairwise { .. } => false, // all contacts of pairs share one account
                Kind::But(_) => true,
                Kind::Space(space) => match &space.law {
                    law if law.is_contact() => true,
                    SpaceLaw::Lnl { law, .. } => !law.is_active(ACTIVE.0, ACTIVE.1),
                    _ => run.len <= LONGEST,
                },
                Kind::Lnl { law, .. } => {
                    let is_exempt = law.is_shared() || law.is_active(ACTIVE.0, ACTIVE.1);
                    run.len <= LONGEST && !is_exempt
                }
            };
            may && run.gate.is_none()
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
        let runs = scheme.runs.iter().filter(may_gain).flat_map(alone);
        let links: Vec<Watched> = runs
            .map(|run| Watched {
                run,
                from: [0.0; 2],
                is_whole: false,
                worst: None,
            })
            .collect();
        let link_work = links.iter().map(|Watched { run, .. }| LinkWork {
            a: run.a,
            b: run.b,
            link: run.first,
            stretch: 0.0,
            force: 0.0,
            account: Account::default(),
            space: match &run.kind {
                Kind::Space(link) => Some(SpaceWork::new(link.clone())),
                _ => None,
            },
        });
        let link_work = link_work.collect();
        let pairs = PairGains::new(scheme);
        (!links.is_empty() || pairs.is_some()).then(|| {
            Box::new(Self {
                link_work,
                links,
                pairs,
                is_fresh: true,
            })
        })
    }

    /// Begin the accounts anew at the next step, because what happened in this one is not known.
    pub(super) fn restart(&mut self) {
        self.is_fresh = true;
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
    pub(super) fn step(&mut self, scheme: &Scheme, body: &Body) {
        if self.is_fresh {
            self.begin(body);
            return;
        }
        for link_work in &mut self.link_work {
            let force = body.link[link_work.link];
            if force == 0.0 && link_work.force == 0.0 {
                continue;
            }
            let ends = (link_work.a, link_work.b);
            let (work, kinetic) = if let Some(space) = &mut link_work.space {
                let work = space.step(ends, force, body);
                let axes = (0..space.link.n_axes).map(|axis| space.link.pair(ends, axis));
                (work, axes.map(|ends| kinetic(ends, scheme, body)).sum())
            } else {
                let stretch = body.d[link_work.b] - body.d[link_work.a];
                let work = 0.5 * (link_work.stretch + stretch) * link_work.force;
                link_work.stretch = stretch;
                (work, kinetic(ends, scheme, body))
            };
            link_work.account.take_from_masses(work, kinetic);
            link_work.force = force;
        }
        if let Some(pairs) = &mut self.pairs {
            pairs.step(body);
        }
    }

    #[cold]
    fn begin(&mut self, body: &Body) {
        for (link_work, link) in self.link_work.iter_mut().zip(&mut self.links) {
            link_work.account = Account::default();
            link_work.stretch = body.d[link_work.b] - body.d[link_work.a];
            link_work.force = body.link[link_work.link];
            if let Some(space) = &mut link_work.space {
                space.step((link_work.a, link_work.b), link_work.force, body);
            }
            (link.from, link.is_whole) = (elongations(&link.run, body), false);
        }
        if let Some(pairs) = &mut self.pairs {
            pairs.begin(body);
        }
        self.is_fresh = false;
    }
}

impl Watched {
    /// The energy created by frame `n`, if that is worth reporting; `around` is the energy of all masses.
    fn check(
        &mut self,
        account: &mut Account,
        body: &Body,
        around: impl Fn() -> f64,
        n: u64,
    ) -> Option<Gain> {
        if account.is_overdrawn() && !self.is_whole {
            let start = stored(&self.run, self.from);
            account.add_start(start);
            self.is_whole = true;
        }
        if !account.is_overdrawn() {
            return None;
        }
        let stored = stored(&self.run, elongations(&self.run, body));
        let gain = account.gain(stored, around(), n);
        if !gain.is_reportable() || gain.created <= rounding(&self.run, body) {
            return None;
        }
        self.worst = Some(gain.worse_of(self.worst));
        Some(gain)
    }
}

/// Elongations of a link now and a step before [m].
fn elongations(run: &Run, body: &Body) -> [f64; 2] {
    let now = run.elongation(0, |mat| body.x[mat]);
    if run.n_axes() > 1 {
        let yielded = if run.yields() {
            body.memory[run.first]
        } else {
            0.0
        };
        let before = run.elongation(0, |mat| body.x[mat] - body.d[mat]);
        return [now - yielded, before - yielded];
    }
    [now, now - (body.d[run.b] - body.d[run.a])]
}

/// Energy of a link in space that rounding alone explains [J]: its elongation is a difference of coordinates.
fn rounding(run: &Run, body: &Body) -> f64 {
    /// Error of the elongation in units of the last digit: rounding adds up from step to step.
    const DIGITS: f64 = 1e4;
    if run.n_axes() == 1 {
        return 0.0; // a contact that is open has no force at all
    }
    let ends = run.pairs(0).flat_map(|(a, b)| [body.x[a], body.x[b]]);
    let least = DIGITS * f64::EPSILON * ends.map(f64::abs).fold(0.0, f64::max);
    run.k * least * least
}

/// Energy of a link between two steps [J].
fn stored(run: &Run, [now, before]: [f64; 2]) -> f64 {
    0.5 * (kernel::potential(run, now) + kernel::potential(run, before))
}

/// Kinetic energy of the two ends of a link along one axis [J], without ends that are imposed.
fn kinetic((a, b): (usize, usize), scheme: &Scheme, body: &Body) -> f64 {
    let own = |mat: usize| {
        let (d, w) = (body.d[mat], scheme.w[mat]);
        if w > 0.0 { 0.5 * d * d / w } else { 0.0 }
    };
    own(a) + own(b)
}

/// Energy of all MATs and of what ties them to the ground [J].
fn around(scheme: &Scheme, body: &Body) -> f64 {
    let own = |i: usize| {
        let (x, d) = (body.x[i] - scheme.rest[i], body.d[i]);
        0.5 * (d * d + scheme.kappa[i] * (x * (x - d))) / scheme.w[i]
    };
    let moving = (0..scheme.n_mat()).filter(|&i| scheme.w[i] > 0.0);
    moving.map(own).sum()
}

impl Island {
    /// Links and bodies that created energy, each with the most that it created.
    pub(crate) fn gains(&self) -> impl Iterator<Item = (String, Gain)> {
        let links = self.state.gains.iter().flat_map(|gains| &gains.links);
        let links = links.filter_map(|link| {
            let gain = link.worst?;
            Some((self.network.link_name(link.run.first), gain))
        });
        let pairs = self.state.gains.iter().filter_map(|gains| {
            let pairs = gains.pairs.as_ref()?;
            Some((self.network.link_name(pairs.first_link()), pairs.worst()?))
        });
        let bodies = self.state.bodies.iter();
        links.chain(pairs).chain(bodies.filter_map(|body| {
            let gain = body.gain()?;
            Some((body.first_module()?.0, gain))
        }))
    }

    /// Check the accounts; stop, or mute, if a part created too much.
    #[cold]
    pub(super) fn check_gains(&mut self) -> Result<(), Fault> {
        let n = self.state.frame;
        let mut faults: Vec<(String, usize, Gain)> = Vec::new();
        if let Some(gains) = &mut self.state.gains {
            let scheme = self.state.scheme.as_deref().unwrap_or(&self.script.scheme);
            let body = &self.state.body;
            let around = || around(scheme, body);
            for (link_work, link) in gains.link_work.iter_mut().zip(&mut gains.links) {
                let found = link.check(&mut link_work.account, body, around, n);
                if let Some(gain) = found.filter(Gain::is_fault) {
                    let (a, b) = (link_work.a, link_work.b);
                    let part = scheme.part[if scheme.w[a] > 0.0 { a } else { b }] as usize;
                    faults.push((self.network.link_name(link_work.link), part, gain));
                }
            }
            if let Some(pairs) = &mut gains.pairs
                && let Some(gain) = pairs.check(body, around, n).filter(Gain::is_fault)
            {
                let part = scheme.part[pairs.moving_mat(scheme)] as usize;
                faults.push((self.network.link_name(pairs.first_link()), part, gain));
            }
        }
        for body in &mut self.state.bodies {
            if let Some(gain) = body.check_gain(n).filter(Gain::is_fault)
                && let Some((module, part)) = body.first_module()
            {
                faults.push((module, part, gain));
            }
        }
        let parts = self.network.parts();
        // Under `units: ca` the time step is part of the instrument: the energy that it creates is intended.
        faults.retain(|(_, part, _)| parts[*part].ca_rate.is_none());
        for (module, part, gain) in faults {
            if self.script.on_fault == OnFault::Stop {
                return Err(self.fault_of(module, part, Some(gain)));
            }
            if !self.state.mutes.is_mute(part) {
                self.mute(part, n);
            }
        }
        Ok(())
    }
}
