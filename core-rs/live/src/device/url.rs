//! The URL of a device: `kind:where?option&option=value#axis`.

use std::fmt;

use super::DeviceError;
use crate::emulate::Protocol;

/// The protocols.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceKind {
    /// Two motor faders on a serial port.
    FireFader,
    /// The open frame (docs/open-frame.md) on a serial port.
    Frame,
    /// The open frame by UDP.
    FrameUdp,
    /// Haply's Inverse Service, by WebSocket.
    Haply,
    /// An emulated device in this process.
    Emul,
    /// A key that a stream of positions plays by a virtual finger.
    Pointer,
}

impl DeviceKind {
    /// All kinds, by their names.
    const NAMED: &[(&str, Self)] = &[
        ("firefader", Self::FireFader),
        ("frame", Self::Frame),
        ("frame+udp", Self::FrameUdp),
        ("haply", Self::Haply),
        ("emul", Self::Emul),
        ("page", Self::Pointer),
        ("keys", Self::Pointer),
        ("midi", Self::Pointer),
        ("osc", Self::Pointer),
        ("gamepad", Self::Pointer),
    ];

    /// The name with which a URL of this kind begins.
    pub(crate) fn name(self) -> &'static str {
        let named_kind = Self::NAMED.iter().find(|(_, kind)| *kind == self);
        named_kind.expect("every kind has a name").0
    }

    /// All names in a sentence.
    fn names() -> String {
        let kind_names: Vec<_> = Self::NAMED.iter().map(|(name, _)| *name).collect();
        let (last_name, other_names) = kind_names.split_last().expect("there are kinds");
        format!("{} and {last_name}", other_names.join(", "))
    }

    /// Whether the target is a serial port, whose board may have a serial number.
    pub(crate) fn is_serial(self) -> bool {
        match self {
            Self::FireFader | Self::Frame => true,
            Self::FrameUdp | Self::Haply | Self::Emul | Self::Pointer => false,
        }
    }
}

/// The driver for an emulated board.
impl From<Protocol> for DeviceKind {
    fn from(protocol: Protocol) -> Self {
        match protocol {
            Protocol::FireFader => Self::FireFader,
            Protocol::Frame => Self::Frame,
            Protocol::Haply => Self::Haply,
        }
    }
}

/// Options without a value, and options with one.
const FLAG_OPTIONS: [&str; 2] = ["lockstep", "wide"];
const VALUE_OPTIONS: [&str; 9] = [
    "arm",
    "id",
    "baud",
    "axes",
    "rate",
    "mass",
    "stiffness",
    "damping",
    "patience",
];

/// The URL of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceUrl {
    /// The protocol.
    pub kind: DeviceKind,
    /// A path or an address; empty for `emul`.
    pub target: String,
    /// Whether the host waits for every reply.
    pub lockstep: bool,
    /// Whether forces and positions are sent as f64 instead of integers.
    pub wide: bool,
    /// The axis that is meant, if the device has several.
    pub axis: Option<usize>,
    option_values: Vec<(String, String)>,
    text: String,
}

/// What is wrong with a URL.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UrlError {
    /// No such protocol.
    #[error("'{0}' is not a kind of device; the kinds are {names}", names = DeviceKind::names())]
    Kind(String),
    /// A protocol that is known but not supported.
    #[error(
        "'{0}' is not supported yet: the host would have to compute its kinematics, and no such device was there to test"
    )]
    Unsupported(String),
    /// Something is missing or not understood.
    #[error("'{text}': {what}")]
    Invalid {
        /// The text.
        text: String,
        /// What is wrong.
        what: String,
    },
}

impl DeviceUrl {
    /// Parse a URL.
    ///
    /// ```
    /// use ergon_live::device::DeviceUrl;
    ///
    /// let url = DeviceUrl::parse("frame+udp:192.168.1.7:4000?lockstep")?;
    /// assert!(url.lockstep && url.target == "192.168.1.7:4000");
    /// assert!(DeviceUrl::parse("nothing").is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`UrlError`] names what is not understood.
    pub fn parse(text: &str) -> Result<Self, UrlError> {
        let url_error = |what: String| UrlError::Invalid {
            text: text.to_owned(),
            what,
        };
        let (kind_name, remainder) = text
            .split_once(':')
            .ok_or_else(|| url_error("an address begins with a kind of device and a colon".to_owned()))?;
        if kind_name == "hapi" {
            return Err(UrlError::Unsupported(kind_name.to_owned()));
        }
        let kind = DeviceKind::NAMED.iter().find(|named_kind| named_kind.0 == kind_name);
        let kind = kind.ok_or_else(|| UrlError::Kind(kind_name.to_owned()))?.1;
        if kind == DeviceKind::Pointer {
            // Its options are those of the stream, which is found by its whole name.
            return Ok(Self {
                target: remainder.to_owned(),
                text: text.to_owned(),
                ..Self::in_process(kind)
            });
        }
        let (remainder, axis) = match remainder.rsplit_once('#') {
            None => (remainder, None),
            Some((remainder, axis)) => {
                let axis = axis.parse();
                let axis = axis.map_err(|_| url_error("the number of an axis must follow #".into()))?;
                (remainder, Some(axis))
            }
        };
        let (target, options) = remainder.split_once('?').unwrap_or((remainder, ""));
        let target = target.strip_prefix("//").unwrap_or(target);
        if target.is_empty() != (kind == DeviceKind::Emul) {
            return Err(url_error(match kind {
                DeviceKind::Emul => "`emul:` takes no address".to_owned(),
                _ => "a path or an address must follow the colon".to_owned(),
            }));
        }
        if kind.is_serial() && is_network_address(target) {
            return Err(url_error(match kind {
                DeviceKind::Frame => {
                    let address = target.strip_prefix("udp:").unwrap_or(target);
                    format!("'{target}' is a network address; over a network, write frame+udp:{address}")
                }
                _ => {
                    format!("'{target}' is a network address, and {kind_name} takes a serial port")
                }
            }));
        }
        let mut new_url = Self {
            kind,
            target: target.to_owned(),
            lockstep: false,
            wide: false,
            axis,
            option_values: Vec::new(),
            text: text.to_owned(),
        };
        for option in options.split('&').filter(|option| !option.is_empty()) {
            match option.split_once('=') {
                None if option == FLAG_OPTIONS[0] => new_url.lockstep = true,
                None if option == FLAG_OPTIONS[1] => new_url.wide = true,
                Some((key, value)) if VALUE_OPTIONS.contains(&key) => {
                    new_url.option_values.push((key.to_owned(), value.to_owned()));
                }
                _ => return Err(url_error(format!("unknown option '{option}'"))),
            }
        }
        Ok(new_url)
    }

    /// The URL of a device of a kind that is emulated inside this process.
    pub(super) fn in_process(kind: DeviceKind) -> Self {
        Self {
            kind,
            target: String::new(),
            lockstep: false,
            wide: false,
            axis: None,
            option_values: Vec::new(),
            text: "a board in this process".to_owned(),
        }
    }

    /// The name of the stream that leads a key.
    pub(super) fn stream_name(&self) -> &str {
        &self.text
    }

    /// The text of an option.
    pub(crate) fn option_text(&self, key: &str) -> Option<&str> {
        let option_entry = self.option_values.iter().find(|(option_key, _)| option_key == key);
        option_entry.map(|(_, value)| value.as_str())
    }

    /// The number of an option.
    pub(crate) fn option_number(&self, key: &str, default: f64) -> Result<f64, DeviceError> {
        let Some(option_text) = self.option_text(key) else {
            return Ok(default);
        };
        let option_number = option_text
            .parse()
            .ok()
            .filter(|option_number: &f64| option_number.is_finite());
        option_number.ok_or_else(|| self.open_error(format!("{key} must be a number, not '{option_text}'")))
    }

    pub(super) fn open_error(&self, reason: impl fmt::Display) -> DeviceError {
        DeviceError::NotOpened {
            url: self.text.clone(),
            reason: reason.to_string(),
        }
    }

    pub(super) fn no_answer_error(&self, kind: &'static str) -> DeviceError {
        DeviceError::NoAnswer {
            url: self.text.clone(),
            kind,
        }
    }

    pub(crate) fn impossible_error(&self, reason: String) -> DeviceError {
        DeviceError::Impossible {
            url: self.text.clone(),
            reason,
        }
    }

    pub(crate) fn unsupported_error(&self, capability: &'static str) -> DeviceError {
        DeviceError::Unsupported {
            url: self.text.clone(),
            what: capability,
        }
    }
}

/// Whether a target is `HOST:PORT`, which no serial port is called.
fn is_network_address(target: &str) -> bool {
    let is_port_number = |text: &str| text.parse::<u16>().is_ok();
    target
        .rsplit_once(':')
        .is_some_and(|(host, port)| !host.contains('/') && is_port_number(port))
}

impl fmt::Display for DeviceUrl {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn url_with_kind_target_options_and_axis() {
        let url = DeviceUrl::parse("firefader:/dev/ttyACM0#1").unwrap();
        assert_eq!((url.kind, url.axis), (DeviceKind::FireFader, Some(1)));
        assert_eq!(url.target, "/dev/ttyACM0");
        let url = DeviceUrl::parse("frame+udp://127.0.0.1:9999?lockstep&wide").unwrap();
        assert_eq!(url.target, "127.0.0.1:9999");
        assert!(url.lockstep && url.wide);
        let url = DeviceUrl::parse("haply:ws://127.0.0.1:10001?id=A14#2").unwrap();
        assert_eq!(url.target, "ws://127.0.0.1:10001");
        assert_eq!((url.option_text("id"), url.axis), (Some("A14"), Some(2)));
        let url = DeviceUrl::parse("emul:?mass=0.1").unwrap();
        assert_eq!(url.option_number("mass", 1.0).unwrap(), 0.1);
    }

    #[test]
    fn url_with_unknown_words_is_refused_by_name() {
        for (text, word) in [
            ("hapi:/dev/ttyACM1", "not supported yet"),
            (
                "falcon:usb",
                "the kinds are firefader, frame, frame+udp, haply, emul, page, keys, midi, osc and gamepad",
            ),
            ("/dev/ttyACM0", "colon"),
            ("firefader:", "a path"),
            ("emul:here", "takes no address"),
            ("emul:?masss=1", "masss"),
            ("frame:/dev/x?mass", "'mass'"),
            ("frame:/dev/x#one", "number of an axis"),
            ("frame:127.0.0.1:9999", "write frame+udp:127.0.0.1:9999"),
            ("frame:udp:127.0.0.1:9999", "write frame+udp:127.0.0.1:9999"),
            ("firefader:board.local:80", "takes a serial port"),
        ] {
            let message = DeviceUrl::parse(text).unwrap_err().to_string();
            assert!(message.contains(word), "{text}: {message}");
        }
    }
}
