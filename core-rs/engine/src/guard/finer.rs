//! A frame in several steps of CA.
//!
//! x goes by d/S a step and d by a/S; forces see d as they know it, metres a frame. The last of S steps is 1/2S before
//! the end of its frame, that of a frame in one step a half: between the two, velocities pass by what links and ties
//! give meanwhile. What acts from outside acts at the beginning of the frame, as in one step.

use super::{CALM, Guard, HOLD, MOST};
use crate::kernel::{fine_steps, sound};

/// What is gone through.
pub(crate) trait Stage {
    /// Forces of all links at positions and steps as they are, into `force`.
    fn pull(&mut self);
    /// What moves.
    fn motion(&mut self) -> Motion<'_>;
}

/// What moves, (n_mat) each.
pub(crate) struct Motion<'a> {
    /// 1/M, κ, ζ and where the ground is.
    pub(crate) ties: [&'a [f64]; 4],
    pub(crate) force: &'a mut [f64],
    pub(crate) x: &'a mut [f64],
    pub(crate) d: &'a mut [f64],
}

impl Guard {
    /// MATs that are led in the next finer frame, ports among them; `way` says from where to where [m].
    pub(crate) fn lead(
        &mut self,
        targets: impl Iterator<Item = usize>,
        way: impl Fn(usize) -> (f64, f64),
    ) {
        let all = self.ports.iter().copied().chain(targets);
        self.led.clear();
        self.led.extend(all.map(|mat| {
            let (from, to) = way(mat);
            (mat, from, to)
        }));
    }

    /// Go through a frame finer: `stage` stands at its beginning, with all forces that act in it. Says whether all
    /// stayed within reason.
    pub(crate) fn finer(&mut self, stage: &mut impl Stage) -> bool {
        self.begin(stage);
        let mut steps = if self.now > 1 { self.now } else { 2 };
        while !self.go(stage, steps) && steps < MOST {
            steps *= 2;
            let Motion { x, d, .. } = stage.motion();
            x.copy_from_slice(&self.x);
            d.copy_from_slice(&self.d);
        }
        self.end(stage, steps)
    }

    /// What is there at the beginning.
    fn begin(&mut self, stage: &mut impl Stage) {
        let Motion { force, x, d, .. } = stage.motion();
        self.x.copy_from_slice(x);
        self.d.copy_from_slice(d);
        self.outside.copy_from_slice(force);
        stage.pull();
        let Motion { ties, force, x, d } = stage.motion();
        let [w, kappa, zeta, rest] = ties;
        for (outside, force) in self.outside.iter_mut().zip(&*force) {
            *outside -= force;
        }
        for (i, own) in self.own.iter_mut().enumerate() {
            *own = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
        }
    }

    /// In so many steps; false where these are too few, and more may be taken.
    fn go(&mut self, stage: &mut impl Stage, steps: u32) -> bool {
        let part = 1.0 / f64::from(steps);
        let since = 0.5 / f64::from(self.before) - 0.5 * part;
        let Motion { d, ties, .. } = stage.motion();
        let [kappa, zeta] = &mut self.ties;
        if let Some(cells) = &self.cells {
            cells.ties(steps, [ties[1], ties[2]], [kappa, zeta]);
        }
        for (i, d) in d.iter_mut().enumerate() {
            let lead = if self.before > 1 { self.lead[i] } else { 0.0 };
            *d += lead + since * self.own[i];
        }
        for &(mat, from, to) in &self.led {
            d[mat] = to - from;
        }
        for step in 1..=steps {
            stage.pull();
            let Motion { ties, force, x, d } = stage.motion();
            if step == 1 {
                for (i, force) in force.iter_mut().enumerate() {
                    *force += f64::from(steps) * self.outside[i];
                    self.way[i] = 0.5 * d[i];
                }
            }
            let own = match self.cells {
                Some(_) => [ties[0], &self.ties[0], &self.ties[1], ties[3]],
                None => ties,
            };
            fine_steps(part, own, force, x, d);
            if step == 1 {
                let mesh_partition = self.way.iter_mut().zip(&*d);
                mesh_partition.for_each(|(way, d)| *way += 0.5 * d);
            }
            let share = f64::from(step) * part;
            for &(mat, from, to) in &self.led {
                (x[mat], d[mat]) = (from + (to - from) * share, to - from);
            }
            let (risen, _) = self.look(x, ties[0]);
            if steps < MOST && self.needs(risen) > steps {
                return false;
            }
        }
        true
    }

    /// The frame is over: its mean is its step, and what the last of its steps is ahead of it is kept.
    fn end(&mut self, stage: &mut impl Stage, steps: u32) -> bool {
        let Motion { ties, x, d, .. } = stage.motion();
        for i in 0..x.len() {
            let mean = x[i] - self.x[i];
            self.lead[i] = d[i] - mean;
            d[i] = mean;
        }
        let (risen, _) = self.risen(x, ties[0]);
        // Half as many only where a quarter would do.
        let is_calm = match steps {
            2 => risen <= CALM * (self.limit - self.rest),
            _ => 4 * self.needs(risen) <= steps,
        };
        self.calm = if is_calm { self.calm + 1 } else { 0 };
        (self.before, self.now) = (steps, steps);
        if self.calm == HOLD {
            (self.calm, self.now) = (0, steps / 2);
            self.before = if self.now == 1 { 1 } else { steps };
        }
        self.finer_frames.frames += 1;
        self.finer_frames.most = self.finer_frames.most.max(steps);
        x.iter().all(|&x| sound(x))
    }
}
