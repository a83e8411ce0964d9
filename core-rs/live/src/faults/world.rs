//! A board, the guardian if there is one, and the bytes between them and the host, in virtual time.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::device::DeviceLoss;
use crate::device::haply::{ForceCommand, GuardianAction, GuardianRules};
use crate::emulate::Firmware;
use crate::wire::{frame, haply};

/// Step of the board's time.
const TIME_STEP: Duration = Duration::from_micros(125);
/// A request number far from those of the host.
const FOREIGN_REQUEST: u16 = 40_000;

/// Faults of the line or the board.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LineFaults {
    pub(super) is_unplugged: bool,
    pub(super) replies_lost: bool,
    pub(super) replies_random: bool,
    pub(super) requests_random: bool,
    pub(super) board_stalled: bool,
    /// Another program asks for the positions, once in every tick of the host.
    pub(super) another_program: bool,
    /// Greatest lateness of a packet, each way [steps of the board's time].
    pub(super) jitter_steps: u64,
    /// Percentage of packets that are lost, each way.
    pub(super) loss_percent: u64,
}

/// Haply's guardian: its rules, without its process and its sockets.
pub(super) struct SimulatedGuardian {
    rules: GuardianRules,
    /// Number of the answered command, position [m], whether the guardian let go.
    newest_state: Option<(u16, [f64; 3], bool)>,
    loss: Option<DeviceLoss>,
}

/// The record of the motor of the first axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotorRecord {
    /// Force now [N].
    pub(super) force: f64,
    /// Since the record began: when the force first was zero, and when it was last not zero.
    pub(super) first_zero: Option<Duration>,
    pub(super) last_push: Option<Duration>,
    /// Greatest force [N], and fastest growth [N in a tick of the host].
    pub(super) force_max: f64,
    pub(super) rise_max: f64,
}

/// Everything outside the host.
pub(super) struct SimulatedWorld {
    /// Virtual time [ns].
    clock: Arc<AtomicU64>,
    /// The instant that corresponds to time 0, for rules that need instants.
    epoch: Instant,
    /// `None`: the device is a key in the host's process.
    firmware: Option<Firmware>,
    guardian: Option<SimulatedGuardian>,
    to_host: Vec<u8>,
    /// Packets that a stalled board has not read.
    unread_packets: Vec<Vec<u8>>,
    /// Requests and replies under way, each with its time of arrival.
    requests: Vec<(Duration, Vec<u8>)>,
    replies: Vec<(Duration, Vec<u8>)>,
    /// Work that the motor of the first axis has done on its key, and its greatest value so far [J].
    pub(super) work: [f64; 2],
    pub(super) line_faults: LineFaults,
    pub(super) motor: MotorRecord,
    /// The force at the previous tick [N].
    previous_force: f64,
    random_state: u64,
    n_foreign: u16,
}

impl SimulatedWorld {
    pub(super) fn new(firmware: Option<Firmware>, has_guardian: bool) -> Self {
        let epoch = Instant::now();
        Self {
            clock: Arc::default(),
            epoch,
            firmware,
            guardian: has_guardian.then(|| SimulatedGuardian {
                rules: GuardianRules::new(false, epoch),
                newest_state: None,
                loss: None,
            }),
            to_host: Vec::new(),
            unread_packets: Vec::new(),
            requests: Vec::new(),
            replies: Vec::new(),
            work: [0.0; 2],
            line_faults: LineFaults::default(),
            motor: MotorRecord::default(),
            previous_force: 0.0,
            random_state: 0x9e37_79b9_7f4a_7c15,
            n_foreign: 0,
        }
    }

    pub(super) fn clock(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.clock)
    }

    pub(super) fn now(&self) -> Duration {
        Duration::from_nanos(self.clock.load(Ordering::Relaxed))
    }

    /// Advance the time, while the host does nothing.
    pub(super) fn advance(&mut self, time: Duration) {
        if self.line_faults.another_program {
            self.send_foreign_request();
        }
        let end_time = self.now() + time;
        while self.now() < end_time {
            self.record();
            self.clock.fetch_add(TIME_STEP.as_nanos() as u64, Ordering::Relaxed);
            if !self.line_faults.board_stalled {
                for packet in std::mem::take(&mut self.unread_packets) {
                    self.deliver(&packet);
                }
                let step_time = self.now();
                for (_, packet) in take_arrived(&mut self.requests, step_time) {
                    self.deliver(&packet);
                }
                if let Some(firmware) = &mut self.firmware {
                    let (place_before, motor_force) = (firmware.keys().positions()[0], firmware.forces()[0]);
                    firmware.run_to(step_time);
                    self.work[0] += motor_force * (firmware.keys().positions()[0] - place_before);
                    self.work[1] = self.work[1].max(self.work[0]);
                }
                for (_, reply) in take_arrived(&mut self.replies, step_time) {
                    self.to_host.extend(reply);
                }
            }
            self.run_guardian();
        }
        let force_growth = self.motor.force.abs() - self.previous_force.abs();
        self.motor.rise_max = self.motor.rise_max.max(force_growth);
        self.previous_force = self.motor.force;
    }

    /// Restart the record of the motor.
    pub(super) fn begin_record(&mut self) {
        self.motor = MotorRecord {
            force: self.motor.force,
            ..MotorRecord::default()
        };
    }

    /// Record the motor's force in the step that begins now.
    fn record(&mut self) {
        if let Some(firmware) = &self.firmware {
            self.motor.force = firmware.forces()[0];
        }
        let record_time = self.now();
        let motor = &mut self.motor;
        motor.force_max = motor.force_max.max(motor.force.abs());
        if motor.force == 0.0 {
            motor.first_zero = motor.first_zero.or(Some(record_time));
        } else {
            motor.last_push = Some(record_time + TIME_STEP);
        }
    }

    /// Deliver a packet of the host, or of its guardian, to the board.
    pub(super) fn write(&mut self, packet: &[u8]) -> Result<(), DeviceLoss> {
        if self.line_faults.is_unplugged {
            return Err(DeviceLoss::Closed);
        }
        let packet = if self.line_faults.requests_random {
            self.random_bytes(packet.len())
        } else {
            packet.to_vec()
        };
        if self.line_faults.board_stalled {
            self.unread_packets.push(packet);
        } else if self.line_faults.jitter_steps > 0 {
            if let Some(instant) = self.arrival_time() {
                self.requests.push((instant, packet));
            }
        } else {
            self.deliver(&packet);
        }
        Ok(())
    }

    fn deliver(&mut self, packet: &[u8]) {
        let delivery_time = self.now();
        let Some(firmware) = &mut self.firmware else {
            return;
        };
        let mut replies: Vec<Vec<u8>> = Vec::new();
        firmware.receive(packet, delivery_time, &mut |bytes| replies.push(bytes.to_vec()));
        for reply in replies {
            if self.line_faults.replies_lost {
                continue;
            }
            let reply = if self.line_faults.replies_random {
                self.random_bytes(reply.len())
            } else {
                reply
            };
            match &mut self.guardian {
                None if self.line_faults.jitter_steps > 0 => {
                    if let Some(instant) = self.arrival_time() {
                        self.replies.push((instant, reply));
                    }
                }
                None => self.to_host.extend(reply),
                Some(guardian) => {
                    let reply_text = String::from_utf8_lossy(&reply);
                    if let Some(haply_state) = haply::parse_state(&reply_text, None) {
                        let (state_number, let_go) = guardian.rules.take_state(self.epoch + delivery_time);
                        guardian.newest_state = Some((state_number, haply_state.position, let_go));
                    }
                }
            }
        }
    }

    /// Read the bytes that have arrived at the host.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> Result<usize, DeviceLoss> {
        if self.line_faults.is_unplugged {
            return Err(DeviceLoss::Closed);
        }
        let byte_count = buffer.len().min(self.to_host.len());
        buffer[..byte_count].copy_from_slice(&self.to_host[..byte_count]);
        self.to_host.drain(..byte_count);
        Ok(byte_count)
    }

    /// Pass a force command of the host to its guardian.
    pub(super) fn pass_order(&mut self, command: ForceCommand) {
        let instant = self.epoch + self.now();
        if let Some(guardian) = &mut self.guardian {
            guardian.rules.take_order(command, instant);
        }
        self.run_guardian();
    }

    /// The newest state from the guardian, once; an error if the guardian has lost the service.
    pub(super) fn take_state(&mut self) -> Result<Option<(u16, [f64; 3], bool)>, DeviceLoss> {
        let Some(guardian) = &mut self.guardian else {
            return Ok(None);
        };
        match guardian.loss {
            Some(loss) => Err(loss),
            None => Ok(guardian.newest_state.take()),
        }
    }

    /// Perform the due actions of the guardian.
    fn run_guardian(&mut self) {
        let instant = self.epoch + self.now();
        while let Some(guardian) = &mut self.guardian {
            match guardian.rules.next_action(instant) {
                GuardianAction::Nothing => return,
                GuardianAction::Send(force) => {
                    let command_text = haply::force_message(crate::emulate::HAPLY_ID, force);
                    let _ = self.write(command_text.as_bytes());
                }
                GuardianAction::Gone => {
                    guardian.loss = Some(DeviceLoss::Silent);
                    return;
                }
            }
        }
    }

    /// Send the request of another program.
    fn send_foreign_request(&mut self) {
        self.n_foreign = self.n_foreign.wrapping_add(1);
        let request = frame::FrameRequest {
            seq: FOREIGN_REQUEST.wrapping_add(self.n_foreign),
            axis_count: 1,
            flags: frame::flag::REQUEST,
            ..frame::FrameRequest::default()
        };
        let mut request_bytes = [0; frame::FRAME_BYTES_MAX];
        let request_length = request.write(1.0, &mut request_bytes);
        self.deliver(&request_bytes[..request_length]);
    }

    /// The time at which a packet that is sent now arrives; `None` if it is lost.
    fn arrival_time(&mut self) -> Option<Duration> {
        let is_lost = self.random() % 100 < self.line_faults.loss_percent;
        let delay_steps = self.random() % (self.line_faults.jitter_steps + 1);
        (!is_lost).then(|| self.now() + TIME_STEP * delay_steps as u32)
    }

    fn random_bytes(&mut self, n: usize) -> Vec<u8> {
        (0..n).map(|_| self.random() as u8).collect()
    }

    /// A random number by xorshift64 (Marsaglia, 2003).
    fn random(&mut self) -> u64 {
        self.random_state ^= self.random_state << 13;
        self.random_state ^= self.random_state >> 7;
        self.random_state ^= self.random_state << 17;
        self.random_state >> 32
    }
}

/// Remove the packets that have arrived by `now`, in the order of arrival.
fn take_arrived(packets_in_transit: &mut Vec<(Duration, Vec<u8>)>, now: Duration) -> Vec<(Duration, Vec<u8>)> {
    let mut packets: Vec<_> = packets_in_transit
        .extract_if(.., |(arrival_time, _)| *arrival_time <= now)
        .collect();
    packets.sort_by_key(|(arrival_time, _)| *arrival_time);
    packets
}
