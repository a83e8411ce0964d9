//! Energy that impulses between frames create at points that steps hold too, by springs or as a mesh.
//!
//! Within a frame such a point moves as if it were free, and what holds it acts at frames only. So the work of an
//! impulse along that motion, which is what the contact or law gives or takes, is not its work in the steps. The
//! difference is created energy; without springs it is zero, to rounding.

use super::Fine;
use super::script::Script;
use crate::island::energy_account::{Account, Gain};
use crate::island::inside::RunningBody;
use crate::network::Network;
use crate::scheme::Scheme;
use crate::state::Body;

/// A point that steps hold too.
#[derive(Clone, Debug)]
pub(super) struct Sprung {
    joint: usize,
    mat: usize,
    /// A link between frames that ends there, whose name is told.
    link: usize,
    /// Its velocity at the start of this frame [m/frame] and its acceleration [m/frame²], if no link pushes it.
    free: [f64; 2],
    /// In the step before: the force in the steps that replaces impulses [N], and the last step [m].
    force: f64,
    step: f64,
    account: Account,
    worst: Option<Gain>,
}

crate::archive::state!(Sprung {
    force,
    step,
    account,
    worst
});

/// The joints that steps hold too.
pub(super) fn sprung(script: &Script, network: &Network, bodies: &[RunningBody]) -> Vec<Sprung> {
    let is_stepped = |mat: usize| {
        let mut others = bodies.iter().filter(|body| body.modal().is_none());
        let ends = script.links.iter().flat_map(|run| [run.a, run.b]);
        let n_fine = ends.filter(|&end| end == mat).count();
        others.any(|body| body.has_port(mat)) || network.degree(mat) as usize > n_fine
    };
    let joints = script.joints.iter().enumerate();
    joints
        .filter(|(_, joint)| joint.port.is_none() && joint.cell.is_some() && is_stepped(joint.mat))
        .filter_map(|(at, joint)| {
            let mut ends = script.ends.iter();
            let link = ends.position(|&(a, b)| a == at || b == at)?;
            Some(Sprung {
                joint: at,
                mat: joint.mat,
                link: script.links[link].first,
                free: [0.0; 2],
                force: 0.0,
                step: 0.0,
                account: Account::default(),
                worst: None,
            })
        })
        .collect()
}

impl Sprung {
    pub(super) fn is_at(&self, joint: usize) -> bool {
        self.joint == joint
    }

    /// Note where it would go in this frame: the step to the next frame, and half of the change of the step by forces
    /// that last [m].
    pub(super) fn note_free(&mut self, step: f64, bend: f64) {
        self.free = [step - bend, 2.0 * bend];
    }

    /// Note the force that the frame before left to this one, of those of all joints [N].
    pub(super) fn carry(&mut self, later: &[f64], body: &Body) {
        (self.force, self.step) = (later[self.joint], body.d[self.mat]);
    }
}

impl Fine {
    /// Count the work that the impulses of the step before did in the steps: ½(d[n] + d[n+1])·f.
    pub(super) fn settle_sprung(&mut self, scheme: &Scheme, body: &Body) {
        for own in self.sprung.iter_mut().filter(|own| own.force != 0.0) {
            let (step, w) = (body.d[own.mat], scheme.w[own.mat]);
            let around = if w > 0.0 { 0.5 * step * step / w } else { 0.0 };
            let work = 0.5 * (own.step + step) * own.force;
            own.account.take_from_masses(-work, around);
        }
    }

    /// Count the work of this frame's impulses along the motion within the frame, and note the force that replaces
    /// them.
    pub(super) fn note_sprung(&mut self, script: &Script, scheme: &Scheme, body: &Body) {
        let (n, rate) = (script.basis.n(), script.rate.hertz());
        for own in &mut self.sprung {
            let pushed = &self.pushed[own.joint * n..(own.joint + 1) * n];
            let split = script.joints[own.joint].split.iter();
            let (mut sum, mut moment) = (0.0, 0.0);
            for ((impulse, s), [at_once, _]) in
                pushed.iter().zip(&script.basis.instants).zip(split)
            {
                sum += impulse * rate;
                moment += impulse * rate * s;
                own.force += impulse * at_once;
            }
            let [velocity, acceleration] = own.free;
            let halfway = velocity + 0.5 * scheme.w[own.mat] * sum;
            own.account.take(sum * halfway + moment * acceleration);
            own.step = body.d[own.mat];
        }
    }

    /// Begin the accounts anew.
    pub(in crate::island) fn restart_accounts(&mut self) {
        for own in &mut self.sprung {
            (own.account, own.force) = (Account::default(), 0.0);
        }
    }

    /// The energy created by frame `n`, where it is worth reporting: a link, the point's MAT, and the energy; `around`
    /// is that of all that moves.
    pub(in crate::island) fn check_gains(
        &mut self,
        (around, put_in): (impl Fn() -> f64, f64),
        n: u64,
    ) -> impl Iterator<Item = (usize, usize, Gain)> {
        self.sprung.iter_mut().filter_map(move |own| {
            if !own.account.is_overdrawn() {
                return None;
            }
            let gain = own.account.gain(0.0, around(), n).of_at_least(put_in);
            if !gain.is_reportable() {
                return None;
            }
            own.worst = Some(gain.worse_of(own.worst));
            Some((own.link, own.mat, gain))
        })
    }

    /// Links at whose ends energy was created, each with the most that was.
    pub(in crate::island) fn gains(&self) -> impl Iterator<Item = (usize, Gain)> {
        let all = self.sprung.iter();
        all.filter_map(|own| Some((own.link, own.worst?)))
    }

    /// Remove the points that are among the marked MATs (n_mat).
    pub(super) fn release_sprung(&mut self, mats: &[bool]) {
        self.sprung.retain(|own| !mats[own.mat]);
    }
}
