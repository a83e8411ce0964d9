//! What pages receive of strikes and of broken links.

use super::*;

/// A strike by MIDI or by hand is reported like a strike of the score: with its target, its frame and its sign.
#[test]
fn pages_receive_live_strikes() {
    let mut scene = scene(&[]);
    scene.1.open();
    scene.1.add_strike_point(&scene.0, 3, 7, Some(0.0)).unwrap();
    scene.1.add_strike_point(&scene.0, 5, 9, Some(0.0)).unwrap();
    let simulation = planned(&scene, 0);
    let look = simulation.make_look();
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut hub_cursor = shown.server.hub().new_cursor();
    let mut message_bytes = Vec::new();
    let mut expected_ergons = Vec::new();
    for (point, mat, impulse, ticks) in [(7, 3, 2e-5, 301), (9, 5, -3e-5, 77), (7, 3, -1e-5, 400)] {
        for _ in 0..ticks {
            shown.tick(1);
            shown.relay.poll();
        }
        expected_ergons.push((shown.frame() as f64 / RATE, mat, impulse));
        shown.this.strike(point, impulse).unwrap();
        shown.this.strike(8, impulse).unwrap(); // not a point of this piece
    }
    for _ in 0..100 {
        shown.tick(1);
        shown.relay.poll();
    }
    message_bytes.extend(messages(&shown.server, &mut hub_cursor).concat());
    assert_ergons(&ergons(&message_bytes, &look), &expected_ergons);
    shown.end();
}

/// Strikes between a takeover and the first picture of its window are in that picture, written ones and live ones; so
/// are live strikes since the last picture before. Written strikes of the new score before the takeover did not happen.
#[test]
fn strikes_before_the_first_picture_are_shown() {
    let with_points = |struck: &[f64]| {
        let mut playable_scene = scene(struck);
        playable_scene.1.open();
        playable_scene
            .1
            .add_strike_point(&playable_scene.0, 3, 7, Some(0.0))
            .unwrap();
        playable_scene
            .1
            .add_strike_point(&playable_scene.0, 5, 9, Some(0.0))
            .unwrap();
        playable_scene
    };
    let tick_frames = EVERY as u64;
    let (takeover_tick, opening_tick) = (600_u64, 640_u64);
    let seconds_of = |tick: u64| (tick * tick_frames) as f64 / RATE;
    // Cells 0 to 3 are struck before the takeover, at it, between it and the first picture, and after that picture.
    let written = [
        seconds_of(590),
        seconds_of(takeover_tick),
        seconds_of(613),
        seconds_of(700),
    ];
    let (first_scene, second_scene) = (with_points(&[]), with_points(&written));
    let (first_simulation, second_simulation) = (
        planned(&first_scene, 0),
        planned(&second_scene, takeover_tick * tick_frames),
    );
    let mut shown = Shown::fast(&first_simulation, &first_scene.1);
    let mut hub_cursor = shown.server.hub().new_cursor();
    let takeover_change = Change {
        simulation: Some((
            second_simulation.fork(),
            Takeover::new(&first_simulation, &second_simulation),
        )),
        ..Change::default()
    };
    shown.this.change(takeover_tick * tick_frames, takeover_change).unwrap();
    let mut expected_ergons: Vec<_> = (1..4).map(|i| (written[i], i, 2e-5)).collect();
    let mut message_bytes = Vec::new();
    for tick in 0..720_u64 {
        let live_strike = match tick {
            599 => Some((7, 3, 1e-5)), // the previous picture was made at tick 584
            600 => Some((9, 5, -2e-5)),
            620 => Some((7, 3, -3e-5)),
            _ => None,
        };
        if let Some((struck_point, struck_mat, impulse)) = live_strike {
            shown.this.strike(struck_point, impulse).unwrap();
            expected_ergons.push((seconds_of(tick), struck_mat, impulse));
        }
        if tick == opening_tick {
            let (window, scene) = window_on(&second_simulation, &second_scene.1, "second");
            assert!(shown.this.open_window(window));
            shown.reader_sender.send((scene, shown.this.output_times())).unwrap();
        }
        shown.tick(1);
        shown.relay.poll();
        let new_bytes = messages(&shown.server, &mut hub_cursor).concat();
        if tick < opening_tick {
            assert!(ergons(&new_bytes, &first_simulation.make_look()).is_empty());
        } else {
            message_bytes.extend(new_bytes);
        }
    }
    expected_ergons.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    assert_ergons(
        &ergons(&message_bytes, &second_simulation.make_look()),
        &expected_ergons,
    );
    shown.end();
}

/// The strikes of a written gesture are reported with the pictures, even if pages missed some: no impulse is lost.
#[test]
fn pages_receive_strikes_of_gestures() {
    let scene = gesture();
    let simulation = planned(&scene, 0);
    let look = simulation.make_look();
    let mut reference = {
        let plan = Plan::new(scene.0.clone(), &scene.1, &Budget::default(), None).unwrap();
        let options = SimulationOptions {
            records_ergons: true,
            ..OPTIONS
        };
        Simulation::from_plan(Arc::new(plan), options).unwrap()
    };
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut hub_cursor = shown.server.hub().new_cursor();
    let mut message_bytes = Vec::new();
    let tick_count = 900;
    for tick in 0..tick_count {
        shown.tick(1);
        // For a while no picture is fetched.
        if !(200..350).contains(&tick) {
            shown.relay.poll();
            message_bytes.extend(messages(&shown.server, &mut hub_cursor).concat());
        }
    }
    assert!(shown.relay.skipped_count() > 3);
    reference.skip(tick_count * EVERY as u64).unwrap();
    let struck = reference.take_ergons();
    let output = ergons(&message_bytes, &look);
    assert!(output.len() > 8 && struck.len() > 100 * output.len());
    assert!(output.iter().all(|ergon| ergon.1 == 1));
    for up in [true, false] {
        let output = output.iter().map(|ergon| ergon.2);
        let output: f64 = output.filter(|impulse| (*impulse > 0.0) == up).sum();
        let struck = struck.iter().map(|ergon| ergon.impulse);
        let struck: f64 = struck.filter(|impulse| (*impulse > 0.0) == up).sum();
        assert!((output / struck - 1.0).abs() < 1e-5, "{output} of {struck}");
    }
    shown.end();
}

/// A page that joins after a thread tore learns this from its first key state; so does a window that is opened then.
#[test]
fn late_pages_receive_broken_links() {
    let scene = torn();
    let simulation = planned(&scene, 0);
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut first_cursor = shown.server.hub().new_cursor();
    let second_ticks = (RATE as u64).div_ceil(EVERY as u64);
    let advance_ticks = |shown: &mut Shown, n: u64| {
        for _ in 0..n {
            shown.tick(1);
            shown.relay.poll();
        }
    };
    advance_ticks(&mut shown, second_ticks / 2);
    let broken_links = |bytes: &[u8]| -> Vec<(f64, f64, u32)> {
        let broken_chunks = chunks(bytes).into_iter().filter(|one| one.0 == kind::BROKEN);
        broken_chunks
            .flat_map(|(_, t, payload)| {
                let chunk_breaks = payload.chunks(8).map(move |single| {
                    let (time_offset, link_bytes) = single.split_at(4);
                    let time_offset = f32::from_le_bytes(time_offset.try_into().unwrap());
                    (
                        t,
                        t + f64::from(time_offset),
                        u32::from_le_bytes(link_bytes.try_into().unwrap()),
                    )
                });
                chunk_breaks.collect::<Vec<_>>()
            })
            .collect()
    };
    // It tears at 8 mm and 0.4 m/s, that is before 30 ms.
    let early_breaks = broken_links(&messages(&shown.server, &mut first_cursor).concat());
    assert_eq!(early_breaks.len(), 1, "{early_breaks:?}");
    assert!((0.02..0.05).contains(&early_breaks[0].1), "{early_breaks:?}");
    advance_ticks(&mut shown, 2 * second_ticks);
    let mut late_cursor = shown.server.hub().new_cursor();
    let page_breaks = broken_links(&messages(&shown.server, &mut late_cursor).concat());
    assert_eq!(page_breaks.len(), 1, "{page_breaks:?}");
    assert!(
        page_breaks[0].0 > 2.0 && (page_breaks[0].1 - early_breaks[0].1).abs() < 1e-6,
        "{page_breaks:?}"
    );
    assert_eq!(page_breaks[0].2, early_breaks[0].2);
    // Another window on the playing simulation, as a session opens one.
    let (window, scene) = window_on(&simulation, &scene.1, "late");
    assert!(shown.this.open_window(window));
    shown.reader_sender.send((scene, shown.this.output_times())).unwrap();
    advance_ticks(&mut shown, second_ticks / 2);
    let mut last_cursor = shown.server.hub().new_cursor();
    let page_breaks = broken_links(&messages(&shown.server, &mut last_cursor).concat());
    assert_eq!(page_breaks.len(), 1, "{page_breaks:?}");
    assert_eq!(
        (page_breaks[0].0, page_breaks[0].2),
        (page_breaks[0].1, early_breaks[0].2)
    );
    shown.end();
}
