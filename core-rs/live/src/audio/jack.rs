//! JACK, or PipeWire in its place: a client named `ergon` with ports `out_1` to `out_n`.

mod api;
mod capture;
mod client;
mod input;

use std::ffi::c_ulong;
use std::sync::Arc;
use std::time::Duration;

use self::api::{Api, PLAYBACK_LATENCY, PORT_IS_INPUT, PORT_IS_OUTPUT, PORT_IS_PHYSICAL};
use self::client::{Active, Client, Port, Process};
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

/// Opens a client of the running server; starts no server.
pub(super) fn open(
    spec: &Spec,
    channels: usize,
    shared: &Arc<Shared>,
) -> Result<Opened, AudioError> {
    let client = Client::open(c"ergon", shared.clone())?;
    let targets = targets(&client, spec.device.as_deref(), PORT_IS_INPUT);
    let mut remarks = Vec::new();
    if let Some(wanted) = spec.block.filter(|wanted| *wanted != client.block()) {
        remarks.push(format!("the server keeps its own block size, not {wanted}"));
    }
    let device = match targets.first() {
        Some(first) => format!("client {}, to {first} and on", client.name()),
        None => format!("client {}, not connected", client.name()),
    };
    if !targets.is_empty() && targets.len() < channels {
        let n_ports = targets.len();
        remarks.push(format!(
            "there are {n_ports} ports to play on: the first {n_ports} channels are heard"
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

fn start(
    client: Client,
    drain: Drain,
    device: Option<&str>,
) -> Result<Box<dyn Sink>, StartFailure> {
    let channels = drain.channels();
    let ports = match client.ports("out", channels, PORT_IS_OUTPUT) {
        Ok(ports) => ports,
        Err(error) => return Err((Some(Box::new(drain)), error)),
    };
    let playing = JackCallback {
        scratch: vec![0.0; SLICE * channels].into(),
        ports: ports.clone().into(),
        drain,
    };
    let active = client
        .activate(playing)
        .map_err(|(playing, error)| (Some(Box::new(playing.drain)), error))?;
    let mut playing = Playback { active, ports };
    playing.connect_ports(device);
    playing.alive();
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
struct JackCallback {
    drain: Drain,
    ports: Box<[Port]>,
    scratch: Box<[f32]>,
}

impl Process for JackCallback {
    fn cycle(&mut self, api: &Api, frames: u32) {
        let channels = self.ports.len();
        let total = frames as usize;
        let mut done = 0;
        while done < total {
            let n = (total - done).min(SLICE);
            if self.drain.shared().freewheeling() {
                self.drain.wait_for(n, PATIENCE);
            }
            let slice = &mut self.scratch[..n * channels];
            self.drain.fill(slice);
            for (channel, port) in self.ports.iter().enumerate() {
                // SAFETY: a port of this client, in its process callback: `frames` floats, or null.
                let buffer = unsafe { (api.port_get_buffer)(port.0, frames) }.cast::<f32>();
                if buffer.is_null() {
                    continue;
                }
                // SAFETY: as above, and done + n <= frames.
                let out = unsafe { std::slice::from_raw_parts_mut(buffer.add(done), n) };
                for (x, frame) in out.iter_mut().zip(slice.chunks_exact(channels)) {
                    *x = frame[channel];
                }
            }
            done += n;
        }
    }
}

struct Playback {
    active: Active<JackCallback>,
    ports: Vec<Port>,
}

impl Playback {
    fn connect_ports(&self, device: Option<&str>) {
        let client = self.active.client();
        let targets = targets(client, device, PORT_IS_INPUT);
        for (port, target) in self.ports.iter().zip(&targets) {
            client.connect(&client.port_name(*port), target);
        }
        // A single channel is connected to the first two loudspeakers.
        if let ([port], [_, other]) = (self.ports.as_slice(), targets.as_slice()) {
            client.connect(&client.port_name(*port), other);
        }
    }
}

impl Sink for Playback {
    fn alive(&mut self) -> bool {
        let client = self.active.client();
        if !client.alive() {
            return false;
        }
        let latency = self
            .ports
            .first()
            .map_or(0, |port| client.latency(*port, PLAYBACK_LATENCY));
        client.shared().set_timing(client.block(), latency);
        true
    }

    fn stop(self: Box<Self>) -> (Option<Drain>, Option<String>) {
        let gone = !self.active.client().alive();
        let drain = self.active.close().drain;
        let why = "the server ended or changed its rate";
        (Some(drain), gone.then(|| why.into()))
    }
}

/// What the running server would play on.
pub(super) fn survey() -> Result<String, AudioError> {
    let client = Client::open(c"ergon_survey", Arc::<Shared>::default())?;
    let (rate, block) = (client.rate(), client.block());
    let ports = client.find("", PORT_IS_INPUT | PORT_IS_PHYSICAL).len();
    Ok(format!(
        "a server at {rate} Hz, {block} frames at a time, {ports} ports to play on"
    ))
}
