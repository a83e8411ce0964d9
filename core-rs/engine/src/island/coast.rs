//! Coasting: steps in which no contact closes. Masses fly or swing freely, bodies move by their modes, and nothing else
//! is computed. After the blow of a hammer this is the case for seconds.
//!
//! The result is the same to the last bit as that of ordinary steps; only the test whether a finely computed contact may
//! close has a slightly wider margin.

use super::energy_account;
use super::fault::Fault;
use super::fine::HAIR;
use super::step::StepOutputs;
use super::{Island, energy_rise, inside};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::But;
use crate::scheme::{Kind, Run, Scheme};
use crate::state::Body;
use crate::timeline::{Drive, Source};

/// Fewer steps are not worth coasting.
const STEPS_MIN: usize = 2;
/// Steps for which one bound on the swing of masses is valid: rounding adds less than about [`SLACK`] to it.
const BOUND_STEPS: usize = 1024;
/// Steps until the next attempt at such a bound.
const RETRY_STEPS: usize = 32;
/// Share by which bounds on the swing are enlarged for rounding.
const SLACK: f64 = 1e-6;

impl Island {
    /// Whether it may coast: its masses are joined by contacts alone, its bodies are computed by modes, and it has no real
    /// hand, no drive but strikes, and no layer, gate, glide, ledger or muted part.
    pub(super) fn may_coast(&self) -> bool {
        let (script, state) = (&self.script, &self.state);
        let scheme = &script.scheme;
        let is_bare = scheme.runs.iter().all(|run| contact(run).is_some())
            && scheme.fused.is_empty()
            && scheme.exact.is_empty()
            && scheme.proxies.is_empty()
            && scheme.weight.iter().all(|&weight| weight == 0.0);
        let is_struck = |drive: &Drive| matches!(drive.source, Source::Strikes { .. });
        let is_left = script.hand_bindings.is_empty()
            && script.drives.iter().all(is_struck)
            && !script.voices.iter().any(|own| own.layer);
        let is_plain =
            script.gates.is_empty() && state.values.scheme.is_none() && state.values.damped >= 1.0;
        let watch = &state.watch;
        let is_whole =
            watch.ledger.is_none() && watch.guard.is_none() && watch.mutes.list().next().is_none();
        let by_modes = |body: &inside::RunningBody| body.modal().is_some();
        let has_contacts = !scheme.runs.is_empty() || state.matter.fine.is_some();
        (is_bare && is_left && is_plain && is_whole)
            && state.matter.bodies.iter().all(by_modes)
            && has_contacts
    }

    /// Coast while no contact closes, from one step of a block to another at most; returns the number of steps.
    pub(super) fn coast(
        &mut self,
        outputs: &mut StepOutputs<'_>,
        from: usize,
        to: usize,
    ) -> Result<usize, Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let (scheme, n) = (&script.scheme, state.frame);
        let mut fine = state.matter.fine.as_mut();
        if fine.as_ref().is_some_and(|fine| !fine.is_done())
            || !are_open(scheme, &state.matter.body)
        {
            return Ok(0);
        }
        let gains = state.watch.gains.as_ref();
        if gains.is_some_and(|gains| !gains.is_idle()) {
            return Ok(0);
        }
        let push = script.pushes.get(state.hands.pushed).map(|push| push.frame);
        let ergon = script.ergons.get(state.hands.ergons);
        let ergon = ergon.map(|(frame, _)| *frame);
        let voices = state.hands.voices.iter().zip(&script.voices);
        let voices =
            voices.map(|(voice, own)| voice.idle_until(own, &script.gestures).unwrap_or(n));
        let events = push.into_iter().chain(ergon).chain(voices);
        let events = events.chain(state.hands.is_struck().then_some(n));
        let quiet = events.map(|frame_now| frame_now.saturating_sub(n) as usize);
        let modals = state
            .matter
            .bodies
            .iter()
            .filter_map(inside::RunningBody::modal);
        let ahead = modals.map(super::modal::RunningModal::ahead);
        let rise = state.watch.rise.as_ref();
        let looks = [
            rise.map(|_| energy_rise::Rise::steps_left(n)),
            gains.map(|_| n.next_multiple_of(energy_account::BLOCK) - n),
        ];
        let looks = looks.into_iter().flatten().map(|steps| steps as usize);
        let steps = quiet.chain(ahead).chain(looks);
        let steps = steps.fold(to - from, usize::min);
        if steps < STEPS_MIN {
            return Ok(0);
        }
        // The motion without forces is needed here: forces of the step before are cleared.
        state.matter.body.force.fill(0.0);
        let has_bodies = !state.matter.bodies.is_empty();
        let (mut done, mut sound, mut open_until, mut next_look) = (0, true, 0, 0);
        while done < steps && sound {
            let body = &mut state.matter.body;
            if done >= open_until {
                let stays_open = fine
                    .as_ref()
                    .is_none_or(|fine| fine.stays_open(scheme, body));
                if !stays_open || !are_open(scheme, body) {
                    break;
                }
                if done >= next_look && !has_bodies {
                    let swing = |mat| swing(scheme, body, mat);
                    let fine = fine.as_ref();
                    if cannot_close(scheme, swing)
                        && fine.is_none_or(|fine| fine.cannot_close(scheme, swing, SLACK))
                    {
                        open_until = done + BOUND_STEPS;
                    }
                    next_look = done + RETRY_STEPS;
                }
            }
            if done == 0 {
                fine.iter_mut().for_each(|fine| fine.rest(body));
                for run in &scheme.runs {
                    // With the sign of zero that an open contact's force has.
                    body.link[run.links()].fill(0.0 * contact(run).map_or(0.0, But::sign));
                }
            }
            let step = n + done as u64;
            if let Some(out) = outputs.row(from + done) {
                kernel::tap(scheme, body, out);
                let bodies = state.matter.bodies.iter();
                for modal in bodies.filter_map(inside::RunningBody::modal) {
                    modal.tap_ahead(done, out);
                }
                state.watch.mutes.fade(step, scheme, out);
            }
            for (voice, own) in state.hands.voices.iter_mut().zip(&script.voices) {
                voice.step_idle(own, &mut state.hands.reports, step);
            }
            sound = kernel::advance(scheme, &mut [], body, None, &mut ThreadTeam::alone());
            done += 1;
            let bodies = state.matter.bodies.iter();
            for modal in bodies.filter_map(inside::RunningBody::modal) {
                modal.place_ahead(done, body);
            }
        }
        let modals = state.matter.bodies.iter_mut();
        for modal in modals.filter_map(inside::RunningBody::modal_mut) {
            modal.coast(done);
        }
        state.frame += done as u64;
        if !sound {
            self.fault()?;
        }
        Ok(done)
    }
}

/// The contact that the links of a run are, if they are contacts.
fn contact(run: &Run) -> Option<&But> {
    match &run.kind {
        Kind::But(but) => Some(but),
        _ => None,
    }
}

/// Whether no contact that is computed once a step pushes in this step.
fn are_open(scheme: &Scheme, body: &Body) -> bool {
    scheme.runs.iter().all(|run| {
        let side = contact(run).map_or(0.0, But::sign);
        let is_closed = |i: usize| side * (body.x[run.b + i] - body.x[run.a + i] - run.rest) > 0.0;
        !(0..run.len).any(is_closed)
    })
}

/// Whether no contact that is computed once a step closes for as long as its points move freely; `swing` bounds the
/// distance of each from its rest position, and its step [m].
fn cannot_close(scheme: &Scheme, swing: impl Fn(usize) -> [f64; 2]) -> bool {
    scheme.runs.iter().all(|run| {
        let side = contact(run).map_or(0.0, But::sign);
        (0..run.len).all(|i| {
            let (a, b) = (run.a + i, run.b + i);
            let middle = scheme.rest[b] - scheme.rest[a] - run.rest;
            side * middle + (swing(a)[0] + swing(b)[0]) * (1.0 + SLACK) < -HAIR
        })
    })
}

/// Bounds on the free motion of a MAT [m]: its distance from its rest position, and its step. Infinite if its poles
/// give no bound.
fn swing(scheme: &Scheme, body: &Body, mat: usize) -> [f64; 2] {
    let (kappa, b) = (scheme.kappa[mat], 1.0 - scheme.zeta[mat]);
    let x = body.x[mat] - scheme.rest[mat];
    let before = x - body.d[mat];
    let inner = body.inner.get(mat).copied().unwrap_or(0.0);
    if body.d[mat] == 0.0 && kappa * x == 0.0 && inner == 0.0 {
        return [x.abs(), 0.0];
    }
    if inner != 0.0 || b <= 0.0 || b > 1.0 || kappa < 0.0 {
        return [f64::INFINITY; 2];
    }
    // x[n+1] = 2h·x[n] − b·x[n−1]: poles h ± √(h² − b).
    let h = 0.5 * (1.0 + b - kappa);
    let room = b - h * h;
    if room > 0.0 {
        // Poles of magnitude √b: `past` is the position a step before, less the decay of one step. Each pole is √κ away
        // from 1.
        let past = before * b.sqrt();
        let square = (x * x + past * past - 2.0 * x * before * h) * b / room;
        let amplitude = square.max(0.0).sqrt();
        return [amplitude, amplitude * kappa.sqrt()];
    }
    let root = (-room).sqrt();
    let [fast, slow] = [h - root, h + root];
    if fast < 0.0 || slow > 1.0 || root == 0.0 {
        return [f64::INFINITY; 2];
    }
    // x[n] = u·slowⁿ + v·fastⁿ.
    let u = slow * (x - before * fast) / (2.0 * root);
    let v = x - u;
    [
        u.abs() + v.abs(),
        u.abs() * (1.0 - slow) + v.abs() * (1.0 - fast),
    ]
}
