//! The order of the steps in which contacts push between frames.

use crate::integrate::STAGES;
use crate::maths::sqrt;

/// Kick and drift of Strang's splitting; a last kick of half a step ends it.
const STRANG: [[f64; 2]; 1] = [[0.5, 1.0]];
/// Contacts that swing slower than this are slow [rad/frame]. In steps of order 2, one a frame, their own oscillation
/// is too quick by (1/8)²/24 = 1.1 cents at most.
const SLOW_RATE: f64 = 0.125;

/// The order of the steps in which contacts push between frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ContactOrder {
    /// Strang's splitting while contacts are slow, as where something rests on them; else BM4.
    Second,
    /// BM4.
    #[default]
    Fourth,
}

/// Kicks and drifts of a step, as shares of it; a last kick as long as the first ends it.
pub(super) type Stages = &'static [[f64; 2]];

/// How fast the contacts that push may swing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ContactRates {
    /// The quickest of them alone [rad/frame].
    pub(super) rate_max: f64,
    /// The sum of their squares: on one mass their stiffness adds up.
    square_sum: f64,
}

impl ContactRates {
    pub(super) fn add(&mut self, rate: f64) {
        self.rate_max = self.rate_max.max(rate);
        self.square_sum += rate * rate;
    }
}

impl ContactOrder {
    /// The order.
    pub(crate) fn number(self) -> u32 {
        match self {
            Self::Second => 2,
            Self::Fourth => 4,
        }
    }

    /// The scheme of this order of accuracy; `None` unless that is 2 or 4.
    pub(crate) fn from_number(number: u32) -> Option<Self> {
        [Self::Second, Self::Fourth]
            .into_iter()
            .find(|order| order.number() == number)
    }

    /// The stages of a step, and the least number of steps in a frame. Order 4 takes at least `steps` in a frame, and
    /// as many in a radian of the quickest contact.
    pub(super) fn stages(self, steps: f64, rates: ContactRates) -> (Stages, f64) {
        match self {
            Self::Second if sqrt(rates.square_sum) <= SLOW_RATE => (&STRANG, 1.0),
            Self::Second | Self::Fourth => (&STAGES, steps * rates.rate_max.max(1.0)),
        }
    }
}
