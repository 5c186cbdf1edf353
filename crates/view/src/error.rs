use std::{io, net::SocketAddr};

use thiserror::Error;

/// Why there is no live page.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewError {
    /// The address is taken, or not one of this machine's.
    #[error(
        "cannot serve the live page on {address}; if another program (or another bench) has that port, give one with --listen, such as \
         --listen 127.0.0.1:8081"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// A thread or its runtime could not be started.
    #[error("cannot start the live page's thread {thread}")]
    Thread {
        /// The thread's name.
        thread: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// No random numbers for the token.
    #[error("the system gives no random numbers, so the live page would not be safe: {0}")]
    Random(getrandom::Error),
}
