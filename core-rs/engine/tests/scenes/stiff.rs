//! Links that stiffen until the scheme would diverge: frames are computed in finer steps, and the scene plays on.

use std::sync::Arc;

use super::blocks::play;
use super::scene::options;
use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::law::{Law, LawText};
use ergon_engine::maths::log10;
use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

const HERTZ: f64 = 44_100.0;
/// Frames of a twentieth of a second.
const N: usize = 2_205;

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

/// Options without the guard.
fn bare() -> SimulationOptions {
    SimulationOptions {
        is_unchecked: true,
        ..plain()
    }
}

fn listen(network: &mut Network, name: &str, first: usize) {
    let (len, weight) = (1, 1.0);
    let term = Term::Position { first, len, weight };
    network.listen(name, vec![term]).unwrap();
}

/// A gong of 127 masses beside a small bell.
fn gong(t60: Option<f64>) -> Network {
    let mut network = Network::new();
    for (radius, f, part) in [(6, 120.0, "gong"), (1, 300.0, "bell")] {
        network.part(part, None);
        let topology = plate(Shape::Hex, radius, Rim::Fixed).unwrap();
        let first = network.n_mat();
        network.mesh("p", &topology, 0.3, f, t60, 1e11).unwrap();
        listen(&mut network, part, first + 3);
    }
    network
}

/// A string of masses whose links follow a law; the output is its third mass.
fn string(law: &LawText<'_>) -> Network {
    let mut network = Network::new();
    network.part("gong", None);
    let law = Arc::new(Law::new(law).unwrap());
    for i in 0..12 {
        network.mas(&format!("m{i}"), 2e-3, 0.0, 0.0).unwrap();
    }
    let ends = [0.0; 2].map(|x| network.sol("end", x).unwrap());
    network.lnl("first", ends[0], 0, law.clone(), 0.0).unwrap();
    for i in 1..12 {
        let name = format!("l{i}");
        network.lnl(&name, i - 1, i, law.clone(), 0.0).unwrap();
    }
    network.lnl("last", 11, ends[1], law, 0.0).unwrap();
    listen(&mut network, "gong", 2);
    network
}

/// A strike on MAT 5 at 10 ms [N·s]; `times`: factor of the rate.
fn struck(network: &Network, impulse: f64, times: f64) -> Timeline {
    let mut timeline = Timeline::new(Rate::new(HERTZ * times).unwrap());
    timeline.open();
    timeline.strike(network, 5, 0.01, impulse, Some(0.0), 0).unwrap();
    timeline
}

fn begin(network: &Arc<Network>, impulse: f64, options: SimulationOptions) -> Simulation {
    Simulation::new(network.clone(), &struck(network, impulse, 1.0), options).unwrap()
}

/// The hardest strike that a scene survives without the guard, to 1 %, by bisection.
fn hardest(network: &Arc<Network>) -> f64 {
    let survives = |impulse: f64| begin(network, impulse, bare()).skip(N as u64).is_ok();
    let (mut low, mut high) = (1e-6, 1e3);
    assert!(survives(low) && !survives(high));
    while high > 1.01 * low {
        let middle = (low * high).sqrt();
        *(if survives(middle) { &mut low } else { &mut high }) = middle;
    }
    high
}

/// The output over N frames, computed at a rate `times` as high.
fn render(network: &Arc<Network>, impulse: f64, times: usize) -> Vec<f64> {
    let timeline = struck(network, impulse, times as f64);
    let mut simulation = Simulation::new(network.clone(), &timeline, plain()).unwrap();
    let n_out = simulation.n_out();
    let mut out = vec![0.0; n_out * N * times];
    simulation.process(&mut out).unwrap();
    out.chunks(n_out * times).map(|frame| frame[0]).collect()
}

/// Over the first `n` frames: the error relative to the truth [dB], and the difference of levels [dB].
fn errors(rendered: &[f64], truth: &[f64], n: usize) -> [f64; 2] {
    let power = |all: &mut dyn Iterator<Item = f64>| all.map(|x| x * x).sum::<f64>();
    let all = || rendered[..n].iter().zip(&truth[..n]);
    let size = power(&mut truth[..n].iter().copied());
    let error = power(&mut all().map(|(own, truth)| own - truth));
    [error, power(&mut rendered[..n].iter().copied())].map(|power| 10.0 * log10(power / size))
}

fn quintic() -> LawText<'static> {
    LawText {
        law: Some("2e4*d + 1e17*d**5"),
        damping: Some("0.02*v"),
        ..LawText::default()
    }
}

/// The error is taken over ten frames after the strike. If all of these are computed in eight steps, they equal CA at
/// eight times the rate, up to rounding. Later motion is chaotic at any rate: only its level is compared.
#[test]
fn hard_strikes_stay_near_a_finer_reference() {
    let strikes = [1.0, 2.0, 4.0, 8.0, 16.0];
    for (network, limit) in [
        (gong(Some(1.0)), [-34.0, -27.0, -29.0, -33.0, -250.0]),
        (string(&quintic()), [-21.0, -34.0, -37.0, -250.0, -250.0]),
    ] {
        let network = Arc::new(network);
        let border = hardest(&network);
        for (by, limit) in strikes.into_iter().zip(limit) {
            let [single, truth] = [1, 8].map(|times| render(&network, by * border, times));
            let [error, _] = errors(&single, &truth, 451);
            let [_, louder] = errors(&single, &truth, N);
            assert!(error < limit && louder.abs() < 2.5, "{by}: {error} {louder}");
        }
    }
}

/// Not every strike can be computed in eight steps a frame: a harder one still ends in a fault.
#[test]
fn hard_strike_beyond_eight_steps_is_a_fault() {
    let network = Arc::new(gong(Some(1.0)));
    let impulse = 64.0 * hardest(&network);
    let fault = begin(&network, impulse, plain()).skip(N as u64).unwrap_err();
    assert_eq!(fault.part, "gong");
    let mut muted = begin(&network, impulse, options(OnFault::Mute));
    muted.skip(N as u64).unwrap();
    assert_eq!(muted.muted_parts().len(), 1);
}

/// A law whose stiffness stays within the limit of eight steps never diverges.
#[test]
fn law_by_points_never_diverges() {
    let points = [(-1e-2, -9.8e4), (-2e-4, -4.0), (2e-4, 4.0), (1e-2, 9.8e4)];
    let law = LawText {
        points: Some(&points),
        ..LawText::default()
    };
    let network = Arc::new(string(&law));
    let border = hardest(&network);
    for by in [1.0, 10.0, 100.0, 1e3] {
        let mut simulation = begin(&network, by * border, plain());
        simulation.skip(N as u64).unwrap();
        assert!(simulation.n_finer() == 1, "{by}");
    }
}

/// The ledger closes while frames are computed finer, and the energy stored and lost does not exceed the energy put in.
#[test]
fn hard_struck_gong_creates_no_energy() {
    let network = Arc::new(gong(Some(1.0)));
    let border = hardest(&network);
    for by in [1.0, 2.0, 4.0, 8.0, 16.0] {
        let mut simulation = begin(&network, by * border, options(OnFault::Stop));
        simulation.skip(4 * N as u64).unwrap();
        assert!(simulation.finer_parts()[0].1 > 100);
        let energy = simulation.energy().unwrap();
        assert!(energy.residual.abs() < 1e-12 * energy.flow, "{energy:?}");
        assert!(energy.lost > 0.4 * energy.injected, "{by}: {energy:?}");
        assert!(energy.stored + energy.lost < energy.injected, "{by}: {energy:?}");
    }
}

/// If links do not stiffen so much, the guard changes no byte; if they do, it changes only their island.
#[test]
fn guard_changes_stiffened_islands_only() {
    for network in [gong(Some(1.0)), string(&quintic())] {
        let network = Arc::new(network);
        let border = hardest(&network);
        let mut guarded = begin(&network, 0.5 * border, plain());
        let mut unguarded = begin(&network, 0.5 * border, bare());
        assert!(play(&mut guarded, N, &[N]) == play(&mut unguarded, N, &[N]));
        assert!(guarded.finer_parts().is_empty());
        let mut hard = begin(&network, 2.0 * border, plain());
        let single = play(&mut hard, N, &[N]);
        let finer = hard.finer_parts();
        assert!(finer.len() == 1 && finer[0].0 == "gong" && finer[0].1 > 100 && finer[0].2 > 1);
        if let [_, bell] = network.outputs() {
            let n_out = 2;
            let alone = begin(&network, 0.5 * border, plain());
            assert_eq!((bell.name.as_str(), alone.n_out()), ("bell", n_out));
            assert!(single.iter().skip(1).step_by(n_out).all(|bits| *bits == 0));
        }
    }
}

/// A bell of 9 kHz on a string that is struck too hard: its poles are also exact in finer steps.
#[test]
fn cell_beside_hard_struck_string_keeps_its_pitch() {
    let mut network = string(&quintic());
    let border = hardest(&Arc::new(network.clone()));
    network.part("bell", None);
    let (f, t60) = (9e3, Some(1.0));
    let tie = Tie::Tuned { f, t60 };
    let bell = network.cel("b", 1e-3, tie, 1e-3, 0.0, 0.0).unwrap();
    network.spring("thread", 2, bell, 1e-3, 0.0, 0.0).unwrap();
    listen(&mut network, "bell", bell);
    let network = Arc::new(network);
    let listened = |times: usize| {
        let timeline = struck(&network, 4.0 * border, times as f64);
        let mut simulation = Simulation::new(network.clone(), &timeline, plain()).unwrap();
        let mut out = vec![0.0; 2 * N * times];
        simulation.process(&mut out).unwrap();
        assert!(times > 1 || simulation.finer_parts()[0].1 > 1_000);
        out.chunks(2 * times).map(|frame| frame[1]).collect::<Vec<f64>>()
    };
    let [error, _] = errors(&listened(1), &listened(8), N);
    assert!(error < -38.0, "{error}"); // out of tune it would be near 0
}

/// Snapshots, forks and blocks in the middle of frames that are computed finer.
#[test]
fn hard_struck_gong_survives_blocks_snapshots_and_takeover() {
    let network = Arc::new(gong(Some(1.0)));
    let impulse = 4.0 * hardest(&network);
    for method in [Method::Ca, Method::Ca2p] {
        let timeline = struck(&network, impulse, 1.0);
        let plan = Plan::new(network.clone(), &timeline, &Budget::Method(method), None).unwrap();
        let plan = Arc::new(plan);
        let begin = || Simulation::from_plan(plan.clone(), plain()).unwrap();
        let mut complete = begin();
        let before = play(&mut complete, 480, &[480]);
        let (snapshot, mut fork) = (complete.snapshot(), complete.fork());
        let after = play(&mut complete, N, &[N]);
        let output = complete.finer_parts();
        assert!(output[0].1 > 100, "{method:?} {output:?}");
        assert!(play(&mut fork, N, &[7, 64, 1]) == after, "{method:?}");
        complete.restore(&snapshot);
        assert!(play(&mut complete, N, &[300]) == after, "{method:?}");
        assert_eq!(complete.finer_parts(), output);
        // Another version takes over the parts that are the same.
        let mut old = begin();
        assert!(play(&mut old, 480, &[37]) == before);
        let mut new = Simulation::from_plan_at_frame(plan.clone(), plain(), 480).unwrap();
        let mut takeover = Takeover::new(&old, &new);
        assert!(new.take_over(&mut old, &mut takeover));
        assert!(play(&mut new, N, &[N]) == after, "{method:?}");
        assert_eq!(new.finer_parts(), output);
    }
}

/// Another gong takes over while frames are computed finer, and is damped: it plays on from that state.
#[test]
fn take_over_of_a_hard_struck_gong() {
    let network = Arc::new(gong(Some(1.0)));
    let impulse = 4.0 * hardest(&network);
    let plan = |network: &Arc<Network>| {
        let timeline = struck(network, impulse, 1.0);
        let budget = Budget::Method(Method::Ca);
        Arc::new(Plan::new(network.clone(), &timeline, &budget, None).unwrap())
    };
    let mut old = Simulation::from_plan(plan(&network), plain()).unwrap();
    let before = play(&mut old, 480, &[480]);
    let other = Arc::new(gong(Some(0.5)));
    let mut new = Simulation::from_plan_at_frame(plan(&other), plain(), 480).unwrap();
    let mut takeover = Takeover::new(&old, &new);
    assert!(new.take_over(&mut old, &mut takeover));
    new.damp(Some(0.02));
    let after = play(&mut new, N, &[N]);
    let loudest = |bits: &[u64]| bits.iter().fold(0.0_f64, |most, &x| most.max(f64::from_bits(x).abs()));
    assert!(!new.finer_parts().is_empty());
    assert!(loudest(&after) < 2.0 * loudest(&before));
    assert!(loudest(&after[2 * N - 200..]) < 0.2 * loudest(&after));
}
