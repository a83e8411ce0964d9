//! Adding bodies: banks, bodies given by their modes, strings and plates, each tuned to its pitch and decay.

use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::{LinkKind, Mat, MatKind, Network};
use crate::chance::Chance;
use crate::generator::{self, BankCell, BankForm, Decay, Losses, Topology, Tuned};
use crate::interrupt;
use crate::law::Law;

/// Frequency [Hz] and T60 [s] of the modes that are added if the places of a list of modes are not independent. They
/// decay before they can be heard as a pitch. The frequency is about the highest that CA steps allow at 44.1 kHz.
const ADDED: (f64, f64) = (12_000.0, 1e-3);

impl Network {
    /// Add a bank of CELs of mass `m` [kg] each; random values come from `seed`. Returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if `m` or a number of the bank is out of range, or the network is
    /// full.
    pub fn bank(
        &mut self,
        name: &str,
        m: f64,
        form: &BankForm,
        seed: i128,
    ) -> Result<usize, Error> {
        self.check(name, &[("M", m, Rule::Positive)])?;
        let full = self.full_name(name);
        let draw = |member: usize| {
            let mut chance = Chance::new(seed, "bank", &full, member as u64, 0);
            (chance.uniform(0.0, 1.0), chance.uniform(0.0, 1.0))
        };
        let cells = generator::bank(form, draw, self.turns(name, seed))
            .map_err(|error| self.refused(name, &error.to_string()))?;
        let masses = vec![m; cells.len()];
        self.cells(name, &masses, &cells)
    }

    /// Draws of the angles of a bank: of each member a part of a whole turn.
    pub fn turns(&self, name: &str, seed: i128) -> impl Fn(usize) -> f64 + use<> {
        let full = self.full_name(name);
        move |member| Chance::new(seed, "bank angle", &full, member as u64, 0).uniform(0.0, 1.0)
    }

    /// Add the CELs of a bank, each with its own mass [kg]; returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range, or the network is full.
    pub fn cells(
        &mut self,
        name: &str,
        masses: &[f64],
        cells: &[BankCell],
    ) -> Result<usize, Error> {
        for (m, cell) in masses.iter().zip(cells) {
            self.check(name, &[("M", *m, Rule::Positive)])?;
            self.check_tuning(name, cell.f, Some(cell.t60))?;
        }
        let full = self.full_name(name);
        self.check_capacity(name, cells.len())?;
        let first = self.n_mat();
        let part = self.current();
        for (mass_index, (&m, cell)) in masses.iter().zip(cells).enumerate() {
            if mass_index.is_multiple_of(1024) {
                interrupt::poll();
            }
            let (k, z) = self.tie(m, cell.f, Some(cell.t60));
            self.mats.push(Mat {
                kind: MatKind::Cel,
                m,
                k,
                z,
                rest: 0.0,
                x0: 0.0,
                v0: 0.0,
                place: cell.position,
                part,
            });
        }
        self.names
            .add_mats(first, cells.len(), true, full, cells.len() / 2);
        Ok(first)
    }

    /// Add a body given by its `modes` (f [Hz] and t60 [s]) and their `levels` (n_modes, n_places); `mass` [kg] is the
    /// modal mass at a level of 1. Returns the index of the first place; the other places follow it.
    ///
    /// ```
    /// use ergon_engine::Network;
    ///
    /// let mut network = Network::new();
    /// network.part("bell", None);
    /// let levels = vec![vec![1.0, 0.5], vec![0.7, -0.7]];
    /// let first = network.modal("", 0.2, &[(220.0, 4.0), (447.0, 2.0)], &levels)?;
    /// assert_eq!((network.count(first), network.mat_name(first + 1)), (2, "bell.1".into()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the network is full.
    pub fn modal(
        &mut self,
        name: &str,
        mass: f64,
        modes: &[(f64, f64)],
        levels: &[Vec<f64>],
    ) -> Result<usize, Error> {
        self.check(name, &[("M", mass, Rule::Positive)])?;
        for &(f, t60) in modes {
            self.check_tuning(name, f, Some(t60))?;
        }
        let poles: Vec<(f64, f64)> = modes
            .iter()
            .map(|&(f, t60)| self.tie(1.0, f, Some(t60)))
            .collect();
        let (f, t60) = ADDED;
        let beyond = self.ca_rate().map_or(f, |rate| f.min(0.27 * rate.hertz()));
        let beyond = self.tie(1.0, beyond, Some(t60));
        let body = generator::modal_body(mass, &poles, levels, beyond)
            .map_err(|error| self.refused(name, &error.to_string()))?;
        let n = body.masses.len();
        self.check_capacity(name, n * n)?;
        let (first, part, places) = (self.n_mat(), self.current(), levels[0].len());
        let line = generator::Place::Line;
        for (i, &m) in body.masses.iter().enumerate() {
            let row = i * n..(i + 1) * n;
            self.mats.push(Mat {
                kind: MatKind::Cel,
                m,
                k: body.stiffness[row.clone()].iter().sum(),
                z: body.damping[row].iter().sum(),
                rest: 0.0,
                x0: 0.0,
                v0: 0.0,
                place: line.position(i.min(places - 1), places, 0.0, |_| 0.0),
                part,
            });
        }
        let full = self.full_name(name);
        self.names
            .add_mats(first, places, true, full.clone(), places / 2);
        let inside = format!("{full}.inside");
        self.names
            .add_mats(first + places, n - places, true, inside, 0);
        let links = self.n_lia;
        for a in 0..n {
            for b in a + 1..n {
                let (k, z) = (-body.stiffness[a * n + b], -body.damping[a * n + b]);
                if k != 0.0 || z != 0.0 {
                    self.add_run(LinkKind::Ref, first + a, first + b, 1, [k, z, 0.0]);
                }
            }
        }
        self.names
            .add_links(links, self.n_lia - links, true, format!("{full}.link"));
        Ok(first)
    }

    /// Add a string or a plate of total mass `mass` [kg] whose lowest mode has the frequency `f` [Hz], and which has
    /// the `decay`; returns the index of the first mass.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::generator::{Rim, Shape, plate};
    ///
    /// let mut network = Network::new();
    /// network.part("gong", None);
    /// let first = network.mesh("plate", &plate(Shape::Hex, 2, Rim::Free)?, 0.5, 120.0, Some(4.0), 0.0)?;
    /// assert_eq!((network.count(first), network.mat_name(network.centre(first))), (19, "gong.plate.9".into()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range, the mesh cannot have the pitch, or
    /// the network is full.
    pub fn mesh<'a>(
        &mut self,
        name: &str,
        topology: &Topology,
        mass: f64,
        f: f64,
        decay: impl Into<Decay<'a>>,
        hardening: f64,
    ) -> Result<usize, Error> {
        self.stretched_mesh(name, topology, mass, f, decay, [hardening, 0.0])
    }

    /// As [`Network::mesh`], with the `stretching` of a row of masses, whose links in line share one tension.
    /// `hardening` is q of the force q·d³ and `stretching` q of q·S·d [N/m³], where S is the sum of the squares of all
    /// elongations.
    ///
    /// # Errors
    /// As [`Network::mesh`].
    pub fn stretched_mesh<'a>(
        &mut self,
        name: &str,
        topology: &Topology,
        mass: f64,
        f: f64,
        decay: impl Into<Decay<'a>>,
        [hardening, stretching]: [f64; 2],
    ) -> Result<usize, Error> {
        self.check(
            name,
            &[
                ("M", mass, Rule::Positive),
                ("hardening", hardening, Rule::NotNegative),
                ("stretching", stretching, Rule::NotNegative),
            ],
        )?;
        let decay = decay.into();
        let lowest = match decay {
            Decay::Lowest(t60) => t60,
            Decay::Points(_) => None,
        };
        self.check_tuning(name, f, lowest)?;
        let each = mass / topology.n_mat as f64;
        let losses = match decay {
            Decay::Lowest(t60) => {
                let tuned = generator::tune(topology, each, f, t60, self.ca_rate());
                tuned.map(|tuned| Losses {
                    tuned,
                    ground: 0.0,
                    dampers: Vec::new(),
                })
            }
            Decay::Points(points) => {
                generator::tune_points(topology, each, f, points, self.ca_rate())
            }
        };
        let losses = losses.map_err(|error| self.refused(name, &error.to_string()))?;
        self.add_mesh(name, topology, each, &losses, [hardening, stretching])
    }

    /// As [`Network::stretched_mesh`], but each link of factor 1 has the stiffness `k` [N/m] and the viscosity `z`
    /// [N·s/m]; in a part under `ca` these are the algorithmic K and Z.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the network is full.
    pub fn linked_mesh(
        &mut self,
        name: &str,
        topology: &Topology,
        mass: f64,
        [k, z]: [f64; 2],
        [hardening, stretching]: [f64; 2],
    ) -> Result<usize, Error> {
        self.check(
            name,
            &[
                ("M", mass, Rule::Positive),
                ("K", k, Rule::NotNegative),
                ("Z", z, Rule::NotNegative),
                ("hardening", hardening, Rule::NotNegative),
                ("stretching", stretching, Rule::NotNegative),
            ],
        )?;
        let losses = Losses {
            tuned: Tuned { k, z },
            ground: 0.0,
            dampers: Vec::new(),
        };
        let each = mass / topology.n_mat as f64;
        self.add_mesh(name, topology, each, &losses, [hardening, stretching])
    }

    /// Add the masses of `each` [kg] and the links of a mesh; returns the index of the first mass.
    fn add_mesh(
        &mut self,
        name: &str,
        topology: &Topology,
        each: f64,
        losses: &Losses,
        [hardening, stretching]: [f64; 2],
    ) -> Result<usize, Error> {
        self.check_capacity(name, topology.n_mat + topology.n_fixed)?;
        let tuned = losses.tuned;
        let (n, n_fixed) = (topology.n_mat, topology.n_fixed);
        let before = usize::from(topology.in_line && n_fixed > 0);
        let first = self.n_mat() + before;
        let part = self.current();
        // A topology numbers the MATs first, then the fixed points. In a row the first fixed point lies before the
        // MATs.
        let order = (n..n + before).chain(0..n).chain(n + before..n + n_fixed);
        for i in order {
            let place = &topology.positions[i];
            let share = topology.share(i);
            let (kind, m, z) = if i >= topology.n_mat {
                (MatKind::Sol, 0.0, 0.0)
            } else if losses.ground > 0.0 {
                (MatKind::Cel, each * share, losses.ground * share)
            } else {
                (MatKind::Mas, each * share, 0.0)
            };
            self.mats.push(Mat {
                kind,
                m,
                k: 0.0,
                z,
                rest: 0.0,
                x0: 0.0,
                v0: 0.0,
                place: *place,
                part,
            });
        }
        let full = self.full_name(name);
        let end = format!("{full}.end");
        if before > 0 {
            self.names
                .add_mats(first - 1, 1, false, format!("{end}.0"), 0);
            self.names
                .add_mats(first, n, true, full.clone(), topology.centre);
            if n_fixed > 1 {
                self.names
                    .add_mats(first + n, 1, false, format!("{end}.1"), 0);
            }
        } else {
            self.names
                .add_mats(first, n, true, full.clone(), topology.centre);
            self.names.add_mats(first + n, n_fixed, true, end, 0);
        }
        let links = self.n_lia;
        // Runs with the same factor share one law.
        let mut laws: Vec<(f64, Arc<Law>)> = Vec::new();
        let point = |i: usize| match i {
            i if i < n || before == 0 => first + i,
            i if i == n => first - 1,
            i => first + i - 1,
        };
        for run in &topology.runs {
            let (k, z) = (tuned.k * run.factor, tuned.z * run.factor);
            let kind = if hardening == 0.0 || !run.hardens {
                LinkKind::Ref
            } else if let Some((_, law)) = laws.iter().find(|(factor, _)| *factor == run.factor) {
                LinkKind::Lnl(law.clone())
            } else {
                let law = Law::hardening(k, hardening, z);
                let law = Arc::new(law.map_err(|error| self.refused(name, &error.to_string()))?);
                laws.push((run.factor, law.clone()));
                LinkKind::Lnl(law)
            };
            self.add_run(kind, point(run.a), point(run.b), run.len, [k, z, 0.0]);
        }
        for run in &losses.dampers {
            let (a, b) = (point(run.a), point(run.b));
            self.add_run(LinkKind::Ref, a, b, run.len, [0.0, run.factor, 0.0]);
        }
        if stretching > 0.0 {
            let law = Arc::new(Law::shared(stretching));
            let links = n_fixed + n - 1;
            let path = first - before;
            self.add_run(LinkKind::Lnl(law), path, path + 1, links, [0.0; 3]);
        }
        self.names
            .add_links(links, self.n_lia - links, true, format!("{full}.link"));
        Ok(first)
    }
}
