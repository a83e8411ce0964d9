//! LNL: laws of non-linear elasticity and friction, f = law(d) + damping(d, v).
//!
//! A law is an expression in a small language, or a table of points, compiled once. `d` is the link's elongation [m],
//! `v` its rate [m/s] (metres per sample where units are algorithmic), the value a force [N].

mod error;
mod native;
mod noise;
mod parse;
mod points;
mod polynomial;
mod potential;
mod program;
mod runs;
mod table;
mod tangents;
#[cfg(test)]
mod tests;
mod token;
mod tree;

pub use error::{LawError, LawField};
pub use native::{Entry, FUNCTIONS, Function, NATIVE_LANES};
pub use parse::Constants;
pub use runs::Scratch;
pub use table::Row;

use std::fmt;
use std::sync::{Arc, OnceLock};

use points::Points;
use program::Program;
pub(crate) use tangents::{PLACES, Places, TangentScratch};

/// Relative step of the numerical slopes: the cube root of the rounding unit balances truncation and rounding of a
/// central difference.
const SLOPE_STEP: f64 = 6e-6;
/// Absolute step at rest: 1 nm, or 1 nm/s, far below what is heard and far above the rounding of a force around zero.
const SLOPE_STEP_AT_REST: f64 = 1e-9;

/// A law, ready to run.
///
/// ```
/// use ergon_engine::law::{Law, LawText};
///
/// let text = LawText { law: Some("k*d + q*d**3"), constants: [("k".into(), 2e3), ("q".into(), 1e8)].into(),
/// ..LawText::default() }; let law = Law::new(&text)?; assert_eq!(law.force(1e-3, 0.0), 2e3 * 1e-3 + 1e8 * 1e-3 * (1e-3
/// * 1e-3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, PartialEq)]
pub struct Law {
    elastic: Elastic,
    damping: Option<Program>,
    reach: f64,
    hardening: Option<Hardening>,
    /// q of the force q·S·d, where S is the sum of the squares of all elongations of its run [N/m³]; 0 for a law of one
    /// link.
    shared: f64,
    native: Option<native::Native>,
    /// Whether it has constants that may change.
    is_open: bool,
    asked: ActivityCache,
}

/// The first question to [`Law::is_active`] (which includes the law's reach) and its answer, because a session asks all
/// laws at each of its lines. Copies of a law share it.
#[derive(Clone, Debug, Default)]
struct ActivityCache(Arc<OnceLock<(ActivityQuery, bool)>>);

/// A law's reach, and the greatest elongation and rate in question, as bits.
type ActivityQuery = [u64; 3];

impl fmt::Debug for Law {
    /// Leaves out what changes no bit of a force, because networks are identified by their `Debug` output.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            elastic,
            damping,
            reach,
            hardening,
            shared,
            native: _,
            is_open,
            asked: _,
        } = self;
        f.debug_struct("Law")
            .field("elastic", elastic)
            .field("damping", damping)
            .field("reach", reach)
            .field("hardening", hardening)
            .field("shared", shared)
            .field("is_open", is_open)
            .finish()
    }
}

impl PartialEq for ActivityCache {
    /// Always equal, because the answer follows from the law.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// The constants of a hardening spring, f = k·d + q·d³ + z·v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hardening {
    /// Stiffness [N/m].
    pub(crate) k: f64,
    /// Hardening [N/m³].
    pub(crate) q: f64,
    /// Damping [N·s/m]; None: the force does not depend on the rate.
    pub(crate) z: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
enum Elastic {
    None,
    /// `integral`: coefficients of the integral of a polynomial, from the first power of d on.
    Expression {
        program: Program,
        integral: Option<Vec<f64>>,
    },
    Points(Points),
}

/// The source of a law; see [`Law::new`].
#[derive(Clone, Debug, Default)]
pub struct LawText<'a> {
    /// The elastic part, an expression of `d`.
    pub law: Option<&'a str>,
    /// The damping part, an expression of `d` and `v`.
    pub damping: Option<&'a str>,
    /// Named constants of both, in SI units.
    pub constants: Constants,
    /// The elastic part as points (d [m], f [N]), d rising.
    pub points: Option<&'a [(f64, f64)]>,
    /// Those of the constants that [`Law::set`] can change, in the order of their numbers.
    pub open: &'a [String],
}

impl Law {
    /// Compile a law: an expression or points, a damping, or both an elastic part and a damping.
    ///
    /// # Errors
    /// [`LawError`] with the place, in characters of the text at fault.
    pub fn new(text: &LawText<'_>) -> Result<Self, LawError> {
        check_constants(&text.constants)?;
        let parse_text = |field, expression| parse::parse(field, expression, &text.constants, text.open);
        let elastic = match (text.law, text.points) {
            (Some(_), Some(_)) => {
                let message = "A law is given by an expression or by points, not by both.";
                return Err(LawError::new(LawField::Points, 0, 0, message.into()));
            }
            (Some(expression), None) => {
                let syntax_tree = parse_text(LawField::Law, expression)?;
                Elastic::Expression {
                    program: Program::new(&syntax_tree),
                    integral: polynomial::coefficients(&syntax_tree).map(polynomial::integral),
                }
            }
            (None, Some(points)) => Elastic::Points(Points::new(points)?),
            (None, None) if text.damping.is_some() => Elastic::None,
            (None, None) => {
                let message = "An LNL needs a `law`, a `damping` or `points`.";
                return Err(LawError::new(LawField::Law, 0, 0, message.into()));
            }
        };
        let damping = text
            .damping
            .map(|expression| parse_text(LawField::Damping, expression))
            .transpose()?;
        Ok(Self {
            elastic,
            damping: damping.as_ref().map(Program::new),
            reach: 1.0,
            hardening: None,
            shared: 0.0,
            native: None,
            is_open: !text.open.is_empty(),
            asked: ActivityCache::default(),
        })
    }

    /// Set an open constant to another value, in SI units; `slot` is its number among the open constants.
    ///
    /// ```
    /// use ergon_engine::law::{Law, LawText};
    ///
    /// let constants = [("k".into(), 100.0), ("q".into(), 1e6)].into();
    /// let open = ["k".to_owned()];
    /// let mut law = Law::new(&LawText { law: Some("k*d + q*d**3"), constants, open: &open, ..LawText::default() })?;
    /// law.set(0, 200.0);
    /// assert_eq!(law.force(1e-3, 0.0), 200.0 * 1e-3 + 1e6 * (1e-3 * 1e-3 * 1e-3));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn set(&mut self, slot: usize, value: f64) {
        if let Elastic::Expression { program, .. } = &mut self.elastic {
            program.set(slot, value);
        }
        if let Some(damping) = &mut self.damping {
            damping.set(slot, value);
        }
    }

    /// The tension that stretching adds to all links of a run alike: the force q·S·d, where S is the sum of the squares
    /// of all their elongations (Kirchhoff 1876, Carrier 1945) and `q` >= 0 [N/m³]. It stores the energy ¼·q·S².
    pub fn shared(q: f64) -> Self {
        Self {
            elastic: Elastic::None,
            damping: None,
            reach: 1.0,
            hardening: None,
            shared: q,
            native: None,
            is_open: false,
            asked: ActivityCache::default(),
        }
    }

    /// The stiffness that all links of a run share [N/m], if `squares` is the sum of the squares of their elongations;
    /// 0 for a law of one link.
    pub(crate) fn tension(&self, squares: f64) -> f64 {
        self.shared * squares
    }

    /// Whether the force of a link depends on the whole run.
    pub(crate) fn is_shared(&self) -> bool {
        self.shared != 0.0
    }

    /// The law k·d + q·d³ of a hardening spring (k [N/m], q [N/m³]) with a damper z [N·s/m].
    ///
    /// ```
    /// use ergon_engine::law::Law;
    ///
    /// let law = Law::hardening(2e3, 1e8, 0.1)?;
    /// assert!(law.slope(1e-3) > law.slope(0.0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`LawError`] if a constant is not finite.
    pub fn hardening(k: f64, q: f64, z: f64) -> Result<Self, LawError> {
        let named_constants = [("k", k), ("q", q), ("z", z)];
        let z = (z != 0.0).then_some(z);
        let parsed_law = Self::new(&LawText {
            law: Some("k*d + q*d**3"),
            damping: z.map(|_| "z*v"),
            constants: named_constants.map(|(name, value)| (name.to_owned(), value)).into(),
            ..LawText::default()
        })?;
        Ok(Self {
            hardening: Some(Hardening { k, q, z }),
            ..parsed_law
        })
    }

    /// The constants of a hardening spring without a lever. Kernels compute it directly, because a mesh has thousands
    /// of them.
    pub(crate) fn hardening_spring(&self) -> Option<Hardening> {
        self.hardening.filter(|_| self.reach == 1.0)
    }

    /// The law behind a lever that multiplies travel by s = `reach`: f(d/s, v/s)/s.
    ///
    /// ```
    /// use ergon_engine::law::Law;
    ///
    /// let law = Law::hardening(2e3, 0.0, 0.0)?.behind_lever(2.0)?;
    /// assert_eq!(law.force(2e-3, 0.0), 1.0); // 1 mm behind the lever: 2 N there, 1 N here
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`LawError`] unless `reach` is a positive number.
    pub fn behind_lever(mut self, reach: f64) -> Result<Self, LawError> {
        if !(reach > 0.0 && reach.is_finite()) {
            let message = format!("A reach is a positive number, not {reach}.");
            return Err(LawError::new(LawField::Reach, 0, 0, message));
        }
        self.reach *= reach;
        Ok(self)
    }

    /// Force [N] at elongation `d` [m] and its rate `v` [m/s].
    pub fn force(&self, d: f64, v: f64) -> f64 {
        let (d, v) = (d / self.reach, v / self.reach);
        let elastic = self.elastic(d);
        let law_force = match &self.damping {
            Some(damping) => elastic + damping.value(d, v),
            None => elastic,
        };
        law_force / self.reach
    }

    /// The elastic part of the force [N] at elongation `d` [m].
    pub fn spring(&self, d: f64) -> f64 {
        self.elastic(d / self.reach) / self.reach
    }

    fn elastic(&self, d: f64) -> f64 {
        match &self.elastic {
            Elastic::None => 0.0,
            Elastic::Expression { program, .. } => program.value(d, 0.0),
            Elastic::Points(points) => points.value(d),
        }
    }

    /// Energy stored at elongation `d` [J], zero at 0: the integral of the elastic part.
    ///
    /// Exact for points and for polynomials; to some 1e-13 of ∫|f| for other expressions.
    ///
    /// ```
    /// use ergon_engine::law::Law;
    ///
    /// let law = Law::hardening(2e3, 0.0, 0.0)?;
    /// assert!((law.potential(1e-3) - 0.5 * 2e3 * 1e-6).abs() < 1e-15);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn potential(&self, d: f64) -> f64 {
        let d = d / self.reach;
        match &self.elastic {
            Elastic::None => 0.0,
            Elastic::Expression {
                integral: Some(integral),
                ..
            } => polynomial::value(integral, d) * d,
            Elastic::Expression { program, .. } => potential::integrate(|d| program.value(d, 0.0), d),
            Elastic::Points(points) => points.potential(d),
        }
    }

    /// Work against the elastic part from elongation `from` to `to` [J]. The path need not include 0, where a law may
    /// be infinite.
    pub(crate) fn work(&self, from: f64, to: f64) -> f64 {
        let (start_elongation, end_elongation) = (from / self.reach, to / self.reach);
        match &self.elastic {
            Elastic::Expression {
                program,
                integral: None,
            } => potential::integrate(
                |d| program.value(start_elongation + d, 0.0),
                end_elongation - start_elongation,
            ),
            _ => self.potential(to) - self.potential(from),
        }
    }

    /// Tangent stiffness of the elastic part at `d` [N/m]: exact for points, otherwise a central difference over
    /// ±(6e-6·|d| + 1 nm).
    pub fn slope(&self, d: f64) -> f64 {
        let d = d / self.reach;
        let slope = match &self.elastic {
            Elastic::None => 0.0,
            Elastic::Expression { program, .. } => {
                let difference_step = SLOPE_STEP * d.abs() + SLOPE_STEP_AT_REST;
                let (elongation_below, elongation_above) = (d - difference_step, d + difference_step);
                (program.value(elongation_above, 0.0) - program.value(elongation_below, 0.0))
                    / (elongation_above - elongation_below)
            }
            Elastic::Points(points) => points.slope(d),
        };
        slope / self.reach / self.reach
    }

    /// The largest elongation [m], either way, up to which no tangent is stiffer than `stiffness` [N/m]; infinite if
    /// there is no stiffer tangent.
    ///
    /// It is exact for points; other laws are sampled at 16 places an octave, from 1 nm on.
    pub(crate) fn elongation_at_slope(&self, stiffness: f64) -> f64 {
        const OCTAVE: i32 = 16;
        const OCTAVES: i32 = 44; // to 17 km
        if let Elastic::Points(points) = &self.elastic {
            let stiffness = stiffness * self.reach * self.reach;
            return points.distance_to_steeper(stiffness) * self.reach;
        }
        let is_stiffer = |d: &f64| [*d, -d].iter().any(|&d| self.slope(d) > stiffness);
        let sampled_places = (0..=OCTAVE * OCTAVES)
            .map(|i| SLOPE_STEP_AT_REST * crate::maths::pow(2.0, f64::from(i) / f64::from(OCTAVE)));
        let mut place_before = 0.0;
        for d in sampled_places {
            if is_stiffer(&d) {
                return place_before;
            }
            place_before = d;
        }
        f64::INFINITY
    }

    /// Slope of the damping in v, at elongation `d` and v = 0 [N·s/m]: a central difference over
    /// ±1 nm/s.
    pub fn damping_slope(&self, d: f64) -> f64 {
        let Some(damping) = &self.damping else {
            return 0.0;
        };
        let (d, rate_step) = (d / self.reach, SLOPE_STEP_AT_REST);
        let rate_slope = (damping.value(d, rate_step) - damping.value(d, -rate_step)) / (2.0 * rate_step);
        rate_slope / self.reach / self.reach
    }

    /// Whether its force far from rest is small compared with its slopes at rest, as that of a bow is: motion that
    /// these slopes excite stays bounded.
    pub(crate) fn is_bounded_far_from_rest(&self) -> bool {
        const PROBE_DISTANCE: f64 = 1e3; // [m], [m/s]
        const SMALL_RATIO: f64 = 0.01;
        let is_small = |far: f64, slope: f64| (far / PROBE_DISTANCE).abs() <= SMALL_RATIO * slope.abs();
        [PROBE_DISTANCE, -PROBE_DISTANCE].iter().all(|&far| {
            is_small(self.spring(far), self.slope(0.0)) && is_small(self.drag(0.0, far), self.damping_slope(0.0))
        })
    }

    /// Whether damping·v < 0 somewhere in |d| ≤ `d_max` [m], |v| ≤ `v_max` [m/s]: the link can then supply energy, as a
    /// bow does.
    ///
    /// The damping is sampled on a grid of 33 elongations and 192 rates. Rates are spaced evenly and also by octaves,
    /// down to a millionth of `v_max`, because sticking happens at low rates. A damping that is NaN counts as active.
    ///
    /// ```
    /// use ergon_engine::law::{Law, LawText};
    ///
    /// let damped = |damping| Law::new(&LawText { damping: Some(damping), ..LawText::default() });
    /// assert!(!damped("0.1*v")?.is_active(1e-3, 1.0));
    /// assert!(damped("-0.1*v")?.is_active(1e-3, 1.0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn is_active(&self, d_max: f64, v_max: f64) -> bool {
        let activity_query: ActivityQuery = [self.reach, d_max, v_max].map(f64::to_bits);
        let computed_answer = || (activity_query, self.gives_energy(d_max, v_max));
        let cached_answer = self.asked.0.get_or_init(computed_answer);
        if cached_answer.0 == activity_query && !self.is_open {
            cached_answer.1
        } else {
            self.gives_energy(d_max, v_max)
        }
    }

    fn gives_energy(&self, d_max: f64, v_max: f64) -> bool {
        const ELONGATIONS: i32 = 16;
        const EVEN: i32 = 75;
        const OCTAVES: usize = 21;
        let Some(damping) = &self.damping else {
            return false;
        };
        let octaves = std::iter::successors(Some(v_max), |v| Some(0.5 * v)).take(OCTAVES);
        let even_rates = (1..=EVEN).map(|i| v_max * f64::from(i) / f64::from(EVEN));
        let tried_rates: Vec<f64> = even_rates.chain(octaves).flat_map(|v| [v, -v]).collect();
        (-ELONGATIONS..=ELONGATIONS).any(|i| {
            let d = d_max * f64::from(i) / f64::from(ELONGATIONS);
            tried_rates.iter().any(|v| {
                let damping_power = damping.value(d / self.reach, v / self.reach) * v;
                damping_power.is_nan() || damping_power < 0.0
            })
        })
    }
}

fn check_constants(constants: &Constants) -> Result<(), LawError> {
    for (name, value) in constants {
        let message = if parse::is_reserved(name) {
            format!("`{name}` already has a meaning in laws; give the constant another name.")
        } else if !value.is_finite() {
            format!("The constant `{name}` is not a finite number.")
        } else {
            continue;
        };
        return Err(LawError::new(LawField::Constants, 0, 0, message));
    }
    Ok(())
}
