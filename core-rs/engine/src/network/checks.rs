//! What every number of a network must be.

use super::Network;
use super::kinds::Error;

/// Most MATs or LIAs of one network: 4 GB of state.
const MODULES_MAX: usize = 20_000_000;

impl Network {
    /// The refusal of a module of the present part.
    pub fn refused(&self, name: &str, message: &str) -> Error {
        Error::Refused {
            module: self.full(name),
            message: message.to_owned(),
        }
    }

    pub(super) fn room(&self, name: &str, more: usize) -> Result<(), Error> {
        if self.n_mat() + more > MODULES_MAX || self.n_lia + more > MODULES_MAX {
            return Err(self.refused(
                name,
                &format!("a network holds at most {MODULES_MAX} modules"),
            ));
        }
        Ok(())
    }

    pub(super) fn check_tuning(&self, name: &str, f: f64, t60: Option<f64>) -> Result<(), Error> {
        if !(f > 0.0 && f.is_finite()) {
            return Err(self.refused(name, &format!("f is {f} Hz: it must be above 0 and finite")));
        }
        if let Some(t60) = t60.filter(|t60| t60.is_nan() || *t60 <= 0.0) {
            return Err(self.refused(name, &format!("t60 is {t60} s: it must be above 0")));
        }
        Ok(())
    }

    /// Each value must be finite and at least (`closed`) or above its bound.
    pub(super) fn check(&self, name: &str, values: &[(&str, f64, f64, bool)]) -> Result<(), Error> {
        for &(what, value, bound, closed) in values {
            let fits = value.is_finite() && (value > bound || (closed && value == bound));
            if !fits {
                let rule = match (value.is_finite(), closed) {
                    (false, _) => "it must be a finite number",
                    (_, true) => "it must not be negative",
                    (_, false) => "it must be above 0",
                };
                return Err(self.refused(name, &format!("{what} is {value}: {rule}")));
            }
        }
        Ok(())
    }
}
