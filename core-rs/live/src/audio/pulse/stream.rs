//! A playback stream: the server asks for bytes, and our thread sends them.

use std::ffi::{CStr, CString};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use pulseaudio::protocol::{
    self, ChannelMap, ChannelPosition, Command, Prop, SampleFormat, SampleSpec, ServerInfo, SinkInfo,
};

use super::wire::ServerConnection;
use crate::audio::ring::RingReader;
use crate::audio::sink::{OpenedOutput, RingThread, SINK_THREAD_PRIORITY, Sink};
use crate::audio::{AudioError, AudioSpec};
use crate::realtime;

/// Most channels of a channel map of the protocol.
const CHANNELS_MAX: usize = 32;
/// With smaller blocks PulseAudio loses frames now and then; from this size on, tests lost none.
pub(super) const BLOCK_FRAMES: u32 = 1024;
const MESSAGE_TIMEOUT: Duration = Duration::from_millis(50);
const LATENCY_INTERVAL: Duration = Duration::from_secs(1);

pub(super) fn unavailable_error(reason: String) -> AudioError {
    AudioError::Unavailable {
        backend: "pulse",
        reason,
    }
}

/// Opens a stream to the named sink, or to the default one; starts no server.
pub(in crate::audio) fn open(spec: &AudioSpec, channels: usize) -> Result<OpenedOutput, AudioError> {
    if channels > CHANNELS_MAX {
        let limit_text = "PulseAudio's protocol carries 32 at most: use jack (any number) or file:PATH";
        return Err(AudioError::Channels {
            channels,
            reason: limit_text.into(),
        });
    }
    let mut connection = ServerConnection::connect(c"ergon").map_err(unavailable_error)?;
    let sink = find_sink(&mut connection, spec.target.as_deref())?;
    let block = spec.block.unwrap_or(BLOCK_FRAMES);
    let rate = sink.sample_spec.sample_rate;
    let mut remarks = Vec::new();
    let sink_channels = usize::from(sink.sample_spec.channels);
    if sink_channels < channels && channels > 2 {
        remarks.push(format!(
            "the sink has {sink_channels} channels: the first {sink_channels} are heard"
        ));
    }
    Ok(OpenedOutput {
        backend: "pulse",
        device: server_words(sink.description.as_deref().unwrap_or(&sink.name)),
        rate,
        block,
        is_paced: true,
        remarks,
        start: Box::new(move |ring_reader| {
            let ring_thread = RingThread::start("ergon pulse", ring_reader, move |ring_reader, stop| {
                ring_reader
                    .stream_state()
                    .set_priority(realtime::set_priority(SINK_THREAD_PRIORITY));
                PlayingStream::begin(connection, &sink, ring_reader.channels(), block)?.run(ring_reader, stop)
            })?;
            Ok(Box::new(ring_thread) as Box<dyn Sink>)
        }),
    })
}

pub(super) fn server_words(text: &CStr) -> String {
    text.to_string_lossy().into_owned()
}

fn find_sink(connection: &mut ServerConnection, device: Option<&str>) -> Result<SinkInfo, AudioError> {
    let sink_name = device_name(connection, device, "sink", |server| server.default_sink_name)?;
    let sink_query = protocol::GetSinkInfo {
        index: None,
        name: Some(sink_name.clone()),
    };
    connection
        .request(&Command::GetSinkInfo(sink_query))
        .map_err(|error| unavailable_error(format!("no sink {} ({error})", server_words(&sink_name))))
}

/// The name of a device: as the user wrote it, or the server's default one.
pub(super) fn device_name(
    connection: &mut ServerConnection,
    device: Option<&str>,
    kind: &str,
    default_name: fn(ServerInfo) -> Option<CString>,
) -> Result<CString, AudioError> {
    if let Some(device) = device {
        return Ok(CString::new(device).unwrap_or_default());
    }
    let server_info = connection.request(&Command::GetServerInfo).map_err(unavailable_error)?;
    default_name(server_info).ok_or_else(|| unavailable_error(format!("the PulseAudio server has no {kind}")))
}

/// Samples as they are sent and received.
pub(super) fn native_float_format(channels: u8, rate: u32) -> SampleSpec {
    SampleSpec {
        format: SampleFormat::Float32Le,
        channels,
        sample_rate: rate,
    }
}

/// A stream that plays.
struct PlayingStream {
    connection: ServerConnection,
    channel: u32,
    rate: u32,
    channels: usize,
    block: u32,
    /// Bytes that the server has asked for.
    requested_bytes: usize,
    samples: Vec<f32>,
    bytes: Vec<u8>,
}

impl PlayingStream {
    fn begin(mut connection: ServerConnection, sink: &SinkInfo, channels: usize, block: u32) -> Result<Self, String> {
        let rate = sink.sample_spec.sample_rate;
        let frame_bytes = 4 * channels as u32;
        let mut props = protocol::Props::new();
        props.set(Prop::MediaName, c"ergon");
        let params = protocol::PlaybackStreamParams {
            sample_spec: native_float_format(channels as u8, rate),
            channel_map: channel_map(sink, channels),
            sink_index: Some(sink.index),
            buffer_attr: protocol::stream::BufferAttr {
                target_length: 2 * block * frame_bytes,
                minimum_request_length: block * frame_bytes,
                ..Default::default()
            },
            props,
            flags: protocol::stream::StreamFlags {
                // One or two channels are mixed to all channels of the sink; more are sent by number.
                no_remap_channels: channels > 2,
                no_remix_channels: channels > 2,
                adjust_latency: true,
                ..Default::default()
            },
            ..Default::default()
        };
        let stream_reply: protocol::CreatePlaybackStreamReply =
            connection.request(&Command::CreatePlaybackStream(params))?;
        let frames_max = 4 * block as usize;
        Ok(Self {
            connection,
            channel: stream_reply.channel,
            rate,
            channels,
            block,
            requested_bytes: stream_reply.requested_bytes as usize,
            samples: vec![0.0; frames_max * channels],
            bytes: Vec::with_capacity(frames_max * channels * 4),
        })
    }

    fn run(mut self, ring_reader: &mut RingReader, stop: &AtomicBool) -> Result<(), String> {
        ring_reader.stream_state().set_timing(self.block, 2 * self.block);
        let mut latency_query = (0, Instant::now());
        while !stop.load(Ordering::Acquire) {
            if self.send_requested(ring_reader)? {
                continue;
            }
            if latency_query.1.elapsed() > LATENCY_INTERVAL {
                let now = SystemTime::now();
                let channel = self.channel;
                let params = protocol::LatencyParams { channel, now };
                latency_query = (
                    self.connection.send(&Command::GetPlaybackLatency(params))?,
                    Instant::now(),
                );
            }
            let Some(message) = self.connection.receive_message(MESSAGE_TIMEOUT)? else {
                continue;
            };
            match self.connection.parse_command(&message) {
                Some((_, Command::Request(request))) if request.channel == self.channel => {
                    self.requested_bytes += request.length as usize;
                }
                Some((_, Command::Underflow(_))) => ring_reader.stream_state().add_xruns(1),
                Some((_, Command::PlaybackStreamKilled(_))) => {
                    return Err("the server ended the stream".into());
                }
                Some((reply_serial, Command::Reply)) if reply_serial == latency_query.0 => {
                    let latency = self.latency(&self.connection.parse_reply(&message)?);
                    ring_reader.stream_state().set_timing(self.block, latency);
                }
                _ => {}
            }
        }
        let _ = self.connection.send(&Command::DeletePlaybackStream(self.channel));
        Ok(())
    }

    /// Send the bytes that the server asked for; whether it had asked for any.
    fn send_requested(&mut self, ring_reader: &mut RingReader) -> Result<bool, String> {
        let frames = (self.requested_bytes / (4 * self.channels)).min(self.samples.len() / self.channels);
        if frames == 0 {
            return Ok(false);
        }
        let samples = &mut self.samples[..frames * self.channels];
        ring_reader.fill(samples);
        self.bytes.clear();
        self.bytes
            .extend(samples.iter().flat_map(|sample| sample.to_le_bytes()));
        self.connection.send_samples(self.channel, &self.bytes)?;
        self.requested_bytes -= self.bytes.len();
        Ok(true)
    }

    /// Frames that wait in the server and in the sink.
    fn latency(&self, reply: &protocol::PlaybackLatency) -> u32 {
        let frame_bytes = 4 * self.channels as i64;
        let buffered_frames = (reply.write_offset - reply.read_offset).max(0) / frame_bytes;
        let sink_frames = u128::from(reply.sink_usec) * u128::from(self.rate) / 1_000_000;
        u32::try_from(buffered_frames as u128 + sink_frames).unwrap_or(u32::MAX)
    }
}

/// Channel positions of our channels: those of the sink if it has as many channels, else numbered ones.
fn channel_map(sink: &SinkInfo, channels: usize) -> ChannelMap {
    if channels == usize::from(sink.channel_map.num_channels()) {
        return sink.channel_map;
    }
    match channels {
        1 => ChannelMap::mono(),
        2 => ChannelMap::stereo(),
        _ => ChannelMap::new(AUX_POSITIONS.into_iter().take(channels)),
    }
}

macro_rules! aux {
    ($($name:ident)*) => { [$(ChannelPosition::$name),*] };
}

const AUX_POSITIONS: [ChannelPosition; CHANNELS_MAX] = aux! {
    Aux0 Aux1 Aux2 Aux3 Aux4 Aux5 Aux6 Aux7 Aux8 Aux9 Aux10 Aux11 Aux12 Aux13 Aux14 Aux15
    Aux16 Aux17 Aux18 Aux19 Aux20 Aux21 Aux22 Aux23 Aux24 Aux25 Aux26 Aux27 Aux28 Aux29 Aux30 Aux31
};

/// What the running server would play on.
pub(in crate::audio) fn survey() -> Result<String, AudioError> {
    let mut connection = ServerConnection::connect(c"ergon").map_err(unavailable_error)?;
    let server: ServerInfo = connection.request(&Command::GetServerInfo).map_err(unavailable_error)?;
    let sink_list: protocol::SinkInfoList = connection
        .request(&Command::GetSinkInfoList)
        .map_err(unavailable_error)?;
    let default_sink = server.default_sink_name.unwrap_or_default();
    let sink_texts: Vec<String> = sink_list
        .iter()
        .map(|sink| {
            let (sample_rate, channels) = (sink.sample_spec.sample_rate, sink.sample_spec.channels);
            let default_mark = if sink.name == default_sink { ", default" } else { "" };
            format!(
                "{} ({channels} channels, {sample_rate} Hz{default_mark})",
                server_words(&sink.name)
            )
        })
        .collect();
    let server_name = server_words(&server.server_name.unwrap_or_default());
    Ok(match sink_texts.is_empty() {
        true => format!("{server_name}, no sinks"),
        false => format!("{server_name}: {}", sink_texts.join("; ")),
    })
}
