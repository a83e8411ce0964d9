mod repeated_routes;

use super::route::DELAY_MAX;
use super::*;
use crate::maths;
use crate::mix::curve::{Pan, PanChannel, Point, Segment};
use crate::mix::delay::Echo;

/// Three outputs: noise, a small offset with noise (a hand that leans), and a constant with one broken sample.
fn frames(n: usize) -> Vec<f64> {
    let noise_frame = |i: usize| {
        let noise = maths::sin((i * i % 7919) as f64);
        [noise, 5e-3 + 1e-3 * noise, if i == 17 { f64::NAN } else { 0.1 }]
    };
    (0..n).flat_map(noise_frame).collect()
}

fn mixer() -> Mixer {
    let mut mixer = Mixer::new(44_100.0, 3, 2);
    mixer.add_route(0, 0, 0.5, None).unwrap();
    mixer.add_route(1, 1, 1.0, Some(8.0)).unwrap();
    mixer.add_route(0, 1, -0.25, None).unwrap();
    mixer.add_route(2, 1, 0.1, Some(8.0)).unwrap();
    mixer
}

#[test]
fn mixer_sums_its_routes() {
    let frames = frames(1000);
    let mut mixed = vec![f64::NAN; 2000];
    let mut mixer = Mixer::new(48_000.0, 3, 2);
    mixer.add_route(0, 0, 0.5, None).unwrap();
    mixer.add_route(1, 0, 2.0, None).unwrap();
    mixer.process(&frames, &mut mixed);
    for (i, out) in mixed.chunks(2).enumerate() {
        assert_eq!(out, [0.5 * frames[3 * i] + 2.0 * frames[3 * i + 1], 0.0]);
    }
}

#[test]
fn mixer_in_blocks_of_any_size() {
    let frame_count = 5000;
    let frames = frames(frame_count);
    let mut complete = vec![0.0; 2 * frame_count];
    mixer().process(&frames, &mut complete);
    let mut block_output = vec![0.0; 2 * frame_count];
    let (mut mixer, mut position) = (mixer(), 0);
    for size in [1, 64, 7, 0, 4096, 333].into_iter().cycle() {
        let block_end = (position + size).min(frame_count);
        mixer.process(
            &frames[3 * position..3 * block_end],
            &mut block_output[2 * position..2 * block_end],
        );
        position = block_end;
        if position == frame_count {
            break;
        }
    }
    assert_eq!(complete, block_output);
    assert!(complete.iter().all(|x| x.is_finite()), "one bad sample does not stay");
}

/// Of two groups, one changes its gain at frame 1000 of the piece: the other keeps its bits.
#[test]
fn group_gain_glides_alike_in_blocks() {
    let frame_count = 4000;
    let frames = frames(frame_count);
    let mixed = |block: usize| {
        let mut mixer = Mixer::new(44_100.0, 3, 2);
        mixer.add_route_in_group(0, 0, 0, 0.5, None).unwrap();
        mixer.add_route_in_group(2, 0, 1, 0.5, None).unwrap();
        mixer.add_route_in_group(2, 1, 1, 1.0, Some(8.0)).unwrap();
        assert_eq!(mixer.n_groups(), 3);
        mixer.seek(500);
        let mut mixed = vec![0.0; 2 * frame_count];
        let mut position = 0;
        while position < frame_count {
            if position == 500 {
                mixer.set_gain(2, 0.5);
                mixer.set_gain(7, 9.0);
            }
            let block_end = (position + block).min(if position < 500 { 500 } else { frame_count });
            mixer.process(
                &frames[3 * position..3 * block_end],
                &mut mixed[2 * position..2 * block_end],
            );
            position = block_end;
        }
        mixed
    };
    let complete = mixed(frame_count);
    for block in [1, 44, 64, 333] {
        assert_eq!(mixed(block), complete);
    }
    let mut plain_output = vec![0.0; 2 * frame_count];
    let mut mixer = Mixer::new(44_100.0, 3, 2);
    mixer.add_route(0, 0, 0.5, None).unwrap();
    mixer.add_route(0, 1, 0.5, None).unwrap();
    mixer.add_route(1, 1, 1.0, Some(8.0)).unwrap();
    mixer.process(&frames, &mut plain_output);
    for (i, (now, was)) in complete.chunks(2).zip(plain_output.chunks(2)).enumerate() {
        assert_eq!(now[0], was[0]);
        // Frame 1024 of the piece is the first multiple of 64 after 1000; 896 frames are 20 ms, rounded up.
        let u = (i as f64 + 500.0 - 1024.0) / 896.0;
        let u = u.clamp(0.0, 1.0);
        let expected_gain = 1.0 - 0.5 * (3.0 - 2.0 * u) * u * u;
        assert!((now[1] - expected_gain * was[1]).abs() < 1e-15, "frame {i}");
    }
}

#[test]
fn highpass_removes_a_constant_offset() {
    let frame_count = 88_200;
    let mut mixer = Mixer::new(44_100.0, 1, 1);
    mixer.add_route(0, 0, 1.0, Some(8.0)).unwrap();
    let mut mixed = vec![0.0; frame_count];
    mixer.process(&vec![0.02; frame_count], &mut mixed);
    assert!(mixed[0] > 0.019 && mixed[frame_count - 1].abs() < 1e-15);
}

#[test]
fn route_with_wrong_values_is_refused() {
    let mut mixer = Mixer::new(44_100.0, 3, 2);
    assert_eq!(
        mixer.add_route(3, 0, 1.0, None),
        Err(RouteError::Out { out: 3, n_out: 3 })
    );
    let channel = RouteError::Channel {
        channel: 2,
        n_channels: 2,
    };
    assert_eq!(mixer.add_route(0, 2, 1.0, None), Err(channel));
    assert!(mixer.add_route(0, 0, f64::NAN, None).is_err());
    for cutoff in [0.0, -1.0, 22_050.0, f64::NAN] {
        assert!(mixer.add_route(0, 0, 1.0, Some(cutoff)).is_err());
    }
}

/// A mixer with two rooms, a delay, curves and a fade.
fn hall() -> Mixer {
    let mut mixer = Mixer::new(44_100.0, 3, 2);
    for (name, t60) in [("hall", 1.0), ("cellar", 0.4)] {
        let room_spec = RoomSpec {
            name: name.to_owned(),
            size: 5.0,
            t60: [(200.0, t60), (6_000.0, 0.5 * t60)],
            channels: vec![1, 0],
            gain: 0.5,
        };
        mixer.add_room(room_spec).unwrap();
    }
    let smooth_point = |frame: i64, value: f64| Point {
        frame,
        value,
        segment: Segment::Smooth,
    };
    let level_curve = Curve::new(vec![smooth_point(100, 0.1), smooth_point(3000, 1.0)]);
    let treatment = RouteTreatment {
        filters: vec![
            FilterKind::Highpass { f: 8.0 },
            FilterKind::Lowpass { f: 9_000.0 },
            FilterKind::Highshelf {
                f: 2_000.0,
                level: -5.0,
            },
        ],
        delay: 37,
        echo: Some(Echo {
            delay_frames: 30,
            feedback_ratio: 0.5,
        }),
        curve: Some(level_curve.with_pan(Pan::new(
            vec![smooth_point(0, -0.5), smooth_point(4000, 0.9)],
            PanChannel::Second,
        ))),
        ..RouteTreatment::default()
    };
    mixer
        .add_treated_route(0, 1, RouteTarget::Channel(0), 0.5, treatment.clone())
        .unwrap();
    mixer
        .add_treated_route(1, 1, RouteTarget::Room(0), 0.3, treatment)
        .unwrap();
    let plain_treatment = RouteTreatment::default();
    mixer
        .add_treated_route(0, 0, RouteTarget::Room(1), 0.7, plain_treatment.clone())
        .unwrap();
    mixer
        .add_treated_route(0, 0, RouteTarget::Channel(1), 1.0, plain_treatment)
        .unwrap();
    mixer.set_master_curve(Curve::new(vec![smooth_point(4000, 1.0), smooth_point(4900, 0.0)]));
    mixer
}

#[test]
fn treatments_in_blocks_and_after_take_over() {
    let frame_count = 5000;
    let frames = frames(frame_count);
    let mut complete = vec![0.0; 2 * frame_count];
    hall().process(&frames, &mut complete);
    assert!(complete[2 * 4900..].iter().all(|x| *x == 0.0));
    assert!(complete[2 * 2000] != 0.0);
    for block in [1, 44, 333] {
        let mut mixer = hall();
        let mut block_output = vec![0.0; 2 * frame_count];
        for (i, (x, y)) in frames
            .chunks(3 * block)
            .zip(block_output.chunks_mut(2 * block))
            .enumerate()
        {
            // Another version of the mix takes over.
            if i == 7 {
                let mut next_mixer = hall();
                next_mixer.take_over(&mut mixer, None);
                mixer = next_mixer;
            }
            mixer.process(x, y);
        }
        assert_eq!(block_output, complete);
    }
}

#[test]
fn treated_with_wrong_room_or_delay_is_refused() {
    let mut mixer = hall();
    let late_treatment = RouteTreatment {
        delay: DELAY_MAX + 1,
        ..RouteTreatment::default()
    };
    assert!(
        mixer
            .add_treated_route(0, 0, RouteTarget::Channel(0), 1.0, late_treatment)
            .is_err()
    );
    let plain_treatment = RouteTreatment::default();
    let room_error = RouteError::Room { room: 2, n_rooms: 2 };
    assert_eq!(
        mixer.add_treated_route(0, 0, RouteTarget::Room(2), 1.0, plain_treatment),
        Err(room_error)
    );
}

/// Output for a constant input of 1 from frame 1000 on, where a mixer has taken over from another.
fn taken_over(before: &[(usize, f64)], after: &[(usize, f64)], block: usize) -> Vec<f64> {
    let mixer = |routes: &[(usize, f64)]| {
        let mut mixer = Mixer::new(44_100.0, 1, 2);
        for &(channel, gain) in routes {
            mixer.add_route(0, channel, gain, None).unwrap();
        }
        mixer
    };
    let (mut old_mixer, mut new_mixer) = (mixer(before), mixer(after));
    old_mixer.process(&[1.0; 1000], &mut [0.0; 2000]);
    new_mixer.take_over(&mut old_mixer, None);
    let mut mixed = vec![0.0; 4000];
    for part in mixed.chunks_mut(2 * block) {
        new_mixer.process(&vec![1.0; part.len() / 2], part);
    }
    mixed
}

#[test]
fn take_over_fades_routes_and_glides_gains() {
    let faded_mix = taken_over(&[(0, 0.5)], &[(1, 0.25)], 2000);
    let glided_mix = taken_over(&[(0, 0.5)], &[(0, 1.0)], 2000);
    for block in [1, 64, 333] {
        assert_eq!(taken_over(&[(0, 0.5)], &[(1, 0.25)], block), faded_mix);
    }
    let frame_pairs = faded_mix.chunks(2).zip(glided_mix.chunks(2)).enumerate();
    for (i, (faded_mix, glided_mix)) in frame_pairs {
        // Frame 1024 is the first multiple of 64 after 1000; 896 frames are 20 ms, rounded up.
        let u = ((i as f64 - 24.0) / 896.0).clamp(0.0, 1.0);
        let fade_share = (3.0 - 2.0 * u) * u * u;
        for (is, wanted) in [
            (faded_mix[0], 0.5 * (1.0 - fade_share)),
            (faded_mix[1], 0.25 * fade_share),
            (glided_mix[0], 0.5 + 0.5 * fade_share),
        ] {
            assert!((is - wanted).abs() < 1e-15, "frame {i}: {is}, {wanted}");
        }
    }
    let unchanged_mix = taken_over(&[(0, 0.5), (1, 2.0)], &[(1, 2.0), (0, 0.5)], 2000);
    assert!(unchanged_mix.chunks(2).all(|frame| frame == [0.5, 2.0]));
}

fn level(frame: i64, value: f64) -> Point {
    let method = Segment::Line;
    Point {
        frame,
        value,
        segment: method,
    }
}

/// The output for an input of 1 over 3000 frames. At frame 1000 a mixer with another curve takes over: a curve of the
/// route, or of all channels.
fn turned(before: &[Point], after: &[Point], is_route: bool, block: usize) -> Vec<f64> {
    let mixer = |points: &[Point]| {
        let mut mixer = Mixer::new(44_100.0, 1, 1);
        let curve = (!points.is_empty()).then(|| Curve::new(points.to_vec()));
        let treatment = RouteTreatment {
            curve: curve.clone().filter(|_| is_route),
            ..RouteTreatment::default()
        };
        mixer
            .add_treated_route(0, 0, RouteTarget::Channel(0), 1.0, treatment)
            .unwrap();
        curve
            .filter(|_| !is_route)
            .into_iter()
            .for_each(|curve| mixer.set_master_curve(curve));
        mixer
    };
    let (mut old_mixer, mut new_mixer) = (mixer(before), mixer(after));
    let mut gains = vec![0.0; 3000];
    old_mixer.process(&[1.0; 1000], &mut gains[..1000]);
    new_mixer.take_over(&mut old_mixer, None);
    for part in gains[1000..].chunks_mut(block) {
        new_mixer.process(&vec![1.0; part.len()], part);
    }
    gains
}

#[test]
fn take_over_of_a_reversed_fade_without_jump() {
    let fade_out = [level(0, 1.0), level(500, 0.0)];
    let late_rise = [level(0, 0.0), level(990, 0.0), level(200_000, 1.0)];
    for is_route in [false, true] {
        for (before, after) in [
            (&fade_out[..], &[][..]),  // faded out, and back
            (&[][..], &fade_out[..]),  // and forth
            (&[][..], &late_rise[..]), // to a fade that has hardly begun
        ] {
            let turned_gains = turned(before, after, is_route, 2000);
            for block in [1, 64, 333] {
                assert_eq!(turned(before, after, is_route, block), turned_gains);
            }
            let last_gain = *turned_gains.last().unwrap();
            let new_curve = Curve::new(after.to_vec());
            assert!((last_gain - new_curve.gain_at(2999)).abs() < 1e-12, "{last_gain}");
            assert!(
                turned_gains[999..].iter().all(|x| (0.0..1.001).contains(x)),
                "no overshoot"
            );
            let gain_steps = turned_gains[999..].windows(2).map(|pair| (pair[1] - pair[0]).abs());
            assert!(gain_steps.fold(0.0, f64::max) < 1.5 * 1.01 / 896.0);
        }
    }
}

#[test]
fn mixer_without_inputs_or_outputs() {
    Mixer::new(44_100.0, 0, 2).process(&[], &mut [1.0; 8]);
    Mixer::new(44_100.0, 0, 0).process(&[], &mut []);
}

/// A mixer of one output; a frozen ramp begins at `start_frame`, if that is given.
fn ramp(source: &Arc<FrozenOutputs>, start_frame: Option<i64>) -> Mixer {
    let mut mixer = Mixer::new(44_100.0, 1, 1);
    mixer.add_route(0, 0, 1.0, None).unwrap();
    if let Some(start_frame) = start_frame {
        mixer.add_frozen_outputs(source, &[0], start_frame).unwrap();
    }
    mixer
}

#[test]
fn frozen_outputs_begin_and_move_without_a_jump() {
    let samples: Vec<f64> = (0..6_000).map(|n| 1.0 + f64::from(n) * 1e-4).collect();
    let source = Arc::new(FrozenOutputs::new(samples, 1));
    let played_samples = |block: usize| {
        let mut mixer = ramp(&source, Some(0));
        let mut listened = Vec::new();
        // Unchanged at 1000, moved at 2000, taken over during the fade at 2100, removed at 4000.
        let changes = [(1000, Some(0)), (2000, Some(500)), (2100, Some(500)), (4000, None)];
        while listened.len() < 6_000 {
            let position = listened.len();
            if let Some((_, start_frame)) = changes.iter().find(|change| change.0 == position) {
                let mut next = ramp(&source, *start_frame).clone();
                next.take_over(&mut mixer, None);
                mixer = next;
            }
            let next = changes.iter().map(|change| change.0).find(|&next| next > position);
            let n = block.min(next.unwrap_or(6_000) - position);
            let mut mixed = vec![0.0; n];
            mixer.process(&vec![0.0; n], &mut mixed);
            listened.extend(mixed);
        }
        listened
    };
    let listened = played_samples(4096);
    let ramp_sample = |n: usize| 1.0 + n as f64 * 1e-4;
    assert!((0..2000).all(|n| listened[n] == ramp_sample(n)));
    assert!((2048 + 896..4000).all(|n| listened[n] == ramp_sample(n - 500)));
    assert!(listened[4032 + 896..].iter().all(|&x| x == 0.0));
    let sample_steps = listened.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    assert!(sample_steps.fold(0.0, f64::max) < 1.5 * 1.4 / 896.0 + 1e-4);
    assert_eq!(listened, played_samples(7));
}

#[test]
fn frozen_outputs_follow_a_renumbered_output() {
    let source = Arc::new(FrozenOutputs::new(vec![1.0; 4_000], 1));
    let mut old_mixer = ramp(&source, Some(0));
    let mut new_mixer = Mixer::new(44_100.0, 2, 1);
    new_mixer.add_route(1, 0, 1.0, None).unwrap();
    new_mixer.add_frozen_outputs(&source, &[1], 0).unwrap();
    let mut mixed = vec![0.0; 64];
    old_mixer.process(&[0.0; 64], &mut mixed);
    new_mixer.take_over(&mut old_mixer, Some(&[Some(1)]));
    new_mixer.process(&[0.0; 128], &mut mixed);
    assert_eq!(mixed, [1.0; 64]);
}

#[test]
fn frozen_outputs_without_matching_outputs_are_refused() {
    let source = Arc::new(FrozenOutputs::new(vec![0.0; 4], 2));
    let mut mixer = Mixer::new(44_100.0, 2, 1);
    let freeze_error = mixer.add_frozen_outputs(&source, &[0, 2], 0).unwrap_err();
    assert_eq!(freeze_error, RouteError::Out { out: 2, n_out: 2 });
    let freeze_error = mixer.add_frozen_outputs(&source, &[0], 0).unwrap_err();
    assert_eq!(
        freeze_error.to_string(),
        "2 frozen outputs cannot replace 1 outputs; the numbers must be equal"
    );
}

#[test]
fn take_over_fades_routes_with_delay_or_curve() {
    let rising_curve = Curve::new(vec![level(0, 0.5), level(4000, 1.0)]);
    let late_treatment = RouteTreatment {
        delay: 300,
        ..RouteTreatment::default()
    };
    let curve_treatment = RouteTreatment {
        curve: Some(rising_curve),
        ..RouteTreatment::default()
    };
    for treatment in [late_treatment, curve_treatment] {
        let played_channels = |block: usize| {
            let mut old = Mixer::new(44_100.0, 1, 2);
            old.add_treated_route(0, 0, RouteTarget::Channel(0), 1.0, treatment.clone())
                .unwrap();
            old.process(&[1.0; 1000], &mut [0.0; 2000]);
            let mut channels = vec![0.0; 8000];
            let mut new = Mixer::new(44_100.0, 1, 2);
            new.add_treated_route(0, 0, RouteTarget::Channel(1), 1.0, treatment.clone())
                .unwrap();
            new.take_over(&mut old, None);
            for part in channels.chunks_mut(2 * block) {
                new.process(&vec![1.0; part.len() / 2], part);
            }
            let mut last_mixer = Mixer::new(44_100.0, 1, 2);
            last_mixer.take_over(&mut new, None);
            assert_eq!(last_mixer.fading_out.iter().flatten().count(), 1, "that of `new`");
            channels
        };
        let listened = played_channels(4000);
        assert!(listened[0] > 0.5, "it is heard on: {}", listened[0]);
        for channel in 0..2 {
            let channel_samples: Vec<f64> = listened.iter().skip(channel).step_by(2).copied().collect();
            let sample_steps = channel_samples.windows(2).map(|pair| (pair[1] - pair[0]).abs());
            assert!(sample_steps.fold(0.0, f64::max) < 1.5 / 896.0 + 1e-3, "{channel}");
            assert_eq!(channel_samples[24 + 896..].iter().all(|&x| x == 0.0), channel == 0);
        }
        assert_eq!(listened, played_channels(7));
    }
}

/// The output for a tone of 100 Hz over 6000 frames; at frame 3000 a mixer with another treatment takes over.
fn retreated(before: &RouteTreatment, after: &RouteTreatment, block: usize) -> Vec<f64> {
    let mixer = |treatment: &RouteTreatment| {
        let mut mixer = Mixer::new(44_100.0, 1, 1);
        mixer
            .add_treated_route(0, 0, RouteTarget::Channel(0), 1.0, treatment.clone())
            .unwrap();
        mixer
    };
    let listened: Vec<f64> = (0..6000).map(|n| crate::maths::sin(f64::from(n) * 0.0142)).collect();
    let (mut old_mixer, mut new_mixer) = (mixer(before), mixer(after));
    let mut mixed = vec![0.0; 6000];
    old_mixer.process(&listened[..3000], &mut mixed[..3000]);
    new_mixer.take_over(&mut old_mixer, None);
    for (x, y) in listened[3000..].chunks(block).zip(mixed[3000..].chunks_mut(block)) {
        new_mixer.process(x, y);
    }
    mixed
}

#[test]
fn take_over_of_filter_or_delay_without_jump() {
    let shelf_treatment = |level: f64| RouteTreatment {
        filters: vec![FilterKind::Lowshelf { f: 900.0, level }],
        ..RouteTreatment::default()
    };
    let delay = |delay: usize, ratio: f64| RouteTreatment {
        delay,
        echo: Some(Echo {
            delay_frames: delay,
            feedback_ratio: ratio,
        }),
        ..RouteTreatment::default()
    };
    let lowpass = |f: f64| RouteTreatment {
        filters: vec![FilterKind::Lowpass { f }],
        ..RouteTreatment::default()
    };
    for (before, after) in [
        (shelf_treatment(-20.0), shelf_treatment(0.0)),
        (delay(200, 0.0), delay(500, 0.0)),
        (delay(500, 0.0), delay(200, 0.0)),
        (delay(300, 0.0), delay(300, 0.1)),
        (lowpass(80.0), lowpass(9_000.0)),
        (lowpass(80.0), RouteTreatment::default()),
    ] {
        let listened = retreated(&before, &after, 3000);
        assert_eq!(retreated(&before, &after, 7), listened);
        let sample_steps = listened[2990..].windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let steepest = sample_steps.fold(0.0, f64::max);
        assert!(steepest < 0.03, "{before:?} {after:?}: {steepest}");
    }
}

#[test]
fn treated_with_impossible_filters_or_echoes_is_refused() {
    let mut mixer = Mixer::new(44_100.0, 1, 1);
    let f = 30_000.0;
    let bad_tones = [
        FilterKind::Lowpass { f },
        FilterKind::Highshelf {
            f: 900.0,
            level: f64::NAN,
        },
    ];
    for tone in bad_tones {
        let treatment = RouteTreatment {
            filters: vec![tone],
            ..RouteTreatment::default()
        };
        let route_error = mixer.add_treated_route(0, 0, RouteTarget::Channel(0), 1.0, treatment);
        assert!(route_error.unwrap_err().to_string().contains(tone.score_word()));
    }
    for (frames, ratio) in [(3, 1.0), (4, 0.5), (0, 0.5), (3, f64::NAN)] {
        let endless = RouteTreatment {
            delay: 3,
            echo: Some(Echo {
                delay_frames: frames,
                feedback_ratio: ratio,
            }),
            ..RouteTreatment::default()
        };
        let route_error = mixer.add_treated_route(0, 0, RouteTarget::Channel(0), 1.0, endless);
        assert!(matches!(route_error, Err(RouteError::Echo(_))));
    }
}
