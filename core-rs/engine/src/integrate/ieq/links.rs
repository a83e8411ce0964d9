//! IEQ, state of each link: ψ, its slope g, and what the link adds to the system matrix.

use super::super::mesh::Mesh;
use super::super::passes;
use super::loops::{add_at_ends, advance_psi_run, springs};
use crate::maths::power_law;
use crate::maths::{copysign, sqrt};
use crate::network::{Error, Network};
use crate::scheme::{Kind, Run, top};
use crate::scheme::{Pull, Spring};

/// The links, springs first, others after them.
#[derive(Clone, Debug)]
pub(super) struct Links {
    pub(super) runs: Vec<Spring>,
    /// β, how much of the linear springs is implicit: 0 to ¼.
    pub(super) beta: f64,
}

/// The state of the links.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// ψ = √(2V) half a step ago [√J]          (n_links)
    psi: Vec<f64>,
    /// dψ/de at the current frame              (n_links)
    g: Vec<f64>,
    /// What the link adds to the system matrix: ½z + βk + ¼g²   (n_links)
    pub(super) c: Vec<f64>,
}

crate::archive::state!(State { psi, g, c });

/// Refuses a link whose energy has no closed form, or falls below its value at rest.
pub(in super::super) fn check_supported(mesh: &Mesh, network: &Network) -> Result<(), Error> {
    let refuse = |a: usize, b: usize, message: &str| {
        let run = network.runs().iter().find(|run| (run.a, run.b) == (a, b));
        Err(Error::Refused {
            module: network.link_name(run.map_or(0, |run| run.first)),
            message: message.to_owned(),
        })
    };
    if let Some(run) = mesh.springs.iter().find(|run| run.q < 0.0 || run.k < 0.0) {
        return refuse(
            run.a,
            run.b,
            "the energy of its law has no lower bound, so method ieq cannot compute it; choose another method",
        );
    }
    for run in &mesh.others {
        let why = match &run.kind {
            Kind::Lnl { law, .. } if law.is_shared() => Some(
                "method ieq cannot compute the tension of a string, which all its links share; choose another method",
            ),
            Kind::Lnl { law, .. } if !law.has_closed_energy() => Some(
                "method ieq needs a law by points or a polynomial, whose energy is known; choose another method",
            ),
            Kind::Lnl { law, .. } => {
                // A law that pushes away from rest has a negative potential near rest.
                let mut reach = [1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6]
                    .into_iter()
                    .flat_map(|e| [e, -e]);
                reach
                    .any(|e| law.potential(e) < 0.0)
                    .then_some(
                        "the energy of its law falls below its energy at rest, so method ieq cannot compute it; \
                         choose another method",
                    )
            }
            Kind::But(but) if but.clamp && run.z != 0.0 => Some(
                "method ieq computes a contact with Z only if the contact may pull; remove `clamp`, or choose \
                     another method",
            ),
            _ => None,
        };
        if let Some(why) = why {
            return refuse(run.a, run.b, why);
        }
    }
    Ok(())
}

/// λmax(M⁻¹K) of springs and ties, or an upper bound.
pub(super) fn linear_part(mesh: &Mesh, network: &Network) -> Result<f64, Error> {
    let mut linear = mesh.scheme.clone();
    linear.runs.retain(|run| match &run.kind {
        Kind::Ref | Kind::Hardening(_) => true,
        Kind::But(_)
        | Kind::Followed { .. }
        | Kind::Bristle { .. }
        | Kind::Dry { .. }
        | Kind::Space(_)
        | Kind::Pairwise { .. } => false,
        Kind::Lnl { law, .. } => law.hardening_spring().is_some(),
    });
    Ok(top(&linear, network, 0.0, super::EXPLICIT)?.lambda)
}

impl Links {
    pub(super) fn new(mesh: &Mesh, beta: f64) -> Self {
        let others = mesh.others.iter().map(|run| Spring {
            a: run.a,
            b: run.b,
            len: run.len,
            k: 0.0,
            q: 0.0,
            z: 0.0,
            rest: run.rest,
            pull: Pull::Both(run.a, run.b),
        });
        Self {
            runs: mesh.springs.iter().copied().chain(others).collect(),
            beta,
        }
    }

    pub(super) fn longest(&self) -> usize {
        self.runs.iter().map(|run| run.len).max().unwrap_or(0)
    }

    /// State before frame 0: ψ half a step earlier, at the mean elongation of that step.
    pub(super) fn start(&self, mesh: &Mesh, x: &[f64], d: &[f64]) -> State {
        let n = self.runs.iter().map(|run| run.len).sum();
        let mut state = State {
            psi: vec![0.0; n],
            g: vec![0.0; n],
            c: vec![0.0; n],
        };
        self.begin(mesh, x, d, &mut state);
        state
    }

    /// Set ψ and the constant part of c from the positions and last steps of the MATs.
    pub(super) fn begin(&self, mesh: &Mesh, x: &[f64], d: &[f64], state: &mut State) {
        let mut first = 0;
        for (run_index, run) in self.runs.iter().enumerate() {
            for i in 0..run.len {
                let (e, de) = elongation(run, x, d, i);
                let e = e - 0.5 * de;
                state.psi[first + i] = match run_index.checked_sub(mesh.springs.len()) {
                    None => sqrt(0.5 * run.q) * (e * e),
                    Some(other) => psi(&mesh.others[other], e),
                };
                state.c[first + i] = 0.5 * run.z + self.beta * run.k;
            }
            first += run.len;
        }
    }

    /// Returns what the links' elastic parts add to the system matrix at the start (n_links), and adds it to
    /// `diagonal`.
    pub(super) fn elastic_matrix(
        &self,
        mesh: &Mesh,
        motion: [&[f64]; 2],
        diagonal: &mut [f64],
    ) -> Vec<f64> {
        let mut state = self.start(mesh, motion[0], motion[1]);
        let (mut forces, mut right) = (vec![0.0; self.longest()], vec![0.0; diagonal.len()]);
        let mut unused = right.clone();
        let sums = [&mut right[..], &mut unused[..]];
        self.gather(mesh, motion, &mut state, &mut forces, sums);
        let mut first = 0;
        for run in &self.runs {
            let c = &mut state.c[first..first + run.len];
            for (c, g) in c.iter_mut().zip(&state.g[first..]) {
                *c = self.beta * run.k + 0.25 * g * g;
            }
            add_at_ends(c, run.a, run.b, diagonal);
            first += run.len;
        }
        state.c
    }

    /// Sets g and c of every link for the current frame; adds its explicit force to `right`, and c to the diagonal at
    /// both ends.
    pub(super) fn gather(
        &self,
        mesh: &Mesh,
        [x, d]: [&[f64]; 2],
        state: &mut State,
        forces: &mut [f64],
        [right, diagonal]: [&mut [f64]; 2],
    ) {
        let mut first = 0;
        for (run_index, run) in self.runs.iter().enumerate() {
            let span = first..first + run.len;
            let f = &mut forces[..run.len];
            let (psi, g) = (&state.psi[span.clone()], &mut state.g[span.clone()]);
            let c = &mut state.c[span];
            match run_index.checked_sub(mesh.springs.len()) {
                None => springs(run, self.beta, [x, d], psi, [g, c, f]),
                Some(other) => {
                    let other = &mesh.others[other];
                    for i in 0..run.len {
                        let (e, de) = elongation(run, x, d, i);
                        let (slope, drag, push) = slope_and_damping(other, e, de, psi[i]);
                        g[i] = slope;
                        c[i] = 0.25 * slope * slope + 0.5 * drag;
                        f[i] = slope * psi[i] + push;
                    }
                }
            }
            passes::pull(f, run.a, run.b, right);
            add_at_ends(c, run.a, run.b, diagonal);
            first += run.len;
        }
    }

    /// Advances ψ by one step, given the solution `s`.
    pub(super) fn advance_psi(&self, s: &[f64], state: &mut State) {
        let mut first = 0;
        for run in &self.runs {
            let span = first..first + run.len;
            let ends = [&s[run.a..][..run.len], &s[run.b..][..run.len]];
            advance_psi_run(&state.g[span.clone()], ends, &mut state.psi[span]);
            first += run.len;
        }
    }

    /// Energy of all links half a step ago [J].
    pub(super) fn energy(&self, mesh: &Mesh, x: &[f64], d: &[f64], state: &State) -> f64 {
        let linear = mesh.springs.iter().flat_map(|run| {
            (0..run.len).map(move |i| {
                let (e, de) = elongation(run, x, d, i);
                0.5 * run.k * (e * (e - de) + self.beta * (de * de))
            })
        });
        linear.sum::<f64>() + state.psi.iter().map(|psi| 0.5 * (psi * psi)).sum::<f64>()
    }

    /// Energy of the non-linear parts of all links [J]: once from ψ, once from their laws as the mean of this frame and
    /// the last.
    pub(super) fn nonlinear_energies(
        &self,
        mesh: &Mesh,
        x: &[f64],
        d: &[f64],
        state: &State,
    ) -> (f64, f64) {
        let quadratic = state.psi.iter().map(|psi| 0.5 * (psi * psi)).sum();
        let runs = self.runs.iter().enumerate();
        let each = runs.flat_map(|(run_index, run)| {
            (0..run.len).map(move |i| {
                let (e, de) = elongation(run, x, d, i);
                let potential = |e: f64| match run_index.checked_sub(mesh.springs.len()) {
                    None => 0.25 * run.q * (e * e * e * e),
                    Some(other) => mesh.others[other].potential(e),
                };
                0.5 * (potential(e) + potential(e - de))
            })
        });
        (quadratic, each.sum())
    }
}

/// Elongation of link i of a run, and its last step [m].
fn elongation(run: &Spring, x: &[f64], d: &[f64], i: usize) -> (f64, f64) {
    let (a, b) = (run.a + i, run.b + i);
    (x[b] - x[a] - run.rest, d[b] - d[a])
}

/// ψ of a contact or a law: √(2V), with the sign of e for a law that acts on both sides.
fn psi(run: &Run, e: f64) -> f64 {
    match &run.kind {
        Kind::Lnl { law, .. } => copysign(sqrt(2.0 * law.potential(e)), e),
        Kind::But(but) => {
            let p = but.sign() * e;
            sqrt(2.0 * but.elastic(run.k).energy(p.max(0.0)))
        }
        Kind::Ref
        | Kind::Hardening(_)
        | Kind::Followed { .. }
        | Kind::Bristle { .. }
        | Kind::Dry { .. }
        | Kind::Space(_)
        | Kind::Pairwise { .. } => 0.0,
    }
}

/// dψ/de of a contact or a law, the coefficient of damping that acts implicitly, and an explicit force.
fn slope_and_damping(run: &Run, e: f64, de: f64, psi_now: f64) -> (f64, f64, f64) {
    match &run.kind {
        Kind::Lnl { law, rate, .. } => {
            let stored = psi(run, e);
            let slope = if stored == 0.0 {
                sqrt(law.slope(e).max(0.0))
            } else {
                law.spring(e) / stored
            };
            let drag = if law.is_damped() {
                law.force(e, de * rate) - law.spring(e)
            } else {
                0.0
            };
            // Damping that takes energy acts implicitly, as force over velocity; damping that gives energy acts as an
            // explicit force.
            if drag * de > 0.0 {
                (slope, drag / de, 0.0)
            } else {
                (slope, 0.0, drag)
            }
        }
        Kind::But(but) => {
            let s = but.sign();
            let p = s * e;
            let slope = if p > 0.0 {
                let steep = sqrt(0.5 * run.k * (but.exponent + 1.0));
                copysign(steep * power_law(p, 0.5 * (but.exponent - 1.0)), psi_now)
            } else if psi_now != 0.0 && s * de < 0.0 {
                // Open contact: choose the slope that brings the remaining ψ to zero as the ends part, as if no other
                // force acted.
                -psi_now / (s * de)
            } else {
                0.0
            };
            (s * slope, if p > 0.0 { run.z } else { 0.0 }, 0.0)
        }
        Kind::Ref
        | Kind::Hardening(_)
        | Kind::Followed { .. }
        | Kind::Bristle { .. }
        | Kind::Dry { .. }
        | Kind::Space(_)
        | Kind::Pairwise { .. } => (0.0, 0.0, run.force(e, de)),
    }
}
