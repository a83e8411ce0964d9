//! Trials: the beginning of an island is played to measure the error of ways to compute it.

pub(in crate::plan) mod allowance;
pub(in crate::plan) mod candidates;
pub(in crate::plan) mod chaos;
pub(in crate::plan) mod displayed_rate;
pub(in crate::plan) mod horizon;
pub(in crate::plan) mod multirate;
pub(in crate::plan) mod pilot;
pub(in crate::plan) mod pilot_result;
pub(in crate::plan) mod pilot_run;
pub(in crate::plan) mod prune_modes;
pub(in crate::plan) mod record;
pub(in crate::plan) mod reference;
pub(in crate::plan) mod run_cache;
pub(in crate::plan) mod search;
pub(in crate::plan) mod silence;
pub(in crate::plan) mod stored_modes;
pub(in crate::plan) mod waveform_error;
