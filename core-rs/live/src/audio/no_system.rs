//! Stand-in for the system backend where it is not built.

use super::sink::Opened;
use super::{AudioError, Spec};

const WHY: &str = "used on macOS and Windows only; use jack or pulse here";

fn missing() -> AudioError {
    AudioError::Unavailable {
        backend: "system",
        why: WHY.into(),
    }
}

pub(super) fn open(_: &Spec, _: u32, _: usize) -> Result<Opened, AudioError> {
    Err(missing())
}

pub(super) fn survey() -> Result<String, AudioError> {
    Err(missing())
}
