//! The part of a network that a hand can move, linearised at the greatest stiffness that the hand can meet.

use super::{Contact, LinkKind, MatKind, Network, Run};
use crate::law::Law;
use crate::network::forest::{Forest, link_mats};

/// Contacts and hardening laws are linearised for penetrations up to this depth [m].
pub const PRESS_DEPTH: f64 = 1e-3;
/// Number of places on either side of rest at which the slope of a law is evaluated.
const SLOPE_PLACES: i32 = 16;

/// How a network differs from its state at rest at one moment of a piece.
#[derive(Clone, Debug, Default)]
pub struct NetworkMoment {
    /// MATs that other hands hold.
    pub held_mats: Vec<usize>,
    /// Links that are switched off.
    pub disabled_links: Vec<usize>,
    /// K, Z and M of MATs that glide.
    pub ties: Vec<(usize, [f64; 3])>,
    /// Factors of links whose force glides.
    pub link_factors: Vec<(usize, f64)>,
}

/// The part of a network that a hand can move: linear, at rest, with all contacts closed.
#[derive(Clone, Debug)]
pub struct ReachableNetwork {
    /// The MATs that move, and the fixed points that they are linked to.
    pub network: Network,
    /// The MAT that the hand moves.
    pub mat: usize,
    /// Number of other hands that are linked to it.
    pub n_other_hands: usize,
}

impl Network {
    /// The part of the network that a hand on `mat` can move at a moment, with every contact closed and every law
    /// replaced by its stiffest spring within `depth` [m].
    ///
    /// `rate` [Hz] sets the stiffness of magic contacts, which depends on the length of a step.
    pub fn reachable_network(&self, mat: usize, moment: &NetworkMoment, depth: f64, rate: f64) -> ReachableNetwork {
        let is_removed = |link: usize| moment.disabled_links.contains(&link);
        let is_held_still = |other: usize| other != mat && moment.held_mats.contains(&other);
        let can_move = |other: usize| other == mat || self.mats.kind[other].moves();
        let (mut joined_mats, mut components) = (Forest::new(self.n_mat()), Forest::new(self.n_mat()));
        for (_, mats) in link_mats(self).filter(|&(link, _)| !is_removed(link)) {
            // A link in space joins all coordinates of its points.
            let mut movable = mats.as_slice().iter().copied().filter(|&mat| can_move(mat));
            let Some(first_movable) = movable.next() else {
                continue;
            };
            let mut first_of = (!is_held_still(first_movable)).then_some(first_movable);
            for other in movable {
                joined_mats.join(first_movable, other);
                if !is_held_still(other) {
                    components.join(*first_of.get_or_insert(other), other);
                }
            }
        }
        let hand_root = joined_mats.root(mat);
        let linked_hands = moment.held_mats.iter();
        let linked_hands = linked_hands.filter(|&&other| other != mat && joined_mats.root(other) == hand_root);
        let n_other_hands = linked_hands.count();
        let hand_root = components.root(mat);
        let mut is_reached: Vec<bool> = (0..self.n_mat()).map(|i| components.root(i) == hand_root).collect();
        let links_reached: Vec<_> = link_mats(self)
            .filter(|(link, mats)| !is_removed(*link) && mats.as_slice().iter().any(|&mat| is_reached[mat]))
            .collect();
        for mat in links_reached.iter().flat_map(|(_, mats)| mats.as_slice()) {
            is_reached[*mat] = true;
        }
        let mats: Vec<u32> = (0..self.n_mat() as u32).filter(|&i| is_reached[i as usize]).collect();
        let link_numbers: Vec<u32> = links_reached.iter().map(|&(link, _)| link as u32).collect();
        let mut reached = self.subset(&mats, &[], &link_numbers);
        let local_mat = |global_index: usize| mats.binary_search(&(global_index as u32)).ok();
        for &(global_index, tie) in &moment.ties {
            if let Some(mat) = local_mat(global_index) {
                reached.network.set_tie(mat, tie);
            }
        }
        for mat in moment.held_mats.iter().filter(|mat| is_held_still(**mat)) {
            if let Some(mat) = local_mat(*mat) {
                reached.network.mats.kind[mat] = MatKind::Sol;
            }
        }
        // The MAT of the hand always belongs to them.
        let hand_mat = local_mat(mat).unwrap_or_default();
        reached.network.linearise(depth, rate, hand_mat);
        for run in &mut reached.network.runs {
            let global_index = reached.links[run.first] as usize;
            let factors = moment.link_factors.iter().filter(|(link, _)| *link == global_index);
            for (_, factor) in factors {
                (run.k, run.z) = (run.k * factor, run.z * factor);
            }
        }
        ReachableNetwork {
            network: reached.network,
            mat: hand_mat,
            n_other_hands,
        }
    }

    fn linearise(&mut self, depth: f64, rate: f64, hand: usize) {
        let Self { mats, runs, parts, .. } = self;
        let inverse_mass = |mat: usize| {
            let is_movable = mat != hand && mats.kind[mat].moves();
            if is_movable { 1.0 / mats.m[mat] } else { 0.0 }
        };
        for run in runs {
            let is_ca_part = parts.get(run.part).is_some_and(|part| part.ca_rate.is_some());
            let rate_square = if is_ca_part { 1.0 } else { rate * rate };
            let (k, z) = stiffest_run(run, depth, inverse_mass(run.a) + inverse_mass(run.b), rate_square);
            (run.k, run.z, run.rest) = (k, z, 0.0);
            // A link in space keeps its kind, which acts along all axes: it is nowhere stiffer than along its own line.
            if run.n_axes() == 1 {
                run.kind = LinkKind::Ref;
            }
        }
        mats.weight.clear();
        for values in [&mut mats.rest, &mut mats.x0, &mut mats.v0] {
            values.fill(0.0);
        }
    }

    /// All numbers that determine the motion, as bytes: networks with equal bytes move equally.
    pub fn parameter_bytes(&self) -> Vec<u8> {
        let mut number_bytes = Vec::with_capacity(32 * self.n_mat() + 48 * self.runs.len());
        let mut push_number = |number: u64| number_bytes.extend(number.to_le_bytes());
        let part_rate = |part: usize| {
            let part_rate = self.parts.get(part).and_then(|part| part.ca_rate);
            part_rate.map_or(0, |part_rate| part_rate.hertz().to_bits())
        };
        push_number(self.n_mat() as u64);
        for i in 0..self.n_mat() {
            let mats = &self.mats;
            push_number(mats.kind[i] as u64);
            push_number(part_rate(mats.part[i] as usize));
            for number in [mats.m[i], mats.k[i], mats.z[i]] {
                push_number(number.to_bits());
            }
        }
        for run in &self.runs {
            for number in [run.a, run.b, run.len] {
                push_number(number as u64);
            }
            for number in [part_rate(run.part), run.k.to_bits(), run.z.to_bits()] {
                push_number(number);
            }
        }
        number_bytes
    }
}

/// The greatest stiffness [N/m] of a run within `depth` [m], and its damping [N·s/m].
///
/// `inverse_mass_sum` is the sum of 1/M of both ends [1/kg]; `rate_square` [1/s²], or 1 for a discrete part, converts
/// the algorithmic K of a magic contact.
fn stiffest_run(run: &Run, depth: f64, inverse_mass_sum: f64, rate_square: f64) -> (f64, f64) {
    match &run.kind {
        LinkKind::Ref | LinkKind::Space(_) | LinkKind::Pairwise(_) => (run.k, run.z),
        // Replaced by a spring that reaches F at `depth`.
        LinkKind::Dry(_) => (run.z / depth, 0.0),
        LinkKind::Bristle(bristle) => (run.k, bristle.with_stiffness_and_level(run.k, run.z).steepest_damping()),
        LinkKind::But(but) if but.contact == Contact::Magic => {
            let reduced_mass = if inverse_mass_sum > 0.0 {
                1.0 / inverse_mass_sum
            } else {
                0.0
            };
            let (k, z) = but.exact_restitution();
            (k * reduced_mass * rate_square, z * reduced_mass * rate_square.sqrt())
        }
        LinkKind::But(but) => (but.elastic(run.k).slope(depth), run.z),
        LinkKind::Lnl(law) => stiffest_law(law, depth),
        LinkKind::Followed(followed) => followed
            .end_value_laws()
            .map(|law| stiffest_law(&law, depth))
            .fold((0.0, 0.0), |(k, z), stiffness_and_damping| {
                (stiffness_and_damping.0.max(k), stiffness_and_damping.1.max(z))
            }),
    }
}

fn stiffest_law(law: &Law, depth: f64) -> (f64, f64) {
    let elongations = (-SLOPE_PLACES..=SLOPE_PLACES).map(|i| depth * f64::from(i) / f64::from(SLOPE_PLACES));
    let law_slopes = elongations.clone().map(|d| law.slope(d)).filter(|k| k.is_finite());
    let damping_slopes = elongations.map(|d| law.damping_slope(d)).filter(|z| z.is_finite());
    // A negative slope, which gives way or supplies energy, counts as 0.
    (law_slopes.fold(0.0, f64::max), damping_slopes.fold(0.0, f64::max))
}
