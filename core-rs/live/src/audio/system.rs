//! The sound system of macOS and Windows.
//!
//! Type-checked for both systems, but never run on either: the machines that test this program run Linux, where JACK
//! and PulseAudio are used directly and this file is not built.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{BufferSize, Device, ErrorKind, SampleFormat, Stream, StreamConfig};

use super::ring::RingReader;
use super::sink::{OpenedOutput, OutputFailure, Sink};
use super::{AudioError, AudioSpec};

const BLOCK_FRAMES: u32 = 512;

fn unavailable_error(reason: impl ToString) -> AudioError {
    AudioError::Unavailable {
        backend: "system",
        reason: reason.to_string(),
    }
}

/// Opens the named device, or the default one.
pub(super) fn open(spec: &AudioSpec, rate: u32, channels: usize) -> Result<OpenedOutput, AudioError> {
    let device = find_device(spec.target.as_deref())?;
    let rate = playable_rate(&device, rate, channels)?;
    let block = spec.block;
    let config = StreamConfig {
        channels: channels as u16,
        sample_rate: rate,
        buffer_size: block.map_or(BufferSize::Default, BufferSize::Fixed),
    };
    Ok(OpenedOutput {
        backend: "system",
        device: device.to_string(),
        rate,
        block: block.unwrap_or(BLOCK_FRAMES),
        is_paced: true,
        remarks: Vec::new(),
        start: Box::new(move |ring_reader| start(&device, config, ring_reader)),
    })
}

fn find_device(device_name: Option<&str>) -> Result<Device, AudioError> {
    let audio_host = cpal::default_host();
    let Some(device_name) = device_name else {
        return audio_host
            .default_output_device()
            .ok_or_else(|| unavailable_error("the system has no sound device"));
    };
    let mut devices = audio_host.output_devices().map_err(unavailable_error)?;
    devices
        .find(|device| device.to_string() == device_name)
        .ok_or_else(|| unavailable_error(format!("no sound device {device_name}")))
}

/// `rate` if the device can play it with float samples, else the device's own rate.
fn playable_rate(device: &Device, rate: u32, channels: usize) -> Result<u32, AudioError> {
    let mut configs = device
        .supported_output_configs()
        .map_err(unavailable_error)?
        .filter(|config| config.sample_format() == SampleFormat::F32)
        .filter(|config| usize::from(config.channels()) == channels)
        .peekable();
    if configs.peek().is_none() {
        return Err(AudioError::Channels {
            channels,
            reason: format!("{device} has no float format with this number of channels"),
        });
    }
    if configs.any(|config| (config.min_sample_rate()..=config.max_sample_rate()).contains(&rate)) {
        return Ok(rate);
    }
    let default_config = device.default_output_config().map_err(unavailable_error)?;
    Ok(default_config.sample_rate())
}

fn start(device: &Device, config: StreamConfig, ring_reader: RingReader) -> Result<Box<dyn Sink>, OutputFailure> {
    let is_lost = Arc::new(AtomicBool::new(false));
    let (lost_flag, stream_state) = (is_lost.clone(), ring_reader.stream_state().clone());
    let (reader_sender, reader_receiver) = mpsc::sync_channel(1);
    let mut lent_reader = LentRingReader(Some((ring_reader, reader_sender)));
    let stream = device.build_output_stream::<f32, _, _>(
        config,
        move |out, _| lent_reader.fill(out),
        move |error| match error.kind() {
            ErrorKind::Xrun => stream_state.add_xruns(1),
            ErrorKind::DeviceChanged | ErrorKind::RealtimeDenied => {}
            _ => lost_flag.store(true, Ordering::Release),
        },
        None,
    );
    let start_result = stream.and_then(|stream| stream.play().map(|()| stream));
    match start_result {
        Ok(stream) => Ok(Box::new(SystemStream {
            stream,
            reader_receiver,
            is_lost,
        })),
        Err(error) => Err((reader_receiver.try_recv().ok().map(Box::new), unavailable_error(error))),
    }
}

/// The reader in the callback; it is sent back when the callback is dropped.
struct LentRingReader(Option<(RingReader, mpsc::SyncSender<RingReader>)>);

impl LentRingReader {
    fn fill(&mut self, out: &mut [f32]) {
        match &mut self.0 {
            Some((ring_reader, _)) => ring_reader.fill(out),
            None => out.fill(0.0),
        }
    }
}

impl Drop for LentRingReader {
    fn drop(&mut self) {
        if let Some((ring_reader, reader_sender)) = self.0.take() {
            let _ = reader_sender.try_send(ring_reader);
        }
    }
}

struct SystemStream {
    stream: Stream,
    reader_receiver: mpsc::Receiver<RingReader>,
    is_lost: Arc<AtomicBool>,
}

impl Sink for SystemStream {
    fn is_alive(&mut self) -> bool {
        !self.is_lost.load(Ordering::Acquire)
    }

    fn stop(self: Box<Self>) -> (Option<RingReader>, Option<String>) {
        let is_lost = self.is_lost.load(Ordering::Acquire);
        drop(self.stream);
        let stop_reason = is_lost.then(|| "the device disappeared".into());
        (self.reader_receiver.recv().ok(), stop_reason)
    }
}

/// What the system would play on.
pub(super) fn survey() -> Result<String, AudioError> {
    find_device(None).map(|device| device.to_string())
}
