//! The phases of a step (`step` says what each reads and writes).

use super::strikes::apply_strikes_and_ergons;
use super::{MotionState, Script, State, delayed_ports, glide, live_strikes, real_hands, sounds_in};
use crate::guard;
use crate::island::written_hand::voice::{Voice, VoiceScene, VoiceScript};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::Scheme;

/// Sets the inputs of this frame: gliding parameters, open gates, positions of real hands.
pub(super) fn set_inputs(script: &Script, state: &mut State, mut scheme: Option<&mut Scheme>, n: u64) {
    let State {
        parameters,
        motion,
        sources,
        monitors,
        ..
    } = state;
    if let Some(scheme) = scheme.as_deref_mut() {
        glide::apply_glides(&script.glides, &script.scheme, scheme, n);
        let leads = (&script.led_links[..], &mut parameters.next_lead_points);
        glide::apply_leads(leads, &script.scheme, scheme, &mut motion.fine_links, n);
        if let Some(fine_links) = &mut motion.fine_links {
            glide::set_fine_coefficients(&script.glides, &script.scheme, fine_links, n);
        }
    }
    parameters.set_gates(&script.gates, n);
    if parameters.velocity_factor < 1.0 {
        motion
            .modules
            .d
            .iter_mut()
            .for_each(|d| *d *= parameters.velocity_factor);
        if let Some(guard) = &mut monitors.guard {
            guard.scale_velocities(parameters.velocity_factor);
        }
        motion.set_ports(); // bodies are damped by themselves
    }
    let hand_states = &mut sources.hand_states;
    real_hands::move_hands(&script.hand_bindings, hand_states, n, &mut motion.modules);
    delayed_ports::follow_keys(&script.port_bindings, &mut motion.modules);
    if let Some(scheme) = scheme {
        glide::apply_following_masses(&script.scheme, scheme, &motion.modules.x);
    }
}

/// A frame while it is computed.
pub(super) struct StepInProgress<'a, 'team> {
    pub(super) n: u64,
    pub(super) script: &'a Script,
    /// The numbers of this frame.
    pub(super) scheme: &'a Scheme,
    pub(super) state: &'a mut State,
    pub(super) team: &'a mut ThreadTeam<'team>,
}

/// The forces of links and of imposed motions are known.
pub(super) struct LinksApplied(());

/// All strikes of this frame have been applied.
pub(super) struct StrikesApplied(());

/// All forces are known.
pub(super) struct ForcesComplete(());

/// Positions and steps are those of the next frame.
pub(super) struct MoveResult {
    /// Whether all of them are plausible.
    pub(super) is_plausible: bool,
    /// Whether the frame was computed again in finer steps.
    is_finer: bool,
}

impl StepInProgress<'_, '_> {
    /// Computes the forces of links, drives, sounds and live strokes, and divides the forces on proxies among their
    /// masses.
    pub(super) fn apply_links(&mut self) -> LinksApplied {
        let (n, script, scheme) = (self.n, self.script, self.scheme);
        let State {
            parameters,
            motion,
            sources,
            monitors,
            ..
        } = &mut *self.state;
        let MotionState {
            modules,
            scratch,
            fine_links,
            targets,
            ..
        } = motion;
        kernel::compute_link_forces(scheme, &parameters.gate_openings, modules, scratch, self.team);
        targets.clear();
        for drive in &script.drives {
            drive.apply(n, scheme.rate, modules, targets);
        }
        delayed_ports::push_keys(&script.port_bindings, &sources.delayed_forces, modules);
        sounds_in::apply_inputs(&script.sound_drives, &sources.input_signals, n, modules, targets);
        if let Some(energy_rise) = &mut monitors.energy_rise
            && sources.has_pending_strikes()
        {
            energy_rise.restart();
        }
        live_strikes::apply_strikes(&script.strike_points, &mut sources.pending_strikes, scheme, modules);
        kernel::proxies::record_positions(scheme, modules);
        kernel::proxies::distribute_forces(scheme, modules);
        if let Some(fine_links) = fine_links {
            fine_links.record_steady_forces(scheme, modules);
            fine_links.apply_carried_forces(modules);
        }
        LinksApplied(())
    }

    /// Applies the strikes of written hands, pushes and ergons, also to the bodies.
    pub(super) fn apply_strikes(&mut self, _: LinksApplied) -> StrikesApplied {
        self.sum_layers();
        self.for_each_voice(Voice::step);
        apply_strikes_and_ergons(self.script, self.scheme, self.state, self.n);
        let MotionState { modules, bodies, .. } = &mut self.state.motion;
        for running_body in bodies {
            running_body.apply_strikes(self.n, modules);
        }
        StrikesApplied(())
    }

    /// Solves contacts and friction, which need all other forces. Then written hands compute their forces.
    pub(super) fn solve_contacts(&mut self, _: StrikesApplied) -> ForcesComplete {
        let scheme = self.scheme;
        let State { parameters, motion, .. } = &mut *self.state;
        let MotionState {
            modules,
            bodies,
            fine_links,
            targets,
            ..
        } = motion;
        kernel::solve_exact_contacts(scheme, &parameters.gate_openings, targets, modules);
        if let Some(fine_links) = fine_links {
            fine_links.step(scheme, &parameters.gate_openings, targets, bodies, modules);
            kernel::solve_friction(scheme, &parameters.gate_openings, targets, modules);
        }
        self.for_each_voice(Voice::record_tracked_ergon);
        ForcesComplete(())
    }

    /// Writes the outputs of this frame, the forces on hands, and the counters.
    pub(super) fn write_outputs_and_counters(&mut self, _: &ForcesComplete, out: Option<&mut [f64]>) {
        let (n, script, scheme) = (self.n, self.script, self.scheme);
        let State {
            parameters,
            motion,
            sources,
            monitors,
            ..
        } = &mut *self.state;
        let MotionState {
            modules,
            bodies,
            targets,
            ..
        } = motion;
        real_hands::add_hand_forces(&script.hand_bindings, &mut sources.hand_states, n, modules);
        delayed_ports::record_port_forces(&script.port_bindings, &mut sources.delayed_forces, modules);
        delayed_ports::set_port_targets(&script.port_bindings, scheme, targets, modules);
        monitors.contact_peaks.record_forces(n, &modules.link_forces);
        if let Some(out) = out {
            kernel::write_outputs(scheme, modules, out);
            bodies.iter().for_each(|running_body| running_body.add_outputs(out));
            monitors.muted_parts.fade(n, scheme, out);
        }
        if let Some(gains) = &mut monitors.energy_gains
            && !monitors.guard.as_ref().is_some_and(|guard| guard.is_finer())
        {
            gains.step(scheme, &parameters.gate_openings, targets, modules);
        }
        if let Some(ledger) = &mut monitors.ledger {
            ledger.begin_frame(scheme, targets, modules);
        }
    }

    /// Masses and bodies move; the frame is computed again in finer steps if links have stiffened too much.
    pub(super) fn advance(&mut self, _: ForcesComplete) -> MoveResult {
        let scheme = self.scheme;
        let MotionState {
            modules,
            bodies,
            scratch,
            targets,
            ..
        } = &mut self.state.motion;
        for running_body in &mut *bodies {
            running_body.step(self.n, &modules.force, self.team);
        }
        let partition = scratch.mesh_partition.as_ref();
        let is_plausible = kernel::advance_mats(scheme, targets, modules, partition, self.team);
        let mut are_bodies_bounded = true;
        for running_body in &*bodies {
            running_body.set_ports(modules);
            are_bodies_bounded &= running_body.is_bounded();
        }
        kernel::proxies::move_to_masses(scheme, modules);
        let finer_result = recompute_finer(scheme, self.state, self.team);
        let State {
            parameters,
            motion,
            monitors,
            ..
        } = &mut *self.state;
        if finer_result.is_some() || parameters.velocity_factor < 1.0 {
            monitors.energy_gains.iter_mut().for_each(|gains| gains.restart());
            let fine_links = motion.fine_links.iter_mut();
            fine_links.for_each(|fine_links| fine_links.stepped_points_mut().restart());
        }
        kernel::slide_bristles(scheme, &mut motion.modules);
        kernel::stop_resting_masses(scheme, &mut motion.modules);
        if let Some(fine_links) = &motion.fine_links {
            fine_links.stop_held_masses(scheme, &mut motion.modules);
        }
        MoveResult {
            is_plausible: finer_result.unwrap_or(is_plausible) && are_bodies_bounded,
            is_finer: finer_result.is_some(),
        }
    }

    /// The ledger of the energy, if it is kept.
    pub(super) fn update_ledger(&mut self, moved: &MoveResult) {
        let State {
            parameters,
            motion,
            monitors,
            ..
        } = &mut *self.state;
        let Some(ledger) = &mut monitors.ledger else {
            return;
        };
        parameters.set_next_gates(&self.script.gates, self.n + 1);
        let guard = monitors.guard.as_ref().filter(|_| moved.is_finer);
        ledger.end_frame(
            self.scheme,
            [&parameters.gate_openings, &parameters.next_gate_openings],
            &motion.targets,
            &motion.modules,
            guard.map(|guard| guard.force_travel()),
        );
    }

    /// Sums the deviations that layers add to each key at this frame.
    fn sum_layers(&mut self) {
        let sources = &mut self.state.sources;
        sources.layer_deviations.fill(0.0);
        for (voice, voice_script) in sources.voices.iter().zip(&self.script.voices) {
            if voice_script.is_layer {
                sources.layer_deviations[voice_script.key_index] += voice.deviation(voice_script);
            }
        }
    }

    /// Run one phase of the frame for every voice.
    fn for_each_voice(&mut self, phase_of_voice: fn(&mut Voice, &VoiceScript, &mut VoiceScene<'_>, u64)) {
        let State { motion, sources, .. } = &mut *self.state;
        let mut voice_scene = VoiceScene {
            scheme: self.scheme,
            gestures: &self.script.gestures,
            modules: &mut motion.modules,
            targets: &mut motion.targets,
            reports: &mut sources.reports,
            ergon_stream: &mut sources.ergon_stream,
            bodies: &mut motion.bodies,
            layer_deviations: &sources.layer_deviations,
        };
        for (voice, voice_script) in sources.voices.iter_mut().zip(&self.script.voices) {
            if voice.is_awake(voice_script, voice_scene.gestures, self.n) {
                phase_of_voice(voice, voice_script, &mut voice_scene, self.n);
            }
        }
    }
}

/// Computes the frame again in smaller steps if links have stiffened too much, and returns whether all positions stayed
/// plausible; `None` if the frame was not computed again.
fn recompute_finer(scheme: &Scheme, state: &mut State, team: &mut ThreadTeam<'_>) -> Option<bool> {
    let State {
        parameters,
        motion,
        monitors,
        ..
    } = state;
    let (guard, modules) = (monitors.guard.as_mut()?, &mut motion.modules);
    if !guard.needs_finer(&modules.x, &modules.d, &scheme.w) {
        return None;
    }
    let previous = modules.previous_state.as_mut()?;
    previous.swap(&mut modules.x, &mut modules.d);
    let imposed_mats = motion.targets.iter().map(|target| target.mat);
    let (x, previous) = (&modules.x, &previous.x);
    guard.set_imposed_paths(imposed_mats, |mat| (x[mat], previous[mat]));
    let is_plausible = guard.compute_finer(&mut guard::KernelSystem {
        scheme,
        gates: &parameters.gate_openings,
        modules,
        scratch: &mut motion.scratch,
        team,
    });
    if let Some(state_before) = &modules.previous_state {
        guard.restore_unrelated(state_before, &mut modules.x, &mut modules.d);
    }
    motion.set_ports();
    kernel::proxies::move_to_masses(scheme, &mut motion.modules);
    Some(is_plausible)
}
