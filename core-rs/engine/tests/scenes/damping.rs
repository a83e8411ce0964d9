//! Additional damping: everything decays faster, by the decay time that was set.

use std::sync::Arc;

use ergon_engine::law::{Law, LawText};
use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::plan::{Budget, Method, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::options;

const RATE: f64 = 44_100.0;

fn plain() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

/// T60 of an output [s], from its level in two stretches of 50 ms.
fn t60(simulation: &mut Simulation, output: usize, apart: f64) -> f64 {
    let first = level(simulation, output);
    simulation.skip(((apart - 0.05) * RATE) as u64).unwrap();
    60.0 * apart / (first - level(simulation, output))
}

/// The level of an output over 50 ms [dB].
fn level(simulation: &mut Simulation, output: usize) -> f64 {
    let mut sound = vec![0.0; (0.05 * RATE) as usize * simulation.n_out()];
    simulation.process(&mut sound).unwrap();
    let single = sound.iter().skip(output).step_by(simulation.n_out());
    10.0 * ergon_engine::maths::log10(single.map(|x| x * x).sum::<f64>())
}

/// The additional damping adds to the own damping, for each method and frequency, until it is changed or another
/// version takes over.
#[test]
fn extra_damping_adds_to_decay() {
    let damping = 0.8;
    let ln_1000 = 6.907_755_278_982_137;
    // Damping in proportion to mass: all modes of these bodies have the same decay time.
    let single = 2.0;
    let mut network = Network::new();
    // The last pitch is 1/16 of the rate: every eighth frame has the same phase, up to its sign.
    let pitches = [220.0, 3_000.0, 2_756.25];
    for (i, f) in pitches.into_iter().enumerate() {
        network.part(&format!("bell{i}"), None);
        let tie = Tie::Tuned { f, t60: Some(single) };
        let m = network.cel("m", 2e-3, tie, 0.0, 1e-3, 0.0).unwrap();
        let term = Term::Position {
            first: m,
            len: 1,
            weight: 1.0,
        };
        network.listen("bell", vec![term]).unwrap();
    }
    let law = LawText {
        law: Some("2e4*d + 1e6*d**3"),
        ..LawText::default()
    };
    let law = Arc::new(Law::new(&law).unwrap());
    for (name, law, every) in [
        ("string", None, None),
        ("net", Some(&law), None),
        ("slow", None, Some(4)),
    ] {
        network.part(name, None);
        if let Some(every) = every {
            network.macrostep(every);
        }
        let first = network.n_mat();
        for i in 0..12 {
            let z = 2.0 * ln_1000 / single * 2e-3;
            let k = if i == 0 || i == 11 { 4e3 } else { 0.0 };
            let tie = Tie::Physical { k, z };
            let x0 = if i == 5 { 1e-4 } else { 0.0 };
            network.cel(&format!("s{i}"), 2e-3, tie, 0.0, x0, 0.0).unwrap();
        }
        for i in first..first + 11 {
            match law {
                Some(law) => network.lnl("l", i, i + 1, law.clone(), 0.0),
                None => network.spring("l", i, i + 1, 2e4, 0.0, 0.0),
            }
            .unwrap();
        }
        let term = Term::Position {
            first: first + 8,
            len: 1,
            weight: 1.0,
        };
        network.listen(name, vec![term]).unwrap();
    }
    let network = Arc::new(network);
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    let both = 1.0 / (1.0 / single + 1.0 / damping);
    let budgets = [
        Budget::default(),
        Budget::Method(Method::Ca),
        Budget::Method(Method::Ca2p),
        Budget::Method(Method::Bm4),
        Budget::Method(Method::Ieq),
    ];
    for budget in budgets {
        let plan = Plan::new(network.clone(), &timeline, &budget, None).unwrap();
        let plan = Arc::new(plan);
        let start = Simulation::from_plan(plan.clone(), plain()).unwrap();
        for output in 0..start.n_out() {
            let mut simulation = start.fork();
            simulation.damp(Some(damping));
            let result = t60(&mut simulation, output, 0.5);
            assert!(
                (result / both - 1.0).abs() < 0.02,
                "{budget:?} {output}: {result} {both}"
            );
            let from = simulation.frame();
            let mut next = Simulation::from_plan_at_frame(plan.clone(), plain(), from).unwrap();
            let mut takeover = Takeover::new(&simulation, &next);
            assert!(next.take_over(&mut simulation, &mut takeover));
            let result = t60(&mut next, output, 0.5);
            assert!(
                (result / single - 1.0).abs() < 0.02,
                "{budget:?} {output}: {result} {single} after"
            );
        }
        // Everything that sounded is 60 dB down soon after the decay time that was set.
        let mut simulation = start.fork();
        simulation.damp(Some(3.0));
        let mut sound = vec![0.0; (3.5 * RATE) as usize * start.n_out()];
        simulation.process(&mut sound).unwrap();
        let peak = |sound: &[f64]| sound.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
        let tail = (0.05 * RATE) as usize * start.n_out();
        assert!(
            peak(&sound[sound.len() - tail..]) < 1e-3 * peak(&sound[..tail]),
            "{budget:?}"
        );
    }
}
