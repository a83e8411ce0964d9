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
use self::client::{ActiveClient, Client, ProcessCallback, ProcessCycle};
use super::AudioError;
use super::ring::RingReader;
use super::sink::{OpenedOutput, OutputFailure, Sink};
use super::spec::AudioSpec;
use super::stream_state::StreamState;

pub use self::capture::Capture;
pub(super) use self::input::open as open_input;

/// Frames that are copied to the ports at a time.
const SLICE_FRAMES: usize = 256;
/// Longest wait of the callback for the physics while the server runs as fast as its clients (freewheel).
const FREEWHEEL_TIMEOUT: Duration = Duration::from_secs(2);

/// A client of the running server, the ports that it is to be connected to, and its description; starts no server.
fn connect(
    name: &CStr,
    spec: &AudioSpec,
    stream_state: &Arc<StreamState>,
    direction: c_ulong,
    preposition: &str,
) -> Result<(Client, Vec<String>, String), AudioError> {
    let client = Client::open(name, stream_state.clone())?;
    let targets = target_ports(&client, spec.target.as_deref(), direction);
    let device = match targets.first() {
        Some(first) => format!("client {}, {preposition} {first} and on", client.name()),
        None => format!("client {}, not connected", client.name()),
    };
    Ok((client, targets, device))
}

/// Opens a client that plays.
pub(super) fn open(
    spec: &AudioSpec,
    channels: usize,
    stream_state: &Arc<StreamState>,
) -> Result<OpenedOutput, AudioError> {
    let (client, targets, device) = connect(c"ergon", spec, stream_state, PORT_IS_INPUT, "to")?;
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
    let pattern = spec.target.clone();
    Ok(OpenedOutput {
        backend: "jack",
        device,
        rate,
        block,
        is_paced: true,
        remarks,
        start: Box::new(move |ring_reader| start(client, ring_reader, pattern.as_deref())),
    })
}

fn start(client: Client, ring_reader: RingReader, device: Option<&str>) -> Result<Box<dyn Sink>, OutputFailure> {
    let channels = ring_reader.channels();
    let callback = OutputCallback {
        scratch: vec![0.0; SLICE_FRAMES * channels].into(),
        ring_reader,
    };
    let active_client = client
        .activate("out", channels, PORT_IS_OUTPUT, callback)
        .map_err(|(callback, error)| (Some(Box::new(callback.ring_reader)), error))?;
    let mut playback = Playback(active_client);
    playback.connect_ports(device);
    playback.is_alive();
    Ok(Box::new(playback))
}

/// The ports in a direction that our ports are connected to, in their order.
fn target_ports(client: &Client, device: Option<&str>, direction: c_ulong) -> Vec<String> {
    let is_autoconnect_off = std::env::var_os("JACK_NO_AUTOCONNECT").is_some_and(|value| !value.is_empty());
    match device {
        Some("none") => Vec::new(),
        Some(pattern) => client.find(pattern, direction),
        None if is_autoconnect_off => Vec::new(),
        None => client.find("", direction | PORT_IS_PHYSICAL),
    }
}

/// The process callback, which runs in the server's thread.
struct OutputCallback {
    ring_reader: RingReader,
    scratch: Box<[f32]>,
}

impl ProcessCallback for OutputCallback {
    fn process(&mut self, cycle: &ProcessCycle<'_>) {
        let channels = self.ring_reader.channels();
        for first_frame in (0..cycle.frames()).step_by(SLICE_FRAMES) {
            let slice_frames = (cycle.frames() - first_frame).min(SLICE_FRAMES);
            if self.ring_reader.stream_state().is_freewheeling() {
                self.ring_reader.wait_for(slice_frames, FREEWHEEL_TIMEOUT);
            }
            let slice_samples = &mut self.scratch[..slice_frames * channels];
            self.ring_reader.fill(slice_samples);
            cycle.write(first_frame, slice_samples);
        }
    }
}

struct Playback(ActiveClient<OutputCallback>);

impl Playback {
    fn connect_ports(&self, device: Option<&str>) {
        let client = self.0.client();
        let target_ports = target_ports(client, device, PORT_IS_INPUT);
        let port_names = self.0.port_names();
        for (output_port, target) in port_names.iter().zip(&target_ports) {
            client.connect(output_port, target);
        }
        // A single channel is connected to the first two loudspeakers.
        if let ([output_port], [_, second_target]) = (port_names.as_slice(), target_ports.as_slice()) {
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
        client.stream_state().set_timing(client.block(), latency);
        true
    }

    fn stop(self: Box<Self>) -> (Option<RingReader>, Option<String>) {
        let has_server_ended = !self.0.client().is_alive();
        let ring_reader = self.0.close().ring_reader;
        let stop_reason = "the server ended or changed its rate";
        (Some(ring_reader), has_server_ended.then(|| stop_reason.into()))
    }
}

/// What the running server would play on.
pub(super) fn survey() -> Result<String, AudioError> {
    let client = Client::open(c"ergon_survey", Arc::<StreamState>::default())?;
    let (server_rate, server_block) = (client.rate(), client.block());
    let port_count = client.find("", PORT_IS_INPUT | PORT_IS_PHYSICAL).len();
    Ok(format!(
        "a server at {server_rate} Hz, {server_block} frames at a time, {port_count} ports to play on"
    ))
}
