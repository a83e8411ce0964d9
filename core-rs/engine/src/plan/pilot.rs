//! A pilot: the beginning of an island's music, played to see what it needs.
//!
//! It lasts until a while after the first contact. From it follow how finely contacts are computed (the same
//! stretch at S and 2S: what differs is the error), and which modes of a body this score excites.

use super::budget::Budget;
use super::choice::Choice;
use super::truncate::{Kept, choose};
use super::{Isle, row};
use crate::island::modal::Modal;
use crate::island::{Island, OnFault, Options};
use crate::maths::{log10, pow, sqrt};
use crate::network::{Error, LinkKind};

/// How long after the first contact [s]: long enough to hear it, short enough to cost nothing.
const AFTER: f64 = 0.3;
/// No contact until then: there is nothing to learn [s].
const LONGEST: f64 = 10.0;
/// A pilot that would take longer than this is not played [s].
const WORTH: f64 = 0.5;
/// The search for how finely contacts are computed begins here.
const LEAST: usize = 2;
/// Frames between two looks at the modes.
const LOOK: usize = 64;
/// Error of a contact falls with the square of the step: what S and 2S differ by is so much more than the
/// error of 2S.
const RICHARDSON: f64 = 3.0;

/// What a pilot says.
pub(super) struct Pilot {
    /// How often a frame contacts are to be computed.
    pub(super) steps: usize,
    /// The error that is left [dB], over so many seconds from the start.
    pub(super) error: Option<(f64, f64)>,
    /// For each body the modes that stay.
    pub(super) kept: Vec<Kept>,
}

impl Pilot {
    /// What a plan decided before; `None` where it does not fit.
    pub(super) fn pinned(pin: &Choice, bodies: &[Modal]) -> Option<Self> {
        if pin.kept.len() != bodies.len() {
            return None;
        }
        let pairs = pin.kept.iter().zip(bodies);
        let kept = pairs.map(|(kept, body)| Kept::pinned(kept, body.modes.len()));
        Some(Self {
            steps: pin.steps.clamp(1, Budget::STEPS_MAX),
            error: None,
            kept: kept.collect::<Option<Vec<_>>>()?,
        })
    }
}

/// One way through the beginning.
struct Take {
    /// (n_frames · n_out)
    sound: Vec<f64>,
    /// Square of the amplitude that each mode of each body reached.
    squares: Vec<Vec<f64>>,
}

/// Play the beginning of an island; `None` where that would take long, or nothing touches.
pub(super) fn pilot(isle: &Isle, budget: &Budget) -> Result<Option<Pilot>, Error> {
    let rate = isle.timeline.rate.hertz();
    let bodies: f64 = isle.bodies.iter().map(row::body_cost).sum();
    let frame = 1e-9 * (row::stepped_cost(&isle.network, &isle.timeline) + bodies);
    let most = ((WORTH / frame) as usize).min((LONGEST * rate) as usize);
    let aim = budget.contact();
    if isle.steps == 1 {
        return Ok(None);
    }
    let Some(n_frames) = first_contact(isle, most)? else {
        return Ok(None);
    };
    let (mut steps, mut error) = (LEAST, None);
    let mut before = play(isle, steps, n_frames)?;
    while steps < Budget::STEPS_MAX {
        let after = play(isle, 2 * steps, n_frames)?;
        let left = difference(&before.sound, &after.sound) - 20.0 * log10(RICHARDSON);
        // What S differs from the truth by is four thirds of what it differs from 2S by.
        let own = left + 20.0 * log10(4.0);
        if own <= aim {
            error = Some((own, n_frames as f64 / rate));
            break;
        }
        steps *= 2;
        error = Some((left, n_frames as f64 / rate));
        before = after;
        if left <= aim {
            break;
        }
    }
    let kept = isle.bodies.iter().zip(&before.squares);
    let kept = kept.map(|(body, squares)| keep(isle, body, squares, budget));
    Ok(Some(Pilot {
        steps,
        error,
        kept: kept.collect(),
    }))
}

fn island(isle: &Isle, steps: usize) -> Result<Island, Error> {
    let options = Options {
        ledger: false,
        record: false,
        on_fault: OnFault::Mute,
        threads: 1,
        unchecked: true,
    };
    Island::new(
        isle.network.clone(),
        &isle.timeline,
        &isle.bodies,
        steps,
        options,
    )
}

/// How many frames there are up to a while after the first contact.
fn first_contact(isle: &Isle, most: usize) -> Result<Option<usize>, Error> {
    let mut island = island(isle, isle.steps)?;
    let mut sound = vec![0.0; LOOK * island.n_out()];
    let after = (AFTER * isle.timeline.rate.hertz()) as usize;
    for at in (0..most).step_by(LOOK) {
        // Faults are muted: a pilot says nothing of them.
        let _ = island.process(&mut sound, LOOK);
        if island.has_touched() {
            return Ok(Some((at + after).min(most)));
        }
    }
    Ok(None)
}

fn play(isle: &Isle, steps: usize, n_frames: usize) -> Result<Take, Error> {
    let mut island = island(isle, steps)?;
    let n_out = island.n_out();
    let mut sound = vec![0.0; n_frames * n_out];
    let mut squares: Vec<Vec<f64>> = isle
        .bodies
        .iter()
        .map(|body| vec![0.0; body.modes.len()])
        .collect();
    for sound in sound.chunks_mut((LOOK * n_out).max(1)) {
        let _ = island.process(sound, sound.len() / n_out.max(1));
        island.squares(&mut squares);
    }
    Ok(Take { sound, squares })
}

/// ‖a − b‖ / ‖b‖ [dB].
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let apart: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    let whole: f64 = b.iter().map(|b| b * b).sum();
    20.0 * log10(sqrt(apart / whole.max(f64::MIN_POSITIVE)).max(1e-15))
}

/// The modes of a body that its outputs hear and its ports feel.
fn keep(isle: &Isle, body: &Modal, squares: &[f64], budget: &Budget) -> Kept {
    let ports = body.ports.iter().map(|port| port.shape.as_slice());
    let heard = body.heard.iter().map(|(_, shape)| shape.as_slice());
    let rows: Vec<&[f64]> = ports.chain(heard).collect();
    let mut kept = choose(squares, &rows, budget, |mode| body.frequency(mode));
    let Some(db) = budget.left_out() else {
        return kept;
    };
    // Modes that fall no longer give way: as long as a contact does not notice.
    let enough = pow(10.0, db / 20.0);
    let mut fallen: Vec<usize> = (0..body.modes.len())
        .filter(|mode| kept.modes.binary_search(mode).is_err())
        .collect();
    for port in &body.ports {
        let stiff = stiffest(isle, port.mat);
        let give =
            |mode: usize| stiff * port.shape[mode] * port.shape[mode] * body.compliance(mode);
        let mut lost: f64 = fallen.iter().map(|&mode| give(mode)).sum();
        // The lowest give most.
        fallen.retain(|&mode| {
            if lost <= enough {
                return true;
            }
            lost -= give(mode);
            kept.modes.push(mode);
            false
        });
    }
    kept.modes.sort_unstable();
    kept
}

/// Stiffness of the stiffest link on a MAT [N/m].
fn stiffest(isle: &Isle, mat: usize) -> f64 {
    let runs = isle.network.runs().iter();
    let on = runs.filter(|run| {
        [run.a, run.b]
            .iter()
            .any(|&end| (end..end + run.len).contains(&mat))
    });
    on.map(|run| match &run.kind {
        LinkKind::Lnl(law) => law.slope(0.0).abs(),
        _ => run.k,
    })
    .fold(0.0, f64::max)
}
