//! The numbers by which plans are made, each with its unit and its reason.
//!
//! Sizes of blocks, and numbers that follow from these, stand where they are used.

// What is heard.
/// The part of the audible error allowed that slow parts may take if they are only seen: the rest of the island has
/// errors too.
pub(in crate::plan) const DISPLAYED_ERROR_SHARE: f64 = 0.5;
/// Limits up to which a slow part counts as preserved: frames from kick to kick, and error [dB].
pub(in crate::plan) const PRESERVED_LIMITS: [(u32, f64); 2] = [(10, -75.0), (20, -70.0)];

// Runs that part.
/// Differences of third octaves between runs that have parted [dB]. Two runs that differ by rounding alone are up to 2
/// dB apart over 0.3 s (the bundled tamtam, struck softly to hard), so smaller differences are as good as none.
pub const SPECTRUM_NOISE_DB: f64 = 2.0;
/// Length of the first stretch over which runs are compared [s]; each later one is as long as all before it.
pub(in crate::plan) const FIRST_STRETCH_SECONDS: f64 = 1.25e-3;
/// Duration of the attack of a stroke [s].
pub(in crate::plan) const ATTACK_SECONDS: f64 = 0.02;
/// The part of the motion that a nudge takes away at each step.
pub(in crate::plan) const PERTURBATION_SHARE: f64 = 1e-12;
/// By how much the growth of a nudge may exceed that of a regular motion by chance [dB].
pub(in crate::plan) const GROWTH_MARGIN_DB: f64 = 6.0;
/// The least error that a method can have over the first millisecond of a stroke [dB].
pub(in crate::plan) const ATTACK_ERROR_MIN_DB: f64 = -120.0;
/// Waveforms further apart than this have nothing in common [dB].
pub(in crate::plan) const UNCORRELATED_DB: f64 = -10.0;

// What a pilot plays.
/// How long a pilot plays after the first contact or event [s]: long enough to hear it, short enough to cost little.
pub(in crate::plan) const PILOT_SECONDS: f64 = 0.3;
/// Parts into which the time after the first event is divided if all of it is too long to play: 50 ms, the shortest
/// time that says anything about a sound.
pub(in crate::plan) const PILOT_SPANS: usize = 6;
/// Longest excerpt [s]: if nothing touches within it, there is nothing to learn about contacts.
pub(in crate::plan) const EXCERPT_SECONDS_MAX: f64 = 10.0;
/// How often created energy is checked in a run: it may give back later what it created.
pub(in crate::plan) const ENERGY_CHECKS_PER_RUN: usize = 16;
/// An event is faint where outputs hear less than this share of what they would hear if no motion were cancelled (-80
/// dB): what friction between frames lets through of a blow that it holds, 1e-8 of it, shrinks with every step.
pub(in crate::plan) const FAINT_OUTPUT_SHARE: f64 = 1e-4;
/// An output is silent if it changes by less than this share of what it would hear if no motion were cancelled (-200
/// dB). Rounding leaves up to 1e-12 of it where friction holds a point of a body between frames.
pub(in crate::plan) const SILENT_OUTPUT_SHARE: f64 = 1e-10;

// What trials may cost.
/// Allowance of a plan for each module that is computed and heard [s]: 2.5 s for 1,000.
pub(in crate::plan) const SECONDS_PER_MODULE: f64 = 2.5e-3;
/// Least and most allowance of a plan [s].
pub(in crate::plan) const ALLOWANCE_MIN: f64 = 1.0;
pub(in crate::plan) const ALLOWANCE_MAX: f64 = 10.0;
/// The part of a plan's allowance that an island may take, however few its modules: four hard ones get the same.
pub(in crate::plan) const ISLAND_ALLOWANCE_SHARE_MIN: f64 = 0.25;
/// The reserve for measuring how long errors hold, as a share of the allowance and in addition to it.
pub(in crate::plan) const RESERVE_SHARE: f64 = 0.25;
/// Work of a search in multiples of its first run, if contacts dominate the cost: the reference takes 14, candidates
/// with up to four times as many substeps 7.
pub(in crate::plan) const SEARCH_COST_IN_FIRST_RUNS: f64 = 24.0;
/// The part of the remaining allowance that one family may take.
pub(in crate::plan) const FAMILY_ALLOWANCE_SHARE: f64 = 0.4;
/// A doubling is played if this multiple of the work of the run before is left.
pub(in crate::plan) const DOUBLING_WORK_FACTOR: f64 = 2.0;

// The reference and the search.
/// A reference is this much more exact than what is asked for [dB], by waveform or by ear: its error then changes that
/// of a candidate by 2.5 dB at most.
pub(in crate::plan) const REFERENCE_MARGIN_DB: f64 = 12.0;
/// Whatever is asked for, a reference of a waveform is this exact [dB]: at -80 dB too, so that a plan for less sees the
/// same errors of the same candidates.
pub(in crate::plan) const REFERENCE_ERROR_DB_MAX: f64 = -92.0;
/// Runs that take less work are doubled until no difference of pitch or decay is left, and not only none that is more
/// than chance [s]: a piece has tens of islands, and a second of planning is what a composer waits for.
pub(in crate::plan) const SHORT_RUN_SECONDS: f64 = 0.02;
/// Errors that differ by less count as equal [dB]: a doubling that gains less ends a family of references; if none is
/// within the budget, one of higher cost is taken only if its error is lower by more; an error that grows by less after
/// a pilot is the pilot's.
pub(in crate::plan) const EQUAL_ERRORS_DB: f64 = 3.0;
/// Orders of convergence that are believed. Kinks of laws and stops of friction have less than order 1; a faster fall
/// from one doubling to the next may be chance.
pub(in crate::plan) const CONVERGENCE_ORDERS: [f64; 2] = [0.5, 1.0];
/// Errors estimated from two runs may be too low by this [dB]: by 3.4 in the worst of the 138 scenes of
/// docs/accuracy.md at three budgets, before this was added. Margin below the budget where errors may grow after the
/// pilot (`keys-105` of the audit: by 3.4).
pub(in crate::plan) const ESTIMATE_MARGIN_DB: f64 = 3.5;
/// A candidate may create this share of the energy that is there: half of what is reported.
pub(in crate::plan) const CREATED_ENERGY_SHARE_MAX: f64 = 0.005;
/// A run is first compared after one part in this number of its first span.
pub(in crate::plan) const EARLY_SPAN_DIVISOR: usize = 4;
/// Its difference there exceeds the final one by at most this [dB].
pub(in crate::plan) const EARLY_MARGIN_DB: f64 = 12.0;
/// Most steps a frame of a candidate that a plan may choose.
pub(in crate::plan) const OVERSAMPLING_MAX: u32 = 8;

// How long errors hold.
/// Time between two checks of the error [s].
pub(in crate::plan) const ERROR_CHECK_SECONDS: f64 = 0.1;
/// A strike or a gesture is harder than another by this factor. Errors of laws that harden grow with the square of the
/// impulse, so by 3.9 dB, about what estimates are in doubt anyway.
pub(in crate::plan) const HARDER_EVENT_RATIO: f64 = 1.25;
/// Time for which the last event is heard [s].
pub(in crate::plan) const LAST_EVENT_SECONDS: f64 = 8.0;
/// The part of the reserve that is planned for: contacts and guards add to the cost of a run.
pub(in crate::plan) const RESERVE_PLANNED_SHARE: f64 = 0.5;
/// The part of what is left after the first run that the second may be expected to take.
pub(in crate::plan) const RESERVE_USABLE_SHARE: f64 = 0.9;

// Slow parts and their stability.
/// Keys are made slow only if the island then costs at most this part of its cost before.
pub(in crate::plan) const SLOW_COST_RATIO_MAX: f64 = 0.95;
/// Largest turn of the modes of a key from kick to kick for which it is made slow [rad]: R·√λ ≤ 1, with R half the
/// stability limit. No such key grew in scans without damping.
pub(in crate::plan) const KEY_KICK_PHASE_MAX: f64 = 1.0;

/// Most attempts to leave modes out.
pub(in crate::plan) const PRUNE_TRIALS_MAX: usize = 4;
