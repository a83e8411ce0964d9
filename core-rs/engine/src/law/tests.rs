use super::parse::parse;
use super::tree::{Node, Tree, choose};
use super::*;
use proptest::prelude::*;

fn constants(named: &[(&str, f64)]) -> Constants {
    named.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

fn law(expression: &str, named: &[(&str, f64)]) -> Law {
    Law::new(&LawText {
        law: Some(expression),
        constants: constants(named),
        ..Default::default()
    })
    .expect(expression)
}

fn damping(expression: &str, named: &[(&str, f64)]) -> Law {
    let law_text = LawText {
        damping: Some(expression),
        constants: constants(named),
        ..Default::default()
    };
    Law::new(&law_text).expect(expression)
}

/// The reference: evaluates a tree without compiling it.
fn walk(tree: &Tree, node: usize, d: f64, v: f64) -> f64 {
    let evaluated = |node| walk(tree, node, d, v);
    match tree.nodes[node] {
        Node::Number(value) | Node::Adjustable(_, value) => value,
        Node::Elongation => d,
        Node::Velocity => v,
        Node::Unary(operation, a) => operation.apply(evaluated(a)),
        Node::Binary(operation, a, b) => operation.apply(evaluated(a), evaluated(b)),
        Node::Where(c, a, b) => choose(evaluated(c), evaluated(a), evaluated(b)),
    }
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

#[test]
fn law_with_wrong_constants_or_fields_is_refused() {
    let refused_part = |law_text: &LawText<'_>| Law::new(law_text).expect_err("refused").field;
    for (name, value) in [("d", 1.0), ("v", 1.0), ("sqrt", 1.0), ("k", f64::NAN)] {
        let constants = constants(&[(name, value)]);
        let law_text = LawText {
            law: Some("d"),
            constants,
            ..Default::default()
        };
        assert_eq!(refused_part(&law_text), LawField::Constants, "{name}");
    }
    assert_eq!(refused_part(&LawText::default()), LawField::Law);
    let law_and_points = LawText {
        law: Some("d"),
        points: Some(&[(0.0, 0.0), (1.0, 1.0)]),
        ..Default::default()
    };
    assert_eq!(refused_part(&law_and_points), LawField::Points);
    let bad_damping = LawText {
        law: Some("d"),
        damping: Some("v*w"),
        ..Default::default()
    };
    let law_error = Law::new(&bad_damping).expect_err("w");
    assert_eq!((law_error.field, law_error.offset), (LawField::Damping, 2));
    for reach in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(
            law("d", &[]).behind_lever(reach).expect_err("reach").field,
            LawField::Reach
        );
    }
}

#[test]
fn law_with_wrong_points_is_refused() {
    let refused_place = |points: &[(f64, f64)]| {
        let law_text = LawText {
            points: Some(points),
            ..Default::default()
        };
        let law_error = Law::new(&law_text).expect_err("refused");
        (law_error.field, law_error.offset)
    };
    assert_eq!(refused_place(&[(0.0, 0.0)]), (LawField::Points, 0));
    assert_eq!(
        refused_place(&[(0.0, 0.0), (1.0, 1.0), (1.0, 2.0)]),
        (LawField::Points, 2)
    );
    assert_eq!(refused_place(&[(0.0, 0.0), (1.0, f64::NAN)]), (LawField::Points, 1));
    let many_points: Vec<(f64, f64)> = (0..10_001).map(|i| (f64::from(i), 0.0)).collect();
    assert_eq!(refused_place(&many_points), (LawField::Points, 10_000));
}

#[test]
fn law_by_points_continues_with_its_last_slopes() {
    let points = [(-1.0, -2.0), (0.5, 1.0), (2.0, 1.0), (3.0, 5.0)];
    let law = Law::new(&LawText {
        points: Some(&points),
        ..Default::default()
    })
    .expect("law");
    for (d, f) in [
        (-2.0, -4.0),
        (-1.0, -2.0),
        (0.0, 0.0),
        (1.0, 1.0),
        (2.5, 3.0),
        (4.0, 9.0),
    ] {
        assert_eq!(law.force(d, 7.0), f);
    }
    // ∫ by hand: 2d up to 0.5 (0.25), flat to 2 (1.5), then 1 + 4(d-2).
    assert_eq!(law.potential(0.5), 0.25);
    assert_eq!(law.potential(2.0), 1.75);
    assert_eq!(law.potential(4.0), 1.75 + 2.0 + 8.0);
    assert_eq!(law.potential(-2.0), 4.0);
    assert_eq!(law.slope(2.5), 4.0);
    assert_eq!(law.slope(-9.0), 2.0);
}

#[test]
fn potential_matches_closed_forms() {
    let check_energy = |law: &Law, d: f64, energy: f64| {
        let energy_got = law.potential(d);
        assert!(
            (energy_got - energy).abs() <= 1e-13 * energy.abs(),
            "{d}: {energy_got} and {energy}"
        );
    };
    for d in [-3e-3, 1e-6, 2e-3, 0.7] {
        let cubic_law = law("k*d + q*d**3", &[("k", 400.0), ("q", 3e7)]);
        check_energy(&cubic_law, d, 200.0 * d * d + 0.75e7 * d * d * d * d);
        check_energy(&cubic_law.clone().behind_lever(4.0).expect("lever"), d, {
            let d = d / 4.0;
            200.0 * d * d + 0.75e7 * d * d * d * d
        });
        // A rope: slack up to 0.1 mm, with a kink inside the interval.
        let rope_law = law("where(d > 1e-4, k*(d - 1e-4), 0)", &[("k", 400.0)]);
        let taut_length = f64::max(d - 1e-4, 0.0);
        check_energy(&rope_law, d, 200.0 * taut_length * taut_length);
        // A jump at an arbitrary place.
        let jump_law = law("where(d > 1.2345e-4, 3, 1)", &[]);
        check_energy(&jump_law, d, d + 2.0 * f64::max(d - 1.2345e-4, 0.0));
        // Narrow, and near 0.
        let detent_law = law("a*d*exp(-(d/3e-5)**2)", &[("a", 50.0)]);
        check_energy(
            &detent_law,
            d,
            25.0 * 9e-10 * -crate::maths::expm1(-(d / 3e-5) * (d / 3e-5)),
        );
        // A power with a vertical tangent at 0, and an exponential.
        let root_law = law("sign(d)*abs(d)**0.5", &[]);
        check_energy(&root_law, d, maths_power(d.abs(), 1.5) / 1.5);
        let exponential_law = law("exp(-(d/1e-3))", &[]);
        check_energy(&exponential_law, d, -1e-3 * crate::maths::expm1(-d / 1e-3));
    }
}

fn maths_power(a: f64, b: f64) -> f64 {
    crate::maths::pow(a, b)
}

// A polynomial is integrated exactly; the same law, written so that it is not recognised, by quadrature.
#[test]
fn potential_of_recognised_polynomials() {
    let named_constants = [("k", 400.0), ("q", 3e7)];
    let law_pairs = [
        ("k*d + q*d**3", "k*abs(d)*sign(d) + q*abs(d)**3*sign(d)"),
        ("-(d - 1e-3)**2*k/3 + 2", "-abs(d - 1e-3)**2*k/3 + 2"),
        ("(d*k - 1)*(1 - d**2)*d**0", "(abs(d)*sign(d)*k - 1)*(1 - abs(d)**2)"),
    ];
    for (polynomial, other) in law_pairs {
        let (recognised, unrecognised) = (law(polynomial, &named_constants), law(other, &named_constants));
        assert!(
            matches!(recognised.elastic, Elastic::Expression { integral: Some(_), .. }),
            "{polynomial}"
        );
        assert!(
            matches!(unrecognised.elastic, Elastic::Expression { integral: None, .. }),
            "{other}"
        );
        for d in [-0.3, 2e-3, 1.7] {
            let (recognised, unrecognised) = (recognised.potential(d), unrecognised.potential(d));
            assert!(
                (recognised - unrecognised).abs() <= 1e-13 * (recognised.abs() + 0.1),
                "{polynomial}, {d}: {recognised} {unrecognised}"
            );
        }
    }
    for other in [
        "1/d",
        "d/0",
        "1e200*d*1e200",
        "d**0.5",
        "d**-1",
        "2**d",
        "d**17",
        "(d**5)**4",
    ] {
        assert!(matches!(
            law(other, &[]).elastic,
            Elastic::Expression { integral: None, .. }
        ));
    }
}

#[test]
fn force_is_the_slope_of_the_potential() {
    let laws = [
        law("k*d + q*d**3", &[("k", 400.0), ("q", 3e7)]),
        law("min(k*d, 0.5) + 0.3*max(d, 0)", &[("k", 400.0)]),
        law("a*tanh(d/w) + abs(d)**1.7*sign(d)", &[("a", 2.0), ("w", 4e-4)]),
    ];
    let lever_reaches = [1.0, 0.25, 3.0];
    for (law, reach) in laws.into_iter().zip(lever_reaches) {
        let law = law.behind_lever(reach).expect("lever");
        for i in -9..=9 {
            let d = 3.1e-4 * f64::from(i) + 1e-5;
            let h = 1e-7;
            let potential_slope = (law.potential(d + h) - law.potential(d - h)) / (2.0 * h);
            let law_force = law.force(d, 0.0);
            assert!(
                (potential_slope - law_force).abs() <= 1e-6 * law_force.abs() + 1e-9,
                "{d}: {potential_slope}, {law_force}"
            );
        }
    }
}

#[test]
fn slope_is_the_tangent_of_the_force() {
    let cubic_law = law("k*d + q*d**3", &[("k", 400.0), ("q", 3e7)]);
    for d in [0.0, -1e-3, 5e-3, 0.2] {
        let tangent = 400.0 + 9e7 * d * d;
        assert!((cubic_law.slope(d) / tangent - 1.0).abs() < 1e-8, "{d}");
        let levered = cubic_law.clone().behind_lever(2.0).expect("lever").slope(2.0 * d);
        assert!((levered / (tangent / 4.0) - 1.0).abs() < 1e-8, "{d}");
    }
    assert_eq!(cubic_law.damping_slope(0.1), 0.0);
    let friction = damping("z*v*(1 + d) + c*v**3", &[("z", 0.4), ("c", 9.0)]);
    assert!((friction.damping_slope(0.5) / 0.6 - 1.0).abs() < 1e-12);
}

#[test]
fn is_active_of_bows_and_brakes() {
    assert!(!law("1 - d", &[]).is_active(1.0, 1.0));
    assert!(!damping("z*v + c*tanh(v/1e-4)", &[("z", 0.1), ("c", 0.3)]).is_active(0.01, 2.0));
    // A bow that moves at 0.2 m/s drags along anything slower.
    let bow_damping = damping("f*tanh((v - 0.2)/1e-3)", &[("f", 0.3)]);
    assert!(bow_damping.is_active(0.01, 2.0));
    assert!(bow_damping.is_active(0.01, 200.0));
    // Negative damping only near rest, and only to one side.
    assert!(damping("where(d > 0.004, v*(abs(v) - 1e-4), v)", &[]).is_active(0.005, 1.0));
    assert!(!damping("where(d > 0.004, v*(abs(v) - 1e-4), v)", &[]).is_active(0.003, 1.0));
    assert!(damping("v*sqrt(d)", &[]).is_active(0.005, 1.0), "no value for d < 0");
}

#[test]
fn law_with_integer_powers_equals_products() {
    for (exponent, product) in [("2", 1.1 * 1.1), ("3", 1.1 * 1.1 * 1.1), ("-1", 1.0 / 1.1)] {
        assert_eq!(law(&format!("d**{exponent}"), &[]).force(1.1, 0.0), product);
    }
    // A power has the same value whether its exponent is constant or computed.
    let (constant_power, computed_power) = (law("d**7", &[]), law("d**(7 + 0*d)", &[]));
    assert!(same(constant_power.force(1.7, 0.0), computed_power.force(1.7, 0.0)));
    assert_eq!(law("d**0", &[]).force(0.0, 0.0), 1.0);
}

fn trees() -> impl Strategy<Value = String> {
    let leaf_text = prop_oneof![
        Just("d".to_owned()),
        Just("v".to_owned()),
        Just("k".to_owned()),
        (0u32..4000).prop_map(|n| format!("{}", f64::from(n) / 16.0)),
        Just("1e-3".to_owned()),
    ];
    leaf_text.prop_recursive(6, 100, 3, |inner| {
        let infix_sign = prop::sample::select(vec!["+", "-", "*", "/", "**"]);
        let compare = prop::sample::select(vec!["<", "<=", ">", ">=", "==", "!="]);
        let unary_name = prop::sample::select(vec!["-", "abs", "sqrt", "sign", "exp", "tanh", "noise"]);
        let binary_name = prop::sample::select(vec!["min", "max"]);
        let tree_pair = (inner.clone(), inner.clone());
        prop_oneof![
            (tree_pair.clone(), infix_sign).prop_map(|((a, b), s)| format!("({a}){s}{b}")),
            (tree_pair.clone(), compare).prop_map(|((a, b), s)| format!("(({a}) {s} ({b}))")),
            (inner.clone(), unary_name).prop_map(|(a, f)| format!("{f}({a})")),
            (tree_pair, binary_name).prop_map(|((a, b), f)| format!("{f}({a}, {b})")),
            (inner.clone(), 0u32..9).prop_map(|(a, n)| format!("({a})**{n}")),
            (inner.clone(), inner.clone(), inner).prop_map(|(c, a, b)| format!("where({c}, {a}, {b})")),
        ]
    })
}

proptest! {
    // Four evaluations with the same bits: the tree itself, a single link, a few links, and a run of links.
    #[test]
    fn law_program_equals_tree_and_runs(
        text in trees(),
        links in prop::collection::vec((-10.0f64..10.0, -10.0f64..10.0), 1..600),
        reach in prop::sample::select(vec![1.0, 0.3, 4.0]),
    ) {
        let constants = constants(&[("k", 2.5)]);
        let tree = match parse(LawField::Damping, &text, &constants, &[]) {
            Ok(tree) => tree,
            Err(error) => {
                let bounded = error.message.contains("at most");
                prop_assert!(bounded, "{text}: {error}");
                return Ok(());
            }
        };
        let text = LawText { law: Some("d*k"), damping: Some(&text), constants, ..LawText::default() };
        let law = Law::new(&text).expect("parsed before").behind_lever(reach).expect("lever");
        let (d, v): (Vec<f64>, Vec<f64>) = links.into_iter().unzip();
        let mut forces = vec![f64::MAX; d.len()];
        law.eval_run(&d, &v, &mut forces, &mut law.scratch());
        for ((d, v), force) in d.iter().zip(&v).zip(forces) {
            let inner = (d / reach, v / reach);
            let walked = (inner.0 * 2.5 + walk(&tree, tree.root, inner.0, inner.1)) / reach;
            prop_assert!(same(walked, law.force(*d, *v)), "{walked} {}", law.force(*d, *v));
            prop_assert!(same(walked, force), "{walked} {force}");
        }
        let [some_d, some_v]: [Places; 2] = [&d, &v].map(|all| std::array::from_fn(|lane| all[lane % all.len()]));
        let forces = law.tangents(&some_d, &some_v, &mut law.tangent_scratch()).force;
        for ((d, v), force) in some_d.iter().zip(&some_v).zip(forces) {
            prop_assert!(same(law.force(*d, *v), force), "{} {force}", law.force(*d, *v));
        }
    }

    #[test]
    fn law_by_points_equals_scalar_in_runs(links in prop::collection::vec(-10.0f64..10.0, 1..600)) {
        let points = [(-3.0, -2.0), (0.5, 1.0), (2.0, 1.0), (3.0, 5.0)];
        let text = LawText { points: Some(&points), ..Default::default() };
        let law = Law::new(&text).expect("law").behind_lever(0.7).expect("lever");
        let mut forces = vec![0.0; links.len()];
        law.eval_run(&links, &[], &mut forces, &mut law.scratch());
        for (d, force) in links.iter().zip(forces) {
            prop_assert!(same(law.force(*d, 0.0), force));
        }
        let some: Places = std::array::from_fn(|lane| links[lane % links.len()]);
        let found = law.tangents(&some, &some, &mut law.tangent_scratch());
        prop_assert_eq!(found.force, some.map(|d| law.force(d, 0.0)));
    }
}

/// An open constant gives the same bits as a written one, whatever value it is set to.
#[test]
fn open_constants_equal_written_ones() {
    let law_text = "where(abs(v) < w, (k - k/3)*v, sign(v)*k*w/3) + k";
    let law = |k: f64, open: &[String]| {
        let constants = [("k".to_owned(), k), ("w".to_owned(), 0.2)].into();
        let law_text = LawText {
            damping: Some(law_text),
            constants,
            open,
            ..LawText::default()
        };
        Law::new(&law_text).expect("a law")
    };
    let mut open_law = law(0.2, &["k".to_owned()]);
    assert!(open_law.rows().is_none(), "native code would keep its constants");
    for k in [0.2, -3.0, 1e-9, 7.25] {
        open_law.set(0, k);
        for v in [-1.0, -0.1, 0.0, 0.15, 0.2, 4.0] {
            assert_eq!(open_law.force(0.0, v).to_bits(), law(k, &[]).force(0.0, v).to_bits());
        }
        assert_eq!(open_law.is_active(1.0, 1.0), law(k, &[]).is_active(1.0, 1.0));
    }
}

/// A bow gives way far from rest; a spring, a damper and a law that hardens do not.
#[test]
fn is_bounded_far_from_rest_by_law() {
    let law = |law, damping| {
        let law_text = LawText {
            law,
            damping,
            ..LawText::default()
        };
        Law::new(&law_text).expect("a law").is_bounded_far_from_rest()
    };
    assert!(law(None, Some("v*exp(0.5 - 4*(v/0.2)**2)")));
    assert!(law(Some("where(abs(d) < 1, d, 0)"), None));
    assert!(!law(Some("3*d"), None));
    assert!(!law(None, Some("0.1*v")));
    assert!(!law(Some("d + d**3"), None));
}
