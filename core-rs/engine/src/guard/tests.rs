//! The guard's bound on λ, the reach of laws, and which links are watched.

use std::sync::Arc;

use super::*;
use crate::chance::Chance;
use crate::law::{Law, LawText};
use crate::units::Rate;

const N: usize = 12;

fn rate() -> Rate {
    Rate::new(44_100.0).unwrap()
}

fn law(law_text: &str) -> Arc<Law> {
    let law = Some(law_text);
    let law_text = LawText {
        law,
        ..LawText::default()
    };
    Arc::new(Law::new(&law_text).unwrap())
}

/// A network of masses with random links, each made by `join` from its number; every fifth link holds a mass to a fixed
/// point.
fn net(seed: i128, mut join: impl FnMut(&mut Network, usize, usize, usize)) -> Network {
    let mut link_chance = Chance::new(seed, "guard", "", 0, 0);
    let mut network = Network::new();
    network.part("p", None);
    for i in 0..N {
        let point_mass = link_chance.uniform(1e-3, 3e-3);
        network.mas(&format!("m{i}"), point_mass, 0.0, 0.0).unwrap();
    }
    let held_point = network.sol("held", 0.0).unwrap();
    for link in 0..2 * N {
        let end_a = link % N;
        let end_b = link_chance.uniform(0.0, (N - 1) as f64) as usize;
        let end_b = if link % 5 == 0 {
            held_point
        } else {
            end_b + usize::from(end_b >= end_a)
        };
        join(&mut network, link, end_a, end_b);
    }
    network
}

/// λ is within the limit while there is a margin, and otherwise at most λ at rest plus the rise that the guard
/// computes.
#[test]
fn guard_bounds_lambda_of_stiffened_links() {
    let [k, q, z] = [2e4, 3e10, 0.05];
    let hardening = Arc::new(Law::hardening(k, q, z).unwrap());
    let quintic = law("2e4*d + 1e16*d**5");
    let mut nearest = f64::INFINITY;
    for seed in 0..200 {
        let link_laws = [&hardening, &quintic];
        let stiff_network = net(seed, |network, link, a, b| {
            let link_name = format!("l{link}");
            network.lnl(&link_name, a, b, link_laws[link % 2].clone(), 0.0).unwrap();
        });
        let stiff_scheme = Scheme::new(&stiff_network, rate()).unwrap();
        let mut guard = Guard::new(&stiff_scheme, &stiff_network, StabilityLimit::CA, &[])
            .unwrap()
            .unwrap();
        let mut position_chance = Chance::new(seed, "guard", "x", 0, 0);
        let reach_max = position_chance.uniform(0.0, 1e-2);
        let mut x: Vec<f64> = (0..N).map(|_| position_chance.uniform(-reach_max, reach_max)).collect();
        x.push(0.0);
        let tangent = net(seed, |network, link, a, b| {
            let elongation = x[b] - x[a];
            let (k, z) = match link % 2 {
                0 => (k + 3.0 * q * elongation * elongation, z),
                _ => (k + 5e16 * elongation * elongation * elongation * elongation, 0.0),
            };
            network.spring(&format!("l{link}"), a, b, k, z, 0.0).unwrap();
        });
        let tangent_scheme = Scheme::new(&tangent, rate()).unwrap();
        let tangent_lambda = largest_eigenvalue(&tangent_scheme, &tangent, 2.0, 0.0).unwrap().lambda;
        let (lambda_rise, _) = guard.lambda_rise(&x, &stiff_scheme.w);
        if guard.elongation_margin > 0.0 {
            assert!(tangent_lambda <= guard.lambda_limit, "{seed}: {tangent_lambda}");
        } else {
            assert!(
                tangent_lambda <= (guard.rest_lambda + lambda_rise) * (1.0 + 1e-6),
                "{seed}: {tangent_lambda} {lambda_rise}"
            );
            nearest = nearest.min((guard.rest_lambda + lambda_rise) / tangent_lambda);
        }
    }
    // The bound is tight: some state comes within 10 % of it.
    assert!(nearest < 1.1, "{nearest}");
}

#[test]
fn stiffens_beyond_gives_the_allowed_stretch() {
    let assert_near = |result: f64, expected: f64| {
        assert!(result <= expected && result > expected / 1.05, "{result} {expected}");
    };
    assert_near(law("2e4*d + 1e10*d**3").elongation_at_slope(5e4), 1e-3);
    assert_near(law("2e4*d - 1e7*d**2").elongation_at_slope(4e4), 1e-3);
    for law_text in ["2e4*d", "1e3*tanh(20*d)", "2e4*d - 1e10*d**3"] {
        assert_eq!(law(law_text).elongation_at_slope(3e4), f64::INFINITY, "{law_text}");
    }
    let points = [(-2e-3, -60.0), (-1e-3, -10.0), (3e-3, 30.0), (4e-3, 100.0)];
    let points = Some(&points[..]);
    let law_text = LawText {
        points,
        ..LawText::default()
    };
    let law = Law::new(&law_text).unwrap();
    assert_eq!(law.elongation_at_slope(1e4), 1e-3);
    assert_eq!(law.elongation_at_slope(6e4), 3e-3);
    assert_eq!(law.elongation_at_slope(8e4), f64::INFINITY);
    assert_eq!(law.behind_lever(2.0).unwrap().elongation_at_slope(1.5e4), 6e-3);
}

#[test]
fn guard_is_absent_for_laws_without_stiffening() {
    let has_guard = |law: Arc<Law>| {
        let network = net(1, |network, link, a, b| {
            network.lnl(&format!("l{link}"), a, b, law.clone(), 0.0).unwrap();
        });
        let network_scheme = Scheme::new(&network, rate()).unwrap();
        Guard::new(&network_scheme, &network, StabilityLimit::CA, &[])
            .unwrap()
            .is_some()
    };
    assert!(has_guard(law("2e4*d + 1e10*d**3")));
    assert!(!has_guard(law("2e4*d")) && !has_guard(law("1e2*tanh(50*d)")));
    assert!(!has_guard(Arc::new(Law::hardening(2e4, -1e6, 0.0).unwrap())));
}

/// A position that is NaN or infinite is beyond every reach.
#[test]
fn guard_with_non_finite_positions_needs_finer_steps() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(!watch::magnitude_max(&[0.0, bad, 1.0]).is_finite());
        let network = net(2, |network, link, a, b| {
            let hardening_law = Arc::new(Law::hardening(2e4, 1e10, 0.0).unwrap());
            network.lnl(&format!("l{link}"), a, b, hardening_law, 0.0).unwrap();
        });
        let network_scheme = Scheme::new(&network, rate()).unwrap();
        let mut guard = Guard::new(&network_scheme, &network, StabilityLimit::CA, &[])
            .unwrap()
            .unwrap();
        let (mut x, mut d) = (vec![0.0; N + 1], vec![0.0; N + 1]);
        assert!(!guard.needs_finer(&x, &d, &network_scheme.w));
        (x[3], d[3]) = (bad, bad);
        assert!(guard.needs_finer(&x, &d, &network_scheme.w));
    }
}
