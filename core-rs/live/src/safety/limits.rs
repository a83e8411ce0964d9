//! The limits of force, power and energy on a hand, as numbers; the stages in `pipeline` apply them.

use crate::safety::contract::Spec;

/// Work that no device does on a hand at once [J]: 10 N over 100 mm. A partner who leads a hand by 15 mm to and fro three
/// times a second does a fifth of a watt.
const ENERGY: f64 = 1.0;
/// Power that no device gives to a hand for long [W].
const POWER: f64 = 0.5;

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
    /// Most work that may be done on a hand at once [J].
    pub energy: f64,
    /// Power that may go into a hand for ever: it fills that up [W].
    pub power: f64,
    /// Time over which a motor's heat is averaged [s].
    pub heat: f64,
}

impl Limits {
    /// Limits for a device: all its force, within 5 ms; and work to push a hand with it over the range twice, and twice in
    /// every second after that, but no more than 1 J and 0.5 W. A partner who moves a hand stays below; a loop
    /// that swings ever further does not.
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
            energy: ENERGY.min(2.0 * full * range),
            power: POWER.min(2.0 * full * range),
            heat: 10.0,
        }
    }
}
