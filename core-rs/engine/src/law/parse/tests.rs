use proptest::prelude::*;

use super::*;
use crate::law::{Law, LawText};

/// Value of a text whose only name is d.
fn value(text: &str, d: f64) -> f64 {
    Law::new(&LawText {
        law: Some(text),
        ..Default::default()
    })
    .expect(text)
    .force(d, 0.0)
}

fn refusal(expression: &str) -> LawError {
    let constants = [("stiffness", 2.0), ("k", 1.0)]
        .map(|(name, value)| (name.to_owned(), value))
        .into();
    let law_text = LawText {
        law: Some(expression),
        constants,
        ..Default::default()
    };
    Law::new(&law_text).expect_err(expression)
}

// Values as Python gives them for the same text.
#[test]
fn parse_binds_operators_as_in_python() {
    let expected_values = [
        ("-2**2", -4.0),
        ("2**3**2", 512.0),
        ("2**-1", 0.5),
        ("2**-1*3", 1.5),
        ("2 - 3 - 4", -5.0),
        ("24/4/2", 3.0),
        ("1 + 2*3 < 7 + 1", 1.0),
        ("-2*-3", 6.0),
        ("--2", 2.0),
        ("(1 + 2)*3", 9.0),
        ("1e3 + .5 + 2. + 1.5E-1", 1002.65),
        ("2 == 2.0", 1.0),
        ("2 != 2.0", 0.0),
        ("where(3 > 2, 10, 20)", 10.0),
        ("min(2, -3) + max(2, -3)", -1.0),
        ("sign(-3)*sqrt(16) + abs(-2)", -2.0),
        ("4**0.5", 2.0),
        ("tanh(0) + exp(0)", 1.0),
        ("+3 - +2", 1.0),
    ];
    for (text, expected) in expected_values {
        assert_eq!(value(text, 0.3), expected, "{text}");
    }
}

#[test]
fn parse_refusals_have_places_and_suggestions() {
    // text, first character, characters, suggestion
    let refused_texts: [(&str, usize, usize, Option<&str>); 24] = [
        ("stifness*d", 0, 8, Some("stiffness")),
        ("2*K*d", 2, 1, Some("k")),
        ("q*d", 0, 1, None),
        ("tahn(d)", 0, 4, Some("tanh")),
        ("log(d)", 0, 3, None),
        ("d*v", 2, 1, None),
        ("d^3", 1, 1, Some("**")),
        ("d = 2", 2, 1, Some("==")),
        ("d.real", 1, 1, None),
        ("__import__('os')", 11, 1, None),
        ("'d'", 0, 1, None),
        ("d[0]", 1, 1, Some("(")),
        ("400N*d", 0, 4, None),
        ("k*(d + 1", 2, 1, None),
        ("k*d)", 3, 1, None),
        ("k*", 1, 1, None),
        ("", 0, 0, None),
        ("k d", 2, 1, None),
        ("0 < d < 1", 6, 1, None),
        ("abs", 0, 3, None),
        ("min(d)", 0, 3, None),
        ("d(2)", 0, 1, None),
        ("1e999", 0, 5, None),
        // Places count characters, and letters of any script are letters.
        ("µ_é*d", 0, 3, None),
    ];
    for (text, offset, length, suggestion) in refused_texts {
        let law_error = refusal(text);
        assert_eq!(
            (law_error.offset, law_error.length),
            (offset, length),
            "{text}: {law_error}"
        );
        assert_eq!(law_error.suggestion.as_deref(), suggestion, "{text}: {law_error}");
        assert_eq!(law_error.field, LawField::Law);
    }
    let law_error = refusal("d + é·2");
    assert_eq!((law_error.offset, law_error.length), (5, 1), "{law_error}");
}

#[test]
fn parse_bounds_sizes_of_texts() {
    let deep_text = format!("{}d{}", "(".repeat(65), ")".repeat(65));
    assert!(refusal(&deep_text).message.contains("64 deep"));
    assert_eq!(refusal(&"-".repeat(1_999)).offset, 64);
    assert_eq!(refusal(&format!("d{}", "**d".repeat(65))).offset, 1 + 3 * 64);
    assert!(value(&format!("{}d{}", "(".repeat(64), ")".repeat(64)), 2.0) == 2.0);
    assert!(refusal(&format!("d{}", "+d".repeat(128))).message.contains("256"));
    assert_eq!(value(&format!("d{}", "+d".repeat(127)), 1.0), 128.0);
    assert_eq!(refusal(&" ".repeat(2_001)).offset, 2_000);
    assert_eq!(refusal(&"x".repeat(2_000)).suggestion, None);
}

// The names of all operations, so that the loops over runs omit none.
#[test]
fn parse_reaches_all_operations() {
    let parsed_nodes = |text: &str| parse(LawField::Law, text, &Constants::new(), &[]).expect(text).nodes;
    for (text, operation) in [("sign(d)", Unary::Sign), ("-d", Unary::Negate)] {
        assert!(parsed_nodes(text).contains(&Node::Unary(operation, 0)));
    }
    for (text, operation) in [("d>=2", Binary::GreaterEqual), ("max(d, 1)", Binary::Max)] {
        assert!(parsed_nodes(text).contains(&Node::Binary(operation, 0, 1)));
    }
}

proptest! {
    // Any text gives a law, or an error with a place inside the text.
    #[test]
    fn parse_of_random_text(text in "[-+*/() dvk0-9.e<>=!,a-zµ−\"\\[]{0,60}") {
        let length = text.chars().count();
        let text = LawText { law: Some(&text), ..Default::default() };
        if let Err(error) = Law::new(&text) {
            prop_assert!(error.offset + error.length <= length, "{error:?}");
            prop_assert!(error.message.ends_with(['.', '`', ')']), "{error}");
        }
    }
}
