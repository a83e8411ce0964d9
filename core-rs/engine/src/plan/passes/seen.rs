//! What is seen but not heard: computed as if one output heard all of it.

use crate::network::{Error, Network, Subset, Term};
use crate::plan::passes::islands::IslandMembers;

/// Whether anything of an island belongs to a part that is displayed.
pub(in crate::plan) fn is_seen(network: &Network, island: &IslandMembers, seen: &[String]) -> bool {
    !seen.is_empty() && is_any(&network.parts_of(&island.mats), seen)
}

/// Whether any of some parts is displayed.
pub(in crate::plan) fn is_any(parts: &[String], seen: &[String]) -> bool {
    parts.iter().any(|name| seen.contains(name))
}

/// A subset for each island, and how many these are; all loose cells together follow as one further subset.
pub(in crate::plan) fn subsets(
    network: &Network,
    islands: Vec<IslandMembers>,
    is_loose: impl Fn(&IslandMembers) -> bool,
) -> Result<(Vec<Subset>, usize), Error> {
    let (mut all, mut loose) = (Vec::new(), Vec::new());
    for island in islands {
        if is_loose(&island) {
            loose.extend(island.mats);
        } else {
            let subset = network.subset(&island.mats, &island.guests, &island.links);
            all.push(with_probe_output(subset, &island.mats)?);
        }
    }
    let n_islands = all.len();
    if !loose.is_empty() {
        all.push(with_probe_output(network.subset(&loose, &[], &[]), &loose)?);
    }
    Ok((all, n_islands))
}

/// The subset with one output that hears every mass with a weight of its own: no mode is silent at it.
pub(in crate::plan) fn with_probe_output(
    mut subset: Subset,
    probed_mats: &[u32],
) -> Result<Subset, Error> {
    let terms = probed_mats.iter().filter_map(|&mat| {
        let first = subset.mat(mat as usize)?;
        subset.network.mats().kind[first].moves().then(|| {
            let drawn = mat.wrapping_mul(0x9e37_79b9).rotate_left(15) >> 8;
            let size = 0.5 + f64::from(drawn) / f64::from(1 << 24);
            Term::Position {
                first,
                len: 1,
                weight: if drawn & 1 == 0 { size } else { -size },
            }
        })
    });
    let terms: Vec<Term> = terms.collect();
    subset.network.listen("what is looked at", terms)?;
    // No output of the whole network: units that are only seen are added to none.
    subset.outputs.push(0);
    Ok(subset)
}
