//! Resting islands: steps that would not change an island are skipped, until an event is due or something comes from
//! outside.
//!
//! A step is a function of the state and of the events due at it. If no event is due, and a step leaves the state and
//! the outputs the same to the last bit, so do all that follow. Only the counters of steps in the state are advanced.
//! The state is therefore at every frame what it would be if all steps were computed, and an island wakes by computing
//! its next step.

use super::{Fault, Island, energy_account, inside};
use crate::archive::{Archive, State as _};
use crate::island::quiet::Quiet;
use crate::island::written_hand::voice::Voice;
use crate::kernel::thread_team::ThreadTeam;
use crate::timeline::{Drive, DriveSource};

/// Successive frames that must leave the state the same before an island rests. Periodic work recurs within so many:
/// looks at gains, pulls of slow bodies, and modes that are computed ahead.
const ALIKE_FRAMES: u64 = 256;
/// Frames from the beginning of an island to the first look at it; the wait doubles after each look that finds it
/// moving.
const FIRST_GAP: u64 = 64;
/// Most frames between two looks: one look costs about as much as two frames.
const GAP_MAX: u64 = 1 << 15;
/// Steps before an event from which on steps are computed, because bodies are computed ahead and strikes may fall
/// between frames.
const MARGIN: u64 = 4 * energy_account::CHECK_STEPS;
/// Frames after which a search for silence ends, and the island counts as one that sounds.
const SILENCE_FRAMES: u64 = 1_024;
/// States larger than this are not compared [bytes].
const STATE_MAX: usize = 1 << 26;

/// State of the search for rest.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    stage: Stage,
    /// The step of the next look, and the frames from there to the look after it.
    next: u64,
    gap: u64,
    /// The state at the last look.
    left: Vec<u8>,
    /// Outputs in the frame after it   (n_out), and the work of contacts in that frame.
    outputs: Vec<f64>,
    work: [u64; 2],
    /// Number of steps that were skipped.
    passed: u64,
}

#[derive(Clone, Copy, Debug)]
enum Stage {
    /// It moves, or may.
    Computed,
    /// This many frames since the last look left the state the same.
    Alike(u64),
    /// It rests up to this step.
    Resting(u64),
    /// It sleeps up to this step: its clock stands still.
    Asleep(u64),
}

impl Rest {
    pub(super) fn new(n_out: usize) -> Self {
        Self {
            stage: Stage::Computed,
            next: 0,
            gap: FIRST_GAP,
            left: Vec::new(),
            outputs: vec![0.0; n_out],
            work: [0; 2],
            passed: 0,
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
            let frames_to_look = frames_until(self.next_quiet_look());
            let frame_count = match self.rest.stage {
                Stage::Computed => frames_to_look.min(frames_until(self.rest.next)),
                Stage::Alike(_) => 1,
                Stage::Resting(last) => frames_to_look.min(frames_until(last)),
                Stage::Asleep(last) => frames_until(last),
            };
            let out = &mut out[n_out * frames_done..n_out * (frames_done + frame_count as usize)];
            frames_done += frame_count as usize;
            match self.rest.stage {
                Stage::Asleep(_) if frame_count == 0 => self.sleep_on(),
                Stage::Asleep(_) => {
                    for row in out.chunks_exact_mut(n_out.max(1)) {
                        self.quiet.iter().for_each(|quiet| quiet.hold(row));
                    }
                    self.state.frame += frame_count * steps_per_frame;
                    self.rest.passed += frame_count * steps_per_frame;
                    continue;
                }
                Stage::Computed if frame_count == 0 => self.look_for_rest(),
                Stage::Computed => self.compute(out, frame_count as usize, team)?,
                Stage::Alike(frames) => {
                    let work_before = self.fine_products();
                    self.compute(out, 1, team)?;
                    self.compare(out, frames, work_before);
                }
                Stage::Resting(_) if frame_count == 0 => self.wake(),
                Stage::Resting(_) => {
                    for row in out.chunks_exact_mut(n_out.max(1)) {
                        row.copy_from_slice(&self.rest.outputs);
                    }
                    self.shift_frames((frame_count * steps_per_frame) as i64, frame_count as i64);
                    self.rest.passed += frame_count * steps_per_frame;
                }
            }
            if frame_count > 0
                && let Some(wake_step) = self.falls_asleep(out)
            {
                self.rest.stage = Stage::Asleep(wake_step);
            }
        }
        Ok(())
    }

    /// Compute steps from here on, because something came from outside.
    pub(super) fn wake(&mut self) {
        if !matches!(self.rest.stage, Stage::Computed) {
            self.quiet.iter_mut().for_each(Quiet::wake);
            self.look_soon();
        }
    }

    /// Compute steps from here on, unless it sleeps: what only watches it changes no sample.
    pub(super) fn wake_from_rest(&mut self) {
        if !matches!(self.rest.stage, Stage::Asleep(_)) {
            self.wake();
        }
    }

    /// Compute steps from here on, because the state came from elsewhere, and look soon whether the island rests; sleep
    /// on if it slept there.
    pub(super) fn begin_again(&mut self) {
        self.look_soon();
        if self.quiet.as_ref().is_some_and(Quiet::is_asleep) {
            // Until when, the next frame decides: more of the state may come.
            self.rest.stage = Stage::Asleep(self.state.frame);
        }
    }

    /// Sleep on until the next event, or wake for it.
    fn sleep_on(&mut self) {
        match self.wakes_at() {
            Some(wake_step) => self.rest.stage = Stage::Asleep(wake_step),
            None => self.wake(),
        }
    }

    fn look_soon(&mut self) {
        self.rest.gap = FIRST_GAP;
        self.schedule_look();
    }

    /// Number of steps skipped so far because the island rested.
    pub(crate) fn passed(&self) -> u64 {
        self.rest.passed
    }

    /// Number of frames computed so far.
    pub(crate) fn computed(&self) -> u64 {
        (self.state.frame - self.rest.passed) / u64::from(self.oversampling)
    }

    /// The step up to which it rests or sleeps; `None` if it moves, may move, or rests for ever.
    pub(crate) fn rests_until(&self) -> Option<u64> {
        match self.rest.stage {
            Stage::Resting(last) | Stage::Asleep(last) if last < u64::MAX - MARGIN => Some(last),
            Stage::Resting(_) | Stage::Asleep(_) | Stage::Computed | Stage::Alike(_) => None,
        }
    }

    /// The frame up to which its outputs are 0 if nothing comes from outside, found on a copy that is computed until it
    /// rests; the present frame if it sounds or moves soon.
    pub(crate) fn silent_until(&self) -> u64 {
        let steps_per_frame = u64::from(self.oversampling);
        let frame_now = self.state.frame / steps_per_frame;
        if self.due(self.state.frame) <= self.state.frame + SILENCE_FRAMES * steps_per_frame {
            return frame_now;
        }
        let mut island_copy = self.clone();
        let mut output_row = vec![0.0; self.n_out()];
        let is_silent = |output_row: &[f64]| output_row.iter().all(|x| *x == 0.0);
        let team = |team: &mut ThreadTeam<'_>| {
            for _ in 0..SILENCE_FRAMES {
                if island_copy.process(&mut output_row, 1, team).is_err() || !is_silent(&output_row) {
                    return frame_now;
                }
                if let Stage::Resting(last_step) = island_copy.rest.stage {
                    // What it would give if it slept later.
                    island_copy.quiet.iter().for_each(|quiet| quiet.hold(&mut output_row));
                    return if is_silent(&output_row) {
                        last_step / steps_per_frame
                    } else {
                        frame_now
                    };
                }
            }
            frame_now
        };
        ThreadTeam::with(1, team)
    }

    /// Reserve room for the state, so that looks at it do not allocate.
    pub(super) fn reserve_rest(&mut self) {
        let mut state_size = 0;
        let _ = self.archive_all(&mut Archive::Count(&mut state_size));
        // Some lists grow while it plays.
        let reports_size = size_of_val(&*self.state.hands.reports);
        let state_room = state_size + state_size / 4 + reports_size + 4_096;
        self.rest.left.clear();
        if state_size <= STATE_MAX {
            self.rest.left.reserve_exact(state_room);
        }
        if let Stage::Alike(_) = self.rest.stage {
            self.schedule_look();
        }
    }

    fn schedule_look(&mut self) {
        let rest = &mut self.rest;
        rest.stage = Stage::Computed;
        rest.next = self.state.frame + rest.gap * u64::from(self.oversampling);
        rest.gap = GAP_MAX.min(2 * rest.gap);
    }

    #[cold]
    fn look_for_rest(&mut self) {
        let island_step = self.state.frame;
        let soon_step = island_step + MARGIN + 2 * ALIKE_FRAMES * u64::from(self.oversampling);
        let mut noted_state = std::mem::take(&mut self.rest.left);
        noted_state.clear();
        let may_rest = self.due(island_step) > soon_step
            && !self.state.watch.touches.are_pushed(&self.state.matter.body.link)
            && self.archive_all(&mut Archive::Note(&mut noted_state)).is_ok();
        self.rest.left = noted_state;
        if may_rest {
            self.rest.stage = Stage::Alike(0);
        } else {
            self.schedule_look();
        }
    }

    /// Compare the frame that was just computed with the look, `frames` frames before; `work` is that of contacts
    /// before the frame.
    fn compare(&mut self, outputs: &[f64], frames: u64, work: [u64; 2]) {
        let work_after = self.fine_products();
        let work = [work_after[0] - work[0], work_after[1] - work[1]];
        if frames == 0 {
            self.rest.outputs.copy_from_slice(outputs);
            self.rest.work = work;
        }
        let is_same_frame = work == self.rest.work && same_bits(outputs, &self.rest.outputs);
        if !is_same_frame || !self.is_unchanged(frames + 1) {
            self.schedule_look();
            return;
        }
        self.rest.stage = Stage::Alike(frames + 1);
        if frames + 1 == ALIKE_FRAMES {
            let due_step = self.due(self.state.frame);
            self.rest.stage = Stage::Resting(due_step.saturating_sub(MARGIN));
        }
    }

    /// Whether the state is that of the look, `frames` frames later.
    fn is_unchanged(&mut self, frames: u64) -> bool {
        let (frames, steps_per_frame) = (frames as i64, i64::from(self.oversampling));
        let noted_state = std::mem::take(&mut self.rest.left);
        let mut same_archive = Archive::Same(&noted_state);
        self.shift_frames(-frames * steps_per_frame, -frames);
        let is_same_state = self.archive_all(&mut same_archive).is_ok() && same_archive.is_empty();
        self.shift_frames(frames * steps_per_frame, frames);
        self.rest.left = noted_state;
        is_same_state
    }

    /// Archive the whole state, with the ledger and the length of the stream, which a stored render leaves out.
    fn archive_all(&mut self, archive: &mut Archive<'_>) -> Result<(), crate::archive::Damaged> {
        let state = &mut self.state;
        state.archive(archive)?;
        state.watch.ledger.archive(archive)?;
        state.hands.stream.len().archive(archive)
    }

    /// Advance all counters of steps by `steps`, and the work of contacts by that of `frames` frames; both may be
    /// negative.
    fn shift_frames(&mut self, steps: i64, frames: i64) {
        let state = &mut self.state;
        state.frame = state.frame.wrapping_add_signed(steps);
        for body in &mut state.matter.bodies {
            body.shift_frames(steps);
        }
        for voice in &mut state.hands.voices {
            voice.shift_frames(steps);
        }
        if let Some(fine_state) = &mut state.matter.fine {
            let [instants, products] = self.rest.work.map(|fine_work| fine_work as i64 * frames);
            let fine_work = &mut fine_state.work;
            fine_work.instants = fine_work.instants.wrapping_add_signed(instants);
            fine_work.products = fine_work.products.wrapping_add_signed(products);
        }
    }

    /// The first step, `n` or later, at which an event may be due; `n` if that is not known.
    pub(super) fn due(&self, n: u64) -> u64 {
        let (script, state) = (&*self.script, &self.state);
        // The future of hands and takes is not looked at.
        let is_known = |drive: &Drive| matches!(drive.source, DriveSource::Constant(_) | DriveSource::Strikes { .. });
        if !script.drives.iter().all(is_known) || !script.hand_bindings.is_empty() || state.hands.is_struck() {
            return n;
        }
        let body_intervals = state.matter.bodies.iter().map(inside::RunningBody::kick_every);
        let mut kick_intervals = body_intervals.chain(state.hands.voices.iter().map(Voice::kick_every));
        if kick_intervals.any(|interval| u64::from(interval) > ALIKE_FRAMES) {
            return n;
        }
        let push_frame = script.pushes.get(state.hands.pushed).map(|push_frame| push_frame.frame);
        let ergon_frame = script.ergons.get(state.hands.ergons).map(|ergon_frame| ergon_frame.0);
        let voice_events = state.hands.voices.iter().zip(&script.voices);
        let voice_events = voice_events.map(|(voice, voice_script)| voice.due(voice_script, &script.gestures, n));
        let body_events = state.matter.bodies.iter().map(|body| body.due(n));
        let continuations = state.values.gate_continuations.iter();
        let gate_events = script.gates.iter().zip(continuations);
        let gate_events = gate_events.map(|(gate, continuation)| gate.next_change_frame(continuation.as_ref(), n));
        let glide_events = script.glides.iter().map(|glide| glide.due(n));
        let lead_events = script.led.iter().map(|led| led.due(n));
        let event_frames = push_frame
            .into_iter()
            .chain(ergon_frame)
            .chain(voice_events)
            .chain(body_events);
        let event_frames = event_frames.chain(gate_events).chain(glide_events).chain(lead_events);
        event_frames.min().unwrap_or(u64::MAX)
    }

    /// Work of contacts so far: instants, and products.
    fn fine_products(&self) -> [u64; 2] {
        let fine_work = self.fine_work();
        [fine_work.instants, fine_work.products]
    }
}

impl inside::RunningBody {
    /// The first step, `n` or later, in which anything strikes it or changes its parameters.
    fn due(&self, n: u64) -> u64 {
        match self {
            Self::Modal(modal) => modal.next_strike_frame(),
            Self::Mesh(mesh) => mesh.due(n),
            // Strikes on a slow body go through its ports, which are in the island.
            Self::Slow(_) => u64::MAX,
        }
    }

    /// Most steps between two pulls of its springs.
    fn kick_every(&self) -> u32 {
        match self {
            Self::Slow(slow) => slow.kick_every(),
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

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    let bit_pattern = |x: &f64| x.to_bits();
    a.iter().map(bit_pattern).eq(b.iter().map(bit_pattern))
}
