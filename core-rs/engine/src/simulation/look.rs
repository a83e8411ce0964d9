//! What can be seen of a simulation: where every mass is, whatever computes it.
//!
//! A [`Look`] is made outside real time and lists where each number comes from; [`Simulation::look`] then only copies. What is
//! free to swing goes by its oscillation, of which two frames tell all; a body by those of its modes; the rest by positions.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use super::Simulation;
use super::group::RunningUnit;
use crate::bank::Oscillator;
use crate::island::inside::{BodyPlan, RunningBody};
use crate::island::{Island, Record};
use crate::maths;
use crate::network::{LinkKind, MatKind, Network};
use crate::plan::{BankPlan, IslandPlan, ModalTransform, ModeShapes, Unit, whole};
use crate::timeline::Timeline;
use crate::units::Rate;

/// Most modes of a body that are looked at, the lowest: those that can be seen.
const MODES_MAX: usize = 256;

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

/// e^−σt (a cos ωt + b sin ωt) [m], or e^−σt (a + bt) where ω is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillation {
    /// ω [rad/s]
    pub omega: f64,
    /// σ [1/s]
    pub sigma: f64,
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
    n_modes: usize,
    sources: Vec<(usize, Source)>,
    /// By unit: the contact of each LIA of the island.
    touched: Vec<(usize, Vec<u32>)>,
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

impl Oscillation {
    /// Of x[n+1] = a·x[n] − b·x[n−1].
    fn of(a: f64, b: f64, rate: f64) -> Self {
        if b <= 0.0 {
            let fall = if a > 0.0 && a < 1.0 {
                maths::log(a)
            } else {
                0.0
            };
            return Self {
                omega: 0.0,
                sigma: -fall * rate,
            };
        }
        let sigma = -0.5 * maths::log(b) * rate;
        let cosine = 0.5 * a / b.sqrt();
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let omega = if cosine.abs() < 1.0 {
            maths::atan2(sine, cosine) * rate
        } else {
            0.0
        };
        Self { omega, sigma }
    }

    /// a and b of its motion from here on, from where it is and was a step of `step` [s] before [m].
    pub fn phase(&self, now: f64, before: f64, step: f64) -> (f64, f64) {
        let turn = self.omega * step;
        let was = before * maths::exp(-self.sigma * step);
        if self.omega == 0.0 {
            return (now, (now - was) / step);
        }
        (now, (now * maths::cos(turn) - was) / maths::sin(turn))
    }

    /// a and b as they are `t` [s] later, which may be below 0.
    pub fn later(&self, (a, b): (f64, f64), t: f64) -> (f64, f64) {
        let fade = maths::exp(-self.sigma * t);
        if self.omega == 0.0 {
            return (fade * (a + b * t), fade * b);
        }
        let (sine, cosine) = maths::sincos(self.omega * t);
        (
            fade * (a * cosine + b * sine),
            fade * (b * cosine - a * sine),
        )
    }
}

impl Look {
    /// What can be seen of a simulation. Takes as long as finding the modes of its bodies.
    fn of(simulation: &Simulation) -> Self {
        let plan = &*simulation.plan;
        let mut maker = Maker::new(&plan.network, plan.timeline_rate.hertz());
        for (at, unit) in plan.units.iter().enumerate() {
            match unit {
                Unit::IslandPlan(island) => maker.island(at, island),
                Unit::Bank(bank) => maker.bank(at, bank),
            }
        }
        maker.finish(&plan.unmoved)
    }

    /// How many numbers are looked at: points, then modes.
    pub fn n_tracks(&self) -> usize {
        self.points.len() + self.n_modes
    }

    /// How many modes are looked at.
    pub fn n_modes(&self) -> usize {
        self.n_modes
    }
}

/// What is found of one MAT: how it moves, from where, and where its numbers are.
struct Found {
    how: How,
    rest: f64,
    at: usize,
    from: From,
}

#[derive(Clone, Copy)]
enum From {
    Mass(usize),
    Mesh(usize, usize),
    Slow(usize, usize),
    Bank(usize),
    Body,
}

/// A body by its modes: its MATs with the rows of its shapes, rising, and its modes.
struct FoundBody {
    mats: Vec<(usize, usize)>,
    modes: Vec<FoundMode>,
}

/// A mode, where it is computed, and how much each row sees of it.
struct FoundMode {
    oscillation: Oscillation,
    /// Its unit, and which body of that, if not all of it.
    place: (usize, Option<usize>),
    mode: usize,
    shape: Vec<f64>,
}

struct Maker<'a> {
    network: &'a Network,
    rate: f64,
    by_name: HashMap<String, usize>,
    /// (n_mat)
    found: Vec<Option<Found>>,
    bodies: Vec<FoundBody>,
    contacts: Vec<Contact>,
    touched: Vec<(usize, Vec<u32>)>,
}

impl<'a> Maker<'a> {
    fn new(network: &'a Network, rate: f64) -> Self {
        let n = network.n_mat();
        let contacts = network.runs().iter().filter(|run| is_contact(&run.kind));
        let contacts = contacts.flat_map(|run| {
            (0..run.len).map(|i| Contact {
                name: network.link_name(run.first + i),
                link: run.first + i,
                ends: (run.a + i, run.b + i),
            })
        });
        Self {
            network,
            rate,
            by_name: (0..n).map(|mat| (network.mat_name(mat), mat)).collect(),
            found: (0..n).map(|_| None).collect(),
            bodies: Vec::new(),
            contacts: contacts.collect(),
            touched: Vec::new(),
        }
    }

    fn whole(&self, network: &Network, mat: usize) -> Option<usize> {
        self.by_name.get(&network.mat_name(mat)).copied()
    }

    fn put(&mut self, mat: Option<usize>, found: Found) {
        if let Some(mat) = mat {
            self.found[mat] = Some(found);
        }
    }

    fn rest(&self, mat: usize) -> f64 {
        let mats = self.network.mats();
        match mats.kind[mat] {
            MatKind::Cel => mats.rest[mat],
            _ => mats.x0[mat],
        }
    }

    fn sampled(&mut self, mat: Option<usize>, at: usize, from: From) {
        let rest = mat.map_or(0.0, |mat| self.rest(mat));
        let how = How::Sampled;
        self.put(
            mat,
            Found {
                how,
                rest,
                at,
                from,
            },
        );
    }

    fn island(&mut self, at: usize, island: &IslandPlan) {
        let network = &*island.network;
        for (mat, kind) in network.mats().kind.iter().enumerate() {
            // A point that is held is another island's guest too; whoever is first tells where it is.
            let global = whole(&island.to_whole.mats, mat);
            if kind.moves() || self.found[global].is_none() {
                self.sampled(Some(global), at, From::Mass(mat));
            }
        }
        for (body, inside) in island.bodies.iter().enumerate() {
            match inside {
                BodyPlan::Mesh(mesh) => {
                    for own in moving(&mesh.network) {
                        let mat = self.whole(&mesh.network, own);
                        self.sampled(mat, at, From::Mesh(body, own));
                    }
                }
                BodyPlan::Slow(slow) => {
                    for (own, &mat) in slow.free.iter().enumerate() {
                        let mat = self.whole(&slow.network, mat);
                        self.sampled(mat, at, From::Slow(body, own));
                    }
                }
                BodyPlan::Modal(modal) => {
                    let seen = match &modal.answers {
                        Some(answers) => {
                            ModeShapes::complex(&modal.of, &answers.places, modal.rate)
                        }
                        None => ModeShapes::new(
                            &modal.of,
                            (&modal.kept, modal.turned.as_deref()),
                            modal.rate,
                            ModalTransform::ToPositions,
                        ),
                    };
                    let modes = modal.modes.iter();
                    let modes =
                        modes.map(|mode| Oscillation::of(mode.a, mode.b, modal.rate.hertz()));
                    if let Some(seen) = seen {
                        self.body((at, Some(body)), &modal.of, &seen, modes.collect());
                    }
                }
            }
        }
        let by_name: HashMap<&str, usize> = (self.contacts.iter().enumerate())
            .map(|(at, contact)| (contact.name.as_str(), at))
            .collect();
        let mut contacts = vec![NOWHERE; network.n_lia()];
        for run in network.runs().iter().filter(|run| is_contact(&run.kind)) {
            let links = run.first..run.first + run.len;
            for (contact, link) in contacts[links.clone()].iter_mut().zip(links) {
                if let Some(&known) = by_name.get(network.link_name(link).as_str()) {
                    *contact = known as u32;
                }
            }
        }
        self.touched.push((at, contacts));
    }

    fn bank(&mut self, at: usize, bank: &BankPlan) {
        let oscillation = |own: &Oscillator| Oscillation::of(own.a, own.b, self.rate);
        let all: Vec<Oscillation> = bank.oscillators.iter().map(oscillation).collect();
        if bank.mats.len() == all.len() && !all.is_empty() {
            for (own, (&(mat, rest), &free)) in bank.mats.iter().zip(&all).enumerate() {
                let from = From::Bank(own);
                let how = How::Free(free);
                self.put(
                    Some(mat as usize),
                    Found {
                        how,
                        rest,
                        at,
                        from,
                    },
                );
            }
            return;
        }
        let rate = Rate::new(self.rate).ok();
        let (network, seen) = match (&bank.of, &bank.complex, rate) {
            (Some(of), _, Some(rate)) => {
                let kept = (&bank.kept[..], bank.turned.as_deref());
                let seen = ModeShapes::new(of, kept, rate, ModalTransform::ToPositions);
                (of.clone(), seen)
            }
            (_, Some((of, parts)), Some(rate)) => {
                (of.clone(), ModeShapes::complex(of, parts, rate))
            }
            _ => return,
        };
        if let Some(seen) = seen {
            self.body((at, None), &network, &seen, all);
        }
    }

    /// A body by its modes, or more modes of one that is known.
    fn body(
        &mut self,
        place: (usize, Option<usize>),
        network: &Arc<Network>,
        seen: &ModeShapes,
        modes: Vec<Oscillation>,
    ) {
        let mats: Vec<Option<usize>> = seen
            .mats
            .iter()
            .map(|&mat| self.whole(network, mat))
            .collect();
        let known = mats
            .iter()
            .flatten()
            .find_map(|&mat| match self.found[mat].as_ref()?.how {
                How::Modal(body) => Some(body),
                _ => None,
            });
        let at = known.unwrap_or(self.bodies.len());
        if known.is_none() {
            for (&mat, &rest) in mats.iter().zip(seen.rest()) {
                let (how, from) = (How::Modal(at), From::Body);
                self.put(
                    mat,
                    Found {
                        how,
                        rest,
                        at: place.0,
                        from,
                    },
                );
            }
            let mats = mats.iter().enumerate();
            let mut mats: Vec<(usize, usize)> =
                mats.filter_map(|(own, mat)| Some(((*mat)?, own))).collect();
            mats.sort_unstable();
            self.bodies.push(FoundBody {
                mats,
                modes: Vec::new(),
            });
        }
        let own = modes.into_iter().enumerate().take(seen.n_modes());
        self.bodies[at]
            .modes
            .extend(own.map(|(mode, oscillation)| FoundMode {
                oscillation,
                place,
                mode,
                shape: seen.shape(mode).to_vec(),
            }));
    }

    fn finish(mut self, unmoved: &[u32]) -> Look {
        let mats = self.network.mats();
        let mut points: Vec<Point> = Vec::new();
        for mat in 0..self.network.n_mat() {
            let moves = mats.kind[mat] != MatKind::Sol;
            if !moves {
                continue;
            }
            let (how, rest) = match &self.found[mat] {
                Some(found) => (found.how, found.rest),
                None => {
                    let is_moved = unmoved.binary_search(&(mat as u32)).is_err();
                    (How::NotComputed { is_moved }, self.rest(mat))
                }
            };
            points.push(Point {
                mat,
                part: mats.part[mat] as usize,
                rest,
                how,
            });
        }
        points.sort_by_key(|point| (point.part, kind(point.how), point.mat));
        let number: HashMap<usize, usize> = (points.iter().enumerate())
            .map(|(at, point)| (point.mat, at))
            .collect();
        let (mut bodies, mut n_modes) = (Vec::new(), 0);
        for body in &mut self.bodies {
            let of = body.modes.len();
            let by_pitch = |a: &FoundMode, b: &FoundMode| {
                (a.oscillation.omega.total_cmp(&b.oscillation.omega))
                    .then((a.place, a.mode).cmp(&(b.place, b.mode)))
            };
            body.modes.sort_by(by_pitch);
            body.modes.truncate(MODES_MAX);
            let modes = &body.modes;
            let rows = body.mats.iter();
            bodies.push(SeenBody {
                of,
                modes: modes.iter().map(|mode| mode.oscillation).collect(),
                first: n_modes,
                points: body.mats.iter().map(|(mat, _)| number[mat]).collect(),
                shapes: rows
                    .flat_map(|&(_, row)| modes.iter().map(move |mode| mode.shape[row]))
                    .collect(),
            });
            n_modes += modes.len();
        }
        Look {
            sources: self.sources(&points, &bodies),
            bodies,
            contacts: self.contacts,
            n_modes,
            touched: self.touched,
            points,
        }
    }

    /// Where the numbers of points and modes come from, source by source.
    fn sources(&self, points: &[Point], bodies: &[SeenBody]) -> Vec<(usize, Source)> {
        type Key = (usize, u8, usize);
        let mut by_key: BTreeMap<Key, Source> = BTreeMap::new();
        for (at, point) in points.iter().enumerate() {
            let (Some(found), track) = (&self.found[point.mat], at as u32) else {
                continue;
            };
            let (key, own) = match found.from {
                From::Mass(own) => ((found.at, 0, 0), own),
                From::Mesh(body, own) => ((found.at, 1, body), own),
                From::Slow(body, own) => ((found.at, 2, body), own),
                From::Bank(own) => ((found.at, 3, 0), own),
                From::Body => continue,
            };
            let source = by_key.entry(key).or_insert_with(|| match found.from {
                From::Mass(_) => Source::Masses(Vec::new()),
                From::Mesh(body, _) => Source::Mesh(body, Vec::new()),
                From::Slow(body, _) => Source::Slow(body, Vec::new()),
                From::Bank(_) | From::Body => Source::Bank(Vec::new()),
            });
            match source {
                Source::Masses(all) | Source::Mesh(_, all) | Source::Slow(_, all) => {
                    all.push((own as u32, track, point.rest));
                }
                Source::Bank(all) => all.push((own as u32, track)),
                Source::Modes(..) => {}
            }
        }
        let mut sources: Vec<(usize, Source)> = by_key
            .into_iter()
            .map(|((at, _, _), source)| (at, source))
            .collect();
        for (found, body) in self.bodies.iter().zip(bodies) {
            let mut by_place = BTreeMap::<_, Vec<(u32, u32)>>::new();
            for (mode, track) in found.modes.iter().zip(points.len() + body.first..) {
                let own = by_place.entry(mode.place).or_default();
                own.push((mode.mode as u32, track as u32));
            }
            for ((at, place), pairs) in by_place {
                let source = match place {
                    None => Source::Bank(pairs),
                    Some(place) => {
                        let last = pairs.iter().map(|(mode, _)| *mode as usize).max();
                        let mut modes = vec![NOWHERE; last.map_or(0, |last| last + 1)];
                        pairs
                            .iter()
                            .for_each(|(mode, track)| modes[*mode as usize] = *track);
                        Source::Modes(place, modes)
                    }
                };
                sources.push((at, source));
            }
        }
        sources
    }
}

/// The order of points within a part.
fn kind(how: How) -> (u8, usize) {
    match how {
        How::Free(_) => (0, 0),
        How::Sampled => (1, 0),
        How::Modal(body) => (2, body),
        How::NotComputed { is_moved } => (3, usize::from(is_moved)),
    }
}

fn is_contact(kind: &LinkKind) -> bool {
    matches!(kind, LinkKind::But(_))
}

fn moving(network: &Network) -> Vec<usize> {
    let kinds = network.mats().kind.iter().enumerate();
    kinds
        .filter(|(_, kind)| kind.moves())
        .map(|(mat, _)| mat)
        .collect()
}

impl Simulation {
    /// The ergons that a timeline holds, by rising instant; the speed of a strike, and the impulse of an ergon, are those
    /// against a mass that stands still. Ergons of gestures and of real hands are none of them.
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
            let at = self.groups.partition_point(|group| group.first <= *unit) - 1;
            let group = &self.groups[at];
            match &group.units[unit - group.first] {
                RunningUnit::Bank(bank) => {
                    let Source::Bank(pairs) = source else {
                        continue;
                    };
                    for &(own, track) in pairs {
                        let motion = bank.motion(own as usize);
                        (now[track as usize], before[track as usize]) = motion;
                    }
                }
                RunningUnit::Island(island) => source.look(island, now, before),
            }
        }
    }

    /// Note the strongest push of each contact from here on.
    pub fn watch_contacts(&mut self) {
        for running in self.groups.iter_mut().flat_map(|group| &mut group.units) {
            if let RunningUnit::Island(island) = running {
                island.watch_contacts();
            }
        }
    }

    /// Tell of each contact of [`Look::contacts`] that pushed since the last call: which, in which frame most, and by
    /// which force [N], above 0 where it pushes its first end up.
    pub fn take_contacts(&mut self, look: &Look, mut tell: impl FnMut(usize, u64, f64)) {
        for (unit, contacts) in &look.touched {
            let at = self.groups.partition_point(|group| group.first <= *unit) - 1;
            let group = &mut self.groups[at];
            let place = unit - group.first;
            if let RunningUnit::Island(island) = &mut group.units[place] {
                let steps = u64::from(island.oversampling());
                island.take_touches(|link, touch| {
                    if contacts[link] != NOWHERE {
                        tell(contacts[link] as usize, touch.frame / steps, touch.force);
                    }
                });
            }
        }
    }
}

impl Source {
    fn look(&self, island: &Island, now: &mut [f64], before: &mut [f64]) {
        match self {
            Self::Masses(all) => {
                let x = island.positions();
                for &(own, track, rest) in all {
                    now[track as usize] = x[own as usize] - rest;
                }
            }
            Self::Mesh(body, all) => {
                if let Some(RunningBody::Mesh(mesh)) = island.bodies().get(*body) {
                    for &(own, track, rest) in all {
                        now[track as usize] = mesh.motion(own as usize).0 - rest;
                    }
                }
            }
            Self::Slow(body, all) => {
                if let Some(RunningBody::Slow(slow)) = island.bodies().get(*body) {
                    for &(own, track, rest) in all {
                        now[track as usize] = slow.motion(own as usize).0 - rest;
                    }
                }
            }
            Self::Modes(body, tracks) => {
                if let Some(RunningBody::Modal(modal)) = island.bodies().get(*body) {
                    modal.look(|mode, x, was| {
                        let track = tracks.get(mode).copied().unwrap_or(NOWHERE);
                        if track != NOWHERE {
                            (now[track as usize], before[track as usize]) = (x, was);
                        }
                    });
                }
            }
            Self::Bank(_) => {}
        }
    }
}
