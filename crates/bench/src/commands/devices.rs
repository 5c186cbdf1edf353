use std::fmt::Write as _;

use bench_dac::ports::{self, Port};
use bench_kinect::usb::{self, DriverError, Listed, Model};
use clap::Args;
use serde_json::json;

use crate::{arguments::Json, exit::Exit, words};

/// List serial ports and Kinects, with what can be told of them
#[derive(Args)]
#[command(after_help = "Examples:
  bench devices
  bench devices --json | jq -r '.ports[].path'

An emulated board (`bench emulate psoc5`) says its own port; pseudo terminals are not listed.")]
pub struct Arguments {
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let ports = ports::list();
    let kinects = usb::list();
    if arguments.json.json {
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
        let listed: Vec<_> = kinects
            .iter()
            .flatten()
            .map(|kinect| {
                json!({
                    "model": kinect.model.map(|model| model.to_string()),
                    "bus": kinect.bus,
                    "address": kinect.address,
                    "serial": kinect.serial.as_ref().ok(),
                    "motor": kinect.motor,
                    "problem": kinect.serial.as_ref().err().map(ToString::to_string),
                })
            })
            .collect();
        let error = kinects.as_ref().err().map(ToString::to_string);
        words::print_json(
            &json!({ "schema": "bench.devices/1", "ports": ports, "kinects": listed, "usb_error": error }),
        )?;
    } else {
        words::print(&in_words(&ports, &kinects))?;
    }
    Ok(Exit::Done)
}

fn in_words(ports: &[Port], kinects: &Result<Vec<Listed>, DriverError>) -> String {
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
        Ok(kinects) => {
            for (index, kinect) in kinects.iter().enumerate() {
                out += &kinect_in_words(index, kinect);
            }
            if kinects.is_empty() {
                out.push_str("  none on the USB\n");
            }
        }
        Err(error) => _ = writeln!(out, "  {error}"),
    }
    out
}

fn kinect_in_words(index: usize, kinect: &Listed) -> String {
    let Listed { model, bus, address, serial, motor } = kinect;
    let place = format!("bus {bus:03} address {address:03}");
    let mut out = match model {
        Some(model) => format!("  {index}  {place}  {model}"),
        None => format!("  -  {place}  foot of a Kinect"),
    };
    if let Ok(serial) = serial {
        let _ = write!(out, ", serial number {serial}");
    }
    if let Some(why) = model.and_then(Model::motor_limit) {
        let _ = write!(out, "; no motor and accelerometer: {why}");
    } else if !motor {
        out.push_str("; its motor is not there");
    }
    if let Err(error) = serial {
        let _ = write!(out, "\n     {error}");
    }
    out + "\n"
}
