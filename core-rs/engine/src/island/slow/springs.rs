//! How the springs of a slow body pull once every R frames: linear ones by their exact flow, springs in space by a step of CA.
//!
//! A step of CA over R frames is a kick and straight motion too: d += R²·F/M − κ(x − rest) − ζd, then x += d. Its first half
//! is the kick; the body goes straight by itself.

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
    /// As long as the exact motion of linear springs takes them.
    Exact(Arc<Flow>),
    /// By the CA scheme of the body's own rate: springs in space, which are not linear.
    Stepped(Arc<Scheme>),
}

impl Springs {
    /// Room for the steps of springs in space.
    pub(super) fn room(&self, network: &Network) -> Option<Box<SteppedSprings>> {
        match self {
            Self::Exact(_) => None,
            Self::Stepped(scheme) => Some(Box::new(SteppedSprings::new(scheme, network))),
        }
    }
}

/// A step of CA of the body's own network. It has no memory: what it needs is put in before each step.
#[derive(Clone, Debug)]
pub(crate) struct SteppedSprings {
    body: Body,
    laws: Laws,
}

impl SteppedSprings {
    fn new(scheme: &Scheme, network: &Network) -> Self {
        let x = network.mats().x0.clone();
        let d = vec![0.0; x.len()];
        Self {
            body: Body::new(scheme, x, d),
            laws: Laws::new(scheme),
        }
    }

    /// Velocities after a pull at positions `x`, from those `before`, or from rest [m a frame] (n each).
    pub(super) fn pull(
        &mut self,
        scheme: &Scheme,
        slow: &Slow,
        x: &[f64],
        before: Option<&[f64]>,
        after: &mut [f64],
    ) {
        let Self { body, laws } = self;
        let frames = f64::from(slow.macrostep);
        for (own, &mat) in slow.free.iter().enumerate() {
            body.x[mat] = x[own];
            body.d[mat] = before.map_or(0.0, |before| frames * before[own]);
        }
        let team = &mut ThreadTeam::alone();
        kernel::links(scheme, &[], body, laws, team);
        kernel::advance(scheme, &mut [], body, None, team);
        for (own, &mat) in slow.free.iter().enumerate() {
            after[own] = body.d[mat] / frames;
        }
    }
}
