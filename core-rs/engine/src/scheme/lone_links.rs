//! Springs of which each has numbers of its own, one by one: in a round plate that resists bending hardly two adjacent
//! links are alike, and the loop over a run costs more than its only link.

use super::force_sums::{ForceSums, LINK_LANES};
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

/// Springs by their links.
#[derive(Clone, Debug)]
pub(crate) struct LoneLinks {
    /// The first link of each run, and the number of links   (n_runs + 1)
    first_links: Vec<u32>,
    /// All links, eight in each; the last is filled with links that do nothing.
    pub(crate) blocks: Vec<LinkBlock>,
    /// Whether any link is damped.
    pub(crate) are_damped: bool,
    /// The forces of links that add up at each MAT.
    pub(crate) force_sums: ForceSums,
}

/// Links side by side: their MATs and numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct LinkBlock {
    pub(crate) a: [u32; LINK_LANES],
    pub(crate) b: [u32; LINK_LANES],
    /// Stiffness [N/m]
    pub(crate) k: [f64; LINK_LANES],
    /// Damping per step [N/m]
    pub(crate) z: [f64; LINK_LANES],
    /// Cubic stiffness [N/m³]
    pub(crate) q: [f64; LINK_LANES],
    /// Rest length [m]
    pub(crate) rest: [f64; LINK_LANES],
}

impl LoneLinks {
    /// The links of some runs; `None` if the runs are so long that loops over them are faster.
    pub(super) fn new(springs: &[Spring]) -> Option<Self> {
        are_lone(springs.iter().map(|run| run.len)).then(|| Self::from_runs(springs))
    }

    /// [`Self::new`] for any runs.
    pub(crate) fn from_runs(springs: &[Spring]) -> Self {
        let mut lone_links = Self {
            first_links: vec![0],
            blocks: Vec::new(),
            are_damped: springs.iter().any(|run| run.z != 0.0),
            force_sums: ForceSums::default(),
        };
        let mut signed_forces = Vec::new();
        let mut link_count = 0;
        for run in springs {
            let (first_at_a, first_at_b) = match run.force_ends {
                ForceEnds::Both(a, b) => (Some(a), Some(b)),
                ForceEnds::A(a) => (Some(a), None),
                ForceEnds::B(b) => (None, Some(b)),
            };
            // A pass over runs adds to all ends a of a run before its ends b.
            for (first_end, is_negative) in [(first_at_a, false), (first_at_b, true)] {
                let ends = first_end.map_or(0..0, |first_end| first_end..first_end + run.len);
                signed_forces.extend(ends.zip(link_count..).map(|(end, link)| (end, link, is_negative)));
            }
            for i in 0..run.len {
                lone_links.set_link(link_count + i, i, run);
            }
            link_count += run.len;
            lone_links.first_links.push(link_count as u32);
        }
        lone_links.force_sums = ForceSums::new(&signed_forces, lone_links.blocks.len());
        lone_links
    }

    /// Set stiffness and damping of all links of a run.
    pub(super) fn set_k_and_z(&mut self, run: usize, [k, z]: [f64; 2]) {
        let [first_link, stop_link] = [run, run + 1].map(|number| self.first_links[number] as usize);
        for link in first_link..stop_link {
            let (block, lane) = (&mut self.blocks[link / LINK_LANES], link % LINK_LANES);
            (block.k[lane], block.z[lane]) = (k, z);
        }
    }

    /// Set a link to the i-th of a run.
    fn set_link(&mut self, link: usize, i: usize, run: &Spring) {
        let lane = link % LINK_LANES;
        if lane == 0 {
            self.blocks.push(LinkBlock::default());
        }
        let block = &mut self.blocks[link / LINK_LANES];
        (block.a[lane], block.b[lane]) = ((run.a + i) as u32, (run.b + i) as u32);
        (block.k[lane], block.z[lane]) = (run.k, run.z);
        (block.q[lane], block.rest[lane]) = (run.q, run.rest);
    }
}
