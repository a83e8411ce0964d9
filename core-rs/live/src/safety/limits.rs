//! The limits of force, power and energy on a hand; the stages in `pipeline` apply them.

use crate::safety::contract::DeviceSpec;

/// Greatest work that any device may do on a hand at once [J]: 10 N over 100 mm. For comparison: a partner who leads a
/// hand by 15 mm to and fro three times a second does 0.2 W.
const ENERGY_MAX: f64 = 1.0;
/// Greatest power that any device may give to a hand for long [W].
const POWER_MAX: f64 = 0.5;

/// Limits of each axis; those of a [`DeviceSpec`] hold in addition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyLimits {
    /// Greatest force [N].
    pub force_max: f64,
    /// Fastest change of force [N/ms].
    pub slew_rate_max: f64,
    /// Time of the rise to full force at the start [s].
    pub ramp_time: f64,
    /// Speed above which an axis trips [m/s].
    pub velocity_max: f64,
    /// Time over which velocity is averaged [s], because one step of a coarse sensor is not a speed.
    pub velocity_window: f64,
    /// Age above which a position is not used [s].
    pub position_age_max: f64,
    /// Least duration of a trip [s].
    pub trip_time: f64,
    /// Time of the fade from zero to full force after a trip or a stale position [s].
    pub fade_time: f64,
    /// Greatest work that may be done on a hand at once [J].
    pub work_max: f64,
    /// Power at which `work_max` is refilled, so the greatest continuous power into a hand [W].
    pub power_max: f64,
    /// Time constant of a motor's heat [s].
    pub heat_time: f64,
}

impl SafetyLimits {
    /// Limits for a device: its full force, within 5 ms; the work of pushing a hand with that force twice over the
    /// range, refilled once per second, but no more than 1 J and 0.5 W. A partner who moves a hand stays below; a loop
    /// that swings ever further does not.
    pub fn from_spec(spec: &DeviceSpec) -> Self {
        let full_force = spec.force_max_peak;
        let position_range = spec.pos_range[1] - spec.pos_range[0];
        Self {
            force_max: full_force,
            slew_rate_max: full_force / 5.0,
            ramp_time: 2.0,
            velocity_max: 40.0 * position_range,
            velocity_window: 5e-3,
            position_age_max: 0.02,
            trip_time: 0.5,
            fade_time: 0.25,
            work_max: ENERGY_MAX.min(2.0 * full_force * position_range),
            power_max: POWER_MAX.min(2.0 * full_force * position_range),
            heat_time: 10.0,
        }
    }
}
