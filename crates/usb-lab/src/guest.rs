//! The first process of the guest: mounts what programs expect, plugs devices in, runs a script, powers off.

use std::{
    collections::BTreeMap,
    fs,
    io::{self, BufRead, BufReader},
    path::Path,
    process::{Command, Stdio},
    thread,
};

use rustix::{
    fs::{Mode, mknodat},
    mount::{MountFlags, mount},
    system::{RebootCommand, reboot},
};

use crate::{Device, Plug};

/// Orders to the guest, one a line: `plug PORT`, `unplug PORT`.
pub const ORDERS: &str = "/run/usb-lab";

/// In the work folder: the script, and what it returned.
pub(crate) const SCRIPT: &str = "script";
pub(crate) const STATUS: &str = "status";

/// The kernel hands unknown words of its command line to the first process as environment variables.
pub(crate) const WORK: &str = "USB_LAB_WORK";

/// What makes the device of a port, each time that it is plugged in.
pub type Maker = Box<dyn Fn(u8) -> io::Result<Box<dyn Device>> + Send>;

/// To be called by a binary that serves as the guest's first process; comes back only where it cannot begin. Port 0 is plugged in at once.
pub fn main(make: Maker) -> io::Result<()> {
    let work = std::env::var_os(WORK).ok_or_else(|| {
        io::Error::other("this is the first process of a test kernel, and no program to be run by hand")
    })?;
    let work = Path::new(&work);
    mount_all()?;
    let mut plugs = BTreeMap::new();
    plugs.insert(0, Plug::insert(0, make(0)?)?);
    thread::spawn(move || obey(&make, plugs));

    let status = Command::new("/bin/sh")
        .arg(work.join(SCRIPT))
        .current_dir(work)
        .env("PATH", "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin")
        // The console is a terminal at which nobody sits: a program that asks there would wait for ever.
        .stdin(Stdio::null())
        .status()?;
    fs::write(work.join(STATUS), status.code().unwrap_or(-1).to_string())?;
    rustix::fs::sync();
    reboot(RebootCommand::PowerOff)?;
    Ok(())
}

fn mount_all() -> io::Result<()> {
    let none = MountFlags::empty();
    for (kind, target) in [("proc", "/proc"), ("sysfs", "/sys"), ("devtmpfs", "/dev"), ("tmpfs", "/run")] {
        mounted(target, mount(kind, target, kind, none, None))?;
    }
    fs::create_dir_all("/dev/pts")?;
    mounted("/dev/pts", mount("devpts", "/dev/pts", "devpts", none, None))?;
    fs::create_dir_all("/dev/shm")?;
    mounted("/dev/shm", mount("tmpfs", "/dev/shm", "tmpfs", none, None))?;
    mknodat(rustix::fs::CWD, ORDERS, rustix::fs::FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)?;
    Ok(())
}

fn mounted(target: &str, result: rustix::io::Result<()>) -> io::Result<()> {
    result.map_err(|error| io::Error::other(format!("cannot mount {target}: {error}")))
}

fn obey(make: &Maker, mut plugs: BTreeMap<u8, Plug>) {
    // Open for writing too, so that a writer that goes is not the end.
    let Ok(orders) = fs::File::options().read(true).write(true).open(ORDERS) else { return };
    for line in BufReader::new(orders).lines().map_while(Result::ok) {
        let done = match line.split_once(' ').map(|(order, port)| (order, port.trim().parse())) {
            Some(("plug", Ok(port))) => make(port)
                .and_then(|device| Plug::insert(port, device))
                .map(|plug| drop(plugs.insert(port, plug))),
            Some(("unplug", Ok(port))) => {
                drop(plugs.remove(&port));
                Ok(())
            }
            _ => Err(io::Error::other("an order is `plug PORT` or `unplug PORT`")),
        };
        if let Err(error) = done {
            eprintln!("usb-lab: {line}: {error}");
        }
    }
}
