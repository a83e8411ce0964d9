//! Block size, snapshots, and faults in other parts change no byte.

use super::scene::{Scene, options};
use ergon_engine::simulation::{OnFault, Simulation};
use proptest::prelude::*;

/// Continue, cycling through these block sizes.
pub(crate) fn play(simulation: &mut Simulation, n_frames: usize, blocks: &[usize]) -> Vec<u64> {
    let n_out = simulation.n_out();
    let mut out = vec![f64::NAN; n_frames * n_out];
    let (mut rest, mut sizes) = (&mut out[..], blocks.iter().cycle());
    while !rest.is_empty() {
        let size = (sizes.next().unwrap() * n_out).min(rest.len());
        let (block, after) = rest.split_at_mut(size);
        simulation.process(block).unwrap();
        rest = after;
    }
    out.iter().map(|sample| sample.to_bits()).collect()
}

/// Everything that can be read from a simulation, as bits.
fn seen(simulation: &Simulation) -> String {
    format!(
        "{:?} {:?} {:?} {:?} {:?}",
        simulation.positions(),
        simulation.steps(),
        simulation.energy(),
        simulation.reports(),
        simulation.muted_parts(),
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn blocks_of_any_size_give_the_same_bytes(seed in any::<u64>(), blocks in prop::collection::vec(1..700_usize, 1..6)) {
        let scene = Scene::random(seed);
        let n = scene.n_frames();
        let mut whole = scene.simulation(options(OnFault::Mute));
        let mut split = scene.simulation(options(OnFault::Mute));
        prop_assert!(play(&mut whole, n, &[n]) == play(&mut split, n, &blocks));
        prop_assert_eq!(seen(&whole), seen(&split));
        prop_assert!(whole.muted_parts().is_empty(), "a scene that diverges tests little: {:?}", whole.muted_parts());
    }

    /// A snapshot is taken in the middle of gestures, flights, throws, fades and contacts.
    #[test]
    fn snapshot_restores_the_complete_state(seed in any::<u64>(), part in 0.0..1.0_f64) {
        let scene = Scene::random(seed);
        let at = (part * scene.n_frames() as f64) as usize;
        let rest = scene.n_frames() - at;
        let mut simulation = scene.simulation(options(OnFault::Mute));
        play(&mut simulation, at, &[64]);
        let snapshot = simulation.snapshot();
        let first = play(&mut simulation, rest, &[64]);
        let end = seen(&simulation);
        simulation.restore(&snapshot);
        prop_assert_eq!(simulation.frame(), at as u64);
        prop_assert!(play(&mut simulation, rest, &[17]) == first);
        prop_assert_eq!(seen(&simulation), end);
    }
}

#[test]
fn skip_equals_play() {
    let scene = Scene::random(11);
    let mut played = scene.simulation(options(OnFault::Stop));
    let mut skipped = scene.simulation(options(OnFault::Stop));
    play(&mut played, 1_000, &[64]);
    skipped.skip(1_000).unwrap();
    assert_eq!(seen(&played), seen(&skipped));
}

#[test]
fn empty_scene_advances_its_frames() {
    let scene = Scene::new(44_100.0, 0);
    let mut simulation = scene.simulation(options(OnFault::Stop));
    simulation.skip(100).unwrap();
    simulation.process(&mut []).unwrap();
    assert_eq!((simulation.frame(), simulation.n_out()), (100, 0));
    assert_eq!(simulation.energy().map(|energy| energy.flow), Some(0.0));
}
