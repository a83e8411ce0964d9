//! Coasting: steps in which no contact closes. Masses fly or swing freely, bodies move by their modes, and nothing else
//! is computed. After the blow of a hammer this is the case for seconds.
//!
//! The result is the same to the last bit as that of ordinary steps; only the test whether a contact may close has a
//! slightly wider margin.

use super::fault::Fault;
use super::step::StepOutputs;
use super::{Island, energy_rise, inside};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;
use crate::scheme::Scheme;
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
    /// Whether it may coast: its masses are joined by finely computed contacts alone, its bodies are computed by modes,
    /// and it has no real hand, no drive but strikes, and no layer, gate, glide, ledger or muted part.
    pub(super) fn may_coast(&self) -> bool {
        let (script, state) = (&self.script, &self.state);
        let scheme = &script.scheme;
        let is_bare = scheme.runs.is_empty() && scheme.fused.is_empty() && scheme.exact.is_empty();
        let is_bare = is_bare && scheme.weight.iter().all(|&weight| weight == 0.0);
        let is_struck = |drive: &Drive| matches!(drive.source, Source::Strikes(_));
        let is_left = script.hand_bindings.is_empty()
            && script.drives.iter().all(is_struck)
            && !script.voices.iter().any(|own| own.layer);
        let is_plain =
            script.gates.is_empty() && state.values.scheme.is_none() && state.values.damped >= 1.0;
        let is_whole = state.watch.ledger.is_none() && state.watch.mutes.list().next().is_none();
        let by_modes = |body: &inside::RunningBody| body.modal().is_some();
        let fine = state.matter.fine.as_ref();
        (is_bare && is_left && is_plain && is_whole)
            && state.matter.bodies.iter().all(by_modes)
            && fine.is_some()
    }

    /// Coast while no contact closes, from one step of a block to another at most; returns the number of steps.
    pub(super) fn coast(
        &mut self,
        heard: &mut StepOutputs<'_>,
        from: usize,
        to: usize,
    ) -> Result<usize, Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let (scheme, n) = (&script.scheme, state.frame);
        let Some(fine) = state.matter.fine.as_mut().filter(|fine| fine.is_done()) else {
            return Ok(0);
        };
        let push = script.pushes.get(state.hands.pushed).map(|push| push.frame);
        let ergon = script.ergons.get(state.hands.ergons);
        let ergon = ergon.map(|(frame, _)| *frame);
        let voices = state.hands.voices.iter().zip(&script.voices);
        let voices =
            voices.map(|(voice, own)| voice.idle_until(own, &script.gestures).unwrap_or(n));
        let pending = state.hands.impulses.iter().any(|&impulse| impulse != 0.0);
        let events = push.into_iter().chain(ergon).chain(voices);
        let events = events.chain(pending.then_some(n));
        let quiet = events.map(|at| at.saturating_sub(n) as usize);
        let modals = state
            .matter
            .bodies
            .iter()
            .filter_map(inside::RunningBody::modal);
        let ahead = modals.map(super::modal::RunningModal::ahead);
        let watched = state.watch.rise.is_some();
        let look = watched.then(|| energy_rise::Rise::steps_left(n) as usize);
        let most = quiet.chain(ahead).chain(look);
        let most = most.fold(to - from, usize::min);
        if most < STEPS_MIN {
            return Ok(0);
        }
        // The motion without forces is needed here: forces of the step before are cleared.
        state.matter.body.force.fill(0.0);
        let (mut done, mut sound, mut open_until, mut next_look) = (0, true, 0, 0);
        while done < most && sound {
            if done >= open_until && !fine.stays_open(scheme, &state.matter.body) {
                break;
            }
            if done >= open_until.max(next_look) {
                let swing = |mat| swing(scheme, &state.matter.body, mat);
                if fine.cannot_close(scheme, swing, SLACK) {
                    open_until = done + BOUND_STEPS;
                }
                next_look = done + RETRY_STEPS;
            }
            if done == 0 {
                fine.rest(&mut state.matter.body);
            }
            let out = heard.at(from + done);
            kernel::tap(scheme, &state.matter.body, out);
            for modal in state
                .matter
                .bodies
                .iter()
                .filter_map(inside::RunningBody::modal)
            {
                modal.tap_ahead(done, out);
            }
            let at = n + done as u64;
            state.watch.mutes.fade(at, scheme, out);
            for (voice, own) in state.hands.voices.iter_mut().zip(&script.voices) {
                voice.step_idle(own, &mut state.hands.reports, at);
            }
            sound = kernel::advance(
                scheme,
                &mut [],
                &mut state.matter.body,
                None,
                &mut ThreadTeam::alone(),
            );
            done += 1;
            for modal in state
                .matter
                .bodies
                .iter()
                .filter_map(inside::RunningBody::modal)
            {
                modal.place_ahead(done, &mut state.matter.body);
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
        let most = square.max(0.0).sqrt();
        return [most, most * kappa.sqrt()];
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
