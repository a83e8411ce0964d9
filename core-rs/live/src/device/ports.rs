//! Serial ports of this machine, by what the system knows of them; none is opened.

use serialport::SerialPortType;

/// A serial port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SerialPort {
    /// Its path or name.
    pub path: String,
    /// What is plugged in there, if it came by USB.
    pub usb: Option<Usb>,
}

/// What a USB device says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usb {
    /// Number of the vendor.
    pub vendor: u16,
    /// The vendor's number of the product.
    pub product: u16,
    /// In words; empty where it says nothing.
    pub name: String,
    /// Its serial number; empty where it has none.
    pub serial: String,
}

/// All serial ports, by their paths. A system that cannot say has none.
#[must_use]
pub fn serial_ports() -> Vec<SerialPort> {
    // The list is made from here, and the crate takes it for granted.
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let mut ports: Vec<_> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| SerialPort {
            path: port.port_name,
            usb: usb(port.port_type),
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

fn usb(kind: SerialPortType) -> Option<Usb> {
    let SerialPortType::UsbPort(usb) = kind else {
        return None;
    };
    Some(Usb {
        vendor: usb.vid,
        product: usb.pid,
        name: usb.product.or(usb.manufacturer).unwrap_or_default(),
        serial: usb.serial_number.unwrap_or_default(),
    })
}
