//! A second JACK client that records another client, as the loudspeakers would get it.

use std::ffi::CString;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::api::{Api, PORT_IS_INPUT, PORT_IS_OUTPUT};
use super::client::{Active, Client, Port, Process};
use crate::audio::AudioError;

/// A running recording.
pub struct Capture {
    active: Active<Recorder>,
    ports: Vec<Port>,
    recorded: Arc<AtomicUsize>,
}

struct Recorder {
    ports: Box<[Port]>,
    samples: Vec<f32>,
    recorded: Arc<AtomicUsize>,
    capacity: usize,
}

impl Capture {
    /// Record up to `frames` frames of `channels`, beginning with the first sound after `connect`: a freewheeling
    /// server makes minutes of silence while its clients start.
    ///
    /// # Errors
    ///
    /// No library, no server.
    pub fn open(name: &str, channels: usize, frames: usize) -> Result<Self, AudioError> {
        let name = CString::new(name).unwrap_or_default();
        let client = Client::open(&name, Arc::default())?;
        let ports = client.ports("in", channels, PORT_IS_INPUT)?;
        let recorded = Arc::new(AtomicUsize::new(0));
        let recorder = Recorder {
            ports: ports.clone().into(),
            samples: vec![0.0; frames * channels],
            recorded: recorded.clone(),
            capacity: frames,
        };
        let active = client.activate(recorder).map_err(|(_, error)| error)?;
        Ok(Self {
            active,
            ports,
            recorded,
        })
    }

    /// Connect the inputs to the outputs of client `source`, in order; waits for them to appear. Returns whether all
    /// are connected.
    #[must_use]
    pub fn connect(&self, source: &str, limit: Duration) -> bool {
        let client = self.active.client();
        let until = Instant::now() + limit;
        let pattern = format!("^{source}:");
        loop {
            let outputs = client.find(&pattern, PORT_IS_OUTPUT);
            if outputs.len() >= self.ports.len() {
                let mut pairs = outputs.iter().zip(&self.ports);
                return pairs.all(|(from, to)| client.connect(from, &client.port_name(*to)));
            }
            if Instant::now() >= until {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Frames recorded so far.
    #[must_use]
    pub fn recorded(&self) -> usize {
        self.recorded.load(Ordering::Acquire)
    }

    /// Let the server run as fast as its clients, or by its clock again; whether it agreed.
    pub fn freewheel(&self, on: bool) -> bool {
        self.active.client().set_freewheel(on)
    }

    /// End the recording; the interleaved frames.
    #[must_use]
    pub fn finish(self) -> Vec<f32> {
        let channels = self.ports.len();
        let recorded = self.recorded.clone();
        let mut samples = self.active.close().samples;
        samples.truncate(recorded.load(Ordering::Acquire) * channels);
        samples
    }
}

impl Process for Recorder {
    fn cycle(&mut self, api: &Api, frames: u32) {
        let channels = self.ports.len();
        let done = self.recorded.load(Ordering::Relaxed);
        let n = (frames as usize).min(self.capacity - done);
        let to = &mut self.samples[done * channels..(done + n) * channels];
        for (channel, port) in self.ports.iter().enumerate() {
            // SAFETY: a port of this client, in its process callback: `frames` floats, or null.
            let buffer = unsafe { (api.port_get_buffer)(port.0, frames) }.cast::<f32>();
            if buffer.is_null() {
                continue;
            }
            // SAFETY: as above, and n <= frames.
            let from = unsafe { std::slice::from_raw_parts(buffer, n) };
            for (frame, x) in to.chunks_exact_mut(channels).zip(from) {
                frame[channel] = *x;
            }
        }
        if done > 0 || to.iter().any(|x| *x != 0.0) {
            self.recorded.store(done + n, Ordering::Release);
        }
    }
}
