//! How the springs of a slow body pull: linear ones by their exact flow, springs in space once every R frames by a step
//! of CA.
//!
//! A step of CA over R frames also consists of a kick and straight motion: d += R²·F/M − κ(x − rest) − ζd, then x += d.
//! Only the kick is taken from it; the body itself computes the straight motion.

use std::sync::Arc;

use super::Slow;
use super::block::SlowBlock;
use super::block_flow::BlockFlow;
use crate::archive::{Archive, Damaged, State};
use crate::kernel::thread_team::ThreadTeam;
use crate::kernel::{self, KernelScratch};
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::ModuleState;

/// How the springs pull.
#[derive(Clone, Debug)]
pub(crate) enum SpringMethod {
    /// Linear springs, by their exact flow.
    Exact(Arc<BlockFlow>),
    /// By the CA scheme of the body's own rate: springs in space, which are not linear.
    Stepped(Arc<Scheme>),
}

impl SpringMethod {
    /// The running springs of that body.
    pub(super) fn start(&self, slow: &Slow) -> RunningSprings {
        match self {
            Self::Exact(flow) => RunningSprings::Exact(Box::new(SlowBlock::new(flow))),
            Self::Stepped(scheme) => RunningSprings::Stepped(Box::new(SteppedSprings::new(scheme, &slow.network))),
        }
    }
}

/// Running springs.
#[derive(Clone, Debug)]
pub(super) enum RunningSprings {
    Exact(Box<SlowBlock>),
    Stepped(Box<SteppedSprings>),
}

impl State for RunningSprings {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        match self {
            Self::Exact(block) => block.archive(archive),
            // Springs in space have no memory.
            Self::Stepped(_) => Ok(()),
        }
    }
}

impl RunningSprings {
    /// Linear springs.
    pub(super) fn exact_block(&self) -> Option<&SlowBlock> {
        match self {
            Self::Exact(block) => Some(block),
            Self::Stepped(_) => None,
        }
    }

    /// The velocities of the first straight motion [m a frame]   (n).
    pub(super) fn start_velocities(&mut self, slow: &Slow) -> Vec<f64> {
        match self {
            Self::Exact(block) => {
                let pairs = slow.x0.iter().zip(&slow.rest_positions);
                let displacements: Vec<f64> = pairs.map(|(x, rest_position)| x - rest_position).collect();
                block.flow().frame_flow.start_velocities(&displacements, &slow.v0)
            }
            Self::Stepped(stepped_springs) => {
                let mut velocities_after = slow.v0.clone();
                stepped_springs.velocities_after_pull(slow, &slow.x0, Some(&slow.v0), &mut velocities_after);
                let pairs = velocities_after.iter().zip(&slow.v0);
                pairs.map(|(velocity_after, v0)| 0.5 * (velocity_after + v0)).collect()
            }
        }
    }
}

/// A step of CA of the body's own network. Positions and velocities are set before each step.
#[derive(Clone, Debug)]
pub(super) struct SteppedSprings {
    scheme: Arc<Scheme>,
    modules: ModuleState,
    scratch: KernelScratch,
}

impl SteppedSprings {
    fn new(scheme: &Arc<Scheme>, network: &Network) -> Self {
        let start_positions = network.mats().x0.clone();
        let zero_steps = vec![0.0; start_positions.len()];
        Self {
            scheme: scheme.clone(),
            modules: ModuleState::new(scheme, start_positions, zero_steps),
            scratch: KernelScratch::new(scheme),
        }
    }

    /// Velocities after a pull at positions `x`, from those `velocities_before`, or from rest [m a frame] (n each).
    pub(super) fn velocities_after_pull(
        &mut self,
        slow: &Slow,
        x: &[f64],
        velocities_before: Option<&[f64]>,
        velocities_after: &mut [f64],
    ) {
        let Self {
            scheme,
            modules,
            scratch: laws,
        } = self;
        let step_frames = f64::from(slow.macrostep);
        for (index, &mat) in slow.free_mats.iter().enumerate() {
            modules.x[mat] = x[index];
            modules.d[mat] = velocities_before.map_or(0.0, |velocities_before| step_frames * velocities_before[index]);
        }
        let team = &mut ThreadTeam::alone();
        kernel::compute_link_forces(scheme, &[], modules, laws, team);
        kernel::advance_mats(scheme, &mut [], modules, None, team);
        for (index, &mat) in slow.free_mats.iter().enumerate() {
            velocities_after[index] = modules.d[mat] / step_frames;
        }
    }
}
