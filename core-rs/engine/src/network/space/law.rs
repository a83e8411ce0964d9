//! Force laws of links in space.

use std::sync::Arc;

use crate::law::Law;
use crate::network::PowerLaw;

/// How a link in space turns the measured distance into a force.
#[derive(Clone, Debug, PartialEq)]
pub enum SpaceLaw {
    /// Spring and damper with the rest length `rest`.
    Spring,
    /// A spring and damper whose rest length changes when its force exceeds a limit, and which breaks when it is too
    /// long. A limit that is never reached is infinite.
    Yielding {
        /// Greatest force of the spring, either way [N]: perfect plasticity (Prandtl 1928).
        yield_force: f64,
        /// Elongation beyond the original `rest` at which it breaks [m], however far it has yielded.
        break_elongation: f64,
    },
    /// A mass that attracts by K·ℓ/(1 + (ℓ/core)²)^1.5 at distance − rest ℓ: as a spring nearby, and as 1/ℓ² far away
    /// (Plummer 1911).
    Attraction {
        /// Scale of distance [m]: the force falls beyond core/√2.
        core: f64,
    },
    /// A contact, closed while the distance is below `rest`: it pushes by K·p^exponent + Z·dp/dt, where p is the depth.
    Contact {
        /// Exponent of the depth, 1 or more.
        exponent: f64,
        /// Whether a force that would pull is set to 0.
        is_clamped: bool,
    },
    /// A contact that sticks: beside its push it pulls by K·sink. Beyond touching, the pull falls to 0 over the
    /// distance `reach`. `rest` is the distance at which it separates.
    Cohesive {
        /// Exponent of the depth, 1 or more.
        exponent: f64,
        /// Whether damping cannot raise the pull above K·sink.
        is_clamped: bool,
        /// Its pull divided by K [m^exponent]; for an exponent of 1 this is the depth at which it rests.
        sink: f64,
        /// Distance beyond touching up to which it pulls [m].
        reach: f64,
    },
    /// No force: the link is only measured.
    Gauge,
    /// A law of distance − rest and its rate. K and Z of its run are its largest stiffness and viscosity at its initial
    /// length and at rest.
    Lnl {
        /// The law.
        law: Arc<Law>,
        /// Initial distance − rest, at which its energy is 0 [m].
        initial_elongation: f64,
        /// Factor from a step to the law's v: 1/T; 1 if steps are given in [m/s].
        rate: f64,
    },
}

/// Why a contact that sticks is refused.
pub(in crate::network) const COLLAPSE_MESSAGE: &str = "its attraction is stronger than K times the gap, so its two points would collapse \
     onto each other; reduce the attraction, or use a larger K or gap";

/// Value of distance − rest that marks a broken link.
const BROKEN: f64 = f64::NEG_INFINITY;

impl SpaceLaw {
    /// Whether its rest length changes for good.
    pub(crate) fn yields(&self) -> bool {
        matches!(self, Self::Yielding { .. })
    }

    /// Distance − rest after the rest length has yielded. `e` [m] is relative to the original rest length, which had
    /// grown by `yielded_length` [m] before; the new growth is `e` minus the result.
    pub(crate) fn after_yielding(&self, k: f64, e: f64, yielded_length: f64) -> f64 {
        let Self::Yielding {
            yield_force,
            break_elongation,
        } = self
        else {
            return e;
        };
        if e > *break_elongation || yielded_length.is_infinite() {
            return BROKEN;
        }
        let e = e - yielded_length;
        if (k * e).abs() > *yield_force {
            (yield_force / k).copysign(e)
        } else {
            e
        }
    }

    /// Whether it is a contact.
    #[inline(always)]
    pub(crate) fn is_contact(&self) -> bool {
        matches!(self, Self::Contact { .. } | Self::Cohesive { .. })
    }

    /// How far beyond touching it acts [m].
    pub fn reach(&self) -> f64 {
        match self {
            Self::Cohesive { reach, .. } => *reach,
            _ => 0.0,
        }
    }

    /// Whether its ends rest deeper than `gap`, their distance when they touch [m]; it is then stiffer across its line
    /// than along it.
    pub(in crate::network) fn rests_beyond_gap(&self, gap: f64) -> bool {
        matches!(self, Self::Cohesive { exponent: 1.0, sink, .. } if *sink > gap)
    }

    /// Whether it acts at distance − rest `e` [m].
    #[inline(always)]
    pub(crate) fn acts_at(&self, e: f64) -> bool {
        !self.is_contact() || e < 0.0
    }

    /// For a contact at distance − rest `e` [m] with the elastic force `elastic` [N]: its push over its depth [N/m],
    /// and its constant pull [N]. `None` if it does not touch.
    #[inline(always)]
    pub(crate) fn stiffness_and_pull(&self, k: f64, e: f64, elastic: f64) -> Option<[f64; 2]> {
        match self {
            Self::Cohesive { sink, reach, .. } => {
                let (signed_depth, constant_pull) = (e + reach, k * sink);
                (signed_depth < 0.0).then(|| [(elastic - constant_pull) / signed_depth, constant_pull])
            }
            _ => Some([elastic / e, 0.0]),
        }
    }

    /// Force that pulls the ends together [N], without damping, at distance − rest [m].
    pub(crate) fn elastic(&self, k: f64, e: f64) -> f64 {
        match self {
            // For a broken link e is −∞.
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => k * e,
            Self::Attraction { core } => {
                let scaled_square = 1.0 + (e / core) * (e / core);
                k * e / (scaled_square * scaled_square.sqrt())
            }
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => -contact(k, *exponent).force(-e),
            Self::Cohesive { .. } if e >= 0.0 => 0.0,
            Self::Cohesive { sink, reach, .. } if e + reach >= 0.0 => k * sink * (-e / reach),
            Self::Cohesive {
                exponent, sink, reach, ..
            } => k * (sink - contact(1.0, *exponent).force(-(e + reach))),
            Self::Gauge => 0.0,
            Self::Lnl { law, .. } => spring_of(law, e),
        }
    }

    /// Force that pulls the ends together [N] at distance − rest `e` [m] that grows by `step` a frame.
    pub(crate) fn force(&self, [k, z]: [f64; 2], e: f64, step: f64) -> f64 {
        match self {
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => k * e + z * step,
            Self::Attraction { .. } => self.elastic(k, e) + z * step,
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { .. } | Self::Cohesive { .. } => self.damped([k, e], self.elastic(k, e), z * step),
            Self::Gauge => 0.0,
            Self::Lnl { law, rate, .. } => force_of(law, e, step * rate),
        }
    }

    /// Force of a contact of stiffness `k` at distance − rest `e` [m] that pulls the ends together [N], from its
    /// elastic and its damping part.
    #[inline(always)]
    pub(crate) fn damped(&self, [k, e]: [f64; 2], elastic: f64, damping: f64) -> f64 {
        let total_pull = elastic + damping;
        match self {
            Self::Contact { is_clamped: true, .. } => total_pull.min(0.0),
            // Beyond touching, it pulls without damping.
            Self::Cohesive { reach, .. } if e + reach >= 0.0 => elastic,
            Self::Cohesive {
                is_clamped: true, sink, ..
            } => total_pull.min(k * sink),
            _ => total_pull,
        }
    }

    /// Energy at distance − rest `e` [J].
    pub(crate) fn potential(&self, k: f64, e: f64) -> f64 {
        match self {
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => 0.5 * k * e * e,
            // k·core²·(1 − 1/√far), without a difference of nearly equal numbers.
            Self::Attraction { core } => {
                let scaled_square = 1.0 + (e / core) * (e / core);
                k * e * e / (scaled_square + scaled_square.sqrt())
            }
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => contact(k, *exponent).energy(-e),
            // 0 after it has separated, and negative while it sticks.
            Self::Cohesive { .. } if e >= 0.0 => 0.0,
            Self::Cohesive { sink, reach, .. } if e + reach >= 0.0 => -0.5 * k * sink * (e * e) / reach,
            Self::Cohesive {
                exponent, sink, reach, ..
            } => {
                let penetration = -(e + reach);
                k * (contact(1.0, *exponent).energy(penetration) - sink * (0.5 * reach + penetration))
            }
            Self::Gauge => 0.0,
            Self::Lnl {
                law,
                initial_elongation,
                ..
            } => law.work(*initial_elongation, e),
        }
    }
}

#[inline(always)]
fn contact(k: f64, exponent: f64) -> PowerLaw {
    PowerLaw { k, exponent }
}

/// The elastic force of a law; `cold` keeps the loops of other links as short as without it.
#[cold]
#[inline(never)]
fn spring_of(law: &Law, e: f64) -> f64 {
    law.spring(e)
}

/// The force of a law; `cold` for the same reason.
#[cold]
#[inline(never)]
fn force_of(law: &Law, e: f64, v: f64) -> f64 {
    law.force(e, v)
}
