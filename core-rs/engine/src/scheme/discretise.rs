//! SI parameters → algorithmic ones: M = m/T², K = k, Z = z/T; a CEL by its exact poles.

use std::sync::Arc;

use super::{FusedSprings, LinkRun, LinkRunKind, Scheme};
use crate::cell::{self, Cell, CellRatios};
use crate::law::Law;
use crate::network::forest::Forest;
use crate::network::{But, Contact, Error, LinkKind, MatKind, Network, Run as NetworkRun};
use crate::units::Rate;

/// How κ and ζ of a CEL are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TieDiscretisation {
    /// From the poles of its continuous motion, which the CA scheme then has exactly.
    Poles,
    /// From its stiffness and viscosity.
    Physical,
}

pub(super) fn build_scheme(
    network: &Network,
    rate: Rate,
    tie_discretisation: TieDiscretisation,
) -> Result<Scheme, Error> {
    let mut scheme = scheme_without_coefficients(network, rate);
    set_masses(&mut scheme, network, rate, tie_discretisation)?;
    add_links(&mut scheme, network, rate)?;
    scheme.has_coupled_exact_runs = shares_moving_mass(&scheme);
    scheme.equal_ranges = scheme.equal_ranges();
    Ok(scheme)
}

/// A scheme with what does not depend on the rate: MATs that do not move, no links.
fn scheme_without_coefficients(network: &Network, rate: Rate) -> Scheme {
    let n_mats = network.n_mat();
    let mats = network.mats();
    Scheme {
        rate: rate.hertz(),
        kappa: vec![0.0; n_mats],
        zeta: vec![0.0; n_mats],
        w: vec![0.0; n_mats],
        tie_stiffness: mats.k.clone(),
        rest: mats.rest.clone(),
        equal_ranges: Vec::new(),
        weight: mats.weight.clone(),
        part: mats.part.clone(),
        proxies: network.proxies().to_vec(),
        following_masses: network.following_masses().to_vec(),
        fused_springs: FusedSprings::default(),
        runs: Vec::new(),
        exact_runs: Vec::new(),
        has_coupled_exact_runs: false,
        outputs: network.outputs().to_vec(),
        taps: (network.outputs().iter())
            .map(|output| super::taps::taps(network, output))
            .collect(),
        n_lia: network.n_lia(),
        n_parts: network.parts().len(),
        is_linear: (network.runs().iter()).all(|run| matches!(run.kind, LinkKind::Ref)),
    }
}

/// The inverse masses, and κ and ζ of each CEL. Refuses those above half the rate, all at once.
fn set_masses(
    scheme: &mut Scheme,
    network: &Network,
    rate: Rate,
    tie_discretisation: TieDiscretisation,
) -> Result<(), Error> {
    let has_negative_stiffness = mats_with_negative_stiffness(network);
    let mats = network.mats();
    let mut nyquist_errors = Vec::new();
    for i in (0..network.n_mat()).filter(|&i| mats.kind[i].moves()) {
        let (m, k, z) = (mats.m[i], mats.k[i], mats.z[i]);
        let cell_ratios;
        (scheme.w[i], cell_ratios) = match ca_rate(network, mats.part[i] as usize) {
            None if tie_discretisation == TieDiscretisation::Physical || has_negative_stiffness[i] => {
                let w = rate.step() * rate.step() / m;
                let cell_ratios = CellRatios {
                    kappa: k * w,
                    zeta: z * rate.step() / m,
                };
                (w, cell_ratios)
            }
            None => {
                let cell = Cell::new(m, k, z);
                nyquist_errors.extend(check_below_nyquist(network, i, cell.frequency(), rate));
                (rate.step() * rate.step() / m, cell.ratios(rate))
            }
            Some(design_rate) => {
                // The number is M at the part's own rate, so m = M·T²; if `rate` is that rate, the factor is exactly 1.
                let rate_ratio = design_rate.hertz() / rate.hertz();
                let design_ratios = CellRatios {
                    kappa: k / m,
                    zeta: z / m,
                };
                let cell_frequency = design_ratios
                    .pitch(design_rate)
                    .map_or(0.0, |(cell_frequency, _)| cell_frequency);
                nyquist_errors.extend(check_below_nyquist(network, i, cell_frequency, rate));
                (rate_ratio * rate_ratio / m, resampled(design_ratios, design_rate, rate))
            }
        };
        if mats.kind[i] == MatKind::Cel {
            (scheme.kappa[i], scheme.zeta[i]) = (cell_ratios.kappa, cell_ratios.zeta);
        }
    }
    Error::combined(nyquist_errors).map_or(Ok(()), Err)
}

/// The links: those whose force is explicit, and those whose force is solved for, friction last.
fn add_links(scheme: &mut Scheme, network: &Network, rate: Rate) -> Result<(), Error> {
    let mut scratch_slots = ScratchSlots::default();
    let mut dry_runs = Vec::new();
    for run in network.runs() {
        let design_rate = ca_rate(network, run.part);
        // z = Z·T_ca under `ca`; then Z = z/T. Without `ca`, Z = z/T.
        let velocity_factor = rate.hertz() / design_rate.map_or(1.0, Rate::hertz);
        let mut scheme_run = LinkRun {
            kind: scratch_slots.run_kind(&run.kind, velocity_factor),
            a: run.a,
            b: run.b,
            len: run.len,
            first_link: run.first,
            k: run.k,
            z: match run.kind {
                LinkKind::Bristle(_) | LinkKind::Dry(_) => run.z,
                _ => run.z * velocity_factor,
            },
            rest: run.rest,
            gate: None,
        };
        let has_proxy_end = || ends_on_proxy(network, run);
        let target_runs = match &run.kind {
            LinkKind::Dry(_) if has_proxy_end() => return Err(refuse_proxy(network, run)),
            LinkKind::Dry(_) => &mut dry_runs,
            // With a proxy the force is explicit: it has no single mass for which it could be solved.
            LinkKind::But(but) if but.contact == Contact::Exact && !has_proxy_end() => &mut scheme.exact_runs,
            LinkKind::But(but) if but.contact == Contact::Magic => {
                if has_proxy_end() {
                    return Err(refuse_proxy(network, run));
                }
                (scheme_run.k, scheme_run.z) = magic_contact_coefficients(scheme, network, run, *but)?;
                &mut scheme.runs
            }
            _ => &mut scheme.runs,
        };
        target_runs.push(scheme_run);
    }
    scheme.exact_runs.extend(dry_runs);
    Ok(())
}

/// Scratch memory that links share, numbered for each kind by itself.
#[derive(Default)]
struct ScratchSlots {
    laws: Vec<Arc<Law>>,
    n_pairwise: usize,
    n_followed: usize,
}

impl ScratchSlots {
    /// The kind of a link, with its coefficients for one step.
    fn run_kind(&mut self, kind: &LinkKind, velocity_factor: f64) -> LinkRunKind {
        match kind {
            LinkKind::Ref => LinkRunKind::Ref,
            LinkKind::But(but) => LinkRunKind::But(*but),
            LinkKind::Space(space) => LinkRunKind::Space(space.resampled(velocity_factor)),
            LinkKind::Pairwise(pairs) => LinkRunKind::Pairwise {
                pairs: pairs.clone(),
                slot: next_slot(&mut self.n_pairwise),
            },
            LinkKind::Lnl(law) => LinkRunKind::Lnl {
                law: law.clone(),
                velocity_factor,
                slot: self.slot_of(law),
            },
            LinkKind::Followed(followed) => LinkRunKind::Followed {
                law: followed.clone(),
                velocity_factor,
                slot: next_slot(&mut self.n_followed),
            },
            LinkKind::Bristle(bristle) => LinkRunKind::Bristle {
                law: *bristle,
                velocity_factor,
            },
            LinkKind::Dry(dry) => LinkRunKind::Dry {
                law: *dry,
                velocity_factor,
            },
        }
    }

    /// Runs that share a law share its scratch memory.
    fn slot_of(&mut self, law: &Arc<Law>) -> usize {
        let known_index = self.laws.iter().position(|known_law| Arc::ptr_eq(known_law, law));
        known_index.unwrap_or_else(|| {
            self.laws.push(law.clone());
            self.laws.len() - 1
        })
    }
}

/// The count before it is increased by one.
fn next_slot(count: &mut usize) -> usize {
    *count += 1;
    *count - 1
}

/// Stiffness and viscosity of a magic contact, by the masses of its two ends.
fn magic_contact_coefficients(
    scheme: &Scheme,
    network: &Network,
    run: &NetworkRun,
    but: But,
) -> Result<(f64, f64), Error> {
    check_no_other_link(network, run.a, run.first)?;
    check_no_other_link(network, run.b, run.first)?;
    if scheme.w[run.a] + scheme.w[run.b] == 0.0 {
        return Err(Error::Refused {
            module: network.link_name(run.first),
            message: "a magic contact needs an end that moves".to_owned(),
        });
    }
    let reduced_mass = 1.0 / (scheme.w[run.a] + scheme.w[run.b]);
    let (k, z) = but.exact_restitution();
    Ok((k * reduced_mass, z * reduced_mass))
}

/// Whether a mass that moves is an end of several links that are solved for.
fn shares_moving_mass(scheme: &Scheme) -> bool {
    let mut exact_ends: Vec<usize> = scheme.exact_runs.iter().flat_map(|run| [run.a, run.b]).collect();
    exact_ends.sort_unstable();
    let end_pairs = &mut exact_ends.windows(2);
    end_pairs.any(|pair| pair[0] == pair[1] && scheme.w[pair[0]] > 0.0)
}

/// MATs of bodies in which some tie or spring has a negative stiffness, as in those of MODES. Such stiffnesses cancel
/// others, and would not if a tie were discretised by its own poles   (n_mat).
fn mats_with_negative_stiffness(network: &Network) -> Vec<bool> {
    let mut joined_mats = Forest::new(network.n_mat());
    let springs = network.runs().iter();
    let springs = springs.filter(|run| run.kind == LinkKind::Ref && run.len == 1);
    let mut negative_mats: Vec<usize> = Vec::new();
    for run in springs {
        if network.mats().part[run.a] == network.mats().part[run.b] {
            joined_mats.join(run.a, run.b);
        }
        if run.k < 0.0 {
            negative_mats.push(run.a);
        }
    }
    let tie_stiffness = network.mats().k.iter().enumerate();
    negative_mats.extend(tie_stiffness.filter(|&(_, &k)| k < 0.0).map(|(mat, _)| mat));
    let mut has_negative_stiffness = vec![false; network.n_mat()];
    for mat in negative_mats {
        has_negative_stiffness[joined_mats.root(mat)] = true;
    }
    (0..has_negative_stiffness.len())
        .map(|mat| has_negative_stiffness[joined_mats.root(mat)])
        .collect()
}

fn ca_rate(network: &Network, part: usize) -> Option<Rate> {
    network.parts().get(part).and_then(|part| part.ca_rate)
}

/// Refuses a CEL above half the rate: its exact poles would be those of its alias, stable but of another pitch.
fn check_below_nyquist(network: &Network, mat: usize, f: f64, rate: Rate) -> Option<Error> {
    (f > 0.5 * rate.hertz()).then(|| Error::Refused {
        module: network.mat_name(mat),
        message: format!(
            "its frequency is {f:.0} Hz, above half the rate of {:.0} Hz; use a higher rate, or a lower f or K",
            rate.hertz()
        ),
    })
}

/// κ and ζ of a discrete CEL at another rate: from its poles if they have a pitch and a decay, else by M = m/T², Z =
/// z/T.
fn resampled(ratios: CellRatios, design_rate: Rate, rate: Rate) -> CellRatios {
    if design_rate.hertz() == rate.hertz() {
        return ratios;
    }
    let rate_ratio = design_rate.hertz() / rate.hertz();
    match ratios.pitch(design_rate) {
        Some((f, t60)) => cell::tune(f, t60.is_finite().then_some(t60), rate),
        None => CellRatios {
            kappa: ratios.kappa * rate_ratio * rate_ratio,
            zeta: ratios.zeta * rate_ratio,
        },
    }
}

/// Whether an end of a run is a proxy.
fn ends_on_proxy(network: &Network, run: &NetworkRun) -> bool {
    let mut end_pairs = (0..run.len).flat_map(|i| run.pairs(i));
    !network.proxies().is_empty() && end_pairs.any(|(a, b)| network.is_proxy(a) || network.is_proxy(b))
}

/// A link that cannot end on a proxy.
fn refuse_proxy(network: &Network, run: &NetworkRun) -> Error {
    Error::Refused {
        module: network.link_name(run.first),
        message:
            "this link must end on a mass, because its force is solved together with that mass; a PROXY stands for \
             several masses"
                .to_owned(),
    }
}

/// A magic contact is exact only if nothing else acts on its two ends.
fn check_no_other_link(network: &Network, mat: usize, link: usize) -> Result<(), Error> {
    let is_tied_cell = network.mats().kind[mat] == MatKind::Cel;
    let has_other_links = is_tied_cell || (network.degree(mat) > 1 && network.mats().kind[mat].moves());
    if has_other_links {
        return Err(Error::Refused {
            module: network.link_name(link),
            message: format!(
                "a magic contact needs {} to have no other link; use contact: exact",
                network.mat_name(mat)
            ),
        });
    }
    Ok(())
}
