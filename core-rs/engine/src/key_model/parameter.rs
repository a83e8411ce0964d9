//! The parameters with respect to which a path is differentiated.

use super::{KEY_PARAMETERS, MODE_PARAMETERS};

/// The parameter of a column of derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Parameter {
    Mass,
    Stiffness,
    Damping,
    Weight,
    Dry,
    Start,
    Delay,
    Presliding,
    StaticDry,
    StaticSpeed,
    ModeMass(usize),
    ModeFrequency(usize),
    ModeRatio(usize),
    /// The force of a tick.
    Force(usize),
}

impl Parameter {
    pub(super) fn from_index(index: usize, n_modes: usize) -> Option<Self> {
        const FIRST: [Parameter; KEY_PARAMETERS] = [
            Parameter::Mass,
            Parameter::Stiffness,
            Parameter::Damping,
            Parameter::Weight,
            Parameter::Dry,
            Parameter::Start,
            Parameter::Delay,
            Parameter::Presliding,
            Parameter::StaticDry,
            Parameter::StaticSpeed,
        ];
        if let Some(&parameter) = FIRST.get(index) {
            return Some(parameter);
        }
        let mode_index = (index - KEY_PARAMETERS) / MODE_PARAMETERS;
        let mode_parameters = [Self::ModeMass, Self::ModeFrequency, Self::ModeRatio];
        (mode_index < n_modes).then(|| mode_parameters[(index - KEY_PARAMETERS) % MODE_PARAMETERS](mode_index))
    }
}
