//! A mesh in the form that the methods step: the scaled coefficients of a scheme, with all springs in one list for a
//! single pass.

use std::ops::Range;

use super::method::MeshMethod;
use super::passes::{self, Ties};
use crate::kernel::KernelScratch;
use crate::kernel::mesh_partition::MeshPartition;
use crate::kernel::springs::ForcePart;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Contact, Error, LinkKind, MatKind, Network};
use crate::scheme::{ForceEnds, FusedSprings, LinkRun, LinkRunKind, Scheme, Spring};
use crate::units::Rate;

/// A network in numbers scaled by the step.
#[derive(Clone, Debug)]
pub(super) struct Mesh {
    pub(super) scheme: Scheme,
    /// M = m/T², the mass per step squared; 0 for fixed points   (n_mat)
    pub(super) scaled_masses: Vec<f64>,
    /// Springs, hardening or not, in order of declaration.
    pub(super) springs: FusedSprings,
    /// The first link of each run of springs.
    pub(super) first_links: Vec<usize>,
    /// Contacts and other laws, in order of declaration.
    pub(super) other_runs: Vec<LinkRun>,
    /// Whether any link loses energy.
    pub(super) is_damped: bool,
}

/// Work space for the computation of forces.
#[derive(Clone, Debug)]
pub(super) struct Scratch {
    /// Forces of one run   (longest run)
    link_forces: Vec<f64>,
    kernel_scratch: KernelScratch,
}

impl Scratch {
    /// Partition of the mesh for a thread team.
    pub(super) fn mesh_partition(&self) -> Option<&MeshPartition> {
        self.kernel_scratch.mesh_partition.as_ref()
    }
}

impl Mesh {
    /// Fails with the name of a module that the method cannot step.
    pub(super) fn new(network: &Network, rate: Rate, method: MeshMethod) -> Result<Self, Error> {
        refuse_stateful_links(network)?;
        let scheme = if method == MeshMethod::Ca {
            Scheme::new(network, rate)?
        } else {
            check_supported(network)?;
            Scheme::physical(network, rate)?
        };
        let inverse = |w: &f64| if *w > 0.0 { 1.0 / w } else { 0.0 };
        let mut new_mesh = Self {
            scaled_masses: scheme.w.iter().map(inverse).collect(),
            springs: FusedSprings::default(),
            first_links: Vec::new(),
            other_runs: Vec::new(),
            is_damped: false,
            scheme,
        };
        let mut springs = Vec::new();
        for run in &new_mesh.scheme.runs {
            let (k, q, z) = match &run.kind {
                LinkRunKind::Ref => (run.k, 0.0, run.z),
                LinkRunKind::Hardening(q) => (run.k, *q, run.z),
                LinkRunKind::Lnl {
                    law, velocity_factor, ..
                } if law.hardening_spring().is_some() => {
                    let hardening = law
                        .hardening_spring()
                        .map_or((0.0, 0.0, None), |hardening| (hardening.k, hardening.q, hardening.z));
                    (hardening.0, hardening.1, hardening.2.unwrap_or(0.0) * velocity_factor)
                }
                other => {
                    new_mesh.is_damped |= match other {
                        LinkRunKind::Lnl { law, .. } => law.is_damped(),
                        _ => run.z != 0.0,
                    };
                    new_mesh.other_runs.push(run.clone());
                    continue;
                }
            };
            new_mesh.is_damped |= z != 0.0;
            new_mesh.first_links.push(run.first_link);
            springs.push(Spring {
                a: run.a,
                b: run.b,
                len: run.len,
                k,
                q,
                z,
                rest: run.rest,
                force_ends: ForceEnds::Both(run.a, run.b),
            });
        }
        new_mesh.springs = FusedSprings::new(springs);
        Ok(new_mesh)
    }

    pub(super) fn n_mat(&self) -> usize {
        self.scaled_masses.len()
    }

    /// 1/M, κ, ζ and rest position of every MAT.
    pub(super) fn ties(&self) -> Ties<'_> {
        Ties {
            w: &self.scheme.w,
            kappa: &self.scheme.kappa,
            zeta: &self.scheme.zeta,
            rest: &self.scheme.rest,
        }
    }

    pub(super) fn new_scratch(&self) -> Scratch {
        let lengths = self.scheme.runs.iter().map(|run| run.len);
        let mut laws = KernelScratch::new(&self.scheme);
        laws.set_springs(&self.springs, self.n_mat());
        Scratch {
            link_forces: vec![0.0; lengths.max().unwrap_or(0)],
            kernel_scratch: laws,
        }
    }

    /// The velocity per step that an impulse [N·s] gives a MAT [m]: T·p/m.
    pub(super) fn velocity_step(&self, mat: usize, impulse: f64) -> f64 {
        self.scheme.w[mat] * (impulse * self.scheme.rate)
    }

    /// V0 per step [m]; 0 for MATs that do not move freely   (n_mat)
    pub(super) fn initial_velocities(&self, network: &Network) -> Vec<f64> {
        let network_mats = network.mats();
        (0..self.n_mat())
            .map(|i| match network_mats.kind[i] {
                MatKind::Mas | MatKind::Cel => network_mats.v0[i] / self.scheme.rate,
                MatKind::Sol | MatKind::Imposed | MatKind::Proxy => 0.0,
            })
            .collect()
    }

    /// Elastic forces of all links at positions `x` [N], including contacts.
    pub(super) fn set_elastic_forces(
        &self,
        x: &[f64],
        scratch: &mut Scratch,
        force: &mut [f64],
        team: &mut ThreadTeam<'_>,
    ) {
        scratch
            .kernel_scratch
            .spring_forces(ForcePart::Elastic, &self.springs, [x, x], force, team);
        self.add_other_forces(ForcePart::Elastic, [x, x], scratch, force);
    }

    /// Damping forces of all links at positions `x` and velocities `v` [N].
    pub(super) fn set_viscous_forces(
        &self,
        [x, v]: [&[f64]; 2],
        scratch: &mut Scratch,
        force: &mut [f64],
        team: &mut ThreadTeam<'_>,
    ) {
        if !self.is_damped {
            force.fill(0.0);
            return;
        }
        scratch
            .kernel_scratch
            .spring_forces(ForcePart::Viscous, &self.springs, [x, v], force, team);
        self.add_other_forces(ForcePart::Viscous, [x, v], scratch, force);
    }

    /// All forces of all links at positions `x` and velocities `v` [N].
    pub(super) fn set_total_forces(
        &self,
        [x, v]: [&[f64]; 2],
        scratch: &mut Scratch,
        force: &mut [f64],
        team: &mut ThreadTeam<'_>,
    ) {
        let spring_part = if self.is_damped {
            ForcePart::Total
        } else {
            ForcePart::Elastic
        };
        scratch
            .kernel_scratch
            .spring_forces(spring_part, &self.springs, [x, v], force, team);
        self.add_other_forces(ForcePart::Total, [x, v], scratch, force);
    }

    /// Runs `work` over all MATs, by a thread team if the mesh is partitioned: each call gets a range of MATs, their
    /// ties and their slices of `arrays`.
    pub(super) fn for_each_range<const N: usize>(
        &self,
        scratch: &Scratch,
        team: &mut ThreadTeam<'_>,
        arrays: [&mut [f64]; N],
        work: impl Fn(Range<usize>, Ties<'_>, [&mut [f64]; N]) + Sync,
    ) {
        let mesh_ties = self.ties();
        match scratch.mesh_partition() {
            Some(mesh_partition) => mesh_partition.for_each_range(team, arrays, |mats, changed| {
                work(mats.clone(), mesh_ties.range(mats), changed);
            }),
            None => work(0..self.n_mat(), mesh_ties, arrays),
        }
    }

    /// Partition the mesh for a number of threads if this saves time.
    pub(super) fn partition(&self, scratch: &mut Scratch, threads: usize) {
        scratch.kernel_scratch.mesh_partition = MeshPartition::for_threads(&self.springs, self.n_mat(), threads);
    }

    fn add_other_forces(&self, part: ForcePart, [x, v]: [&[f64]; 2], scratch: &mut Scratch, force: &mut [f64]) {
        for run in &self.other_runs {
            let link_force = &mut scratch.link_forces[..run.len];
            match &run.kind {
                LinkRunKind::Lnl {
                    law,
                    velocity_factor,
                    slot: scratch_index,
                } => {
                    let law_buffers = &mut scratch.kernel_scratch;
                    let (e, de) = (
                        &mut law_buffers.elongations[..run.len],
                        &mut law_buffers.elongation_rates[..run.len],
                    );
                    for i in 0..run.len {
                        e[i] = x[run.b + i] - x[run.a + i] - run.rest;
                        de[i] = (v[run.b + i] - v[run.a + i]) * velocity_factor;
                    }
                    let law_scratch = &mut law_buffers.law_scratch[*scratch_index];
                    match part {
                        ForcePart::Elastic => law.spring_run(e, link_force, law_scratch),
                        ForcePart::Viscous => law.drag_run(e, de, link_force, law_scratch),
                        ForcePart::Total => {
                            law.eval_in(e, de, link_force, law_scratch, &mut law_buffers.native_scratch)
                        }
                    }
                }
                _ => {
                    for (i, link_force) in link_force.iter_mut().enumerate() {
                        let e = x[run.b + i] - x[run.a + i] - run.rest;
                        let de = v[run.b + i] - v[run.a + i];
                        *link_force = match part {
                            ForcePart::Elastic => run.force(e, 0.0),
                            ForcePart::Viscous => run.force(e, de) - run.force(e, 0.0),
                            ForcePart::Total => run.force(e, de),
                        };
                    }
                }
            }
            passes::add_to_ends(link_force, run.a, run.b, force);
        }
    }
}

fn only_ca_message(what: &str) -> String {
    format!("only the CA scheme can compute {what}; write `method: ca`, or leave `method` out")
}

/// Refuses links with a state of their own: a mesh stores only positions and velocities.
fn refuse_stateful_links(network: &Network) -> Result<(), Error> {
    let mut link_runs = network.runs().iter();
    match link_runs.find(|run| matches!(run.kind, LinkKind::Bristle(_) | LinkKind::Dry(_))) {
        Some(run) => Err(Error::Refused {
            module: network.link_name(run.first),
            message: only_ca_message("a BRISTLE or a DRY link"),
        }),
        None => Ok(()),
    }
}

/// Refuses what methods other than CA cannot step: they need parameters in continuous time, and forces that are
/// functions of the positions and velocities.
fn check_supported(network: &Network) -> Result<(), Error> {
    let discrete_part = network
        .parts()
        .iter()
        .find(|discrete_part| discrete_part.ca_rate.is_some());
    if let Some(discrete_part) = discrete_part {
        return Err(Error::Refused {
            module: discrete_part.name.clone(),
            message: only_ca_message("a part under `units: ca`, whose steps are its definition"),
        });
    }
    if let Some(first_proxy) = network.proxies().first() {
        return Err(Error::Refused {
            module: network.mat_name(first_proxy.mat),
            message: only_ca_message("a PROXY"),
        });
    }
    if let Some((followed_mat, _)) = network.follower_pairs().next() {
        return Err(Error::Refused {
            module: network.mat_name(followed_mat),
            message: "only the CA scheme can step what follows a MAT".to_owned(),
        });
    }
    for run in network.runs() {
        if matches!(run.kind, LinkKind::Space(_) | LinkKind::Pairwise(_)) {
            return Err(Error::Refused {
                module: network.link_name(run.first),
                message: only_ca_message("a link in space"),
            });
        }
        let LinkKind::But(but_link) = &run.kind else {
            continue;
        };
        if but_link.contact != Contact::Plain {
            return Err(Error::Refused {
                module: network.link_name(run.first),
                message: only_ca_message("an exact or a magic contact"),
            });
        }
    }
    Ok(())
}
