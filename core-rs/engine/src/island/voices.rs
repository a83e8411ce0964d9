//! Timeline → voices: the written hands of an island.

use std::sync::Arc;

use super::bodies::BodyPlan;
use super::origin::initial_motion;
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
    let mat_parts = &network.mats().part;
    let mut outer_links = Vec::new();
    for run in network.runs() {
        if run.pairwise().is_some() {
            let pair_links =
                (0..run.len).flat_map(|link_offset| run.pairs(link_offset).map(move |pair| (link_offset, pair)));
            for (link_offset, (first_mat, second_mat)) in
                pair_links.filter(|&(_, (first_mat, second_mat))| first_mat == mat || second_mat == mat)
            {
                outer_links.push((
                    run.first + link_offset,
                    if first_mat == mat { second_mat } else { first_mat },
                ));
            }
            continue;
        }
        for axis in 0..run.n_axes() {
            let (first_mat, second_mat) = run.pair(0, axis);
            for (near_end, far_end) in [(first_mat, second_mat), (second_mat, first_mat)] {
                if let Some(link_offset) = mat.checked_sub(near_end).filter(|link_offset| *link_offset < run.len) {
                    outer_links.push((run.first + link_offset, far_end + link_offset));
                }
            }
        }
    }
    outer_links.retain(|&(_, other_mat)| mat_parts[other_mat] != mat_parts[mat]);
    outer_links
}

/// The gestures of a timeline at its rate.
pub(super) fn framed_gestures(timeline: &Timeline) -> Vec<FramedGesture> {
    let (frame_rate, oversampling) = (timeline.rate.hertz(), timeline.oversampling);
    let gestures = timeline.gestures.iter();
    gestures
        .map(|gesture| FramedGesture::new(gesture, frame_rate, oversampling))
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
    for (key_index, played_key) in timeline.keys.iter().enumerate() {
        let (free_key, free_motion) = free_key(network, timeline, played_key, bodies)?;
        let mut ordered_gestures: Vec<usize> = (0..gestures.len())
            .filter(|&i| gestures[i].gesture.key == key_index)
            .collect();
        let start_time = |i: usize| gestures[i].gesture.start;
        ordered_gestures.sort_by(|&i, &j| start_time(i).total_cmp(&start_time(j)));
        for &i in &ordered_gestures {
            check_playable(&gestures[i], &free_key, played_key, timeline.rate)?;
        }
        let (layer_gestures, key_gestures): (Vec<usize>, Vec<usize>) = ordered_gestures
            .into_iter()
            .partition(|&i| gestures[i].gesture.manner.is_layer);
        let voice_script = VoiceScript {
            key_index,
            struck_mat: played_key.struck_mat,
            free_key,
            gesture_indices: key_gestures,
            is_layer: false,
            outer_links: outer_links(network, played_key.struck_mat),
        };
        voices.push(Voice::new(&voice_script, free_motion));
        scripts.push(voice_script.clone());
        for gesture_index in layer_gestures {
            let layer_script = VoiceScript {
                free_key: voice_script.free_key.layer_key(),
                gesture_indices: vec![gesture_index],
                is_layer: true,
                ..voice_script.clone()
            };
            voices.push(Voice::new(&layer_script, layer_script.free_key.motion_at_rest()));
            scripts.push(layer_script);
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
    if !mats.kind[key.struck_mat].moves() {
        return Err(Error::Refused {
            module: network.mat_name(key.struck_mat),
            message: "ergons of a key can only strike a MAS or a CEL".to_owned(),
        });
    }
    let key_part = mats.part[key.struck_mat] as usize;
    // Links that close by the end are left out: a gesture is written for the key as it is in the end.
    let closing_gates = timeline.gates.iter().filter(|gate| gate.ends_closed());
    let key_network = network.subset_of_part(key_part, &closing_gates.map(|gate| gate.links()).collect::<Vec<_>>());
    let key_mat = |mat: usize| key_network.mat(mat);
    let couplings = timeline.gates.iter().filter(|gate| gate.has_schedule());
    for link in couplings.map(|gate| gate.first_link) {
        let link_run = network.run_of(link);
        if link_run.is_some_and(|link_run| key_mat(link_run.a).is_some() && key_mat(link_run.b).is_some()) {
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
        .filter_map(|drive| key_mat(drive.mat).map(|mat| Drive { mat, ..drive.clone() }))
        .collect();
    let scheme = Arc::new(Scheme::new(&key_network.network, timeline.rate)?);
    let modules = initial_motion(
        &key_network.network,
        &scheme,
        &Timeline::new(timeline.rate),
        &drives,
        &|_| true,
    );
    let free_key = FreeKey {
        struck_mat: key_mat(key.struck_mat).unwrap_or(0),
        scene_mats: key_network.mats.iter().map(|&mat| mat as usize).collect(),
        slow_bodies: bodies
            .iter()
            .filter_map(|body| match body {
                BodyPlan::Slow(slow) if slow.part == key_part => Some(slow.in_free_key(key_mat)),
                _ => None,
            })
            .collect(),
        scheme,
        drives,
    };
    let free_motion = free_key.start_motion(modules);
    Ok((free_key, free_motion))
}

/// Refuses a gesture that its key cannot play.
fn check_playable(gesture: &FramedGesture, free_key: &FreeKey, key: &Key, rate: Rate) -> Result<(), Error> {
    let manner = gesture.gesture.manner;
    let refuse = |message| {
        Err(Error::Refused {
            module: key.name.clone(),
            message,
        })
    };
    // No flight lasts longer than the gesture.
    let frames_max = gesture.last_frame().saturating_sub(gesture.first_frame);
    let flight_frames = |grain: &f64| frame(*grain, rate.hertz()).min(frames_max);
    let is_past_quarter = |grain: &f64| free_key.is_past_quarter(flight_frames(grain));
    if let Some(grain) = manner.grain.filter(is_past_quarter) {
        return refuse(format!(
            "a grain of {:.1} ms is longer than a quarter of the key's own period: between \
             ergons the key would swing back",
            1e3 * grain
        ));
    }
    if manner.is_layer && manner.touch == Touch::Tracked {
        return refuse("a gesture with `layer` cannot be tracked".to_owned());
    }
    Ok(())
}
