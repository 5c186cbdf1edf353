//! The live page of a flight, on whichever bench: its arguments, its words, and who waits for it.

#[cfg(feature = "lab")]
mod page;

use std::net::SocketAddr;

use clap::Args;

#[cfg(feature = "lab")]
pub use page::{Ends, Page, directive, not_flown, outcome};

/// The live page.
#[derive(Args)]
#[group(skip)]
pub struct LiveArguments {
    /// Show the flight on a page in the browser, which waits for START; the address is printed
    #[arg(long)]
    live: bool,
    /// Where the live page listens; port 0 takes any that is free
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080", requires = "live", value_parser = address)]
    listen: SocketAddr,
    /// Fly at once, without START, and end with the flight
    #[arg(long, requires = "live")]
    autostart: bool,
}

/// An address and a port, from the command line.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    let numbers = text.replacen("localhost:", "127.0.0.1:", 1);
    numbers.parse().map_err(|_| "expected an address and a port, such as 127.0.0.1:8080".to_owned())
}

#[cfg(not(feature = "lab"))]
impl LiveArguments {
    /// An error where the page is wanted.
    pub fn refuse(&self) -> anyhow::Result<()> {
        let Self { live, listen: _, autostart: _ } = self;
        if *live { Err(crate::left_out::left_out("the live page", "lab")) } else { Ok(()) }
    }
}
