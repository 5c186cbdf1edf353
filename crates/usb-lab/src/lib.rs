//! USB devices that exist in software only, in a kernel that runs as an ordinary program: for tests without hardware.
//!
//! A [`Device`] is a USB device's side of the cable. [`guest`] plugs it into the kernel's `vhci_hcd`, which speaks USB/IP over a socket,
//! so that the kernel's own drivers (`cdc_acm`), libusb and whatever sits on them meet it as they would a real one. [`host`] boots a
//! User-Mode Linux kernel, as any user and in about a second, with the machine's own file system as its root, and runs a script there.
//!
//! ```text
//!  test -> host::Lab::run(script) -> kernel -> guest::main -> plugs devices in, runs the script, powers off
//!                                                 ^ "plug 0", "unplug 0" on /run/usb-lab
//! ```
//! `kernel/build` builds that kernel once and keeps it. To add a device: implement [`Device`], and give a binary of your own
//! [`guest::main`] with it, as `src/bin/usb-lab.rs` does with the serial port of [`acm`].

pub mod acm;
mod device;
pub mod guest;
pub mod host;
mod server;
mod wire;

pub use device::{Descriptors, Device, Setup, Speed, Stall};
pub use server::{Bus, Plug};
pub use wire::{Packet, Urb};
