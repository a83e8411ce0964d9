//! The masses, springs and dampers of some parts by themselves, contacts open and laws at their slope at rest.

use super::{LinkKind, MatKind, Network};
use crate::units::Rate;

/// What a link of some parts is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// The spring and damper of a CEL to the ground.
    Tie,
    /// A spring and a damper (REF; RES and FRO where one of the two is 0).
    Ref,
    /// A contact, which is open.
    But,
    /// A law, at its slope at rest.
    Lnl,
    /// A friction with memory, at rest.
    Bristle,
    /// Dry friction, which is left out.
    Dry,
    /// A link in space, which is left out; its ends are their first coordinates.
    Space,
}

/// A spring and damper between two masses, or between one and what is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// What it is.
    pub kind: ElementKind,
    /// Slots of its ends among the masses; `None` is held.
    pub ends: [Option<usize>; 2],
    /// Stiffness at rest [N/m]; of a contact that while it is closed.
    pub k: f64,
    /// Damping at rest [N·s/m].
    pub z: f64,
}

/// Some parts by themselves.
#[derive(Clone, Debug)]
pub struct Elements {
    /// The masses, by their index in the network   (n), rising
    pub mats: Vec<usize>,
    /// M [kg]   (n)
    pub m: Vec<f64>,
    /// All links, also those between points that are held
    pub each: Vec<Element>,
    /// Number of fixed and of imposed points.
    pub n_held: usize,
    /// The rate of the network whose numbers are the truth, of the first of the parts.
    pub ca_rate: Option<Rate>,
}

impl Elements {
    /// Number of links of a kind.
    pub fn count(&self, kind: ElementKind) -> usize {
        self.each.iter().filter(|one| one.kind == kind).count()
    }
}

impl Network {
    /// The masses and links of some parts, with the links between them and without those to others.
    ///
    /// ```
    /// use ergon_engine::Network;
    ///
    /// let mut network = Network::new();
    /// network.part("bell", None);
    /// let (wall, m) = (network.sol("wall", 0.0)?, network.mas("m", 2e-3, 0.0, 0.0)?);
    /// network.spring("s", m, wall, 500.0, 0.01, 0.0)?;
    /// let found = network.elements(&[0]);
    /// assert_eq!((found.m.len(), found.n_held, found.each[0].ends), (1, 1, [Some(0), None]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn elements(&self, parts: &[usize]) -> Elements {
        let own: Vec<u32> = (0..self.n_mat() as u32)
            .filter(|&i| parts.contains(&(self.mats.part[i as usize] as usize)))
            .collect();
        let links: Vec<u32> = (0..self.n_lia() as u32).collect();
        let subset = self.subset(&own, &[], &links);
        let alone = &subset.network;
        let mats = alone.mats();
        let moving: Vec<usize> = (0..alone.n_mat())
            .filter(|&i| mats.kind[i].moves())
            .collect();
        let ties = moving.iter().enumerate();
        let ties = ties.filter(|&(_, &i)| mats.kind[i] == MatKind::Cel);
        let mut each: Vec<Element> = ties
            .map(|(slot, &i)| Element {
                kind: ElementKind::Tie,
                ends: [Some(slot), None],
                k: mats.k[i],
                z: mats.z[i],
            })
            .collect();
        for run in alone.runs() {
            let (kind, k, z) = match &run.kind {
                LinkKind::Ref => (ElementKind::Ref, run.k, run.z),
                LinkKind::But(_) => (ElementKind::But, run.k, run.z),
                LinkKind::Bristle(bristle) => {
                    (ElementKind::Bristle, run.k, bristle.damping_at_rest())
                }
                LinkKind::Dry(_) => (ElementKind::Dry, 0.0, 0.0),
                LinkKind::Space(_) | LinkKind::Pairwise(_) => (ElementKind::Space, run.k, run.z),
                LinkKind::Lnl(law) => (ElementKind::Lnl, law.slope(0.0), law.damping_slope(0.0)),
                // As it is where all that it follows begins.
                LinkKind::Followed(followed) => {
                    let law = followed.at(|mat| mats.x0[mat]);
                    (ElementKind::Lnl, law.slope(0.0), law.damping_slope(0.0))
                }
            };
            let slot = |mat: usize| moving.binary_search(&mat).ok();
            // A link at a point between masses ties none of them alone.
            let ties = |i: &usize| {
                let (a, b) = run.pair(*i, 0);
                !alone.is_proxy(a) && !alone.is_proxy(b)
            };
            each.extend((0..run.len).filter(ties).map(|i| Element {
                kind,
                ends: [slot(run.pair(i, 0).0), slot(run.pair(i, 0).1)],
                k,
                z,
            }));
        }
        Elements {
            m: moving.iter().map(|&i| mats.m[i]).collect(),
            n_held: mats.kind.iter().filter(|kind| kind.is_held()).count(),
            mats: moving.iter().map(|&i| subset.mats[i] as usize).collect(),
            each,
            ca_rate: parts.first().and_then(|&part| self.parts[part].ca_rate),
        }
    }
}
