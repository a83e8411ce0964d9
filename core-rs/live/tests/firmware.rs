//! The sketch that is shipped (docs/firmware), compiled for this computer and driven like a board.
#![cfg(target_os = "linux")]

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use ergon_live::device::calibrate::{DirectionError, TestPulse, find_directions};
use ergon_live::device::{self, DeviceSample, DeviceUrl};
use ergon_live::safety::{GuardedDevice, SafetyLimits};

/// Number of tries: the host follows the wall clock and withdraws forces if the machine holds it up.
const TRIES: usize = 10_000;

/// The running sketch; its time is simulated (tests/firmware/Arduino.h).
struct Board {
    process: Child,
    output: BufReader<ChildStdout>,
}

impl Board {
    /// Let time pass without a packet [ms].
    fn pass(&mut self, ms: usize) {
        let mut answers = vec![0; ms];
        let input = self.process.stdin.as_mut().unwrap();
        input.write_all(&answers).unwrap();
        self.output.read_exact(&mut answers).unwrap();
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The sketch and the path of its serial port; `None` without a C++ compiler.
fn board() -> Option<(Board, String)> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("open_frame");
    let compiled = Command::new("c++")
        .args(["-Wall", "-Wextra", "-Werror", "-O1", "-x", "c++"])
        .arg("-I")
        .arg(here.join("tests/firmware"))
        .arg(here.join("../../docs/firmware/open_frame/open_frame.ino"))
        .arg("-o")
        .arg(&program)
        .args(["-lutil"])
        .status();
    let Ok(compiled) = compiled else {
        eprintln!("no C++ compiler: the sketch is not tried");
        return None;
    };
    assert!(compiled.success(), "the sketch compiles");
    let mut process = Command::new(program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut path = String::new();
    let mut output = BufReader::new(process.stdout.take().unwrap());
    output.read_line(&mut path).unwrap();
    Some((Board { process, output }, path.trim().to_owned()))
}

#[test]
fn firmware_sketch_acts_as_a_device() {
    let Some((mut board, path)) = board() else {
        return;
    };
    let url = DeviceUrl::parse(&format!("frame:{path}")).unwrap();
    let mut device = device::open(&url).unwrap();
    let spec = device.spec().clone();
    assert_eq!((spec.dof, spec.can_send_wide, spec.can_lockstep), (1, false, false));
    assert!((spec.force_max_peak - 1.5).abs() < 1e-6 && (spec.pos_range[1] - 0.05).abs() < 1e-6);
    let go = AtomicBool::new(false);
    let mut tries = (0..TRIES).map(|_| {
        let signs = find_directions(&mut device, &[0], TestPulse::from_spec(&spec), 1e-3, &go);
        signs.expect("the board answers")[0]
    });
    // A pulse that was held up moves the key too little, or to one side only.
    let result = tries.find(|result| !matches!(result, Err(DirectionError::NoMotion | DirectionError::SameDirection)));
    assert_eq!(result, Some(Ok(1.0)));
    let limits = SafetyLimits {
        ramp_time: 0.0,
        ..SafetyLimits::from_spec(&spec)
    };
    let mut device = GuardedDevice::new(device, limits, 1e-3);
    let mut sample = DeviceSample::default();
    // The force that was sent, and the reply to it. A host that was held up sends a zero after it, and the replies may
    // come one by one: a reply to an earlier packet is not the answer.
    let mut exchange = |force: f64| {
        let sent = device.send(&[force]).unwrap().newtons()[0];
        let mut let_go = false;
        loop {
            let deadline = Instant::now() + Duration::from_secs(60);
            assert!(device.receive(&mut sample, deadline).unwrap());
            let_go |= sample.has_let_go;
            if sample.requests_behind == 0 {
                return (
                    sent,
                    DeviceSample {
                        has_let_go: let_go,
                        ..sample
                    },
                );
            }
        }
    };
    let start = exchange(0.0).1.position[0];
    let mut there = (0..TRIES).map(|_| exchange(0.3).1.position[0]);
    assert!(there.any(|x| x > start + 5e-3), "it goes where it is pushed");
    let mut enabled = (0..TRIES).map(|_| exchange(0.0).1.is_force_enabled[0]);
    assert!(enabled.any(|enabled| enabled));
    // After a push and 50 ms of silence it pushes no more.
    let mut pushed = (0..TRIES).map(|_| exchange(-0.3));
    let (_, there) = pushed.find(|(sent, _)| *sent == -0.3).unwrap();
    board.pass(300);
    let (_, left) = exchange(0.0);
    assert!(left.has_let_go);
    board.pass(200);
    let (_, later) = exchange(0.0);
    let [there, left, later] = [there, left, later].map(|sample| sample.position[0]);
    let method = there - left;
    assert!((0.005..0.0053).contains(&method), "{method}: 0.1 m/s for 51 ms");
    assert_eq!(later, left);
    let stats = device.device().stats();
    assert!(stats.garbage_bytes == 0 && stats.replies_received > 200, "{stats:?}");
}
