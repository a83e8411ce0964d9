//! The last step before frame 0, which the scheme needs to start.

use crate::cell::Cell;
use crate::interrupt;
use crate::kernel::{self, Neighbours};
use crate::network::{AXES_MAX, Contact, Dry, LinkKind, MatKind, Network, Run};
use crate::scheme::Scheme;
use crate::timeline::Timeline;
use crate::units::Rate;

/// d[0] = x[0] − x[−1] of every MAT [m], (n_mat).
///
/// x[−1] is the free motion at −T, exact for a CEL and linear for a MAS, plus ½T²·F/m for the force F of links at t=0.
/// Under `ca` d[0] is V0·T.
///
/// `x` are the positions at frame 0 [m], `pushes` the forces of ENF there, as (MAT, newton). `acts`: whether the run
/// that begins with a given link is computed at frames, not in substeps.
pub(crate) fn backward_steps(
    network: &Network,
    timeline: &Timeline,
    scheme: &Scheme,
    x: &[f64],
    pushes: &[(usize, f64)],
    acts: &dyn Fn(usize) -> bool,
) -> Vec<f64> {
    let rate = timeline.rate;
    let t = rate.step();
    let mats = network.mats();
    let force = forces(network, timeline, x, pushes, acts);
    let mut steps: Vec<f64> = (0..network.n_mat())
        .map(|i| {
            let (x0, v0) = (x[i], mats.v0[i]);
            let ca = network
                .parts()
                .get(mats.part[i] as usize)
                .and_then(|part| part.ca_rate);
            let half = 0.5 * scheme.w[i] * force[i]; // ½T²F/m, since w = T²/m
            match mats.kind[i] {
                MatKind::Sol | MatKind::Imposed | MatKind::Proxy => 0.0,
                _ if ca.is_some() => v0 * t,
                MatKind::Mas | MatKind::Cel => free_step(network, rate, i, x0) - half,
            }
        })
        .collect();
    for proxy in network.proxies() {
        steps[proxy.mat] = proxy.sum(|mat| x[mat], |mat| steps[mat]);
    }
    steps
}

/// d[0] of a MAS or CEL at `x` [m] that no link acts on [m]; zero for all others.
fn free_step(network: &Network, rate: Rate, mat: usize, x: f64) -> f64 {
    let mats = network.mats();
    let v = mats.v0[mat];
    match mats.kind[mat] {
        MatKind::Sol | MatKind::Imposed | MatKind::Proxy => 0.0,
        MatKind::Mas => v * rate.step(),
        MatKind::Cel => {
            let cell = Cell::new(mats.m[mat], mats.k[mat], mats.z[mat]);
            cell.last_step(x, v, mats.rest[mat], rate)
        }
    }
}

/// Forces at t = 0 on the MATs by all links that are computed at frames, from positions `x` and V0, with SI damping
/// [N], (n_mat).
pub(crate) fn forces(
    network: &Network,
    timeline: &Timeline,
    x: &[f64],
    pushes: &[(usize, f64)],
    acts: &dyn Fn(usize) -> bool,
) -> Vec<f64> {
    let mats = network.mats();
    let mut force = vec![0.0; network.n_mat()];
    force[..mats.weight.len()].copy_from_slice(&mats.weight);
    for &(mat, push) in pushes {
        force[mat] += push;
    }
    let closed = |first: usize| {
        timeline
            .gates
            .iter()
            .any(|gate| gate.links().contains(&first) && gate.open(0) == 0.0)
    };
    let runs = interrupt::each(network.runs());
    for run in runs.filter(|run| !closed(run.first) && acts(run.first)) {
        let ca = network.parts().get(run.part).and_then(|part| part.ca_rate);
        let ca_step = ca.map_or(1.0, Rate::step);
        let elongation = |i: usize| x[run.b + i] - x[run.a + i] - run.rest;
        let squares = || (0..run.len).map(|i| elongation(i) * elongation(i)).sum();
        let tension = match &run.kind {
            LinkKind::Lnl(law) if law.is_shared() => law.tension(squares()),
            _ => 0.0,
        };
        if let LinkKind::Space(space) = &run.kind {
            for i in interrupt::steps(0..run.len) {
                let ends = (run.a + i, run.b + i);
                let (length, direction) = space.line(ends, |mat| x[mat]);
                let v = space.stretch(ends, direction, |mat| mats.v0[mat]) * ca_step;
                let e = space.law.after_yielding(run.k, length - run.rest, 0.0);
                let f = space.law.force([run.k, run.z], e, v);
                for ((a, b), along) in run.pairs(i).zip(direction) {
                    force[a] += f * along;
                    force[b] -= f * along;
                }
            }
            continue;
        }
        if let Some(pairs) = run.pairwise() {
            let link = &pairs.pairs.link;
            let push = |ends, e, along: [f64; AXES_MAX]| {
                let v = link.stretch(ends, along, |mat| mats.v0[mat]) * ca_step;
                let f = link.law.force([run.k, run.z], e, v);
                for (axis, along) in along.into_iter().enumerate().take(link.n_axes) {
                    let (a, b) = link.pair(ends, axis);
                    force[a] += f * along;
                    force[b] -= f * along;
                }
            };
            Neighbours::new(&pairs).touching(&pairs, |mat| x[mat], push);
            continue;
        }
        for i in interrupt::steps(0..run.len) {
            let (a, b) = (run.a + i, run.b + i);
            let e = x[b] - x[a] - run.rest;
            // Under `ca` Z is a factor of metres per sample.
            let v = (mats.v0[b] - mats.v0[a]) * ca_step;
            let f = match &run.kind {
                LinkKind::Ref => run.k * e + run.z * v,
                LinkKind::Lnl(law) if law.is_shared() => tension * e,
                LinkKind::Lnl(law) => law.force(e, v),
                LinkKind::Followed(followed) => followed.law_for(|mat| x[mat]).force(e, v),
                LinkKind::Bristle(bristle) => bristle.with(run.k, run.z).force(0.0, v),
                // Dry friction; the others were added above.
                LinkKind::Dry(_) | LinkKind::Space(_) | LinkKind::Pairwise(_) => continue,
                LinkKind::But(but) if but.contact == Contact::Exact => continue,
                LinkKind::But(but) => but.force(run.k, run.z, e, v),
            };
            force[a] += f;
            force[b] -= f;
        }
    }
    let is_exact =
        |run: &&Run| matches!(&run.kind, LinkKind::But(but) if but.contact == Contact::Exact);
    let runs = network
        .runs()
        .iter()
        .filter(|run| !closed(run.first) && acts(run.first));
    add_exact_contacts(
        network,
        timeline.rate,
        &runs.filter(is_exact).collect::<Vec<_>>(),
        x,
        &mut force,
    );
    for proxy in network.proxies() {
        let pull = force[proxy.mat];
        proxy.for_each_share(|mat| x[mat], |mat, share| force[mat] += share * pull);
    }
    let runs = interrupt::each(network.runs());
    for run in runs.filter(|run| !closed(run.first) && acts(run.first)) {
        if let LinkKind::Dry(dry) = &run.kind {
            add_dry_friction(network, (run, dry), x, &mut force);
        }
    }
    force
}

/// Add the forces of contacts with `contact: exact` over half a step backward, by the same discrete gradient as in steps:
/// ½T²·F/m then takes a MAT to x[−1], and never from a contact into more energy than it began with, however stiff the
/// contact is. For a mass with δ = T·v₀ − ½T²G/m and the gradient G from x[0] to x[−1], the energy of the step is that of
/// the start less T²G²/8m.
fn add_exact_contacts(network: &Network, rate: Rate, runs: &[&Run], x: &[f64], force: &mut [f64]) {
    /// Contacts that share a MAT are solved in turn; each round halves what they disagree by, or better.
    const ROUNDS: usize = 50;
    let mats = network.mats();
    let t = rate.step();
    // Change of a position by a newton over half a step [m/N].
    let compliance = |i: usize| {
        if mats.kind[i].moves() {
            0.5 * t * t / mats.m[i]
        } else {
            0.0
        }
    };
    // Where a MAT would have been without links [m]: the same in all rounds.
    let free = |i: usize| x[i] - free_step(network, rate, i, x[i]);
    let links = runs
        .iter()
        .flat_map(|run| (0..run.len).map(move |i| (*run, run.a + i, run.b + i)));
    let mut links: Vec<_> = links
        .map(|(run, a, b)| (run, [(a, free(a)), (b, free(b))], 0.0))
        .collect();
    for _ in 0..ROUNDS {
        let mut is_settled = true;
        for (run, [(a, free_a), (b, free_b)], push) in &mut links {
            let LinkKind::But(but) = &run.kind else {
                continue;
            };
            let (a, b) = (*a, *b);
            interrupt::poll();
            let s = but.sign();
            force[a] -= *push;
            force[b] += *push;
            let contact = kernel::Contact {
                k: run.k,
                z: 0.0,
                exponent: but.exponent,
                beta: compliance(a) + compliance(b),
                clamp: false,
            };
            let now = s * (x[b] - x[a] - run.rest);
            let v = s * (mats.v0[b] - mats.v0[a]);
            let before_a = *free_a + compliance(a) * force[a];
            let before_b = *free_b + compliance(b) * force[b];
            let elastic = contact.push(s * (before_b - before_a - run.rest), now, now);
            let drag = if now > 0.0 { run.z * v } else { 0.0 };
            let total = elastic + drag;
            let f = s * if but.clamp { total.max(0.0) } else { total };
            is_settled &= (f - *push).abs() <= f64::EPSILON * f.abs();
            *push = f;
            force[a] += f;
            force[b] -= f;
        }
        if is_settled {
            break;
        }
    }
}

/// Add the force of dry friction just before t = 0: against the velocity, or at rest against all other forces. If these
/// exceed its level, motion begins at t = 0; just before, the ends moved the other way and reversed, so that friction
/// had the other sign.
fn add_dry_friction(network: &Network, (run, dry): (&Run, &Dry), x: &[f64], force: &mut [f64]) {
    let mats = network.mats();
    let (a, b) = (run.a, run.b);
    let v = mats.v0[b] - mats.v0[a];
    let level = dry.with(run.z).level_at(v);
    let per_force = |i: usize| {
        if mats.kind[i].moves() {
            1.0 / mats.m[i]
        } else {
            0.0
        }
    };
    let acceleration_without = |i: usize| {
        let tie = mats.k[i] * (x[i] - mats.rest[i]) + mats.z[i] * mats.v0[i];
        per_force(i)
            * (force[i]
                - if mats.kind[i] == MatKind::Cel {
                    tie
                } else {
                    0.0
                })
    };
    let both = per_force(a) + per_force(b);
    let f = if v != 0.0 {
        level * v.signum()
    } else if both > 0.0 {
        let held = (acceleration_without(b) - acceleration_without(a)) / both;
        if held.abs() > level {
            -level * held.signum()
        } else {
            held
        }
    } else {
        0.0
    };
    force[a] += f;
    force[b] -= f;
}
