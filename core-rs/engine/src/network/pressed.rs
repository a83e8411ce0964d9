//! What a hand can reach of a scene, with all its contacts closed: as stiff as the hand can meet it.

use super::{Contact, LinkKind, MatKind, Network, Run};
use crate::network::forest::{Forest, ends};

/// Contacts and laws that harden are looked at this deep [m] at least.
pub const DEEP: f64 = 1e-3;
/// Places between at which a law's slope is looked at.
const PLACES: i32 = 16;

/// A scene at one moment, as far as it differs from what its network says.
#[derive(Clone, Debug, Default)]
pub struct Moment {
    /// MATs that other hands hold.
    pub held: Vec<usize>,
    /// Links that do not act.
    pub without: Vec<usize>,
    /// K, Z and M of MATs that glide.
    pub ties: Vec<(usize, [f64; 3])>,
    /// Factors of links whose force glides.
    pub factors: Vec<(usize, f64)>,
}

/// The part of a scene that a hand can move, pressed: linear and at rest.
#[derive(Clone, Debug)]
pub struct Met {
    /// What moves, and the points that hold it.
    pub network: Network,
    /// The MAT that the hand moves.
    pub mat: usize,
    /// Other hands that feel it, through whatever lies between.
    pub others: usize,
}

impl Network {
    /// What a hand on `mat` can reach at a moment, at rest, with every contact closed and every law a spring as stiff as
    /// it gets within `deep` [m]. It is linear: what it does to a small push it does to any.
    ///
    /// `rate` [Hz]: a magic contact is as stiff as its steps are short.
    pub fn met(&self, mat: usize, moment: &Moment, deep: f64, rate: f64) -> Met {
        let is_off = |link: usize| moment.without.contains(&link);
        let is_held = |other: usize| other != mat && moment.held.contains(&other);
        let goes = |other: usize| other == mat || self.mats.kind[other].moves();
        let (mut through, mut own) = (Forest::new(self.n_mat()), Forest::new(self.n_mat()));
        for (_, a, b) in ends(self).filter(|&(link, ..)| !is_off(link)) {
            if goes(a) && goes(b) {
                through.join(a, b);
                if !is_held(a) && !is_held(b) {
                    own.join(a, b);
                }
            }
        }
        let root = through.root(mat);
        let others = moment.held.iter();
        let others = others.filter(|&&other| other != mat && through.root(other) == root);
        let others = others.count();
        let root = own.root(mat);
        let mut is_here: Vec<bool> = (0..self.n_mat()).map(|i| own.root(i) == root).collect();
        let all: Vec<_> = ends(self)
            .filter(|&(link, a, b)| !is_off(link) && (is_here[a] || is_here[b]))
            .collect();
        for &(_, a, b) in &all {
            (is_here[a], is_here[b]) = (true, true);
        }
        let mats: Vec<u32> = (0..self.n_mat() as u32)
            .filter(|&i| is_here[i as usize])
            .collect();
        let links: Vec<u32> = all.iter().map(|&(link, ..)| link as u32).collect();
        let mut found = self.subset(&mats, &[], &links);
        let local = |whole: usize| mats.binary_search(&(whole as u32)).ok();
        for &(whole, tie) in &moment.ties {
            if let Some(mat) = local(whole) {
                found.network.retie(mat, tie);
            }
        }
        for mat in moment.held.iter().filter(|mat| is_held(**mat)) {
            if let Some(mat) = local(*mat) {
                found.network.mats.kind[mat] = MatKind::Sol;
            }
        }
        // A MAT is found where the hand is: it is among its own.
        let hand = local(mat).unwrap_or_default();
        found.network.press(deep, rate, hand);
        for run in &mut found.network.runs {
            let whole = found.links[run.first] as usize;
            let factors = moment.factors.iter().filter(|(link, _)| *link == whole);
            for (_, factor) in factors {
                (run.k, run.z) = (run.k * factor, run.z * factor);
            }
        }
        Met {
            network: found.network,
            mat: hand,
            others,
        }
    }

    fn press(&mut self, deep: f64, rate: f64, hand: usize) {
        let Self {
            mats, runs, parts, ..
        } = self;
        let give = |mat: usize| {
            let is_free = mat != hand && mats.kind[mat].moves();
            if is_free { 1.0 / mats.m[mat] } else { 0.0 }
        };
        for run in runs {
            let is_ca = parts
                .get(run.part)
                .is_some_and(|part| part.ca_rate.is_some());
            let per_mass = if is_ca { 1.0 } else { rate * rate };
            let (k, z) = stiffest(run, deep, give(run.a) + give(run.b), per_mass);
            (run.kind, run.k, run.z, run.rest) = (LinkKind::Ref, k, z, 0.0);
        }
        for values in [&mut mats.rest, &mut mats.x0, &mut mats.v0] {
            values.fill(0.0);
        }
    }

    /// Every number that a simulation of it goes by, as bytes: the same bytes, the same motion.
    pub fn numbers(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(32 * self.n_mat() + 48 * self.runs.len());
        let mut put = |number: u64| bytes.extend(number.to_le_bytes());
        let rate = |part: usize| {
            let rate = self.parts.get(part).and_then(|part| part.ca_rate);
            rate.map_or(0, |rate| rate.hertz().to_bits())
        };
        put(self.n_mat() as u64);
        for i in 0..self.n_mat() {
            let mats = &self.mats;
            put(mats.kind[i] as u64);
            put(rate(mats.part[i] as usize));
            for number in [mats.m[i], mats.k[i], mats.z[i]] {
                put(number.to_bits());
            }
        }
        for run in &self.runs {
            for number in [run.a, run.b, run.len] {
                put(number as u64);
            }
            for number in [rate(run.part), run.k.to_bits(), run.z.to_bits()] {
                put(number);
            }
        }
        bytes
    }
}

fn stiffest(run: &Run, deep: f64, give: f64, per_mass: f64) -> (f64, f64) {
    match &run.kind {
        LinkKind::Ref => (run.k, run.z),
        LinkKind::But(but) if but.contact == Contact::Magic => {
            let mass = if give > 0.0 { 1.0 / give } else { 0.0 };
            let (k, z) = but.exact_restitution();
            (k * mass * per_mass, z * mass * per_mass.sqrt())
        }
        LinkKind::But(but) => {
            let slope = but.exponent * crate::maths::pow(deep, but.exponent - 1.0);
            (run.k * slope, run.z)
        }
        LinkKind::Lnl(law) => {
            let places = (-PLACES..=PLACES).map(|i| deep * f64::from(i) / f64::from(PLACES));
            let slopes = places
                .clone()
                .map(|d| law.slope(d))
                .filter(|k| k.is_finite());
            let drags = places
                .map(|d| law.damping_slope(d))
                .filter(|z| z.is_finite());
            // A law that gives way, or gives energy, is no spring at all.
            (slopes.fold(0.0, f64::max), drags.fold(0.0, f64::max))
        }
    }
}
