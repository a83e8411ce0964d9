//! A keyboard: a guarded device whose axes are hands of the piece, and the thread that looks for it when it is gone.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rtrb::{Consumer, Producer, RingBuffer};

use super::{Command, hand_limit};
use crate::device::calibrate::{self, Axis};
use crate::device::{self, Device, Kind, MAX_AXES, Sample, Unit, Url, ports};
use crate::safety::{Guarded, Limits, Trip, stiffness};

/// A device that is gone is looked for so often.
const RETRY: Duration = Duration::from_millis(500);
const LOOK: Duration = Duration::from_millis(50);
/// A device that has sent no position for so long is gone, though its port may be open: datagrams never close [s].
const SILENT: f64 = 0.25;
/// Beyond its range a key is believed by this part of it: sensors and stops are not exact.
const OVER: f64 = 0.5;
/// The newest position is waited for during this part of a tick at most.
const WAIT: f64 = 0.3;

/// A device that is open, and the hands on it.
pub struct Keyboard {
    guarded: Box<Guarded>,
    known: DeviceConfig,
    /// Device axis and hand of the piece.
    axes: Vec<(usize, usize)>,
}

/// How to open it, now and again.
#[derive(Clone, Debug)]
pub struct DeviceConfig {
    /// Where it is.
    pub url: Url,
    /// What was found of its axes, by their numbers.
    pub calibration: Vec<(usize, Axis)>,
    /// The greatest force, if that is less than the device's own [N].
    pub most: Option<f64>,
    /// Of a tick [s].
    pub period: f64,
}

impl DeviceConfig {
    /// What the board is called wherever it is plugged in, if that is certain.
    fn identity(&self) -> Option<String> {
        let is_serial = matches!(self.url.kind, Kind::FireFader | Kind::Frame);
        is_serial
            .then(|| ports::identity(&self.url.target))
            .flatten()
    }
}

/// The physics thread's side of it.
pub struct Slot {
    guarded: Option<Box<Guarded>>,
    lockstep: bool,
    pub(super) axes: Vec<(usize, usize)>,
    pub(super) sample: Sample,
    forces: [f64; MAX_AXES],
    pub(super) sent: [f64; MAX_AXES],
    gone: Arc<AtomicBool>,
    grave: Producer<Box<Guarded>>,
    wait: Duration,
    /// Farther than this no key goes [m].
    range: [f64; 2],
    /// Ticks without a new position, and how many are too many.
    silent: u32,
    patience: u32,
    /// Interruptions of devices that are gone.
    earlier: [u64; 2],
}

/// The side that may wait: opens the device again, frees what is dead.
pub(super) struct Reconnector {
    thread: Option<JoinHandle<()>>,
    stop: Arc<AtomicBool>,
}

impl Keyboard {
    /// Open a device; `axes`: (axis of the device, hand of the piece).
    ///
    /// # Errors
    /// What the device's driver says.
    pub fn open(
        known: DeviceConfig,
        axes: Vec<(usize, usize)>,
    ) -> Result<Self, device::DeviceError> {
        let device = known.open()?;
        let n = device.spec().dof;
        if axes.iter().any(|(axis, _)| *axis >= n) {
            return Err(known.url.cannot(device::NO_AXIS));
        }
        Ok(Self::around(device, known, axes))
    }

    /// A device that is open already; gone, it is looked for by what is known of it.
    pub(super) fn around(
        device: Box<dyn Device>,
        known: DeviceConfig,
        axes: Vec<(usize, usize)>,
    ) -> Self {
        Self {
            guarded: known.guard(device),
            known,
            axes,
        }
    }

    /// Its keys by themselves.
    pub(super) fn key(&self) -> stiffness::Key {
        self.known.key(&self.guarded)
    }

    /// Device axes and hands of the piece.
    pub(super) fn axes(&self) -> &[(usize, usize)] {
        &self.axes
    }

    /// What the device is.
    pub fn spec(&self) -> &device::Spec {
        self.guarded.spec()
    }

    pub(super) fn split(
        self,
        index: usize,
        commands: Arc<Mutex<Producer<Command>>>,
    ) -> (Slot, Reconnector) {
        let (gone, stop) = (Arc::default(), Arc::default());
        // One may die while the one before is still to be freed.
        let (grave, graves) = RingBuffer::new(4);
        let [low, high] = self.guarded.spec().pos_range;
        let over = OVER * (high - low).abs();
        let key = self.key();
        let slot = Slot {
            range: [low.min(high) - over, low.max(high) + over],
            lockstep: self.guarded.in_lockstep(),
            guarded: Some(self.guarded),
            axes: self.axes.clone(),
            sample: Sample::default(),
            forces: [0.0; MAX_AXES],
            sent: [0.0; MAX_AXES],
            gone: Arc::clone(&gone),
            grave,
            wait: Duration::from_secs_f64(WAIT * self.known.period),
            silent: 0,
            patience: (SILENT / self.known.period) as u32 + 1,
            earlier: [0; 2],
        };
        let search = ReconnectLoop {
            key,
            axes: self.axes,
            identity: self.known.identity(),
            known: self.known,
            index,
            gone,
            stop: Arc::clone(&stop),
            graves,
            commands,
        };
        let thread = std::thread::Builder::new()
            .name("ergon keys".into())
            .spawn(move || search.run())
            .ok();
        (slot, Reconnector { thread, stop })
    }
}

impl DeviceConfig {
    fn open(&self) -> Result<Box<dyn Device>, device::DeviceError> {
        let device = calibrate::applied(device::open(&self.url)?, &self.calibration);
        if device.spec().unit == Unit::Radian {
            return Err(self
                .url
                .cannot("the axis rotates (its unit is rad), and a key of a score needs metres"));
        }
        Ok(device)
    }

    fn key(&self, guarded: &Guarded) -> stiffness::Key {
        hand_limit::key(guarded.spec(), guarded.in_lockstep(), self.period)
    }

    fn guard(&self, device: Box<dyn Device>) -> Box<Guarded> {
        let own = Limits::of(device.spec());
        let force = self.most.map_or(own.force, |most| most.min(own.force));
        let limits = Limits { force, ..own };
        Box::new(Guarded::new(device, limits, self.period).watched())
    }
}

impl Slot {
    /// Whether its ticks come by a clock: not in lockstep, where it waits for us.
    pub fn is_on_the_clock(&self) -> bool {
        !self.lockstep
    }

    pub(super) fn is_there(&self) -> bool {
        self.guarded.is_some()
    }

    pub(super) fn tripped(&self, axis: usize) -> Option<Trip> {
        self.guarded
            .as_ref()
            .and_then(|guarded| guarded.tripped(axis))
    }

    /// How often the board said that it had let go, and how often the host was stopped.
    pub(super) fn interruptions(&self) -> [u64; 2] {
        let [let_go, stalls] = self.earlier;
        self.guarded.as_ref().map_or(self.earlier, |guarded| {
            let counts = guarded.counts();
            [let_go + counts.let_go, stalls + counts.stalls]
        })
    }

    /// The force that an axis is to get [N].
    pub(super) fn force(&mut self, axis: usize, force: f64) {
        self.forces[axis] = force;
    }

    /// Which part of its forces an axis gets; a device that comes back gets it in its first tick.
    pub(super) fn scale(&mut self, axis: usize, scale: f64) {
        if let Some(guarded) = &mut self.guarded {
            guarded.scale(axis, scale);
        }
    }

    /// No more forces, or forces again.
    pub(super) fn stop(&mut self, stopped: bool) {
        if let Some(guarded) = &mut self.guarded {
            guarded.stop(stopped);
        }
    }

    /// What tripped may push again.
    pub(super) fn release(&mut self) {
        if let Some(guarded) = &mut self.guarded {
            guarded.release();
        }
    }

    /// Forces out. False: the device has just gone.
    pub(super) fn send(&mut self) -> bool {
        let Some(guarded) = &mut self.guarded else {
            return true;
        };
        match guarded.send(&self.forces) {
            Ok(sent) => {
                let newtons = sent.newtons();
                self.sent[..newtons.len()].copy_from_slice(newtons);
                true
            }
            Err(_) => self.let_go(),
        }
    }

    /// When positions are waited for no longer, if they are asked for now.
    pub(super) fn deadline(&self) -> Instant {
        Instant::now() + self.wait
    }

    /// Positions in. False: the device has just gone.
    pub(super) fn look(&mut self, deadline: Instant) -> bool {
        self.sample.fresh = false;
        let Some(guarded) = &mut self.guarded else {
            return true;
        };
        let done = guarded.receive(&mut self.sample, deadline);
        self.sample.fresh = matches!(done, Ok(true));
        let [low, high] = self.range;
        for position in &mut self.sample.position {
            // What a board says is no place for a key is none.
            *position = position.clamp(low, high);
        }
        self.silent = if self.sample.fresh {
            0
        } else {
            self.silent + 1
        };
        if done.is_ok() && self.silent <= self.patience {
            return true;
        }
        self.let_go()
    }

    fn let_go(&mut self) -> bool {
        (self.sample.fresh, self.sample.t_dev_us) = (false, None);
        self.earlier = self.interruptions();
        if let Some(dead) = self.guarded.take() {
            // Freed by the seeker: closing a port takes its time.
            if let Err(rtrb::PushError::Full(dead)) = self.grave.push(dead) {
                std::mem::forget(dead);
            }
        }
        self.sent = [0.0; MAX_AXES];
        self.gone.store(true, Ordering::Release);
        false
    }

    /// A device that was found again.
    pub(super) fn comes_back(&mut self, guarded: Box<Guarded>) {
        self.forces = [0.0; MAX_AXES];
        self.silent = 0;
        self.guarded = Some(guarded);
    }
}

struct ReconnectLoop {
    known: DeviceConfig,
    key: stiffness::Key,
    axes: Vec<(usize, usize)>,
    /// Of the board that was opened first.
    identity: Option<String>,
    index: usize,
    gone: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    graves: Consumer<Box<Guarded>>,
    commands: Arc<Mutex<Producer<Command>>>,
}

impl ReconnectLoop {
    fn run(mut self) {
        let mut next = Instant::now();
        let mut memory = None;
        while !self.stop.load(Ordering::Acquire) {
            std::thread::park_timeout(LOOK);
            let is_gone = self.gone.load(Ordering::Acquire);
            // What is dead sends its last zeros and closes its port before it is opened again.
            while let Ok(dead) = self.graves.pop() {
                memory = Some(dead.memory());
            }
            if !is_gone || Instant::now() < next {
                continue;
            }
            next = Instant::now() + RETRY;
            // Another board at the same port has another motor, which nobody tried.
            if self.identity.is_some() && self.known.identity() != self.identity {
                continue;
            }
            let Ok(device) = self.known.open() else {
                continue;
            };
            // Another device may have taken its name: the scales of its hands are those of this key.
            let n = device.spec().dof;
            if self.axes.iter().any(|(axis, _)| *axis >= n) {
                continue;
            }
            let mut guarded = self.known.guard(device);
            if self.known.key(&guarded) != self.key {
                continue;
            }
            if let Some(memory) = &memory {
                guarded.recall(memory);
            }
            self.gone.store(false, Ordering::Release);
            let mut commands = self.commands.lock().unwrap_or_else(PoisonError::into_inner);
            // Where the ring is full nobody plays any more.
            let _ = commands.push(Command::Keys(self.index, guarded));
        }
    }
}

impl Drop for Reconnector {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // What panicked there has freed what it held.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests;
