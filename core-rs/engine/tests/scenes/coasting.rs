//! While nothing touches, many frames are computed at a time: the bits are those of single frames.

use std::sync::Arc;

use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{ErgonKind, Gesture, Manner, Touch};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network::{But, Network, Side, Term, Tie};
use ergon_engine::plan::{Budget, Choice, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::blocks::play;
use super::scene::options;

const N: usize = 30_000;

/// How contacts are computed.
#[derive(Clone, Copy)]
enum Contacts {
    /// Finely, between frames.
    Fine,
    /// Once a step, in this many steps a frame.
    Plain(u32),
}

/// All ways to compute contacts.
const CONTACTS: [Contacts; 3] = [Contacts::Fine, Contacts::Plain(1), Contacts::Plain(2)];

/// The plan of a scene, with its contacts computed in one of these ways.
fn planned(network: Network, timeline: &Timeline, contacts: Contacts) -> Arc<Plan> {
    let (network, budget) = (Arc::new(network), Budget::Error(-60.0));
    let plan = |choices| Plan::new(network.clone(), timeline, &budget, choices).unwrap();
    let fine = plan(None);
    let Contacts::Plain(oversampling) = contacts else {
        return Arc::new(fine);
    };
    let once = |choice: &Choice| match choice.numbers() {
        (modules, _, substeps, bodies, cost, order) if substeps > 1 => {
            Choice::from_numbers((modules, oversampling, 1, bodies, cost, order)).unwrap()
        }
        _ => choice.clone(),
    };
    let choices = fine.choices().iter().map(once).collect();
    Arc::new(plan(Some(choices)))
}

/// A hammer flies to and fro between a plate and a tied mass that lies `below` it [m]; all three are struck. Outputs:
/// the plate, the positions of the other two, and the contact forces.
fn plan(below: f64, contacts: Contacts) -> Arc<Plan> {
    let mut network = Network::new();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    let position = |first| Term::Position {
        first,
        len: 1,
        weight: 1.0,
    };
    network.part("plate", None);
    let topology = plate(Shape::Square, 3, Rim::Fixed).unwrap();
    network.mesh("p", &topology, 0.1, 90.0, Some(0.3), 0.0).unwrap();
    network.listen("plate", vec![position(16)]).unwrap();
    network.part("hammer", None);
    let hammer = network.mas("m", 5e-3, -1e-3, 1.5).unwrap();
    let tie = Tie::Tuned {
        f: 31.0,
        t60: Some(0.3),
    };
    let reed = network.cel("reed", 2e-2, tie, -below, -below, 0.0).unwrap();
    let but = |side| But {
        side,
        ..But::plain(2e4, 0.2, 0.0)
    };
    let first = network.n_lia();
    network.but("to", hammer, 24, but(Side::Below)).unwrap();
    network.but("fro", hammer, reed, but(Side::Above)).unwrap();
    network
        .listen("flight", vec![position(hammer), position(reed)])
        .unwrap();
    let force = Term::Force {
        first,
        len: 2,
        weight: 1.0,
    };
    network.listen("force", vec![force]).unwrap();
    for (mat, instant, impulse, lasts) in [
        (9, 0.2, 3e-3, Some(0.0)),
        (hammer, 0.3, 4e-3, None),
        (hammer, 0.300_01, 4e-3, None),
        (reed, 0.31, 1e-3, Some(5e-3)),
        (9, 0.45, -2e-3, None),
    ] {
        timeline.strike(&network, mat, instant, impulse, lasts, 0).unwrap();
    }
    planned(network, &timeline, contacts)
}

/// The outputs, in blocks of these sizes; then the reports of gestures and the final state.
fn played(plan: &Arc<Plan>, blocks: &[usize]) -> (Vec<u64>, String) {
    let options = SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    };
    let mut simulation = Simulation::from_plan(plan.clone(), options).unwrap();
    let sound = play(&mut simulation, N, blocks);
    let output = format!("{:?} {:?}", simulation.reports(), simulation.positions());
    (sound, output)
}

#[test]
fn coasting_frames_equal_frames_in_sequence() {
    let cases = [2e-2, 0.4].into_iter();
    for (below, contacts) in cases.flat_map(|below| CONTACTS.map(|contacts| (below, contacts))) {
        let plan = plan(below, contacts);
        let single_by_one = played(&plan, &[1]);
        let touches = single_by_one.0.chunks(3).map(|frame| frame[2] << 1 != 0);
        let (closed, open) = touches.fold((0, 0), |(closed, open), is_closed| {
            (closed + i32::from(is_closed), open + i32::from(!is_closed))
        });
        assert!(closed > 20 && open > 10_000, "{closed} {open}");
        assert!(played(&plan, &[N]) == single_by_one);
        assert!(played(&plan, &[2, 63, 7, 64, 300]) == single_by_one);
    }
}

/// A key throws a hammer at two reeds, `gap` away from it at rest. Its gestures are open and tracked, by events and by
/// particles; the parts are also struck.
fn keyed(gap: f64, contacts: Contacts) -> Arc<Plan> {
    let mut network = Network::new();
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    let spring = Tie::Physical { k: 60.0, z: 1.2 };
    network.part("k", None);
    let key = network.cel("key", 0.4, spring, 0.0, 0.0, 0.0).unwrap();
    network.part("harp", None);
    let mut cel = |name, mass, f, t60| {
        let tie = Tie::Tuned { f, t60: Some(t60) };
        network.cel(name, mass, tie, 0.0, 0.0, 0.0).unwrap()
    };
    let hammer = cel("hammer", 4e-3, 1.0, 0.6);
    let reeds = [cel("low", 0.08, 160.0, 0.3), cel("high", 0.06, 320.0, 0.2)];
    let below = |gap| But {
        side: Side::Below,
        ..But::plain(4e3, 2.0, gap)
    };
    for (name, reed) in ["a", "b"].into_iter().zip(reeds) {
        network.but(name, hammer, reed, below(gap)).unwrap();
    }
    network.but("push", key, hammer, below(5e-4)).unwrap();
    let terms = [key, hammer, reeds[0], reeds[1]].map(|first| Term::Position {
        first,
        len: 1,
        weight: 1.0,
    });
    network.listen("harp", terms.to_vec()).unwrap();
    let single = timeline.add_key("k", key);
    for (position, touch, ergons) in [
        (0.05, Touch::Open, ErgonKind::Event),
        (0.2, Touch::Tracked, ErgonKind::Event),
        (0.35, Touch::Open, ErgonKind::Particle),
        (0.431, Touch::Open, ErgonKind::Event),
    ] {
        let written = WrittenPoints {
            t: &[position, position + 0.04, position + 0.08],
            x: &[0.0, 6e-3, 0.0],
            approaches: &[Approach::Path(Curve::Smooth); 3],
            sources: &[],
        };
        let manner = Manner {
            touch,
            ergon_kind: ergons,
            ..Manner::OPEN
        };
        let gesture = Gesture::from_points(single, &written, manner).unwrap();
        timeline.add_gesture(gesture).unwrap();
    }
    for (mat, position, impulse) in [(reeds[1], 0.3, 2e-3), (hammer, 0.6, 4e-3)] {
        timeline.strike(&network, mat, position, impulse, None, 0).unwrap();
    }
    planned(network, &timeline, contacts)
}

#[test]
fn coasting_between_gestures_of_a_key() {
    let cases = [7e-3, 1e-4].into_iter();
    for (gap, contacts) in cases.flat_map(|gap| CONTACTS.map(|contacts| (gap, contacts))) {
        let plan = keyed(gap, contacts);
        let single_by_one = played(&plan, &[1]);
        assert!(played(&plan, &[N]) == single_by_one);
        assert!(played(&plan, &[2, 63, 7, 44, 300]) == single_by_one);
    }
}
