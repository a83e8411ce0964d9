//! Some modules of a network as a network of their own, with their indices in the whole network.

use std::sync::Arc;

use super::{Error, Followed, LinkKind, Mat, MatKind, Network, Output, Pairwise, Run, SpaceLink, Term};
use crate::interrupt;
use crate::law::{Hardening, Law};

/// A part of another network, the whole. The lists give the index in the whole of each local index, in rising order.
#[derive(Clone, Debug)]
pub(crate) struct Subset {
    pub(crate) network: Network,
    /// (n_mat)
    pub(crate) mats: Vec<u32>,
    /// (n_lia)
    pub(crate) links: Vec<u32>,
    /// (n_out); of [`Network::subset`] only outputs that listen to its modules
    pub(crate) outputs: Vec<u32>,
}

impl Subset {
    /// Local index of a MAT of the whole.
    pub(crate) fn mat(&self, network_mat: usize) -> Option<usize> {
        self.mats.binary_search(&(network_mat as u32)).ok()
    }
}

impl Network {
    /// The MATs `mats` and `guests`, and those of `links` whose ends are among them, in the order of the whole.
    ///
    /// Outputs keep their terms on `mats` and `links`, but not those on guests. All lists must rise.
    pub(crate) fn subset(&self, mats: &[u32], guests: &[u32], links: &[u32]) -> Subset {
        let mut subset = self.subset_with_all_outputs(mats, guests, links);
        let outputs = &mut subset.network.outputs;
        subset
            .outputs
            .retain(|&index| !outputs[index as usize].terms.is_empty());
        outputs.retain(|output| !output.terms.is_empty());
        subset
    }

    /// [`Network::subset`] with all outputs of the whole, including those that listen to none of its modules.
    pub(crate) fn subset_with_all_outputs(&self, mats: &[u32], guests: &[u32], links: &[u32]) -> Subset {
        let mut subset_mats = [mats, guests].concat();
        subset_mats.sort_unstable();
        let mut subset = Subset {
            network: Network {
                parts: self.parts.clone(),
                ..Network::default()
            },
            mats: subset_mats,
            links: Vec::new(),
            outputs: Vec::new(),
        };
        for &mat in interrupt::polled_items(&subset.mats) {
            let mat = self.mat_at(mat as usize);
            subset.network.mats.push(mat);
        }
        if !self.mats.weight.is_empty() {
            let weights = subset.mats.iter();
            let weights = weights.map(|&mat| self.mats.weight_of(mat as usize));
            subset.network.mats.weight = weights.collect();
        }
        let proxies = self.proxies.iter();
        let proxies = proxies.filter_map(|proxy| proxy.renumbered(|mat| subset.mat(mat)));
        subset.network.proxies = proxies.collect();
        let mass_followers = self.following_masses.iter();
        let mass_followers = mass_followers.filter_map(|mass| mass.renumbered(|mat| subset.mat(mat)));
        subset.network.following_masses = mass_followers.collect();
        for run in interrupt::polled_items(&self.runs) {
            if let LinkKind::Pairwise(pairs) = &run.kind {
                subset.push_pairwise(run, pairs, links);
                continue;
            }
            let mut law_guides = run.followed_law().into_iter().flat_map(Followed::guide_mats);
            if law_guides.any(|mat| subset.mat(mat).is_none()) {
                continue;
            }
            // Few runs reach a small subset: check before searching link by link.
            if subset.has_any(run.a, run.len) && subset.has_any(run.b, run.len) {
                self.add_inside(run, links, &mut subset);
            }
        }
        let Subset { mats, links, .. } = &subset;
        subset.network.names = self.names.subset(mats, links);
        subset.add_outputs(&self.outputs, guests);
        subset
    }

    /// Turn a MAT into a free mass `m` [kg] at its present position.
    pub(crate) fn set_free(&mut self, mat: usize, m: f64) {
        let mats = &mut self.mats;
        mats.kind[mat] = MatKind::Mas;
        (mats.m[mat], mats.k[mat], mats.z[mat], mats.rest[mat]) = (m, 0.0, 0.0, 0.0);
    }

    /// Remove gravity from a MAT, because its body accounts for it.
    pub(crate) fn set_weightless(&mut self, mat: usize) {
        if let Some(mat_weight) = self.mats.weight.get_mut(mat) {
            *mat_weight = 0.0;
        }
    }

    /// Give a MAT another K, Z and M.
    pub(crate) fn set_tie(&mut self, mat: usize, [k, z, m]: [f64; 3]) {
        let mats = &mut self.mats;
        (mats.k[mat], mats.z[mat], mats.m[mat]) = (k, z, m);
    }

    /// Multiply K and Z of some links, which are whole runs; q of a hardening spring does not change.
    pub(crate) fn scale_links(
        &mut self,
        links: std::ops::Range<usize>,
        [k_factor, z_factor]: [f64; 2],
    ) -> Result<(), Error> {
        for run in self.runs.iter_mut().filter(|run| links.contains(&run.first)) {
            (run.k, run.z) = (run.k * k_factor, run.z * z_factor);
            let LinkKind::Lnl(law) = &run.kind else {
                continue;
            };
            if let Some(Hardening { k, q, z }) = law.hardening_spring() {
                let law = Law::hardening(k_factor * k, q, z_factor * z.unwrap_or(0.0));
                run.kind = LinkKind::Lnl(Arc::new(law.map_err(|error| Error::Refused {
                    module: self.names.link(run.first),
                    message: error.to_string(),
                })?));
            }
        }
        Ok(())
    }

    /// The network with undifferentiated outputs: SOV and SOA give the positions from which they are derived.
    pub fn undifferentiated(&self) -> Self {
        let mut undifferentiated = self.clone();
        undifferentiated.outputs.iter_mut().for_each(|output| output.order = 0);
        undifferentiated
    }

    /// The network with other macrosteps of its parts: `macrostep` returns the frames from pull to pull for a part's
    /// name and present value; `None` means every frame.
    pub(crate) fn with_macrosteps(&self, macrostep: impl Fn(&str, Option<u32>) -> Option<u32>) -> Self {
        let mut changed = self.clone();
        for part in &mut changed.parts {
            part.macrostep = macrostep(&part.name, part.macrostep);
        }
        changed
    }

    fn mat_at(&self, i: usize) -> Mat {
        let all_mats = &self.mats;
        Mat {
            kind: all_mats.kind[i],
            m: all_mats.m[i],
            k: all_mats.k[i],
            z: all_mats.z[i],
            rest: all_mats.rest[i],
            x0: all_mats.x0[i],
            v0: all_mats.v0[i],
            bench_position: all_mats.bench_position[i],
            part: all_mats.part[i],
        }
    }

    /// Add the links of one run that lie inside the subset; links whose ends stay consecutive share a run.
    fn add_inside(&self, run: &Run, links: &[u32], subset: &mut Subset) {
        let mut open_range: Option<LinkRange> = None;
        for i in interrupt::steps(0..run.len) {
            let Some((a, b, space)) = subset.local_link(run, i) else {
                continue;
            };
            if links.binary_search(&((run.first + i) as u32)).is_err() {
                continue;
            }
            subset.links.push((run.first + i) as u32);
            match &mut open_range {
                Some(range) if range.is_followed_by(a, b, space.as_ref()) => range.len += 1,
                range => {
                    let next_range = LinkRange { a, b, len: 1, space };
                    subset.push_run_range(run, range.replace(next_range));
                }
            }
        }
        subset.push_run_range(run, open_range);
    }
}

/// Links of a run that stay consecutive.
struct LinkRange {
    a: usize,
    b: usize,
    len: usize,
    space: Option<SpaceLink>,
}

impl LinkRange {
    fn is_followed_by(&self, a: usize, b: usize, space: Option<&SpaceLink>) -> bool {
        (a, b) == (self.a + self.len, self.b + self.len) && space == self.space.as_ref()
    }
}

impl Subset {
    /// Whether any MAT of a range of the whole belongs to the subset.
    fn has_any(&self, first: usize, len: usize) -> bool {
        let first_index = self.mats.partition_point(|&mat| (mat as usize) < first);
        self.mats
            .get(first_index)
            .is_some_and(|&mat| (mat as usize) < first + len)
    }

    /// Local ends of the i-th link of a run of the whole, and its form in space; `None` if an end is not in the subset.
    fn local_link(&self, run: &Run, i: usize) -> Option<(usize, usize, Option<SpaceLink>)> {
        let link_ends = (run.a + i, run.b + i);
        if let LinkKind::Space(space_link) = &run.kind {
            return self.local_in_space(space_link, link_ends);
        }
        Some((self.mat(link_ends.0)?, self.mat(link_ends.1)?, None))
    }

    fn local_in_space(&self, space: &SpaceLink, ends: (usize, usize)) -> Option<(usize, usize, Option<SpaceLink>)> {
        let (first_local, second_local) = (self.mat(ends.0)?, self.mat(ends.1)?);
        let mut local_space = space.clone();
        for axis in 1..space.n_axes {
            let (first_axis_mat, second_axis_mat) = space.pair(ends, axis);
            local_space.offsets[0][axis - 1] = self.mat(first_axis_mat)? as isize - first_local as isize;
            local_space.offsets[1][axis - 1] = self.mat(second_axis_mat)? as isize - second_local as isize;
        }
        Some((first_local, second_local, Some(local_space)))
    }

    /// Add a run of pairwise links if all its points and links belong to the subset.
    fn push_pairwise(&mut self, run: &Run, pairs: &Pairwise, links: &[u32]) {
        let link_range = run.first..run.first + run.len;
        let is_included = |link: usize| links.binary_search(&(link as u32)).is_ok();
        let first_mats = (run.a, run.b);
        let last_mats = (run.a + pairs.n_first - 1, run.b + run.len - 1);
        let has_all_points = (0..pairs.link.n_axes).all(|axis| {
            let (first_on_axis, last_mats) = (pairs.link.pair(first_mats, axis), pairs.link.pair(last_mats, axis));
            self.has_all(first_on_axis.0..=last_mats.0) && self.has_all(first_on_axis.1..=last_mats.1)
        });
        if !has_all_points || !link_range.clone().all(is_included) {
            return;
        }
        let Some((a, b, Some(link))) = self.local_in_space(&pairs.link, first_mats) else {
            return;
        };
        self.links.extend(link_range.map(|link| link as u32));
        self.network.push_run(Run {
            kind: LinkKind::Pairwise(Pairwise { link, ..pairs.clone() }),
            a,
            b,
            ..*run
        });
    }

    /// Whether all MATs of a range of the whole belong to the subset.
    fn has_all(&self, range: std::ops::RangeInclusive<usize>) -> bool {
        let subset_rank = |mat: usize| self.mats.partition_point(|&subset_mat| (subset_mat as usize) < mat);
        let (first_mat, last_mat) = range.into_inner();
        self.mat(last_mat).is_some() && subset_rank(last_mat) - subset_rank(first_mat) == last_mat - first_mat
    }

    fn push_run_range(&mut self, run: &Run, range: Option<LinkRange>) {
        let Some(LinkRange { a, b, len, space }) = range else {
            return;
        };
        let followed = run.followed_law();
        let followed = followed.and_then(|following| following.renumbered(|mat| self.mat(mat)));
        let kind = match (space, followed) {
            (Some(space), _) => LinkKind::Space(space),
            (None, Some(followed)) => LinkKind::Followed(followed),
            (None, None) => run.kind.clone(),
        };
        self.network.push_run(Run {
            kind,
            a,
            b,
            len,
            ..*run
        });
    }

    fn add_outputs(&mut self, outputs: &[Output], guests: &[u32]) {
        for (index, output) in outputs.iter().enumerate() {
            let terms: Vec<Term> = output
                .terms
                .iter()
                .flat_map(|term| self.local_terms(term, guests))
                .collect();
            self.outputs.push(index as u32);
            self.network.outputs.push(Output {
                name: output.name.clone(),
                terms,
                order: output.order,
            });
        }
    }

    /// The part of a term that lies in the subset, as terms over local ranges.
    fn local_terms(&self, term: &Term, guests: &[u32]) -> Vec<Term> {
        let (subset_indices, guests, first, len) = match *term {
            Term::Position { first, len, .. } | Term::Ground { first, len, .. } => (&self.mats, guests, first, len),
            Term::Force { first, len, .. } | Term::Length { first, len, .. } => (&self.links, &[][..], first, len),
        };
        // Indices rise, so those in the range are adjacent.
        let local = |network_index: usize| subset_indices.partition_point(|&index| (index as usize) < network_index);
        let (first, local_stop) = (local(first), local(first + len));
        let local_indices: Vec<usize> = (first..local_stop)
            .filter(|&local| guests.binary_search(&subset_indices[local]).is_err())
            .collect();
        local_indices
            .chunk_by(|index, next| index + 1 == *next)
            .map(|range| term.over(range[0], range.len()))
            .collect()
    }
}
