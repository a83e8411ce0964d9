//! Scratch memory for the loops that evaluate laws.

use super::mesh_partition::MeshPartition;
use super::pairwise::Neighbours;
use super::space::SpaceScratch;
use super::springs::{ForcePart, SpringPass};
use super::thread_team::ThreadTeam;
use crate::law::{Law, Scratch};
use crate::scheme::{FusedSprings, LinkRunKind, Scheme, Spring};

/// Scratch memory in which the laws of a scheme are evaluated.
#[derive(Clone, Debug)]
pub(crate) struct KernelScratch {
    /// Elongations and their rates of one run of links   (longest run)
    pub(crate) elongations: Vec<f64>,
    pub(crate) elongation_rates: Vec<f64>,
    /// The springs that are computed in one pass.
    spring_pass: SpringPass,
    /// The springs partitioned for a thread team; `None` for one thread.
    pub(crate) mesh_partition: Option<MeshPartition>,
    /// Scratch memory of each law, by its index           (n_laws)
    pub(crate) law_scratch: Vec<Scratch>,
    /// Laws with constants that follow MATs, with the current values of the constants; indexed by `slot`.
    pub(crate) following_laws: Vec<Law>,
    /// Scratch memory for links in space.
    pub(crate) space_scratch: SpaceScratch,
    /// Neighbour lists of runs of contacts between all pairs; indexed by `slot`.
    pub(crate) neighbours: Vec<Neighbours>,
    /// Scratch memory for compiled laws; shared by all   (largest)
    pub(crate) native_scratch: Vec<f64>,
}

impl KernelScratch {
    /// Set `force` to the sum of a part of the springs' forces on each MAT [N], by a thread team if they are
    /// partitioned; see [`SpringPass::forces`].
    pub(crate) fn spring_forces(
        &mut self,
        part: ForcePart,
        springs: &FusedSprings,
        motion: [&[f64]; 2],
        force: &mut [f64],
        team: &mut ThreadTeam<'_>,
    ) {
        match &mut self.mesh_partition {
            Some(mesh_partition) => mesh_partition.forces(team, part, motion, force),
            None => self.spring_pass.compute_forces(part, springs, motion, force),
        }
    }

    /// Compute other springs in one pass from now on, which pull on `mat_count` MATs.
    pub(crate) fn set_springs(&mut self, springs: &[Spring], mat_count: usize) {
        self.spring_pass = SpringPass::new(springs, mat_count);
        if let Some(mesh_partition) = &mut self.mesh_partition {
            mesh_partition.set_springs(springs);
        }
    }

    /// Scratch memory for the laws of a scheme.
    pub(crate) fn new(scheme: &Scheme) -> Self {
        let mut laws = Self {
            elongations: Vec::new(),
            elongation_rates: Vec::new(),
            spring_pass: SpringPass::new(&scheme.fused_springs, scheme.n_mat()),
            mesh_partition: None,
            law_scratch: Vec::new(),
            following_laws: following_laws(scheme),
            space_scratch: SpaceScratch::new(scheme),
            neighbours: neighbour_lists(scheme),
            native_scratch: Vec::new(),
        };
        let mut longest_runs: Vec<usize> = Vec::new();
        for run in &scheme.runs {
            if let LinkRunKind::Lnl { law, slot, .. } = &run.kind {
                // A law without runs in the scheme keeps its index and needs no memory.
                let n_laws = laws.law_scratch.len().max(slot + 1);
                laws.law_scratch.resize_with(n_laws, Scratch::default);
                longest_runs.resize(n_laws, 0);
                if longest_runs[*slot] == 0 {
                    laws.law_scratch[*slot] = law.scratch_alone();
                    laws.native_scratch
                        .resize(laws.native_scratch.len().max(law.room_len()), 0.0);
                }
                if longest_runs[*slot] <= 1 && run.len > 1 {
                    laws.law_scratch[*slot] = law.scratch();
                }
                longest_runs[*slot] = longest_runs[*slot].max(run.len);
                laws.elongations.resize(laws.elongations.len().max(run.len), 0.0);
            }
        }
        laws.elongation_rates.clone_from(&laws.elongations);
        laws
    }
}

/// Laws that follow MATs, one for every `slot` in the scheme.
pub(crate) fn following_laws(scheme: &Scheme) -> Vec<Law> {
    let scheme_runs = scheme.runs.iter();
    let mut followed_laws: Vec<Law> = Vec::new();
    for run in scheme_runs {
        if let LinkRunKind::Followed {
            law: followed_law,
            slot,
            ..
        } = &run.kind
        {
            // Entries below this index belong to runs that the scheme no longer has; they get any law.
            followed_laws.resize(followed_laws.len().max(slot + 1), followed_law.law().clone());
            followed_laws[*slot] = followed_law.law().clone();
        }
    }
    followed_laws
}

/// A neighbour list for every `slot` in the scheme; those of runs that the scheme no longer has stay empty.
fn neighbour_lists(scheme: &Scheme) -> Vec<Neighbours> {
    let mut lists = Vec::new();
    for run in &scheme.runs {
        if let (LinkRunKind::Pairwise { slot, .. }, Some(pair_run)) = (&run.kind, run.pairwise()) {
            let room_count = lists.len().max(slot + 1);
            lists.resize_with(room_count, Neighbours::default);
            lists[*slot] = Neighbours::new(&pair_run);
        }
    }
    lists
}
