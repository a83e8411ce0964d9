//! Timeline → voices: the written hands of an island.

use std::sync::Arc;

use super::inside::BodyPlan;
use super::origin::start;
use super::written_hand::framed::FramedGesture;
use super::written_hand::free::{FreeKey, FreeMotion};
use super::written_hand::voice::{Voice, VoiceScript};
use crate::gesture::script::Touch;
use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::timeline::{Drive, Key, Timeline};
use crate::units::{Rate, frame};

/// Links that join a MAT to other parts, each with the MAT at its other end.
fn outer_links(network: &Network, mat: usize) -> Vec<(usize, usize)> {
    let part = &network.mats().part;
    let mut linked = Vec::new();
    for run in network.runs() {
        if run.pairwise().is_some() {
            let links = (0..run.len).flat_map(|i| run.pairs(i).map(move |pair| (i, pair)));
            for (i, (a, b)) in links.filter(|&(_, (a, b))| a == mat || b == mat) {
                linked.push((run.first + i, if a == mat { b } else { a }));
            }
            continue;
        }
        for axis in 0..run.n_axes() {
            let (a, b) = run.pair(0, axis);
            for (end, other) in [(a, b), (b, a)] {
                if let Some(i) = mat.checked_sub(end).filter(|i| *i < run.len) {
                    linked.push((run.first + i, other + i));
                }
            }
        }
    }
    linked.retain(|&(_, other)| part[other] != part[mat]);
    linked
}

/// The gestures of a timeline at its rate.
pub(super) fn framed(timeline: &Timeline) -> Vec<FramedGesture> {
    let (rate, oversampling) = (timeline.rate.hertz(), timeline.oversampling);
    let gestures = timeline.gestures.iter();
    gestures
        .map(|gesture| FramedGesture::new(gesture, rate, oversampling))
        .collect()
}

/// The voices of all keys: one for the successive gestures of a key, and one for each gesture with `layer`.
pub(super) fn build_voices(
    network: &Network,
    timeline: &Timeline,
    gestures: &[FramedGesture],
    bodies: &[BodyPlan],
) -> Result<(Vec<VoiceScript>, Vec<Voice>), Error> {
    let mut scripts = Vec::new();
    let mut voices = Vec::new();
    for (key, known) in timeline.keys.iter().enumerate() {
        let (free, motion) = free_key(network, timeline, known, bodies)?;
        let mut ordered: Vec<usize> = (0..gestures.len())
            .filter(|&i| gestures[i].gesture.key == key)
            .collect();
        let start = |i: usize| gestures[i].gesture.start;
        ordered.sort_by(|&i, &j| start(i).total_cmp(&start(j)));
        for &i in &ordered {
            check_playable(&gestures[i], &free, known, timeline.rate)?;
        }
        let (layers, line): (Vec<usize>, Vec<usize>) = ordered
            .into_iter()
            .partition(|&i| gestures[i].gesture.manner.layer);
        let script = VoiceScript {
            key,
            struck: known.struck,
            free,
            gestures: line,
            layer: false,
            outer_links: outer_links(network, known.struck),
        };
        voices.push(Voice::new(&script, motion));
        scripts.push(script.clone());
        for gesture in layers {
            let layer = VoiceScript {
                free: script.free.deviation(),
                gestures: vec![gesture],
                layer: true,
                ..script.clone()
            };
            voices.push(Voice::new(&layer, layer.free.motion_at_rest()));
            scripts.push(layer);
        }
    }
    Ok((scripts, voices))
}

/// A free copy of a key's part, and its motion at frame 0. Refuses a key that cannot be struck.
pub(super) fn free_key(
    network: &Network,
    timeline: &Timeline,
    key: &Key,
    bodies: &[BodyPlan],
) -> Result<(FreeKey, FreeMotion), Error> {
    let mats = network.mats();
    if !mats.kind[key.struck].moves() {
        return Err(Error::Refused {
            module: network.mat_name(key.struck),
            message: "ergons of a key can only strike a MAS or a CEL".to_owned(),
        });
    }
    let part = mats.part[key.struck] as usize;
    // Links that close by the end are left out: a gesture is written for the key as it is in the end.
    let closing = timeline.gates.iter().filter(|gate| gate.closes());
    let key_network =
        network.part_alone(part, &closing.map(|gate| gate.links()).collect::<Vec<_>>());
    let inside = |mat: usize| key_network.mat(mat);
    let couplings = timeline.gates.iter().filter(|gate| !gate.is_ramp());
    for link in couplings.map(|gate| gate.link) {
        let run = network.run_of(link);
        if run.is_some_and(|run| inside(run.a).is_some() && inside(run.b).is_some()) {
            return Err(Error::Refused {
                module: network.link_name(link),
                message: "a coupling cannot join two modules of one key, because gestures are computed for the key \
                          with all its links; make this link a module of the key"
                    .to_owned(),
            });
        }
    }
    let drives: Vec<Drive> = timeline
        .drives
        .iter()
        .filter(|drive| drive.acts_on_free_key)
        .filter_map(|drive| {
            inside(drive.mat).map(|mat| Drive {
                mat,
                ..drive.clone()
            })
        })
        .collect();
    let scheme = Arc::new(Scheme::new(&key_network.network, timeline.rate)?);
    let body = start(
        &key_network.network,
        &scheme,
        &Timeline::new(timeline.rate),
        &drives,
        &|_| true,
    );
    let free = FreeKey {
        struck: inside(key.struck).unwrap_or(0),
        members: key_network.mats.iter().map(|&mat| mat as usize).collect(),
        slow: bodies
            .iter()
            .filter_map(|body| match body {
                BodyPlan::Slow(slow) if slow.part == part => Some(slow.alone(inside)),
                _ => None,
            })
            .collect(),
        scheme,
        drives,
    };
    let motion = free.start(body);
    Ok((free, motion))
}

/// Refuses a gesture that its key cannot play.
fn check_playable(
    gesture: &FramedGesture,
    free: &FreeKey,
    key: &Key,
    rate: Rate,
) -> Result<(), Error> {
    let manner = gesture.gesture.manner;
    let refuse = |message| {
        Err(Error::Refused {
            module: key.name.clone(),
            message,
        })
    };
    // No flight lasts longer than the gesture.
    let frames_max = gesture.last().saturating_sub(gesture.first);
    let flight = |grain: &f64| frame(*grain, rate.hertz()).min(frames_max);
    let is_long = |grain: &f64| free.is_past_quarter(flight(grain));
    if let Some(grain) = manner.grain.filter(is_long) {
        return refuse(format!(
            "a grain of {:.1} ms is longer than a quarter of the key's own period: between \
             ergons the key would swing back",
            1e3 * grain
        ));
    }
    if manner.layer && manner.touch == Touch::Tracked {
        return refuse("a gesture with `layer` cannot be tracked".to_owned());
    }
    Ok(())
}
