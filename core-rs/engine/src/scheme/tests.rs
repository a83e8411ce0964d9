use super::*;
use crate::law::{Law, LawText};
use crate::network::{Contact, Tie};

const HERTZ: f64 = 44_100.0;

fn rate() -> Rate {
    Rate::new(HERTZ).unwrap()
}

/// A part under `ca`: the numbers are the algorithmic M, K, Z themselves.
fn discrete() -> Network {
    let mut network = Network::new();
    network.part("p", Some(rate()));
    network
}

fn certify(network: &Network) -> Result<Certificate, Error> {
    Scheme::new(network, rate())?.certify(network)
}

fn unstable(network: &Network) -> (String, f64, u32) {
    match certify(network) {
        Err(Error::Unstable {
            module,
            lambda,
            oversampling,
        }) => (module, lambda, oversampling),
        other => panic!("{other:?}"),
    }
}

/// One mass on one link to a fixed point: λ is (K + 2Z)/M.
fn single_mass(k: f64, z: f64) -> Network {
    let mut network = discrete();
    let moving_mass = network.mas("m", 1.0, 0.0, 0.0).unwrap();
    let fixed_point = network.sol("s", 0.0).unwrap();
    network.spring("l", fixed_point, moving_mass, k, z, 0.0).unwrap();
    network
}

/// n masses in a row, both ends free: λmax is 4K·cos²(π/2n).
fn row(n: usize, k: f64) -> Network {
    let mut network = discrete();
    for i in 0..n {
        network.mas(&format!("m{i}"), 1.0, 0.0, 0.0).unwrap();
    }
    for i in 1..n {
        network.spring(&format!("l{i}"), i - 1, i, k, 0.0, 0.0).unwrap();
    }
    network
}

#[test]
fn certify_of_a_single_mass_at_its_limit() {
    for (k, z) in [(4.0, 0.0), (2.0, 1.0), (0.0, 2.0)] {
        let certificate = certify(&single_mass(k * (1.0 - 1e-12), z * (1.0 - 1e-12))).unwrap();
        assert_eq!(
            (certificate.guarantee, certificate.oversampling()),
            (StabilityGuarantee::Proved, 1)
        );
        assert!(certificate.lambda_max < 4.0 && certificate.lambda_max > 4.0 - 1e-10);
        for factor in [1.0 + 1e-12, 1.1] {
            let (module, lambda, oversampling) = unstable(&single_mass(k * factor, z * factor));
            assert_eq!((module.as_str(), oversampling), ("p.m", 2));
            assert!(lambda > 4.0);
        }
    }
}

/// The bound from sums is 4K and more; the eigenvalue is slightly less.
#[test]
fn certify_by_eigenvalue_beyond_coarse_sums() {
    let mass_count = 40;
    let row_cosine = crate::maths::cos(std::f64::consts::PI / (2 * mass_count) as f64);
    let limit_stiffness = 1.0 / (row_cosine * row_cosine);
    let coarse_bound = certify(&row(mass_count, 1.0 - 1e-12)).unwrap();
    assert_eq!(coarse_bound.bound_method, BoundMethod::Gershgorin);
    let certificate = certify(&row(mass_count, limit_stiffness * (1.0 - 1e-9))).unwrap();
    assert_ne!(certificate.bound_method, BoundMethod::Gershgorin);
    assert!((certificate.lambda_max - 4.0).abs() < 1e-8 && certificate.lambda_max < 4.0);
    let (module, lambda, _) = unstable(&row(mass_count, limit_stiffness * (1.0 + 1e-9)));
    assert!((4.0..4.0 + 1e-7).contains(&lambda));
    // The unstable mode alternates in sign, and is largest in the middle.
    assert!(["p.m19", "p.m20"].contains(&module.as_str()), "{module}");
}

#[test]
fn certify_names_the_unstable_module() {
    let mut network = discrete();
    for i in 0..30 {
        let cell_tie = Tie::Physical { k: 1.0, z: 0.1 };
        network.cel(&format!("c{i}"), 1.0, cell_tie, 0.0, 0.0, 0.0).unwrap();
    }
    network.part("q", Some(rate()));
    let heavy_mass = network.mas("heavy", 100.0, 0.0, 0.0).unwrap();
    let light_mass = network.mas("light", 0.1, 0.0, 0.0).unwrap();
    network.spring("l", heavy_mass, light_mass, 0.5, 0.0, 0.0).unwrap();
    let (module, lambda, oversampling) = unstable(&network);
    assert_eq!((module.as_str(), oversampling), ("q.light", 2));
    // K(1/M₁ + 1/M₂)
    assert!((lambda - 0.5 * (0.01 + 10.0)).abs() < 1e-9, "{lambda}");
}

/// The oversampling factor in the error is the smallest that suffices.
#[test]
fn certify_names_the_smallest_oversampling() {
    for k in [4.5, 15.9, 16.1, 35.0, 37.0] {
        let mut network = Network::new();
        network.part("p", None);
        let (m, t) = (1e-3, rate().step());
        let mass = network.mas("m", m, 0.0, 0.0).unwrap();
        let fixed_point = network.sol("s", 0.0).unwrap();
        network
            .spring("l", mass, fixed_point, k * m / (t * t), 0.0, 0.0)
            .unwrap();
        let (_, _, oversampling) = unstable(&network);
        let position = |oversampling: u32| {
            let rate = Rate::new(HERTZ * f64::from(oversampling)).unwrap();
            Scheme::new(&network, rate).unwrap().certify(&network)
        };
        assert!(
            position(oversampling).is_ok() && position(oversampling - 1).is_err(),
            "{k}: {oversampling}"
        );
    }
}

fn but(contact: Contact) -> But {
    But {
        contact,
        ..But::plain(1.0, 0.0, 0.0)
    }
}

/// Contacts count as closed, laws by their slope at rest; an exact contact is always stable.
#[test]
fn certify_of_non_linear_links_is_guarded() {
    let certify_scene = |join: &dyn Fn(&mut Network)| {
        let mut network = discrete();
        network.mas("m", 1.0, 0.0, 0.0).unwrap();
        network.sol("s", 0.0).unwrap();
        join(&mut network);
        certify(&network).map(|it| (it.guarantee, it.lambda_max))
    };
    let plain_contact = |k: f64| But {
        k,
        ..but(Contact::Plain)
    };
    let contact_link = |but: But| move |network: &mut Network| _ = network.but("l", 0, 1, but).unwrap();
    assert_eq!(
        certify_scene(&contact_link(plain_contact(3.0))),
        Ok((StabilityGuarantee::Guarded, 3.0))
    );
    assert!(certify_scene(&contact_link(plain_contact(4.001))).is_err());
    let exact_contact = But {
        k: 1e12,
        ..but(Contact::Exact)
    };
    assert_eq!(
        certify_scene(&contact_link(exact_contact)),
        Ok((StabilityGuarantee::Guarded, 0.0))
    );
    let law = |k: f64| {
        let law = Law::hardening(k, 1e6, 0.0).unwrap();
        move |network: &mut Network| _ = network.lnl("l", 0, 1, Arc::new(law.clone()), 0.0).unwrap()
    };
    assert_eq!(certify_scene(&law(3.5)).map(|it| it.0), Ok(StabilityGuarantee::Guarded));
    assert!(certify_scene(&law(4.5)).is_err());
    let damping = LawText {
        damping: Some("1.9*v"),
        ..LawText::default()
    };
    let damping = Arc::new(Law::new(&damping).unwrap());
    let damped_result = certify_scene(&|network| _ = network.lnl("l", 0, 1, damping.clone(), 0.0).unwrap());
    assert!((damped_result.unwrap().1 - 3.8).abs() < 1e-6);
}

#[test]
fn certify_of_an_empty_network() {
    assert_eq!(certify(&Network::new()).unwrap().lambda_max, 0.0);
    let mut network = discrete();
    network.sol("s", 1.0).unwrap();
    assert_eq!(certify(&network).unwrap().bound_method, BoundMethod::Gershgorin);
}

#[test]
fn magic_contact_between_wrong_ends_is_refused() {
    // a: 0 MAS, 1 MAS, 2 SOL, 3 SOL, 4 CEL
    let refused = |a: usize, b: usize, more: &dyn Fn(&mut Network)| {
        let mut network = Network::new();
        network.part("p", None);
        network.mas("m", 1.0, 0.0, 0.0).unwrap();
        network.mas("n", 2.0, 0.0, 0.0).unwrap();
        network.sol("s", 0.0).unwrap();
        network.sol("t", 0.0).unwrap();
        let cell_tie = Tie::Physical { k: 1.0, z: 0.0 };
        network.cel("c", 1.0, cell_tie, 0.0, 0.0, 0.0).unwrap();
        network.but("magic", a, b, but(Contact::Magic)).unwrap();
        more(&mut network);
        match Scheme::new(&network, rate()) {
            Ok(_) => None,
            Err(Error::Refused { module, message }) => {
                assert_eq!(module, "p.magic");
                Some(message)
            }
            Err(other) => panic!("{other}"),
        }
    };
    assert_eq!(refused(0, 1, &|_| {}), None);
    assert_eq!(refused(0, 2, &|_| {}), None);
    // A fixed point may have other links.
    let other = |network: &mut Network| _ = network.spring("o", 1, 2, 1.0, 0.0, 0.0).unwrap();
    assert_eq!(refused(0, 2, &other), None);
    assert!(refused(0, 1, &other).unwrap().contains("p.n"));
    assert!(refused(0, 4, &|_| {}).unwrap().contains("p.c"));
    assert!(refused(2, 3, &|_| {}).unwrap().contains("an end that moves"));
}

#[test]
fn magic_contact_with_wrong_settings_is_refused() {
    let mut network = discrete();
    network.mas("m", 1.0, 0.0, 0.0).unwrap();
    network.sol("s", 0.0).unwrap();
    let magic_contact = but(Contact::Magic);
    let bad_contacts = [
        But {
            restitution: 0.0,
            ..magic_contact
        },
        But {
            restitution: 1.1,
            ..magic_contact
        },
        But {
            restitution: f64::NAN,
            ..magic_contact
        },
        But {
            steps: 1,
            ..magic_contact
        },
        But {
            steps: 10_001,
            ..magic_contact
        },
        But {
            exponent: 1.5,
            ..magic_contact
        },
        But {
            is_clamped: true,
            restitution: 0.9,
            ..magic_contact
        },
    ];
    for but in bad_contacts {
        assert!(network.but("l", 0, 1, but).is_err(), "{but:?}");
    }
    let clamped = But {
        is_clamped: true,
        ..magic_contact
    };
    assert!(network.but("l", 0, 1, clamped).is_ok());
}

/// Its exact poles would be stable, but of another pitch.
#[test]
fn cell_above_half_the_rate_is_refused() {
    let try_cell = |ca: Option<Rate>, tie: Tie, hertz: f64| {
        let mut network = Network::new();
        network.part("p", ca);
        network.cel("m", 1e-2, tie, 0.0, 0.0, 0.0).unwrap();
        Scheme::new(&network, Rate::new(hertz).unwrap()).map(drop)
    };
    let tuned_tie = Tie::Tuned {
        f: 5_000.0,
        t60: Some(1.0),
    };
    let (m, omega) = (1e-2, std::f64::consts::TAU * 5_000.0);
    let stiff_tie = Tie::Physical {
        k: m * omega * omega,
        z: 0.0,
    };
    let ca = Some(rate());
    for (ca, tie) in [(None, tuned_tie), (None, stiff_tie), (ca, tuned_tie)] {
        assert!(try_cell(ca, tie, 10_010.0).is_ok());
        let rate_error = try_cell(ca, tie, 9_990.0).unwrap_err().to_string();
        assert!(
            rate_error.contains("p.m") && rate_error.contains("5000 Hz"),
            "{rate_error}"
        );
    }
    // Above critical damping there is no pitch that could be wrong.
    let creeping = Tie::Physical {
        k: m * omega * omega,
        z: 3.0 * m * omega,
    };
    assert!(try_cell(None, creeping, 1_000.0).is_ok());
}

#[test]
fn certify_names_the_lowest_stable_rate() {
    // λ of a damper falls with the rate, that of a spring with its square.
    for (k, z) in [(0.0, 1000.0), (1e7, 0.0), (1e6, 30.0)] {
        let mut network = Network::new();
        let moving_mat = network.mas("m", 2.5e-4, 0.0, 0.0).unwrap();
        let wall_mat = network.sol("wall", 0.0).unwrap();
        network.spring("r", wall_mat, moving_mat, k, z, 0.0).unwrap();
        let certify = |times: u32| {
            let rate = Rate::new(44_100.0 * f64::from(times)).unwrap();
            Scheme::new(&network, rate).unwrap().certify(&network)
        };
        let Err(Error::Unstable { oversampling, .. }) = certify(1) else {
            panic!("{k} {z}: stable");
        };
        assert!(certify(oversampling).is_ok(), "{k} {z}: {oversampling}");
        assert!(certify(oversampling - 1).is_err(), "{k} {z}: {oversampling}");
    }
}

#[test]
fn refusal_names_modules_above_half_the_rate_once() {
    let mut network = Network::new();
    for (name, f) in [("a", 30_000.0), ("b", 440.0), ("c", 40_000.0)] {
        let cell_tie = Tie::Tuned { f, t60: Some(1.0) };
        network.cel(name, 1e-3, cell_tie, 0.0, 0.0, 0.0).unwrap();
    }
    for member in 0..3 {
        let cell_tie = Tie::Tuned {
            f: 50_000.0,
            t60: Some(1.0),
        };
        network
            .cel(&format!("sky.{member}"), 1e-3, cell_tie, 0.0, 0.0, 0.0)
            .unwrap();
    }
    let refused = Scheme::new(&network, rate()).unwrap_err();
    let error_lines: Vec<String> = refused.to_string().lines().map(str::to_owned).collect();
    assert_eq!(error_lines.len(), 3, "{error_lines:?}");
    for (line, module) in error_lines.iter().zip(["a: ", "c: ", "sky.0: "]) {
        assert!(line.starts_with(module), "{line}");
    }
    assert_eq!(refused.into_list().len(), 3);
}
