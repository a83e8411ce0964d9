//! Steps in which nothing meets: masses fly or swing by themselves, bodies sound by their modes, and nothing else is
//! looked at. After the stroke of a hammer that is all there is for seconds.
//!
//! Every bit is that of steps done one by one; a contact is only asked a hair more carefully whether it may close.

use super::fault::Fault;
use super::step::StepOutputs;
use super::{Island, inside};
use crate::kernel;
use crate::kernel::thread_team::ThreadTeam;

/// Fewer steps are not worth the look.
const LEAST: usize = 2;

impl Island {
    /// Whether it may coast: its masses are joined by contacts alone, its bodies go by modes, and nobody plays or watches.
    pub(super) fn may_coast(&self) -> bool {
        let (script, state) = (&self.script, &self.state);
        let scheme = &script.scheme;
        let is_bare = scheme.runs.is_empty() && scheme.fused.is_empty() && scheme.exact.is_empty();
        let is_left =
            script.voices.is_empty() && script.hand_bindings.is_empty() && script.drives.is_empty();
        let is_plain = script.gates.is_empty() && state.scheme.is_none() && state.damped >= 1.0;
        let is_whole = state.ledger.is_none() && state.mutes.list().next().is_none();
        let by_modes = |body: &inside::RunningBody| body.modal().is_some();
        let fine = state.fine.as_ref();
        (is_bare && is_left && is_plain && is_whole)
            && state.bodies.iter().all(by_modes)
            && fine.is_some()
    }

    /// Coast for as long as nothing meets, from one step of a block to another at most; how many steps that was.
    pub(super) fn coast(
        &mut self,
        heard: &mut StepOutputs<'_>,
        from: usize,
        to: usize,
    ) -> Result<usize, Fault> {
        let (script, state) = (&*self.script, &mut self.state);
        let (scheme, n) = (&script.scheme, state.frame);
        let Some(fine) = state.fine.as_mut().filter(|fine| fine.is_done()) else {
            return Ok(0);
        };
        let push = script.pushes.get(state.pushed).map(|push| push.frame);
        let ergon = script.ergons.get(state.ergons);
        let ergon = ergon.map(|(frame, _)| *frame);
        let events = push.into_iter().chain(ergon);
        let quiet = events.map(|at| at.saturating_sub(n) as usize);
        let modals = state.bodies.iter().filter_map(inside::RunningBody::modal);
        let ahead = modals.map(super::modal::RunningModal::ahead);
        let most = quiet.chain(ahead).fold(to - from, usize::min);
        if most < LEAST {
            return Ok(0);
        }
        // Where its points go by themselves is asked, not by what pushed them in the step before.
        state.body.force.fill(0.0);
        let (mut done, mut sound) = (0, true);
        while done < most && sound && fine.stays_open(scheme, &state.body) {
            if done == 0 {
                fine.rest(&mut state.body);
            }
            let out = heard.at(from + done);
            kernel::tap(scheme, &state.body, out);
            for modal in state.bodies.iter().filter_map(inside::RunningBody::modal) {
                modal.tap_ahead(done, out);
            }
            state.mutes.fade(n + done as u64, scheme, out);
            sound = kernel::advance(
                scheme,
                &mut [],
                &mut state.body,
                None,
                &mut ThreadTeam::alone(),
            );
            done += 1;
            for modal in state.bodies.iter().filter_map(inside::RunningBody::modal) {
                modal.place_ahead(done, &mut state.body);
            }
        }
        let modals = state.bodies.iter_mut();
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
