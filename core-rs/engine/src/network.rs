//! The network: MATs and LIAs with their parameters, names and parts.
//!
//! Sizes: `n_mat` MATs, `n_lia` LIAs, `n_out` outputs. Arrays are contiguous, one entry a module;
//! links are stored as runs of equal offset, so that a mesh is a handful of loops.

mod anonymous;
mod bodies;
mod bristle;
mod builder;
mod checks;
mod contact_law;
mod damped;
mod elements;
mod error;
mod following;
pub(crate) mod forest;
mod highest;
mod links;
mod modes;
mod names;
mod output;
mod pairwise;
mod parameters;
mod part_body;
mod proxy;
mod reachable;
mod response;
mod same;
mod sliding;
mod space;
mod subset;

pub use crate::dry::Dry;
pub(crate) use anonymous::PartOrder;
pub use bristle::Bristle;
pub(crate) use contact_law::{ContactLaw, PowerLaw};
pub use elements::{Element, ElementKind, Elements};
pub use error::Error;
pub use following::{FOLLOWING_MAX, Followed, Following, FollowingMass};
pub use links::LawUse;
pub use modes::{ModeRange, PartModes, Tone, TooManyModes};
pub use output::{Output, Term};
pub(crate) use pairwise::PairRun;
pub use pairwise::{PairLaw, Pairwise, PointGroup};
pub use parameters::{But, Contact, Side, Tie};
pub use proxy::{Proxy, Shares, SidePosition};
pub use reachable::{NetworkMoment, PRESS_DEPTH, ReachableNetwork};
pub(crate) use sliding::{Sliding, difference};
pub(crate) use space::{AXES_MAX, distance, length_and_unit_vector};
pub use space::{Facets, Measure, SpaceLaw, SpaceLink, SpacePoint, SpacePoints};
pub(crate) use subset::Subset;

use std::ops::Range;
use std::sync::Arc;

use crate::law::Law;
use crate::units::Rate;

/// The kind of a MAT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatKind {
    /// A free mass.
    Mas,
    /// A mass tied to the ground.
    Cel,
    /// A fixed point.
    Sol,
    /// A point whose position is imposed (ENX).
    Imposed,
    /// A massless point between masses, which moves with them.
    Proxy,
}

impl MatKind {
    /// Whether forces move the MAT.
    pub(crate) fn moves(self) -> bool {
        matches!(self, Self::Mas | Self::Cel)
    }

    /// Whether the MAT is fixed or imposed, so that no force moves it.
    pub(crate) fn is_held(self) -> bool {
        matches!(self, Self::Sol | Self::Imposed)
    }
}

/// The MATs, one entry each.
#[derive(Clone, Debug, Default)]
pub struct Mats {
    /// Kind of the MAT                                   (n_mat)
    pub kind: Vec<MatKind>,
    /// Mass [kg], or algorithmic M in a part under `ca`  (n_mat)
    pub m: Vec<f64>,
    /// Stiffness to the ground [N/m]                     (n_mat)
    pub k: Vec<f64>,
    /// Damping to the ground [N·s/m], or algorithmic Z   (n_mat)
    pub z: Vec<f64>,
    /// Position of the ground [m]                        (n_mat)
    pub rest: Vec<f64>,
    /// Initial position [m]                              (n_mat)
    pub x0: Vec<f64>,
    /// Initial velocity [m/s]                            (n_mat)
    pub v0: Vec<f64>,
    /// Place on the bench [m]                            (n_mat)
    pub bench_position: Vec<[f64; 2]>,
    /// Index of the part                                 (n_mat)
    pub part: Vec<u32>,
    /// Constant force on the MAT [N]                     (at most n_mat; 0 for MATs beyond the end)
    pub weight: Vec<f64>,
}

/// The law of a run of links.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkKind {
    /// Spring and damper (RES, FRO, REF).
    Ref,
    /// One-sided contact.
    But(But),
    /// Non-linear law.
    Lnl(Arc<Law>),
    /// Non-linear law some of whose constants follow MATs.
    Followed(Followed),
    /// Friction with memory; the K of its run is σ0, its Z is Fc.
    Bristle(Bristle),
    /// Dry friction that holds rigidly; the Z of its run is F [N].
    Dry(Dry),
    /// Spring or contact between points in space.
    Space(SpaceLink),
    /// Contacts between all pairs of points of two groups in space.
    Pairwise(Pairwise),
}

/// Links of one kind whose ends advance together: link i joins MATs `a + i` and `b + i`.
#[derive(Clone, Debug)]
pub struct Run {
    /// The law.
    pub kind: LinkKind,
    /// First point of the first link.
    pub a: usize,
    /// Second point of the first link.
    pub b: usize,
    /// Number of links.
    pub len: usize,
    /// Index of the first link among all LIAs.
    pub first: usize,
    /// Stiffness [N/m] of every link of the run.
    pub k: f64,
    /// Damping [N·s/m], or algorithmic Z in a part under `ca`.
    pub z: f64,
    /// Elongation at rest [m]; ± gap of a contact.
    pub rest: f64,
    /// Index of the part that declared the run.
    pub part: usize,
}

impl Run {
    /// Whether it is of springs without damping, whose forces are sums of positions.
    pub(crate) fn is_undamped_spring(&self) -> bool {
        matches!(self.kind, LinkKind::Ref) && self.z == 0.0
    }
}

/// An instrument or a key: everything to which a composer gave one name.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its name in the score.
    pub name: String,
    /// Rate of the discrete network that defines the part (`units: ca`); `None` if the part is continuous.
    pub ca_rate: Option<Rate>,
    /// Frames from one pull of the part's own springs to the next; `None`: every frame.
    pub macrostep: Option<u32>,
}

/// A network of MATs and LIAs.
///
/// ```
/// use ergon_engine::Network;
/// use ergon_engine::network::Tie;
///
/// let mut network = Network::new();
/// network.part("bell", None);
/// let m = network.cel("m", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
/// assert_eq!(network.mat_name(m), "bell.m");
/// let refused = network.mas("heavy", -1.0, 0.0, 0.0).unwrap_err();
/// assert_eq!(refused.to_string(), "bell.heavy: M is -1: it must be above 0");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Network {
    parts: Vec<Part>,
    /// Index of the part that modules are added to.
    current_part: usize,
    mats: Mats,
    runs: Vec<Run>,
    n_lia: usize,
    /// Number of links on each MAT                         (at most n_mat)
    degree: Vec<u32>,
    outputs: Vec<Output>,
    proxies: Vec<Proxy>,
    following_masses: Vec<FollowingMass>,
    names: names::Names,
}

impl Network {
    /// How many MATs forces move.
    pub(crate) fn n_moving(&self) -> usize {
        self.mats.kind.iter().filter(|kind| kind.moves()).count()
    }

    /// Whether a part with MATs in this network has a macrostep.
    pub(crate) fn has_slow_parts(&self) -> bool {
        let has_mats = |part: usize| self.mats.part.contains(&(part as u32));
        let mut numbered_parts = self.parts.iter().enumerate();
        numbered_parts.any(|(index, part)| part.macrostep.is_some() && has_mats(index))
    }

    /// Names of the parts that have moving MATs among `mats`, in the order of the parts.
    pub(crate) fn moving_parts_among(&self, mats: &[u32]) -> Vec<String> {
        let mut has_moving = vec![false; self.parts.len()];
        for &mat_index in mats {
            let mat_index = mat_index as usize;
            has_moving[self.mats.part[mat_index] as usize] |= self.mats.kind[mat_index].moves();
        }
        let flagged_parts = self.parts.iter().zip(has_moving);
        flagged_parts
            .filter(|(_, has_moving)| *has_moving)
            .map(|(part, _)| part.name.clone())
            .collect()
    }

    /// Names of the parts with moving MATs, in order.
    pub(crate) fn moving_parts(&self) -> Vec<String> {
        let all_mats: Vec<u32> = (0..self.n_mat() as u32).collect();
        self.moving_parts_among(&all_mats)
    }

    /// An empty network.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of MATs.
    pub fn n_mat(&self) -> usize {
        self.mats.m.len()
    }

    /// Number of LIAs.
    pub fn n_lia(&self) -> usize {
        self.n_lia
    }

    /// The MATs.
    pub fn mats(&self) -> &Mats {
        &self.mats
    }

    /// The runs of links, in order of declaration.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The outputs, in order of declaration.
    pub fn outputs(&self) -> &[Output] {
        &self.outputs
    }

    /// The parts, in order of declaration.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Name of a MAT as the composer wrote it, e.g. `bell.m` or `gong.12`.
    pub fn mat_name(&self, index: usize) -> String {
        self.names.mat(index)
    }

    /// Name of a LIA as the composer wrote it.
    pub fn link_name(&self, index: usize) -> String {
        self.names.link(index)
    }

    /// The run that holds a LIA.
    pub fn run_of(&self, link: usize) -> Option<&Run> {
        let run_index = self.runs.partition_point(|run| run.first + run.len <= link);
        self.runs.get(run_index)
    }

    /// How many links end on a MAT.
    pub fn degree(&self, mat: usize) -> u32 {
        self.degree.get(mat).copied().unwrap_or(0)
    }

    /// The network of one part: its MATs and all links between them, except the links in the ranges `excluded_links`.
    pub(crate) fn subset_of_part(&self, part: usize, excluded_links: &[Range<usize>]) -> Subset {
        let is_inside = |&i: &u32| self.mats.part[i as usize] as usize == part;
        let part_mats: Vec<u32> = (0..self.n_mat() as u32).filter(is_inside).collect();
        let is_included = |link: &u32| {
            excluded_links
                .iter()
                .all(|excluded| !excluded.contains(&(*link as usize)))
        };
        let links_left: Vec<u32> = (0..self.n_lia as u32).filter(is_included).collect();
        self.subset(&part_mats, &[], &links_left)
    }
}

impl Network {
    /// Append a run of links, and give it the next index.
    fn push_run(&mut self, run: Run) {
        for axis in 0..run.n_axes() {
            let (first_mat, second_mat) = run.pair(0, axis);
            let mats_reached = run.len + first_mat.max(second_mat);
            self.degree.resize(self.degree.len().max(mats_reached), 0);
            for i in 0..run.len {
                self.degree[first_mat + i] += 1;
                self.degree[second_mat + i] += 1;
            }
        }
        self.runs.push(Run {
            first: self.n_lia,
            ..run
        });
        self.n_lia += self.runs[self.runs.len() - 1].len;
    }
}

/// One MAT.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mat {
    kind: MatKind,
    m: f64,
    k: f64,
    z: f64,
    rest: f64,
    x0: f64,
    v0: f64,
    bench_position: [f64; 2],
    part: u32,
}

impl Mats {
    /// Constant force on a MAT [N].
    pub(crate) fn weight_of(&self, mat: usize) -> f64 {
        self.weight.get(mat).copied().unwrap_or(0.0)
    }

    fn push(&mut self, mat: Mat) {
        self.kind.push(mat.kind);
        self.m.push(mat.m);
        self.k.push(mat.k);
        self.z.push(mat.z);
        self.rest.push(mat.rest);
        self.x0.push(mat.x0);
        self.v0.push(mat.v0);
        self.bench_position.push(mat.bench_position);
        self.part.push(mat.part);
    }
}

#[cfg(test)]
mod tests;
