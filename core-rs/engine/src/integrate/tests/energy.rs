//! The energy that each method conserves, and the stiffness that it withstands.

use super::*;

/// Largest relative change of a method's energy after its first frame; +∞ if positions leave the valid range.
fn drift(mut it: Integrator, frames: usize) -> f64 {
    it.step(&[], &mut ThreadTeam::alone());
    let start_energy = it.energy();
    let mut largest_drift = 0.0_f64;
    for _ in 0..frames {
        it.step(&[], &mut ThreadTeam::alone());
        if !it.is_bounded() {
            return f64::INFINITY;
        }
        largest_drift = largest_drift.max((it.energy() / start_energy - 1.0).abs());
    }
    largest_drift
}

#[test]
fn linear_row_keeps_its_energy_to_rounding() {
    let network = row(20, 2e5, 0.0, 0.0);
    for method in MeshMethod::ALL {
        // BM4 conserves an energy close to this one, which therefore oscillates but does not drift.
        let drift_limit = if method == MeshMethod::Bm4 { 1e-6 } else { 2e-12 };
        let drift = drift(by(&network, method, 1), 4000);
        assert!(drift < drift_limit, "{method:?} {drift:e}");
    }
}

/// Links that harden until CA and CA2P compute only finer frames, and BM4 diverges: IEQ still conserves its energy.
#[test]
fn hard_cubic_chain_keeps_its_energy_by_ieq() {
    let mesh_methods = [MeshMethod::Ca, MeshMethod::Ca2p, MeshMethod::Bm4, MeshMethod::Ieq];
    let position = |q: f64| mesh_methods.map(|way| drift(by(&row(20, 2e5, q, 0.0), way, 1), 4000));
    let [ca, ca2p, bm4, ieq] = position(1e12);
    assert!(ca < 0.02 && ca2p < 0.02 && bm4 < 1e-5 && ieq < 1e-13);
    let [ca, ca2p, bm4, ieq] = position(1e14);
    assert!(ca < 0.8 && ca2p < 0.8 && bm4 < 0.2 && ieq < 1e-12);
    let [.., bm4, ieq] = position(1e16);
    assert!(bm4.is_infinite() && ieq < 1e-9, "{ieq:e}");
}

/// Springs up to about 500 times as stiff as an explicit step allows.
#[test]
fn stiff_springs_keep_their_energy_by_ieq() {
    for k in [1e6, 1e7, 1e9] {
        let energy_drifts = [
            drift(by(&row(20, k, 0.0, 0.0), MeshMethod::Ieq, 1), 4000),
            drift(by(&row(20, k, 1e14, 0.0), MeshMethod::Ieq, 1), 4000),
        ];
        assert!(
            energy_drifts.iter().all(|drift| *drift < 5e-12),
            "{k:e} {energy_drifts:?}"
        );
    }
}

/// A struck, damped row: at every frame the energy put in is stored or lost, to rounding.
#[test]
fn energy_ledger_of_a_damped_row_closes() {
    let link_damping = 0.3;
    for q in [0.0, 1e14] {
        let network = row(20, 2e5, q, link_damping);
        let link_ends: Vec<(usize, usize)> = network.runs().iter().map(|run| (run.a, run.b)).collect();
        let mut integrator = by(&network, MeshMethod::Ieq, 1);
        integrator.step(&[], &mut ThreadTeam::alone());
        let mut positions_before = integrator.positions().to_vec();
        integrator.step(&[], &mut ThreadTeam::alone());
        let mut positions_now = integrator.positions().to_vec();
        let (mut injected, mut energy_lost) = (0.0, 0.0);
        let start_energy = integrator.energy();
        for n in 0..2000 {
            let impulse = if n % 50 == 0 { 1e-3 } else { 0.0 };
            integrator.step(&[(7, impulse)], &mut ThreadTeam::alone());
            let positions_next = integrator.positions().to_vec();
            // A force and the damping act on the mean velocity over two frames.
            let mean_speed = |mat: usize| (positions_next[mat] - positions_before[mat]) * HERTZ / 2.0;
            injected += impulse * mean_speed(7);
            for &(a, b) in &link_ends {
                let slide_speed = mean_speed(b) - mean_speed(a);
                energy_lost += link_damping * (slide_speed * slide_speed) / HERTZ;
            }
            let open_balance = start_energy + injected - energy_lost - integrator.energy();
            assert!(
                open_balance.abs() < 1e-12 * (start_energy + injected),
                "{q:e} {n} {open_balance:e}"
            );
            (positions_before, positions_now) = (positions_now, positions_next);
        }
        assert!(energy_lost > 0.1 * injected && injected > 0.0);
    }
}

/// Neither a step nor a reading allocates memory.
#[test]
fn step_and_readings_do_not_allocate() {
    for method in MeshMethod::ALL {
        let mut integrator = by(&hex(1e13, Some(1.0)), method, 2);
        let mut velocities_read = [0.0; 2];
        reset_violation_count();
        assert_no_alloc(|| {
            for _ in 0..3 {
                integrator.velocities(&[3, 165], &mut velocities_read);
                integrator.step(&[(165, 1e-3)], &mut ThreadTeam::alone());
                assert!(integrator.energy() > 0.0);
            }
        });
        assert!(integrator.is_bounded() && violation_count() == 0, "{method:?}");
    }
}
