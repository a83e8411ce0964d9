//! One step of an island: forces, outputs, hands, contacts, masses, ledger.
//!
//! A step does not allocate (but for a recorded stream of ergons), lock or panic.

use super::{
    Fault, Island, Record, Script, State, energy_account, glide, live_strikes, real_hands,
    sounds_in,
};
use crate::guard;
use crate::interrupt;
use crate::island::written_hand::voice::{Scene, Voice, VoiceScript};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::Scheme;
use crate::timeline::GateContinuation;

/// Most steps between two polls for an interrupt, and most modules that these steps compute.
const LOOK: usize = 16;
const LOOK_MODULES: usize = 1 << 17;

/// Output buffer of the steps of a frame; only the first step of a frame is heard.
pub(super) struct StepOutputs<'a> {
    /// (n_frames · n_out)
    out: &'a mut [f64],
    /// (n_out)
    unheard: &'a mut [f64],
    oversampling: usize,
}

impl StepOutputs<'_> {
    /// The output row of a step, counted from the first step of the first frame.
    pub(super) fn at(&mut self, step: usize) -> &mut [f64] {
        let n_out = self.unheard.len();
        if step.is_multiple_of(self.oversampling) {
            &mut self.out[step / self.oversampling * n_out..][..n_out]
        } else {
            self.unheard
        }
    }
}

impl Island {
    /// Compute `n_frames` frames, as [`Island::process`] plays them.
    pub(crate) fn compute(
        &mut self,
        out: &mut [f64],
        n_frames: usize,
        team: &mut ThreadTeam<'_>,
    ) -> Result<(), Fault> {
        let mut unheard = std::mem::take(&mut self.state.unheard);
        let mut heard = StepOutputs {
            out,
            unheard: &mut unheard,
            oversampling: self.oversampling as usize,
        };
        let end = self.compute_steps(&mut heard, n_frames, team);
        self.state.unheard = unheard;
        end
    }

    /// Computes all steps of `n_frames` frames.
    fn compute_steps(
        &mut self,
        heard: &mut StepOutputs<'_>,
        n_frames: usize,
        team: &mut ThreadTeam<'_>,
    ) -> Result<(), Fault> {
        let (steps, may_coast) = (n_frames * heard.oversampling, self.may_coast());
        let (mut done, mut looks) = (0, 0_usize);
        let modules = self.script.scheme.n_mat() + self.script.scheme.n_lia;
        let look = (LOOK_MODULES / modules.max(1)).clamp(1, LOOK);
        while done < steps {
            if looks.is_multiple_of(look) {
                interrupt::poll();
            }
            looks += 1;
            if may_coast {
                done += self.coast(heard, done, steps)?;
            }
            if done < steps {
                self.step(heard.at(done), team)?;
                done += 1;
            }
        }
        Ok(())
    }

    /// One step: forces, outputs, hands, contacts, masses.
    fn step(&mut self, out: &mut [f64], team: &mut ThreadTeam<'_>) -> Result<(), Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let n = state.frame;
        let mut gliding = state.scheme.take();
        if let Some(scheme) = &mut gliding {
            glide::apply_glides(&script.glides, &script.scheme, scheme, n);
            glide::apply_leads(&script.led, &script.scheme, scheme, &mut state.fine, n);
            if let Some(fine) = &mut state.fine {
                glide::pass_to_fine(&script.glides, &script.scheme, fine, n);
            }
        }
        for ((open, gate), continuation) in state
            .gates
            .iter_mut()
            .zip(&script.gates)
            .zip(&state.gate_continuations)
        {
            *open = GateContinuation::open(continuation.as_ref(), gate, n);
        }
        if state.damped < 1.0 {
            state.body.d.iter_mut().for_each(|d| *d *= state.damped);
            if let Some(guard) = &mut state.guard {
                guard.slow_down(state.damped);
            }
            for body in &state.bodies {
                body.place(&mut state.body); // bodies are damped by themselves
            }
        }
        real_hands::arrive(
            &script.hand_bindings,
            &mut state.hand_states,
            n,
            &mut state.body,
        );
        if let Some(scheme) = &mut gliding {
            glide::apply_following_masses(&script.scheme, scheme, &state.body.x);
        }
        let scheme = gliding.as_deref().unwrap_or(&script.scheme);
        kernel::links(scheme, &state.gates, &mut state.body, &mut state.laws, team);
        state.targets.clear();
        for drive in &script.drives {
            drive.apply(n, scheme.rate, &mut state.body, &mut state.targets);
        }
        sounds_in::apply(
            &script.sound_drives,
            &state.played,
            n,
            &mut state.body,
            &mut state.targets,
        );
        if let Some(rise) = &mut state.rise
            && state.impulses.iter().any(|&impulse| impulse != 0.0)
        {
            rise.restart();
        }
        live_strikes::apply(
            &script.strike_points,
            &mut state.impulses,
            scheme,
            &mut state.body,
        );
        kernel::proxies::note(scheme, &mut state.body);
        kernel::proxies::divide(scheme, &mut state.body);
        if let Some(fine) = &mut state.fine {
            fine.lean(scheme, &state.body);
            fine.carry(&mut state.body);
        }
        layers(script, state);
        voices(script, scheme, state, n, Voice::step);
        strike(script, scheme, state, n);
        for body in &mut state.bodies {
            body.strike(n, &mut state.body);
        }
        kernel::contacts(scheme, &state.gates, &state.targets, &mut state.body);
        if let Some(fine) = &mut state.fine {
            let State {
                gates,
                targets,
                bodies,
                body,
                ..
            } = state;
            fine.step(scheme, gates, targets, bodies, body);
            kernel::friction(scheme, gates, targets, body);
        }
        voices(script, scheme, state, n, Voice::settle);
        real_hands::feel(
            &script.hand_bindings,
            &mut state.hand_states,
            n,
            &state.body,
        );
        state.touches.step(n, &state.body.link);
        kernel::tap(scheme, &state.body, out);
        state.bodies.iter().for_each(|body| body.tap(out));
        state.mutes.fade(n, scheme, out);
        if let Some(gains) = &mut state.gains
            && !state.guard.as_ref().is_some_and(|guard| guard.is_finer())
        {
            gains.step(scheme, &state.gates, &state.targets, &state.body);
        }
        if let Some(ledger) = &mut state.ledger {
            ledger.before(scheme, &state.targets, &state.body);
        }
        for body in &mut state.bodies {
            body.step(n, &state.body.force, team);
        }
        let mut sound = kernel::advance(
            scheme,
            &mut state.targets,
            &mut state.body,
            state.laws.mesh_partition.as_ref(),
            team,
        );
        let mut bodies_sound = true;
        for body in &state.bodies {
            body.place(&mut state.body);
            bodies_sound &= body.sound();
        }
        kernel::proxies::gather(scheme, &mut state.body);
        let finer = recompute_finer(scheme, state, team);
        sound = finer.unwrap_or(sound);
        if finer.is_some() || state.damped < 1.0 {
            state.gains.iter_mut().for_each(|gains| gains.restart());
            let fine = state.fine.iter_mut();
            fine.for_each(|fine| fine.sprung_mut().restart());
        }
        kernel::bend(scheme, &mut state.body);
        kernel::rest(scheme, &mut state.body);
        if let Some(fine) = &state.fine {
            fine.rest_held(scheme, &mut state.body);
        }
        if let Some(ledger) = &mut state.ledger {
            let gates = script.gates.iter().zip(&state.gate_continuations);
            for (next, (gate, continuation)) in state.gates_next.iter_mut().zip(gates) {
                *next = GateContinuation::open(continuation.as_ref(), gate, n + 1);
            }
            ledger.after(
                scheme,
                [&state.gates, &state.gates_next],
                &state.targets,
                &state.body,
                finer.and(state.guard.as_ref()).map(|guard| guard.travel()),
            );
        }
        state.scheme = gliding;
        state.frame += 1;
        if sound && bodies_sound {
            if n.is_multiple_of(energy_account::BLOCK) {
                return self.check_gains();
            }
            Ok(())
        } else {
            self.fault()
        }
    }
}

/// Computes the frame again in smaller steps if links have stiffened too much, and returns whether all positions stayed
/// plausible; `None` if the frame stands as it is.
fn recompute_finer(scheme: &Scheme, state: &mut State, team: &mut ThreadTeam<'_>) -> Option<bool> {
    let (guard, body) = (state.guard.as_mut()?, &mut state.body);
    if !guard.needs_finer(&body.x, &body.d, &scheme.w) {
        return None;
    }
    let then = body.previous.as_mut()?;
    then.swap(&mut body.x, &mut body.d);
    let led = state.targets.iter().map(|target| target.mat);
    let (x, then) = (&body.x, &then.x);
    guard.impose(led, |mat| (x[mat], then[mat]));
    let sound = guard.compute_finer(&mut guard::KernelStage {
        scheme,
        gates: &state.gates,
        body,
        laws: &mut state.laws,
        team,
    });
    if let Some(whole) = &state.body.previous {
        guard.keep_unrelated(whole, &mut state.body.x, &mut state.body.d);
    }
    for body in &state.bodies {
        body.place(&mut state.body);
    }
    kernel::proxies::gather(scheme, &mut state.body);
    Some(sound)
}

/// Sums the deviations that layers add to each key at this frame.
fn layers(script: &Script, state: &mut State) {
    state.layers.fill(0.0);
    for (voice, own) in state.voices.iter().zip(&script.voices) {
        if own.layer {
            state.layers[own.key] += voice.deviation(own);
        }
    }
}

/// Let every voice do its part of frame `n`.
fn voices(
    script: &Script,
    scheme: &Scheme,
    state: &mut State,
    n: u64,
    act: fn(&mut Voice, &VoiceScript, &mut Scene<'_>, u64),
) {
    let mut scene = Scene {
        scheme,
        gestures: &script.gestures,
        body: &mut state.body,
        targets: &mut state.targets,
        reports: &mut state.reports,
        stream: &mut state.stream,
        bodies: &mut state.bodies,
        layers: &state.layers,
    };
    for (voice, own) in state.voices.iter_mut().zip(&script.voices) {
        if voice.is_awake(own, scene.gestures, n) {
            act(voice, own, &mut scene, n);
        }
    }
}

/// Applies the pushes and ergons that fall on frame `n`.
fn strike(script: &Script, scheme: &Scheme, state: &mut State, n: u64) {
    let t = 1.0 / scheme.rate;
    let (body, bodies) = (&mut state.body, &mut state.bodies);
    while let Some(push) = script
        .pushes
        .get(state.pushed)
        .filter(|push| push.frame <= n)
    {
        state.pushed += 1;
        let mat = push.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue; // the part was muted
        }
        if push.impulse != 0.0 && state.stream.is_kept() {
            let velocity = kernel::centred(scheme, body, mat);
            let mass = t * t / scheme.w[mat];
            state.stream.push(
                n,
                Record::event(push.at, mat, push.source, mass, velocity, push.impulse),
            );
        }
        body.push(mat, push.force);
        bodies
            .iter_mut()
            .for_each(|body| body.struck(mat, push.force));
    }
    while let Some((_, ergon)) = script
        .ergons
        .get(state.ergons)
        .filter(|(frame, _)| *frame <= n)
    {
        state.ergons += 1;
        let mat = ergon.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue;
        }
        // p = 2 m m_S/(m + m_S)·(v − V), where V is the centred velocity without the ergon: with this impulse the work
        // on the struck MAT is exactly the energy that the ergon loses.
        let mass = t * t / scheme.w[mat];
        let velocity = kernel::centred(scheme, body, mat);
        let impulse = 2.0 * ergon.mass * mass / (ergon.mass + mass) * (ergon.speed - velocity);
        let force = impulse * scheme.rate;
        body.push(mat, force);
        bodies.iter_mut().for_each(|body| body.struck(mat, force));
        let (mass, speed, source) = (ergon.mass, ergon.speed, ergon.source);
        state.stream.push(
            n,
            Record {
                time: n as f64 / scheme.rate,
                mat: ergon.mat,
                source,
                mass,
                speed,
                impulse,
            },
        );
    }
}
