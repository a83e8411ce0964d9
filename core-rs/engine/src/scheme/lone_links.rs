//! Springs of which each has numbers of its own, one by one: in a round plate that resists bending hardly two adjacent
//! links are alike, and the loop over a run costs more than its only link.

use std::ops::Range;

use super::spring::{ForceEnds, Spring};

/// Links a run on average, below which links are computed one by one.
const RUN_LENGTH_MIN: usize = 2;
/// Runs below which nothing is gained by that.
const LONE_RUNS_MIN: usize = 32;

/// Whether runs of these lengths are so short that links are computed one by one.
pub(crate) fn are_lone(run_lengths: impl Iterator<Item = usize>) -> bool {
    let (mut run_count, mut link_count) = (0, 0);
    for length in run_lengths {
        (run_count, link_count) = (run_count + 1, link_count + length);
    }
    run_count >= LONE_RUNS_MIN && link_count < RUN_LENGTH_MIN * run_count
}

/// Springs by their links, in the order in which their forces are added.
#[derive(Clone, Debug)]
pub(crate) struct LoneLinks {
    pub(crate) groups: Vec<LinkGroup>,
    /// The first link of each run, and the number of links   (n_runs + 1)
    first_links: Vec<u32>,
    /// The MATs of each link, and the indices of its ends in the array of forces   (n_links each)
    pub(crate) mats: Vec<[u32; 2]>,
    pub(crate) force_ends: Vec<[u32; 2]>,
    /// Stiffness [N/m] and damping per step, cubic stiffness [N/m³], rest length [m]   (n_links each)
    pub(crate) k_and_z: Vec<[f64; 2]>,
    pub(crate) q: Vec<f64>,
    pub(crate) rest: Vec<f64>,
}

/// Consecutive links that are computed by the same loop.
#[derive(Clone, Debug)]
pub(crate) struct LinkGroup {
    pub(crate) links: Range<usize>,
    pub(crate) form: LinkForm,
}

/// What a loop over links computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LinkForm {
    pub(crate) is_hardening: bool,
    pub(crate) is_damped: bool,
    pub(crate) pulled_ends: PulledEnds,
}

/// The ends to which links add their forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PulledEnds {
    Both,
    A,
    B,
}

impl LoneLinks {
    /// The links of some runs; `None` if the runs are so long that loops over them are faster.
    pub(super) fn new(springs: &[Spring]) -> Option<Self> {
        are_lone(springs.iter().map(|run| run.len)).then(|| Self::from_runs(springs))
    }

    /// [`Self::new`] for any runs.
    pub(crate) fn from_runs(springs: &[Spring]) -> Self {
        let mut lone_links = Self {
            groups: Vec::new(),
            first_links: vec![0],
            mats: Vec::new(),
            force_ends: Vec::new(),
            k_and_z: Vec::new(),
            q: Vec::new(),
            rest: Vec::new(),
        };
        for run in springs {
            match run.force_ends {
                // A pass over such a run adds to all its ends a before its ends b.
                ForceEnds::Both(a, b) if a.abs_diff(b) < run.len => {
                    lone_links.push(run, PulledEnds::A, [a, b]);
                    lone_links.push(run, PulledEnds::B, [a, b]);
                }
                ForceEnds::Both(a, b) => lone_links.push(run, PulledEnds::Both, [a, b]),
                ForceEnds::A(a) => lone_links.push(run, PulledEnds::A, [a, a]),
                ForceEnds::B(b) => lone_links.push(run, PulledEnds::B, [b, b]),
            }
            lone_links.first_links.push(lone_links.mats.len() as u32);
        }
        lone_links
    }

    /// Set stiffness and damping of all links of a run.
    pub(super) fn set_k_and_z(&mut self, run: usize, k_and_z: [f64; 2]) {
        let [first_link, stop_link] = [run, run + 1].map(|number| self.first_links[number] as usize);
        self.k_and_z[first_link..stop_link].fill(k_and_z);
    }

    fn push(&mut self, run: &Spring, pulled_ends: PulledEnds, force_starts: [usize; 2]) {
        let form = LinkForm {
            is_hardening: run.q != 0.0,
            is_damped: run.z != 0.0,
            pulled_ends,
        };
        let links = self.mats.len()..self.mats.len() + run.len;
        for i in 0..run.len {
            self.mats.push([run.a, run.b].map(|mat| (mat + i) as u32));
            self.force_ends.push(force_starts.map(|end| (end + i) as u32));
            self.k_and_z.push([run.k, run.z]);
            self.q.push(run.q);
            self.rest.push(run.rest);
        }
        match self.groups.last_mut() {
            Some(group) if group.form == form => group.links.end = links.end,
            _ => self.groups.push(LinkGroup { links, form }),
        }
    }
}
