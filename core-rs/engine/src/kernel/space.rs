//! Forces of links in space. Springs take one pass. Other laws take one pass each for distances and directions, for the
//! law, and for the components, so that each vectorises.

use super::pull::add_link_forces_wide;
use crate::maths::wide::wide;
use crate::network::{AXES_MAX, SpaceLaw, SpaceLink, length_and_unit_vector};
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::ModuleState;

/// Scratch memory for a run of links in space   (longest run each).
#[derive(Clone, Debug, Default)]
pub(crate) struct SpaceScratch {
    /// Components of the unit vector from end to end, then of the force [N].
    directions: [Vec<f64>; AXES_MAX],
    /// Distance − rest [m].
    elongations: Vec<f64>,
    /// Change of the distance in the last step [m].
    elongation_steps: Vec<f64>,
}

impl SpaceScratch {
    pub(super) fn new(scheme: &Scheme) -> Self {
        let space_runs = scheme.runs.iter();
        let space_runs = space_runs.filter(|run| matches!(run.kind, LinkRunKind::Space(_)));
        let scratch_row = vec![0.0; space_runs.map(|run| run.len).max().unwrap_or(0)];
        Self {
            directions: [scratch_row.clone(), scratch_row.clone(), scratch_row.clone()],
            elongations: scratch_row.clone(),
            elongation_steps: scratch_row,
        }
    }
}

/// Add the forces of a run to the coordinates of its ends, and store the force along each link [N].
pub(super) fn add_space_forces(
    run: &LinkRun,
    link: &SpaceLink,
    gates: &[f64],
    modules: &mut ModuleState,
    scratch: &mut SpaceScratch,
) {
    let link_count = run.len;
    if link_count == 1 {
        return add_single_link(run, link, gates, modules);
    }
    let SpaceScratch {
        directions: [direction_x, direction_y, direction_z],
        elongations,
        elongation_steps,
    } = scratch;
    let [direction_x, direction_y, direction_z] =
        [direction_x, direction_y, direction_z].map(|axis_values| &mut axis_values[..link_count]);
    let ModuleState {
        x,
        d,
        force,
        link_forces: link_force,
        link_memories: memory,
        ..
    } = modules;
    let link_force = &mut link_force[run.first_link..run.first_link + link_count];
    let axis_ends: [(usize, usize); AXES_MAX] = std::array::from_fn(|axis| run.pair(0, axis.min(link.n_axes - 1)));
    let end_motion = SpaceEndMotions::new(link.n_axes, &axis_ends, [x, d], link_count);
    let gate_opening = run.gate.map_or(1.0, |gate| gates[gate]);
    if link.law == SpaceLaw::Spring {
        let spring_terms = [run.k, run.z, run.rest, gate_opening];
        set_spring_forces(
            spring_terms,
            &end_motion,
            link_force,
            direction_x,
            direction_y,
            direction_z,
        );
    } else {
        let (e, step) = (&mut elongations[..link_count], &mut elongation_steps[..link_count]);
        set_directions_and_elongations(run.rest, &end_motion, e, step, direction_x, direction_y, direction_z);
        if link.law.yields() {
            let memory = &mut memory[run.first_link..run.first_link + link_count];
            for (e, memory) in e.iter_mut().zip(memory) {
                *e = update_rest(link, run.k, *e, memory);
            }
        }
        for ((link_force, &e), &step) in link_force.iter_mut().zip(&*e).zip(&*step) {
            *link_force = link.law.force([run.k, run.z], e, step) * gate_opening;
        }
        for directions in [&mut *direction_x, &mut *direction_y, &mut *direction_z] {
            scale_directions(link_force, directions);
        }
    }
    let axis_forces = axis_ends.into_iter().zip([direction_x, direction_y, direction_z]);
    for ((a, b), axis_force) in axis_forces.take(link.n_axes) {
        add_link_forces_wide(axis_force, force, a, b);
    }
}

/// Positions and steps at the ends of a run of links, axis by axis, (n) each.
struct SpaceEndMotions<'a> {
    x: [[&'a [f64]; 2]; AXES_MAX],
    d: [[&'a [f64]; 2]; AXES_MAX],
}

impl<'a> SpaceEndMotions<'a> {
    /// Of `n` links, the first of which joins `ends`. Along an axis that the network does not have, both ends get the
    /// same positions.
    fn new(n_axes: usize, ends: &[(usize, usize); AXES_MAX], [x, d]: [&'a [f64]; 2], n: usize) -> Self {
        let end_slices = |mat_values: &'a [f64], axis: usize, ends_coincide: bool| {
            let (first_mat, second_mat) = ends[axis];
            [first_mat, if ends_coincide { first_mat } else { second_mat }].map(|first| &mat_values[first..][..n])
        };
        Self {
            x: std::array::from_fn(|axis| end_slices(x, axis, axis >= n_axes)),
            d: std::array::from_fn(|axis| end_slices(d, axis, false)),
        }
    }

    /// The same values as slices of one length, so that the compiler drops bounds checks.
    #[inline(always)]
    fn equal_slices(&self, n: usize) -> [[[&'a [f64]; 2]; AXES_MAX]; 2] {
        [self.x, self.d].map(|mat_values| mat_values.map(|ends| ends.map(|mat_values| &mat_values[..n])))
    }
}

/// Unit vector of the i-th link, its distance − rest, and the change of the distance in the last step.
#[inline(always)]
fn link_line([x, d]: &[[[&[f64]; 2]; AXES_MAX]; 2], rest: f64, i: usize) -> ([f64; AXES_MAX], f64, f64) {
    let end_offset = |[a, b]: [&[f64]; 2]| b[i] - a[i];
    let (link_length, direction) = length_and_unit_vector(x.map(end_offset));
    let length_step =
        0.0 + direction[0] * end_offset(d[0]) + direction[1] * end_offset(d[1]) + direction[2] * end_offset(d[2]);
    (direction, link_length - rest, length_step)
}

/// Distance − rest [m] of a link whose rest length has grown by `memory` [m]; updates `memory` if the
/// link yields.
fn update_rest(link: &SpaceLink, k: f64, e: f64, memory: &mut f64) -> f64 {
    let elastic_elongation = link.law.after_yielding(k, e, *memory);
    *memory = e - elastic_elongation;
    elastic_elongation
}

/// [`add_space_forces`] of a run of one link, for which separate passes would cost ten times as much.
fn add_single_link(run: &LinkRun, link: &SpaceLink, gates: &[f64], modules: &mut ModuleState) {
    let link_ends = (run.a, run.b);
    let (link_length, direction) = link.length_and_direction(link_ends, |mat| modules.x[mat]);
    let length_step = link.length_step(link_ends, direction, |mat| modules.d[mat]);
    let mut elongation = link_length - run.rest;
    if link.law.yields() {
        elongation = update_rest(link, run.k, elongation, &mut modules.link_memories[run.first_link]);
    }
    let mut link_force = link.law.force([run.k, run.z], elongation, length_step);
    if let Some(gate) = run.gate {
        link_force *= gates[gate];
    }
    modules.link_forces[run.first_link] = link_force;
    for ((a, b), direction) in run.pairs(0).zip(direction) {
        modules.force[a] += link_force * direction;
        modules.force[b] -= link_force * direction;
    }
}

wide! {
    /// Forces of springs and their components; `spring_terms`: K, Z, rest, and the opening of the gate.
    fn set_spring_forces(
        spring_terms: [f64; 4],
        ends: &SpaceEndMotions<'_>,
        f: &mut [f64],
        x: &mut [f64],
        y: &mut [f64],
        z: &mut [f64],
    ) {
        let n = f.len();
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        let ends = ends.equal_slices(n);
        let [stiffness, damping, rest, opening] = spring_terms;
        for i in 0..n {
            let (directions, e, step) = link_line(&ends, rest, i);
            let force = (stiffness * e + damping * step) * opening;
            f[i] = force;
            x[i] = force * directions[0];
            y[i] = force * directions[1];
            z[i] = force * directions[2];
        }
    }
}

wide! {
    /// Distances − rest, their change in the last step, and unit vectors.
    fn set_directions_and_elongations(
        rest: f64,
        ends: &SpaceEndMotions<'_>,
        e: &mut [f64],
        step: &mut [f64],
        x: &mut [f64],
        y: &mut [f64],
        z: &mut [f64],
    ) {
        let n = e.len();
        let (x, y, z, step) = (&mut x[..n], &mut y[..n], &mut z[..n], &mut step[..n]);
        let ends = ends.equal_slices(n);
        for i in 0..n {
            let directions;
            (directions, e[i], step[i]) = link_line(&ends, rest, i);
            [x[i], y[i], z[i]] = directions;
        }
    }
}

wide! {
    /// Turn components of unit vectors into components of forces.
    fn scale_directions(f: &[f64], directions: &mut [f64]) {
        for (directions, f) in directions.iter_mut().zip(f) {
            *directions *= f;
        }
    }
}
