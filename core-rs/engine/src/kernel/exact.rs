//! Forces of contacts with `contact: exact`, which conserve the energy. They use a discrete gradient (Chatziioannou &
//! van Walstijn 2015): in closed form for a linear contact, by a bracketed secant for a power law. Dry friction is
//! solved together with them.

mod friction;

pub(crate) use friction::{STILL, rest};

use super::predict;
use super::runs::scatter;
use crate::network::PowerLaw;
use crate::scheme::{Kind, Run, Scheme};
use crate::state::{Body, Target};

/// Largest number of secant steps; 5 to 10 are usual. Two steps at least halve the bracket, so that so many steps
/// always close it.
const STEPS_MAX: usize = 200;

/// Largest number of rounds over contacts that share a MAT: a dozen is usual, and guesses keep it so where rounds alone
/// would take a hundred, as for light masses between stiff contacts, or friction that holds masses in a circle.
const ROUNDS_MAX: usize = 200;
/// Rounds before the first guess: what converges by itself is left alone.
const PLAIN_ROUNDS: usize = 4;
/// Relative change of a force below which contacts that share a MAT have converged, and the same relative to the largest
/// force: less is rounding of the sums on their MATs.
const AGREE: f64 = 1e-14;
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Solve all exact contacts and all dry friction, after all other forces are summed. Those that share a MAT are solved
/// in turn until they converge (Gauss-Seidel; the problem is convex, so that this converges).
pub(crate) fn contacts(scheme: &Scheme, gates: &[f64], targets: &[Target], body: &mut Body) {
    for run in &scheme.exact {
        body.link[run.first] = 0.0;
    }
    solve(scheme, gates, targets, body, |_| true);
}

/// Solve all dry friction again, after the forces of contacts in substeps were added: friction is the last force on a
/// mass.
pub(crate) fn friction(scheme: &Scheme, gates: &[f64], targets: &[Target], body: &mut Body) {
    solve(scheme, gates, targets, body, Run::is_dry);
}

/// Solve those exact runs for which `is_solved` holds, in turn until they converge.
fn solve(
    scheme: &Scheme,
    gates: &[f64],
    targets: &[Target],
    body: &mut Body,
    is_solved: impl Fn(&Run) -> bool,
) {
    let is_solved = |run: &&Run| is_solved(run);
    let rounds = if scheme.exact_coupled { ROUNDS_MAX } else { 1 };
    let mut mixing = std::mem::take(&mut body.mixing);
    if scheme.exact_coupled {
        mixing.start(scheme.exact.iter().filter(is_solved).count());
    }
    for round in 0..rounds {
        let (mut change, mut largest) = (0.0_f64, 0.0_f64);
        if scheme.exact_coupled {
            mixing.next_round();
        }
        for (index, run) in scheme.exact.iter().filter(is_solved).enumerate() {
            body.exact_work.solved_again += u64::from(round > 0);
            let before = body.link[run.first];
            // Subtract the force of the last round, so that the run is solved given all other forces.
            body.link[run.first] = -before;
            scatter(run, body);
            let (force, evaluations) = force(scheme, gates, targets, body, run);
            body.link[run.first] = force;
            body.exact_work.evaluations += evaluations;
            scatter(run, body);
            let now = body.link[run.first];
            change = change.max((now - before).abs() - AGREE * now.abs());
            largest = largest.max(now.abs());
            if scheme.exact_coupled {
                mixing.record(index, before, now);
            }
        }
        if change <= ROUNDING * largest {
            break;
        }
        if round >= PLAIN_ROUNDS && round + 1 < rounds {
            let runs = scheme.exact.iter().filter(is_solved);
            for (run, &guess) in runs.zip(mixing.guess()) {
                body.link[run.first] = guess - body.link[run.first];
                scatter(run, body);
                body.link[run.first] = guess;
            }
        }
    }
    body.mixing = mixing;
}

/// Force of one exact contact or dry friction, given all other forces [N], and how often it evaluated a power law.
fn force(scheme: &Scheme, gates: &[f64], targets: &[Target], body: &Body, run: &Run) -> (f64, u64) {
    let but = match &run.kind {
        Kind::But(but) => but,
        Kind::Dry { .. } => return (friction::force(scheme, gates, targets, body, run), 0),
        _ => return (0.0, 0),
    };
    let s = but.sign();
    let next = |i: usize| match targets.iter().find(|target| target.mat == i) {
        Some(target) => (target.x, 0.0),
        None => (predict(scheme, body, i), scheme.w[i]),
    };
    let ((xa, wa), (xb, wb)) = (next(run.a), next(run.b));
    let (x, d) = (&body.x, &body.d);
    let now = s * (x[run.b] - x[run.a] - run.rest);
    let before = now - s * (d[run.b] - d[run.a]);
    let free = s * (xb - xa - run.rest);
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    let contact = Contact {
        k: open * run.k,
        z: open * run.z,
        exponent: but.exponent,
        beta: wa + wb,
        clamp: but.clamp,
    };
    let (push, evaluations) = contact.counted_push(free, before, now);
    (s * push, evaluations)
}

/// A contact over one step, from n−1 to n+1: K and Z per step, and β, the change of its penetration per newton [m/N].
pub(crate) struct Contact {
    pub(crate) k: f64,
    pub(crate) z: f64,
    pub(crate) exponent: f64,
    pub(crate) beta: f64,
    pub(crate) clamp: bool,
}

impl Contact {
    /// The force [N] that takes the penetration from `w` (at n−1) to u (at n+1). `free` is the penetration at n+1
    /// without this force, `now` that at n [m].
    pub(crate) fn push(&self, free: f64, w: f64, now: f64) -> f64 {
        self.counted_push(free, w, now).0
    }

    /// The same, and how often the power law was evaluated.
    fn counted_push(&self, free: f64, w: f64, now: f64) -> (f64, u64) {
        // Both ends are imposed (β = 0): the next penetration is known, and the gradient is explicit.
        if self.beta == 0.0 {
            let push = self.gradient(free, w) + self.drag(free, w, now);
            return (self.limit(push), 1);
        }
        // Damping acts while the contact is closed: p ← (p + γw)/(1 + γ), β ← β/(1 + γ).
        let gamma = if now > 0.0 {
            self.beta * self.z / 2.0
        } else {
            0.0
        };
        let p = (free + gamma * w) / (1.0 + gamma);
        let beta = self.beta / (1.0 + gamma);
        let (u, evaluations) = if self.exponent == 1.0 {
            (linear(p, w, beta * self.k / 2.0), 0)
        } else {
            self.solve(p, w, beta)
        };
        (self.limit((free - u) / self.beta), evaluations)
    }

    fn elastic(&self) -> PowerLaw {
        PowerLaw {
            k: self.k,
            exponent: self.exponent,
        }
    }

    fn limit(&self, push: f64) -> f64 {
        if self.clamp { push.max(0.0) } else { push }
    }

    fn drag(&self, u: f64, w: f64, now: f64) -> f64 {
        if now > 0.0 {
            self.z * (u - w) / 2.0
        } else {
            0.0
        }
    }

    fn potential(&self, p: f64) -> f64 {
        if p > 0.0 {
            self.elastic().energy(p)
        } else {
            0.0
        }
    }

    /// (V(u) − V(w))/(u − w); the force V′ where u = w.
    fn gradient(&self, u: f64, w: f64) -> f64 {
        let apart = u - w;
        // For a smaller difference the quotient loses more digits than the error of Simpson's rule.
        if apart.abs() <= 1e-3 * (u.abs() + w.abs()) {
            let force = |p: f64| self.elastic().force(p);
            return if u > 0.0 {
                (force(u) + 4.0 * force(0.5 * (u + w)) + force(w)) / 6.0
            } else {
                0.0
            };
        }
        (self.potential(u) - self.potential(w)) / apart
    }

    /// Solve u + β·gradient(u, w) = p by a bracketed secant; the left side increases with u, so that the root can be
    /// bracketed. Also returns the number of evaluations.
    fn solve(&self, p: f64, w: f64, beta: f64) -> (f64, u64) {
        if p <= 0.0 && w <= 0.0 {
            return (p, 0);
        }
        let mut evaluations = 1;
        let mut residue = |u: f64| {
            evaluations += 1;
            u + beta * self.gradient(u, w) - p
        };
        let (mut high, mut low) = (p, p - beta * self.gradient(p, w));
        let (mut high_residue, mut low_residue) = (residue(high), residue(low));
        while low_residue > 0.0 {
            // If both ends of the bracket round to the same number, move them apart.
            low -= (high - low).max(f64::EPSILON * high.abs());
            low_residue = residue(low);
        }
        let (mut halve, mut side) = (false, 0.0);
        for _ in 0..STEPS_MAX {
            let width = high - low;
            if width <= 4.0 * f64::EPSILON * high.abs().max(low.abs()) {
                break;
            }
            let secant = low - low_residue * (width / (high_residue - low_residue));
            let u = if halve || !(secant > low && secant < high) {
                0.5 * (low + high)
            } else {
                secant
            };
            let residue_at_u = residue(u);
            if residue_at_u.abs() <= f64::EPSILON * p.abs().max(u.abs()) {
                return (u, evaluations); // only rounding is left
            }
            // Illinois rule: halve the residue at the end that stays, so that the next secant falls on its side.
            let stays = if residue_at_u * side > 0.0 { 0.5 } else { 1.0 };
            if residue_at_u > 0.0 {
                (high, high_residue, low_residue) = (u, residue_at_u, stays * low_residue);
            } else {
                (low, low_residue, high_residue) = (u, residue_at_u, stays * high_residue);
            }
            side = residue_at_u;
            halve = high - low > 0.5 * width;
        }
        (0.5 * (low + high), evaluations)
    }
}

/// Closed form for V = ½K·max(p, 0)², a = βK/2.
fn linear(p: f64, w: f64, a: f64) -> f64 {
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
