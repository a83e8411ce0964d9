//! Emulated devices in threads, for tests to open.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ergon_live::device::{self, Device, DeviceUrl, guardian};
use ergon_live::emulate::{
    BoardConfig, EmulatedHand, EmulationOptions, KeyConstants, Protocol, ServeEvent, ServeSummary, Transport, serve,
};

/// Rate of ticks of 44 samples at 44.1 kHz.
pub(crate) const RATE: f64 = 44_100.0 / 44.0;

pub(crate) struct Emulator {
    pub(crate) address: String,
    pub(crate) events: Receiver<ServeEvent>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<ServeSummary>,
}

pub(crate) fn options(
    protocol: Protocol,
    transport: Transport,
    axes: usize,
    hands: Vec<EmulatedHand>,
) -> EmulationOptions {
    let key = KeyConstants::default();
    EmulationOptions {
        network: None,
        board: BoardConfig {
            protocol,
            lockstep: true,
            touch_gate: false,
            force_max: 20.0,
            resolution: 0.0,
            noise: 0.0,
            seed: 0,
            force_step: 0.0,
            watchdog: Duration::from_millis(50),
            reported_constants: [key.mass, key.damping],
            range: key.range,
        },
        transport,
        axes,
        key,
        model: None,
        rate: RATE,
        hands,
        seconds: None,
        ends_with_host: false,
    }
}

/// Let this program also act as the guardian of a Haply.
pub(crate) fn can_guard() {
    let arguments = ["--exact", "emulator::guardian_process", "--ignored", "--nocapture"];
    guardian::register_program(guardian::GuardianProgram {
        path: std::env::current_exe().unwrap(),
        arguments: arguments.map(Into::into).into(),
    });
}

/// The guardian process of a Haply that another test opens.
#[test]
#[ignore = "a part of other tests"]
fn guardian_process() {
    guardian::serve().unwrap();
}

impl Emulator {
    pub(crate) fn start(options: EmulationOptions) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (tell, events) = channel();
        let asked = stop.clone();
        let thread = std::thread::spawn(move || {
            let tell = &mut |event| drop(tell.send(event));
            serve(options, tell, &mut || !asked.load(Ordering::Relaxed)).unwrap()
        });
        let Ok(ServeEvent::Ready(address)) = events.recv_timeout(Duration::from_secs(60)) else {
            panic!("no emulator");
        };
        Self {
            address,
            events,
            stop,
            thread,
        }
    }

    pub(crate) fn open(&self, kind: &str, options: &str) -> Box<dyn Device> {
        can_guard();
        let url = DeviceUrl::parse(&format!("{kind}:{}?{options}", self.address)).unwrap();
        device::open(&url).unwrap()
    }

    pub(crate) fn end(self) -> ServeSummary {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// A smooth path there and back within a number of periods.
pub(crate) fn gesture(periods: usize, metres: f64) -> Vec<f64> {
    (0..periods)
        .map(|n| {
            let turn = std::f64::consts::TAU * n as f64 / periods as f64;
            0.5 * metres * (1.0 - libm::cos(turn))
        })
        .collect()
}
