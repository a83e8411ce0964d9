//! PulseAudio, or PipeWire in its place, by the PulseAudio protocol: a stream named `ergon`.

#[cfg(unix)]
mod record;
#[cfg(unix)]
mod stream;
#[cfg(unix)]
mod wire;

#[cfg(unix)]
pub(super) use record::open as open_input;
#[cfg(unix)]
pub(super) use stream::{open, survey};

#[cfg(not(unix))]
mod absent {
    use crate::audio::sink::OpenedOutput;
    use crate::audio::source::OpenedInput;
    use crate::audio::{AudioError, AudioSpec};

    const NOWHERE: AudioError = AudioError::Unavailable {
        backend: "pulse",
        reason: String::new(),
    };

    pub(in crate::audio) fn open(_: &AudioSpec, _: usize) -> Result<OpenedOutput, AudioError> {
        Err(NOWHERE)
    }

    pub(in crate::audio) fn open_input(_: &AudioSpec, _: usize) -> Result<OpenedInput, AudioError> {
        Err(NOWHERE)
    }

    pub(in crate::audio) fn survey() -> Result<String, AudioError> {
        Err(NOWHERE)
    }
}
#[cfg(not(unix))]
pub(super) use absent::{open, open_input, survey};
