//! What can be seen of a simulation: where every mass is, whatever computes it.
//!
//! A [`Look`] is made outside real time and lists where each number comes from; [`Simulation::look`] then only copies. What is
//! free to swing goes by its oscillation, of which two frames tell all; a body by those of its modes; the rest by positions.

use std::sync::Arc;

use super::Simulation;
use super::group::RunningUnit;
use crate::island::inside::RunningBody;
use crate::island::{Island, Record};
use crate::network::Network;
use crate::plan::{Plan, Unit, whole};
use crate::timeline::Timeline;
use crate::units::Rate;
use maker::Maker;

mod glance;
mod maker;
mod oscillation;

pub use glance::{Glance, Push};
pub use oscillation::Oscillation;

/// How a point that is looked at moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum How {
    /// By an oscillation of its own.
    Free(Oscillation),
    /// By its positions.
    Sampled,
    /// By the modes of [`Look::bodies`] of this number.
    Modal(usize),
    /// Nothing computes it, for nobody hears it or nothing moves it.
    NotComputed {
        /// Whether anything moves it: then nobody hears it.
        is_moved: bool,
    },
}

/// A mass.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Its MAT in the network.
    pub mat: usize,
    /// Its part in the network.
    pub part: usize,
    /// From where its displacement counts [m].
    pub rest: f64,
    /// How it moves.
    pub how: How,
}

/// A body that goes by its modes.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenBody {
    /// The oscillation of each mode.
    pub modes: Vec<Oscillation>,
    /// The first of them among all modes that are looked at.
    pub first: usize,
    /// How many modes the engine computes of it.
    pub of: usize,
    /// Its points, rising.
    pub points: Vec<usize>,
    /// How much each point sees of each mode   (n_points, n_modes)
    pub shapes: Vec<f64>,
}

/// A contact: a link that opens and closes.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// Its name in the score.
    pub name: String,
    /// The LIA in the network.
    pub link: usize,
    /// Its two MATs.
    pub ends: (usize, usize),
}

/// What can be seen of a simulation, and where it is found.
#[derive(Clone, Debug)]
pub struct Look {
    /// By part, by how they move, by MAT.
    pub points: Vec<Point>,
    /// Bodies that go by their modes.
    pub bodies: Vec<SeenBody>,
    /// Contacts.
    pub contacts: Vec<Contact>,
    /// LIAs of the network that may break, rising.
    pub breakable: Vec<usize>,
    plan: Arc<Plan>,
    n_modes: usize,
    sources: Vec<(usize, Source)>,
    /// By unit: the contact of each LIA of the island.
    touched: Vec<(usize, Vec<u32>)>,
    /// Units in which written gestures play, and the MAT of the network that each of theirs is.
    played: Vec<(usize, Option<Vec<u32>>)>,
    /// By unit: LIAs of the island that may break, and which of `breakable` each is.
    breaking: Vec<(usize, Vec<(u32, u32)>)>,
}

/// Where numbers come from: pairs of an index in the source and one in what is looked at, with the rest of it.
#[derive(Clone, Debug)]
enum Source {
    Masses(Vec<(u32, u32, f64)>),
    Mesh(usize, Vec<(u32, u32, f64)>),
    Slow(usize, Vec<(u32, u32, f64)>),
    /// What each mode is, [`NOWHERE`] where it is not looked at.
    Modes(usize, Vec<u32>),
    Bank(Vec<(u32, u32)>),
}

const NOWHERE: u32 = u32::MAX;

impl Look {
    /// What can be seen of a simulation. Takes as long as finding the modes of its bodies.
    fn of(simulation: &Simulation) -> Self {
        let plan = &simulation.plan;
        let mut maker = Maker::new(&plan.network, plan.timeline_rate.hertz());
        for (at, unit) in plan.units.iter().enumerate() {
            match unit {
                Unit::IslandPlan(island) => maker.island(at, island),
                Unit::Bank(bank) => maker.bank(at, bank),
            }
        }
        maker.finish(plan.clone())
    }

    /// How many numbers are looked at: points, then modes.
    pub fn n_tracks(&self) -> usize {
        self.points.len() + self.n_modes
    }

    /// Whether it was found of the plan of this simulation.
    pub fn is_of(&self, simulation: &Simulation) -> bool {
        Arc::ptr_eq(&self.plan, &simulation.plan)
    }

    /// How many modes are looked at.
    pub fn n_modes(&self) -> usize {
        self.n_modes
    }

    /// The oscillation of a mode, by its place among all numbers.
    fn oscillation(&self, track: usize) -> Oscillation {
        let mode = track - self.points.len();
        let body = self.bodies.partition_point(|body| body.first <= mode) - 1;
        self.bodies[body].modes[mode - self.bodies[body].first]
    }
}

impl Simulation {
    /// The ergons that a timeline holds, by rising instant; the speed of a strike, and the impulse of an ergon, are those
    /// against a mass that stands still. Of gestures [`Self::take_sparks`] tells; real hands give forces.
    pub fn written(&self, timeline: &Timeline) -> Vec<Record> {
        let network = &*self.plan.network;
        let mass = |mat: u32| {
            let own = network.mats().m[mat as usize];
            let part = network
                .parts()
                .get(network.mats().part[mat as usize] as usize);
            let rate = part.and_then(|part| part.ca_rate).map_or(1.0, Rate::hertz);
            own / (rate * rate)
        };
        let strikes = timeline.strikes.iter().map(|strike| {
            let (struck, mat) = (mass(strike.mat), strike.mat as usize);
            Record::event(strike.at, mat, strike.source, struck, 0.0, strike.impulse)
        });
        let ergons = timeline.ergons.iter().map(|ergon| Record {
            time: ergon.at,
            mat: ergon.mat,
            source: ergon.source,
            mass: ergon.mass,
            speed: ergon.speed,
            impulse: 2.0 * ergon.mass * mass(ergon.mat) / (ergon.mass + mass(ergon.mat))
                * ergon.speed,
        });
        let mut all: Vec<Record> = strikes.chain(ergons).collect();
        all.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.mat.cmp(&b.mat)));
        all
    }

    /// The network of its plan.
    pub fn network(&self) -> &Network {
        &self.plan.network
    }

    /// What can be seen of it. Takes as long as finding the modes of its bodies, and longer.
    pub fn looked_at(&self) -> Look {
        Look::of(self)
    }

    /// Displacements now, and one frame before, of what is free and of modes [m]   (2 · n_tracks): first all now. What is sampled, and
    /// what nobody computes, has no frame before. Only copies.
    pub fn look(&self, look: &Look, out: &mut [f64]) {
        let (now, before) = out.split_at_mut(look.n_tracks());
        for (unit, source) in &look.sources {
            match self.running(*unit) {
                RunningUnit::Bank(bank) => {
                    let Source::Bank(pairs) = source else {
                        continue;
                    };
                    for &(own, track) in pairs {
                        let motion = bank.motion(own as usize);
                        (now[track as usize], before[track as usize]) = motion;
                    }
                }
                RunningUnit::Island(island) => {
                    source.look(look, (island, self.frame), self.rate(), now, before);
                }
            }
        }
    }

    /// Note the strongest push of each contact, and what written hands strike, from here on.
    pub fn watch(&mut self) {
        for running in self.groups.iter_mut().flat_map(|group| &mut group.units) {
            if let RunningUnit::Island(island) = running {
                island.watch();
            }
        }
    }

    /// Tell of each contact of [`Look::contacts`] that pushed since the last call: which, in which frame most, and by
    /// which force [N], above 0 where it pushes its first end up.
    pub fn take_contacts(&mut self, look: &Look, mut tell: impl FnMut(usize, u64, f64)) {
        for (unit, contacts) in &look.touched {
            if let RunningUnit::Island(island) = self.running_mut(*unit) {
                island.take_touches(|link, frame, force| {
                    if contacts[link] != NOWHERE {
                        tell(contacts[link] as usize, frame, force);
                    }
                });
            }
        }
    }
}

impl Simulation {
    /// A unit of the plan as it runs.
    fn running(&self, unit: usize) -> &RunningUnit {
        let at = self.groups.partition_point(|group| group.first <= unit) - 1;
        &self.groups[at].units[unit - self.groups[at].first]
    }

    fn running_mut(&mut self, unit: usize) -> &mut RunningUnit {
        let at = self.groups.partition_point(|group| group.first <= unit) - 1;
        let group = &mut self.groups[at];
        &mut group.units[unit - group.first]
    }

    /// How many sparks there are between two looks at most.
    pub(super) fn sparks_max(&self, look: &Look) -> usize {
        let most = look
            .played
            .iter()
            .map(|(unit, _)| match self.running(*unit) {
                RunningUnit::Island(island) => island.sparks_max(),
                RunningUnit::Bank(_) => 0,
            });
        most.sum()
    }

    /// Tell of the ergons of written gestures since the last call, as they are seen: a throw and a grain each by itself, of those that lead along a
    /// path the ones of one sign as one, with the impulse of all. Where more strike than can be told, others are gathered too.
    pub fn take_sparks(&mut self, look: &Look, mut tell: impl FnMut(Record)) {
        for (unit, mats) in &look.played {
            if let RunningUnit::Island(island) = self.running_mut(*unit) {
                island.take_sparks(|spark| {
                    let mat = whole(mats, spark.mat as usize) as u32;
                    tell(Record { mat, ..spark });
                });
            }
        }
    }

    /// Tell of each link of [`Look::breakable`] that is computed whether it is broken.
    fn look_at_breaks(&self, look: &Look, mut tell: impl FnMut(usize, bool)) {
        for (unit, links) in &look.breaking {
            if let RunningUnit::Island(island) = self.running(*unit) {
                for &(own, link) in links {
                    tell(link as usize, island.is_broken(own as usize));
                }
            }
        }
    }
}

impl Source {
    /// What an island has of it in a scene of `rate` that has computed so many frames; where the island is ahead of the scene,
    /// what was there before.
    fn look(
        &self,
        look: &Look,
        (island, frame): (&Island, u64),
        rate: f64,
        now: &mut [f64],
        before: &mut [f64],
    ) {
        let ahead = island.ahead(frame);
        let steps = f64::from(ahead) * island.steps_a_frame();
        let then = |x: f64, step: f64| if ahead == 0 { x } else { x - steps * step };
        match self {
            Self::Masses(all) => {
                let (x, step) = (island.positions(), island.steps());
                for &(own, track, rest) in all {
                    now[track as usize] = then(x[own as usize], step[own as usize]) - rest;
                }
            }
            Self::Mesh(body, all) => {
                if let Some(RunningBody::Mesh(mesh)) = island.bodies().get(*body) {
                    for &(own, track, rest) in all {
                        let (x, step) = mesh.motion(own as usize);
                        now[track as usize] = then(x, step) - rest;
                    }
                }
            }
            Self::Slow(body, all) => {
                if let Some(RunningBody::Slow(slow)) = island.bodies().get(*body) {
                    for &(own, track, rest) in all {
                        let (x, step) = slow.motion(own as usize);
                        now[track as usize] = then(x, step) - rest;
                    }
                }
            }
            Self::Modes(body, tracks) => {
                if let Some(RunningBody::Modal(modal)) = island.bodies().get(*body) {
                    let step = 1.0 / (rate * island.steps_a_frame());
                    let since = -f64::from(ahead) / rate;
                    modal.look(|mode, x, was| {
                        let track = tracks.get(mode).copied().unwrap_or(NOWHERE) as usize;
                        if track == NOWHERE as usize {
                            return;
                        }
                        (now[track], before[track]) = if island.is_slow() {
                            let own = look.oscillation(track);
                            let phase = own.phase(x, was, step);
                            let at = |t: f64| own.later(phase, t).0;
                            (at(since), at(since - 1.0 / rate))
                        } else {
                            (x, was)
                        };
                    });
                }
            }
            Self::Bank(_) => {}
        }
    }
}
