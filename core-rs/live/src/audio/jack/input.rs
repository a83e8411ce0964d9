//! A JACK client for inputs: named `ergon_in`, with ports `in_1` to `in_n`.

use std::sync::Arc;

use super::api::{CAPTURE_LATENCY, PORT_IS_INPUT, PORT_IS_OUTPUT};
use super::client::{Active, Client, Cycle, Process};
use super::{SLICE, connect, targets};
use crate::audio::ring::Feed;
use crate::audio::shared::Shared;
use crate::audio::source::{InputFailure, OpenedInput, Source};
use crate::audio::{AudioError, Spec};

/// Opens a client that listens.
pub(in crate::audio) fn open(spec: &Spec, channels: usize, shared: &Arc<Shared>) -> Result<OpenedInput, AudioError> {
    let (client, _, device) = connect(c"ergon_in", spec, shared, PORT_IS_OUTPUT, "from")?;
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

fn start(client: Client, feed: Feed, channels: usize, device: Option<&str>) -> Result<Box<dyn Source>, InputFailure> {
    let callback = InputCallback {
        scratch: vec![0.0; SLICE * channels].into(),
        feed,
    };
    let active = client
        .activate("in", channels, PORT_IS_INPUT, callback)
        .map_err(|(callback, error)| (Some(Box::new(callback.feed)), error))?;
    let client = active.client();
    let sources = targets(client, device, PORT_IS_OUTPUT);
    for (port, source) in active.port_names().iter().zip(&sources) {
        client.connect(source, port);
    }
    Ok(Box::new(Hearing(active)))
}

/// The process callback, which runs in the server's thread.
struct InputCallback {
    feed: Feed,
    scratch: Box<[f32]>,
}

impl Process for InputCallback {
    fn cycle(&mut self, cycle: &Cycle<'_>) {
        let channels = self.feed.channels();
        for first in (0..cycle.frames()).step_by(SLICE) {
            let slice_frames = (cycle.frames() - first).min(SLICE);
            let slice_samples = &mut self.scratch[..slice_frames * channels];
            cycle.read(first, slice_samples);
            self.feed.offer(slice_samples);
        }
    }
}

struct Hearing(Active<InputCallback>);

impl Source for Hearing {
    fn is_alive(&mut self) -> bool {
        self.0.client().is_alive()
    }

    fn latency(&self) -> u32 {
        self.0.latency(CAPTURE_LATENCY)
    }

    fn stop(self: Box<Self>) -> Option<Feed> {
        Some(self.0.close().feed)
    }
}
