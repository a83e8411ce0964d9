//! A pilot: the beginning of an island's music, played to see what it needs.
//!
//! It lasts until a while after the first contact, or after the first event where nothing touches. From it follow how
//! finely contacts are computed (the same stretch at S and 2S: what differs is the error), which modes of a body
//! this score excites, and how often a frame the whole island is stepped (again by what differs).

use super::Isle;
use super::assemble::Assembled;
use super::budget::Budget;
use super::choice::Choice;
use super::mesh::Ways;
use super::row;
use super::search::{Search, Standing};
use super::truncate::{Kept, choose};
use crate::island::inside::Inside;
use crate::island::modal::Modal;
use crate::island::{Island, OnFault, Options};
use crate::kernel::crew::Crew;
use crate::maths::{log10, pow, sqrt};
use crate::network::{Error, LinkKind, Run};

/// How long after the first contact [s]: long enough to hear it, short enough to cost nothing.
const AFTER: f64 = 0.3;
/// No contact until then: there is nothing to learn of contacts [s].
const LONGEST: f64 = 10.0;
/// A pilot that would take longer than this is not played [s].
const WORTH: f64 = 0.5;
/// The search for how finely contacts are computed begins here.
const LEAST: usize = 2;
/// An island is stepped at most so often a frame.
pub(super) const TIMES_MAX: u32 = 8;
/// So often fewer modes are tried, each time quieter ones by at least so much [dB].
const TRIES: usize = 4;
const QUIETER: f64 = 2.0;
/// Frames between two looks at the modes.
const LOOK: usize = 64;
/// Error of a contact falls with the square of the step at best, with its first power where damping jumps.
pub(super) const ORDERS: (f64, f64) = (1.0, 2.0);
/// By so much an error of order 1 falls with a doubling [dB].
const DOUBLING: f64 = 6.02;

/// An island with what its budget asks for, and the error that is left: [dB], over so many seconds from the start.
pub(super) struct Found {
    pub(super) island: Assembled,
    pub(super) error: Option<(f64, f64)>,
}

/// One way through the beginning.
pub(super) struct Take {
    /// (n_frames · n_out)
    pub(super) sound: Vec<f64>,
    /// Square of the amplitude that each mode of each body reached.
    pub(super) squares: Vec<Vec<f64>>,
    /// A part went beyond all bounds.
    pub(super) is_lost: bool,
}

/// What a plan decided before; `None` where it does not fit.
pub(super) fn pinned(island: Assembled, pin: &Choice) -> Option<Found> {
    if pin.kept.len() != island.bodies.len() {
        return None;
    }
    let pairs = pin.kept.iter().zip(&island.isle.bodies);
    let kept = pairs.map(|(kept, body)| match body {
        Inside::Modal(modal) => Kept::pinned(kept, modal.modes.len()),
        Inside::Mesh(_) | Inside::Slow(_) => Some(Kept::none()),
    });
    let kept = kept.collect::<Option<Vec<_>>>()?;
    Some(Found {
        island: island.only(pin.steps.clamp(1, Budget::STEPS_MAX), kept),
        error: None,
    })
}

/// The cheapest island within the budget; `assemble` puts it together at some times the rate.
pub(super) fn pilot(
    assemble: &impl Fn((u32, Ways<'_>)) -> Result<Assembled, Error>,
    budget: &Budget,
) -> Result<Found, Error> {
    if let Budget::Method(_) = budget {
        let island = assemble((1, Ways::Budget))?;
        return Ok(Found {
            island,
            error: None,
        });
    }
    let island = first(assemble)?;
    let timeline = &island.isle.timeline;
    if timeline.is_open || timeline.hands().next().is_some() {
        // Nobody knows beforehand what a hand or a session will do: nothing is left out.
        return Ok(Found {
            island,
            error: None,
        });
    }
    let times = island.isle.times;
    let n_frames = length(&island.isle)?;
    if n_frames == 0 {
        return Ok(Found {
            island,
            error: None,
        });
    }
    let seconds = n_frames as f64 * f64::from(times) / island.isle.timeline.rate.hertz();
    let found = contacts(&island.isle, budget, n_frames)?;
    let search = Search {
        assemble,
        spans: Spans::of(&island.isle, n_frames),
        once: found.steps * times as usize,
        n_frames,
    };
    let Some(finer) = search.finer(&island) else {
        let error = found.error.map(|db| (db, seconds));
        let island = fewer(&island, &found, n_frames, budget)?;
        return Ok(Found { island, error });
    };
    let start = search.hold(island, found.take, &finer, None, None)?;
    let mut best = search.climb(start, budget)?;
    if best.take.is_lost
        && let Ok(island) = assemble((1, Ways::Safe))
    {
        let steps = search.once;
        let take = play(&island.isle, steps, n_frames)?;
        if !take.is_lost {
            best = Standing {
                island,
                steps,
                take,
                own: f64::NAN,
                ..best
            };
        }
    }
    // What is lost, or by what cannot be lost, was held against nothing.
    let own = Some(best.own).filter(|own| own.is_finite());
    let error = own.map(|own| (own.max(found.error.unwrap_or(f64::NEG_INFINITY)), seconds));
    let found = Contacts {
        steps: best.steps,
        error: found.error,
        take: best.take,
    };
    Ok(Found {
        island: fewer(&best.island, &found, n_frames, budget)?,
        error,
    })
}

/// An island at the lowest rate at which it is stable.
fn first(
    assemble: &impl Fn((u32, Ways<'_>)) -> Result<Assembled, Error>,
) -> Result<Assembled, Error> {
    match assemble((1, Ways::Budget)) {
        // Where it diverges at this rate it may not at a higher one.
        Err(error @ Error::Unstable { .. }) => {
            let higher = [2, 4, 8, 2 * TIMES_MAX].into_iter();
            let mut stable = higher.filter_map(|times| assemble((times, Ways::Budget)).ok());
            stable.next().ok_or(error)
        }
        other => other,
    }
}

/// An island without the modes that are not heard: those that energies tell, then tested by ear.
fn fewer(
    island: &Assembled,
    found: &Contacts,
    n_frames: usize,
    budget: &Budget,
) -> Result<Assembled, Error> {
    let with = |allowed: Option<f64>| {
        let bodies = island.isle.bodies.iter().zip(&found.take.squares);
        let kept = bodies.map(|(body, squares)| match body {
            Inside::Modal(modal) => keep(&island.isle, modal, squares, allowed, budget),
            Inside::Mesh(_) | Inside::Slow(_) => Kept::none(),
        });
        island.clone().only(found.steps, kept.collect())
    };
    let count = |island: &Assembled| island.isle.bodies.iter().map(modes).sum::<usize>();
    let Some(most) = budget.left_out() else {
        return Ok(with(None));
    };
    if !is_worth(&island.isle, 2 * n_frames) {
        return Ok(with(Some(most)));
    }
    // What nobody can hear is no error.
    let all = with(None);
    let sound = if count(&all) == count(island) {
        found.take.sound.clone()
    } else {
        play(&all.isle, found.steps, n_frames)?.sound
    };
    let spans = Spans::of(&island.isle, n_frames);
    let mut allowed = most;
    for _ in 0..TRIES {
        let mut fewer = with(Some(allowed));
        if count(&fewer) == count(&all) {
            break;
        }
        let take = play(&fewer.isle, found.steps, n_frames)?;
        let loud = difference(&take.sound, &sound, &spans);
        if loud <= most {
            let bodies = fewer.bodies.iter_mut();
            bodies.for_each(|body| body.left_out = body.left_out.map(|_| loud));
            return Ok(fewer);
        }
        allowed -= (loud - most).max(QUIETER);
    }
    Ok(all)
}

/// How finely contacts are computed: as finely as it takes for twice as often to make no difference.
struct Contacts {
    steps: usize,
    error: Option<f64>,
    take: Take,
}

fn contacts(isle: &Isle, budget: &Budget, n_frames: usize) -> Result<Contacts, Error> {
    if isle.steps == 1 {
        let take = play(isle, 1, n_frames)?;
        return Ok(Contacts {
            steps: 1,
            error: None,
            take,
        });
    }
    let aim = budget.contact();
    let spans = Spans::of(isle, n_frames);
    // Where a contact with damping closes its force jumps.
    let jumps = |run: &Run| matches!(run.kind, LinkKind::But(_)) && run.z != 0.0;
    let order = if isle.network.runs().iter().any(jumps) {
        ORDERS.0
    } else {
        ORDERS.1
    };
    let mut steps = LEAST;
    let mut take = play(isle, steps, n_frames)?;
    // Once a frame tells how fast the error falls; it is no choice, for it may diverge.
    let once = difference(&play(isle, 1, n_frames)?.sound, &take.sound, &spans);
    let mut last = Some(once).filter(|change| change.is_finite());
    loop {
        let finer = play(isle, 2 * steps, n_frames)?;
        let change = difference(&take.sound, &finer.sound, &spans);
        let (own, left) = errors(change, last, order);
        last = Some(change);
        if own <= aim {
            let error = Some(own);
            return Ok(Contacts { steps, error, take });
        }
        (steps, take) = (2 * steps, finer);
        if left <= aim || 2 * steps > Budget::STEPS_MAX {
            let error = Some(left);
            return Ok(Contacts { steps, error, take });
        }
    }
}

/// Seconds of work for a frame, by the table of costs.
fn work(isle: &Isle) -> f64 {
    let bodies: f64 = isle.bodies.iter().map(row::body_cost).sum();
    1e-9 * f64::from(isle.times) * (row::stepped_cost(&isle.network, &isle.timeline) + bodies)
}

pub(super) fn is_worth(isle: &Isle, n_frames: usize) -> bool {
    work(isle) * n_frames as f64 <= WORTH
}

/// How many frames a pilot takes; 0 where it would take long.
pub(super) fn length(isle: &Isle) -> Result<usize, Error> {
    let rate = isle.timeline.rate.hertz() / f64::from(isle.times);
    let most = ((WORTH / work(isle)) as usize).min((LONGEST * rate) as usize);
    let after = (AFTER * rate) as usize;
    if isle.steps > 1 {
        let mut island = island(isle, isle.steps)?;
        let mut sound = vec![0.0; LOOK * island.n_out()];
        for at in (0..most).step_by(LOOK) {
            // Faults are muted: a pilot says nothing of them.
            let _ = island.process(&mut sound, LOOK, &mut Crew::alone());
            if island.has_touched() {
                return Ok((at + after).min(most));
            }
        }
        // Nothing touches: what there is to hear is the rest.
    }
    let timeline = &isle.timeline;
    let gestures = timeline.gestures.iter().map(|gesture| gesture.start);
    let strikes = timeline.strikes.iter().map(|strike| strike.at);
    let ergons = timeline.ergons.iter().map(|ergon| ergon.at);
    let inside = isle.bodies.iter().map(|body| body.first_strike() / rate);
    let first = gestures.chain(strikes).chain(ergons).chain(inside);
    let first = first.fold(f64::INFINITY, f64::min);
    let first = if first.is_finite() {
        first.max(0.0)
    } else {
        0.0
    };
    let n_frames = ((first * rate).min(1e12) as usize).saturating_add(after);
    Ok(if n_frames <= most { n_frames } else { 0 })
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
        (steps, isle.times),
        options,
    )
}

/// How many modes a body goes by.
fn modes(body: &Inside) -> usize {
    match body {
        Inside::Modal(modal) => modal.modes.len(),
        Inside::Mesh(_) | Inside::Slow(_) => 0,
    }
}

pub(super) fn play(isle: &Isle, steps: usize, n_frames: usize) -> Result<Take, Error> {
    let mut island = island(isle, steps)?;
    let n_out = island.n_out();
    let mut sound = vec![0.0; n_frames * n_out];
    let mut squares: Vec<Vec<f64>> = isle
        .bodies
        .iter()
        .map(|body| vec![0.0; modes(body)])
        .collect();
    for sound in sound.chunks_mut((LOOK * n_out).max(1)) {
        let _ = island.process(sound, sound.len() / n_out.max(1), &mut Crew::alone());
        island.squares(&mut squares);
    }
    Ok(Take {
        sound,
        squares,
        is_lost: !island.muted().is_empty(),
    })
}

/// Errors of S and of 2S [dB] by what they differ by, and S/2 and S before them: a change that falls faster than
/// by the order `most` is luck, for it matters where between two instants a contact closes.
pub(super) fn errors(change: f64, last: Option<f64>, most: f64) -> (f64, f64) {
    let least = ORDERS.0;
    let believed = last.map_or(change, |last| change.max(last - most * DOUBLING));
    let order = last.map_or(least, |last| {
        ((last - believed) / DOUBLING).clamp(least, most)
    });
    let falls = pow(2.0, order);
    (
        believed + 20.0 * log10(falls / (falls - 1.0)),
        believed - 20.0 * log10(falls - 1.0),
    )
}

/// Where sounds are compared: from the start to a third of the time after the first event, to two thirds, to all.
pub(super) struct Spans {
    n_out: usize,
    frames: [usize; 3],
}

impl Spans {
    pub(super) fn of(isle: &Isle, n_frames: usize) -> Self {
        let rate = isle.timeline.rate.hertz() / f64::from(isle.times);
        let third = (AFTER / 3.0 * rate) as usize;
        Self {
            n_out: isle.network.outputs().len(),
            frames: [2, 1, 0].map(|thirds| n_frames.saturating_sub(thirds * third)),
        }
    }
}

/// ‖a − b‖ / ‖b‖ [dB] of the output and over the span where it is worst; that something stands aside is no sound.
pub(super) fn difference(a: &[f64], b: &[f64], spans: &Spans) -> f64 {
    let of = |output: usize, n_frames: usize| {
        let own = |x: &[f64]| -> Vec<f64> {
            let own = x.iter().skip(output).step_by(spans.n_out);
            own.take(n_frames).copied().collect()
        };
        let (a, b) = (own(a), own(b));
        let mean = b.iter().sum::<f64>() / b.len().max(1) as f64;
        let apart: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
        let whole: f64 = b.iter().map(|b| (b - mean) * (b - mean)).sum();
        if apart > 0.0 { apart / whole } else { 0.0 }
    };
    let all = (0..spans.n_out).flat_map(|output| spans.frames.map(|n| of(output, n)));
    20.0 * log10(sqrt(all.fold(0.0, f64::max)).max(1e-15))
}

/// The modes of a body that its outputs hear and its ports feel.
fn keep(isle: &Isle, body: &Modal, squares: &[f64], allowed: Option<f64>, budget: &Budget) -> Kept {
    let ports = body.ports.iter().map(|port| port.shape.as_slice());
    let heard = body.heard.iter().map(|(_, shape)| shape.as_slice());
    let rows: Vec<&[f64]> = ports.chain(heard).collect();
    let mut kept = choose(&ways(body, squares), &rows, allowed, budget, |mode| {
        body.frequency(mode)
    });
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

/// Ways that modes get their energies: what the pilot heard, and what may come after it. That is a strike on
/// every place that is struck at all, and a touch of a port that may not have been touched.
fn ways(body: &Modal, squares: &[f64]) -> Vec<Vec<f64>> {
    let by = |shape: &Vec<f64>| -> Vec<f64> {
        let each = shape.iter().enumerate();
        each.map(|(mode, share)| share * share * body.compliance(mode))
            .collect()
    };
    let is_told = body.ports.len() == 1 && squares.iter().any(|square| *square > 0.0);
    let ports = body.ports.iter().filter(|_| !is_told);
    let struck = body.struck.iter().map(|struck| by(&struck.shape));
    let touched = ports.map(|port| by(&port.shape));
    struck.chain(touched).chain([squares.to_vec()]).collect()
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
