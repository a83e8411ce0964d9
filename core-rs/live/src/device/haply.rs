//! Haply's Inverse Service: one device of three axes behind a WebSocket.
//!
//! The service has no documented watchdog, so a force would persist if its host fell silent, was stopped or was killed.
//! The connection is therefore held by a guardian, a separate process that sets the force to zero in these cases. The
//! host sends orders to the guardian and gets the positions back, in messages of fixed length.

pub mod guardian;
mod line;
mod rules;
mod service;
mod start;

use std::time::{Duration, Instant};

use super::wait_canceller::next_check;
use super::{
    Device, DeviceError, FIRST_REPLY, Gone, LOCKSTEP_PATIENCE, LastResort, MAX_AXES, Sample, Spec, Stats, Unit, Url,
    WaitCanceller,
};
use crate::safety::SafeForce;
use crate::safety::contract::SentRequests;
use guardian::{HostRequest, Reply};
pub(crate) use line::ForceCommand;
use line::{GuardianReply, Line, put_text, take_text};
pub(crate) use rules::{Action, Rules};

/// Longest time for a guardian to start, on a busy machine.
const START_TIMEOUT: Duration = Duration::from_secs(10);

pub(super) struct Haply {
    spec: Spec,
    lockstep: bool,
    canceller: WaitCanceller,
    // Declared before the guardian, so that it is closed before the wait for the guardian's end.
    line: Line,
    _guardian: start::Started,
    sent: SentRequests,
    /// Numbers of the latest order and of the latest order that was answered.
    last_order: u16,
    last_answered: u16,
    position: [f64; 3],
    let_go: bool,
    gone: Option<Gone>,
    /// Whether the first position has not yet been returned by `receive`.
    has_unread_position: bool,
    stats: Stats,
}

/// Data of an Inverse3, as a community driver lists them; its mass and friction must be measured (metrology).
pub(crate) fn spec() -> Spec {
    Spec {
        dof: 3,
        unit: Unit::Metre,
        pos_lsb: 1e-5,
        pos_range: [-0.15, 0.15],
        force_max_continuous: 5.0,
        force_max_peak: 10.0,
        force_lsb: 1e-3,
        rate_nominal: None,
        loop_delay_s: None,
        inertia: None,
        damping: None,
        touch_gated: false,
        can_lockstep: true,
        can_wide: false,
    }
}

impl Haply {
    pub(super) fn open(url: &Url, canceller: &WaitCanceller) -> Result<Self, DeviceError> {
        if url.wide {
            return Err(url.cannot("the option wide is only for the open frame"));
        }
        if !url.target.starts_with("ws://") {
            return Err(url.cannot("its address must have the form ws://127.0.0.1:10001"));
        }
        let closed_error = |error: std::io::Error| url.closed(error);
        let (mut guardian_stream, guardian) = start::start().map_err(closed_error)?;
        let request = HostRequest {
            target: &url.target,
            id: url.text("id"),
            lockstep: url.lockstep,
        };
        let reply = put_text(&mut guardian_stream, &request.text())
            .and_then(|()| take_text(&mut guardian_stream, START_TIMEOUT + 2 * FIRST_REPLY))
            .map_err(|error| url.closed(format!("its guardian process did not start ({error})")))?;
        let position = match Reply::parse(&reply) {
            Some(Reply::Open(position)) => position,
            Some(Reply::OpenError(why)) => return Err(url.closed(why)),
            Some(Reply::OwnClock) => {
                return Err(url.cannot("a real device runs by its own clock; lockstep is only for emulators"));
            }
            Some(Reply::NoAnswer) | None => return Err(url.no_answer("Haply device")),
        };
        Ok(Self {
            spec: spec(),
            lockstep: url.lockstep,
            canceller: canceller.clone(),
            line: Line::new(guardian_stream).map_err(closed_error)?,
            _guardian: guardian,
            sent: SentRequests::default(),
            last_order: u16::MAX,
            last_answered: u16::MAX,
            position,
            let_go: false,
            gone: None,
            has_unread_position: true,
            stats: Stats::default(),
        })
    }

    fn send_order(&mut self, force: [f64; 3]) -> Result<(), Gone> {
        self.last_order = self.sent.number_request(Instant::now(), &mut self.stats);
        let force_order = ForceCommand {
            number: self.last_order,
            force,
        };
        match self.gone {
            Some(gone) => Err(gone),
            None => self.line.put(&force_order.bytes()),
        }
    }

    /// Read all replies that are there, or wait for the first one until the deadline.
    fn read_replies(&mut self, deadline: Instant) -> Result<bool, Gone> {
        loop {
            let Self {
                line,
                sent,
                last_answered,
                position: last_position,
                let_go: is_let_go,
                gone,
                stats,
                ..
            } = self;
            let (read_instant, mut is_fresh) = (Instant::now(), false);
            let take_result = line.take(|bytes| match GuardianReply::parse(bytes) {
                GuardianReply::State {
                    number,
                    position,
                    let_go,
                } => {
                    sent.note_reply(number, read_instant, stats);
                    (*last_answered, *last_position, *is_let_go, is_fresh) = (number, position, let_go, true);
                }
                GuardianReply::Gone(why) => *gone = Some(why),
            });
            if let Err(line_failure) = take_result {
                *gone = gone.or(Some(line_failure));
            }
            if is_fresh {
                return Ok(true);
            }
            if let Some(gone) = self.gone {
                return Err(gone);
            }
            if read_instant >= deadline {
                return Ok(false);
            }
            self.line.wait(deadline);
        }
    }
}

impl Device for Haply {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
        let axis_force = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        self.send_order([axis_force(0), axis_force(1), axis_force(2)])
    }

    fn receive(&mut self, sample: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
        if self.lockstep && !self.has_unread_position {
            let lockstep_deadline = Instant::now() + LOCKSTEP_PATIENCE;
            sample.fresh = self.last_answered != self.last_order;
            while self.last_answered != self.last_order {
                if !self.read_replies(next_check(lockstep_deadline))? && !self.canceller.may_wait(lockstep_deadline) {
                    return Err(Gone::Silent);
                }
            }
        } else {
            sample.fresh = self.has_unread_position || self.read_replies(deadline)?;
        }
        self.has_unread_position = false;
        sample.position[..3].copy_from_slice(&self.position);
        sample.touch = [true; MAX_AXES];
        sample.force_enabled = [!self.let_go; MAX_AXES];
        (sample.hot, sample.let_go) = (false, self.let_go); // the service does not report whether it is hot
        sample.seq = u32::from(self.last_answered);
        sample.behind = self.last_order.wrapping_sub(self.last_answered);
        Ok(sample.fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.lockstep
    }

    fn zero(&mut self) {
        let _ = self.send_order([0.0; 3]);
    }

    fn stats(&self) -> Stats {
        self.stats
    }

    #[cfg(unix)]
    fn last_resort(&self) -> Option<LastResort> {
        use std::os::fd::AsRawFd;
        // A number that no order has soon, so that a late reply to it is not taken for the reply to an order.
        let zero_order = ForceCommand {
            number: self.last_order.wrapping_add(u16::MAX / 2),
            ..ForceCommand::default()
        };
        let socket_fd = self.line.stream().as_raw_fd();
        Some(LastResort::new(socket_fd, &zero_order.bytes()))
    }
}
