//! The argument of `--audio`: the sound output.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use super::AudioError;

/// A sound backend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Backend {
    /// JACK if a server runs, else PulseAudio or PipeWire, else the silent clock.
    Auto,
    /// A JACK server, or PipeWire in its place.
    Jack,
    /// A PulseAudio server, or PipeWire in its place.
    Pulse,
    /// The sound system of macOS or Windows.
    System,
    /// A WAVE file, as fast as the frames come.
    File(PathBuf),
    /// A WAVE file by the clock, as a card would take the frames.
    RealTimeFile(PathBuf),
    /// No sound, by the clock.
    NullRealTime,
    /// No sound, as fast as the frames come.
    NullUnpaced,
}

/// A backend and its options.
///
/// ```
/// use ergon_live::audio::AudioSpec;
///
/// let spec: AudioSpec = "jack:system:playback_*,channels=4".parse()?;
/// assert_eq!((spec.target.as_deref(), spec.channels), (Some("system:playback_*"), Some(4)));
/// assert!("jackal".parse::<AudioSpec>().is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AudioSpec {
    /// The backend.
    pub backend: Backend,
    /// Pulse: the name of the sink. JACK: a pattern for the names of the ports to connect to, or `none`. System: the
    /// name of the device.
    pub target: Option<String>,
    /// Frames per block, if the backend can set it.
    pub block: Option<u32>,
    /// Number of channels to play, if it differs from the score's.
    pub channels: Option<usize>,
}

/// Syntax of the text.
pub const USAGE: &str = "auto, jack[:PORTS], pulse[:SINK], system[:DEVICE] (macOS, Windows), file:PATH, clock:PATH (a file, in real time), \
     null or null:fast; then ,block=FRAMES and ,channels=N where wanted";

impl AudioSpec {
    /// A backend without options.
    #[must_use]
    pub fn without_options(backend: Backend) -> Self {
        Self {
            backend,
            target: None,
            block: None,
            channels: None,
        }
    }
}

impl FromStr for AudioSpec {
    type Err = AudioError;

    fn from_str(text: &str) -> Result<Self, AudioError> {
        let mut new_spec = Self::without_options(Backend::Auto);
        let mut spec_head = text.trim();
        // A path may contain commas: only known options are split off at its end.
        while let Some((text_before, option)) = spec_head.rsplit_once(',') {
            let Some((option_name, value)) = option.split_once('=') else {
                break;
            };
            let number = || match value.trim().parse() {
                Ok(number @ 1..=1_048_576) => Ok(number),
                _ => Err(spec_error(
                    text,
                    format!("{option_name}={value} is not a number of frames or channels"),
                )),
            };
            match option_name.trim() {
                "block" => new_spec.block = Some(number()?),
                "channels" => new_spec.channels = Some(number()? as usize),
                _ => break,
            }
            spec_head = text_before;
        }
        let (word, target) = match spec_head.split_once(':') {
            Some((word, target)) => (word, Some(target)),
            None => (spec_head, None),
        };
        let target = target.filter(|target| !target.is_empty());
        new_spec.backend = match (word, target) {
            ("auto", None) => Backend::Auto,
            ("jack", _) => Backend::Jack,
            ("pulse", _) => Backend::Pulse,
            ("system", _) => Backend::System,
            ("null", None) => Backend::NullRealTime,
            ("null", Some("fast")) => Backend::NullUnpaced,
            ("file", Some(path)) => Backend::File(path.into()),
            ("clock", Some(path)) => Backend::RealTimeFile(path.into()),
            ("file", None) => {
                return Err(spec_error(text, "a file needs a path: file:PATH".into()));
            }
            _ => return Err(spec_error(text, "no such output".into())),
        };
        if matches!(new_spec.backend, Backend::Jack | Backend::Pulse | Backend::System) {
            new_spec.target = target.map(str::to_owned);
        }
        Ok(new_spec)
    }
}

fn spec_error(text: &str, reason: String) -> AudioError {
    AudioError::Spec {
        text: text.to_owned(),
        reason,
    }
}

impl fmt::Display for AudioSpec {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let backend_name = match &self.backend {
            Backend::Auto => "auto",
            Backend::Jack => "jack",
            Backend::Pulse => "pulse",
            Backend::System => "system",
            Backend::File(path) => return write!(formatter, "file:{}", path.display()),
            Backend::RealTimeFile(path) => return write!(formatter, "clock:{}", path.display()),
            Backend::NullRealTime => "null",
            Backend::NullUnpaced => "null:fast",
        };
        formatter.write_str(backend_name)?;
        match &self.target {
            Some(target) => write!(formatter, ":{target}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_with_device_and_options() {
        let spec: AudioSpec = "pulse:dome,block=512,channels=24".parse().expect("is one");
        assert_eq!(spec.backend, Backend::Pulse);
        assert_eq!(spec.target.as_deref(), Some("dome"));
        assert_eq!((spec.block, spec.channels), (Some(512), Some(24)));
        let spec: AudioSpec = "jack:system:playback_".parse().expect("is one");
        assert_eq!(spec.target.as_deref(), Some("system:playback_"));
    }

    #[test]
    fn spec_of_a_path_with_commas() {
        let spec: AudioSpec = "file:a,b=c.wav,block=64".parse().expect("is one");
        assert_eq!(spec.backend, Backend::File("a,b=c.wav".into()));
        assert_eq!(spec.block, Some(64));
    }

    #[test]
    fn spec_with_unknown_names_is_refused() {
        for text in [
            "",
            "alsa",
            "file:",
            "clock",
            "auto:x",
            "null:slow",
            "jack,block=0",
            "jack,black=2",
        ] {
            assert!(text.parse::<AudioSpec>().is_err(), "{text}");
        }
    }
}
