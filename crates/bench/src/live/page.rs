use std::future::Future;

use anstream::adapter::strip_str;
use bench_recording::WhenFull;
use bench_rig::{Calibration, Mission};
use bench_run::{Directive, StopReason, Watcher};
use bench_view::{About, Ask, Controls, Frames, Live, Outcome, Stage, Start};

use super::LiveArguments;
use crate::{exit::Exit, flight::Flight, words};

/// Records that may wait for the page.
const RECORDS: usize = 16_384;

/// What of the page belongs to the flight.
pub struct Ends {
    pub watcher: Watcher,
    pub controls: Controls,
}

/// The page as the command has it.
pub struct Page {
    live: Live,
    autostart: bool,
}

impl LiveArguments {
    /// Opens the page, if it is wanted, and says where it is.
    pub fn open(&self, about: impl FnOnce() -> About) -> anyhow::Result<Option<(Page, Ends)>> {
        if !self.live {
            return Ok(None);
        }
        let about = about();
        let when_full = if about.real_time { WhenFull::Drop } else { WhenFull::Block };
        let (watcher, records, missed) = Watcher::new(RECORDS, when_full);
        let (live, controls) = Live::start(self.listen, about, records, missed)?;
        if live.is_exposed() {
            words::warn(format_args!(
                "the live page listens on {}, where other machines reach it, and nothing on its way is encrypted; whoever has \
                 the address below can fly",
                self.listen
            ));
        }
        crate::words::say!("live page: {}", live.url());
        let page = Page { live, autostart: self.autostart };
        Ok(Some((page, Ends { watcher, controls })))
    }
}

impl Page {
    /// Tells the page where the bench is.
    pub fn stage(&self, stage: Stage) {
        self.live.stage(stage);
    }

    /// What the tracker shows frames to.
    pub fn frames(&self, calibration: &Calibration) -> anyhow::Result<Frames> {
        Ok(self.live.frames(calibration)?)
    }

    /// Whether somebody is to press START, again if need be.
    pub fn waits(&self) -> bool {
        !self.autostart
    }

    /// Waits for START; gives the mission as the operator wants it, or why nothing is flown. `warning` says why the START before
    /// did not lead to a flight.
    pub async fn start(
        &mut self,
        mission: &Mission,
        checked: Vec<String>,
        warning: Option<String>,
        interrupted: impl Future<Output = &'static str>,
    ) -> Result<Start, String> {
        if self.autostart {
            self.stage(Stage::Starting);
            return Ok(Start { mission: mission.clone(), changes: Vec::new() });
        }
        self.stage(Stage::Waiting { checked, warning });
        crate::words::say!("waiting for START on the live page (Ctrl-C ends it)");
        tokio::select! {
            start = self.live.started() => start.ok_or_else(|| "the operator ended the bench".to_owned()),
            name = interrupted => Err(name.to_owned()),
        }
    }

    /// Tells how the flight ended, and stays for a look until somebody ends it.
    pub async fn stay(mut self, outcome: Outcome, interrupted: impl Future<Output = &'static str>) {
        self.stage(Stage::Landed(outcome.clone()));
        if !self.autostart {
            crate::words::say!("the live page stays until Ctrl-C, or until the operator ends it");
            tokio::select! {
                () = self.live.ended() => {}
                _ = interrupted => {}
            }
        }
        self.close(outcome);
    }

    /// Ends the page.
    pub fn close(self, outcome: Outcome) {
        self.live.close(outcome);
    }
}

/// What the page asks of the flight, as the loop takes it.
pub fn directive(controls: Option<&mut Controls>) -> Directive {
    match controls.and_then(Controls::next_ask) {
        None => Directive::GoOn,
        Some(Ask::Stop) => Directive::Stop(StopReason::Pressed),
        Some(Ask::Altitude(altitude_m)) => Directive::FlyAt(altitude_m),
        Some(Ask::Land) => Directive::Land,
    }
}

/// A flight as the page tells it, with what the terminal says: its colours are left out.
pub fn outcome(flight: &Flight<'_>, words: &str) -> Outcome {
    let exit = flight.exit();
    Outcome { passed: exit == Exit::Done, headline: flight.headline(), words: strip_str(words).to_string() }
}

/// Nothing was flown.
pub fn not_flown(why: &str) -> Outcome {
    Outcome { passed: false, headline: format!("Not flown: {why}"), words: String::new() }
}
