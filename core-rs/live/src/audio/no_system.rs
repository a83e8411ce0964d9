//! Stand-in for the system backend where it is not built.

use super::sink::OpenedOutput;
use super::{AudioError, AudioSpec};

const MISSING_REASON: &str = "used on macOS and Windows only; use jack or pulse here";

fn unavailable_error() -> AudioError {
    AudioError::Unavailable {
        backend: "system",
        reason: MISSING_REASON.into(),
    }
}

pub(super) fn open(_: &AudioSpec, _: u32, _: usize) -> Result<OpenedOutput, AudioError> {
    Err(unavailable_error())
}

pub(super) fn survey() -> Result<String, AudioError> {
    Err(unavailable_error())
}
