//! How often each stage acted.

/// Ticks times axes in which a stage changed a force, in the stages' order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Ticks passed.
    pub ticks: u64,
    /// Asked forces that were no numbers.
    pub not_finite: u64,
    /// Greater than the player or the device allows.
    pub clamped: u64,
    /// Greater than the device bears for long.
    pub hot: u64,
    /// Growing or falling too fast.
    pub slewed: u64,
    /// Less than asked, at the start.
    pub ramped: u64,
    /// Zero while tripped or fading in after it.
    pub tripped: u64,
    /// Zero because the position was too old, or fading in after it.
    pub stale: u64,
    /// Kept back because more energy had gone into a hand than may.
    pub energy: u64,
    /// Scaled because the coupling would have been too stiff.
    pub stiff: u64,
    /// Zero by the player's wish.
    pub stopped: u64,
    /// How often an axis tripped by a force that is no number.
    pub trips_not_finite: u64,
    /// How often one tripped by its speed.
    pub trips_speed: u64,
}

impl Counts {
    /// Name and count of every stage.
    pub fn named(&self) -> [(&'static str, u64); 13] {
        [
            ("ticks", self.ticks),
            ("not finite", self.not_finite),
            ("clamped", self.clamped),
            ("hot", self.hot),
            ("slewed", self.slewed),
            ("ramped", self.ramped),
            ("tripped", self.tripped),
            ("stale", self.stale),
            ("energy", self.energy),
            ("stiff", self.stiff),
            ("stopped", self.stopped),
            ("trips by no number", self.trips_not_finite),
            ("trips by speed", self.trips_speed),
        ]
    }
}
