//! Energy that explicit steps create.
//!
//! A contact or a law whose force is that at the present frame gives back what it took only if its own oscillation is
//! slow against the steps. So each has an account of the work that it took, ½(e⁺ − e⁻)·f a step: with this work the
//! scheme balances exactly, whatever else moves the ends. What a link gave or stores beyond the work that it took is
//! created energy.

use super::energy_account::{Account, Gain};
use super::fine::Fine;
use super::inside::RunningBody;
use super::pair_gain::PairGains;
use super::put_in::PutIn;
use super::{Fault, Island, OnFault};
use crate::kernel;
use crate::law::Law;
use crate::network::{AXES_MAX, SpaceLaw, SpaceLink};
use crate::scheme::{Kind, Run, Scheme, Spring};
use crate::state::{Body, Target};

/// Steps between two looks at the accounts.
pub(super) const BLOCK: u64 = 256;
/// Longest run of laws with accounts: a longer one would take more time for its accounts than for its steps.
pub(super) const LONGEST: usize = 32;
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
    /// A spring that is computed in one pass with others: its force is not known apart from theirs.
    spring: Option<Spring>,
    /// For a link whose strength changes in time, by a gate or a lead: its strength in the step before, as a factor.
    strength: Option<f64>,
}

crate::archive::state!(LinkWork {
    stretch,
    force,
    account,
    space,
    strength
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
    /// Elongations [m] when the account began, and a step before; of bristles, their bend, twice.
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
                Kind::Lnl { law, .. } => {
                    run.len <= LONGEST && !law.is_shared() && !is_active(law)
                }
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
            spring: (fused.iter())
                .any(|own| (own.first..own.first + own.len).contains(&run.first))
                .then(|| run.spring())
                .flatten(),
            strength: (run.gate.is_some() || is_led(run.first)).then_some(0.0),
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
    pub(super) fn step(
        &mut self,
        scheme: &Scheme,
        gates: &[f64],
        targets: &[Target],
        body: &Body,
    ) {
        self.put_in.step(scheme, targets, body);
        if self.is_fresh {
            self.begin(scheme, gates, body);
            return;
        }
        for (link_work, link) in self.link_work.iter_mut().zip(&self.links) {
            let force = link_work.force_now(body);
            if let Some(before) = link_work.strength {
                let now = strength(&link.run, scheme, gates);
                if now != before {
                    let stored = stored(&link.run, elongations(&link.run, body));
                    link_work.account.take((now - before) * stored);
                    link_work.strength = Some(now);
                }
            }
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
    fn begin(&mut self, scheme: &Scheme, gates: &[f64], body: &Body) {
        for (link_work, link) in self.link_work.iter_mut().zip(&mut self.links) {
            link_work.account = Account::default();
            link_work.stretch = body.d[link_work.b] - body.d[link_work.a];
            link_work.force = link_work.force_now(body);
            if link_work.strength.is_some() {
                link_work.strength = Some(strength(&link.run, scheme, gates));
            }
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
    /// The energy created by frame `n`, if that is worth reporting; `around` is the energy of all masses, `put_in` what
    /// hands put in.
    fn check(
        &mut self,
        link_work: &mut LinkWork,
        body: &Body,
        (around, put_in): (impl Fn() -> f64, f64),
        n: u64,
    ) -> Option<Gain> {
        if link_work.account.is_overdrawn() && !self.is_whole {
            let start = link_work.start(self);
            link_work.account.add_start(start);
            self.is_whole = true;
        }
        if !link_work.account.is_overdrawn() {
            return None;
        }
        let stored = link_work.stored(&self.run, body);
        let gain = link_work.account.gain(stored, around(), n);
        let gain = gain.of_at_least(put_in);
        if !gain.is_reportable() || gain.created <= rounding(&self.run, body) {
            return None;
        }
        self.worst = Some(gain.worse_of(self.worst));
        Some(gain)
    }
}

impl LinkWork {
    /// The energy that its link stored when the account began [J].
    fn start(&self, link: &Watched) -> f64 {
        self.strength.unwrap_or(1.0) * stored(&link.run, link.from)
    }

    /// The energy that its link stored between the two frames up to which the account goes: MATs have moved on since
    /// [J].
    fn stored(&self, run: &Run, body: &Body) -> f64 {
        let [next, now] = elongations(run, body);
        let between = if run.n_axes() > 1 || run.bristle().is_some() {
            [next, now]
        } else {
            [now, now - self.stretch]
        };
        self.strength.unwrap_or(1.0) * stored(run, between)
    }
}

impl LinkWork {
    /// The force of the link now [N].
    fn force_now(&self, body: &Body) -> f64 {
        match &self.spring {
            None => body.link[self.link],
            Some(spring) => {
                let e = body.x[self.b] - body.x[self.a] - spring.rest;
                let stretch = body.d[self.b] - body.d[self.a];
                spring.k * e + spring.q * (e * e * e) + spring.z * stretch
            }
        }
    }
}

/// Whether a law may give energy, as a bow does.
pub(super) fn is_active(law: &Law) -> bool {
    law.is_active(ACTIVE.0, ACTIVE.1)
}

/// The strength of a link in this step, as a factor of what it is as written.
fn strength(run: &Run, scheme: &Scheme, gates: &[f64]) -> f64 {
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    let mut runs = scheme.runs.iter().chain(&scheme.exact);
    let now = runs.find(|own| (own.first..own.first + own.len).contains(&run.first));
    let of_k = now.map_or(1.0, |now| now.k / run.k);
    if of_k.is_finite() { open * of_k } else { open }
}

/// Elongations of a link now and a step before [m]; of bristles, their bend.
fn elongations(run: &Run, body: &Body) -> [f64; 2] {
    if run.bristle().is_some() {
        return [body.memory[run.first]; 2];
    }
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
    match run.bristle() {
        Some((by, _)) => by.energy(now),
        None => 0.5 * (kernel::potential(run, now) + kernel::potential(run, before)),
    }
}

/// Kinetic energy of the two ends of a link along one axis [J], without ends that are imposed.
fn kinetic((a, b): (usize, usize), scheme: &Scheme, body: &Body) -> f64 {
    let own = |mat: usize| {
        let (d, w) = (body.d[mat], scheme.w[mat]);
        if w > 0.0 { 0.5 * d * d / w } else { 0.0 }
    };
    own(a) + own(b)
}

/// Energy of all MATs, of what ties them to the ground, and of bodies by their modes [J].
fn around(scheme: &Scheme, bodies: &[RunningBody], body: &Body) -> f64 {
    let own = |i: usize| {
        let (x, d) = (body.x[i] - scheme.rest[i], body.d[i]);
        0.5 * (d * d + scheme.kappa[i] * (x * (x - d))) / scheme.w[i]
    };
    let moving = (0..scheme.n_mat()).filter(|&i| scheme.w[i] > 0.0);
    let mut sum: f64 = moving.map(own).sum();
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
        let links = state.gains.iter().flat_map(|gains| &gains.links);
        let links = links.filter_map(|link| Some((link.run.first, link.worst?)));
        let pairs = state.gains.iter().filter_map(|gains| {
            let pairs = gains.pairs.as_ref()?;
            Some((pairs.first_link(), pairs.worst()?))
        });
        let fine = state.fine.iter().flat_map(Fine::gains);
        let mut all = links.chain(pairs).chain(fine).peekable();
        let rise = match all.peek() {
            Some(_) => None,
            None => state.rise.as_ref().and_then(|rise| rise.worst()),
        };
        all.chain(rise)
    }

    /// Links and bodies that created energy, each with the most that it created.
    pub(crate) fn gains(&self) -> impl Iterator<Item = (String, Gain)> {
        let links = self.link_gains();
        let links = links.map(|(link, gain)| (self.network.link_name(link), gain));
        let bodies = self.state.bodies.iter();
        links.chain(bodies.filter_map(|body| Some((body.first_module()?.0, body.gain()?))))
    }

    /// Number of links and bodies that created energy.
    pub(crate) fn n_gains(&self) -> usize {
        let bodies = self.state.bodies.iter();
        self.link_gains().count() + bodies.filter(|body| body.gain().is_some()).count()
    }

    /// The most energy that one link or body has created, as a share of the energy that was there.
    pub(crate) fn created_share(&self) -> f64 {
        let state = &self.state;
        let scheme = state.scheme.as_deref().unwrap_or(&self.script.scheme);
        let around = around(scheme, &state.bodies, &state.body);
        let links = state.gains.iter().flat_map(|gains| {
            let put_in = gains.put_in.most();
            let links = gains.link_work.iter().zip(&gains.links);
            links.map(move |(link_work, link)| {
                let mut account = link_work.account;
                if !link.is_whole {
                    account.add_start(link_work.start(link));
                }
                let stored = link_work.stored(&link.run, &state.body);
                account.gain(stored, around, 0).of_at_least(put_in)
            })
        });
        let told = self.gains().map(|(_, gain)| gain);
        let all = links.chain(told).map(|gain| gain.created / gain.reference);
        all.filter(|share| share.is_finite()).fold(0.0, f64::max)
    }

    /// Check the accounts; stop, or mute, if a part created too much.
    #[cold]
    pub(super) fn check_gains(&mut self) -> Result<(), Fault> {
        let n = self.state.frame;
        let mut faults: Vec<(String, usize, Gain)> = Vec::new();
        let state = &mut self.state;
        let scheme = state.scheme.as_deref().unwrap_or(&self.script.scheme);
        let (body, bodies) = (&state.body, &state.bodies);
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
        if let Some(gains) = &mut state.gains {
            put_in = gains.put_in.most();
            for (link_work, link) in gains.link_work.iter_mut().zip(&mut gains.links) {
                let found = link.check(link_work, body, (around, put_in), n);
                if let Some(gain) = found.filter(Gain::is_fault) {
                    let part = part(link_work.a, link_work.b);
                    faults.push((self.network.link_name(link_work.link), part, gain));
                }
            }
            if let Some(pairs) = &mut gains.pairs
                && let Some(gain) = pairs.check(body, (around, put_in), n).filter(Gain::is_fault)
            {
                let part = scheme.part[pairs.moving_mat(scheme)] as usize;
                faults.push((self.network.link_name(pairs.first_link()), part, gain));
            }
        }
        if let Some(fine) = &mut state.fine {
            let found = fine.check_gains((around, put_in), n);
            for (link, mat, gain) in found.filter(|(.., gain)| gain.is_fault()) {
                faults.push((self.network.link_name(link), scheme.part[mat] as usize, gain));
            }
        }
        for body in &mut self.state.bodies {
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
            if !self.state.mutes.is_mute(part) {
                self.mute(part, n);
            }
        }
        Ok(())
    }
}
