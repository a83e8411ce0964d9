//! Performances whose ticks are run one by one: no tick allocates, whatever happens meanwhile. This module has what
//! these tests share.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use ergon_engine::network::{Network, Term, Tie};
use ergon_engine::plan::{Budget, Plan};
use ergon_engine::simulation::{OnFault, SimulationOptions};
use ergon_engine::timeline::{HandInterpolation, Timeline};
use ergon_engine::units::Rate;

use super::*;
use crate::device::{DeviceUrl, WaitCanceller};

mod changes;
mod keys;
mod sound;
pub(super) mod unplugged;
mod windows;

use unplugged::Unplugged;

const RATE: f64 = 44_100.0;
const EVERY: usize = 44;
const TICKS: u64 = 6_000;
const KEY: &str = "emul:?mass=0.05&damping=1";
/// How long a test waits before it gives up. No result depends on it, because the machine may be busy.
const PATIENCE: Duration = Duration::from_secs(120);

/// A configuration in which sound goes to `audio`; there is no input and no recording.
fn config(audio: &str) -> PlaybackConfig {
    PlaybackConfig {
        audio: audio.parse().unwrap(),
        frames_ahead: None,
        recording: None,
        input: InputConfig::default(),
    }
}

/// The last n samples of a file of floats, as bits; the file is deleted.
fn taken(path: &Path, n: usize) -> Vec<u32> {
    let file_bytes = std::fs::read(path).unwrap();
    std::fs::remove_file(path).unwrap();
    let samples = file_bytes[file_bytes.len() - 4 * n..].chunks_exact(4);
    samples.map(|x| u32::from_le_bytes(x.try_into().unwrap())).collect()
}

const OPTIONS: SimulationOptions = SimulationOptions {
    keeps_ledger: false,
    records_ergons: false,
    on_fault: OnFault::Mute,
    threads: 1,
    is_unchecked: false,
};

fn keyboard(hand: usize, left: u32) -> Keyboard {
    let url = DeviceUrl::parse(KEY).unwrap();
    let key = crate::device::open(&url).unwrap();
    let unplugged_device = Box::new(Unplugged { key, left });
    let device_config = DeviceConfig {
        url,
        calibration: Vec::new(),
        force_limit: None,
        period: EVERY as f64 / RATE,
        canceller: WaitCanceller::default(),
    };
    Keyboard::from_device(unplugged_device, device_config, vec![(0, hand)])
}

/// Two keys, and between them a mass that swings and is heard.
fn network() -> Network {
    let mut network = Network::new();
    network.part("keys", None);
    let key_support = Tie::Physical { k: 60.0, z: 1.2 };
    let first_key = network.cel("a", 0.4, key_support, 0.0, 0.0, 0.0).unwrap();
    let second_key = network.cel("b", 0.4, key_support, 0.0, 0.0, 0.0).unwrap();
    let swinging = Tie::Physical { k: 50.0, z: 0.0 };
    let swinging_mass = network.cel("m", 0.01, swinging, 4e-3, 0.0, 0.0).unwrap();
    network.spring("am", first_key, swinging_mass, 40.0, 0.01, 0.0).unwrap();
    network
        .spring("bm", second_key, swinging_mass, 40.0, 0.01, 0.0)
        .unwrap();
    let listened = Term::Position {
        first: swinging_mass,
        len: 1,
        weight: 1.0,
    };
    network.listen("out", vec![listened]).unwrap();
    network
}

/// A simulation in which both keys are held and the mass is struck at these instants [s].
fn simulation(struck: &[f64], from: u64) -> Simulation {
    let network = Arc::new(network());
    let mut timeline = Timeline::new(Rate::new(RATE).unwrap());
    timeline.open();
    for mat in [0, 1] {
        let hand_way = HandInterpolation::Line;
        timeline.add_hand(&network, mat, EVERY as u32, hand_way, &[]).unwrap();
    }
    for &instant in struck {
        timeline.strike(&network, 2, instant, 1e-3, Some(0.0), 0).unwrap();
    }
    let plan = Plan::new(network, &timeline, &Budget::default(), None).unwrap();
    Simulation::from_plan_at_frame(Arc::new(plan), OPTIONS, from).unwrap()
}

fn stage_mixer() -> Mixer {
    let mut mixer = Mixer::new(RATE, 1, 2);
    mixer.add_route(0, 0, 1.0, None).unwrap();
    mixer.add_route(0, 1, 0.5, Some(8.0)).unwrap();
    mixer
}

fn piece() -> PreparedPiece {
    let mixer = stage_mixer();
    let stage_hand = LiveHand {
        standin_positions: (0..TICKS).map(|n| 1e-6 * (n % 1_000) as f64).collect(),
        travel_ratio: 1.0,
        guidance: Some(Guidance {
            k: 50.0,
            z: 0.5,
            follows_steps: false,
        }),
        ..LiveHand::default()
    };
    PreparedPiece {
        simulation: simulation(&[], 0),
        mixer,
        gain: 1.0,
        fold: None,
        limiter: Limiter::new(RATE, 2, 1.0).unwrap(),
        n_frames: None,
        silence_detector: None,
        tick_frames: EVERY,
        hands: vec![stage_hand; 2],
        bars: (0..).map(|bar| bar * 4_410).take(1_000).collect(),
        frozen_stems: Vec::new(),
        is_displayed: false,
    }
}
