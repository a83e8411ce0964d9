//! Energy and work of contacts and attractions of all pairs of points.

use crate::kernel::{Neighbours, PairContact};
use crate::network::{PairRun, difference};
use crate::state::{ContactHistory, ModuleState};

/// Work of all pairs in a frame [J].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairWork {
    /// Taken from the points by the whole force.
    pub(super) total: f64,
    /// Taken from the points by its elastic part.
    pub(super) elastic: f64,
}

/// Energy of all pairs of stiffness `k` [J]: now, and a step before.
pub(super) fn potentials(run: &PairRun, k: f64, neighbours: &mut Neighbours, modules: &ModuleState) -> [f64; 2] {
    let energy_before = potential_energy(run, k, neighbours, |mat| modules.x[mat] - modules.d[mat]);
    [
        potential_energy(run, k, neighbours, |mat| modules.x[mat]),
        energy_before,
    ]
}

/// Energy of all pairs of stiffness `k` at positions `x` [J].
pub(super) fn potential_energy(run: &PairRun, k: f64, neighbours: &mut Neighbours, x: impl Fn(usize) -> f64) -> f64 {
    let mut energy_sum = 0.0;
    let pair_law = &run.pairs.link.law;
    neighbours.for_each_touching(run, x, |_, elongation, _| {
        energy_sum += pair_law.potential(k, elongation)
    });
    energy_sum
}

/// Work in the frame that has ended, by the forces at the positions before it. `d` are the steps of the frame before
/// and of this one [m] (n_mat each); if the frame was computed finer, both are those of this one.
pub(super) fn work(
    run: &PairRun,
    k_and_z: [f64; 2],
    neighbours: &mut Neighbours,
    modules: &ModuleState,
    frame_steps: [&[f64]; 2],
    history: &ContactHistory,
) -> PairWork {
    let pair_link = &run.pairs.link;
    let mut pair_work = PairWork::default();
    let position_before = |mat: usize| modules.x[mat] - modules.d[mat];
    neighbours.for_each_touching(run, position_before, |ends, elongation, direction| {
        let previous_length_step = pair_link.length_step(ends, direction, |mat| frame_steps[0][mat]);
        let length_step = 0.5 * pair_link.length_step(ends, direction, |mat| frame_steps[0][mat] + frame_steps[1][mat]);
        let (pair_force, elastic_force) = (
            pair_link.law.force(k_and_z, elongation, previous_length_step),
            pair_link.law.elastic(k_and_z[0], elongation),
        );
        pair_work.total += length_step * pair_force;
        pair_work.elastic += length_step * elastic_force;
        if run.pairs.friction > 0.0 {
            let relative_steps = frame_steps.map(|d| pair_link.offset_between(ends, |mat| d[mat]));
            let contact = PairContact {
                elongation,
                force: pair_force,
                elastic_force,
                direction,
                offset: pair_link.offset_between(ends, position_before),
                relative_step: relative_steps[0],
            };
            let sliding = contact.sliding(&run.pairs, k_and_z);
            let (friction_force, _) = sliding.force(history.anchor_of(run.points(ends)));
            for (axis, force) in friction_force.into_iter().enumerate() {
                pair_work.total += 0.5 * (relative_steps[0][axis] + relative_steps[1][axis]) * force;
            }
        }
    });
    pair_work
}

/// Elastic energy of friction in all touching pairs of stiffness `k` [J].
pub(super) fn friction_energy(run: &PairRun, k: f64, history: &ContactHistory, modules: &ModuleState) -> f64 {
    let pair_link = &run.pairs.link;
    let pair_energy = |(points, anchor): ([u32; 2], [f64; 3])| {
        let pair_ends = run.ends(points);
        let elongation = pair_link.length_and_direction(pair_ends, |mat| modules.x[mat]).0 - run.rest;
        if elongation >= 0.0 {
            return 0.0;
        }
        let Some([tangent_stiffness, _]) =
            pair_link
                .law
                .stiffness_and_pull(k, elongation, pair_link.law.elastic(k, elongation))
        else {
            return 0.0;
        };
        let spring_elongation = difference(pair_link.offset_between(pair_ends, |mat| modules.x[mat]), anchor);
        let stretch_square: f64 = spring_elongation.iter().map(|component| component * component).sum();
        0.5 * tangent_stiffness * stretch_square
    };
    history.pairs().map(pair_energy).sum()
}
