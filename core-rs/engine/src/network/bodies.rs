//! Adding bodies: banks, bodies given by their modes, strings and plates, each tuned to its pitch and decay.

use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::{LinkKind, Mat, MatKind, Network};
use crate::chance::Chance;
use crate::generator::{self, BankCell, BankForm, Decay, Losses, Topology, TunedLinks};
use crate::interrupt;
use crate::law::Law;

/// Frequency [Hz] and T60 [s] of the modes that are added if the places of a list of modes are not independent. They
/// decay before they can be heard as a pitch. The frequency is about the highest that CA steps allow at 44.1 kHz.
const ADDED_MODE: (f64, f64) = (12_000.0, 1e-3);

impl Network {
    /// Add a bank of CELs of mass `m` [kg] each; random values come from `seed`. Returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if `m` or a number of the bank is out of range, or the network is
    /// full.
    pub fn bank(&mut self, name: &str, m: f64, form: &BankForm, seed: i128) -> Result<usize, Error> {
        self.check(name, &[("M", m, Rule::Positive)])?;
        let module_name = self.full_name(name);
        let member_draw = |member: usize| {
            let mut chance = Chance::new(seed, "bank", &module_name, member as u64, 0);
            (chance.uniform(0.0, 1.0), chance.uniform(0.0, 1.0))
        };
        let bank_cells = generator::bank(form, member_draw, self.member_turns(name, seed))
            .map_err(|error| self.refused(name, &error.to_string()))?;
        let cell_masses = vec![m; bank_cells.len()];
        self.cells(name, &cell_masses, &bank_cells)
    }

    /// Draws of the angles of a bank: of each member a part of a whole turn.
    pub fn member_turns(&self, name: &str, seed: i128) -> impl Fn(usize) -> f64 + use<> {
        let module_name = self.full_name(name);
        move |member| Chance::new(seed, "bank angle", &module_name, member as u64, 0).uniform(0.0, 1.0)
    }

    /// Add the CELs of a bank, each with its own mass [kg]; returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range, or the network is full.
    pub fn cells(&mut self, name: &str, masses: &[f64], cells: &[BankCell]) -> Result<usize, Error> {
        for (m, cell) in masses.iter().zip(cells) {
            self.check(name, &[("M", *m, Rule::Positive)])?;
            self.check_tuning(name, cell.f, Some(cell.t60))?;
        }
        let module_name = self.full_name(name);
        self.check_capacity(name, cells.len())?;
        let first_mat = self.n_mat();
        let part = self.current_part_index();
        for (mass_index, (&m, cell)) in masses.iter().zip(cells).enumerate() {
            if mass_index.is_multiple_of(1024) {
                interrupt::poll();
            }
            let (k, z) = self.tuned_tie(m, cell.f, Some(cell.t60));
            self.mats.push(Mat {
                kind: MatKind::Cel,
                m,
                k,
                z,
                rest: 0.0,
                x0: 0.0,
                v0: 0.0,
                bench_position: cell.position,
                part,
            });
        }
        self.names
            .add_mats(first_mat, cells.len(), true, module_name, cells.len() / 2);
        Ok(first_mat)
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
    pub fn modal(&mut self, name: &str, mass: f64, modes: &[(f64, f64)], levels: &[Vec<f64>]) -> Result<usize, Error> {
        self.check(name, &[("M", mass, Rule::Positive)])?;
        for &(f, t60) in modes {
            self.check_tuning(name, f, Some(t60))?;
        }
        let mode_ties: Vec<(f64, f64)> = modes
            .iter()
            .map(|&(f, t60)| self.tuned_tie(1.0, f, Some(t60)))
            .collect();
        let (f, t60) = ADDED_MODE;
        let added_frequency = self.ca_rate().map_or(f, |rate| f.min(0.27 * rate.hertz()));
        let added_tie = self.tuned_tie(1.0, added_frequency, Some(t60));
        let body = generator::modal_body(mass, &mode_ties, levels, added_tie)
            .map_err(|error| self.refused(name, &error.to_string()))?;
        let mass_count = body.masses.len();
        self.check_capacity(name, mass_count * mass_count)?;
        let (first_mat, part, place_count) = (self.n_mat(), self.current_part_index(), levels[0].len());
        let place_line = generator::Place::Line;
        for (i, &m) in body.masses.iter().enumerate() {
            let row_range = i * mass_count..(i + 1) * mass_count;
            self.mats.push(Mat {
                kind: MatKind::Cel,
                m,
                k: body.stiffness[row_range.clone()].iter().sum(),
                z: body.damping[row_range].iter().sum(),
                rest: 0.0,
                x0: 0.0,
                v0: 0.0,
                bench_position: place_line.position(i.min(place_count - 1), place_count, 0.0, |_| 0.0),
                part,
            });
        }
        let module_name = self.full_name(name);
        self.names
            .add_mats(first_mat, place_count, true, module_name.clone(), place_count / 2);
        let inside_name = format!("{module_name}.inside");
        self.names
            .add_mats(first_mat + place_count, mass_count - place_count, true, inside_name, 0);
        let first_link = self.n_lia;
        for a in 0..mass_count {
            for b in a + 1..mass_count {
                let (k, z) = (-body.stiffness[a * mass_count + b], -body.damping[a * mass_count + b]);
                if k != 0.0 || z != 0.0 {
                    self.add_run(LinkKind::Ref, first_mat + a, first_mat + b, 1, [k, z, 0.0]);
                }
            }
        }
        self.names
            .add_links(first_link, self.n_lia - first_link, true, format!("{module_name}.link"));
        Ok(first_mat)
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
        let lowest_t60 = match decay {
            Decay::Lowest(t60) => t60,
            Decay::Points(_) => None,
        };
        self.check_tuning(name, f, lowest_t60)?;
        let mass_each = mass / topology.n_mat as f64;
        let mesh_losses = match decay {
            Decay::Lowest(t60) => {
                let tuned = generator::tune(topology, mass_each, f, t60, self.ca_rate());
                tuned.map(|tuned| Losses {
                    tuned,
                    ground: 0.0,
                    dampers: Vec::new(),
                })
            }
            Decay::Points(points) => generator::tune_points(topology, mass_each, f, points, self.ca_rate()),
        };
        let mesh_losses = mesh_losses.map_err(|error| self.refused(name, &error.to_string()))?;
        self.add_mesh(name, topology, mass_each, &mesh_losses, [hardening, stretching])
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
        let mesh_losses = Losses {
            tuned: TunedLinks { k, z },
            ground: 0.0,
            dampers: Vec::new(),
        };
        let mass_each = mass / topology.n_mat as f64;
        self.add_mesh(name, topology, mass_each, &mesh_losses, [hardening, stretching])
    }

    /// Add the masses of `mass_each` [kg] and the links of a mesh; returns the index of the first mass.
    fn add_mesh(
        &mut self,
        name: &str,
        topology: &Topology,
        mass_each: f64,
        losses: &Losses,
        [hardening, stretching]: [f64; 2],
    ) -> Result<usize, Error> {
        self.check_capacity(name, topology.n_mat + topology.n_fixed)?;
        let tuned_link = losses.tuned;
        let (mat_count, fixed_count) = (topology.n_mat, topology.n_fixed);
        let fixed_before = usize::from(topology.is_in_line && fixed_count > 0);
        let first_mat = self.n_mat() + fixed_before;
        let part = self.current_part_index();
        // A topology numbers the MATs first, then the fixed points. In a row the first fixed point lies before the
        // MATs.
        let mat_order = (mat_count..mat_count + fixed_before)
            .chain(0..mat_count)
            .chain(mat_count + fixed_before..mat_count + fixed_count);
        for i in mat_order {
            let mat_position = &topology.positions[i];
            let mass_share = topology.mass_share(i);
            let (kind, m, z) = if i >= topology.n_mat {
                (MatKind::Sol, 0.0, 0.0)
            } else if losses.ground > 0.0 {
                (MatKind::Cel, mass_each * mass_share, losses.ground * mass_share)
            } else {
                (MatKind::Mas, mass_each * mass_share, 0.0)
            };
            self.mats.push(Mat {
                kind,
                m,
                k: 0.0,
                z,
                rest: 0.0,
                x0: 0.0,
                v0: 0.0,
                bench_position: *mat_position,
                part,
            });
        }
        let module_name = self.full_name(name);
        let end_name = format!("{module_name}.end");
        if fixed_before > 0 {
            self.names.add_mats(first_mat - 1, 1, false, format!("{end_name}.0"), 0);
        }
        self.names
            .add_mats(first_mat, mat_count, true, module_name.clone(), topology.centre);
        let after_mats = first_mat + mat_count;
        if fixed_before == 0 {
            self.names.add_mats(after_mats, fixed_count, true, end_name, 0);
        } else if fixed_count > 1 {
            self.names.add_mats(after_mats, 1, false, format!("{end_name}.1"), 0);
        }
        let first_link = self.n_lia;
        // Runs with the same factor share one law.
        let mut factor_laws: Vec<(f64, Arc<Law>)> = Vec::new();
        let mat_of_point = |i: usize| match i {
            i if i < mat_count || fixed_before == 0 => first_mat + i,
            i if i == mat_count => first_mat - 1,
            i => first_mat + i - 1,
        };
        for run in &topology.runs {
            let (k, z) = (tuned_link.k * run.factor, tuned_link.z * run.factor);
            let kind = if hardening == 0.0 || !run.hardens {
                LinkKind::Ref
            } else if let Some((_, law)) = factor_laws.iter().find(|(factor, _)| *factor == run.factor) {
                LinkKind::Lnl(law.clone())
            } else {
                let law = Law::hardening(k, hardening, z);
                let law = Arc::new(law.map_err(|error| self.refused(name, &error.to_string()))?);
                factor_laws.push((run.factor, law.clone()));
                LinkKind::Lnl(law)
            };
            self.add_run(kind, mat_of_point(run.a), mat_of_point(run.b), run.len, [k, z, 0.0]);
        }
        for run in &losses.dampers {
            let (first_end, second_end) = (mat_of_point(run.a), mat_of_point(run.b));
            self.add_run(LinkKind::Ref, first_end, second_end, run.len, [0.0, run.factor, 0.0]);
        }
        if stretching > 0.0 {
            let law = Arc::new(Law::shared(stretching));
            let link_count = fixed_count + mat_count - 1;
            let row_start = first_mat - fixed_before;
            self.add_run(LinkKind::Lnl(law), row_start, row_start + 1, link_count, [0.0; 3]);
        }
        self.names
            .add_links(first_link, self.n_lia - first_link, true, format!("{module_name}.link"));
        Ok(first_mat)
    }
}
