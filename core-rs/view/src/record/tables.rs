//! The tables that follow the manifest: points, names, links, shapes.

use std::collections::HashMap;

use ergon_engine::network::Network;
use ergon_engine::simulation::{MotionLook, Oscillation, PointMotion, VisiblePoint};
use serde_json::Value;

use super::{PointRun, RecordingSetup, chunks};
use crate::motion::PAYLOAD_MAX;
use crate::payload::{ByteWriter, half_bits, kind, write_chunk};

/// Appends the manifest and the tables to `out`.
pub(super) fn write_tables(
    out: &mut Vec<u8>,
    network: &Network,
    (look, setup): (&MotionLook, &RecordingSetup),
    runs: &[PointRun],
) {
    write_chunk(out, kind::MANIFEST, 0.0, setup.manifest.as_bytes());
    write_chunk(out, kind::POINTS, 0.0, &point_table(look, setup).0);
    let name_lines = look.points.iter();
    let name_lines: String = name_lines.map(|point| network.mat_name(point.mat) + "\n").collect();
    write_chunk(out, kind::NAMES, 0.0, name_lines.as_bytes());
    write_chunk(out, kind::LINKS, 0.0, &link_table(look, network).0);
    for (part, run) in runs.iter().enumerate() {
        write_shapes(out, look, part, run);
    }
}

/// Appends who made the file, as its manifest says: the first bytes of a file show whose it is.
pub(super) fn write_maker(out: &mut Vec<u8>, manifest: &str) {
    let manifest: Value = serde_json::from_str(manifest).unwrap_or_default();
    if let Some(maker) = manifest["made_by"].as_str() {
        write_chunk(out, kind::MAKER, 0.0, maker.as_bytes());
    }
}

fn point_table(look: &MotionLook, setup: &RecordingSetup) -> ByteWriter {
    let oscillation_of = |point: &VisiblePoint| match point.motion {
        PointMotion::Free(free) => free,
        _ => Oscillation { omega: 0.0, sigma: 0.0 },
    };
    let (mut table_bytes, look_points) = (ByteWriter::default(), &look.points);
    table_bytes.u32(look_points.len() as u32);
    for axis in 0..3 {
        setup
            .point_positions
            .iter()
            .for_each(|position| table_bytes.f32(position[axis]));
    }
    look_points.iter().for_each(|point| table_bytes.f32(point.rest));
    look_points
        .iter()
        .for_each(|point| table_bytes.f64(oscillation_of(point).omega));
    look_points
        .iter()
        .for_each(|point| table_bytes.f64(oscillation_of(point).sigma));
    table_bytes
}

fn link_table(look: &MotionLook, network: &Network) -> ByteWriter {
    let link_pairs = drawn_links(look, network);
    let mut table_bytes = ByteWriter::default();
    table_bytes.u32(link_pairs.len() as u32);
    for (_, a, b) in link_pairs {
        table_bytes.u32(a);
        table_bytes.u32(b);
    }
    table_bytes
}

/// Springs, as pairs of points with the LIA of each; a spring in space has a pair for each axis. Contacts are in the
/// manifest, and attraction between masses is not drawn.
fn drawn_links(look: &MotionLook, network: &Network) -> Vec<(usize, u32, u32)> {
    let mut point_by_mat = vec![None; network.n_mat()];
    for (point_number, point) in look.points.iter().enumerate() {
        point_by_mat[point.mat] = Some(point_number as u32);
    }
    let springs = network.runs().iter();
    let springs = springs.filter(|run| run.kind.is_drawn());
    springs
        .flat_map(|run| {
            let pairs_of = move |i| run.pairs(i).map(move |ends| (run.first + i, ends));
            (0..run.len).flat_map(pairs_of)
        })
        .filter_map(|(link, (a, b))| Some((link, point_by_mat[a]?, point_by_mat[b]?)))
        .collect()
}

/// Index, among the links that are drawn, of the first pair of each breakable link   (n_breakable)
pub(super) fn breakable_numbers(look: &MotionLook, network: &Network) -> Vec<Option<u32>> {
    if look.breakable_links.is_empty() {
        return Vec::new();
    }
    let mut first_pairs: HashMap<usize, u32> = HashMap::new();
    for ((link, ..), number) in drawn_links(look, network).into_iter().zip(0..) {
        first_pairs.entry(link).or_insert(number);
    }
    let link_numbers = look.breakable_links.iter();
    link_numbers.map(|link| first_pairs.get(link).copied()).collect()
}

/// The shapes of a body's modes, as many in one chunk as it can hold.
fn write_shapes(out: &mut Vec<u8>, look: &MotionLook, part: usize, run: &PointRun) {
    let Some(body) = run.body.map(|body| &look.bodies[body]) else {
        return;
    };
    let (point_count, mode_count) = (body.points.len(), body.modes.len());
    for mode_range in chunks(mode_count, (PAYLOAD_MAX / 4) / (2 * point_count.max(1)).max(1)) {
        let (mut table_bytes, chunk_modes) = (ByteWriter::default(), &body.modes[mode_range.clone()]);
        table_bytes.u16(part as u16);
        table_bytes.u16(0);
        table_bytes.u32((body.first_mode + mode_range.start) as u32);
        table_bytes.u32(chunk_modes.len() as u32);
        table_bytes.u32(point_count as u32);
        chunk_modes.iter().for_each(|mode| table_bytes.f64(mode.omega));
        chunk_modes.iter().for_each(|mode| table_bytes.f64(mode.sigma));
        for shape_row in body.shapes.chunks(mode_count.max(1)) {
            let shape_row = shape_row[mode_range.clone()].iter();
            shape_row.for_each(|weight| table_bytes.u16(half_bits(*weight)));
        }
        write_chunk(out, kind::SHAPES, 0.0, &table_bytes.0);
    }
}
