//! The account of one link: the work that it took in steps, and what it stores.

use crate::island::energy_account::{Account, Gain};
use crate::network::{AXES_MAX, SpaceLink};
use crate::scheme::{Kind, Run, Scheme, Spring};
use crate::state::Body;

/// The account of one link, added to at every step.
#[derive(Clone, Debug)]
pub(super) struct LinkWork {
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) link: usize,
    /// In the step before: the stretch [m a step], and the force [N].
    stretch: f64,
    force: f64,
    pub(super) account: Account,
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
        Self { link, stretch, force }
    }

    /// The work that the link took since the step before [J], if it pulls with `force` [N] now.
    fn step(&mut self, ends: (usize, usize), force: f64, body: &Body) -> f64 {
        let (_, direction) = self.link.length_and_direction(ends, |mat| body.x[mat]);
        let mut step_work = 0.0;
        for (axis, direction) in direction.into_iter().enumerate().take(self.link.n_axes) {
            let (first_mat, second_mat) = self.link.pair(ends, axis);
            let stretch = body.d[second_mat] - body.d[first_mat];
            step_work += 0.5 * (self.stretch[axis] + stretch) * self.force[axis];
            (self.stretch[axis], self.force[axis]) = (stretch, force * direction);
        }
        step_work
    }
}

/// A link whose account is checked.
#[derive(Clone, Debug)]
pub(super) struct CheckedLink {
    /// A run of only this link.
    pub(super) run: Run,
    /// Elongations [m] when the account began, and a step before; of bristles, their bend, twice.
    from: [f64; 2],
    /// Whether the account counts the energy that was stored when it began; that is computed only when needed.
    pub(super) is_whole: bool,
    pub(super) worst: Option<Gain>,
}

crate::archive::state!(CheckedLink { from, is_whole, worst });

impl CheckedLink {
    pub(super) fn new(run: Run) -> Self {
        Self {
            run,
            from: [0.0; 2],
            is_whole: false,
            worst: None,
        }
    }

    /// The energy created by frame `n`, if that is worth reporting; `moving_energy` is the energy of all masses,
    /// `hand_work` what hands put in.
    pub(super) fn check(
        &mut self,
        link_work: &mut LinkWork,
        body: &Body,
        (moving_energy, hand_work): (impl Fn() -> f64, f64),
        n: u64,
    ) -> Option<Gain> {
        if link_work.account.is_overdrawn() && !self.is_whole {
            let start_energy = link_work.start(self);
            link_work.account.add_start(start_energy);
            self.is_whole = true;
        }
        if !link_work.account.is_overdrawn() {
            return None;
        }
        let energy_now = moving_energy();
        link_work.account.take_from_masses(0.0, energy_now);
        let gain = link_work.gain(self, body, (energy_now, hand_work), n);
        if !gain.is_reportable() || gain.created <= rounding(&self.run, body) {
            return None;
        }
        self.worst = Some(gain.worse_of(self.worst));
        Some(gain)
    }
}

impl LinkWork {
    /// The account of a run of one link; `is_fused`: it is computed in one pass with others; `strength_varies`: its
    /// strength changes in time.
    pub(super) fn new(run: &Run, is_fused: bool, strength_varies: bool) -> Self {
        Self {
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
            spring: is_fused.then(|| run.spring()).flatten(),
            strength: strength_varies.then_some(0.0),
        }
    }

    /// The force in the step before [N].
    pub(super) fn force(&self) -> f64 {
        self.force
    }

    /// Begin anew.
    pub(super) fn begin(&mut self, link: &mut CheckedLink, scheme: &Scheme, gates: &[f64], body: &Body) {
        self.account = Account::default();
        self.stretch = body.d[self.b] - body.d[self.a];
        self.force = self.force_now(body);
        if self.strength.is_some() {
            self.strength = Some(strength(&link.run, scheme, gates));
        }
        if let Some(space_work) = &mut self.space {
            space_work.step((self.a, self.b), self.force, body);
        }
        (link.from, link.is_whole) = (elongations(&link.run, body), false);
    }

    /// Account for a step in which all forces are known and MATs have not moved yet.
    pub(super) fn step(&mut self, link: &CheckedLink, scheme: &Scheme, gates: &[f64], body: &Body) {
        let link_force = self.force_now(body);
        if let Some(strength_before) = self.strength {
            let strength_now = strength(&link.run, scheme, gates);
            if strength_now != strength_before {
                let stored = stored(&link.run, elongations(&link.run, body));
                self.account.take((strength_now - strength_before) * stored);
                self.strength = Some(strength_now);
            }
        }
        if link_force == 0.0 && self.force == 0.0 {
            return;
        }
        let link_ends = (self.a, self.b);
        let (step_work, kinetic) = if let Some(space_work) = &mut self.space {
            let step_work = space_work.step(link_ends, link_force, body);
            let axis_pairs = (0..space_work.link.n_axes).map(|axis| space_work.link.pair(link_ends, axis));
            (
                step_work,
                axis_pairs.map(|link_ends| kinetic(link_ends, scheme, body)).sum(),
            )
        } else {
            let stretch = body.d[self.b] - body.d[self.a];
            let step_work = 0.5 * (self.stretch + stretch) * self.force;
            self.stretch = stretch;
            (step_work, kinetic(link_ends, scheme, body))
        };
        self.account.take_from_masses(step_work, kinetic);
        self.force = link_force;
    }

    /// The energy created so far, by frame `n`; `moving_energy` is the energy of all masses, `hand_work` what hands put
    /// in.
    pub(super) fn gain(&self, link: &CheckedLink, body: &Body, (moving_energy, hand_work): (f64, f64), n: u64) -> Gain {
        let mut account = self.account;
        if !link.is_whole {
            account.add_start(self.start(link));
        }
        let stored_energy = self.stored(&link.run, body);
        account
            .gain(stored_energy, moving_energy, n)
            .with_reference_min(hand_work)
    }

    /// The energy that its link stored when the account began [J].
    fn start(&self, link: &CheckedLink) -> f64 {
        self.strength.unwrap_or(1.0) * stored(&link.run, link.from)
    }

    /// The energy that its link stored between the two frames up to which the account goes: MATs have moved on since
    /// [J].
    fn stored(&self, run: &Run, body: &Body) -> f64 {
        let [elongation_next, elongation_now] = elongations(run, body);
        let elongation_pair = if run.n_axes() > 1 || run.bristle().is_some() {
            [elongation_next, elongation_now]
        } else {
            [elongation_now, elongation_now - self.stretch]
        };
        self.strength.unwrap_or(1.0) * stored(run, elongation_pair)
    }

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

/// The strength of a link in this step, as a factor of what it is as written.
fn strength(run: &Run, scheme: &Scheme, gates: &[f64]) -> f64 {
    let gate_opening = run.gate.map_or(1.0, |gate| gates[gate]);
    let mut scheme_runs = scheme.runs.iter().chain(&scheme.exact);
    let run_now = scheme_runs.find(|scheme_run| scheme_run.links().contains(&run.first));
    let stiffness_ratio = run_now.map_or(1.0, |run_now| run_now.k / run.k);
    if stiffness_ratio.is_finite() {
        gate_opening * stiffness_ratio
    } else {
        gate_opening
    }
}

/// Elongations of a link now and a step before [m]; of bristles, their bend.
fn elongations(run: &Run, body: &Body) -> [f64; 2] {
    if run.bristle().is_some() {
        return [body.memory[run.first]; 2];
    }
    let elongation_now = run.elongation(0, |mat| body.x[mat]);
    if run.n_axes() > 1 {
        let yielded = if run.yields() { body.memory[run.first] } else { 0.0 };
        let elongation_before = run.elongation(0, |mat| body.x[mat] - body.d[mat]);
        return [elongation_now - yielded, elongation_before - yielded];
    }
    [elongation_now, elongation_now - (body.d[run.b] - body.d[run.a])]
}

/// Energy of a link in space that rounding alone explains [J]: its elongation is a difference of coordinates.
fn rounding(run: &Run, body: &Body) -> f64 {
    /// Error of the elongation in units of the last digit: rounding adds up from step to step.
    const ELONGATION_ERROR_ULP: f64 = 1e4;
    if run.n_axes() == 1 {
        return 0.0; // a contact that is open has no force at all
    }
    let end_positions = run.pairs(0).flat_map(|(a, b)| [body.x[a], body.x[b]]);
    let elongation_error = ELONGATION_ERROR_ULP * f64::EPSILON * end_positions.map(f64::abs).fold(0.0, f64::max);
    run.k * elongation_error * elongation_error
}

/// Energy of a link between two steps [J].
fn stored(run: &Run, [elongation_now, elongation_before]: [f64; 2]) -> f64 {
    match run.bristle() {
        Some((bristle, _)) => bristle.energy(elongation_now),
        None => 0.5 * (run.potential(elongation_now) + run.potential(elongation_before)),
    }
}

/// Kinetic energy of the two ends of a link along one axis [J], without ends that are imposed.
fn kinetic((a, b): (usize, usize), scheme: &Scheme, body: &Body) -> f64 {
    let kinetic_of = |mat: usize| {
        let (d, w) = (body.d[mat], scheme.w[mat]);
        if w > 0.0 { 0.5 * d * d / w } else { 0.0 }
    };
    kinetic_of(a) + kinetic_of(b)
}
