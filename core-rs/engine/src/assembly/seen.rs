//! What is seen but not heard: computed as if one output heard all of it.

use crate::assembly::islands::IslandMembers;
use crate::network::{Error, Network, Subset, Term};

/// Whether anything of an island belongs to a part that is displayed.
pub(crate) fn is_displayed(network: &Network, island: &IslandMembers, displayed_parts: &[String]) -> bool {
    !displayed_parts.is_empty() && has_displayed_part(&network.moving_parts_among(&island.mats), displayed_parts)
}

/// Whether any of some parts is displayed.
pub(crate) fn has_displayed_part(parts: &[String], displayed_parts: &[String]) -> bool {
    parts.iter().any(|name| displayed_parts.contains(name))
}

/// A subset for each island, and how many these are; all loose cells together follow as one further subset.
pub(crate) fn subsets(
    network: &Network,
    islands: Vec<IslandMembers>,
    is_uncoupled: impl Fn(&IslandMembers) -> bool,
) -> Result<(Vec<Subset>, usize), Error> {
    let (mut all_subsets, mut uncoupled_mats) = (Vec::new(), Vec::new());
    for island in islands {
        if is_uncoupled(&island) {
            uncoupled_mats.extend(island.mats);
        } else {
            let island_subset = network.subset(&island.mats, &island.foreign_held_mats, &island.links);
            all_subsets.push(with_probe_output(island_subset, &island.mats)?);
        }
    }
    let n_islands = all_subsets.len();
    if !uncoupled_mats.is_empty() {
        all_subsets.push(with_probe_output(
            network.subset(&uncoupled_mats, &[], &[]),
            &uncoupled_mats,
        )?);
    }
    Ok((all_subsets, n_islands))
}

/// The subset with one output that hears every mass with a weight of its own: no mode is silent at it.
pub(crate) fn with_probe_output(mut subset: Subset, probed_mats: &[u32]) -> Result<Subset, Error> {
    let probe_terms = probed_mats.iter().filter_map(|&mat| {
        let first = subset.mat(mat as usize)?;
        subset.network.mats().kind[first].moves().then(|| {
            let random_bits = mat.wrapping_mul(0x9e37_79b9).rotate_left(15) >> 8;
            let magnitude = 0.5 + f64::from(random_bits) / f64::from(1 << 24);
            Term::Position {
                first,
                len: 1,
                weight: if random_bits & 1 == 0 { magnitude } else { -magnitude },
            }
        })
    });
    let probe_terms: Vec<Term> = probe_terms.collect();
    subset.network.listen("what is looked at", probe_terms)?;
    // No output of the whole network: units that are only seen are added to none.
    subset.outputs.push(0);
    Ok(subset)
}
