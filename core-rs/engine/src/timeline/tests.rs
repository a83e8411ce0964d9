use super::gate::FADE_SECONDS;
use super::*;
use crate::gesture::profile::Curve;
use crate::gesture::script::Manner;
use crate::gesture::written::{Approach, WrittenPoints};
use crate::network::{But, Contact, Tie};
use crate::units::frame;

/// a – b by link 0; c is tied and alone; d fixed.
fn network() -> Network {
    let mut network = Network::new();
    network.part("p", None);
    network.mas("a", 1e-2, 0.0, 0.0).unwrap();
    network.mas("b", 1e-2, 0.0, 0.0).unwrap();
    let tuned_tie = Tie::Tuned {
        f: 440.0,
        t60: Some(1.0),
    };
    network.cel("c", 1e-2, tuned_tie, 0.0, 0.0, 0.0).unwrap();
    network.sol("d", 0.0).unwrap();
    network.spring("l", 0, 1, 1.0, 0.0, 0.0).unwrap();
    network
}

fn timeline(hertz: f64) -> Timeline {
    Timeline::new(Rate::new(hertz).unwrap())
}

#[test]
fn fades_lie_on_the_grid_without_jumps() {
    for hertz in [8_000.0, 44_100.0, 48_000.0, 192_000.0] {
        for (start, stop) in [
            (0.0, None),
            (0.0, Some(0.3)),
            (0.1, None),
            (0.1234, Some(0.3)),
            // The fade out begins before the fade in ends.
            (0.1, Some(0.105)),
            (-1.0, Some(1e-3)),
        ] {
            let mut timeline = timeline(hertz);
            timeline.couple(&network(), 0, start, stop).unwrap();
            let gate = timeline.gates[0];
            assert_eq!(gate.fade_frames % GRID_FRAMES, 0);
            let fade_frames = gate.fade_frames as f64;
            assert!((FADE_SECONDS * hertz..FADE_SECONDS * hertz + GRID_FRAMES as f64).contains(&fade_frames));
            for (edge_frame, edge_time) in [(gate.start, Some(start)), (gate.stop, stop)] {
                let (Some(edge_frame), Some(edge_time)) = (edge_frame, edge_time) else {
                    continue;
                };
                assert_eq!(edge_frame % GRID_FRAMES, 0);
                let frame_delay = edge_frame as f64 - edge_time.max(0.0) * hertz;
                assert!(
                    (-0.5..GRID_FRAMES as f64).contains(&frame_delay),
                    "{hertz} {edge_time}: {frame_delay}"
                );
            }
            let openness: Vec<f64> = (0..(0.4 * hertz) as u64).map(|n| gate.opening(n)).collect();
            assert!(openness.iter().all(|openness| (0.0..=1.0).contains(openness)));
            assert_eq!(openness[0], if start <= 0.0 { 1.0 } else { 0.0 });
            assert_eq!(openness[openness.len() - 1], if stop.is_none() { 1.0 } else { 0.0 });
            // C1: the second difference of 3u² − 2u³ is at most 6/fade² per frame, and twice that where two fades meet.
            for three in openness.windows(3) {
                let curvature = three[2] - 2.0 * three[1] + three[0];
                assert!(
                    curvature.abs() <= 12.0 / (fade_frames * fade_frames) + 1e-15,
                    "{hertz} {start}: {curvature}"
                );
            }
        }
    }
}

/// A fade of another length, and a linear factor, alone and together with the fade.
#[test]
fn fades_with_length_and_factor() {
    let hertz = 44_100.0;
    let (network, mut timeline) = (network(), timeline(hertz));
    let fade_span = (0.5, 0.9);
    timeline.glide_force(&network, (0, 1), (0.25, 2.0), fade_span).unwrap();
    let [start_frame, stop_frame] = [fade_span.0, fade_span.1].map(|t| (t * hertz / 64.0).ceil() as u64 * 64);
    let faded_gate = timeline.gates[0];
    let middle_frame = (start_frame + stop_frame) / 2;
    for (n, factor) in [
        (0, 0.25),
        (start_frame, 0.25),
        (middle_frame, 1.125),
        (stop_frame, 2.0),
        (1 << 40, 2.0),
    ] {
        assert!((faded_gate.opening(n) - factor).abs() < 1e-12, "{n}");
    }
    let couple_link = |timeline: &mut Timeline| timeline.couple_over(&network, 0, 0.1, Some(3.0), 1.0);
    couple_link(&mut timeline).unwrap();
    assert_eq!(timeline.gates.len(), 1);
    let coupled_gate = timeline.gates[0];
    // 3u² − 2u³ is a half half-way.
    let half_frame = coupled_gate.start.unwrap() + coupled_gate.fade_frames / 2;
    assert!((hertz..hertz + 64.0).contains(&(coupled_gate.fade_frames as f64)));
    assert!((coupled_gate.opening(half_frame) - 0.5 * faded_gate.opening(half_frame)).abs() < 1e-12);
    assert!(couple_link(&mut timeline).is_err(), "twice");
    assert!(
        timeline.glide_force(&network, (0, 1), (1.0, 0.0), fade_span).is_err(),
        "twice"
    );
    // At four times the rate everything happens at the same time.
    let fast_timeline = timeline.with_higher_rate(4).unwrap();
    assert!((fast_timeline.gates[0].opening(4 * half_frame) - coupled_gate.opening(half_frame)).abs() < 1e-12);
}

#[test]
fn couple_of_wrong_links_is_refused() {
    let mut network = network();
    let topology = crate::generator::string(5, crate::generator::Ends::Fixed, 0.0).unwrap();
    let inner_link = network.n_lia() + 1;
    network.mesh("s", &topology, 1e-2, 100.0, None, 0.0).unwrap();
    let mut timeline = timeline(44_100.0);
    for (start, stop) in [
        (0.2, Some(0.1)),
        (0.2, Some(0.2)),
        (-2.0, Some(-1.0)),
        (0.0, Some(0.0)),
        (f64::NAN, None),
        (0.0, Some(f64::NAN)),
        (f64::INFINITY, None),
    ] {
        assert!(timeline.couple(&network, 0, start, stop).is_err(), "{start} {stop:?}");
    }
    assert!(timeline.couple(&network, network.n_lia(), 0.0, None).is_err());
    assert!(
        timeline.couple(&network, inner_link, 0.0, None).is_err(),
        "one of a generator's"
    );
    assert!(timeline.couple(&network, 0, 0.0, Some(1.0)).is_ok());
    assert!(timeline.couple(&network, 0, 2.0, None).is_err(), "twice");
}

/// Events beyond the last frame never begin: frame numbers do not wrap round.
#[test]
fn events_after_the_last_frame_never_begin() {
    let mut timeline = timeline(192_000.0);
    timeline.couple(&network(), 0, 1e300, None).unwrap();
    assert_eq!(timeline.gates[0].opening(1 << 40), 0.0);
    timeline.strike(&network(), 0, 1e300, 1.0, Some(0.0), 0).unwrap();
    timeline.add_ergon(&network(), 0, 1e300, 1e-3, 1.0, 0).unwrap();
    let pushes = strike_forces(&network(), &timeline, |_| true);
    assert!(pushes.iter().all(|push| push.frame > 1 << 40));
    assert_eq!(frame(f64::INFINITY, 8_000.0), 1 << 53);
    assert_eq!((frame(-3.0, 8_000.0), frame(f64::NAN, 8_000.0)), (0, 0));
}

#[test]
fn frame_is_nearest_to_the_instant() {
    for (t, n) in [
        (0.0, 0),
        (0.4e-3, 0),
        (0.5e-3, 1),
        (0.6e-3, 1),
        (1.5e-3, 2),
        (2.0, 2000),
    ] {
        assert_eq!(frame(t, 1_000.0), n, "{t}");
    }
}

/// Impulse and, off the grid, its first moment: Σ F·T = p, Σ F·T·n = p·t·rate.
#[test]
fn strike_keeps_its_impulse_and_instant() {
    let network = network();
    for position in [0.0, 0.25, 0.5, 7.999_9] {
        let mut timeline = timeline(1_000.0);
        timeline
            .strike(&network, 0, position * 1e-3, 2e-3, Some(0.0), 9)
            .unwrap();
        let pushes = strike_forces(&network, &timeline, |_| true);
        let push_sum = |of: &dyn Fn(&StrikeForce) -> f64| pushes.iter().map(of).sum::<f64>();
        assert!((push_sum(&|push| push.force) * 1e-3 - 2e-3).abs() < 1e-15);
        let first_moment = push_sum(&|push| push.force * push.frame as f64) * 1e-3;
        assert!((first_moment - 2e-3 * position).abs() < 1e-14, "{position}");
        // One recorded impulse per strike, however it is split.
        assert_eq!(pushes.iter().filter(|push| push.impulse != 0.0).count(), 1);
    }
}

/// The force of a strike is the same at any rate, and has its whole impulse.
#[test]
fn parts_of_a_strike_at_other_rates() {
    let mut timeline = timeline(44_100.0);
    for begin in [0.0, 0.0123, 7.5] {
        timeline.strikes.clear();
        timeline.strike(&network(), 0, begin, 2e-3, None, 0).unwrap();
        let instants = |timeline: &Timeline| -> Vec<(f64, f64)> {
            let strike_parts = timeline.strike_parts(&timeline.strikes[0], StrikeTiming::Exact);
            let instant = |frame: u64, alpha: f64| (frame as f64 + alpha) / timeline.rate.hertz();
            strike_parts
                .map(|part| (instant(part.frame, part.frame_fraction), part.impulse))
                .collect()
        };
        let expected = instants(&timeline);
        assert_eq!(expected.len(), 7); // 0.19 ms are 8 frames
        assert!((expected.iter().map(|part| part.1).sum::<f64>() - 2e-3).abs() < 1e-17);
        assert!(expected[0].0 > begin && expected[6].0 < begin + 0.19e-3);
        for other in [timeline.with_higher_rate(4), timeline.with_lower_rate(2)]
            .into_iter()
            .flatten()
        {
            for (part, theirs) in expected.iter().zip(instants(&other)) {
                assert!((part.0 - theirs.0).abs() < 1e-12 && part.1 == theirs.1);
            }
        }
    }
}

#[test]
fn strike_on_keys_and_ca_parts_is_undivided() {
    let mut network = network();
    network.part("ca", Some(Rate::new(44_100.0).unwrap()));
    let discrete = network.mas("m", 1.0, 0.0, 0.0).unwrap();
    let mut timeline = timeline(1_000.0);
    timeline.strike(&network, discrete, 0.4e-3, 1.0, Some(0.0), 0).unwrap();
    timeline.add_key("k", 2);
    timeline.strike(&network, 2, 0.6e-3, 1.0, Some(0.0), 0).unwrap();
    let frame_forces: Vec<_> = strike_forces(&network, &timeline, |_| true)
        .iter()
        .map(|push| (push.frame, push.force))
        .collect();
    assert_eq!(frame_forces, [(0, 1_000.0), (1, 1_000.0)]);
}

#[test]
fn strike_with_wrong_values_is_refused() {
    let network = network();
    let mut timeline = timeline(44_100.0);
    for position in [-1e-9, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            timeline.strike(&network, 0, position, 1.0, Some(0.0), 0),
            Err(StrikeError::Before(_))
        ));
        assert!(timeline.add_ergon(&network, 0, position, 1.0, 1.0, 0).is_err());
    }
    assert!(timeline.strike(&network, 0, 0.0, f64::NAN, Some(0.0), 0).is_err());
    for (mass, speed) in [(0.0, 1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
        assert!(timeline.add_ergon(&network, 0, 0.0, mass, speed, 0).is_err());
    }
    let fixed_error = StrikeError::Fixed("p.d".to_owned());
    assert_eq!(
        timeline.strike(&network, 3, 0.0, 1.0, Some(0.0), 0),
        Err(fixed_error.clone())
    );
    assert_eq!(timeline.add_ergon(&network, 3, 0.0, 1.0, 1.0, 0), Err(fixed_error));
    assert!(
        timeline
            .drive(3, DriveKind::Position, DriveSource::Constant(f64::NAN), true)
            .is_err()
    );
    assert!(timeline.strikes.is_empty() && timeline.ergons.is_empty() && timeline.drives.is_empty());
}

/// The rain is refused before it fills the memory, even if its impulses are 0.
#[test]
fn rain_without_end_is_refused_at_once() {
    let network = network();
    let mut timeline = timeline(44_100.0);
    let finite_rain = Rain {
        rate: 1.0,
        duration: Some(0.0),
        start: 0.0,
        stop: 1.0,
        impulse: (0.0, 0.0),
        window: (0.0, f64::INFINITY),
        source: 0,
    };
    let member_chance = |member| Chance::new(1, "strikes", "r", member, 0);
    for bad in [
        Rain {
            rate: f64::INFINITY,
            ..finite_rain
        },
        Rain {
            rate: f64::NAN,
            ..finite_rain
        },
        Rain {
            rate: 1e9,
            ..finite_rain
        },
        Rain {
            stop: f64::INFINITY,
            ..finite_rain
        },
        Rain {
            start: f64::NEG_INFINITY,
            ..finite_rain
        },
    ] {
        assert!(
            timeline.rain(&network, &[0, 1], &bad, member_chance).is_err(),
            "{bad:?}"
        );
    }
    assert_eq!(
        timeline.rain(
            &network,
            &[0],
            &Rain {
                stop: -1.0,
                ..finite_rain
            },
            member_chance
        ),
        Ok(0)
    );
    assert!(
        timeline
            .rain(
                &network,
                &[0],
                &Rain {
                    rate: 500.0,
                    ..finite_rain
                },
                member_chance
            )
            .unwrap()
            > 300
    );
}

/// The gated contact of a simulation follows the gate: see `simulation::tests`.
#[test]
fn couple_of_contacts_of_any_kind() {
    for contact in [Contact::Plain, Contact::Exact] {
        let mut network = network();
        let contact_but = But {
            contact,
            ..But::plain(1e3, 0.0, 0.0)
        };
        let link_index = network.but("b", 0, 2, contact_but).unwrap();
        assert!(timeline(44_100.0).couple(&network, link_index, 0.1, None).is_ok());
    }
}

#[test]
fn drive_by_position_twice_is_refused() {
    let mut timeline = timeline(44_100.0);
    let mut add_drive = |kind, value| timeline.drive(0, kind, DriveSource::Constant(value), true);
    assert_eq!(add_drive(DriveKind::Position, 0.0), Ok(()));
    assert_eq!(add_drive(DriveKind::Position, 0.0), Err(StrikeError::Driven(0)));
    // Forces add.
    assert_eq!(add_drive(DriveKind::Force, 1.0), Ok(()));
    assert_eq!(add_drive(DriveKind::Force, 1.0), Ok(()));
}

/// Everything that glides or fades is constant until the frame at which it is due, and then changes.
#[test]
fn next_change_of_paths_and_gates() {
    let path_points = [(10, 1.0), (20, 1.0), (30, 2.0), (40, 2.0), (50, 1.0)];
    for (n, change_frame) in [(0, 20), (20, 20), (29, 29), (30, 40), (49, 49), (50, u64::MAX)] {
        assert_eq!(next_change(&path_points, n), change_frame, "{n}");
    }
    let last_frame = 8_000;
    for (start, stop, ramp) in [
        (0.0, None, None),
        (0.1, Some(0.3), None),
        (0.1, Some(0.105), None),
        (0.0, Some(0.5), Some((0.2, 0.4))),
        (0.3, None, Some((0.1, 0.6))),
    ] {
        let mut timeline = timeline(8_000.0);
        timeline.couple(&network(), 0, start, stop).unwrap();
        if let Some(ramp_span) = ramp {
            timeline.glide_force(&network(), (0, 1), (0.5, 2.0), ramp_span).unwrap();
        }
        let coupled_gate = timeline.gates[0];
        let continuations = [None, GateContinuation::new(&coupled_gate, 0.3, 6_000)];
        for continuation in continuations.iter().map(Option::as_ref) {
            let openness = |n| GateContinuation::opening(continuation, &coupled_gate, n);
            let start_frame = if continuation.is_some() { 6_000 } else { 0 };
            for n in (start_frame..last_frame).step_by(7) {
                let due_frame = coupled_gate.next_change_frame(continuation, n);
                let change_frame = (n + 1..=last_frame)
                    .find(|&m| openness(m) != openness(n))
                    .unwrap_or(last_frame + 1);
                assert!(
                    due_frame >= n && (due_frame < change_frame || change_frame > last_frame),
                    "{n}: due {due_frame}, changes {change_frame}"
                );
                // And not earlier, except for the glide of a closed gate.
                assert!(
                    ramp.is_some() || due_frame > last_frame || change_frame - due_frame <= 2,
                    "{n}: due {due_frame}"
                );
            }
        }
    }
}

/// A gesture of two points.
fn gesture(start: f64, stop: f64) -> Gesture {
    let written = WrittenPoints {
        t: &[start, stop],
        x: &[0.0, 1e-3],
        approaches: &[Approach::Path(Curve::Smooth); 2],
        sources: &[],
    };
    Gesture::from_points(0, &written, Manner::OPEN).unwrap()
}

#[test]
fn cut_drops_events_from_its_frame() {
    let (network, frame_rate) = (network(), 8_000.0);
    let mut timeline = timeline(frame_rate);
    timeline.open();
    let instants = [0.2, 0.999, 1.0 - 1e-12, 1.0, 1.5];
    for t in instants {
        timeline.strike(&network, 0, t, 1.0, Some(0.0), 7).unwrap();
        timeline.add_ergon(&network, 1, t, 1.0, 1.0, 7).unwrap();
    }
    let key_index = timeline.add_key("p", 2);
    for start in [0.1, 0.8, 0.5] {
        timeline.add_gesture(gesture(start, 3.0)).unwrap();
    }
    for freezes_couplings in [false, true] {
        let cut_timeline = timeline.cut(8_000, &[1, 2, 3], freezes_couplings);
        assert_eq!(cut_timeline.strikes_on(0), [(0.999, 1.0)]);
        assert_eq!(cut_timeline.strikes_on(1), [(0.2, 1.0), (0.999, 1.0)]); // ergons
        let gesture_starts: Vec<f64> = cut_timeline.gestures.iter().map(|gesture| gesture.start).collect();
        assert_eq!(gesture_starts, [0.8, 0.5]);
        assert!(cut_timeline.is_open);
        assert_eq!(cut_timeline.keys[key_index].struck_mat, 2);
        assert!(timeline.cut(8_000, &[], freezes_couplings).gestures.is_empty());
    }
}

#[test]
fn cut_with_stop_keeps_couplings() {
    let network = network();
    for (start, stop, start_opening, closes) in [
        (0.0, None, Some(1.0), 1.0),
        (0.0, Some(2.0), Some(1.0), 1.0),
        (0.5, Some(2.0), Some(1.0), 1.0),
        (0.1, Some(0.5), Some(0.0), 0.0),
        (2.0, None, Some(0.0), 0.0),
        (2.0, Some(3.0), Some(0.0), 0.0),
        (0.992, Some(3.0), None, 1.0), // it fades in at that frame, and goes on
        (0.1, Some(0.992), None, 0.0),
    ] {
        let mut timeline = timeline(8_000.0);
        timeline.couple(&network, 0, start, stop).unwrap();
        let cut_timeline = timeline.cut(8_000, &[], true);
        let openness = |n| cut_timeline.gates.first().map_or(1.0, |gate| gate.opening(n));
        if let Some(start_opening) = start_opening {
            assert_eq!(openness(8_000), start_opening, "{start} {stop:?}");
        }
        assert_eq!(openness(8_000), timeline.gates[0].opening(8_000), "{start} {stop:?}");
        assert_eq!(openness(80_000), closes, "{start} {stop:?}");
        let cut_timeline = timeline.cut(8_000, &[], false);
        assert_eq!(cut_timeline.gates, timeline.gates);
    }
}

#[test]
fn cut_keeps_running_glides() {
    let network = network();
    for (stop, is_kept) in [(0.5, false), (2.0, true)] {
        let mut timeline = timeline(8_000.0);
        timeline.glide_force(&network, (0, 1), (0.5, 1.0), (0.1, stop)).unwrap();
        timeline.glide(&network, 0, [1.0, 0.0, 1.0], (0.1, stop)).unwrap();
        let path_tie = [1.0, 1.0, 1.0];
        timeline
            .glide_through(&network, 2, &[(0.1, path_tie), (stop, path_tie)])
            .unwrap();
        for freezes_couplings in [false, true] {
            let mut cut_timeline = timeline.cut(8_000, &[], freezes_couplings);
            assert_eq!(cut_timeline.gates == timeline.gates, is_kept);
            assert_eq!(cut_timeline.gates.is_empty(), !is_kept);
            // Points that a MAT goes through are automation, whose last values hold.
            let gliding_mats =
                |cut_timeline: &Timeline| cut_timeline.glides.iter().map(|glide| glide.mat).collect::<Vec<_>>();
            assert_eq!(gliding_mats(&cut_timeline), if is_kept { vec![0, 2] } else { vec![2] });
            cut_timeline.remove_glides(&[(1, 2)], &[]);
            assert_eq!(gliding_mats(&cut_timeline), if is_kept { vec![0] } else { vec![] });
        }
    }
    let mut timeline = timeline(8_000.0);
    let lead_points = [(0.1, [2.0, 2.0]), (0.5, [1.0, 1.0])];
    timeline.lead(&network, (0, 1), &lead_points).unwrap();
    assert_eq!(timeline.cut(1_000, &[], true).leads, timeline.leads);
    assert!(timeline.cut(8_000, &[], true).leads.is_empty());
    timeline.remove_glides(&[], &[(0, 1)]);
    assert!(timeline.leads.is_empty());
}
