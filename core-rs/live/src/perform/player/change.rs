//! What is to change at a frame: another version of what plays, of who hears it, of how loud it is.
//!
//! A change is made where time does not count and comes to the physics thread as a box; what it replaces goes back in the
//! same box, to be freed where it came from.

use ergon_engine::mix::mixer::Mixer;
use ergon_engine::simulation::{Carry, Simulation};

use super::Player;
use crate::perform::guidance::GuidanceStep;
use crate::perform::scale::Bound;
use crate::perform::status::EventKind;

/// Changes that may wait at once.
pub(in crate::perform) const SCHEDULED_MAX: usize = 64;

/// What is to change; what is not said stays.
#[derive(Default)]
pub struct Change {
    /// Another simulation, at the frame of the change, and what it takes over from the one that plays.
    pub simulation: Option<(Simulation, Carry)>,
    /// Another mixer, of as many channels.
    pub mixer: Option<Mixer>,
    /// Gains of groups of routes.
    pub gains: Vec<(usize, f64)>,
    /// The gain after the mixer.
    pub gain: Option<f64>,
    /// Frames at which bars begin, rising.
    pub bars: Option<Vec<u64>>,
    /// Where hands stand in at each tick from that of the change on, hand by hand, where a guide leads it; without any it
    /// stays as it is.
    pub standins: Option<Vec<Vec<f64>>>,
    /// Steps of each hand's loose guidance; a hand without steps keeps its factors.
    pub guidance_steps: Option<Vec<Vec<GuidanceStep>>>,
    /// How much of the scene's force each hand may get when; a hand without bounds gets as much as before.
    pub bounds: Option<Vec<Vec<Bound>>>,
    /// See [`Simulation::damp`].
    pub damp: Option<Option<f64>>,
}

/// A change on its way.
pub(crate) struct ScheduledChange {
    pub(in crate::perform) at: u64,
    pub(in crate::perform) ticket: u64,
    pub(in crate::perform) change: Change,
    /// Room for what the new simulation is heard by   (every · n_out)
    pub(in crate::perform) heard: Vec<f64>,
}

impl Player {
    /// A change came: it waits for its frame, behind those of the same frame.
    pub(super) fn wait_for(&mut self, due: Box<ScheduledChange>) {
        if self.waiting.len() == SCHEDULED_MAX {
            self.tell(EventKind::Late(due.ticket));
            self.give_back(due);
            return;
        }
        let at = self.waiting.partition_point(|other| other.at <= due.at);
        self.waiting.insert(at, due);
    }

    /// Do what is due at the first frame of this tick; what was due before it comes too late and is left.
    pub(super) fn changes(&mut self) {
        while self.waiting.first().is_some_and(|due| due.at <= self.frame) {
            let mut due = self.waiting.remove(0);
            let done = due.at == self.frame && self.change(&mut due);
            let ticket = due.ticket;
            self.tell(if done {
                EventKind::Changed(ticket)
            } else {
                EventKind::Late(ticket)
            });
            self.note(format_args!("{{\"change\":{ticket},\"done\":{done}}}"));
            self.give_back(due);
        }
    }

    /// False where the simulation is of another frame, takes over from another than plays, or has other outputs than are
    /// mixed: nothing is changed then.
    fn change(&mut self, due: &mut ScheduledChange) -> bool {
        let ScheduledChange { change, heard, .. } = due;
        let stage = &mut self.stage;
        let simulation = change
            .simulation
            .as_ref()
            .map_or(&stage.simulation, |(own, _)| own);
        let mixer = change.mixer.as_ref().unwrap_or(&stage.mixer);
        if simulation.n_out() != mixer.n_out() {
            return false;
        }
        if let Some((simulation, carry)) = &mut change.simulation {
            if !simulation.take_over(&mut stage.simulation, carry) {
                return false;
            }
            std::mem::swap(simulation, &mut stage.simulation);
            std::mem::swap(heard, &mut self.heard);
        }
        if let Some(mixer) = &mut change.mixer {
            let outputs = change.simulation.as_ref().map(|(_, carry)| carry.outputs());
            mixer.take_over(&stage.mixer, outputs);
            std::mem::swap(mixer, &mut stage.mixer);
        }
        for &(group, gain) in &change.gains {
            stage.mixer.set_gain(group, gain);
        }
        if let Some(gain) = change.gain {
            self.gain.set(gain);
        }
        if let Some(t60) = change.damp {
            stage.simulation.damp(t60);
        }
        if let Some(bars) = &mut change.bars {
            std::mem::swap(bars, &mut stage.bars);
        }
        if let Some(standins) = &mut change.standins {
            let movers = self.movers.iter_mut().zip(&mut self.guidance);
            for ((hand, standin), (mover, guidance)) in
                stage.hands.iter_mut().zip(standins).zip(movers)
            {
                if standin.is_empty() {
                    continue;
                }
                let before = hand.stands_at(self.tick);
                std::mem::swap(&mut hand.standin, standin);
                hand.since = self.tick;
                let now = hand.stands_at(self.tick);
                guidance.change(before, now);
                if !mover.real {
                    mover.change(false, now);
                }
            }
        }
        if let Some(all) = &mut change.guidance_steps {
            for (guidance, steps) in self.guidance.iter_mut().zip(all) {
                if guidance.is_loose() {
                    std::mem::swap(&mut guidance.steps, steps);
                    guidance.begin(self.tick);
                }
            }
        }
        if let Some(bounds) = &mut change.bounds {
            for (scale, bounds) in self.scales.iter_mut().zip(bounds) {
                if !bounds.is_empty() {
                    std::mem::swap(&mut scale.bounds, bounds);
                    scale.begin(self.tick);
                }
            }
        }
        true
    }

    /// What each hand's force is scaled by in this tick, with an eye to the changes that wait.
    pub(super) fn scale(&mut self) {
        let every = self.stage.every as u64;
        for (hand, scale) in self.scales.iter_mut().enumerate() {
            let Some((slot, axis)) = self.of[hand] else {
                continue;
            };
            let waiting = self.waiting.iter().flat_map(|due| {
                let bounds = due.change.bounds.iter().filter_map(|all| all.get(hand));
                bounds.flatten().map(|bound| Bound {
                    at: bound.at.saturating_add(due.at / every),
                    ..*bound
                })
            });
            let now = scale.tick(self.tick, waiting);
            self.slots[slot].scale(axis, now);
        }
    }

    /// To be freed elsewhere; where nobody takes it back it is not freed at all.
    fn give_back(&mut self, due: Box<ScheduledChange>) {
        if let Err(rtrb::PushError::Full(due)) = self.links.garbage.push(due) {
            std::mem::forget(due);
        }
    }
}
