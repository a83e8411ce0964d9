//! What pages see of a performance while it plays.
//!
//! Once per video frame the physics thread copies the moving points into a picture (`DisplayWindow`). An ordinary
//! thread makes chunks of the picture and gives them to the server of the pages (`WindowServer`), with the instant at
//! which its frame is heard (`PlaybackTimes`). The physics thread never waits: while a picture has not been fetched,
//! the next one is skipped and counted, and its contacts and levels are added to the one after.

mod output_times;
mod showing;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ergon_engine::simulation::{MotionLook, MotionSnapshot, Simulation};
use ergon_view::record::{Recorder, RecordingSetup, add_square_sums};
use triple_buffer::{Input, Output, triple_buffer};

pub use output_times::PlaybackTimes;
#[cfg(test)]
pub(super) use showing::WindowRelay;
pub use showing::WindowServer;

/// Greatest number of strikes by hand and by MIDI in a picture; if there are more, the earliest are heard but not
/// shown.
const STRIKES_MAX: usize = 256;

/// A live strike, which is not written in the score.
#[derive(Clone, Copy, Default)]
struct LiveStrike {
    frame: u64,
    point: u32,
    /// [N·s]
    impulse: f64,
}

/// Strikes that no picture has contained yet. They outlast a window: strikes since its last picture are in the first
/// picture of the next window.
pub(super) struct UnreportedStrikes(Vec<LiveStrike>);

impl UnreportedStrikes {
    pub(super) fn new() -> Self {
        Self(Vec::with_capacity(STRIKES_MAX))
    }

    /// Add a strike that was made at `frame`.
    pub(super) fn add(&mut self, frame: u64, point: u32, impulse: f64) {
        if self.0.len() == STRIKES_MAX {
            self.0.remove(0);
        }
        self.0.push(LiveStrike { frame, point, impulse });
    }
}

/// What the physics thread copies for pages.
#[derive(Clone)]
struct DisplayFrame {
    snapshot: MotionSnapshot,
    /// Strikes since the previous picture: the first `n_strikes` entries are valid   (STRIKES_MAX)
    strikes: Vec<LiveStrike>,
    n_strikes: usize,
    /// Sum of the squares of `n_level_frames` frames, for each loudspeaker.
    square_sums: Vec<f64>,
    n_level_frames: u64,
    /// Number of frames that had been dropped by then, because the ring was full.
    dropped_frames: u64,
}

/// The physics thread's end of a window.
pub struct DisplayWindow {
    motion_look: MotionLook,
    /// Pictures per audio frame.
    display_frames_per_audio_frame: f64,
    /// Number of the last video frame for which a picture was due.
    last_display_frame: Option<u64>,
    square_sums: Vec<f64>,
    n_level_frames: u64,
    display_frames: Input<DisplayFrame>,
    n_skipped: Arc<AtomicU64>,
}

/// The other end of a window, which makes chunks of pictures.
pub struct WindowReader {
    recorder: Recorder,
    display_frames: Output<DisplayFrame>,
    n_skipped: Arc<AtomicU64>,
}

/// The two ends of a window on a simulation; `look` and `setup` are those of [`Recorder::for_live_pages`]. To be called
/// outside real time, because it allocates room for all pictures.
///
/// # Errors
/// A sentence if there is too much to show.
pub fn window_pair(
    simulation: &Simulation,
    look: MotionLook,
    setup: RecordingSetup,
) -> Result<(DisplayWindow, WindowReader), String> {
    let display_frame = DisplayFrame {
        snapshot: MotionSnapshot::new(simulation, &look),
        strikes: vec![LiveStrike::default(); STRIKES_MAX],
        n_strikes: 0,
        square_sums: vec![0.0; setup.n_speakers],
        n_level_frames: 0,
        dropped_frames: 0,
    };
    let (display_input, display_output) = triple_buffer(&display_frame);
    let n_skipped = Arc::new(AtomicU64::new(0));
    let window = DisplayWindow {
        display_frames_per_audio_frame: setup.looks_per_second / simulation.rate(),
        last_display_frame: None,
        square_sums: display_frame.square_sums,
        n_level_frames: 0,
        display_frames: display_input,
        n_skipped: n_skipped.clone(),
        motion_look: look.clone(),
    };
    let reader = WindowReader {
        recorder: Recorder::for_live_pages(simulation, look, setup)?,
        display_frames: display_output,
        n_skipped,
    };
    Ok((window, reader))
}

impl DisplayWindow {
    /// Add the levels of a tick's loudspeaker channels; `is_heard` is false during a panic, which counts as silence
    /// (n_frames · n_speakers)
    pub(super) fn add_levels(&mut self, mixed: &[f64], is_heard: bool) {
        if is_heard {
            self.n_level_frames += add_square_sums(&mut self.square_sums, mixed);
        } else {
            self.n_level_frames += (mixed.len() / self.square_sums.len().max(1)) as u64;
        }
    }

    /// Whether this is a window on `simulation`.
    pub(super) fn shows_simulation(&self, simulation: &Simulation) -> bool {
        self.motion_look.was_made_for(simulation)
    }

    /// Publish a picture, with the strikes, if a new video frame has begun since the last call. Do nothing for a
    /// simulation that is not its own.
    pub(super) fn publish(
        &mut self,
        simulation: &mut Simulation,
        strikes: &mut UnreportedStrikes,
        dropped_frames: u64,
    ) {
        let display_number = (simulation.frame() as f64 * self.display_frames_per_audio_frame) as u64;
        if self.last_display_frame == Some(display_number) || !self.shows_simulation(simulation) {
            return;
        }
        self.last_display_frame = Some(display_number);
        if !self.display_frames.consumed() {
            self.n_skipped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let display_frame = self.display_frames.input_buffer_mut();
        simulation.fill_snapshot(&self.motion_look, &mut display_frame.snapshot);
        display_frame.n_strikes = strikes.0.len();
        display_frame.strikes[..strikes.0.len()].copy_from_slice(&strikes.0);
        strikes.0.clear();
        std::mem::swap(&mut display_frame.square_sums, &mut self.square_sums);
        self.square_sums.fill(0.0);
        display_frame.n_level_frames = std::mem::take(&mut self.n_level_frames);
        display_frame.dropped_frames = dropped_frames;
        self.display_frames.publish();
    }
}

impl WindowReader {
    /// Whether the other end was dropped, and no picture is left to be fetched.
    fn is_over(&self) -> bool {
        Arc::strong_count(&self.n_skipped) == 1 && !self.display_frames.updated()
    }

    /// Number of pictures that were skipped.
    fn skipped_count(&self) -> u64 {
        self.n_skipped.load(Ordering::Relaxed)
    }
}
