//! Links in space of a slow body: the CA scheme of the body alone at its own rate.

use std::sync::Arc;

use super::{Solution, moving_mats, resolves_phase};
use crate::assembly::wiring::WiredBody;
use crate::island::slow::{Slow, SpringMethod};
use crate::maths;
use crate::network::{Error, Subset};
use crate::scheme::Scheme;
use crate::units::Rate;

/// A body with links in space, or why it is not stable at that rate.
pub(super) fn slow_body_in_space(
    rate: Rate,
    (part, macrostep): (usize, u32),
    body: &WiredBody,
    subset: Subset,
) -> Result<Slow, String> {
    let macro_frames = f64::from(macrostep);
    let macro_rate = Rate::new(rate.hertz() / macro_frames).map_err(|error| error.to_string())?;
    let stiff_message = || "its springs are too stiff for that rate".to_owned();
    let macro_scheme = Scheme::new(&subset.network, macro_rate).map_err(|error| error.to_string())?;
    let certificate = macro_scheme.certify(&subset.network).map_err(|error| match error {
        Error::Unstable { .. } => stiff_message(),
        other_error => other_error.to_string(),
    })?;
    let kick_phase = 2.0 * maths::asin((0.5 * certificate.lambda_max.sqrt()).min(1.0));
    if !resolves_phase(kick_phase) {
        return Err(stiff_message());
    }
    let moving_mats = moving_mats(body, &subset);
    let solution = Solution {
        kick_phase,
        kick_interval: macrostep,
        rest_positions: vec![0.0; moving_mats.len()],
        inverse_masses: moving_mats
            .iter()
            .map(|&mat| macro_scheme.w[mat] / (macro_frames * macro_frames))
            .collect(),
        moving_mats,
        is_discrete: false,
    };
    let springs = SpringMethod::Stepped(Arc::new(macro_scheme));
    solution.into_slow_body(rate, (part, macrostep), body, subset, |_, _| springs)
}
