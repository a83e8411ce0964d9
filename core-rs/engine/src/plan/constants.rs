//! The numbers by which plans are made, each with its unit and its reason.
//!
//! Measured costs stand in `costs.txt`. Sizes of blocks, and numbers that follow from these, stand where they are used.

use std::f64::consts::PI;

use crate::island::slow;

// What is heard.
/// Above this frequency a sound hardly has a pitch [Hz].
pub const PITCH_HERTZ_MAX: f64 = 5_000.0;
/// Loudness of all left-out partials together, relative to the sound, if the budget is one of pitch [dB]: masked by the
/// rest, and below the noise of a 16-bit file at any usual level.
pub(in crate::plan) const LEFT_OUT_LEVEL_MAX: f64 = -80.0;
/// Accuracy of contacts, and of all whose audible error is not known, if the budget is one of pitch [dB]. A reference
/// that is surer than this is not chaotic.
pub const INAUDIBLE_ERROR_DB: f64 = -60.0;
/// The part of the audible error allowed that slow parts may take if they are only seen: the rest of the island has
/// errors too.
pub(in crate::plan) const SEEN_SHARE: f64 = 0.5;
/// Limits up to which a slow part counts as preserved: frames from kick to kick, and error [dB].
pub(in crate::plan) const PRESERVED_LIMITS: [(u32, f64); 2] = [(10, -75.0), (20, -70.0)];

/// Multiples of `SHORTEST_SECONDS` over which loudness is compared.
pub(in crate::plan) const LOUDNESS_SPANS: usize = 20;

// Runs that part.
/// Differences of third octaves between runs that have parted [dB]. Two runs that differ by rounding alone are up to 2
/// dB apart over 0.3 s (the bundled tamtam, struck softly to hard), so smaller differences are as good as none.
pub const SPECTRUM_NOISE: f64 = 2.0;
/// Length of the first stretch over which runs are compared [s]; each later one is as long as all before it.
pub(in crate::plan) const FIRST_STRETCH_SECONDS: f64 = 1.25e-3;
/// Duration of the attack of a stroke [s].
pub(in crate::plan) const ATTACK_SECONDS: f64 = 0.02;
/// The part of the motion that a nudge takes away at each step.
pub(in crate::plan) const NUDGE_SHARE: f64 = 1e-12;
/// Growth a stretch of a nudge that grows with the square of time [dB], and the tolerance between two stretches [dB].
pub(in crate::plan) const REGULAR_GROWTH: (f64, f64) = (12.04, 6.0);
/// The least error that a method can have over the first millisecond of a stroke [dB].
pub(in crate::plan) const ATTACK_ERROR_MIN: f64 = -120.0;
/// Waveforms further apart than this have nothing in common [dB].
pub(in crate::plan) const PARTED_DB: f64 = -10.0;

// What a pilot plays.
/// How long a pilot plays after the first contact or event [s]: long enough to hear it, short enough to cost little.
pub(in crate::plan) const PILOT_SECONDS: f64 = 0.3;
/// Parts into which the time after the first event is divided if all of it is too long to play: 50 ms, the shortest
/// time that says anything about a sound.
pub(in crate::plan) const PILOT_PARTS: usize = 6;
/// Longest excerpt [s]: if nothing touches within it, there is nothing to learn about contacts.
pub(in crate::plan) const EXCERPT_SECONDS_MAX: f64 = 10.0;
/// How often created energy is checked in a run: it may give back later what it created.
pub(in crate::plan) const ENERGY_CHECKS: usize = 16;
/// An event is faint where outputs hear less than this share of what they would hear if no motion were cancelled (-80
/// dB): what friction between frames lets through of a blow that it holds, 1e-8 of it, shrinks with every step.
pub(in crate::plan) const FAINT_SHARE: f64 = 1e-4;
/// An output is silent if it changes by less than this share of what it would hear if no motion were cancelled (-200
/// dB). Rounding leaves up to 1e-12 of it where friction holds a point of a body between frames.
pub(in crate::plan) const SILENT_SHARE: f64 = 1e-10;
/// Most samples of sound that are kept.
pub(in crate::plan) const SAMPLES_MAX: usize = 1 << 24;
/// Most lengths that are remembered for one island.
pub(in crate::plan) const LENGTHS_MAX: usize = 8;
/// Events within this many frames after an instant count as before it, because events are rounded to frames and strikes
/// are spread over two frames.
pub(in crate::plan) const ROUNDED_FRAMES: u64 = 4;

// What trials may cost.
/// A number of modules that are computed and heard, and the allowance of a plan of at most so many [s]. The allowance
/// is linear between this and `ALLOWANCE_LARGE`, proportional to the modules above that, at most `ALLOWANCE_MAX`.
pub(in crate::plan) const ALLOWANCE_SMALL: (usize, f64) = (100, 1.0);
/// The same of a plan of more modules.
pub(in crate::plan) const ALLOWANCE_LARGE: (usize, f64) = (1_000, 2.5);
/// Most allowance of a plan [s].
pub(in crate::plan) const ALLOWANCE_MAX: f64 = 10.0;
/// The reserve for measuring how long errors hold, as a share of the allowance and in addition to it.
pub(in crate::plan) const ALLOWANCE_RESERVE: f64 = 0.25;
/// Most work of a pilot, and of a test of stability [s]. If eigenvalues would take more, the island is simulated
/// instead; if that would take more too, its stability stays unknown. The bound does not depend on what is left of the
/// allowance, so that a kept plan decides as it did when it was made.
pub(in crate::plan) const TRIAL_WORK_MAX: f64 = 0.5;
/// Work of a search in multiples of its first run, if contacts dominate the cost: the reference takes 14, candidates
/// with up to four times as many substeps 7.
pub(in crate::plan) const SEARCH_COST: f64 = 24.0;
/// The part of the remaining allowance that one family may take.
pub(in crate::plan) const FAMILY_SHARE: f64 = 0.4;
/// A doubling is played if this multiple of the work of the run before is left.
pub(in crate::plan) const DOUBLING_RESERVE: f64 = 2.0;
/// Work of comparing one sample of an output with others [s].
pub(in crate::plan) const COMPARISON_SECONDS: f64 = 2e-8;
/// Work of the eigenvalues, for the cube of the state's size [s].
pub(in crate::plan) const EIGENVALUES_SECONDS: f64 = 8e-9;
/// Work of a number of a state, or of a link, in a frame [s].
pub(in crate::plan) const NUMBER_SECONDS: f64 = 0.4e-9;
/// Work of an eigenvalue solution, for the cube of the number of modes [s].
pub(in crate::plan) const SOLVE_SECONDS: f64 = 0.5e-9;

// The reference and the search.
/// A reference is this much more exact than the waveform that is asked for [dB]: its error then changes that of a
/// candidate by 2.5 dB at most.
pub(in crate::plan) const REFERENCE_MARGIN_DB: f64 = 12.0;
/// Whatever is asked for, a reference of a waveform is this exact [dB]: at -80 dB too, so that a plan for less sees the
/// same errors of the same candidates.
pub(in crate::plan) const REFERENCE_DB: f64 = -92.0;
/// By ear a reference is exact enough if its audible error is this part of what is allowed.
pub(in crate::plan) const REFERENCE_SHARE: f64 = 0.2;
/// Errors that differ by less count as equal [dB]: a doubling that gains less ends a family of references; if none is
/// within the budget, one of higher cost is taken only if its error is lower by more; an error that grows by less after
/// a pilot is the pilot's.
pub(in crate::plan) const EQUAL_ERRORS_DB: f64 = 3.0;
/// The same of audible errors, as a factor.
pub(in crate::plan) const EQUAL_ERRORS_RATIO: f64 = 1.5;
/// Orders of convergence that are believed. Kinks of laws and stops of friction have less than order 1; a faster fall
/// from one doubling to the next may be chance.
pub(in crate::plan) const CONVERGENCE_ORDERS: [f64; 2] = [0.5, 1.0];
/// A factor of 2 [dB]: what an error of order 1 falls by when the step is halved.
pub(in crate::plan) const FACTOR_TWO_DB: f64 = 6.02;
/// Margin below the budget for what comes after the pilot, over which the runs are compared [dB]. If twice as many
/// substeps lower the error by less, still more do not help.
pub(in crate::plan) const BUDGET_MARGIN_DB: f64 = 0.1;
/// Errors estimated from two runs may be too low by this [dB]: by 3.4 in the worst of the 138 scenes of
/// docs/accuracy.md at three budgets, before this was added. Margin below the budget where errors may grow after the
/// pilot (`keys-105` of the audit: by 3.4).
pub(in crate::plan) const ESTIMATE_MARGIN_DB: f64 = 3.5;
/// A candidate may create this share of the energy that is there: half of what is reported.
pub(in crate::plan) const CREATED_SHARE_MAX: f64 = 0.005;
/// A run is first compared after one part in `EARLY_CHECK.0` of its first span; its difference there exceeds the final
/// one by at most `EARLY_CHECK.1` [dB].
pub(in crate::plan) const EARLY_CHECK: (usize, f64) = (4, 12.0);
/// The part of an error budget for left-out modes, and for contacts [dB]; the predictor of their loudness is within 1.1
/// dB.
pub(in crate::plan) const BUDGET_SHARE_DB: f64 = -6.0;
/// Most steps a frame of a candidate that a plan may choose.
pub(in crate::plan) const OVERSAMPLING_MAX: u32 = 8;
/// Most substeps a frame of contacts that are computed finer than a frame; more would be slower than they are worth.
pub(in crate::plan) const SUBSTEPS_MAX: usize = 64;
/// Contact substeps a step of a reference. If contacts take more than the part `COSTLY_SHARE` of the cost, a doubling
/// doubles nearly all work, so it begins at `FINE_SUBSTEPS_MIN`.
pub(in crate::plan) const REFERENCE_SUBSTEPS: usize = 32;
/// The part of the cost above which contacts count as costly.
pub(in crate::plan) const COSTLY_SHARE: f64 = 0.5;

// How long errors hold.
/// Time between two checks of the error [s].
pub(in crate::plan) const ERROR_CHECK_SECONDS: f64 = 0.1;
/// A strike or a gesture is harder than another by this factor. Errors of laws that harden grow with the square of the
/// impulse, so by 3.9 dB, about what estimates are in doubt anyway.
pub(in crate::plan) const HARDER_RATIO: f64 = 1.25;
/// Time for which the last event is heard [s].
pub(in crate::plan) const RING_SECONDS: f64 = 8.0;
/// The part of the reserve that is planned for: contacts and guards add to the cost of a run.
pub(in crate::plan) const RESERVE_PLANNED: f64 = 0.5;
/// The part of what is left after the first run that the second may be expected to take.
pub(in crate::plan) const RESERVE_FITS: f64 = 0.9;

// Slow parts and their stability.
/// Keys are made slow only if the island then costs at most this part of its cost before.
pub(in crate::plan) const SLOW_COST_RATIO_MAX: f64 = 0.95;
/// Largest turn of the modes of a key from kick to kick for which it is made slow [rad]: R·√λ ≤ 1, with R half the
/// stability limit. No such key grew in scans without damping.
pub(in crate::plan) const KEY_TURN_MAX: f64 = 1.0;
/// Largest turn of a mode between two kicks [rad]; above it the kicks do not resolve the mode.
pub(in crate::plan) const TURN_MAX: f64 = 0.9 * PI;
/// Most masses of a body: with more, dense products are hardly cheaper than stepping, and computing the flow takes
/// seconds.
pub(in crate::plan) const FLOW_MASSES_MAX: usize = slow::MASSES_MAX;
/// Largest state of which all eigenvalues are computed.
pub(in crate::plan) const DENSE_MAX: usize = 240;
/// Tolerance for eigenvalues on the unit circle: rounding moves them off it, and double ones (a free mass) by the root
/// of that.
pub(in crate::plan) const UNIT_CIRCLE_TOLERANCE: f64 = 3e-7;
/// Kicks for which a large island is simulated.
pub(in crate::plan) const TRIAL_KICKS: usize = 2_000;
/// Its permitted growth at each kick: its energy fluctuates by that much.
pub(in crate::plan) const GROWTH_TOLERANCE: f64 = 3e-5;
/// Longest time between common kicks of all slow parts [frames]; above it the map is not computed.
pub(in crate::plan) const COMMON_FRAMES_MAX: u64 = 20_000;

// Which bodies go by modes, and which modes are left out.
/// Fewest masses of a body that nothing touches between frames: fewer are stepped as quickly as by modes.
pub(in crate::plan) const MODAL_MASSES_MIN: usize = 4;
/// Ports that a body may have, however few its masses: contacts at all of them cost less by modes than with a mesh
/// stepped as finely (60 on 100 masses: a fifth).
pub(in crate::plan) const PORTS_ANY: usize = 64;
/// A body with more ports goes by modes only if at most one in this many masses is a port (200 on 400 masses took 14
/// times as long as the mesh).
pub(in crate::plan) const MASSES_PER_PORT: usize = 4;
/// Largest cost of a body by complex modes, as a multiple of stepping it: complex modes are exact, which no stepping at
/// that multiple of the rate is.
pub(in crate::plan) const COST_RATIO_MAX: f64 = 2.0;
/// Most ties of a body that may be stepped beside its modes: for a body that hangs in a few places.
pub(in crate::plan) const TIES_MAX: usize = 8;
/// Modes are left out only if those kept cost at most this part of all: with all modes there is no error.
pub(in crate::plan) const TRUNCATED_COST_RATIO_MAX: f64 = 0.5;
/// Time over which energies are compared [s]: at the beginning, where high modes, which fade first, count most.
pub(in crate::plan) const ENERGY_SPAN: f64 = 0.1;
/// Least reduction of the permitted loudness of left-out modes after a failed attempt [dB].
pub(in crate::plan) const QUIETER_STEP_DB: f64 = 2.0;
/// Most attempts to leave modes out.
pub(in crate::plan) const PRUNE_TRIES: usize = 4;

// What counts as rounding in slow parts.
/// Stiffness below this part of the largest is rounding: nothing holds the body in such a mode.
pub(in crate::plan) const LOOSE_STIFFNESS_RATIO: f64 = 1e-12;

// What the table of costs does not measure.
/// Instants of a frame: 8 to 10 for strings of 17 to 35 masses, plus a reserve for what lies between modes.
pub(in crate::plan) const LAW_INSTANTS: f64 = 12.0;
/// Rounds in which laws agree on their forces.
pub(in crate::plan) const LAW_ROUNDS: f64 = 3.0;
/// The share of the possible parts of a frame that are computed on average (a rope that is stretched 800 times a
/// second).
pub(in crate::plan) const LAW_PARTS: f64 = 0.25;
