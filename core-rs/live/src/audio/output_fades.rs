//! Three ramps against clicks: down from the last sample at a gap, up into the sound after it, and down to silence in a
//! panic.

const FADE_SECONDS: f64 = 0.002; // s
const MUTE_SECONDS: f64 = 0.005; // s

/// Ramps over the frames of one stream; between ramps samples pass unchanged, bit for bit.
pub(super) struct OutputFades {
    channels: usize,
    fade_frames: u32,
    mute_frames: u32,
    /// How far the incoming sound has risen, 0 to `fade_frames`.
    rise_frames: u32,
    /// What is left of the fall from `held_frame`, `fade_frames` to 0.
    fall_frames_left: u32,
    held_frame: Box<[f32]>,
    last_frame: Box<[f32]>,
    /// What is left of the fall to silence [frames], while silence is requested.
    mute_frames_left: Option<u32>,
}

impl OutputFades {
    pub(super) fn new(channels: usize, rate: u32) -> Self {
        let mut new_fades = Self {
            channels,
            fade_frames: 0,
            mute_frames: 0,
            rise_frames: 0,
            fall_frames_left: 0,
            held_frame: vec![0.0; channels].into(),
            last_frame: vec![0.0; channels].into(),
            mute_frames_left: None,
        };
        new_fades.set_rate(rate);
        new_fades
    }

    pub(super) fn set_rate(&mut self, rate: u32) {
        let fade_frames = |seconds: f64| (f64::from(rate) * seconds).round().max(1.0) as u32;
        (self.fade_frames, self.mute_frames) = (fade_frames(FADE_SECONDS), fade_frames(MUTE_SECONDS));
        (self.rise_frames, self.fall_frames_left) = (self.fade_frames, 0);
    }

    /// Begin a gap: the sound falls from its last value, and the next frames will rise.
    pub(super) fn begin_gap(&mut self) {
        self.held_frame.copy_from_slice(&self.last_frame);
        (self.rise_frames, self.fall_frames_left) = (0, self.fade_frames);
    }

    /// Let the next frames rise from silence.
    pub(super) fn restart(&mut self) {
        (self.rise_frames, self.fall_frames_left) = (0, 0);
        self.last_frame.fill(0.0);
    }

    /// Shape frames of sound.
    pub(super) fn shape_sound(&mut self, frames: &mut [f32]) {
        for frame in frames.chunks_exact_mut(self.channels) {
            if self.rise_frames == self.fade_frames && self.fall_frames_left == 0 {
                break;
            }
            self.rise_frames = (self.rise_frames + 1).min(self.fade_frames);
            self.fall_frames_left = self.fall_frames_left.saturating_sub(1);
            let (rise_gain, fall_gain) = (
                self.frame_share(self.rise_frames),
                self.frame_share(self.fall_frames_left),
            );
            for (x, held) in frame.iter_mut().zip(&self.held_frame) {
                *x = *x * rise_gain + held * fall_gain;
            }
        }
        if let Some(frame) = frames.rchunks_exact(self.channels).next() {
            self.last_frame.copy_from_slice(frame);
        }
    }

    /// Fill frames of a gap: what is left of the fall, then silence.
    pub(super) fn fill_gap(&mut self, frames: &mut [f32]) {
        for frame in frames.chunks_exact_mut(self.channels) {
            self.fall_frames_left = self.fall_frames_left.saturating_sub(1);
            let fall_gain = self.frame_share(self.fall_frames_left);
            for (x, held) in frame.iter_mut().zip(&self.held_frame) {
                *x = if self.fall_frames_left == 0 {
                    0.0
                } else {
                    held * fall_gain
                };
            }
        }
        if let Some(frame) = frames.rchunks_exact(self.channels).next() {
            self.last_frame.copy_from_slice(frame);
        }
    }

    fn frame_share(&self, frame_count: u32) -> f32 {
        frame_count as f32 / self.fade_frames as f32
    }

    /// Request silence; returns whether it is reached.
    pub(super) fn request_mute(&mut self) -> bool {
        *self.mute_frames_left.get_or_insert(self.mute_frames) == 0
    }

    /// Request silence when the output is silent already.
    pub(super) fn mute_now(&mut self) {
        self.mute_frames_left = Some(0);
    }

    /// Whether silence is requested but not reached.
    pub(super) fn is_falling_silent(&self) -> bool {
        self.mute_frames_left.is_some_and(|left| left > 0)
    }

    /// Withdraw the request for silence; returns whether there was one.
    pub(super) fn end_mute(&mut self) -> bool {
        self.mute_frames_left.take().is_some()
    }

    /// Apply the fall to silence to frames that the other ramps have shaped.
    pub(super) fn apply_mute(&mut self, frames: &mut [f32]) {
        let Some(frames_left) = &mut self.mute_frames_left else {
            return;
        };
        for frame in frames.chunks_exact_mut(self.channels) {
            *frames_left = frames_left.saturating_sub(1);
            let mute_gain = *frames_left as f32 / self.mute_frames as f32;
            for x in frame {
                *x = if *frames_left == 0 { 0.0 } else { *x * mute_gain };
            }
        }
    }
}
