//! A linear body: masses, springs and dampers as matrices, and whether its damping is proportional to mass and
//! stiffness.

use crate::body_modes::constants::{MODAL_MASSES_MAX, RELATIVE_TOLERANCE};
use crate::body_modes::viscosity::Viscosity;
use crate::network::{LinkKind, MatKind, Network};
use crate::units::Rate;

/// Why a body has no modes here.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum NoModes {
    /// It has a contact, a law, a proxy, or a mass that follows.
    NotLinear,
    /// A coupling opens and closes in it.
    Gated,
    /// Its parts have different reference rates, or one that is not that of the scene.
    OtherRate,
    /// Its damping is not proportional to stiffness and mass: it would couple the modes.
    Damping,
    /// More than `MODAL_MASSES_MAX`.
    TooLarge,
    /// A number in it is not finite.
    NotFinite,
    /// A mode is so slow that rounding would change its pitch.
    Slow,
    /// A hand, a path, or an ergon of a given mass and speed acts on it.
    Driven,
    /// An output hears a force inside it.
    ForceHeard,
    /// One of its modes grows.
    Diverges,
    /// The given plan selects other modes.
    Pinned,
    /// A link to one of its bodies is too stiff for modes that receive its force once a frame.
    Stiff,
    /// Rounding in its eigenvalue problem would be heard.
    Inexact,
    /// A constant force acts on its masses.
    HasWeight,
    /// Other modules touch so many of its points that complex modes would cost more than stepping it.
    TooManyPorts,
}

impl NoModes {
    const ALL: [Self; 15] = [
        Self::NotLinear,
        Self::Gated,
        Self::OtherRate,
        Self::Damping,
        Self::TooLarge,
        Self::NotFinite,
        Self::Slow,
        Self::Driven,
        Self::ForceHeard,
        Self::Diverges,
        Self::Pinned,
        Self::Stiff,
        Self::Inexact,
        Self::HasWeight,
        Self::TooManyPorts,
    ];

    /// The reason with this text; `None` if there is none.
    pub(crate) fn from_text(text: &str) -> Option<Self> {
        Self::ALL.iter().find(|reason| reason.as_str() == text).cloned()
    }

    /// The reason as text, as a plan reports it.
    pub(crate) fn as_str(&self) -> &'static str {
        match self {
            Self::NotLinear => "it has a contact, a law, a proxy or a mass that follows",
            Self::Gated => "a coupling opens and closes in it",
            Self::OtherRate => "`units: ca` gives its numbers for another rate",
            Self::Damping => "its damping is not proportional to stiffness and mass",
            Self::TooLarge => "it has too many masses for a complete eigenvalue computation",
            Self::NotFinite => "a number in it is not finite",
            Self::Slow => "the frequency of one of its modes is too low to be computed exactly",
            Self::Driven => "a hand, a path or an ergon of its own mass and speed acts on it",
            Self::Diverges => "one of its modes grows",
            Self::Pinned => "the given plan selects other modes",
            Self::Stiff => "a link to its body is too stiff for modes that receive its force once a frame",
            Self::Inexact => "its damping is too strong for its modes to be computed exactly",
            Self::TooManyPorts => {
                "other modules touch so many of its points that modes would cost more than time steps"
            }
            Self::HasWeight => "gravity acts on it",
            Self::ForceHeard => "an output listens to a force inside it",
        }
    }
}

/// M, K and Z of a linear body.
pub(crate) struct Linear {
    /// MATs that move, by their index in the network   (n)
    pub(crate) free: Vec<usize>,
    /// √M   (n)
    pub(crate) sqrt_masses: Vec<f64>,
    /// M^-½ K M^-½ (n, n)
    pub(crate) stiffness: Vec<f64>,
    /// Force on each if all are at x = 0 [N]   (n)
    pub(crate) force: Vec<f64>,
    /// α and β of Z = α·M + β·K; `None` if damping is not proportional.
    pub(crate) proportion: Option<[f64; 2]>,
    /// Its dampers   (as many as there are)
    pub(crate) dampers: Vec<Damper>,
    /// Its damping, if that is not proportional but still has the undamped modes.
    pub(crate) viscosity: Option<Viscosity>,
    /// The discrete network is the reference: M, K, Z are algorithmic.
    pub(crate) is_discrete: bool,
}

/// A damper between two masses, or between one and a fixed point: indices among the masses that move, `None` for a
/// fixed point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Damper {
    pub(crate) ends: [Option<usize>; 2],
    /// [N·s/m]
    pub(crate) z: f64,
}

impl Linear {
    /// The matrices of a network that is one linear body.
    pub(crate) fn new(network: &Network, rate: Rate) -> Result<Self, NoModes> {
        let mats = network.mats();
        let free: Vec<usize> = (0..network.n_mat()).filter(|&i| mats.kind[i].moves()).collect();
        let is_discrete = is_discrete_reference(network, &free, rate)?;
        if free.len() > MODAL_MASSES_MAX {
            return Err(NoModes::TooLarge);
        }
        if free.iter().any(|&mat| mats.weight_of(mat) != 0.0) {
            return Err(NoModes::HasWeight);
        }
        if !network.proxies().is_empty() || network.has_following() {
            return Err(NoModes::NotLinear);
        }
        let free_count = free.len();
        let sqrt_masses: Vec<f64> = free.iter().map(|&i| mats.m[i].sqrt()).collect();
        let (mut damping, mut dampers) = (Damping::default(), Vec::new());
        let mut proportion = Ok(());
        let (mut stiffness, mut force) = (vec![0.0; free_count * free_count], vec![0.0; free_count]);
        let slot_of_mat = |mat: usize| free.binary_search(&mat).ok();
        for run in network.runs() {
            if !matches!(run.kind, LinkKind::Ref) {
                return Err(NoModes::NotLinear);
            }
            proportion = proportion.and_then(|()| damping.link(run.k, run.z));
            for i in 0..run.len {
                let (first_end, second_end) = (run.a + i, run.b + i);
                let (first_slot, second_slot) = (slot_of_mat(first_end), slot_of_mat(second_end));
                if run.z != 0.0 {
                    dampers.push(Damper {
                        ends: [first_slot, second_slot],
                        z: run.z,
                    });
                }
                for (slot, sign) in [(first_slot, 1.0), (second_slot, -1.0)] {
                    let Some(slot) = slot else { continue };
                    stiffness[slot * free_count + slot] += run.k / (sqrt_masses[slot] * sqrt_masses[slot]);
                    let fixed_position = |end: usize, other: Option<usize>| match other {
                        Some(_) => 0.0,
                        None => mats.x0[end],
                    };
                    force[slot] += sign
                        * run.k
                        * (fixed_position(second_end, second_slot) - fixed_position(first_end, first_slot) - run.rest);
                }
                if let (Some(row), Some(column)) = (first_slot, second_slot) {
                    stiffness[row * free_count + column] -= run.k / (sqrt_masses[row] * sqrt_masses[column]);
                    stiffness[column * free_count + row] -= run.k / (sqrt_masses[row] * sqrt_masses[column]);
                }
            }
        }
        for (slot, &i) in free.iter().enumerate() {
            let is_cell = mats.kind[i] == MatKind::Cel;
            let (k, z) = if is_cell { (mats.k[i], mats.z[i]) } else { (0.0, 0.0) };
            stiffness[slot * free_count + slot] += k / mats.m[i];
            force[slot] += k * mats.rest[i];
            proportion = proportion.and_then(|()| damping.mass(mats.m[i], k, z));
            if z != 0.0 {
                dampers.push(Damper {
                    ends: [Some(slot), None],
                    z,
                });
            }
        }
        let proportional = proportion.ok();
        let viscosity = match proportional {
            Some(()) => None,
            None => Viscosity::new(network, &free, &sqrt_masses).filter(|viscosity| viscosity.shares_modes(&stiffness)),
        };
        Ok(Self {
            proportion: proportional.map(|()| [damping.alpha.unwrap_or(0.0), damping.beta.unwrap_or(0.0)]),
            dampers,
            viscosity,
            free,
            sqrt_masses,
            stiffness,
            force,
            is_discrete,
        })
    }
}

/// Whether the discrete network is the reference: for the whole body at the scene's rate, or for none of it.
fn is_discrete_reference(network: &Network, free: &[usize], rate: Rate) -> Result<bool, NoModes> {
    let ca_rate_of = |part: usize| network.parts().get(part).and_then(|part| part.ca_rate);
    let mass_rates = free.iter().map(|&i| ca_rate_of(network.mats().part[i] as usize));
    let mut reference_rates = mass_rates.chain(network.runs().iter().map(|run| ca_rate_of(run.part)));
    let Some(first_rate) = reference_rates.next() else {
        return Ok(false);
    };
    let is_scene_rate = first_rate.is_none_or(|part_rate| part_rate.hertz() == rate.hertz());
    if is_scene_rate && reference_rates.all(|other| other.map(Rate::hertz) == first_rate.map(Rate::hertz)) {
        Ok(first_rate.is_some())
    } else {
        Err(NoModes::OtherRate)
    }
}

/// α and β of Z = α·M + β·K, as far as they have been determined.
#[derive(Default)]
struct Damping {
    alpha: Option<f64>,
    beta: Option<f64>,
}

impl Damping {
    fn link(&mut self, k: f64, z: f64) -> Result<(), NotProportional> {
        if k == 0.0 && z == 0.0 {
            return Ok(());
        }
        let beta = z / k;
        let known_beta = *self.beta.get_or_insert(beta);
        same(known_beta, beta)
    }

    /// Checks a mass and its tie to the ground; to be called after all links.
    fn mass(&mut self, m: f64, k: f64, z: f64) -> Result<(), NotProportional> {
        let beta = self.beta.unwrap_or(0.0);
        let mass_damping = z - beta * k;
        // A difference of two nearly equal numbers is rounding, not damping.
        let mass_damping = if mass_damping.abs() <= RELATIVE_TOLERANCE * z.abs() {
            0.0
        } else {
            mass_damping
        };
        let alpha = mass_damping / m;
        let known_alpha = *self.alpha.get_or_insert(alpha);
        same(known_alpha, alpha)
    }
}

/// Damping that is not proportional to mass and stiffness.
struct NotProportional;

fn same(known: f64, other: f64) -> Result<(), NotProportional> {
    if !known.is_finite() || !other.is_finite() {
        // A damper without a spring.
        return Err(NotProportional);
    }
    if (known - other).abs() <= RELATIVE_TOLERANCE * known.abs().max(other.abs()) {
        Ok(())
    } else {
        Err(NotProportional)
    }
}
