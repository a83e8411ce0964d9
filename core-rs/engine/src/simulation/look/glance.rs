//! A snapshot of what can be seen of a simulation at one frame, in memory that is allocated beforehand.

use super::Look;
use crate::island::ErgonRecord;
use crate::simulation::Simulation;

/// The strongest push of a contact between two glances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Push {
    /// The frame in which it pushed most.
    pub frame: u64,
    /// The force in that frame [N], above 0 if the contact pushes its first end up; 0 if it did not touch.
    pub force: f64,
}

/// What was seen of a simulation at one frame.
#[derive(Clone, Debug, Default)]
pub struct Glance {
    /// The frame.
    pub frame: u64,
    /// Displacements, as [`Simulation::look`] writes them [m]   (2 · n_tracks)
    pub tracks: Vec<f64>,
    /// Position that the gesture of each key asks for [m]; NaN for keys without a running gesture   (n_keys)
    pub asked: Vec<f64>,
    /// Strongest push of each contact since the last glance   (n_contacts)
    pub pushes: Vec<Push>,
    /// Whether each link that may break is broken   (n_breakable)
    pub is_broken: Vec<bool>,
    /// Strikes of written hands since the last glance, as they are drawn: the first `n_sparks` are valid
    sparks: Vec<ErgonRecord>,
    n_sparks: usize,
}

impl Glance {
    /// Memory for what is seen of a simulation.
    pub fn new(simulation: &Simulation, look: &Look) -> Self {
        Self {
            frame: 0,
            tracks: vec![0.0; 2 * look.n_tracks()],
            asked: vec![f64::NAN; simulation.plan.n_keys],
            pushes: vec![Push::default(); look.contacts.len()],
            is_broken: vec![false; look.breakable.len()],
            sparks: vec![ErgonRecord::default(); simulation.sparks_max(look)],
            n_sparks: 0,
        }
    }

    /// Strikes of written hands since the last glance, as [`Simulation::take_sparks`] reports them.
    pub fn sparks(&self) -> &[ErgonRecord] {
        &self.sparks[..self.n_sparks]
    }
}

impl Simulation {
    /// Fills `snapshot` with the state at this frame and the contacts and strikes since the last glance. Only copies.
    pub fn glance(&mut self, look: &Look, snapshot: &mut Glance) {
        snapshot.frame = self.frame;
        self.look(look, &mut snapshot.tracks);
        self.write_gesture_positions(&mut snapshot.asked);
        snapshot.pushes.fill(Push::default());
        let pushes = &mut snapshot.pushes;
        self.take_contacts(look, |contact, frame, force| {
            pushes[contact] = Push { frame, force };
        });
        let broken_links = &mut snapshot.is_broken;
        self.look_at_breaks(look, |link, is_broken| broken_links[link] = is_broken);
        snapshot.n_sparks = 0;
        self.take_sparks(look, |spark| {
            if let Some(spark_room) = snapshot.sparks.get_mut(snapshot.n_sparks) {
                *spark_room = spark;
                snapshot.n_sparks += 1;
            }
        });
    }
}
