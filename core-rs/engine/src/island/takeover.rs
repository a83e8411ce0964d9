//! Starting an island at a later frame, and continuing one from the state of another version.

use super::{Island, State};
use crate::kernel;
use crate::timeline::GateContinuation;

/// An item whose state passes from an island to one of another version. Indices are in the old island first, then in
/// the new.
#[derive(Clone, Debug)]
pub(crate) enum ItemTakeover {
    /// From a voice to a voice.
    Voice(crate::island::written_hand::voice::VoiceTakeover),
    /// From a gate, or from a link without a gate (`None`), to a gate.
    Gate(Option<usize>, usize),
    /// From a hand to a hand.
    Hand(usize, usize),
    /// From a delayed port to a delayed port.
    Port(usize, usize),
    /// From a gesture's report to that of the same gesture, and whether MATs have the same indices in both islands.
    GestureReport(usize, usize, bool),
    /// From a body to an equal one.
    Body(usize, usize),
    /// The memory of a link, from one index to another.
    LinkMemory(usize, usize),
    /// The sliding history of contacts of all pairs, from the first link of one run to that of another.
    PairHistory(usize, usize),
    /// Whether a part is muted, from one index to another.
    MutedPart(usize, usize),
}

impl State {
    /// The memory of a link [m]; infinite if the link is broken.
    pub(super) fn memory_of(&self, link: usize) -> f64 {
        let bristle_deflection = self
            .motion
            .fine_links
            .as_ref()
            .and_then(|fine_links| fine_links.bristle_deflection(link));
        let stepped_memory = self.motion.modules.link_memories.get(link).copied();
        bristle_deflection.or(stepped_memory).unwrap_or(0.0)
    }

    fn set_memory(&mut self, link: usize, memory: f64) {
        if let Some(link_memory) = self.motion.modules.link_memories.get_mut(link) {
            *link_memory = memory;
        }
        if let Some(fine_links) = &mut self.motion.fine_links {
            fine_links.set_bristle_deflection(link, memory);
        }
    }
}

impl Island {
    /// Begin at a frame of the scene instead of 0: events before it are skipped.
    pub(crate) fn seek(&mut self, scene_frame: u64) {
        let start_step = self.step_at(scene_frame);
        let (script, state) = (&*self.script, &mut self.state);
        let step_rate = script.scheme.rate;
        state.frame = start_step;
        state.sources.next_strike = script
            .strike_forces
            .partition_point(|strike_force| strike_force.frame < start_step);
        state.sources.next_ergon = script.ergons.partition_point(|(frame, _)| *frame < start_step);
        for (voice, voice_script) in state.sources.voices.iter_mut().zip(&script.voices) {
            voice.seek(voice_script, &script.gestures, start_step);
        }
        for body in &mut state.motion.bodies {
            body.seek(start_step);
        }
        for drive in &script.drives {
            if drive.is_path() && start_step > 0 {
                let path_position = drive.value(start_step, step_rate);
                state.motion.modules.x[drive.mat] = path_position;
                state.motion.modules.d[drive.mat] = path_position - drive.value(start_step - 1, step_rate);
            }
        }
        super::real_hands::seek_hands(&script.hand_bindings, &mut state.sources.hand_states, start_step);
        self.resume_computing();
    }

    /// Take over, to the last bit, the state of an island of the same network and bodies with the same number of steps
    /// a frame.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        self.resume_computing();
        if old.n_muted_parts() > 0 {
            // Muted parts were removed from the old island's lists, so only positions and steps are sure to match.
            self.state.motion.modules.x.copy_from_slice(&old.state.motion.modules.x);
            self.state.motion.modules.d.copy_from_slice(&old.state.motion.modules.d);
            if let Some(guard) = &mut self.state.monitors.guard {
                guard.reset();
            }
            self.set_ports();
            return;
        }
        let (motion, old_motion) = (&mut self.state.motion, &mut old.state.motion);
        let (modules, old_modules) = (&mut motion.modules, &mut old_motion.modules);
        std::mem::swap(&mut modules.x, &mut old_modules.x);
        std::mem::swap(&mut modules.d, &mut old_modules.d);
        std::mem::swap(&mut modules.free_port_motion, &mut old_modules.free_port_motion);
        std::mem::swap(&mut modules.link_forces, &mut old_modules.link_forces);
        std::mem::swap(&mut modules.link_memories, &mut old_modules.link_memories);
        std::mem::swap(&mut modules.contact_histories, &mut old_modules.contact_histories);
        for (running_body, old_running_body) in motion.bodies.iter_mut().zip(&mut old_motion.bodies) {
            running_body.continue_from(old_running_body);
        }
        if let (Some(fine_links), Some(old_fine_links)) = (&mut motion.fine_links, &mut old_motion.fine_links) {
            fine_links.continue_from(old_fine_links);
        }
        let (monitors, old_monitors) = (&mut self.state.monitors, &mut old.state.monitors);
        monitors.muted_parts.continue_from(&old_monitors.muted_parts);
        std::mem::swap(&mut monitors.guard, &mut old_monitors.guard);
        std::mem::swap(
            &mut self.state.sources.ergon_stream,
            &mut old.state.sources.ergon_stream,
        );
        if monitors.ledger.is_some() && old_monitors.ledger.is_some() {
            std::mem::swap(&mut monitors.ledger, &mut old_monitors.ledger);
        }
        if self.sleep_monitor.is_some() && old.sleep_monitor.is_some() {
            std::mem::swap(&mut self.sleep_monitor, &mut old.sleep_monitor);
            self.resume_computing();
        }
    }

    /// Take the state of one item over from an island of another version.
    pub(crate) fn take_over(&mut self, item: &ItemTakeover, old: &mut Self) {
        self.resume_computing();
        let has_all_parts = old.n_muted_parts() == 0;
        match *item {
            ItemTakeover::Voice(ref takeover) if has_all_parts => {
                let script = &self.script;
                let voice = &mut self.state.sources.voices[takeover.new_voice];
                let (old_voice, old_script) = (
                    &mut old.state.sources.voices[takeover.old_voice],
                    &old.script.voices[takeover.old_voice],
                );
                voice.continue_from(&script.voices[takeover.new_voice], old_voice, old_script, takeover);
            }
            ItemTakeover::Gate(old_index, new_index) => {
                let island_step = self.state.frame;
                let new_gate = &self.script.gates[new_index];
                let old_step = old.state.frame;
                self.state.parameters.gate_continuations[new_index] = match old_index {
                    // A gate that glides has its own start value.
                    _ if new_gate.has_ramp() => None,
                    None => GateContinuation::new(new_gate, 1.0, island_step),
                    Some(old_index) => {
                        let (old_gate, continuation) = (
                            &old.script.gates[old_index],
                            &old.state.parameters.gate_continuations[old_index],
                        );
                        if old_gate.on_links(new_gate.first_link, new_gate.n_links) == *new_gate {
                            *continuation
                        } else {
                            GateContinuation::new(
                                new_gate,
                                GateContinuation::opening(continuation.as_ref(), old_gate, old_step),
                                island_step,
                            )
                        }
                    }
                };
            }
            ItemTakeover::Hand(old_index, new_index) => {
                self.state.sources.hand_states[new_index] = old.state.sources.hand_states[old_index].clone();
                let mat = self.script.hand_bindings[new_index].mat();
                let old_mat = old.script.hand_bindings[old_index].mat();
                self.state.motion.modules.x[mat] = old.state.motion.modules.x[old_mat];
                self.state.motion.modules.d[mat] = old.state.motion.modules.d[old_mat];
            }
            ItemTakeover::Port(old_index, new_index) => {
                self.state.sources.delayed_forces[new_index].take_over(&old.state.sources.delayed_forces[old_index]);
            }
            ItemTakeover::GestureReport(old_index, new_index, has_same_mats) => {
                let new_report = &mut self.state.sources.reports[new_index];
                *new_report = old.state.sources.reports[old_index];
                new_report.pushed_by_mat = new_report.pushed_by_mat.filter(|_| has_same_mats);
            }
            ItemTakeover::Body(old_index, new_index) if has_all_parts => {
                self.state.motion.bodies[new_index].continue_from(&mut old.state.motion.bodies[old_index]);
            }
            ItemTakeover::LinkMemory(old_index, new_index) => {
                let link_memory = old.state.memory_of(old_index);
                self.state.set_memory(new_index, link_memory);
            }
            ItemTakeover::PairHistory(old_index, new_index) => {
                let history_slots = (
                    old.script.scheme.slot_of(old_index),
                    self.script.scheme.slot_of(new_index),
                );
                if let (Some(old_slot), Some(new_slot)) = history_slots {
                    let history = &mut self.state.motion.modules.contact_histories[new_slot];
                    history.copy_from(&old.state.motion.modules.contact_histories[old_slot]);
                }
            }
            ItemTakeover::MutedPart(old_index, new_index) => {
                if old.is_part_muted(old_index) && !self.is_part_muted(new_index) {
                    // A muted part stays muted in the next version.
                    self.mute(new_index, self.state.frame);
                }
            }
            ItemTakeover::Voice(_) | ItemTakeover::Body(..) => {}
        }
    }

    /// Whether a part is muted.
    fn is_part_muted(&self, part: usize) -> bool {
        let mut muted_parts = self.state.monitors.muted_parts.iter();
        muted_parts.any(|(muted_part, _)| muted_part == part)
    }

    /// Position of a MAT [m], and its step in a frame of the scene [m].
    pub(crate) fn motion(&self, mat: usize) -> (f64, f64) {
        let modules = &self.state.motion.modules;
        (modules.x[mat], modules.d[mat] * self.steps_per_frame())
    }

    /// Set position and step in a frame of the scene [m] of a MAT; values that are not finite or plausible are ignored.
    pub(crate) fn set_motion(&mut self, mat: usize, (x, step): (f64, f64)) {
        self.resume_computing();
        if kernel::is_bounded(x) && step.is_finite() {
            self.state.motion.modules.x[mat] = x;
            self.state.motion.modules.d[mat] = step / self.steps_per_frame();
            if let Some(guard) = &mut self.state.monitors.guard {
                guard.reset();
            }
        }
    }

    /// One of the bodies; `None` if any part of the island is muted.
    pub(crate) fn body_mut(&mut self, body_index: usize) -> Option<&mut super::bodies::RunningBody> {
        self.resume_computing();
        if self.n_muted_parts() > 0 {
            return None;
        }
        self.state.motion.bodies.get_mut(body_index)
    }

    /// Set the ports to where their bodies have them.
    pub(crate) fn set_ports(&mut self) {
        self.resume_computing();
        for body in &self.state.motion.bodies {
            body.set_ports(&mut self.state.motion.modules);
        }
        let changing_scheme = self.state.parameters.changing_scheme.as_deref();
        let current_scheme = changing_scheme.unwrap_or(&self.script.scheme);
        kernel::proxies::set_from_masses(current_scheme, &mut self.state.motion.modules);
    }

    /// The script, whose voices, gates, hands and parts are matched with those of another version.
    pub(crate) fn script(&self) -> &super::Script {
        &self.script
    }
}
