//! How the springs of a slow body pull once every R frames: linear ones by their exact flow, springs in space by a step
//! of CA.
//!
//! A step of CA over R frames also consists of a kick and straight motion: d += R²·F/M − κ(x − rest) − ζd, then x += d.
//! Only the kick is taken from it; the body itself computes the straight motion.

use std::sync::Arc;

use super::Slow;
use crate::integrate::flow::Flow;
use crate::kernel::thread_team::ThreadTeam;
use crate::kernel::{self, Laws};
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::Body;

/// How the springs pull.
#[derive(Clone, Debug)]
pub(crate) enum Springs {
    /// Linear springs, by their exact flow.
    Exact(Arc<Flow>),
    /// By the CA scheme of the body's own rate: springs in space, which are not linear.
    Stepped(Arc<Scheme>),
}

impl Springs {
    /// The running springs of a body of that network.
    pub(super) fn running(&self, network: &Network) -> RunningSprings {
        match self {
            Self::Exact(flow) => RunningSprings::Exact(flow.clone()),
            Self::Stepped(scheme) => {
                RunningSprings::Stepped(Box::new(SteppedSprings::new(scheme, network)))
            }
        }
    }
}

/// Running springs.
#[derive(Clone, Debug)]
pub(super) enum RunningSprings {
    Exact(Arc<Flow>),
    Stepped(Box<SteppedSprings>),
}

impl RunningSprings {
    /// The velocities of the first straight motion [m a frame], if masses begin `displacements` from rest [m] (n each).
    pub(super) fn start(&mut self, slow: &Slow, displacements: &[f64]) -> Vec<f64> {
        match self {
            Self::Exact(flow) => flow.start(displacements, &slow.v0),
            Self::Stepped(stepped) => {
                let mut after = slow.v0.clone();
                stepped.pull(slow, &slow.x0, Some(&slow.v0), &mut after);
                let pairs = after.iter().zip(&slow.v0);
                pairs.map(|(after, v0)| 0.5 * (after + v0)).collect()
            }
        }
    }

    /// Velocities after a pull at positions `x`, from those `before`, or from rest [m a frame] (n each).
    /// `displacements` is a buffer for linear springs.
    pub(super) fn pull(
        &mut self,
        slow: &Slow,
        x: &[f64],
        before: Option<&[f64]>,
        displacements: &mut [f64],
        after: &mut [f64],
    ) {
        match self {
            Self::Exact(flow) => {
                for ((displacements, x), rest) in displacements.iter_mut().zip(x).zip(&slow.rest) {
                    *displacements = rest - x;
                }
                flow.pulled(before, displacements, after);
            }
            Self::Stepped(stepped) => stepped.pull(slow, x, before, after),
        }
    }
}

/// A step of CA of the body's own network. Positions and velocities are set before each step.
#[derive(Clone, Debug)]
pub(super) struct SteppedSprings {
    scheme: Arc<Scheme>,
    body: Body,
    laws: Laws,
}

impl SteppedSprings {
    fn new(scheme: &Arc<Scheme>, network: &Network) -> Self {
        let x = network.mats().x0.clone();
        let d = vec![0.0; x.len()];
        Self {
            scheme: scheme.clone(),
            body: Body::new(scheme, x, d),
            laws: Laws::new(scheme),
        }
    }

    fn pull(&mut self, slow: &Slow, x: &[f64], before: Option<&[f64]>, after: &mut [f64]) {
        let Self { scheme, body, laws } = self;
        let frames = f64::from(slow.macrostep);
        for (index, &mat) in slow.free.iter().enumerate() {
            body.x[mat] = x[index];
            body.d[mat] = before.map_or(0.0, |before| frames * before[index]);
        }
        let team = &mut ThreadTeam::alone();
        kernel::links(scheme, &[], body, laws, team);
        kernel::advance(scheme, &mut [], body, None, team);
        for (index, &mat) in slow.free.iter().enumerate() {
            after[index] = body.d[mat] / frames;
        }
    }
}
