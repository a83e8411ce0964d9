//! Where every MAT is at frame 0, and how it moves there.

use crate::network::Network;
use crate::scheme::Scheme;
use crate::start::backward_steps;
use crate::state::ModuleState;
use crate::timeline::{Drive, DriveKind, Timeline};

/// Where every MAT is at frame 0, and the step that led there.
pub(super) fn initial_motion(
    network: &Network,
    scheme: &Scheme,
    timeline: &Timeline,
    drives: &[Drive],
    is_active_mat: &dyn Fn(usize) -> bool,
) -> ModuleState {
    let drive_forces: Vec<_> = drives
        .iter()
        .filter(|drive| drive.kind == DriveKind::Force)
        .map(|drive| (drive.mat, drive.value(0, scheme.rate)))
        .collect();
    let start_positions = initial_positions(network, timeline, drives);
    let mut start_steps = backward_steps(
        network,
        timeline,
        scheme,
        &start_positions,
        &drive_forces,
        is_active_mat,
    );
    for (port, key) in timeline.delayed_ports() {
        start_steps[port] = start_steps[key];
    }
    ModuleState::new(scheme, start_positions, start_steps)
}

/// Where every MAT is at frame 0 [m], (n_mat).
pub(super) fn initial_positions(network: &Network, timeline: &Timeline, drives: &[Drive]) -> Vec<f64> {
    let mut start_positions = network.mats().x0.clone();
    for drive in drives
        .iter()
        // The position of a real hand is not yet known: its key begins where the network has it.
        .filter(|drive| drive.is_path())
    {
        start_positions[drive.mat] = drive.value(0, timeline.rate.hertz());
    }
    for (port, key) in timeline.delayed_ports() {
        start_positions[port] = start_positions[key];
    }
    for proxy in network.proxies() {
        start_positions[proxy.mat] = proxy.weighted_sum(|mat| start_positions[mat], |mat| start_positions[mat]);
    }
    start_positions
}
