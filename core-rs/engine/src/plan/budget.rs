//! How exact a plan has to be, or which method it has to use.

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
}

impl Method {
    /// The method for meshes; `None`: CA.
    pub(crate) fn mesh_method(self) -> Option<MeshMethod> {
        match self {
            Self::Ca | Self::Modal => None,
            Self::Ca2p => Some(MeshMethod::Ca2p),
            Self::Bm4 => Some(MeshMethod::Bm4),
            Self::Ieq => Some(MeshMethod::Ieq),
        }
    }
}

/// The accuracy that a plan has to reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// One method, whatever its error.
    Method(Method),
    /// Error of the waveform [dB], relative to the sound.
    Error(f64),
    /// Error of pitches [cents], up to a frequency [Hz].
    Cents {
        /// Largest error [cents].
        cents: f64,
        /// Up to this frequency [Hz].
        upto: f64,
    },
}

/// Loudness of all left-out partials together, relative to the sound, if the budget is one of pitch [dB]: masked by the
/// rest, and below the noise of a 16-bit file at any usual level.
const UNHEARD: f64 = -80.0;
/// The part of an error budget for left-out modes, and for contacts [dB]; the predictor of their loudness is within 1.1
/// dB.
const SHARE: f64 = -6.0;
/// Accuracy of contacts, and of all whose audible error is not known, if the budget is one of pitch [dB].
pub const INAUDIBLE: f64 = -60.0;
/// Errors that count as equal, each the least that is heard: of a pitch [cents], of a T60 [1], of the level of a third
/// octave [dB], of the beginning of the first stroke and of a later one [s], and of the level of a stroke [dB].
///
/// 3 cents: Moore, J. Acoust. Soc. Am. 54 (1973). 3 %: below the difference limen of reverberation times of 5 %, ISO
/// 3382-1 (2009), table A.1. 1 dB: the difference limen of levels, Zwicker & Fastl, Psychoacoustics (1990), 7.1; half of
/// it for strokes, which are compared with each other. 2 ms: two clicks are heard in their order at 2 to 3 ms (Hirsh, J.
/// Acoust. Soc. Am. 31, 1959); a quarter of it where a gesture begins, which the player feels.
pub const LEAST_HEARD: [f64; 6] = [3.0, 0.03, 1.0, 0.5e-3, 2e-3, 0.5];
/// Highest audible frequency [Hz].
pub(crate) const AUDIBLE: f64 = 20_000.0;

/// Above this frequency a sound hardly has a pitch [Hz].
pub const PITCH_UPTO: f64 = 5_000.0;

impl Default for Budget {
    /// By ear: 3 cents, the least difference in pitch that is heard (between 0.5 and 4 kHz), up to
    /// [`PITCH_UPTO`].
    fn default() -> Self {
        Self::Cents {
            cents: LEAST_HEARD[0],
            upto: PITCH_UPTO,
        }
    }
}

impl Budget {
    /// Whether linear bodies are computed by their modes.
    pub(crate) fn takes_modes(&self) -> bool {
        match self {
            Self::Method(method) => *method == Method::Modal,
            Self::Error(_) | Self::Cents { .. } => true,
        }
    }

    /// Whether meshes may be computed by another method than CA.
    pub(crate) fn takes_meshes(&self) -> bool {
        match self {
            Self::Method(method) => method.mesh_method().is_some(),
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

    /// Fewest substeps a frame of contacts that are computed finer than a frame; more than `STEPS_MAX` would be slower
    /// than they are worth.
    pub(crate) const STEPS_MIN: usize = 2;
    pub(crate) const STEPS_MAX: usize = 64;

    /// Largest error that contacts may have [dB].
    pub(crate) fn contact(&self) -> f64 {
        match *self {
            Self::Method(_) => f64::INFINITY,
            Self::Error(db) => db + SHARE,
            Self::Cents { .. } => INAUDIBLE,
        }
    }

    /// The error of the waveform that is asked for; if the budget is not one of the waveform, the accuracy of contacts
    /// [dB].
    pub(crate) fn asked(&self) -> f64 {
        match *self {
            Self::Error(db) => db,
            Self::Cents { .. } | Self::Method(_) => INAUDIBLE,
        }
    }

    /// Fewest contact substeps a frame, and for a radian of the contacts' own oscillation.
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
