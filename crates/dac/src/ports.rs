//! Serial ports: which there are, and who has one.

use std::{fs, path::Path};

use serialport::SerialPortType;

/// A serial port and what can be told of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Its path, to be given to `--port`.
    pub path: String,
    /// Maker and product, or the kind of port.
    pub description: String,
    /// USB vendor and product number and serial number, where it is a USB port.
    pub usb: Option<Usb>,
    /// The program that has it open, if one has and that can be told.
    pub holder: Option<String>,
}

/// Numbers of a USB device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Usb {
    /// Vendor.
    pub vendor: u16,
    /// Product.
    pub product: u16,
    /// Serial number, where it has one.
    pub serial: Option<String>,
}

/// All serial ports of this machine, by path. Pseudo terminals, an emulated board's among them, are not listed by the system.
pub fn list() -> Vec<Port> {
    let mut ports: Vec<_> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|found| {
            let (description, usb) = match found.port_type {
                SerialPortType::UsbPort(usb) => {
                    let words: Vec<_> = [usb.manufacturer, usb.product].into_iter().flatten().collect();
                    let description = if words.is_empty() { "USB".to_owned() } else { words.join(" ") };
                    (description, Some(Usb { vendor: usb.vid, product: usb.pid, serial: usb.serial_number }))
                }
                SerialPortType::PciPort => ("on the PCI bus".to_owned(), None),
                SerialPortType::BluetoothPort => ("Bluetooth".to_owned(), None),
                SerialPortType::Unknown => ("serial port".to_owned(), None),
            };
            Port { holder: holder(&found.port_name), path: found.port_name, description, usb }
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// The ports there are, in words for an error.
pub(crate) fn in_words() -> String {
    let paths: Vec<_> = list().into_iter().map(|port| port.path).collect();
    if paths.is_empty() {
        "this machine has no serial port".to_owned()
    } else {
        format!("there is {}", paths.join(", "))
    }
}

/// The program that has a port open: name and process number. Only what this user may see.
pub fn holder(port: &str) -> Option<String> {
    let port = fs::canonicalize(port).ok()?;
    let own = std::process::id().to_string();
    for process in fs::read_dir("/proc").ok()?.flatten() {
        let name = process.file_name();
        let Some(id) = name.to_str().filter(|id| id.bytes().all(|byte| byte.is_ascii_digit()) && *id != own)
        else {
            continue;
        };
        if has_open(&process.path(), &port) {
            let program = fs::read_to_string(process.path().join("comm")).unwrap_or_default();
            return Some(format!("{} (process {id})", program.trim()));
        }
    }
    None
}

fn has_open(process: &Path, file: &Path) -> bool {
    let Ok(open) = fs::read_dir(process.join("fd")) else { return false };
    open.flatten().any(|entry| fs::read_link(entry.path()).is_ok_and(|target| target == *file))
}
