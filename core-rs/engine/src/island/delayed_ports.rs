//! Delayed ports in an island: each port moves with its key, and a force on the port acts on the key after a delay.

use crate::kernel;
use crate::maths::floor;
use crate::scheme::Scheme;
use crate::state::{ImposedTarget, ModuleState};
use crate::timeline::Drive;

/// A port, and the key that it follows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PortBinding {
    pub(crate) port_mat: usize,
    pub(crate) key_mat: usize,
    /// The delay in steps, at least 1.
    delay_steps: f64,
}

/// The forces on a port that have not yet acted.
#[derive(Clone, Debug)]
pub(super) struct DelayedForces {
    /// The last forces [N]; the oldest is at `oldest_slot`   (full steps of the delay + 1)
    forces: Vec<f64>,
    oldest_slot: usize,
}

crate::archive::state!(DelayedForces { forces, oldest_slot });

impl PortBinding {
    /// A port at which nothing has pushed yet.
    pub(super) fn without_forces(&self) -> DelayedForces {
        DelayedForces {
            forces: vec![0.0; floor(self.delay_steps) as usize + 1],
            oldest_slot: 0,
        }
    }
}

impl DelayedForces {
    /// Take the newest forces of a port of another version, whose delay may be another. Allocates nothing.
    pub(super) fn take_over(&mut self, old: &Self) {
        let (new_length, old_length) = (self.forces.len(), old.forces.len());
        for age in 0..new_length {
            let past_force = if age < old_length {
                old.forces[(old.oldest_slot + old_length - 1 - age) % old_length]
            } else {
                0.0
            };
            self.forces[(self.oldest_slot + new_length - 1 - age) % new_length] = past_force;
        }
    }
}

/// The delayed ports among drives, in steps of 1/`rate`.
pub(super) fn port_bindings(drives: &[Drive], rate: f64) -> Vec<PortBinding> {
    let binding = |drive: &Drive| {
        let delayed_port = drive.port()?;
        Some(PortBinding {
            port_mat: drive.mat,
            key_mat: delayed_port.key,
            delay_steps: (delayed_port.delay * rate).max(1.0),
        })
    };
    drives.iter().filter_map(binding).collect()
}

/// Set the position and step of every port to those of its key.
pub(super) fn follow_keys(bindings: &[PortBinding], modules: &mut ModuleState) {
    for binding in bindings {
        modules.x[binding.port_mat] = modules.x[binding.key_mat];
        modules.d[binding.port_mat] = modules.d[binding.key_mat];
    }
}

/// Push every key by the force on its port a delay ago; between two steps by their forces, in proportion.
pub(super) fn push_keys(bindings: &[PortBinding], states: &[DelayedForces], modules: &mut ModuleState) {
    for (binding, state) in bindings.iter().zip(states) {
        let oldest_share = binding.delay_steps - floor(binding.delay_steps);
        let second_oldest = (state.oldest_slot + 1) % state.forces.len();
        let delayed_force = if oldest_share > 0.0 {
            oldest_share * state.forces[state.oldest_slot] + (1.0 - oldest_share) * state.forces[second_oldest]
        } else {
            state.forces[second_oldest]
        };
        modules.push(binding.key_mat, delayed_force);
    }
}

/// Set the target of every port to the next position of its key, once all forces are known.
pub(super) fn set_port_targets(
    bindings: &[PortBinding],
    scheme: &Scheme,
    targets: &mut [ImposedTarget],
    modules: &ModuleState,
) {
    for binding in bindings {
        let imposed_target = targets.iter().find(|target| target.mat == binding.key_mat);
        let key_position = imposed_target.map_or_else(
            || kernel::predict_position(scheme, modules, binding.key_mat),
            |target| target.x,
        );
        let port_target = targets.iter_mut().find(|target| target.mat == binding.port_mat);
        port_target.into_iter().for_each(|target| target.x = key_position);
    }
}

/// Note the complete forces of a step.
pub(super) fn record_port_forces(bindings: &[PortBinding], states: &mut [DelayedForces], modules: &ModuleState) {
    for (binding, state) in bindings.iter().zip(states) {
        state.forces[state.oldest_slot] = modules.force[binding.port_mat];
        state.oldest_slot = (state.oldest_slot + 1) % state.forces.len();
    }
}
