//! State of an island's masses: positions, last steps, forces.

mod contact_history;

use crate::maths::Mixing;
use crate::scheme::{LinkRunKind, Scheme};
pub(crate) use contact_history::ContactHistory;

/// The state of MATs and links, and their forces.
#[derive(Clone, Debug)]
pub(crate) struct ModuleState {
    /// Position now [m]                                   (n_mat)
    pub(crate) x: Vec<f64>,
    /// The last step, x[n] − x[n−1] [m]                   (n_mat)
    pub(crate) d: Vec<f64>,
    /// Sum of forces now [N]                              (n_mat)
    pub(crate) force: Vec<f64>,
    /// Force of each LIA now [N]: it pulls a towards b    (n_lia)
    pub(crate) link_forces: Vec<f64>,
    /// State of each LIA [m]: the bending of its bristles, or the yielded part of its rest length (infinite if it is
    /// broken); empty if no LIA has a state   (n_lia)
    pub(crate) link_memories: Vec<f64>,
    /// Friction states of touching points, for each pairwise run, indexed by `LinkRunKind::Pairwise::slot`.
    pub(crate) contact_histories: Vec<ContactHistory>,
    /// Part of `force` from contacts between all pairs [N]   (n_mat; empty if there are none)
    pub(crate) pair_forces: Vec<f64>,
    /// Position of each proxy before it moves [m]   (n_proxies)
    pub(crate) proxy_positions: Vec<f64>,
    /// Motion of body ports without external force, beyond their last step [m]   (n_mat; empty: no ports)
    pub(crate) free_port_motion: Vec<f64>,
    /// Part of `force` by strikes, hands and weights [N]; empty without a ledger   (n_mat)
    pub(crate) outside_forces: Vec<f64>,
    /// The state one frame before, if a frame may have to be computed again in finer steps.
    pub(crate) previous_state: Option<Box<PreviousState>>,
    /// Work of exact contacts and frictions, in all frames so far.
    pub(crate) exact_work: ExactWork,
    /// Room for rounds over exact contacts and frictions that share a MAT.
    pub(crate) round_mixing: Mixing,
}

crate::archive::state!(ModuleState {
    x,
    d,
    force,
    link_forces,
    link_memories,
    contact_histories,
    pair_forces,
    free_port_motion,
    outside_forces,
    previous_state
});

/// Counters of motion-dependent work in exact contacts and frictions.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ExactWork {
    /// Contacts and frictions that were solved in rounds after the first.
    pub(crate) n_resolved: u64,
    /// Evaluations of power laws.
    pub(crate) evaluations: u64,
}

/// Positions and last steps a frame ago [m]   (n_mat each).
#[derive(Clone, Debug)]
pub(crate) struct PreviousState {
    pub(crate) x: Vec<f64>,
    pub(crate) d: Vec<f64>,
}

crate::archive::option!(Box<PreviousState>, fixed);

crate::archive::state!(PreviousState { x, d });

impl PreviousState {
    pub(crate) fn new(n_mat: usize) -> Box<Self> {
        let (x, d) = (vec![0.0; n_mat], vec![0.0; n_mat]);
        Box::new(Self { x, d })
    }

    /// Swap the current and the previous state.
    pub(crate) fn swap(&mut self, x: &mut Vec<f64>, d: &mut Vec<f64>) {
        std::mem::swap(&mut self.x, x);
        std::mem::swap(&mut self.d, d);
    }
}

impl ModuleState {
    /// A body at positions `x` with last steps `d` [m], (n_mat) each.
    pub(crate) fn new(scheme: &Scheme, x: Vec<f64>, d: Vec<f64>) -> Self {
        Self {
            force: vec![0.0; x.len()],
            link_forces: vec![0.0; scheme.n_lia],
            link_memories: scheme.initial_memory(),
            contact_histories: histories(scheme),
            pair_forces: vec![0.0; if scheme.has_pairwise() { x.len() } else { 0 }],
            proxy_positions: vec![0.0; scheme.proxies.len()],
            free_port_motion: Vec::new(),
            outside_forces: Vec::new(),
            previous_state: None,
            exact_work: ExactWork::default(),
            round_mixing: Mixing::new(if scheme.has_coupled_exact_runs {
                scheme.exact_runs.len()
            } else {
                0
            }),
            x,
            d,
        }
    }

    /// Add a force [N] of a hand, a strike or a weight to a MAT.
    pub(crate) fn push(&mut self, mat: usize, force: f64) {
        self.force[mat] += force;
        if let Some(outside) = self.outside_forces.get_mut(mat) {
            *outside += force;
        }
    }

    /// Copy another body's motion without allocating.
    pub(crate) fn copy_motion(&mut self, other: &Self) {
        self.x.copy_from_slice(&other.x);
        self.d.copy_from_slice(&other.d);
        self.link_memories.copy_from_slice(&other.link_memories);
        for (history, other) in self.contact_histories.iter_mut().zip(&other.contact_histories) {
            history.copy_from(other);
        }
        self.free_port_motion.copy_from_slice(&other.free_port_motion);
    }
}

/// Contact histories by `slot`; those without friction stay empty.
fn histories(scheme: &Scheme) -> Vec<ContactHistory> {
    let mut histories = Vec::new();
    for run in &scheme.runs {
        if let LinkRunKind::Pairwise { pairs, slot } = &run.kind {
            let room_count = histories.len().max(slot + 1);
            histories.resize_with(room_count, ContactHistory::default);
            if pairs.friction > 0.0 {
                histories[*slot] = ContactHistory::new(pairs.n_points(run.len));
            }
        }
    }
    histories
}

/// A MAT whose next position is imposed for this step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ImposedTarget {
    pub(crate) mat: usize,
    /// Position at the next frame [m].
    pub(crate) x: f64,
    /// Position at this frame [m], set by `kernel::advance`.
    pub(crate) previous: f64,
}

crate::archive::state!(ImposedTarget { mat, x, previous });
