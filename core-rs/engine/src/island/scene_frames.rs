//! How the steps of an island lie in the frames of the scene: `oversampling` steps in `frame_interval` frames.
//!
//! An island that is only displayed may be computed once in many frames. Its own frames lie on multiples of
//! `frame_interval`, and it is computed up to the first of them that is not before the scene. Between two of its frames
//! its displayed position is interpolated on the straight line of its last step.

use super::Island;

impl Island {
    /// Number of its own frames that are computed when the scene has computed `scene_frame` frames.
    fn island_frames(&self, scene_frame: u64) -> u64 {
        scene_frame.div_ceil(u64::from(self.frame_interval))
    }

    /// Number of its own frames that fall in the scene's next `n_frames`, from `scene_frame` on.
    pub(crate) fn due_frames(&self, scene_frame: u64, n_frames: usize) -> usize {
        let frames_at_end = self.island_frames(scene_frame + n_frames as u64);
        (frames_at_end - self.island_frames(scene_frame)) as usize
    }

    /// Number of its steps that are computed when the scene has computed `scene_frame` frames.
    pub(crate) fn step_at(&self, scene_frame: u64) -> u64 {
        self.island_frames(scene_frame) * u64::from(self.oversampling)
    }

    /// The frame of the scene in which a step begins.
    pub(crate) fn scene_frame_at(&self, step: u64) -> u64 {
        step / u64::from(self.oversampling) * u64::from(self.frame_interval)
    }

    /// Its steps in a frame of the scene.
    pub(crate) fn steps_per_frame(&self) -> f64 {
        f64::from(self.oversampling) / f64::from(self.frame_interval)
    }

    /// Number of frames by which it is ahead of the scene, which has computed `scene_frame`; less than
    /// `frame_interval`.
    pub(crate) fn frames_ahead(&self, scene_frame: u64) -> u32 {
        let reached_frame = self.island_frames(scene_frame) * u64::from(self.frame_interval);
        (reached_frame - scene_frame) as u32
    }

    /// Whether one of its frames takes several frames of the scene.
    pub(crate) fn is_decimated(&self) -> bool {
        self.frame_interval > 1
    }
}
