//! Integrators: a network that goes on by itself, frame by frame, pushed by impulses alone.
//!
//! The CA scheme is quick and bends the pitch of high partials; other methods buy accuracy or safety for
//! more work. All of them step the same numbers (M = m/T², K = k, Z = z/T, velocities as V = T·v) at
//! `substeps` times the rate, take an impulse as a jump of the velocity at the beginning of a frame, and
//! neither allocate, fail nor panic while they step.

mod banded;
mod bm4;
mod ca;
mod ca2p;
mod certify;
mod conjugate;
pub(crate) mod flow;
mod ieq;
mod local;
mod mesh;
mod method;
mod order;
mod passes;
pub(crate) mod square;
mod trapezoid;
mod watched;

pub(crate) use certify::certify;
pub(crate) use method::MeshMethod;

use std::sync::Arc;

use crate::guard::{FinerFrames, Guard};
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network};
use crate::units::Rate;
use mesh::Mesh;

/// What every method does.
trait Stepper {
    /// Go on one step of the mesh's rate; impulses [N·s] act at its beginning.
    fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>);
    /// Be ready for a crew of so many threads, where that gains anything.
    fn share(&mut self, _threads: usize) {}
    /// Whether a crew can share its work.
    fn is_shared(&self) -> bool {
        false
    }
    /// Positions now [m]                                            (n_mat)
    fn x(&self) -> &[f64];
    /// Its guard, where its links stiffen.
    fn guard(&self) -> Option<&Guard> {
        None
    }
    fn guard_mut(&mut self) -> Option<&mut Guard> {
        None
    }
    /// Velocity of a MAT now, before any impulse of this frame [m/s].
    fn velocity(&self, mat: usize) -> f64;
    /// Velocities or last steps, whichever carry its motion on            (n_mat)
    fn pace(&mut self) -> &mut [f64];
    /// The last step of a MAT, x − x⁻ [m], as well as the method knows it.
    fn last_step(&self, mat: usize) -> f64;
    /// Set a MAT going: where it is, and by what last step it came there [m]; once all are set, `settle`.
    fn put(&mut self, mat: usize, x: f64, step: f64);
    /// Find anew what follows from where all MATs are.
    fn settle(&mut self);
    /// The energy that the method keeps [J]: half a step before now where it lives between frames.
    fn energy(&self) -> f64;
}

#[derive(Clone, Debug)]
enum Motion {
    Ca(Box<ca::Ca>),
    Ca2p(ca2p::Ca2p),
    Bm4(bm4::Bm4),
    Ieq(ieq::Ieq),
    Trapezoid(trapezoid::Trapezoid),
}

impl Motion {
    fn stepper(&self) -> &dyn Stepper {
        match self {
            Self::Ca(it) => &**it,
            Self::Ca2p(it) => it,
            Self::Bm4(it) => it,
            Self::Ieq(it) => it,
            Self::Trapezoid(it) => it,
        }
    }

    fn stepper_mut(&mut self) -> &mut dyn Stepper {
        match self {
            Self::Ca(it) => &mut **it,
            Self::Ca2p(it) => it,
            Self::Bm4(it) => it,
            Self::Ieq(it) => it,
            Self::Trapezoid(it) => it,
        }
    }
}

/// A network that goes on by one method; cloning it is a snapshot.
#[derive(Clone, Debug)]
pub(crate) struct Integrator {
    motion: Motion,
    substeps: u32,
}

impl Integrator {
    /// A network at its X0 and V0, to be stepped at `rate`, `substeps` steps a frame.
    ///
    /// Imposed points stay where they are. Methods other than CA take continuous parameters and plain
    /// contacts only; what a method cannot step is refused with its module's name.
    pub(crate) fn new(
        network: &Network,
        rate: Rate,
        way: MeshMethod,
        substeps: u32,
    ) -> Result<Self, Error> {
        let rate = faster(rate, substeps)?;
        let mesh = Arc::new(Mesh::new(network, rate, way)?);
        let motion = match way {
            MeshMethod::Ca => Motion::Ca(Box::new(ca::Ca::new(mesh, network, rate)?)),
            MeshMethod::Ca2p => Motion::Ca2p(ca2p::Ca2p::new(mesh, network)?),
            MeshMethod::Bm4 => Motion::Bm4(bm4::Bm4::new(mesh, network)),
            MeshMethod::Ieq => Motion::Ieq(ieq::Ieq::new(mesh, network)?),
            MeshMethod::Trapezoid => Motion::Trapezoid(trapezoid::Trapezoid::new(mesh, network)?),
        };
        Ok(Self { motion, substeps })
    }

    /// From frame n to n+1: impulses (MAT, [N·s]) act at the beginning of the frame.
    pub(crate) fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        let method = self.motion.stepper_mut();
        method.step(impulses, team);
        for _ in 1..self.substeps {
            method.step(&[], team);
        }
    }

    /// All it moves by is so many times as much.
    pub(crate) fn slow_down(&mut self, by: f64) {
        let method = self.motion.stepper_mut();
        method.pace().iter_mut().for_each(|v| *v *= by);
        if let Some(guard) = method.guard_mut() {
            guard.slow_down(by);
        }
    }

    /// Where a MAT is, and its step in a frame [m].
    pub(crate) fn motion(&self, mat: usize) -> (f64, f64) {
        let method = self.motion.stepper();
        (
            method.x()[mat],
            method.last_step(mat) * f64::from(self.substeps),
        )
    }

    /// Set a MAT going as it goes elsewhere; once all are, [`Integrator::settle`].
    pub(crate) fn put(&mut self, mat: usize, (x, step): (f64, f64)) {
        let step = step / f64::from(self.substeps);
        self.motion.stepper_mut().put(mat, x, step);
    }

    /// All MATs are set.
    pub(crate) fn settle(&mut self) {
        let method = self.motion.stepper_mut();
        method.guard_mut().into_iter().for_each(Guard::forget);
        method.settle();
    }

    /// Be ready for a crew of so many threads, where that gains anything; the bits stay the same.
    pub(crate) fn share(&mut self, threads: usize) {
        self.motion.stepper_mut().share(threads);
    }

    /// Whether a crew can share its work.
    pub(crate) fn is_shared(&self) -> bool {
        self.motion.stepper().is_shared()
    }

    /// Frames that were computed finer, if any.
    pub(crate) fn finer_frames(&self) -> Option<FinerFrames> {
        let finer_frames = self.motion.stepper().guard()?.finer_frames()?;
        Some(finer_frames.by(self.substeps))
    }

    /// Positions at the frame [m], (n_mat).
    pub(crate) fn positions(&self) -> &[f64] {
        self.motion.stepper().x()
    }

    /// Velocities [m/s] of some MATs at the frame, before its impulses, as well as the method knows them;
    /// `mats`, `out`: (n,).
    pub(crate) fn velocities(&self, mats: &[usize], out: &mut [f64]) {
        let method = self.motion.stepper();
        for (out, &mat) in out.iter_mut().zip(mats) {
            *out = method.velocity(mat);
        }
    }

    /// Whether every MAT is where a MAT can be.
    pub(crate) fn sound(&self) -> bool {
        passes::within(self.positions())
    }

    /// The method's own energy [J]: constant without losses and impulses, as far as the method goes.
    pub(crate) fn energy(&self) -> f64 {
        self.motion.stepper().energy()
    }
}

/// The rate of the steps.
fn faster(rate: Rate, substeps: u32) -> Result<Rate, Error> {
    let refused = |_| Error::Refused {
        module: "substeps".to_owned(),
        message: format!("{substeps} steps a frame are not possible"),
    };
    Rate::new(rate.hertz() * f64::from(substeps)).map_err(refused)
}

#[cfg(test)]
mod tests;
