//! Networks: MATs and LIAs.

mod bodies;
mod links;
mod masses;
mod reachable;
mod space;

pub(crate) use reachable::ReachableNetwork;

use ergon_engine::interrupt;
use ergon_engine::network::{self, ElementKind, ModeRange, Term};
use ergon_engine::scheme::{BoundMethod, Scheme, StabilityGuarantee};
use ergon_engine::units::Rate;
use pyo3::prelude::*;

use crate::arrays::{ComplexArray, NumberArray, load_numpy};
use crate::error::{from_engine, hertz, module_error};
use crate::named::{Elements, Mode, PartModes, Place};
use crate::work::computing;

/// (first, count, weight) of modules in an output.
type Ranges = Vec<(usize, usize, f64)>;

/// MATs and LIAs with SI parameters, grouped into named parts.
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

    /// The part of the network that a hand on a MAT can move, at `rate` [Hz]: at rest, with every contact closed and
    /// every law replaced by the stiffest spring that it is within `depth` [m].
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
        self.check_mat(mat)?;
        let network_moment = network::NetworkMoment {
            held_mats: held,
            disabled_links: without,
            ties: ties.into_iter().map(|(mat, k, z, m)| (mat, [k, z, m])).collect(),
            link_factors: factors,
        };
        let rate = hertz(rate)?;
        Ok(ReachableNetwork {
            reached: computing(py, || {
                self.0.reachable_network(mat, &network_moment, depth, rate.hertz())
            })?,
            rate,
        })
    }

    /// Start a part: modules added from now on belong to it.
    #[pyo3(signature = (name, *, ca_rate=None, macrostep=None))]
    fn part(&mut self, name: &str, ca_rate: Option<f64>, macrostep: Option<u32>) -> PyResult<()> {
        let ca_rate = ca_rate.map(hertz).transpose()?;
        self.0.part(name, ca_rate);
        if let Some(macrostep_frames) = macrostep {
            self.0.macrostep(macrostep_frames);
        }
        Ok(())
    }

    /// Place of the MAT on the bench [m].
    fn position_of(&self, index: usize) -> PyResult<Place> {
        self.check_mat(index)?;
        let [x, y] = self.0.mats().bench_position[index];
        Ok(Place { x, y })
    }

    /// An output: a weighted sum over ranges of modules, differentiated `order` times by time; its index.
    #[pyo3(signature = (name, *, positions=Vec::new(), forces=Vec::new(), ground_forces=Vec::new(), lengths=Vec::new(), order=0))]
    fn listen(
        &mut self,
        name: &str,
        positions: Ranges,
        forces: Ranges,
        ground_forces: Ranges,
        lengths: Ranges,
        order: u8,
    ) -> PyResult<usize> {
        let range_terms = |ranges: Ranges, term: fn((usize, usize, f64)) -> Term| ranges.into_iter().map(term);
        let output_terms = range_terms(positions, |(first, len, weight)| Term::Position { first, len, weight })
            .chain(range_terms(forces, |(first, len, weight)| Term::Force {
                first,
                len,
                weight,
            }))
            .chain(range_terms(ground_forces, |(first, len, weight)| Term::Ground {
                first,
                len,
                weight,
            }))
            .chain(range_terms(lengths, |(first, len, weight)| Term::Length {
                first,
                len,
                weight,
            }));
        self.0
            .listen_to(name, output_terms.collect(), order)
            .map_err(from_engine)
    }

    /// The name of a MAT as in the score, e.g. `gong.12`.
    fn name_of(&self, index: usize) -> String {
        self.0.mat_name(index)
    }

    /// The lowest modes of a part, whatever its damping.
    fn modes(&self, py: Python<'_>, part: &str, n_modes: usize) -> PyResult<Vec<Mode>> {
        let part_index = self.part_index(part)?;
        let part_tones = computing(py, || self.0.tones(part_index, n_modes))?;
        let part_tones = part_tones.map_err(|error| module_error(part, error))?;
        let mode_of_tone = |tone: &network::Tone| Mode {
            f: tone.f,
            t60: tone.t60,
        };
        Ok(part_tones.iter().map(mode_of_tone).collect())
    }

    /// Modes of a part: the lowest `count`, all up to `to` [Hz], or `count` next to `around` [Hz].
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
        let part_index = self.part_index(part)?;
        let frequency = |f: f64| {
            let is_positive = f > 0.0 && f.is_finite();
            let refusal = || module_error(part, "modes are asked for at frequencies above 0 Hz");
            if is_positive { Ok(f) } else { Err(refusal()) }
        };
        let mode_range = match (count, to, around) {
            (Some(count), None, None) => ModeRange::Lowest(count),
            (None, Some(to), None) => ModeRange::Below(frequency(to)?),
            (Some(count), None, Some(f)) => ModeRange::Around(frequency(f)?, count),
            _ => {
                let refusal_reason = "modes are asked for by `count`, by `to`, or by `count` and `around`";
                return Err(module_error(part, refusal_reason));
            }
        };
        let computed_modes = computing(py, || {
            let mut computed_modes = self.0.part_modes(part_index, mode_range)?;
            // Shapes of a large body are hundreds of megabytes: each is copied, and given back, between two polls.
            let mut mode_shapes = Vec::with_capacity(computed_modes.poles.len() * computed_modes.mats.len());
            for shape in std::mem::take(&mut computed_modes.shapes) {
                interrupt::poll();
                mode_shapes.extend(shape);
            }
            Ok((computed_modes, mode_shapes))
        })?;
        let (computed_modes, mode_shapes) =
            computed_modes.map_err(|error: network::TooManyModes| module_error(part, error))?;
        let (n_modes, n_masses) = (computed_modes.poles.len(), computed_modes.mats.len());
        Ok(PartModes {
            poles: ComplexArray {
                values: computed_modes.poles,
                shape: vec![n_modes],
            },
            shapes: ComplexArray {
                values: mode_shapes,
                shape: vec![n_modes, n_masses],
            },
            mats: computed_modes.mats,
            is_certified: computed_modes.is_certified,
            n_laws: computed_modes.n_laws,
            n_contacts: computed_modes.n_contacts,
        })
    }

    /// The masses and links of some parts, with the links between them and without those to other parts.
    fn elements(&self, py: Python<'_>, parts: Vec<String>) -> PyResult<Elements> {
        load_numpy(py);
        let indices = self.part_indices(&parts)?;
        let elements = computing(py, || self.0.elements(&indices))?;
        let end_slots = |end_index: usize| -> NumberArray<i64> {
            let slot_index =
                |element: &network::Element| element.ends[end_index].map_or(-1, |slot_index| slot_index as i64);
            NumberArray(elements.elements.iter().map(slot_index).collect())
        };
        let kind_word = |element: &network::Element| match element.kind {
            ElementKind::Tie => "CEL",
            ElementKind::Ref if element.z == 0.0 => "RES",
            ElementKind::Ref if element.k == 0.0 => "FRO",
            ElementKind::Ref => "REF",
            ElementKind::But => "BUT",
            ElementKind::Lnl => "LNL",
            ElementKind::Bristle => "BRISTLE",
            ElementKind::Dry => "DRY",
            ElementKind::Space => "SPACE",
        };
        Ok(Elements {
            kinds: elements.elements.iter().map(kind_word).collect(),
            a: end_slots(0),
            b: end_slots(1),
            stiffness: NumberArray(elements.elements.iter().map(|element| element.k).collect()),
            damping: NumberArray(elements.elements.iter().map(|element| element.z).collect()),
            n_held: elements.n_held,
            ca_rate: elements.ca_rate.map(Rate::hertz),
            mats: elements.mats,
            masses: NumberArray(elements.masses),
        })
    }

    /// Velocity of each of `observed` over a force at `forced`, with the parts taken by themselves, (n_observed,
    /// n_frequencies).
    fn admittance(
        &self,
        py: Python<'_>,
        parts: Vec<String>,
        forced: Vec<usize>,
        observed: Vec<Vec<usize>>,
        frequencies: Vec<f64>,
    ) -> PyResult<ComplexArray> {
        load_numpy(py);
        let indices = self.part_indices(&parts)?;
        if !frequencies.iter().all(|f| *f > 0.0 && f.is_finite()) {
            let refusal_reason = "an admittance is asked for at frequencies above 0 Hz";
            return Err(module_error(&parts.join(" + "), refusal_reason));
        }
        let shape = vec![observed.len(), frequencies.len()];
        let values = computing(py, || self.0.admittance(&indices, &forced, &observed, &frequencies))?;
        Ok(ComplexArray { values, shape })
    }

    /// The same network with positions in place of each SOV and SOA.
    fn undifferentiated(&self) -> Self {
        Self(self.0.undifferentiated())
    }

    /// The certificate that the CA scheme is stable at `rate` [Hz].
    fn certify(&self, py: Python<'_>, rate: f64) -> PyResult<Certificate> {
        let rate = hertz(rate)?;
        let certificate = computing(py, || Scheme::new(&self.0, rate)?.certify(&self.0))?;
        let certificate = certificate.map_err(from_engine)?;
        Ok(Certificate {
            lambda_max: certificate.lambda_max,
            method: match certificate.bound_method {
                BoundMethod::Gershgorin => "gershgorin",
                BoundMethod::Dense => "dense",
                BoundMethod::Lanczos => "lanczos",
            },
            guarantee: match certificate.guarantee {
                StabilityGuarantee::Proved => "proved",
                StabilityGuarantee::Guarded => "guarded",
                StabilityGuarantee::Tried => "tried",
            },
            oversampling: certificate.oversampling(),
        })
    }
}

impl Network {
    fn part_index(&self, part: &str) -> PyResult<usize> {
        let matched_index = self.0.parts().iter().position(|candidate| candidate.name == part);
        matched_index.ok_or_else(|| module_error(part, "no part has this name"))
    }

    fn part_indices(&self, parts: &[String]) -> PyResult<Vec<usize>> {
        parts.iter().map(|part| self.part_index(part)).collect()
    }

    fn check_mat(&self, index: usize) -> PyResult<()> {
        if index < self.0.n_mat() {
            return Ok(());
        }
        Err(module_error(
            &format!("#{index}"),
            format!("there are {} MATs", self.0.n_mat()),
        ))
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
