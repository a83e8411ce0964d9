//! Terms of outputs → what is summed at every frame: single MATs lie together in one list.

use crate::network::{Output, Term};

/// Fewer single MATs than this are as quick one by one.
const TOGETHER: usize = 8;

/// One summand of an output.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Tap {
    Term(Term),
    /// weight · Σ x of scattered MATs: a bank's members by their nearest loudspeaker.
    Scattered {
        mats: Vec<u32>,
        weight: f64,
    },
}

/// The taps of one output, in the order of its terms.
pub(super) fn taps(output: &Output) -> Vec<Tap> {
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
            _ => taps.extend(group.iter().copied().map(Tap::Term)),
        }
    }
    taps
}
