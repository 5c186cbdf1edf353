//! A simulation that somebody watches on the live page.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use bench_recording::{Finished, RecordingError};
use bench_rig::{Calibration, Mission, Rig};
use bench_run::{Directive, StopReason, Watcher};
use bench_view::{About, Controls, Frames, Stage};
use tokio::{runtime::Runtime, sync::mpsc::UnboundedReceiver};

use super::Arguments;
use crate::{
    flight::Flight,
    live::{self, Page},
    signals,
};

/// Who watches.
pub struct Watched {
    page: Page,
    /// Until the flight takes it.
    watcher: Option<Watcher>,
    controls: Controls,
    stop: Arc<AtomicBool>,
    runtime: Runtime,
    interrupts: UnboundedReceiver<&'static str>,
}

impl Watched {
    /// Opens the page, if it is wanted.
    pub fn open(arguments: &Arguments, rig: &Rig, mission: &Mission) -> anyhow::Result<Option<Self>> {
        let about = || About {
            mode: "sim",
            rig: rig.clone(),
            mission: mission.clone(),
            real_time: arguments.realtime,
            views: arguments.frames,
            truth: true,
        };
        let Some((page, ends)) = arguments.live.open(about)? else { return Ok(None) };
        let stop = Arc::new(AtomicBool::new(false));
        let interrupts = signals::heed(Arc::clone(&stop))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let live::Ends { watcher, controls } = ends;
        Ok(Some(Self { page, watcher: Some(watcher), controls, stop, runtime, interrupts }))
    }

    /// Waits for START; the mission as the operator wants it, and what was changed of it; or why nothing is flown.
    pub fn started(mut self, mission: &Mission) -> Result<(Self, Mission, Vec<String>), String> {
        let Self { page, runtime, interrupts, .. } = &mut self;
        let checked = vec!["airframe, tracker and outputs are simulated".to_owned()];
        match runtime.block_on(page.start(mission, checked, None, interrupted(interrupts))) {
            Ok(start) => {
                page.stage(Stage::Flying);
                Ok((self, start.mission, start.changes))
            }
            Err(why) => {
                crate::words::say!("not flown: {why}");
                self.page.close(live::not_flown(&why));
                Err(why)
            }
        }
    }

    /// What the flight shows its records to; once.
    pub fn watcher(&mut self) -> Option<Watcher> {
        self.watcher.take()
    }

    /// What the tracker shows frames to.
    pub fn frames(&self, calibration: &Calibration) -> anyhow::Result<Frames> {
        self.page.frames(calibration)
    }

    /// What is asked of the flight.
    pub fn asks(&mut self) -> Directive {
        if self.stop.load(Ordering::Relaxed) {
            return Directive::Stop(StopReason::Asked);
        }
        live::directive(Some(&mut self.controls))
    }

    /// Tells what the flight came to, and stays for a look.
    pub fn landed(mut self, flight: &Flight<'_>, finished: &Result<Finished, RecordingError>) {
        let outcome = live::outcome(flight, &flight.in_words(finished));
        self.runtime.block_on(self.page.stay(outcome, interrupted(&mut self.interrupts)));
    }
}

async fn interrupted(interrupts: &mut UnboundedReceiver<&'static str>) -> &'static str {
    // The thread that tells lives as long as the program.
    interrupts.recv().await.unwrap_or("interrupted")
}
