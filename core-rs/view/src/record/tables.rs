//! The tables that follow the manifest: points, names, links, shapes.

use std::collections::HashMap;

use ergon_engine::network::Network;
use ergon_engine::simulation::{How, Look, Oscillation, Point};

use super::{Run, Setup, chunks};
use crate::motion::PAYLOAD_MAX;
use crate::payload::{Bytes, kind, put, to_half};

/// Appends the manifest and the tables to `out`.
pub(super) fn put_all(
    out: &mut Vec<u8>,
    network: &Network,
    (look, setup): (&Look, &Setup),
    runs: &[Run],
) {
    put(out, kind::MANIFEST, 0.0, setup.manifest.as_bytes());
    put(out, kind::POINTS, 0.0, &points(look, setup).0);
    let names = look.points.iter();
    let names: String = names
        .map(|point| network.mat_name(point.mat) + "\n")
        .collect();
    put(out, kind::NAMES, 0.0, names.as_bytes());
    put(out, kind::LINKS, 0.0, &links(look, network).0);
    for (part, run) in runs.iter().enumerate() {
        shapes(out, look, part, run);
    }
}

fn points(look: &Look, setup: &Setup) -> Bytes {
    let free = |point: &Point| match point.how {
        How::Free(own) => own,
        _ => Oscillation {
            omega: 0.0,
            sigma: 0.0,
        },
    };
    let (mut table, points) = (Bytes::default(), &look.points);
    table.u32(points.len() as u32);
    for axis in 0..3 {
        setup.places.iter().for_each(|place| table.f32(place[axis]));
    }
    points.iter().for_each(|point| table.f32(point.rest));
    points.iter().for_each(|point| table.f64(free(point).omega));
    points.iter().for_each(|point| table.f64(free(point).sigma));
    table
}

fn links(look: &Look, network: &Network) -> Bytes {
    let pairs = drawn(look, network);
    let mut table = Bytes::default();
    table.u32(pairs.len() as u32);
    for (_, a, b) in pairs {
        table.u32(a);
        table.u32(b);
    }
    table
}

/// Springs, as pairs of points with the LIA of each; a spring in space has a pair for each axis. Contacts are in the
/// manifest, and attraction between masses is not drawn.
fn drawn(look: &Look, network: &Network) -> Vec<(usize, u32, u32)> {
    let mut by_mat = vec![None; network.n_mat()];
    for (at, point) in look.points.iter().enumerate() {
        by_mat[point.mat] = Some(at as u32);
    }
    let springs = network.runs().iter();
    let springs = springs.filter(|run| run.kind.is_drawn());
    springs
        .flat_map(|run| {
            let pairs = move |i| run.pairs(i).map(move |ends| (run.first + i, ends));
            (0..run.len).flat_map(pairs)
        })
        .filter_map(|(link, (a, b))| Some((link, by_mat[a]?, by_mat[b]?)))
        .collect()
}

/// Index, among the links that are drawn, of the first pair of each breakable link   (n_breakable)
pub(super) fn breakable(look: &Look, network: &Network) -> Vec<Option<u32>> {
    if look.breakable.is_empty() {
        return Vec::new();
    }
    let mut first: HashMap<usize, u32> = HashMap::new();
    for ((link, ..), number) in drawn(look, network).into_iter().zip(0..) {
        first.entry(link).or_insert(number);
    }
    let links = look.breakable.iter();
    links.map(|link| first.get(link).copied()).collect()
}

/// The shapes of a body's modes, as many in one chunk as it can hold.
fn shapes(out: &mut Vec<u8>, look: &Look, part: usize, run: &Run) {
    let Some(body) = run.body.map(|body| &look.bodies[body]) else {
        return;
    };
    let (n, m) = (body.points.len(), body.modes.len());
    for some in chunks(m, (PAYLOAD_MAX / 4) / (2 * n.max(1)).max(1)) {
        let (mut table, modes) = (Bytes::default(), &body.modes[some.clone()]);
        table.u16(part as u16);
        table.u16(0);
        table.u32((body.first + some.start) as u32);
        table.u32(some.len() as u32);
        table.u32(n as u32);
        modes.iter().for_each(|own| table.f64(own.omega));
        modes.iter().for_each(|own| table.f64(own.sigma));
        for row in body.shapes.chunks(m.max(1)) {
            let row = row[some.clone()].iter();
            row.for_each(|share| table.u16(to_half(*share)));
        }
        put(out, kind::SHAPES, 0.0, &table.0);
    }
}
