//! The contract between `safety` and the drivers of devices: forces go out, positions come back.
//!
//! Every protocol is request and reply: a packet of forces is answered with the positions of the axes. So one trait
//! serves all of them. Units are SI, and a positive force moves towards positive positions. A driver takes a
//! [`SafeForce`], which only `safety` can make; this is why the contract is in this module.

mod stats;

pub(crate) use stats::{ClockDrift, SentRequests};
pub use stats::{DurationHistogram, WireStats};

use std::time::Instant;

use super::force::SafeForce;
use crate::wire::MAX_AXES;

/// Unit of an axis's position; its force is in N or N·m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// [m]
    Metre,
    /// [rad]
    Radian,
}

/// The properties of a device, in SI units; all its axes are alike.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceSpec {
    /// Number of axes.
    pub dof: usize,
    /// Unit of positions.
    pub unit: Unit,
    /// Step of the position sensor.
    pub pos_lsb: f64,
    /// Least and greatest position.
    pub pos_range: [f64; 2],
    /// Force that the motor bears continuously.
    pub force_max_continuous: f64,
    /// Greatest force.
    pub force_max_peak: f64,
    /// Step of the force.
    pub force_lsb: f64,
    /// Exchanges per second [Hz], if the device promises a rate.
    pub rate_nominal: Option<f64>,
    /// Delay from a force sent to the position that shows its effect, in addition to the tick [s].
    pub loop_delay_s: Option<f64>,
    /// Moving mass [kg].
    pub inertia: Option<f64>,
    /// Damping of the key itself [N·s/m].
    pub damping: Option<f64>,
    /// Whether the device gives no force without a finger on the key.
    pub is_touch_gated: bool,
    /// Whether every packet is answered, so that the device can run in lockstep with the host.
    pub can_lockstep: bool,
    /// Whether forces and positions can be sent in full precision (f64).
    pub can_send_wide: bool,
}

/// The state of all axes in one reply.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceSample {
    /// [m] or [rad]
    pub position: [f64; MAX_AXES],
    /// Whether a finger is on the axis; true for devices that cannot know.
    pub is_touched: [bool; MAX_AXES],
    /// Whether the device lets forces through to the motor.
    pub is_force_enabled: [bool; MAX_AXES],
    /// Whether the device reports that its motors are too hot.
    pub is_hot: bool,
    /// Whether the device reports that it had received nothing for too long and had set its forces to zero.
    pub has_let_go: bool,
    /// Number of the reply, or of its request if the protocol echoes it.
    pub seq: u32,
    /// Number of requests that were sent after the one that this answers.
    pub requests_behind: u16,
    /// The device's own clock [µs]; it wraps.
    pub t_dev_us: Option<u32>,
    /// Whether this sample came with the latest `receive`.
    pub is_fresh: bool,
}

/// Why a device can no longer be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceLoss {
    /// The port or socket was closed by the other side.
    #[error("the device was unplugged, or its program ended")]
    Closed,
    /// In lockstep a reply did not come.
    #[error("the device no longer answers")]
    Silent,
    /// The device answers requests of another program.
    #[error("another program sends forces to the device")]
    Shared,
    /// The system reported this error number.
    #[error("the port failed (error {0})")]
    System(i32),
}

/// A device. `send` and `receive` neither allocate nor lock.
pub trait Device: Send {
    /// The properties of the device.
    fn spec(&self) -> &DeviceSpec;

    /// Least and greatest position of an axis, if they are known better than by [`DeviceSpec::pos_range`].
    fn range(&self, _axis: usize) -> [f64; 2] {
        self.spec().pos_range
    }

    /// Send a force for every axis.
    ///
    /// # Errors
    /// [`DeviceLoss`] if the device cannot receive it.
    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss>;

    /// Send zero force for every axis, and switch the motors off where the protocol can.
    ///
    /// # Errors
    /// [`DeviceLoss`] if the device cannot receive it.
    fn switch_off(&mut self) -> Result<(), DeviceLoss> {
        self.send(&SafeForce::zero(self.spec().dof))
    }

    /// The forces as rounded by the packet that [`Device::send`] makes [N] or [N·m].
    fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
        let mut wire_forces = [0.0; MAX_AXES];
        wire_forces[..force.newtons().len()].copy_from_slice(force.newtons());
        wire_forces
    }

    /// Take the newest reply; returns whether there was a new one. Waits for a reply until `deadline` (if it has
    /// passed: not at all); in lockstep waits for the reply to the latest request, whatever the deadline. The first
    /// call, before anything is sent, gives the positions of the axes without a request.
    ///
    /// # Errors
    /// [`DeviceLoss`] if no reply will come any more.
    fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss>;

    /// Whether the driver waits for every reply, so that the device's time is the host's.
    fn in_lockstep(&self) -> bool;

    /// Send zero forces; never fails, because nothing could be done about a failure.
    fn zero(&mut self);

    /// Statistics of the wire so far.
    fn stats(&self) -> WireStats {
        WireStats::default()
    }

    /// The packet with which a signal handler or a dying process can still send zero forces.
    fn zero_force_packet(&self) -> Option<ZeroForcePacket> {
        None
    }
}

/// Implements `Device` for types that hold a device.
macro_rules! devices {
    ($($holder:ty $(, $d:ident)?;)*) => {$(
        impl$(<$d: Device + ?Sized>)? Device for $holder {
            fn spec(&self) -> &DeviceSpec {
                (**self).spec()
            }
            fn range(&self, axis: usize) -> [f64; 2] {
                (**self).range(axis)
            }
            fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
                (**self).send(force)
            }
            fn switch_off(&mut self) -> Result<(), DeviceLoss> {
                (**self).switch_off()
            }
            fn on_wire(&self, force: &SafeForce) -> [f64; MAX_AXES] {
                (**self).on_wire(force)
            }
            fn receive(&mut self, sample: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
                (**self).receive(sample, deadline)
            }
            fn in_lockstep(&self) -> bool {
                (**self).in_lockstep()
            }
            fn zero(&mut self) {
                (**self).zero();
            }
            fn stats(&self) -> WireStats {
                (**self).stats()
            }
            fn zero_force_packet(&self) -> Option<ZeroForcePacket> {
                (**self).zero_force_packet()
            }
        }
    )*};
}

devices! {
    Box<dyn Device>;
    &mut D, D;
}

/// A packet of zero forces, and the file descriptor to write it to.
#[derive(Clone, Copy, Debug)]
pub struct ZeroForcePacket {
    /// File descriptor, open as long as the device is.
    pub fd: i32,
    /// The packet.
    pub bytes: [u8; 64],
    /// Length of the packet in `bytes`.
    pub len: usize,
}

impl ZeroForcePacket {
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
