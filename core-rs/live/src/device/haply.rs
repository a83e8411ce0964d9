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
    Device, DeviceError, DeviceLoss, DeviceSample, DeviceSpec, DeviceUrl, FIRST_REPLY_TIMEOUT, LOCKSTEP_TIMEOUT,
    MAX_AXES, Unit, WaitCanceller, WireStats, ZeroForcePacket,
};
use crate::safety::SafeForce;
use crate::safety::contract::SentRequests;
use guardian::{HostRequest, OpenReply};
pub(crate) use line::ForceCommand;
use line::{GuardianLine, GuardianReply, read_text, write_text};
pub(crate) use rules::{GuardianAction, GuardianRules};

/// Longest time for a guardian to start, on a busy machine.
const GUARDIAN_START_TIMEOUT: Duration = Duration::from_secs(10);

pub(super) struct HaplyDevice {
    spec: DeviceSpec,
    lockstep: bool,
    canceller: WaitCanceller,
    // Declared before the guardian, so that it is closed before the wait for the guardian's end.
    line: GuardianLine,
    _guardian: start::GuardianProcess,
    sent_requests: SentRequests,
    /// Numbers of the latest order and of the latest order that was answered.
    last_order_number: u16,
    last_answered_number: u16,
    position: [f64; 3],
    let_go: bool,
    loss: Option<DeviceLoss>,
    /// Whether the first position has not yet been returned by `receive`.
    has_unread_position: bool,
    stats: WireStats,
}

/// Data of an Inverse3, as a community driver lists them; its mass and friction must be measured (metrology).
pub(crate) fn spec() -> DeviceSpec {
    DeviceSpec {
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
        is_touch_gated: false,
        can_lockstep: true,
        can_send_wide: false,
    }
}

impl HaplyDevice {
    pub(super) fn open(url: &DeviceUrl, canceller: &WaitCanceller) -> Result<Self, DeviceError> {
        if url.wide {
            return Err(url.unsupported_error("the option wide is only for the open frame"));
        }
        if !url.target.starts_with("ws://") {
            return Err(url.unsupported_error("its address must have the form ws://127.0.0.1:10001"));
        }
        let open_error = |error: std::io::Error| url.open_error(error);
        let (mut guardian_stream, guardian) = start::start().map_err(open_error)?;
        let request = HostRequest {
            target: &url.target,
            id: url.option_text("id"),
            lockstep: url.lockstep,
        };
        let reply = write_text(&mut guardian_stream, &request.text())
            .and_then(|()| read_text(&mut guardian_stream, GUARDIAN_START_TIMEOUT + 2 * FIRST_REPLY_TIMEOUT))
            .map_err(|error| url.open_error(format!("its guardian process did not start ({error})")))?;
        let position = match OpenReply::parse(&reply) {
            Some(OpenReply::Opened(position)) => position,
            Some(OpenReply::Refused(reason)) => return Err(url.open_error(reason)),
            Some(OpenReply::NotInLockstep) => {
                return Err(
                    url.unsupported_error("a real device runs by its own clock; lockstep is only for emulators")
                );
            }
            Some(OpenReply::NoAnswer) | None => return Err(url.no_answer_error("Haply device")),
        };
        Ok(Self {
            spec: spec(),
            lockstep: url.lockstep,
            canceller: canceller.clone(),
            line: GuardianLine::new(guardian_stream).map_err(open_error)?,
            _guardian: guardian,
            sent_requests: SentRequests::default(),
            last_order_number: u16::MAX,
            last_answered_number: u16::MAX,
            position,
            let_go: false,
            loss: None,
            has_unread_position: true,
            stats: WireStats::default(),
        })
    }

    fn send_order(&mut self, force: [f64; 3]) -> Result<(), DeviceLoss> {
        self.last_order_number = self.sent_requests.number_request(Instant::now(), &mut self.stats);
        let force_order = ForceCommand {
            number: self.last_order_number,
            force,
        };
        match self.loss {
            Some(loss) => Err(loss),
            None => self.line.send(&force_order.bytes()),
        }
    }

    /// Read all replies that are there, or wait for the first one until the deadline.
    fn read_replies(&mut self, deadline: Instant) -> Result<bool, DeviceLoss> {
        loop {
            let Self {
                line,
                sent_requests,
                last_answered_number,
                position: last_position,
                let_go: has_let_go,
                loss,
                stats,
                ..
            } = self;
            let (read_instant, mut is_fresh) = (Instant::now(), false);
            let receive_result = line.receive(|bytes| match GuardianReply::parse(bytes) {
                GuardianReply::State {
                    number,
                    position,
                    let_go,
                } => {
                    sent_requests.note_reply(number, read_instant, stats);
                    (*last_answered_number, *last_position, *has_let_go, is_fresh) = (number, position, let_go, true);
                }
                GuardianReply::Gone(reason) => *loss = Some(reason),
            });
            if let Err(line_loss) = receive_result {
                *loss = loss.or(Some(line_loss));
            }
            if is_fresh {
                return Ok(true);
            }
            if let Some(loss) = self.loss {
                return Err(loss);
            }
            if read_instant >= deadline {
                return Ok(false);
            }
            self.line.wait(deadline);
        }
    }
}

impl Device for HaplyDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let axis_force = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        self.send_order([axis_force(0), axis_force(1), axis_force(2)])
    }

    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        if self.lockstep && !self.has_unread_position {
            let lockstep_deadline = Instant::now() + LOCKSTEP_TIMEOUT;
            sample.is_fresh = self.last_answered_number != self.last_order_number;
            while self.last_answered_number != self.last_order_number {
                if !self.read_replies(next_check(lockstep_deadline))? && !self.canceller.may_wait(lockstep_deadline) {
                    return Err(DeviceLoss::Silent);
                }
            }
        } else {
            sample.is_fresh = self.has_unread_position || self.read_replies(deadline)?;
        }
        self.has_unread_position = false;
        sample.position[..3].copy_from_slice(&self.position);
        sample.is_touched = [true; MAX_AXES];
        sample.is_force_enabled = [!self.let_go; MAX_AXES];
        (sample.is_hot, sample.has_let_go) = (false, self.let_go); // the service does not report whether it is hot
        sample.seq = u32::from(self.last_answered_number);
        sample.requests_behind = self.last_order_number.wrapping_sub(self.last_answered_number);
        Ok(sample.is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.lockstep
    }

    fn zero(&mut self) {
        let _ = self.send_order([0.0; 3]);
    }

    fn stats(&self) -> WireStats {
        self.stats
    }

    #[cfg(unix)]
    fn zero_force_packet(&self) -> Option<ZeroForcePacket> {
        use std::os::fd::AsRawFd;
        // A number that no order has soon, so that a late reply to it is not taken for the reply to an order.
        let zero_order = ForceCommand {
            number: self.last_order_number.wrapping_add(u16::MAX / 2),
            ..ForceCommand::default()
        };
        let socket_fd = self.line.stream().as_raw_fd();
        Some(ZeroForcePacket::new(socket_fd, &zero_order.bytes()))
    }
}
