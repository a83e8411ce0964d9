//! Turns the terms of outputs into what is summed at every frame: single MATs are gathered in one list.

use crate::network::{LinkKind, Network, Output, SpaceLink, Term};

/// Below this number, single MATs are summed as quickly one by one.
const SCATTERED_MIN: usize = 8;

/// One summand of an output.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Tap {
    Term(Term),
    /// weight · Σ x of MATs that are not adjacent: for example members of a bank, by their nearest loudspeaker.
    Scattered {
        mats: Vec<u32>,
        weight: f64,
    },
    /// weight · Σ of the lengths of links, each given by its MATs along the first axis.
    Lengths {
        links: Vec<((usize, usize), SpaceLink)>,
        weight: f64,
    },
}

/// The taps of one output, in the order of its terms.
pub(super) fn taps(network: &Network, output: &Output) -> Vec<Tap> {
    let single_tap = |term: &Term| match *term {
        Term::Position { first, len: 1, weight } => Some((first, weight)),
        _ => None,
    };
    let same_weight = |a: &Term, b: &Term| match (single_tap(a), single_tap(b)) {
        (Some((_, a)), Some((_, b))) => a == b,
        _ => false,
    };
    let mut output_taps = Vec::new();
    for group in output.terms.chunk_by(same_weight) {
        match single_tap(&group[0]) {
            Some((_, weight)) if group.len() >= SCATTERED_MIN => {
                let mats = group.iter().filter_map(single_tap).map(|(mat, _)| mat as u32).collect();
                output_taps.push(Tap::Scattered { mats, weight });
            }
            _ => output_taps.extend(group.iter().map(|term| tap(network, term))),
        }
    }
    output_taps
}

fn tap(network: &Network, term: &Term) -> Tap {
    let Term::Length { first, len, weight } = *term else {
        return Tap::Term(*term);
    };
    let term_links = first..first + len;
    let links = network.runs().iter().flat_map(|run| {
        let links = run.first.max(term_links.start)..(run.first + run.len).min(term_links.end);
        links.filter_map(move |link| match &run.kind {
            LinkKind::Space(space_link) => Some((run.pair(link - run.first, 0), space_link.clone())),
            _ => None,
        })
    });
    Tap::Lengths {
        links: links.collect(),
        weight,
    }
}
