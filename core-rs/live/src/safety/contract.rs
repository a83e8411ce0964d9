//! The contract between `safety` and the drivers of devices: forces go out, positions come back.
//!
//! Every protocol is request and reply: a packet of forces is answered by where the axes are. So one trait serves all
//! of them. Units are SI and a positive force moves towards positive positions. A driver takes a [`SafeForce`], which
//! `safety` alone can make; this is why the contract stands here.

mod stats;

pub(crate) use stats::{Drift, Sent};
pub use stats::{Histogram, Stats};

use std::time::Instant;

use super::force::SafeForce;
use crate::wire::MAX_AXES;

/// What an axis's position is measured in; its force is N or N·m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// [m]
    Metre,
    /// [rad]
    Radian,
}

/// What a device is, in SI units; all its axes are alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Number of axes.
    pub dof: usize,
    /// What positions are measured in.
    pub unit: Unit,
    /// Step of the position sensor.
    pub pos_lsb: f64,
    /// Least and greatest position.
    pub pos_range: [f64; 2],
    /// Force that it bears for hours.
    pub force_max_continuous: f64,
    /// Greatest force.
    pub force_max_peak: f64,
    /// Step of the force.
    pub force_lsb: f64,
    /// Exchanges a second, where it promises any [Hz].
    pub rate_nominal: Option<f64>,
    /// From a force sent to the position that shows it, beside the tick [s].
    pub loop_delay_s: Option<f64>,
    /// Moving mass [kg].
    pub inertia: Option<f64>,
    /// Its own friction [N·s/m].
    pub damping: Option<f64>,
    /// No force without a finger on it.
    pub touch_gated: bool,
    /// Whether every packet is answered, so that its time can be the host's.
    pub can_lockstep: bool,
    /// Whether forces and positions can travel whole (f64).
    pub can_wide: bool,
}

/// Where the axes are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// [m] or [rad]
    pub position: [f64; MAX_AXES],
    /// Whether a finger is on it; true for devices that cannot know.
    pub touch: [bool; MAX_AXES],
    /// Whether the device lets forces through.
    pub force_enabled: [bool; MAX_AXES],
    /// Whether the device says that its motors are too hot.
    pub hot: bool,
    /// Whether the device says that it had heard nothing for too long and had set its forces to zero.
    pub let_go: bool,
    /// Counts replies, or echoes the request where the protocol can.
    pub seq: u32,
    /// Requests that were sent after the one that this answers.
    pub behind: u16,
    /// The device's own clock [µs], wrapping.
    pub t_dev_us: Option<u32>,
    /// Whether this came with the latest `receive`.
    pub fresh: bool,
}

/// The device no longer answers to its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Gone {
    /// The port or socket was closed under us.
    #[error("the device was unplugged, or its program ended")]
    Closed,
    /// In lockstep a reply did not come.
    #[error("the device no longer answers")]
    Silent,
    /// It answers requests that are not ours.
    #[error("another program sends forces to the device")]
    Shared,
    /// The system refused; its error number.
    #[error("the port failed (error {0})")]
    System(i32),
}

/// A device. `send` and `receive` neither allocate nor lock.
pub trait Device: Send {
    /// What it is.
    fn spec(&self) -> &Spec;

    /// Least and greatest position of an axis, where it is known closer than [`Spec::pos_range`].
    fn range(&self, _axis: usize) -> [f64; 2] {
        self.spec().pos_range
    }

    /// Send a force for every axis.
    ///
    /// # Errors
    /// [`Gone`] when there is nobody to send it to.
    fn send(&mut self, force: &SafeForce) -> Result<(), Gone>;

    /// The forces as the wire carries them: those of the packet that [`Device::send`] makes [N] or [N·m].
    fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
        let mut carried = [0.0; MAX_AXES];
        carried[..force.newtons().len()].copy_from_slice(force.newtons());
        carried
    }

    /// Take the newest reply; says whether there was a new one. Waits for one until `deadline` (a past one: not at
    /// all); in lockstep for the reply to what was sent last, whatever the deadline. The first time, before anything
    /// is sent, it gives where the axes are by themselves.
    ///
    /// # Errors
    /// [`Gone`] when no reply will come any more.
    fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone>;

    /// Whether every reply is waited for: the device's time is then the host's.
    fn in_lockstep(&self) -> bool;

    /// Send zero forces; never fails, for there is nothing left to do if it does.
    fn zero(&mut self);

    /// What the wire did so far.
    fn stats(&self) -> Stats {
        Stats::default()
    }

    /// How a signal handler or a dying process can still send zero forces.
    fn last_resort(&self) -> Option<LastResort> {
        None
    }
}

/// What holds a device is one.
macro_rules! devices {
    ($($holder:ty $(, $d:ident)?;)*) => {$(
        impl$(<$d: Device + ?Sized>)? Device for $holder {
            fn spec(&self) -> &Spec {
                (**self).spec()
            }
            fn range(&self, axis: usize) -> [f64; 2] {
                (**self).range(axis)
            }
            fn send(&mut self, force: &SafeForce) -> Result<(), Gone> {
                (**self).send(force)
            }
            fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
                (**self).on_wire(force)
            }
            fn receive(&mut self, into: &mut Sample, deadline: Instant) -> Result<bool, Gone> {
                (**self).receive(into, deadline)
            }
            fn in_lockstep(&self) -> bool {
                (**self).in_lockstep()
            }
            fn zero(&mut self) {
                (**self).zero();
            }
            fn stats(&self) -> Stats {
                (**self).stats()
            }
            fn last_resort(&self) -> Option<LastResort> {
                (**self).last_resort()
            }
        }
    )*};
}

devices! {
    Box<dyn Device>;
    &mut D, D;
}

/// A packet of zero forces and the file descriptor it goes to.
#[derive(Clone, Copy, Debug)]
pub struct LastResort {
    /// Open as long as the device is.
    pub fd: i32,
    /// The packet.
    pub bytes: [u8; 64],
    /// How many of the bytes.
    pub len: usize,
}

impl LastResort {
    pub(crate) fn new(fd: i32, packet: &[u8]) -> Self {
        let mut bytes = [0; 64];
        bytes[..packet.len()].copy_from_slice(packet);
        Self {
            fd,
            bytes,
            len: packet.len(),
        }
    }
}
