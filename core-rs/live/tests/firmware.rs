//! The sketch that ships (docs/firmware), compiled for this computer and driven like a board.
#![cfg(target_os = "linux")]

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use ergon_live::device::calibrate::{Pulse, Unsure, direction};
use ergon_live::device::{self, Sample, Url};
use ergon_live::safety::{Guarded, Limits};

struct Board(Child);

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The sketch at work and the path of its serial port; none without a C++ compiler.
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
    let mut board = Command::new(program)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut path = String::new();
    BufReader::new(board.stdout.take().unwrap())
        .read_line(&mut path)
        .unwrap();
    Some((Board(board), path.trim().to_owned()))
}

#[test]
fn the_sketch_is_a_device() {
    let Some((_board, path)) = board() else {
        return;
    };
    let url = Url::parse(&format!("frame:{path}")).unwrap();
    let mut device = device::open(&url).unwrap();
    let spec = device.spec().clone();
    assert_eq!(
        (spec.dof, spec.can_wide, spec.can_lockstep),
        (1, false, false)
    );
    assert!((spec.force_max_peak - 1.5).abs() < 1e-6 && (spec.pos_range[1] - 0.05).abs() < 1e-6);
    // By the wall: where the machine is held up the board has let go meanwhile, and is asked again.
    let mut found = Err(Unsure::Still);
    for _ in 0..5 {
        if found == Err(Unsure::Still) {
            let go = AtomicBool::new(false);
            found = direction(&mut device, 0, Pulse::of(&spec), 1e-3, &go);
        }
    }
    assert_eq!(found, Ok(1.0));
    let limits = Limits {
        ramp: 0.0,
        ..Limits::of(&spec)
    };
    let mut device = Guarded::new(device, limits, 1e-3);
    let mut sample = Sample::default();
    let mut exchange = |device: &mut Guarded, force: f64| {
        device.send(&[force]).unwrap();
        device
            .receive(&mut sample, Instant::now() + Duration::from_millis(5))
            .unwrap();
        sample
    };
    let start = exchange(&mut device, 0.0).position[0];
    for _ in 0..200 {
        exchange(&mut device, 0.3);
        std::thread::sleep(Duration::from_micros(500));
    }
    exchange(&mut device, 0.0);
    let there = exchange(&mut device, 0.0).position[0];
    assert!(there > start + 5e-3, "{start} {there}");
    assert!(exchange(&mut device, 0.0).force_enabled[0]);
    // Pushed, and then left alone: after 50 ms it pushes no more.
    exchange(&mut device, -0.3);
    std::thread::sleep(Duration::from_millis(300));
    let left = exchange(&mut device, 0.0).position[0];
    std::thread::sleep(Duration::from_millis(200));
    let later = exchange(&mut device, 0.0).position[0];
    assert!(
        left < there && left > there - 0.02,
        "{there} {left}: 0.1 m/s for 50 ms"
    );
    assert!((later - left).abs() < 1e-3, "{left} {later}");
    let stats = device.device().stats();
    assert!(stats.garbage == 0 && stats.received > 200, "{stats:?}");
}
