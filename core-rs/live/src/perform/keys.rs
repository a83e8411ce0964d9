//! A keyboard: a guarded device whose axes are hands of the piece, and the thread that reopens a lost device.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rtrb::{Consumer, Producer, RingBuffer};

use super::Command;
use super::hand_limit::{self, MeasuredKey};
use crate::device::calibrate::{self, AxisCalibration};
use crate::device::{self, Device, DeviceKind, DeviceSample, DeviceUrl, MAX_AXES, Unit, WaitCanceller, ports};
use crate::safety::{GuardedDevice, SafetyLimits, TripCause, stiffness};

/// Time between two attempts to open a lost device.
const RETRY_INTERVAL: Duration = Duration::from_millis(500);
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Time without a position after which a device counts as lost [s]. Its port may still be open: a datagram socket never
/// closes.
const LOST_SECONDS: f64 = 0.25;
/// Tolerance of positions beyond the range, as a part of the range: sensors and end stops are not exact.
const RANGE_TOLERANCE: f64 = 0.5;
/// Longest wait for the newest position, as a part of a tick.
const WAIT_SHARE: f64 = 0.3;

/// An open device and the hands on it.
pub struct Keyboard {
    guarded_device: Box<GuardedDevice>,
    config: DeviceConfig,
    /// Pairs of device axis and hand of the piece.
    axes: Vec<(usize, usize)>,
}

/// How to open a device, the first time and again.
#[derive(Clone, Debug)]
pub struct DeviceConfig {
    /// The address of the device.
    pub url: DeviceUrl,
    /// Calibrations of axes, each with the number of its axis.
    pub calibration: Vec<(usize, AxisCalibration)>,
    /// Greatest force [N], if less than the device's own limit.
    pub force_limit: Option<f64>,
    /// Length of a tick [s].
    pub period: f64,
    /// Ends the search for the device, and its waits for replies.
    pub canceller: WaitCanceller,
}

impl DeviceConfig {
    /// An identifier of the board that does not depend on its port, if there is one.
    fn identity(&self) -> Option<String> {
        let device_kind = self.url.kind;
        device_kind
            .is_serial()
            .then(|| ports::identity(&self.url.target))
            .flatten()
    }
}

/// A keyboard as the physics thread uses it.
pub struct KeyboardSlot {
    guarded_device: Option<Box<GuardedDevice>>,
    in_lockstep: bool,
    pub(super) axes: Vec<(usize, usize)>,
    pub(super) sample: DeviceSample,
    forces: [f64; MAX_AXES],
    pub(super) sent_forces: [f64; MAX_AXES],
    is_lost: Arc<AtomicBool>,
    lost_device_producer: Producer<Box<GuardedDevice>>,
    sample_wait: Duration,
    /// Range of plausible positions [m].
    range: [f64; 2],
    /// Number of ticks without a new position, and the number above which the device counts as lost.
    silent_ticks: u32,
    silent_ticks_max: u32,
    /// Counts of interruptions on devices of this slot that were lost; new counts are added to them.
    earlier_counts: [u64; 2],
}

/// The thread that is allowed to wait: it opens the device again and frees lost ones.
pub(super) struct Reconnector {
    thread: Option<JoinHandle<()>>,
    canceller: WaitCanceller,
}

impl Keyboard {
    /// Open a device; `axes`: (axis of the device, hand of the piece).
    ///
    /// # Errors
    /// The error of the device's driver.
    pub fn open(config: DeviceConfig, axes: Vec<(usize, usize)>) -> Result<Self, device::DeviceError> {
        let device = config.open(false)?;
        let axis_count = device.spec().dof;
        if axes.iter().any(|(axis, _)| *axis >= axis_count) {
            return Err(config.url.unsupported_error(device::NO_SUCH_AXIS));
        }
        Ok(Self::from_device(device, config, axes))
    }

    /// A keyboard of an open device; if the device is lost, it is opened again as `config` says.
    pub(super) fn from_device(device: Box<dyn Device>, config: DeviceConfig, axes: Vec<(usize, usize)>) -> Self {
        Self {
            guarded_device: config.guard(device),
            config,
            axes,
        }
    }

    /// The handle that ends the waits for the device.
    pub(super) fn canceller(&self) -> WaitCanceller {
        self.config.canceller.clone()
    }

    /// The key of the device, without hand or piece.
    pub(super) fn haptic_loop(&self, measured_key: Option<MeasuredKey>) -> stiffness::HapticLoop {
        self.config.key(&self.guarded_device, measured_key)
    }

    /// Pairs of device axis and hand of the piece.
    pub(super) fn axes(&self) -> &[(usize, usize)] {
        &self.axes
    }

    /// The properties of the device.
    pub fn spec(&self) -> &device::DeviceSpec {
        self.guarded_device.spec()
    }

    pub(super) fn split(self, index: usize, commands: Arc<Mutex<Producer<Command>>>) -> (KeyboardSlot, Reconnector) {
        let (is_gone, canceller) = (Arc::default(), self.config.canceller.clone());
        // Room for devices that are lost while an earlier one is still to be freed.
        let (to_drop, lost_devices) = RingBuffer::new(4);
        let [range_start, range_end] = self.guarded_device.spec().pos_range;
        let tolerance = RANGE_TOLERANCE * (range_end - range_start).abs();
        let key = self.haptic_loop(None);
        let slot = KeyboardSlot {
            range: [
                range_start.min(range_end) - tolerance,
                range_start.max(range_end) + tolerance,
            ],
            in_lockstep: self.guarded_device.in_lockstep(),
            guarded_device: Some(self.guarded_device),
            axes: self.axes.clone(),
            sample: DeviceSample::default(),
            forces: [0.0; MAX_AXES],
            sent_forces: [0.0; MAX_AXES],
            is_lost: Arc::clone(&is_gone),
            lost_device_producer: to_drop,
            sample_wait: Duration::from_secs_f64(WAIT_SHARE * self.config.period),
            silent_ticks: 0,
            silent_ticks_max: (LOST_SECONDS / self.config.period) as u32 + 1,
            earlier_counts: [0; 2],
        };
        let reconnect = ReconnectLoop {
            haptic_loop: key,
            axes: self.axes,
            identity: self.config.identity(),
            config: self.config,
            slot_index: index,
            is_lost: is_gone,
            lost_devices,
            commands,
        };
        let thread = std::thread::Builder::new()
            .name("ergon keys".into())
            .spawn(move || reconnect.run())
            .ok();
        (slot, Reconnector { thread, canceller })
    }
}

impl DeviceConfig {
    fn open(&self, is_retry: bool) -> Result<Box<dyn Device>, device::DeviceError> {
        let opened_device = match self.url.kind {
            DeviceKind::Pointer => device::open_pointer(&self.url, self.period, is_retry)?,
            _ => device::open_until(&self.url, &self.canceller)?,
        };
        let opened_device = calibrate::with_calibration(opened_device, &self.calibration);
        if opened_device.spec().unit == Unit::Radian {
            return Err(self
                .url
                .unsupported_error("the axis rotates (its unit is rad), and a key of a score needs metres; ?arm=0.05 says at which distance [m] from its axis a hand holds it"));
        }
        Ok(opened_device)
    }

    fn key(&self, guarded_device: &GuardedDevice, measured_key: Option<MeasuredKey>) -> stiffness::HapticLoop {
        let lockstep = guarded_device.in_lockstep();
        hand_limit::bare_key(guarded_device.spec(), measured_key, lockstep, self.period)
    }

    fn guard(&self, device: Box<dyn Device>) -> Box<GuardedDevice> {
        let device_limits = SafetyLimits::from_spec(device.spec());
        let force = self
            .force_limit
            .map_or(device_limits.force_max, |limit| limit.min(device_limits.force_max));
        let capped_limits = SafetyLimits {
            force_max: force,
            ..device_limits
        };
        Box::new(GuardedDevice::new(device, capped_limits, self.period).with_plausibility())
    }
}

impl KeyboardSlot {
    /// Whether the device has a clock of its own; in lockstep it waits for the host.
    pub fn has_clock(&self) -> bool {
        !self.in_lockstep
    }

    pub(super) fn is_open(&self) -> bool {
        self.guarded_device.is_some()
    }

    pub(super) fn trip_cause(&self, axis: usize) -> Option<TripCause> {
        self.guarded_device
            .as_ref()
            .and_then(|guarded_device| guarded_device.trip_cause(axis))
    }

    /// How often the board reported that it let go, and how often forces ended because the host was stopped.
    pub(super) fn interruptions(&self) -> [u64; 2] {
        let [let_go, stalls] = self.earlier_counts;
        self.guarded_device
            .as_ref()
            .map_or(self.earlier_counts, |guarded_device| {
                let guarded_counts = guarded_device.counts();
                [let_go + guarded_counts.let_go, stalls + guarded_counts.stalls]
            })
    }

    /// Set the force of an axis [N].
    pub(super) fn set_force(&mut self, axis: usize, force: f64) {
        self.forces[axis] = force;
    }

    /// Set the factor of the forces of an axis; a device that returns gets it in its first tick.
    pub(super) fn set_scale(&mut self, axis: usize, scale: f64) {
        if let Some(guarded_device) = &mut self.guarded_device {
            guarded_device.scale(axis, scale);
        }
    }

    /// Stop the forces, or let them return.
    pub(super) fn set_stopped(&mut self, is_stopped: bool) {
        if let Some(guarded_device) = &mut self.guarded_device {
            guarded_device.set_stopped(is_stopped);
        }
    }

    /// Let axes that tripped push again.
    pub(super) fn release(&mut self) {
        if let Some(guarded_device) = &mut self.guarded_device {
            guarded_device.release();
        }
    }

    /// Send the forces; false if the device has just been lost.
    pub(super) fn send(&mut self) -> bool {
        let Some(guarded_device) = &mut self.guarded_device else {
            return true;
        };
        match guarded_device.send(&self.forces) {
            Ok(sent_forces) => {
                self.sent_forces = guarded_device.device().on_wire(&sent_forces);
                true
            }
            Err(_) => self.detach(),
        }
    }

    /// The deadline for positions that are asked for now.
    pub(super) fn deadline(&self) -> Instant {
        Instant::now() + self.sample_wait
    }

    /// Receive positions; false if the device has just been lost.
    pub(super) fn receive(&mut self, deadline: Instant) -> bool {
        self.sample.is_fresh = false;
        let Some(guarded_device) = &mut self.guarded_device else {
            return true;
        };
        let receive_result = guarded_device.receive(&mut self.sample, deadline);
        self.sample.is_fresh = matches!(receive_result, Ok(true));
        let [lowest_position, highest_position] = self.range;
        for position in &mut self.sample.position {
            // Positions that the key cannot have are clamped.
            *position = position.clamp(lowest_position, highest_position);
        }
        self.silent_ticks = if self.sample.is_fresh { 0 } else { self.silent_ticks + 1 };
        if receive_result.is_ok() && self.silent_ticks <= self.silent_ticks_max {
            return true;
        }
        self.detach()
    }

    fn detach(&mut self) -> bool {
        (self.sample.is_fresh, self.sample.t_dev_us) = (false, None);
        self.earlier_counts = self.interruptions();
        if let Some(lost_device) = self.guarded_device.take() {
            // The reconnector frees it, because closing a port may take long.
            if let Err(rtrb::PushError::Full(lost_device)) = self.lost_device_producer.push(lost_device) {
                std::mem::forget(lost_device);
            }
        }
        self.sent_forces = [0.0; MAX_AXES];
        self.is_lost.store(true, Ordering::Release);
        false
    }

    /// Continue with a device that was opened again.
    pub(super) fn set_reopened(&mut self, guarded_device: Box<GuardedDevice>) {
        self.forces = [0.0; MAX_AXES];
        self.silent_ticks = 0;
        self.guarded_device = Some(guarded_device);
    }
}

struct ReconnectLoop {
    config: DeviceConfig,
    haptic_loop: stiffness::HapticLoop,
    axes: Vec<(usize, usize)>,
    /// Identity of the board that was opened first.
    identity: Option<String>,
    slot_index: usize,
    is_lost: Arc<AtomicBool>,
    lost_devices: Consumer<Box<GuardedDevice>>,
    commands: Arc<Mutex<Producer<Command>>>,
}

impl ReconnectLoop {
    fn run(mut self) {
        let mut next_attempt = Instant::now();
        let mut device_memory = None;
        while !self.config.canceller.is_cancelled() {
            std::thread::park_timeout(POLL_INTERVAL);
            let is_detached = self.is_lost.load(Ordering::Acquire);
            // The lost device is dropped here, before its port is opened again: it sends its last zeros and closes the
            // port.
            while let Ok(lost_device) = self.lost_devices.pop() {
                device_memory = Some(lost_device.memory());
            }
            if !is_detached || Instant::now() < next_attempt {
                continue;
            }
            next_attempt = Instant::now() + RETRY_INTERVAL;
            // Another board at the same port may have another motor, whose direction is unknown.
            if self.identity.is_some() && self.config.identity() != self.identity {
                continue;
            }
            let Ok(opened_device) = self.config.open(true) else {
                continue;
            };
            // The name may belong to another device, but the force scales were computed for the first one.
            let axis_count = opened_device.spec().dof;
            if self.axes.iter().any(|(axis, _)| *axis >= axis_count) {
                continue;
            }
            let mut guarded_device = self.config.guard(opened_device);
            if self.config.key(&guarded_device, None) != self.haptic_loop {
                continue;
            }
            if let Some(device_memory) = &device_memory {
                guarded_device.restore_memory(device_memory);
            }
            self.is_lost.store(false, Ordering::Release);
            let mut commands = self.commands.lock().unwrap_or_else(PoisonError::into_inner);
            // The ring is full only after the end of the performance.
            let _ = commands.push(Command::ReopenedKeyboard(self.slot_index, guarded_device));
        }
    }
}

impl Drop for Reconnector {
    fn drop(&mut self) {
        self.canceller.cancel();
        if let Some(reconnect_thread) = self.thread.take() {
            reconnect_thread.thread().unpark();
            // If the thread panicked, its device has been freed.
            let _ = reconnect_thread.join();
        }
    }
}

#[cfg(test)]
mod tests;
