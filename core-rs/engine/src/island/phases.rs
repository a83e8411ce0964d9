//! The phases of a step (`step` says what each reads and writes).

use super::strikes::strike;
use super::{Matter, Script, State, delayed_ports, glide, live_strikes, real_hands, sounds_in};
use crate::guard;
use crate::island::written_hand::voice::{Scene, Voice, VoiceScript};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::Scheme;

/// Sets the inputs of this frame: gliding parameters, open gates, positions of real hands.
pub(super) fn set_values(script: &Script, state: &mut State, mut scheme: Option<&mut Scheme>, n: u64) {
    let State {
        values,
        matter,
        hands,
        watch,
        ..
    } = state;
    if let Some(scheme) = scheme.as_deref_mut() {
        glide::apply_glides(&script.glides, &script.scheme, scheme, n);
        glide::apply_leads(&script.led, &script.scheme, scheme, &mut matter.fine, n);
        if let Some(fine_state) = &mut matter.fine {
            glide::pass_to_fine(&script.glides, &script.scheme, fine_state, n);
        }
    }
    values.open(&script.gates, n);
    if values.damped < 1.0 {
        matter.body.d.iter_mut().for_each(|d| *d *= values.damped);
        if let Some(guard) = &mut watch.guard {
            guard.scale_velocities(values.damped);
        }
        matter.place(); // bodies are damped by themselves
    }
    let hand_states = &mut hands.hand_states;
    real_hands::move_hands(&script.hand_bindings, hand_states, n, &mut matter.body);
    delayed_ports::follow(&script.port_bindings, &mut matter.body);
    if let Some(scheme) = scheme {
        glide::apply_following_masses(&script.scheme, scheme, &matter.body.x);
    }
}

/// A frame while it is computed.
pub(super) struct Frame<'a, 'team> {
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
pub(super) struct Moved {
    /// Whether all of them are plausible.
    pub(super) is_plausible: bool,
    /// Whether the frame was computed again in finer steps.
    is_finer: bool,
}

impl Frame<'_, '_> {
    /// Computes the forces of links, drives, sounds and live strokes, and divides the forces on proxies among their
    /// masses.
    pub(super) fn apply_links(&mut self) -> LinksApplied {
        let (n, script, scheme) = (self.n, self.script, self.scheme);
        let State {
            values,
            matter,
            hands,
            watch,
            ..
        } = &mut *self.state;
        let Matter {
            body,
            laws,
            fine,
            targets,
            ..
        } = matter;
        kernel::compute_link_forces(scheme, &values.gates, body, laws, self.team);
        targets.clear();
        for drive in &script.drives {
            drive.apply(n, scheme.rate, body, targets);
        }
        delayed_ports::push_keys(&script.port_bindings, &hands.port_states, body);
        sounds_in::apply(&script.sound_drives, &hands.played, n, body, targets);
        if let Some(energy_rise) = &mut watch.energy_rise
            && hands.is_struck()
        {
            energy_rise.restart();
        }
        live_strikes::apply(&script.strike_points, &mut hands.pending, scheme, body);
        kernel::proxies::record_positions(scheme, body);
        kernel::proxies::distribute_forces(scheme, body);
        if let Some(fine) = fine {
            fine.record_steady_forces(scheme, body);
            fine.apply_carried_forces(body);
        }
        LinksApplied(())
    }

    /// Applies the strikes of written hands, pushes and ergons, also to the bodies.
    pub(super) fn strike(&mut self, _: LinksApplied) -> StrikesApplied {
        self.sum_layers();
        self.for_each_voice(Voice::step);
        strike(self.script, self.scheme, self.state, self.n);
        let Matter { body, bodies, .. } = &mut self.state.matter;
        for running_body in bodies {
            running_body.strike(self.n, body);
        }
        StrikesApplied(())
    }

    /// Solves contacts and friction, which need all other forces. Then written hands compute their forces.
    pub(super) fn solve_contacts(&mut self, _: StrikesApplied) -> ForcesComplete {
        let scheme = self.scheme;
        let State { values, matter, .. } = &mut *self.state;
        let Matter {
            body,
            bodies,
            fine,
            targets,
            ..
        } = matter;
        kernel::solve_exact_contacts(scheme, &values.gates, targets, body);
        if let Some(fine) = fine {
            fine.step(scheme, &values.gates, targets, bodies, body);
            kernel::solve_friction(scheme, &values.gates, targets, body);
        }
        self.for_each_voice(Voice::settle);
        ForcesComplete(())
    }

    /// Writes the outputs of this frame, the forces on hands, and the counters.
    pub(super) fn observe(&mut self, _: &ForcesComplete, out: Option<&mut [f64]>) {
        let (n, script, scheme) = (self.n, self.script, self.scheme);
        let State {
            values,
            matter,
            hands,
            watch,
            ..
        } = &mut *self.state;
        let Matter {
            body, bodies, targets, ..
        } = matter;
        real_hands::add_hand_forces(&script.hand_bindings, &mut hands.hand_states, n, body);
        delayed_ports::record_forces(&script.port_bindings, &mut hands.port_states, body);
        delayed_ports::lead(&script.port_bindings, scheme, targets, body);
        watch.touches.step(n, &body.link);
        if let Some(out) = out {
            kernel::write_outputs(scheme, body, out);
            bodies.iter().for_each(|running_body| running_body.add_outputs(out));
            watch.mutes.fade(n, scheme, out);
        }
        if let Some(gains) = &mut watch.gains
            && !watch.guard.as_ref().is_some_and(|guard| guard.is_finer())
        {
            gains.step(scheme, &values.gates, targets, body);
        }
        if let Some(ledger) = &mut watch.ledger {
            ledger.before(scheme, targets, body);
        }
    }

    /// Masses and bodies move; the frame is computed again in finer steps if links have stiffened too much.
    pub(super) fn advance(&mut self, _: ForcesComplete) -> Moved {
        let scheme = self.scheme;
        let Matter {
            body,
            bodies,
            laws,
            targets,
            ..
        } = &mut self.state.matter;
        for running_body in &mut *bodies {
            running_body.step(self.n, &body.force, self.team);
        }
        let partition = laws.mesh_partition.as_ref();
        let is_plausible = kernel::advance_mats(scheme, targets, body, partition, self.team);
        let mut are_bodies_bounded = true;
        for running_body in &*bodies {
            running_body.set_ports(body);
            are_bodies_bounded &= running_body.is_bounded();
        }
        kernel::proxies::move_to_masses(scheme, body);
        let finer_plausible = recompute_finer(scheme, self.state, self.team);
        let State {
            values, matter, watch, ..
        } = &mut *self.state;
        if finer_plausible.is_some() || values.damped < 1.0 {
            watch.gains.iter_mut().for_each(|gains| gains.restart());
            let fine_state = matter.fine.iter_mut();
            fine_state.for_each(|fine_state| fine_state.stepped_points_mut().restart());
        }
        kernel::slide_bristles(scheme, &mut matter.body);
        kernel::stop_resting_masses(scheme, &mut matter.body);
        if let Some(fine_state) = &matter.fine {
            fine_state.rest_held(scheme, &mut matter.body);
        }
        Moved {
            is_plausible: finer_plausible.unwrap_or(is_plausible) && are_bodies_bounded,
            is_finer: finer_plausible.is_some(),
        }
    }

    /// The ledger of the energy, if it is kept.
    pub(super) fn account(&mut self, moved: &Moved) {
        let State {
            values, matter, watch, ..
        } = &mut *self.state;
        let Some(ledger) = &mut watch.ledger else {
            return;
        };
        values.open_next(&self.script.gates, self.n + 1);
        let guard = watch.guard.as_ref().filter(|_| moved.is_finer);
        ledger.after(
            self.scheme,
            [&values.gates, &values.gates_next],
            &matter.targets,
            &matter.body,
            guard.map(|guard| guard.force_travel()),
        );
    }

    /// Sums the deviations that layers add to each key at this frame.
    fn sum_layers(&mut self) {
        let hands = &mut self.state.hands;
        hands.layers.fill(0.0);
        for (voice, voice_script) in hands.voices.iter().zip(&self.script.voices) {
            if voice_script.is_layer {
                hands.layers[voice_script.key] += voice.deviation(voice_script);
            }
        }
    }

    /// Run one phase of the frame for every voice.
    fn for_each_voice(&mut self, phase: fn(&mut Voice, &VoiceScript, &mut Scene<'_>, u64)) {
        let State { matter, hands, .. } = &mut *self.state;
        let mut voice_scene = Scene {
            scheme: self.scheme,
            gestures: &self.script.gestures,
            body: &mut matter.body,
            targets: &mut matter.targets,
            reports: &mut hands.reports,
            stream: &mut hands.stream,
            bodies: &mut matter.bodies,
            layers: &hands.layers,
        };
        for (voice, voice_script) in hands.voices.iter_mut().zip(&self.script.voices) {
            if voice.is_awake(voice_script, voice_scene.gestures, self.n) {
                phase(voice, voice_script, &mut voice_scene, self.n);
            }
        }
    }
}

/// Computes the frame again in smaller steps if links have stiffened too much, and returns whether all positions stayed
/// plausible; `None` if the frame was not computed again.
fn recompute_finer(scheme: &Scheme, state: &mut State, team: &mut ThreadTeam<'_>) -> Option<bool> {
    let State {
        values, matter, watch, ..
    } = state;
    let (guard, body) = (watch.guard.as_mut()?, &mut matter.body);
    if !guard.needs_finer(&body.x, &body.d, &scheme.w) {
        return None;
    }
    let previous = body.previous.as_mut()?;
    previous.swap(&mut body.x, &mut body.d);
    let imposed_mats = matter.targets.iter().map(|target| target.mat);
    let (x, previous) = (&body.x, &previous.x);
    guard.set_imposed_paths(imposed_mats, |mat| (x[mat], previous[mat]));
    let is_plausible = guard.compute_finer(&mut guard::KernelStage {
        scheme,
        gates: &values.gates,
        body,
        laws: &mut matter.laws,
        team,
    });
    if let Some(state_before) = &body.previous {
        guard.restore_unrelated(state_before, &mut body.x, &mut body.d);
    }
    matter.place();
    kernel::proxies::move_to_masses(scheme, &mut matter.body);
    Some(is_plausible)
}
