//! The guardian: a separate process that holds the connection to the service. It sets the force to zero if the host
//! falls silent, is stopped, or is gone.

use std::io;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::line::{ForceCommand, GuardianLine, GuardianReply, read_text, wait, write_text};
use super::rules::{GuardianAction, GuardianRules};
use super::service::{OpenError, Service};
use super::start;
pub use super::start::{GuardianProgram, register_program};
use crate::device::{DeviceLoss, FIRST_REPLY_TIMEOUT, LOCKSTEP_TIMEOUT};
use crate::realtime;

/// Number of zeros that are sent at the end, unless a state answers one of them.
const ZERO_REPEATS: usize = 3;
const ZERO_REPLY_TIMEOUT: Duration = Duration::from_millis(20);

/// The host's first message: which device to open.
pub(super) struct HostRequest<'a> {
    pub(super) target: &'a str,
    pub(super) id: Option<&'a str>,
    pub(super) lockstep: bool,
}

impl HostRequest<'_> {
    pub(super) fn text(&self) -> String {
        json!({"target": self.target, "id": self.id, "lockstep": self.lockstep}).to_string()
    }
}

/// The guardian's answer to it.
pub(super) enum OpenReply {
    /// The device is open; its position [m].
    Opened([f64; 3]),
    Refused(String),
    NoAnswer,
    /// Lockstep was asked for, but the device runs by its own clock.
    NotInLockstep,
}

impl OpenReply {
    fn text(&self) -> String {
        match self {
            Self::Opened(position) => json!({"open": position}),
            Self::Refused(reason) => json!({"refused": reason}),
            Self::NoAnswer => json!({"no_answer": true}),
            Self::NotInLockstep => json!({"own_time": true}),
        }
        .to_string()
    }

    pub(super) fn parse(text: &str) -> Option<Self> {
        let reply_object: Value = serde_json::from_str(text).ok()?;
        if let Some(position) = reply_object.get("open").and_then(Value::as_array) {
            let numbers: Option<Vec<f64>> = position.iter().map(Value::as_f64).collect();
            return numbers?.try_into().ok().map(Self::Opened);
        }
        if let Some(refusal) = reply_object.get("refused").and_then(Value::as_str) {
            return Some(Self::Refused(refusal.to_owned()));
        }
        if reply_object.get("own_time").is_some() {
            return Some(Self::NotInLockstep);
        }
        reply_object.get("no_answer").map(|_| Self::NoAnswer)
    }
}

/// Run as the guardian of one Haply until its host is gone. For a program that does nothing else: signals that end or
/// stop a program are ignored, and on Linux all files but the three standard ones are closed.
///
/// # Errors
/// If the standard input is not a host.
pub fn serve() -> io::Result<()> {
    isolate_process();
    let mut host_stream = start::inherited_stream()?;
    let request = read_text(&mut host_stream, FIRST_REPLY_TIMEOUT)?;
    let request: Value = serde_json::from_str(&request)?;
    let service_url = request["target"].as_str().unwrap_or_default();
    let lockstep = request["lockstep"] == true;
    let open_result = Service::open(service_url, request["id"].as_str());
    let (first_reply, mut service) = match open_result {
        Ok((service, first_state)) if lockstep && !first_state.in_lockstep => (OpenReply::NotInLockstep, Some(service)),
        Ok((service, first)) => (OpenReply::Opened(first.position), Some(service)),
        Err(OpenError::Refused(reason)) => (OpenReply::Refused(reason), None),
        Err(OpenError::NoAnswer) => (OpenReply::NoAnswer, None),
    };
    write_text(&mut host_stream, &first_reply.text())?;
    if let (OpenReply::Opened(_), Some(service)) = (&first_reply, &mut service) {
        // Above the physics thread, so that a hanging physics thread cannot block its guardian.
        realtime::request(realtime::PHYSICS_PRIORITY + 1);
        let mut host_line = GuardianLine::new(host_stream)?;
        guard_until_closed(&mut host_line, service, lockstep);
    }
    if let Some(service) = service {
        service.close();
    }
    Ok(())
}

/// Pass orders on and states back until either side is gone; at the end the force is zero.
fn guard_until_closed(line: &mut GuardianLine, service: &mut Service, lockstep: bool) {
    let mut rules = GuardianRules::new(lockstep, Instant::now());
    if !lockstep {
        // A force that a former host left may still act. If this fails, the service is gone, which `pass_messages`
        // detects.
        let _ = service.command([0.0; 3]);
    }
    let Err(loss) = pass_messages(line, service, &mut rules) else {
        return send_final_zero(service, lockstep);
    };
    if loss == DeviceLoss::Silent {
        send_final_zero(service, lockstep);
    } else if rules.may_push() {
        service.reconnect_and_send_zero();
    }
    let _ = line.send(&GuardianReply::Gone(loss).bytes());
}

/// Pass orders and states; fails when the service is gone, and returns when the host is gone.
fn pass_messages(line: &mut GuardianLine, service: &mut Service, rules: &mut GuardianRules) -> Result<(), DeviceLoss> {
    loop {
        // Messages that have arrived are read before a silence is judged, and all with the time from before the reads.
        let pass_instant = Instant::now();
        let host_result = line.receive(|bytes| rules.take_order(ForceCommand::parse(bytes), pass_instant));
        let has_more = service.read(|state| {
            let (number, let_go) = rules.take_state(pass_instant);
            let state_reply = GuardianReply::State {
                number,
                position: state.position,
                let_go,
            };
            // Errors are ignored here; a host that is gone is detected when orders are read.
            let _ = line.send(&state_reply.bytes());
        })?;
        loop {
            match rules.next_action(pass_instant) {
                GuardianAction::Nothing => break,
                GuardianAction::Send(force) => service.command(force)?,
                GuardianAction::Gone => return Err(DeviceLoss::Silent),
            }
        }
        if host_result.is_err() {
            return Ok(());
        }
        if !has_more {
            wait([line.stream(), service.stream()], rules.next_deadline(pass_instant));
        }
    }
}

/// Send zero until a state answers; in lockstep a command is a period, so one is enough.
fn send_final_zero(service: &mut Service, lockstep: bool) {
    let (attempts, timeout) = if lockstep {
        (1, LOCKSTEP_TIMEOUT)
    } else {
        (ZERO_REPEATS, ZERO_REPLY_TIMEOUT)
    };
    for _ in 0..attempts {
        if service.command([0.0; 3]).is_err() {
            return service.reconnect_and_send_zero();
        }
        let (deadline, mut is_answered) = (Instant::now() + timeout, false);
        while !is_answered && Instant::now() < deadline {
            service.wait(deadline);
            if service.read(|_| is_answered = true).is_err() {
                return service.reconnect_and_send_zero();
            }
        }
        if is_answered {
            return;
        }
    }
}

/// Close the files that were inherited from the host, and ignore the signals of the host's terminal.
#[cfg(unix)]
fn isolate_process() {
    const IGNORED_SIGNALS: [i32; 8] = [
        libc::SIGINT,
        libc::SIGTERM,
        libc::SIGHUP,
        libc::SIGQUIT,
        libc::SIGPIPE,
        libc::SIGTSTP,
        libc::SIGTTIN,
        libc::SIGTTOU,
    ];
    for signal in IGNORED_SIGNALS {
        // SAFETY: no handler is installed.
        unsafe { libc::signal(signal, libc::SIG_IGN) };
    }
    #[cfg(target_os = "linux")]
    // SAFETY: no pointers are passed. Nobody uses these: the caller's program does nothing else.
    unsafe {
        libc::syscall(libc::SYS_close_range, 3, u32::MAX, 0);
    }
}

#[cfg(not(unix))]
fn isolate_process() {}
