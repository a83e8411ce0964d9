//! Turns the terms of outputs into what is summed at every frame: single MATs are gathered in one list.

use crate::network::{LinkKind, Network, Output, SpaceLink, Term};

/// Below this number, single MATs are summed as quickly one by one.
const TOGETHER: usize = 8;

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
    let single = |term: &Term| match *term {
        Term::Position {
            first,
            len: 1,
            weight,
        } => Some((first, weight)),
        _ => None,
    };
    let alike = |a: &Term, b: &Term| match (single(a), single(b)) {
        (Some((_, a)), Some((_, b))) => a == b,
        _ => false,
    };
    let mut taps = Vec::new();
    for group in output.terms.chunk_by(alike) {
        match single(&group[0]) {
            Some((_, weight)) if group.len() >= TOGETHER => {
                let mats = group
                    .iter()
                    .filter_map(single)
                    .map(|(mat, _)| mat as u32)
                    .collect();
                taps.push(Tap::Scattered { mats, weight });
            }
            _ => taps.extend(group.iter().map(|term| tap(network, term))),
        }
    }
    taps
}

fn tap(network: &Network, term: &Term) -> Tap {
    let Term::Length { first, len, weight } = *term else {
        return Tap::Term(*term);
    };
    let all = first..first + len;
    let links = network.runs().iter().flat_map(|run| {
        let links = run.first.max(all.start)..(run.first + run.len).min(all.end);
        links.filter_map(move |link| match &run.kind {
            LinkKind::Space(space) => Some((run.pair(link - run.first, 0), space.clone())),
            _ => None,
        })
    });
    Tap::Lengths {
        links: links.collect(),
        weight,
    }
}
