//! A Haply whose service or host falls silent, stops or dies: zero forces arrive at the service.
#![cfg(unix)]

#[allow(dead_code)] // used by other tests
mod emulator;
mod service;

use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ergon_live::device::{self, DeviceLoss, DeviceSample, DeviceUrl};
use ergon_live::safety::{GuardedDevice, SafetyLimits};
use service::{PATIENCE, Reply, Service, ServiceEvent};

/// A host that never withdraws a force by itself: zeros at the service come from the guardian.
fn open(url: &str) -> GuardedDevice {
    emulator::can_guard();
    let device = device::open(&DeviceUrl::parse(url).unwrap()).unwrap();
    let limits = SafetyLimits {
        slew_rate_max: f64::INFINITY,
        ramp_time: 0.0,
        fade_time: 0.0,
        velocity_max: f64::INFINITY,
        work_max: f64::INFINITY,
        position_age_max: f64::INFINITY,
        ..SafetyLimits::from_spec(device.spec())
    };
    GuardedDevice::new(device, limits, 1e-3)
}

/// A tick of a host that pushes with 1 N; returns whether a new position came.
fn push(device: &mut GuardedDevice) -> Result<bool, DeviceLoss> {
    let mut sample = DeviceSample::default();
    let fresh = device.receive(&mut sample, Instant::now() + Duration::from_millis(1))?;
    device.send(&[1.0])?;
    Ok(fresh)
}

/// A service that stops replying until it receives zero. The guardian sends zero, although the host pushes on and the
/// connection holds.
fn let_go_by(reply: Reply) {
    let service = Service::start();
    let mut device = open(&service.url);
    std::thread::scope(|scope| {
        let host = scope.spawn(move || {
            let start = Instant::now();
            let mut fresh = 0;
            while fresh < 100 && start.elapsed() < PATIENCE {
                fresh += u32::from(push(&mut device).expect("the line holds"));
            }
            (device, fresh)
        });
        service.until_pushed();
        service.reply(reply);
        service.until_zero();
        service.until_pushed();
        let (device, fresh) = host.join().unwrap();
        assert_eq!(fresh, 100, "it answers again");
        drop(device);
    });
}

#[test]
fn open_zeroes_the_force_of_a_former_host() {
    let service = Service::start();
    let device = open(&service.url);
    service.until_zero();
    drop(device);
}

#[test]
fn silent_service_receives_zero_without_a_reply() {
    let_go_by(Reply::SilentUntilZero);
}

#[test]
fn service_without_a_state_receives_zero() {
    let_go_by(Reply::EmptyUntilZero);
}

#[test]
fn service_without_replies_is_gone() {
    let service = Service::start();
    let mut device = open(&service.url);
    let start = Instant::now();
    push(&mut device).unwrap();
    service.until_pushed();
    service.reply(Reply::Never);
    let gone = loop {
        if let Err(gone) = push(&mut device) {
            break gone;
        }
        assert!(start.elapsed() < PATIENCE, "it is never gone");
    };
    assert_eq!(gone, DeviceLoss::Silent);
    service.until_zero();
}

#[test]
fn service_closing_its_connection_receives_zero_on_another() {
    let service = Service::start();
    let mut device = open(&service.url);
    let start = Instant::now();
    push(&mut device).unwrap();
    service.until_pushed();
    service.reply(Reply::HangUp);
    while push(&mut device).is_ok() {
        assert!(start.elapsed() < PATIENCE, "it is never gone");
    }
    // The device is kept alive, so these events do not come from its end.
    service.until(|told| told == ServiceEvent::Left);
    service.until(|told| told == ServiceEvent::Came);
    service.until_zero();
    drop(device);
}

/// A separate host process, which the tests below end; it pushes with 1 N as long as it runs.
#[test]
#[ignore = "a part of other tests"]
fn host_process() {
    let mut device = open(&std::env::var("ERGON_TEST_DEVICE").unwrap());
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        let _ = push(&mut device);
    }
}

/// A host process that is killed if a test ends early.
struct Host(Child);

impl Host {
    fn signal(&self, number: i32) {
        signal(self.0.id().cast_signed(), number);
    }

    fn kill(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A service, and a host in a process group of its own that pushes it.
fn hosted() -> (Service, Host) {
    let service = Service::start();
    let host = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "host_process", "--ignored", "--nocapture"])
        .env("ERGON_TEST_DEVICE", &service.url)
        .stdout(Stdio::null())
        .process_group(0)
        .spawn()
        .map(Host)
        .unwrap();
    service.until_pushed();
    (service, host)
}

fn signal(pid: i32, signal: i32) {
    // SAFETY: no pointers are passed; the processes are this test's own, and live.
    assert_eq!(unsafe { libc::kill(pid, signal) }, 0);
}

#[test]
fn killed_host_leaves_no_force() {
    let (service, mut host) = hosted();
    host.kill();
    service.until_zero();
    service.until(|told| told == ServiceEvent::Left);
}

#[test]
fn stopped_host_leaves_no_force() {
    let (service, mut host) = hosted();
    host.signal(libc::SIGSTOP);
    service.until_zero();
    // The host continues: its forces pass again.
    host.signal(libc::SIGCONT);
    service.until_pushed();
    host.kill();
    service.until_zero();
}

#[test]
fn killed_process_group_leaves_no_force() {
    let (service, host) = hosted();
    signal(-host.0.id().cast_signed(), libc::SIGKILL);
    service.until_zero();
}

/// The child processes of a process.
#[cfg(target_os = "linux")]
fn children(source: u32) -> Vec<i32> {
    let tasks = std::fs::read_dir(format!("/proc/{source}/task")).unwrap();
    let from_task = |task: std::fs::DirEntry| {
        let result = std::fs::read_to_string(task.path().join("children"));
        let result = result.unwrap_or_default();
        let numbers = result.split_whitespace().map(|pid| pid.parse().unwrap());
        numbers.collect::<Vec<i32>>()
    };
    tasks.flat_map(|task| from_task(task.unwrap())).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn guardian_survives_signals_and_ends_with_its_host() {
    let (service, mut host) = hosted();
    let [guardian] = children(host.0.id())[..] else {
        panic!("one guardian");
    };
    let files = format!("/proc/{guardian}/fd");
    // The three standard files, the host and the service.
    let open = std::fs::read_dir(&files).unwrap().count();
    assert!(open <= 5, "{open}");
    for number in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP, libc::SIGQUIT] {
        signal(guardian, number);
    }
    host.kill();
    service.until_zero();
    let start = Instant::now();
    while std::fs::read_dir(&files).is_ok_and(|files| files.count() > 0) {
        assert!(start.elapsed() < PATIENCE, "it never ends");
        std::thread::yield_now();
    }
}

#[test]
fn lockstep_with_a_real_time_service_is_refused() {
    let service = Service::start();
    emulator::can_guard();
    let url = DeviceUrl::parse(&format!("{}?lockstep", service.url)).unwrap();
    let error = device::open(&url).err().unwrap();
    assert!(error.to_string().contains("lockstep"), "{error}");
}

#[test]
fn open_of_a_missing_service_names_it() {
    emulator::can_guard();
    let url = DeviceUrl::parse("haply:ws://127.0.0.1:1").unwrap();
    let error = device::open(&url).err().unwrap().to_string();
    assert!(error.contains("127.0.0.1:1") && error.contains("refused"), "{error}");
}
