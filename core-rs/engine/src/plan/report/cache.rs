//! Plans that are kept from one run to the next: what a plan is known again by, and what its pilot found.

use std::fmt::{self, Write};

use sha2::{Digest, Sha256};

use crate::network::{Error, Network};
use crate::plan::budget::Budget;
use crate::plan::choice::another;
use crate::plan::passes::linear::NoModes;
use crate::plan::report::row::{Computed, Measured, Row};
use crate::timeline::Timeline;

/// What a row says that its choice does not: a pilot found it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CachedReport {
    /// The error that was measured.
    pub error: Option<Measured>,
    /// How loud the modes that are not computed would be [dB].
    pub left_out: Option<f64>,
    /// Why it is not computed in a better way.
    pub because: Option<String>,
    /// The allowance of work for trials was spent there.
    pub is_cut_short: bool,
}

/// SHA-256 of all that a plan of this version is a function of (64 hex digits).
///
/// Everything is written as `Debug` writes it: every field that there is or will be, and each number with all
/// its digits.
pub fn key(network: &Network, timeline: &Timeline, budget: &Budget, share: f64) -> String {
    let mut sink = Sink(Sha256::new());
    // A hash takes everything: nothing can fail.
    let _ = write!(sink, "{network:?}\n{timeline:?}\n{budget:?}\n{share:?}");
    sink.hex()
}

/// What is written is hashed.
pub(in crate::plan) struct Sink(pub(in crate::plan) Sha256);

impl Sink {
    /// The hash (64 hex digits).
    pub(in crate::plan) fn hex(self) -> String {
        let digest = self.0.finalize();
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

impl Write for Sink {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text);
        Ok(())
    }
}

/// Give rows back what was told of them; refused where it was told of others.
pub(in crate::plan) fn recall(rows: &mut [Row], reports: &[CachedReport]) -> Result<(), Error> {
    if rows.len() != reports.len() {
        return Err(another());
    }
    for (row, reports) in rows.iter_mut().zip(reports) {
        let numbers = reports.error.iter();
        let numbers = numbers.flat_map(|reports| {
            let audible = reports.audible;
            let heard = audible.map(|audible| [audible.cents, audible.t60, audible.level]);
            let heard = heard.into_iter().flatten().map(Some);
            [Some(reports.db), Some(reports.over), reports.spectral]
                .into_iter()
                .chain(heard)
        });
        let is_number = numbers
            .flatten()
            .chain(reports.left_out)
            .all(f64::is_finite);
        let is_known = reports.because.as_deref().is_none_or(NoModes::is_why);
        if !is_number || !is_known {
            return Err(another());
        }
        match (&mut row.what, reports.left_out) {
            (Computed::Modes { left_out, .. }, reports) => *left_out = reports,
            (_, None) => {}
            (_, Some(_)) => return Err(another()),
        }
        row.error = reports.error;
        row.is_cut_short = reports.is_cut_short;
        row.because.clone_from(&reports.because);
    }
    Ok(())
}
