//! A snapshot of what can be seen of a simulation at one frame, in memory that is allocated beforehand.

use super::MotionLook;
use crate::island::ErgonRecord;
use crate::simulation::Simulation;

/// The strongest push of a contact between two snapshots.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactPush {
    /// The frame in which it pushed most.
    pub frame: u64,
    /// The force in that frame [N], above 0 if the contact pushes its first end up; 0 if it did not touch.
    pub force: f64,
}

/// What was seen of a simulation at one frame.
#[derive(Clone, Debug, Default)]
pub struct MotionSnapshot {
    /// The frame.
    pub frame: u64,
    /// Displacements, as [`Simulation::write_tracks`] writes them [m]   (2 · n_tracks)
    pub tracks: Vec<f64>,
    /// Position that the gesture of each key requires [m]; NaN for keys without a running gesture   (n_keys)
    pub gesture_positions: Vec<f64>,
    /// Strongest push of each contact since the last snapshot   (n_contacts)
    pub pushes: Vec<ContactPush>,
    /// Whether each link that may break is broken   (n_breakable)
    pub is_broken: Vec<bool>,
    /// Strikes of written hands since the last snapshot, as they are drawn: the first `n_sparks` are valid
    sparks: Vec<ErgonRecord>,
    n_sparks: usize,
}

impl MotionSnapshot {
    /// Memory for what is seen of a simulation.
    pub fn new(simulation: &Simulation, look: &MotionLook) -> Self {
        Self {
            frame: 0,
            tracks: vec![0.0; 2 * look.n_tracks()],
            gesture_positions: vec![f64::NAN; simulation.plan.n_keys],
            pushes: vec![ContactPush::default(); look.contacts.len()],
            is_broken: vec![false; look.breakable_links.len()],
            sparks: vec![ErgonRecord::default(); simulation.sparks_max(look)],
            n_sparks: 0,
        }
    }

    /// Strikes of written hands since the last snapshot, as [`Simulation::take_sparks`] reports them.
    pub fn sparks(&self) -> &[ErgonRecord] {
        &self.sparks[..self.n_sparks]
    }
}

impl Simulation {
    /// Fills `snapshot` with the state at this frame and the contacts and strikes since the last snapshot. Only copies.
    pub fn fill_snapshot(&mut self, look: &MotionLook, snapshot: &mut MotionSnapshot) {
        snapshot.frame = self.frame;
        self.write_tracks(look, &mut snapshot.tracks);
        self.write_gesture_positions(&mut snapshot.gesture_positions);
        snapshot.pushes.fill(ContactPush::default());
        let pushes = &mut snapshot.pushes;
        self.take_contacts(look, |contact, frame, force| {
            pushes[contact] = ContactPush { frame, force };
        });
        let broken_links = &mut snapshot.is_broken;
        self.for_each_breakable(look, |link, is_broken| broken_links[link] = is_broken);
        snapshot.n_sparks = 0;
        self.take_sparks(look, |spark| {
            if let Some(spark_slot) = snapshot.sparks.get_mut(snapshot.n_sparks) {
                *spark_slot = spark;
                snapshot.n_sparks += 1;
            }
        });
    }
}
