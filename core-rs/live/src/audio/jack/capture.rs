//! A second JACK client that records another client, as the loudspeakers would get it.

use std::ffi::CString;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::api::{PORT_IS_INPUT, PORT_IS_OUTPUT};
use super::client::{ActiveClient, Client, ProcessCallback, ProcessCycle};
use crate::audio::AudioError;

/// A running recording.
pub struct Capture {
    active_client: ActiveClient<CaptureCallback>,
    channels: usize,
    recorded_frames: Arc<AtomicUsize>,
}

struct CaptureCallback {
    channels: usize,
    samples: Vec<f32>,
    recorded_frames: Arc<AtomicUsize>,
    capacity: usize,
}

impl Capture {
    /// Record up to `frames` frames of `channels`, beginning with the first sound after `connect`: a freewheeling
    /// server makes minutes of silence while its clients start.
    ///
    /// # Errors
    ///
    /// No library, no server.
    pub fn open(client_name: &str, channels: usize, frames: usize) -> Result<Self, AudioError> {
        let client_name = CString::new(client_name).unwrap_or_default();
        let client = Client::open(&client_name, Arc::default())?;
        let recorded_frames = Arc::new(AtomicUsize::new(0));
        let recorder = CaptureCallback {
            channels,
            samples: vec![0.0; frames * channels],
            recorded_frames: recorded_frames.clone(),
            capacity: frames,
        };
        let active_client = client
            .activate("in", channels, PORT_IS_INPUT, recorder)
            .map_err(|(_, error)| error)?;
        Ok(Self {
            active_client,
            channels,
            recorded_frames,
        })
    }

    /// Connect the inputs to the outputs of client `source`, in order; waits for them to appear. Returns whether all
    /// are connected.
    #[must_use]
    pub fn connect(&self, source: &str, timeout: Duration) -> bool {
        let client = self.active_client.client();
        let deadline = Instant::now() + timeout;
        let pattern = format!("^{source}:");
        loop {
            let outputs = client.find(&pattern, PORT_IS_OUTPUT);
            if outputs.len() >= self.channels {
                let port_names = self.active_client.port_names();
                let mut port_pairs = outputs.iter().zip(&port_names);
                return port_pairs.all(|(source_port, target_port)| client.connect(source_port, target_port));
            }
            if Instant::now() >= deadline {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Frames recorded so far.
    #[must_use]
    pub fn recorded(&self) -> usize {
        self.recorded_frames.load(Ordering::Acquire)
    }

    /// Switch the freewheel mode of the server, in which it runs as fast as its clients; returns whether the server
    /// accepted.
    pub fn freewheel(&self, is_on: bool) -> bool {
        self.active_client.client().set_freewheel(is_on)
    }

    /// End the recording; returns its interleaved frames.
    #[must_use]
    pub fn finish(self) -> Vec<f32> {
        let recorded_frames = self.recorded_frames.clone();
        let channels = self.channels;
        let mut samples = self.active_client.close().samples;
        samples.truncate(recorded_frames.load(Ordering::Acquire) * channels);
        samples
    }
}

impl ProcessCallback for CaptureCallback {
    fn process(&mut self, cycle: &ProcessCycle<'_>) {
        let frames_done = self.recorded_frames.load(Ordering::Relaxed);
        let new_frames = cycle.frames().min(self.capacity - frames_done);
        let new_samples = &mut self.samples[frames_done * self.channels..(frames_done + new_frames) * self.channels];
        cycle.read(0, new_samples);
        if frames_done > 0 || new_samples.iter().any(|x| *x != 0.0) {
            self.recorded_frames.store(frames_done + new_frames, Ordering::Release);
        }
    }
}
