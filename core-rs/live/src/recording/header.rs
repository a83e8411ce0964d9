//! The header of a recording: rate, axes and description.

use std::collections::HashSet;

use super::RecordingError;
use super::chunk::PAYLOAD_MAX;

const AXES_MAX: usize = 64;
const NAME_BYTES_MAX: usize = 200;
/// Greatest size of the description; the rest of a header chunk is enough for the axes' names.
const ABOUT_BYTES_MAX: usize = PAYLOAD_MAX / 2;
const RATE_MAX: f64 = 2e6;

/// One degree of freedom of a device, played by one hand.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordedAxis {
    /// Name of the player.
    pub player: String,
    /// The key of the score that the hand is on; may be empty.
    pub key: String,
}

/// The header, which says how to interpret the rows.
///
/// ```
/// use ergon_live::recording::{RecordedAxis, Header};
///
/// let header = Header { rate: 44_100.0, frames: 44, axes: vec![RecordedAxis::default()], about: "{}".to_owned() };
/// header.check()?;
/// assert!((header.tick_rate() - 1002.3).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Audio rate [Hz].
    pub rate: f64,
    /// Audio frames per tick: tick k begins with audio frame k·frames.
    pub frames: u32,
    /// 1 to 64 axes.
    pub axes: Vec<RecordedAxis>,
    /// Further information as JSON, by the recording program: score, devices, calibration, date.
    pub about: String,
}

impl Header {
    /// Check that all values are possible.
    pub fn check(&self) -> Result<(), RecordingError> {
        let has_long_name = |axis: &RecordedAxis| axis.player.len().max(axis.key.len()) > NAME_BYTES_MAX;
        let error_text = if !(self.rate > 0.0 && self.rate <= RATE_MAX) {
            "the audio rate must be above 0 and at most 2 MHz"
        } else if self.frames == 0 || f64::from(self.frames) > RATE_MAX {
            "a tick must have 1 to 2,000,000 frames"
        } else if self.axes.is_empty() || self.axes.len() > AXES_MAX {
            "there must be 1 to 64 axes"
        } else if self.axes.iter().any(has_long_name) {
            "a name must have at most 200 bytes"
        } else if self.about.len() > ABOUT_BYTES_MAX {
            "the description must have at most 512 KiB"
        } else {
            return Ok(());
        };
        Err(RecordingError::Header(error_text))
    }

    /// Rows per second [Hz].
    pub fn tick_rate(&self) -> f64 {
        self.rate / f64::from(self.frames)
    }

    /// A distinct name for each axis: that of its player, followed by the key's if the player has several axes; or
    /// numbers from 1.
    pub fn names(&self) -> Vec<String> {
        let has_several_axes = |player: &str| self.axes.iter().filter(|a| a.player == player).count() > 1;
        let axis_names: Vec<String> = self
            .axes
            .iter()
            .map(|axis| match (&*axis.player, &*axis.key) {
                ("", key) => key.to_owned(),
                (player, key) if has_several_axes(player) => format!("{player}.{key}"),
                (player, _) => player.to_owned(),
            })
            .collect();
        let distinct_names: HashSet<&String> = axis_names.iter().collect();
        if distinct_names.len() < axis_names.len() || axis_names.iter().any(String::is_empty) {
            return (1..=axis_names.len()).map(|i| i.to_string()).collect();
        }
        axis_names
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let mut header_bytes = Vec::new();
        header_bytes.extend_from_slice(&self.rate.to_le_bytes());
        header_bytes.extend_from_slice(&self.frames.to_le_bytes());
        header_bytes.extend_from_slice(&(self.axes.len() as u32).to_le_bytes());
        for name in self.axes.iter().flat_map(|axis| [&axis.player, &axis.key]) {
            header_bytes.extend_from_slice(&(name.len() as u16).to_le_bytes());
            header_bytes.extend_from_slice(name.as_bytes());
        }
        header_bytes.extend_from_slice(self.about.as_bytes());
        header_bytes
    }

    /// The header of a payload; `None` if it is not a valid header.
    pub(super) fn decode(payload: &[u8]) -> Option<Self> {
        let (rate_bytes, bytes_left) = payload.split_first_chunk::<8>()?;
        let (frame_bytes, bytes_left) = bytes_left.split_first_chunk::<4>()?;
        let (n_axes, mut bytes_left) = bytes_left.split_first_chunk::<4>()?;
        let n_axes = u32::from_le_bytes(*n_axes) as usize;
        if n_axes > AXES_MAX {
            return None;
        }
        let mut next_name = || {
            let (length_bytes, bytes_after) = bytes_left.split_first_chunk::<2>()?;
            let (name_bytes, bytes_after) = bytes_after.split_at_checked(u16::from_le_bytes(*length_bytes).into())?;
            bytes_left = bytes_after;
            String::from_utf8(name_bytes.to_vec()).ok()
        };
        let axes = (0..n_axes)
            .map(|_| {
                Some(RecordedAxis {
                    player: next_name()?,
                    key: next_name()?,
                })
            })
            .collect::<Option<_>>()?;
        let header = Self {
            rate: f64::from_le_bytes(*rate_bytes),
            frames: u32::from_le_bytes(*frame_bytes),
            axes,
            about: String::from_utf8(bytes_left.to_vec()).ok()?,
        };
        header.check().ok()?;
        Some(header)
    }
}
