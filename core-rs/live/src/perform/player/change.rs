//! Changes at a frame: another simulation, mixer, gain, stand-ins, guidance or bounds of forces.
//!
//! A change is prepared in an ordinary thread and sent to the physics thread in a box. What it replaces goes back in
//! the same box and is freed in the ordinary thread.

use ergon_engine::mix::mixer::Mixer;
use ergon_engine::simulation::{Simulation, Takeover};

use super::Player;
use crate::perform::Garbage;
use crate::perform::guidance::GuidanceStep;
use crate::perform::scale::ScaleBound;
use crate::perform::status::EventKind;

/// Greatest number of changes that may wait.
pub(in crate::perform) const SCHEDULED_MAX: usize = 64;

/// A change; fields that are `None` or empty change nothing.
#[derive(Default)]
pub struct Change {
    /// Another simulation, at the frame of the change, and the takeover of state from the playing one.
    pub simulation: Option<(Simulation, Takeover)>,
    /// Another mixer, with the same number of channels.
    pub mixer: Option<Mixer>,
    /// Gains of groups of routes.
    pub gains: Vec<(usize, f64)>,
    /// The gain after the mixer.
    pub gain: Option<f64>,
    /// Frames at which bars begin, rising.
    pub bars: Option<Vec<u64>>,
    /// Stand-in positions of each hand, at each tick from the change on [m]; an empty list keeps the old ones.
    pub standin_positions: Option<Vec<Vec<f64>>>,
    /// With `standin_positions`: for each hand the forces that drive its key along them [N].
    pub standin_forces: Vec<Vec<f64>>,
    /// Steps of each hand's loose guidance; a hand without steps keeps its factors.
    pub guidance_steps: Option<Vec<Vec<GuidanceStep>>>,
    /// Bounds of the force on each hand; a hand without bounds keeps its scale.
    pub scale_bounds: Option<Vec<Vec<ScaleBound>>>,
    /// See [`Simulation::decay_time`].
    pub decay_time: Option<Option<f64>>,
}

/// A change that waits for its frame.
pub(crate) struct ScheduledChange {
    pub(in crate::perform) frame: u64,
    pub(in crate::perform) ticket: u64,
    pub(in crate::perform) change: Change,
    /// Buffer for the outputs of the new simulation   (tick_frames · n_out)
    pub(in crate::perform) outputs: Vec<f64>,
}

impl Player {
    /// Queue a change until its frame, after earlier changes of the same frame.
    pub(super) fn schedule(&mut self, due_change: Box<ScheduledChange>) {
        if self.scheduled_changes.len() == SCHEDULED_MAX {
            self.send_event(EventKind::ChangeMissed(due_change.ticket));
            self.discard_change(due_change);
            return;
        }
        let queue_index = self
            .scheduled_changes
            .partition_point(|other| other.frame <= due_change.frame);
        self.scheduled_changes.insert(queue_index, due_change);
    }

    /// Withdraw the changes of the simulation that are due at `frame` or later, by rising tickets.
    pub(super) fn revoke(&mut self, frame: u64) {
        let is_revoked =
            |due_change: &ScheduledChange| due_change.frame >= frame && due_change.change.simulation.is_some();
        loop {
            let waiting = self.scheduled_changes.iter().enumerate();
            let revoked_index = waiting.filter(|(_, due_change)| is_revoked(due_change));
            let Some((revoked_index, _)) = revoked_index.min_by_key(|(_, due_change)| due_change.ticket) else {
                break;
            };
            let due_change = self.scheduled_changes.remove(revoked_index);
            self.report(due_change.ticket, false);
            self.discard_change(due_change);
        }
    }

    /// Make the changes that are due at the first frame of this tick. Changes of earlier frames are late, and not made.
    pub(super) fn make_changes(&mut self) {
        while self
            .scheduled_changes
            .first()
            .is_some_and(|due_change| due_change.frame <= self.frame)
        {
            let mut due_change = self.scheduled_changes.remove(0);
            let is_done = due_change.frame == self.frame && self.change(&mut due_change);
            self.report(due_change.ticket, is_done);
            self.discard_change(due_change);
        }
    }

    /// Report whether a change was made.
    fn report(&mut self, ticket: u64, is_done: bool) {
        self.send_event(if is_done {
            EventKind::ChangeDone(ticket)
        } else {
            EventKind::ChangeMissed(ticket)
        });
        self.record_note(format_args!("{{\"change\":{ticket},\"done\":{is_done}}}"));
    }

    /// Make a change. Return false, with nothing changed, if its simulation cannot take over from the playing one, or
    /// if the numbers of outputs of simulation and mixer differ.
    fn change(&mut self, due_change: &mut ScheduledChange) -> bool {
        let ScheduledChange { change, outputs, .. } = due_change;
        let piece = &mut self.piece;
        let simulation = change
            .simulation
            .as_ref()
            .map_or(&piece.simulation, |(simulation, _)| simulation);
        let mixer = change.mixer.as_ref().unwrap_or(&piece.mixer);
        if simulation.n_out() != mixer.n_out() {
            return false;
        }
        if let Some((simulation, takeover)) = &mut change.simulation {
            if !simulation.take_over(&mut piece.simulation, takeover) {
                return false;
            }
            std::mem::swap(simulation, &mut piece.simulation);
            std::mem::swap(outputs, &mut self.outputs);
        }
        if let Some(mixer) = &mut change.mixer {
            let outputs = change.simulation.as_ref().map(|(_, takeover)| takeover.outputs());
            mixer.take_over(&mut piece.mixer, outputs);
            std::mem::swap(mixer, &mut piece.mixer);
        }
        for &(group, gain) in &change.gains {
            piece.mixer.set_gain(group, gain);
        }
        if let Some(gain) = change.gain {
            self.gain.set(gain);
        }
        if let Some(decay_time) = change.decay_time {
            piece.simulation.damp(decay_time);
        }
        if let Some(bars) = &mut change.bars {
            std::mem::swap(bars, &mut piece.bars);
        }
        if let Some(standins) = &mut change.standin_positions {
            let sources = self.hand_sources.iter_mut().zip(&mut self.guidance_states);
            for (index, ((hand, standin), (source, guidance))) in
                piece.hands.iter_mut().zip(standins).zip(sources).enumerate()
            {
                if standin.is_empty() {
                    continue;
                }
                let position_before = hand.standin_position(self.tick);
                std::mem::swap(&mut hand.standin_positions, standin);
                if let Some(written_forces) = change.standin_forces.get_mut(index) {
                    std::mem::swap(&mut hand.forces, written_forces);
                }
                hand.start_tick = self.tick;
                let position_now = hand.standin_position(self.tick);
                guidance.crossfade(position_before, position_now);
                if !source.is_real {
                    source.change_source(false, position_now);
                }
            }
        }
        if let Some(step_lists) = &mut change.guidance_steps {
            for (guidance, steps) in self.guidance_states.iter_mut().zip(step_lists) {
                if guidance.is_loose() {
                    std::mem::swap(&mut guidance.steps, steps);
                    guidance.begin_steps(self.tick);
                }
            }
        }
        if let Some(bounds) = &mut change.scale_bounds {
            for (scale, bounds) in self.force_scales.iter_mut().zip(bounds) {
                if !bounds.is_empty() {
                    std::mem::swap(&mut scale.bounds, bounds);
                    scale.begin(self.tick);
                }
            }
        }
        true
    }

    /// Advance the force scale of each hand, with the bounds of changes that wait.
    pub(super) fn update_scales(&mut self) {
        let tick_frames = self.piece.tick_frames as u64;
        for (hand, scale) in self.force_scales.iter_mut().enumerate() {
            let Some((slot_index, axis_index)) = self.hand_axes[hand] else {
                continue;
            };
            let waiting = self.scheduled_changes.iter().flat_map(|due_change| {
                let hand_bounds = due_change.change.scale_bounds.iter().filter_map(|all| all.get(hand));
                hand_bounds.flatten().map(|bound| ScaleBound {
                    tick: bound.tick.saturating_add(due_change.frame / tick_frames),
                    ..*bound
                })
            });
            let scale_now = scale.advance(self.tick, waiting);
            self.slots[slot_index].set_scale(axis_index, scale_now);
        }
    }

    fn discard_change(&mut self, due_change: Box<ScheduledChange>) {
        self.discard(Garbage::Change(due_change));
    }

    /// Send a box back to be freed; if there is no room it is leaked, not freed here.
    pub(super) fn discard(&mut self, garbage: Garbage) {
        if let Err(rtrb::PushError::Full(garbage)) = self.connections.garbage.push(garbage) {
            std::mem::forget(garbage);
        }
    }
}
