//! The guard of links that stiffen: frames in which they would make a scheme diverge are computed finer.
//!
//! A certificate knows every law by its slope at rest. Beyond it λmax(M⁻¹(K + 2Z)) is at most that at rest plus the
//! edge sums of what the links have stiffened by. Where that leaves too little of the limit at the end of a frame, the
//! frame is gone through again in 2, 4 or 8 steps of CA.

mod cells;
mod finer;
mod scene;
mod watch;

pub(crate) use finer::{Motion, Stage};
pub(crate) use scene::Scene;

use std::ops::Range;
use std::sync::Arc;

use crate::network::forest::{Forest, ends};
use crate::network::{Error, Network};
use crate::scheme::{Scheme, top};
use crate::state::PreviousState;
use cells::Cells;
use watch::{Watch, allow, nearest, watches};

/// λ up to which steps of CA are trusted, of the 4 that they bear. Near 4 they swing too wide, and what follows takes
/// that for energy: at 0.9 of it a gong struck at the border of what it bears makes a quarter of what is put in, at
/// 0.5 nothing (`tests/scenes/stiff.rs`).
const CA: f64 = 2.0;
/// Steps a frame at most.
const MOST: u32 = 8;
/// Of what links may stiffen by, so much ends the finer frames: changing to and fro costs energy.
const CALM: f64 = 0.5;
/// Frames for which less must have been enough: what swings is calm where it passes through its middle.
const HOLD: u32 = 64;

/// Stability limit of a stepping method.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// The guarded quantity is λmax(M⁻¹(K + c·Z)).
    pub(crate) c: f64,
    /// Largest λ up to which the method's energy is trusted.
    pub(crate) trusted: f64,
    /// Largest λ at rest that the certificate accepts.
    pub(crate) most: f64,
    /// Whether the springs to the ground are exact poles of cells at this rate.
    pub(crate) has_poles: bool,
}

impl Limit {
    /// The scheme of CORDIS-ANIMA.
    pub(crate) const CA: Self = Self {
        c: 2.0,
        trusted: CA,
        most: 4.0,
        has_poles: true,
    };
}

/// How many frames were computed with smaller steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FinerFrames {
    pub(crate) frames: u64,
    /// Steps in the finest.
    pub(crate) most: u32,
    /// A MAT where the links had stiffened most when it began.
    pub(crate) mat: usize,
}

impl FinerFrames {
    /// The same where a frame has so many steps, each of which may have been computed finer.
    pub(crate) fn by(self, steps: u32) -> Self {
        Self {
            frames: self.frames.div_ceil(u64::from(steps)),
            ..self
        }
    }
}

/// Watches over the links of a network that stiffen.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    watches: Vec<Watch>,
    /// The MATs that they join, and all between.
    mats: Range<usize>,
    /// MATs that others move.
    pub(crate) ports: Vec<usize>,
    /// MATs that nothing joins with any of them.
    apart: Vec<usize>,
    cells: Option<Arc<Cells>>,
    /// λ at rest, and the largest that a whole frame is trusted with.
    rest: f64,
    limit: f64,
    /// No elongation has to be looked at until they have changed by so much [m].
    margin: f64,
    /// Steps in this frame, and in the one before; 1: it was a frame as all.
    now: u32,
    before: u32,
    /// For how many frames less would have done.
    calm: u32,
    finer_frames: FinerFrames,
    /// By how much the last step of a finer frame was ahead of the frame's mean [m a frame]   (n_mat)
    lead: Vec<f64>,
    /// Where a frame began, and what acts in it from outside [N]   (n_mat each)
    x: Vec<f64>,
    d: Vec<f64>,
    outside: Vec<f64>,
    /// How far that goes with its MAT in a finer frame [m]            (n_mat)
    way: Vec<f64>,
    /// What the links alone would give in it [m a frame]           (n_mat)
    own: Vec<f64>,
    /// By how much links have stiffened: at each MAT [N/m] (n_mat), of one run (longest run)
    sums: Vec<f64>,
    rises: Vec<f64>,
    /// κ and ζ of cells in this frame's steps                       (n_mat each; empty: no cells)
    ties: [Vec<f64>; 2],
    /// MAT, and where it is led from and to in the frame [m].
    led: Vec<(usize, f64, f64)>,
}

impl Guard {
    /// Of a network as a way steps it; `ports` are moved by others. `None` where nothing stiffens.
    pub(crate) fn new(
        scheme: &Scheme,
        network: &Network,
        limit: Limit,
        ports: &[usize],
    ) -> Result<Option<Self>, Error> {
        let moves = |mat: usize| scheme.w[mat] > 0.0 && !ports.contains(&mat);
        let mut watches = watches(&scheme.runs, moves);
        if watches.is_empty() {
            return Ok(None);
        }
        let enough = 0.5 * limit.trusted;
        let rest = top(scheme, network, limit.c, enough)?.lambda;
        if rest >= limit.most {
            return Ok(None); // it diverges by itself
        }
        // What is near its limit by itself has a quarter of what is left.
        let has_poles = limit.has_poles;
        let limit = f64::max(limit.trusted, rest + 0.25 * (limit.most - rest));
        allow(&mut watches, limit - rest, &scheme.w);
        if watches.is_empty() {
            return Ok(None);
        }
        let ends = || watches.iter().flat_map(|watch| [watch.a, watch.b]);
        let longest = watches.iter().map(|watch| watch.len).max().unwrap_or(0);
        let last = watches.iter().map(|watch| watch.a.max(watch.b) + watch.len);
        let zeros = || vec![0.0; scheme.n_mat()];
        let cells = Cells::new(scheme, network, has_poles)?.map(Arc::new);
        let ties = || cells.as_ref().map_or_else(Vec::new, |_| zeros());
        Ok(Some(Self {
            ties: [ties(), ties()],
            mats: ends().min().unwrap_or(0)..last.max().unwrap_or(0),
            ports: ports.to_vec(),
            apart: apart(network, scheme, &watches),
            cells,
            rest,
            limit,
            margin: f64::NEG_INFINITY,
            now: 1,
            before: 1,
            calm: 0,
            finer_frames: FinerFrames::default(),
            lead: zeros(),
            x: zeros(),
            d: zeros(),
            outside: zeros(),
            way: zeros(),
            own: zeros(),
            sums: zeros(),
            rises: vec![0.0; longest],
            led: Vec::new(),
            watches,
        }))
    }

    /// Room for so many MATs that are led in a frame, beside the ports.
    pub(crate) fn reserve(&mut self, n_led: usize) {
        let most = n_led + self.ports.len();
        self.led.reserve(most.saturating_sub(self.led.len()));
    }

    /// Frames that were computed finer so far, if any.
    pub(crate) fn finer_frames(&self) -> Option<FinerFrames> {
        (self.finer_frames.frames > 0).then_some(self.finer_frames)
    }

    /// MATs that have nothing to do with links that stiffen go on as they did in the whole frame.
    pub(crate) fn keep(&mut self, whole: &PreviousState, x: &mut [f64], d: &mut [f64]) {
        for &mat in &self.apart {
            (x[mat], d[mat]) = (whole.x[mat], whole.d[mat]);
            self.way[mat] = 0.5 * (self.d[mat] + whole.d[mat]);
        }
    }

    /// How far forces from outside went with their MATs in the last finer frame [m]   (n_mat).
    pub(crate) fn way(&self) -> &[f64] {
        &self.way
    }

    /// MATs were put elsewhere.
    pub(crate) fn forget(&mut self) {
        (self.now, self.before, self.calm) = (1, 1, 0);
        self.margin = f64::NEG_INFINITY;
    }

    /// All it moves by is so many times as much.
    pub(crate) fn slow_down(&mut self, by: f64) {
        if self.now > 1 {
            self.lead.iter_mut().for_each(|lead| *lead *= by);
        }
    }

    /// Look no longer at links that some MATs have.
    pub(crate) fn release(&mut self, is_gone: impl Fn(usize) -> bool) {
        let meets = |first: usize, len| (first..first + len).any(&is_gone);
        self.watches
            .retain(|watch| !meets(watch.a, watch.len) && !meets(watch.b, watch.len));
        self.forget();
    }

    /// Whether a frame that led to `x` by steps `d` has to be gone through again, finer   (n_mat each).
    pub(crate) fn is_over(&mut self, x: &[f64], d: &[f64], w: &[f64]) -> bool {
        if self.now > 1 {
            return true;
        }
        self.margin -= 2.0 * watch::peak(&d[self.mats.clone()]);
        // A margin that is no number is none.
        if self.margin > 0.0 {
            return false;
        }
        let (risen, mat) = self.look(x, w);
        let is_over = self.needs(risen) > 1;
        if is_over {
            self.finer_frames.mat = mat;
        }
        is_over
    }

    /// By how much links raise λ at `x`, at most, and where; 0 where that is within the limit for sure.
    fn look(&mut self, x: &[f64], w: &[f64]) -> (f64, usize) {
        self.margin = nearest(&self.watches, x);
        if self.margin > 0.0 {
            return (0.0, 0);
        }
        self.risen(x, w)
    }

    /// The same without a guess.
    fn risen(&mut self, x: &[f64], w: &[f64]) -> (f64, usize) {
        watch::risen(
            &self.watches,
            &self.mats,
            x,
            w,
            &mut self.sums,
            &mut self.rises,
        )
    }

    /// Steps that a frame needs where links raise λ by so much: more than [`MOST`] where none are enough.
    fn needs(&self, risen: f64) -> u32 {
        if self.rest + risen <= self.limit {
            return 1;
        }
        let bears = |steps: &u32| {
            let steps = f64::from(*steps);
            self.rest / steps + risen / (steps * steps) <= CA
        };
        [2, 4, MOST].into_iter().find(bears).unwrap_or(2 * MOST)
    }
}

/// MATs that nothing joins with any link that stiffens.
fn apart(network: &Network, scheme: &Scheme, watches: &[Watch]) -> Vec<usize> {
    let n = scheme.n_mat();
    let mut forest = Forest::new(n);
    let moves = |mat: usize| scheme.w[mat] > 0.0;
    for (_, a, b) in ends(network) {
        if moves(a) && moves(b) {
            forest.join(a, b);
        }
    }
    let mut is_near = vec![false; n];
    for watch in watches {
        for first in [watch.a, watch.b] {
            (first..first + watch.len).for_each(|mat| is_near[forest.root(mat)] = true);
        }
    }
    (0..n).filter(|&mat| !is_near[forest.root(mat)]).collect()
}

#[cfg(test)]
mod tests;
