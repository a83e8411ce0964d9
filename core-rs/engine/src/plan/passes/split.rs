//! Distributes a timeline over the islands that its events act on.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use crate::network::Subset;
use crate::timeline::{DelayedPort, Drive, Ergon, Glide, Source, Strike, Timeline};

/// The timeline of one island, and the indices of its keys and gestures in the whole network.
#[derive(Clone)]
pub(in crate::plan) struct OwnTimeline {
    pub(in crate::plan) timeline: Timeline,
    pub(in crate::plan) keys: Vec<u32>,
    pub(in crate::plan) gestures: Vec<u32>,
}

impl OwnTimeline {
    /// The same with one frame for `every` of these; `None` if the timeline has no such version.
    pub(in crate::plan) fn slower(&self, every: u32) -> Option<Self> {
        Some(Self {
            timeline: self.timeline.slower(every)?,
            ..self.clone()
        })
    }
}

/// Where a module is: index of the subset, and its index there.
type Home = (usize, usize);

/// Gives each subset its share of the timeline. Events on MATs in no subset are dropped.
pub(in crate::plan) fn split(
    subsets: Vec<Subset>,
    timeline: &Timeline,
) -> Vec<(Subset, OwnTimeline)> {
    let homes = homes(&subsets, timeline);
    let home = |mat: u32| homes.get(&mat).map_or(&[][..], Vec::as_slice);
    let mut timelines: Vec<OwnTimeline> = subsets
        .iter()
        .map(|_| OwnTimeline {
            timeline: Timeline {
                is_open: timeline.is_open,
                is_unguarded: timeline.is_unguarded,
                ..Timeline::new(timeline.rate)
            },
            keys: Vec::new(),
            gestures: Vec::new(),
        })
        .collect();
    for strike in &timeline.strikes {
        for &(subset_index, mat) in home(strike.mat) {
            let mat = mat as u32;
            timelines[subset_index]
                .timeline
                .strikes
                .push(Strike { mat, ..*strike });
        }
    }
    for ergon in &timeline.ergons {
        for &(subset_index, mat) in home(ergon.mat) {
            let mat = mat as u32;
            timelines[subset_index]
                .timeline
                .ergons
                .push(Ergon { mat, ..*ergon });
        }
    }
    for drive in &timeline.drives {
        for &(subset_index, mat) in home(drive.mat as u32) {
            let drive = drive.clone();
            // The input is not known in advance: nothing is tried, and nothing left out.
            timelines[subset_index].timeline.is_open |= drive.is_heard();
            let source = match drive.source {
                Source::Key(port) => {
                    let here = home(port.key as u32).iter();
                    let mut keys = here.filter(|(subset, _)| *subset == subset_index);
                    let Some(&(_, key)) = keys.next() else {
                        continue;
                    };
                    Source::Key(DelayedPort { key, ..port })
                }
                other => other,
            };
            timelines[subset_index].timeline.drives.push(Drive {
                mat,
                source,
                ..drive
            });
        }
    }
    for glide in &timeline.glides {
        for &(subset_index, mat) in home(glide.mat as u32) {
            let points = glide.points.clone();
            timelines[subset_index]
                .timeline
                .glides
                .push(Glide { mat, points });
        }
    }
    for (index, key) in timeline.keys.iter().enumerate() {
        for &(subset_index, struck) in home(key.struck as u32) {
            timelines[subset_index].keys.push(index as u32);
            timelines[subset_index].timeline.key(&key.name, struck);
        }
    }
    for (index, gesture) in timeline.gestures.iter().enumerate() {
        for timelines in &mut timelines {
            let here = timelines
                .keys
                .iter()
                .position(|&key| key as usize == gesture.key);
            if let Some(key) = here {
                let same = gesture.key == key;
                let gesture = if same {
                    gesture.clone()
                } else {
                    Arc::new((**gesture).clone().on_key(key))
                };
                timelines.timeline.gestures.push(gesture);
                timelines.gestures.push(index as u32);
            }
        }
    }
    for (subset, timelines) in subsets.iter().zip(&mut timelines) {
        for gate in &timeline.gates {
            if let Some((first, len)) = local_links(subset, gate.links()) {
                timelines.timeline.gates.push(gate.on(first, len));
            }
        }
        for lead in &timeline.leads {
            if let Some((first, len)) = local_links(subset, lead.links()) {
                timelines.timeline.leads.push(lead.on(first, len));
            }
        }
    }
    subsets.into_iter().zip(timelines).collect()
}

/// The links of a range that are in a subset: the first, and how many. Links rise, so these lie together.
pub(in crate::plan) fn local_links(subset: &Subset, links: Range<usize>) -> Option<(usize, usize)> {
    let local = |global: usize| {
        let links = &subset.links;
        links.partition_point(|&link| (link as usize) < global)
    };
    let (first, stop) = (local(links.start), local(links.end));
    (stop > first).then(|| (first, stop - first))
}

/// The homes of every MAT that an event acts on: one if it moves, any number if it is held.
fn homes(subsets: &[Subset], timeline: &Timeline) -> HashMap<u32, Vec<Home>> {
    let strikes = timeline.strikes.iter().map(|strike| strike.mat);
    let ergons = timeline.ergons.iter().map(|ergon| ergon.mat);
    let drives = timeline.driven().map(|mat| mat as u32);
    let keys = timeline.keys.iter().map(|key| key.struck as u32);
    let glides = timeline.glides.iter().map(|glide| glide.mat as u32);
    let all = strikes
        .chain(ergons)
        .chain(drives)
        .chain(keys)
        .chain(glides);
    let mut homes: HashMap<u32, Vec<Home>> = all.map(|mat| (mat, Vec::new())).collect();
    for (index, subset) in subsets.iter().enumerate() {
        for (local, mat) in subset.mats.iter().enumerate() {
            if let Some(homes) = homes.get_mut(mat) {
                homes.push((index, local));
            }
        }
    }
    homes
}
