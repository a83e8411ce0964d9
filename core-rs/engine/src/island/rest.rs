//! Resting islands: steps that would not change an island are skipped, until an event is due or something comes from
//! outside.
//!
//! A step is a function of the state and of the events due at it. If no event is due, and a step leaves the state and
//! the outputs the same to the last bit, so do all that follow. Only the counters of steps in the state are advanced.
//! The state is therefore at every frame what it would be if all steps were computed, and an island wakes by computing
//! its next step.

use super::{Fault, Island, bodies, energy_account};
use crate::archive::{Archive, State as _};
use crate::island::sleep::SleepMonitor;
use crate::island::written_hand::voice::Voice;
use crate::kernel::thread_team::ThreadTeam;
use crate::timeline::{Drive, DriveSource};

/// Successive frames that must leave the state the same before an island rests. Periodic work recurs within so many:
/// checks of energy gains, kicks of slow bodies, and modes that are computed ahead.
const UNCHANGED_FRAMES: u64 = 256;
/// Frames from the beginning of an island to the first check whether it rests; the interval doubles after each check
/// that finds it moving.
const CHECK_INTERVAL_MIN_FRAMES: u64 = 64;
/// Most frames between two checks: one check costs about as much as two frames.
const CHECK_INTERVAL_MAX_FRAMES: u64 = 1 << 15;
/// Steps before an event from which on steps are computed, because bodies are computed ahead and strikes may fall
/// between frames.
const EVENT_MARGIN_STEPS: u64 = 4 * energy_account::CHECK_STEPS;
/// Frames after which a search for silence ends, and the island counts as one that sounds.
const SILENCE_SEARCH_FRAMES: u64 = 1_024;
/// States larger than this are not compared [bytes].
const STATE_BYTES_MAX: usize = 1 << 26;

/// State of the search for rest.
#[derive(Clone, Debug)]
pub(super) struct RestSearch {
    activity: IslandActivity,
    /// The step of the next check, and the frames from there to the check after it.
    next_check: u64,
    check_interval: u64,
    /// The state at the last check.
    reference_state: Vec<u8>,
    /// Outputs in the frame after it   (n_out), and the work of contacts in that frame.
    reference_outputs: Vec<f64>,
    reference_work: [u64; 2],
    /// Number of steps that were skipped.
    skipped_steps: u64,
}

#[derive(Clone, Copy, Debug)]
enum IslandActivity {
    /// It moves, or may.
    Computed,
    /// This many frames since the last check left the state the same.
    Unchanged(u64),
    /// It rests up to this step.
    Resting(u64),
    /// It sleeps up to this step; its state does not change.
    Asleep(u64),
}

impl RestSearch {
    pub(super) fn new(n_out: usize) -> Self {
        Self {
            activity: IslandActivity::Computed,
            next_check: 0,
            check_interval: CHECK_INTERVAL_MIN_FRAMES,
            reference_state: Vec::new(),
            reference_outputs: vec![0.0; n_out],
            reference_work: [0; 2],
            skipped_steps: 0,
        }
    }
}

impl Island {
    /// Play `n_frames` frames and write their outputs into `out`, frame by frame, (n_frames · n_out).
    ///
    /// Fails with the first part that goes non-finite, unless faults are muted.
    pub(crate) fn process(&mut self, out: &mut [f64], n_frames: usize, team: &mut ThreadTeam<'_>) -> Result<(), Fault> {
        let (n_out, steps_per_frame) = (self.n_out(), u64::from(self.oversampling));
        let mut frames_done = 0;
        while frames_done < n_frames {
            let frames_left = (n_frames - frames_done) as u64;
            let frames_until = |step: u64| frames_left.min(step.saturating_sub(self.state.frame) / steps_per_frame);
            let frames_to_check = frames_until(self.next_quiet_check());
            let frame_count = match self.rest_search.activity {
                IslandActivity::Computed => frames_to_check.min(frames_until(self.rest_search.next_check)),
                IslandActivity::Unchanged(_) => 1,
                IslandActivity::Resting(last_step) => frames_to_check.min(frames_until(last_step)),
                IslandActivity::Asleep(last_step) => frames_until(last_step),
            };
            let out = &mut out[n_out * frames_done..n_out * (frames_done + frame_count as usize)];
            frames_done += frame_count as usize;
            match self.rest_search.activity {
                IslandActivity::Asleep(_) if frame_count == 0 => self.continue_sleep(),
                IslandActivity::Asleep(_) => {
                    for row in out.chunks_exact_mut(n_out.max(1)) {
                        self.sleep_monitor
                            .iter()
                            .for_each(|sleep_monitor| sleep_monitor.write_held_outputs(row));
                    }
                    self.state.frame += frame_count * steps_per_frame;
                    self.rest_search.skipped_steps += frame_count * steps_per_frame;
                    continue;
                }
                IslandActivity::Computed if frame_count == 0 => self.begin_rest_check(),
                IslandActivity::Computed => self.compute(out, frame_count as usize, team)?,
                IslandActivity::Unchanged(frames) => {
                    let work_before = self.contact_work();
                    self.compute(out, 1, team)?;
                    self.compare_with_reference(out, frames, work_before);
                }
                IslandActivity::Resting(_) if frame_count == 0 => self.wake(),
                IslandActivity::Resting(_) => {
                    for row in out.chunks_exact_mut(n_out.max(1)) {
                        row.copy_from_slice(&self.rest_search.reference_outputs);
                    }
                    self.shift_frames((frame_count * steps_per_frame) as i64, frame_count as i64);
                    self.rest_search.skipped_steps += frame_count * steps_per_frame;
                }
            }
            if frame_count > 0
                && let Some(wake_step) = self.try_sleep(out)
            {
                self.rest_search.activity = IslandActivity::Asleep(wake_step);
            }
        }
        Ok(())
    }

    /// Compute steps from here on, because something came from outside.
    pub(super) fn wake(&mut self) {
        if !matches!(self.rest_search.activity, IslandActivity::Computed) {
            self.sleep_monitor.iter_mut().for_each(SleepMonitor::wake);
            self.restart_checks();
        }
    }

    /// Compute steps from here on, unless it sleeps: what only watches it changes no sample.
    pub(super) fn wake_from_rest(&mut self) {
        if !matches!(self.rest_search.activity, IslandActivity::Asleep(_)) {
            self.wake();
        }
    }

    /// Compute steps from here on, because the state came from elsewhere, and soon check whether the island rests;
    /// continue its sleep if it slept there.
    pub(super) fn resume_computing(&mut self) {
        self.restart_checks();
        if self.sleep_monitor.as_ref().is_some_and(SleepMonitor::is_asleep) {
            // Until when, the next frame decides: more of the state may come.
            self.rest_search.activity = IslandActivity::Asleep(self.state.frame);
        }
    }

    /// Sleep on until the next event, or wake for it.
    fn continue_sleep(&mut self) {
        match self.wake_step() {
            Some(wake_step) => self.rest_search.activity = IslandActivity::Asleep(wake_step),
            None => self.wake(),
        }
    }

    fn restart_checks(&mut self) {
        self.rest_search.check_interval = CHECK_INTERVAL_MIN_FRAMES;
        self.schedule_check();
    }

    /// Number of steps skipped so far because the island rested.
    pub(crate) fn skipped_steps(&self) -> u64 {
        self.rest_search.skipped_steps
    }

    /// Number of frames computed so far.
    pub(crate) fn computed_frames(&self) -> u64 {
        (self.state.frame - self.rest_search.skipped_steps) / u64::from(self.oversampling)
    }

    /// The step up to which it rests or sleeps; `None` if it moves, may move, or rests for ever.
    pub(crate) fn rest_end_step(&self) -> Option<u64> {
        match self.rest_search.activity {
            IslandActivity::Resting(last) | IslandActivity::Asleep(last) if last < u64::MAX - EVENT_MARGIN_STEPS => {
                Some(last)
            }
            IslandActivity::Resting(_)
            | IslandActivity::Asleep(_)
            | IslandActivity::Computed
            | IslandActivity::Unchanged(_) => None,
        }
    }

    /// The frame up to which its outputs are 0 if nothing comes from outside, found on a copy that is computed until it
    /// rests; the present frame if it sounds or moves soon.
    pub(crate) fn silence_end_frame(&self) -> u64 {
        let steps_per_frame = u64::from(self.oversampling);
        let frame_now = self.state.frame / steps_per_frame;
        if self.next_event_step(self.state.frame) <= self.state.frame + SILENCE_SEARCH_FRAMES * steps_per_frame {
            return frame_now;
        }
        let mut island_copy = self.clone();
        let mut output_row = vec![0.0; self.n_out()];
        let is_silent = |output_row: &[f64]| output_row.iter().all(|x| *x == 0.0);
        let search_silence = |team: &mut ThreadTeam<'_>| {
            for _ in 0..SILENCE_SEARCH_FRAMES {
                if island_copy.process(&mut output_row, 1, team).is_err() || !is_silent(&output_row) {
                    return frame_now;
                }
                if let IslandActivity::Resting(last_step) = island_copy.rest_search.activity {
                    // What it would give if it slept later.
                    island_copy
                        .sleep_monitor
                        .iter()
                        .for_each(|sleep_monitor| sleep_monitor.write_held_outputs(&mut output_row));
                    return if is_silent(&output_row) {
                        last_step / steps_per_frame
                    } else {
                        frame_now
                    };
                }
            }
            frame_now
        };
        ThreadTeam::with_threads(1, search_silence)
    }

    /// Reserve room for the state, so that checks of it do not allocate.
    pub(super) fn reserve_rest(&mut self) {
        let mut state_size = 0;
        let _ = self.archive_whole_state(&mut Archive::Count(&mut state_size));
        // Some lists grow while it plays.
        let reports_size = size_of_val(&*self.state.sources.reports);
        let state_room = state_size + state_size / 4 + reports_size + 4_096;
        self.rest_search.reference_state.clear();
        if state_size <= STATE_BYTES_MAX {
            self.rest_search.reference_state.reserve_exact(state_room);
        }
        if let IslandActivity::Unchanged(_) = self.rest_search.activity {
            self.schedule_check();
        }
    }

    fn schedule_check(&mut self) {
        let rest_search = &mut self.rest_search;
        rest_search.activity = IslandActivity::Computed;
        rest_search.next_check = self.state.frame + rest_search.check_interval * u64::from(self.oversampling);
        rest_search.check_interval = CHECK_INTERVAL_MAX_FRAMES.min(2 * rest_search.check_interval);
    }

    #[cold]
    fn begin_rest_check(&mut self) {
        let island_step = self.state.frame;
        let event_step_min = island_step + EVENT_MARGIN_STEPS + 2 * UNCHANGED_FRAMES * u64::from(self.oversampling);
        let mut reference_state = std::mem::take(&mut self.rest_search.reference_state);
        reference_state.clear();
        let may_rest = self.next_event_step(island_step) > event_step_min
            && !self
                .state
                .monitors
                .contact_peaks
                .is_any_pushing(&self.state.motion.modules.link_forces)
            && self
                .archive_whole_state(&mut Archive::WriteWithin(&mut reference_state))
                .is_ok();
        self.rest_search.reference_state = reference_state;
        if may_rest {
            self.rest_search.activity = IslandActivity::Unchanged(0);
        } else {
            self.schedule_check();
        }
    }

    /// Compare the frame that was just computed with the state of the check, `frames` frames before; `work_before` is
    /// that of contacts before the frame.
    fn compare_with_reference(&mut self, outputs: &[f64], frames: u64, work_before: [u64; 2]) {
        let work_after = self.contact_work();
        let work = [work_after[0] - work_before[0], work_after[1] - work_before[1]];
        if frames == 0 {
            self.rest_search.reference_outputs.copy_from_slice(outputs);
            self.rest_search.reference_work = work;
        }
        let is_same_frame =
            work == self.rest_search.reference_work && has_same_bits(outputs, &self.rest_search.reference_outputs);
        if !is_same_frame || !self.is_unchanged(frames + 1) {
            self.schedule_check();
            return;
        }
        self.rest_search.activity = IslandActivity::Unchanged(frames + 1);
        if frames + 1 == UNCHANGED_FRAMES {
            let event_step = self.next_event_step(self.state.frame);
            self.rest_search.activity = IslandActivity::Resting(event_step.saturating_sub(EVENT_MARGIN_STEPS));
        }
    }

    /// Whether the state is that of the check, `frames` frames later.
    fn is_unchanged(&mut self, frames: u64) -> bool {
        let (frames, steps_per_frame) = (frames as i64, i64::from(self.oversampling));
        let reference_state = std::mem::take(&mut self.rest_search.reference_state);
        let mut comparison_archive = Archive::Compare(&reference_state);
        self.shift_frames(-frames * steps_per_frame, -frames);
        let is_same_state = self.archive_whole_state(&mut comparison_archive).is_ok() && comparison_archive.is_empty();
        self.shift_frames(frames * steps_per_frame, frames);
        self.rest_search.reference_state = reference_state;
        is_same_state
    }

    /// Archive the whole state, with the ledger and the length of the stream, which a stored render leaves out.
    fn archive_whole_state(&mut self, archive: &mut Archive<'_>) -> Result<(), crate::archive::Damaged> {
        let state = &mut self.state;
        state.archive(archive)?;
        state.monitors.ledger.archive(archive)?;
        state.sources.ergon_stream.len().archive(archive)
    }

    /// Advance all counters of steps by `steps`, and the work of contacts by that of `frames` frames; both may be
    /// negative.
    fn shift_frames(&mut self, steps: i64, frames: i64) {
        let state = &mut self.state;
        state.frame = state.frame.wrapping_add_signed(steps);
        for body in &mut state.motion.bodies {
            body.shift_frames(steps);
        }
        for voice in &mut state.sources.voices {
            voice.shift_frames(steps);
        }
        if let Some(fine_links) = &mut state.motion.fine_links {
            let [evaluations, products] = self
                .rest_search
                .reference_work
                .map(|fine_work| fine_work as i64 * frames);
            let fine_work = &mut fine_links.work;
            fine_work.evaluations = fine_work.evaluations.wrapping_add_signed(evaluations);
            fine_work.products = fine_work.products.wrapping_add_signed(products);
        }
    }

    /// The first step, `n` or later, at which an event may be due; `n` if that is not known.
    pub(super) fn next_event_step(&self, n: u64) -> u64 {
        let (script, state) = (&*self.script, &self.state);
        // The future of hands and takes is not known here.
        let is_known = |drive: &Drive| matches!(drive.source, DriveSource::Constant(_) | DriveSource::Strikes { .. });
        if !script.drives.iter().all(is_known)
            || !script.hand_bindings.is_empty()
            || state.sources.has_pending_strikes()
        {
            return n;
        }
        let body_intervals = state.motion.bodies.iter().map(bodies::RunningBody::kick_interval);
        let mut kick_intervals = body_intervals.chain(state.sources.voices.iter().map(Voice::kick_interval));
        if kick_intervals.any(|interval| u64::from(interval) > UNCHANGED_FRAMES) {
            return n;
        }
        let strike_frame = script
            .strike_forces
            .get(state.sources.next_strike)
            .map(|strike_force| strike_force.frame);
        let ergon_frame = script
            .ergons
            .get(state.sources.next_ergon)
            .map(|ergon_frame| ergon_frame.0);
        let voice_events = state.sources.voices.iter().zip(&script.voices);
        let voice_events =
            voice_events.map(|(voice, voice_script)| voice.next_gesture_frame(voice_script, &script.gestures, n));
        let body_events = state.motion.bodies.iter().map(|body| body.next_event_frame(n));
        let continuations = state.parameters.gate_continuations.iter();
        let gate_events = script.gates.iter().zip(continuations);
        let gate_events = gate_events.map(|(gate, continuation)| gate.next_change_frame(continuation.as_ref(), n));
        let glide_events = script.glides.iter().map(|glide| glide.next_change_frame(n));
        let lead_events = script.led_links.iter().map(|led| led.next_change_frame(n));
        let event_frames = strike_frame
            .into_iter()
            .chain(ergon_frame)
            .chain(voice_events)
            .chain(body_events);
        let event_frames = event_frames.chain(gate_events).chain(glide_events).chain(lead_events);
        event_frames.min().unwrap_or(u64::MAX)
    }

    /// Work of contacts so far: instants, and products.
    fn contact_work(&self) -> [u64; 2] {
        let fine_work = self.fine_work();
        [fine_work.evaluations, fine_work.products]
    }
}

impl bodies::RunningBody {
    /// The first step, `n` or later, in which anything strikes it or changes its parameters.
    fn next_event_frame(&self, n: u64) -> u64 {
        match self {
            Self::Modal(modal) => modal.next_strike_frame(),
            Self::Mesh(mesh) => mesh.next_event_frame(n),
            // Strikes on a slow body go through its ports, which are in the island.
            Self::Slow(_) => u64::MAX,
        }
    }

    /// Most steps between two pulls of its springs.
    fn kick_interval(&self) -> u32 {
        match self {
            Self::Slow(slow) => slow.kick_interval(),
            Self::Modal(_) | Self::Mesh(_) => 1,
        }
    }

    /// Advance its counters of steps by `steps`, which may be negative.
    fn shift_frames(&mut self, steps: i64) {
        match self {
            Self::Modal(modal) => modal.shift_frames(steps),
            Self::Slow(slow) => slow.shift_frames(steps),
            Self::Mesh(_) => {}
        }
    }
}

fn has_same_bits(a: &[f64], b: &[f64]) -> bool {
    let bit_pattern = |x: &f64| x.to_bits();
    a.iter().map(bit_pattern).eq(b.iter().map(bit_pattern))
}
