//! Networks: what is.

use std::collections::HashMap;
use std::sync::Arc;

use ergon_engine::generator::{
    self, BankForm, Decay, GeneratorError, Place as MemberPlace, Shape, Topology,
};
use ergon_engine::network::{
    self, Bristle, But, Dry, ElementKind, Measure, ModeRange, PairLaw, PointGroup, SpaceLaw,
    SpacePoint, SpacePoints, Term, Tie,
};
use ergon_engine::scheme::{Means, Scheme, StabilityGuarantee};
use ergon_engine::units::Rate;
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::{Complexes, Numbers, load_numpy};
use crate::error::{from_engine, hertz, refused, word};
use crate::law::{Law, entry, named_row};
use crate::named::{Elements, LawUse, Mode, PartModes, Place};
use crate::words;
use crate::work::computing;

/// The decay of the lowest mode [s], or decays [s] at frequencies [Hz].
#[derive(FromPyObject)]
enum Decays {
    Lowest(f64),
    Points(Vec<(f64, f64)>),
}

/// What the links of a body are: tuned to a pitch and a decay, or K and Z of each.
enum Links {
    Tuned(f64, Option<Decays>),
    Given([f64; 2]),
}

impl Links {
    fn of(
        name: &str,
        f: Option<f64>,
        t60: Option<Decays>,
        k: Option<f64>,
        z: Option<f64>,
    ) -> PyResult<Self> {
        match (f, t60, k, z) {
            (Some(f), t60, None, None) => Ok(Self::Tuned(f, t60)),
            (None, None, Some(k), z) => Ok(Self::Given([k, z.unwrap_or(0.0)])),
            _ => Err(refused(
                name,
                "a body takes either f and t60 or K and Z of its links",
            )),
        }
    }
}

/// Two points in space by the MATs that are their coordinates, and how many axes they have.
fn points(name: &str, ends: [&[usize]; 2]) -> PyResult<([SpacePoint; 2], usize)> {
    let axes = ends[0].len();
    if !(2..=3).contains(&axes) || ends[1].len() != axes {
        let message = "a link in space joins points with two or three coordinates each";
        return Err(refused(name, message));
    }
    let behind = |end: &[usize], axis: usize| {
        let mat = end.get(axis).unwrap_or(&end[0]);
        (*mat as isize).wrapping_sub(end[0] as isize)
    };
    let ends = ends.map(|end| SpacePoint {
        first: end[0],
        offsets: [behind(end, 1), behind(end, 2)],
    });
    Ok((ends, axes))
}

/// (first, count, weight) of modules in an output.
type Ranges = Vec<(usize, usize, f64)>;

/// What is: MATs and LIAs with SI parameters, grouped into named parts.
#[pyclass(module = "ergon._core")]
#[derive(Default)]
pub(crate) struct Network(pub(crate) network::Network);

#[pymethods]
impl Network {
    #[new]
    fn new(py: Python<'_>) -> Self {
        load_numpy(py);
        Self::default()
    }

    #[getter]
    fn n_mat(&self) -> usize {
        self.0.n_mat()
    }

    #[getter]
    fn n_lia(&self) -> usize {
        self.0.n_lia()
    }

    #[getter]
    fn n_out(&self) -> usize {
        self.0.outputs().len()
    }

    /// What a hand on a MAT can reach, at rest, with every contact closed and every law a spring: (network, the MAT
    /// there, other hands that feel it).
    #[pyo3(signature = (mat, rate, *, held=Vec::new(), without=Vec::new(), ties=Vec::new(), factors=Vec::new(), depth=network::PRESS_DEPTH))]
    #[allow(clippy::too_many_arguments)]
    fn reachable_network(
        &self,
        py: Python<'_>,
        mat: usize,
        rate: f64,
        held: Vec<usize>,
        without: Vec<usize>,
        ties: Vec<(usize, f64, f64, f64)>,
        factors: Vec<(usize, f64)>,
        depth: f64,
    ) -> PyResult<ReachableNetwork> {
        self.there(mat)?;
        let moment = network::NetworkMoment {
            held,
            without,
            ties: ties
                .into_iter()
                .map(|(mat, k, z, m)| (mat, [k, z, m]))
                .collect(),
            factors,
        };
        let rate = hertz(rate)?;
        Ok(ReachableNetwork {
            reached: py.detach(|| self.0.reachable_network(mat, &moment, depth, rate.hertz())),
            rate,
        })
    }

    /// Start a part: modules added from now on belong to it.
    #[pyo3(signature = (name, *, ca_rate=None, macrostep=None))]
    fn part(&mut self, name: &str, ca_rate: Option<f64>, macrostep: Option<u32>) -> PyResult<()> {
        let ca_rate = ca_rate.map(hertz).transpose()?;
        self.0.part(name, ca_rate);
        if let Some(frames) = macrostep {
            self.0.macrostep(frames);
        }
        Ok(())
    }

    #[pyo3(signature = (name, *, M, X0=0.0, V0=0.0))]
    #[allow(non_snake_case)] // the field's names
    fn mas(&mut self, name: &str, M: f64, X0: f64, V0: f64) -> PyResult<usize> {
        self.0.mas(name, M, X0, V0).map_err(from_engine)
    }

    #[pyo3(signature = (name, *, X0=0.0))]
    #[allow(non_snake_case)]
    fn sol(&mut self, name: &str, X0: f64) -> PyResult<usize> {
        self.0.sol(name, X0).map_err(from_engine)
    }

    /// A MAS tied to the ground, by K and Z, or by its damped frequency f and decay t60.
    #[pyo3(signature = (name, *, M, K=None, Z=None, f=None, t60=None, X0=0.0, V0=0.0, rest=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn cel(
        &mut self,
        name: &str,
        M: f64,
        K: Option<f64>,
        Z: Option<f64>,
        f: Option<f64>,
        t60: Option<f64>,
        X0: f64,
        V0: f64,
        rest: f64,
    ) -> PyResult<usize> {
        let tie = match (K, Z, f, t60) {
            (k, z, None, None) => Tie::Physical {
                k: k.unwrap_or(0.0),
                z: z.unwrap_or(0.0),
            },
            (None, None, Some(f), t60) => Tie::Tuned { f, t60 },
            _ => {
                return Err(refused(name, "a CEL takes either K and Z or f and t60"));
            }
        };
        self.0.cel(name, M, tie, rest, X0, V0).map_err(from_engine)
    }

    /// Points in space, axis by axis: X0 and V0 have one value for each axis and point.
    #[pyo3(signature = (name, *, axes, M, X0, V0, Z=0.0, numbered=true))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn points(
        &mut self,
        name: &str,
        axes: usize,
        M: Vec<f64>,
        X0: Vec<f64>,
        V0: Vec<f64>,
        Z: f64,
        numbered: bool,
    ) -> PyResult<usize> {
        let points = SpacePoints {
            n_axes: axes,
            masses: &M,
            x0: &X0,
            v0: &V0,
            z: Z,
        };
        self.0.points(name, numbered, points).map_err(from_engine)
    }

    /// Gravity of g [m/s²] along the axis of `count` MATs from `first` on.
    fn weigh(&mut self, first: usize, count: usize, g: f64) -> PyResult<()> {
        if count == 0 {
            return Ok(());
        }
        self.there(first)?;
        self.there(first + count - 1)?;
        self.0.weigh(first..first + count, g).map_err(from_engine)
    }

    /// The distance of two points in space at the beginning [m]; each is the MATs that are its coordinates.
    fn distance(&self, a: Vec<usize>, b: Vec<usize>) -> PyResult<f64> {
        for &mat in a.iter().chain(&b) {
            self.there(mat)?;
        }
        let (ends, axes) = points("distance", [&a, &b])?;
        Ok(self.0.distance((ends[0], ends[1]), axes))
    }

    /// Springs between `count` pairs of points in space that follow one another; an end is the MATs that are the
    /// coordinates of its first point.
    /// Beyond the force `yields` [N] their rest length follows, and `breaks` [m] longer than it was they break.
    /// Beyond the distance `core` [m] their force falls as that of masses that attract each other.
    #[pyo3(signature = (name, a, b, *, rest, count=1, K=0.0, Z=0.0, yields=None, breaks=None, core=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn space_ref(
        &mut self,
        name: &str,
        a: Vec<usize>,
        b: Vec<usize>,
        rest: f64,
        count: usize,
        K: f64,
        Z: f64,
        yields: Option<f64>,
        breaks: Option<f64>,
        core: Option<f64>,
    ) -> PyResult<usize> {
        let law = match (core, yields, breaks) {
            (Some(core), None, None) => SpaceLaw::Attraction { core },
            (Some(_), ..) => {
                return Err(refused(name, "an attraction neither yields nor breaks"));
            }
            (None, None, None) => SpaceLaw::Spring,
            _ => SpaceLaw::Yielding {
                yields: yields.unwrap_or(f64::INFINITY),
                breaks: breaks.unwrap_or(f64::INFINITY),
            },
        };
        self.space(name, [&a, &b], count, law, [K, Z, rest])
    }

    /// Contacts between `count` pairs of points in space that follow one another, closed where they are nearer than `gap`.
    #[pyo3(signature = (name, a, b, *, gap, count=1, K=0.0, Z=0.0, exponent=1.0, clamp=false))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn space_but(
        &mut self,
        name: &str,
        a: Vec<usize>,
        b: Vec<usize>,
        gap: f64,
        count: usize,
        K: f64,
        Z: f64,
        exponent: f64,
        clamp: bool,
    ) -> PyResult<usize> {
        let law = SpaceLaw::Contact { exponent, clamp };
        self.space(name, [&a, &b], count, law, [K, Z, gap])
    }

    /// Contacts between all points of two groups, each (coordinates of its first point, count); the same group twice: between
    /// all its points. With `normal` they touch planes through the points of the first group, with `inside` they are held
    /// in spheres around these. `friction` is the coefficient of dry friction across a contact. With `core` [m] they attract
    /// each other.
    #[pyo3(signature = (name, a, b, *, gap=0.0, K=0.0, Z=0.0, exponent=1.0, clamp=false, inside=false, normal=None, friction=0.0, core=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn pairwise(
        &mut self,
        name: &str,
        a: (Vec<usize>, usize),
        b: (Vec<usize>, usize),
        gap: f64,
        K: f64,
        Z: f64,
        exponent: f64,
        clamp: bool,
        inside: bool,
        normal: Option<[f64; 3]>,
        friction: f64,
        core: Option<f64>,
    ) -> PyResult<usize> {
        let law = match core {
            Some(core) => SpaceLaw::Attraction { core },
            None => SpaceLaw::Contact { exponent, clamp },
        };
        let measure = match normal {
            Some(normal) => Measure::Plane(normal),
            None if inside => Measure::Within,
            None => Measure::Distance,
        };
        let own = PairLaw {
            measure,
            law,
            friction,
        };
        let (ends, axes) = points(name, [&a.0, &b.0])?;
        let groups = [(ends[0], a.1), (ends[1], b.1)].map(|(first, n)| PointGroup { first, n });
        self.0
            .pairwise(name, groups, axes, own, [K, Z, gap])
            .map_err(from_engine)
    }

    /// A row of MAS, tuned so that its lowest mode is f.
    #[pyo3(signature = (name, *, masses, M, f=None, t60=None, K=None, Z=None, ends="fixed", stiffness=0.0, inharmonicity=None, hardening=0.0, stretching=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn string(
        &mut self,
        py: Python<'_>,
        name: &str,
        masses: usize,
        M: f64,
        f: Option<f64>,
        t60: Option<Decays>,
        K: Option<f64>,
        Z: Option<f64>,
        ends: &str,
        stiffness: f64,
        inharmonicity: Option<f64>,
        hardening: f64,
        stretching: f64,
    ) -> PyResult<usize> {
        let ends = word("ends", ends, words::ENDS)?;
        let topology = computing(py, || match inharmonicity {
            None => generator::string(masses, ends, stiffness),
            Some(b) => generator::stiff_string(masses, ends, b),
        })?;
        let topology = topology.map(|topology| topology.in_line(stretching > 0.0));
        let links = Links::of(name, f, t60, K, Z)?;
        self.mesh(py, name, topology, M, &links, [hardening, stretching])
    }

    /// A mesh, tuned so that its lowest non-rigid mode is f.
    #[pyo3(signature = (name, *, shape="hex", radius=0, sides=None, M, f=None, t60=None, K=None, Z=None, rim="free", bending=None, hardening=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn plate(
        &mut self,
        py: Python<'_>,
        name: &str,
        shape: &str,
        radius: usize,
        sides: Option<(usize, usize)>,
        M: f64,
        f: Option<f64>,
        t60: Option<Decays>,
        K: Option<f64>,
        Z: Option<f64>,
        rim: &str,
        bending: Option<f64>,
        hardening: f64,
    ) -> PyResult<usize> {
        let shape = match sides {
            Some((across, up)) => Shape::Rectangle { across, up },
            None => word("shape", shape, words::SHAPES)?,
        };
        let rim = word("rim", rim, words::RIMS)?;
        let topology = computing(py, || match bending {
            None if shape == Shape::Disc => generator::round_membrane(radius, rim),
            None => generator::plate(shape, radius, rim),
            Some(poisson) => generator::bent_plate(shape, radius, rim, poisson),
        })?;
        let links = Links::of(name, f, t60, K, Z)?;
        self.mesh(py, name, topology, M, &links, [hardening, 0.0])
    }

    /// Many CELs with frequencies over a range.
    #[pyo3(signature = (name, *, count, M, f, t60, spread="even", place="line", hole=0.3, seed=0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn bank(
        &mut self,
        py: Python<'_>,
        name: &str,
        count: usize,
        M: f64,
        f: (f64, f64),
        t60: (f64, f64),
        spread: &str,
        place: &str,
        hole: f64,
        seed: i128,
    ) -> PyResult<usize> {
        let spread = word("spread", spread, words::SPREADS)?;
        let place = placed(place, hole)?;
        computing(py, || {
            self.0.bank(
                name,
                M,
                &BankForm {
                    count,
                    f,
                    t60,
                    spread,
                    place,
                },
                seed,
            )
        })?
        .map_err(from_engine)
    }

    /// CELs with a frequency, a decay and a mass each.
    #[pyo3(signature = (name, *, cells, place="line", hole=0.3))]
    fn cells(
        &mut self,
        py: Python<'_>,
        name: &str,
        cells: Vec<(f64, f64, f64)>,
        place: &str,
        hole: f64,
    ) -> PyResult<usize> {
        let place = placed(place, hole)?;
        let masses: Vec<f64> = cells.iter().map(|(_, _, mass)| *mass).collect();
        let tunings: Vec<(f64, f64)> = cells.iter().map(|(f, t60, _)| (*f, *t60)).collect();
        let cells = generator::cells_at(&tunings, place)
            .map_err(|error| from_engine(self.0.refused(name, &error.to_string())))?;
        computing(py, || self.0.cells(name, &masses, &cells))?.map_err(from_engine)
    }

    /// A body of which modes and their levels at places are known.
    #[pyo3(signature = (name, *, M, modes, levels))]
    #[allow(non_snake_case)]
    fn modal(
        &mut self,
        py: Python<'_>,
        name: &str,
        M: f64,
        modes: Vec<(f64, f64)>,
        levels: Vec<Vec<f64>>,
    ) -> PyResult<usize> {
        let places = levels.first().map_or(0, Vec::len);
        if levels.len() != modes.len() || levels.iter().any(|row| row.len() != places) {
            return Err(refused(name, "each mode has one level for each place"));
        }
        computing(py, || self.0.modal(name, M, &modes, &levels))?.map_err(from_engine)
    }

    /// The highest mode of a STRING or PLATE [Hz], by the index of its first MAT.
    fn highest_mode(&self, py: Python<'_>, first: usize) -> PyResult<f64> {
        self.there(first)?;
        computing(py, || self.0.highest_mode(first))
    }

    /// How many MATs the module that begins at index `first` has.
    fn count(&self, first: usize) -> usize {
        self.0.count(first)
    }

    /// Index of the middle MAT of the module that begins at `first`.
    fn centre(&self, first: usize) -> usize {
        self.0.centre(first)
    }

    /// Set the initial position and velocity of one MAT.
    #[allow(non_snake_case)]
    fn start(&mut self, index: usize, X0: f64, V0: f64) -> PyResult<()> {
        self.there(index)?;
        self.0.start(index, X0, V0).map_err(from_engine)
    }

    /// Where the MAT lies on the bench [m].
    fn position_of(&self, index: usize) -> PyResult<Place> {
        self.there(index)?;
        let [x, y] = self.0.mats().place[index];
        Ok(Place { x, y })
    }

    /// Spring and damper between two MATs.
    #[pyo3(signature = (name, a, b, *, K=0.0, Z=0.0, rest=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn r#ref(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        K: f64,
        Z: f64,
        rest: f64,
    ) -> PyResult<usize> {
        self.0.spring(name, a, b, K, Z, rest).map_err(from_engine)
    }

    /// One-sided contact of the striker a on b.
    #[pyo3(signature = (name, a, b, *, K=0.0, Z=0.0, gap=0.0, side="below", contact="plain", restitution=1.0, exponent=1.0, clamp=false, steps=2))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn but(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        K: f64,
        Z: f64,
        gap: f64,
        side: &str,
        contact: &str,
        restitution: f64,
        exponent: f64,
        clamp: bool,
        steps: u32,
    ) -> PyResult<usize> {
        let side = word("side", side, words::SIDES)?;
        let contact = word("contact", contact, words::CONTACTS)?;
        let but = But {
            k: K,
            z: Z,
            gap,
            side,
            contact,
            restitution,
            steps,
            exponent,
            clamp,
        };
        self.0.but(name, a, b, but).map_err(from_engine)
    }

    /// A friction with memory.
    #[pyo3(signature = (name, a, b, *, sigma0, Fc, sigma1=0.0, sigma2=0.0, Fs=None, vs=1e-3))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn bristle(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        sigma0: f64,
        Fc: f64,
        sigma1: f64,
        sigma2: f64,
        Fs: Option<f64>,
        vs: f64,
    ) -> PyResult<usize> {
        let bristle = Bristle {
            stiffness: sigma0,
            damping: sigma1,
            viscosity: sigma2,
            level: Fc,
            static_level: Fs.unwrap_or(Fc),
            speed: vs,
        };
        self.0.bristle(name, a, b, bristle).map_err(from_engine)
    }

    /// Dry friction that holds rigidly.
    #[pyo3(signature = (name, a, b, *, F, static_level=None, speed=1e-3))]
    #[allow(non_snake_case)]
    fn dry(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        F: f64,
        static_level: Option<f64>,
        speed: f64,
    ) -> PyResult<usize> {
        let dry = Dry {
            level: F,
            static_level: static_level.unwrap_or(F),
            speed,
        };
        self.0.dry(name, a, b, dry).map_err(from_engine)
    }

    /// A non-linear link.
    #[pyo3(signature = (name, a, b, law, *, rest=0.0))]
    fn lnl(&mut self, name: &str, a: usize, b: usize, law: &Law, rest: f64) -> PyResult<usize> {
        self.0
            .lnl(name, a, b, Arc::new(law.0.clone()), rest)
            .map_err(from_engine)
    }

    /// Every different law that can be native code.
    fn laws(&self) -> Vec<LawUse> {
        let laws = self.0.laws().into_iter();
        laws.map(|law| LawUse {
            rows: law.rows.iter().map(named_row).collect(),
            alone: law.alone,
            in_runs: law.in_runs,
        })
        .collect()
    }

    /// Let the law `laws()[index]` of each (index, address) be computed by native code there.
    fn native(&mut self, entries: Vec<(usize, usize)>) -> PyResult<()> {
        let laws = self.0.laws();
        let mut found = HashMap::new();
        for (index, address) in entries {
            let law = laws.get(index).filter(|_| address != 0);
            let law = law.ok_or_else(|| PyIndexError::new_err("no law has this index"))?;
            // SAFETY: `ergon.instruments.native`, the only caller, passes what it compiled of these rows.
            found.insert(law.rows.clone(), unsafe { entry(address) });
        }
        // SAFETY: as above; compiled code is kept until the process ends.
        unsafe { self.0.set_native(&found) };
        Ok(())
    }

    /// The MAT's position is imposed (ENX).
    fn impose(&mut self, index: usize) -> PyResult<()> {
        self.there(index)?;
        self.0.impose(index);
        Ok(())
    }

    /// An output: a weighted sum over ranges of modules; its speed (order 1) or acceleration (2).
    #[pyo3(signature = (name, *, positions=Vec::new(), forces=Vec::new(), ground_forces=Vec::new(), order=0))]
    fn listen(
        &mut self,
        name: &str,
        positions: Ranges,
        forces: Ranges,
        ground_forces: Ranges,
        order: u8,
    ) -> PyResult<usize> {
        let terms =
            |ranges: Ranges, term: fn((usize, usize, f64)) -> Term| ranges.into_iter().map(term);
        let all = terms(positions, |(first, len, weight)| Term::Position {
            first,
            len,
            weight,
        })
        .chain(terms(forces, |(first, len, weight)| Term::Force {
            first,
            len,
            weight,
        }))
        .chain(terms(ground_forces, |(first, len, weight)| Term::Ground {
            first,
            len,
            weight,
        }));
        self.0
            .listen_to(name, all.collect(), order)
            .map_err(from_engine)
    }

    /// A MAT as the composer wrote it.
    fn name_of(&self, index: usize) -> String {
        self.0.mat_name(index)
    }

    /// Lowest modes of a part.
    fn modes(&self, py: Python<'_>, part: &str, n_modes: usize) -> PyResult<Vec<Mode>> {
        let index = self.part_index(part)?;
        let tones = computing(py, || self.0.tones(index, n_modes))?;
        let tones = tones.map_err(|error| refused(part, error))?;
        let mode = |tone: &network::Tone| Mode {
            f: tone.f,
            t60: tone.t60,
        };
        Ok(tones.iter().map(mode).collect())
    }

    /// Modes of a part with their shapes: the lowest `count`, those up to `to` [Hz], or `count` around a frequency [Hz].
    #[pyo3(signature = (part, *, count=None, to=None, around=None))]
    fn part_modes(
        &self,
        py: Python<'_>,
        part: &str,
        count: Option<usize>,
        to: Option<f64>,
        around: Option<f64>,
    ) -> PyResult<PartModes> {
        load_numpy(py);
        let index = self.part_index(part)?;
        let frequency = |f: f64| {
            let is_one = f > 0.0 && f.is_finite();
            let refusal = || refused(part, "modes are asked for at frequencies above 0 Hz");
            if is_one { Ok(f) } else { Err(refusal()) }
        };
        let range = match (count, to, around) {
            (Some(count), None, None) => ModeRange::Lowest(count),
            (None, Some(to), None) => ModeRange::Below(frequency(to)?),
            (Some(count), None, Some(f)) => ModeRange::Around(frequency(f)?, count),
            _ => {
                let why = "modes are asked for by `count`, by `to`, or by `count` and `around`";
                return Err(refused(part, why));
            }
        };
        let found = computing(py, || self.0.part_modes(index, range))?;
        let found = found.map_err(|error| refused(part, error))?;
        let (n_modes, n_masses) = (found.poles.len(), found.mats.len());
        Ok(PartModes {
            poles: Complexes {
                values: found.poles,
                shape: vec![n_modes],
            },
            shapes: Complexes {
                values: found.shapes.concat(),
                shape: vec![n_modes, n_masses],
            },
            mats: found.mats,
            is_certified: found.is_certified,
            n_laws: found.n_laws,
            n_contacts: found.n_contacts,
        })
    }

    /// The masses and links of some parts by themselves.
    fn elements(&self, py: Python<'_>, parts: Vec<String>) -> PyResult<Elements> {
        load_numpy(py);
        let found = self.0.elements(&self.part_indices(&parts)?);
        let end = |at: usize| -> Numbers<i64> {
            let slot = |one: &network::Element| one.ends[at].map_or(-1, |slot| slot as i64);
            Numbers(found.each.iter().map(slot).collect())
        };
        let kind = |one: &network::Element| match one.kind {
            ElementKind::Tie => "CEL",
            ElementKind::Ref if one.z == 0.0 => "RES",
            ElementKind::Ref if one.k == 0.0 => "FRO",
            ElementKind::Ref => "REF",
            ElementKind::But => "BUT",
            ElementKind::Lnl => "LNL",
            ElementKind::Bristle => "BRISTLE",
            ElementKind::Dry => "DRY",
            ElementKind::Space => "SPACE",
        };
        Ok(Elements {
            kinds: found.each.iter().map(kind).collect(),
            a: end(0),
            b: end(1),
            stiffness: Numbers(found.each.iter().map(|one| one.k).collect()),
            damping: Numbers(found.each.iter().map(|one| one.z).collect()),
            n_held: found.n_held,
            ca_rate: found.ca_rate.map(Rate::hertz),
            mats: found.mats,
            masses: Numbers(found.m),
        })
    }

    /// Velocities of points over a force at one, of some parts by themselves   (n_heard, n_frequencies).
    fn admittance(
        &self,
        py: Python<'_>,
        parts: Vec<String>,
        forced: Vec<usize>,
        heard: Vec<Vec<usize>>,
        frequencies: Vec<f64>,
    ) -> PyResult<Complexes> {
        load_numpy(py);
        let indices = self.part_indices(&parts)?;
        if !frequencies.iter().all(|f| *f > 0.0 && f.is_finite()) {
            let why = "an admittance is asked for at frequencies above 0 Hz";
            return Err(refused(&parts.join(" + "), why));
        }
        let shape = vec![heard.len(), frequencies.len()];
        let values = computing(py, || {
            self.0.admittance(&indices, &forced, &heard, &frequencies)
        })?;
        Ok(Complexes { values, shape })
    }

    /// Whether the CA scheme is stable at `rate`.
    fn certify(&self, py: Python<'_>, rate: f64) -> PyResult<Certificate> {
        let rate = hertz(rate)?;
        let certificate = computing(py, || Scheme::new(&self.0, rate)?.certify(&self.0))?;
        let certificate = certificate.map_err(from_engine)?;
        Ok(Certificate {
            lambda_max: certificate.lambda_max,
            method: match certificate.means {
                Means::Gershgorin => "gershgorin",
                Means::Dense => "dense",
                Means::Lanczos => "lanczos",
            },
            guarantee: match certificate.word {
                StabilityGuarantee::Proved => "proved",
                StabilityGuarantee::Guarded => "guarded",
                StabilityGuarantee::Tried => "tried",
            },
            oversampling: certificate.oversampling(),
        })
    }
}

/// How the members of a bank lie, by its word; `hole` is that of a galaxy.
fn placed(place: &str, hole: f64) -> PyResult<MemberPlace> {
    Ok(match word("place", place, words::PLACES)? {
        MemberPlace::Galaxy { .. } => MemberPlace::Galaxy { hole },
        other => other,
    })
}

impl Network {
    fn part_index(&self, part: &str) -> PyResult<usize> {
        let index = self.0.parts().iter().position(|known| known.name == part);
        index.ok_or_else(|| refused(part, "no part has this name"))
    }

    fn part_indices(&self, parts: &[String]) -> PyResult<Vec<usize>> {
        parts.iter().map(|part| self.part_index(part)).collect()
    }

    fn mesh(
        &mut self,
        py: Python<'_>,
        name: &str,
        topology: Result<Topology, GeneratorError>,
        mass: f64,
        links: &Links,
        laws: [f64; 2],
    ) -> PyResult<usize> {
        let topology =
            topology.map_err(|error| from_engine(self.0.refused(name, &error.to_string())))?;
        computing(py, || match links {
            Links::Given(kz) => self.0.linked_mesh(name, &topology, mass, *kz, laws),
            Links::Tuned(f, decays) => {
                let decay = match decays {
                    None => Decay::Lowest(None),
                    Some(Decays::Lowest(t60)) => Decay::Lowest(Some(*t60)),
                    Some(Decays::Points(points)) => Decay::Points(points),
                };
                self.0
                    .stretched_mesh(name, &topology, mass, *f, decay, laws)
            }
        })?
        .map_err(from_engine)
    }

    fn space(
        &mut self,
        name: &str,
        ends: [&[usize]; 2],
        count: usize,
        law: SpaceLaw,
        numbers: [f64; 3],
    ) -> PyResult<usize> {
        let (ends, axes) = points(name, ends)?;
        self.0
            .space_links(name, (ends[0], ends[1]), count, axes, law, numbers)
            .map_err(from_engine)
    }

    fn there(&self, index: usize) -> PyResult<()> {
        if index < self.0.n_mat() {
            return Ok(());
        }
        Err(refused(
            &format!("#{index}"),
            format!("there are {} MATs", self.0.n_mat()),
        ))
    }
}

/// The part of a network that a hand can move, linear and at rest.
#[pyclass(frozen, module = "ergon._core")]
pub(crate) struct ReachableNetwork {
    reached: network::ReachableNetwork,
    rate: Rate,
}

#[pymethods]
impl ReachableNetwork {
    /// Number of other hands that feel this hand.
    #[getter]
    fn others(&self) -> usize {
        self.reached.others
    }

    /// Bytes that determine the response.
    fn key<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let mut bytes = self.reached.network.numbers();
        bytes.extend((self.reached.mat as u64).to_le_bytes());
        bytes.extend(self.rate.hertz().to_le_bytes());
        PyBytes::new(py, &bytes)
    }

    /// Force against the hand [N/m] in each tick after it was 1 m away for one tick, (n_ticks,).
    fn response<'py>(
        &self,
        py: Python<'py>,
        tick_frames: u32,
        ticks: [usize; 2],
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let found = py.detach(|| self.reached.response(self.rate, tick_frames, ticks));
        Ok(found
            .map_err(from_engine)?
            .map(|felt| felt.into_pyarray(py)))
    }
}

/// A stability certificate.
#[pyclass(frozen, get_all, module = "ergon._core")]
pub(crate) struct Certificate {
    lambda_max: f64,
    method: &'static str,
    guarantee: &'static str,
    oversampling: u32,
}
