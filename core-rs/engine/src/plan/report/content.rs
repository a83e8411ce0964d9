//! Hashes of all that the sound of an island up to an instant depends on: the same in another version of the score
//! whose events differ only later, and in any score that has an equal island under other names or in another place.

use std::collections::BTreeSet;
use std::fmt::{self, Arguments, Write};

use sha2::{Digest, Sha256};

use crate::gesture::script::Gesture;
use crate::island::inside::BodyPlan;
use crate::network::{Network, PartOrder};
use crate::plan::IslandPlan;
use crate::plan::constants::ROUNDED_FRAMES;
use crate::timeline::{Ergon, Key, Strike, Timeline};

/// A writer that hashes what is written.
pub(super) struct Sink(Sha256);

impl Sink {
    pub(super) fn new() -> Self {
        Self(Sha256::new())
    }

    pub(super) fn add(&mut self, bytes: impl AsRef<[u8]>) {
        self.0.update(bytes);
    }

    pub(super) fn end(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

impl Write for Sink {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text);
        Ok(())
    }
}

/// A hash of formatted text (64 hex digits).
pub(crate) fn hex_of(words: Arguments<'_>) -> String {
    hex(&digest(words))
}

/// The hex digits of a hash.
pub(in crate::plan) fn hex(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Hashes of what an island depends on: one of everything except strikes, ergons and gestures, and one of each gesture.
#[derive(Clone, Debug)]
struct Events {
    fixed: [u8; 32],
    /// The instant from which each gesture acts [s], and its hash   (n_gestures)
    gestures: Vec<(f64, [u8; 32])>,
}

impl Events {
    /// `also`: what else the hash has to include; `order`: the parts of the island.
    fn new(network: &Network, order: &PartOrder, timeline: &Timeline, also: Arguments<'_>) -> Self {
        let network = network.anonymous(order);
        let keys = timeline.keys.iter();
        let rest = Timeline {
            keys: keys
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
            fixed: digest(format_args!("{network:?}\n{rest:?}\n{also}")),
            gestures: timeline
                .gestures
                .iter()
                .map(|own| gesture_content(own))
                .collect(),
        }
    }

    /// Hashes the fixed part, and the events that act after the instant `start` [s], if one is given, up to `stop` [s].
    fn hash(&self, timeline: &Timeline, (start, stop): (Option<f64>, f64), sink: &mut Sink) {
        let falls = |instant: f64| instant <= stop && start.is_none_or(|start| instant > start);
        sink.0.update(self.fixed);
        // Gestures are identified by their index, so all gestures before the last one that counts are included.
        let begun = self.gestures.iter().rposition(|own| own.0 <= stop);
        for (_, digest) in &self.gestures[..begun.map_or(0, |last| last + 1)] {
            sink.0.update(digest);
        }
        // Where a strike stands in the score does not affect the sound.
        for &Strike {
            instant,
            mat,
            frames,
            impulse,
            ..
        } in &timeline.strikes
        {
            if falls(instant) {
                sink.0.update(mat.to_le_bytes());
                sink.0.update(instant.to_le_bytes());
                sink.0.update(frames.to_le_bytes());
                sink.0.update(impulse.to_le_bytes());
            }
        }
        sink.0.update(b"ergons");
        for &Ergon {
            instant,
            mat,
            mass,
            speed,
            ..
        } in &timeline.ergons
        {
            if falls(instant) {
                sink.0.update(mat.to_le_bytes());
                for number in [instant, mass, speed] {
                    sink.0.update(number.to_le_bytes());
                }
            }
        }
    }
}

/// Hashes of an island's parts and of each of its gestures.
#[derive(Clone, Debug)]
pub(crate) struct Content(Events);

impl Content {
    pub(crate) fn new(island: &IslandPlan) -> Self {
        let IslandPlan {
            network,
            timeline,
            bodies,
            contact_substeps,
            counted_cost: _,
            oversampling,
            every: _,
            sleeps,
            to_whole: _,
        } = island;
        let networks = bodies.iter().map(BodyPlan::network);
        let order = PartOrder::new(networks.chain([&**network]));
        let bodies: Vec<BodyPlan> = bodies.iter().map(|body| body.anonymous(&order)).collect();
        let numbers = (contact_substeps, oversampling, sleeps);
        Self(Events::new(
            network,
            &order,
            timeline,
            format_args!("{bodies:?}\n{numbers:?}"),
        ))
    }

    /// A hash of all that the island depends on up to frame `until` of the scene (64 hex digits); `before` is that hash
    /// up to frame `from`, empty at 0.
    pub(crate) fn key(
        &self,
        island: &IslandPlan,
        (from, until): (u64, u64),
        before: &str,
    ) -> String {
        let oversampling = u64::from(island.oversampling);
        let rate = island.timeline.rate.hertz();
        let [first, last] = [from, until].map(|frame| match frame {
            0 => 0,
            frame => (frame + ROUNDED_FRAMES) * oversampling,
        });
        let [start, stop] = [first, last].map(|frame| frame as f64 / rate);
        let mut sink = Sink::new();
        sink.0.update(before);
        sink.0.update(until.to_le_bytes());
        let start = (from > 0).then_some(start);
        self.0.hash(&island.timeline, (start, stop), &mut sink);
        for body in &island.bodies {
            sink.0.update(b"body");
            let falls = |frame: u64| frame <= last && (from == 0 || frame > first);
            for (frame, point, values) in body.strikes().filter(|own| falls(own.0)) {
                sink.0.update(frame.to_le_bytes());
                sink.0.update((point as u64).to_le_bytes());
                for value in values {
                    sink.0.update(value.to_le_bytes());
                }
            }
        }
        hex(&sink.0.finalize())
    }
}

/// What an island depends on before it is assembled, whatever its plan will be.
pub(in crate::plan) struct IslandContent<'a> {
    timeline: &'a Timeline,
    events: Events,
}

impl<'a> IslandContent<'a> {
    /// `also`: what else its plan depends on.
    pub(in crate::plan) fn new(
        network: &Network,
        timeline: &'a Timeline,
        also: Arguments<'_>,
    ) -> Self {
        // How an island is assembled depends on which MATs events act on, no matter when.
        let places = (
            Vec::from_iter(
                timeline
                    .strikes
                    .iter()
                    .map(|own| own.mat)
                    .collect::<BTreeSet<_>>(),
            ),
            Vec::from_iter(
                timeline
                    .ergons
                    .iter()
                    .map(|own| own.mat)
                    .collect::<BTreeSet<_>>(),
            ),
        );
        let gestures = timeline.gestures.iter();
        let manners: BTreeSet<String> = gestures
            .map(|own| format!("{} {:?}", own.key, (own.manner.touch, own.manner.limit)))
            .collect();
        let events = Events::new(
            network,
            &PartOrder::new([network]),
            timeline,
            format_args!("{places:?} {manners:?}\n{also}"),
        );
        Self { timeline, events }
    }

    /// A hash of what does not depend on time (64 hex digits).
    pub(in crate::plan) fn fixed(&self) -> String {
        let mut sink = Sink::new();
        sink.0.update(self.events.fixed);
        hex(&sink.0.finalize())
    }

    /// A hash of all that the island depends on up to a frame (64 hex digits).
    pub(in crate::plan) fn until(&self, frame: u64) -> String {
        let mut sink = Sink::new();
        sink.0.update(frame.to_le_bytes());
        let stop = (frame + ROUNDED_FRAMES) as f64 / self.timeline.rate.hertz();
        self.events.hash(self.timeline, (None, stop), &mut sink);
        hex(&sink.0.finalize())
    }
}

/// When a gesture begins to act, and a hash of it.
fn gesture_content(gesture: &Gesture) -> (f64, [u8; 32]) {
    let Gesture {
        key,
        stretches,
        start,
        exit,
        entry,
        manner,
        points,
    } = gesture;
    // Where a point stands in the score does not affect the sound.
    let instants: Vec<f64> = points.iter().map(|point| point.0).collect();
    (
        start - manner.join,
        digest(format_args!(
            "{key} {stretches:?} {start:?} {exit:?} {entry:?} {manner:?} {instants:?}"
        )),
    )
}

pub(super) fn digest(text: Arguments<'_>) -> [u8; 32] {
    let mut sink = Sink::new();
    // Writing into a hash cannot fail.
    let _ = sink.write_fmt(text);
    sink.0.finalize().into()
}
