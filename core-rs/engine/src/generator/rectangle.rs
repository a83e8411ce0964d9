//! PLATE of shape `rectangle`: rows of masses, four neighbours each.

use std::f64::consts::FRAC_PI_2;

use super::{GeneratorError, Links, MAX_MASSES, Topology, count};
use crate::maths::sin;

/// `across` by `up` masses; a fixed rim is one more row of SOLs on each side.
pub(super) fn rectangle(across: usize, up: usize, has_fixed_rim: bool) -> Result<Topology, GeneratorError> {
    for side in [across, up] {
        count("`sides`", side, 1, MAX_MASSES)?;
    }
    count("The masses of a rectangle", across.saturating_mul(up), 1, MAX_MASSES)?;
    let mass_count = across * up;
    let mut mesh_links = Links::new();
    for row in 0..up {
        (1..across).for_each(|x| mesh_links.join(row * across + x - 1, row * across + x, 1.0));
    }
    (across..mass_count).for_each(|i| mesh_links.join(i - across, i, 1.0));
    if has_fixed_rim {
        let (sols_below, sols_above, sols_left, sols_right) = (
            mass_count,
            mass_count + across,
            mass_count + 2 * across,
            mass_count + 2 * across + up,
        );
        (0..across).for_each(|x| mesh_links.join(sols_below + x, x, 1.0));
        (0..across).for_each(|x| mesh_links.join(mass_count - across + x, sols_above + x, 1.0));
        (0..up).for_each(|y| mesh_links.join(sols_left + y, y * across, 1.0));
        (0..up).for_each(|y| mesh_links.join(y * across + across - 1, sols_right + y, 1.0));
    }
    // With SOLs, one spacing more on either side.
    let edge_offset = if has_fixed_rim { 1.0 } else { 0.0 };
    let half = |side: usize| 0.5 * (side - 1) as f64 + edge_offset;
    let normalising_width = (2.0 * half(across).max(half(up))).max(1.0);
    let normalised_point = |x: f64, y: f64| {
        [
            (x - half(across)) / normalising_width,
            (y - half(up)) / normalising_width,
        ]
    };
    let mass_point = |i: usize| normalised_point((i % across) as f64 + edge_offset, (i / across) as f64 + edge_offset);
    let mut positions: Vec<[f64; 2]> = (0..mass_count).map(mass_point).collect();
    if has_fixed_rim {
        let (right_edge, upper_edge) = ((across + 1) as f64, (up + 1) as f64);
        positions.extend((1..=across).map(|x| normalised_point(x as f64, 0.0)));
        positions.extend((1..=across).map(|x| normalised_point(x as f64, upper_edge)));
        positions.extend((1..=up).map(|y| normalised_point(0.0, y as f64)));
        positions.extend((1..=up).map(|y| normalised_point(right_edge, y as f64)));
    }
    let string_lambda = |gaps: usize| {
        let half = sin(FRAC_PI_2 / gaps as f64);
        4.0 * half * half
    };
    let longer_side = across.max(up);
    let closed_lambda = if has_fixed_rim {
        Some(string_lambda(across + 1) + string_lambda(up + 1))
    } else {
        (longer_side > 1).then(|| string_lambda(longer_side))
    };
    Ok(Topology {
        centre: up / 2 * across + across / 2,
        lowest_lambda: closed_lambda,
        ..Topology::new(mass_count, mesh_links.runs, positions)
    })
}
