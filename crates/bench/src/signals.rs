//! The signals that end a flight: Ctrl-C, `kill`, a terminal that was closed.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
};

use anyhow::Context;
use tokio::{
    signal::unix::{Signal, SignalKind, signal},
    sync::mpsc,
};

use crate::exit::Exit;

/// The signals, caught from here on.
pub struct Signals {
    interrupt: Signal,
    terminate: Signal,
    hang_up: Signal,
    parent_ended: Signal,
}

/// The name of the signal that says that the process which started this one has ended. It may come several times over, once for each
/// of that process' threads.
pub const PARENT_ENDED: &str = "the end of the process that started this one";

impl Signals {
    /// To be called within a runtime.
    pub fn catch() -> anyhow::Result<Self> {
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hang_up: signal(SignalKind::hangup())?,
            parent_ended: signal(SignalKind::user_defined1())?,
        })
    }

    /// The name of the next one.
    pub async fn next(&mut self) -> &'static str {
        tokio::select! {
            _ = self.interrupt.recv() => "Ctrl-C",
            _ = self.terminate.recv() => "SIGTERM",
            _ = self.hang_up.recv() => "SIGHUP",
            _ = self.parent_ended.recv() => PARENT_ENDED,
        }
    }
}

/// For work that has its thread for itself: the first signal sets `stop` and is told through what this returns, the second leaves at once.
pub fn heed(stop: Arc<AtomicBool>) -> anyhow::Result<mpsc::UnboundedReceiver<&'static str>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    let mut signals = {
        let _inside = runtime.enter();
        Signals::catch()?
    };
    let (told, names) = mpsc::unbounded_channel();
    thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            runtime.block_on(async {
                loop {
                    let name = signals.next().await;
                    // Nobody may listen any more.
                    let _ = told.send(name);
                    if stop.swap(true, Ordering::Relaxed) {
                        crate::words::say!("{name} again: leaving at once");
                        std::process::exit(Exit::Stopped as i32);
                    }
                }
            });
        })
        .context("cannot start a thread for signals")?;
    Ok(names)
}
