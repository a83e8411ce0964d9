//! The ledger: energy at the start + injected = stored + lost − produced, to rounding.
//!
//! Linear: H = ½δᵀ(M − Z/2)δ + ½x⁺ᵀKx closes exactly. Non-linear links store ½(V(e⁺) + V(e)); the difference to the
//! work of the scheme is the production P, the quality figure of an explicit contact.

use crate::island::followed_energy::{self, FrameEnergies, followed_law_and_rate};
use crate::island::pair_energy;
use crate::kernel::{self, Neighbours};
use crate::law::Law;
use crate::scheme::{LinkRun, LinkRunKind, Scheme, tension_energy};
use crate::state::{ImposedTarget, ModuleState};
use crate::timeline::Gate;

/// The ledger so far [J].
#[derive(Clone, Copy, Debug)]
pub struct Energy {
    /// At frame 0.
    pub start: f64,
    /// Now, in masses and links.
    pub stored: f64,
    /// Work of hands, strikes, weights and imposed points.
    pub injected: f64,
    /// Taken by damping (negative where a bow gives).
    pub lost: f64,
    /// Created by the scheme itself at non-linear links, signed.
    pub produced: f64,
    /// start + injected − lost + produced − stored: rounding alone.
    pub residual: f64,
    /// Σ|injected| + Σ|lost| + Σ|produced| + start: the scale on which the residual is judged.
    pub flow: f64,
}

impl std::ops::Add for Energy {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            start: self.start + other.start,
            stored: self.stored + other.stored,
            injected: self.injected + other.injected,
            lost: self.lost + other.lost,
            produced: self.produced + other.produced,
            residual: self.residual + other.residual,
            flow: self.flow + other.flow,
        }
    }
}

/// A sum that keeps what rounding drops (Neumaier 1974).
#[derive(Clone, Copy, Debug, Default)]
struct CompensatedSum {
    rounded_sum: f64,
    rounding_error: f64,
    absolute_sum: f64,
}

impl CompensatedSum {
    fn add(&mut self, value: f64) {
        let rounded_sum = self.rounded_sum + value;
        self.rounding_error += if self.rounded_sum.abs() >= value.abs() {
            (self.rounded_sum - rounded_sum) + value
        } else {
            (value - rounded_sum) + self.rounded_sum
        };
        self.rounded_sum = rounded_sum;
        self.absolute_sum += value.abs();
    }

    fn value(&self) -> f64 {
        self.rounded_sum + self.rounding_error
    }
}

crate::archive::state!(CompensatedSum {
    rounded_sum,
    rounding_error,
    absolute_sum
});

#[derive(Clone, Debug)]
pub(super) struct Ledger {
    start: f64,
    injected: CompensatedSum,
    lost: CompensatedSum,
    produced: CompensatedSum,
    /// The step before this one [m]                                (n_mat)
    previous_steps: Vec<f64>,
    /// Forces that hold imposed MATs on their way [N], by target
    holding_forces: Vec<f64>,
    /// ½(V(e⁺) + V(e)) of links that are not plain springs [J]     (n_lia)
    link_energies: Vec<f64>,
    /// Buffers of contacts of all pairs, in the order of their runs
    neighbour_buffers: Vec<Neighbours>,
    /// Buffers of laws that follow MATs, in the order of their runs
    followed_law_buffers: Vec<Law>,
    /// 1/M of masses that follow MATs, in the frame before   (n_following_masses)
    previous_inverse_masses: Vec<f64>,
}

crate::archive::option!(Ledger, fixed);

crate::archive::state!(Ledger {
    start,
    injected,
    lost,
    produced,
    previous_steps,
    holding_forces,
    link_energies,
    previous_inverse_masses
});

/// Elongation of the i-th link of a run: now, and one step ago.
fn elongations(run: &LinkRun, modules: &ModuleState, i: usize) -> (f64, f64) {
    let elongation_now = run.elongation(i, |mat| modules.x[mat]);
    if run.n_axes() > 1 {
        let permanent_stretch = permanent_stretch(run, modules, i);
        let elongation_before = run.elongation(i, |mat| modules.x[mat] - modules.d[mat]);
        return (
            elongation_now - permanent_stretch,
            elongation_before - permanent_stretch,
        );
    }
    (
        elongation_now,
        elongation_now - (modules.d[run.b + i] - modules.d[run.a + i]),
    )
}

/// How much the rest length of the i-th link of a run has grown.
fn permanent_stretch(run: &LinkRun, modules: &ModuleState, i: usize) -> f64 {
    let memory = run
        .has_permanent_stretch()
        .then(|| modules.link_memories[run.first_link + i]);
    memory.unwrap_or(0.0)
}

/// The stiffness that the links of a run share: now, and one step ago.
fn shared_stiffnesses(run: &LinkRun, modules: &ModuleState) -> [f64; 2] {
    [
        run.shared_stiffness(|i| elongations(run, modules, i).0),
        run.shared_stiffness(|i| elongations(run, modules, i).1),
    ]
}

/// Energy of one link [J].
fn link_energy(run: &LinkRun, shared_stiffness: f64, e: f64) -> f64 {
    run.potential_energy(e) + tension_energy(shared_stiffness, e)
}

fn is_spring(run: &LinkRun) -> bool {
    matches!(run.kind, LinkRunKind::Ref) && run.gate.is_none()
}

impl Ledger {
    pub(super) fn new(scheme: &Scheme, gates: &[Gate], modules: &mut ModuleState) -> Self {
        modules.outside_forces = vec![0.0; scheme.n_mat()];
        let mut ledger = Self {
            start: 0.0,
            injected: CompensatedSum::default(),
            lost: CompensatedSum::default(),
            produced: CompensatedSum::default(),
            previous_steps: modules.d.clone(),
            holding_forces: Vec::new(),
            link_energies: vec![0.0; scheme.n_lia],
            neighbour_buffers: scheme
                .link_runs()
                .filter_map(LinkRun::pairwise)
                .map(|pair_run| Neighbours::new(&pair_run))
                .collect(),
            followed_law_buffers: followed_energy::followed_law_buffers(scheme),
            previous_inverse_masses: inverse_masses(scheme).collect(),
        };
        let gate_opening = |run: &LinkRun| run.gate.map_or(1.0, |gate| gates[gate].opening(0));
        let mut neighbour_buffers = ledger.neighbour_buffers.iter_mut();
        let mut followed_law_buffers = ledger.followed_law_buffers.iter_mut();
        for run in scheme.link_runs().filter(|run| !is_spring(run)) {
            if let Some((followed_law, rate)) = followed_law_and_rate(run) {
                let Some(law_buffer) = followed_law_buffers.next() else {
                    continue;
                };
                followed_law.update_law(law_buffer, |mat| modules.x[mat]);
                for i in 0..run.len {
                    let (elongation_now, elongation_before) = elongations(run, modules, i);
                    let frame_energies = FrameEnergies::new(
                        law_buffer,
                        rate,
                        [elongation_before, elongation_now, elongation_now],
                        0.0,
                    );
                    ledger.link_energies[run.first_link + i] = frame_energies.last_energy;
                }
                continue;
            }
            if let Some(pair_run) = run.pairwise() {
                if let Some(pair_buffer) = neighbour_buffers.next() {
                    let [energy_now, energy_before] = pair_energy::potentials(&pair_run, run.k, pair_buffer, modules);
                    ledger.link_energies[run.first_link] = 0.5 * gate_opening(run) * (energy_now + energy_before);
                }
                continue;
            }
            let tensions = shared_stiffnesses(run, modules);
            for i in 0..run.len {
                let (elongation_now, elongation_before) = elongations(run, modules, i);
                ledger.link_energies[run.first_link + i] = 0.5
                    * gate_opening(run)
                    * (link_energy(run, tensions[0], elongation_now)
                        + link_energy(run, tensions[1], elongation_before));
            }
        }
        ledger.start = ledger.stored_energy(scheme, modules);
        ledger
    }

    /// Reserve room for this many imposed MATs, so that steps do not allocate.
    pub(super) fn reserve(&mut self, n_targets: usize) {
        self.holding_forces.reserve(n_targets);
    }

    /// Before the MAT phase: forces are complete, positions are those of frame n.
    pub(super) fn begin_frame(&mut self, scheme: &Scheme, targets: &[ImposedTarget], modules: &ModuleState) {
        self.previous_steps.copy_from_slice(&modules.d);
        let inverse_masses = scheme.following_masses.iter().zip(inverse_masses(scheme));
        for ((mass, inverse_mass), previous_inverse_mass) in inverse_masses.zip(&mut self.previous_inverse_masses) {
            let last_step = modules.d[mass.mat];
            if inverse_mass != 0.0 && *previous_inverse_mass != 0.0 {
                self.injected
                    .add(0.5 * last_step * last_step * (1.0 / inverse_mass - 1.0 / *previous_inverse_mass));
            }
            *previous_inverse_mass = inverse_mass;
        }
        self.holding_forces.clear();
        self.holding_forces
            .extend(targets.iter().map(|target| match scheme.w[target.mat] {
                0.0 => -modules.force[target.mat],
                _ => kernel::force_to_reach(scheme, modules, target.mat, target.x),
            }));
    }

    /// After the MAT phase: positions are those of frame n + 1, forces still those of frame n. For a frame that was
    /// computed finer, `finer_travel` gives the distance over which outside forces acted; what else does not balance
    /// counts as produced.
    pub(super) fn end_frame(
        &mut self,
        scheme: &Scheme,
        gates: [&[f64]; 2],
        targets: &[ImposedTarget],
        modules: &ModuleState,
        finer_travel: Option<&[f64]>,
    ) {
        // s = x[n+1] − x[n−1]
        let d = std::mem::take(&mut self.previous_steps);
        let s = |i: usize| modules.d[i] + d[i];
        for i in 0..scheme.n_mat() {
            if scheme.zeta[i] != 0.0 {
                self.lost.add(0.25 * scheme.zeta[i] / scheme.w[i] * s(i) * s(i));
            }
            if modules.outside_forces[i] != 0.0 {
                let travel = finer_travel.map_or_else(|| 0.5 * s(i), |travel| travel[i]);
                self.injected.add(travel * modules.outside_forces[i]);
            }
        }
        for (target, holding_force) in targets.iter().zip(&self.holding_forces) {
            self.injected.add(0.5 * s(target.mat) * holding_force);
        }
        // A proxy that moves along its masses does work against the force on it.
        let moving_proxies = scheme.proxies.iter().filter(|proxy| proxy.is_moving());
        for proxy in moving_proxies.filter(|_| finer_travel.is_none()) {
            let proxy_travel = s(proxy.mat) - proxy.weighted_sum(|mat| modules.x[mat] - modules.d[mat], s);
            self.injected.add(-0.5 * proxy_travel * modules.force[proxy.mat]);
        }
        let mut neighbour_buffers = self.neighbour_buffers.iter_mut();
        let mut followed_law_buffers = self.followed_law_buffers.iter_mut();
        for run in scheme.link_runs() {
            let [opening_now, opening_next] = gates.map(|gates| run.gate.map_or(1.0, |gate| gates[gate]));
            let [tension_next, tension_now] = shared_stiffnesses(run, modules);
            if let Some((bristle_law, _)) = run.bristle() {
                // Work on the bristles that is not stored is lost: their bend between frames is exact.
                for (i, link) in run.links().enumerate() {
                    let stored_energy = opening_next * bristle_law.energy(modules.link_memories[link]);
                    let energy_rise = stored_energy - self.link_energies[link];
                    self.link_energies[link] = stored_energy;
                    let stretch = s(run.b + i) - s(run.a + i);
                    self.lost.add(0.5 * stretch * modules.link_forces[link] - energy_rise);
                }
                continue;
            }
            if let Some(pair_run) = run.pairwise() {
                let Some(pair_buffer) = neighbour_buffers.next() else {
                    continue;
                };
                let [potential_next, potential_now] = pair_energy::potentials(&pair_run, run.k, pair_buffer, modules);
                let stored_energy = 0.5 * (opening_next * potential_next + opening_now * potential_now);
                let energy_rise = stored_energy - self.link_energies[run.first_link];
                self.link_energies[run.first_link] = stored_energy;
                let k_and_z = [opening_now * run.k, opening_now * run.z];
                let steps_before = if finer_travel.is_some() { &modules.d } else { &d };
                let frame_steps: [&[f64]; 2] = [steps_before, &modules.d];
                let history = &modules.contact_histories[run.slot()];
                let pair_work = pair_energy::work(&pair_run, k_and_z, pair_buffer, modules, frame_steps, history);
                self.lost.add(pair_work.total - pair_work.elastic);
                if finer_travel.is_none() {
                    self.produced.add(energy_rise - pair_work.elastic);
                }
                continue;
            }
            // Positions at which the frame's forces acted.
            let position_at_force = |mat: usize| modules.x[mat] - modules.d[mat];
            if let Some((followed_law, rate)) = followed_law_and_rate(run) {
                let Some(law_buffer) = followed_law_buffers.next() else {
                    continue;
                };
                followed_law.update_law(law_buffer, position_at_force);
                for (i, link) in run.links().enumerate() {
                    let (e_next, e) = elongations(run, modules, i);
                    let e_before = run.elongation(i, |mat| position_at_force(mat) - d[mat]);
                    let frame_stretch = run.stretch(i, position_at_force, |mat| modules.d[mat]);
                    let frame_energies = FrameEnergies::new(law_buffer, rate, [e_before, e, e_next], frame_stretch);
                    let energy_before = std::mem::replace(&mut self.link_energies[link], frame_energies.next_energy);
                    self.injected.add(frame_energies.last_energy - energy_before); // the law has changed
                    if finer_travel.is_some() {
                        self.lost.add(frame_energies.damping_force * frame_stretch);
                        continue;
                    }
                    let stretch = 0.5 * run.stretch(i, position_at_force, s);
                    let elastic_work = stretch * frame_energies.elastic_force;
                    self.lost.add(stretch * modules.link_forces[link] - elastic_work);
                    self.produced
                        .add(frame_energies.next_energy - frame_energies.last_energy - elastic_work);
                }
                continue;
            }
            for (i, link) in run.links().enumerate() {
                let stretch = run.stretch(i, position_at_force, s);
                if is_spring(run) {
                    if run.z != 0.0 {
                        self.lost.add(0.25 * run.z * stretch * stretch);
                    }
                    continue;
                }
                let (e_next, e) = elongations(run, modules, i);
                let energy_next = opening_next * link_energy(run, tension_next, e_next);
                let stored_energy = 0.5 * (energy_next + opening_now * link_energy(run, tension_now, e));
                if permanent_stretch(run, modules, i).is_infinite() {
                    self.lost.add(self.link_energies[link]);
                    self.link_energies[link] = 0.0;
                    continue;
                }
                if run.has_permanent_stretch() {
                    // Energy that was stored before the link yielded in this frame, and no longer is, counts as lost.
                    let position_before = |mat: usize| modules.x[mat] - modules.d[mat] - d[mat];
                    let e_before = run.elongation(i, position_before) - permanent_stretch(run, modules, i);
                    let [potential_now, potential_before] = [e, e_before].map(|e| run.potential_energy(e));
                    let energy_left = 0.5 * opening_now * (potential_now + potential_before);
                    self.lost.add(self.link_energies[link] - energy_left);
                    self.link_energies[link] = energy_left;
                }
                let energy_rise = stored_energy - self.link_energies[link];
                self.link_energies[link] = stored_energy;
                if finer_travel.is_some() {
                    let frame_stretch = run.stretch(i, position_at_force, |mat| modules.d[mat]);
                    let damping_force = opening_now * run.damping_force(e, frame_stretch);
                    self.lost.add(damping_force * frame_stretch);
                    continue;
                }
                let link_work = 0.5 * stretch * modules.link_forces[link];
                if is_exact(run) && run.z != 0.0 {
                    self.lost.add(link_work - energy_rise);
                } else {
                    let elastic_work = if is_exact(run) {
                        link_work
                    } else {
                        0.5 * stretch * opening_now * (run.elastic_force(e) + tension_now * e)
                    };
                    self.lost.add(link_work - elastic_work);
                    self.produced.add(energy_rise - elastic_work);
                }
            }
        }
        self.previous_steps = d;
        if finer_travel.is_some() {
            self.produced.add(-self.energy(scheme, modules).residual);
        }
    }

    /// Energy in masses and links between the last frame and this one [J].
    fn stored_energy(&self, scheme: &Scheme, modules: &ModuleState) -> f64 {
        let mut energy_sum = CompensatedSum::default();
        for i in (0..scheme.n_mat()).filter(|&i| scheme.w[i] != 0.0) {
            let (x, d, rest_position) = (modules.x[i], modules.d[i], scheme.rest[i]);
            if let Some(mat_weight) = scheme.weight.get(i) {
                // With the same work a step as other forces: 0.5·(x[n+1] − x[n−1])·F.
                energy_sum.add(-mat_weight * (x - 0.5 * d));
            }
            let mat_energy = 0.5 * d * d + 0.5 * scheme.kappa[i] * (x - rest_position) * (x - d - rest_position)
                - 0.25 * scheme.zeta[i] * d * d;
            energy_sum.add(mat_energy / scheme.w[i]);
        }
        for run in scheme.link_runs() {
            for i in 0..run.len {
                energy_sum.add(if is_spring(run) {
                    let (elongation_now, elongation_before) = elongations(run, modules, i);
                    0.5 * run.k * elongation_now * elongation_before
                        - 0.25 * run.z * (elongation_now - elongation_before) * (elongation_now - elongation_before)
                } else {
                    self.link_energies[run.first_link + i]
                });
            }
        }
        energy_sum.value()
    }

    pub(super) fn energy(&self, scheme: &Scheme, modules: &ModuleState) -> Energy {
        let (start, stored) = (self.start, self.stored_energy(scheme, modules));
        let (injected, lost, produced) = (self.injected.value(), self.lost.value(), self.produced.value());
        Energy {
            start,
            stored,
            injected,
            lost,
            produced,
            residual: start + injected - lost + produced - stored,
            flow: start + self.injected.absolute_sum + self.lost.absolute_sum + self.produced.absolute_sum,
        }
    }
}

/// 1/M of each mass that follows a MAT.
fn inverse_masses(scheme: &Scheme) -> impl Iterator<Item = f64> + '_ {
    let following_masses = scheme.following_masses.iter();
    following_masses.map(|mass| scheme.w[mass.mat])
}

fn is_exact(run: &LinkRun) -> bool {
    matches!(&run.kind, LinkRunKind::But(but) if but.contact == crate::network::Contact::Exact)
}
