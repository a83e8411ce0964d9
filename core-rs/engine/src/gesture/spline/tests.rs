//! Against scipy 1.x and against the normal equations solved in rational numbers.

use super::super::quintic::{Knot, Quintic};
use super::*;

const T: [f64; 6] = [0.0, 0.125, 0.3, 1.0, 1.001, 4.0];
const X: [f64; 6] = [0.0, 6e-3, -4e-3, 1e-3, 1.5e-3, 0.0];

fn close(result: &[f64], wanted: &[f64], tolerance: f64) {
    assert_eq!(result.len(), wanted.len());
    let largest_wanted = wanted.iter().fold(0.0f64, |m, w| m.max(w.abs()));
    for (f, w) in result.iter().zip(wanted) {
        assert!(
            (f - w).abs() <= tolerance * largest_wanted,
            "{result:?} is not {wanted:?}"
        );
    }
}

/// s = scipy.interpolate.make_interp_spline(T, X, k=5, bc_type=(left, right)); s(T, 1), s(T, 2)
/// with left = right = [(3, 0), (4, 0)].
#[test]
fn slopes_of_natural_spline_equal_scipy() {
    let (v, a) = slopes(&T, &X, Ends::Natural);
    let velocities = [
        0.09030934813970125,
        0.005366782789464672,
        -0.11968835398349578,
        0.4990879811429456,
        0.500911420773339,
        -2.118395108232409,
    ];
    let accelerations = [
        -0.6752222685241653,
        -0.6924952856350755,
        -0.6745154839306673,
        1.825231655795164,
        1.821643961676287,
        -1.7717390638090693,
    ];
    close(&v, &velocities, 1e-12);
    close(&a, &accelerations, 1e-12);
}

/// The same with left = [(1, .1), (2, -.2)], right = [(1, -.3), (2, .4)], and with all four zero.
#[test]
fn slopes_of_clamped_spline_equal_scipy() {
    let (v, a) = slopes(
        &T,
        &X,
        Ends::Clamped {
            first: (0.1, -0.2),
            last: (-0.3, 0.4),
        },
    );
    let velocities = [
        0.1,
        -0.009369839308597914,
        -0.10519975665825514,
        0.4991418100581952,
        0.5008572000387552,
        -0.3,
    ];
    let accelerations = [
        -0.2,
        -0.6978707042739447,
        -0.6143854226229702,
        1.718356737580632,
        1.712418510996627,
        0.4,
    ];
    close(&v, &velocities, 1e-12);
    close(&a, &accelerations, 1e-12);

    let (v, a) = slopes(&T, &X, Ends::CLAMPED_AT_REST);
    let velocities = [
        0.0,
        0.06818161050846612,
        -0.1864820226380552,
        0.4993715681634947,
        0.5006274709376225,
        0.0,
    ];
    let accelerations = [
        0.0,
        -0.7466167407864551,
        -1.1062187696900825,
        1.2587840556557541,
        1.2530193720432412,
        0.0,
    ];
    close(&v, &velocities, 1e-12);
    close(&a, &accelerations, 1e-12);
}

/// Reference: continuous x''' and x'''', solved in rational numbers (Python's Fraction) for exactly these doubles;
/// scipy is off by 5e-10 here, Cholesky on the system in v and a by 1e-10.
#[test]
fn slopes_with_a_millisecond_beside_ten_seconds() {
    let t = [0.0, 10.0, 10.001, 10.002, 20.5, 20.5001, 30.0];
    let x = [0.0, 6e-3, 6.1e-3, 5.9e-3, -4e-3, -4.001e-3, 1e-3];
    let (v, a) = slopes(&t, &x, Ends::Natural);
    let velocities = [
        -750.2256913892968,
        0.24999219486457053,
        -0.050007457890145345,
        -0.3499623642112999,
        -0.006900657313122665,
        -0.01309928831203958,
        147.2330273683553,
    ];
    let accelerations = [
        200.04371822415484,
        -299.9408812388,
        -300.02596692344383,
        -299.8513929129918,
        -61.98794121566293,
        -61.98467873110341,
        41.327900156993884,
    ];
    close(&v, &velocities, 1e-13);
    close(&a, &accelerations, 1e-13);
    for i in 1..6 {
        close(&v[i..=i], &velocities[i..=i], 1e-11);
    }
    let (v, a) = slopes(&t, &x, Ends::CLAMPED_AT_REST);
    let velocities = [
        0.0,
        0.24996564768096344,
        -0.049997804614077566,
        -0.34997442888467045,
        -0.007623649964351983,
        -0.012376274988342805,
        0.0,
    ];
    let accelerations = [
        0.0,
        -299.8498645165172,
        -300.0342431266248,
        -299.876206772468,
        -47.52850164205825,
        -47.52399881225462,
        0.0,
    ];
    close(&v, &velocities, 1e-12);
    close(&a, &accelerations, 1e-12);
}

#[test]
fn slopes_of_few_knots() {
    assert_eq!(slopes(&[], &[], Ends::Natural), (vec![], vec![]));
    assert_eq!(slopes(&[3.0], &[1.0], Ends::Natural), (vec![0.0], vec![0.0]));
    let moving_ends = Ends::Clamped {
        first: (2.0, 3.0),
        last: (2.0, 3.0),
    };
    assert_eq!(slopes(&[3.0], &[1.0], moving_ends), (vec![2.0], vec![3.0]));
    // A line through two points, a parabola through three.
    assert_eq!(
        slopes(&[1.0, 3.0], &[1.0, 5.0], Ends::Natural),
        (vec![2.0; 2], vec![0.0; 2])
    );
    let (v, a) = slopes(&[0.0, 1.0, 3.0], &[0.0, 1.0, 9.0], Ends::Natural);
    close(&v, &[0.0, 2.0, 6.0], 1e-15);
    close(&a, &[2.0; 3], 1e-15);
    // Two points at rest: 10s³ - 15s⁴ + 6s⁵.
    let (v, a) = slopes(&[0.0, 2.0], &[0.0, 1.0], Ends::CLAMPED_AT_REST);
    let rest_piece = Quintic::between_knots(
        Knot {
            t: 0.0,
            x: 0.0,
            v: v[0],
            a: a[0],
        },
        Knot {
            t: 2.0,
            x: 1.0,
            v: v[1],
            a: a[1],
        },
    );
    for s in [0.1f64, 0.25, 0.5, 0.9] {
        let exact_position = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
        assert!((rest_piece.evaluate(2.0 * s).0 - exact_position).abs() < 1e-15);
    }
}

/// The spline through points of a quintic, clamped as it is, equals this quintic for any knots and unit of time.
#[test]
fn slopes_of_a_clamped_quintic_are_its_derivatives() {
    for unit in [1e-6, 1.0, 1e4] {
        let knot_times: Vec<f64> = [0.0, 0.1, 0.7, 0.701, 1.0, 2.5, 2.6, 3.0]
            .iter()
            .map(|t| t * unit)
            .collect();
        let exact_piece = Quintic::between_knots(
            Knot {
                t: 0.0,
                x: 1.0,
                v: -2.0 / unit,
                a: 3.0 / unit / unit,
            },
            Knot {
                t: 3.0 * unit,
                x: 0.5,
                v: 1.0 / unit,
                a: -1.0 / unit / unit,
            },
        );
        let position: Vec<_> = knot_times.iter().map(|&t| exact_piece.evaluate(t)).collect();
        let x: Vec<f64> = position.iter().map(|k| k.0).collect();
        let first = (position[0].1, position[0].2);
        let last = (position[7].1, position[7].2);
        let (v, a) = slopes(&knot_times, &x, Ends::Clamped { first, last });
        close(&v, &position.iter().map(|k| k.1).collect::<Vec<_>>(), 1e-12);
        close(&a, &position.iter().map(|k| k.2).collect::<Vec<_>>(), 1e-9);
    }
}

/// An hour of a hand at 720 Hz: the spline moves as the sampled sine does.
#[test]
fn slopes_of_two_million_knots() {
    let n_knots = 2_600_000;
    let t: Vec<f64> = (0..n_knots).map(|i| f64::from(i) / 720.0).collect();
    let x: Vec<f64> = t.iter().map(|&t| crate::maths::sin(20.0 * t)).collect();
    let (v, a) = slopes(&t, &x, Ends::Natural);
    for i in (100..t.len() - 100).step_by(9973) {
        assert!((v[i] - 20.0 * crate::maths::cos(20.0 * t[i])).abs() < 1e-7);
        assert!((a[i] + 400.0 * x[i]).abs() < 1e-3);
    }
}
