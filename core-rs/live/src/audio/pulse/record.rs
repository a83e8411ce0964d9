//! A recording stream: the server sends bytes, and our thread writes them to the ring.

use std::ffi::CStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use pulseaudio::protocol::{self, Command, Prop, SourceInfo};

use super::stream::{BLOCK_FRAMES, device_name, native_float_format, server_words, unavailable_error};
use super::wire::ServerConnection;
use crate::audio::ring::RingWriter;
use crate::audio::sink::{RingThread, SINK_THREAD_PRIORITY};
use crate::audio::source::{InputFailure, OpenedInput, Source};
use crate::audio::{AudioError, AudioSpec};
use crate::realtime;

const MESSAGE_TIMEOUT: Duration = Duration::from_millis(50);

/// Opens a stream from the named source, or from the default one; starts no server.
pub(in crate::audio) fn open(spec: &AudioSpec, channels: usize) -> Result<OpenedInput, AudioError> {
    let mut connection = ServerConnection::connect(c"ergon").map_err(unavailable_error)?;
    let source = find_source(&mut connection, spec.target.as_deref())?;
    let block = spec.block.unwrap_or(BLOCK_FRAMES);
    let source_channels = usize::from(source.sample_spec.channels);
    let mut device = server_words(source.description.as_deref().unwrap_or(&source.name));
    if source_channels < channels {
        device += &format!(", of which {source_channels} are heard");
    }
    Ok(OpenedInput {
        backend: "pulse",
        device,
        rate: source.sample_spec.sample_rate,
        block,
        start: Box::new(move |ring_writer| start(connection, &source, ring_writer, block)),
    })
}

fn find_source(connection: &mut ServerConnection, device: Option<&str>) -> Result<SourceInfo, AudioError> {
    let source_name = device_name(connection, device, "source", |server| server.default_source_name)?;
    let source_query = protocol::GetSourceInfo {
        index: None,
        name: Some(source_name.clone()),
    };
    connection
        .request(&Command::GetSourceInfo(source_query))
        .map_err(|error| unavailable_error(format!("no source {} ({error})", server_words(&source_name))))
}

fn start(
    mut connection: ServerConnection,
    source: &SourceInfo,
    ring_writer: RingWriter,
    block: u32,
) -> Result<Box<dyn Source>, InputFailure> {
    let (channel, latency) = match begin(&mut connection, source, c"ergon", block) {
        Ok(stream) => stream,
        Err(reason) => return Err((Some(Box::new(ring_writer)), unavailable_error(reason))),
    };
    let mut recording_stream = RecordingStream {
        connection,
        channel,
        source_channels: usize::from(source.sample_spec.channels).max(1),
        samples: Vec::new(),
    };
    let thread = RingThread::start("ergon pulse in", ring_writer, move |ring_writer, stop| {
        realtime::set_priority(SINK_THREAD_PRIORITY);
        recording_stream.run(ring_writer, stop)
    })?;
    Ok(Box::new(PulseInput { thread, latency }))
}

/// Creates a stream of all channels of a source: its number, and its latency [frames].
fn begin(
    connection: &mut ServerConnection,
    source: &SourceInfo,
    name: &CStr,
    block: u32,
) -> Result<(u32, u32), String> {
    let mut props = protocol::Props::new();
    props.set(Prop::MediaName, name);
    let (sample_rate, channels) = (source.sample_spec.sample_rate, source.sample_spec.channels);
    let params = protocol::RecordStreamParams {
        sample_spec: native_float_format(channels, sample_rate),
        channel_map: source.channel_map,
        source_index: Some(source.index),
        buffer_attr: protocol::stream::BufferAttr {
            fragment_size: block * 4 * u32::from(channels),
            ..Default::default()
        },
        props,
        flags: protocol::stream::StreamFlags {
            adjust_latency: true,
            ..Default::default()
        },
        ..Default::default()
    };
    let stream_reply: protocol::CreateRecordStreamReply = connection.request(&Command::CreateRecordStream(params))?;
    let latency = u128::from(stream_reply.stream_latency) * u128::from(sample_rate) / 1_000_000;
    Ok((stream_reply.channel, u32::try_from(latency).unwrap_or(u32::MAX)))
}

struct RecordingStream {
    connection: ServerConnection,
    channel: u32,
    /// Channels of the source.
    source_channels: usize,
    samples: Vec<f32>,
}

impl RecordingStream {
    fn run(&mut self, ring_writer: &mut RingWriter, stop: &AtomicBool) -> Result<(), String> {
        while !stop.load(Ordering::Acquire) {
            let Some(message) = self.connection.receive_message(MESSAGE_TIMEOUT)? else {
                continue;
            };
            if message.channel() == Some(self.channel) {
                self.push_samples(message.bytes(), ring_writer);
                continue;
            }
            match self.connection.parse_command(&message) {
                Some((_, Command::Overflow(_))) => ring_writer.stream_state().add_xruns(1),
                Some((_, Command::RecordStreamKilled(_))) => {
                    return Err("the server ended the stream".into());
                }
                _ => {}
            }
        }
        let _ = self.connection.send(&Command::DeleteRecordStream(self.channel));
        Ok(())
    }

    /// Write whole frames to the ring: the first channels of the source, and silence for those that it lacks.
    fn push_samples(&mut self, bytes: &[u8], ring_writer: &mut RingWriter) {
        let channels = ring_writer.channels();
        self.samples.clear();
        for frame in bytes.chunks_exact(4 * self.source_channels) {
            let (samples, _) = frame.as_chunks();
            let samples = samples.iter().map(|&bytes| f32::from_le_bytes(bytes));
            let padded_samples = samples.chain(std::iter::repeat(0.0));
            self.samples.extend(padded_samples.take(channels));
        }
        ring_writer.push_or_discard(&self.samples);
    }
}

struct PulseInput {
    thread: RingThread<RingWriter>,
    latency: u32,
}

impl Source for PulseInput {
    fn is_alive(&mut self) -> bool {
        self.thread.is_running()
    }

    fn latency(&self) -> u32 {
        self.latency
    }

    fn stop(self: Box<Self>) -> Option<RingWriter> {
        // The error is not reported: the supervisor sees that the thread has ended.
        self.thread.stop().0
    }
}
