//! STRING, PLATE, BANK and MODES: where the masses lie, what links them, and how they are tuned.
//!
//! A topology has masses and springs of 1. Masses are numbered row by row, and links come in long runs of constant
//! offset, over which the kernels loop.

mod bank;
mod bent_plate;
mod fit;
mod loss;
mod modal_body;
mod plate;
mod rectangle;
mod round_membrane;
mod sparse;
mod stiff_string;
mod string;
#[cfg(test)]
mod tests;
mod tune;

pub use bank::{Angles, BankCell, BankForm, Place, Spread, bank, cells_at};
pub use bent_plate::bent_plate;
pub use loss::{Decay, Losses, tune_points};
pub use modal_body::{MAX_MODAL, MAX_PLACES, ModalBody, modal_body};
pub use plate::{Rim, Shape, plate};
pub use round_membrane::round_membrane;
pub use stiff_string::stiff_string;
pub use string::{Ends, string};
pub use tune::{TunedLinks, tune};

use crate::maths::wide::wide;

/// Most MATs of one generator, so that they fit the memory.
pub const MAX_MASSES: usize = 2_000_000;

/// Links of one factor: link i of the run joins points a + i and b + i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TopologyRun {
    /// First point of the first link.
    pub a: usize,
    /// Second point of the first link.
    pub b: usize,
    /// How many links.
    pub len: usize,
    /// Factor of the generator's k and z: 1, or the `stiffness` of a string. It may be negative in a body that resists
    /// bending, whose links together are passive.
    pub factor: f64,
    /// Whether `hardening` acts on them.
    pub hardens: bool,
}

/// The network that a generator makes: points 0..n_mat are MATs, n_mat..n_mat + n_fixed are SOLs.
#[derive(Clone, Debug, PartialEq)]
pub struct Topology {
    /// Number of MATs.
    pub n_mat: usize,
    /// Number of SOLs.
    pub n_fixed: usize,
    /// The links.
    pub runs: Vec<TopologyRun>,
    /// Index of the middle MAT.
    pub centre: usize,
    /// (x, y) of every point on the picture of the instrument, in units of its longer side and centred on (0, 0);
    /// (n_mat + n_fixed,).
    pub positions: Vec<[f64; 2]>,
    /// Mass of each MAT over the mean mass; empty if all are equal   (n_mat,)
    pub shares: Vec<f64>,
    /// Whether nothing keeps the body from tilting, because it resists only curvature.
    has_tilt_modes: bool,
    /// The lowest non-rigid λ, if a formula gives it.
    lowest_lambda: Option<f64>,
    /// Whether the fixed points lie before and after the masses, so that a path of links is one run.
    pub(crate) is_in_line: bool,
    /// A plainer body of whose matrix this body's matrix is a polynomial, and the coefficients from the first power on.
    base_polynomial: Option<(Box<Topology>, Vec<f64>)>,
}

/// Why a generator is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeneratorError {
    /// A number of things that is out of range.
    #[error("{what} must be from {least} to {largest}; here it is {got}.")]
    Count {
        /// The field.
        what: &'static str,
        /// Bounds.
        least: usize,
        /// Bounds.
        largest: usize,
        /// What was given.
        got: usize,
    },
    /// A value out of its range.
    #[error("{what} must be {range}; here it is {got}.")]
    Range {
        /// The field.
        what: &'static str,
        /// What it must be.
        range: &'static str,
        /// What was given.
        got: f64,
    },
    /// A string whose lattice is too coarse for its partials.
    #[error(
        "A string of {masses} masses cannot have its first 20 partials within 1 cent of this inharmonicity; give it \
         {enough} masses or more."
    )]
    FewMasses {
        /// Number of masses given.
        masses: usize,
        /// Number of masses that is enough.
        enough: usize,
    },
    /// Decays that change too fast with pitch, or too slowly.
    #[error(
        "This body cannot have a T60 of {t60:.3} s at {f:.0} Hz together with its other decays; the nearest possible \
         value is {nearest:.3} s. Remove this point, or write a value near that."
    )]
    Decays {
        /// Frequency [Hz].
        f: f64,
        /// Decay asked for [s].
        t60: f64,
        /// Nearest possible decay [s].
        nearest: f64,
    },
    /// A place at which all levels of a list of modes are 0.
    #[error("No mode moves place {place}: all its levels are 0.")]
    Still {
        /// Index of the place, from 0.
        place: usize,
    },
    /// A disc where a lattice is needed.
    #[error("A disc has rings, not the rows of a lattice.")]
    Rings,
    /// No two masses can move against each other.
    #[error("A body of one free mass has no mode to tune; give it more masses, or fix its edge.")]
    NoMode,
    /// A pitch above half the rate of a discrete network.
    #[error("A discrete network at {rate} Hz cannot sound at {f} Hz: its frequencies end at half its rate.")]
    Pitch {
        /// Asked frequency [Hz].
        f: f64,
        /// The network's rate [Hz].
        rate: f64,
    },
}

fn check_count(what: &'static str, got: usize, least: usize, greatest: usize) -> Result<(), GeneratorError> {
    if (least..=greatest).contains(&got) {
        return Ok(());
    }
    Err(GeneratorError::Count {
        what,
        least,
        largest: greatest,
        got,
    })
}

fn positive(what: &'static str, got: f64) -> Result<(), GeneratorError> {
    if got > 0.0 && got.is_finite() {
        return Ok(());
    }
    Err(GeneratorError::Range {
        what,
        range: "a positive number",
        got,
    })
}

impl Topology {
    /// A topology of MATs of equal mass, without further properties.
    fn new(n_mat: usize, runs: Vec<TopologyRun>, positions: Vec<[f64; 2]>) -> Self {
        Self {
            n_mat,
            n_fixed: positions.len() - n_mat,
            runs,
            centre: n_mat / 2,
            positions,
            shares: Vec::new(),
            has_tilt_modes: false,
            lowest_lambda: None,
            is_in_line: false,
            base_polynomial: None,
        }
    }

    /// The topology with its fixed points before and after its masses, or all of them after.
    #[must_use]
    pub fn in_line(mut self, is_in_line: bool) -> Self {
        self.is_in_line = is_in_line;
        self
    }

    /// Mass of a MAT over the mean mass.
    pub fn mass_share(&self, mat: usize) -> f64 {
        self.shares.get(mat).copied().unwrap_or(1.0)
    }

    /// Whether no point is fixed, so that the body has a rigid mode.
    pub fn is_rigid(&self) -> bool {
        self.n_fixed == 0
    }

    /// y = K x of the network with springs of `factor`; x and y are (n_mat,).
    pub fn apply(&self, x: &[f64], y: &mut [f64]) {
        pull(&self.runs, self.n_mat, x, y);
    }
}

wide! {
    /// y = K x of springs between `n_mat` MATs and fixed points behind them.
    fn pull(runs: &[TopologyRun], n_mat: usize, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for run in runs {
            let TopologyRun {
                a, b, len, factor, ..
            } = *run;
            if a + len <= n_mat && b + len <= n_mat {
                // One loop for each end, so that no loop writes what it reads.
                let (xa, xb) = (&x[a..a + len], &x[b..b + len]);
                for (y, (xa, xb)) in y[a..a + len].iter_mut().zip(xa.iter().zip(xb)) {
                    *y += factor * (xa - xb);
                }
                for (y, (xa, xb)) in y[b..b + len].iter_mut().zip(xa.iter().zip(xb)) {
                    *y += factor * (xb - xa);
                }
                continue;
            }
            for i in 0..len {
                let at = |point: usize| x[..n_mat].get(point).copied().unwrap_or(0.0);
                let force = factor * (at(a + i) - at(b + i));
                for (point, force) in [(a + i, force), (b + i, -force)] {
                    if let Some(y) = y[..n_mat].get_mut(point) {
                        *y += force;
                    }
                }
            }
        }
    }
}

/// Collects links one by one into runs.
struct Links {
    runs: Vec<TopologyRun>,
}

impl Links {
    fn new() -> Self {
        Self { runs: Vec::new() }
    }

    fn join(&mut self, a: usize, b: usize, factor: f64) {
        self.join_bent(a, b, factor, true);
    }

    /// Adds a link of either sign of a body that resists bending; `hardens` is true only for links that stretch.
    fn join_bent(&mut self, a: usize, b: usize, factor: f64, hardens: bool) {
        let continues_run = |run: &TopologyRun| {
            (run.a + run.len, run.b + run.len) == (a, b) && (run.factor, run.hardens) == (factor, hardens)
        };
        match self.runs.last_mut() {
            Some(run) if continues_run(run) => run.len += 1,
            _ => self.runs.push(TopologyRun {
                a,
                b,
                len: 1,
                factor,
                hardens,
            }),
        }
    }
}
