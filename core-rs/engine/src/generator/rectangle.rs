//! PLATE of shape `rectangle`: rows of masses, four neighbours each.

use std::f64::consts::FRAC_PI_2;

use super::{GeneratorError, Links, MAX_MASSES, Topology, check_count};
use crate::maths::sin;

/// `columns` by `rows` masses; a fixed rim is one more row of SOLs on each side.
pub(super) fn rectangle(columns: usize, rows: usize, has_fixed_rim: bool) -> Result<Topology, GeneratorError> {
    for side in [columns, rows] {
        check_count("`sides`", side, 1, MAX_MASSES)?;
    }
    check_count("The masses of a rectangle", columns.saturating_mul(rows), 1, MAX_MASSES)?;
    let mass_count = columns * rows;
    let mut mesh_links = Links::new();
    for row in 0..rows {
        (1..columns).for_each(|x| mesh_links.join(row * columns + x - 1, row * columns + x, 1.0));
    }
    (columns..mass_count).for_each(|i| mesh_links.join(i - columns, i, 1.0));
    if has_fixed_rim {
        let (sols_below, sols_above, sols_left, sols_right) = (
            mass_count,
            mass_count + columns,
            mass_count + 2 * columns,
            mass_count + 2 * columns + rows,
        );
        (0..columns).for_each(|x| mesh_links.join(sols_below + x, x, 1.0));
        (0..columns).for_each(|x| mesh_links.join(mass_count - columns + x, sols_above + x, 1.0));
        (0..rows).for_each(|y| mesh_links.join(sols_left + y, y * columns, 1.0));
        (0..rows).for_each(|y| mesh_links.join(y * columns + columns - 1, sols_right + y, 1.0));
    }
    // With SOLs, one spacing more on either side.
    let edge_offset = if has_fixed_rim { 1.0 } else { 0.0 };
    let half_extent = |side: usize| 0.5 * (side - 1) as f64 + edge_offset;
    let normalising_width = (2.0 * half_extent(columns).max(half_extent(rows))).max(1.0);
    let normalised_point = |x: f64, y: f64| {
        [
            (x - half_extent(columns)) / normalising_width,
            (y - half_extent(rows)) / normalising_width,
        ]
    };
    let mass_point =
        |i: usize| normalised_point((i % columns) as f64 + edge_offset, (i / columns) as f64 + edge_offset);
    let mut positions: Vec<[f64; 2]> = (0..mass_count).map(mass_point).collect();
    if has_fixed_rim {
        let (right_edge, upper_edge) = ((columns + 1) as f64, (rows + 1) as f64);
        positions.extend((1..=columns).map(|x| normalised_point(x as f64, 0.0)));
        positions.extend((1..=columns).map(|x| normalised_point(x as f64, upper_edge)));
        positions.extend((1..=rows).map(|y| normalised_point(0.0, y as f64)));
        positions.extend((1..=rows).map(|y| normalised_point(right_edge, y as f64)));
    }
    let string_lambda = |gaps: usize| {
        let half_sine = sin(FRAC_PI_2 / gaps as f64);
        4.0 * half_sine * half_sine
    };
    let longer_side = columns.max(rows);
    let closed_lambda = if has_fixed_rim {
        Some(string_lambda(columns + 1) + string_lambda(rows + 1))
    } else {
        (longer_side > 1).then(|| string_lambda(longer_side))
    };
    Ok(Topology {
        centre: rows / 2 * columns + columns / 2,
        lowest_lambda: closed_lambda,
        ..Topology::new(mass_count, mesh_links.runs, positions)
    })
}
