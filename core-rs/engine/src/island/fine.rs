//! Contacts computed finer than a frame, and only while they may be closed.
//!
//! Between its contacts all that touches is linear, so within a frame a contact needs of its two points
//! only where each would go by itself, and what a push at one instant makes of the instants after it. The pushes of
//! a frame, S of them, then act on the rest of the scene as impulses at their own instants.

use std::sync::Arc;

use super::inside::RunningBody;
use super::modal::RunningModal;
use crate::cell::{Cell, Split};
use crate::kernel::{self, ports};
use crate::network::{MatKind, Network};
use crate::scheme::{Kind, Run, Scheme};
use crate::state::{Body, Target};
use crate::timeline::{DriveKind, Timeline};
use crate::units::Rate;

/// A contact that is further than this from closing stays open, however its distance is rounded [m].
const HAIR: f64 = 1e-9;
/// A mode's answer to an impulse costs as much as so many products: it has an exponential and a sine.
const RESPONSE: u64 = 200;
/// A sum of products costs as much as so many of them before the first.
const LOOP: u64 = 16;

/// A point that contacts touch.
#[derive(Clone, Debug)]
struct Joint {
    mat: usize,
    /// The body that it is a port of, and which port.
    port: Option<(usize, usize)>,
    /// Of a MAT that is stepped: its own motion, and where it rests [m].
    cell: Option<Cell>,
    /// How impulses at j/S are split between two frames; of a MAT that is stepped   (S)
    splits: Vec<Split>,
    rest: f64,
    /// Weights of where it is, and of where it goes, at j/S of the way   (S + 1)
    way: Vec<(f64, f64)>,
}

/// What does not change.
#[derive(Clone, Debug)]
struct Script {
    steps: usize,
    rate: Rate,
    contacts: Vec<Run>,
    /// The two joints of each contact.
    ends: Vec<(usize, usize)>,
    joints: Vec<Joint>,
    /// What an impulse at one joint moves another by, j/S of a frame later   (n_joints², S + 1); empty where
    /// nothing leads from one to the other within a frame.
    moves: Vec<Vec<f64>>,
    /// Products that tell in each frame where all joints go.
    ways: u64,
}

/// Contacts that play.
#[derive(Clone, Debug)]
pub(crate) struct Fine {
    script: Arc<Script>,
    /// Where each joint goes in this frame   (n_joints · (S + 1))
    way: Vec<f64>,
    /// Impulses on each joint in this frame   (n_joints · S)
    given: Vec<f64>,
    /// Elongation of each contact at the last instant, where the frame before had one.
    before: Vec<Option<f64>>,
    /// Force that each stepped joint still feels in the next frame   (n_joints)
    later: Vec<f64>,
    /// Whether a contact may be closed in this frame.
    near: Vec<bool>,
    /// K and Z of each contact in this frame.
    numbers: Vec<[f64; 2]>,
    /// Whether one has been.
    pub(super) has_touched: bool,
    /// Work done so far.
    work: FineWork,
}

crate::archive::option!(Fine, fixed);

crate::archive::state!(Fine {
    way,
    given,
    before,
    later,
    near,
    numbers,
    has_touched,
    work
});

/// Work of contacts that are computed finely, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FineWork {
    /// Contacts, once for each instant at which they were computed.
    pub(crate) instants: u64,
    /// Sums of products.
    pub(crate) products: u64,
}

crate::archive::state!(FineWork { instants, products });

impl Fine {
    /// `contacts` leave the scheme: single links whose ends are masses or ports.
    pub(super) fn new(
        contacts: Vec<Run>,
        network: &Network,
        scheme: &Scheme,
        bodies: &[RunningBody],
        steps: usize,
        timeline: &Timeline,
    ) -> Self {
        let rate = timeline.rate;
        let mut mats: Vec<usize> = contacts.iter().flat_map(|run| [run.a, run.b]).collect();
        mats.sort_unstable();
        mats.dedup();
        let is_held = |mat: usize| {
            let mut drives = timeline.drives.iter();
            drives.any(|drive| drive.mat == mat && drive.kind == DriveKind::Position)
        };
        let joint = |&mat: &usize| joint(mat, is_held(mat), network, scheme, bodies, steps, rate);
        let joints: Vec<Joint> = mats.iter().map(joint).collect();
        let at = |mat: usize| mats.binary_search(&mat).unwrap_or(0);
        let ends = contacts.iter().map(|run| (at(run.a), at(run.b))).collect();
        let n = joints.len();
        // Of each joint: the modes that tell where it is, itself where it is a mass.
        let modes = |joint: &Joint| {
            let body = joint.port.and_then(|(owner, _)| bodies[owner].modal());
            body.map_or(1, RunningModal::n_modes) as u64
        };
        let pairs = |joint: &Joint| {
            let same = |other: &&Joint| match (joint.port, other.port) {
                (Some((owner, _)), Some((own, _))) => owner == own,
                _ => false,
            };
            joints.iter().filter(same).count().max(1) as u64
        };
        let instants = steps as u64 + 1;
        let responses = joints
            .iter()
            .map(|own| pairs(own) * modes(own) * instants)
            .sum::<u64>();
        let ways = joints.iter().map(|own| 2 * modes(own) * instants).sum();
        let moves = (0..n * n)
            .map(|pair| moves(&joints, bodies, pair / n, pair % n, steps, rate))
            .collect();
        Self {
            way: vec![0.0; n * (steps + 1)],
            given: vec![0.0; n * steps],
            before: vec![None; contacts.len()],
            later: vec![0.0; n],
            near: vec![false; contacts.len()],
            numbers: contacts.iter().map(|run| [run.k, run.z]).collect(),
            has_touched: false,
            work: FineWork {
                instants: 0,
                products: RESPONSE * responses,
            },
            script: Arc::new(Script {
                steps,
                rate,
                contacts,
                ends,
                joints,
                moves,
                ways,
            }),
        }
    }

    /// Continue as the same contacts of another version stand.
    pub(super) fn continue_from(&mut self, old: &mut Self) {
        std::mem::swap(&mut self.before, &mut old.before);
        std::mem::swap(&mut self.later, &mut old.later);
        self.has_touched = old.has_touched;
    }

    /// Let go of the contacts on some MATs (n_mat), whose links are returned, and of the bodies that leave: `places` are
    /// where the others are from now on (n_bodies).
    pub(super) fn release(&mut self, mats: &[bool], places: &[Option<usize>]) -> Vec<usize> {
        // A part leaves once in a run: a copy of the script for it is allowed to cost.
        let script = Arc::make_mut(&mut self.script);
        for (joint, later) in script.joints.iter_mut().zip(&mut self.later) {
            joint.port = (joint.port).and_then(|(owner, port)| Some((places[owner]?, port)));
            if mats[joint.mat] {
                joint.cell = None;
                *later = 0.0;
            }
        }
        let stays: Vec<bool> = (script.contacts.iter())
            .map(|run| !mats[run.a] && !mats[run.b])
            .collect();
        let links = (script.contacts.iter().zip(&stays))
            .filter(|(_, stays)| !**stays)
            .map(|(run, _)| run.first)
            .collect();
        keep(&mut script.contacts, &stays);
        keep(&mut script.ends, &stays);
        keep(&mut self.before, &stays);
        keep(&mut self.near, &stays);
        keep(&mut self.numbers, &stays);
        links
    }

    /// Give the contact of a link, if it is here still, K and Z times what they are.
    pub(super) fn lead(&mut self, link: usize, [of_k, of_z]: [f64; 2]) {
        let script = &self.script;
        for (run, numbers) in script.contacts.iter().zip(&mut self.numbers) {
            if run.first == link {
                *numbers = [run.k * of_k, run.z * of_z];
            }
        }
    }

    /// Work done so far, counted.
    pub(super) fn work(&self) -> FineWork {
        self.work
    }

    /// How many of its contacts end on a MAT.
    pub(super) fn touches(&self, mat: usize) -> u32 {
        let contacts = self.script.contacts.iter();
        contacts
            .map(|run| u32::from(run.a == mat) + u32::from(run.b == mat))
            .sum()
    }

    /// Whether the last frame left nothing to this one.
    pub(super) fn is_done(&self) -> bool {
        self.later.iter().all(|later| *later == 0.0)
    }

    /// Whether every contact is open in this frame, and a hair from closing, where nothing moves its points but themselves.
    pub(super) fn stays_open(&self, scheme: &Scheme, body: &Body) -> bool {
        self.script.contacts.iter().all(|run| {
            let next = |mat: usize| kernel::predict(scheme, body, mat);
            let now = body.x[run.b] - body.x[run.a];
            let then = next(run.b) - next(run.a);
            nearest(run, now - run.rest, then - run.rest) < -HAIR
        })
    }

    /// As frames in which every contact is open leave it.
    pub(super) fn rest(&mut self, body: &mut Body) {
        self.before.fill(None);
        self.near.fill(false);
        for run in &self.script.contacts {
            body.link[run.first] = 0.0;
        }
    }

    /// Forces that the frame before left to this one.
    pub(super) fn carry(&mut self, body: &mut Body) {
        for (joint, later) in self.script.joints.iter().zip(&mut self.later) {
            if *later != 0.0 {
                body.push(joint.mat, std::mem::take(later));
            }
        }
    }

    /// One frame of every contact that may be closed, once all other forces are summed.
    pub(super) fn step(
        &mut self,
        scheme: &Scheme,
        gates: &[f64],
        targets: &[Target],
        bodies: &mut [RunningBody],
        body: &mut Body,
    ) {
        let next = |mat: usize, body: &Body| match targets.iter().find(|target| target.mat == mat) {
            Some(target) => target.x,
            None => kernel::predict(scheme, body, mat),
        };
        let mut any = false;
        for (contact, run) in self.script.contacts.iter().enumerate() {
            let now = body.x[run.b] - body.x[run.a];
            let then = next(run.b, body) - next(run.a, body);
            let near = may_close(run, now - run.rest, then - run.rest);
            if !near {
                self.before[contact] = None;
            }
            self.near[contact] = near;
            any |= near;
            body.link[run.first] = 0.0;
        }
        if !any {
            return;
        }
        let script = self.script.clone();
        self.work.products += script.ways;
        for (at, joint) in script.joints.iter().enumerate() {
            let way = &mut self.way[at * (script.steps + 1)..(at + 1) * (script.steps + 1)];
            match joint.port {
                Some((owner, port)) => {
                    if let Some(modal) = bodies[owner].modal_mut() {
                        modal.way(port, way);
                    }
                }
                None => {
                    let rest = joint.rest;
                    let (x, then) = (body.x[joint.mat] - rest, next(joint.mat, body) - rest);
                    for (x_at, (from, to)) in way.iter_mut().zip(&joint.way) {
                        *x_at = rest + (x * from + then * to);
                    }
                }
            }
        }
        self.given.fill(0.0);
        self.collide(&script, gates, body);
        for (at, joint) in script.joints.iter().enumerate() {
            let given = &self.given[at * script.steps..(at + 1) * script.steps];
            if given.iter().all(|impulse| *impulse == 0.0) {
                continue;
            }
            match (joint.port, &joint.cell) {
                (Some((owner, port)), _) => {
                    if let Some(modal) = bodies[owner].modal_mut() {
                        modal.give(port, given, body);
                    }
                }
                (None, Some(_)) => {
                    let pushes = given.iter().zip(&joint.splits);
                    for (&impulse, split) in pushes.filter(|(impulse, _)| **impulse != 0.0) {
                        // The responses are kept; counted as before, so that plans stay as they are.
                        self.work.products += 2 * RESPONSE;
                        let [now, later] = split.of(impulse);
                        body.push(joint.mat, now);
                        self.later[at] += later;
                    }
                }
                // It moves as it is told, and a hand that holds it feels what it is told by.
                (None, None) => {
                    body.push(joint.mat, given.iter().sum::<f64>() * script.rate.hertz())
                }
            }
        }
    }

    /// The pushes of a frame, one instant after the other.
    fn collide(&mut self, script: &Script, gates: &[f64], body: &mut Body) {
        let (steps, stride) = (script.steps, script.steps + 1);
        let n = script.joints.len();
        let share = script.rate.step() / steps as f64;
        for j in 0..steps {
            for (contact, run) in script.contacts.iter().enumerate() {
                if !self.near[contact] {
                    continue;
                }
                self.work.instants += 1;
                let (a, b) = script.ends[contact];
                let e = self.way[b * stride + j] - self.way[a * stride + j] - run.rest;
                let e_next = self.way[b * stride + j + 1] - self.way[a * stride + j + 1] - run.rest;
                // Where there is no instant before, as if it had come as fast as it goes.
                let before = self.before[contact].unwrap_or(2.0 * e - e_next);
                self.before[contact] = Some(e);
                let open = run.gate.map_or(1.0, |gate| gates[gate]);
                let force =
                    open * force(run, self.numbers[contact], e, (e - before) * steps as f64);
                if j == 0 {
                    body.link[run.first] = force;
                }
                if force == 0.0 {
                    continue;
                }
                self.has_touched = true;
                for (end, impulse) in [(a, force * share), (b, -force * share)] {
                    self.given[end * steps + j] += impulse;
                    for other in 0..n {
                        let moves = &script.moves[end * n + other];
                        let way = &mut self.way[other * stride + j..(other + 1) * stride];
                        ports::add_scaled(way, moves, impulse);
                        self.work.products += LOOP + moves.len().min(stride - j) as u64;
                    }
                }
            }
        }
    }
}

/// Keep the entries of a list that stay.
fn keep<T>(list: &mut Vec<T>, stays: &[bool]) {
    let mut stays = stays.iter();
    list.retain(|_| *stays.next().unwrap_or(&true));
}

fn joint(
    mat: usize,
    is_held: bool,
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    steps: usize,
    rate: Rate,
) -> Joint {
    let port = bodies.iter().enumerate().find_map(|(owner, playing)| {
        let port = playing.modal()?.ports().position(|port| port == mat)?;
        Some((owner, port))
    });
    let mats = network.mats();
    let cell = match mats.kind[mat] {
        _ if port.is_some() || is_held || scheme.w[mat] == 0.0 => None,
        MatKind::Cel => Some(Cell::new(mats.m[mat], mats.k[mat], mats.z[mat])),
        _ => Some(Cell::new(mats.m[mat], 0.0, 0.0)),
    };
    let instants = (0..=steps).map(|j| j as f64 / steps as f64);
    let (way, rest) = match &cell {
        Some(cell) => (
            instants.map(|at| cell.interpolation(at, rate)).collect(),
            mats.rest[mat],
        ),
        None => (instants.map(|at| (1.0 - at, at)).collect(), 0.0),
    };
    let splits = (cell.iter())
        .flat_map(|cell| (0..steps).map(|j| cell.split_at(j as f64 / steps as f64, rate)))
        .collect();
    Joint {
        mat,
        port,
        cell,
        splits,
        rest,
        way,
    }
}

/// What an impulse at `from` moves `to` by, j/S of a frame later.
fn moves(
    joints: &[Joint],
    bodies: &[RunningBody],
    from: usize,
    to: usize,
    steps: usize,
    rate: Rate,
) -> Vec<f64> {
    let after = |j: usize| j as f64 / steps as f64 * rate.step();
    match (joints[from].port, joints[to].port) {
        (Some((owner, from)), Some((same, to))) if owner == same => {
            let modal = bodies[owner].modal();
            let at = |t| modal.map_or(0.0, |modal| modal.response(from, to, t));
            (0..=steps).map(after).map(at).collect()
        }
        (None, None) if from == to => match &joints[from].cell {
            Some(cell) => (0..=steps).map(|j| cell.answer(after(j))).collect(),
            None => Vec::new(),
        },
        _ => Vec::new(),
    }
}

/// Whether a contact may be closed between two elongations: it is at one of them, or so near that what it does
/// in between could take it there.
fn may_close(run: &Run, now: f64, then: f64) -> bool {
    nearest(run, now, then) > 0.0
}

/// How far it may come beyond its gap between two elongations [m].
fn nearest(run: &Run, now: f64, then: f64) -> f64 {
    let Kind::But(but) = &run.kind else {
        return f64::NEG_INFINITY;
    };
    let s = kernel::side(but);
    let (now, then) = (s * now, s * then);
    now.max(then) + (then - now).abs()
}

fn force(run: &Run, [k, z]: [f64; 2], e: f64, step: f64) -> f64 {
    let Kind::But(but) = &run.kind else {
        return 0.0;
    };
    let s = kernel::side(but);
    s * kernel::push(but, k, z, s * e, s * step)
}
