//! What pages see of a performance while it plays.
//!
//! Once per video frame the physics thread copies the moving points into a picture (`Window`). An ordinary thread makes
//! chunks of the picture and gives them to the server of the pages (`Showing`), with the instant at which its frame is
//! heard (`HeardTimes`). The physics thread never waits: while a picture has not been fetched, the next one is skipped
//! and counted, and its contacts and levels are added to the one after.

mod output_times;
mod showing;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ergon_engine::simulation::{Glance, Look, Simulation};
use ergon_view::record::{Recorder, Setup, add_squares};
use triple_buffer::{Input, Output, triple_buffer};

pub use output_times::HeardTimes;
#[cfg(test)]
pub(super) use showing::Relay;
pub use showing::Showing;

/// Greatest number of strikes by hand and by MIDI in a picture; if there are more, the earliest are heard but not
/// shown.
const STRIKES_MAX: usize = 256;

/// A live strike, which is not written in the score.
#[derive(Clone, Copy, Default)]
struct Strike {
    frame: u64,
    point: u32,
    /// [N·s]
    impulse: f64,
}

/// Strikes that no picture has contained yet. They outlast a window: strikes since its last picture are in the first
/// picture of the next window.
pub(super) struct Strikes(Vec<Strike>);

impl Strikes {
    pub(super) fn new() -> Self {
        Self(Vec::with_capacity(STRIKES_MAX))
    }

    /// Add a strike that was made at `frame`.
    pub(super) fn add(&mut self, frame: u64, point: u32, impulse: f64) {
        if self.0.len() == STRIKES_MAX {
            self.0.remove(0);
        }
        self.0.push(Strike { frame, point, impulse });
    }
}

/// What the physics thread copies for pages.
#[derive(Clone)]
struct Picture {
    glance: Glance,
    /// Strikes since the previous picture: the first `n_strikes` entries are valid   (STRIKES_MAX)
    strikes: Vec<Strike>,
    n_strikes: usize,
    /// Sum of the squares of `n_heard` frames, for each loudspeaker.
    squares: Vec<f64>,
    n_heard: u64,
    /// Number of frames that had been dropped by then, because the ring was full.
    dropped: u64,
}

/// The physics thread's end of a window.
pub struct Window {
    look: Look,
    /// Pictures per audio frame.
    pictures_per_frame: f64,
    /// Number of the last video frame for which a picture was due.
    last_picture: Option<u64>,
    squares: Vec<f64>,
    n_heard: u64,
    pictures: Input<Picture>,
    skipped: Arc<AtomicU64>,
}

/// The other end of a window, which makes chunks of pictures.
pub struct WindowReader {
    recorder: Recorder,
    pictures: Output<Picture>,
    skipped: Arc<AtomicU64>,
}

/// The two ends of a window on a simulation; `look` and `setup` are those of [`Recorder::live`]. To be called outside
/// real time, because it allocates room for all pictures.
///
/// # Errors
/// A sentence if there is too much to show.
pub fn window_pair(simulation: &Simulation, look: Look, setup: Setup) -> Result<(Window, WindowReader), String> {
    let picture = Picture {
        glance: Glance::new(simulation, &look),
        strikes: vec![Strike::default(); STRIKES_MAX],
        n_strikes: 0,
        squares: vec![0.0; setup.n_speakers],
        n_heard: 0,
        dropped: 0,
    };
    let (picture_input, pictures) = triple_buffer(&picture);
    let skipped = Arc::new(AtomicU64::new(0));
    let window = Window {
        pictures_per_frame: setup.fps / simulation.rate(),
        last_picture: None,
        squares: picture.squares,
        n_heard: 0,
        pictures: picture_input,
        skipped: skipped.clone(),
        look: look.clone(),
    };
    let reader = WindowReader {
        recorder: Recorder::live(simulation, look, setup)?,
        pictures,
        skipped,
    };
    Ok((window, reader))
}

impl Window {
    /// Add the levels of a tick's loudspeaker channels; `is_heard` is false during a panic, which counts as silence
    /// (n_frames · n_speakers)
    pub(super) fn add_levels(&mut self, mixed: &[f64], is_heard: bool) {
        if is_heard {
            self.n_heard += add_squares(&mut self.squares, mixed);
        } else {
            self.n_heard += (mixed.len() / self.squares.len().max(1)) as u64;
        }
    }

    /// Whether this is a window on `simulation`.
    pub(super) fn is_of(&self, simulation: &Simulation) -> bool {
        self.look.was_made_for(simulation)
    }

    /// Publish a picture, with the strikes, if a new video frame has begun since the last call. Do nothing for a
    /// simulation that is not its own.
    pub(super) fn publish(&mut self, simulation: &mut Simulation, strikes: &mut Strikes, dropped: u64) {
        let picture_number = (simulation.frame() as f64 * self.pictures_per_frame) as u64;
        if self.last_picture == Some(picture_number) || !self.is_of(simulation) {
            return;
        }
        self.last_picture = Some(picture_number);
        if !self.pictures.consumed() {
            self.skipped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let picture = self.pictures.input_buffer_mut();
        simulation.fill_glance(&self.look, &mut picture.glance);
        picture.n_strikes = strikes.0.len();
        picture.strikes[..strikes.0.len()].copy_from_slice(&strikes.0);
        strikes.0.clear();
        std::mem::swap(&mut picture.squares, &mut self.squares);
        self.squares.fill(0.0);
        picture.n_heard = std::mem::take(&mut self.n_heard);
        picture.dropped = dropped;
        self.pictures.publish();
    }
}

impl WindowReader {
    /// Whether the other end was dropped, and no picture is left to be fetched.
    fn is_over(&self) -> bool {
        Arc::strong_count(&self.skipped) == 1 && !self.pictures.updated()
    }

    /// Number of pictures that were skipped.
    fn skipped(&self) -> u64 {
        self.skipped.load(Ordering::Relaxed)
    }
}
