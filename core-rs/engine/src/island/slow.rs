//! A slow body inside an island: what else touches it acts at every frame, and its ports move frame by frame.
//!
//! Linear springs act exactly, and MATs that nothing else touches are computed once in a block of frames (`block`).
//! Springs in space kick once every R frames; these MATs then move in a straight line from kick to kick.

mod block;
mod block_flow;
mod led_port;
mod springs;

use std::sync::Arc;

use crate::kernel::is_bounded;
use crate::network::Network;
use crate::state::ModuleState;
pub(crate) use block_flow::{BlockFlow, BodyInterface, MASSES_MAX, PresentState, Weights, best_block_length};
use springs::RunningSprings;
pub(crate) use springs::SpringMethod;

/// The plan of a slow body.
#[derive(Clone, Debug)]
pub(crate) struct Slow {
    /// The network of its modules.
    pub(crate) network: Arc<Network>,
    /// The part to which the whole body belongs.
    pub(crate) part: usize,
    /// Its MATs that move, by their index in the network   (n)
    pub(crate) free_mats: Vec<usize>,
    /// R, the frames of one step at its own rate.
    pub(crate) macrostep: u32,
    /// Frames from one kick to the next: 1 for linear springs, else R.
    pub(crate) kick_interval: u32,
    pub(crate) springs: SpringMethod,
    /// Phase of its fastest mode from kick to kick [rad].
    pub(crate) kick_phase: f64,
    /// Positions at which linear springs balance [m]   (n)
    pub(crate) rest_positions: Vec<f64>,
    /// Its first positions [m] and steps [m a frame]   (n)
    pub(crate) x0: Vec<f64>,
    pub(crate) v0: Vec<f64>,
    /// 1/M = T²/m [m/N]   (n)
    pub(crate) w: Vec<f64>,
    /// MATs that other modules or hands touch: index in the body, and MAT in the island.
    pub(crate) ports: Vec<(usize, usize)>,
    /// The other MATs; and for every MAT 1 if it is one of those, 0 if it is a port   (n)
    pub(crate) inner_mats: Vec<usize>,
    pub(crate) inner_mask: Vec<f64>,
    /// Whether it is computed as the discrete network, and not as continuous motion.
    pub(crate) is_discrete: bool,
    /// Outputs that hear it, each a weighted sum of positions.
    pub(crate) outputs: Vec<(u32, Weights)>,
}

/// A running slow body.
#[derive(Clone, Debug)]
pub(crate) struct RunningSlow {
    plan: Arc<Slow>,
    /// Positions [m] and velocities [m a frame] of all MATs at the last kick, of ports at this frame. With linear
    /// springs these follow from the block.
    x: Vec<f64>,
    v: Vec<f64>,
    /// What the last kick of springs in space added to the velocities   (n)
    last_kick: Vec<f64>,
    /// Positions of the ports one frame ago   (n_ports)
    previous_positions: Vec<f64>,
    /// Frames since the last kick.
    frames_since_kick: u32,
    /// Frames from the last kick to the frame at which it began.
    start_offset: u32,
    springs: RunningSprings,
    /// Velocities that hands give its ports at the end of this frame [m a frame]   (n_ports)
    hand_velocities: Vec<f64>,
    /// Factor on all velocities at each kick.
    velocity_factor: f64,
}

crate::archive::state!(RunningSlow {
    x,
    v,
    last_kick,
    previous_positions,
    frames_since_kick,
    start_offset,
    springs,
    hand_velocities,
    velocity_factor
});

impl Slow {
    /// Whether its springs are linear, and pull by their exact flow.
    pub(crate) fn is_linear(&self) -> bool {
        matches!(self.springs, SpringMethod::Exact(_))
    }

    /// The same body in the free copy of its key; `port_mat` gives the MATs of its ports there.
    pub(crate) fn in_free_key(&self, port_mat: impl Fn(usize) -> Option<usize>) -> Self {
        let ports = self.ports.iter();
        let ports: Vec<(usize, usize)> = ports
            .filter_map(|&(mat_index, island_mat)| Some((mat_index, port_mat(island_mat)?)))
            .collect();
        let springs = match &self.springs {
            SpringMethod::Exact(flow) => {
                let interface = self.port_interface(&ports);
                let n_frames = best_block_length(self.free_mats.len(), ports.len());
                SpringMethod::Exact(Arc::new(flow.with_interface(interface, n_frames)))
            }
            SpringMethod::Stepped(scheme) => SpringMethod::Stepped(scheme.clone()),
        };
        Self {
            ports,
            outputs: Vec::new(),
            springs,
            ..self.clone()
        }
    }

    /// The same body in blocks of one frame, without outputs.
    pub(crate) fn frame_by_frame(&self) -> Self {
        let springs = match &self.springs {
            SpringMethod::Exact(flow) => {
                let interface = self.port_interface(&self.ports);
                SpringMethod::Exact(Arc::new(flow.with_interface(interface, 1)))
            }
            SpringMethod::Stepped(scheme) => SpringMethod::Stepped(scheme.clone()),
        };
        Self {
            springs,
            outputs: Vec::new(),
            ..self.clone()
        }
    }

    /// Ports alone, without strikes.
    fn port_interface(&self, ports: &[(usize, usize)]) -> BodyInterface<'_> {
        BodyInterface {
            inverse_masses: &self.w,
            ports: ports.iter().map(|port| (port.0, None)).collect(),
            outputs: Vec::new(),
        }
    }

    /// Whether another body has the same masses, macrostep and ports. Its other numbers may differ: a body continues
    /// with them from its next kick.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let port_indices = |slow: &Self| slow.ports.iter().map(|port| port.0).collect::<Vec<_>>();
        let mat_names = |slow: &Self| -> Vec<String> {
            let free_mats = slow.free_mats.iter();
            free_mats.map(|&mat| slow.network.mat_name(mat)).collect()
        };
        self.macrostep == other.macrostep
            && port_indices(self) == port_indices(other)
            && mat_names(self) == mat_names(other)
    }

    /// The same body with positions as displacements from another motion: at rest at 0, where its springs do not pull.
    pub(crate) fn layer_body(&self) -> Self {
        let free_count = self.free_mats.len();
        Self {
            rest_positions: vec![0.0; free_count],
            x0: vec![0.0; free_count],
            v0: vec![0.0; free_count],
            ..self.clone()
        }
    }
}

impl RunningSlow {
    /// Whether its springs are linear, and pull by their exact flow.
    pub(crate) fn is_linear(&self) -> bool {
        self.springs.exact_block().is_some()
    }

    /// The body at frame 0, where the steps of its ports in `modules` already contain all but the slow springs.
    pub(crate) fn new(plan: &Slow, modules: &ModuleState) -> Self {
        let mut springs = plan.springs.start(plan);
        let mut v = springs.start_velocities(plan);
        // Half a kick lies between the velocity at the start and that of the straight motion.
        let kick: Vec<f64> = difference(&v, &plan.v0).iter().map(|dv| 2.0 * dv).collect();
        let half_share = 0.5 / f64::from(plan.kick_interval);
        let mut previous_positions = Vec::with_capacity(plan.ports.len());
        let mut x = plan.x0.clone();
        for &(port, mat) in &plan.ports {
            x[port] = modules.x[mat];
            v[port] += modules.d[mat] - plan.v0[port];
            let curve_step = if plan.is_discrete { 0.0 } else { half_share * kick[port] };
            previous_positions.push(x[port] - (modules.d[mat] - curve_step));
        }
        if let RunningSprings::Exact(spring_block) = &mut springs {
            let mat_count = x.len();
            spring_block.state_mut()[..mat_count].copy_from_slice(&difference(&x, &plan.rest_positions));
            spring_block.state_mut()[mat_count..].copy_from_slice(&v);
            spring_block.begin();
        }
        Self {
            last_kick: if springs.exact_block().is_some() {
                vec![0.0; x.len()]
            } else {
                kick
            },
            x,
            v,
            previous_positions,
            frames_since_kick: 0,
            start_offset: 0,
            springs,
            hand_velocities: vec![0.0; plan.ports.len()],
            velocity_factor: 1.0,
            plan: Arc::new(plan.clone()),
        }
    }

    /// Take over another's motion without allocating.
    pub(crate) fn copy_motion(&mut self, other: &Self) {
        self.x.copy_from_slice(&other.x);
        self.v.copy_from_slice(&other.v);
        self.last_kick.copy_from_slice(&other.last_kick);
        self.previous_positions.copy_from_slice(&other.previous_positions);
        self.frames_since_kick = other.frames_since_kick;
        if let (RunningSprings::Exact(spring_block), RunningSprings::Exact(other)) = (&mut self.springs, &other.springs)
        {
            spring_block.copy_motion(other);
        }
    }

    /// The motion of all its MATs at this frame, for [`Self::motion`].
    pub(crate) fn present_state(&self) -> PresentState {
        let spring_block = self.springs.exact_block();
        spring_block.map_or_else(PresentState::default, |spring_block| spring_block.present_state())
    }

    /// Position of one of its MATs, and its step in a frame [m]; `present` is that of this frame.
    pub(crate) fn motion(&self, present: &PresentState, index: usize) -> (f64, f64) {
        if let Some(spring_block) = self.springs.exact_block() {
            let (displacement, step) = spring_block.motion(present, index);
            return (self.plan.rest_positions[index] + displacement, step);
        }
        let kick_per_frame = self.last_kick[index] / f64::from(self.plan.kick_interval);
        let frames_since = f64::from(self.frames_since_kick) * self.plan.inner_mask[index];
        (
            self.x[index] + frames_since * self.v[index],
            self.v[index] - kick_per_frame * self.velocity_lead(self.frames_since_kick),
        )
    }

    /// Begin at frame `n`.
    pub(crate) fn seek(&mut self, n: u64) {
        self.start_offset = (n % u64::from(self.plan.kick_interval)) as u32;
    }

    /// Set positions and steps of all its MATs (own, (x, step)), as if its springs had pulled at their regular frames.
    pub(crate) fn set_motions(&mut self, mat_motions: &[(usize, (f64, f64))]) {
        for &(mat_index, (x, step)) in mat_motions {
            (self.x[mat_index], self.v[mat_index]) = (x, step);
        }
        self.estimate_previous_positions();
        let Self { springs, plan, .. } = self;
        let RunningSprings::Exact(spring_block) = springs else {
            return self.find_last_kick();
        };
        let mat_count = self.x.len();
        let state_pairs = spring_block
            .state_mut()
            .iter_mut()
            .zip(&self.x)
            .zip(&plan.rest_positions);
        state_pairs.for_each(|((u, x), rest_position)| *u = x - rest_position);
        spring_block.set_velocities(&self.v[..mat_count]);
        spring_block.begin();
        self.read_block();
    }

    /// Set positions and steps of its ports from MATs of a network; the other MATs stay.
    pub(crate) fn set_motion_of_ports(&mut self, modules: &ModuleState) {
        for &(port_index, mat) in &self.plan.ports {
            (self.x[port_index], self.v[port_index]) = (modules.x[mat], modules.d[mat]);
        }
        self.estimate_previous_positions();
        let Self { springs, plan, .. } = self;
        let RunningSprings::Exact(spring_block) = springs else {
            return self.find_last_kick();
        };
        spring_block.end_at_present();
        for &(port_index, _) in &plan.ports {
            spring_block.state_mut()[port_index] = self.x[port_index] - plan.rest_positions[port_index];
        }
        for &(port_index, _) in &plan.ports {
            spring_block.set_velocity(port_index, self.v[port_index]);
        }
        spring_block.begin();
        self.read_block();
    }

    /// Find the positions of ports one frame ago from their steps.
    fn estimate_previous_positions(&mut self) {
        for (&(mat, _), previous) in self.plan.ports.iter().zip(&mut self.previous_positions) {
            *previous = self.x[mat] - self.v[mat];
        }
    }

    /// When all MATs are set: find the kick of springs in space at their last regular frame.
    fn find_last_kick(&mut self) {
        self.frames_since_kick = self.start_offset;
        std::mem::swap(&mut self.v, &mut self.last_kick);
        self.spring_kick(false);
        std::mem::swap(&mut self.v, &mut self.last_kick);
        let ahead_share = self.velocity_lead(self.frames_since_kick) / f64::from(self.plan.kick_interval);
        for (v, kick) in self.v.iter_mut().zip(&self.last_kick) {
            *v += kick * ahead_share;
        }
        for &mat_index in &self.plan.inner_mats {
            self.x[mat_index] -= f64::from(self.frames_since_kick) * self.v[mat_index];
        }
    }

    /// Read positions and velocities from the block: those of ports, and at its first frame all.
    fn read_block(&mut self) {
        let (plan, RunningSprings::Exact(spring_block)) = (&*self.plan, &self.springs) else {
            return;
        };
        if spring_block.is_first() {
            for ((x, rest_position), u) in self.x.iter_mut().zip(&plan.rest_positions).zip(spring_block.state()) {
                *x = rest_position + u;
            }
        }
        for (index, &(port, _)) in plan.ports.iter().enumerate() {
            self.x[port] = plan.rest_positions[port] + spring_block.displacement(index);
            self.v[port] = spring_block.velocity(index);
        }
    }

    /// Number of frames between two kicks.
    pub(crate) fn kick_interval(&self) -> u32 {
        self.plan.kick_interval
    }

    /// For a body at rest: advance by `frames`, which may be negative.
    pub(crate) fn shift_frames(&mut self, frames: i64) {
        if let RunningSprings::Exact(spring_block) = &mut self.springs {
            return spring_block.shift_frames(frames);
        }
        let frames_since = i64::from(self.frames_since_kick) + frames;
        self.frames_since_kick = frames_since.rem_euclid(i64::from(self.kick_interval())) as u32;
    }

    /// Make its motion decay by an additional factor in each frame.
    pub(crate) fn damp(&mut self, decay_factor: f64) {
        let spring_block = self.springs.exact_block();
        let block_frames = spring_block.map_or(self.plan.kick_interval, |spring_block| spring_block.n_frames());
        self.velocity_factor = (0..2 * block_frames).fold(1.0, |block_factor, _| block_factor * decay_factor);
    }

    /// Take over the state of an equal body.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        let velocity_factor = self.velocity_factor;
        std::mem::swap(self, old);
        std::mem::swap(&mut self.plan, &mut old.plan);
        std::mem::swap(&mut self.springs, &mut old.springs);
        self.velocity_factor = velocity_factor;
        // After the swap, `old` holds the old springs again.
        let (RunningSprings::Exact(spring_block), RunningSprings::Exact(old_block)) =
            (&mut self.springs, &mut old.springs)
        else {
            return;
        };
        if spring_block.has_same_numbers(old_block) && self.plan.rest_positions == old.plan.rest_positions {
            return spring_block.copy_motion(old_block);
        }
        old_block.end_at_present();
        let block_state = spring_block.state_mut();
        block_state.copy_from_slice(old_block.state());
        for ((u, old_rest_position), rest_position) in block_state
            .iter_mut()
            .zip(&old.plan.rest_positions)
            .zip(&self.plan.rest_positions)
        {
            *u += old_rest_position - rest_position;
        }
        spring_block.begin();
        self.read_block();
    }

    /// Add its outputs now to `out` (n_out).
    pub(crate) fn add_outputs(&self, out: &mut [f64]) {
        let frames_since = f64::from(self.frames_since_kick);
        for (index, (output, row)) in self.plan.outputs.iter().enumerate() {
            if let Some(spring_block) = self.springs.exact_block() {
                let rest_terms = row
                    .iter()
                    .map(|&(mat_index, weight)| weight * self.plan.rest_positions[mat_index]);
                out[*output as usize] += rest_terms.sum::<f64>() + spring_block.output(index);
                continue;
            }
            let weighted_position = |&(mat_index, weight): &(usize, f64)| {
                weight * (self.x[mat_index] + frames_since * self.plan.inner_mask[mat_index] * self.v[mat_index])
            };
            out[*output as usize] += row.iter().map(weighted_position).sum::<f64>();
        }
    }

    /// Set positions, steps and free motion of the ports in the island.
    pub(crate) fn set_ports(&self, modules: &mut ModuleState) {
        for (&(port, mat), previous) in self.plan.ports.iter().zip(&self.previous_positions) {
            let port_step = self.x[port] - previous;
            modules.x[mat] = self.x[port];
            modules.d[mat] = port_step;
            modules.free_port_motion[mat] = self.v[port] - port_step;
        }
    }

    /// Take note of a strike on a MAT of the island in this frame [N]: linear springs answer it from its instant on.
    pub(crate) fn record_strike(&mut self, mat: usize, force: f64) {
        let port = self.plan.ports.iter().position(|port| port.1 == mat);
        if let (Some(port), RunningSprings::Exact(spring_block)) = (port, &mut self.springs) {
            spring_block.record_strike(port, force);
        }
    }

    /// Step from frame `n` to the next, under the forces at the ports (n_mat).
    pub(crate) fn step(&mut self, n: u64, force: &[f64]) {
        let plan = &*self.plan;
        if let RunningSprings::Exact(spring_block) = &mut self.springs {
            for (index, &(_, mat)) in plan.ports.iter().enumerate() {
                spring_block.push_port(index, force[mat]);
            }
            return self.step_flow();
        }
        for (&(port, mat), previous) in plan.ports.iter().zip(&mut self.previous_positions) {
            *previous = self.x[port];
            self.v[port] += plan.w[port] * force[mat];
            self.x[port] += self.v[port];
        }
        for (&(port, _), hand_velocity) in plan.ports.iter().zip(&mut self.hand_velocities) {
            self.v[port] += std::mem::take(hand_velocity);
        }
        self.frames_since_kick += 1;
        let kick_interval = plan.kick_interval;
        if !(n + 1).is_multiple_of(u64::from(kick_interval)) {
            return;
        }
        for &mat in &plan.inner_mats {
            // The frames since the last kick: the first interval may be shorter.
            self.x[mat] += f64::from(self.frames_since_kick) * self.v[mat];
        }
        self.frames_since_kick = 0;
        if self.velocity_factor < 1.0 {
            self.v.iter_mut().for_each(|v| *v *= self.velocity_factor);
        }
        self.last_kick.copy_from_slice(&self.v);
        self.spring_kick(true);
        for (kick, v) in self.last_kick.iter_mut().zip(&self.v) {
            *kick = v - *kick;
        }
    }

    /// Step to the next frame by the flow of linear springs, under the forces of this frame that were passed on, or
    /// under none: with the same result as [`Self::step`].
    pub(crate) fn step_flow(&mut self) {
        let RunningSprings::Exact(spring_block) = &mut self.springs else {
            return;
        };
        for (&(port, _), previous) in self.plan.ports.iter().zip(&mut self.previous_positions) {
            *previous = self.x[port];
        }
        spring_block.step(self.velocity_factor);
        self.read_block();
    }

    /// Set velocities to those after springs in space pull at the present positions: from those in `last_kick` if it
    /// `is_moving`, otherwise from rest.
    fn spring_kick(&mut self, is_moving: bool) {
        let velocities_before = is_moving.then_some(&self.last_kick[..]);
        if let RunningSprings::Stepped(stepped_springs) = &mut self.springs {
            stepped_springs.velocities_after_pull(&self.plan, &self.x, velocities_before, &mut self.v);
        }
    }

    /// Number of state variables at the beginning of a block.
    pub(crate) fn n_state(&self) -> usize {
        2 * self.x.len() + self.previous_positions.len()
    }

    /// Visit each of these variables.
    pub(crate) fn visit_state(&mut self, visit: &mut impl FnMut(&mut f64)) {
        if let RunningSprings::Exact(spring_block) = &mut self.springs {
            spring_block.state_mut().iter_mut().for_each(&mut *visit);
            spring_block.begin();
        }
        self.previous_positions.iter_mut().for_each(visit);
        self.read_block();
    }

    /// Set all displacements to 0, and each velocity to a random one, scaled to equal energy.
    pub(crate) fn randomise(&mut self, mut random: impl FnMut() -> f64) {
        self.previous_positions.fill(0.0);
        if let RunningSprings::Exact(spring_block) = &mut self.springs {
            let (u, v) = spring_block.state_mut().split_at_mut(self.plan.w.len());
            u.fill(0.0);
            for (v, w) in v.iter_mut().zip(&self.plan.w) {
                *v = random() * w.sqrt();
            }
            spring_block.begin();
        }
        self.read_block();
    }

    /// Energy of linear springs and their masses at the beginning of the block [in units of a frame]; infinite if its
    /// springs are not linear.
    pub(crate) fn spring_energy(&self) -> f64 {
        let spring_block = self.springs.exact_block();
        spring_block.map_or(f64::INFINITY, |spring_block| spring_block.energy(&self.plan.w))
    }

    /// Whether a MAT of the island is one of its ports.
    pub(crate) fn has_port(&self, mat: usize) -> bool {
        self.plan.ports.iter().any(|&(_, port)| port == mat)
    }

    /// Whether it belongs to a part.
    pub(crate) fn is_in_part(&self, part: usize) -> bool {
        self.plan.part == part
    }

    /// Outputs that hear it.
    pub(crate) fn outputs(&self) -> Vec<u32> {
        self.plan.outputs.iter().map(|&(output, _)| output).collect()
    }

    /// The name and part of a MAT whose position is beyond all bounds.
    pub(crate) fn diverged_mat(&self) -> Option<(String, usize)> {
        let mat_index = self.x.iter().position(|&x| !is_bounded(x))?;
        let mat_name = self.plan.network.mat_name(self.plan.free_mats[mat_index]);
        Some((mat_name, self.plan.part))
    }

    /// Whether all positions are finite and plausible.
    pub(crate) fn is_bounded(&self) -> bool {
        // Between the beginnings of two blocks only ports are known.
        let is_partial = self.springs.exact_block().is_some_and(|block| !block.is_first());
        if is_partial {
            let mut ports = self.plan.ports.iter();
            return ports.all(|&(port, _)| is_bounded(self.x[port]));
        }
        self.x.iter().all(|&x| is_bounded(x))
    }
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
