//! Points that contacts touch: where each goes by itself in a frame, and what impulses move.

use super::basis::Basis;
use crate::cell::Cell;
use crate::island::inside::RunningBody;
use crate::network::{MatKind, Network};
use crate::scheme::Scheme;
use crate::units::Rate;

/// A point that contacts touch.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub(super) mat: usize,
    /// The body that it is a port of, and which port.
    pub(super) port: Option<(usize, usize)>,
    /// Of a MAT that is stepped: its own motion, and where it rests [m].
    pub(super) cell: Option<Cell>,
    pub(super) rest: f64,
    /// Weights of where it is, and of where it goes, at each instant   (n)
    pub(super) way: Vec<(f64, f64)>,
    /// Forces of this frame and of the next [N] that stand for an impulse at each instant [N·s]   (n)
    pub(super) split: Vec<[f64; 2]>,
}

/// The fastest motion of the points: |λ| of e^(λs) [1/frame].
pub(super) fn reach(
    mats: &[usize],
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    rate: Rate,
) -> f64 {
    let own = |mat: usize| {
        let body = bodies.iter().filter_map(RunningBody::modal);
        match body
            .into_iter()
            .find(|body| body.ports().any(|port| port == mat))
        {
            Some(body) => body.reach(),
            None => cell(mat, network, scheme).map_or(0.0, |cell| cell.reach()),
        }
    };
    let all = mats.iter().map(|&mat| own(mat) * rate.step());
    all.fold(0.0, f64::max)
}

fn cell(mat: usize, network: &Network, scheme: &Scheme) -> Option<Cell> {
    let mats = network.mats();
    match mats.kind[mat] {
        _ if scheme.w[mat] == 0.0 => None,
        MatKind::Cel => Some(Cell::new(mats.m[mat], mats.k[mat], mats.z[mat])),
        _ => Some(Cell::new(mats.m[mat], 0.0, 0.0)),
    }
}

pub(super) fn joint(
    mat: usize,
    is_held: bool,
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
) -> Joint {
    let port = bodies.iter().enumerate().find_map(|(owner, playing)| {
        let port = playing.modal()?.ports().position(|port| port == mat)?;
        Some((owner, port))
    });
    let cell = cell(mat, network, scheme).filter(|_| port.is_none() && !is_held);
    let instants = basis.instants.iter();
    let (way, rest) = match &cell {
        Some(cell) => (
            instants
                .clone()
                .map(|&at| cell.interpolation(at, rate))
                .collect(),
            network.mats().rest[mat],
        ),
        None => (instants.clone().map(|&at| (1.0 - at, at)).collect(), 0.0),
    };
    let split = |cell: &Cell| instants.map(|&at| cell.split(1.0, at, rate)).collect();
    Joint {
        mat,
        port,
        rest,
        way,
        split: cell.as_ref().map(split).unwrap_or_default(),
        cell,
    }
}

/// What an impulse at one joint makes of another's way: a row for each polynomial of the impulse's instant, (n, n) [m/N·s], and the
/// velocity at once [m/frame per N·s]. Empty where nothing leads from one to the other within a frame.
pub(super) fn moves(
    (from, to): (&Joint, &Joint),
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
) -> (Vec<f64>, f64) {
    let step = rate.step();
    let table = |answer: &dyn Fn(f64) -> f64| {
        let instants = &basis.instants;
        let pairs = instants
            .iter()
            .flat_map(|from| instants.iter().map(move |to| to - from));
        let values: Vec<f64> = pairs.map(|part| answer(part * step)).collect();
        basis.fit_both(&values)
    };
    match (from.port, to.port) {
        (Some((owner, from)), Some((same, to))) if owner == same => {
            let Some(modal) = bodies[owner].modal() else {
                return (Vec::new(), 0.0);
            };
            let at = |t: f64| modal.response(from, to, t);
            (table(&at), step * modal.jump(from, to))
        }
        (None, None) if from.mat == to.mat => match &from.cell {
            Some(cell) => (table(&|t| cell.answer_around(t)), step * cell.jump()),
            None => (Vec::new(), 0.0),
        },
        _ => (Vec::new(), 0.0),
    }
}
