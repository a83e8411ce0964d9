//! A scene, a window on it, and a performance whose ticks and pages are advanced by the test.

use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{Gesture, Manner};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::network::{SpaceLaw, SpacePoint, SpacePoints};
use ergon_engine::simulation::MotionLook;

use super::*;

pub(super) const FPS: f64 = 60.0;
pub(super) const CELLS: usize = 12;

/// Cells that swing freely, and a skin that a hammer falls on.
pub(super) fn scene(struck: &[f64]) -> (Arc<Network>, Timeline) {
    let mut network = Network::new();
    network.part("sky", None);
    for i in 0..CELLS {
        let f = 40.0 * libm::pow(1.4, i as f64);
        let tuned_tie = Tie::Tuned { f, t60: Some(0.8) };
        let cell_name = format!("c{i}");
        network.cel(&cell_name, 1e-3, tuned_tie, 0.0, 0.0, 0.0).unwrap();
    }
    network.part("skin", None);
    let topology = plate(Shape::Hex, 2, Rim::Fixed).unwrap();
    let skin_start = network.mesh("p", &topology, 1e-3, 200.0, Some(0.5), 0.0).unwrap();
    let hammer_mass = network.mas("h", 5e-3, -5e-3, 0.2).unwrap();
    let hammer_but = But::plain(4e4, 0.0, 0.0);
    network.but("hits", hammer_mass, skin_start + 5, hammer_but).unwrap();
    let listened = |first, len| Term::Position {
        first,
        len,
        weight: 10.0,
    };
    let listened_terms = vec![listened(0, CELLS), listened(skin_start + 8, 1)];
    network.listen("out", listened_terms).unwrap();
    let network = Arc::new(network);
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    for (i, &index) in struck.iter().enumerate() {
        timeline
            .strike(&network, i % CELLS, index, 2e-5, Some(0.0), i as u32)
            .unwrap();
    }
    (network, timeline)
}

/// A key that moves up by 4 mm and back within 0.74 s, and a bell that it pulls.
pub(super) fn gesture() -> (Arc<Network>, Timeline) {
    let mut network = Network::new();
    let physical_tie = |k, z| Tie::Physical { k, z };
    network.part("bell", None);
    network.cel("b", 2e-3, physical_tie(4e3, 0.01), 0.0, 0.0, 0.0).unwrap();
    network.part("key", None);
    let key_mass = network.cel("m", 0.08, physical_tie(20.0, 0.4), 0.0, 0.0, 0.0).unwrap();
    network.spring("s", key_mass, 0, 5.0, 0.0, 0.0).unwrap();
    let position_term = Term::Position {
        first: 0,
        len: 2,
        weight: 1.0,
    };
    network.listen("out", vec![position_term]).unwrap();
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    let gesture_key = timeline.add_key("key", key_mass);
    let path_times: Vec<f64> = (0..13).map(|i| 0.02 + 0.06 * f64::from(i)).collect();
    let path_positions: Vec<f64> = (0..13).map(|i| 4e-3 * f64::from(i % 2)).collect();
    let written = WrittenPoints {
        t: &path_times,
        x: &path_positions,
        approaches: &[Approach::Path(Curve::Smooth); 13],
        sources: &[],
    };
    let gesture = Gesture::from_points(gesture_key, &written, Manner::OPEN).unwrap();
    timeline.add_gesture(gesture).unwrap();
    (Arc::new(network), timeline)
}

/// A ball of 1 kg that tears a thread of 1 kN/m at 0.4 m/s.
pub(super) fn torn() -> (Arc<Network>, Timeline) {
    let mut network = Network::new();
    network.part("w", None);
    let mut space_point = |name, m: f64, x: f64, v: f64| {
        let space_points = SpacePoints {
            n_axes: 2,
            masses: &[m],
            x0: &[x, 0.0],
            v0: &[v, 0.0],
            z: 0.0,
        };
        SpacePoint::strided(network.points(name, false, space_points).unwrap(), 1)
    };
    let thread_ends = (space_point("nail", 0.0, 0.0, 0.0), space_point("ball", 1.0, 0.1, 0.4));
    let tearing_law = SpaceLaw::Yielding {
        yield_force: f64::INFINITY,
        break_elongation: 8e-3,
    };
    network
        .space_links("thread", thread_ends, 1, 2, tearing_law, [1e3, 0.0, 0.1])
        .unwrap();
    let position_term = Term::Position {
        first: thread_ends.1.first,
        len: 1,
        weight: 1.0,
    };
    network.listen("out", vec![position_term]).unwrap();
    (Arc::new(network), Timeline::new(Rate::new(RATE).unwrap()))
}

pub(super) fn planned(scene: &(Arc<Network>, Timeline), from: u64) -> Simulation {
    let plan = Plan::new(scene.0.clone(), &scene.1, &Budget::default(), None).unwrap();
    Simulation::from_plan_at_frame(Arc::new(plan), OPTIONS, from).unwrap()
}

/// Strikes within a second and a half, some at the same instant.
pub(super) fn strikes() -> Vec<f64> {
    (0..40).map(|i| f64::from(i * i % 53) / 36.0).collect()
}

/// A window as a performance has it, with the manifest that a reader needs.
pub(super) fn window_on(simulation: &Simulation, timeline: &Timeline, title: &str) -> (DisplayWindow, WindowReader) {
    let look = simulation.make_look();
    let part_list: Vec<_> = point_runs(&look)
        .into_iter()
        .map(|run| {
            let mode_range = run.body.map(|body| {
                let body = &look.bodies[body];
                serde_json::json!({"first": body.first_mode, "count": body.modes.len(), "of": body.n_modes})
            });
            serde_json::json!({"name": run.part.to_string(), "first": run.points.start,
                "count": run.points.len(), "kind": run.kind, "modes": mode_range})
        })
        .collect();
    let manifest = serde_json::json!({"title": title, "points": look.points.len(), "modes": look.n_modes(),
        "parts": part_list, "fps": FPS});
    let mut ergons = simulation.written_ergons(timeline);
    ergons.sort_by(|a, b| a.time.total_cmp(&b.time));
    let window_setup = RecordingSetup {
        manifest: manifest.to_string(),
        point_positions: vec![[0.0; 3]; look.points.len()],
        ergons,
        strike_points: timeline.strike_points().collect(),
        key_mats: Vec::new(),
        n_speakers: 2,
        looks_per_second: FPS,
    };
    window_pair(simulation, look, window_setup).unwrap()
}

pub(super) fn prepared_piece(simulation: &Simulation, is_seen: bool) -> PreparedPiece {
    PreparedPiece {
        simulation: simulation.fork(),
        hands: Vec::new(),
        is_displayed: is_seen,
        ..piece()
    }
}

pub(super) fn served(limits: ConnectionLimits) -> Arc<Server> {
    let options = ergon_view::serve::ServerOptions {
        address: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
        access_key: ergon_view::serve::AccessKey::new(&"0".repeat(32)).expect("a key"),
        motion_file: None,
        sound_file: None,
        page_keys: Vec::new(),
        limits,
    };
    Arc::new(Server::start(options).expect("a server"))
}

/// A performance whose ticks and pages are advanced by the test.
pub(super) struct Shown {
    pub(super) this: Performance,
    pub(super) player: Player,
    pub(super) server: Arc<Server>,
    pub(super) relay: WindowRelay,
    pub(super) reader_sender: Sender<(WindowReader, PlaybackTimes)>,
}

impl Shown {
    /// A performance that runs as fast as it can, without an output file.
    pub(super) fn fast(simulation: &Simulation, timeline: &Timeline) -> Self {
        let config = config("null:fast");
        Self::new(simulation, timeline, config, ConnectionLimits::default())
    }

    pub(super) fn new(
        simulation: &Simulation,
        timeline: &Timeline,
        config: PlaybackConfig,
        limits: ConnectionLimits,
    ) -> Self {
        let (window, scene) = window_on(simulation, timeline, "first");
        let piece = prepared_piece(simulation, true);
        let (mut this, mut player) = Performance::prepare(piece, Vec::new(), config).unwrap();
        player.receive_first_positions();
        assert!(this.open_window(window));
        let server = served(limits);
        let (reader_sender, new_readers) = channel();
        reader_sender.send((scene, this.output_times())).unwrap();
        let relay = WindowRelay::new(server.clone(), new_readers);
        Self {
            this,
            player,
            server,
            relay,
            reader_sender,
        }
    }

    /// Run `n` ticks; no page reads meanwhile.
    pub(super) fn tick(&mut self, n: u64) {
        reset_violation_count();
        assert_no_alloc(|| (0..n).for_each(|_| assert!(self.player.tick())));
        assert_eq!(violation_count(), 0);
    }

    pub(super) fn frame(&self) -> u64 {
        self.player.frame
    }

    pub(super) fn end(self) {
        drop(self.player);
        self.this.close(PATIENCE).unwrap();
    }
}

/// All messages for a viewer so far.
pub(super) fn messages(server: &Server, cursor: &mut ViewerCursor) -> Vec<Vec<u8>> {
    let mut all_messages = Vec::new();
    loop {
        match server.hub().next_message(cursor, Duration::ZERO) {
            NextMessage::Message(bytes) => all_messages.push(bytes.to_vec()),
            NextMessage::Nothing => return all_messages,
            other => panic!("{other:?}"),
        }
    }
}

/// Kind, instant and payload of consecutive chunks.
pub(super) fn chunks(mut bytes: &[u8]) -> Vec<(u16, f64, Vec<u8>)> {
    let mut all_chunks = Vec::new();
    bytes = bytes.strip_prefix(&MAGIC[..]).unwrap_or(bytes);
    while !bytes.is_empty() {
        let (chunk, chunk_length) = motion::read_chunk(bytes).expect("a whole chunk");
        all_chunks.push((chunk.kind, chunk.seconds, chunk.payload.to_vec()));
        bytes = &bytes[chunk_length..];
    }
    all_chunks
}

/// The ergons in chunks, by rising instant: [s], MAT, impulse [N·s].
pub(super) fn ergons(bytes: &[u8], look: &MotionLook) -> Vec<(f64, usize, f64)> {
    let word_bytes = |single: &[u8], at: usize| <[u8; 4]>::try_from(&single[at..at + 4]).unwrap();
    let mut read_ergons = Vec::new();
    for (_, t, payload) in (chunks(bytes).iter()).filter(|one| one.0 == kind::ERGONS) {
        for single in payload.chunks(20) {
            let number_at = |at| f64::from(f32::from_le_bytes(word_bytes(single, at)));
            let point_index = u32::from_le_bytes(word_bytes(single, 4)) as usize;
            read_ergons.push((t + number_at(0), look.points[point_index].mat, number_at(8)));
        }
    }
    read_ergons.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    read_ergons
}

/// Instants must agree with those of the strikes to a hundredth of a frame.
pub(super) fn assert_ergons(ergons: &[(f64, usize, f64)], wanted: &[(f64, usize, f64)]) {
    assert_eq!(ergons.len(), wanted.len(), "{ergons:?}, {wanted:?}");
    for (item, wanted) in ergons.iter().zip(wanted) {
        assert!((item.0 - wanted.0).abs() < 1e-7, "{item:?}, {wanted:?}");
        assert_eq!(item.1, wanted.1);
        assert!((item.2 / wanted.2 - 1.0).abs() < 1e-6, "{item:?}, {wanted:?}");
    }
}
