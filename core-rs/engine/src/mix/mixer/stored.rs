//! The state of a mixer as bytes, so that another run continues from a frame without the frames before it.

use super::Mixer;
use crate::archive::{Archive, Damaged, State, state_of};

impl State for Mixer {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        state_of!(self, archive, frame, routes, rooms)
    }
}

impl Mixer {
    /// The state of routes and rooms; `None` while a gain glides, or with frozen outputs.
    ///
    /// ```
    /// use ergon_engine::mix::mixer::Mixer;
    ///
    /// let with_highpass = || {
    ///     let mut mixer = Mixer::new(44_100.0, 1, 1);
    ///     mixer.add_route(0, 0, 1.0, Some(20.0)).map(|()| mixer)
    /// };
    /// let (mut first, mut second) = (with_highpass()?, with_highpass()?);
    /// let (mut wanted, mut mixed) = ([0.0; 2], [0.0]);
    /// first.process(&[1.0], &mut mixed);
    /// let state = first.write_state().ok_or("a gain glides")?;
    /// first.process(&[0.5, 0.25], &mut wanted);
    /// second.read_state(&state)?;
    /// second.process(&[0.5], &mut mixed);
    /// assert_eq!(mixed[0], wanted[0]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn write_state(&mut self) -> Option<Vec<u8>> {
        let mut state_bytes = Vec::new();
        self.is_plain()
            .then(|| self.archive(&mut Archive::Write(&mut state_bytes)))?
            .ok()?;
        Some(state_bytes)
    }

    /// Continue after the frames that a mixer with the same routes and rooms has mixed.
    ///
    /// # Errors
    /// [`Damaged`] if the bytes are not a state of such a mixer; this one is then as it was.
    pub fn read_state(&mut self, state: &[u8]) -> Result<(), Damaged> {
        let mut restored = self.clone();
        let mut archive = Archive::Read(state);
        restored.archive(&mut archive)?;
        if !archive.is_empty() || !self.is_plain() {
            return Err(Damaged);
        }
        // Routes that hear the same do so in the restored state too.
        *self = restored;
        Ok(())
    }

    /// Whether no gain glides and nothing of another mixer fades out.
    fn is_plain(&self) -> bool {
        !self.is_fading
            && self.frozen_outputs.is_empty()
            && self.residual_gain.is_none()
            && self.fading_out.iter().all(Option::is_none)
            && self
                .group_gains
                .iter()
                .all(|glide| glide.constant_gain(self.frame).is_some())
    }
}
