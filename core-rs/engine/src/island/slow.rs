//! A slow body inside an island: kicked by its own springs once every R frames, by all else at every frame.
//!
//! Its ports move frame by frame; MATs that nothing else touches move in a straight line from kick to kick.

mod led;
mod springs;

use std::sync::Arc;

use crate::kernel::sound;
use crate::network::Network;
use crate::state::Body;
use springs::RunningSprings;
pub(crate) use springs::Springs;

/// The plan of a slow body.
#[derive(Clone, Debug)]
pub(crate) struct Slow {
    /// The network of its modules.
    pub(crate) network: Arc<Network>,
    /// The part to which the whole body belongs.
    pub(crate) part: usize,
    /// Its MATs that move, by their index in the network   (n)
    pub(crate) free: Vec<usize>,
    /// R, the frames of one step at its own rate.
    pub(crate) macrostep: u32,
    /// Frames from one kick to the next: 1 for a few linear springs, else R.
    pub(crate) kick_every: u32,
    pub(crate) springs: Springs,
    /// Phase of its fastest mode from kick to kick [rad].
    pub(crate) turn: f64,
    /// Positions at which linear springs balance [m]   (n)
    pub(crate) rest: Vec<f64>,
    /// Its first positions [m] and steps [m a frame]   (n)
    pub(crate) x0: Vec<f64>,
    pub(crate) v0: Vec<f64>,
    /// 1/M = T²/m [m/N]   (n)
    pub(crate) w: Vec<f64>,
    /// MATs that other modules or hands touch: index in the body, and MAT in the island.
    pub(crate) ports: Vec<(usize, usize)>,
    /// The other MATs; and for every MAT 1 if it is one of those, 0 if it is a port   (n)
    pub(crate) inner: Vec<usize>,
    pub(crate) is_inner: Vec<f64>,
    /// Whether it is computed as the discrete network, and not as continuous motion.
    pub(crate) is_discrete: bool,
    /// For each port that is struck, by the frames since the last kick: corrections of positions and velocities that
    /// are due at the next kick, for a change of the step by 1 m a frame   (n_ports, R; [n, n])
    pub(crate) missing: Vec<Vec<[Vec<f64>; 2]>>,
    /// Outputs that hear it, each a weighted sum of positions.
    pub(crate) outputs: Vec<(u32, Vec<(usize, f64)>)>,
}

/// A running slow body.
#[derive(Clone, Debug)]
pub(crate) struct RunningSlow {
    plan: Arc<Slow>,
    x: Vec<f64>,
    v: Vec<f64>,
    /// What the last kick added to the velocities   (n)
    kick: Vec<f64>,
    /// Positions of the ports one frame ago   (n_ports)
    previous: Vec<f64>,
    /// Frames since the last kick.
    since: u32,
    /// Frames from the last kick to the frame at which it began.
    first: u32,
    /// Distances from rest   (n)
    displacements: Vec<f64>,
    /// Corrections of positions and velocities for strikes since the last kick   (n)
    pending_corrections: [Vec<f64>; 2],
    is_struck: bool,
    springs: RunningSprings,
    /// Velocities that hands give its ports at the end of this frame [m a frame]   (n_ports)
    hand_velocities: Vec<f64>,
    /// Factor on all velocities at each kick.
    damped: f64,
}

crate::archive::state!(RunningSlow {
    x,
    v,
    kick,
    previous,
    since,
    first,
    displacements,
    pending_corrections,
    is_struck,
    hand_velocities,
    damped
});

impl Slow {
    /// Whether its springs are linear, and pull by their exact flow.
    pub(crate) fn is_linear(&self) -> bool {
        matches!(self.springs, Springs::Exact(_))
    }

    /// The same body in the free copy of its key; `mat` gives the MATs of its ports there.
    pub(crate) fn alone(&self, mat: impl Fn(usize) -> Option<usize>) -> Self {
        let ports = self.ports.iter();
        Self {
            ports: ports
                .filter_map(|&(own, there)| Some((own, mat(there)?)))
                .collect(),
            outputs: Vec::new(),
            missing: Vec::new(),
            ..self.clone()
        }
    }

    /// Whether another body has the same masses, macrostep and ports. Its other numbers may differ: a body continues
    /// with them from its next kick.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let ports = |slow: &Self| slow.ports.iter().map(|port| port.0).collect::<Vec<_>>();
        let names = |slow: &Self| -> Vec<String> {
            let free = slow.free.iter();
            free.map(|&mat| slow.network.mat_name(mat)).collect()
        };
        self.macrostep == other.macrostep
            && ports(self) == ports(other)
            && names(self) == names(other)
    }

    /// The same body with positions as displacements from another motion: at rest at 0, where its springs do not pull.
    pub(crate) fn deviation(&self) -> Self {
        let n = self.free.len();
        Self {
            rest: vec![0.0; n],
            x0: vec![0.0; n],
            v0: vec![0.0; n],
            ..self.clone()
        }
    }
}

impl RunningSlow {
    /// The body at frame 0, where the steps of its ports in `body` already contain all but the slow springs.
    pub(crate) fn new(plan: &Slow, body: &Body) -> Self {
        let displacements: Vec<f64> = difference(&plan.x0, &plan.rest);
        let mut springs = plan.springs.running(&plan.network);
        let mut v = springs.start(plan, &displacements);
        // Half a kick lies between the velocity at the start and that of the straight motion.
        let kick: Vec<f64> = difference(&v, &plan.v0).iter().map(|dv| 2.0 * dv).collect();
        let half = 0.5 / f64::from(plan.kick_every);
        let mut previous = Vec::with_capacity(plan.ports.len());
        let mut x = plan.x0.clone();
        for &(port, mat) in &plan.ports {
            x[port] = body.x[mat];
            v[port] += body.d[mat] - plan.v0[port];
            let curve = if plan.is_discrete {
                0.0
            } else {
                half * kick[port]
            };
            previous.push(x[port] - (body.d[mat] - curve));
        }
        let n = x.len();
        Self {
            x,
            v,
            kick,
            previous,
            since: 0,
            first: 0,
            pending_corrections: [vec![0.0; n], vec![0.0; n]],
            is_struck: false,
            springs,
            hand_velocities: vec![0.0; plan.ports.len()],
            damped: 1.0,
            displacements,
            plan: Arc::new(plan.clone()),
        }
    }

    /// Take over another's motion without allocating.
    pub(crate) fn copy_motion(&mut self, other: &Self) {
        self.x.copy_from_slice(&other.x);
        self.v.copy_from_slice(&other.v);
        self.kick.copy_from_slice(&other.kick);
        self.previous.copy_from_slice(&other.previous);
        self.since = other.since;
    }

    /// Position of one of its MATs, and its step in a frame [m].
    pub(crate) fn motion(&self, index: usize) -> (f64, f64) {
        let pull = self.kick[index] / f64::from(self.plan.kick_every);
        let frames = f64::from(self.since) * self.plan.is_inner[index];
        (
            self.x[index] + frames * self.v[index],
            self.v[index] - pull * self.ahead(self.since),
        )
    }

    /// Begin at frame `n`.
    pub(crate) fn seek(&mut self, n: u64) {
        self.first = (n % u64::from(self.plan.kick_every)) as u32;
    }

    /// Set positions and steps of all its MATs (own, (x, step)), as if its springs had pulled at their regular frames.
    pub(crate) fn put(&mut self, all: &[(usize, (f64, f64))]) {
        for &(own, (x, step)) in all {
            (self.x[own], self.v[own]) = (x, step);
        }
        self.settle();
    }

    /// Set positions and steps of its ports from MATs of a network; the other MATs stay.
    pub(crate) fn put_ports(&mut self, body: &Body) {
        for &(own, mat) in &self.plan.ports {
            (self.x[own], self.v[own]) = (body.x[mat], body.d[mat]);
        }
        self.settle();
    }

    /// When all MATs are set: find the kick of the springs at their last regular frame.
    fn settle(&mut self) {
        for (&(own, _), previous) in self.plan.ports.iter().zip(&mut self.previous) {
            *previous = self.x[own] - self.v[own];
        }
        self.since = self.first;
        std::mem::swap(&mut self.v, &mut self.kick);
        self.spring_kick(false);
        std::mem::swap(&mut self.v, &mut self.kick);
        let ahead = self.ahead(self.since) / f64::from(self.plan.kick_every);
        for (v, kick) in self.v.iter_mut().zip(&self.kick) {
            *v += kick * ahead;
        }
        for &own in &self.plan.inner {
            self.x[own] -= f64::from(self.since) * self.v[own];
        }
    }

    /// Number of frames between two kicks.
    pub(crate) fn every(&self) -> u32 {
        self.plan.kick_every
    }

    /// For a body at rest: advance by `frames`, which may be negative.
    pub(crate) fn shift_frames(&mut self, frames: i64) {
        let since = i64::from(self.since) + frames;
        self.since = since.rem_euclid(i64::from(self.every())) as u32;
    }

    /// Make its motion decay by an additional factor in each frame.
    pub(crate) fn damp(&mut self, by: f64) {
        self.damped = (0..2 * self.plan.kick_every).fold(1.0, |all, _| all * by);
    }

    /// Take over the state of an equal body.
    pub(crate) fn continue_from(&mut self, old: &mut Self) {
        let damped = self.damped;
        std::mem::swap(self, old);
        std::mem::swap(&mut self.plan, &mut old.plan);
        std::mem::swap(&mut self.springs, &mut old.springs);
        self.damped = damped;
    }

    /// Add its outputs now to `out` (n_out).
    pub(crate) fn tap(&self, out: &mut [f64]) {
        let frames = f64::from(self.since);
        for (output, row) in &self.plan.outputs {
            let weighted = |&(own, weight): &(usize, f64)| {
                weight * (self.x[own] + frames * self.plan.is_inner[own] * self.v[own])
            };
            out[*output as usize] += row.iter().map(weighted).sum::<f64>();
        }
    }

    /// Set positions, steps and free motion of the ports in the island.
    pub(crate) fn place(&self, body: &mut Body) {
        for (&(port, mat), previous) in self.plan.ports.iter().zip(&self.previous) {
            let step = self.x[port] - previous;
            body.x[mat] = self.x[port];
            body.d[mat] = step;
            body.inner[mat] = self.v[port] - step;
        }
    }

    /// Take note of a strike on a MAT of the island in this frame [N]: its springs answer it at their next kick.
    pub(crate) fn strike(&mut self, mat: usize, force: f64) {
        let port = self.plan.ports.iter().position(|port| port.1 == mat);
        let Some(port) = port else { return };
        let step = force * self.plan.w[self.plan.ports[port].0];
        if let Some(missing) = self.plan.missing[port].get(self.since as usize) {
            self.is_struck = true;
            for (pending_corrections, missing) in self.pending_corrections.iter_mut().zip(missing) {
                for (pending_corrections, missing) in pending_corrections.iter_mut().zip(missing) {
                    *pending_corrections += step * missing;
                }
            }
        }
    }

    /// Step from frame `n` to the next, under the forces at the ports (n_mat).
    pub(crate) fn step(&mut self, n: u64, force: &[f64]) {
        let plan = &*self.plan;
        for (&(port, mat), previous) in plan.ports.iter().zip(&mut self.previous) {
            *previous = self.x[port];
            self.v[port] += plan.w[port] * force[mat];
            self.x[port] += self.v[port];
        }
        for (&(port, _), hand_velocities) in plan.ports.iter().zip(&mut self.hand_velocities) {
            self.v[port] += std::mem::take(hand_velocities);
        }
        self.since += 1;
        let every = plan.kick_every;
        if !(n + 1).is_multiple_of(u64::from(every)) {
            return;
        }
        for &port in &plan.inner {
            // The frames since the last kick: the first interval may be shorter.
            self.x[port] += f64::from(self.since) * self.v[port];
        }
        self.since = 0;
        if self.is_struck {
            add_and_clear(&mut self.x, &mut self.pending_corrections[0]);
        }
        if self.damped < 1.0 {
            self.v.iter_mut().for_each(|v| *v *= self.damped);
        }
        self.kick.copy_from_slice(&self.v);
        self.spring_kick(true);
        if self.is_struck {
            add_and_clear(&mut self.v, &mut self.pending_corrections[1]);
            self.is_struck = false;
        }
        for (kick, v) in self.kick.iter_mut().zip(&self.v) {
            *kick = v - *kick;
        }
    }

    /// Set velocities to those after its springs pull at the present positions, from those in `kick`, or from rest.
    fn spring_kick(&mut self, is_moving: bool) {
        let before = is_moving.then_some(&self.kick[..]);
        let (x, displacements, after) = (&self.x, &mut self.displacements, &mut self.v);
        self.springs
            .pull(&self.plan, x, before, displacements, after);
    }

    /// Number of state variables at a kick.
    pub(crate) fn n_state(&self) -> usize {
        self.x.len() + self.v.len() + self.previous.len()
    }

    /// Visit each of these variables.
    pub(crate) fn each(&mut self, visit: &mut impl FnMut(&mut f64)) {
        let all = self
            .x
            .iter_mut()
            .chain(&mut self.v)
            .chain(&mut self.previous);
        all.for_each(visit);
    }

    /// Set all positions to 0, and each velocity to a random one, scaled to equal energy.
    pub(crate) fn randomise(&mut self, mut random: impl FnMut() -> f64) {
        self.x.fill(0.0);
        self.previous.fill(0.0);
        for (v, w) in self.v.iter_mut().zip(&self.plan.w) {
            *v = random() * w.sqrt();
        }
    }

    /// Its approximate energy [in units of a frame]: of its motion, and of linear springs as they pull.
    pub(crate) fn energy(&self) -> f64 {
        let plan = &*self.plan;
        let pulled = match &plan.springs {
            Springs::Exact(flow) => flow.pull.apply(&self.x),
            Springs::Stepped(_) => vec![0.0; self.x.len()],
        };
        let each = self.x.iter().zip(&self.v).zip(pulled.iter().zip(&plan.w));
        let every = f64::from(plan.kick_every);
        each.map(|((x, v), (pull, w))| 0.5 * (v * v + x * pull / every) / w)
            .sum()
    }

    /// Whether a MAT of the island is one of its ports.
    pub(crate) fn has_port(&self, mat: usize) -> bool {
        self.plan.ports.iter().any(|&(_, port)| port == mat)
    }

    /// Whether it belongs to a part.
    pub(crate) fn is_of(&self, part: usize) -> bool {
        self.plan.part == part
    }

    /// Outputs that hear it.
    pub(crate) fn outputs(&self) -> Vec<u32> {
        self.plan
            .outputs
            .iter()
            .map(|&(output, _)| output)
            .collect()
    }

    /// The name and part of a MAT whose position is beyond all bounds.
    pub(crate) fn culprit(&self) -> Option<(String, usize)> {
        let index = self.x.iter().position(|&x| !sound(x))?;
        let name = self.plan.network.mat_name(self.plan.free[index]);
        Some((name, self.plan.part))
    }

    /// Whether all positions are finite and plausible.
    pub(crate) fn sound(&self) -> bool {
        self.x.iter().all(|&x| sound(x))
    }
}

/// Add `due` to `to`, and set it to 0.
fn add_and_clear(to: &mut [f64], due: &mut [f64]) {
    for (to, due) in to.iter_mut().zip(due) {
        *to += std::mem::take(due);
    }
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
