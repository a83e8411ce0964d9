//! Force-feedback devices: forces go out, positions come back.
//!
//! There is one driver for each protocol; each implements [`Device`]. Signs and scales of the individual device are
//! corrected by [`calibrate`].

mod arm;
pub mod calibrate;
mod emulated;
mod firefader;
mod frame;
pub(crate) mod haply;
#[cfg(unix)]
mod lock;
mod pointer_device;
mod port;
pub mod ports;
mod url;
mod wait_canceller;

pub use crate::safety::contract::{
    Device, DeviceLoss, DeviceSample, DeviceSpec, DurationHistogram, Unit, WireStats, ZeroForcePacket,
};
pub use crate::wire::MAX_AXES;
pub use emulated::{EmulatedDevice, open_board};
pub use haply::guardian;
pub(crate) use port::InProcessPort;
pub use url::{DeviceKind, DeviceUrl, UrlError};
pub use wait_canceller::WaitCanceller;

use std::time::Duration;

/// Longest wait for the first reply: a board that restarts when its port is opened needs two seconds.
const FIRST_REPLY_TIMEOUT: Duration = Duration::from_secs(4);
/// Time between two requests until the first reply.
const REQUEST_RETRY_INTERVAL: Duration = Duration::from_millis(50);
/// Wait in lockstep after which a silent device counts as gone: there a late reply is not an error by itself.
const LOCKSTEP_TIMEOUT: Duration = Duration::from_secs(2);

/// The error for an axis that the device does not have.
pub(crate) const NO_SUCH_AXIS: &str = "the device has no such axis (axes count from 0)";

/// Why a device could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The port or address could not be opened.
    #[error("{url}: {reason}")]
    NotOpened {
        /// The URL.
        url: String,
        /// The reason, e.g. the system's error.
        reason: String,
    },
    /// The port or address was opened, but nothing there speaks the protocol.
    #[error("{url}: no {kind} answers there")]
    NoAnswer {
        /// The URL.
        url: String,
        /// The protocol.
        kind: &'static str,
    },
    /// The device answers and describes itself by impossible numbers.
    #[error("{url}: {reason}")]
    Impossible {
        /// The URL.
        url: String,
        /// The number, and what it has to be.
        reason: String,
    },
    /// The device answers but cannot do this.
    #[error("{url}: {what}")]
    Unsupported {
        /// The URL.
        url: String,
        /// What it cannot do.
        what: &'static str,
    },
}

/// Open the device at `url` and wait until it answers.
///
/// # Errors
/// [`DeviceError`] says what is missing, or what the device cannot do.
pub fn open(url: &DeviceUrl) -> Result<Box<dyn Device>, DeviceError> {
    open_until(url, &WaitCanceller::default())
}

/// As [`open`], but `canceller` ends the wait, and later ends the waits of the device for replies.
///
/// # Errors
/// As for [`open`].
pub fn open_until(url: &DeviceUrl, canceller: &WaitCanceller) -> Result<Box<dyn Device>, DeviceError> {
    let device: Box<dyn Device> = match url.kind {
        DeviceKind::FireFader => Box::new(firefader::FireFader::open(url, canceller)?),
        DeviceKind::Frame | DeviceKind::FrameUdp => Box::new(frame::OpenFrameDevice::open(url, canceller)?),
        DeviceKind::Haply => Box::new(haply::HaplyDevice::open(url, canceller)?),
        DeviceKind::Emul => Box::new(EmulatedDevice::open(url)?),
        DeviceKind::Pointer => return Err(url.unsupported_error("a key that is played without a device has no motor")),
    };
    if url.axis.is_some_and(|axis| axis >= device.spec().dof) {
        return Err(url.unsupported_error(NO_SUCH_AXIS));
    }
    arm::with_arm(device, url)
}

/// Open the key that a stream of positions plays, in ticks of `period` [s]. With `is_retry` it is opened only while
/// somebody plays it; a performance may begin without.
///
/// # Errors
/// [`DeviceError`] if nothing leads it, or nobody plays it now.
pub fn open_pointer(url: &DeviceUrl, period: f64, is_retry: bool) -> Result<Box<dyn Device>, DeviceError> {
    Ok(Box::new(pointer_device::PointerDevice::open(url, period, is_retry)?))
}

/// The driver of a kind of device for a board that is emulated inside this process.
///
/// # Errors
/// [`DeviceError`] if the board does not answer, or if this kind cannot be emulated inside the process.
pub(crate) fn open_in_process(
    kind: DeviceKind,
    board: Box<dyn InProcessPort>,
    lockstep: bool,
) -> Result<Box<dyn Device>, DeviceError> {
    let mut board_url = DeviceUrl::in_process(kind);
    board_url.lockstep = lockstep;
    let (board_port, canceller) = (port::Port::InProcess(board), WaitCanceller::default());
    Ok(match kind {
        DeviceKind::Frame => Box::new(frame::OpenFrameDevice::on_port(board_port, &board_url, &canceller)?),
        DeviceKind::FireFader => Box::new(firefader::FireFader::on_port(board_port, &board_url, &canceller)?),
        _ => {
            return Err(board_url.unsupported_error("this kind of device cannot be emulated inside the process"));
        }
    })
}

/// Tests the lock of devices on UDP, as far as this system has one: whether it can be taken a second time. It takes the
/// lock of an address that no board has, twice.
#[cfg(unix)]
pub(crate) fn second_opening_is_refused() -> bool {
    let unused_address = std::net::SocketAddr::from(([127, 0, 0, 1], 1));
    // If another process holds the lock now, both calls fail, and the result is the same.
    let _first = lock::DeviceLock::take(unused_address);
    lock::DeviceLock::take(unused_address).is_err()
}

/// There is no such lock on this system.
#[cfg(not(unix))]
pub(crate) fn second_opening_is_refused() -> bool {
    false
}
