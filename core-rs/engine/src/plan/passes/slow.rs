//! Slow linear parts of an island: which of their masses go once every R frames, and by what flow.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::DMatrix;

use crate::gesture::script::Touch;
use crate::integrate::flow::{Flow, frame};
use crate::integrate::square::Square;
use crate::interrupt;
use crate::island::slow::Slow;
use crate::maths;
use crate::network::forest::{Forest, ends};
use crate::network::{LinkKind, MatKind, Network, Proxy, Subset, Term};
use crate::plan::passes::body::heard;
use crate::plan::passes::wiring::Body;
use crate::scheme::Scheme;
use crate::timeline::{DriveKind, Timeline};
use crate::units::Rate;

/// More masses than this are hardly cheaper by dense products, and their flow takes seconds to compute.
const MASSES_MAX: usize = 120;
/// A mode that turns further than this between two kicks [rad] is not seen well enough by them.
const TURN_MAX: f64 = 0.9 * PI;
/// Stiffness below this part of the stiffest is rounding: nothing holds a body in such a mode.
const LOOSE: f64 = 1e-12;

/// A part that was to be slow and is not: its name, and why.
pub(in crate::plan) type Stays = (String, String);

/// The slow bodies of a network, and the parts that cannot be slow.
#[derive(Default)]
pub(in crate::plan) struct SlowBodies {
    pub(in crate::plan) bodies: Vec<(Body, Slow)>,
    pub(in crate::plan) stay: Vec<Stays>,
}

/// The slow bodies of a network, by its parts' own rates.
pub(in crate::plan) fn slow(network: &Network, timeline: &Timeline) -> SlowBodies {
    let mut found = SlowBodies::default();
    for (part, own) in network.parts().iter().enumerate() {
        let is_here = || network.mats().part.contains(&(part as u32));
        let Some(every) = own.macrostep.filter(|_| is_here()) else {
            continue;
        };
        match held_fast(network, timeline, part) {
            Some(why) => found.stay.push((own.name.clone(), why.to_owned())),
            None => match bodies(network, timeline, part, every) {
                Ok(bodies) => found.bodies.extend(bodies),
                Err(why) => found.stay.push((own.name.clone(), why)),
            },
        }
    }
    found
}

/// What a hand asks of a key at every frame, if it does.
fn held_fast(network: &Network, timeline: &Timeline, part: usize) -> Option<&'static str> {
    let of = |key: usize| network.mats().part[timeline.keys[key].struck] as usize;
    let mut own = timeline
        .gestures
        .iter()
        .filter(|gesture| of(gesture.key) == part);
    own.find_map(|gesture| match gesture.manner.touch {
        Touch::Tracked => Some("a gesture with `touch: tracked` moves it at every frame"),
        Touch::Open if gesture.manner.limit.is_some() => {
            Some("its force limit is checked at every frame")
        }
        Touch::Open => None,
    })
}

/// The bodies of a part, or why it has none.
fn bodies(
    network: &Network,
    timeline: &Timeline,
    part: usize,
    every: u32,
) -> Result<Vec<(Body, Slow)>, String> {
    let wired = wired(network, timeline, part);
    if wired.is_empty() {
        return Err("no mass in it is held by linear springs alone".to_owned());
    }
    let strikes = timeline.strikes.iter().map(|strike| strike.mat);
    let ergons = timeline.ergons.iter().map(|ergon| ergon.mat);
    let struck: BTreeSet<u32> = strikes.chain(ergons).collect();
    // A session may strike any of it.
    let is_struck = |mat: usize| timeline.is_open || struck.contains(&(mat as u32));
    let slow = |body: Body| {
        let slow = Slow::of(network, timeline.rate, (part, every), &body, is_struck)?;
        Ok((body, slow))
    };
    wired.into_iter().map(slow).collect()
}

/// Masses of a part that springs of its own join or tie to the ground, each set with the masses that
/// anything else touches.
fn wired(network: &Network, timeline: &Timeline, part: usize) -> Vec<Body> {
    let mats = network.mats();
    let n = network.n_mat();
    let is_own = |mat: usize| mats.part[mat] as usize == part;
    let mut may: Vec<bool> = (0..n).map(|i| is_own(i) && mats.kind[i].moves()).collect();
    let mut is_port = vec![false; n];
    let mut is_inner = vec![false; network.n_lia()];
    for run in network.runs().iter().filter(|run| run.part == part) {
        is_inner[run.first..run.first + run.len].fill(matches!(run.kind, LinkKind::Ref));
    }
    timeline
        .gates
        .iter()
        .for_each(|gate| is_inner[gate.links()].fill(false));
    timeline
        .leads
        .iter()
        .for_each(|lead| is_inner[lead.links()].fill(false));
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        match *term {
            Term::Force { first, len, .. } => is_inner[first..first + len].fill(false),
            Term::Ground { first, len, .. } => may[first..first + len].fill(false),
            Term::Position { .. } | Term::Length { .. } => {}
        }
    }
    let mut is_driven = vec![false; n];
    for drive in &timeline.drives {
        is_driven[drive.mat] = true;
        match drive.kind {
            DriveKind::Position => may[drive.mat] = false,
            DriveKind::Force => is_port[drive.mat] = true,
        }
    }
    timeline
        .glides
        .iter()
        .for_each(|glide| may[glide.mat] = false);
    let masses = network.following_masses().iter();
    masses.for_each(|mass| may[mass.mat] = false);
    let strikes = timeline.strikes.iter().map(|strike| strike.mat as usize);
    let ergons = timeline.ergons.iter().map(|ergon| ergon.mat as usize);
    let keys = timeline.keys.iter().map(|key| key.struck);
    strikes
        .chain(ergons)
        .chain(keys)
        .for_each(|mat| is_port[mat] = true);

    if timeline.is_open {
        is_port.fill(true);
    }
    let proxied = network.proxies().iter().flat_map(Proxy::masses);
    let guides = network.followed().map(|(_, guide)| guide);
    proxied.chain(guides).for_each(|mat| is_port[mat] = true);
    let is_held = |mat: usize| is_own(mat) && mats.kind[mat].is_held() && !is_driven[mat];
    let mut forest = Forest::new(n);
    for (link, a, b) in ends(network) {
        if is_inner[link] && may[a] && may[b] {
            forest.join(a, b);
        }
    }
    let mut bodies: BTreeMap<usize, Body> = BTreeMap::new();
    for mat in (0..n).filter(|&mat| may[mat]) {
        let body = bodies.entry(forest.root(mat)).or_insert_with(Body::empty);
        body.mats.push(mat as u32);
        if is_port[mat] {
            body.ports.push(mat as u32);
        }
    }
    for (link, a, b) in ends(network) {
        for (own, other) in [(a, b), (b, a)].into_iter().filter(|&(own, _)| may[own]) {
            let Some(body) = bodies.get_mut(&forest.root(own)) else {
                continue;
            };
            if is_inner[link] && (may[other] || is_held(other)) {
                body.links.push(link as u32);
                if is_held(other) {
                    body.guests.push(other as u32);
                }
            } else {
                body.ports.push(own as u32);
            }
        }
    }
    let is_tied = |&mat: &u32| mats.kind[mat as usize] == MatKind::Cel;
    let is_slow = |body: &Body| !body.links.is_empty() || body.mats.iter().any(is_tied);
    bodies
        .into_values()
        .map(Body::tidy)
        .filter(is_slow)
        .collect()
}

impl Slow {
    fn of(
        network: &Network,
        rate: Rate,
        (part, every): (usize, u32),
        body: &Body,
        is_struck: impl Fn(usize) -> bool,
    ) -> Result<Self, String> {
        let n = body.mats.len();
        if n > MASSES_MAX {
            return Err(format!(
                "{n} of its masses are connected; above {MASSES_MAX}, a slow rate costs more than the audio rate"
            ));
        }
        let is_discrete = network.parts()[part].ca_rate.is_some();
        let subset = network.subset(&body.mats, &body.guests, &body.links);
        let scheme = if is_discrete {
            Scheme::new(&subset.network, rate)
        } else {
            Scheme::physical(&subset.network, rate)
        };
        let scheme = scheme.map_err(|error| error.to_string())?;
        let own = Matrices::new(&subset, &scheme, body);
        let modes = own.modes();
        let top = modes.eigenvalues.iter().fold(0.0_f64, |top, x| top.max(*x));
        let turn = f64::from(every)
            * if is_discrete {
                2.0 * maths::asin((0.5 * top.sqrt()).min(1.0))
            } else {
                top.sqrt()
            };
        let too_fast = || {
            let hertz = turn / f64::from(every) * rate.hertz() / (2.0 * PI);
            format!("its highest mode is at {hertz:.0} Hz, too high for that rate")
        };
        // A number that is none is no turn within it.
        if !matches!(turn.partial_cmp(&TURN_MAX), Some(std::cmp::Ordering::Less)) {
            return Err(too_fast());
        }
        let frame = frame(&own.k, &own.z, is_discrete);
        let flow = Flow::new(&frame, every).ok_or_else(too_fast)?;
        let outputs = heard(&subset.network).map_err(|why| why.why().to_owned())?;
        let slot = |mat: usize| own.free.binary_search(&mat).ok();
        let rows = outputs.rows.into_iter().map(|row| {
            let own = row
                .into_iter()
                .filter_map(|(mat, weight)| Some((slot(mat)?, weight)));
            own.collect()
        });
        let ports: Vec<(usize, usize)> = body
            .ports
            .iter()
            .filter_map(|&mat| Some((slot(subset.mat(mat as usize)?)?, mat as usize)))
            .collect();
        let is_port = |own: usize| ports.iter().any(|port| port.0 == own);
        let missing = |&(own, mat): &(usize, usize)| {
            if is_struck(mat) {
                missing(&flow, &frame, own, is_discrete)
            } else {
                Vec::new()
            }
        };
        let mats = subset.network.mats();
        Ok(Self {
            part,
            missing: ports.iter().map(missing).collect(),
            turn,
            rest: own.rest(&modes.eigenvalues, &modes.eigenvectors),
            x0: own.free.iter().map(|&i| mats.x0[i]).collect(),
            v0: own.free.iter().map(|&i| mats.v0[i] * rate.step()).collect(),
            inner: (0..n).filter(|&own| !is_port(own)).collect(),
            is_inner: (0..n)
                .map(|own| f64::from(u8::from(!is_port(own))))
                .collect(),
            heard: subset.outputs.iter().copied().zip(rows).collect(),
            w: own.w,
            free: own.free,
            flow: Arc::new(flow),
            is_discrete,
            ports,
            network: Arc::new(subset.network),
        })
    }
}

/// What pushes of a mass at each frame between two kicks leave undone.
fn missing(flow: &Flow, frame: &Square, own: usize, is_discrete: bool) -> Vec<[Vec<f64>; 2]> {
    let n = flow.keep.n;
    let mut moved = vec![0.0; 2 * n];
    moved[n + own] = 1.0;
    // The CA network has moved on by a push at the very next frame; motion follows it from where it is.
    if is_discrete {
        moved[own] = 1.0;
    } else {
        moved = frame.apply(&moved);
    }
    let mut found = Vec::new();
    for frames in 1..=flow.macrostep {
        interrupt::poll();
        found.push(flow.missing(own, frames, &moved));
        moved = frame.apply(&moved);
    }
    found.reverse();
    found
}

/// What holds masses together, in units of a frame.
struct Matrices {
    /// MATs that move, by their index in the subset.
    free: Vec<usize>,
    w: Vec<f64>,
    /// M⁻¹K and M⁻¹Z   (n, n)
    k: Square,
    z: Square,
    /// Force where all are at 0 [N]   (n)
    force: Vec<f64>,
}

impl Matrices {
    fn new(subset: &Subset, scheme: &Scheme, body: &Body) -> Self {
        let mats = subset.network.mats();
        let free: Vec<usize> = body
            .mats
            .iter()
            .filter_map(|&mat| subset.mat(mat as usize))
            .collect();
        let n = free.len();
        let slot = |mat: usize| free.binary_search(&mat).ok();
        let w: Vec<f64> = free.iter().map(|&i| scheme.w[i]).collect();
        let (mut k, mut z, mut force) = (Square::zero(n), Square::zero(n), vec![0.0; n]);
        for (own, &i) in free.iter().enumerate() {
            *k.at(own, own) += scheme.kappa[i];
            *z.at(own, own) += scheme.zeta[i];
            force[own] += scheme.kappa[i] / w[own] * scheme.rest[i];
        }
        for run in &scheme.runs {
            for i in 0..run.len {
                let pair = [(run.a + i, run.b + i, 1.0), (run.b + i, run.a + i, -1.0)];
                for (own, other, sign) in pair {
                    let Some(row) = slot(own) else { continue };
                    *k.at(row, row) += w[row] * run.k;
                    *z.at(row, row) += w[row] * run.z;
                    force[row] -= sign * run.k * run.rest;
                    match slot(other) {
                        Some(column) => {
                            *k.at(row, column) -= w[row] * run.k;
                            *z.at(row, column) -= w[row] * run.z;
                        }
                        None => force[row] += run.k * mats.x0[other],
                    }
                }
            }
        }
        Self {
            free,
            w,
            k,
            z,
            force,
        }
    }

    /// Modes of M^-½ K M^-½.
    fn modes(&self) -> nalgebra::SymmetricEigen<f64, nalgebra::Dyn> {
        let n = self.w.len();
        let root: Vec<f64> = self.w.iter().map(|w| w.sqrt()).collect();
        let entry = |row: usize, column: usize| self.k.get(row, column) * root[column] / root[row];
        // Rounding has made it a little unsymmetric.
        let even = |row, column| 0.5 * (entry(row, column) + entry(column, row));
        DMatrix::from_fn(n, n, even).symmetric_eigen()
    }

    /// Where the springs balance: K·x = force, and x = 0 along what nothing holds.
    fn rest(&self, values: &nalgebra::DVector<f64>, vectors: &DMatrix<f64>) -> Vec<f64> {
        let n = self.w.len();
        let mut rest = vec![0.0; n];
        if self.force.iter().all(|force| *force == 0.0) {
            return rest;
        }
        let root: Vec<f64> = self.w.iter().map(|w| w.sqrt()).collect();
        let top = values.iter().fold(0.0_f64, |top, x| top.max(*x));
        for (mode, &value) in values
            .iter()
            .enumerate()
            .filter(|(_, value)| **value > LOOSE * top)
        {
            let share: f64 = (0..n)
                .map(|i| vectors[(i, mode)] * root[i] * self.force[i])
                .sum();
            for (i, rest) in rest.iter_mut().enumerate() {
                *rest += vectors[(i, mode)] * root[i] * (share / value);
            }
        }
        rest
    }
}
