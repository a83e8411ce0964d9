//! The silence detector: finds the point where a sound has decayed by 80 dB.

/// Relative to the highest peak: −80 dB.
const QUIET_RATIO: f64 = 1e-4;
/// Length of a window [s].
const WINDOW_SECONDS: f64 = 0.1;
/// Number of consecutive quiet windows that end a sound: beats return within a shorter time.
const QUIET_WINDOWS: u64 = 10;

/// Finds the end of a sound: ten consecutive quiet windows of a tenth of a second, all after a given frame.
///
/// A window is quiet if it is 80 dB below the highest peak so far. The result, the end of the first of these windows,
/// does not depend on how frames are cut into blocks.
///
/// ```
/// use ergon_engine::mix::silence_detector::SilenceDetector;
///
/// let mut finder = SilenceDetector::new(1_000.0, 1, 0);
/// assert_eq!(finder.process(&[1.0; 1_000]), None);
/// assert_eq!(finder.process(&[5e-5; 1_000]), Some(1_100));
/// ```
#[derive(Clone, Debug)]
pub struct SilenceDetector {
    window_frames: u64,
    n_channels: usize,
    start_frame: u64,
    frame: u64,
    n_quiet_windows: u64,
    peak: f64,
    window_peak: f64,
}

impl SilenceDetector {
    /// A detector for frames at `rate` [Hz]; windows count from frame `start_frame` on, where 0 is the first frame
    /// taken.
    pub fn new(rate: f64, n_channels: usize, start_frame: u64) -> Self {
        Self {
            window_frames: (WINDOW_SECONDS * rate + 0.5).max(1.0) as u64,
            n_channels: n_channels.max(1),
            start_frame,
            frame: 0,
            n_quiet_windows: 0,
            peak: 0.0,
            window_peak: 0.0,
        }
    }

    /// Number of channels.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// Take (n_frames · n_channels); returns the frame at which the sound has decayed, as soon as that is known.
    pub fn process(&mut self, frames: &[f64]) -> Option<u64> {
        let mut frames_left = frames;
        while !frames_left.is_empty() {
            let window_left = (self.window_frames - self.frame % self.window_frames) as usize;
            let frame_count = window_left.min(frames_left.len() / self.n_channels);
            let window_part;
            (window_part, frames_left) = frames_left.split_at(frame_count * self.n_channels);
            self.window_peak = window_part
                .iter()
                .fold(self.window_peak, |largest_yet, x| largest_yet.max(x.abs()));
            self.frame += frame_count as u64;
            if frame_count < window_left {
                return None;
            }
            self.peak = self.peak.max(self.window_peak);
            let is_after = self.frame - self.window_frames >= self.start_frame;
            let is_quiet = is_after && self.window_peak <= QUIET_RATIO * self.peak;
            self.n_quiet_windows = if is_quiet { self.n_quiet_windows + 1 } else { 0 };
            self.window_peak = 0.0;
            if self.n_quiet_windows == QUIET_WINDOWS {
                return Some(self.frame - (QUIET_WINDOWS - 1) * self.window_frames);
            }
        }
        None
    }
}
