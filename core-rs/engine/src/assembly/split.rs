//! Distributes a timeline over the islands that its events act on.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use crate::network::Subset;
use crate::timeline::{DelayedPort, Drive, DriveSource, Ergon, Glide, Strike, Timeline};

/// The timeline of one island, and the indices of its keys and gestures in the whole network.
#[derive(Clone)]
pub(crate) struct LocalTimeline {
    pub(crate) timeline: Timeline,
    pub(crate) keys: Vec<u32>,
    pub(crate) gestures: Vec<u32>,
}

impl LocalTimeline {
    /// The same with one frame in place of `n_frames`; `None` if the timeline has no such version.
    pub(crate) fn with_lower_rate(&self, n_frames: u32) -> Option<Self> {
        Some(Self {
            timeline: self.timeline.with_lower_rate(n_frames)?,
            ..self.clone()
        })
    }
}

/// Where a module is: index of the subset, and its index there.
type LocalMat = (usize, usize);

/// Gives each subset its share of the timeline. Events on MATs in no subset are dropped.
pub(crate) fn split(subsets: Vec<Subset>, timeline: &Timeline) -> Vec<(Subset, LocalTimeline)> {
    let local_mats = find_local_mats(&subsets, timeline);
    let local_mats_of = |mat: u32| local_mats.get(&mat).map_or(&[][..], Vec::as_slice);
    let mut timelines: Vec<LocalTimeline> = subsets
        .iter()
        .map(|_| LocalTimeline {
            timeline: Timeline {
                is_open: timeline.is_open,
                is_unguarded: timeline.is_unguarded,
                ..Timeline::new(timeline.rate)
            },
            keys: Vec::new(),
            gestures: Vec::new(),
        })
        .collect();
    distribute_strikes(&timeline.strikes, &local_mats_of, &mut timelines, |timeline| {
        &mut timeline.strikes
    });
    distribute_strikes(&timeline.trial_strikes, &local_mats_of, &mut timelines, |timeline| {
        &mut timeline.trial_strikes
    });
    for ergon in &timeline.ergons {
        for &(subset_index, mat) in local_mats_of(ergon.mat) {
            let mat = mat as u32;
            timelines[subset_index].timeline.ergons.push(Ergon { mat, ..*ergon });
        }
    }
    for drive in &timeline.drives {
        for &(subset_index, mat) in local_mats_of(drive.mat as u32) {
            let drive = drive.clone();
            // The input is not known in advance: nothing is tried, and nothing left out.
            timelines[subset_index].timeline.is_open |= drive.is_sound_in();
            let source = match drive.source {
                DriveSource::Key(port) => {
                    let key_homes = local_mats_of(port.key as u32).iter();
                    let mut local_keys = key_homes.filter(|(subset, _)| *subset == subset_index);
                    let Some(&(_, key)) = local_keys.next() else {
                        continue;
                    };
                    DriveSource::Key(DelayedPort { key, ..port })
                }
                other => other,
            };
            timelines[subset_index]
                .timeline
                .drives
                .push(Drive { mat, source, ..drive });
        }
    }
    for glide in &timeline.glides {
        for &(subset_index, mat) in local_mats_of(glide.mat as u32) {
            let points = glide.points.clone();
            timelines[subset_index].timeline.glides.push(Glide { mat, points });
        }
    }
    for (index, key) in timeline.keys.iter().enumerate() {
        for &(subset_index, struck) in local_mats_of(key.struck_mat as u32) {
            timelines[subset_index].keys.push(index as u32);
            timelines[subset_index].timeline.add_key(&key.name, struck);
        }
    }
    for (index, gesture) in timeline.gestures.iter().enumerate() {
        for island_timeline in &mut timelines {
            let local_key = island_timeline.keys.iter().position(|&key| key as usize == gesture.key);
            if let Some(key) = local_key {
                let is_same_key = gesture.key == key;
                let gesture = if is_same_key {
                    gesture.clone()
                } else {
                    Arc::new((**gesture).clone().with_key(key))
                };
                island_timeline.timeline.gestures.push(gesture);
                island_timeline.gestures.push(index as u32);
            }
        }
    }
    for (subset, island_timeline) in subsets.iter().zip(&mut timelines) {
        for gate in &timeline.gates {
            if let Some((first_link, link_count)) = local_links(subset, gate.links()) {
                let island_gate = gate.on_links(first_link, link_count);
                island_timeline.timeline.gates.push(island_gate);
            }
        }
        for lead in &timeline.leads {
            if let Some((first_link, link_count)) = local_links(subset, lead.links()) {
                let island_lead = lead.on_links(first_link, link_count);
                island_timeline.timeline.leads.push(island_lead);
            }
        }
    }
    subsets.into_iter().zip(timelines).collect()
}

/// Adds strikes to a list of the timeline of each subset that has their MAT.
fn distribute_strikes<'a>(
    strikes: &[Strike],
    local_mats_of: &impl Fn(u32) -> &'a [LocalMat],
    timelines: &mut [LocalTimeline],
    strike_list: impl Fn(&mut Timeline) -> &mut Vec<Strike>,
) {
    for strike in strikes {
        for &(subset_index, mat) in local_mats_of(strike.mat) {
            let mat = mat as u32;
            strike_list(&mut timelines[subset_index].timeline).push(Strike { mat, ..*strike });
        }
    }
}

/// The links of a range that are in a subset: the first, and how many. Links rise, so these lie together.
pub(crate) fn local_links(subset: &Subset, links: Range<usize>) -> Option<(usize, usize)> {
    let local_index = |global: usize| {
        let links = &subset.links;
        links.partition_point(|&link| (link as usize) < global)
    };
    let (first_link, stop_link) = (local_index(links.start), local_index(links.end));
    (stop_link > first_link).then(|| (first_link, stop_link - first_link))
}

/// The homes of every MAT that an event acts on: one if it moves, any number if it is held.
fn find_local_mats(subsets: &[Subset], timeline: &Timeline) -> HashMap<u32, Vec<LocalMat>> {
    let all_strikes = timeline.strikes.iter().chain(&timeline.trial_strikes);
    let strike_mats = all_strikes.map(|strike| strike.mat);
    let ergon_mats = timeline.ergons.iter().map(|ergon| ergon.mat);
    let driven_mats = timeline.driven_mats().map(|mat| mat as u32);
    let struck_mats = timeline.keys.iter().map(|key| key.struck_mat as u32);
    let glided_mats = timeline.glides.iter().map(|glide| glide.mat as u32);
    let event_mats = strike_mats
        .chain(ergon_mats)
        .chain(driven_mats)
        .chain(struck_mats)
        .chain(glided_mats);
    let mut local_mats: HashMap<u32, Vec<LocalMat>> = event_mats.map(|mat| (mat, Vec::new())).collect();
    for (index, subset) in subsets.iter().enumerate() {
        for (local, mat) in subset.mats.iter().enumerate() {
            if let Some(mat_homes) = local_mats.get_mut(mat) {
                mat_homes.push((index, local));
            }
        }
    }
    local_mats
}
