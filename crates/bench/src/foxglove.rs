//! Foxglove's live server: whoever connects sees what the recorder writes.

#[cfg(not(feature = "foxglove"))]
mod absent;
#[cfg(feature = "foxglove")]
mod server;

use clap::Args;

#[cfg(not(feature = "foxglove"))]
pub use absent::Server;
#[cfg(feature = "foxglove")]
pub use server::Server;

/// Where the server listens, if there is one.
#[derive(Args)]
#[group(skip)]
pub struct FoxgloveArguments {
    /// Serve the flight's messages to Foxglove and Lichtblick; port 0 takes any that is free
    #[cfg(feature = "foxglove")]
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        num_args = 0..=1,
        default_missing_value = "127.0.0.1:8765",
        value_parser = crate::live::address
    )]
    foxglove: Option<std::net::SocketAddr>,
}

impl FoxgloveArguments {
    /// Opens the server, if it is wanted, and says where it is.
    #[cfg(feature = "foxglove")]
    pub fn open(&self) -> anyhow::Result<Option<Server>> {
        self.foxglove.map(Server::open).transpose()
    }

    /// None: the program was built without.
    #[cfg(not(feature = "foxglove"))]
    #[expect(clippy::unused_self, clippy::unnecessary_wraps, reason = "as with the feature")]
    pub fn open(&self) -> anyhow::Result<Option<Server>> {
        Ok(None)
    }
}
