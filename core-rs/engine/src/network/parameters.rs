//! Parameters of ties and contacts, in SI units.

use crate::maths;

/// How a CEL is tied to the ground.
#[derive(Clone, Copy, Debug)]
pub enum Tie {
    /// Stiffness [N/m] and damping [N·s/m].
    Physical {
        /// K
        k: f64,
        /// Z
        z: f64,
    },
    /// Damped frequency [Hz] and decay to -60 dB [s] (none: no decay).
    Tuned {
        /// f
        f: f64,
        /// T60
        t60: Option<f64>,
    },
}

/// How a contact is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// The plain scheme of CORDIS-ANIMA.
    Plain,
    /// Energy-exact by a discrete gradient (Chatziioannou & van Walstijn 2015).
    Exact,
    /// K and Z chosen such that the restitution is exact for any instant of contact.
    Magic,
}

/// The side from which the striker comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The striker comes from below and pushes up.
    Below,
    /// The striker comes from above and pushes down.
    Above,
}

/// A one-sided contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct But {
    /// Stiffness [N/m^exponent]; a magic contact chooses its own.
    pub k: f64,
    /// Viscosity while it is closed [N·s/m], or algorithmic Z in a part under `ca`.
    pub z: f64,
    /// How far the striker is beyond the other point when the contact closes [m].
    pub gap: f64,
    /// The side from which the striker comes.
    pub side: Side,
    /// How the contact is computed.
    pub contact: Contact,
    /// Ratio of speeds after and before (magic contacts).
    pub restitution: f64,
    /// Number of steps a magic contact lasts.
    pub steps: u32,
    /// Power of the penetration.
    pub exponent: f64,
    /// Whether a force that would pull is set to 0.
    pub is_clamped: bool,
}

impl But {
    /// The plain contact of CORDIS-ANIMA: a spring k with viscosity z that the striker closes from below, with a gap.
    #[must_use]
    pub const fn plain(k: f64, z: f64, gap: f64) -> Self {
        Self {
            k,
            z,
            gap,
            side: Side::Below,
            contact: Contact::Plain,
            restitution: 1.0,
            steps: 2,
            exponent: 1.0,
            is_clamped: false,
        }
    }

    /// κ and ζ of a contact that lasts N steps and has exactly the restitution e: x[k+N] = −r^N·x[k] for any phase of
    /// the contact, with r = e^(1/N), Nθ = π.
    pub(crate) fn exact_restitution(&self) -> (f64, f64) {
        let step_count = f64::from(self.steps);
        let r = if self.restitution == 1.0 {
            1.0
        } else {
            maths::pow(self.restitution, 1.0 / step_count)
        };
        // Exact for the common cases of two and three steps; cos(π/2) is 6e-17 in floating point.
        let cos = match self.steps {
            2 => 0.0,
            3 => 0.5,
            _ => maths::cos(std::f64::consts::PI / step_count),
        };
        (1.0 + r * r - 2.0 * r * cos, 1.0 - r * r)
    }
}
