//! How often each stage acted.

/// Ticks times axes in which a stage changed a force, by stage.
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
    /// Zero because position or force was too old, or fading in after it.
    pub stale: u64,
    /// Less than asked because more work would be done on a hand than may be.
    pub energy: u64,
    /// Scaled because the coupling would have been too stiff.
    pub stiff: u64,
    /// Zero by the player's wish.
    pub stopped: u64,
    /// How often an axis tripped by a force or a position that is no number.
    pub trips_not_finite: u64,
    /// How often one tripped by its speed.
    pub trips_speed: u64,
    /// How often the host had been stopped.
    pub stalls: u64,
    /// How often the device said that it had let go.
    pub let_go: u64,
}

impl Counts {
    /// Name and count of every stage.
    pub fn named(&self) -> [(&'static str, u64); 15] {
        [
            ("ticks", self.ticks),
            ("force not finite", self.not_finite),
            ("clamped", self.clamped),
            ("motor too hot", self.hot),
            ("slew limited", self.slewed),
            ("ramped at the start", self.ramped),
            ("tripped", self.tripped),
            ("stale", self.stale),
            ("energy limited", self.energy),
            ("scaled for stability", self.stiff),
            ("stopped by the player", self.stopped),
            ("trips: not finite", self.trips_not_finite),
            ("trips: speed", self.trips_speed),
            ("stalls of the host", self.stalls),
            ("force dropped by device", self.let_go),
        ]
    }
}
