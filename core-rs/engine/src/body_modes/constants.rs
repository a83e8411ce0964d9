//! Sizes of bodies whose modes are computed, and what counts as rounding in them.

/// Most masses of a body whose whole spectrum is computed: its matrix takes 8 n² bytes, its reduction
/// n³ multiplications (0.4 s for 1,000, 25 s for 4,000).
pub(super) const MODAL_MASSES_MAX: usize = 2_000;
/// Most undamped modes that damping may couple. An eigenvalue problem of 256 states takes 0.06 s, one of 512 half a
/// second.
pub(super) const COUPLED_MODES_MAX: usize = 256;
/// Most masses of a body whose damping is not proportional: the coupling of all its modes is computed.
pub(super) const DAMPED_MASSES_MAX: usize = 300;
/// Largest ‖E‖ [1/s]: after a second the motion is off by −120 dB.
pub(super) const COUPLING_ERROR_MAX: f64 = 1e-6;
/// A mode whose pole turns by less than this angle a step is stepped as written instead: the two-term recurrence would
/// round its frequency (relative error 1e-16/θ²).
pub(crate) const ANGLE_MIN: f64 = 1e-4;
/// Relative difference below which damping ratios, matrices that should commute and the damping of a rigid mode beside
/// the largest count as equal: the digits of a score, fitted numbers, and rounding.
pub(super) const RELATIVE_TOLERANCE: f64 = 1e-9;
/// The same for losses found from several vectors: modes of nearly equal frequency mix.
pub(super) const MIXED_MODES_TOLERANCE: f64 = 1e-6;
/// Vectors from which the loss of each mode is found: a single one may contain nothing of a mode.
pub(super) const PROBE_VECTORS: usize = 3;
/// Frequencies that differ by less count as equal [rad/s]: over a minute they drift apart by 6e-6 of a turn, -104 dB.
/// Between modes that are equal by symmetry rounding leaves less, except for the very lowest.
pub(super) const FREQUENCY_TOLERANCE: f64 = 1e-7;
/// A part of a row that is this small relative to the row is rounding.
pub(super) const ROW_ROUNDING: f64 = 1e-10;
/// Coupling below this, relative to the strongest damping, is rounding.
pub(super) const COUPLING_ROUNDING: f64 = 1e-15;
/// Frequencies that differ by less count as equal [rad/s], and all coupling below it together counts as none [1/s].
pub(super) const COUPLING_NONE: f64 = 1e-8;
/// Two real roots this close, relative to their sum, are taken as a pair that hardly swings: as separate roots their
/// residues would cancel each other.
pub(super) const CRITICAL_TOLERANCE: f64 = 1e-7;
