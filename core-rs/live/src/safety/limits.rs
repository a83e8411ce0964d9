//! What a hand is asked to bear.

use crate::device::Spec;

/// Limits of each axis; those of a [`Spec`] hold besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest force [N].
    pub force: f64,
    /// Fastest change of force [N/ms].
    pub slew: f64,
    /// From the first tick to full force [s].
    pub ramp: f64,
    /// An axis that is faster trips [m/s].
    pub velocity: f64,
    /// Time over which velocity is averaged [s]: one step of a coarse sensor is no speed.
    pub velocity_over: f64,
    /// A position that is older is none [s].
    pub stale: f64,
    /// How long a trip lasts at least [s].
    pub hold: f64,
    /// From zero to full force after a trip or a stale position [s].
    pub fade: f64,
    /// Most energy that may go into a hand at once [J].
    pub energy: f64,
    /// Power that a hand takes for ever [W].
    pub power: f64,
    /// Time over which a motor's heat is averaged [s].
    pub heat: f64,
}

impl Limits {
    /// Limits for a device: all its force, within 5 ms; and energy to push a hand with it over the range twice, then once in
    /// half a second. A partner who moves a hand stays below; a loop that swings ever further does not.
    pub fn of(spec: &Spec) -> Self {
        let full = spec.force_max_peak;
        let range = spec.pos_range[1] - spec.pos_range[0];
        Self {
            force: full,
            slew: full / 5.0,
            ramp: 2.0,
            velocity: 40.0 * range,
            velocity_over: 5e-3,
            stale: 0.02,
            hold: 0.5,
            fade: 0.25,
            energy: 2.0 * full * range,
            power: 2.0 * full * range,
            heat: 10.0,
        }
    }
}
