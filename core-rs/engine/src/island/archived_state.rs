//! The state of an island as bytes, for a render that continues from an earlier one.

use super::{Island, State};
use crate::archive::{Archive, Damaged, State as Archived, state_of};

impl Island {
    /// Whether its state can be written: ledgers and streams of ergons cannot.
    pub(crate) fn is_storable(&self) -> bool {
        self.state.monitors.ledger.is_none() && !self.state.sources.ergon_stream.is_recording()
    }

    /// The changing state, as bytes.
    pub(crate) fn write_state(&mut self) -> Vec<u8> {
        let mut state_bytes = Vec::new();
        // Writing into memory cannot fail.
        let mut archive = Archive::Write(&mut state_bytes);
        let _ = self.state.archive(&mut archive);
        let _ = self.sleep_monitor.archive(&mut archive);
        state_bytes
    }

    /// Continue from the state of an island of the same network and bodies, with the same events up to there.
    ///
    /// # Errors
    /// [`Damaged`] if the bytes do not fit such an island; this island is then unusable.
    pub(crate) fn read_state(&mut self, bytes: &[u8]) -> Result<(), Damaged> {
        let mut archive = Archive::Read(bytes);
        self.state.archive(&mut archive)?;
        self.sleep_monitor.archive(&mut archive)?;
        self.refresh_next_event();
        self.resume_computing();
        if archive.is_empty() { Ok(()) } else { Err(Damaged) }
    }

    /// Find the next event again: events from here on may differ from those of the writer.
    fn refresh_next_event(&mut self) {
        let next_step = self.state.frame;
        let event_step = self.next_event_step(next_step);
        if let Some(energy_rise) = &mut self.state.monitors.energy_rise {
            energy_rise.set_next_event(next_step, event_step);
        }
    }
}

/// The state of a render: ledger, stream of ergons and continuations from another version are left out.
impl Archived for State {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        // Later gestures may differ from those of the writer, so only reports up to the last gesture that has begun are
        // archived.
        let has_begun = |report: &crate::gesture::report::GestureReport| !report.start.is_nan();
        let mut n_reports = self
            .sources
            .reports
            .iter()
            .rposition(has_begun)
            .map_or(0, |last_begun| last_begun + 1);
        n_reports.archive(archive)?;
        let reports = self.sources.reports.get_mut(..n_reports).ok_or(Damaged)?;
        reports.archive(archive)?;
        let Self {
            parameters,
            motion,
            sources,
            monitors,
            ..
        } = self;
        state_of!(motion, archive, modules, bodies, fine_links)?;
        state_of!(
            sources,
            archive,
            voices,
            next_strike,
            next_ergon,
            layer_deviations,
            hand_states,
            delayed_forces,
            pending_strikes
        )?;
        state_of!(parameters, archive, gate_openings, velocity_factor)?;
        state_of!(monitors, archive, muted_parts, guard, energy_gains, energy_rise)?;
        state_of!(self, archive, frame)
    }
}
