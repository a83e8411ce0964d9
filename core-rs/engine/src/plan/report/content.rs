//! What the sound of an island up to an instant is a function of, as a hash: the same in another version of the score
//! whose events differ only later.

use std::fmt::Write;

use sha2::{Digest, Sha256};

use crate::gesture::script::Gesture;
use crate::island::inside::BodyPlan;
use crate::plan::IslandPlan;
use crate::plan::report::cache::Sink;
use crate::timeline::{Ergon, Strike, Timeline};

/// Events that act within so many frames after an instant count as before it: rounding to frames, and strikes that are
/// shared out to two frames.
const MARGIN: u64 = 4;

/// Hashes of an island's parts and of each of its gestures.
#[derive(Clone, Debug)]
pub(crate) struct Content {
    /// Of all but strikes, ergons and gestures.
    fixed: [u8; 32],
    /// Of each gesture, and the instant from which it acts [s]   (n_gestures)
    gestures: Vec<(f64, [u8; 32])>,
}

impl Content {
    pub(crate) fn of(island: &IslandPlan) -> Self {
        let IslandPlan {
            network,
            timeline,
            bodies,
            contact_substeps,
            oversampling,
            to_whole: _,
        } = island;
        let rest = Timeline {
            gestures: Vec::new(),
            strikes: Vec::new(),
            ergons: Vec::new(),
            ..timeline.clone()
        };
        let bodies: Vec<BodyPlan> = bodies.iter().map(BodyPlan::without_strikes).collect();
        let numbers = (contact_substeps, oversampling);
        Self {
            fixed: digest(format_args!(
                "{network:?}\n{rest:?}\n{bodies:?}\n{numbers:?}"
            )),
            gestures: timeline
                .gestures
                .iter()
                .map(|own| of_gesture(own))
                .collect(),
        }
    }

    /// A hash of what the island is a function of up to frame `until` of the scene (64 hex digits); `before` is that up to
    /// frame `from`, and empty at 0.
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
            frame => (frame + MARGIN) * oversampling,
        });
        let [start, stop] = [first, last].map(|frame| frame as f64 / rate);
        let falls = |at: f64| at <= stop && (from == 0 || at > start);
        let mut sink = Sink(Sha256::new());
        sink.0.update(before);
        sink.0.update(self.fixed);
        sink.0.update(until.to_le_bytes());
        // Gestures are known by their place in this list: those before one that counts do too.
        let begun = self.gestures.iter().rposition(|own| own.0 <= stop);
        for (_, digest) in &self.gestures[..begun.map_or(0, |last| last + 1)] {
            sink.0.update(digest);
        }
        let timeline = &island.timeline;
        // Where in the score a strike stands does not sound.
        for &Strike {
            at, mat, impulse, ..
        } in &timeline.strikes
        {
            if falls(at) {
                sink.0.update(mat.to_le_bytes());
                sink.0.update(at.to_le_bytes());
                sink.0.update(impulse.to_le_bytes());
            }
        }
        sink.0.update(b"ergons");
        for &Ergon {
            at,
            mat,
            mass,
            speed,
            ..
        } in &timeline.ergons
        {
            if falls(at) {
                sink.0.update(mat.to_le_bytes());
                for number in [at, mass, speed] {
                    sink.0.update(number.to_le_bytes());
                }
            }
        }
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
        sink.hex()
    }
}

fn of_gesture(gesture: &Gesture) -> (f64, [u8; 32]) {
    (
        gesture.start - gesture.manner.join,
        digest(format_args!("{gesture:?}")),
    )
}

fn digest(text: std::fmt::Arguments<'_>) -> [u8; 32] {
    let mut sink = Sink(Sha256::new());
    // A hash takes everything: nothing can fail.
    let _ = sink.write_fmt(text);
    sink.0.finalize().into()
}
