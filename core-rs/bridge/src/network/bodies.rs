//! Strings, plates, banks, and bodies that are given by their modes.

use ergon_engine::generator::{self, Angles, BankForm, Decay, GeneratorError, Place as Arrangement, Shape, Topology};
use pyo3::prelude::*;

use super::Network;
use crate::error::{from_engine, module_error, parse_choice};
use crate::words;
use crate::work::computing;

/// The decay of the lowest mode [s], or decays [s] at frequencies [Hz].
#[derive(FromPyObject)]
enum ModeDecays {
    Lowest(f64),
    Points(Vec<(f64, f64)>),
}

/// How the links of a body are given: by a pitch and a decay, or by K and Z of each link.
enum MeshLinks {
    Tuned(f64, Option<ModeDecays>),
    Direct([f64; 2]),
}

impl MeshLinks {
    fn new(name: &str, f: Option<f64>, t60: Option<ModeDecays>, k: Option<f64>, z: Option<f64>) -> PyResult<Self> {
        match (f, t60, k, z) {
            (Some(f), t60, None, None) => Ok(Self::Tuned(f, t60)),
            (None, None, Some(k), z) => Ok(Self::Direct([k, z.unwrap_or(0.0)])),
            _ => Err(module_error(
                name,
                "a body takes either f and t60 or K and Z of its links",
            )),
        }
    }
}

/// The arrangement of the members of a bank by its word; `hole` and `angles` are used for a galaxy.
fn member_arrangement(place: &str, hole: f64, angles: &str) -> PyResult<Arrangement> {
    let angles: Angles = parse_choice("angles", angles, words::BANK_ANGLES)?;
    Ok(match parse_choice("place", place, words::BANK_PLACES)? {
        Arrangement::Galaxy { .. } => Arrangement::Galaxy { hole, angles },
        other_arrangement => other_arrangement,
    })
}

#[pymethods]
impl Network {
    /// `masses` MAS in a row, whose lowest vibrating mode has f and t60, or with links of the given K and Z.
    #[pyo3(signature = (name, *, masses, M, f=None, t60=None, K=None, Z=None, ends="fixed", stiffness=0.0, inharmonicity=None, hardening=0.0, stretching=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn string(
        &mut self,
        py: Python<'_>,
        name: &str,
        masses: usize,
        M: f64,
        f: Option<f64>,
        t60: Option<ModeDecays>,
        K: Option<f64>,
        Z: Option<f64>,
        ends: &str,
        stiffness: f64,
        inharmonicity: Option<f64>,
        hardening: f64,
        stretching: f64,
    ) -> PyResult<usize> {
        let ends = parse_choice("ends", ends, words::STRING_ENDS)?;
        let topology = computing(py, || match inharmonicity {
            None => generator::string(masses, ends, stiffness),
            Some(b) => generator::stiff_string(masses, ends, b),
        })?;
        let topology = topology.map(|topology| topology.in_line(stretching > 0.0));
        let mesh_links = MeshLinks::new(name, f, t60, K, Z)?;
        self.mesh(py, name, topology, M, &mesh_links, [hardening, stretching])
    }

    /// A mesh, whose lowest vibrating mode has f and t60, or with links of the given K and Z.
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
        t60: Option<ModeDecays>,
        K: Option<f64>,
        Z: Option<f64>,
        rim: &str,
        bending: Option<f64>,
        hardening: f64,
    ) -> PyResult<usize> {
        let shape = match sides {
            Some((across, up)) => Shape::Rectangle { across, up },
            None => parse_choice("shape", shape, words::PLATE_SHAPES)?,
        };
        let rim = parse_choice("rim", rim, words::PLATE_RIMS)?;
        let topology = computing(py, || match bending {
            None if shape == Shape::Disc => generator::round_membrane(radius, rim),
            None => generator::plate(shape, radius, rim),
            Some(poisson) => generator::bent_plate(shape, radius, rim, poisson),
        })?;
        let mesh_links = MeshLinks::new(name, f, t60, K, Z)?;
        self.mesh(py, name, topology, M, &mesh_links, [hardening, 0.0])
    }

    /// Many CELs with frequencies over a range.
    #[pyo3(signature = (name, *, count, M, f, t60, spread="even", place="line", hole=0.3, angles="even", seed=0))]
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
        angles: &str,
        seed: i128,
    ) -> PyResult<usize> {
        let spread = parse_choice("spread", spread, words::BANK_SPREADS)?;
        let place = member_arrangement(place, hole, angles)?;
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

    /// CELs side by side, each with f [Hz], t60 [s] and M [kg]; the index of the first.
    #[pyo3(signature = (name, *, cells, place="line", hole=0.3, angles="even", seed=0))]
    #[allow(clippy::too_many_arguments)]
    fn cells(
        &mut self,
        py: Python<'_>,
        name: &str,
        cells: Vec<(f64, f64, f64)>,
        place: &str,
        hole: f64,
        angles: &str,
        seed: i128,
    ) -> PyResult<usize> {
        let place = member_arrangement(place, hole, angles)?;
        let cell_masses: Vec<f64> = cells.iter().map(|(_, _, mass)| *mass).collect();
        let tunings: Vec<(f64, f64)> = cells.iter().map(|(f, t60, _)| (*f, *t60)).collect();
        let cells = generator::cells_at(&tunings, place, self.0.member_turns(name, seed))
            .map_err(|error| from_engine(self.0.refused(name, &error.to_string())))?;
        computing(py, || self.0.cells(name, &cell_masses, &cells))?.map_err(from_engine)
    }

    /// A body of `modes`, each f [Hz] and t60 [s], with `levels` (n_modes, n_places) at places; the index of the first
    /// place.
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
        let n_places = levels.first().map_or(0, Vec::len);
        if levels.len() != modes.len() || levels.iter().any(|row| row.len() != n_places) {
            return Err(module_error(name, "each mode has one level for each place"));
        }
        computing(py, || self.0.modal(name, M, &modes, &levels))?.map_err(from_engine)
    }

    /// Frequency [Hz] of the highest mode of the STRING or PLATE that begins at index `first`.
    fn highest_mode(&self, py: Python<'_>, first: usize) -> PyResult<f64> {
        self.check_mat(first)?;
        computing(py, || self.0.highest_mode(first))
    }

    /// Number of MATs of the module that begins at index `first`.
    fn count(&self, first: usize) -> usize {
        self.0.count(first)
    }

    /// Index of the middle MAT of the module that begins at `first`.
    fn centre(&self, first: usize) -> usize {
        self.0.centre(first)
    }
}

impl Network {
    fn mesh(
        &mut self,
        py: Python<'_>,
        name: &str,
        topology: Result<Topology, GeneratorError>,
        mass: f64,
        links: &MeshLinks,
        hardening_and_stretching: [f64; 2],
    ) -> PyResult<usize> {
        let topology = topology.map_err(|error| from_engine(self.0.refused(name, &error.to_string())))?;
        computing(py, || match links {
            MeshLinks::Direct(k_and_z) => self
                .0
                .linked_mesh(name, &topology, mass, *k_and_z, hardening_and_stretching),
            MeshLinks::Tuned(f, decays) => {
                let tuned_decay = match decays {
                    None => Decay::Lowest(None),
                    Some(ModeDecays::Lowest(t60)) => Decay::Lowest(Some(*t60)),
                    Some(ModeDecays::Points(points)) => Decay::Points(points),
                };
                self.0
                    .stretched_mesh(name, &topology, mass, *f, tuned_decay, hardening_and_stretching)
            }
        })?
        .map_err(from_engine)
    }
}
