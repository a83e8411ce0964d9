//! What a plan tells of itself, and how it is known again.

pub(crate) mod content;
pub(in crate::plan) mod hash;
pub(in crate::plan) mod row;
