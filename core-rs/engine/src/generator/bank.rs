//! BANK: CELs side by side, each with its own pitch and decay.

use std::f64::consts::TAU;

use super::{GeneratorError, MAX_MASSES, check_count, positive};
use crate::interrupt;
use crate::maths::{cos, exp, log, sin, sqrt};

/// How pitches and decays are spread over their ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Pitches even by logarithm, rising; decays from the longest (lowest pitch) to the shortest.
    Even,
    /// Both drawn at random by logarithm, for each member independently.
    Random,
}

/// In which directions from the middle the members of a galaxy lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Angles {
    /// Each turned from the one before by the golden angle, so that no two lie close together.
    Even,
    /// Drawn at random, for each member independently.
    Random,
}

/// How members lie on the picture of the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// In a row of 1 m, evenly.
    Line,
    /// On a sunflower's spiral that fills a disc of 1 m evenly (H. Vogel, Math. Biosci. 44, 1979).
    Spiral,
    /// By pitch on a disc of 1 m: the lowest at the rim, the highest around a hole. The radius is inversely
    /// proportional to the cents above a pitch below the lowest one, which the hole determines.
    Galaxy {
        /// Radius of the highest pitch over that of the lowest, above 0 and at most 1.
        hole: f64,
        /// Where around the middle the members lie.
        angles: Angles,
    },
}

impl Place {
    /// (x, y) [m] of member `i` of `count`; `rise` is its pitch on a logarithmic scale from the lowest (0) to the
    /// highest (1). `turn` draws a part of a whole turn from [0, 1), where angles are random.
    pub fn position(self, i: usize, count: usize, rise: f64, turn: impl FnOnce(usize) -> f64) -> [f64; 2] {
        let rank_share = (i as f64 + 0.5) / count as f64;
        let place_radius = match self {
            Self::Line => return [rank_share - 0.5, 0.0],
            Self::Spiral => 0.5 * sqrt(rank_share),
            Self::Galaxy { hole, .. } => 0.5 * hole / (hole + (1.0 - hole) * rise),
        };
        let angle = match self {
            Self::Galaxy {
                angles: Angles::Random, ..
            } => TAU * turn(i),
            _ => GOLDEN_ANGLE * i as f64,
        };
        [place_radius * cos(angle), place_radius * sin(angle)]
    }

    fn check(self) -> Result<(), GeneratorError> {
        match self {
            Self::Galaxy { hole, .. } if !(hole > 0.0 && hole <= 1.0) => Err(GeneratorError::Range {
                what: "`hole`",
                range: "above 0 and at most 1",
                got: hole,
            }),
            _ => Ok(()),
        }
    }
}

/// The parameters of a bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankForm {
    /// How many members.
    pub count: usize,
    /// Lowest and highest pitch [Hz].
    pub f: (f64, f64),
    /// Shortest and longest decay [s].
    pub t60: (f64, f64),
    /// How pitches and decays are spread.
    pub spread: Spread,
    /// Where members lie.
    pub place: Place,
}

/// One member.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankCell {
    /// Damped frequency [Hz].
    pub f: f64,
    /// Decay [s].
    pub t60: f64,
    /// (x, y) [m]
    pub position: [f64; 2],
}

/// Members between two polls of an interruption.
const POLL_EVERY: usize = 1024;
/// π(3 - √5): the angle between one seed of a sunflower and the next.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// The members of a bank. `draw(member)` returns two numbers from [0, 1), for pitch and decay; it is called once for
/// each member in turn, and only if the spread is random. `turn(member)` returns one, for a random angle.
///
/// ```
/// use ergon_engine::generator::{BankForm, Place, Spread, bank};
///
/// let form = BankForm { count: 3, f: (200.0, 800.0), t60: (1.0, 4.0), spread: Spread::Even, place: Place::Line };
/// let cells = bank(&form, |_| (0.0, 0.0), |_| 0.0)?; // an even bank draws nothing
/// assert_eq!((cells[0].f, cells[0].t60), (200.0, 4.0));
/// assert!((cells[1].f - 400.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Numbers out of range.
pub fn bank(
    form: &BankForm,
    mut draw: impl FnMut(usize) -> (f64, f64),
    mut turn: impl FnMut(usize) -> f64,
) -> Result<Vec<BankCell>, GeneratorError> {
    check_count("`count`", form.count, 1, MAX_MASSES)?;
    range("`f`", form.f)?;
    range("`t60`", form.t60)?;
    form.place.check()?;
    let member_count = form.count as f64;
    let make_member = |i: usize| {
        if i.is_multiple_of(POLL_EVERY) {
            interrupt::poll();
        }
        let (pitch_share, decay_share) = match form.spread {
            Spread::Random => draw(i),
            Spread::Even if form.count == 1 => (0.0, 1.0),
            Spread::Even => (i as f64 / (member_count - 1.0), 1.0 - i as f64 / (member_count - 1.0)),
        };
        BankCell {
            f: interpolate(form.f, pitch_share),
            t60: interpolate(form.t60, decay_share),
            position: form.place.position(i, form.count, pitch_share, &mut turn),
        }
    };
    Ok((0..form.count).map(make_member).collect())
}

/// Members with a frequency [Hz] and a decay [s] each. `turn` is that of [`bank`].
///
/// ```
/// use ergon_engine::generator::{Angles, Place, cells_at};
///
/// let place = Place::Galaxy { hole: 0.3, angles: Angles::Even };
/// let cells = cells_at(&[(100.0, 1.0), (400.0, 1.0)], place, |_| 0.0)?;
/// assert_eq!(cells[0].position, [0.5, 0.0]); // the lowest at the rim
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A place with a number out of range.
pub fn cells_at(
    tunings: &[(f64, f64)],
    place: Place,
    mut turn: impl FnMut(usize) -> f64,
) -> Result<Vec<BankCell>, GeneratorError> {
    place.check()?;
    let (lowest_frequency, highest_frequency) = tunings.iter().fold(
        (f64::INFINITY, 0.0f64),
        |(lowest_frequency, highest_frequency), (f, _)| (lowest_frequency.min(*f), highest_frequency.max(*f)),
    );
    let pitch_rise = |f: f64| {
        if highest_frequency > lowest_frequency {
            log(f / lowest_frequency) / log(highest_frequency / lowest_frequency)
        } else {
            0.0
        }
    };
    let placed_cell = |(i, &(f, t60)): (usize, &(f64, f64))| BankCell {
        f,
        t60,
        position: place.position(i, tunings.len(), pitch_rise(f), &mut turn),
    };
    Ok(tunings.iter().enumerate().map(placed_cell).collect())
}

fn range(what: &'static str, (low, high): (f64, f64)) -> Result<(), GeneratorError> {
    positive(what, low)?;
    positive(what, high)?;
    if low <= high {
        return Ok(());
    }
    Err(GeneratorError::Range {
        what,
        range: "a range from low to high",
        got: low,
    })
}

/// low·(high/low)^u, within the range and exact at both ends.
fn interpolate((low, high): (f64, f64), u: f64) -> f64 {
    match u {
        0.0 => low,
        1.0 => high,
        _ => (low * exp(u * log(high / low))).clamp(low, high),
    }
}
