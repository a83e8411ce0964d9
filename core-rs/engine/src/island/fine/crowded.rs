//! Bodies that many contacts touch: impulses on them are kept as amplitudes of their modes.
//!
//! An impulse changes the paths of all joints of a body. Computed path by path, that takes n² products for each joint.
//! If there are many joints, it takes less to add the impulse to the modes, and to sum over the modes when the motion
//! of a joint is needed.

use super::basis::{Basis, Instant, dot};
use super::joint::Joint;
use super::{FineLinks, FineScript};
use crate::cell::Cell;
use crate::island::bodies::RunningBody;
use crate::kernel::bank::SUM_LANES;
use crate::kernel::pushed_modes::{
    ModeTables, ModeValues, PushedGroup, add_all_impulses, move_to_instant, point_motion, push_point,
};
use crate::scheme::{LinkRun, LinkRunKind};
use crate::units::Rate;

/// Share of the joints that push at once, as a bridge or a fret that a string wraps.
const PUSHING_SHARE: f64 = 0.25;
/// Kicks in a step.
const KICKS_PER_STEP: f64 = 6.0;
/// Paths of pairs are kept unless sums over modes take this many times fewer products.
const PRODUCTS_RATIO_MIN: f64 = 1.5;
/// Highest loss of a mode's velocity, 2σ [1/frame]: beyond it P and Q lose digits to each other.
const LOSS_MAX: f64 = 0.5;

/// The constant data of such a body.
#[derive(Clone, Debug)]
pub(super) struct CrowdedBody {
    body_index: usize,
    n_modes: usize,
    mode_tables: ModeTables,
    /// Joints on the body, and the shares of the modes in the position of each   (n_groups each)
    share_rows: Vec<(usize, Vec<ModeValues>)>,
}

/// The motion that impulses add to such a body in a frame.
#[derive(Clone, Debug)]
pub(super) struct CrowdedMotion {
    pushed_groups: Vec<PushedGroup>,
    /// Amplitudes before a step that may be repeated   (n_groups)
    saved_amplitudes: Vec<[ModeValues; 2]>,
    /// The instant of the frame to which the groups are brought, 0 to 1.
    instant: Option<f64>,
}

/// All bodies of which the modes are to be pushed.
pub(super) fn crowded_bodies(
    links: &[LinkRun],
    joints: &[Joint],
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
) -> Vec<CrowdedBody> {
    // Laws and friction are solved from the responses of pairs.
    if !links.iter().all(|run| matches!(run.kind, LinkRunKind::But(_))) {
        return Vec::new();
    }
    let body_indices = 0..bodies.len();
    let bodies_found =
        body_indices.filter_map(|body_index| CrowdedBody::new(body_index, joints, bodies, (basis, rate)));
    bodies_found.collect()
}

impl CrowdedBody {
    /// `None` if the paths of pairs take less, or if its modes are complex or discrete.
    fn new(body_index: usize, joints: &[Joint], bodies: &[RunningBody], (basis, rate): (&Basis, Rate)) -> Option<Self> {
        let joint_ports: Vec<(usize, usize)> = (joints.iter().enumerate())
            .filter_map(|(joint_index, joint)| match joint.port {
                Some((joint_body, port)) if joint_body == body_index => Some((joint_index, port)),
                _ => None,
            })
            .collect();
        let modal_body = bodies[body_index].modal()?;
        let (n_instants, n_modes) = (basis.n_polynomials(), modal_body.n_modes());
        if !is_crowded(joint_ports.len(), n_modes, n_instants) {
            return None;
        }
        let mode_cells = modal_body.cells()?;
        let time_step = rate.step();
        if mode_cells.iter().any(|cell| cell.viscosity() * time_step > LOSS_MAX) {
            return None;
        }
        let n_groups = n_modes.div_ceil(SUM_LANES);
        let share_row = |port: usize| {
            let mut share_row = vec![[0.0; SUM_LANES]; n_groups];
            for (mode, share) in modal_body.shape(port).iter().enumerate() {
                share_row[mode / SUM_LANES][mode % SUM_LANES] = *share;
            }
            share_row
        };
        Some(Self {
            body_index,
            n_modes,
            mode_tables: build_tables(&mode_cells, basis, rate),
            share_rows: joint_ports
                .iter()
                .map(|&(joint, port)| (joint, share_row(port)))
                .collect(),
        })
    }

    /// The motion at rest.
    pub(super) fn resting_motion(&self) -> CrowdedMotion {
        CrowdedMotion {
            pushed_groups: vec![PushedGroup::START; self.mode_tables.kappa_and_zeta.len()],
            saved_amplitudes: vec![[[0.0; SUM_LANES]; 2]; self.mode_tables.kappa_and_zeta.len()],
            instant: Some(0.0),
        }
    }

    /// Body and row of each joint that is on such a body   (n_joints)
    pub(super) fn joint_rows(bodies: &[Self], n_joints: usize) -> Vec<Option<(usize, usize)>> {
        let mut joint_rows = vec![None; n_joints];
        for (body, crowded) in bodies.iter().enumerate() {
            for (row, &(joint, _)) in crowded.share_rows.iter().enumerate() {
                joint_rows[joint] = Some((body, row));
            }
        }
        joint_rows
    }

    pub(super) fn body_index(&self) -> usize {
        self.body_index
    }

    pub(super) fn n_modes(&self) -> usize {
        self.n_modes
    }
}

/// Whether sums over modes take far fewer products than paths of pairs, if a share of the joints push at once.
fn is_crowded(n_joints: usize, n_modes: usize, n_instants: usize) -> bool {
    let (joint_count, mode_count, n_instants) = (n_joints as f64, n_modes as f64, n_instants as f64);
    let pushing_joints = (PUSHING_SHARE * joint_count).max(1.0);
    let pair_products = KICKS_PER_STEP * pushing_joints * joint_count * n_instants * n_instants;
    // For each kick the instant, and what each contact sees and pushes; for each step what all joints see.
    let mode_products =
        mode_count * (KICKS_PER_STEP * (2.0 * n_instants + 8.0 + 3.0 * pushing_joints) + 2.0 * joint_count);
    pair_products > PRODUCTS_RATIO_MIN * mode_products
}

/// The tables of modes with these motions. A group that is not full is filled with copies of a mode, which have no
/// share in any position.
fn build_tables(cells: &[Cell], basis: &Basis, rate: Rate) -> ModeTables {
    let (n, time_step) = (basis.n_polynomials(), rate.step());
    let n_groups = cells.len().div_ceil(SUM_LANES);
    let mut motion_coefficients = vec![[[0.0; SUM_LANES]; 2]; n_groups * n];
    let mut kappa_and_zeta = vec![[[0.0; SUM_LANES]; 2]; n_groups];
    let mut coefficients = vec![0.0; n];
    for index in 0..n_groups * SUM_LANES {
        let (mode_cell, group_index, lane_index) =
            (&cells[index.min(cells.len() - 1)], index / SUM_LANES, index % SUM_LANES);
        for coordinate in 0..2 {
            let motion_value = |s: &f64| unit_motion(mode_cell, s * time_step, coordinate, time_step);
            let motion_samples: Vec<f64> = basis.instants.iter().map(motion_value).collect();
            basis.fit(&motion_samples, &mut coefficients);
            let group_motions = motion_coefficients[group_index * n..(group_index + 1) * n].iter_mut();
            for (motion, coefficient) in group_motions.zip(&coefficients) {
                motion[coordinate][lane_index] = *coefficient;
            }
        }
        kappa_and_zeta[group_index][0][lane_index] = mode_cell.stiffness() * time_step * time_step;
        kappa_and_zeta[group_index][1][lane_index] = mode_cell.viscosity() * time_step;
    }
    ModeTables {
        n_polynomials: n,
        motion_coefficients,
        kappa_and_zeta,
    }
}

/// Displacement `t` [s] after a start with 1 m (`coordinate` = 0), or with 1 m a frame.
fn unit_motion(cell: &Cell, t: f64, coordinate: usize, step: f64) -> f64 {
    if coordinate == 0 {
        cell.released(t)
    } else {
        cell.response(t) / step
    }
}

impl CrowdedMotion {
    /// Begin a frame.
    fn begin(&mut self) {
        self.pushed_groups.fill(PushedGroup::START);
        self.instant = Some(0.0);
    }

    fn save(&mut self, body: &CrowdedBody) {
        add_all_impulses(&body.mode_tables, &mut self.pushed_groups);
        for (saved, group) in self.saved_amplitudes.iter_mut().zip(&self.pushed_groups) {
            *saved = group.amplitudes;
        }
    }

    fn restore(&mut self) {
        for (saved, group) in self.saved_amplitudes.iter().zip(&mut self.pushed_groups) {
            group.restore(*saved);
        }
        self.instant = None;
    }
}

impl FineLinks {
    /// Begin a frame.
    pub(super) fn begin_crowded_motions(&mut self) {
        self.crowded_motions.iter_mut().for_each(CrowdedMotion::begin);
    }

    /// Keep what impulses have added so far, for a step that may be repeated.
    pub(super) fn save_crowded_motions(&mut self, script: &FineScript) {
        for (motion, body) in self.crowded_motions.iter_mut().zip(&script.crowded_bodies) {
            motion.save(body);
        }
    }

    /// Undo the last step.
    pub(super) fn restore_crowded_motions(&mut self) {
        self.crowded_motions.iter_mut().for_each(CrowdedMotion::restore);
    }

    /// An instant of this frame, 0 to 1. From now on the motion of joints is read, and joints are pushed, at this
    /// instant.
    pub(super) fn set_instant(&mut self, script: &FineScript, s: f64) -> Instant {
        let instant = Instant::new(script.basis.n_polynomials(), s);
        for (motion, body) in self.crowded_motions.iter_mut().zip(&script.crowded_bodies) {
            if motion.instant != Some(s) {
                move_to_instant(&body.mode_tables, &instant.values, &mut motion.pushed_groups);
                motion.instant = Some(s);
                self.work.products += ((2 * body.mode_tables.n_polynomials + 8) * body.n_modes) as u64;
            }
        }
        instant
    }

    /// Position [m] and velocity [m/frame] of a joint at this instant.
    pub(super) fn joint_motion(&self, script: &FineScript, joint: usize, instant: &Instant) -> [f64; 2] {
        let n_instants = script.basis.n_polynomials();
        let joint_path = &self.paths[joint * n_instants..(joint + 1) * n_instants];
        let [x, v] = [&instant.values, &instant.slopes].map(|polynomials| dot(joint_path, polynomials));
        match script.crowded_rows[joint] {
            None => [x, v],
            Some((body, row)) => {
                let [crowded_x, crowded_v] = point_motion(
                    &script.crowded_bodies[body].share_rows[row].1,
                    &self.crowded_motions[body].pushed_groups,
                );
                [x + crowded_x, v + crowded_v]
            }
        }
    }

    /// Push a joint that is on such a body at this instant [N·s]; false if it is on none.
    pub(super) fn push_crowded_joint(&mut self, script: &FineScript, joint: usize, impulse: f64) -> bool {
        let Some((body_index, row_index)) = script.crowded_rows[joint] else {
            return false;
        };
        let (crowded_body, body_motion) = (
            &script.crowded_bodies[body_index],
            &mut self.crowded_motions[body_index],
        );
        push_point(
            &crowded_body.share_rows[row_index].1,
            impulse * script.rate.step(),
            &mut body_motion.pushed_groups,
        );
        // The change of the modes, and the read-out of the joint.
        self.work.products += 3 * crowded_body.n_modes as u64;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::island::fine::basis::RELATIVE_ERROR;
    use crate::maths::sin;

    #[test]
    fn crowded_modes_follow_each_impulse() {
        let rate = Rate::new(44_100.0).unwrap();
        // Oscillating, critically damped, creeping and free modes; more than a group holds.
        let cells: Vec<Cell> = (0..13)
            .map(|i| match i % 4 {
                0 => Cell::new(1.0, 9e6 * f64::from((i + 1) * (i + 1)), 50.0),
                1 => Cell::new(1.0, 1e6, 2e3),
                2 => Cell::new(1.0, 1e6, 1e4),
                _ => Cell::new(1.0, 0.0, 0.0),
            })
            .collect();
        let reach = cells.iter().map(Cell::pole_magnitude_max).fold(0.0, f64::max) * rate.step();
        let basis = Basis::new(reach, RELATIVE_ERROR);
        let tables = build_tables(&cells, &basis, rate);
        let mode_share = |row: usize, mode: usize| sin((7 * row + 3 * mode + 1) as f64);
        let share_rows: Vec<Vec<ModeValues>> = (0..3)
            .map(|row| {
                let mut groups = vec![[0.0; SUM_LANES]; 2];
                (0..13).for_each(|mode| groups[mode / SUM_LANES][mode % SUM_LANES] = mode_share(row, mode));
                groups
            })
            .collect();
        let mut groups = vec![PushedGroup::START; 2];
        // Instant, row and impulse; two of them at one instant.
        let push_list = [(0.0, 0, 1e-3), (0.3, 1, -2e-3), (0.3, 2, 3e-3), (0.85, 0, 5e-4)];
        let mut instant_now = 0.0;
        for &(s, row, impulse) in &push_list {
            if s != instant_now {
                move_to_instant(&tables, &Instant::new(basis.n_polynomials(), s).values, &mut groups);
                instant_now = s;
            }
            push_point(&share_rows[row], impulse * rate.step(), &mut groups);
        }
        for end in [0.85, 0.9, 1.0] {
            // At the instant of the last impulse the velocity has changed already.
            if end != instant_now {
                move_to_instant(&tables, &Instant::new(basis.n_polynomials(), end).values, &mut groups);
            }
            for (seen, row_seen) in share_rows.iter().enumerate() {
                let [x, v] = point_motion(row_seen, &groups);
                let mut exact_motion = [0.0; 2];
                for &(s, row, impulse) in &push_list {
                    let time_since = (end - s) * rate.step();
                    for (mode, cell) in cells.iter().enumerate() {
                        let modal_impulse = impulse * mode_share(row, mode) * mode_share(seen, mode);
                        exact_motion[0] += modal_impulse * cell.response(time_since);
                        let response_slope = cell.released(time_since) - cell.viscosity() * cell.response(time_since);
                        exact_motion[1] += modal_impulse * response_slope * rate.step();
                    }
                }
                let error_max = 1e-8 * rate.step() * 3e-3;
                assert!((x - exact_motion[0]).abs() < error_max, "{x} {}", exact_motion[0]);
                assert!(
                    (v - exact_motion[1]).abs() < 10.0 * error_max,
                    "{v} {}",
                    exact_motion[1]
                );
            }
        }
    }

    #[test]
    fn is_crowded_by_contacts_and_modes() {
        assert!(!is_crowded(1, 40, 9) && !is_crowded(12, 90, 9));
        assert!(is_crowded(30, 90, 9) && is_crowded(19, 45, 9));
    }
}
