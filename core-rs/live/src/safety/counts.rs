//! How often each stage acted.

/// Counts of what the stages did. Unless a field says otherwise, a count grows for every tick and axis in which a stage
/// changed a force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageCounts {
    /// Ticks in which forces passed the stages.
    pub ticks: u64,
    /// Asked forces that are not finite.
    pub not_finite: u64,
    /// Forces greater than the player or the device allows.
    pub clamped: u64,
    /// Forces greater than a hot motor may give.
    pub hot: u64,
    /// Forces that grew or fell too fast.
    pub slewed: u64,
    /// Forces reduced during the rise at the start.
    pub ramped: u64,
    /// Forces reduced by a trip: zero while it lasts, then fading in.
    pub tripped: u64,
    /// Forces reduced because the position or the force was too old: zero, then fading in.
    pub stale: u64,
    /// Forces reduced because they would do too much work on a hand.
    pub energy: u64,
    /// Forces scaled because the coupling would have been too stiff.
    pub stiff: u64,
    /// Forces set to zero because the player stopped them.
    pub stopped: u64,
    /// How often an axis tripped because a force or a position is not finite.
    pub trips_not_finite: u64,
    /// How often an axis tripped because of its speed.
    pub trips_speed: u64,
    /// How often an axis tripped because of a position that is outside its travel, or that no force explains.
    pub trips_position: u64,
    /// How often the host had been stopped.
    pub stalls: u64,
    /// How often the device reported that it had let go.
    pub let_go: u64,
}

impl StageCounts {
    /// Name and value of every count.
    pub fn named(&self) -> [(&'static str, u64); 16] {
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
            ("trips: position", self.trips_position),
            ("stalls of the host", self.stalls),
            ("force dropped by device", self.let_go),
        ]
    }
}
