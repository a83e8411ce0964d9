//! The sound system of macOS and Windows.
//!
//! Type-checked for both systems, but never run on either: the machines that test this program run Linux, where JACK
//! and PulseAudio are used directly and this file is not built.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{BufferSize, Device, ErrorKind, SampleFormat, Stream, StreamConfig};

use super::ring::Drain;
use super::sink::{Opened, Sink, StartFailure};
use super::{AudioError, Spec};

const BLOCK: u32 = 512;

fn missing(why: impl ToString) -> AudioError {
    AudioError::Unavailable {
        backend: "system",
        why: why.to_string(),
    }
}

/// Opens the named device, or the default one.
pub(super) fn open(spec: &Spec, rate: u32, channels: usize) -> Result<Opened, AudioError> {
    let device = find(spec.device.as_deref())?;
    let rate = playable(&device, rate, channels)?;
    let block = spec.block;
    let config = StreamConfig {
        channels: channels as u16,
        sample_rate: rate,
        buffer_size: block.map_or(BufferSize::Default, BufferSize::Fixed),
    };
    Ok(Opened {
        backend: "system",
        device: device.to_string(),
        rate,
        block: block.unwrap_or(BLOCK),
        paced: true,
        remarks: Vec::new(),
        start: Box::new(move |drain| start(&device, config, drain)),
    })
}

fn find(device_name: Option<&str>) -> Result<Device, AudioError> {
    let audio_host = cpal::default_host();
    let Some(device_name) = device_name else {
        return audio_host
            .default_output_device()
            .ok_or_else(|| missing("the system has no sound device"));
    };
    let mut devices = audio_host.output_devices().map_err(missing)?;
    devices
        .find(|device| device.to_string() == device_name)
        .ok_or_else(|| missing(format!("no sound device {device_name}")))
}

/// `rate` if the device can play it with float samples, else the device's own rate.
fn playable(device: &Device, rate: u32, channels: usize) -> Result<u32, AudioError> {
    let mut configs = device
        .supported_output_configs()
        .map_err(missing)?
        .filter(|one| one.sample_format() == SampleFormat::F32)
        .filter(|one| usize::from(one.channels()) == channels)
        .peekable();
    if configs.peek().is_none() {
        return Err(AudioError::Channels {
            channels,
            why: format!("{device} has no float format with this number of channels"),
        });
    }
    if configs.any(|one| (one.min_sample_rate()..=one.max_sample_rate()).contains(&rate)) {
        return Ok(rate);
    }
    let default_config = device.default_output_config().map_err(missing)?;
    Ok(default_config.sample_rate())
}

fn start(device: &Device, config: StreamConfig, drain: Drain) -> Result<Box<dyn Sink>, StartFailure> {
    let gone = Arc::new(AtomicBool::new(false));
    let (lost_flag, shared) = (gone.clone(), drain.shared().clone());
    let (drain_sender, returned) = mpsc::sync_channel(1);
    let mut lent_drain = LentDrain(Some((drain, drain_sender)));
    let stream = device.build_output_stream::<f32, _, _>(
        config,
        move |out, _| lent_drain.fill(out),
        move |error| match error.kind() {
            ErrorKind::Xrun => shared.add_xruns(1),
            ErrorKind::DeviceChanged | ErrorKind::RealtimeDenied => {}
            _ => lost_flag.store(true, Ordering::Release),
        },
        None,
    );
    let start_result = stream.and_then(|stream| stream.play().map(|()| stream));
    match start_result {
        Ok(stream) => Ok(Box::new(SystemStream { stream, returned, gone })),
        Err(error) => Err((returned.try_recv().ok().map(Box::new), missing(error))),
    }
}

/// The drain in the callback; it is sent back when the callback is dropped.
struct LentDrain(Option<(Drain, mpsc::SyncSender<Drain>)>);

impl LentDrain {
    fn fill(&mut self, out: &mut [f32]) {
        match &mut self.0 {
            Some((drain, _)) => drain.fill(out),
            None => out.fill(0.0),
        }
    }
}

impl Drop for LentDrain {
    fn drop(&mut self) {
        if let Some((drain, drain_sender)) = self.0.take() {
            let _ = drain_sender.try_send(drain);
        }
    }
}

struct SystemStream {
    stream: Stream,
    returned: mpsc::Receiver<Drain>,
    gone: Arc<AtomicBool>,
}

impl Sink for SystemStream {
    fn is_alive(&mut self) -> bool {
        !self.gone.load(Ordering::Acquire)
    }

    fn stop(self: Box<Self>) -> (Option<Drain>, Option<String>) {
        let is_gone = self.gone.load(Ordering::Acquire);
        drop(self.stream);
        let stop_reason = is_gone.then(|| "the device disappeared".into());
        (self.returned.recv().ok(), stop_reason)
    }
}

/// What the system would play on.
pub(super) fn survey() -> Result<String, AudioError> {
    find(None).map(|device| device.to_string())
}
