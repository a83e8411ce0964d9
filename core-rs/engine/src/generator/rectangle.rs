//! PLATE of shape `rectangle`: rows of masses, four neighbours each.

use std::f64::consts::FRAC_PI_2;

use super::{GeneratorError, Links, MAX_MASSES, Topology, count};
use crate::maths::sin;

/// `across` by `up` masses; a fixed rim is one more row of SOLs on each side.
pub(super) fn rectangle(across: usize, up: usize, fixed: bool) -> Result<Topology, GeneratorError> {
    for side in [across, up] {
        count("`sides`", side, 1, MAX_MASSES)?;
    }
    count(
        "The masses of a rectangle",
        across.saturating_mul(up),
        1,
        MAX_MASSES,
    )?;
    let n = across * up;
    let mut links = Links::new();
    for row in 0..up {
        (1..across).for_each(|x| links.join(row * across + x - 1, row * across + x, 1.0));
    }
    (across..n).for_each(|i| links.join(i - across, i, 1.0));
    if fixed {
        let (below, above, left, right) = (n, n + across, n + 2 * across, n + 2 * across + up);
        (0..across).for_each(|x| links.join(below + x, x, 1.0));
        (0..across).for_each(|x| links.join(n - across + x, above + x, 1.0));
        (0..up).for_each(|y| links.join(left + y, y * across, 1.0));
        (0..up).for_each(|y| links.join(y * across + across - 1, right + y, 1.0));
    }
    // With SOLs, one spacing more on either side.
    let edge = if fixed { 1.0 } else { 0.0 };
    let half = |side: usize| 0.5 * (side - 1) as f64 + edge;
    let width = (2.0 * half(across).max(half(up))).max(1.0);
    let point = |x: f64, y: f64| [(x - half(across)) / width, (y - half(up)) / width];
    let inside = |i: usize| point((i % across) as f64 + edge, (i / across) as f64 + edge);
    let mut positions: Vec<[f64; 2]> = (0..n).map(inside).collect();
    if fixed {
        let (far, high) = ((across + 1) as f64, (up + 1) as f64);
        positions.extend((1..=across).map(|x| point(x as f64, 0.0)));
        positions.extend((1..=across).map(|x| point(x as f64, high)));
        positions.extend((1..=up).map(|y| point(0.0, y as f64)));
        positions.extend((1..=up).map(|y| point(far, y as f64)));
    }
    let string = |gaps: usize| {
        let half = sin(FRAC_PI_2 / gaps as f64);
        4.0 * half * half
    };
    let longer = across.max(up);
    let closed = if fixed {
        Some(string(across + 1) + string(up + 1))
    } else {
        (longer > 1).then(|| string(longer))
    };
    Ok(Topology {
        centre: up / 2 * across + across / 2,
        lowest_lambda: closed,
        ..Topology::new(n, links.runs, positions)
    })
}
