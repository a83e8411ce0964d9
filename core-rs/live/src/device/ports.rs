//! Serial ports of this machine, as the system lists them; none is opened.

use serialport::SerialPortType;

/// A serial port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SerialPort {
    /// Its path or name.
    pub path: String,
    /// The USB device behind the port, if there is one.
    pub usb: Option<UsbInfo>,
}

/// What a USB device reports about itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UsbInfo {
    /// Number of the vendor.
    pub vendor: u16,
    /// Number of the product, given by the vendor.
    pub product: u16,
    /// Name of the product; empty if it reports none.
    pub name: String,
    /// Its serial number; empty if it has none.
    pub serial: String,
}

/// All serial ports, sorted by path; empty if the system cannot list them.
#[must_use]
pub fn serial_ports() -> Vec<SerialPort> {
    // The crate reads this folder and relies on it.
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let mut ports: Vec<_> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| SerialPort {
            path: port.port_name,
            usb: usb_info(port.port_type),
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// A name of the board on a port that does not depend on the port: `usb_info:VENDOR:PRODUCT:SERIAL`. `None` if the
/// device has no serial number, or if two connected devices report the same identity.
#[must_use]
pub fn identity(path: &str) -> Option<String> {
    // A name in /dev/serial/by-id is a link to the port.
    let real_path = std::fs::canonicalize(path).ok()?;
    identity_among(&serial_ports(), |port_path| {
        std::fs::canonicalize(port_path).is_ok_and(|resolved_path| resolved_path == real_path)
    })
}

fn identity_among(ports: &[SerialPort], is_same_path: impl Fn(&str) -> bool) -> Option<String> {
    let usb_identity = |port: &SerialPort| {
        let usb_info = port.usb.as_ref()?;
        let serial_number = usb_info.serial.trim();
        let UsbInfo { vendor, product, .. } = usb_info;
        (!serial_number.is_empty()).then(|| format!("usb:{vendor:04x}:{product:04x}:{serial_number}"))
    };
    let identity = usb_identity(ports.iter().find(|port| is_same_path(&port.path))?)?;
    let same_ports = ports
        .iter()
        .filter(|port| usb_identity(port).as_ref() == Some(&identity));
    (same_ports.count() == 1).then_some(identity)
}

fn usb_info(kind: SerialPortType) -> Option<UsbInfo> {
    let SerialPortType::UsbPort(usb_port) = kind else {
        return None;
    };
    Some(UsbInfo {
        vendor: usb_port.vid,
        product: usb_port.pid,
        name: usb_port.product.or(usb_port.manufacturer).unwrap_or_default(),
        serial: usb_port.serial_number.unwrap_or_default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(path: &str, vendor: u16, serial: Option<&str>) -> SerialPort {
        let usb = serial.map(|serial| UsbInfo {
            vendor,
            product: 0x0042,
            name: "board".into(),
            serial: serial.into(),
        });
        SerialPort { path: path.into(), usb }
    }

    #[test]
    fn identity_by_serial_number_only() {
        let test_ports = [
            port("/dev/ttyACM0", 0x2341, Some("85439303 ")),
            port("/dev/ttyACM1", 0x16c0, Some("85439303")),
            port("/dev/ttyUSB0", 0x1a86, Some("")),
            port("/dev/ttyUSB1", 0x0403, Some("0001")),
            port("/dev/ttyUSB2", 0x0403, Some("0001")),
            port("/dev/ttyS0", 0, None),
        ];
        let identity = |path: &str| identity_among(&test_ports, |port_path| port_path == path);
        assert_eq!(identity("/dev/ttyACM0").unwrap(), "usb:2341:0042:85439303");
        assert_eq!(identity("/dev/ttyACM1").unwrap(), "usb:16c0:0042:85439303");
        for unsure in [
            "/dev/ttyUSB0",
            "/dev/ttyUSB1",
            "/dev/ttyUSB2",
            "/dev/ttyS0",
            "/dev/pts/3",
        ] {
            assert_eq!(identity(unsure), None, "{unsure}");
        }
    }
}
