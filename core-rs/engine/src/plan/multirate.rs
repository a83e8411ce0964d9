//! Whether slow parts of an island may be slow: they do not make it grow, and what they cost in exactness.

use super::apart::{Spans, difference};
use super::assemble::Assembled;
use super::budget::Budget;
use super::macrostep::{self, Growth};
use super::memo::Memo;
use super::mesh::Ways;
use super::pilot::{is_worth, length, play};
use super::row::Measured;
use super::slow::{Stays, slow};
use super::split::Own;
use crate::island::inside::Inside;
use crate::network::{Error, Network, Subset};
use crate::scheme::Word;

/// Whether any part of a network is to be slow.
pub(super) fn is_asked(network: &Network) -> bool {
    network.parts().iter().any(|part| part.every.is_some())
}

/// An island with only those of its parts slow that may be, as far as one sees without playing; and the others.
pub(super) fn settle(subset: &Subset, own: &Own, budget: &Budget) -> (Subset, Vec<Stays>) {
    let stay = match budget {
        Budget::Method(_) => all(subset, "one method is asked for all"),
        Budget::Error(_) | Budget::Cents { .. } => slow(&subset.network, &own.timeline).stay,
    };
    (without(subset, &stay), stay)
}

/// The parts here that are to be slow, with a reason for all of them.
pub(super) fn all(subset: &Subset, why: &str) -> Vec<Stays> {
    let mats = subset.network.mats();
    let parts = subset.network.parts().iter().enumerate();
    let is_ours = |at: usize| mats.part.contains(&(at as u32));
    parts
        .filter(|(at, part)| part.every.is_some() && is_ours(*at))
        .map(|(_, part)| (part.name.clone(), why.to_owned()))
        .collect()
}

/// The same island with some parts at every frame.
pub(super) fn without(subset: &Subset, stay: &[Stays]) -> Subset {
    let stays = |name: &str| stay.iter().any(|(own, _)| own == name);
    Subset {
        network: subset
            .network
            .with_every(|name, every| (!stays(name)).then_some(every)),
        ..subset.clone()
    }
}

/// How much an island with slow parts grows from kick to kick; `None`: it has none. Where it does grow, why they
/// cannot be slow.
pub(super) fn certify(island: &Assembled) -> Result<Option<Growth>, String> {
    let bodies = &island.isle.bodies;
    if !bodies.iter().any(|body| matches!(body, Inside::Slow(_))) {
        return Ok(None);
    }
    let growth = macrostep::growth(&island.isle);
    if growth.is_stable() {
        return Ok(Some(growth));
    }
    Err(format!(
        "what touches it is too stiff for kicks at that rate: it would grow by {:.3} from kick to kick",
        growth.radius
    ))
}

/// What slow parts change of the sound [dB], and over how long [s]: an island is played beside the same with kicks at
/// every frame. `None` where that would take long.
pub(super) fn error(
    subset: &Subset,
    own: &Own,
    budget: &Budget,
    island: &Assembled,
    memo: &Memo<'_>,
) -> Result<Option<Measured>, Error> {
    let ways = island.ways();
    let (times, steps) = (island.isle.times, island.isle.steps);
    let how = (times, Ways::As(&ways));
    let slow = Assembled::new(subset, own, budget, how, None, memo)?;
    let single = Subset {
        network: subset.network.with_every(|_, _| Some(1)),
        ..subset.clone()
    };
    let Ok(single) = Assembled::new(&single, own, budget, how, None, memo) else {
        return Ok(None);
    };
    let n_frames = length(&slow.isle)?;
    if n_frames == 0 || !is_worth(&single.isle, n_frames) {
        return Ok(None);
    }
    let spans = Spans::of(&slow.isle, n_frames);
    let pair = [&slow, &single].map(|island| play(&island.isle, steps, n_frames));
    let [slow, single] = pair;
    let db = difference(&slow?.sound, &single?.sound, &spans);
    let over = n_frames as f64 / spans.rate;
    Ok(db.is_finite().then_some(Measured {
        db,
        over,
        spectral: None,
    }))
}

/// How sure a certificate is of an island whose other links say `word`.
pub(super) fn word(growth: Growth, word: Word) -> Word {
    if growth.is_tried { Word::Tried } else { word }
}
