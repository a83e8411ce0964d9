//! Three ramps against clicks: down from the last sample at a gap, up into the sound after it, and down to silence in a
//! panic.

const FADE: f64 = 0.002; // s
const HUSH: f64 = 0.005; // s

/// Ramps over the frames of one stream; between ramps samples pass unchanged, bit for bit.
pub(super) struct OutputFades {
    channels: usize,
    fade: u32,
    hush_frames: u32,
    /// How far the incoming sound has risen, 0 to `fade`.
    risen: u32,
    /// What is left of the fall from `held`, `fade` to 0.
    fall: u32,
    held: Box<[f32]>,
    last: Box<[f32]>,
    /// What is left of the fall to silence [frames], while silence is requested.
    hushing: Option<u32>,
}

impl OutputFades {
    pub(super) fn new(channels: usize, rate: u32) -> Self {
        let mut new_fades = Self {
            channels,
            fade: 0,
            hush_frames: 0,
            risen: 0,
            fall: 0,
            held: vec![0.0; channels].into(),
            last: vec![0.0; channels].into(),
            hushing: None,
        };
        new_fades.set_rate(rate);
        new_fades
    }

    pub(super) fn set_rate(&mut self, rate: u32) {
        let fade_frames = |seconds: f64| (f64::from(rate) * seconds).round().max(1.0) as u32;
        (self.fade, self.hush_frames) = (fade_frames(FADE), fade_frames(HUSH));
        (self.risen, self.fall) = (self.fade, 0);
    }

    /// Begin a gap: the sound falls from its last value, and the next frames will rise.
    pub(super) fn begin_gap(&mut self) {
        self.held.copy_from_slice(&self.last);
        (self.risen, self.fall) = (0, self.fade);
    }

    /// Let the next frames rise from silence.
    pub(super) fn restart(&mut self) {
        (self.risen, self.fall) = (0, 0);
        self.last.fill(0.0);
    }

    /// Shape frames of sound.
    pub(super) fn shape_sound(&mut self, frames: &mut [f32]) {
        for frame in frames.chunks_exact_mut(self.channels) {
            if self.risen == self.fade && self.fall == 0 {
                break;
            }
            self.risen = (self.risen + 1).min(self.fade);
            self.fall = self.fall.saturating_sub(1);
            let (rise_gain, fall_gain) = (self.part(self.risen), self.part(self.fall));
            for (x, held) in frame.iter_mut().zip(&self.held) {
                *x = *x * rise_gain + held * fall_gain;
            }
        }
        if let Some(frame) = frames.rchunks_exact(self.channels).next() {
            self.last.copy_from_slice(frame);
        }
    }

    /// Fill frames of a gap: what is left of the fall, then silence.
    pub(super) fn fill_gap(&mut self, frames: &mut [f32]) {
        for frame in frames.chunks_exact_mut(self.channels) {
            self.fall = self.fall.saturating_sub(1);
            let fall_gain = self.part(self.fall);
            for (x, held) in frame.iter_mut().zip(&self.held) {
                *x = if self.fall == 0 { 0.0 } else { held * fall_gain };
            }
        }
        if let Some(frame) = frames.rchunks_exact(self.channels).next() {
            self.last.copy_from_slice(frame);
        }
    }

    fn part(&self, of: u32) -> f32 {
        of as f32 / self.fade as f32
    }

    /// Request silence; returns whether it is reached.
    pub(super) fn request_hush(&mut self) -> bool {
        *self.hushing.get_or_insert(self.hush_frames) == 0
    }

    /// Request silence when the output is silent already.
    pub(super) fn hush_now(&mut self) {
        self.hushing = Some(0);
    }

    /// Whether silence is requested but not reached.
    pub(super) fn is_falling_silent(&self) -> bool {
        self.hushing.is_some_and(|left| left > 0)
    }

    /// Withdraw the request for silence; returns whether there was one.
    pub(super) fn end_hush(&mut self) -> bool {
        self.hushing.take().is_some()
    }

    /// Apply the fall to silence to frames that the other ramps have shaped.
    pub(super) fn apply_hush(&mut self, frames: &mut [f32]) {
        let Some(frames_left) = &mut self.hushing else {
            return;
        };
        for frame in frames.chunks_exact_mut(self.channels) {
            *frames_left = frames_left.saturating_sub(1);
            let hush_gain = *frames_left as f32 / self.hush_frames as f32;
            for x in frame {
                *x = if *frames_left == 0 { 0.0 } else { *x * hush_gain };
            }
        }
    }
}
