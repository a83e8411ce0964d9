//! IEQ, state of each link: ψ, its slope, and what the link adds to the system matrix.

use super::super::mesh::Mesh;
use super::super::passes;
use super::loops::{add_at_ends, advance_psi_run, set_spring_terms};
use crate::maths::{copysign, sqrt};
use crate::network::{Error, Network};
use crate::scheme::{ForceEnds, Spring};
use crate::scheme::{LinkRun, LinkRunKind, largest_eigenvalue};

/// The links, springs first, others after them.
#[derive(Clone, Debug)]
pub(super) struct IeqLinks {
    pub(super) runs: Vec<Spring>,
    /// β, how much of the linear springs is implicit: 0 to ¼.
    pub(super) beta: f64,
}

/// The state of the links.
#[derive(Clone, Debug)]
pub(super) struct LinkStates {
    /// ψ = √(2V) half a step ago [√J]          (n_links)
    psi: Vec<f64>,
    /// dψ/de at the current frame              (n_links)
    psi_slopes: Vec<f64>,
    /// What the link adds to the system matrix: ½z + βk + ¼(dψ/de)²   (n_links)
    pub(super) matrix_terms: Vec<f64>,
}

crate::archive::state!(LinkStates {
    psi,
    psi_slopes,
    matrix_terms
});

/// Refuses a link whose energy has no closed form, or falls below its value at rest.
pub(in super::super) fn check_supported(mesh: &Mesh, network: &Network) -> Result<(), Error> {
    let refuse_link = |a: usize, b: usize, message: &str| {
        let link_run = network
            .runs()
            .iter()
            .find(|link_run| (link_run.a, link_run.b) == (a, b));
        Err(Error::Refused {
            module: network.link_name(link_run.map_or(0, |link_run| link_run.first)),
            message: message.to_owned(),
        })
    };
    if let Some(link_run) = mesh
        .springs
        .iter()
        .find(|link_run| link_run.q < 0.0 || link_run.k < 0.0)
    {
        return refuse_link(
            link_run.a,
            link_run.b,
            "the energy of its law has no lower bound, so method ieq cannot compute it; choose another method",
        );
    }
    for link_run in &mesh.other_runs {
        let refusal_reason = match &link_run.kind {
            LinkRunKind::Lnl { law, .. } if law.is_shared() => Some(
                "method ieq cannot compute the tension of a string, which all its links share; choose another method",
            ),
            LinkRunKind::Lnl { law, .. } if !law.has_closed_energy() => {
                Some("method ieq needs a law by points or a polynomial, whose energy is known; choose another method")
            }
            LinkRunKind::Lnl { law, .. } => {
                // A law that pushes away from rest has a negative potential near rest.
                let mut probe_lengths = [1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6]
                    .into_iter()
                    .flat_map(|e| [e, -e]);
                probe_lengths.any(|e| law.potential(e) < 0.0).then_some(
                    "the energy of its law falls below its energy at rest, so method ieq cannot compute it; \
                         choose another method",
                )
            }
            LinkRunKind::But(but) if but.is_clamped && link_run.z != 0.0 => Some(
                "method ieq computes a contact with Z only if the contact may pull; remove `clamp`, or choose \
                     another method",
            ),
            _ => None,
        };
        if let Some(refusal_reason) = refusal_reason {
            return refuse_link(link_run.a, link_run.b, refusal_reason);
        }
    }
    Ok(())
}

/// λmax(M⁻¹K) of springs and ties, or an upper bound.
pub(super) fn linear_lambda_max(mesh: &Mesh, network: &Network) -> Result<f64, Error> {
    let mut linear_scheme = mesh.scheme.clone();
    linear_scheme.runs.retain(|run| match &run.kind {
        LinkRunKind::Ref | LinkRunKind::Hardening(_) => true,
        LinkRunKind::But(_)
        | LinkRunKind::Followed { .. }
        | LinkRunKind::Bristle { .. }
        | LinkRunKind::Dry { .. }
        | LinkRunKind::Space(_)
        | LinkRunKind::Pairwise { .. } => false,
        LinkRunKind::Lnl { law, .. } => law.hardening_spring().is_some(),
    });
    Ok(largest_eigenvalue(&linear_scheme, network, 0.0, super::EXPLICIT_LAMBDA_MAX)?.lambda)
}

impl IeqLinks {
    pub(super) fn new(mesh: &Mesh, beta: f64) -> Self {
        let other_springs = mesh.other_runs.iter().map(|run| Spring {
            a: run.a,
            b: run.b,
            len: run.len,
            k: 0.0,
            q: 0.0,
            z: 0.0,
            rest: run.rest,
            force_ends: ForceEnds::Both(run.a, run.b),
        });
        Self {
            runs: mesh.springs.iter().copied().chain(other_springs).collect(),
            beta,
        }
    }

    pub(super) fn longest_run(&self) -> usize {
        self.runs.iter().map(|run| run.len).max().unwrap_or(0)
    }

    /// State before frame 0: ψ half a step earlier, at the mean elongation of that step.
    pub(super) fn initial_states(&self, mesh: &Mesh, x: &[f64], d: &[f64]) -> LinkStates {
        let n_links = self.runs.iter().map(|run| run.len).sum();
        let mut link_states = LinkStates {
            psi: vec![0.0; n_links],
            psi_slopes: vec![0.0; n_links],
            matrix_terms: vec![0.0; n_links],
        };
        self.set_initial_states(mesh, x, d, &mut link_states);
        link_states
    }

    /// Set ψ and the constant part of the matrix term from the positions and last steps of the MATs.
    pub(super) fn set_initial_states(&self, mesh: &Mesh, x: &[f64], d: &[f64], state: &mut LinkStates) {
        let mut run_start = 0;
        for (run_index, run) in self.runs.iter().enumerate() {
            for i in 0..run.len {
                let (e, de) = elongation(run, x, d, i);
                let e = e - 0.5 * de;
                state.psi[run_start + i] = match run_index.checked_sub(mesh.springs.len()) {
                    None => sqrt(0.5 * run.q) * (e * e),
                    Some(other) => psi_of_run(&mesh.other_runs[other], e),
                };
                state.matrix_terms[run_start + i] = 0.5 * run.z + self.beta * run.k;
            }
            run_start += run.len;
        }
    }

    /// Returns what the links' elastic parts add to the system matrix at the start (n_links), and adds it to
    /// `diagonal`.
    pub(super) fn elastic_matrix(&self, mesh: &Mesh, motion: [&[f64]; 2], diagonal: &mut [f64]) -> Vec<f64> {
        let mut link_states = self.initial_states(mesh, motion[0], motion[1]);
        let (mut link_forces, mut right_side) = (vec![0.0; self.longest_run()], vec![0.0; diagonal.len()]);
        let mut unused_diagonal = right_side.clone();
        let side_and_diagonal = [&mut right_side[..], &mut unused_diagonal[..]];
        self.add_explicit_forces(mesh, motion, &mut link_states, &mut link_forces, side_and_diagonal);
        let mut run_start = 0;
        for run in &self.runs {
            let matrix_terms = &mut link_states.matrix_terms[run_start..run_start + run.len];
            for (matrix_term, psi_slope) in matrix_terms.iter_mut().zip(&link_states.psi_slopes[run_start..]) {
                *matrix_term = self.beta * run.k + 0.25 * psi_slope * psi_slope;
            }
            add_at_ends(matrix_terms, run.a, run.b, diagonal);
            run_start += run.len;
        }
        link_states.matrix_terms
    }

    /// Sets the slope of ψ and the matrix term of every link for the current frame; adds its explicit force to
    /// `right_side`, and the matrix term to the diagonal at both ends.
    pub(super) fn add_explicit_forces(
        &self,
        mesh: &Mesh,
        [x, d]: [&[f64]; 2],
        state: &mut LinkStates,
        forces: &mut [f64],
        [right_side, diagonal]: [&mut [f64]; 2],
    ) {
        let mut run_start = 0;
        for (run_index, run) in self.runs.iter().enumerate() {
            let run_span = run_start..run_start + run.len;
            let run_forces = &mut forces[..run.len];
            let (psi, psi_slopes) = (&state.psi[run_span.clone()], &mut state.psi_slopes[run_span.clone()]);
            let matrix_terms = &mut state.matrix_terms[run_span];
            match run_index.checked_sub(mesh.springs.len()) {
                None => set_spring_terms(run, self.beta, [x, d], psi, [psi_slopes, matrix_terms, run_forces]),
                Some(other) => {
                    let other = &mesh.other_runs[other];
                    for i in 0..run.len {
                        let (e, de) = elongation(run, x, d, i);
                        let (psi_slope, drag_factor, explicit_force) = slope_and_damping(other, e, de, psi[i]);
                        psi_slopes[i] = psi_slope;
                        matrix_terms[i] = 0.25 * psi_slope * psi_slope + 0.5 * drag_factor;
                        run_forces[i] = psi_slope * psi[i] + explicit_force;
                    }
                }
            }
            passes::add_to_ends(run_forces, run.a, run.b, right_side);
            add_at_ends(matrix_terms, run.a, run.b, diagonal);
            run_start += run.len;
        }
    }

    /// Advances ψ by one step, given the solution `s`.
    pub(super) fn advance_psi(&self, s: &[f64], state: &mut LinkStates) {
        let mut run_start = 0;
        for run in &self.runs {
            let run_span = run_start..run_start + run.len;
            let end_slices = [&s[run.a..][..run.len], &s[run.b..][..run.len]];
            advance_psi_run(
                &state.psi_slopes[run_span.clone()],
                end_slices,
                &mut state.psi[run_span],
            );
            run_start += run.len;
        }
    }

    /// Energy of all links half a step ago [J].
    pub(super) fn energy(&self, mesh: &Mesh, x: &[f64], d: &[f64], state: &LinkStates) -> f64 {
        let linear_energies = mesh.springs.iter().flat_map(|run| {
            (0..run.len).map(move |i| {
                let (e, de) = elongation(run, x, d, i);
                0.5 * run.k * (e * (e - de) + self.beta * (de * de))
            })
        });
        linear_energies.sum::<f64>() + state.psi.iter().map(|psi| 0.5 * (psi * psi)).sum::<f64>()
    }

    /// Energy of the non-linear parts of all links [J]: once from ψ, once from their laws as the mean of this frame and
    /// the last.
    pub(super) fn nonlinear_energies(&self, mesh: &Mesh, x: &[f64], d: &[f64], state: &LinkStates) -> (f64, f64) {
        let psi_energy = state.psi.iter().map(|psi| 0.5 * (psi * psi)).sum();
        let numbered_runs = self.runs.iter().enumerate();
        let law_energies = numbered_runs.flat_map(|(run_index, run)| {
            (0..run.len).map(move |i| {
                let (e, de) = elongation(run, x, d, i);
                let potential = |e: f64| match run_index.checked_sub(mesh.springs.len()) {
                    None => 0.25 * run.q * (e * e * e * e),
                    Some(other) => mesh.other_runs[other].potential_energy(e),
                };
                0.5 * (potential(e) + potential(e - de))
            })
        });
        (psi_energy, law_energies.sum())
    }
}

/// Elongation of link i of a run, and its last step [m].
fn elongation(run: &Spring, x: &[f64], d: &[f64], i: usize) -> (f64, f64) {
    let (end_a, end_b) = (run.a + i, run.b + i);
    (x[end_b] - x[end_a] - run.rest, d[end_b] - d[end_a])
}

/// ψ of a contact or a law: √(2V), with the sign of e for a law that acts on both sides.
fn psi_of_run(run: &LinkRun, e: f64) -> f64 {
    match &run.kind {
        LinkRunKind::Lnl { law, .. } => copysign(sqrt(2.0 * law.potential(e)), e),
        LinkRunKind::But(but) => {
            let penetration = but.sign() * e;
            sqrt(2.0 * but.elastic(run.k).energy(penetration.max(0.0)))
        }
        LinkRunKind::Ref
        | LinkRunKind::Hardening(_)
        | LinkRunKind::Followed { .. }
        | LinkRunKind::Bristle { .. }
        | LinkRunKind::Dry { .. }
        | LinkRunKind::Space(_)
        | LinkRunKind::Pairwise { .. } => 0.0,
    }
}

/// dψ/de of a contact or a law, the coefficient of damping that acts implicitly, and an explicit force.
fn slope_and_damping(run: &LinkRun, e: f64, de: f64, psi_now: f64) -> (f64, f64, f64) {
    match &run.kind {
        LinkRunKind::Lnl {
            law, velocity_factor, ..
        } => {
            let potential_root = psi_of_run(run, e);
            let psi_slope = if potential_root == 0.0 {
                sqrt(law.slope(e).max(0.0))
            } else {
                law.spring(e) / potential_root
            };
            let drag_force = if law.is_damped() {
                law.force(e, de * velocity_factor) - law.spring(e)
            } else {
                0.0
            };
            // Damping that takes energy acts implicitly, as force over velocity; damping that gives energy acts as an
            // explicit force.
            if drag_force * de > 0.0 {
                (psi_slope, drag_force / de, 0.0)
            } else {
                (psi_slope, 0.0, drag_force)
            }
        }
        LinkRunKind::But(but) => {
            let contact_sign = but.sign();
            let penetration = contact_sign * e;
            let psi_slope = if penetration > 0.0 {
                copysign(but.elastic(run.k).root_slope(penetration), psi_now)
            } else if psi_now != 0.0 && contact_sign * de < 0.0 {
                // Open contact: choose the slope that brings the remaining ψ to zero as the ends part, as if no other
                // force acted.
                -psi_now / (contact_sign * de)
            } else {
                0.0
            };
            (
                contact_sign * psi_slope,
                if penetration > 0.0 { run.z } else { 0.0 },
                0.0,
            )
        }
        LinkRunKind::Ref
        | LinkRunKind::Hardening(_)
        | LinkRunKind::Followed { .. }
        | LinkRunKind::Bristle { .. }
        | LinkRunKind::Dry { .. }
        | LinkRunKind::Space(_)
        | LinkRunKind::Pairwise { .. } => (0.0, 0.0, run.force(e, de)),
    }
}
