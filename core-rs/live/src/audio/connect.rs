//! Opens the output that a `AudioSpec` names, and lists the available outputs.

use std::sync::Arc;

use super::sink::OpenedOutput;
use super::spec::{AudioSpec, Backend};
use super::stream_state::StreamState;
use super::{AudioError, file, jack, null, pulse, system};

const HAS_SYSTEM_BACKEND: bool = cfg!(any(target_os = "macos", windows));

/// Opens the output that `spec` names; for `auto`, the first one available. Also returns the spec of the output found.
pub(super) fn connect(
    spec: &AudioSpec,
    rate: u32,
    channels: usize,
    stream_state: &Arc<StreamState>,
) -> Result<(OpenedOutput, AudioSpec), AudioError> {
    let opened_output = match &spec.backend {
        Backend::Auto => return first_available(spec, rate, channels, stream_state),
        Backend::Jack => jack::open(spec, channels, stream_state)?,
        Backend::Pulse => pulse::open(spec, channels)?,
        Backend::System => system::open(spec, rate, channels)?,
        Backend::File(path) => file::open(path, rate, channels, None)?,
        Backend::RealTimeFile(path) => file::open(path, rate, channels, Some(spec.block))?,
        Backend::NullRealTime => null::open_paced(rate, spec.block),
        Backend::NullUnpaced => null::open_unpaced(rate, spec.block),
    };
    Ok((opened_output, spec.clone()))
}

fn first_available(
    spec: &AudioSpec,
    rate: u32,
    channels: usize,
    stream_state: &Arc<StreamState>,
) -> Result<(OpenedOutput, AudioSpec), AudioError> {
    let mut failures = Vec::new();
    let mut backends = vec![Backend::Jack, Backend::Pulse, Backend::System, Backend::NullRealTime];
    // Where there is no system backend, its absence is not worth a remark.
    backends.retain(|backend| HAS_SYSTEM_BACKEND || *backend != Backend::System);
    for backend in backends {
        let candidate = AudioSpec {
            backend,
            ..spec.clone()
        };
        match connect(&candidate, rate, channels, stream_state) {
            Ok((mut opened_output, candidate)) => {
                opened_output.remarks.append(&mut failures);
                return Ok((opened_output, candidate));
            }
            Err(error) => failures.push(format!("{candidate} is not available: {error}")),
        }
    }
    Err(AudioError::Unavailable {
        backend: "auto",
        reason: failures.join("; "),
    })
}

/// For each backend what it would play on, or why it is not available. Starts no server.
#[must_use]
pub fn survey() -> Vec<(String, Result<String, String>)> {
    let as_text = |result: Result<String, AudioError>| result.map_err(|error| error.to_string());
    let mut surveys = vec![
        ("jack".into(), as_text(jack::survey())),
        ("pulse".into(), as_text(pulse::survey())),
    ];
    if HAS_SYSTEM_BACKEND {
        surveys.push(("system".into(), as_text(system::survey())));
    }
    surveys.extend([
        ("null".into(), Ok("in real time, without sound".into())),
        (
            "file".into(),
            Ok("file:PATH writes a WAVE file, clock:PATH writes one in real time".into()),
        ),
    ]);
    surveys
}
