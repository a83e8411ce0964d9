//! Laws that are polynomials of d, such as the hardening spring: their energy is exact and cheap.

use super::tree::{Binary, Node, Tree, Unary, integer_exponent};

/// Highest degree recognised; a typical law has degree 3.
const MAX_DEGREE: usize = 16;

/// Coefficients by rising power of d; `None` if the tree is not a polynomial, or a coefficient is not finite.
pub(super) fn coefficients(tree: &Tree) -> Option<Vec<f64>> {
    polynomial(tree, tree.root).filter(|coefficients| coefficients.iter().all(|c| c.is_finite()))
}

/// Coefficients of the integral from 0, divided by d.
pub(super) fn integral(coefficients: Vec<f64>) -> Vec<f64> {
    coefficients
        .iter()
        .enumerate()
        .map(|(power, c)| c / (power as f64 + 1.0))
        .collect()
}

/// Value at `d` (Horner).
pub(super) fn value(coefficients: &[f64], d: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * d + c)
}

fn polynomial(tree: &Tree, node: usize) -> Option<Vec<f64>> {
    match tree.nodes[node] {
        Node::Number(value) => Some(vec![value]),
        Node::Elongation => Some(vec![0.0, 1.0]),
        Node::Unary(Unary::Negate, a) => polynomial(tree, a).map(|a| scaled(&a, -1.0)),
        Node::Binary(operation, a, b) => {
            let (a, b) = (polynomial(tree, a)?, polynomial(tree, b)?);
            match operation {
                Binary::Add => Some(sum(&a, &b)),
                Binary::Subtract => Some(sum(&a, &scaled(&b, -1.0))),
                Binary::Multiply => product(&a, &b),
                Binary::Divide => match b[..] {
                    [divisor] => Some(a.iter().map(|c| c / divisor).collect()),
                    _ => None,
                },
                Binary::Power => match b[..] {
                    [exponent] => {
                        let factor_count = usize::try_from(integer_exponent(exponent)?).ok()?;
                        (0..factor_count).try_fold(vec![1.0], |power, _| product(&power, &a))
                    }
                    _ => None,
                },
                _ => None,
            }
        }
        _ => None,
    }
}

fn scaled(a: &[f64], factor: f64) -> Vec<f64> {
    a.iter().map(|c| c * factor).collect()
}

fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
    let coefficient = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(0.0);
    (0..a.len().max(b.len()))
        .map(|i| coefficient(a, i) + coefficient(b, i))
        .collect()
}

fn product(a: &[f64], b: &[f64]) -> Option<Vec<f64>> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    if product.len() > MAX_DEGREE + 1 {
        return None;
    }
    for (i, a) in a.iter().enumerate() {
        for (j, b) in b.iter().enumerate() {
            product[i + j] += a * b;
        }
    }
    Some(product)
}
