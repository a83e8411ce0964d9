//! What a plan may spend, and how far from the truth it may be.

use crate::integrate::MeshMethod;

/// A method that is asked for by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The plain CA scheme, module by module.
    Ca,
    /// Modes where a body is linear, CA elsewhere.
    Modal,
    /// Meshes in two passes of CA.
    Ca2p,
    /// Meshes by the symmetric splitting of order 4.
    Bm4,
    /// Meshes by quadratised energy.
    Ieq,
    /// Linear meshes by the trapezoidal rule.
    Trapezoid,
}

impl Method {
    /// How it steps a mesh; `None`: as CA does.
    pub(crate) fn way(self) -> Option<MeshMethod> {
        match self {
            Self::Ca | Self::Modal => None,
            Self::Ca2p => Some(MeshMethod::Ca2p),
            Self::Bm4 => Some(MeshMethod::Bm4),
            Self::Ieq => Some(MeshMethod::Ieq),
            Self::Trapezoid => Some(MeshMethod::Trapezoid),
        }
    }
}

/// How exact a plan has to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// By one method, whatever its error.
    Method(Method),
    /// Error of the waveform [dB], relative to the sound.
    Error(f64),
    /// Error of pitches [cents], up to a frequency [Hz].
    Cents {
        /// Most cents.
        cents: f64,
        /// Up to here [Hz].
        upto: f64,
    },
}

/// Partials that are left out lie together this far below the sound where pitch is what counts [dB]:
/// masked by the rest, and below the noise of a 16-bit file at any usual level.
const UNHEARD: f64 = -80.0;
/// What is left out may take this part of an error budget [dB]: the predictor is within 1.1 dB.
const SHARE: f64 = -6.0;
/// Where pitch is what counts, a contact is right to this [dB].
const CONTACT: f64 = -60.0;
/// Nobody hears above [Hz].
pub(crate) const AUDIBLE: f64 = 20_000.0;

/// Above this pitch is hardly a quality of a sound any more [Hz].
pub const PITCH_UPTO: f64 = 5_000.0;

impl Default for Budget {
    /// By ear: 3 cents, the least difference in pitch that is heard (between 0.5 and 4 kHz), up to
    /// [`PITCH_UPTO`].
    fn default() -> Self {
        Self::Cents {
            cents: 3.0,
            upto: PITCH_UPTO,
        }
    }
}

impl Budget {
    /// Whether linear bodies go by their modes.
    pub(crate) fn takes_modes(&self) -> bool {
        match self {
            Self::Method(method) => *method == Method::Modal,
            Self::Error(_) | Self::Cents { .. } => true,
        }
    }

    /// Whether meshes may go by another method than CA.
    pub(crate) fn takes_meshes(&self) -> bool {
        match self {
            Self::Method(method) => method.way().is_some(),
            Self::Error(_) | Self::Cents { .. } => true,
        }
    }

    /// How loud all left-out modes may be together [dB]; `None`: none is left out.
    pub(crate) fn left_out(&self) -> Option<f64> {
        match *self {
            Self::Method(_) => None,
            Self::Error(db) => Some(db + SHARE),
            Self::Cents { .. } => Some(UNHEARD),
        }
    }

    /// Contacts that are computed finer than a frame take so many steps a frame at least; more than `STEPS_MAX` are
    /// slower than they are worth.
    pub(crate) const STEPS_MIN: usize = 2;
    pub(crate) const STEPS_MAX: usize = 64;

    /// How exact contacts have to be [dB].
    pub(crate) fn contact(&self) -> f64 {
        match *self {
            Self::Method(_) => f64::INFINITY,
            Self::Error(db) => db + SHARE,
            Self::Cents { .. } => CONTACT,
        }
    }

    /// The error of the waveform that is asked for, or where it is none that counts, what contacts are right to [dB].
    pub(crate) fn asked(&self) -> f64 {
        match *self {
            Self::Error(db) => db,
            Self::Cents { .. } | Self::Method(_) => CONTACT,
        }
    }

    /// How finely contacts are computed: in so many steps a frame and for a radian of their own oscillation at least.
    pub(crate) fn contact_substeps(&self) -> usize {
        match self {
            Self::Method(_) => 1,
            Self::Error(_) | Self::Cents { .. } => Self::STEPS_MIN,
        }
    }

    /// Modes above this are left out [Hz].
    pub(crate) fn highest(&self) -> f64 {
        match *self {
            Self::Cents { .. } => AUDIBLE,
            Self::Method(_) | Self::Error(_) => f64::INFINITY,
        }
    }
}
