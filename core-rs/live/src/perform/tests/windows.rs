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
use ergon_view::record::{RecordingSetup, point_runs};
use ergon_view::serve::{ConnectionLimits, NextMessage, Server, ViewerCursor};
use tungstenite::protocol::Role;
use tungstenite::{Message, WebSocket};

use super::super::player::Player;
use super::super::window::{DisplayWindow, PlaybackTimes, WindowReader, WindowRelay, window_pair};
use super::*;

mod rig;
mod strikes;

use rig::*;

/// A page that misses nothing gets the positions of the engine's masses, once per video frame.
#[test]
fn pages_receive_positions_of_the_engine() {
    let scene = scene(&strikes());
    let simulation = planned(&scene, 0);
    let mut reference = simulation.fork();
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut hub_cursor = shown.server.hub().new_cursor();
    let (mut message_bytes, mut picture_frames) = (Vec::new(), Vec::new());
    let mut squares = Vec::new();
    for _ in 0..2_000 {
        shown.tick(1);
        shown.relay.poll();
        let new_messages = messages(&shown.server, &mut hub_cursor);
        let mut listened = vec![0.0; EVERY];
        reference.process(&mut listened).unwrap();
        squares.extend(listened.iter().map(|x| x * x));
        if new_messages.is_empty() {
            continue;
        }
        picture_frames.push(shown.frame());
        message_bytes.extend(new_messages.concat());
    }
    assert_eq!(shown.relay.skipped_count(), 0);
    let seconds: Vec<f64> = picture_frames.iter().map(|frame| *frame as f64 / RATE).collect();
    // Each video frame has one picture, made at the first tick of the frame.
    let numbers: Vec<u64> = seconds.iter().map(|t| (t * FPS) as u64).collect();
    let n = (2_000 * EVERY) as f64 / RATE * FPS;
    assert_eq!(numbers, (0..=n as u64).collect::<Vec<_>>());

    let all_chunks = chunks(&message_bytes);
    let chunks_of_kind = |which: u16| {
        all_chunks
            .iter()
            .filter(move |chunk| chunk.0 == which)
            .collect::<Vec<_>>()
    };
    assert_eq!(chunks_of_kind(kind::MANIFEST).len(), 1);
    assert_eq!(chunks_of_kind(kind::STATE).len(), 2, "one in a second");
    assert!(chunks_of_kind(kind::CLOCK).is_empty(), "no clock takes these frames");
    assert!(!chunks_of_kind(kind::CONTACTS).is_empty());
    // Every strike is reported once.
    let mut shown_strikes: Vec<f64> = chunks_of_kind(kind::ERGONS)
        .iter()
        .flat_map(|(_, t, payload)| {
            let records = payload.chunks(20);
            records.map(move |frame_squares| t + f64::from(f32::from_le_bytes(frame_squares[..4].try_into().unwrap())))
        })
        .collect();
    let mut expected = strikes();
    shown_strikes.sort_by(f64::total_cmp);
    expected.sort_by(f64::total_cmp);
    assert_eq!(shown_strikes.len(), expected.len());
    assert!(shown_strikes.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6));
    // Levels: the first channel is the output itself. The window was opened in the first tick and has no level of it.
    let level_chunks = chunks_of_kind(kind::LEVELS);
    assert_eq!(level_chunks.len(), picture_frames.len() - 1);
    for (index, (_, t, payload)) in level_chunks.iter().enumerate() {
        let page_level = f64::from(f32::from_le_bytes(payload[..4].try_into().unwrap()));
        let frame_squares = &squares[picture_frames[index] as usize..picture_frames[index + 1] as usize];
        let expected = (frame_squares.iter().sum::<f64>() / frame_squares.len() as f64).sqrt();
        assert_eq!(*t, seconds[index + 1]);
        assert!(
            (page_level - expected).abs() <= 1e-6 * expected + 1e-12,
            "{t}: {page_level}, {expected}"
        );
    }

    // Positions of points, as read by the reader of files.
    let look = simulation.make_look();
    let motion_file = MotionFile::new(message_bytes).expect("a motion file");
    let displacements = motion_file.displacements(&seconds).expect("frames");
    let mut second_fork = simulation.fork();
    let (mut snapshot, n) = (
        ergon_engine::simulation::MotionSnapshot::new(&second_fork, &look),
        look.points.len(),
    );
    let mut error_by_kind: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for (row, &frame) in displacements.chunks(n).zip(&picture_frames) {
        let frames_left = (frame - second_fork.frame()) as usize;
        second_fork.process(&mut vec![0.0; frames_left]).unwrap();
        second_fork.fill_snapshot(&look, &mut snapshot);
        for run in point_runs(&look) {
            let (worst_error, peak_swing) = error_by_kind.entry(run.kind).or_default();
            for index in run.points.clone() {
                let expected = match run.body.map(|body| &look.bodies[body]) {
                    None => snapshot.tracks[index],
                    Some(body) => {
                        let row = &body.shapes[(index - run.points.start) * body.modes.len()..];
                        let mode_tracks = &snapshot.tracks[n + body.first_mode..];
                        row.iter()
                            .zip(&mode_tracks[..body.modes.len()])
                            .map(|(a, b)| a * b)
                            .sum()
                    }
                };
                *worst_error = worst_error.max((row[index] - expected).abs());
                *peak_swing = peak_swing.max(expected.abs());
            }
        }
    }
    assert!(
        error_by_kind.contains_key("free") && error_by_kind.len() > 1,
        "{error_by_kind:?}"
    );
    for (kind, (worst_error, peak_swing)) in error_by_kind {
        assert!(
            worst_error <= 5e-3 * peak_swing && peak_swing > 0.0,
            "{kind}: {worst_error} of {peak_swing}"
        );
    }
    shown.end();
}

/// The sound is the same to the bit without a window, with a window, and with a window whose pictures nobody fetches.
#[test]
fn window_changes_no_sample() {
    let scene = scene(&strikes());
    let simulation = planned(&scene, 0);
    let wav_path = |name: &str| std::env::temp_dir().join(format!("ergon-window-{name}-{}.wav", std::process::id()));
    let file_config = |wav_path: &PathBuf| config(&format!("file:{}", wav_path.display()));
    let wav_paths = ["none", "shown", "stalled"].map(wav_path);

    let piece = prepared_piece(&simulation, false);
    let (performance, mut player) = Performance::prepare(piece, Vec::new(), file_config(&wav_paths[0])).unwrap();
    player.receive_first_positions();
    (0..1_000).for_each(|_| assert!(player.tick()));
    player.connections.ring_writer.close();
    drop(player);
    performance.close(PATIENCE).unwrap();
    let mut skipped = Vec::new();
    for (wav_path, is_looked_at) in [(&wav_paths[1], true), (&wav_paths[2], false)] {
        let mut shown = Shown::new(
            &simulation,
            &scene.1,
            file_config(wav_path),
            ConnectionLimits::default(),
        );
        for _ in 0..1_000 {
            shown.tick(1);
            if is_looked_at {
                shown.relay.poll();
            }
        }
        shown.relay.poll();
        skipped.push(shown.relay.skipped_count());
        shown.player.connections.ring_writer.close();
        drop(shown.player);
        shown.this.close(PATIENCE).unwrap();
    }
    // One picture waits to be fetched, and all others are counted as skipped.
    let picture_count = (1_000 * EVERY) as f64 / RATE * FPS;
    assert_eq!(skipped, [0, picture_count as u64]);
    let listened = wav_paths.map(|wav_path| {
        let file_bytes = std::fs::read(&wav_path).unwrap();
        std::fs::remove_file(wav_path).unwrap();
        file_bytes
    });
    assert!(listened[0].iter().filter(|byte| **byte != 0).count() > 100_000);
    assert!(listened[0] == listened[1], "with a window");
    assert!(listened[0] == listened[2], "with one that nobody looks through");
}

/// Contacts and levels of skipped pictures are in the next picture.
#[test]
fn skipped_pictures_are_gathered_in_the_next() {
    let scene = scene(&[]);
    let simulation = planned(&scene, 0);
    let mut shown = Shown::fast(&simulation, &scene.1);
    let mut hub_cursor = shown.server.hub().new_cursor();
    shown.tick(1);
    shown.relay.poll();
    let bytes_before = messages(&shown.server, &mut hub_cursor).concat();
    assert!(!chunks(&bytes_before).iter().any(|chunk| chunk.0 == kind::CONTACTS));
    // The hammer meets the skin after 25 ms, while the picture of 17 ms has not been fetched, and leaves it some
    // milliseconds later.
    shown.tick(400);
    shown.relay.poll();
    shown.tick(20);
    shown.relay.poll();
    let bytes_after = messages(&shown.server, &mut hub_cursor).concat();
    let contact_chunks: Vec<_> = chunks(&bytes_after)
        .into_iter()
        .filter(|chunk| chunk.0 == kind::CONTACTS)
        .collect();
    let &[(_, picture_time, ref payload)] = contact_chunks.as_slice() else {
        panic!("{contact_chunks:?}");
    };
    let contact_offset = f64::from(f32::from_le_bytes(payload[..4].try_into().unwrap()));
    assert!(
        (0.025..0.05).contains(&(picture_time + contact_offset)),
        "{picture_time} + {contact_offset}"
    );
    assert!(shown.relay.skipped_count() > 20);
    shown.end();
}

/// A new version has its own manifest from its first picture on; a version that came too late is never shown.
#[test]
fn version_is_shown_from_its_takeover_on() {
    let first_scene = scene(&strikes());
    let (first_simulation, second_scene) = (planned(&first_scene, 0), scene(&[0.6, 0.7]));
    let mut shown = Shown::fast(&first_simulation, &first_scene.1);
    let mut hub_cursor = shown.server.hub().new_cursor();
    let tick_frames = EVERY as u64;
    let second_at = |tick: u64| planned(&second_scene, tick * tick_frames);
    let change = |shown: &mut Shown, tick: u64, new_simulation: &Simulation| {
        let change = Change {
            simulation: Some((new_simulation.fork(), Takeover::new(&first_simulation, new_simulation))),
            ..Change::default()
        };
        shown.this.change(tick * tick_frames, change).unwrap();
    };
    let open_window = |shown: &mut Shown, new_simulation: &Simulation, title: &str| {
        let (window, scene) = window_on(new_simulation, &second_scene.1, title);
        assert!(shown.this.open_window(window));
        shown.reader_sender.send((scene, shown.this.output_times())).unwrap();
    };
    shown.tick(300);
    let (late, new_simulation) = (second_at(200), second_at(600));
    change(&mut shown, 200, &late);
    open_window(&mut shown, &late, "late");
    change(&mut shown, 600, &new_simulation);
    open_window(&mut shown, &new_simulation, "second");
    let mut window_titles = Vec::new();
    for tick in 300..900_u64 {
        shown.tick(1);
        shown.relay.poll();
        if tick == 800 {
            open_window(&mut shown, &new_simulation, "again");
        }
        for message in messages(&shown.server, &mut hub_cursor) {
            if let Some((kind::MANIFEST, _, manifest_json)) = chunks(&message).first() {
                let manifest: serde_json::Value = serde_json::from_slice(manifest_json).unwrap();
                window_titles.push((tick, manifest["title"].as_str().unwrap().to_owned()));
            }
        }
    }
    assert_eq!(window_titles.len(), 3, "{window_titles:?}");
    assert_eq!(window_titles[0], (300, "first".into()));
    assert!(
        (600..620).contains(&window_titles[1].0) && window_titles[1].1 == "second",
        "{window_titles:?}"
    );
    // A window may be opened at any time, also after its version has begun.
    assert!((800..820).contains(&window_titles[2].0) && window_titles[2].1 == "again");
    // A page that joins now gets nothing of the first version.
    let late = messages(&shown.server, &mut shown.server.hub().new_cursor());
    let chunk_kinds: Vec<u16> = late.iter().flat_map(|own| chunks(own)).map(|own| own.0).collect();
    assert_eq!(chunk_kinds[0], kind::MANIFEST);
    assert_eq!(chunk_kinds.iter().filter(|own| **own == kind::MANIFEST).count(), 1);
    assert!(chunk_kinds.contains(&kind::STATE));
    shown.end();
}

/// A page's WebSocket.
fn page(server: &Server) -> WebSocket<TcpStream> {
    let server_port = server.address().port();
    let mut page_stream = TcpStream::connect(("127.0.0.1", server_port)).unwrap();
    page_stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let path = server.url();
    let path = path.splitn(4, '/').nth(3).unwrap();
    let request_head = format!(
        "GET /{path}live HTTP/1.1\r\nHost: localhost:{server_port}\r\nOrigin: http://localhost:{server_port}\r\nUpgrade: websocket\r\n\
         Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    page_stream.write_all(request_head.as_bytes()).unwrap();
    let mut answer_head = Vec::new();
    while !answer_head.ends_with(b"\r\n\r\n") {
        let mut next_byte = [0];
        page_stream.read_exact(&mut next_byte).unwrap();
        answer_head.extend(next_byte);
    }
    assert!(answer_head.starts_with(b"HTTP/1.1 101"));
    let mut page = WebSocket::from_raw_socket(page_stream, Role::Client, None);
    // The reply shows that the page has joined.
    page.send(Message::text("ping 0")).unwrap();
    page
}

/// Read up to the picture of an instant.
fn read_until(page: &mut WebSocket<TcpStream>, seconds: f64) -> Vec<u8> {
    let mut message_bytes = Vec::new();
    loop {
        if let Message::Binary(message) = page.read().expect("a message") {
            let is_there = chunks(&message)
                .iter()
                .any(|own| own.0 == kind::PEAKS && own.1 == seconds);
            message_bytes.extend_from_slice(&message);
            if is_there {
                return message_bytes;
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
    let stall_limits = ConnectionLimits {
        stall_timeout: Duration::from_millis(100),
        ..ConnectionLimits::default()
    };
    let mut shown = Shown::new(&simulation, &scene.1, config("null:fast"), stall_limits);
    let stalled = page(&shown.server);
    let mut live_pages: Vec<_> = (0..3).map(|_| page(&shown.server)).collect();
    let mut page_bytes = vec![Vec::new(); 4];
    let mut last_picture = None;
    for tick in 0..1_500 {
        if tick == 800 {
            live_pages.push(page(&shown.server));
        }
        shown.tick(1);
        shown.relay.poll();
        let seconds = shown.frame() as f64 / RATE;
        let picture_number = (seconds * FPS) as u64;
        if last_picture.replace(picture_number) != Some(picture_number) {
            for (page, bytes) in live_pages.iter_mut().zip(&mut page_bytes) {
                bytes.extend(read_until(page, seconds));
            }
        }
    }
    assert_eq!(shown.relay.skipped_count(), 0);
    assert!(shown.server.hub().stored_bytes() <= 16 << 20);
    let (late_bytes, prompt_bytes) = page_bytes.split_last().unwrap();
    assert!(prompt_bytes[0].starts_with(&MAGIC) && late_bytes.starts_with(&MAGIC));
    // Three pages get the same, and the late page gets the same from a key state on.
    let motion_of = |bytes: &[u8]| MotionFile::new(bytes.to_vec()).expect("a motion file");
    let (first_motion, late_motion) = (motion_of(&prompt_bytes[0]), motion_of(late_bytes));
    let instants = [1.3, 1.4, 1.45];
    let expected = first_motion.displacements(&instants).unwrap();
    for bytes in &prompt_bytes[1..] {
        assert_eq!(motion_of(bytes).displacements(&instants).unwrap(), expected);
    }
    let peak_motion = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let late_displacements = late_motion.displacements(&instants).unwrap();
    let late_errors = late_displacements.iter().zip(&expected).map(|(a, b)| (a - b).abs());
    assert!(late_errors.fold(0.0, f64::max) <= 1e-3 * peak_motion && peak_motion > 0.0);
    // Messages fill the socket of the stalled page, which is then dropped.
    let filler_bytes = vec![0; 1 << 20];
    let server_tally = shown.server.counts();
    while server_tally.dropped.load(Ordering::Relaxed) == 0 {
        shown
            .server
            .hub()
            .publish(&filler_bytes, ergon_view::serve::Retention::All);
        for page in &mut live_pages {
            while page.read().expect("a message").len() != filler_bytes.len() {}
        }
    }
    drop((stalled, live_pages));
    shown.end();
}
