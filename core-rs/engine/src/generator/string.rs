//! STRING: masses in a row.

use std::f64::consts::FRAC_PI_2;

use super::{GeneratorError, Links, MAX_MASSES, Topology, check_count};
use crate::maths::sin;

/// The ends at which a string is tied to SOLs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// At both ends: n + 1 springs.
    Fixed,
    /// Nowhere: n - 1 springs.
    Free,
    /// Before its first mass: n springs.
    Left,
}

/// Most masses of a string with stiffness: its lowest mode is found by an iteration, which takes longer for more
/// masses.
const MAX_STIFF_MASSES: usize = 20_000;

/// `n_masses` MATs in a row; `stiffness` s >= 0 adds links of factor s between neighbours but one.
///
/// ```
/// use ergon_engine::generator::{Ends, string};
///
/// let topology = string(60, Ends::Fixed, 0.0)?;
/// assert_eq!((topology.n_mat, topology.n_fixed), (60, 2));
/// assert!(string(0, Ends::Fixed, 0.0).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Numbers out of range.
pub fn string(n_masses: usize, ends: Ends, stiffness: f64) -> Result<Topology, GeneratorError> {
    let is_stiff = stiffness != 0.0;
    let (masses_label, masses_limit) = match is_stiff {
        false => ("`masses`", MAX_MASSES),
        true => ("`masses` of a string with stiffness", MAX_STIFF_MASSES),
    };
    check_count(masses_label, n_masses, 1, masses_limit)?;
    if !(stiffness >= 0.0 && stiffness.is_finite()) {
        let range = "0 or a positive number";
        return Err(GeneratorError::Range {
            what: "`stiffness`",
            range,
            got: stiffness,
        });
    }
    let string_row = Row::new(n_masses, ends);
    let (holds_left, holds_right) = (string_row.is_left_held, string_row.is_right_held);
    let mut string_links = Links::new();
    if holds_left {
        string_links.join(n_masses, 0, 1.0);
    }
    (1..n_masses).for_each(|i| string_links.join(i - 1, i, 1.0));
    if holds_right {
        string_links.join(n_masses - 1, n_masses + 1, 1.0);
    }
    if is_stiff {
        // The fixed ends are neighbours like others.
        if holds_left && n_masses > 1 {
            string_links.join(n_masses, 1, stiffness);
        }
        (2..n_masses).for_each(|i| string_links.join(i - 2, i, stiffness));
        if holds_right && n_masses > 1 {
            string_links.join(n_masses - 2, n_masses + 1, stiffness);
        }
    }
    // λ₁ = 4 sin²(angle).
    let n = n_masses as f64;
    let angle = match ends {
        Ends::Fixed => FRAC_PI_2 / (n + 1.0),
        Ends::Free => FRAC_PI_2 / n,
        Ends::Left => FRAC_PI_2 / (2.0 * n + 1.0),
    };
    let is_known = !is_stiff && (ends != Ends::Free || n_masses > 1);
    Ok(Topology {
        lowest_lambda: is_known.then(|| 4.0 * sin(angle) * sin(angle)),
        ..Topology::new(n_masses, string_links.runs, string_row.positions)
    })
}

/// Where masses in a row lie, and which of its ends are held.
pub(super) struct Row {
    pub(super) is_left_held: bool,
    pub(super) is_right_held: bool,
    /// (x, y) [m] of masses and fixed points   (n_mat + n_fixed,)
    pub(super) positions: Vec<[f64; 2]>,
}

impl Row {
    pub(super) fn new(n_masses: usize, ends: Ends) -> Self {
        let (is_left_held, is_right_held) = match ends {
            Ends::Fixed => (true, true),
            Ends::Left => (true, false),
            Ends::Free => (false, false),
        };
        // Fixed points, or free ends, lie half a metre to either side.
        let (first_place, n_gaps) = (
            f64::from(is_left_held),
            (n_masses - 1) as f64 + f64::from(is_left_held) + f64::from(is_right_held),
        );
        let position = |place: f64| [if n_gaps > 0.0 { place / n_gaps - 0.5 } else { 0.0 }, 0.0];
        let mut positions: Vec<[f64; 2]> = (0..n_masses).map(|i| position(first_place + i as f64)).collect();
        positions.extend(is_left_held.then(|| position(0.0)));
        positions.extend(is_right_held.then(|| position(n_gaps)));
        Self {
            is_left_held,
            is_right_held,
            positions,
        }
    }

    pub(super) fn n_fixed(&self) -> usize {
        usize::from(self.is_left_held) + usize::from(self.is_right_held)
    }
}
