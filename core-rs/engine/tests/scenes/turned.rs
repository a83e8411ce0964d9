//! A body with symmetries has several modes of each frequency. Only as many of them are computed as there are points
//! that move it, and the sound is the same.

use std::sync::Arc;

use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::network::{But, Network, Term};
use ergon_engine::plan::{Budget, Computation, Plan};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions, Takeover};
use ergon_engine::timeline::Timeline;
use ergon_engine::units::Rate;

use super::scene::options;

const SIDE: usize = 11;
const N: usize = 22_050;

/// What moves the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
enum By {
    Strikes,
    Hammer,
}

/// A square plate, moved off its axes and heard at two points. If `is_open`, further strikes may come at any point, so
/// no mode is turned and none is left out.
fn plan(by: By, is_open: bool) -> Arc<Plan> {
    let mut network = Network::new();
    network.part("plate", None);
    let topology = plate(Shape::Square, SIDE / 2, Rim::Fixed).unwrap();
    network.mesh("p", &topology, 0.2, 220.0, Some(1.0), 0.0).unwrap();
    let position = |row: usize, column: usize| row * SIDE + column;
    for (name, first) in [("left", position(2, 3)), ("right", position(8, 4))] {
        let (len, weight) = (1, 1.0);
        network
            .listen(name, vec![Term::Position { first, len, weight }])
            .unwrap();
    }
    let mut timeline = Timeline::new(Rate::new(44_100.0).unwrap());
    if is_open {
        timeline.open();
    }
    match by {
        By::Strikes => {
            for (mat, instant) in [(position(1, 4), 1e-3), (position(7, 3), 0.1), (position(1, 4), 0.2)] {
                timeline.strike(&network, mat, instant, 0.01, Some(0.0), 0).unwrap();
            }
        }
        By::Hammer => {
            network.part("hammer", None);
            let hammer = network.mas("m", 5e-3, -1e-3, 1.5).unwrap();
            let but = But::plain(4e4, 0.0, 0.0);
            network.but("b", hammer, position(1, 4), but).unwrap();
        }
    }
    Arc::new(Plan::new(Arc::new(network), &timeline, &Budget::Error(-100.0), None).unwrap())
}

fn n_computed(plan: &Plan) -> usize {
    let modes = plan.rows().iter().find_map(|row| match row.computation {
        Computation::Modes { n_computed: kept, .. } => Some(kept),
        _ => None,
    });
    modes.unwrap_or_else(|| panic!("{:?}", plan.rows()))
}

fn alone() -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: false,
        ..options(OnFault::Stop)
    }
}

fn render(simulation: &mut Simulation, n_frames: usize) -> Vec<f64> {
    let mut out = vec![0.0; n_frames * simulation.n_out()];
    simulation.process(&mut out).unwrap();
    out
}

impl By {
    /// Largest difference between the two ways of computing: from what the budget neglects, and from the resolution of
    /// contacts.
    fn apart(self) -> f64 {
        match self {
            Self::Strikes => 1e-5,
            Self::Hammer => 1e-3,
        }
    }
}

/// ‖a − b‖ / ‖b‖
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let square = |of: &mut dyn Iterator<Item = f64>| of.map(|x| x * x).sum::<f64>();
    let difference = square(&mut a.iter().zip(b).map(|(a, b)| a - b));
    (difference / square(&mut b.iter().copied())).sqrt()
}

#[test]
fn turned_modes_for_each_struck_point() {
    // (i, j) and (j, i) have the same frequency: the 121 modes have 66 frequencies.
    let pairs = SIDE * (SIDE + 1) / 2;
    for (by, limit) in [(By::Strikes, SIDE * SIDE), (By::Hammer, pairs)] {
        let (closed, open) = (plan(by, false), plan(by, true));
        assert_eq!(n_computed(&open), SIDE * SIDE);
        assert!(
            n_computed(&closed) <= limit && n_computed(&closed) > pairs / 2,
            "{by:?}"
        );
        let sound = |plan: &Arc<Plan>| {
            let mut simulation = Simulation::from_plan(plan.clone(), alone()).unwrap();
            render(&mut simulation, N)
        };
        let (closed, open) = (sound(&closed), sound(&open));
        assert!(apart(&closed, &open) < by.apart(), "{by:?}: {}", apart(&closed, &open));
    }
}

/// Another version takes over from turned modes mass by mass.
#[test]
fn take_over_from_turned_modes() {
    for by in [By::Strikes, By::Hammer] {
        let (closed, open) = (plan(by, false), plan(by, true));
        let mut complete = Simulation::from_plan(open.clone(), alone()).unwrap();
        render(&mut complete, N / 2);
        let wanted = render(&mut complete, N / 2);
        let mut old = Simulation::from_plan(closed, alone()).unwrap();
        render(&mut old, N / 2);
        let mut new = Simulation::from_plan_at_frame(open, alone(), (N / 2) as u64).unwrap();
        let mut takeover = Takeover::new(&old, &new);
        assert!(new.take_over(&mut old, &mut takeover));
        let result = render(&mut new, N / 2);
        assert!(
            apart(&result, &wanted) < by.apart(),
            "{by:?}: {}",
            apart(&result, &wanted)
        );
    }
}
