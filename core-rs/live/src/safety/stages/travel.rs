//! Whether a position is possible: within the travel of the key, and no jump that no force could cause.

use crate::safety::TripCause;
use crate::safety::contract::DeviceSpec;

/// How far a position may lie beyond either end of the travel, as a part of the travel: ends and sensors are not exact.
pub(in crate::safety) const TRAVEL_MARGIN: f64 = 0.1;
/// Greatest force of a hand that strikes a key, for a moment [N].
const STRIKE_FORCE: f64 = 200.0;
/// Greatest mass that is relied on [kg]: a device may report the mass of its whole mechanism.
const RELIED_MASS_MAX: f64 = 0.05;
/// By how much a reply may be older than it seems [s].
const REPLY_LATENESS: f64 = 5e-3;
/// A position is off by up to this many steps of the sensor.
const SENSOR_STEPS: f64 = 3.0;

/// The travel of an axis, and what it can do between two positions.
#[derive(Clone, Copy, Debug)]
pub(in crate::safety) struct Travel {
    /// Least and greatest position [m].
    range: [f64; 2],
    /// Greatest acceleration [m/s²].
    acceleration_max: f64,
    /// Greatest error of the sensor [m].
    sensor_error_max: f64,
}

impl Travel {
    /// The travel `range` [m] of an axis of a device that gives at most `force` [N].
    pub(in crate::safety) fn new(range: [f64; 2], spec: &DeviceSpec, force: f64) -> Self {
        let (lower_end, upper_end) = (range[0].min(range[1]), range[0].max(range[1]));
        let range_margin = TRAVEL_MARGIN * (upper_end - lower_end);
        let mass = spec.inertia.map_or(RELIED_MASS_MAX, |mass| mass.min(RELIED_MASS_MAX));
        Self {
            range: [lower_end - range_margin, upper_end + range_margin],
            acceleration_max: (STRIKE_FORCE + force) / mass,
            sensor_error_max: SENSOR_STEPS * spec.pos_lsb,
        }
    }

    /// Why a key that was at `position_before` [m] cannot be at `position` after `elapsed_time` [s], if it cannot;
    /// `velocities`: the mean of late, and that of the last step [m/s].
    pub(in crate::safety) fn fault(
        &self,
        position: f64,
        position_before: f64,
        velocities: [f64; 2],
        elapsed_time: f64,
    ) -> Option<TripCause> {
        let [lower_end, upper_end] = self.range;
        if position < lower_end || position > upper_end {
            return Some(TripCause::OutsideTravel);
        }
        // A reply that was late, or early, seems to be a jump by the velocity times that time.
        let max_deviation = self.acceleration_max * elapsed_time * elapsed_time
            + velocities[0].abs() * REPLY_LATENESS
            + self.sensor_error_max;
        let is_jump = |velocity: &f64| (position - position_before - velocity * elapsed_time).abs() > max_deviation;
        velocities.iter().all(is_jump).then_some(TripCause::Jump)
    }
}
