//! MATs whose numbers glide while they are stepped.

use super::fine::Fine;
use crate::cell::Ratios;
use crate::maths::{asin, log, sin, sqrt};
use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::timeline::{Lead, Ties, Timeline, next_change};

/// sin²(θ/2) this near to the Nyquist frequency: no recurrence holds an amplitude there.
const NYQUIST: f64 = 0.99;

/// 1/M, κ, ζ and the stiffness of the ground of a MAT, as a frame takes them.
type Numbers = [f64; 4];

/// A MAT on its way from some numbers to others.
#[derive(Clone, Debug)]
pub(super) struct Glide {
    mat: usize,
    /// Frames, rising, and which of the numbers the MAT has there.
    points: Vec<(u64, usize)>,
    numbers: Vec<Numbers>,
    /// ln(θ/sin θ) of each, θ the angle of a step   (as `numbers`)
    bends: Vec<f64>,
}

impl Glide {
    /// The numbers of frame `n`.
    fn at(&self, n: u64) -> Numbers {
        let next = self.points.partition_point(|&(frame, _)| frame <= n);
        let of = |point: usize| self.numbers[self.points[point].1];
        if next == 0 {
            return of(0);
        }
        let (start, before) = self.points[next - 1];
        let Some(&(stop, after)) = self.points.get(next) else {
            return of(next - 1);
        };
        if before == after {
            return of(next);
        }
        let share = (n - start) as f64 / (stop - start) as f64;
        let (from, to) = (of(next - 1), of(next));
        let [w, kappa, zeta, ground] = std::array::from_fn(|i| from[i] + (to[i] - from[i]) * share);
        // An oscillation whose pitch changes slowly keeps ω times its square; its samples by this recurrence keep sin θ
        // times it. The poles are moved outwards by what the two differ.
        let bend = (self.bends[after] - self.bends[before]) / (stop - start) as f64;
        [
            w,
            kappa + 0.5 * bend * (zeta - kappa),
            zeta + (1.0 - zeta) * bend,
            ground,
        ]
    }

    /// The first frame, `n` or later, at which the numbers may change.
    pub(super) fn due(&self, n: u64) -> u64 {
        next_change(&self.points, n)
    }
}

impl Led {
    /// The first frame, `n` or later, at which K and Z may change.
    pub(super) fn due(&self, n: u64) -> u64 {
        self.lead.due(n)
    }
}

/// The glides of an island.
pub(super) fn glides(
    network: &Network,
    timeline: &Timeline,
    scheme: &Scheme,
) -> Result<Vec<Glide>, Error> {
    let (mut found, mut ties): (Vec<Glide>, Vec<Vec<Option<Ties>>>) = (Vec::new(), Vec::new());
    for glide in &timeline.glides {
        let mut own: Vec<Option<Ties>> = Vec::new();
        let mut points = Vec::with_capacity(glide.points.len());
        for &(frame, ties) in glide.points.iter() {
            let known = own.iter().position(|other| *other == ties);
            let index = known.unwrap_or_else(|| {
                own.push(ties);
                own.len() - 1
            });
            points.push((frame, index));
        }
        found.push(Glide {
            mat: glide.mat,
            points,
            numbers: Vec::with_capacity(own.len()),
            bends: Vec::with_capacity(own.len()),
        });
        ties.push(own);
    }
    let mut refused = Vec::new();
    // One scheme tells one number of every MAT.
    for round in 0..ties.iter().map(Vec::len).max().unwrap_or(0) {
        let here = || found_at(&ties, round);
        let mut other = network.clone();
        for (at, own) in here() {
            if let Some(own) = own {
                other.retie(found[at].mat, own);
            }
        }
        let other = match Scheme::new(&other, timeline.rate) {
            Ok(other) => other,
            Err(error) => {
                refused.push(error);
                continue;
            }
        };
        for (at, own) in here() {
            let scheme = if own.is_some() { &other } else { scheme };
            let glide = &mut found[at];
            let mat = glide.mat;
            let (kappa, zeta) = (scheme.kappa[mat], scheme.zeta[mat]);
            let part = network.mats().part[mat] as usize;
            let is_ca = network
                .parts()
                .get(part)
                .is_some_and(|part| part.ca_rate.is_some());
            let bend = if is_ca {
                0.0
            } else {
                bend(Ratios { kappa, zeta })
            };
            glide.bends.push(bend);
            glide
                .numbers
                .push([scheme.w[mat], kappa, zeta, scheme.ground[mat]]);
        }
    }
    if let Some(refused) = Error::of(refused) {
        return Err(refused);
    }
    Ok(found)
}

/// ln(θ/sin θ) of an oscillation of angle θ a step; 0 where there is none.
fn bend(own: Ratios) -> f64 {
    let root = sqrt(1.0 - own.zeta);
    let loss = own.zeta / (1.0 + root);
    let half = (own.kappa - loss * loss) / (4.0 * root);
    if !(half > 0.0 && half < NYQUIST) {
        return 0.0;
    }
    let theta = 2.0 * asin(sqrt(half));
    log(theta / sin(theta))
}

/// The parameters of one round, by the number of the glide.
fn found_at(
    ties: &[Vec<Option<Ties>>],
    round: usize,
) -> impl Iterator<Item = (usize, Option<Ties>)> + '_ {
    let some = ties.iter().enumerate();
    some.filter_map(move |(at, own)| own.get(round).map(|own| (at, *own)))
}

/// The numbers of frame `n` into `now`; what is mute stays so.
pub(super) fn turn(glides: &[Glide], own: &Scheme, now: &mut Scheme, n: u64) {
    for glide in glides.iter().filter(|glide| own.w[glide.mat] != 0.0) {
        let mat = glide.mat;
        let numbers = glide.at(n);
        [now.w[mat], now.kappa[mat], now.zeta[mat], now.ground[mat]] = numbers;
    }
}

/// 1/M of masses that follow MATs, where these are at `x` [m], into `now`; what is mute stays so.
pub(super) fn weigh(own: &Scheme, now: &mut Scheme, x: &[f64]) {
    for mass in &own.following_masses {
        if now.w[mass.mat] != 0.0 {
            now.w[mass.mat] = own.w[mass.mat] * mass.lightness(|mat| x[mat]);
        }
    }
}

/// The numbers of frame `n` and of the next for what goes on between them.
pub(super) fn between(glides: &[Glide], own: &Scheme, fine: &mut Fine, n: u64) {
    for glide in glides.iter().filter(|glide| own.w[glide.mat] != 0.0) {
        let numbers = [n, n + 1].map(|n| glide.at(n));
        fine.glide(
            glide.mat,
            numbers.map(|[w, kappa, zeta, _]| [w, kappa, zeta]),
        );
    }
}

/// Links whose K and Z are led.
#[derive(Clone, Debug)]
pub(super) struct Led {
    lead: Lead,
    place: Place,
}

/// Where their run is.
#[derive(Clone, Copy, Debug)]
enum Place {
    Run(usize),
    Exact(usize),
    /// A contact or a law that is computed finely.
    Fine,
}

/// The runs of a scheme that are led; their K and Z are numbers from now on.
pub(super) fn led(scheme: &mut Scheme, network: &Network, timeline: &Timeline) -> Vec<Led> {
    let mut found = Vec::new();
    for lead in &timeline.leads {
        for run in network
            .runs()
            .iter()
            .filter(|run| lead.links().contains(&run.first))
        {
            let at =
                |runs: &[crate::scheme::Run]| runs.iter().position(|own| own.first == run.first);
            let place = if let Some(at) = at(&scheme.runs) {
                scheme.runs[at].set_loose();
                Place::Run(at)
            } else {
                at(&scheme.exact).map_or(Place::Fine, Place::Exact)
            };
            let lead = lead.on(run.first, run.len);
            found.push(Led { lead, place });
        }
    }
    found
}

/// K and Z of frame `n` into `now`.
pub(super) fn lead(all: &[Led], own: &Scheme, now: &mut Scheme, fine: &mut Option<Fine>, n: u64) {
    for Led { lead, place } in all {
        let (own, now) = match *place {
            Place::Run(at) => (&own.runs[at], &mut now.runs[at]),
            Place::Exact(at) => (&own.exact[at], &mut now.exact[at]),
            Place::Fine => {
                if let Some(fine) = fine {
                    fine.lead(lead.link, [lead.at(n, 0.0), lead.at(n + 1, 0.0)]);
                }
                continue;
            }
        };
        let [of_k, of_z] = lead.at(n, 0.0);
        (now.k, now.z) = (own.k * of_k, own.z * of_z);
    }
}
