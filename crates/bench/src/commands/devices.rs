use std::fmt::Write as _;

use bench_dac::ports::{self, Port};
use clap::Args;
use serde_json::json;

use crate::{exit::Exit, words};

/// List serial ports and Kinects, with what can be told of them
#[derive(Args)]
#[command(after_help = "Examples:
  bench devices
  bench devices --json | jq -r '.ports[].path'

An emulated board (`bench emulate psoc5`) says its own port; pseudo terminals are not listed.")]
pub struct Arguments {
    /// Print as JSON (schema bench.devices/1)
    #[arg(long)]
    json: bool,
}

/// Microsoft's USB devices that make up a Kinect v1.
const MICROSOFT: u16 = 0x045e;
const KINECT_PARTS: [(u16, &str); 4] = [
    (0x02ae, "camera of a Kinect for Xbox"),
    (0x02bf, "camera of a Kinect for Windows"),
    (0x02ad, "microphones of a Kinect"),
    (0x02b0, "motor of a Kinect"),
];

/// A part of a Kinect on the USB.
struct KinectPart {
    what: &'static str,
    bus: u8,
    address: u8,
    product: u16,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let ports = ports::list();
    let kinects = kinect_parts();
    if arguments.json {
        let ports: Vec<_> = ports
            .iter()
            .map(|port| {
                json!({
                    "path": port.path,
                    "description": port.description,
                    "usb": port.usb.as_ref().map(|usb| json!({
                        "vendor": format!("{:04x}", usb.vendor),
                        "product": format!("{:04x}", usb.product),
                        "serial": usb.serial,
                    })),
                    "holder": port.holder,
                })
            })
            .collect();
        let parts: Vec<_> = kinects
            .iter()
            .flatten()
            .map(|part| {
                let product = format!("{:04x}", part.product);
                json!({ "what": part.what, "bus": part.bus, "address": part.address, "product": product })
            })
            .collect();
        let error = kinects.as_ref().err();
        words::print_json(
            &json!({ "schema": "bench.devices/1", "ports": ports, "kinects": parts, "usb_error": error }),
        )?;
    } else {
        words::print(&in_words(&ports, kinects.as_deref()))?;
    }
    Ok(Exit::Done)
}

fn kinect_parts() -> Result<Vec<KinectPart>, String> {
    // The global context of rusb panics where there is no USB.
    let devices = rusb::Context::new()
        .and_then(|context| rusb::UsbContext::devices(&context))
        .map_err(|error| format!("{error} (is there a USB controller, and /dev/bus/usb?)"))?;
    Ok(devices
        .iter()
        .filter_map(|device| {
            let descriptor = device.device_descriptor().ok()?;
            let (_, what) = KINECT_PARTS.into_iter().find(|(product, _)| {
                descriptor.vendor_id() == MICROSOFT && descriptor.product_id() == *product
            })?;
            let (bus, address, product) = (device.bus_number(), device.address(), descriptor.product_id());
            Some(KinectPart { what, bus, address, product })
        })
        .collect())
}

fn in_words(ports: &[Port], kinects: Result<&[KinectPart], &String>) -> String {
    let mut out = String::from("serial ports\n");
    for port in ports {
        let _ = write!(out, "  {:<16} {}", port.path, port.description);
        if let Some(usb) = &port.usb {
            let _ = write!(out, " ({:04x}:{:04x}", usb.vendor, usb.product);
            if let Some(serial) = &usb.serial {
                let _ = write!(out, ", serial {serial}");
            }
            let _ = write!(out, ")");
        }
        if let Some(holder) = &port.holder {
            let _ = write!(out, ", in use by {holder}");
        }
        out.push('\n');
    }
    if ports.is_empty() {
        out.push_str("  none; is the board plugged in?\n");
    }
    out.push_str("Kinects\n");
    match kinects {
        Ok([]) => out.push_str("  none on the USB\n"),
        Ok(parts) => {
            for part in parts {
                let KinectPart { what, bus, address, product } = part;
                let _ = writeln!(
                    out,
                    "  bus {bus:03} address {address:03}  {what} ({MICROSOFT:04x}:{product:04x})"
                );
            }
        }
        Err(error) => _ = writeln!(out, "  the USB cannot be looked at: {error}"),
    }
    out
}
