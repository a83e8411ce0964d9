//! The numbers by which islands are assembled, each with its unit and its reason.
//!
//! Measured costs stand in `costs.txt`.

use std::f64::consts::PI;

use crate::island::slow;

// What is heard.
/// Above this frequency a sound hardly has a pitch [Hz].
pub const PITCH_HERTZ_MAX: f64 = 5_000.0;
/// Loudness of all left-out partials together, relative to the sound, if the budget is one of pitch [dB]: masked by the
/// rest, and below the noise of a 16-bit file at any usual level.
pub(crate) const LEFT_OUT_DB_MAX: f64 = -80.0;
/// Accuracy of contacts, and of all whose audible error is not known, if the budget is one of pitch [dB]. A reference
/// that is surer than this is not chaotic.
pub const INAUDIBLE_ERROR_DB: f64 = -60.0;
/// Multiples of `SHORTEST_SECONDS` over which loudness is compared.
pub(crate) const LOUDNESS_SPANS: usize = 20;

// What trials may cost.
/// Most work of a pilot, and of a test of stability [s]. If eigenvalues would take more, the island is simulated
/// instead; if that would take more too, its stability stays unknown. The bound does not depend on what is left of the
/// allowance, so that a kept plan decides as it did when it was made.
pub(crate) const TRIAL_WORK_MAX: f64 = 0.5;

// The reference and the search.
/// The part of an error budget for left-out modes, and for contacts [dB]; the predictor of their loudness is within 1.1
/// dB.
pub(crate) const BUDGET_SHARE_DB: f64 = -6.0;
/// Most substeps a frame of contacts that are computed finer than a frame; more would be slower than they are worth.
pub(crate) const SUBSTEPS_MAX: usize = 64;

// Slow parts and their stability.
/// Largest turn of a mode between two kicks [rad]; above it the kicks do not resolve the mode.
pub(crate) const KICK_TURN_RADIANS_MAX: f64 = 0.9 * PI;
/// Most masses of a body: with more, dense products are hardly cheaper than stepping, and computing the flow takes
/// seconds.
pub(crate) const FLOW_MASSES_MAX: usize = slow::MASSES_MAX;
/// Largest state of which all eigenvalues are computed.
pub(crate) const DENSE_STATE_MAX: usize = 240;
/// Tolerance for eigenvalues on the unit circle: rounding moves them off it, and double ones (a free mass) by the root
/// of that.
pub(crate) const UNIT_CIRCLE_TOLERANCE: f64 = 3e-7;
/// Kicks for which a large island is simulated.
pub(crate) const TRIAL_KICKS: usize = 2_000;
/// Its permitted growth at each kick: its energy fluctuates by that much.
pub(crate) const GROWTH_TOLERANCE: f64 = 3e-5;
/// Longest time between common kicks of all slow parts [frames]; above it the map is not computed.
pub(crate) const COMMON_FRAMES_MAX: u64 = 20_000;

// Which bodies go by modes, and which modes are left out.
/// Fewest masses of a body that nothing touches between frames: fewer are stepped as quickly as by modes.
pub(crate) const MODAL_MASSES_MIN: usize = 4;
/// Ports that a body may have, however few its masses: contacts at all of them cost less by modes than with a mesh
/// stepped as finely (60 on 100 masses: a fifth).
pub(crate) const PORTS_ALWAYS_ALLOWED: usize = 64;
/// A body with more ports goes by modes only if at most one in this many masses is a port (200 on 400 masses took 14
/// times as long as the mesh).
pub(crate) const MASSES_PER_PORT: usize = 4;
/// Largest cost of a body by complex modes, as a multiple of stepping it: complex modes are exact, which no stepping at
/// that multiple of the rate is.
pub(crate) const COMPLEX_COST_RATIO_MAX: f64 = 2.0;
/// Most ties of a body that may be stepped beside its modes: for a body that hangs in a few places.
pub(crate) const STEPPED_TIES_MAX: usize = 8;
/// Modes are left out only if those kept cost at most this part of all: with all modes there is no error.
pub(crate) const TRUNCATED_COST_RATIO_MAX: f64 = 0.5;
/// Time over which energies are compared [s]: at the beginning, where high modes, which fade first, count most.
pub(crate) const ENERGY_SECONDS: f64 = 0.1;
/// Least reduction of the permitted loudness of left-out modes after a failed attempt [dB].
pub(crate) const QUIETER_STEP_DB: f64 = 2.0;

// What counts as rounding in slow parts.
/// Stiffness below this part of the largest is rounding: nothing holds the body in such a mode.
pub(crate) const LOOSE_STIFFNESS_RATIO: f64 = 1e-12;

// What the table of costs does not measure.
/// Instants of a frame: 8 to 10 for strings of 17 to 35 masses, plus a reserve for what lies between modes.
pub(crate) const LAW_INSTANTS: f64 = 12.0;
/// Rounds in which laws agree on their forces.
pub(crate) const LAW_ROUNDS: f64 = 3.0;
/// The share of the possible parts of a frame that are computed on average (a rope that is stretched 800 times a
/// second).
pub(crate) const LAW_PARTS_SHARE: f64 = 0.25;
