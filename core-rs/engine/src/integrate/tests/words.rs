//! Guarantees of certificates, and networks that are refused.

use super::*;
use crate::law::LawText;
use crate::network::{But, Contact};
use crate::scheme::StabilityGuarantee;

/// One mass of 1 kg on a link to a fixed point: λ is κ + c·ζ.
fn single_mass(kappa: f64, zeta: f64) -> Network {
    let mut network = Network::new();
    network.part("p", None);
    let mass_index = network.mas("m", 1.0, 1e-3, 0.0).expect("a mass");
    let fixed_point = network.sol("s", 0.0).expect("a point");
    let (stiffness, viscosity) = (kappa * HERTZ * HERTZ, zeta * HERTZ);
    network
        .spring("l", fixed_point, mass_index, stiffness, viscosity, 0.0)
        .expect("a spring");
    network
}

fn word(network: &Network, way: MeshMethod) -> Option<StabilityGuarantee> {
    certify(network, rate(), way, 1).ok().map(|it| it.guarantee)
}

/// Whether the motion stays below a hundred times its initial displacement: near its stability limit CA2P swings slowly
/// and far.
fn stays(network: &Network, method: MeshMethod) -> bool {
    let mass_path = play(by(network, method, 1), 20_000, &[]);
    mass_path.len() == 20_000 && mass_path.iter().all(|x| x[0].abs() < 0.1)
}

#[test]
fn certificate_limits_by_method() {
    let (just_below, just_above) = (1.0 - 1e-3, 1.0 + 1e-3);
    let maximum = super::super::method::BM4_LIMIT * super::super::method::BM4_LIMIT;
    for (method, border, sure) in [
        (MeshMethod::Ca, 4.0, StabilityGuarantee::Proved),
        (MeshMethod::Ca2p, 12.0, StabilityGuarantee::Proved),
        (MeshMethod::Bm4, maximum, StabilityGuarantee::Tried),
    ] {
        assert_eq!(
            method
                .properties()
                .omega_step_max
                .map(|limit| (limit * limit * 1e9).round()),
            Some((border * 1e9_f64).round())
        );
        let (stable_mass, unstable_mass) = (
            single_mass(border * just_below, 0.0),
            single_mass(border * just_above, 0.0),
        );
        assert_eq!(word(&stable_mass, method), Some(sure), "{method:?}");
        assert!(stays(&stable_mass, method), "{method:?}");
        assert_eq!(word(&unstable_mass, method), None, "{method:?}");
        assert!(!stays(&unstable_mass, method), "{method:?}");
        // Twice the rate allows four times the stiffness.
        assert!(certify(&unstable_mass, rate(), method, 2).is_ok());
    }
    let method = MeshMethod::Ieq;
    assert_eq!(word(&single_mass(1e5, 1.0), method), Some(StabilityGuarantee::Proved));
    assert!(stays(&single_mass(1e5, 0.0), method));
}

#[test]
fn certificate_of_ca2p_with_damping() {
    for (kappa, zeta, expected) in [
        (2.0, 0.5, Some(StabilityGuarantee::Proved)),
        (2.0, 1.0, Some(StabilityGuarantee::Tried)),
        (2.0, 1.7, None),
        (6.5, 0.1, Some(StabilityGuarantee::Tried)),
    ] {
        let network = single_mass(kappa, zeta);
        assert_eq!(word(&network, MeshMethod::Ca2p), expected, "{kappa} {zeta}");
        assert!(expected.is_none() || stays(&network, MeshMethod::Ca2p));
    }
    // BM4 treats losses by the midpoint rule.
    for (zeta, expected) in [(4.9, Some(StabilityGuarantee::Tried)), (9.0, None)] {
        let network = single_mass(1e-3, zeta);
        assert_eq!(word(&network, MeshMethod::Bm4), expected, "{zeta}");
        assert_eq!(stays(&network, MeshMethod::Bm4), expected.is_some(), "{zeta}");
    }
}

#[test]
fn certificate_of_hardening_links_is_guarded() {
    let network = hex(1e13, Some(2.0));
    let guarantees = MeshMethod::ALL.map(|way| word(&network, way));
    use StabilityGuarantee::{Guarded, Tried};
    // IEQ conserves an energy of its own here, not that of the laws.
    let expected = [Some(Guarded), Some(Guarded), Some(Tried), Some(Guarded)];
    assert_eq!(guarantees, expected);
}

/// A row of two masses with a link between them that follows a law.
fn lawful(text: &LawText<'_>) -> Network {
    let mut network = row(2, 1e4, 0.0, 0.0);
    let link_law = Arc::new(Law::new(text).expect("a law"));
    network.lnl("law", 0, 1, link_law, 1e-5).expect("a link");
    network
}

fn law(text: &str) -> Network {
    lawful(&LawText {
        law: Some(text),
        ..LawText::default()
    })
}

#[test]
fn integrator_refuses_links_by_method() {
    let refused = |network: &Network, ways: &[MeshMethod]| {
        for method in MeshMethod::ALL {
            let integrator = Integrator::new(network, rate(), method, 1);
            assert_eq!(integrator.is_err(), ways.contains(&method), "{method:?}");
            assert_eq!(
                certify(network, rate(), method, 1).is_err(),
                integrator.is_err(),
                "{method:?}"
            );
        }
    };
    use MeshMethod::{Bm4, Ca2p, Ieq};
    refused(&row(4, 1e4, 0.0, 0.1), &[]);
    refused(&row(4, 1e4, 1e9, 0.1), &[]);
    // Potential energies: without a closed form, with one, and with one that falls below its value at rest.
    refused(&law("1e4*tanh(d)"), &[Ieq]);
    refused(&law("1e4*d + 1e8*d**3"), &[]);
    refused(&law("1e4*d - 1e9*d**3"), &[Ieq]);
    let mut network = row(2, 1e4, 0.0, 0.0);
    let exact_contact = But {
        contact: Contact::Exact,
        ..But::plain(1e4, 0.0, 0.0)
    };
    network.but("stop", 0, 1, exact_contact).expect("a contact");
    refused(&network, &[Ca2p, Bm4, Ieq]);
    let mut discrete = Network::new();
    discrete.part("discrete", Some(rate()));
    discrete.mas("m", 1.0, 0.0, 0.0).expect("a mass");
    refused(&discrete, &[Ca2p, Bm4, Ieq]);
    assert!(Integrator::new(&row(2, 1e4, 0.0, 0.0), rate(), MeshMethod::Ca, 0).is_err());
}

/// The same spring given by three numbers, by an expression, and by points.
#[test]
fn general_law_steps_equal_springs() {
    let law_network = lawful(&LawText {
        law: Some("2e4*d + 1e11*d**3"),
        damping: Some("0.05*v"),
        ..LawText::default()
    });
    let mut hardening_row = row(2, 1e4, 0.0, 0.0);
    let hardening = Arc::new(Law::hardening(2e4, 1e11, 0.05).expect("a law"));
    hardening_row.lnl("law", 0, 1, hardening, 1e-5).expect("a link");
    let law_points: Vec<(f64, f64)> = (-4000..=4000)
        .map(|i| {
            let elongation = f64::from(i) * 1e-6;
            (
                elongation,
                2e4 * elongation + 1e11 * (elongation * elongation * elongation),
            )
        })
        .collect();
    let pointed = lawful(&LawText {
        points: Some(&law_points),
        damping: Some("0.05*v"),
        ..LawText::default()
    });
    for (method, limit) in [
        (MeshMethod::Ca, -250.0),
        (MeshMethod::Ca2p, -250.0),
        (MeshMethod::Bm4, -250.0),
        // IEQ quadratises the whole of a general law, but only the hardening part of a spring: two schemes of the same
        // order.
        (MeshMethod::Ieq, -25.0),
    ] {
        let spring_path = play(by(&hardening_row, method, 1), 400, &[(0, 0, 1e-3)]);
        let law_error = error_db(&play(by(&law_network, method, 1), 400, &[(0, 0, 1e-3)]), &spring_path);
        let by_points = error_db(&play(by(&pointed, method, 1), 400, &[(0, 0, 1e-3)]), &spring_path);
        assert!(law_error < limit, "{method:?} {law_error}");
        // The line segments between the points are 1 µm long.
        assert!(by_points < f64::max(limit, -95.0), "{method:?} {by_points}");
    }
    let mut undamped = by(&law("2e4*d + 1e11*d**3"), MeshMethod::Ieq, 1);
    undamped.step(&[], &mut ThreadTeam::alone());
    let start_energy = undamped.energy();
    for _ in 0..4000 {
        undamped.step(&[], &mut ThreadTeam::alone());
    }
    let energy_drift = undamped.energy() / start_energy - 1.0;
    assert!(energy_drift.abs() < 1e-12, "{energy_drift:e}");
}
