//! A timeline whose events end at a frame: for a piece that is silenced or stopped while it plays.

use super::pulse::PARTS_PER_SECOND;
use super::{GRID_FRAMES, Gate, Glide, Lead, Strike, Timeline};

/// Instants that differ by less are one [s]: rounding, not music.
const SAME_INSTANT_SECONDS: f64 = 1e-9;
/// The instant of events that never begin [s]: after 30 years, where frames are still counted exactly.
const NEVER_SECONDS: f64 = 1e9;

impl Timeline {
    /// The timeline without what begins at `frame` or later. It keeps the gestures with the given indices, which must
    /// be in rising order. If it `freezes_couplings`, couplings stay as they are at the frame.
    ///
    /// Strikes and ergons at the instant of the frame are left out, and so are strikes and glides that are over by
    /// then. Glides of typed values continue to their end. Keys, drives, inputs and automation stay: see
    /// [`Timeline::remove_glides`].
    ///
    /// ```
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let m = network.mas("m", 1e-3, 0.0, 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// timeline.strike(&network, m, 0.9999, 1e-3, None, 0)?;
    /// timeline.strike(&network, m, 1.0, 1e-3, None, 0)?;
    /// let cut = timeline.cut(44_100, &[], false); // at 1 s
    /// assert_eq!(cut.strikes_on(m), [(0.9999, 1e-3)]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn cut(&self, frame: u64, gestures: &[usize], freezes_couplings: bool) -> Self {
        let frame_rate = self.rate.hertz();
        let instant = frame as f64 / frame_rate;
        let is_before = |t: f64| t < instant - SAME_INSTANT_SECONDS;
        // A strike acts as long as it lasts, and a frame or a step of a part that is stepped less often.
        let earliest_acting_instant = |strike: &Strike| {
            let duration = f64::from(strike.n_parts) / PARTS_PER_SECOND;
            frame.saturating_sub(GRID_FRAMES) as f64 / frame_rate - duration
        };
        let gestures = gestures.iter().filter_map(|&index| self.gestures.get(index));
        let gates = self.gates.iter();
        let running_glides = self.glides.iter().filter(|glide| !glide.is_over(frame));
        let running_leads = self.leads.iter().filter(|lead| !lead.is_over(frame));
        let strikes = self.strikes.iter();
        // All ergons before the frame stay: without any, a body would be computed by its modes, which must be solved
        // first.
        let past_ergons = self.ergons.iter().filter(|ergon| is_before(ergon.instant));
        Self {
            rate: self.rate,
            keys: self.keys.clone(),
            gestures: gestures.cloned().collect(),
            strikes: strikes
                .filter(|strike| strike.instant >= earliest_acting_instant(strike) && is_before(strike.instant))
                .copied()
                .collect(),
            ergons: past_ergons.copied().collect(),
            gates: gates
                .filter_map(|gate| self.gate_after(gate, frame, freezes_couplings))
                .collect(),
            drives: self.drives.clone(),
            sounds_in: self.sounds_in.clone(),
            glides: running_glides.cloned().collect(),
            leads: running_leads.cloned().collect(),
            oversampling: self.oversampling,
            is_open: self.is_open,
            trial_strikes: self.trial_strikes.clone(),
            is_unguarded: self.is_unguarded,
        }
    }

    /// Remove the glides of the parameters of these MATs and links; rows of (first, number).
    pub fn remove_glides(&mut self, mats: &[(usize, usize)], links: &[(usize, usize)]) {
        let is_released = |row_ranges: &[(usize, usize)], index: usize| {
            let mut row_ranges = row_ranges.iter();
            row_ranges.any(|&(first, n)| (first..first.saturating_add(n)).contains(&index))
        };
        self.glides.retain(|glide| !is_released(mats, glide.mat));
        self.leads.retain(|lead| !is_released(links, lead.first_link));
    }

    /// A gate from `frame` on; `None` if it was a glide that is over. The gate of a coupling stays, because the plan
    /// depends on it.
    fn gate_after(&self, gate: &Gate, frame: u64, freezes_couplings: bool) -> Option<Gate> {
        let is_coupling = gate.has_schedule() || !gate.has_ramp();
        let mut gate = *gate;
        if freezes_couplings {
            gate.start = gate.start.map(|start| {
                if start > frame {
                    self.on_grid(NEVER_SECONDS)
                } else {
                    start
                }
            });
            gate.stop = gate.stop.filter(|&stop| stop <= frame);
        }
        gate.ramp = gate.ramp.filter(|ramp| ramp.end_factor != 1.0 || ramp.stop > frame);
        (is_coupling || gate.has_ramp()).then_some(gate)
    }
}

impl Glide {
    /// Whether it has ended by `frame`, at the values of the network.
    fn is_over(&self, frame: u64) -> bool {
        let last_point = self.points.last();
        last_point.is_some_and(|(stop, ties)| ties.is_none() && *stop <= frame)
    }
}

impl Lead {
    /// Whether it has ended by `frame`, at the values of the network.
    fn is_over(&self, frame: u64) -> bool {
        let last_point = self.points().last();
        last_point.is_some_and(|(stop, factors)| *factors == [1.0; 2] && *stop <= frame)
    }
}
