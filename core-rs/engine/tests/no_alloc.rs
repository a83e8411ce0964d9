//! While it steps, a simulation does not allocate: whatever is in the scene, also from its first
//! frame, with the ledger kept, and after it was set back.

#[allow(dead_code)] // what the other tests ask of it
#[path = "scenes/scene.rs"]
mod scene;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::simulation::{OnFault, Simulation};
use scene::{Scene, options};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

fn allocations(simulation: &mut Simulation, out: &mut [f64]) -> u32 {
    reset_violation_count();
    assert_no_alloc(|| simulation.process(out)).unwrap();
    violation_count()
}

#[test]
fn the_allocator_is_watched() {
    reset_violation_count();
    drop(assert_no_alloc(|| Vec::<u8>::with_capacity(100)));
    assert!(violation_count() > 0);
}

#[test]
fn a_playing_scene_does_not_allocate() {
    for seed in 0..60 {
        let scene = Scene::random(seed);
        let mut simulation = scene.simulation(options(OnFault::Stop));
        let mut out = vec![0.0; scene.n_frames() * simulation.n_out()];
        let half = scene.n_frames() / 2 * simulation.n_out();
        assert_eq!(allocations(&mut simulation, &mut out[..half]), 0, "{seed}");
        let snapshot = simulation.snapshot();
        assert_eq!(allocations(&mut simulation, &mut out[half..]), 0, "{seed}");
        simulation.restore(&snapshot);
        assert_eq!(
            allocations(&mut simulation, &mut out[half..]),
            0,
            "{seed} again"
        );
    }
}
