//! The handle of a performance, through which other threads send requests to the physics thread.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rtrb::{Consumer, Producer};

use super::control::{Control, DoneOnDrop, SharedFlags};
use super::player::Player;
use super::player::change::{Change, ScheduledChange};
use super::{
    ChangeError, Command, DisplayWindow, Garbage, HandKey, HandLimit, InputStatus, Keyboard, LiveAction,
    PerformanceEvent, PerformanceStatus, PlayError, PlaybackConfig, PlaybackTimes, PreparedPiece, frozen, keys,
};
use crate::audio::{self, AudioError, Output, TapHandle, TapStatus};
use crate::realtime::{self, GrantedScheduling};
use crate::recording::RecorderHandle;
use crate::safety;

/// All events of the sound so far, and how many of them came from the output and from the input.
#[derive(Default)]
pub(super) struct SoundEvents {
    events: Vec<audio::AudioEvent>,
    n_taken: [usize; 2],
}

/// A piece that is being played; it stops when this is dropped.
pub struct Performance {
    pub(super) flags: Arc<SharedFlags>,
    pub(super) physics_thread: Option<JoinHandle<Player>>,
    pub(super) reconnectors: Vec<keys::Reconnector>,
    pub(super) commands: Arc<Mutex<Producer<Command>>>,
    pub(super) status: triple_buffer::Output<PerformanceStatus>,
    pub(super) events: Consumer<PerformanceEvent>,
    pub(super) output: Output,
    pub(super) recorder: Option<RecorderHandle>,
    pub(super) frozen_reader: Option<frozen::FrozenReader>,
    pub(super) hand_limits: Vec<HandLimit>,
    pub(super) hand_keys: Vec<HandKey>,
    pub(super) garbage: Consumer<Garbage>,
    pub(super) n_tickets: u64,
    pub(super) tap: Option<TapHandle>,
    pub(super) input: InputStatus,
    pub(super) sound_events: SoundEvents,
    /// Frames of a tick.
    pub(super) tick_frames: usize,
    /// Channels that are heard.
    pub(super) channels: usize,
    /// Channels of the mixer.
    pub(super) mixed_channels: usize,
    /// Number of outputs, if frozen parts fill some of them.
    pub(super) frozen_outputs: Option<usize>,
    /// Frame rate [Hz], and the first frame that is played.
    pub(super) rate: f64,
    pub(super) start_frame: u64,
    /// Whether windows may be opened on the performance.
    pub(super) is_displayed: bool,
}

impl Performance {
    /// Start a performance.
    ///
    /// # Errors
    /// [`PlayError`] says what is missing; in this case nothing sounds and no force was sent.
    pub fn start(piece: PreparedPiece, boards: Vec<Keyboard>, config: PlaybackConfig) -> Result<Self, PlayError> {
        let (mut performance, mut player) = Self::prepare(piece, boards, config)?;
        // Also without a hand: a signal must end the sound at once.
        safety::watch_termination();
        let shared_flags = performance.flags.clone();
        let physics_thread = std::thread::Builder::new()
            .name("ergon physics".into())
            .spawn(move || {
                let _mark = DoneOnDrop(shared_flags.clone());
                safety::block_signals();
                shared_flags.set_granted(realtime::request(realtime::PHYSICS_PRIORITY));
                player.run();
                // The player is returned, so that it is freed outside the physics thread.
                player
            })
            .map_err(PlayError::Thread)?;
        performance.physics_thread = Some(physics_thread);
        Ok(performance)
    }

    /// The latest status.
    pub fn status(&mut self) -> PerformanceStatus {
        *self.status.read()
    }

    /// The next event.
    pub fn event(&mut self) -> Option<PerformanceEvent> {
        self.events.pop().ok()
    }

    /// The share of the piece's force that each real hand may get.
    pub fn hand_limits(&self) -> &[HandLimit] {
        &self.hand_limits
    }

    /// The key under a hand, to compute limits of another piece; `None` if no device plays the hand.
    pub fn hand_key(&self, hand: usize) -> Option<HandKey> {
        self.hand_keys.iter().find(|hand_key| hand_key.hand == hand).copied()
    }

    /// Channels that are heard.
    pub fn n_channels(&self) -> usize {
        self.channels
    }

    /// The instants at which its frames are heard, for [`Showing::show`](super::Showing::show).
    pub fn output_times(&self) -> PlaybackTimes {
        PlaybackTimes::new(self.output.sound_clock(), self.rate, self.start_frame)
    }

    /// The sound output.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// All events of the output and the input so far.
    pub fn sound_events(&mut self) -> &[audio::AudioEvent] {
        let input_events = self.input.input.as_ref().map(audio::Input::events);
        let SoundEvents {
            events: all_events,
            n_taken,
        } = &mut self.sound_events;
        let event_lists = [self.output.events(), input_events.unwrap_or_default()];
        for (n_taken, events) in n_taken.iter_mut().zip(event_lists) {
            let event_count = events.len();
            all_events.extend(events.into_iter().skip(*n_taken));
            *n_taken = event_count.max(*n_taken);
        }
        all_events
    }

    /// The input of the performance, if it has one.
    pub fn input(&self) -> &InputStatus {
        &self.input
    }

    /// What the system granted the physics thread; `None` until it runs.
    pub fn granted_scheduling(&self) -> Option<GrantedScheduling> {
        self.flags.granted_scheduling()
    }

    /// A handle that stops the performance from any thread.
    pub fn control(&self) -> Control {
        Control::new(self.flags.clone(), self.output.stream_state().clone())
    }

    /// See [`Control::panic`].
    pub fn panic(&self) {
        self.control().panic();
    }

    /// See [`Control::release`].
    pub fn release(&self) {
        self.control().release();
    }

    /// Glide to another gain over 20 ms, from the next tick on; false if too many commands wait.
    pub fn gain(&self, gain: f64) -> bool {
        self.command(Command::Gain(gain))
    }

    /// Glide to another gain of one of the mixer's groups of routes, as [`Performance::gain`] does.
    pub fn part_gain(&self, group: usize, gain: f64) -> bool {
        self.command(Command::GroupGain(group, gain))
    }

    /// Write the sound that is computed for the loudspeakers to a new file, from the next tick on.
    ///
    /// # Errors
    /// [`AudioError`] if a file is being written already, or cannot be created.
    pub fn record_audio(&mut self, path: &Path) -> Result<(), AudioError> {
        if self.tap.as_ref().is_some_and(|audio_tap| !audio_tap.status().has_ended) {
            return Err(AudioError::Broken("a file is being recorded already".into()));
        }
        let sample_rate = self.output.info().rate;
        let (audio_tap, tap_handle) = audio::tap(path, sample_rate, self.channels)?;
        if !self.command(Command::Tap(Some(audio_tap))) {
            return Err(AudioError::Broken(
                "too many commands wait for the physics thread; try again".into(),
            ));
        }
        self.tap = Some(tap_handle);
        Ok(())
    }

    /// End the file of [`Performance::record_audio`]; false if too many commands wait.
    pub fn end_audio(&self) -> bool {
        self.command(Command::Tap(None))
    }

    /// The status of the file of [`Performance::record_audio`]; `None` if there was none.
    pub fn audio_recorded(&self) -> Option<TapStatus> {
        self.tap.as_ref().map(TapHandle::status)
    }

    /// Strike a point of the playing simulation at the first frame of the next tick. Return a ticket, which
    /// [`EventKind::Acted`](super::EventKind::Acted) or [`EventKind::Missed`](super::EventKind::Missed) reports; `None`
    /// if too many commands wait.
    pub fn strike(&mut self, point: u32, impulse: f64) -> Option<u64> {
        self.act(LiveAction::Strike(point, impulse))
    }

    /// Set an input of the simulation to a value, full scale 1; ticket and time as in [`Performance::strike`].
    pub fn set_input(&mut self, number: u64, value: f64) -> Option<u64> {
        self.act(LiveAction::SetInput(number, value))
    }

    fn act(&mut self, act: LiveAction) -> Option<u64> {
        self.n_tickets += 1;
        let ticket = self.n_tickets;
        self.command(Command::Action(ticket, act)).then_some(ticket)
    }

    /// Schedule a change at a frame that begins a tick. Return a ticket, which [`EventKind::Changed`] or
    /// [`EventKind::Late`] reports.
    ///
    /// # Errors
    /// [`ChangeError`]: nothing was scheduled.
    pub fn change(&mut self, due_frame: u64, mut change: Change) -> Result<u64, ChangeError> {
        self.free_garbage();
        if !due_frame.is_multiple_of(self.tick_frames as u64) {
            return Err(ChangeError::Frame(due_frame, self.tick_frames));
        }
        let n_out = change
            .simulation
            .as_ref()
            .map(|(simulation, _)| (simulation.n_out(), simulation.frame()));
        if let Some((n_out, begin_frame)) = n_out {
            if begin_frame != due_frame {
                return Err(ChangeError::Begins(begin_frame, due_frame));
            }
            if self.frozen_outputs.is_some_and(|n_frozen| n_frozen != n_out) {
                return Err(ChangeError::Frozen);
            }
        }
        if change
            .mixer
            .as_ref()
            .is_some_and(|mixer| mixer.n_channels() != self.mixed_channels)
        {
            return Err(ChangeError::Channels(self.mixed_channels));
        }
        if let Some((simulation, _)) = change.simulation.as_mut().filter(|_| self.is_displayed) {
            simulation.start_watching();
        }
        let outputs = vec![0.0; n_out.map_or(0, |(n_out, _)| n_out * self.tick_frames)];
        self.n_tickets += 1;
        let ticket = self.n_tickets;
        let scheduled_change = ScheduledChange {
            frame: due_frame,
            ticket,
            change,
            outputs,
        };
        if self.command(Command::Change(Box::new(scheduled_change))) {
            Ok(ticket)
        } else {
            Err(ChangeError::Busy)
        }
    }

    /// Withdraw every change of the simulation that is due at `frame` or later and was not made yet;
    /// [`EventKind::Late`](super::EventKind::Late) reports each of them, by rising tickets. Changes that are scheduled
    /// after this call stay.
    ///
    /// # Errors
    /// [`ChangeError::Busy`]: nothing is withdrawn.
    pub fn revoke(&self, frame: u64) -> Result<(), ChangeError> {
        if self.command(Command::Revoke(frame)) {
            Ok(())
        } else {
            Err(ChangeError::Busy)
        }
    }

    /// Open a window, now or as soon as its simulation plays; false if too many commands wait. A window that still
    /// waits is replaced.
    pub fn open_window(&mut self, window: DisplayWindow) -> bool {
        self.free_garbage();
        self.command(Command::Window(Box::new(window)))
    }

    /// Free boxes that the physics thread sent back.
    fn free_garbage(&mut self) {
        while self.garbage.pop().is_ok() {}
    }

    fn command(&self, command: Command) -> bool {
        let mut commands = self.commands.lock().unwrap_or_else(PoisonError::into_inner);
        commands.push(command).is_ok()
    }

    /// See [`Control::stop`].
    pub fn stop(&self) {
        self.control().stop();
    }

    /// Whether the last frame has been computed.
    pub fn is_done(&self) -> bool {
        self.flags.is_done.load(Ordering::Acquire)
    }

    /// Why the recording cannot be written at present, such as a full disk (rows wait in memory for some seconds), or
    /// how many rows were lost because the disk did not answer for longer.
    pub fn recording_trouble(&self) -> Option<String> {
        let recorder_status = self.recorder.as_ref()?.status();
        let lost_message = || (recorder_status.dropped > 0).then(|| format!("{} rows lost", recorder_status.dropped));
        recorder_status.write_error.clone().or_else(lost_message)
    }

    /// Wait until everything was heard, close all files and devices, and return the remaining events.
    ///
    /// # Errors
    /// The error of the physics thread, of the output, or of a file that was written.
    pub fn close(mut self, patience: Duration) -> Result<Vec<PerformanceEvent>, PlayError> {
        self.finish(patience)?;
        Ok(std::iter::from_fn(|| self.event()).collect())
    }

    fn finish(&mut self, patience: Duration) -> Result<(), PlayError> {
        // Devices first: they send their last zeros when the physics thread returns them.
        let play_result = self
            .physics_thread
            .take()
            .map_or(Ok(()), |thread| thread.join().map(drop).map_err(|_| PlayError::Failed));
        self.reconnectors.clear();
        self.frozen_reader = None;
        let _ = self.output.wait(patience);
        let close_result = self.output.close();
        self.tap = None;
        self.input = InputStatus::default();
        let recorded = self.recorder.take().map(RecorderHandle::stop);
        play_result?;
        close_result?;
        recorded.transpose()?;
        Ok(())
    }
}

impl Drop for Performance {
    fn drop(&mut self) {
        self.stop();
        let _ = self.finish(Duration::from_millis(200));
    }
}
