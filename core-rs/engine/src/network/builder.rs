//! Adding MATs (`<M>` points) and outputs; the rules of the formalism are checked at once.

use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::parameters::Tie;
use super::{LinkKind, Mat, MatKind, Network, Output, Part, Run, Term};
use crate::cell::{self, Cell};
use crate::chance::Chance;
use crate::generator::{self, BankCell, BankForm, Decay, Losses, Topology, Tuned};
use crate::interrupt;
use crate::law::Law;
use crate::units::Rate;

/// Frequency [Hz] and decay [s] of the modes that are added where places of a list of modes are not independent: over
/// before they are heard as a pitch, and as high as CA steps at 44.1 kHz.
const ADDED: (f64, f64) = (12_000.0, 1e-3);

impl Network {
    /// Begin or continue a part: modules added from now on belong to it.
    pub fn part(&mut self, name: &str, ca_rate: Option<Rate>) {
        let known = self.parts.iter().position(|part| part.name == name);
        self.current = known.unwrap_or_else(|| {
            self.parts.push(Part {
                name: name.to_owned(),
                ca_rate,
                macrostep: None,
            });
            self.parts.len() - 1
        });
    }

    /// Let a plan compute the own springs of the current part only once in so many frames.
    pub fn macrostep(&mut self, frames: u32) {
        if let Some(part) = self.parts.get_mut(self.current) {
            part.macrostep = Some(frames.max(1));
        }
    }

    /// Add a free mass (MAS) of mass `m` [kg] at position `x0` [m] and velocity `v0` [m/s]; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where `m` is not above 0, a number is not finite, or the network
    /// is full.
    pub fn mas(&mut self, name: &str, m: f64, x0: f64, v0: f64) -> Result<usize, Error> {
        self.check(
            name,
            &[
                ("M", m, Rule::Positive),
                ("X0", x0, Rule::Finite),
                ("V0", v0, Rule::Finite),
            ],
        )?;
        self.add_mat(name, MatKind::Mas, [m, 0.0, 0.0, 0.0, x0, v0])
    }

    /// Add a fixed point (SOL) at `x0` [m]; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where `x0` is not finite or the network is full.
    pub fn sol(&mut self, name: &str, x0: f64) -> Result<usize, Error> {
        self.check(name, &[("X0", x0, Rule::Finite)])?;
        self.add_mat(name, MatKind::Sol, [0.0, 0.0, 0.0, 0.0, x0, 0.0])
    }

    /// Add a mass tied to the ground (CEL): mass `m` [kg], ground at `rest` [m], at `x0` [m] and `v0` [m/s] at the start;
    /// returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range or the network is full.
    pub fn cel(
        &mut self,
        name: &str,
        m: f64,
        tie: Tie,
        rest: f64,
        x0: f64,
        v0: f64,
    ) -> Result<usize, Error> {
        self.check(
            name,
            &[
                ("M", m, Rule::Positive),
                ("rest", rest, Rule::Finite),
                ("X0", x0, Rule::Finite),
                ("V0", v0, Rule::Finite),
            ],
        )?;
        let (k, z) = match tie {
            Tie::Physical { k, z } => (k, z),
            Tie::Tuned { f, t60 } => {
                self.check_tuning(name, f, t60)?;
                self.tie(m, f, t60)
            }
        };
        self.check(
            name,
            &[("K", k, Rule::NotNegative), ("Z", z, Rule::NotNegative)],
        )?;
        self.add_mat(name, MatKind::Cel, [m, k, z, rest, x0, v0])
    }

    /// Add a bank of CELs of mass `m` [kg] each, drawn by `seed`; returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where `m` or a number of the bank is out of range, or the network is
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
        let cells =
            generator::bank(form, draw).map_err(|error| self.refused(name, &error.to_string()))?;
        let masses = vec![m; cells.len()];
        self.cells(name, &masses, &cells)
    }

    /// Add the CELs of a bank, each with its own mass [kg]; returns the index of the first.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range, or the network is full.
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
        self.room(name, cells.len())?;
        let first = self.n_mat();
        let part = self.current();
        for (at, (&m, cell)) in masses.iter().zip(cells).enumerate() {
            if at.is_multiple_of(1024) {
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

    /// Add a body of which `modes` (f [Hz] and t60 [s]) and their `levels` (n_modes, n_places) are known, of mass `mass` [kg]
    /// where a level is 1; returns the index of its first place, which others follow.
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
    /// [`Error::Refused`] with the name of the module where a number is out of range or the network is full.
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
        self.room(name, n * n)?;
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
                place: line.position(i.min(places - 1), places, 0.0),
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
    /// [`Error::Refused`] with the name of the module where a number is out of range, the mesh cannot have the pitch, or
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

    /// The same with the `stretching` of a row of masses, whose links in line share one tension: `hardening` and
    /// `stretching` are q of q·d³ and of q·S·d [N/m³], S the sum of the squares of all elongations.
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

    /// The same whose every link of factor 1 has the stiffness `k` [N/m] and the viscosity `z` [N·s/m]; in a part under
    /// `ca` the algorithmic K and Z.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range or the network is full.
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
        self.room(name, topology.n_mat + topology.n_fixed)?;
        let tuned = losses.tuned;
        let (n, n_fixed) = (topology.n_mat, topology.n_fixed);
        let before = usize::from(topology.in_line && n_fixed > 0);
        let first = self.n_mat() + before;
        let part = self.current();
        // Points are the MATs, then the fixed ones; in line the first of these lies before the MATs.
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
        // Runs of one factor share a law.
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

    /// Set the initial position [m] and velocity [m/s] of one MAT.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is not finite.
    pub fn start(&mut self, index: usize, x0: f64, v0: f64) -> Result<(), Error> {
        if !(x0.is_finite() && v0.is_finite()) {
            return Err(Error::Refused {
                module: self.mat_name(index),
                message: format!("X0 and V0 must be finite numbers, not {x0} and {v0}"),
            });
        }
        self.mats.x0[index] = x0;
        self.mats.v0[index] = v0;
        Ok(())
    }

    /// Make a MAT's position imposed (ENX).
    pub fn impose(&mut self, index: usize) {
        self.mats.kind[index] = MatKind::Imposed;
    }

    /// Add an output, the sum of its terms; returns its index.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::network::Term;
    ///
    /// let mut network = Network::new();
    /// let m = network.mas("m", 1e-3, 0.0, 0.0)?;
    /// let out = network.listen("left", vec![Term::Position { first: m, len: 1, weight: 1.0 }])?;
    /// assert_eq!(network.outputs()[out].name, "left");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a term refers to modules that do not exist or its weight is
    /// not finite.
    pub fn listen(&mut self, name: &str, terms: Vec<Term>) -> Result<usize, Error> {
        self.listen_to(name, terms, 0)
    }

    /// [`Network::listen`] to the sum (`order` 0), to its speed (1) or its acceleration (2).
    ///
    /// # Errors
    /// Those of [`Network::listen`], and [`Error::Refused`] where the order is above 2.
    pub fn listen_to(&mut self, name: &str, terms: Vec<Term>, order: u8) -> Result<usize, Error> {
        if order > 2 {
            let message = format!("an output is differentiated twice at most, not {order} times");
            return Err(self.refused(name, &message));
        }
        for term in &terms {
            let (first, len, weight, most) = match *term {
                Term::Position { first, len, weight } | Term::Ground { first, len, weight } => {
                    (first, len, weight, self.n_mat())
                }
                Term::Force { first, len, weight } => (first, len, weight, self.n_lia),
            };
            if first.checked_add(len).is_none_or(|end| end > most) {
                return Err(self.refused(name, "listens to a module that does not exist"));
            }
            if !weight.is_finite() {
                let message = format!("a weight is {weight}: it must be a finite number");
                return Err(self.refused(name, &message));
            }
        }
        self.outputs.push(Output {
            name: name.to_owned(),
            terms,
            order,
        });
        Ok(self.outputs.len() - 1)
    }

    /// How many MATs the module that begins at `first` has: 1, or a generator's.
    pub fn count(&self, first: usize) -> usize {
        self.names.count(first)
    }

    /// Index of the middle MAT of the module that begins at `first`.
    pub fn centre(&self, first: usize) -> usize {
        self.names.centre(first)
    }

    fn add_mat(
        &mut self,
        name: &str,
        kind: MatKind,
        [m, k, z, rest, x0, v0]: [f64; 6],
    ) -> Result<usize, Error> {
        self.room(name, 1)?;
        let index = self.n_mat();
        let part = self.current();
        self.mats.push(Mat {
            kind,
            m,
            k,
            z,
            rest,
            x0,
            v0,
            place: [0.0; 2],
            part,
        });
        let name = self.full_name(name);
        self.names.add_mats(index, 1, false, name, 0);
        Ok(index)
    }

    /// Add one coordinate of a point in space at [x, v]: fixed where its mass is 0.
    pub(super) fn push_coordinate(&mut self, m: f64, z: f64, [x0, v0]: [f64; 2]) {
        let kind = match (m > 0.0, z > 0.0) {
            (false, _) => MatKind::Sol,
            (true, false) => MatKind::Mas,
            (true, true) => MatKind::Cel,
        };
        let (z, v0) = if m > 0.0 { (z, v0) } else { (0.0, 0.0) };
        let part = self.current();
        self.mats.push(Mat {
            kind,
            m,
            k: 0.0,
            z,
            rest: 0.0,
            x0,
            v0,
            place: [0.0; 2],
            part,
        });
    }

    /// Name the coordinates of `n` points along an axis.
    pub(super) fn name_coordinates(
        &mut self,
        first: usize,
        n: usize,
        is_numbered: bool,
        name: &str,
        axis: usize,
    ) {
        let name = self.full_name(name);
        self.names
            .add_coordinates(first, n, is_numbered, name, axis);
    }

    /// Let gravity act on MATs, with `g` [m/s²] along their axis; on fixed points it has no effect.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the first MAT where `g` is not finite.
    pub fn weigh(&mut self, mats: std::ops::Range<usize>, g: f64) -> Result<(), Error> {
        if !g.is_finite() {
            return Err(Error::Refused {
                module: self.mat_name(mats.start),
                message: format!("gravity is {g} m/s²: it must be a finite number"),
            });
        }
        self.mats.weight.resize(self.n_mat(), 0.0);
        for mat in mats.filter(|&mat| self.mats.kind[mat].moves()) {
            let part = self.parts.get(self.mats.part[mat] as usize);
            // The number M of a discrete network is m/T².
            let step = part.and_then(|part| part.ca_rate).map_or(1.0, Rate::step);
            self.mats.weight[mat] = self.mats.m[mat] * g * step * step;
        }
        Ok(())
    }

    pub(super) fn add_run(
        &mut self,
        kind: LinkKind,
        a: usize,
        b: usize,
        len: usize,
        [k, z, rest]: [f64; 3],
    ) {
        let part = self.current() as usize;
        self.push_run(Run {
            kind,
            a,
            b,
            len,
            first: 0,
            k,
            z,
            rest,
            part,
        });
    }

    /// K and Z of a CEL of damped frequency f: physical, or algorithmic in a part under `ca`.
    fn tie(&self, m: f64, f: f64, t60: Option<f64>) -> (f64, f64) {
        match self.ca_rate() {
            None => {
                let cell = Cell::tuned(m, f, t60);
                (cell.stiffness(), cell.viscosity())
            }
            Some(rate) => {
                let ratios = cell::tune(f, t60, rate);
                (ratios.kappa * m, ratios.zeta * m)
            }
        }
    }

    /// The part that modules are added to; where none was begun, one without a name.
    fn current(&mut self) -> u32 {
        if self.parts.is_empty() {
            self.part("", None);
        }
        self.current as u32
    }

    fn ca_rate(&self) -> Option<Rate> {
        self.parts.get(self.current).and_then(|part| part.ca_rate)
    }

    /// The name of a module with that of its part.
    pub(super) fn full_name(&self, name: &str) -> String {
        let part = self
            .parts
            .get(self.current)
            .map_or("", |part| part.name.as_str());
        match (part.is_empty(), name.is_empty()) {
            (true, _) => name.to_owned(),
            (_, true) => part.to_owned(),
            _ => format!("{part}.{name}"),
        }
    }
}
