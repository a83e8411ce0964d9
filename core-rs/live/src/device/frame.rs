//! The open frame (docs/open-frame.md) on a serial port or by UDP.

use std::time::{Duration, Instant};

use super::port::Port;
use super::wait_canceller::next_check;
use super::{
    Device, DeviceError, DeviceKind, DeviceLoss, DeviceSample, DeviceSpec, DeviceUrl, FIRST_REPLY_TIMEOUT,
    LOCKSTEP_TIMEOUT, MAX_AXES, REQUEST_RETRY_INTERVAL, Unit, WaitCanceller, WireStats, ZeroForcePacket,
};
use crate::safety::SafeForce;
use crate::safety::contract::{ClockDrift, SentRequests};
use crate::wire::PacketBuffer;
use crate::wire::frame::{self as wire, flag, status, trait_flag};

/// Longest wait for a reply in lockstep [s].
const LOCKSTEP_TIMEOUT_MAX: f64 = 3600.0;
/// Boards on USB ignore the baud rate.
const BAUD_RATE: u32 = 1_000_000;

pub(super) struct OpenFrameDevice {
    port: Port,
    spec: DeviceSpec,
    lockstep: bool,
    /// Longest wait for a reply in lockstep.
    lockstep_timeout: Duration,
    canceller: WaitCanceller,
    wide: bool,
    inbox: PacketBuffer<512>,
    sent_requests: SentRequests,
    last_reply: Option<wire::FrameReply>,
    /// Number of the latest request.
    last_request: u16,
    drift: ClockDrift,
    stats: WireStats,
    /// Whether any reply since the last `receive`, not only the newest, said that the board let go.
    has_let_go: bool,
    /// Whether the first position has not yet been returned by `receive`.
    has_new_position: bool,
}

/// Greatest travel that a key can have [m] or [rad]: more means another unit, or nonsense.
const TRAVEL_MAX: f64 = 10.0;

/// The numbers that a device reports about itself: name, unit, and whether zero (unknown) is allowed.
const REPORTED_NUMBERS: [(&str, &str, AllowedRange); 8] = [
    ("continuous force", "N", AllowedRange::ZeroOrMore),
    ("greatest force", "N", AllowedRange::AboveZero),
    ("step of the position", "m", AllowedRange::ZeroOrMore),
    ("least position", "m", AllowedRange::Finite),
    ("greatest position", "m", AllowedRange::Finite),
    ("rate", "Hz", AllowedRange::ZeroOrMore),
    ("mass", "kg", AllowedRange::ZeroOrMore),
    ("friction", "N·s/m", AllowedRange::ZeroOrMore),
];

/// The values that a number may have.
#[derive(Clone, Copy, PartialEq, Eq)]
enum AllowedRange {
    Finite,
    ZeroOrMore,
    AboveZero,
}

/// The specification that a device reports.
///
/// # Errors
/// A sentence that names the first number that is impossible.
fn spec(info: &wire::DeviceInfo) -> Result<DeviceSpec, String> {
    let numbers = info.spec_values.map(f64::from);
    for (&number, (name, unit, allowed_range)) in numbers.iter().zip(REPORTED_NUMBERS) {
        let rule = match allowed_range {
            _ if !number.is_finite() => "it has to be a finite number",
            AllowedRange::AboveZero if number <= 0.0 => "it has to be above zero",
            AllowedRange::ZeroOrMore if number < 0.0 => "it has to be above zero, or zero if it is not known",
            _ => continue,
        };
        return Err(format!(
            "the device reports a {name} of {number} {unit}; {rule} (its firmware sends this number)"
        ));
    }
    let [
        continuous_force,
        peak_force,
        pos_lsb,
        lower_limit,
        upper_limit,
        nominal_rate,
        inertia,
        damping,
    ] = numbers;
    if lower_limit >= upper_limit || upper_limit - lower_limit > TRAVEL_MAX {
        return Err(format!(
            "the device reports positions from {lower_limit} to {upper_limit} m; the least has to be below the greatest, by at most \
             {TRAVEL_MAX} m (its firmware sends these numbers)"
        ));
    }
    let known_value = |number: f64| (number > 0.0).then_some(number);
    Ok(DeviceSpec {
        dof: info.axis_count,
        unit: if info.trait_flags & trait_flag::RADIANS == 0 {
            Unit::Metre
        } else {
            Unit::Radian
        },
        pos_lsb: known_value(pos_lsb).unwrap_or(wire::POSITION_STEP),
        pos_range: [lower_limit, upper_limit],
        force_max_continuous: known_value(continuous_force).unwrap_or(peak_force).min(peak_force),
        force_max_peak: peak_force,
        force_lsb: peak_force / wire::FORCE_STEPS,
        rate_nominal: known_value(nominal_rate),
        loop_delay_s: None,
        inertia: known_value(inertia),
        damping: known_value(damping),
        is_touch_gated: info.trait_flags & trait_flag::TOUCH_GATED != 0,
        can_lockstep: info.trait_flags & trait_flag::LOCKSTEP != 0,
        can_send_wide: info.trait_flags & trait_flag::WIDE != 0,
    })
}

impl OpenFrameDevice {
    pub(super) fn open(url: &DeviceUrl, canceller: &WaitCanceller) -> Result<Self, DeviceError> {
        let device_port = match url.kind {
            DeviceKind::FrameUdp => Port::udp(url)?,
            _ => Port::serial(url, url.option_number("baud", f64::from(BAUD_RATE))? as u32)?,
        };
        Self::on_port(device_port, url, canceller)
    }

    /// The driver on an open port.
    pub(super) fn on_port(mut port: Port, url: &DeviceUrl, canceller: &WaitCanceller) -> Result<Self, DeviceError> {
        let device_info =
            request_info(&mut port, first_reply_timeout(url)?, canceller).map_err(|loss| url.open_error(loss))?;
        let device_info = device_info.ok_or_else(|| url.no_answer_error("device of the open frame"))?;
        let spec = spec(&device_info).map_err(|reason| url.impossible_error(reason))?;
        if url.lockstep && !spec.can_lockstep {
            return Err(url.unsupported_error("a real device runs by its own clock; lockstep is only for emulators"));
        }
        if url.wide && !spec.can_send_wide {
            return Err(url.unsupported_error("the device sends integers only and does not support the option wide"));
        }
        let lockstep_timeout = lockstep_timeout(url)?;
        let mut device = Self {
            port,
            spec,
            lockstep: url.lockstep,
            lockstep_timeout,
            canceller: canceller.clone(),
            wide: url.wide,
            inbox: PacketBuffer::empty(),
            sent_requests: SentRequests::default(),
            last_reply: None,
            last_request: 0,
            drift: ClockDrift::default(),
            stats: WireStats::default(),
            has_let_go: false,
            has_new_position: true,
        };
        // Read the position before the first force is sent: X(0).
        let deadline = Instant::now() + first_reply_timeout(url)?;
        while device.last_reply.is_none() && canceller.may_wait(deadline) {
            device
                .write_request([0.0; MAX_AXES], flag::REQUEST)
                .and_then(|()| device.read_replies(Instant::now() + REQUEST_RETRY_INTERVAL))
                .map_err(|loss| url.open_error(loss))?;
        }
        match device.last_reply {
            Some(_) => Ok(device),
            None => Err(url.no_answer_error("device of the open frame")),
        }
    }

    fn write_request(&mut self, force: [f64; MAX_AXES], flags: u8) -> Result<(), DeviceLoss> {
        let send_instant = Instant::now();
        self.last_request = self.sent_requests.number_request(send_instant, &mut self.stats);
        let (packet_bytes, packet_length) = self.packet(self.last_request, force, flags);
        self.port.write(&packet_bytes[..packet_length])
    }

    fn packet(&self, seq: u16, force: [f64; MAX_AXES], flags: u8) -> ([u8; wire::FRAME_BYTES_MAX], usize) {
        let request = wire::FrameRequest {
            seq,
            axis_count: self.spec.dof,
            is_wide: self.wide,
            flags,
            force,
        };
        let mut packet_bytes = [0; wire::FRAME_BYTES_MAX];
        let packet_length = request.write(self.spec.force_max_peak, &mut packet_bytes);
        (packet_bytes, packet_length)
    }

    /// Read all replies that are there, or wait for the first one until the deadline. Replies out of order are skipped:
    /// a datagram may overtake another.
    fn read_replies(&mut self, deadline: Instant) -> Result<bool, DeviceLoss> {
        let (mut read_bytes, mut is_fresh) = ([0; 512], false);
        loop {
            if self.port.was_refused() && self.lockstep {
                return Err(DeviceLoss::Silent); // in lockstep a refused datagram means that the device is gone
            }
            let read_deadline = if is_fresh { Instant::now() } else { deadline };
            let byte_count = self.port.read(&mut read_bytes, read_deadline)?;
            let read_instant = Instant::now();
            if byte_count == 0 {
                if is_fresh || read_instant >= deadline {
                    return Ok(is_fresh);
                }
                continue;
            }
            let Self {
                inbox,
                sent_requests,
                last_reply: last,
                drift,
                stats,
                spec,
                has_let_go: let_go,
                ..
            } = self;
            inbox.add_bytes(&read_bytes[..byte_count], wire::FrameReply::parse, |reply| {
                let is_newer = |last_reply: &wire::FrameReply| reply.seq.wrapping_sub(last_reply.seq) < 0x8000;
                if reply.axis_count == spec.dof
                    && sent_requests.note_reply(reply.seq, read_instant, stats)
                    && last.as_ref().is_none_or(is_newer)
                {
                    stats.drift_ppm = drift.add(read_instant, reply.clock_us).or(stats.drift_ppm);
                    *let_go |= reply.status & status::LET_GO != 0;
                    (*last, is_fresh) = (Some(reply), true);
                }
            });
            stats.garbage_bytes = inbox.garbage_bytes;
            if self.sent_requests.is_shared() {
                return Err(DeviceLoss::Shared);
            }
            if is_fresh && last.as_ref().is_some_and(|last| last.seq == self.last_request) {
                return Ok(true);
            }
        }
    }
}

/// Longest wait for a reply in lockstep.
fn lockstep_timeout(url: &DeviceUrl) -> Result<Duration, DeviceError> {
    let timeout = url.option_number("patience", LOCKSTEP_TIMEOUT.as_secs_f64())?;
    Ok(Duration::from_secs_f64(timeout.clamp(0.0, LOCKSTEP_TIMEOUT_MAX)))
}

/// Longest wait for the first reply.
fn first_reply_timeout(url: &DeviceUrl) -> Result<Duration, DeviceError> {
    let reply_limit = if url.lockstep {
        lockstep_timeout(url)?
    } else {
        Duration::ZERO
    };
    Ok(reply_limit.max(FIRST_REPLY_TIMEOUT))
}

/// Ask for the device's information until it answers; `None` if it does not.
fn request_info(
    port: &mut Port,
    timeout: Duration,
    canceller: &WaitCanceller,
) -> Result<Option<wire::DeviceInfo>, DeviceLoss> {
    let deadline = Instant::now() + timeout;
    let mut inbox = PacketBuffer::<512>::empty();
    let (mut read_bytes, mut packet_bytes, mut device_info) = ([0; 512], [0; wire::FRAME_BYTES_MAX], None);
    let mut seq = 0;
    while device_info.is_none() && canceller.may_wait(deadline) {
        let request = wire::FrameRequest {
            seq,
            ..wire::FrameRequest::default()
        };
        let packet_length = request.write(1.0, &mut packet_bytes);
        port.write(&packet_bytes[..packet_length])?;
        seq = seq.wrapping_add(1);
        let retry_instant = Instant::now() + REQUEST_RETRY_INTERVAL;
        while device_info.is_none() && Instant::now() < retry_instant {
            let byte_count = port.read(&mut read_bytes, retry_instant)?;
            inbox.add_bytes(&read_bytes[..byte_count], wire::DeviceInfo::parse, |parsed_info| {
                device_info = Some(parsed_info)
            });
        }
    }
    Ok(device_info)
}

impl Device for OpenFrameDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        let mut forces = [0.0; MAX_AXES];
        forces[..force.newtons().len()].copy_from_slice(force.newtons());
        self.write_request(forces, flag::ENABLE)
    }

    fn switch_off(&mut self) -> Result<(), DeviceLoss> {
        self.write_request([0.0; MAX_AXES], 0)
    }

    fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
        let mut wire_forces = [0.0; MAX_AXES];
        for (wire_force, &force) in wire_forces.iter_mut().zip(force.newtons()) {
            *wire_force = if self.wide {
                force
            } else {
                wire::rounded_force(force, self.spec.force_max_peak)
            };
        }
        wire_forces
    }

    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        let is_latest = |last: &Option<wire::FrameReply>, seq| last.as_ref().is_some_and(|last| last.seq == seq);
        if self.lockstep {
            let deadline = Instant::now() + self.lockstep_timeout;
            sample.is_fresh = self.has_new_position || !is_latest(&self.last_reply, self.last_request);
            while !is_latest(&self.last_reply, self.last_request) {
                if !self.read_replies(next_check(deadline))? && !self.canceller.may_wait(deadline) {
                    return Err(DeviceLoss::Silent);
                }
            }
        } else {
            sample.is_fresh = self.has_new_position || self.read_replies(deadline)?;
        }
        self.has_new_position = false;
        sample.has_let_go = std::mem::take(&mut self.has_let_go);
        if let Some(reply) = &self.last_reply {
            sample.position = reply.position;
            sample.is_touched = [reply.status & status::TOUCHED != 0; MAX_AXES];
            sample.is_force_enabled = [reply.status & status::ENABLED != 0; MAX_AXES];
            sample.is_hot = reply.status & status::HOT != 0;
            sample.seq = u32::from(reply.seq);
            sample.requests_behind = self.last_request.wrapping_sub(reply.seq);
            sample.t_dev_us = Some(reply.clock_us);
        }
        Ok(sample.is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.lockstep
    }

    fn zero(&mut self) {
        let _ = self.write_request([0.0; MAX_AXES], 0);
    }

    fn stats(&self) -> WireStats {
        self.stats
    }

    fn zero_force_packet(&self) -> Option<ZeroForcePacket> {
        // Not wide, because that is shorter; a device accepts both.
        let request = wire::FrameRequest {
            axis_count: self.spec.dof,
            ..wire::FrameRequest::default()
        };
        let mut packet_bytes = [0; wire::FRAME_BYTES_MAX];
        let packet_length = request.write(1.0, &mut packet_bytes);
        Some(ZeroForcePacket::new(
            self.port.raw_descriptor(),
            &packet_bytes[..packet_length],
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: [f32; 8] = [10.0, 20.0, 1e-5, -0.05, 0.05, 8000.0, 0.05, 1.0];

    fn described(change: impl Fn(&mut [f32; 8])) -> Result<DeviceSpec, String> {
        let mut numbers = SOUND;
        change(&mut numbers);
        spec(&wire::DeviceInfo {
            seq: 0,
            axis_count: 1,
            trait_flags: 0,
            spec_values: numbers,
        })
    }

    #[test]
    fn impossible_descriptions_are_refused_by_name() {
        for number in 0..8 {
            for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let refusal_text = described(|numbers| numbers[number] = value).unwrap_err();
                assert!(refusal_text.contains(REPORTED_NUMBERS[number].0), "{refusal_text}");
            }
        }
        for (number, value, name) in [
            (6, -1.0, "a mass of -1 kg"),
            (5, -5.0, "a rate of -5 Hz"),
            (7, -0.5, "a friction of -0.5 N·s/m"),
            (0, -2.0, "a continuous force of -2 N"),
            (1, 0.0, "a greatest force of 0 N"),
            (2, -1.0, "a step of the position of -1 m"),
            (3, 0.05, "positions from"),
            (4, 1e4, "positions from"),
        ] {
            let refusal_text = described(|numbers| numbers[number] = value).unwrap_err();
            assert!(refusal_text.contains(name), "{refusal_text}");
        }
    }

    #[test]
    fn description_with_zeros_is_unknown() {
        let frame_spec = described(|numbers| {
            for number in [0, 2, 5, 6, 7] {
                numbers[number] = 0.0;
            }
        });
        let frame_spec = frame_spec.unwrap();
        assert_eq!(
            (frame_spec.inertia, frame_spec.damping, frame_spec.rate_nominal),
            (None, None, None)
        );
        assert_eq!(frame_spec.force_max_continuous, 20.0);
    }
}
