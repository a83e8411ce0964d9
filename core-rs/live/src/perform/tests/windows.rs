//! Windows on a performance, tick by tick: the messages to pages, and that the physics thread neither allocates nor
//! waits for pages.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, channel};

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::generator::{Rim, Shape, plate};
use ergon_engine::network::But;
use ergon_engine::simulation::Takeover;
use ergon_view::motion::{self, MAGIC};
use ergon_view::payload::kind;
use ergon_view::read::MotionFile;
use ergon_view::record::{Setup, runs};
use ergon_view::serve::{Cursor, Limits, Next, Server};
use tungstenite::protocol::Role;
use tungstenite::{Message, WebSocket};

use super::super::player::Player;
use super::super::window::{HeardTimes, Relay, Scene, Window, window};
use super::*;

mod rig;

use rig::*;

/// A strike by MIDI or by hand is reported like a strike of the score: with its target, its frame and its sign.
#[test]
fn pages_receive_live_strikes() {
    let mut scene = scene(&[]);
    scene.1.open();
    scene.1.strike_point(&scene.0, 3, 7, Some(0.0)).unwrap();
    scene.1.strike_point(&scene.0, 5, 9, Some(0.0)).unwrap();
    let simulation = planned(&scene, 0);
    let look = simulation.looked_at();
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut cursor = shown.server.hub().join();
    let mut bytes = Vec::new();
    let mut wanted = Vec::new();
    for (point, mat, impulse, ticks) in [(7, 3, 2e-5, 301), (9, 5, -3e-5, 77), (7, 3, -1e-5, 400)] {
        for _ in 0..ticks {
            shown.tick(1);
            shown.relay.poll();
        }
        wanted.push((shown.frame() as f64 / RATE, mat, impulse));
        shown.this.strike(point, impulse).unwrap();
        shown.this.strike(8, impulse).unwrap(); // not a point of this piece
    }
    for _ in 0..100 {
        shown.tick(1);
        shown.relay.poll();
    }
    bytes.extend(messages(&shown.server, &mut cursor).concat());
    assert_ergons(&ergons(&bytes, &look), &wanted);
    shown.end();
}

/// Strikes between a takeover and the first picture of its window are in that picture, written ones and live ones; so
/// are live strikes since the last picture before. Written strikes of the new score before the takeover did not happen.
#[test]
fn strikes_before_the_first_picture_are_shown() {
    let with_points = |struck: &[f64]| {
        let mut single = scene(struck);
        single.1.open();
        single.1.strike_point(&single.0, 3, 7, Some(0.0)).unwrap();
        single.1.strike_point(&single.0, 5, 9, Some(0.0)).unwrap();
        single
    };
    let every = EVERY as u64;
    let (taken, opened) = (600_u64, 640_u64);
    let second = |tick: u64| (tick * every) as f64 / RATE;
    // Cells 0 to 3 are struck before the takeover, at it, between it and the first picture, and after that picture.
    let written = [second(590), second(taken), second(613), second(700)];
    let (first, after) = (with_points(&[]), with_points(&written));
    let (old, new) = (planned(&first, 0), planned(&after, taken * every));
    let mut shown = Shown::fast(&old, &first.1);
    let mut cursor = shown.server.hub().join();
    let change = Change {
        simulation: Some((new.fork(), Takeover::new(&old, &new))),
        ..Change::default()
    };
    shown.this.change(taken * every, change).unwrap();
    let mut wanted: Vec<_> = (1..4).map(|i| (written[i], i, 2e-5)).collect();
    let mut bytes = Vec::new();
    for tick in 0..720_u64 {
        let by_hand = match tick {
            599 => Some((7, 3, 1e-5)), // the previous picture was made at tick 584
            600 => Some((9, 5, -2e-5)),
            620 => Some((7, 3, -3e-5)),
            _ => None,
        };
        if let Some((point, mat, impulse)) = by_hand {
            shown.this.strike(point, impulse).unwrap();
            wanted.push((second(tick), mat, impulse));
        }
        if tick == opened {
            let (window, scene) = window_on(&new, &after.1, "second");
            assert!(shown.this.open(window));
            shown
                .coming
                .send((scene, shown.this.output_times()))
                .unwrap();
        }
        shown.tick(1);
        shown.relay.poll();
        let some = messages(&shown.server, &mut cursor).concat();
        if tick < opened {
            assert!(ergons(&some, &old.looked_at()).is_empty());
        } else {
            bytes.extend(some);
        }
    }
    wanted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    assert_ergons(&ergons(&bytes, &new.looked_at()), &wanted);
    shown.end();
}

/// The strikes of a written gesture are reported with the pictures, even if pages missed some: no impulse is lost.
#[test]
fn pages_receive_strikes_of_gestures() {
    let scene = gesture();
    let simulation = planned(&scene, 0);
    let look = simulation.looked_at();
    let mut truth = {
        let plan = Plan::new(scene.0.clone(), &scene.1, &Budget::default(), None).unwrap();
        let options = Options {
            record: true,
            ..OPTIONS
        };
        Simulation::planned(Arc::new(plan), options).unwrap()
    };
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut cursor = shown.server.hub().join();
    let mut bytes = Vec::new();
    let ticks = 900;
    for tick in 0..ticks {
        shown.tick(1);
        // For a while no picture is fetched.
        if !(200..350).contains(&tick) {
            shown.relay.poll();
            bytes.extend(messages(&shown.server, &mut cursor).concat());
        }
    }
    assert!(shown.relay.skipped() > 3);
    truth.skip(ticks * EVERY as u64).unwrap();
    let struck = truth.take_ergons();
    let output = ergons(&bytes, &look);
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
    let mut first = shown.server.hub().join();
    let second = (RATE as u64).div_ceil(EVERY as u64);
    let ticks = |shown: &mut Shown, n: u64| {
        for _ in 0..n {
            shown.tick(1);
            shown.relay.poll();
        }
    };
    ticks(&mut shown, second / 2);
    let broken = |bytes: &[u8]| -> Vec<(f64, f64, u32)> {
        let all = chunks(bytes)
            .into_iter()
            .filter(|one| one.0 == kind::BROKEN);
        all.flat_map(|(_, t, payload)| {
            let each = payload.chunks(8).map(move |single| {
                let (dt, link) = single.split_at(4);
                let dt = f32::from_le_bytes(dt.try_into().unwrap());
                (
                    t,
                    t + f64::from(dt),
                    u32::from_le_bytes(link.try_into().unwrap()),
                )
            });
            each.collect::<Vec<_>>()
        })
        .collect()
    };
    // It tears at 8 mm and 0.4 m/s, that is before 30 ms.
    let early = broken(&messages(&shown.server, &mut first).concat());
    assert_eq!(early.len(), 1, "{early:?}");
    assert!((0.02..0.05).contains(&early[0].1), "{early:?}");
    ticks(&mut shown, 2 * second);
    let mut late = shown.server.hub().join();
    let output = broken(&messages(&shown.server, &mut late).concat());
    assert_eq!(output.len(), 1, "{output:?}");
    assert!(
        output[0].0 > 2.0 && (output[0].1 - early[0].1).abs() < 1e-6,
        "{output:?}"
    );
    assert_eq!(output[0].2, early[0].2);
    // Another window on the playing simulation, as a session opens one.
    let (window, scene) = window_on(&simulation, &scene.1, "late");
    assert!(shown.this.open(window));
    shown
        .coming
        .send((scene, shown.this.output_times()))
        .unwrap();
    ticks(&mut shown, second / 2);
    let mut last = shown.server.hub().join();
    let output = broken(&messages(&shown.server, &mut last).concat());
    assert_eq!(output.len(), 1, "{output:?}");
    assert_eq!((output[0].0, output[0].2), (output[0].1, early[0].2));
    shown.end();
}

/// A page that misses nothing gets the positions of the engine's masses, once per video frame.
#[test]
fn pages_receive_positions_of_the_engine() {
    let scene = scene(&strikes());
    let simulation = planned(&scene, 0);
    let mut truth = simulation.fork();
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut cursor = shown.server.hub().join();
    let (mut bytes, mut frames) = (Vec::new(), Vec::new());
    let mut squares = Vec::new();
    for _ in 0..2_000 {
        shown.tick(1);
        shown.relay.poll();
        let some = messages(&shown.server, &mut cursor);
        let mut listened = vec![0.0; EVERY];
        truth.process(&mut listened).unwrap();
        squares.extend(listened.iter().map(|x| x * x));
        if some.is_empty() {
            continue;
        }
        frames.push(shown.frame());
        bytes.extend(some.concat());
    }
    assert_eq!(shown.relay.skipped(), 0);
    let seconds: Vec<f64> = frames.iter().map(|frame| *frame as f64 / RATE).collect();
    // Each video frame has one picture, made at the first tick of the frame.
    let numbers: Vec<u64> = seconds.iter().map(|t| (t * FPS) as u64).collect();
    let n = (2_000 * EVERY) as f64 / RATE * FPS;
    assert_eq!(numbers, (0..=n as u64).collect::<Vec<_>>());

    let result = chunks(&bytes);
    let source = |which: u16| {
        result
            .iter()
            .filter(move |chunk| chunk.0 == which)
            .collect::<Vec<_>>()
    };
    assert_eq!(source(kind::MANIFEST).len(), 1);
    assert_eq!(source(kind::STATE).len(), 2, "one in a second");
    assert!(
        source(kind::CLOCK).is_empty(),
        "no clock takes these frames"
    );
    assert!(!source(kind::CONTACTS).is_empty());
    // Every strike is reported once.
    let mut output: Vec<f64> = source(kind::ERGONS)
        .iter()
        .flat_map(|(_, t, payload)| {
            let records = payload.chunks(20);
            records.map(move |single| {
                t + f64::from(f32::from_le_bytes(single[..4].try_into().unwrap()))
            })
        })
        .collect();
    let mut wanted = strikes();
    output.sort_by(f64::total_cmp);
    wanted.sort_by(f64::total_cmp);
    assert_eq!(output.len(), wanted.len());
    assert!(
        output
            .iter()
            .zip(&wanted)
            .all(|(a, b)| (a - b).abs() < 1e-6)
    );
    // Levels: the first channel is the output itself. The window was opened in the first tick and has no level of it.
    let levels = source(kind::LEVELS);
    assert_eq!(levels.len(), frames.len() - 1);
    for (index, (_, t, payload)) in levels.iter().enumerate() {
        let level = f64::from(f32::from_le_bytes(payload[..4].try_into().unwrap()));
        let single = &squares[frames[index] as usize..frames[index + 1] as usize];
        let wanted = (single.iter().sum::<f64>() / single.len() as f64).sqrt();
        assert_eq!(*t, seconds[index + 1]);
        assert!(
            (level - wanted).abs() <= 1e-6 * wanted + 1e-12,
            "{t}: {level}, {wanted}"
        );
    }

    // Positions of points, as read by the reader of files.
    let look = simulation.looked_at();
    let file = MotionFile::new(bytes).expect("a motion file");
    let displacements = file.displacements(&seconds).expect("frames");
    let mut again = simulation.fork();
    let (mut glance, n) = (
        ergon_engine::simulation::Glance::new(&again, &look),
        look.points.len(),
    );
    let mut off: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for (row, &frame) in displacements.chunks(n).zip(&frames) {
        let left = (frame - again.frame()) as usize;
        again.process(&mut vec![0.0; left]).unwrap();
        again.glance(&look, &mut glance);
        for run in runs(&look) {
            let (worst, swing) = off.entry(run.kind).or_default();
            for index in run.points.clone() {
                let wanted = match run.body.map(|body| &look.bodies[body]) {
                    None => glance.tracks[index],
                    Some(body) => {
                        let row = &body.shapes[(index - run.points.start) * body.modes.len()..];
                        let modes = &glance.tracks[n + body.first..];
                        row.iter()
                            .zip(&modes[..body.modes.len()])
                            .map(|(a, b)| a * b)
                            .sum()
                    }
                };
                *worst = worst.max((row[index] - wanted).abs());
                *swing = swing.max(wanted.abs());
            }
        }
    }
    assert!(off.contains_key("free") && off.len() > 1, "{off:?}");
    for (kind, (worst, swing)) in off {
        assert!(
            worst <= 5e-3 * swing && swing > 0.0,
            "{kind}: {worst} of {swing}"
        );
    }
    shown.end();
}

/// The sound is the same to the bit without a window, with a window, and with a window whose pictures nobody fetches.
#[test]
fn window_changes_no_sample() {
    let scene = scene(&strikes());
    let simulation = planned(&scene, 0);
    let path = |name: &str| {
        std::env::temp_dir().join(format!("ergon-window-{name}-{}.wav", std::process::id()))
    };
    let to = |path: &PathBuf| config(&format!("file:{}", path.display()));
    let paths = ["none", "shown", "stalled"].map(path);

    let stage = a_stage(&simulation, false);
    let (this, mut player) = Performance::prepare(stage, Vec::new(), to(&paths[0])).unwrap();
    player.begin();
    (0..1_000).for_each(|_| assert!(player.tick()));
    player.connections.feed.close();
    drop(player);
    this.close(PATIENCE).unwrap();
    let mut skipped = Vec::new();
    for (path, is_looked_at) in [(&paths[1], true), (&paths[2], false)] {
        let mut shown = Shown::new(&simulation, &scene.1, to(path), Limits::default());
        for _ in 0..1_000 {
            shown.tick(1);
            if is_looked_at {
                shown.relay.poll();
            }
        }
        shown.relay.poll();
        skipped.push(shown.relay.skipped());
        shown.player.connections.feed.close();
        drop(shown.player);
        shown.this.close(PATIENCE).unwrap();
    }
    // One picture waits to be fetched, and all others are counted as skipped.
    let looks = (1_000 * EVERY) as f64 / RATE * FPS;
    assert_eq!(skipped, [0, looks as u64]);
    let listened = paths.map(|path| {
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        bytes
    });
    assert!(listened[0].iter().filter(|byte| **byte != 0).count() > 100_000);
    assert!(listened[0] == listened[1], "with a window");
    assert!(
        listened[0] == listened[2],
        "with one that nobody looks through"
    );
}

/// Contacts and levels of skipped pictures are in the next picture.
#[test]
fn skipped_pictures_are_gathered_in_the_next() {
    let scene = scene(&[]);
    let simulation = planned(&scene, 0);
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut cursor = shown.server.hub().join();
    shown.tick(1);
    shown.relay.poll();
    let before = messages(&shown.server, &mut cursor).concat();
    assert!(
        !chunks(&before)
            .iter()
            .any(|chunk| chunk.0 == kind::CONTACTS)
    );
    // The hammer meets the skin after 25 ms, while the picture of 17 ms has not been fetched, and leaves it some
    // milliseconds later.
    shown.tick(400);
    shown.relay.poll();
    shown.tick(20);
    shown.relay.poll();
    let after = messages(&shown.server, &mut cursor).concat();
    let pushes: Vec<_> = chunks(&after)
        .into_iter()
        .filter(|chunk| chunk.0 == kind::CONTACTS)
        .collect();
    let &[(_, t, ref payload)] = pushes.as_slice() else {
        panic!("{pushes:?}");
    };
    let dt = f64::from(f32::from_le_bytes(payload[..4].try_into().unwrap()));
    assert!((0.025..0.05).contains(&(t + dt)), "{t} + {dt}");
    assert!(shown.relay.skipped() > 20);
    shown.end();
}

/// A new version has its own manifest from its first picture on; a version that came too late is never shown.
#[test]
fn version_is_shown_from_its_takeover_on() {
    let first = scene(&strikes());
    let (old, second) = (planned(&first, 0), scene(&[0.6, 0.7]));
    let mut shown = Shown::fast(&old, &first.1);
    let mut cursor = shown.server.hub().join();
    let every = EVERY as u64;
    let second_at = |tick: u64| planned(&second, tick * every);
    let change = |shown: &mut Shown, tick: u64, new: &Simulation| {
        let change = Change {
            simulation: Some((new.fork(), Takeover::new(&old, new))),
            ..Change::default()
        };
        shown.this.change(tick * every, change).unwrap();
    };
    let open = |shown: &mut Shown, new: &Simulation, title: &str| {
        let (window, scene) = window_on(new, &second.1, title);
        assert!(shown.this.open(window));
        shown
            .coming
            .send((scene, shown.this.output_times()))
            .unwrap();
    };
    shown.tick(300);
    let (late, new) = (second_at(200), second_at(600));
    change(&mut shown, 200, &late);
    open(&mut shown, &late, "late");
    change(&mut shown, 600, &new);
    open(&mut shown, &new, "second");
    let mut titles = Vec::new();
    for tick in 300..900_u64 {
        shown.tick(1);
        shown.relay.poll();
        if tick == 800 {
            open(&mut shown, &new, "again");
        }
        for message in messages(&shown.server, &mut cursor) {
            if let Some((kind::MANIFEST, _, json)) = chunks(&message).first() {
                let manifest: serde_json::Value = serde_json::from_slice(json).unwrap();
                titles.push((tick, manifest["title"].as_str().unwrap().to_owned()));
            }
        }
    }
    assert_eq!(titles.len(), 3, "{titles:?}");
    assert_eq!(titles[0], (300, "first".into()));
    assert!(
        (600..620).contains(&titles[1].0) && titles[1].1 == "second",
        "{titles:?}"
    );
    // A window may be opened at any time, also after its version has begun.
    assert!((800..820).contains(&titles[2].0) && titles[2].1 == "again");
    // A page that joins now gets nothing of the first version.
    let late = messages(&shown.server, &mut shown.server.hub().join());
    let kinds: Vec<u16> = late
        .iter()
        .flat_map(|own| chunks(own))
        .map(|own| own.0)
        .collect();
    assert_eq!(kinds[0], kind::MANIFEST);
    assert_eq!(
        kinds.iter().filter(|own| **own == kind::MANIFEST).count(),
        1
    );
    assert!(kinds.contains(&kind::STATE));
    shown.end();
}

/// A page's WebSocket.
fn page(server: &Server) -> WebSocket<TcpStream> {
    let port = server.address().port();
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let path = server.url();
    let path = path.splitn(4, '/').nth(3).unwrap();
    let head = format!(
        "GET /{path}live HTTP/1.1\r\nHost: localhost:{port}\r\nOrigin: http://localhost:{port}\r\nUpgrade: websocket\r\n\
         Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).unwrap();
    let mut answer = Vec::new();
    while !answer.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).unwrap();
        answer.extend(byte);
    }
    assert!(answer.starts_with(b"HTTP/1.1 101"));
    let mut page = WebSocket::from_raw_socket(stream, Role::Client, None);
    // The reply shows that the page has joined.
    page.send(Message::text("ping 0")).unwrap();
    page
}

/// Read up to the picture of an instant.
fn read_until(page: &mut WebSocket<TcpStream>, seconds: f64) -> Vec<u8> {
    let mut bytes = Vec::new();
    loop {
        if let Message::Binary(message) = page.read().expect("a message") {
            let is_there = chunks(&message)
                .iter()
                .any(|own| own.0 == kind::PEAKS && own.1 == seconds);
            bytes.extend_from_slice(&message);
            if is_there {
                return bytes;
            }
        }
    }
}

/// Four pages over sockets in lockstep, a page that joins late, and a page that reads nothing: nobody waits for the
/// latter, and it is dropped.
#[test]
fn stalled_page_delays_no_performance() {
    let scene = scene(&strikes());
    let simulation = planned(&scene, 0);
    let limits = Limits {
        stall: Duration::from_millis(100),
        ..Limits::default()
    };
    let mut shown = Shown::new(&simulation, &scene.1, config("null:fast"), limits);
    let stalled = page(&shown.server);
    let mut pages: Vec<_> = (0..3).map(|_| page(&shown.server)).collect();
    let mut all = vec![Vec::new(); 4];
    let mut seen = None;
    for tick in 0..1_500 {
        if tick == 800 {
            pages.push(page(&shown.server));
        }
        shown.tick(1);
        shown.relay.poll();
        let seconds = shown.frame() as f64 / RATE;
        let number = (seconds * FPS) as u64;
        if seen.replace(number) != Some(number) {
            for (page, bytes) in pages.iter_mut().zip(&mut all) {
                bytes.extend(read_until(page, seconds));
            }
        }
    }
    assert_eq!(shown.relay.skipped(), 0);
    assert!(shown.server.hub().bytes() <= 16 << 20);
    let (late, prompt) = all.split_last().unwrap();
    assert!(prompt[0].starts_with(&MAGIC) && late.starts_with(&MAGIC));
    // Three pages get the same, and the late page gets the same from a key state on.
    let file = |bytes: &[u8]| MotionFile::new(bytes.to_vec()).expect("a motion file");
    let (first, last) = (file(&prompt[0]), file(late));
    let instants = [1.3, 1.4, 1.45];
    let wanted = first.displacements(&instants).unwrap();
    for bytes in &prompt[1..] {
        assert_eq!(file(bytes).displacements(&instants).unwrap(), wanted);
    }
    let peak = wanted.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let result = last.displacements(&instants).unwrap();
    let off = result.iter().zip(&wanted).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f64::max) <= 1e-3 * peak && peak > 0.0);
    // Messages fill the socket of the stalled page, which is then dropped.
    let blob = vec![0; 1 << 20];
    let tally = shown.server.tally();
    while tally.dropped.load(Ordering::Relaxed) == 0 {
        shown
            .server
            .hub()
            .publish(&blob, ergon_view::serve::Keep::All);
        for page in &mut pages {
            while page.read().expect("a message").len() != blob.len() {}
        }
    }
    drop((stalled, pages));
    shown.end();
}
