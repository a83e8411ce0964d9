//! Routes of one output that follow each other are filtered once: they sound as routes that stand apart.

use super::super::*;
use crate::mix::delay::Echo;

const RATE: f64 = 48_000.0;

/// Routes of two outputs, each to both channels and two rooms; those of one output side by side, or apart.
fn mixer(side_by_side: bool, gain: f64) -> Mixer {
    let mut mixer = Mixer::new(RATE, 2, 2);
    for (name, channel) in [("left", 0), ("right", 1)] {
        let room_spec = RoomSpec {
            name: name.to_owned(),
            size: 10.0,
            t60: [(200.0, 1.5), (6_000.0, 0.8)],
            channels: vec![channel],
            gain: 1.0,
        };
        mixer.add_room(room_spec).unwrap();
    }
    let targets = [
        RouteTarget::Channel(0),
        RouteTarget::Room(0),
        RouteTarget::Channel(1),
        RouteTarget::Room(1),
    ];
    let routes_apart = targets.map(|to| [(0, to), (1, to)]).concat();
    let routes_beside = [0, 1].map(|out| targets.map(|to| (out, to))).concat();
    for (out, to) in if side_by_side { routes_beside } else { routes_apart } {
        let delay = if out == 1 { 40 } else { 0 };
        let treatment = RouteTreatment {
            filters: vec![FilterKind::Highpass { f: 8.0 }, FilterKind::Lowpass { f: 3_000.0 }],
            is_squared: out == 1,
            delay,
            echo: (delay > 0).then_some(Echo {
                delay_frames: 30,
                feedback_ratio: 0.5,
            }),
            curve: None,
        };
        mixer.add_treated_route(out, out, to, gain, treatment).unwrap();
    }
    mixer
}

fn mixed(mixer: &mut Mixer, n_frames: usize) -> Vec<u64> {
    let first_frame = mixer.frame as usize;
    let test_sample = |index: usize| ((index * 7_919) % 1_013) as f64 / 500.0 - 1.0;
    let frames: Vec<f64> = (2 * first_frame..2 * (first_frame + n_frames))
        .map(test_sample)
        .collect();
    let mut mixed_sums = vec![0.0; 2 * n_frames];
    mixer.process(&frames, &mut mixed_sums);
    mixed_sums.into_iter().map(f64::to_bits).collect()
}

#[test]
fn repeated_routes_equal_separate_ones() {
    let (mut beside_mixer, mut apart_mixer) = (mixer(true, 0.5), mixer(false, 0.5));
    for n_frames in [1, 255, 3_000] {
        assert_eq!(mixed(&mut beside_mixer, n_frames), mixed(&mut apart_mixer, n_frames));
        let group_gain = 1.0 / n_frames as f64;
        beside_mixer.set_gain(1, group_gain);
        apart_mixer.set_gain(1, group_gain);
    }
}

#[test]
fn repeated_routes_after_take_over() {
    let (mut beside_mixer, mut apart_mixer) = (mixer(true, 0.5), mixer(false, 0.5));
    assert_eq!(mixed(&mut beside_mixer, 1_000), mixed(&mut apart_mixer, 1_000));
    for gain in [0.25, 0.0, 1.0] {
        let (mut next_beside, mut next_apart) = (mixer(true, gain), mixer(false, gain));
        next_beside.take_over(&mut beside_mixer, None);
        next_apart.take_over(&mut apart_mixer, None);
        (beside_mixer, apart_mixer) = (next_beside, next_apart);
        assert_eq!(mixed(&mut beside_mixer, 700), mixed(&mut apart_mixer, 700), "{gain}");
    }
}

#[test]
fn repeated_route_added_later_begins_at_rest() {
    // A silent route between the two keeps them apart.
    let routed_mixer = |apart: bool, count: usize| {
        let mut mixer = Mixer::new(RATE, 2, 2);
        mixer.add_route(0, 0, 1.0, Some(8.0)).unwrap();
        if apart {
            mixer.add_route(1, 0, 0.0, None).unwrap();
        }
        for _ in 1..count {
            mixer.add_route(0, 1, 1.0, Some(8.0)).unwrap();
        }
        mixer
    };
    let sound_bits = [false, true].map(|apart| {
        let mut mixer_before = routed_mixer(apart, 1);
        mixed(&mut mixer_before, 1_000);
        let mut mixer_after = routed_mixer(apart, 2);
        mixer_after.take_over(&mut mixer_before, None);
        mixed(&mut mixer_after, 2_000)
    });
    assert_eq!(sound_bits[0], sound_bits[1]);
}
