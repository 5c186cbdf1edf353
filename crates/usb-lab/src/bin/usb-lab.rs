//! The first process of a guest whose USB port 0 holds a serial port. Behind that is the program that the file `device` of the work folder
//! names, spoken to over its standard input and output.

use std::{
    fs, io,
    process::{Command, ExitCode, Stdio},
};

use bench_usb_lab::{Device, acm::SerialPort, guest};

fn main() -> ExitCode {
    match guest::main(Box::new(serial_port)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("usb-lab: {error}");
            ExitCode::FAILURE
        }
    }
}

/// A program started anew each time that it is plugged in, as a board that is powered by the bus.
fn serial_port(_port: u8) -> io::Result<Box<dyn Device>> {
    let work = std::env::var("USB_LAB_WORK").map_err(io::Error::other)?;
    let program = fs::read_to_string(format!("{work}/device"))
        .map_err(|error| io::Error::other(format!("cannot read {work}/device: {error}")))?;
    let mut child = Command::new(program.trim())
        .current_dir(work)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| io::Error::other(format!("cannot run {}: {error}", program.trim())))?;
    let gone = || io::Error::other("the program has no standard input and output");
    let (input, output) = (child.stdout.take().ok_or_else(gone)?, child.stdin.take().ok_or_else(gone)?);
    Ok(Box::new(SerialPort::new(input, output)))
}
