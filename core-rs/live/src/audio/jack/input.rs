//! A JACK client for inputs: named `ergon_in`, with ports `in_1` to `in_n`.

use std::sync::Arc;

use super::api::{Api, CAPTURE_LATENCY, PORT_IS_INPUT, PORT_IS_OUTPUT};
use super::client::{Active, Client, Port, Process};
use super::{SLICE, targets};
use crate::audio::ring::Feed;
use crate::audio::shared::Shared;
use crate::audio::source::{InputFailure, OpenedInput, Source};
use crate::audio::{AudioError, Spec};

/// Opens a client of the running server; starts no server.
pub(in crate::audio) fn open(
    spec: &Spec,
    channels: usize,
    shared: &Arc<Shared>,
) -> Result<OpenedInput, AudioError> {
    let client = Client::open(c"ergon_in", shared.clone())?;
    let sources = targets(&client, spec.device.as_deref(), PORT_IS_OUTPUT);
    let device = match sources.first() {
        Some(first) => format!("client {}, from {first} and on", client.name()),
        None => format!("client {}, not connected", client.name()),
    };
    let (rate, block) = (client.rate(), client.block());
    let pattern = spec.device.clone();
    Ok(OpenedInput {
        backend: "jack",
        device,
        rate,
        block,
        start: Box::new(move |feed| start(client, feed, channels, pattern.as_deref())),
    })
}

fn start(
    client: Client,
    feed: Feed,
    channels: usize,
    device: Option<&str>,
) -> Result<Box<dyn Source>, InputFailure> {
    let ports = match client.ports("in", channels, PORT_IS_INPUT) {
        Ok(ports) => ports,
        Err(error) => return Err((Some(Box::new(feed)), error)),
    };
    let callback = InputCallback {
        scratch: vec![0.0; SLICE * channels].into(),
        ports: ports.clone().into(),
        feed,
    };
    let active = client
        .activate(callback)
        .map_err(|(callback, error)| (Some(Box::new(callback.feed)), error))?;
    let client = active.client();
    let sources = targets(client, device, PORT_IS_OUTPUT);
    for (port, source) in ports.iter().zip(&sources) {
        client.connect(source, &client.port_name(*port));
    }
    Ok(Box::new(Hearing { active, ports }))
}

/// The process callback, which runs in the server's thread.
struct InputCallback {
    feed: Feed,
    ports: Box<[Port]>,
    scratch: Box<[f32]>,
}

impl Process for InputCallback {
    fn cycle(&mut self, api: &Api, frames: u32) {
        let channels = self.ports.len();
        let total = frames as usize;
        let mut done = 0;
        while done < total {
            let n = (total - done).min(SLICE);
            let slice = &mut self.scratch[..n * channels];
            for (channel, port) in self.ports.iter().enumerate() {
                // SAFETY: a port of this client, in its process callback: `frames` floats, or null.
                let buffer = unsafe { (api.port_get_buffer)(port.0, frames) }.cast::<f32>();
                if buffer.is_null() {
                    continue;
                }
                // SAFETY: as above, and done + n <= frames.
                let from = unsafe { std::slice::from_raw_parts(buffer.add(done), n) };
                for (frame, x) in slice.chunks_exact_mut(channels).zip(from) {
                    frame[channel] = *x;
                }
            }
            self.feed.offer(slice);
            done += n;
        }
    }
}

struct Hearing {
    active: Active<InputCallback>,
    ports: Vec<Port>,
}

impl Source for Hearing {
    fn alive(&mut self) -> bool {
        self.active.client().alive()
    }

    fn latency(&self) -> u32 {
        let client = self.active.client();
        let latency = |port: &Port| client.latency(*port, CAPTURE_LATENCY);
        self.ports.first().map_or(0, latency)
    }

    fn stop(self: Box<Self>) -> Option<Feed> {
        Some(self.active.close().feed)
    }
}
