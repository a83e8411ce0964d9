//! Cost of a frame on two gongs:
//! `cargo test --release -p ergon-engine --lib integrate::tests::cost -- --ignored --nocapture`.

use std::time::{Duration, Instant};

use super::*;

/// Time per frame [s], the best of five runs.
fn cost(network: &Network, method: MeshMethod, frames: u32) -> f64 {
    let mut best = f64::INFINITY;
    let centre = network.centre(0);
    for _ in 0..5 {
        let mut it = by(network, method, 1);
        it.step(
            &[(centre, 2.0 * network.mats().m[centre])],
            &mut ThreadTeam::alone(),
        );
        let start = Instant::now();
        for _ in 0..frames {
            it.step(&[], &mut ThreadTeam::alone());
        }
        best = best.min(start.elapsed().as_secs_f64() / f64::from(frames));
        assert!(it.sound());
    }
    best
}

fn table(network: &Network, frames: u32, ways: &[MeshMethod]) {
    let mut reference = f64::NAN;
    for &method in ways {
        let cost = cost(network, method, frames);
        if method == MeshMethod::Ca {
            reference = cost;
        }
        let (name, ratio) = (method.facts().name, cost / reference);
        eprintln!(
            "  {name:10} {:8.0} ns a frame, {ratio:.2} of ca",
            1e9 * cost
        );
    }
}

/// Time per frame with a thread team [s]: the best of many short runs, since other programs may use the processor too.
fn shared(network: &Network, method: MeshMethod, threads: usize) -> f64 {
    let (mut best, frames) = (f64::INFINITY, 50);
    let mut it = by(network, method, 1);
    it.share(threads);
    it.step(&[(network.centre(0), 1e-3)], &mut ThreadTeam::alone());
    let end = Instant::now() + Duration::from_millis(2_000);
    ThreadTeam::with(threads, |team| {
        while Instant::now() < end {
            let start = Instant::now();
            (0..frames).for_each(|_| it.step(&[], team));
            best = best.min(start.elapsed().as_secs_f64() / f64::from(frames));
        }
    });
    best
}

#[test]
#[ignore = "a timing"]
fn of_a_crew() {
    for radius in [58, 26, 18, 12, 8] {
        let network = hex_of(radius, 60.0, 1e13, Some(2.0));
        for method in [MeshMethod::Ca, MeshMethod::Ca2p, MeshMethod::Bm4] {
            let first = shared(&network, method, 1);
            let times = first / shared(&network, method, 2);
            let (name, n_mat, us) = (method.facts().name, network.n_mat(), 1e6 * first);
            eprintln!("{name:5} {n_mat:6} masses {us:7.2} us; by 2 threads {times:.2} times");
        }
    }
}

#[test]
#[ignore = "a timing"]
fn of_a_frame() {
    let explicit = &MeshMethod::ALL[..4];
    for t60 in [None, Some(2.0)] {
        eprintln!("331 masses, hardening, t60 {t60:?}");
        table(&hex(1e13, t60), 10_000, explicit);
        eprintln!("331 masses, linear, t60 {t60:?}");
        table(&hex(0.0, t60), 10_000, &MeshMethod::ALL);
    }
    eprintln!("10267 masses, hardening, t60 2 s");
    table(&hex_of(58, 60.0, 1e13, Some(2.0)), 300, explicit);
    eprintln!("10267 masses, linear, t60 2 s");
    table(&hex_of(58, 60.0, 0.0, Some(2.0)), 200, &MeshMethod::ALL);
}
