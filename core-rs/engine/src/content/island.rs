//! Hashes of all that the sound of an island up to an instant depends on: the same in another version of the score
//! whose events differ only later, and in any score that has an equal island under other names or in another place.

use std::collections::BTreeSet;
use std::fmt::Arguments;

use super::{Hasher, digest, hex};
use crate::assembly::unit::IslandPlan;
use crate::gesture::script::Gesture;
use crate::island::bodies::BodyPlan;
use crate::network::{Network, PartOrder};
use crate::timeline::{Ergon, Key, Strike, Timeline};

/// Events within this many frames after an instant count as before it, because events are rounded to frames and strikes
/// are spread over two frames.
const ROUNDED_FRAMES: u64 = 4;

/// Hashes of what an island depends on: one of everything except strikes, ergons and gestures, and one of each gesture.
#[derive(Clone, Debug)]
struct EventHashes {
    static_hash: [u8; 32],
    /// The instant from which each gesture acts [s], and its hash   (n_gestures)
    gestures: Vec<(f64, [u8; 32])>,
}

impl EventHashes {
    /// `extra_content`: what else the hash has to include; `order`: the parts of the island.
    fn new(network: &Network, order: &PartOrder, timeline: &Timeline, extra_content: Arguments<'_>) -> Self {
        let network = network.anonymous(order);
        let timeline_keys = timeline.keys.iter();
        let fixed_timeline = Timeline {
            keys: timeline_keys
                .map(|key| Key {
                    name: String::new(),
                    ..*key
                })
                .collect(),
            gestures: Vec::new(),
            strikes: Vec::new(),
            ergons: Vec::new(),
            ..timeline.clone()
        };
        Self {
            static_hash: digest(format_args!("{network:?}\n{fixed_timeline:?}\n{extra_content}")),
            gestures: timeline
                .gestures
                .iter()
                .map(|gesture| gesture_content(gesture))
                .collect(),
        }
    }

    /// Hashes the fixed part, and the events that act after the instant `start` [s], if one is given, up to `stop` [s].
    fn hash(&self, timeline: &Timeline, (start, stop): (Option<f64>, f64), hasher: &mut Hasher) {
        let is_in_span = |instant: f64| instant <= stop && start.is_none_or(|start| instant > start);
        hasher.add(self.static_hash);
        // Gestures are identified by their index, so all gestures before the last one that counts are included.
        let last_begun = self.gestures.iter().rposition(|gesture_entry| gesture_entry.0 <= stop);
        for (_, digest) in &self.gestures[..last_begun.map_or(0, |last| last + 1)] {
            hasher.add(digest);
        }
        // Where a strike stands in the score does not affect the sound.
        for &Strike {
            instant,
            mat,
            n_parts,
            impulse,
            ..
        } in &timeline.strikes
        {
            if is_in_span(instant) {
                hasher.add(mat.to_le_bytes());
                hasher.add(instant.to_le_bytes());
                hasher.add(n_parts.to_le_bytes());
                hasher.add(impulse.to_le_bytes());
            }
        }
        hasher.add(b"ergons");
        for &Ergon {
            instant,
            mat,
            mass,
            speed,
            ..
        } in &timeline.ergons
        {
            if is_in_span(instant) {
                hasher.add(mat.to_le_bytes());
                for number in [instant, mass, speed] {
                    hasher.add(number.to_le_bytes());
                }
            }
        }
    }
}

/// Hashes of an island's parts and of each of its gestures.
#[derive(Clone, Debug)]
pub(crate) struct Content(EventHashes);

impl Content {
    pub(crate) fn new(island: &IslandPlan) -> Self {
        let IslandPlan {
            network,
            timeline,
            bodies,
            contact_substeps: _,
            contact_order: _,
            counted_cost: _,
            oversampling: _,
            frame_interval: _,
            stops_when_silent: sleeps,
            network_indices: _,
        } = island;
        let networks = bodies.iter().map(BodyPlan::network);
        let part_order = PartOrder::new(networks.chain([&**network]));
        let bodies: Vec<BodyPlan> = bodies
            .iter()
            .map(|body| body.without_strikes_and_names(&part_order))
            .collect();
        let numbers = (island.step_numbers(island.contact_substeps), sleeps);
        Self(EventHashes::new(
            network,
            &part_order,
            timeline,
            format_args!("{bodies:?}\n{numbers:?}"),
        ))
    }

    /// A hash of all that the island depends on up to frame `end_frame` of the scene (64 hex digits); `previous_hash`
    /// is that hash up to frame `start_frame`, empty at 0.
    pub(crate) fn hash_of_span(
        &self,
        island: &IslandPlan,
        (start_frame, end_frame): (u64, u64),
        previous_hash: &str,
    ) -> String {
        let oversampling = u64::from(island.oversampling);
        let frame_rate = island.timeline.rate.hertz();
        let [first_frame, last_frame] = [start_frame, end_frame].map(|frame| match frame {
            0 => 0,
            frame => (frame + ROUNDED_FRAMES) * oversampling,
        });
        let [start_instant, stop_instant] = [first_frame, last_frame].map(|frame| frame as f64 / frame_rate);
        let mut hasher = Hasher::new();
        hasher.add(previous_hash);
        hasher.add(end_frame.to_le_bytes());
        let start_instant = (start_frame > 0).then_some(start_instant);
        self.0
            .hash(&island.timeline, (start_instant, stop_instant), &mut hasher);
        for body in &island.bodies {
            hasher.add(b"body");
            let is_in_span = |frame: u64| frame <= last_frame && (start_frame == 0 || frame > first_frame);
            for (frame, point, strike_numbers) in body.strikes().filter(|strike| is_in_span(strike.0)) {
                hasher.add(frame.to_le_bytes());
                hasher.add((point as u64).to_le_bytes());
                for value in strike_numbers {
                    hasher.add(value.to_le_bytes());
                }
            }
        }
        hex(&hasher.finish())
    }
}

/// What an island depends on before it is assembled, whatever its plan will be.
pub(crate) struct IslandContent<'a> {
    timeline: &'a Timeline,
    events: EventHashes,
}

impl<'a> IslandContent<'a> {
    /// `extra_content`: what else its plan depends on.
    pub(crate) fn new(network: &Network, timeline: &'a Timeline, extra_content: Arguments<'_>) -> Self {
        // How an island is assembled depends on which MATs events act on, no matter when.
        let event_mats = (
            Vec::from_iter(
                timeline
                    .strikes
                    .iter()
                    .map(|timeline_event| timeline_event.mat)
                    .collect::<BTreeSet<_>>(),
            ),
            Vec::from_iter(
                timeline
                    .ergons
                    .iter()
                    .map(|timeline_event| timeline_event.mat)
                    .collect::<BTreeSet<_>>(),
            ),
        );
        let gestures = timeline.gestures.iter();
        let manners: BTreeSet<String> = gestures
            .map(|timeline_event| {
                format!(
                    "{} {:?}",
                    timeline_event.key,
                    (timeline_event.manner.touch, timeline_event.manner.force_max)
                )
            })
            .collect();
        let events = EventHashes::new(
            network,
            &PartOrder::new([network]),
            timeline,
            format_args!("{event_mats:?} {manners:?}\n{extra_content}"),
        );
        Self { timeline, events }
    }

    /// A hash of what does not depend on time (64 hex digits).
    pub(crate) fn static_hash(&self) -> String {
        let mut hasher = Hasher::new();
        hasher.add(self.events.static_hash);
        hex(&hasher.finish())
    }

    /// A hash of all that the island depends on up to a frame (64 hex digits).
    pub(crate) fn hash_until(&self, frame: u64) -> String {
        let mut hasher = Hasher::new();
        hasher.add(frame.to_le_bytes());
        let stop_instant = (frame + ROUNDED_FRAMES) as f64 / self.timeline.rate.hertz();
        self.events.hash(self.timeline, (None, stop_instant), &mut hasher);
        hex(&hasher.finish())
    }
}

/// When a gesture begins to act, and a hash of it.
fn gesture_content(gesture: &Gesture) -> (f64, [u8; 32]) {
    let Gesture {
        key,
        segments: stretches,
        start,
        last_position: exit,
        entry_knot: entry,
        manner,
        points,
    } = gesture;
    // Where a point stands in the score does not affect the sound.
    let instants: Vec<f64> = points.iter().map(|point| point.0).collect();
    (
        start - manner.join_seconds,
        digest(format_args!(
            "{key} {stretches:?} {start:?} {exit:?} {entry:?} {manner:?} {instants:?}"
        )),
    )
}
