//! State of an island's masses: positions, last steps, forces.

mod contact_history;

use crate::scheme::{Kind, Scheme};
pub(crate) use contact_history::ContactHistory;

/// Positions of the MATs and the forces on them.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    /// Position now [m]                                   (n_mat)
    pub(crate) x: Vec<f64>,
    /// The last step, x[n] − x[n−1] [m]                   (n_mat)
    pub(crate) d: Vec<f64>,
    /// Sum of forces now [N]                              (n_mat)
    pub(crate) force: Vec<f64>,
    /// Force of each LIA now [N]: it pulls a towards b    (n_lia)
    pub(crate) link: Vec<f64>,
    /// What each LIA remembers [m]: how far its bristles are bent, or by how much its rest length has yielded, endless
    /// where it is broken; empty: none remembers anything   (n_lia)
    pub(crate) memory: Vec<f64>,
    /// How touching points slid, of each run of contacts of all pairs, by its room.
    pub(crate) histories: Vec<ContactHistory>,
    /// Part of `force` by all pairs of points [N]   (n_mat; empty: there are none)
    pub(crate) pair_force: Vec<f64>,
    /// Where each proxy is before it moves [m]   (n_proxies)
    pub(crate) proxies: Vec<f64>,
    /// Motion of body ports without external force, beyond their last step [m]   (n_mat; empty: no ports)
    pub(crate) inner: Vec<f64>,
    /// Part of `force` by strikes, hands and weights [N]; empty without a ledger   (n_mat)
    pub(crate) outside: Vec<f64>,
    /// The state one frame before, where a frame may be computed again in finer steps.
    pub(crate) previous: Option<Box<PreviousState>>,
}

crate::archive::state!(Body {
    x,
    d,
    force,
    link,
    memory,
    histories,
    pair_force,
    inner,
    outside,
    previous
});

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

impl Body {
    /// A body at positions `x` with last steps `d` [m], (n_mat) each.
    pub(crate) fn new(scheme: &Scheme, x: Vec<f64>, d: Vec<f64>) -> Self {
        Self {
            force: vec![0.0; x.len()],
            link: vec![0.0; scheme.n_lia],
            memory: scheme.memory(),
            histories: histories(scheme),
            pair_force: vec![0.0; if scheme.has_pairwise() { x.len() } else { 0 }],
            proxies: vec![0.0; scheme.proxies.len()],
            inner: Vec::new(),
            outside: Vec::new(),
            previous: None,
            x,
            d,
        }
    }

    /// Add a force [N] on a MAT by a hand, a strike or a weight.
    pub(crate) fn push(&mut self, mat: usize, force: f64) {
        self.force[mat] += force;
        if let Some(outside) = self.outside.get_mut(mat) {
            *outside += force;
        }
    }

    /// Take over another body's motion without allocating.
    pub(crate) fn copy_motion(&mut self, other: &Self) {
        self.x.copy_from_slice(&other.x);
        self.d.copy_from_slice(&other.d);
        self.memory.copy_from_slice(&other.memory);
        for (own, other) in self.histories.iter_mut().zip(&other.histories) {
            own.copy_from(other);
        }
        self.inner.copy_from_slice(&other.inner);
    }
}

/// Room for what the pairs of points of each room remember: of those without friction for nothing.
fn histories(scheme: &Scheme) -> Vec<ContactHistory> {
    let mut histories = Vec::new();
    for run in &scheme.runs {
        if let Kind::Pairwise { by, room } = &run.kind {
            let n_rooms = histories.len().max(room + 1);
            histories.resize_with(n_rooms, ContactHistory::default);
            if by.friction > 0.0 {
                histories[*room] = ContactHistory::new(by.n_points(run.len));
            }
        }
    }
    histories
}

/// A MAT whose next position is imposed for this step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Target {
    pub(crate) mat: usize,
    /// Position at the next frame [m].
    pub(crate) x: f64,
    /// Position at this frame [m], kept by the MAT phase.
    pub(crate) previous: f64,
}

crate::archive::state!(Target { mat, x, previous });
