//! JACK, or PipeWire in its place: a client named `ergon` with ports `out_1` to `out_n`.

mod api;
mod capture;
mod client;
mod input;
mod registry;

use std::ffi::{CStr, c_ulong};
use std::sync::Arc;
use std::time::Duration;

use self::api::{PLAYBACK_LATENCY, PORT_IS_INPUT, PORT_IS_OUTPUT, PORT_IS_PHYSICAL};
use self::client::{Active, Client, Cycle, Process};
use super::AudioError;
use super::ring::Drain;
use super::shared::Shared;
use super::sink::{Opened, Sink, StartFailure};
use super::spec::Spec;

pub use self::capture::Capture;
pub(super) use self::input::open as open_input;

/// Frames that are copied to the ports at a time.
const SLICE: usize = 256;
/// Longest wait of the callback for the physics while the server runs as fast as its clients (freewheel).
const PATIENCE: Duration = Duration::from_secs(2);

/// A client of the running server, the ports that it is to be connected to, and its description; starts no server.
fn connect(
    name: &CStr,
    spec: &Spec,
    shared: &Arc<Shared>,
    direction: c_ulong,
    preposition: &str,
) -> Result<(Client, Vec<String>, String), AudioError> {
    let client = Client::open(name, shared.clone())?;
    let targets = targets(&client, spec.device.as_deref(), direction);
    let device = match targets.first() {
        Some(first) => format!("client {}, {preposition} {first} and on", client.name()),
        None => format!("client {}, not connected", client.name()),
    };
    Ok((client, targets, device))
}

/// Opens a client that plays.
pub(super) fn open(spec: &Spec, channels: usize, shared: &Arc<Shared>) -> Result<Opened, AudioError> {
    let (client, targets, device) = connect(c"ergon", spec, shared, PORT_IS_INPUT, "to")?;
    let mut remarks = Vec::new();
    if let Some(wanted_block) = spec.block.filter(|wanted_block| *wanted_block != client.block()) {
        remarks.push(format!("the server keeps its own block size, not {wanted_block}"));
    }
    if !targets.is_empty() && targets.len() < channels {
        let port_count = targets.len();
        remarks.push(format!(
            "there are {port_count} ports to play on: the first {port_count} channels are heard"
        ));
    }
    let (rate, block) = (client.rate(), client.block());
    let pattern = spec.device.clone();
    Ok(Opened {
        backend: "jack",
        device,
        rate,
        block,
        paced: true,
        remarks,
        start: Box::new(move |drain| start(client, drain, pattern.as_deref())),
    })
}

fn start(client: Client, drain: Drain, device: Option<&str>) -> Result<Box<dyn Sink>, StartFailure> {
    let channels = drain.channels();
    let callback = OutputCallback {
        scratch: vec![0.0; SLICE * channels].into(),
        drain,
    };
    let active = client
        .activate("out", channels, PORT_IS_OUTPUT, callback)
        .map_err(|(callback, error)| (Some(Box::new(callback.drain)), error))?;
    let mut playing = Playback(active);
    playing.connect_ports(device);
    playing.is_alive();
    Ok(Box::new(playing))
}

/// The ports in a direction that our ports are connected to, in their order.
fn targets(client: &Client, device: Option<&str>, direction: c_ulong) -> Vec<String> {
    let unwanted = std::env::var_os("JACK_NO_AUTOCONNECT").is_some_and(|value| !value.is_empty());
    match device {
        Some("none") => Vec::new(),
        Some(pattern) => client.find(pattern, direction),
        None if unwanted => Vec::new(),
        None => client.find("", direction | PORT_IS_PHYSICAL),
    }
}

/// The process callback, which runs in the server's thread.
struct OutputCallback {
    drain: Drain,
    scratch: Box<[f32]>,
}

impl Process for OutputCallback {
    fn cycle(&mut self, cycle: &Cycle<'_>) {
        let channels = self.drain.channels();
        for first in (0..cycle.frames()).step_by(SLICE) {
            let slice_frames = (cycle.frames() - first).min(SLICE);
            if self.drain.shared().freewheeling() {
                self.drain.wait_for(slice_frames, PATIENCE);
            }
            let slice_samples = &mut self.scratch[..slice_frames * channels];
            self.drain.fill(slice_samples);
            cycle.write(first, slice_samples);
        }
    }
}

struct Playback(Active<OutputCallback>);

impl Playback {
    fn connect_ports(&self, device: Option<&str>) {
        let client = self.0.client();
        let targets = targets(client, device, PORT_IS_INPUT);
        let port_names = self.0.port_names();
        for (output_port, target) in port_names.iter().zip(&targets) {
            client.connect(output_port, target);
        }
        // A single channel is connected to the first two loudspeakers.
        if let ([output_port], [_, second_target]) = (port_names.as_slice(), targets.as_slice()) {
            client.connect(output_port, second_target);
        }
    }
}

impl Sink for Playback {
    fn is_alive(&mut self) -> bool {
        let client = self.0.client();
        if !client.is_alive() {
            return false;
        }
        let latency = self.0.latency(PLAYBACK_LATENCY);
        client.shared().set_timing(client.block(), latency);
        true
    }

    fn stop(self: Box<Self>) -> (Option<Drain>, Option<String>) {
        let is_gone = !self.0.client().is_alive();
        let drain = self.0.close().drain;
        let stop_reason = "the server ended or changed its rate";
        (Some(drain), is_gone.then(|| stop_reason.into()))
    }
}

/// What the running server would play on.
pub(super) fn survey() -> Result<String, AudioError> {
    let client = Client::open(c"ergon_survey", Arc::<Shared>::default())?;
    let (server_rate, server_block) = (client.rate(), client.block());
    let port_count = client.find("", PORT_IS_INPUT | PORT_IS_PHYSICAL).len();
    Ok(format!(
        "a server at {server_rate} Hz, {server_block} frames at a time, {port_count} ports to play on"
    ))
}
