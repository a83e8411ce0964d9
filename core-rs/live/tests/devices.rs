//! Drivers and emulated devices, over the same wires as real devices.
#![cfg(unix)]

mod emulator;

use std::io::{BufRead, BufReader};
use std::time::{Duration, Instant};

use emulator::{Emulator, RATE, gesture, options};
use ergon_live::device::{self, Device, DeviceError, DeviceSample, DeviceUrl};
use ergon_live::emulate::{EmulatedHand, EmulationOptions, Protocol, ServeEvent, Transport};
use ergon_live::safety::{GuardedDevice, SafetyLimits};

/// Time after which a test gives up.
const PATIENCE: Duration = Duration::from_secs(60);

fn going(periods: usize, metres: f64) -> EmulatedHand {
    EmulatedHand::OnPath {
        path: gesture(periods, metres),
        stiffness: 400.0,
        damping: 4.0,
    }
}

/// Limits with which only the clamp acts.
fn open_limits(device: &dyn Device) -> SafetyLimits {
    SafetyLimits {
        slew_rate_max: f64::INFINITY,
        ramp_time: 0.0,
        fade_time: 0.0,
        velocity_max: f64::INFINITY,
        work_max: f64::INFINITY,
        ..SafetyLimits::from_spec(device.spec())
    }
}

/// A key that is farther than this was pushed [m].
const MOVED: f64 = 2e-3;
/// Hosts that are killed until one leaves a force.
const TRIES: usize = 20;

fn guard(device: Box<dyn Device>) -> GuardedDevice {
    let limits = open_limits(&device);
    GuardedDevice::new(device, limits, 1.0 / RATE)
}

/// All wires in lockstep: kind, protocol, transport, options, and whether numbers are sent in full precision.
const WIRES: [(&str, Protocol, Transport, &str, bool); 6] = [
    ("firefader", Protocol::FireFader, Transport::Terminal, "lockstep", false),
    ("frame", Protocol::Frame, Transport::Terminal, "lockstep", false),
    ("frame", Protocol::Frame, Transport::Terminal, "lockstep&wide", true),
    ("frame+udp", Protocol::Frame, Transport::Udp(0), "lockstep", false),
    ("frame+udp", Protocol::Frame, Transport::Udp(0), "lockstep&wide", true),
    ("haply", Protocol::Haply, Transport::WebSocket(0), "lockstep", true),
];

/// A spring of the host on an emulated key that a hand moves; returns every position and the emulator's hash.
///
/// Before each exchange the host yields to other threads `yields` times.
fn session(wire: usize, yields: usize) -> (Vec<f64>, u64) {
    let (kind, protocol, transport, how, _) = WIRES[wire];
    let axes = if protocol == Protocol::Haply { 3 } else { 2 };
    let emulator = Emulator::start(options(protocol, transport, axes, vec![going(300, 6e-3)]));
    let mut device = guard(emulator.open(kind, how));
    let (mut sample, mut path) = (DeviceSample::default(), Vec::new());
    let past = Instant::now();
    assert!(device.receive(&mut sample, past).unwrap(), "X(0) comes first");
    for _ in 0..400 {
        (0..yields).for_each(|_| std::thread::yield_now());
        let force = -60.0 * sample.position[0];
        device.send(&[force]).unwrap();
        assert!(device.receive(&mut sample, past).unwrap());
        path.push(sample.position[0]);
    }
    let stats = device_stats(&device);
    assert_eq!((stats.requests_lost, stats.garbage_bytes), (0, 0), "{kind}");
    assert!(stats.round_trip.total() >= 400);
    drop(device);
    (path, emulator.end().hash)
}

fn device_stats(device: &GuardedDevice) -> device::WireStats {
    device.device().stats()
}

#[test]
fn lockstep_session_is_independent_of_pace() {
    for (wire, (kind, ..)) in WIRES.iter().enumerate() {
        let (path, _) = session(wire, 0);
        let peak = path.iter().fold(0.0, |peak: f64, x| peak.max(*x));
        assert!(peak > 3e-3 && peak < 6.5e-3, "{kind}: {peak}");
        let (paced, _) = session(wire, 30);
        assert!(path == paced, "{kind}");
    }
}

#[test]
fn integers_are_equal_on_every_wire() {
    let complete: Vec<_> = (0..WIRES.len()).filter(|&wire| WIRES[wire].4).collect();
    let paths: Vec<_> = complete.iter().map(|&wire| session(wire, 0).0).collect();
    let in_process = {
        use ergon_live::device::EmulatedDevice;
        use ergon_live::emulate::{EmulatedKeys, KeyConstants};
        let keys = EmulatedKeys::new(2, KeyConstants::default(), RATE, vec![going(300, 6e-3)]).unwrap();
        let mut device = EmulatedDevice::new(keys, KeyConstants::default());
        let limits = open_limits(&device);
        let mut device = GuardedDevice::new(&mut device, limits, 1.0 / RATE);
        let (mut sample, mut path) = (DeviceSample::default(), Vec::new());
        device.receive(&mut sample, Instant::now()).unwrap();
        for _ in 0..400 {
            device.send(&[-60.0 * sample.position[0]]).unwrap();
            device.receive(&mut sample, Instant::now()).unwrap();
            path.push(sample.position[0]);
        }
        path
    };
    for (wire, path) in complete.into_iter().zip(paths) {
        assert!(path == in_process, "{:?}", WIRES[wire]);
    }
}

#[test]
fn position_hash_is_independent_of_pace() {
    for wire in [0, 3] {
        let (_, fast) = session(wire, 0);
        let (_, slow) = session(wire, 20);
        assert_eq!(fast, slow, "{:?}", WIRES[wire]);
    }
}

/// The greatest deflections of A and B: a hand moves A by 10 mm, and a REF couples A and B through their devices.
fn duet(kind: &str, protocol: Protocol, transport: Transport, how: &str, k: f64) -> [f64; 2] {
    let hands = [going(800, 10e-3), EmulatedHand::Resting];
    let emulators = hands.map(|hand| Emulator::start(options(protocol, transport, 2, vec![hand; 2])));
    let mut devices = [0, 1].map(|i| guard(emulators[i].open(kind, how)));
    let mut samples = [DeviceSample::default(); 2];
    let past = Instant::now();
    let mut peaks = [0.0_f64; 2];
    let mut before = 0.0;
    for _ in 0..800 {
        for (device, sample) in devices.iter_mut().zip(&mut samples) {
            device.receive(sample, past).unwrap();
        }
        let [a, b] = samples.map(|sample| sample.position[0]);
        (peaks[0], peaks[1]) = (peaks[0].max(a.abs()), peaks[1].max(b.abs()));
        let e = b - a;
        let force = k * e + if k > 0.0 { 0.1 * RATE * (e - before) } else { 0.0 };
        before = e;
        devices[0].send(&[force]).unwrap();
        devices[1].send(&[-force]).unwrap();
    }
    drop(devices);
    for emulator in emulators {
        emulator.end();
    }
    peaks
}

#[test]
fn hands_feel_each_other_through_a_coupling() {
    let udp = Transport::Udp(0);
    let free = duet("frame+udp", Protocol::Frame, udp, "lockstep&wide", 0.0);
    assert_eq!(free[1], 0.0, "nothing ties them");
    let tied = duet("frame+udp", Protocol::Frame, udp, "lockstep&wide", 120.0);
    assert!(tied[1] >= 0.8 * tied[0] && tied[0] > 5e-3, "{tied:?}");
    let again = duet("frame+udp", Protocol::Frame, udp, "lockstep&wide", 120.0);
    assert_eq!(tied, again, "to the last bit");
    // One byte per quantity, on a serial line.
    let terminal = Transport::Terminal;
    let bytes = duet("firefader", Protocol::FireFader, terminal, "lockstep", 120.0);
    assert!(bytes[1] >= 0.75 * bytes[0] && bytes[0] > 4e-3, "{bytes:?}");
}

#[test]
fn dead_device_receives_zero_force() {
    let mut options = options(Protocol::Frame, Transport::Udp(0), 1, vec![EmulatedHand::Resting]);
    options.board.lockstep = false;
    let emulator = Emulator::start(options);
    let mut device = guard(emulator.open("frame+udp", ""));
    let mut sample = DeviceSample::default();
    let mut tick = |device: &mut GuardedDevice| {
        let deadline = Instant::now() + Duration::from_millis(1);
        let fresh = device.receive(&mut sample, deadline).unwrap();
        (fresh, device.send(&[1.0]).unwrap().newtons()[0])
    };
    tick(&mut device);
    // This is reached as soon as the machine lets both sides run for a while.
    let mut alive = (0..60_000).map(|_| tick(&mut device));
    assert!(alive.any(|(fresh, force)| fresh && force == 1.0));
    emulator.end();
    let dead: Vec<_> = (0..100).map(|_| tick(&mut device)).collect();
    assert!(dead[40..].iter().all(|(fresh, force)| !fresh && *force == 0.0));
    assert!(device.counts().stale >= 60, "{:?}", device.counts());
}

/// The first reply after a silence reports it, and a later one no longer does.
#[test]
fn let_go_is_reported_once() {
    let mut options = options(Protocol::Frame, Transport::Udp(0), 1, vec![EmulatedHand::Resting]);
    options.board.lockstep = false;
    let emulator = Emulator::start(options);
    let mut device = guard(emulator.open("frame+udp", ""));
    let mut sample = DeviceSample::default();
    let mut exchange = |device: &mut GuardedDevice| {
        device.send(&[1.0]).unwrap();
        assert!(device.receive(&mut sample, Instant::now() + PATIENCE).unwrap());
        sample.has_let_go
    };
    device.receive(&mut DeviceSample::default(), Instant::now()).unwrap();
    exchange(&mut device);
    while emulator.events.recv_timeout(PATIENCE).unwrap() != ServeEvent::LetGo {}
    assert!(exchange(&mut device));
    // On a busy machine the board may let go again.
    assert!((0..100).any(|_| !exchange(&mut device)));
    assert!(device.counts().let_go > 0);
    drop(device);
    emulator.end();
}

#[test]
fn dead_serial_device_is_gone() {
    let emulator = Emulator::start(options(Protocol::FireFader, Transport::Terminal, 2, vec![]));
    let mut device = guard(emulator.open("firefader", "lockstep"));
    emulator.end();
    let mut sample = DeviceSample::default();
    let mut gone = false;
    for _ in 0..3 {
        gone |= device.send(&[0.0]).is_err();
        gone |= device.receive(&mut sample, Instant::now()).is_err();
    }
    assert!(gone);
}

/// Greatest number of exchanges until an awaited event: a busy machine is slow, not wrong.
const EXCHANGES_MAX: usize = 600_000;

#[test]
fn frame_without_lockstep_reports_time_and_velocity() {
    let mut options = options(Protocol::Frame, Transport::Udp(0), 1, vec![going(2000, 6e-3)]);
    options.board.lockstep = false;
    let emulator = Emulator::start(options);
    let mut device = guard(emulator.open("frame+udp", ""));
    let mut sample = DeviceSample::default();
    let mut peak: f64 = 0.0;
    let mut exchange = |device: &mut GuardedDevice| {
        device.send(&[0.0]).unwrap();
        let deadline = Instant::now() + Duration::from_millis(1);
        device.receive(&mut sample, deadline).unwrap();
        peak = peak.max(sample.position[0]);
        let stats = device_stats(device);
        stats.replies_received > 1000 && stats.drift_ppm.is_some() && peak > 3e-3
    };
    assert!((0..EXCHANGES_MAX).any(|_| exchange(&mut device)));
    let stats = device_stats(&device);
    assert_eq!(stats.garbage_bytes, 0);
    // Both clocks are those of this machine.
    assert!(stats.drift_ppm.unwrap().abs() < 1e5, "{stats:?}");
    drop(device);
    let outcome = emulator.end();
    assert!(outcome.packets > 1000, "{outcome:?}");
}

#[test]
fn service_with_a_silent_host_receives_zero() {
    let mut options = options(
        Protocol::Haply,
        Transport::WebSocket(0),
        3,
        vec![EmulatedHand::Resting; 3],
    );
    options.board.lockstep = false;
    options.board.watchdog = Duration::from_secs(60);
    options.key.stiffness = 100.0;
    let emulator = Emulator::start(options);
    let mut device = guard(emulator.open("haply", ""));
    let mut sample = DeviceSample::default();
    let mut push = |force: Option<f64>| {
        let deadline = Instant::now() + Duration::from_millis(5);
        device.receive(&mut sample, deadline).unwrap();
        if let Some(force) = force {
            device.send(&[force]).unwrap();
        }
        sample
    };
    let mut until = |force: Option<f64>, holds: &dyn Fn(DeviceSample) -> bool| {
        assert!((0..EXCHANGES_MAX).any(|_| holds(push(force))), "{force:?}");
    };
    // 1 N on 100 N/m is 10 mm.
    until(Some(1.0), &|sample| (sample.position[0] - 0.01).abs() < 1e-3);
    // The host falls silent, and its guardian sends zero to the service.
    until(None, &|sample| sample.has_let_go);
    until(Some(0.0), &|sample| sample.position[0].abs() < 1e-4);
    drop(device);
    emulator.end();
}

#[test]
fn open_of_missing_devices_names_them() {
    let fails = |text: &str| device::open(&DeviceUrl::parse(text).unwrap()).err().unwrap();
    let error = fails("firefader:/dev/no-such-port");
    assert!(matches!(error, DeviceError::NotOpened { .. }), "{error}");
    let error = fails("haply:127.0.0.1:1");
    assert!(error.to_string().contains("ws://"), "{error}");
    let error = fails("frame+udp://224.0.0.1:9999");
    assert!(matches!(error, DeviceError::Unsupported { .. }), "{error}");
    let error = fails("emul:?axes=2#2");
    assert!(error.to_string().contains("axis"), "{error}");
    let error = fails("emul:?mass=0");
    assert!(error.to_string().contains("mass"), "{error}");
    // A board of another kind answers in other bytes.
    let emulator = Emulator::start(options(Protocol::FireFader, Transport::Terminal, 2, vec![]));
    let error = fails(&format!("frame:{}", emulator.address));
    assert!(matches!(error, DeviceError::NoAnswer { .. }), "{error}");
    emulator.end();
}

#[test]
fn lockstep_with_a_real_time_board_is_refused() {
    let mut options = options(Protocol::Frame, Transport::Udp(0), 1, vec![]);
    options.board.lockstep = false;
    let emulator = Emulator::start(options);
    let url = format!("frame+udp:{}?lockstep", emulator.address);
    let error = device::open(&DeviceUrl::parse(&url).unwrap()).err().unwrap();
    assert!(error.to_string().contains("lockstep"), "{error}");
    emulator.end();
}

/// Printed by a host when its push of 1 N has moved the key.
const PUSHES: &str = "it pushes";

/// A separate host process, which the tests below end; it pushes with 1 N as long as it runs.
#[test]
#[ignore = "a part of other tests"]
fn host_process() {
    let url = DeviceUrl::parse(&std::env::var("ERGON_TEST_DEVICE").unwrap()).unwrap();
    let mut device = guard(device::open(&url).unwrap());
    let mut sample = DeviceSample::default();
    let mut push = |device: &mut GuardedDevice| {
        let deadline = Instant::now() + Duration::from_millis(1);
        let fresh = device.receive(&mut sample, deadline).unwrap_or(false);
        let _ = device.send(&[1.0]);
        fresh.then_some(sample.position[0])
    };
    // 1 N on 100 N/m gives 10 mm. A part of that is enough: on a busy machine the host withdraws its force now and
    // then, and the key never comes to rest.
    while push(&mut device).is_none_or(|x| x < MOVED) {}
    eprintln!("{PUSHES}");
    match std::env::var("ERGON_TEST_END").as_deref() {
        Ok("panic") => panic!("as asked"),
        // SAFETY: none: the test needs a fault, and nothing is mapped at address 8.
        Ok("fault") => unsafe { std::ptr::without_provenance_mut::<u8>(8).write_volatile(1) },
        _ => {}
    }
    for _ in 0..EXCHANGES_MAX {
        push(&mut device);
    }
}

/// How a host process ends.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    Signal(i32),
    /// A panic or a fault of its own.
    Itself(&'static str),
}

/// An emulated key with a spring, pushed by a host that then ends.
fn ended(kind: &str, mut options: EmulationOptions, end: End) -> Emulator {
    options.board.lockstep = false;
    options.key.stiffness = 100.0;
    let emulator = Emulator::start(options);
    let mut host = std::process::Command::new(std::env::current_exe().unwrap());
    host.args(["--exact", "host_process", "--ignored", "--nocapture"])
        .env("ERGON_TEST_DEVICE", format!("{kind}:{}", emulator.address))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped());
    if let End::Itself(how) = end {
        host.env("ERGON_TEST_END", how);
    }
    let mut host = host.spawn().unwrap();
    let mut output = BufReader::new(host.stderr.take().unwrap()).lines();
    assert!(output.any(|line| line.unwrap() == PUSHES));
    if let End::Signal(signal) = end {
        // SAFETY: the child has not been waited for, so the number is still its own.
        unsafe { libc::kill(host.id().cast_signed(), signal) };
    }
    host.wait().unwrap();
    emulator
}

#[test]
fn killed_host_leaves_no_force() {
    let frame = options(Protocol::Frame, Transport::Udp(0), 1, vec![EmulatedHand::Resting]);
    let fader = options(
        Protocol::FireFader,
        Transport::Terminal,
        2,
        vec![EmulatedHand::Resting; 2],
    );
    for (kind, options) in [("frame+udp", frame), ("firefader", fader)] {
        let emulator = ended(kind, options, End::Signal(libc::SIGKILL));
        let output = std::iter::from_fn(|| emulator.events.recv_timeout(PATIENCE).ok());
        assert!(output.into_iter().any(|event| event == ServeEvent::LetGo), "{kind}");
        emulator.end();
    }
}

/// The position of the key after the host has ended, read by a host without force; the board's own watchdog is off.
fn left_at(end: End) -> f64 {
    let mut options = options(Protocol::Frame, Transport::Udp(0), 1, vec![EmulatedHand::Resting]);
    options.board.watchdog = Duration::from_secs(60);
    let emulator = ended("frame+udp", options, end);
    // By the emulator's clock, which is the wall clock: a released key is at rest, and a new host is accepted.
    std::thread::sleep(Duration::from_millis(1100));
    let mut device = emulator.open("frame+udp", "");
    let mut sample = DeviceSample::default();
    device.receive(&mut sample, Instant::now()).unwrap();
    emulator.end();
    sample.position[0]
}

/// As `left_at`. SIGKILL may come while a busy host has withdrawn its force: then again, until it leaves one.
fn left_by(end: End) -> f64 {
    let tries = if end == End::Signal(libc::SIGKILL) { TRIES } else { 1 };
    let mut positions = (0..tries).map(|_| left_at(end)).peekable();
    let first = *positions.peek().unwrap();
    positions.find(|x| !is_back(*x)).unwrap_or(first)
}

/// Whether a key is where no force leaves it. A late reply may show it on its way back; long after that it is at rest.
fn is_back(x: f64) -> bool {
    x.abs() < 1e-4
}

#[test]
fn ended_host_releases_the_hand() {
    // 1 N on 100 N/m gives 10 mm. Nothing can be sent after SIGKILL, which shows that the other ends do send zero.
    let signals = [
        libc::SIGKILL,
        libc::SIGTERM,
        libc::SIGINT,
        libc::SIGABRT,
        libc::SIGUSR1,
        libc::SIGUSR2,
        libc::SIGALRM,
        libc::SIGVTALRM,
        libc::SIGPROF,
        libc::SIGXCPU,
        libc::SIGXFSZ,
        libc::SIGSYS,
        libc::SIGTRAP,
    ]
    .map(End::Signal);
    let ends: Vec<End> = signals
        .into_iter()
        .chain([End::Itself("panic"), End::Itself("fault")])
        .collect();
    // Two hosts at a time: more of them would hold each other up.
    let positions = ends.chunks(2).flat_map(|pair| {
        std::thread::scope(|scope| {
            let hosts: Vec<_> = pair
                .iter()
                .map(|&end| (end, scope.spawn(move || left_by(end))))
                .collect();
            hosts
                .into_iter()
                .map(|(end, host)| (end, host.join().unwrap()))
                .collect::<Vec<_>>()
        })
    });
    for (end, x) in positions {
        assert_eq!(is_back(x), end != End::Signal(libc::SIGKILL), "{end:?}: {x}");
    }
}
