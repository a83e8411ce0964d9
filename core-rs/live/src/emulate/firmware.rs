//! The program of a board: what it does with packets, period by period. It uses only the times that the caller passes.

use std::f64::consts::TAU;
use std::time::Duration;

use ergon_engine::chance::Chance;
use ergon_engine::maths;

use super::EmulatedKeys;
use crate::wire::MAX_AXES;
use crate::wire::frame::{self, flag, status, trait_flag};
use crate::wire::{PacketBuffer, firefader, haply};

/// The protocol of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// Two faders; single bytes.
    FireFader,
    /// The open frame.
    Frame,
    /// Haply's Inverse Service.
    Haply,
}

impl Protocol {
    /// All of them.
    #[cfg(test)]
    pub(crate) const ALL: &[Self] = &[Self::FireFader, Self::Frame, Self::Haply];
}

/// The id of the emulated Haply device.
pub(crate) const HAPLY_ID: &str = "EMUL";
/// The sensor value of FireFader while a finger touches it.
const FINGER_SENSOR_VALUE: u8 = 100;

/// Properties of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardConfig {
    /// Its protocol.
    pub protocol: Protocol,
    /// Whether every packet is one period; otherwise periods follow wall time.
    pub lockstep: bool,
    /// Whether there is force only while a finger touches the key.
    pub touch_gate: bool,
    /// Greatest force of its motors [N].
    pub force_max: f64,
    /// Step of its position sensor [m]; 0: only that of the wire.
    pub resolution: f64,
    /// Standard deviation of the sensor's noise [m].
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Step of the motors' forces [N]; 0: only that of the wire.
    pub force_step: f64,
    /// Silence of the host after which the board lets go (wall time only).
    pub watchdog: Duration,
    /// Mass [kg] and damping [N·s/m] that the board reports for its keys.
    pub reported_constants: [f64; 2],
    /// Ends of the keys [m].
    pub range: [f64; 2],
}

/// A running board.
pub struct Firmware {
    board: BoardConfig,
    keys: EmulatedKeys,
    inbox: PacketBuffer<512>,
    force: [f64; MAX_AXES],
    /// The sensors' noise in this period [m].
    noise_offsets: [f64; MAX_AXES],
    random: Chance,
    /// FireFader's gate: a low-pass filter of the presence of a finger, over packets.
    gate_levels: [f64; MAX_AXES],
    last_packet: Option<Duration>,
    has_let_go: bool,
    is_host_active: bool,
    packet_count: u64,
    /// Periods of wall time that have passed.
    wall_periods: u64,
}

impl Firmware {
    /// A board with its keys.
    pub fn new(board: BoardConfig, keys: EmulatedKeys) -> Self {
        let mut firmware = Self {
            board,
            keys,
            inbox: PacketBuffer::empty(),
            force: [0.0; MAX_AXES],
            noise_offsets: [0.0; MAX_AXES],
            random: Chance::new(i128::from(board.seed), "emulate", "noise", 0, 0),
            gate_levels: [0.0; MAX_AXES],
            last_packet: None,
            has_let_go: false,
            is_host_active: false,
            packet_count: 0,
            wall_periods: 0,
        };
        firmware.draw_noise();
        firmware
    }

    /// Advance the keys by one period, and draw the noise of the sensors after it.
    fn step(&mut self) {
        self.keys.step(&self.force);
        self.draw_noise();
    }

    fn draw_noise(&mut self) {
        if self.board.noise == 0.0 {
            return;
        }
        for noise in &mut self.noise_offsets[..self.keys.n_keys()] {
            // Box-Muller transform: a radius and an angle give a normal deviate.
            let radius = maths::sqrt(2.0 * self.random.exponential(1.0));
            let angle = self.random.uniform(0.0, TAU);
            *noise = self.board.noise * radius * maths::cos(angle);
        }
    }

    /// The keys.
    pub fn keys(&self) -> &EmulatedKeys {
        &self.keys
    }

    /// Number of packets of forces so far.
    pub fn packets(&self) -> u64 {
        self.packet_count
    }

    /// Advance to a time on the wall clock; returns whether the board has just let go.
    pub fn run_to(&mut self, now: Duration) -> bool {
        if self.board.lockstep {
            return false;
        }
        let board_rate = self.keys.rate().hertz();
        let due_periods = (now.as_secs_f64() * board_rate) as u64;
        // At most one second is caught up, so that a machine that slept does not.
        let missed_periods = due_periods.saturating_sub(self.wall_periods).min(board_rate as u64);
        for _ in 0..missed_periods {
            self.step();
        }
        self.wall_periods = due_periods;
        let is_silent = self
            .last_packet
            .is_some_and(|packet_time| now.saturating_sub(packet_time) > self.board.watchdog);
        let has_just_let_go = is_silent && !self.has_let_go;
        if has_just_let_go {
            self.force = [0.0; MAX_AXES];
            (self.has_let_go, self.is_host_active) = (true, false);
        }
        has_just_let_go
    }

    /// Time at which the next period of wall time begins [s].
    pub(super) fn next_period_time(&self) -> f64 {
        (self.wall_periods + 1) as f64 * self.keys.rate().step()
    }

    /// Whether the forces of a host act: true until the host lets go or is silent for too long.
    pub fn is_host_active(&self) -> bool {
        self.is_host_active
    }

    /// The forces that act now [N]   (16, the keys' first)
    pub fn forces(&self) -> &[f64; MAX_AXES] {
        &self.force
    }

    /// Take bytes from the host; `reply` gets the answers. In a text protocol the bytes are one whole message.
    pub fn receive(&mut self, bytes: &[u8], now: Duration, reply: &mut dyn FnMut(&[u8])) {
        match self.board.protocol {
            Protocol::FireFader => self.receive_firefader(bytes, now, reply),
            Protocol::Frame => self.receive_frame(bytes, now, reply),
            Protocol::Haply => {
                let command_text = std::str::from_utf8(bytes).unwrap_or_default();
                if let Some(axis_forces) = haply::parse_command(command_text, HAPLY_ID) {
                    self.apply_forces(axis_forces.iter().copied(), true, now);
                    reply(self.haply_state().as_bytes());
                }
            }
        }
    }

    /// The first message of the Haply service to a new host.
    pub(super) fn greeting(&self) -> Option<String> {
        (self.board.protocol == Protocol::Haply).then(|| self.haply_state())
    }

    fn haply_state(&self) -> String {
        let three_axes = |axis_values: &[f64; MAX_AXES]| [axis_values[0], axis_values[1], axis_values[2]];
        let (position, force) = (three_axes(&self.sensor_positions()), three_axes(&self.force));
        haply::state_message(HAPLY_ID, position, force, self.board.lockstep)
    }

    /// Set new forces; in lockstep also advance by the period in which they act. `is_enabled`: the host enables the
    /// motors.
    fn apply_forces(&mut self, force: impl Iterator<Item = f64>, is_enabled: bool, now: Duration) {
        self.packet_count += 1;
        self.last_packet = Some(now);
        (self.has_let_go, self.is_host_active) = (false, is_enabled);
        for (axis, force) in force.take(self.keys.n_keys()).enumerate() {
            let is_gate_open = !self.board.touch_gate || self.update_gate(axis);
            let force_step = self.board.force_step;
            let force = if force_step > 0.0 {
                (force / force_step).round() * force_step
            } else {
                force
            };
            let limited_force = force.clamp(-self.board.force_max, self.board.force_max);
            self.force[axis] = if is_enabled && is_gate_open { limited_force } else { 0.0 };
        }
        if self.board.lockstep {
            self.step();
        }
    }

    /// Whether the gate detects a finger: at once, or by FireFader's filter over packets.
    fn update_gate(&mut self, axis: usize) -> bool {
        let is_touched = self.keys.is_touched(axis);
        if self.board.protocol != Protocol::FireFader {
            return is_touched;
        }
        let sensor_byte = firefader::position_byte(self.keys.positions()[axis]);
        let is_opening = is_touched && (5..251).contains(&sensor_byte);
        self.gate_levels[axis] = self.gate_levels[axis] * (31.0 / 32.0) + if is_opening { 5.0 } else { 0.0 };
        self.gate_levels[axis] >= 20.0
    }

    /// Positions as the sensors read them [m].
    fn sensor_positions(&self) -> [f64; MAX_AXES] {
        let resolution = self.board.resolution;
        let mut readings = *self.keys.positions();
        for (reading, noise) in readings.iter_mut().zip(&self.noise_offsets) {
            *reading += noise;
            if resolution > 0.0 {
                *reading = (*reading / resolution).round() * resolution;
            }
        }
        readings
    }

    fn receive_firefader(&mut self, bytes: &[u8], now: Duration, reply: &mut dyn FnMut(&[u8])) {
        let mut packets = Vec::new();
        self.inbox
            .add_bytes(bytes, firefader::parse_request, |axis_forces| packets.push(axis_forces));
        // In wall time the firmware handles only the newest of the packets that it finds, and answers once.
        let n_outdated_packets = if self.board.lockstep {
            0
        } else {
            packets.len().saturating_sub(1)
        };
        for axis_forces in packets.drain(..).skip(n_outdated_packets) {
            self.apply_forces(axis_forces.into_iter(), true, now);
            let mut fader_reply = firefader::FaderReply::default();
            for axis in 0..self.keys.n_keys().min(2) {
                fader_reply.position[axis] = firefader::position_byte(self.sensor_positions()[axis]);
                fader_reply.capacitance[axis] = if self.keys.is_touched(axis) {
                    FINGER_SENSOR_VALUE
                } else {
                    0
                };
            }
            reply(&fader_reply.bytes());
        }
    }

    fn receive_frame(&mut self, request_bytes: &[u8], now: Duration, reply: &mut dyn FnMut(&[u8])) {
        let mut packets = Vec::new();
        let force_max = self.board.force_max;
        self.inbox.add_bytes(
            request_bytes,
            |bytes| frame::FrameRequest::parse(bytes, force_max),
            |packet| packets.push(packet),
        );
        for packet in packets {
            let mut reply_bytes = [0; frame::FRAME_BYTES_MAX];
            let reply_length = if packet.axis_count == 0 {
                self.device_info(packet.seq).write(&mut reply_bytes)
            } else if packet.axis_count == self.keys.n_keys() {
                let had_let_go = self.has_let_go;
                if packet.flags & flag::REQUEST == 0 {
                    let motors_enabled = packet.flags & flag::ENABLE != 0;
                    self.apply_forces(packet.force.iter().copied(), motors_enabled, now);
                }
                self.frame_reply(&packet, had_let_go).write(&mut reply_bytes)
            } else {
                continue;
            };
            reply(&reply_bytes[..reply_length]);
        }
    }

    fn frame_reply(&self, packet: &frame::FrameRequest, had_let_go: bool) -> frame::FrameReply {
        let n_keys = self.keys.n_keys();
        let is_touched = (0..n_keys).any(|axis| self.keys.is_touched(axis));
        let motors_enabled = packet.flags & flag::ENABLE != 0 && (is_touched || !self.board.touch_gate);
        let status_bits = [
            (is_touched, status::TOUCHED),
            (motors_enabled, status::ENABLED),
            (had_let_go, status::LET_GO),
        ];
        let clock_us = if self.board.lockstep {
            self.keys.time_us()
        } else {
            // The time at which the positions were read; forces act from then on.
            (self.wall_periods as f64 * self.keys.rate().step() * 1e6) as u64 as u32
        };
        frame::FrameReply {
            seq: packet.seq,
            clock_us,
            axis_count: n_keys,
            is_wide: packet.is_wide,
            status: status_bits.iter().filter(|bit| bit.0).map(|bit| bit.1).sum(),
            position: self.sensor_positions(),
        }
    }

    fn device_info(&self, seq: u16) -> frame::DeviceInfo {
        let [inertia, damping] = self.board.reported_constants;
        let [lower_limit, upper_limit] = self.board.range;
        let force_max = self.board.force_max;
        let position_step = self.board.resolution.max(frame::POSITION_STEP);
        let board_rate = self.keys.rate().hertz();
        let gate_flag = if self.board.touch_gate {
            trait_flag::TOUCH_GATED
        } else {
            0
        };
        let lockstep_flag = if self.board.lockstep { trait_flag::LOCKSTEP } else { 0 };
        frame::DeviceInfo {
            seq,
            axis_count: self.keys.n_keys(),
            trait_flags: gate_flag | lockstep_flag | trait_flag::WIDE,
            spec_values: [
                force_max,
                force_max,
                position_step,
                lower_limit,
                upper_limit,
                board_rate,
                inertia,
                damping,
            ]
            .map(|number| number as f32),
        }
    }
}

#[cfg(test)]
mod tests;
