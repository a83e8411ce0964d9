use super::*;
use crate::maths;
use crate::network::PowerLaw;
use proptest::prelude::*;

const POWERS: [f64; 4] = [1.0, 1.5, 2.5, 8.0];

fn spring(k: f64, exponent: f64, beta: f64) -> ExactContact {
    ExactContact {
        law: ContactLaw {
            elastic: PowerLaw { k, exponent },
            z: 0.0,
            is_clamped: false,
        },
        beta,
    }
}

/// (V(u) − V(w))/(u − w) of V = K·p₊^(α+1)/(α+1), written independently of the code under test.
fn gradient(k: f64, alpha: f64, u: f64, w: f64) -> f64 {
    let potential = |p: f64| k / (alpha + 1.0) * maths::pow(p.max(0.0), alpha + 1.0);
    if alpha == 1.0 {
        // If both are closed, use the sum: it loses no digits.
        return match (u > 0.0, w > 0.0) {
            (true, true) => 0.5 * k * (u + w),
            (false, false) => 0.0,
            _ => (potential(u) - potential(w)) / (u - w),
        };
    }
    let midpoint = 0.5 * (u + w);
    let interval = u - w;
    if interval.abs() < 1e-4 * midpoint {
        // Simpson's rule over the interval: the next term is of fourth order in 1e-4.
        let power_force = |p: f64| k * maths::pow(p.max(0.0), alpha);
        (power_force(u) + 4.0 * power_force(midpoint) + power_force(w)) / 6.0
    } else if interval == 0.0 {
        0.0
    } else {
        (potential(u) - potential(w)) / interval
    }
}

/// The root of u + β·gradient(u, w) = p, by bisection alone.
fn bisected(k: f64, alpha: f64, beta: f64, p: f64, w: f64) -> f64 {
    let is_above = |u: f64| u + beta * gradient(k, alpha, u, w) > p;
    let (mut low_end, mut high_end) = (p - 1.0, p);
    while is_above(low_end) {
        low_end -= 2.0 * (high_end - low_end);
    }
    for _ in 0..200 {
        let midpoint = 0.5 * (low_end + high_end);
        if is_above(midpoint) {
            high_end = midpoint;
        } else {
            low_end = midpoint;
        }
    }
    high_end
}

/// A signed length from 1 nm to 10 cm.
fn length() -> impl Strategy<Value = f64> {
    (-9.0..-1.0_f64, any::<bool>()).prop_map(|(decade, negative)| {
        let magnitude = maths::pow(10.0, decade);
        if negative { -magnitude } else { magnitude }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// The force is the discrete gradient between the old and the new penetration, for stiffnesses from negligible to
    /// 1e12 N/m and for any masses.
    #[test]
    fn push_solves_the_contact_equation(
        power in 0..4_usize, k in 0.0..12.0_f64, beta in -12.0..-3.0_f64, p in length(), w in length(),
    ) {
        let (alpha, k, beta) = (POWERS[power], maths::pow(10.0, k), maths::pow(10.0, beta));
        let contact = spring(k, alpha, beta);
        let u = if alpha == 1.0 { linear_depth(p, w, 0.5 * beta * k) } else { contact.solve_power_law(p, w, beta).0 };
        let wanted = bisected(k, alpha, beta, p, w);
        // The quotient of a power law keeps twelve digits if its two ends nearly coincide.
        let digits = if alpha == 1.0 { 1e-13 } else { 1e-11 };
        prop_assert!(
            (u - wanted).abs() <= digits * (p.abs() + w.abs() + wanted.abs()),
            "K {k} power {alpha} β {beta} p {p} w {w}: {u} is not {wanted}"
        );
        let push = contact.push(p, w, -1.0);
        prop_assert!(push >= -digits * (p.abs() + w.abs()) / beta, "it pulls: {push}");
    }
}

/// A mass that falls onto the contact again and again: the sum of kinetic, stored and potential energy is constant.
#[test]
fn push_conserves_energy_over_bounces() {
    for alpha in POWERS {
        for k in [1e3, 1e6, 1e9, 1e12] {
            let (beta, weight) = (1e-8, 1.0);
            let contact = spring(k, alpha, beta);
            let bounce_energy = |depth_next: f64, depth_now: f64| {
                let depth_step = depth_next - depth_now;
                0.5 * depth_step * depth_step / beta
                    + 0.5 * (contact.potential(depth_next) + contact.potential(depth_now))
                    - 0.5 * weight * (depth_next + depth_now)
            };
            let (mut depth_before, mut depth_now) = (-1e-3, -1e-3);
            let (start_energy, mut worst_error, mut bounces) = (bounce_energy(depth_now, depth_before), 0.0_f64, 0);
            let mut deepest = 0.0_f64;
            for _ in 0..50_000 {
                let free_depth = 2.0 * depth_now - depth_before + beta * weight;
                let depth_next = free_depth - beta * contact.push(free_depth, depth_before, depth_now);
                bounces += u32::from(depth_now <= 0.0 && depth_next > 0.0);
                deepest = deepest.max(contact.potential(depth_next));
                (depth_before, depth_now) = (depth_now, depth_next);
                worst_error = worst_error.max((bounce_energy(depth_now, depth_before) - start_energy).abs());
            }
            assert!(bounces >= 3, "K {k} power {alpha}: {bounces} bounces");
            let allowed = if alpha == 1.0 { 1e-10 } else { 1e-8 };
            assert!(
                worst_error <= allowed * (start_energy + deepest),
                "K {k} power {alpha}: {worst_error} of {start_energy} J"
            );
        }
    }
}

#[test]
fn push_with_damping_and_clamp() {
    for alpha in POWERS {
        let mut contact = spring(1e5, alpha, 1e-8);
        contact.law.z = 300.0;
        let leaving = (-1e-3, 1e-6, 5e-7);
        assert!(
            contact.push(leaving.0, leaving.1, leaving.2) < 0.0,
            "Z pulls at the exit"
        );
        contact.law.is_clamped = true;
        assert_eq!(contact.push(leaving.0, leaving.1, leaving.2), 0.0);
    }
}

/// Two imposed points: β is 0 and all three penetrations are known.
#[test]
fn push_of_imposed_points_is_the_gradient() {
    for alpha in POWERS {
        let contact = spring(1e5, alpha, 0.0);
        let expected_push = gradient(1e5, alpha, 2e-3, 1e-3);
        assert!((contact.push(2e-3, 1e-3, 1.5e-3) - expected_push).abs() < 1e-9 * expected_push);
        assert_eq!(contact.push(-1e-3, -2e-3, -1.5e-3), 0.0);
    }
}

/// Both ends of the bracket round to p, and the residue there is positive: the solver must widen the bracket.
#[test]
fn solve_with_a_closed_bracket_widens_it() {
    let (alpha, w, p) = (1.5, 1e-3, -1.0);
    for part in 1..=64 {
        let push_force = f64::from(part) / 32.0 * f64::EPSILON / 4.0;
        let k = push_force * (w - p) * (alpha + 1.0) / maths::pow(w, alpha + 1.0);
        let (u, _) = spring(k, alpha, 1.0).solve_power_law(p, w, 1.0);
        assert!((u - p).abs() <= 2.0 * f64::EPSILON, "{part}: {u}");
    }
}
