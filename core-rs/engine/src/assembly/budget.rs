//! How exact a plan has to be, or which method it has to use.

use crate::assembly::constants::{BUDGET_SHARE_DB, INAUDIBLE_ERROR_DB, LEFT_OUT_DB_MAX, PITCH_HERTZ_MAX};
use crate::hearing::{Audible, HIGHEST_AUDIBLE, JUST_NOTICEABLE};
use crate::integrate::MeshMethod;
use crate::island::{ContactOrder, FINE_SUBSTEPS_MIN};

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
        frequency_hz_max: f64,
    },
}

impl Default for Budget {
    /// By ear: 3 cents, the least difference in pitch that is heard (between 0.5 and 4 kHz), up to
    /// [`PITCH_HERTZ_MAX`].
    fn default() -> Self {
        Self::Cents {
            cents: JUST_NOTICEABLE[0],
            frequency_hz_max: PITCH_HERTZ_MAX,
        }
    }
}

impl Budget {
    /// Whether linear bodies are computed by their modes.
    pub(crate) fn allows_modes(&self) -> bool {
        match self {
            Self::Method(method) => *method == Method::Modal,
            Self::Error(_) | Self::Cents { .. } => true,
        }
    }

    /// Whether meshes may be computed by another method than CA.
    pub(crate) fn allows_mesh_methods(&self) -> bool {
        match self {
            Self::Method(method) => method.mesh_method().is_some(),
            Self::Error(_) | Self::Cents { .. } => true,
        }
    }

    /// How loud all left-out modes may be together [dB]; `None`: none is left out.
    pub(crate) fn left_out_db_max(&self) -> Option<f64> {
        match *self {
            Self::Method(_) => None,
            Self::Error(db) => Some(db + BUDGET_SHARE_DB),
            Self::Cents { .. } => Some(LEFT_OUT_DB_MAX),
        }
    }

    /// Largest error that contacts may have [dB].
    pub(crate) fn contact_error_db_max(&self) -> f64 {
        match *self {
            Self::Method(_) => f64::INFINITY,
            Self::Error(db) => db + BUDGET_SHARE_DB,
            Self::Cents { .. } => INAUDIBLE_ERROR_DB,
        }
    }

    /// The error of the waveform that is asked for; if the budget is not one of the waveform, the accuracy of contacts
    /// [dB].
    pub(crate) fn waveform_error_db(&self) -> f64 {
        match *self {
            Self::Error(db) => db,
            Self::Cents { .. } | Self::Method(_) => INAUDIBLE_ERROR_DB,
        }
    }

    /// Orders of contacts that are worth trying in the fewest substeps, from the least work on.
    pub(crate) fn contact_orders(&self) -> &'static [ContactOrder] {
        match self {
            Self::Cents { .. } => &[ContactOrder::Second, ContactOrder::Fourth],
            Self::Error(_) | Self::Method(_) => &[ContactOrder::Fourth],
        }
    }

    /// Fewest contact substeps in a frame, and in a radian of the oscillation of a contact, whichever is more.
    pub(crate) fn contact_substeps(&self) -> usize {
        match self {
            Self::Method(_) => 1,
            Self::Error(_) | Self::Cents { .. } => FINE_SUBSTEPS_MIN,
        }
    }

    /// Modes above this are left out [Hz].
    pub(crate) fn highest_audible_hz(&self) -> f64 {
        match *self {
            Self::Cents { .. } => HIGHEST_AUDIBLE,
            Self::Method(_) | Self::Error(_) => f64::INFINITY,
        }
    }

    /// The largest audible error, as a multiple of what a budget of pitch allows; 0 for any other budget.
    pub(crate) fn excess_ratio(&self, audible: &Audible) -> f64 {
        match *self {
            Self::Cents { cents, .. } => audible.worst_excess() * JUST_NOTICEABLE[0] / cents,
            Self::Error(_) | Self::Method(_) => 0.0,
        }
    }
}
