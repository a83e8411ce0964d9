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

fn law(text: &str) -> Arc<Law> {
    let law = Some(text);
    let text = LawText {
        law,
        ..LawText::default()
    };
    Arc::new(Law::new(&text).unwrap())
}

/// A network of masses with random links, each made by `join` from its number; every fifth link holds a mass to a fixed
/// point.
fn net(seed: i128, mut join: impl FnMut(&mut Network, usize, usize, usize)) -> Network {
    let mut chance = Chance::new(seed, "guard", "", 0, 0);
    let mut network = Network::new();
    network.part("p", None);
    for i in 0..N {
        let m = chance.uniform(1e-3, 3e-3);
        network.mas(&format!("m{i}"), m, 0.0, 0.0).unwrap();
    }
    let held = network.sol("held", 0.0).unwrap();
    for link in 0..2 * N {
        let a = link % N;
        let b = chance.uniform(0.0, (N - 1) as f64) as usize;
        let b = if link % 5 == 0 {
            held
        } else {
            b + usize::from(b >= a)
        };
        join(&mut network, link, a, b);
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
        let laws = [&hardening, &quintic];
        let stiff = net(seed, |network, link, a, b| {
            let name = format!("l{link}");
            network
                .lnl(&name, a, b, laws[link % 2].clone(), 0.0)
                .unwrap();
        });
        let scheme = Scheme::new(&stiff, rate()).unwrap();
        let mut guard = Guard::new(&scheme, &stiff, Limit::CA, &[])
            .unwrap()
            .unwrap();
        let mut chance = Chance::new(seed, "guard", "x", 0, 0);
        let far = chance.uniform(0.0, 1e-2);
        let mut x: Vec<f64> = (0..N).map(|_| chance.uniform(-far, far)).collect();
        x.push(0.0);
        let tangent = net(seed, |network, link, a, b| {
            let e = x[b] - x[a];
            let (k, z) = match link % 2 {
                0 => (k + 3.0 * q * e * e, z),
                _ => (k + 5e16 * e * e * e * e, 0.0),
            };
            network
                .spring(&format!("l{link}"), a, b, k, z, 0.0)
                .unwrap();
        });
        let tangent_scheme = Scheme::new(&tangent, rate()).unwrap();
        let lambda = top(&tangent_scheme, &tangent, 2.0, 0.0).unwrap().lambda;
        let (risen, _) = guard.stiffening(&x, &scheme.w);
        if guard.margin > 0.0 {
            assert!(lambda <= guard.limit, "{seed}: {lambda}");
        } else {
            assert!(
                lambda <= (guard.rest_lambda + risen) * (1.0 + 1e-6),
                "{seed}: {lambda} {risen}"
            );
            nearest = nearest.min((guard.rest_lambda + risen) / lambda);
        }
    }
    // The bound is tight: some state comes within 10 % of it.
    assert!(nearest < 1.1, "{nearest}");
}

#[test]
fn stiffens_beyond_gives_the_allowed_stretch() {
    let near = |result: f64, expected: f64| {
        assert!(
            result <= expected && result > expected / 1.05,
            "{result} {expected}"
        );
    };
    near(law("2e4*d + 1e10*d**3").stiffens_beyond(5e4), 1e-3);
    near(law("2e4*d - 1e7*d**2").stiffens_beyond(4e4), 1e-3);
    for text in ["2e4*d", "1e3*tanh(20*d)", "2e4*d - 1e10*d**3"] {
        assert_eq!(law(text).stiffens_beyond(3e4), f64::INFINITY, "{text}");
    }
    let points = [(-2e-3, -60.0), (-1e-3, -10.0), (3e-3, 30.0), (4e-3, 100.0)];
    let points = Some(&points[..]);
    let text = LawText {
        points,
        ..LawText::default()
    };
    let law = Law::new(&text).unwrap();
    assert_eq!(law.stiffens_beyond(1e4), 1e-3);
    assert_eq!(law.stiffens_beyond(6e4), 3e-3);
    assert_eq!(law.stiffens_beyond(8e4), f64::INFINITY);
    assert_eq!(law.through(2.0).unwrap().stiffens_beyond(1.5e4), 6e-3);
}

#[test]
fn guard_is_absent_for_laws_without_stiffening() {
    let guard = |law: Arc<Law>| {
        let network = net(1, |network, link, a, b| {
            network
                .lnl(&format!("l{link}"), a, b, law.clone(), 0.0)
                .unwrap();
        });
        let scheme = Scheme::new(&network, rate()).unwrap();
        Guard::new(&scheme, &network, Limit::CA, &[])
            .unwrap()
            .is_some()
    };
    assert!(guard(law("2e4*d + 1e10*d**3")));
    assert!(!guard(law("2e4*d")) && !guard(law("1e2*tanh(50*d)")));
    assert!(!guard(Arc::new(Law::hardening(2e4, -1e6, 0.0).unwrap())));
}

/// A position that is NaN or infinite is beyond every reach.
#[test]
fn guard_with_non_finite_positions_needs_finer_steps() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(!watch::peak(&[0.0, bad, 1.0]).is_finite());
        let network = net(2, |network, link, a, b| {
            let law = Arc::new(Law::hardening(2e4, 1e10, 0.0).unwrap());
            network.lnl(&format!("l{link}"), a, b, law, 0.0).unwrap();
        });
        let scheme = Scheme::new(&network, rate()).unwrap();
        let mut guard = Guard::new(&scheme, &network, Limit::CA, &[])
            .unwrap()
            .unwrap();
        let (mut x, mut d) = (vec![0.0; N + 1], vec![0.0; N + 1]);
        assert!(!guard.needs_finer(&x, &d, &scheme.w));
        (x[3], d[3]) = (bad, bad);
        assert!(guard.needs_finer(&x, &d, &scheme.w));
    }
}
