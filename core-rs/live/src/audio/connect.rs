//! From what was asked to an output that is there; and what there is to be asked.

use std::sync::Arc;

use super::shared::Shared;
use super::sink::Opened;
use super::spec::{Backend, Spec};
use super::{AudioError, file, jack, null, pulse, system};

const HAS_SYSTEM: bool = cfg!(any(target_os = "macos", windows));

/// Open what `spec` names; for `auto`, the first that is there. Returns what was found, too.
pub(super) fn connect(
    spec: &Spec,
    rate: u32,
    channels: usize,
    shared: &Arc<Shared>,
) -> Result<(Opened, Spec), AudioError> {
    let opened = match &spec.backend {
        Backend::Auto => return first(spec, rate, channels, shared),
        Backend::Jack => jack::open(spec, channels, shared)?,
        Backend::Pulse => pulse::open(spec, channels)?,
        Backend::System => system::open(spec, rate, channels)?,
        Backend::File(path) => file::open(path, rate, channels, None)?,
        Backend::Clock(path) => file::open(path, rate, channels, Some(spec.block))?,
        Backend::Null => null::open(rate, spec.block),
        Backend::Fast => null::fast(rate, spec.block),
    };
    Ok((opened, spec.clone()))
}

fn first(
    spec: &Spec,
    rate: u32,
    channels: usize,
    shared: &Arc<Shared>,
) -> Result<(Opened, Spec), AudioError> {
    let mut without = Vec::new();
    let mut backends = vec![
        Backend::Jack,
        Backend::Pulse,
        Backend::System,
        Backend::Null,
    ];
    // A system without it is not to be told so each time.
    backends.retain(|backend| HAS_SYSTEM || *backend != Backend::System);
    for backend in backends {
        let found = Spec {
            backend,
            ..spec.clone()
        };
        match connect(&found, rate, channels, shared) {
            Ok((mut opened, found)) => {
                opened.remarks.append(&mut without);
                return Ok((opened, found));
            }
            Err(error) => without.push(format!("not {found}: {error}")),
        }
    }
    Err(AudioError::Unavailable {
        backend: "auto",
        why: without.join("; "),
    })
}

/// What there is: for each backend what it would play on, or why it cannot be had. Starts no server.
#[must_use]
pub fn survey() -> Vec<(String, Result<String, String>)> {
    let told = |found: Result<String, AudioError>| found.map_err(|error| error.to_string());
    let mut found = vec![
        ("jack".into(), told(jack::survey())),
        ("pulse".into(), told(pulse::survey())),
    ];
    if HAS_SYSTEM {
        found.push(("system".into(), told(system::survey())));
    }
    found.extend([
        ("null".into(), Ok("in real time, without sound".into())),
        (
            "file".into(),
            Ok("file:PATH writes a WAVE file, clock:PATH writes one in real time".into()),
        ),
    ]);
    found
}
