//! Integrators: methods that step a network frame by frame under impulses.
//!
//! The CA scheme is fast and lowers the pitch of high partials; other methods are more accurate or more stable at a
//! higher cost. All methods use the same numbers (M = m/T², K = k, Z = z/T, velocities as V = T·v) at `substeps` times
//! the rate, apply an impulse as a jump of the velocity at the beginning of a frame, and neither allocate, fail nor
//! panic while they step.

mod bm4;
mod ca;
mod ca2p;
mod certify;
mod conjugate;
pub(crate) mod flow;
mod ieq;
mod local;
mod mesh;
mod mesh_system;
mod method;
mod passes;
pub(crate) mod square;

pub(crate) use bm4::STAGES;
pub(crate) use certify::certify;
pub(crate) use method::MeshMethod;

use crate::archive::{Archive, Damaged, State};
use std::sync::Arc;

use crate::guard::{FinerFrames, Guard};
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network};
use crate::scheme::{LinkRun, LinkRunKind};
use crate::timeline::Lead;
use crate::units::Rate;
use mesh::Mesh;

/// A stepping method with its state.
trait Stepper {
    /// Advance by one step; impulses (MAT, [N·s]) act at its beginning.
    fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>);
    /// Partition the mesh for a team of `threads` threads if this saves time.
    fn partition(&mut self, _threads: usize) {}
    /// Whether a thread team can share the work.
    fn can_share_work(&self) -> bool {
        false
    }
    /// Set the K and Z of led links to their values at `at`: a frame, and a fraction of a frame.
    fn set_led_links(&mut self, _lead: &Lead, _at: (u64, f64)) {}
    /// Recompute what depends on the K and Z of led links.
    fn recompute_led(&mut self, _team: &mut ThreadTeam<'_>) {}
    /// Take a copy of the numbers that leads change, so that none is shared with a clone.
    fn unshare_parameters(&mut self) {}
    /// Positions now [m]                                            (n_mat)
    fn positions(&self) -> &[f64];
    /// The guard of links that stiffen, if the network has any.
    fn guard(&self) -> Option<&Guard> {
        None
    }
    fn guard_mut(&mut self) -> Option<&mut Guard> {
        None
    }
    /// Velocity of a MAT now, before any impulse of this frame [m/s].
    fn velocity(&self, mat: usize) -> f64;
    /// The method's state: velocities or last steps           (n_mat)
    fn velocities_mut(&mut self) -> &mut [f64];
    /// The last step of a MAT, x − x⁻ [m], to the method's accuracy.
    fn last_step(&self, mat: usize) -> f64;
    /// Set position and last step of a MAT [m]; call `update_after_motion` once all are set.
    fn set_motion(&mut self, mat: usize, x: f64, step: f64);
    /// Recompute what depends on the positions and steps of all MATs.
    fn update_after_motion(&mut self);
    /// The energy that the method conserves [J]; of a staggered method, its value half a step earlier.
    fn energy(&self) -> f64;
    /// The energy of masses and links by their laws [J], even if the method conserves another.
    fn stored_energy(&self) -> f64 {
        self.energy()
    }
    /// The network in numbers.
    fn mesh(&self) -> &Mesh;
}

#[derive(Clone, Debug)]
enum MethodStepper {
    Ca(Box<ca::Ca>),
    Ca2p(ca2p::Ca2p),
    Bm4(bm4::Bm4),
    Ieq(ieq::Ieq),
}

impl State for MethodStepper {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        match self {
            Self::Ca(stepper) => stepper.archive(archive),
            Self::Ca2p(stepper) => stepper.archive(archive),
            Self::Bm4(stepper) => stepper.archive(archive),
            Self::Ieq(stepper) => stepper.archive(archive),
        }
    }
}

impl MethodStepper {
    fn stepper(&self) -> &dyn Stepper {
        match self {
            Self::Ca(stepper) => &**stepper,
            Self::Ca2p(stepper) => stepper,
            Self::Bm4(stepper) => stepper,
            Self::Ieq(stepper) => stepper,
        }
    }

    fn stepper_mut(&mut self) -> &mut dyn Stepper {
        match self {
            Self::Ca(stepper) => &mut **stepper,
            Self::Ca2p(stepper) => stepper,
            Self::Bm4(stepper) => stepper,
            Self::Ieq(stepper) => stepper,
        }
    }
}

/// A network stepped by one method; a clone is a snapshot.
#[derive(Clone, Debug)]
pub(crate) struct Integrator {
    method_stepper: MethodStepper,
    substeps: u32,
}

crate::archive::state!(Integrator { method_stepper });

/// Largest elongation [m] and rate [m/s] up to which a law's damping is tested for giving energy.
const DAMPING_TEST_MAX: (f64, f64) = (1e-2, 10.0);

/// Largest number of links whose energy is integrated: each takes a few hundred values of its law.
const INTEGRATED_LINKS_MAX: usize = 32;

impl Integrator {
    /// A network at its X0 and V0, stepped `substeps` times a frame of `rate`. Imposed points do not move.
    ///
    /// # Errors
    /// With the name of a module that the method cannot step: methods other than CA take continuous parameters and
    /// plain contacts only.
    pub(crate) fn new(network: &Network, rate: Rate, method: MeshMethod, substeps: u32) -> Result<Self, Error> {
        let rate = substep_rate(rate, substeps)?;
        let network_mesh = Arc::new(Mesh::new(network, rate, method)?);
        let method_stepper = match method {
            MeshMethod::Ca => MethodStepper::Ca(Box::new(ca::Ca::new(network_mesh, network, rate)?)),
            MeshMethod::Ca2p => MethodStepper::Ca2p(ca2p::Ca2p::new(network_mesh, network)?),
            MeshMethod::Bm4 => MethodStepper::Bm4(bm4::Bm4::new(network_mesh, network)),
            MeshMethod::Ieq => MethodStepper::Ieq(ieq::Ieq::new(network_mesh, network)?),
        };
        Ok(Self {
            method_stepper,
            substeps,
        })
    }

    /// Advance from frame n to n+1; impulses (MAT, [N·s]) act at the beginning of the frame.
    pub(crate) fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        let stepper = self.method_stepper.stepper_mut();
        stepper.step(impulses, team);
        for _ in 1..self.substeps {
            stepper.step(&[], team);
        }
    }

    /// Does the same as [`Integrator::step`] if the K and Z of some links are led; `n` counts frames.
    pub(crate) fn step_led(&mut self, n: u64, leads: &[Lead], impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        if leads.is_empty() {
            return self.step(impulses, team);
        }
        let stepper = self.method_stepper.stepper_mut();
        for substep in 0..self.substeps {
            let frame_part = (f64::from(substep) + 0.5) / f64::from(self.substeps);
            leads
                .iter()
                .for_each(|lead| stepper.set_led_links(lead, (n, frame_part)));
            stepper.recompute_led(team);
            stepper.step(if substep == 0 { impulses } else { &[] }, team);
        }
    }

    /// Set the K and Z of led links to their values at frame `n`.
    pub(crate) fn set_led_links(&mut self, n: u64, leads: &[Lead]) {
        let stepper = self.method_stepper.stepper_mut();
        leads.iter().for_each(|lead| stepper.set_led_links(lead, (n, 0.0)));
        if !leads.is_empty() {
            stepper.recompute_led(&mut ThreadTeam::alone());
        }
    }

    /// Take a copy of the numbers that leads change, so that none is shared with a clone and a step allocates nothing.
    pub(crate) fn unshare_parameters(&mut self) {
        self.method_stepper.stepper_mut().unshare_parameters();
    }

    /// Multiply all velocities by a factor.
    pub(crate) fn scale_velocities(&mut self, factor: f64) {
        let stepper = self.method_stepper.stepper_mut();
        stepper.velocities_mut().iter_mut().for_each(|v| *v *= factor);
        if let Some(guard) = stepper.guard_mut() {
            guard.scale_velocities(factor);
        }
    }

    /// Position of a MAT, and its step over a frame [m].
    pub(crate) fn mat_motion(&self, mat: usize) -> (f64, f64) {
        let stepper = self.method_stepper.stepper();
        (
            stepper.positions()[mat],
            stepper.last_step(mat) * f64::from(self.substeps),
        )
    }

    /// Set position of a MAT and its step over a frame [m]; call [`Integrator::update_after_motion`] once all are set.
    pub(crate) fn set_mat_motion(&mut self, mat: usize, (x, step): (f64, f64)) {
        let step = step / f64::from(self.substeps);
        self.method_stepper.stepper_mut().set_motion(mat, x, step);
    }

    /// Recompute what depends on the positions and steps of all MATs.
    pub(crate) fn update_after_motion(&mut self) {
        let stepper = self.method_stepper.stepper_mut();
        stepper.guard_mut().into_iter().for_each(Guard::reset);
        stepper.update_after_motion();
    }

    /// Partition the mesh for a team of `threads` threads if this saves time; results stay the same to the last bit.
    pub(crate) fn partition(&mut self, threads: usize) {
        self.method_stepper.stepper_mut().partition(threads);
    }

    /// Whether a thread team can share the work.
    pub(crate) fn can_share_work(&self) -> bool {
        self.method_stepper.stepper().can_share_work()
    }

    /// Frames that were computed in finer steps, if any.
    pub(crate) fn finer_frames(&self) -> Option<FinerFrames> {
        let finer_frames = self.method_stepper.stepper().guard()?.finer_frames()?;
        Some(finer_frames.per_frame(self.substeps))
    }

    /// Positions at the frame [m], (n_mat).
    pub(crate) fn positions(&self) -> &[f64] {
        self.method_stepper.stepper().positions()
    }

    /// Velocities [m/s] of some MATs at the frame, before its impulses, to the method's accuracy;
    /// `mats`, `out`: (n,).
    pub(crate) fn velocities(&self, mats: &[usize], out: &mut [f64]) {
        let stepper = self.method_stepper.stepper();
        for (out, &mat) in out.iter_mut().zip(mats) {
            *out = stepper.velocity(mat);
        }
    }

    /// Whether all positions are finite and within range.
    pub(crate) fn is_bounded(&self) -> bool {
        passes::are_in_range(self.positions())
    }

    /// Whether steps may create energy that can be measured: never for a linear network.
    pub(crate) fn may_create_energy(&self) -> bool {
        let stepped_mesh = self.method_stepper.stepper().mesh();
        // The balance of an active law cannot be judged.
        let is_known = |run: &LinkRun| !matches!(&run.kind, LinkRunKind::Lnl { law, .. } if law.is_active(DAMPING_TEST_MAX.0, DAMPING_TEST_MAX.1));
        !stepped_mesh.scheme.is_linear
            && stepped_mesh.other_runs.iter().all(is_known)
            && self.n_integrated_links() <= INTEGRATED_LINKS_MAX
    }

    /// Links whose energy has no closed form: it is integrated at each evaluation.
    pub(crate) fn n_integrated_links(&self) -> usize {
        let other_runs = self.method_stepper.stepper().mesh().other_runs.iter();
        let integrated =
            other_runs.filter(|run| matches!(&run.kind, LinkRunKind::Lnl { law, .. } if !law.has_closed_energy()));
        integrated.map(|run| run.len).sum()
    }

    /// The energy of masses and links by their laws [J].
    pub(crate) fn stored_energy(&self) -> f64 {
        self.method_stepper.stepper().stored_energy()
    }

    /// Work of the impulses of the coming frame [J]: each impulse times the mean of the velocities before and after it.
    pub(crate) fn impulse_work(&self, impulses: &[(usize, f64)]) -> f64 {
        let stepper = self.method_stepper.stepper();
        let (scaled_masses, step_rate) = (&stepper.mesh().scaled_masses, stepper.mesh().scheme.rate);
        let impulse_work = |(index, &(mat, impulse)): (usize, &(usize, f64))| {
            if scaled_masses[mat] == 0.0 {
                return 0.0;
            }
            let earlier_impulses = impulses[..index].iter().filter(|other| other.0 == mat);
            let earlier_impulse: f64 = earlier_impulses.map(|other| other.1).sum();
            let mat_mass = scaled_masses[mat] / (step_rate * step_rate);
            impulse * (stepper.velocity(mat) + (earlier_impulse + 0.5 * impulse) / mat_mass)
        };
        impulses.iter().enumerate().map(impulse_work).sum()
    }

    /// The energy that the method conserves [J]: constant to the method's accuracy if there are no losses and no
    /// impulses.
    pub(crate) fn energy(&self) -> f64 {
        self.method_stepper.stepper().energy()
    }
}

/// `substeps` times the rate.
fn substep_rate(rate: Rate, substeps: u32) -> Result<Rate, Error> {
    let refused = |_| Error::Refused {
        module: "substeps".to_owned(),
        message: format!("{substeps} steps a frame are not possible"),
    };
    Rate::new(rate.hertz() * f64::from(substeps)).map_err(refused)
}

#[cfg(test)]
mod tests;
