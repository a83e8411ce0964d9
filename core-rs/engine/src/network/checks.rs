//! Rules for the numbers of a network.

use super::Network;
use super::error::Error;

/// Largest number of MATs or LIAs of one network: 4 GB of state.
const MODULES_MAX: usize = 20_000_000;

/// A rule for a number.
#[derive(Clone, Copy, Debug)]
pub(super) enum Rule {
    Finite,
    NotNegative,
    Positive,
}

impl Rule {
    /// The broken rule in words; `None` if the value keeps the rule.
    fn broken(self, value: f64) -> Option<&'static str> {
        match self {
            _ if !value.is_finite() => Some("it must be a finite number"),
            Self::NotNegative if value < 0.0 => Some("it must not be negative"),
            Self::Positive if value <= 0.0 => Some("it must be above 0"),
            _ => None,
        }
    }
}

impl Network {
    /// The error that refuses a module of the current part.
    pub fn refused(&self, name: &str, message: &str) -> Error {
        Error::Refused {
            module: self.full_name(name),
            message: message.to_owned(),
        }
    }

    /// Refuse the module if the network has no room for `n_new` modules.
    pub(super) fn check_capacity(&self, name: &str, n_new: usize) -> Result<(), Error> {
        if self.n_mat() + n_new > MODULES_MAX || self.n_lia + n_new > MODULES_MAX {
            return Err(self.refused(name, &format!("a network holds at most {MODULES_MAX} modules")));
        }
        Ok(())
    }

    /// Refuse the module if a frequency [Hz] or a decay [s] is out of range.
    pub(super) fn check_tuning(&self, name: &str, f: f64, t60: Option<f64>) -> Result<(), Error> {
        if !(f > 0.0 && f.is_finite()) {
            return Err(self.refused(name, &format!("f is {f} Hz: it must be above 0 and finite")));
        }
        if let Some(t60) = t60.filter(|t60| t60.is_nan() || *t60 <= 0.0) {
            return Err(self.refused(name, &format!("t60 is {t60} s: it must be above 0")));
        }
        Ok(())
    }

    /// Refuse the module if a value breaks its rule.
    pub(super) fn check(&self, name: &str, values: &[(&str, f64, Rule)]) -> Result<(), Error> {
        for &(what, value, rule) in values {
            if let Some(broken_rule) = rule.broken(value) {
                return Err(self.refused(name, &format!("{what} is {value}: {broken_rule}")));
            }
        }
        Ok(())
    }
}
