//! SI parameters → algorithmic ones: M = m/T², K = k, Z = z/T; a CEL by its exact poles.

use std::sync::Arc;

use super::{Kind, Run, Scheme};
use crate::cell::{self, Cell, Ratios};
use crate::law::Law;
use crate::network::forest::Forest;
use crate::network::{Contact, Error, LinkKind, MatKind, Network, Run as LinkRun};
use crate::units::Rate;

/// How κ and ζ of a CEL are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ties {
    /// From the poles of its continuous motion, which the CA scheme then has exactly.
    Poles,
    /// From its stiffness and viscosity.
    Physical,
}

pub(super) fn scheme(network: &Network, rate: Rate, ties: Ties) -> Result<Scheme, Error> {
    let n = network.n_mat();
    let mats = network.mats();
    let mut scheme = Scheme {
        rate: rate.hertz(),
        kappa: vec![0.0; n],
        zeta: vec![0.0; n],
        w: vec![0.0; n],
        ground: mats.k.clone(),
        rest: mats.rest.clone(),
        alike: Vec::new(),
        weight: mats.weight.clone(),
        part: mats.part.clone(),
        proxies: network.proxies().to_vec(),
        following_masses: network.following_masses().to_vec(),
        fused: Vec::new(),
        runs: Vec::new(),
        exact: Vec::new(),
        exact_coupled: false,
        outputs: network.outputs().to_vec(),
        taps: (network.outputs().iter())
            .map(|output| super::listen::taps(network, output))
            .collect(),
        n_lia: network.n_lia(),
        n_parts: network.parts().len(),
        linear: true,
    };
    let cancels = cancelling(network);
    let mut too_high = Vec::new();
    for i in (0..n).filter(|&i| mats.kind[i].moves()) {
        let (m, k, z) = (mats.m[i], mats.k[i], mats.z[i]);
        let ratios;
        (scheme.w[i], ratios) = match ca_rate(network, mats.part[i] as usize) {
            None if ties == Ties::Physical || cancels[i] => {
                let w = rate.step() * rate.step() / m;
                let ratios = Ratios {
                    kappa: k * w,
                    zeta: z * rate.step() / m,
                };
                (w, ratios)
            }
            None => {
                let cell = Cell::new(m, k, z);
                too_high.extend(above_nyquist(network, i, cell.frequency(), rate));
                (rate.step() * rate.step() / m, cell.ratios(rate))
            }
            Some(design_rate) => {
                // The number is M at the part's own rate, so m = M·T²; if `rate` is that rate, the factor is exactly 1.
                let step = design_rate.hertz() / rate.hertz();
                let cell = Ratios {
                    kappa: k / m,
                    zeta: z / m,
                };
                let f = cell.pitch(design_rate).map_or(0.0, |(f, _)| f);
                too_high.extend(above_nyquist(network, i, f, rate));
                (step * step / m, resampled(cell, design_rate, rate))
            }
        };
        if mats.kind[i] == MatKind::Cel {
            (scheme.kappa[i], scheme.zeta[i]) = (ratios.kappa, ratios.zeta);
        }
    }
    if let Some(refused) = Error::combined(too_high) {
        return Err(refused);
    }
    let mut laws: Vec<Arc<Law>> = Vec::new();
    let (mut dry_runs, mut n_pairwise, mut n_followed) = (Vec::new(), 0, 0);
    for run in network.runs() {
        let ca = ca_rate(network, run.part);
        // z = Z·T_ca under `ca`; then Z = z/T. Without `ca`, Z = z/T.
        let per_step = rate.hertz() / ca.map_or(1.0, Rate::hertz);
        let mut planned = Run {
            kind: Kind::Ref,
            a: run.a,
            b: run.b,
            len: run.len,
            first: run.first,
            k: run.k,
            z: run.z * per_step,
            rest: run.rest,
            gate: None,
        };
        match &run.kind {
            LinkKind::Ref => scheme.runs.push(planned),
            LinkKind::Space(space) => {
                scheme.linear = false;
                planned.kind = Kind::Space(space.resampled(per_step));
                scheme.runs.push(planned);
            }
            LinkKind::Pairwise(pairs) => {
                scheme.linear = false;
                planned.kind = Kind::Pairwise {
                    by: pairs.clone(),
                    room: n_pairwise,
                };
                n_pairwise += 1;
                scheme.runs.push(planned);
            }
            LinkKind::Lnl(law) => {
                scheme.linear = false;
                // Runs that share a law share its scratch memory.
                let known = laws.iter().position(|known| Arc::ptr_eq(known, law));
                let room = known.unwrap_or_else(|| {
                    laws.push(law.clone());
                    laws.len() - 1
                });
                planned.kind = Kind::Lnl {
                    law: law.clone(),
                    rate: per_step,
                    room,
                };
                scheme.runs.push(planned);
            }
            LinkKind::Followed(followed) => {
                scheme.linear = false;
                planned.kind = Kind::Followed {
                    by: followed.clone(),
                    rate: per_step,
                    room: n_followed,
                };
                n_followed += 1;
                scheme.runs.push(planned);
            }
            LinkKind::Bristle(bristle) => {
                scheme.linear = false;
                planned.z = run.z;
                planned.kind = Kind::Bristle {
                    by: *bristle,
                    rate: per_step,
                };
                scheme.runs.push(planned);
            }
            LinkKind::Dry(dry) => {
                if ends_on_proxy(network, run) {
                    return Err(on_proxy(network, run));
                }
                scheme.linear = false;
                planned.z = run.z;
                planned.kind = Kind::Dry {
                    by: *dry,
                    rate: per_step,
                };
                dry_runs.push(planned);
            }
            LinkKind::But(but) => {
                scheme.linear = false;
                planned.kind = Kind::But(*but);
                match but.contact {
                    Contact::Plain => scheme.runs.push(planned),
                    // The same contact with an explicit force: a proxy has no single mass for which it could be solved.
                    Contact::Exact if ends_on_proxy(network, run) => scheme.runs.push(planned),
                    Contact::Exact => scheme.exact.push(planned),
                    Contact::Magic if ends_on_proxy(network, run) => {
                        return Err(on_proxy(network, run));
                    }
                    Contact::Magic => {
                        check_no_other_link(network, run.a, run.first)?;
                        check_no_other_link(network, run.b, run.first)?;
                        if scheme.w[run.a] + scheme.w[run.b] == 0.0 {
                            return Err(Error::Refused {
                                module: network.link_name(run.first),
                                message: "a magic contact needs an end that moves".to_owned(),
                            });
                        }
                        let mu = 1.0 / (scheme.w[run.a] + scheme.w[run.b]);
                        let (k, z) = but.exact_restitution();
                        planned.k = k * mu;
                        planned.z = z * mu;
                        scheme.runs.push(planned);
                    }
                }
            }
        }
    }
    scheme.exact.extend(dry_runs); // friction is the last of the forces
    let mut ends: Vec<usize> = scheme.exact.iter().flat_map(|run| [run.a, run.b]).collect();
    ends.sort_unstable();
    scheme.exact_coupled = ends
        .windows(2)
        .any(|pair| pair[0] == pair[1] && scheme.w[pair[0]] > 0.0);
    scheme.alike = scheme.equal_ranges();
    Ok(scheme)
}

/// MATs of bodies in which some tie or spring has a negative stiffness, as in those of MODES. Such stiffnesses cancel
/// others, and would not if a tie were discretised by its own poles   (n_mat).
fn cancelling(network: &Network) -> Vec<bool> {
    let mut joined = Forest::new(network.n_mat());
    let springs = network.runs().iter();
    let springs = springs.filter(|run| run.kind == LinkKind::Ref && run.len == 1);
    let mut below: Vec<usize> = Vec::new();
    for run in springs {
        if network.mats().part[run.a] == network.mats().part[run.b] {
            joined.join(run.a, run.b);
        }
        if run.k < 0.0 {
            below.push(run.a);
        }
    }
    let ties = network.mats().k.iter().enumerate();
    below.extend(ties.filter(|&(_, &k)| k < 0.0).map(|(mat, _)| mat));
    let mut cancels = vec![false; network.n_mat()];
    for mat in below {
        cancels[joined.root(mat)] = true;
    }
    (0..cancels.len())
        .map(|mat| cancels[joined.root(mat)])
        .collect()
}

fn ca_rate(network: &Network, part: usize) -> Option<Rate> {
    network.parts().get(part).and_then(|part| part.ca_rate)
}

/// Refuses a CEL above half the rate: its exact poles would be those of its alias, stable but of another pitch.
fn above_nyquist(network: &Network, mat: usize, f: f64, rate: Rate) -> Option<Error> {
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
fn resampled(ratios: Ratios, design_rate: Rate, rate: Rate) -> Ratios {
    if design_rate.hertz() == rate.hertz() {
        return ratios;
    }
    let step = design_rate.hertz() / rate.hertz();
    match ratios.pitch(design_rate) {
        Some((f, t60)) => cell::tune(f, t60.is_finite().then_some(t60), rate),
        None => Ratios {
            kappa: ratios.kappa * step * step,
            zeta: ratios.zeta * step,
        },
    }
}

/// Whether an end of a run is a proxy.
fn ends_on_proxy(network: &Network, run: &LinkRun) -> bool {
    let mut ends = (0..run.len).flat_map(|i| run.pairs(i));
    !network.proxies().is_empty() && ends.any(|(a, b)| network.is_proxy(a) || network.is_proxy(b))
}

fn on_proxy(network: &Network, run: &LinkRun) -> Error {
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
    let tied = network.mats().kind[mat] == MatKind::Cel;
    let held = tied || (network.degree(mat) > 1 && network.mats().kind[mat].moves());
    if held {
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
