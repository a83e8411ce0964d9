//! Masses, springs and dampers of some parts without the rest of the network; contacts are open, and laws have their
//! slope at rest.

use super::{LinkKind, MatKind, Network};
use crate::interrupt;
use crate::units::Rate;

/// Kind of a link of some parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// The spring and damper of a CEL to the ground.
    Tie,
    /// A spring and a damper (REF; RES or FRO if one of the two is 0).
    Ref,
    /// A contact, taken as open.
    But,
    /// A law, taken at its slope at rest.
    Lnl,
    /// Friction with memory, taken at rest.
    Bristle,
    /// Dry friction: listed, but left out of modes and admittances.
    Dry,
    /// A link in space: listed, but left out of modes and admittances. Its ends are their first coordinates.
    Space,
}

/// A spring and damper between two masses, or between a mass and a held point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// What it is.
    pub kind: ElementKind,
    /// Slots of its ends among the masses; `None` for a held point.
    pub ends: [Option<usize>; 2],
    /// Stiffness at rest [N/m]; for a contact, while it is closed.
    pub k: f64,
    /// Damping at rest [N·s/m]; for a contact, while it is closed.
    pub z: f64,
}

/// The masses and links of some parts.
#[derive(Clone, Debug)]
pub struct Elements {
    /// The masses, by their index in the network   (n), rising
    pub mats: Vec<usize>,
    /// M [kg]   (n)
    pub masses: Vec<f64>,
    /// All links, including those between held points
    pub elements: Vec<Element>,
    /// Number of fixed and of imposed points.
    pub n_held: usize,
    /// Rate of the discrete network that defines the first of the parts; `None` if that part is continuous.
    pub ca_rate: Option<Rate>,
}

impl Elements {
    /// Number of links of a kind.
    pub fn count(&self, kind: ElementKind) -> usize {
        self.elements.iter().filter(|element| element.kind == kind).count()
    }
}

impl Network {
    /// The masses and links of `parts`, including links between these parts, but not links to other parts.
    ///
    /// ```
    /// use ergon_engine::Network;
    ///
    /// let mut network = Network::new();
    /// network.part("bell", None);
    /// let (wall, m) = (network.sol("wall", 0.0)?, network.mas("m", 2e-3, 0.0, 0.0)?);
    /// network.spring("s", m, wall, 500.0, 0.01, 0.0)?;
    /// let bell = network.elements(&[0]);
    /// assert_eq!((bell.masses.len(), bell.n_held, bell.elements[0].ends), (1, 1, [Some(0), None]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn elements(&self, parts: &[usize]) -> Elements {
        let part_mats: Vec<u32> = interrupt::steps(0..self.n_mat())
            .filter(|&i| parts.contains(&(self.mats.part[i] as usize)))
            .map(|i| i as u32)
            .collect();
        let all_links: Vec<u32> = (0..self.n_lia() as u32).collect();
        let parts_subset = self.subset(&part_mats, &[], &all_links);
        let parts_network = &parts_subset.network;
        let mats = parts_network.mats();
        let moving_mats: Vec<usize> = (0..parts_network.n_mat()).filter(|&i| mats.kind[i].moves()).collect();
        let tie_elements = moving_mats.iter().enumerate();
        let tie_elements = tie_elements.filter(|&(_, &i)| mats.kind[i] == MatKind::Cel);
        let mut elements: Vec<Element> = tie_elements
            .map(|(moving_slot, &i)| Element {
                kind: ElementKind::Tie,
                ends: [Some(moving_slot), None],
                k: mats.k[i],
                z: mats.z[i],
            })
            .collect();
        for run in parts_network.runs() {
            let (kind, k, z) = match &run.kind {
                LinkKind::Ref => (ElementKind::Ref, run.k, run.z),
                LinkKind::But(_) => (ElementKind::But, run.k, run.z),
                LinkKind::Bristle(bristle) => (ElementKind::Bristle, run.k, bristle.damping_at_rest()),
                LinkKind::Dry(_) => (ElementKind::Dry, 0.0, 0.0),
                LinkKind::Space(_) | LinkKind::Pairwise(_) => (ElementKind::Space, run.k, run.z),
                LinkKind::Lnl(law) => (ElementKind::Lnl, law.slope(0.0), law.damping_slope(0.0)),
                // The law at the initial positions of the MATs that it follows.
                LinkKind::Followed(followed) => {
                    let law = followed.law_for(|mat| mats.x0[mat]);
                    (ElementKind::Lnl, law.slope(0.0), law.damping_slope(0.0))
                }
            };
            let moving_slot = |mat: usize| moving_mats.binary_search(&mat).ok();
            // A link to a proxy acts on several masses at once, so it is left out.
            let avoids_proxies = |i: &usize| {
                let (first_mat, second_mat) = run.pair(*i, 0);
                !parts_network.is_proxy(first_mat) && !parts_network.is_proxy(second_mat)
            };
            elements.extend(interrupt::steps(0..run.len).filter(avoids_proxies).map(|i| Element {
                kind,
                ends: [moving_slot(run.pair(i, 0).0), moving_slot(run.pair(i, 0).1)],
                k,
                z,
            }));
        }
        Elements {
            masses: moving_mats.iter().map(|&i| mats.m[i]).collect(),
            n_held: mats.kind.iter().filter(|kind| kind.is_held()).count(),
            mats: moving_mats.iter().map(|&i| parts_subset.mats[i] as usize).collect(),
            elements,
            ca_rate: parts.first().and_then(|&part| self.parts[part].ca_rate),
        }
    }
}
