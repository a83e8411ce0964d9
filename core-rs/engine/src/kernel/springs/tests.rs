//! Springs in rows against a pass over one run after the other, bit by bit.

use super::rows::Rows;
use super::*;
use crate::chance::Chance;
use crate::scheme::LoneLinks;

fn spring(a: usize, b: usize, len: usize) -> Spring {
    Spring {
        a,
        b,
        len,
        k: 3.0 / (1.0 + a as f64),
        q: if (a + b).is_multiple_of(3) { 0.0 } else { 7.0 },
        z: if len.is_multiple_of(5) { 0.0 } else { 0.3 },
        rest: 1e-3 * b as f64,
        force_ends: ForceEnds::Both(a, b),
    }
}

/// Springs between adjacent rows of MATs and within each, as in a plate of some shape: each row has a number of MATs,
/// and the links to the next row begin with a MAT of each.
fn plate(lengths: &[usize], links: impl Fn(usize) -> Vec<[usize; 3]>) -> (usize, Vec<Spring>) {
    let (mut springs, mut first) = (Vec::new(), 0);
    for (row, &len) in lengths.iter().enumerate() {
        if len > 1 {
            springs.push(spring(first, first + 1, len - 1));
        }
        if row + 1 < lengths.len() {
            let next = first + len;
            springs.extend(links(row).iter().map(|&[a, b, len]| spring(first + a, next + b, len)));
        }
        first += len;
    }
    (first, springs)
}

fn hexagon(radius: usize) -> (usize, Vec<Spring>) {
    let lengths: Vec<usize> = (0..=2 * radius)
        .map(|row| 2 * radius + 1 - row.abs_diff(radius))
        .collect();
    plate(&lengths, |row| {
        let shorter = lengths[row].min(lengths[row + 1]);
        if lengths[row] < lengths[row + 1] {
            vec![[0, 0, shorter], [0, 1, shorter]]
        } else {
            vec![[0, 0, shorter], [1, 0, shorter]]
        }
    })
}

fn disk(radius: f64) -> (usize, Vec<Spring>) {
    let half = |row: f64| (radius * radius - row * row).sqrt() as usize;
    let halves: Vec<usize> = (0..=2 * radius as usize).map(|row| half(row as f64 - radius)).collect();
    let lengths: Vec<usize> = halves.iter().map(|half| 2 * half + 1).collect();
    plate(&lengths, |row| {
        let shorter = halves[row].min(halves[row + 1]);
        vec![[halves[row] - shorter, halves[row + 1] - shorter, 2 * shorter + 1]]
    })
}

fn rectangle(width: usize, height: usize) -> (usize, Vec<Spring>) {
    let (mat_count, mut springs) = plate(&vec![width; height], |_| Vec::new());
    springs.push(spring(0, width, width * (height - 1)));
    (mat_count, springs)
}

/// A closed string.
fn ring(mat_count: usize) -> (usize, Vec<Spring>) {
    (
        mat_count,
        vec![spring(0, 1, mat_count - 1), spring(mat_count - 1, 0, 1)],
    )
}

/// Runs of up to 40 links whose ends may overlap and go backwards, some of which pull on one end only.
fn scattered(seed: u64) -> (usize, Vec<Spring>) {
    let mut chance = Chance::new(1, "springs", "", seed, 0);
    let mut below = |n: usize| chance.uniform(0.0, n as f64) as usize;
    let mat_count = 20 + below(120);
    let springs = (0..1 + below(40)).map(|_| {
        let (a, b) = (below(mat_count), below(mat_count - 1));
        let b = b + usize::from(b >= a);
        let len = 1 + below((mat_count - a.max(b)).min(40));
        let force_ends = [
            ForceEnds::Both(a, b),
            ForceEnds::Both(a, b),
            ForceEnds::A(a),
            ForceEnds::B(b),
        ][below(4)];
        Spring {
            force_ends,
            ..spring(a, b, len)
        }
    });
    (mat_count, springs.collect())
}

/// Forces of springs in rows on a processor with some instructions.
type InRows = fn(&Rows, &[Spring], [&[f64]; 2], &mut [CacheLine], &mut [f64]);

/// The roads that this processor has, for elastic, viscous and all forces.
fn roads() -> Vec<[InRows; 3]> {
    use vector::{ELASTIC, TOTAL, VISCOUS, scalar_lanes};
    #[allow(unused_mut)]
    let mut roads: Vec<[InRows; 3]> = vec![[scalar_lanes::<ELASTIC>, scalar_lanes::<VISCOUS>, scalar_lanes::<TOTAL>]];
    #[cfg(target_arch = "x86_64")]
    {
        use vector::{eight_lanes, four_lanes};
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: this processor has the instructions, here and below.
            roads.push([
                |r, s, m, l, f| unsafe { four_lanes::<ELASTIC>(r, s, m, l, f) },
                |r, s, m, l, f| unsafe { four_lanes::<VISCOUS>(r, s, m, l, f) },
                |r, s, m, l, f| unsafe { four_lanes::<TOTAL>(r, s, m, l, f) },
            ]);
        }
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: see above.
            roads.push([
                |r, s, m, l, f| unsafe { eight_lanes::<ELASTIC>(r, s, m, l, f) },
                |r, s, m, l, f| unsafe { eight_lanes::<VISCOUS>(r, s, m, l, f) },
                |r, s, m, l, f| unsafe { eight_lanes::<TOTAL>(r, s, m, l, f) },
            ]);
        }
    }
    roads
}

fn bits(forces: &[f64]) -> Vec<u64> {
    forces.iter().map(|force| force.to_bits()).collect()
}

/// Compare all roads with a pass over one run after the other, and a second frame of each road with the first.
fn compare(name: &str, (mat_count, springs): &(usize, Vec<Spring>)) {
    let numbers = |seed| -> Vec<f64> {
        let mut chance = Chance::new(2, "springs", "", seed, 0);
        (0..*mat_count).map(|_| chance.uniform(-1.0, 1.0)).collect()
    };
    let (x, v) = (numbers(0), numbers(1));
    let (rows, mut run_forces) = (Rows::for_any_springs(springs, *mat_count), vec![0.0; *mat_count]);
    let mut expected = [(); 3].map(|()| vec![0.0; *mat_count]);
    add_elastic_forces(springs, &x, &mut run_forces, &mut expected[0]);
    add_viscous_forces(springs, &v, &mut run_forces, &mut expected[1]);
    add_total_forces(springs, &x, &v, &mut run_forces, &mut expected[2]);
    let lone_links = LoneLinks::from_runs(springs);
    for (part, expected) in [ForcePart::Elastic, ForcePart::Viscous, ForcePart::Total]
        .into_iter()
        .zip(&expected)
    {
        let mut force = vec![f64::NAN; *mat_count];
        lone::compute_forces(&lone_links, part, [&x, &v], &mut Vec::new(), &mut force);
        assert_eq!(bits(&force), bits(expected), "{name}, link by link, {part:?}");
    }
    for (road, by_part) in roads().iter().enumerate() {
        let mut link_forces = rows.zeroed_forces();
        for _ in 0..2 {
            for (part, in_rows) in by_part.iter().enumerate() {
                let mut force = vec![f64::NAN; *mat_count];
                in_rows(&rows, springs, [&x, &v], &mut link_forces, &mut force);
                assert_eq!(bits(&force), bits(&expected[part]), "{name}, road {road}, part {part}");
            }
        }
    }
}

#[test]
fn forces_in_rows_of_plates() {
    for radius in [1, 2, 3, 7, 12, 25] {
        compare(&format!("hexagon {radius}"), &hexagon(radius));
        compare(&format!("disk {radius}"), &disk(radius as f64));
    }
    for (width, height) in [(1, 9), (2, 7), (8, 8), (9, 3), (50, 40)] {
        compare(&format!("rectangle {width} {height}"), &rectangle(width, height));
    }
}

#[test]
fn forces_in_rows_of_strings() {
    for mat_count in 3..80 {
        compare(&format!("ring {mat_count}"), &ring(mat_count));
    }
}

#[test]
fn forces_in_rows_of_scattered_runs() {
    for seed in 0..150 {
        compare(&format!("seed {seed}"), &scattered(seed));
    }
}

/// Every MAT is in one row, whether links pull on it or not; a hexagon has few more rows than rows of MATs.
#[test]
fn rows_cover_all_mats() {
    let (mat_count, springs) = hexagon(7);
    let rows = Rows::new(&springs, mat_count).unwrap();
    assert!((15..20).contains(&rows.rows.len()));
    let mut mats: Vec<usize> = rows.rows.iter().flat_map(|row| row.mats.clone()).collect();
    mats.sort_unstable();
    assert_eq!(mats, (0..mat_count).collect::<Vec<_>>());
}

#[test]
fn pass_without_springs_sets_no_force() {
    let mut force = vec![f64::NAN; 5];
    SpringPass::new(&[], 5).compute_forces(ForcePart::Total, &FusedSprings::default(), [&[0.0; 5]; 2], &mut force);
    assert_eq!(force, [0.0; 5]);
}

#[test]
fn rows_for_single_links_are_refused() {
    let lone_links: Vec<Spring> = (0..50).map(|i| spring(i, i + 1, 1)).collect();
    assert!(Rows::new(&lone_links, 51).is_none());
    let (mat_count, springs) = rectangle(400, 200);
    assert!(Rows::new(&springs, mat_count).is_none());
}

/// Springs of which each has a stiffness of its own are computed link by link, and follow what a stiffness becomes.
#[test]
fn lone_links_follow_changed_stiffness() {
    let runs: Vec<Spring> = (0..50).map(|i| spring(i, i + 1 + i % 3, 1)).collect();
    let mut springs = FusedSprings::new(runs);
    assert!(springs.lone_links().is_some());
    assert!(FusedSprings::new(hexagon(7).1).lone_links().is_none());
    let changed = Spring {
        k: 123.0,
        z: 0.7,
        ..springs[4]
    };
    springs.set_k_and_z(4, [changed.k, changed.z]);
    let x: Vec<f64> = (0..60).map(|i| f64::from(i * i % 7)).collect();
    let mut expected_runs = springs.to_vec();
    expected_runs[4] = changed;
    let (mut expected, mut force) = (vec![0.0; 60], vec![0.0; 60]);
    add_total_forces(&expected_runs, &x, &x, &mut [0.0; 60], &mut expected);
    lone::compute_forces(
        springs.lone_links().unwrap(),
        ForcePart::Total,
        [&x, &x],
        &mut Vec::new(),
        &mut force,
    );
    assert_eq!(bits(&force), bits(&expected));
}
