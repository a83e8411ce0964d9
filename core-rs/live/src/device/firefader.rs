//! FireFader on a serial port: two motor faders.

use std::time::Instant;

use super::port::Port;
use super::wait_canceller::next_check;
use super::{
    Device, DeviceError, DeviceLoss, DeviceSample, DeviceSpec, DeviceUrl, FIRST_REPLY_TIMEOUT, LOCKSTEP_TIMEOUT,
    MAX_AXES, REQUEST_RETRY_INTERVAL, Unit, WaitCanceller, WireStats, ZeroForcePacket,
};
use crate::safety::SafeForce;
use crate::wire::{PacketBuffer, firefader as wire};

/// Only boards with an FTDI chip use the baud rate.
const BAUD_RATE: u32 = 57_600;

pub(super) struct FireFader {
    port: Port,
    spec: DeviceSpec,
    lockstep: bool,
    canceller: WaitCanceller,
    inbox: PacketBuffer<64>,
    last_reply: Option<wire::FaderReply>,
    /// Number of replies still to come, and when the latest request was sent.
    n_outstanding: u32,
    sent_at: Instant,
    seq: u32,
    stats: WireStats,
    /// Whether the first position has not yet been returned by `receive`.
    has_new_position: bool,
}

/// The published data of the board; its mass and friction must be measured (metrology).
fn spec() -> DeviceSpec {
    DeviceSpec {
        dof: 2,
        unit: Unit::Metre,
        pos_lsb: wire::POSITION_STEP,
        pos_range: [-128.0 * wire::POSITION_STEP, 126.0 * wire::POSITION_STEP],
        // No figure for continuous force is published; at two thirds of the peak the coil produces less than half the
        // heat.
        force_max_continuous: wire::FORCE_MAX * 2.0 / 3.0,
        force_max_peak: wire::FORCE_MAX,
        force_lsb: wire::FORCE_LSB,
        // From 500 Hz to 1.2 kHz, depending on the board: measured, not assumed.
        rate_nominal: None,
        loop_delay_s: Some(3.5e-3),
        inertia: None,
        damping: None,
        is_touch_gated: true,
        can_lockstep: true,
        can_send_wide: false,
    }
}

impl FireFader {
    pub(super) fn open(url: &DeviceUrl, canceller: &WaitCanceller) -> Result<Self, DeviceError> {
        if url.wide {
            return Err(url.unsupported_error("the option wide is only for the open frame"));
        }
        let baud_rate = url.option_number("baud", f64::from(BAUD_RATE))? as u32;
        Self::on_port(Port::serial(url, baud_rate)?, url, canceller)
    }

    /// The driver on an open port.
    pub(super) fn on_port(port: Port, url: &DeviceUrl, canceller: &WaitCanceller) -> Result<Self, DeviceError> {
        let mut fader = Self {
            port,
            spec: spec(),
            lockstep: url.lockstep,
            canceller: canceller.clone(),
            inbox: PacketBuffer::empty(),
            last_reply: None,
            n_outstanding: 0,
            sent_at: Instant::now(),
            seq: 0,
            stats: WireStats::default(),
            has_new_position: true,
        };
        fader.connect().map_err(|loss| url.open_error(loss))?;
        if fader.last_reply.is_none() {
            return Err(url.no_answer_error("FireFader"));
        }
        Ok(fader)
    }

    /// Send requests until the board answers, because opening the port restarts some boards; then read all outstanding
    /// replies.
    fn connect(&mut self) -> Result<(), DeviceLoss> {
        let deadline = Instant::now() + FIRST_REPLY_TIMEOUT;
        // In lockstep every packet advances the device by one period, so it is sent only once, even if the reply is
        // late.
        let retry_after = if self.lockstep {
            FIRST_REPLY_TIMEOUT
        } else {
            REQUEST_RETRY_INTERVAL
        };
        while self.last_reply.is_none() && self.canceller.may_wait(deadline) {
            self.write_request([0.0; 2])?;
            self.read_replies(Instant::now() + retry_after)?;
        }
        let quiet_deadline = Instant::now() + REQUEST_RETRY_INTERVAL;
        while self.n_outstanding > 0 && Instant::now() < quiet_deadline {
            self.read_replies(quiet_deadline)?;
        }
        self.n_outstanding = 0;
        Ok(())
    }

    fn write_request(&mut self, force: [f64; 2]) -> Result<(), DeviceLoss> {
        self.port.write(&wire::request(force))?;
        self.n_outstanding = self.n_outstanding.saturating_add(1);
        self.sent_at = Instant::now();
        self.stats.packets_sent += 1;
        Ok(())
    }

    /// Read all replies that are there, or wait for the first one until the deadline.
    fn read_replies(&mut self, deadline: Instant) -> Result<bool, DeviceLoss> {
        let (mut read_bytes, mut is_fresh) = ([0; 64], false);
        loop {
            let read_deadline = if is_fresh { self.sent_at } else { deadline };
            let byte_count = self.port.read(&mut read_bytes, read_deadline)?;
            if byte_count == 0 {
                return Ok(is_fresh);
            }
            let (mut reply_count, last_reply) = (0_u32, &mut self.last_reply);
            self.inbox
                .add_bytes(&read_bytes[..byte_count], wire::parse_reply, |reply| {
                    (*last_reply, reply_count) = (Some(reply), reply_count + 1);
                });
            self.seq = self.seq.wrapping_add(reply_count);
            self.stats.garbage_bytes = self.inbox.garbage_bytes;
            self.stats.replies_received += u64::from(reply_count);
            self.n_outstanding = self.n_outstanding.saturating_sub(reply_count);
            is_fresh |= reply_count > 0;
            if reply_count > 0 && self.n_outstanding == 0 {
                self.stats.add_round_trip(self.sent_at.elapsed());
                return Ok(true);
            }
        }
    }
}

impl Device for FireFader {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let axis_force = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        if self.n_outstanding > 1 {
            // The firmware answers only the newest of the requests that it finds.
            self.stats.requests_lost += u64::from(self.n_outstanding - 1);
            self.n_outstanding = 1;
        }
        self.write_request([axis_force(0), axis_force(1)])
    }

    fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
        let axis_force = |axis: usize| force.newtons().get(axis).copied().unwrap_or(0.0);
        let mut wire_force = [0.0; MAX_AXES];
        wire_force[..2].copy_from_slice(&wire::rounded_forces([axis_force(0), axis_force(1)]));
        wire_force
    }

    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        sample.is_fresh = if self.lockstep && self.n_outstanding > 0 {
            let deadline_in_lockstep = Instant::now() + LOCKSTEP_TIMEOUT;
            while self.n_outstanding > 0 {
                if !self.read_replies(next_check(deadline_in_lockstep))?
                    && !self.canceller.may_wait(deadline_in_lockstep)
                {
                    return Err(DeviceLoss::Silent);
                }
            }
            true
        } else if self.has_new_position {
            true
        } else {
            self.read_replies(deadline)?
        };
        self.has_new_position = false;
        if let Some(reply) = self.last_reply {
            for axis in 0..2 {
                sample.position[axis] = reply.metres(axis);
                sample.is_touched[axis] = reply.capacitance[axis] > wire::CAP_TOUCHED;
                // The firmware's own gate is not reported; a finger on the key, within the range, opens it.
                let is_in_range = (5..251).contains(&reply.position[axis]);
                sample.is_force_enabled[axis] = sample.is_touched[axis] && is_in_range;
            }
        }
        (sample.is_hot, sample.has_let_go) = (false, false); // the board does not report these
        sample.seq = self.seq;
        Ok(sample.is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.lockstep
    }

    fn zero(&mut self) {
        let _ = self.write_request([0.0; 2]);
    }

    fn stats(&self) -> WireStats {
        self.stats
    }

    fn zero_force_packet(&self) -> Option<ZeroForcePacket> {
        Some(ZeroForcePacket::new(
            self.port.raw_descriptor(),
            &wire::request([0.0; 2]),
        ))
    }
}
