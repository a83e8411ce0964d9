//! Where every MAT is at frame 0, and how it moves there.

use crate::network::Network;
use crate::scheme::Scheme;
use crate::start::backward_steps;
use crate::state::Body;
use crate::timeline::{Drive, DriveKind, Timeline};

/// Where every MAT is at frame 0, and the step that led there.
pub(super) fn start(
    network: &Network,
    scheme: &Scheme,
    timeline: &Timeline,
    drives: &[Drive],
    acts: &dyn Fn(usize) -> bool,
) -> Body {
    let pushes: Vec<_> = drives
        .iter()
        .filter(|drive| drive.kind == DriveKind::Force)
        .map(|drive| (drive.mat, drive.value(0, scheme.rate)))
        .collect();
    let x = positions(network, timeline, drives);
    let mut d = backward_steps(network, timeline, scheme, &x, &pushes, acts);
    for (port, key) in timeline.ports() {
        d[port] = d[key];
    }
    Body::new(scheme, x, d)
}

/// Where every MAT is at frame 0 [m], (n_mat).
pub(super) fn positions(network: &Network, timeline: &Timeline, drives: &[Drive]) -> Vec<f64> {
    let mut x = network.mats().x0.clone();
    for drive in drives
        .iter()
        // The position of a real hand is not yet known: its key begins where the network has it.
        .filter(|drive| drive.is_path())
    {
        x[drive.mat] = drive.value(0, timeline.rate.hertz());
    }
    for (port, key) in timeline.ports() {
        x[port] = x[key];
    }
    for proxy in network.proxies() {
        x[proxy.mat] = proxy.sum(|mat| x[mat], |mat| x[mat]);
    }
    x
}
