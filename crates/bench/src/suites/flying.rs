//! Flights of a suite: simulated ones within this process, those on hardware by `bench hil` in a process of their own.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{Read as _, Seek as _},
    os::unix::process::CommandExt as _,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use anyhow::Context;
use bench_recording::{Finished, Flight, Options, Recorder, Session};
use bench_run::{Directive, Ending, StopReason, simulate, simulate_seen};
use bench_station::Entry;
use bench_suite::{Attached, Mode, Run, Suite, Times, judge};
use rustix::process::{Pid, Signal, kill_process};

use super::{Planned, Ports, sha256};
use crate::{arguments::Meta, exit::Exit, recorded, seen, station::Station};

/// What all flights of a suite share.
pub struct Flying<'a> {
    pub suite: &'a Suite,
    pub ports: &'a Ports,
    /// Handed on to `bench hil`.
    pub hil_arguments: Vec<String>,
    pub meta: BTreeMap<String, String>,
    /// The folder of the results.
    pub folder: &'a Path,
    pub station: Option<&'a Station>,
    /// Set when somebody wants it all to end.
    pub stop: &'a AtomicBool,
}

/// How a flight ended, before its recording is looked at.
#[derive(Default)]
struct Ended {
    reason: Option<String>,
    stopped: bool,
    data_lost: bool,
}

impl Flying<'_> {
    /// Flies a repeat of a test and judges its recording. `None`: it was stopped by who runs the suite.
    pub fn fly(&self, planned: &Planned, repeat: u32) -> anyhow::Result<Option<Run>> {
        let seed = planned.test.seed_of(repeat);
        let began = Instant::now();
        let started_unix_s = recorded::since_1970().as_secs_f64();
        let stem = format!("{}_r{}", planned.test.file_stem, repeat + 1);
        let entered = self.enter(planned, repeat, seed, started_unix_s, &stem)?;
        let recording = match &entered {
            Some((_, recording)) => recording.clone(),
            None => self.unused_recording(planned, &stem)?,
        };
        let flown = if planned.test.mode.is_hardware() {
            self.hardware(planned, seed, &recording)
        } else {
            self.simulated(planned, seed, &recording)
        };
        if self.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let mut run = match flown {
            Ok(ended) => self.judged(planned, repeat, seed, &recording, ended),
            Err(error) => Run::error(repeat, seed, crate::words::causes(&error)),
        };
        run.times = Times { started_unix_s, took_s: began.elapsed().as_secs_f64() };
        run.settle();
        if let (Some(station), Some((id, _))) = (self.station, entered) {
            let finished = bench_station::Finished {
                outcome: run.outcome.name().to_owned(),
                reason: Some(run.faults().join("; ")).filter(|reason| !reason.is_empty()),
                took_s: run.times.took_s,
                sha256: run.recording.as_ref().map(|recording| recording.sha256.clone()),
                figures: run.figures.clone(),
            };
            station.finish(id, &finished)?;
        }
        Ok(Some(run))
    }

    /// Enters the run into the station's log, which gives the recording its name.
    fn enter(
        &self,
        planned: &Planned,
        repeat: u32,
        seed: u64,
        started_unix_s: f64,
        stem: &str,
    ) -> anyhow::Result<Option<(i64, PathBuf)>> {
        let Some(station) = self.station else { return Ok(None) };
        let entry = Entry {
            started_unix_s,
            suite: self.suite.name.clone(),
            test: planned.test.id.clone(),
            rig: planned.nominal.name.clone(),
            mission: planned.mission.name.clone(),
            mode: planned.test.mode.name().to_owned(),
            effects: planned.added().join("; "),
            seed,
            repeat,
            bench_version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let begun = station.begin(&entry, &self.meta, stem)?;
        Ok(Some((begun.id, begun.recording)))
    }

    /// Where a recording goes without a station. What a killed process left of a flight on hardware is put aside: it cannot be made
    /// again.
    fn unused_recording(&self, planned: &Planned, stem: &str) -> anyhow::Result<PathBuf> {
        let path = self.folder.join(RECORDINGS).join(format!("{stem}.mcap"));
        if planned.test.mode.is_hardware() && path.exists() {
            let aside = (1..).map(|number| path.with_file_name(format!("{stem}_cut{number}.mcap")));
            if let Some(aside) = aside.into_iter().find(|aside| !aside.exists()) {
                std::fs::rename(&path, &aside)
                    .with_context(|| format!("cannot put {} aside", path.display()))?;
            }
        }
        Ok(path)
    }

    fn simulated(&self, planned: &Planned, seed: u64, recording: &Path) -> anyhow::Result<Ended> {
        let Planned { nominal, rig, mission, .. } = planned;
        let mut session = Session::simulated(nominal, &planned.added(), mission, seed);
        let by_frames = planned.test.mode == Mode::Frames;
        if by_frames {
            session.extra.insert("tracker".to_owned(), "rendered frames".to_owned());
        }
        Meta::note(self.meta.clone(), &mut session);
        let mut sink = Recorder::create(recording, &session, Options::SIMULATION)?;
        let each = |_: &bench_run::Progress| {
            if self.stop.load(Ordering::Relaxed) {
                Directive::Stop(StopReason::Asked)
            } else {
                Directive::GoOn
            }
        };
        let flown = if by_frames {
            let calibration = seen::calibration(rig, &planned.rig_path)?;
            let see = |exposures| seen::tracker(exposures, calibration, rig, seed, |_, _, _| ());
            simulate_seen(rig, mission, seed, see, &mut sink, each)?
        } else {
            simulate(rig, mission, seed, &mut sink, each)?
        };
        let mut ended = Ended::default();
        match sink.finish() {
            Ok(Finished { dropped: 0, .. }) => {}
            Ok(finished) => ended = lost(&crate::words::count(finished.dropped, "record")),
            Err(error) => {
                ended.data_lost = true;
                ended.reason = Some(format!("not all of the flight was recorded: {error}"));
            }
        }
        ended.stopped = !matches!(flown.ending, Ending::Complete);
        match flown.ending {
            Ending::Complete => {}
            Ending::Stopped(reason) => ended.reason = Some(format!("stopped: {reason}")),
            Ending::Fault(error) => ended.reason = Some(format!("fault: {error}")),
            Ending::Panicked(words) => {
                ended.reason = Some(format!("the program failed ({words}); please report it"));
            }
        }
        Ok(ended)
    }

    /// Flies by `bench hil` in a process of its own: a flight that fails there ends nothing but itself, and the board's watchdog and
    /// the process' own care for the outputs are those of any flight.
    fn hardware(&self, planned: &Planned, seed: u64, recording: &Path) -> anyhow::Result<Ended> {
        let program = std::env::current_exe().context("cannot find the program itself")?;
        let mut command = Command::new(program);
        command.arg("hil").arg("--rig").arg(&planned.rig_path).arg("--mission").arg(&planned.mission_path);
        command.arg("--seed").arg(seed.to_string()).arg("-o").arg(recording).arg("--json").arg("--quiet");
        // A suite that is killed leaves no airframe in the air and no board taken.
        command.arg("--end-with-parent");
        if let Some(port) = self.ports.of(planned.test.mode) {
            command.arg("--port").arg(port);
        }
        for effect in planned.added() {
            command.arg("--effect").arg(effect);
        }
        for (key, value) in &self.meta {
            command.arg("--meta").arg(format!("{key}={value}"));
        }
        command.args(&self.hil_arguments);
        // Files, not pipes: should this process be killed, the flight must still be able to say that it lands.
        let file = || tempfile::tempfile().context("cannot make a file for what `bench hil` says");
        let (mut stdout, mut stderr) = (file()?, file()?);
        // In a group of its own Ctrl-C does not reach it twice, which would end it without a landing.
        let mut child = command
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(stdout.try_clone()?)
            .stderr(stderr.try_clone()?)
            .spawn()
            .context("cannot start `bench hil`")?;
        let mut is_told = false;
        let status = loop {
            if let Some(status) = child.try_wait().context("`bench hil` was lost")? {
                break status;
            }
            // Who stops the suite wants the throttle at rest first; the flight does that on SIGTERM.
            if !is_told && self.stop.load(Ordering::Relaxed) {
                let _ = kill_process(Pid::from_child(&child), Signal::TERM);
                is_told = true;
            }
            std::thread::sleep(LOOK);
        };
        let (printed, said) = (whole(&mut stdout)?, whole(&mut stderr)?);
        let said: Vec<&str> = said.lines().collect();
        let last = said.iter().rev().find(|line| line.starts_with("error")).or(said.last());
        let told = last.map(|line| line.trim_start_matches("error: ").to_owned()).unwrap_or_default();
        let report: serde_json::Value = serde_json::from_str(&printed).unwrap_or_default();
        let reason = report["reason"].as_str();
        let is = |exit: Exit| status.code() == Some(exit as i32);
        Ok(if is(Exit::Done) || is(Exit::CheckFailed) {
            Ended::default()
        } else if is(Exit::DataLoss) {
            lost("some records")
        } else if is(Exit::Stopped) {
            let ending = report["ending"].as_str().unwrap_or("not flown");
            let why = reason.map_or(told, str::to_owned);
            Ended { reason: Some(format!("{ending}: {why}")), stopped: true, data_lost: false }
        } else if is(Exit::BadInput) {
            Ended { reason: Some(format!("not flown: {told}")), ..Ended::default() }
        } else {
            Ended {
                reason: Some(format!("`bench hil` ended unexpectedly ({status}): {told}")),
                stopped: true,
                data_lost: false,
            }
        })
    }

    /// Holds the recording of a flight against the limits of its case.
    fn judged(&self, planned: &Planned, repeat: u32, seed: u64, recording: &Path, ended: Ended) -> Run {
        let case = &self.suite.cases[planned.test.case];
        let mut run = Run::error(repeat, seed, String::new());
        (run.reason, run.stopped, run.data_lost) = (ended.reason, ended.stopped, ended.data_lost);
        if !recording.exists() {
            run.reason.get_or_insert_with(|| "nothing was recorded".to_owned());
            return run;
        }
        match std::fs::read(recording) {
            Ok(bytes) => {
                run.recording = Some(Attached {
                    file: self.named_from_folder(recording),
                    bytes: bytes.len() as u64,
                    sha256: sha256(&bytes),
                });
            }
            Err(error) => {
                _ = run.reason.get_or_insert_with(|| format!("the recording cannot be read: {error}"));
            }
        }
        match Flight::load(recording) {
            Ok(flight) => {
                let judged = judge(&flight, &case.limits, case.mission_criteria, &planned.mission.criteria);
                run.figures = judged.figures.into_iter().collect();
                (run.checks, run.spread) = (judged.checks, judged.spread);
            }
            Err(error) => _ = run.reason.get_or_insert_with(|| error.to_string()),
        }
        run
    }

    /// A recording's name from the folder of the results, or the station's.
    fn named_from_folder(&self, recording: &Path) -> String {
        let folder = self.station.map_or(self.folder, Station::folder);
        recording.strip_prefix(folder).unwrap_or(recording).display().to_string()
    }

    /// The recording that a report names.
    pub fn recording(&self, attached: &Attached) -> PathBuf {
        self.station.map_or(self.folder, Station::folder).join(&attached.file)
    }
}

/// Folder of the recordings within that of the results.
pub const RECORDINGS: &str = "recordings";
/// Between two looks at whether a flight is to be stopped.
const LOOK: Duration = Duration::from_millis(50);

/// All that was written into a file.
fn whole(file: &mut File) -> anyhow::Result<String> {
    let mut bytes = Vec::new();
    file.rewind().and_then(|()| file.read_to_end(&mut bytes)).context("cannot read what `bench hil` said")?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn lost(what: &str) -> Ended {
    Ended {
        reason: Some(format!("{what} of the flight are lost: the disk was too slow")),
        stopped: false,
        data_lost: true,
    }
}
