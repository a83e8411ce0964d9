//! Force-feedback keys: forces go out, positions come back.
//!
//! A driver for each protocol; each is a [`Device`]. What a device itself does with signs and scales is [`calibrate`]d.

pub mod calibrate;
mod emulated;
mod ending;
mod firefader;
mod frame;
pub(crate) mod haply;
#[cfg(unix)]
mod lock;
mod port;
pub mod ports;
mod url;

pub use crate::safety::contract::{Device, Gone, Histogram, LastResort, Sample, Spec, Stats, Unit};
pub use crate::wire::MAX_AXES;
pub use emulated::{Emulated, open_board};
pub use ending::Ending;
pub use haply::guardian;
pub(crate) use port::InProcess;
pub use url::{Kind, Url, UrlError};

use std::time::Duration;

/// How long a device may take to answer for the first time: a board that restarts when its port is opened needs two
/// seconds.
const FIRST_REPLY: Duration = Duration::from_secs(4);
/// How often it is asked meanwhile.
const ASK_AGAIN: Duration = Duration::from_millis(50);
/// In lockstep nobody is late; a device silent for so long is gone.
const LOCKSTEP_PATIENCE: Duration = Duration::from_secs(2);

/// What a device says to an axis that it does not have.
pub(crate) const NO_AXIS: &str = "the device has no such axis (axes count from 0)";

/// A device that could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The port or address could not be opened.
    #[error("{url}: {reason}")]
    Closed {
        /// As it was asked for.
        url: String,
        /// What the system says.
        reason: String,
    },
    /// It was opened, and nothing there speaks the protocol.
    #[error("{url}: no {kind} answers there")]
    NoAnswer {
        /// As it was asked for.
        url: String,
        /// The protocol.
        kind: &'static str,
    },
    /// It answers, and cannot do this.
    #[error("{url}: {what}")]
    Cannot {
        /// As it was asked for.
        url: String,
        /// What it cannot do.
        what: &'static str,
    },
}

/// Open the device at `url` and wait until it answers.
///
/// # Errors
/// [`DeviceError`] says what is not there, or what it cannot do.
pub fn open(url: &Url) -> Result<Box<dyn Device>, DeviceError> {
    open_until(url, &Ending::default())
}

/// As [`open`], until nobody waits for the device any more; nor does the device then wait for replies.
///
/// # Errors
/// As of [`open`].
pub fn open_until(url: &Url, ending: &Ending) -> Result<Box<dyn Device>, DeviceError> {
    let device: Box<dyn Device> = match url.kind {
        Kind::FireFader => Box::new(firefader::FireFader::open(url, ending)?),
        Kind::Frame | Kind::FrameUdp => Box::new(frame::Frame::open(url, ending)?),
        Kind::Haply => Box::new(haply::Haply::open(url, ending)?),
        Kind::Emul => Box::new(Emulated::open(url)?),
    };
    if url.axis.is_some_and(|axis| axis >= device.spec().dof) {
        return Err(url.cannot(NO_AXIS));
    }
    Ok(device)
}

/// The driver of a kind of device whose wire ends in this process.
///
/// # Errors
/// [`DeviceError`] where nobody answers there, or the kind has no such wire.
pub(crate) fn open_in_process(
    kind: Kind,
    board: Box<dyn InProcess>,
    lockstep: bool,
) -> Result<Box<dyn Device>, DeviceError> {
    let mut url = Url::in_process(kind);
    url.lockstep = lockstep;
    let (port, ending) = (port::Port::InProcess(board), Ending::default());
    Ok(match kind {
        Kind::Frame => Box::new(frame::Frame::over(port, &url, &ending)?),
        Kind::FireFader => Box::new(firefader::FireFader::over(port, &url, &ending)?),
        _ => return Err(url.cannot("this kind of device cannot be emulated inside the process")),
    })
}

/// Whether a second program that opens a board in datagrams is refused, as far as this system lets it be: the lock of
/// an address that no board has is taken twice.
#[cfg(unix)]
pub(crate) fn second_opening_is_refused() -> bool {
    let nobody = std::net::SocketAddr::from(([127, 0, 0, 1], 1));
    // Where somebody else tries the same now, the first is refused as well.
    let _first = lock::DeviceLock::take(nobody);
    lock::DeviceLock::take(nobody).is_err()
}

/// This system has no such lock.
#[cfg(not(unix))]
pub(crate) fn second_opening_is_refused() -> bool {
    false
}
