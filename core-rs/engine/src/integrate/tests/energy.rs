//! The energy that each method conserves, and the stiffness that it withstands.

use super::*;

/// Largest relative change of a method's energy after its first frame; +∞ if positions leave the valid range.
fn drift(mut it: Integrator, frames: usize) -> f64 {
    it.step(&[], &mut ThreadTeam::alone());
    let start = it.energy();
    let mut limit = 0.0_f64;
    for _ in 0..frames {
        it.step(&[], &mut ThreadTeam::alone());
        if !it.sound() {
            return f64::INFINITY;
        }
        limit = limit.max((it.energy() / start - 1.0).abs());
    }
    limit
}

#[test]
fn linear_row_keeps_its_energy_to_rounding() {
    let network = row(20, 2e5, 0.0, 0.0);
    for method in MeshMethod::ALL {
        // BM4 conserves an energy close to this one, which therefore oscillates but does not drift.
        let limit = if method == MeshMethod::Bm4 {
            1e-6
        } else {
            2e-12
        };
        let drift = drift(by(&network, method, 1), 4000);
        assert!(drift < limit, "{method:?} {drift:e}");
    }
}

/// Links that harden until CA and CA2P compute only finer frames, and BM4 diverges: IEQ still conserves its energy.
#[test]
fn hard_cubic_chain_keeps_its_energy_by_ieq() {
    let ways = [
        MeshMethod::Ca,
        MeshMethod::Ca2p,
        MeshMethod::Bm4,
        MeshMethod::Ieq,
    ];
    let position = |q: f64| ways.map(|way| drift(by(&row(20, 2e5, q, 0.0), way, 1), 4000));
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
        let drifts = [
            drift(by(&row(20, k, 0.0, 0.0), MeshMethod::Ieq, 1), 4000),
            drift(by(&row(20, k, 1e14, 0.0), MeshMethod::Ieq, 1), 4000),
        ];
        assert!(
            drifts.iter().all(|drift| *drift < 5e-12),
            "{k:e} {drifts:?}"
        );
    }
}

/// A struck, damped row: at every frame the energy put in is stored or lost, to rounding.
#[test]
fn energy_ledger_of_a_damped_row_closes() {
    let z = 0.3;
    for q in [0.0, 1e14] {
        let network = row(20, 2e5, q, z);
        let links: Vec<(usize, usize)> = network.runs().iter().map(|run| (run.a, run.b)).collect();
        let mut it = by(&network, MeshMethod::Ieq, 1);
        it.step(&[], &mut ThreadTeam::alone());
        let mut before = it.positions().to_vec();
        it.step(&[], &mut ThreadTeam::alone());
        let mut now = it.positions().to_vec();
        let (mut injected, mut lost) = (0.0, 0.0);
        let start = it.energy();
        for n in 0..2000 {
            let impulse = if n % 50 == 0 { 1e-3 } else { 0.0 };
            it.step(&[(7, impulse)], &mut ThreadTeam::alone());
            let next = it.positions().to_vec();
            // A force and the damping act on the mean velocity over two frames.
            let speed = |mat: usize| (next[mat] - before[mat]) * HERTZ / 2.0;
            injected += impulse * speed(7);
            for &(a, b) in &links {
                let slide = speed(b) - speed(a);
                lost += z * (slide * slide) / HERTZ;
            }
            let open = start + injected - lost - it.energy();
            assert!(
                open.abs() < 1e-12 * (start + injected),
                "{q:e} {n} {open:e}"
            );
            (before, now) = (now, next);
        }
        assert!(lost > 0.1 * injected && injected > 0.0);
    }
}

/// Neither a step nor a reading allocates memory.
#[test]
fn step_and_readings_do_not_allocate() {
    for method in MeshMethod::ALL {
        let mut it = by(&hex(1e13, Some(1.0)), method, 2);
        let mut v = [0.0; 2];
        reset_violation_count();
        assert_no_alloc(|| {
            for _ in 0..3 {
                it.velocities(&[3, 165], &mut v);
                it.step(&[(165, 1e-3)], &mut ThreadTeam::alone());
                assert!(it.energy() > 0.0);
            }
        });
        assert!(it.sound() && violation_count() == 0, "{method:?}");
    }
}
