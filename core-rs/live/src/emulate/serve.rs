//! Serving an emulated device until its time is over.

use std::time::{Duration, Instant};

use ergon_engine::key_model::KeyModel;
use ergon_engine::network::Network;
use ergon_engine::simulation::{EmulatedKey, KeyMotor};
use ergon_engine::units::Rate;

use super::firmware::{BoardConfig, Firmware};
use super::line::{HostLine, LineEvent, Transport};
use super::{EmulateError, EmulatedHand, EmulatedKeys, KeyConstants};

/// Time between two calls of `should_continue`.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Longest message that is read [bytes].
const MESSAGE_BYTES_MAX: usize = 64 * 1024;

/// Description of a device to emulate.
#[derive(Clone, Debug)]
pub struct EmulationOptions {
    /// Its board.
    pub board: BoardConfig,
    /// Its transport.
    pub transport: Transport,
    /// Number of keys.
    pub axes: usize,
    /// The constants of its keys.
    pub key: KeyConstants,
    /// The model by which the keys move, if they are not CELs.
    pub model: Option<KeyModel>,
    /// The network by which the keys move instead, as the key of a score, the MAT that takes the forces, and its motor.
    pub network: Option<(Network, usize, KeyMotor)>,
    /// Rate of the periods [Hz].
    pub rate: f64,
    /// Hands on the keys; keys beyond the end are free.
    pub hands: Vec<EmulatedHand>,
    /// Duration [s]: in lockstep in the keys' own time, else in wall time.
    pub seconds: Option<f64>,
    /// Whether it ends when the host has gone.
    pub ends_with_host: bool,
}

impl EmulationOptions {
    /// A running board with these options.
    ///
    /// # Errors
    /// [`EmulateError`] if the keys are impossible.
    pub fn firmware(&self) -> Result<Firmware, EmulateError> {
        let mut emulated_keys = EmulatedKeys::new(self.axes, self.key, self.rate, self.hands.clone())?;
        if let Some(model) = &self.model {
            emulated_keys = emulated_keys.with_model(model)?;
        }
        if let Some((network, struck_mat, motor)) = &self.network {
            let period_rate = Rate::new(self.rate)?;
            emulated_keys = emulated_keys.with_network(EmulatedKey::new(network, *struck_mat, period_rate, *motor)?);
        }
        Ok(Firmware::new(self.board, emulated_keys))
    }
}

/// What happens while the device is served.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ServeEvent {
    /// A host can open this address.
    Ready(String),
    /// The host was silent for too long; the force is zero.
    LetGo,
    /// The host has hung up.
    HostGone,
}

/// The result of serving a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServeSummary {
    /// Number of periods of the keys.
    pub periods: u64,
    /// Number of packets of forces.
    pub packets: u64,
    /// Hash of all positions.
    pub hash: u64,
}

/// Serve until `seconds` are over, `should_continue` (called every 50 ms) returns false, or the host has gone and
/// `ends_with_host` is set.
///
/// # Errors
/// [`EmulateError`] if the device is impossible, or no port could be opened.
pub fn serve(
    options: EmulationOptions,
    on_event: &mut dyn FnMut(ServeEvent),
    should_continue: &mut dyn FnMut() -> bool,
) -> Result<ServeSummary, EmulateError> {
    let lockstep = options.board.lockstep;
    let mut firmware = options.firmware()?;
    let period_rate = firmware.keys().rate().hertz();
    let mut host_line = HostLine::open(options.transport)?;
    on_event(ServeEvent::Ready(host_line.address()?));
    let mut message_buffer = vec![0; MESSAGE_BYTES_MAX];
    let start_instant = Instant::now();
    let mut last_check = start_instant;
    loop {
        let elapsed = start_instant.elapsed();
        if firmware.run_to(elapsed) {
            on_event(ServeEvent::LetGo);
            host_line.release_host();
        }
        let elapsed_seconds = if lockstep {
            firmware.keys().periods() as f64 / period_rate
        } else {
            elapsed.as_secs_f64()
        };
        if options.seconds.is_some_and(|seconds| elapsed_seconds >= seconds) {
            break;
        }
        if last_check.elapsed() >= CHECK_INTERVAL {
            last_check = Instant::now();
            if !should_continue() {
                break;
            }
        }
        let read_wait = if lockstep {
            CHECK_INTERVAL
        } else {
            Duration::from_secs_f64((firmware.next_period_time() - elapsed.as_secs_f64()).clamp(0.0, 0.02))
        };
        match host_line.read(&mut message_buffer, read_wait)? {
            LineEvent::Nothing => {}
            LineEvent::Connected => {
                if let Some(greeting) = firmware.greeting() {
                    host_line.write(greeting.as_bytes());
                }
            }
            LineEvent::Bytes(n) => {
                firmware.run_to(start_instant.elapsed());
                let write_reply = &mut |reply_bytes: &[u8]| host_line.write(reply_bytes);
                firmware.receive(&message_buffer[..n], start_instant.elapsed(), write_reply);
                if !firmware.is_host_active() {
                    host_line.release_host();
                }
            }
            LineEvent::Disconnected => {
                on_event(ServeEvent::HostGone);
                if options.ends_with_host {
                    break;
                }
            }
        }
    }
    Ok(ServeSummary {
        periods: firmware.keys().periods(),
        packets: firmware.packets(),
        hash: firmware.keys().hash(),
    })
}
