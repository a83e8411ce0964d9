//! Keys: their greatest stable force, their guidance, and their loss and return.

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};

use super::*;
use crate::recording::{RecordedAxis, flag, read};

/// Guidance counts even before it acts: a key that could not bear it gets less force.
#[test]
fn limit_with_loose_guidance_scales_the_key() {
    let key_scale = |guidance: Option<(f64, bool)>| {
        let guided_hand = LiveHand {
            guidance: guidance.map(|(k, loose)| Guidance {
                k,
                z: 0.0,
                follows_steps: loose,
            }),
            piece_response: vec![0.0; 400],
            ..LiveHand::default()
        };
        let response = guided_hand.piece_response.clone();
        HandKey::from_keyboard(&keyboard(0, 0), &[guided_hand])[0]
            .limit(&response)
            .force_scale
    };
    assert_eq!(key_scale(None), 1.0);
    assert_eq!(key_scale(Some((100.0, true))), 1.0);
    // The greatest stable stiffness of the key is 2b/T = 2 kN/m.
    let guided_scale = key_scale(Some((5e3, true)));
    assert!((0.3..0.5).contains(&guided_scale), "{guided_scale}");
    assert_eq!(guided_scale, key_scale(Some((5e3, false))));
}

/// A value of a calibration counts if the device reports none, or if it makes the loop less stable.
#[test]
fn limit_with_measured_key_takes_the_worse_value() {
    let hand_limit = |measured: Option<MeasuredKey>| {
        let measured_hand = LiveHand {
            piece_response: vec![4e3; 1],
            measured_key: measured,
            ..LiveHand::default()
        };
        HandKey::from_keyboard(&keyboard(0, 0), std::slice::from_ref(&measured_hand))[0]
            .limit(&measured_hand.piece_response)
    };
    let measured = |mass, damping, delay| hand_limit(Some(MeasuredKey { mass, damping, delay })).stable_stiffness;
    let reported_limit = hand_limit(None).stable_stiffness;
    // The device reports 1 N·s/m and no delay; a calibration does not make it safer.
    assert_eq!(measured(0.05, 2.0, None), reported_limit);
    assert_eq!(measured(10.0, 1.0, Some(0.0)), reported_limit);
    assert!(measured(0.05, 0.5, None) < 0.6 * reported_limit);
    assert!(measured(0.05, 1.0, Some(1e-3)) < 0.5 * reported_limit);
    // A measured delay slightly above a tick counts as one tick.
    let delayed_limit = |delay| measured(0.05, 1.0, Some(delay));
    assert_eq!(delayed_limit(1.01e-3), delayed_limit(0.99e-3));
    assert!(delayed_limit(2e-3) < delayed_limit(1e-3));
}

/// Guidance that comes and goes: the key follows its path, and is then left alone.
#[test]
fn loose_guidance_leads_a_key_and_releases_it() {
    let config = config("null:fast");
    let mut piece = piece();
    for hand in &mut piece.hands {
        hand.standin_positions = vec![0.0];
        hand.travel_ratio = 0.0; // the scene has no effect
        hand.guidance = Some(Guidance {
            k: 500.0,
            z: 1.0,
            follows_steps: true,
        });
    }
    let (mut performance, mut player) = Performance::prepare(piece, vec![keyboard(0, u32::MAX)], config).unwrap();
    player.receive_first_positions();
    let guidance_step = |position, share| GuidanceStep { tick: position, share };
    let full_share = GuidanceShare { k: 1.0, z: 1.0 };
    let path_change = |x: f64, steps: Vec<GuidanceStep>| Change {
        standin_positions: Some(vec![vec![x], vec![0.0]]),
        guidance_steps: Some(vec![steps, Vec::new()]),
        ..Change::default()
    };
    let position = |tick: u64| tick * EVERY as u64;
    let guided_change = path_change(
        4e-3,
        vec![
            guidance_step(0, full_share),
            guidance_step(3_000, GuidanceShare::default()),
        ],
    );
    performance.change(position(500), guided_change).unwrap();
    performance
        .change(position(2_000), path_change(-3e-3, vec![guidance_step(0, full_share)]))
        .unwrap();
    performance
        .change(
            position(4_000),
            path_change(-3e-3, vec![guidance_step(0, GuidanceShare::default())]),
        )
        .unwrap();
    let mut x = Vec::new();
    reset_violation_count();
    for _ in 0..TICKS {
        assert!(assert_no_alloc(|| player.tick()));
        x.push(player.hand_sources[0].x);
    }
    assert_eq!(violation_count(), 0);
    let last_status = performance.status();
    drop(player);
    performance.close(PATIENCE).unwrap();
    assert!(x[..500].iter().all(|x| *x == 0.0));
    assert!((x[1_990] - 4e-3).abs() < 1e-5, "{}", x[1_990]);
    // The second change replaced the steps of the first one.
    assert!((x[3_990] + 3e-3).abs() < 1e-5, "{}", x[3_990]);
    // Only guidance moves the key: without it the key stays and gets no force.
    assert!((x[5_990] - x[4_300]).abs() < 1e-5, "{}", x[5_990]);
    assert_eq!(last_status.hands[0].sent_force, 0.0);
    assert!(last_status.hands[0].is_real);
}

/// A key is unplugged and comes back, a panic begins and ends, the gain changes, and everything is recorded.
#[test]
fn tick_does_not_allocate() {
    let take_path = std::env::temp_dir().join(format!("ergon-ticks-{}.take", std::process::id()));
    let axis = |player: &str| RecordedAxis {
        player: player.into(),
        key: "k".into(),
    };
    let take_header = Header {
        rate: RATE,
        frames: EVERY as u32,
        axes: vec![axis("ada"), axis("remi")],
        about: "{}".into(),
    };
    let config = PlaybackConfig {
        recording: Some((take_path.clone(), take_header)),
        ..config("null:fast")
    };
    let keyboards = vec![keyboard(0, u32::MAX), keyboard(1, 1_000)];
    let (mut performance, mut player) = Performance::prepare(piece(), keyboards, config).unwrap();
    player.receive_first_positions();
    // From here on the second key gets no force, and nor does the device that comes back in its place.
    let zero_bounds = vec![ScaleBound { tick: 0, scale: 0.0 }];
    let bounds_change = Change {
        scale_bounds: Some(vec![Vec::new(), zero_bounds]),
        ..Change::default()
    };
    performance.change(500 * EVERY as u64, bounds_change).unwrap();
    reset_violation_count();
    assert_no_alloc(|| {
        for tick in 0..TICKS {
            assert!(player.tick());
            match tick {
                // The search runs in another thread, which may wait; here the ticks stop until the device is found.
                2_000 => {
                    while !player.slots[1].is_open() && player.connections.commands.is_empty() {
                        std::thread::yield_now();
                    }
                }
                3_000 => assert!(performance.gain(0.5)),
                4_000 => performance.panic(),
                4_500 => performance.release(),
                _ => {}
            }
        }
    });
    assert_eq!(violation_count(), 0);
    assert_eq!(performance.status().ticks, TICKS);
    let event_kinds: Vec<_> = std::iter::from_fn(|| performance.event())
        .map(|event| event.kind)
        .collect();
    let changed = EventKind::ChangeDone(1);
    assert_eq!(
        event_kinds,
        [
            changed,
            EventKind::KeyboardLost(1),
            EventKind::KeyboardReturned(1),
            EventKind::HandTakenOver(1)
        ]
    );
    drop(player);
    performance.close(PATIENCE).unwrap();
    let recording = read(&take_path, None).unwrap();
    std::fs::remove_file(take_path).unwrap();
    assert_eq!(recording.dropped, 0);
    assert_eq!(recording.ticks.len() as u64, TICKS);
    let stood_in: Vec<_> = recording
        .samples
        .chunks(2)
        .map(|row| row.iter().map(|axis| axis.flags & flag::STAND_IN).sum::<u8>())
        .collect();
    let standin_begin = stood_in.iter().position(|stood| *stood != 0).unwrap();
    let standin_end = stood_in.iter().rposition(|stood| *stood != 0).unwrap();
    // The first position comes without a force; a bar has 4,410 frames.
    assert_eq!(standin_begin, 1_001);
    assert!((standin_end + 1) * EVERY % 4_410 < EVERY, "{standin_end}");
    assert!(stood_in[standin_begin..=standin_end].iter().all(|stood| *stood != 0));
    assert!(recording.samples.iter().any(|axis| axis.sent_force.abs() > 1e-3));
    let second_samples = recording.samples.iter().skip(1).step_by(2);
    assert!(second_samples.clone().take(480).any(|axis| axis.sent_force != 0.0));
    assert!(second_samples.skip(501).all(|axis| axis.sent_force == 0.0));
}
