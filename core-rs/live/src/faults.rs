//! How soon a force ends after a fault: each fault is made on an emulated device, in virtual time.
//!
//! [`measure`] runs the real drivers, the real wire bytes, the emulators' firmware and every stage of `safety`. Nothing
//! waits for a clock: host, board and guardian are given the time, so the figures are the same on every machine.

mod experiment;
mod line;
mod world;

use std::time::Duration;

use crate::device::{DeviceError, DeviceKind};
use crate::emulate::Protocol;

/// Period of the host's ticks.
const PERIOD: Duration = Duration::from_millis(1);
/// How long the host is stopped, if that is the fault.
const HOST_STALL: Duration = Duration::from_secs(2);
/// How long the board is stopped, if that is the fault.
const BOARD_STALL: Duration = Duration::from_millis(100);

/// A fault that is made on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The piece asks for a force that is not a number.
    NotANumber,
    /// The piece asks for an infinite force.
    Infinite,
    /// The piece asks for 1e300 N for half a second, then for nothing.
    Huge,
    /// The board receives requests, but none of its replies arrive.
    NoReplies,
    /// The host does nothing for two seconds: it is stopped, or killed.
    HostStalled,
    /// The host continues after two seconds.
    HostResumed,
    /// The board does nothing for a tenth of a second, and its motor keeps its force.
    BoardStalled,
    /// The motor begins to push in the opposite direction of its command.
    WrongWay,
    /// The sensor begins to show the same position for ever.
    Frozen,
    /// The motor keeps its force, whatever is sent.
    MotorStuck,
    /// The reported position drifts away by 0.5 m/s.
    SensorDrifts,
    /// The reported positions are ten times too great from now on.
    SensorScaled,
    /// The reported positions jump by 20 mm and stay off by that.
    SensorOffset,
    /// The device reports a part of its travel, and the key leaves it.
    WrongTravel,
    /// The motor pushes the wrong way, and nobody has calibrated the device: its direction is tested before the first
    /// note.
    Uncalibrated,
    /// A second program opens the device.
    OpenedTwice,
    /// Another program sends requests on the same line.
    SharedLine,
    /// The port disappears.
    Unplugged,
    /// The bytes that come from the board are random.
    GarbageReplies,
    /// The bytes that go to the board are random.
    GarbageRequests,
}

/// An emulated device that faults are made on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emulator {
    /// A key in the process of the host.
    InProcess,
    /// A board that speaks a protocol.
    Board(Protocol),
}

/// How the force ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultOutcome {
    /// It was zero this long after the fault [s].
    Zero(f64),
    /// It did not end while the fault lasted.
    Persists,
    /// The fault cannot happen to this device, or is measured elsewhere; the reason.
    Excluded(&'static str),
}

/// The result of one fault on one device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultMeasurement {
    /// The fault.
    pub fault: Fault,
    /// The device.
    pub emulator: Emulator,
    /// How the force ended.
    pub outcome: FaultOutcome,
    /// Time within which the force must be zero [s]; or the reason for which nothing is promised.
    pub time_limit: Result<f64, &'static str>,
    /// Greatest force of the motor from the fault on, and the greatest that is allowed [N].
    pub peak_force_and_limit: [f64; 2],
    /// Fastest growth of the force from the fault on, and the fastest that is allowed [N/ms].
    pub force_rise_and_limit: [f64; 2],
    /// The most that the motor of a board has done on its key by any moment [J]; zero for a key in the host's process.
    pub work_max: f64,
}

impl Fault {
    /// All faults, in the order of the table.
    pub const ALL: &[Self] = &[
        Self::NotANumber,
        Self::Infinite,
        Self::Huge,
        Self::NoReplies,
        Self::HostStalled,
        Self::HostResumed,
        Self::BoardStalled,
        Self::WrongWay,
        Self::Frozen,
        Self::MotorStuck,
        Self::SensorDrifts,
        Self::SensorScaled,
        Self::SensorOffset,
        Self::WrongTravel,
        Self::Uncalibrated,
        Self::OpenedTwice,
        Self::SharedLine,
        Self::Unplugged,
        Self::GarbageReplies,
        Self::GarbageRequests,
    ];

    /// The fault in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotANumber => "the piece asks for NaN",
            Self::Infinite => "the piece asks for an infinite force",
            Self::Huge => "the piece asks for 1e300 N, then for none",
            Self::NoReplies => "no reply arrives: positions are stale",
            Self::HostStalled => "the host stalls for 2 s, or is killed: the watchdog",
            Self::HostResumed => "the host resumes after 2 s",
            Self::BoardStalled => "the board stalls for 100 ms",
            Self::WrongWay => "the motor changes its direction",
            Self::Frozen => "the sensor freezes",
            Self::MotorStuck => "the motor keeps its force, whatever is sent",
            Self::SensorDrifts => "the position drifts by 0.5 m/s",
            Self::SensorScaled => "positions are ten times too great",
            Self::SensorOffset => "positions are off by 20 mm",
            Self::WrongTravel => "the reported travel is too small",
            Self::Uncalibrated => "wired the wrong way, never calibrated",
            Self::OpenedTwice => "a second program opens the device",
            Self::SharedLine => "another program sends on the same line",
            Self::Unplugged => "the port disappears",
            Self::GarbageReplies => "garbage comes from the board",
            Self::GarbageRequests => "garbage goes to the board",
        }
    }

    /// Whether the force must stay zero to the end of the measurement; otherwise its first zero counts.
    fn persists(self) -> bool {
        !matches!(self, Self::HostStalled | Self::BoardStalled)
    }

    /// Time within which the force must be zero [s].
    fn time_limit(self, emulator: Emulator) -> Result<f64, &'static str> {
        let is_firefader = emulator == Emulator::Board(Protocol::FireFader);
        Ok(match self {
            Self::NotANumber | Self::Infinite => 1e-3,
            // Five ticks of the slew limit, and the pulses of a test: 24 ticks.
            Self::Huge => 32e-3,
            Self::GarbageReplies | Self::GarbageRequests if is_firefader => {
                return Err("its packets have no checksum");
            }
            Self::WrongTravel if is_firefader => {
                return Err("the work that it may do keeps the key within so small a travel");
            }
            // 20 ms, and the ticks at its beginning and end.
            Self::NoReplies | Self::GarbageReplies => 22e-3,
            Self::HostStalled | Self::Unplugged | Self::GarbageRequests => 51e-3,
            Self::HostResumed => 0.0,
            Self::BoardStalled => 101e-3,
            Self::WrongWay | Self::Frozen | Self::MotorStuck if is_firefader => {
                return Err("a sensor this coarse is not judged");
            }
            // 0.2 s for which an answer counts, and 1.25 s without one.
            Self::WrongWay | Self::MotorStuck => 1.45,
            // A right response may be 0.2 s old, then two tests of 56 ms after one under way.
            Self::Frozen => 0.4,
            // The travel with its margins, at a speed that the hand and the piece may halve.
            Self::SensorDrifts => 0.45,
            Self::SensorScaled => 0.1,
            // The next packet is zero.
            Self::SensorOffset => 1e-3,
            // The key is driven out of the travel by the greatest force.
            Self::WrongTravel => 0.05,
            // Two pulses of 125 ms, and a rest of at most a second before each.
            Self::Uncalibrated => 2.25,
            Self::OpenedTwice => 0.0,
            // More than 32 ticks until the line counts as shared.
            Self::SharedLine => 0.04,
        })
    }

    /// Why a fault is not made on a device, if it is excluded.
    fn exclusion_reason(self, emulator: Emulator) -> Option<&'static str> {
        use Emulator::{Board, InProcess};
        const NO_WIRE_REASON: &str = "there is no wire";
        match (self, emulator) {
            (Self::HostStalled | Self::HostResumed | Self::BoardStalled, InProcess) => Some("its time is the host's"),
            (
                Self::OpenedTwice | Self::SharedLine | Self::Unplugged | Self::GarbageReplies | Self::GarbageRequests,
                InProcess,
            ) => Some(NO_WIRE_REASON),
            (Self::MotorStuck, Board(Protocol::Haply)) => Some("its service cannot switch motors off"),
            (Self::OpenedTwice, Board(Protocol::FireFader)) => Some("the system locks a serial port"),
            (Self::OpenedTwice | Self::SharedLine, Board(Protocol::Haply)) => {
                Some("its service serves several programs")
            }
            (Self::Unplugged | Self::GarbageRequests, Board(Protocol::Haply)) => {
                Some("its service and a WebSocket stand between: python -m benches haply")
            }
            (Self::SharedLine, Board(Protocol::FireFader)) => Some("the protocol has no numbers that would tell"),
            _ => None,
        }
    }
}

impl Emulator {
    /// All emulated devices.
    pub const ALL: &[Self] = &[
        Self::InProcess,
        Self::Board(Protocol::Frame),
        Self::Board(Protocol::FireFader),
        Self::Board(Protocol::Haply),
    ];

    /// Its name in a URL.
    pub fn name(self) -> &'static str {
        self.kind().name()
    }

    fn kind(self) -> DeviceKind {
        match self {
            Self::InProcess => DeviceKind::Emul,
            Self::Board(protocol) => protocol.into(),
        }
    }
}

impl FaultMeasurement {
    /// Whether a promise is broken: the force lasted longer, was greater or grew faster than allowed.
    pub fn exceeds(&self) -> bool {
        let is_late = match (self.outcome, self.time_limit) {
            (FaultOutcome::Excluded(_), _) | (_, Err(_)) => return false,
            (FaultOutcome::Zero(seconds), Ok(bound)) => seconds > bound + 1e-9,
            (FaultOutcome::Persists, Ok(_)) => true,
        };
        let is_above = |[measured, limit]: [f64; 2]| measured > limit * (1.0 + 1e-12);
        is_late || is_above(self.peak_force_and_limit) || is_above(self.force_rise_and_limit)
    }
}

/// Make every fault on every emulated device, one after the other; takes some seconds.
///
/// # Errors
/// [`DeviceError`] if an emulator does not answer its own driver.
pub fn measure() -> Result<Vec<FaultMeasurement>, DeviceError> {
    let measure_fault = |&fault| {
        (Emulator::ALL.iter())
            .map(move |&emulator| experiment::measure(experiment::RequestedForce::Guide, true, fault, emulator))
    };
    Fault::ALL.iter().flat_map(measure_fault).collect()
}

#[cfg(test)]
mod tests;
