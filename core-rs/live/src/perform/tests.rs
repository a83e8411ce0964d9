//! Ticks by hand: nothing is allocated in them, whatever happens to the keys meanwhile.

use std::sync::Arc;
use std::time::{Duration, Instant};

use assert_no_alloc::{assert_no_alloc, reset_violation_count, violation_count};
use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::simulation::{OnFault, Options};
use ergon_engine::timeline::{HandWay, Timeline};
use ergon_engine::units::Rate;

use super::*;
use crate::device::{Device, Gone, Sample, Spec, Url};
use crate::recording::{Axis, flag, read};
use crate::safety::SafeForce;

const RATE: f64 = 44_100.0;
const EVERY: usize = 44;
const TICKS: u64 = 6_000;
const KEY: &str = "emul:?mass=0.05&damping=1";

/// An emulated key that is pulled out after so many ticks.
struct Brief {
    key: Box<dyn Device>,
    left: u32,
}

impl Device for Brief {
    fn spec(&self) -> &Spec {
        self.key.spec()
    }
    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        self.left = self.left.checked_sub(1).ok_or(Gone::Closed)?;
        self.key.send(force)
    }
    fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        self.key.receive(into, deadline)
    }
    fn in_lockstep(&self) -> bool {
        true
    }
    fn zero(&mut self) {}
}

fn keyboard(hand: usize, left: u32) -> Keyboard {
    let url = Url::parse(KEY).unwrap();
    let key = crate::device::open(&url).unwrap();
    let brief = Box::new(Brief { key, left });
    let known = Known {
        url,
        calibration: Vec::new(),
        most: None,
        period: EVERY as f64 / RATE,
    };
    Keyboard::around(brief, known, vec![(0, hand)])
}

/// Two keys and a mass between them that swings and is heard.
fn stage() -> Stage {
    let rate = Rate::new(RATE).unwrap();
    let mut network = Network::new();
    network.part("keys", None);
    let tie = Tie::Physical { k: 60.0, z: 1.2 };
    let a = network.cel("a", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    let b = network.cel("b", 0.4, tie, 0.0, 0.0, 0.0).unwrap();
    let swinging = Tie::Physical { k: 50.0, z: 0.0 };
    let m = network.cel("m", 0.01, swinging, 4e-3, 0.0, 0.0).unwrap();
    network.spring("am", a, m, 40.0, 0.01, 0.0).unwrap();
    network.spring("bm", b, m, 40.0, 0.01, 0.0).unwrap();
    let heard = Term::Position {
        first: m,
        len: 1,
        weight: 1.0,
    };
    network.listen("out", vec![heard]).unwrap();
    let mut timeline = Timeline::new(rate);
    for mat in [a, b] {
        let way = HandWay::Line;
        timeline
            .hand(&network, mat, EVERY as u32, way, &[])
            .unwrap();
    }
    let options = Options {
        ledger: false,
        record: false,
        on_fault: OnFault::Mute,
        threads: 1,
        unchecked: false,
    };
    let mut mixer = Mixer::new(RATE, 1, 2);
    mixer.route(0, 0, 1.0, None).unwrap();
    mixer.route(0, 1, 0.5, Some(8.0)).unwrap();
    let hand = Hand {
        standin: (0..TICKS).map(|n| 1e-6 * (n % 1_000) as f64).collect(),
        reach: 1.0,
        guide: Some(Guide { k: 50.0, z: 0.5 }),
        response: Vec::new(),
    };
    Stage {
        simulation: Simulation::new(Arc::new(network), &timeline, options).unwrap(),
        mixer,
        gain: 1.0,
        limiter: Limiter::new(RATE, 2, 1.0).unwrap(),
        n_frames: None,
        every: EVERY,
        hands: vec![hand; 2],
        bars: (0..).map(|bar| bar * 4_410).take(1_000).collect(),
        frozen: Vec::new(),
    }
}

/// A key is pulled out and comes back, a panic is called and taken back, the gain changes, all is recorded.
#[test]
fn a_tick_does_not_allocate() {
    let path = std::env::temp_dir().join(format!("ergon-ticks-{}.take", std::process::id()));
    let axis = |player: &str| Axis {
        player: player.into(),
        key: "k".into(),
    };
    let header = Header {
        rate: RATE,
        frames: EVERY as u32,
        axes: vec![axis("ada"), axis("remi")],
        about: "{}".into(),
    };
    let how = How {
        audio: "null:fast".parse().unwrap(),
        ahead: None,
        record: Some((path.clone(), header)),
    };
    let boards = vec![keyboard(0, u32::MAX), keyboard(1, 1_000)];
    let (mut this, mut player) = Performance::prepare(stage(), boards, how).unwrap();
    player.begin();
    reset_violation_count();
    assert_no_alloc(|| {
        for tick in 0..TICKS {
            assert!(player.tick());
            match tick {
                // The key is looked for by a thread that waits; ticks here do not.
                2_000 => std::thread::sleep(Duration::from_millis(700)),
                3_000 => assert!(this.gain(0.5)),
                4_000 => this.panic(),
                4_500 => this.release(),
                _ => {}
            }
        }
    });
    assert_eq!(violation_count(), 0);
    assert_eq!(this.status().ticks, TICKS);
    let events: Vec<_> = std::iter::from_fn(|| this.event())
        .map(|event| event.what)
        .collect();
    assert_eq!(events, [What::Gone(1), What::Back(1), What::TookOver(1)]);
    drop(player);
    this.close(Duration::from_secs(10)).unwrap();
    let recording = read(&path, None).unwrap();
    std::fs::remove_file(path).unwrap();
    assert_eq!(recording.dropped, 0);
    assert_eq!(recording.ticks.len() as u64, TICKS);
    let stood_in: Vec<_> = recording
        .samples
        .chunks(2)
        .map(|row| {
            row.iter()
                .map(|axis| axis.flags & flag::STAND_IN)
                .sum::<u8>()
        })
        .collect();
    let from = stood_in.iter().position(|stood| *stood != 0).unwrap();
    let to = stood_in.iter().rposition(|stood| *stood != 0).unwrap();
    // The first position comes without a force; a bar is 4,410 frames.
    assert_eq!(from, 1_001);
    assert!((to + 1) * EVERY % 4_410 < EVERY, "{to}");
    assert!(stood_in[from..=to].iter().all(|stood| *stood != 0));
    assert!(recording.samples.iter().any(|axis| axis.sent.abs() > 1e-3));
}
