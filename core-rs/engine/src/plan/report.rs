//! What a plan reports, and the hashes by which it is recognised.

pub(crate) mod bank_content;
pub(crate) mod content;
pub(in crate::plan) mod hash;
pub(in crate::plan) mod row;
