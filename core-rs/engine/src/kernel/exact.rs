//! Forces of contacts with `contact: exact`, which conserve the energy. They use a discrete gradient (Chatziioannou &
//! van Walstijn 2015): in closed form for a linear contact, by a bracketed secant for a power law. Dry friction is
//! solved together with them.

mod friction;

pub(crate) use friction::{SLIDE_DISTANCE_MIN, stop_resting_masses};

use super::predict_position;
use super::runs::scatter;
use crate::network::ContactLaw;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::{ImposedTarget, ModuleState};

/// Largest number of secant steps; 5 to 10 are usual. Two steps at least halve the bracket, so that so many steps
/// always close it.
const SECANT_STEPS_MAX: usize = 200;

/// Largest number of rounds over contacts that share a MAT: a dozen is usual. Guesses keep the number small where
/// rounds alone would take a hundred, as for light masses between stiff contacts, or friction that holds masses in a
/// circle.
const ROUNDS_MAX: usize = 200;
/// Rounds before the first guess: contacts that converge by themselves need none.
const UNACCELERATED_ROUNDS: usize = 4;
/// Relative change of a force below which contacts that share a MAT have converged.
const FORCE_TOLERANCE: f64 = 1e-14;
/// The same relative to the largest force: less is rounding of the sums on their MATs.
const FORCE_ROUNDING_RATIO: f64 = 4.0 * f64::EPSILON;

/// Solve all exact contacts and all dry friction, after all other forces are summed. Those that share a MAT are solved
/// in turn until they converge (Gauss-Seidel; the problem is convex, so that this converges).
pub(crate) fn solve_exact_contacts(
    scheme: &Scheme,
    gates: &[f64],
    targets: &[ImposedTarget],
    modules: &mut ModuleState,
) {
    for run in &scheme.exact_runs {
        modules.link_forces[run.first_link] = 0.0;
    }
    solve_runs(scheme, gates, targets, modules, |_| true);
}

/// Solve all dry friction again, after the forces of contacts in substeps were added: friction is the last force on a
/// mass.
pub(crate) fn solve_friction(scheme: &Scheme, gates: &[f64], targets: &[ImposedTarget], modules: &mut ModuleState) {
    solve_runs(scheme, gates, targets, modules, LinkRun::is_dry);
}

/// Solve those exact runs for which `is_solved` holds, in turn until they converge.
fn solve_runs(
    scheme: &Scheme,
    gates: &[f64],
    targets: &[ImposedTarget],
    modules: &mut ModuleState,
    is_solved: impl Fn(&LinkRun) -> bool,
) {
    if scheme.exact_runs.is_empty() {
        return;
    }
    let is_solved = |run: &&LinkRun| is_solved(run);
    let round_limit = if scheme.has_coupled_exact_runs { ROUNDS_MAX } else { 1 };
    let mut force_mixing = std::mem::take(&mut modules.round_mixing);
    if scheme.has_coupled_exact_runs {
        force_mixing.start(scheme.exact_runs.iter().filter(is_solved).count());
    }
    for round in 0..round_limit {
        let (mut change_max, mut force_max) = (0.0_f64, 0.0_f64);
        if scheme.has_coupled_exact_runs {
            force_mixing.next_round();
        }
        for (index, run) in scheme.exact_runs.iter().filter(is_solved).enumerate() {
            modules.exact_work.n_resolved += u64::from(round > 0);
            let force_before = modules.link_forces[run.first_link];
            // Subtract the force of the last round, so that the run is solved given all other forces.
            modules.link_forces[run.first_link] = -force_before;
            scatter(run, modules);
            let (force, evaluations) = run_force(scheme, gates, targets, modules, run);
            modules.link_forces[run.first_link] = force;
            modules.exact_work.evaluations += evaluations;
            scatter(run, modules);
            let force_now = modules.link_forces[run.first_link];
            change_max = change_max.max((force_now - force_before).abs() - FORCE_TOLERANCE * force_now.abs());
            force_max = force_max.max(force_now.abs());
            if scheme.has_coupled_exact_runs {
                force_mixing.record(index, force_before, force_now);
            }
        }
        if change_max <= FORCE_ROUNDING_RATIO * force_max {
            break;
        }
        if round >= UNACCELERATED_ROUNDS && round + 1 < round_limit {
            let solved_runs = scheme.exact_runs.iter().filter(is_solved);
            for (run, &guess) in solved_runs.zip(force_mixing.guess()) {
                modules.link_forces[run.first_link] = guess - modules.link_forces[run.first_link];
                scatter(run, modules);
                modules.link_forces[run.first_link] = guess;
            }
        }
    }
    modules.round_mixing = force_mixing;
}

/// Force of one exact contact or dry friction, given all other forces [N], and how often it evaluated a power law.
fn run_force(
    scheme: &Scheme,
    gates: &[f64],
    targets: &[ImposedTarget],
    modules: &ModuleState,
    run: &LinkRun,
) -> (f64, u64) {
    let but = match &run.kind {
        LinkRunKind::But(but) => but,
        LinkRunKind::Dry { .. } => return (friction::force(scheme, gates, targets, modules, run), 0),
        _ => return (0.0, 0),
    };
    let contact_side = but.sign();
    let next_position_and_compliance = |i: usize| match targets.iter().find(|target| target.mat == i) {
        Some(target) => (target.x, 0.0),
        None => (predict_position(scheme, modules, i), scheme.w[i]),
    };
    let ((xa, wa), (xb, wb)) = (next_position_and_compliance(run.a), next_position_and_compliance(run.b));
    let (x, d) = (&modules.x, &modules.d);
    let depth_now = contact_side * (x[run.b] - x[run.a] - run.rest);
    let depth_before = depth_now - contact_side * (d[run.b] - d[run.a]);
    let free_depth = contact_side * (xb - xa - run.rest);
    let gate_opening = run.gate.map_or(1.0, |gate| gates[gate]);
    let contact = ExactContact {
        law: but.law(gate_opening * run.k, gate_opening * run.z),
        beta: wa + wb,
    };
    let (push_force, evaluations) = contact.counted_push(free_depth, depth_before, depth_now);
    (contact_side * push_force, evaluations)
}

/// A contact over one step, from n−1 to n+1: its law with Z per step, and β, the change of its penetration per newton
/// [m/N].
pub(crate) struct ExactContact {
    pub(crate) law: ContactLaw,
    pub(crate) beta: f64,
}

impl ExactContact {
    /// The force [N] that takes the penetration from `depth_before` (at n−1) to u (at n+1). `free_depth` is the
    /// penetration at n+1 without this force, `depth_now` that at n [m].
    pub(crate) fn push(&self, free_depth: f64, depth_before: f64, depth_now: f64) -> f64 {
        self.counted_push(free_depth, depth_before, depth_now).0
    }

    /// The same, and how often the power law was evaluated.
    fn counted_push(&self, free_depth: f64, depth_before: f64, depth_now: f64) -> (f64, u64) {
        // Both ends are imposed (β = 0): the next penetration is known, and the gradient is explicit.
        if self.beta == 0.0 {
            let push_force =
                self.gradient(free_depth, depth_before) + self.damping_force(free_depth, depth_before, depth_now);
            return (self.law.limited_force(push_force), 1);
        }
        // Damping acts while the contact is closed: p ← (p + γw)/(1 + γ), β ← β/(1 + γ).
        let gamma = if depth_now > 0.0 {
            self.beta * self.law.z / 2.0
        } else {
            0.0
        };
        let p = (free_depth + gamma * depth_before) / (1.0 + gamma);
        let beta = self.beta / (1.0 + gamma);
        let (depth, evaluations) = if self.law.elastic.exponent == 1.0 {
            (linear_depth(p, depth_before, beta * self.law.elastic.k / 2.0), 0)
        } else {
            self.solve_power_law(p, depth_before, beta)
        };
        (self.law.limited_force((free_depth - depth) / self.beta), evaluations)
    }

    fn damping_force(&self, u: f64, w: f64, depth_now: f64) -> f64 {
        if depth_now > 0.0 {
            self.law.z * (u - w) / 2.0
        } else {
            0.0
        }
    }

    fn potential(&self, p: f64) -> f64 {
        if p > 0.0 { self.law.elastic.energy(p) } else { 0.0 }
    }

    /// (V(u) − V(w))/(u − w); the force V′ where u = w.
    fn gradient(&self, u: f64, w: f64) -> f64 {
        let difference = u - w;
        // For a smaller difference the quotient loses more digits than the error of Simpson's rule.
        if difference.abs() <= 1e-3 * (u.abs() + w.abs()) {
            let force = |p: f64| self.law.elastic.force(p);
            return if u > 0.0 {
                (force(u) + 4.0 * force(0.5 * (u + w)) + force(w)) / 6.0
            } else {
                0.0
            };
        }
        (self.potential(u) - self.potential(w)) / difference
    }

    /// Solve u + β·gradient(u, w) = p by a bracketed secant; the left side increases with u, so that the root can be
    /// bracketed. Also returns the number of evaluations.
    fn solve_power_law(&self, p: f64, w: f64, beta: f64) -> (f64, u64) {
        if p <= 0.0 && w <= 0.0 {
            return (p, 0);
        }
        let mut evaluations = 1;
        let mut residue = |u: f64| {
            evaluations += 1;
            u + beta * self.gradient(u, w) - p
        };
        let (mut high_end, mut low_end) = (p, p - beta * self.gradient(p, w));
        let (mut high_residue, mut low_residue) = (residue(high_end), residue(low_end));
        while low_residue > 0.0 {
            // If both ends of the bracket round to the same number, move them apart.
            low_end -= (high_end - low_end).max(f64::EPSILON * high_end.abs());
            low_residue = residue(low_end);
        }
        let (mut must_halve, mut last_residue) = (false, 0.0);
        for _ in 0..SECANT_STEPS_MAX {
            let bracket_width = high_end - low_end;
            if bracket_width <= 4.0 * f64::EPSILON * high_end.abs().max(low_end.abs()) {
                break;
            }
            let secant_root = low_end - low_residue * (bracket_width / (high_residue - low_residue));
            let u = if must_halve || !(secant_root > low_end && secant_root < high_end) {
                0.5 * (low_end + high_end)
            } else {
                secant_root
            };
            let residue_at_u = residue(u);
            if residue_at_u.abs() <= f64::EPSILON * p.abs().max(u.abs()) {
                return (u, evaluations); // only rounding is left
            }
            // Illinois rule: halve the residue at the end that stays, so that the next secant falls on its side.
            let stay_factor = if residue_at_u * last_residue > 0.0 { 0.5 } else { 1.0 };
            if residue_at_u > 0.0 {
                (high_end, high_residue, low_residue) = (u, residue_at_u, stay_factor * low_residue);
            } else {
                (low_end, low_residue, high_residue) = (u, residue_at_u, stay_factor * high_residue);
            }
            last_residue = residue_at_u;
            must_halve = high_end - low_end > 0.5 * bracket_width;
        }
        (0.5 * (low_end + high_end), evaluations)
    }
}

/// Closed form for V = ½K·max(p, 0)², a = βK/2.
fn linear_depth(p: f64, w: f64, a: f64) -> f64 {
    if w >= 0.0 {
        let u = (p - a * w) / (1.0 + a);
        if u >= 0.0 {
            return u;
        }
        // The contact opens. Written without cancellation: the sum and the root are nearly equal.
        let sum = p + w;
        let root = ((p - w) * (p - w) + 4.0 * a * w * w).sqrt();
        if sum > 0.0 {
            2.0 * w * (p - a * w) / (sum + root)
        } else {
            0.5 * (sum - root)
        }
    } else if p <= 0.0 {
        p
    } else {
        let sum = p + w;
        let root = (sum * sum - 4.0 * (1.0 + a) * p * w).sqrt();
        if sum >= 0.0 {
            (sum + root) / (2.0 * (1.0 + a))
        } else {
            2.0 * p * w / (sum - root)
        }
    }
}

#[cfg(test)]
mod tests;
