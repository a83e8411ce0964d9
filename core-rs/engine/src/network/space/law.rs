//! What a link in space does with what it measures.

use std::sync::Arc;

use crate::law::Law;
use crate::maths::power_law;

/// What a link in space does with the distance of its ends.
#[derive(Clone, Debug, PartialEq)]
pub enum SpaceLaw {
    /// Spring and damper, `rest` long without force.
    Spring,
    /// The same, whose rest length follows beyond a force, and which breaks where it is too long. Both are endless where
    /// it never does.
    Yielding {
        /// Greatest force of the spring, either way [N]: perfect plasticity (Prandtl 1928).
        yields: f64,
        /// How much longer than `rest` it breaks [m], whatever it has yielded.
        breaks: f64,
    },
    /// A mass that attracts by K·ℓ/(1 + (ℓ/core)²)^1.5 at distance − rest ℓ: a spring near by, and far away as 1/ℓ²
    /// (Plummer 1911).
    Attraction {
        /// Distance [m] beyond which the force falls.
        core: f64,
    },
    /// A contact, closed where the distance is below `rest`: it pushes by K·p^exponent + Z·dp/dt, p the depth.
    Contact {
        /// Power of the depth, from 1 on.
        exponent: f64,
        /// Whether it never pulls.
        clamp: bool,
    },
    /// A contact that sticks: beside its push it pulls by K·sink, and less and less until its ends are `reach` farther than
    /// where they touch. `rest` is where it lets go.
    Cohesive {
        /// Power of the depth, from 1 on.
        exponent: f64,
        /// Whether its damping never pulls.
        clamp: bool,
        /// Its pull over K [m^exponent]: for an exponent of 1 the depth at which it rests.
        sink: f64,
        /// How far beyond touching it pulls [m].
        reach: f64,
    },
    /// Nothing: it is there to be measured.
    Gauge,
    /// A law of distance − rest and its rate. K and Z of its run are what it is stiff and viscous where it begins, at most.
    Lnl {
        /// The law.
        law: Arc<Law>,
        /// Distance − rest from which its energy counts [m]: where it begins.
        from: f64,
        /// A step times this is the law's v: 1/T; 1 where steps are given in [m/s].
        rate: f64,
    },
}

/// Why a contact that sticks is refused.
pub(in crate::network) const SINKS: &str = "its attraction is stronger than K times the gap, so its two points would collapse \
     onto each other; reduce the attraction, or use a larger K or gap";

/// Distance − rest of a link that is broken.
const BROKEN: f64 = f64::NEG_INFINITY;

impl SpaceLaw {
    /// Whether its rest length changes for good.
    pub(crate) fn yields(&self) -> bool {
        matches!(self, Self::Yielding { .. })
    }

    /// Distance − rest at `e` [m] where the rest length had grown by `yielded` [m], once it has followed: what it grew is
    /// the difference.
    pub(crate) fn settled(&self, k: f64, e: f64, yielded: f64) -> f64 {
        let Self::Yielding { yields, breaks } = self else {
            return e;
        };
        if e > *breaks || yielded.is_infinite() {
            return BROKEN;
        }
        let e = e - yielded;
        if (k * e).abs() > *yields {
            (yields / k).copysign(e)
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

    /// Whether it rests deeper than its ends are apart where they touch [m]: then it is stiffer across than along its line.
    pub(in crate::network) fn sinks_beyond(&self, gap: f64) -> bool {
        matches!(self, Self::Cohesive { exponent: 1.0, sink, .. } if *sink > gap)
    }

    /// Whether it acts at distance − rest `e` [m].
    #[inline(always)]
    pub(crate) fn acts(&self, e: f64) -> bool {
        !self.is_contact() || e < 0.0
    }

    /// Of a contact at distance − rest `e` [m]: how stiffly it pushes for its depth [N/m], and what it pulls beside that
    /// [N], where its elastic force is `elastic` [N]. `None` where it does not touch.
    #[inline(always)]
    pub(crate) fn pressed(&self, k: f64, e: f64, elastic: f64) -> Option<[f64; 2]> {
        match self {
            Self::Cohesive { sink, reach, .. } => {
                let (deep, pull) = (e + reach, k * sink);
                (deep < 0.0).then(|| [(elastic - pull) / deep, pull])
            }
            _ => Some([elastic / e, 0.0]),
        }
    }

    /// Force that pulls the ends together [N], without damping, at distance − rest [m].
    pub(crate) fn elastic(&self, k: f64, e: f64) -> f64 {
        match self {
            // One that is broken is endlessly too short.
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => k * e,
            Self::Attraction { core } => {
                let far = 1.0 + (e / core) * (e / core);
                k * e / (far * far.sqrt())
            }
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => -k * power_law(-e, *exponent),
            Self::Cohesive { .. } if e >= 0.0 => 0.0,
            Self::Cohesive { sink, reach, .. } if e + reach >= 0.0 => k * sink * (-e / reach),
            Self::Cohesive {
                exponent,
                sink,
                reach,
                ..
            } => k * (sink - power_law(-(e + reach), *exponent)),
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
            Self::Contact { .. } | Self::Cohesive { .. } => {
                self.damped([k, e], self.elastic(k, e), z * step)
            }
            Self::Gauge => 0.0,
            Self::Lnl { law, rate, .. } => force_of(law, e, step * rate),
        }
    }

    /// Force of a contact of stiffness `k` at distance − rest `e` [m] that pulls the ends together [N], from its elastic and
    /// its damping part.
    #[inline(always)]
    pub(crate) fn damped(&self, [k, e]: [f64; 2], elastic: f64, damping: f64) -> f64 {
        let pull = elastic + damping;
        match self {
            Self::Contact { clamp: true, .. } => pull.min(0.0),
            // What only pulls has no damper.
            Self::Cohesive { reach, .. } if e + reach >= 0.0 => elastic,
            Self::Cohesive {
                clamp: true, sink, ..
            } => pull.min(k * sink),
            _ => pull,
        }
    }

    /// Energy at distance − rest `e` [J].
    pub(crate) fn potential(&self, k: f64, e: f64) -> f64 {
        match self {
            Self::Yielding { .. } if e == BROKEN => 0.0,
            Self::Spring | Self::Yielding { .. } => 0.5 * k * e * e,
            // Of k·core²·(1 − 1/√far), without the difference of numbers that are nearly the same.
            Self::Attraction { core } => {
                let far = 1.0 + (e / core) * (e / core);
                k * e * e / (far + far.sqrt())
            }
            Self::Contact { .. } if e >= 0.0 => 0.0,
            Self::Contact { exponent, .. } => k * power_law(-e, exponent + 1.0) / (exponent + 1.0),
            // 0 where it has let go, and below 0 where it holds.
            Self::Cohesive { .. } if e >= 0.0 => 0.0,
            Self::Cohesive { sink, reach, .. } if e + reach >= 0.0 => {
                -0.5 * k * sink * (e * e) / reach
            }
            Self::Cohesive {
                exponent,
                sink,
                reach,
                ..
            } => {
                let (deep, power) = (-(e + reach), exponent + 1.0);
                k * (power_law(deep, power) / power - sink * (0.5 * reach + deep))
            }
            Self::Gauge => 0.0,
            Self::Lnl { law, from, .. } => law.work(*from, e),
        }
    }
}

/// The elastic force of a law: cold, so that the loops of other links stay as short as without it.
#[cold]
#[inline(never)]
fn spring_of(law: &Law, e: f64) -> f64 {
    law.spring(e)
}

/// The force of a law, likewise.
#[cold]
#[inline(never)]
fn force_of(law: &Law, e: f64, v: f64) -> f64 {
    law.force(e, v)
}
