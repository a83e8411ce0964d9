//! The last step before frame 0, which the scheme needs to start.

use crate::cell::Cell;
use crate::interrupt;
use crate::kernel::{self, Neighbours};
use crate::network::{AXES_MAX, Contact, ContactLaw, Dry, LinkKind, MatKind, Network, Run};
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
    let frame_rate = timeline.rate;
    let time_step = frame_rate.step();
    let network_mats = network.mats();
    let mat_forces = forces(network, timeline, x, pushes, acts);
    let mut last_steps: Vec<f64> = (0..network.n_mat())
        .map(|i| {
            let (start_position, start_velocity) = (x[i], network_mats.v0[i]);
            let ca_rate = network
                .parts()
                .get(network_mats.part[i] as usize)
                .and_then(|part| part.ca_rate);
            let force_step = 0.5 * scheme.w[i] * mat_forces[i]; // ½T²F/m, since w = T²/m
            match network_mats.kind[i] {
                MatKind::Sol | MatKind::Imposed | MatKind::Proxy => 0.0,
                _ if ca_rate.is_some() => start_velocity * time_step,
                MatKind::Mas | MatKind::Cel => free_step(network, frame_rate, i, start_position) - force_step,
            }
        })
        .collect();
    for proxy in network.proxies() {
        last_steps[proxy.mat] = proxy.weighted_sum(|mat| x[mat], |mat| last_steps[mat]);
    }
    last_steps
}

/// d[0] of a MAS or CEL at `x` [m] that no link acts on [m]; zero for all others.
fn free_step(network: &Network, rate: Rate, mat: usize, x: f64) -> f64 {
    let network_mats = network.mats();
    let velocity = network_mats.v0[mat];
    match network_mats.kind[mat] {
        MatKind::Sol | MatKind::Imposed | MatKind::Proxy => 0.0,
        MatKind::Mas => velocity * rate.step(),
        MatKind::Cel => {
            let cell = Cell::new(network_mats.m[mat], network_mats.k[mat], network_mats.z[mat]);
            cell.last_step(x, velocity, network_mats.rest[mat], rate)
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
    let network_mats = network.mats();
    let mut mat_forces = vec![0.0; network.n_mat()];
    mat_forces[..network_mats.weight.len()].copy_from_slice(&network_mats.weight);
    for &(mat, push) in pushes {
        mat_forces[mat] += push;
    }
    let is_closed = |first: usize| {
        timeline
            .gates
            .iter()
            .any(|gate| gate.links().contains(&first) && gate.opening(0) == 0.0)
    };
    let network_runs = interrupt::polled_items(network.runs());
    for run in network_runs.filter(|run| !is_closed(run.first) && acts(run.first)) {
        let ca_rate = network.parts().get(run.part).and_then(|part| part.ca_rate);
        let ca_step = ca_rate.map_or(1.0, Rate::step);
        let elongation = |i: usize| x[run.b + i] - x[run.a + i] - run.rest;
        let squares = || (0..run.len).map(|i| elongation(i) * elongation(i)).sum();
        let tension = match &run.kind {
            LinkKind::Lnl(law) if law.is_shared() => law.tension(squares()),
            _ => 0.0,
        };
        if let LinkKind::Space(space_link) = &run.kind {
            for i in interrupt::steps(0..run.len) {
                let end_mats = (run.a + i, run.b + i);
                let (link_length, direction) = space_link.length_and_direction(end_mats, |mat| x[mat]);
                let v = space_link.length_step(end_mats, direction, |mat| network_mats.v0[mat]) * ca_step;
                let e = space_link.law.after_yielding(run.k, link_length - run.rest, 0.0);
                let f = space_link.law.force([run.k, run.z], e, v);
                for ((a, b), along) in run.pairs(i).zip(direction) {
                    mat_forces[a] += f * along;
                    mat_forces[b] -= f * along;
                }
            }
            continue;
        }
        if let Some(pair_run) = run.pairwise() {
            let pair_link = &pair_run.pairs.link;
            let push = |end_mats, e, along: [f64; AXES_MAX]| {
                let v = pair_link.length_step(end_mats, along, |mat| network_mats.v0[mat]) * ca_step;
                let f = pair_link.law.force([run.k, run.z], e, v);
                for (axis, along) in along.into_iter().enumerate().take(pair_link.n_axes) {
                    let (a, b) = pair_link.pair(end_mats, axis);
                    mat_forces[a] += f * along;
                    mat_forces[b] -= f * along;
                }
            };
            Neighbours::new(&pair_run).for_each_touching(&pair_run, |mat| x[mat], push);
            continue;
        }
        for i in interrupt::steps(0..run.len) {
            let (a, b) = (run.a + i, run.b + i);
            let e = x[b] - x[a] - run.rest;
            // Under `ca` Z is a factor of metres per sample.
            let v = (network_mats.v0[b] - network_mats.v0[a]) * ca_step;
            let f = match &run.kind {
                LinkKind::Ref => run.k * e + run.z * v,
                LinkKind::Lnl(law) if law.is_shared() => tension * e,
                LinkKind::Lnl(law) => law.force(e, v),
                LinkKind::Followed(followed) => followed.law_for(|mat| x[mat]).force(e, v),
                LinkKind::Bristle(bristle) => bristle.with_stiffness_and_level(run.k, run.z).force(0.0, v),
                // Dry friction; the others were added above.
                LinkKind::Dry(_) | LinkKind::Space(_) | LinkKind::Pairwise(_) => continue,
                LinkKind::But(but) if but.contact == Contact::Exact => continue,
                LinkKind::But(but) => but.force(run.k, run.z, e, v),
            };
            mat_forces[a] += f;
            mat_forces[b] -= f;
        }
    }
    let is_exact = |run: &&Run| matches!(&run.kind, LinkKind::But(but) if but.contact == Contact::Exact);
    let network_runs = network
        .runs()
        .iter()
        .filter(|run| !is_closed(run.first) && acts(run.first));
    add_exact_contacts(
        network,
        timeline.rate,
        &network_runs.filter(is_exact).collect::<Vec<_>>(),
        x,
        &mut mat_forces,
    );
    for proxy in network.proxies() {
        let proxy_force = mat_forces[proxy.mat];
        proxy.for_each_share(|mat| x[mat], |mat, share| mat_forces[mat] += share * proxy_force);
    }
    let network_runs = interrupt::polled_items(network.runs());
    for run in network_runs.filter(|run| !is_closed(run.first) && acts(run.first)) {
        if let LinkKind::Dry(dry_friction) = &run.kind {
            add_dry_friction(network, (run, dry_friction), x, &mut mat_forces);
        }
    }
    mat_forces
}

/// Add the forces of contacts with `contact: exact` over half a step backward, by the same discrete gradient as in
/// steps: ½T²·F/m then takes a MAT to x[−1], and never from a contact into more energy than it began with, however
/// stiff the contact is. For a mass with δ = T·v₀ − ½T²G/m and the gradient G from x[0] to x[−1], the energy of the
/// step is that of the start less T²G²/8m.
fn add_exact_contacts(network: &Network, rate: Rate, runs: &[&Run], x: &[f64], force: &mut [f64]) {
    /// Contacts that share a MAT are solved in turn; each round halves what they disagree by, or better.
    const ROUNDS: usize = 50;
    let network_mats = network.mats();
    let time_step = rate.step();
    // Change of a position by a newton over half a step [m/N].
    let compliance = |i: usize| {
        if network_mats.kind[i].moves() {
            0.5 * time_step * time_step / network_mats.m[i]
        } else {
            0.0
        }
    };
    // Where a MAT would have been without links [m]: the same in all rounds.
    let free_position = |i: usize| x[i] - free_step(network, rate, i, x[i]);
    let contact_links = runs
        .iter()
        .flat_map(|run| (0..run.len).map(move |i| (*run, run.a + i, run.b + i)));
    let mut contact_links: Vec<_> = contact_links
        .map(|(run, a, b)| (run, [(a, free_position(a)), (b, free_position(b))], 0.0))
        .collect();
    for _ in 0..ROUNDS {
        let mut is_settled = true;
        for (run, [(a, free_a), (b, free_b)], push) in &mut contact_links {
            let LinkKind::But(but_link) = &run.kind else {
                continue;
            };
            let (a, b) = (*a, *b);
            interrupt::poll();
            let side_sign = but_link.sign();
            force[a] -= *push;
            force[b] += *push;
            let law = but_link.law(run.k, run.z);
            let contact = kernel::ExactContact {
                law: ContactLaw {
                    z: 0.0,
                    is_clamped: false,
                    ..law
                },
                beta: compliance(a) + compliance(b),
            };
            let contact_depth = side_sign * (x[b] - x[a] - run.rest);
            let depth_rate = side_sign * (network_mats.v0[b] - network_mats.v0[a]);
            let before_a = *free_a + compliance(a) * force[a];
            let before_b = *free_b + compliance(b) * force[b];
            let elastic = contact.push(
                side_sign * (before_b - before_a - run.rest),
                contact_depth,
                contact_depth,
            );
            let damping_force = if contact_depth > 0.0 { law.z * depth_rate } else { 0.0 };
            let contact_force = side_sign * law.limited_force(elastic + damping_force);
            is_settled &= (contact_force - *push).abs() <= f64::EPSILON * contact_force.abs();
            *push = contact_force;
            force[a] += contact_force;
            force[b] -= contact_force;
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
    let network_mats = network.mats();
    let (first_mat, second_mat) = (run.a, run.b);
    let slip_speed = network_mats.v0[second_mat] - network_mats.v0[first_mat];
    let friction_level = dry.with(run.z).level_at(slip_speed);
    let per_force = |i: usize| {
        if network_mats.kind[i].moves() {
            1.0 / network_mats.m[i]
        } else {
            0.0
        }
    };
    let acceleration_without = |i: usize| {
        let cell_force = network_mats.k[i] * (x[i] - network_mats.rest[i]) + network_mats.z[i] * network_mats.v0[i];
        per_force(i)
            * (force[i]
                - if network_mats.kind[i] == MatKind::Cel {
                    cell_force
                } else {
                    0.0
                })
    };
    let inverse_masses = per_force(first_mat) + per_force(second_mat);
    let friction_force = if slip_speed != 0.0 {
        friction_level * slip_speed.signum()
    } else if inverse_masses > 0.0 {
        let holding_force = (acceleration_without(second_mat) - acceleration_without(first_mat)) / inverse_masses;
        if holding_force.abs() > friction_level {
            -friction_level * holding_force.signum()
        } else {
            holding_force
        }
    } else {
        0.0
    };
    force[first_mat] += friction_force;
    force[second_mat] -= friction_force;
}
