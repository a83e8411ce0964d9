//! Adding MATs (`<M>` points) and outputs; each call checks the rules of the formalism.

use super::checks::Rule;
use super::error::Error;
use super::parameters::Tie;
use super::{LinkKind, Mat, MatKind, Network, Output, Part, Run, Term};
use crate::cell::{self, Cell};
use crate::units::Rate;

impl Network {
    /// Begin or continue a part: modules added from now on belong to it.
    pub fn part(&mut self, name: &str, ca_rate: Option<Rate>) {
        let known_part = self.parts.iter().position(|part| part.name == name);
        self.current_part = known_part.unwrap_or_else(|| {
            self.parts.push(Part {
                name: name.to_owned(),
                ca_rate,
                macrostep: None,
            });
            self.parts.len() - 1
        });
    }

    /// Allow a plan to compute the springs inside the current part only once in `frames` frames.
    pub fn macrostep(&mut self, frames: u32) {
        if let Some(current_part) = self.parts.get_mut(self.current_part) {
            current_part.macrostep = Some(frames.max(1));
        }
    }

    /// Add a free mass (MAS) of mass `m` [kg] at position `x0` [m] and velocity `v0` [m/s]; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if `m` is not above 0, a number is not finite, or the network is
    /// full.
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
    /// [`Error::Refused`] with the name of the module if `x0` is not finite or the network is full.
    pub fn sol(&mut self, name: &str, x0: f64) -> Result<usize, Error> {
        self.check(name, &[("X0", x0, Rule::Finite)])?;
        self.add_mat(name, MatKind::Sol, [0.0, 0.0, 0.0, 0.0, x0, 0.0])
    }

    /// Add a mass tied to the ground (CEL): mass `m` [kg], ground at `rest` [m], at `x0` [m] and `v0` [m/s] at the
    /// start; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the network is full.
    pub fn cel(&mut self, name: &str, m: f64, tie: Tie, rest: f64, x0: f64, v0: f64) -> Result<usize, Error> {
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
                self.tuned_tie(m, f, t60)
            }
        };
        self.check(name, &[("K", k, Rule::NotNegative), ("Z", z, Rule::NotNegative)])?;
        self.add_mat(name, MatKind::Cel, [m, k, z, rest, x0, v0])
    }

    /// Set the initial position [m] and velocity [m/s] of one MAT.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is not finite.
    pub fn set_initial_motion(&mut self, index: usize, x0: f64, v0: f64) -> Result<(), Error> {
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
    pub fn set_imposed(&mut self, index: usize) {
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
    /// [`Error::Refused`] with the name of the module if a term refers to modules that do not exist or its weight is
    /// not finite.
    pub fn listen(&mut self, name: &str, terms: Vec<Term>) -> Result<usize, Error> {
        self.listen_to(name, terms, 0)
    }

    /// As [`Network::listen`]: the output is the sum (`order` 0), its speed (1) or its acceleration (2).
    ///
    /// # Errors
    /// Those of [`Network::listen`], and [`Error::Refused`] if the order is above 2.
    pub fn listen_to(&mut self, name: &str, terms: Vec<Term>, order: u8) -> Result<usize, Error> {
        if order > 2 {
            let message = format!("an output is differentiated twice at most, not {order} times");
            return Err(self.refused(name, &message));
        }
        for term in &terms {
            let (first, len, weight, count_max) = match *term {
                Term::Position { first, len, weight } | Term::Ground { first, len, weight } => {
                    (first, len, weight, self.n_mat())
                }
                Term::Force { first, len, weight } | Term::Length { first, len, weight } => {
                    (first, len, weight, self.n_lia)
                }
            };
            if first.checked_add(len).is_none_or(|end| end > count_max) {
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

    /// Number of MATs of the module that begins at `first`: 1, or more for a generator.
    pub fn count(&self, first: usize) -> usize {
        self.names.count(first)
    }

    /// Index of the middle MAT of the module that begins at `first`.
    pub fn centre(&self, first: usize) -> usize {
        self.names.centre(first)
    }

    pub(super) fn add_mat(
        &mut self,
        name: &str,
        kind: MatKind,
        [m, k, z, rest, x0, v0]: [f64; 6],
    ) -> Result<usize, Error> {
        self.check_capacity(name, 1)?;
        let mat_index = self.n_mat();
        let part = self.current_part_index();
        self.mats.push(Mat {
            kind,
            m,
            k,
            z,
            rest,
            x0,
            v0,
            bench_position: [0.0; 2],
            part,
        });
        let name = self.full_name(name);
        self.names.add_mats(mat_index, 1, false, name, 0);
        Ok(mat_index)
    }

    /// Add one coordinate of a point in space that starts at [x, v]; it is fixed if its mass is 0.
    pub(super) fn push_coordinate(&mut self, m: f64, z: f64, [x0, v0]: [f64; 2]) {
        let kind = match (m > 0.0, z > 0.0) {
            (false, _) => MatKind::Sol,
            (true, false) => MatKind::Mas,
            (true, true) => MatKind::Cel,
        };
        let (z, v0) = if m > 0.0 { (z, v0) } else { (0.0, 0.0) };
        let part = self.current_part_index();
        self.mats.push(Mat {
            kind,
            m,
            k: 0.0,
            z,
            rest: 0.0,
            x0,
            v0,
            bench_position: [0.0; 2],
            part,
        });
    }

    /// Name the coordinates of `n` points along an axis.
    pub(super) fn name_coordinates(&mut self, first: usize, n: usize, is_numbered: bool, name: &str, axis: usize) {
        let name = self.full_name(name);
        self.names.add_coordinates(first, n, is_numbered, name, axis);
    }

    /// Let gravity act on MATs, with `g` [m/s²] along their axis; on fixed points it has no effect.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the first MAT if `g` is not finite.
    pub fn set_gravity(&mut self, mats: std::ops::Range<usize>, g: f64) -> Result<(), Error> {
        if !g.is_finite() {
            return Err(Error::Refused {
                module: self.mat_name(mats.start),
                message: format!("gravity is {g} m/s²: it must be a finite number"),
            });
        }
        self.mats.weight.resize(self.n_mat(), 0.0);
        for mat in mats.filter(|&mat| self.mats.kind[mat].moves()) {
            let mat_part = self.parts.get(self.mats.part[mat] as usize);
            // In a discrete network, M is m/T².
            let time_step = mat_part.and_then(|mat_part| mat_part.ca_rate).map_or(1.0, Rate::step);
            self.mats.weight[mat] = self.mats.m[mat] * g * time_step * time_step;
        }
        Ok(())
    }

    pub(super) fn add_run(&mut self, kind: LinkKind, a: usize, b: usize, len: usize, [k, z, rest]: [f64; 3]) {
        let part = self.current_part_index() as usize;
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
    pub(super) fn tuned_tie(&self, m: f64, f: f64, t60: Option<f64>) -> (f64, f64) {
        match self.ca_rate() {
            None => {
                let tuned_cell = Cell::tuned(m, f, t60);
                (tuned_cell.stiffness(), tuned_cell.viscosity())
            }
            Some(rate) => {
                let tuned_ratios = cell::tune(f, t60, rate);
                (tuned_ratios.kappa * m, tuned_ratios.zeta * m)
            }
        }
    }

    /// The part that modules are added to; begins a part without a name if there is none.
    pub(super) fn current_part_index(&mut self) -> u32 {
        if self.parts.is_empty() {
            self.part("", None);
        }
        self.current_part as u32
    }

    pub(super) fn ca_rate(&self) -> Option<Rate> {
        self.parts.get(self.current_part).and_then(|part| part.ca_rate)
    }

    /// The name of a module, prefixed with the name of its part.
    pub(super) fn full_name(&self, name: &str) -> String {
        let part_name = self
            .parts
            .get(self.current_part)
            .map_or("", |part_name| part_name.name.as_str());
        match (part_name.is_empty(), name.is_empty()) {
            (true, _) => name.to_owned(),
            (_, true) => part_name.to_owned(),
            _ => format!("{part_name}.{name}"),
        }
    }
}
