//! The limit of a motor's continuous load.

use super::super::counts::StageCounts;

/// The heat of a motor's coil, by a first-order model.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::safety) struct Heat {
    /// Mean of (force / continuous force)²; above 1 the motor is too hot.
    pub(in crate::safety) coil_load: f64,
}

impl Heat {
    /// Limit the force to the continuous force if the motor is too hot, by the model or as its board reports
    /// (`is_reported_hot`).
    pub(in crate::safety) fn limit_force(
        self,
        force: f64,
        continuous_force: f64,
        is_reported_hot: bool,
        counts: &mut StageCounts,
    ) -> f64 {
        if (is_reported_hot || self.coil_load > 1.0) && force.abs() > continuous_force {
            counts.hot += 1;
            return continuous_force.copysign(force);
        }
        force
    }

    /// Add the load of a force over a tick of `period`; `time_constant`: time constant of the coil [s].
    pub(in crate::safety) fn add_load(&mut self, force: f64, continuous_force: f64, period: f64, time_constant: f64) {
        let heat_load = (force / continuous_force) * (force / continuous_force);
        self.coil_load += (heat_load - self.coil_load) * (period / time_constant);
    }

    /// The heat that is left after `elapsed` [s] without force.
    pub(in crate::safety) fn cooled(self, elapsed: f64, time_constant: f64) -> Self {
        Self {
            coil_load: self.coil_load * ergon_engine::maths::exp(-elapsed / time_constant),
        }
    }
}
