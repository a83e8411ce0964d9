//! What pages see of a performance while it plays.
//!
//! Once a video frame the physics thread copies what moves into a picture (`Window`). A plain thread makes chunks of it and gives them
//! to the server of the pages (`Showing`), with the instant at which they are heard (`Ear`). The physics thread waits for nobody: while a
//! picture has not been fetched the next is not made, but counted, and contacts and levels go on into the one after.

mod ear;
mod showing;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ergon_engine::simulation::{Glance, Look, Simulation};
use ergon_view::record::{Recorder, Setup, add_squares};
use triple_buffer::{Input, Output, triple_buffer};

pub use ear::Ear;
#[cfg(test)]
pub(super) use showing::Relay;
pub use showing::Showing;

/// Strikes by hand and by MIDI that a picture tells; of more at once the first are heard and not seen.
const STRIKES_MAX: usize = 256;

/// A strike that nobody knew beforehand.
#[derive(Clone, Copy, Default)]
struct Strike {
    frame: u64,
    point: u32,
    /// [N·s]
    impulse: f64,
}

/// Strikes that no picture has told yet. They outlast a window: those since its last picture are in the first of the next one.
pub(super) struct Strikes(Vec<Strike>);

impl Strikes {
    pub(super) fn new() -> Self {
        Self(Vec::with_capacity(STRIKES_MAX))
    }

    /// Add one that was done at a frame.
    pub(super) fn add(&mut self, frame: u64, point: u32, impulse: f64) {
        if self.0.len() == STRIKES_MAX {
            self.0.remove(0);
        }
        self.0.push(Strike {
            frame,
            point,
            impulse,
        });
    }
}

/// What the physics thread leaves for pages.
#[derive(Clone)]
struct Picture {
    glance: Glance,
    /// Since the picture before: the first `n_strikes` of them   (STRIKES_MAX)
    strikes: Vec<Strike>,
    n_strikes: usize,
    /// Of each loudspeaker, sum of the squares of `heard` frames.
    squares: Vec<f64>,
    heard: u64,
    /// Frames that had found no room in the ring by then.
    dropped: u64,
}

/// The end of the physics thread.
pub struct Window {
    look: Look,
    /// Pictures a frame.
    pace: f64,
    /// Number of the last video frame that was looked at.
    last: Option<u64>,
    squares: Vec<f64>,
    heard: u64,
    pictures: Input<Picture>,
    skipped: Arc<AtomicU64>,
}

/// The other end: what makes chunks of pictures.
pub struct Scene {
    recorder: Recorder,
    pictures: Output<Picture>,
    skipped: Arc<AtomicU64>,
}

/// The two ends of a window on a simulation, as [`Recorder::new`] takes it. Outside real time: both hold room for all pictures.
///
/// # Errors
/// A sentence where there is too much to be seen.
pub fn window(
    simulation: &Simulation,
    look: Look,
    setup: Setup,
) -> Result<(Window, Scene), String> {
    let picture = Picture {
        glance: Glance::new(simulation, &look),
        strikes: vec![Strike::default(); STRIKES_MAX],
        n_strikes: 0,
        squares: vec![0.0; setup.n_speakers],
        heard: 0,
        dropped: 0,
    };
    let (to_pictures, pictures) = triple_buffer(&picture);
    let skipped = Arc::new(AtomicU64::new(0));
    let window = Window {
        pace: setup.fps / simulation.rate(),
        last: None,
        squares: picture.squares,
        heard: 0,
        pictures: to_pictures,
        skipped: skipped.clone(),
        look: look.clone(),
    };
    let scene = Scene {
        recorder: Recorder::new(simulation, look, setup)?,
        pictures,
        skipped,
    };
    Ok((window, scene))
}

impl Window {
    /// Take what loudspeakers sound of a tick, or what they would without a panic   (n_frames · n_speakers)
    pub(super) fn hear(&mut self, mixed: &[f64], is_heard: bool) {
        if is_heard {
            self.heard += add_squares(&mut self.squares, mixed);
        } else {
            self.heard += (mixed.len() / self.squares.len().max(1)) as u64;
        }
    }

    /// Whether it is a window on this simulation.
    pub(super) fn is_of(&self, simulation: &Simulation) -> bool {
        self.look.is_of(simulation)
    }

    /// Look where a video frame has begun since the last time, and take the strikes. Of another simulation than its own it shows
    /// nothing.
    pub(super) fn look(
        &mut self,
        simulation: &mut Simulation,
        strikes: &mut Strikes,
        dropped: u64,
    ) {
        let now = (simulation.frame() as f64 * self.pace) as u64;
        if self.last == Some(now) || !self.is_of(simulation) {
            return;
        }
        self.last = Some(now);
        if !self.pictures.consumed() {
            self.skipped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let picture = self.pictures.input_buffer_mut();
        simulation.glance(&self.look, &mut picture.glance);
        picture.n_strikes = strikes.0.len();
        picture.strikes[..strikes.0.len()].copy_from_slice(&strikes.0);
        strikes.0.clear();
        std::mem::swap(&mut picture.squares, &mut self.squares);
        self.squares.fill(0.0);
        picture.heard = std::mem::take(&mut self.heard);
        picture.dropped = dropped;
        self.pictures.publish();
    }
}

impl Scene {
    /// Whether the other end is gone, and nothing is left to be fetched.
    fn is_over(&self) -> bool {
        Arc::strong_count(&self.skipped) == 1 && !self.pictures.updated()
    }

    /// Pictures that were not made.
    fn skipped(&self) -> u64 {
        self.skipped.load(Ordering::Relaxed)
    }
}
