//! The energy account of stepped points: points on which impulses act between frames and springs act in the steps.
//!
//! Within a frame such a point moves as if it were free, and what holds it acts at frames only. So the work of an
//! impulse along that motion, which is what the contact or law gives or takes, is not its work in the steps. The
//! difference is created energy; without springs it is zero, to rounding. All points have one account: what is created
//! at one end of a link may be lost at the other.

use super::script::FineScript;
use crate::island::energy_account::{EnergyAccount, EnergyGain};
use crate::island::energy_gain::ACCOUNTED_LAWS_MAX;
use crate::network::{LinkKind, Network};
use crate::scheme::Scheme;
use crate::state::ModuleState;

/// A point on which impulses act between frames, and springs in the steps.
#[derive(Clone, Debug)]
struct SteppedPoint {
    joint: usize,
    mat: usize,
    /// A link between frames that ends there.
    link: usize,
    /// Its velocity at the start of this frame [m/frame] and its acceleration [m/frame²], if no link pushes it.
    free_motion: [f64; 2],
    /// In the step before: the force in the steps that replaces impulses [N], and the last step [m].
    impulse_force: f64,
    last_step: f64,
    /// Energy created at this point alone [J].
    created_energy: f64,
}

crate::archive::state!(SteppedPoint {
    impulse_force,
    last_step,
    created_energy
});

/// All stepped points of an island, and their energy account.
#[derive(Clone, Debug)]
pub(in crate::island) struct SteppedPoints {
    points: Vec<SteppedPoint>,
    energy_account: EnergyAccount,
    /// The most energy that was created, and a link at the point where most of it was.
    worst_gain: Option<EnergyGain>,
    worst_link: usize,
}

crate::archive::state!(SteppedPoints {
    points,
    energy_account,
    worst_gain,
    worst_link
});

impl SteppedPoints {
    /// Points of a mesh are left out. A mesh that is a body has its own energy account; a mesh of many hardening
    /// springs is bounded by the guard, which restarts accounts too often for this one.
    pub(super) fn new(script: &FineScript, network: &Network) -> Self {
        let hardens = |kind: &LinkKind| match kind {
            LinkKind::Lnl(law) => law.hardening_spring().is_some(),
            _ => false,
        };
        let springs = network.runs().iter().filter(|run| hardens(&run.kind));
        let is_mesh = springs.map(|run| run.len).sum::<usize>() > ACCOUNTED_LAWS_MAX;
        let is_stepped = |mat: usize| {
            let link_ends = script.links.iter().flat_map(|run| [run.a, run.b]);
            let fine_link_count = link_ends.filter(|&end| end == mat).count();
            !is_mesh && network.degree(mat) as usize > fine_link_count
        };
        let indexed_joints = script.joints.iter().enumerate();
        let stepped_joints =
            indexed_joints.filter(|(_, joint)| joint.port.is_none() && joint.cell.is_some() && is_stepped(joint.mat));
        let new_point = |(index, joint): (usize, &super::Joint)| {
            let mut link_ends = script.link_joints.iter();
            let link_index = link_ends.position(|&(a, b)| a == index || b == index)?;
            Some(SteppedPoint {
                joint: index,
                mat: joint.mat,
                link: script.links[link_index].first_link,
                free_motion: [0.0; 2],
                impulse_force: 0.0,
                last_step: 0.0,
                created_energy: 0.0,
            })
        };
        Self {
            points: stepped_joints.filter_map(new_point).collect(),
            energy_account: EnergyAccount::default(),
            worst_gain: None,
            worst_link: 0,
        }
    }

    /// Note where a joint would go in this frame: the step to the next frame, and half of the change of the step by
    /// forces that last [m].
    pub(super) fn record_free_motion(&mut self, joint: usize, step: f64, curvature: f64) {
        if let Some(point) = self.points.iter_mut().find(|point| point.joint == joint) {
            point.free_motion = [step - curvature, 2.0 * curvature];
        }
    }

    /// Count the work that the impulses of the step before did in the steps: ½(d[n] + d[n+1])·f.
    pub(super) fn count_step_work(&mut self, scheme: &Scheme, modules: &ModuleState) {
        let (mut impulse_work, mut kinetic_energy) = (0.0, 0.0);
        for point in &mut self.points {
            let (last_step, w) = (modules.d[point.mat], scheme.w[point.mat]);
            if w > 0.0 {
                kinetic_energy += 0.5 * last_step * last_step / w;
            }
            let point_work = 0.5 * (point.last_step + last_step) * point.impulse_force;
            point.created_energy += point_work;
            impulse_work += point_work;
        }
        if impulse_work != 0.0 {
            self.energy_account.add_work_of_masses(-impulse_work, kinetic_energy);
        }
    }

    /// Record the forces that impulses of the previous frame carry over into this frame, for each point [N];
    /// `carried_forces` has an entry for each joint.
    pub(super) fn record_carried_forces(&mut self, carried_forces: &[f64], modules: &ModuleState) {
        for point in &mut self.points {
            (point.impulse_force, point.last_step) = (carried_forces[point.joint], modules.d[point.mat]);
        }
    }

    /// Count the work of this frame's impulses, those on all joints, along the motion within the frame; and note the
    /// forces that replace them.
    pub(super) fn record_impulses(&mut self, script: &FineScript, joint_impulses: &[f64], scheme: &Scheme) {
        let (n_instants, frame_rate) = (script.basis.n_polynomials(), script.rate.hertz());
        for point in &mut self.points {
            let joint_impulses = &joint_impulses[point.joint * n_instants..(point.joint + 1) * n_instants];
            let split_shares = script.joints[point.joint].impulse_split.iter();
            let instants = script.basis.instants.iter();
            let (mut force_sum, mut force_moment) = (0.0, 0.0);
            for ((impulse, s), [share_now, _]) in joint_impulses.iter().zip(instants).zip(split_shares) {
                force_sum += impulse * frame_rate;
                force_moment += impulse * frame_rate * s;
                point.impulse_force += impulse * share_now;
            }
            let [velocity, acceleration] = point.free_motion;
            let mean_velocity = velocity + 0.5 * scheme.w[point.mat] * force_sum;
            let frame_work = force_sum * mean_velocity + force_moment * acceleration;
            point.created_energy -= frame_work;
            self.energy_account.add_work(frame_work);
        }
    }

    /// Restart the account.
    pub(in crate::island) fn restart(&mut self) {
        self.energy_account = EnergyAccount::default();
        for point in &mut self.points {
            (point.impulse_force, point.created_energy) = (0.0, 0.0);
        }
    }

    /// The energy created by frame `n`, if it is worth reporting: a link and the MAT where most of it was created, and
    /// the energy. `motion_energy` gives the energy of everything that moves, `imposed_work_max` the work of hands and
    /// imposed paths.
    pub(in crate::island) fn check_energy(
        &mut self,
        (motion_energy, imposed_work_max): (impl Fn() -> f64, f64),
        n: u64,
    ) -> Option<(usize, usize, EnergyGain)> {
        if !self.energy_account.is_overdrawn() {
            return None;
        }
        let gain = self
            .energy_account
            .energy_gain(0.0, motion_energy(), n)
            .with_reference_energy_min(imposed_work_max);
        let points = self.points.iter();
        let worst_point =
            points.max_by(|point, other_point| point.created_energy.total_cmp(&other_point.created_energy))?;
        if !gain.is_reportable() {
            return None;
        }
        let worst_gain = gain.worse_of(self.worst_gain);
        if self.worst_gain != Some(worst_gain) {
            (self.worst_gain, self.worst_link) = (Some(worst_gain), worst_point.link);
        }
        Some((worst_point.link, worst_point.mat, gain))
    }

    /// The most energy that was created, and a link where most of it was.
    pub(in crate::island) fn worst_gain(&self) -> Option<(usize, EnergyGain)> {
        Some((self.worst_link, self.worst_gain?))
    }

    /// Remove the points that are among the marked MATs (n_mat).
    pub(super) fn remove_points(&mut self, is_muted: &[bool]) {
        self.points.retain(|point| !is_muted[point.mat]);
        self.restart();
    }
}
