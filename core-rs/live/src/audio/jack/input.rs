//! A JACK client for inputs: named `ergon_in`, with ports `in_1` to `in_n`.

use std::sync::Arc;

use super::api::{CAPTURE_LATENCY, PORT_IS_INPUT, PORT_IS_OUTPUT};
use super::client::{ActiveClient, Client, ProcessCallback, ProcessCycle};
use super::{SLICE_FRAMES, connect, target_ports};
use crate::audio::ring::RingWriter;
use crate::audio::source::{InputFailure, OpenedInput, Source};
use crate::audio::stream_state::StreamState;
use crate::audio::{AudioError, AudioSpec};

/// Opens a client that listens.
pub(in crate::audio) fn open(
    spec: &AudioSpec,
    channels: usize,
    stream_state: &Arc<StreamState>,
) -> Result<OpenedInput, AudioError> {
    let (client, _, device) = connect(c"ergon_in", spec, stream_state, PORT_IS_OUTPUT, "from")?;
    let (rate, block) = (client.rate(), client.block());
    let pattern = spec.target.clone();
    Ok(OpenedInput {
        backend: "jack",
        device,
        rate,
        block,
        start: Box::new(move |ring_writer| start(client, ring_writer, channels, pattern.as_deref())),
    })
}

fn start(
    client: Client,
    ring_writer: RingWriter,
    channels: usize,
    device: Option<&str>,
) -> Result<Box<dyn Source>, InputFailure> {
    let callback = InputCallback {
        scratch: vec![0.0; SLICE_FRAMES * channels].into(),
        ring_writer,
    };
    let active_client = client
        .activate("in", channels, PORT_IS_INPUT, callback)
        .map_err(|(callback, error)| (Some(Box::new(callback.ring_writer)), error))?;
    let client = active_client.client();
    let source_ports = target_ports(client, device, PORT_IS_OUTPUT);
    for (port, source) in active_client.port_names().iter().zip(&source_ports) {
        client.connect(source, port);
    }
    Ok(Box::new(JackInput(active_client)))
}

/// The process callback, which runs in the server's thread.
struct InputCallback {
    ring_writer: RingWriter,
    scratch: Box<[f32]>,
}

impl ProcessCallback for InputCallback {
    fn process(&mut self, cycle: &ProcessCycle<'_>) {
        let channels = self.ring_writer.channels();
        for first_frame in (0..cycle.frames()).step_by(SLICE_FRAMES) {
            let slice_frames = (cycle.frames() - first_frame).min(SLICE_FRAMES);
            let slice_samples = &mut self.scratch[..slice_frames * channels];
            cycle.read(first_frame, slice_samples);
            self.ring_writer.push_or_discard(slice_samples);
        }
    }
}

struct JackInput(ActiveClient<InputCallback>);

impl Source for JackInput {
    fn is_alive(&mut self) -> bool {
        self.0.client().is_alive()
    }

    fn latency(&self) -> u32 {
        self.0.latency(CAPTURE_LATENCY)
    }

    fn stop(self: Box<Self>) -> Option<RingWriter> {
        Some(self.0.close().ring_writer)
    }
}
