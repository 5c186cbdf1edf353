//! What is said of a flight, on whichever bench it was flown.

use std::fmt::Write as _;

use bench_page::Tone;
use bench_recording::{Finished, RecordingError};
use bench_rig::{Mission, Rig};
use bench_run::{Check, Ending, Flown};
use serde_json::json;

use crate::{exit::Exit, seen::Watch, words};

/// A flight as told to a person or a program.
pub struct Flight<'a> {
    pub rig: &'a Rig,
    pub mission: &'a Mission,
    pub seed: u64,
    pub flown: &'a Flown,
    pub checks: &'a [Check],
    /// What became of the frames, if there were any.
    pub watch: Option<&'a Watch>,
}

impl Flight<'_> {
    pub fn exit(&self) -> Exit {
        match &self.flown.ending {
            Ending::Stopped(_) | Ending::Fault(_) | Ending::Panicked(_) => Exit::Stopped,
            Ending::Complete if self.checks.iter().all(|check| check.passed) => Exit::Done,
            Ending::Complete => Exit::CheckFailed,
        }
    }

    /// How it ended, in a sentence.
    pub fn headline(&self) -> String {
        match (&self.flown.ending, self.exit()) {
            (Ending::Stopped(reason), _) => format!("Stopped: {reason}"),
            (Ending::Fault(error), _) => format!("Fault: {error}"),
            (Ending::Panicked(_), _) => "The program failed; the throttle went to rest".to_owned(),
            (Ending::Complete, Exit::Done) => "Flown, and all criteria met".to_owned(),
            (Ending::Complete, _) => "Flown, but criteria were missed".to_owned(),
        }
    }

    /// What flew where.
    pub fn name(&self) -> String {
        let (mission, airframe) = (&self.mission.name, &self.rig.airframe.name);
        format!("{mission} with {airframe} on rig {}, seed {}", self.rig.name, self.seed)
    }

    /// Name, value, unit of every figure that the flight defines.
    fn figures(&self) -> Vec<(&'static str, f64, &'static str)> {
        let s = &self.flown.summary;
        [
            ("peak", s.peak_m, "m"),
            ("overshoot", s.overshoot_m, "m"),
            ("settling time", s.settling_time_s, "s"),
            ("RMS error", s.rms_error_m, "m"),
            ("lateral RMS error", s.lateral_rms_error_m, "m"),
            ("rebound at", s.rebound_m, "m"),
            ("overruns", Some(s.overruns as f64), ""),
        ]
        .into_iter()
        .filter_map(|(name, value, unit)| Some((name, value?, unit)))
        .collect()
    }

    /// Effects, figures, ending, criteria and the recording, a line each.
    pub fn in_words(&self, finished: &Result<Finished, RecordingError>) -> String {
        let mut out = String::new();
        for effect in &self.rig.effects {
            let values: Vec<_> = effect.parameters.iter().map(|(key, x, _)| format!("{key} = {x}")).collect();
            let _ = writeln!(out, "  with {}: {}", effect.name, values.join(", "));
        }
        for (name, value, unit) in self.figures() {
            let digits = match unit {
                "m" => 3,
                "s" => 2,
                _ => 0,
            };
            let _ = writeln!(out, "{}", format!("  {name:<18} {value:>8.digits$} {unit}").trim_end());
        }
        if let Some(watch) = self.watch {
            out += &watch.in_words();
        }
        match &self.flown.ending {
            Ending::Complete => {}
            Ending::Stopped(reason) => {
                _ = writeln!(out, "  {}: {reason}", words::toned(Tone::Bad, "stopped"));
            }
            Ending::Fault(error) => _ = writeln!(out, "  {}: {error}", words::toned(Tone::Bad, "fault")),
            Ending::Panicked(words) => {
                _ = writeln!(out, "  the program failed ({words}); please report it with the recording");
            }
        }
        for check in self.checks {
            let value = check.value.map_or("not reached".to_owned(), |value| format!("{value:.3}"));
            let relation = if check.at_least { "at least" } else { "at most" };
            let verdict = words::passed(check.passed);
            let _ = writeln!(out, "  {verdict}  {}: {value}, {relation} {}", check.key, check.limit);
        }
        if let Ok(finished) = finished {
            let _ = writeln!(
                out,
                "recorded {} ({}) to {}",
                words::count(finished.messages, "message"),
                words::size(finished.bytes),
                finished.path.display()
            );
        }
        out
    }

    pub fn as_json(&self, schema: &str, finished: &Result<Finished, RecordingError>) -> serde_json::Value {
        let s = &self.flown.summary;
        let (ending, reason) = match &self.flown.ending {
            Ending::Complete => ("complete", None),
            Ending::Stopped(reason) => ("stopped", Some(reason.to_string())),
            Ending::Fault(error) => ("fault", Some(error.to_string())),
            Ending::Panicked(words) => ("panicked", Some(words.clone())),
        };
        let checks: Vec<_> = self
            .checks
            .iter()
            .map(|c| json!({ "key": c.key, "value": c.value, "limit": c.limit, "passed": c.passed }))
            .collect();
        let recording = finished.as_ref().ok().map(|finished| {
            json!({ "path": finished.path, "messages": finished.messages, "bytes": finished.bytes })
        });
        json!({
            "schema": schema,
            "rig": self.rig.name,
            "airframe": self.rig.airframe.name,
            "mission": self.mission.name,
            "seed": self.seed,
            "effects": self.rig.effects.iter().map(|effect| json!({
                "name": effect.name,
                "parameters": effect.parameters.iter()
                    .map(|(key, value, _)| (key.clone(), json!(value)))
                    .collect::<serde_json::Map<_, _>>(),
            })).collect::<Vec<_>>(),
            "tracking": self.watch.map(Watch::as_json),
            "ending": ending,
            "reason": reason,
            "passed": self.exit() == Exit::Done,
            "summary": {
                "duration_s": s.duration_s,
                "peak_m": s.peak_m,
                "overshoot_m": s.overshoot_m,
                "settling_time_s": s.settling_time_s,
                "rms_error_m": s.rms_error_m,
                "lateral_rms_error_m": s.lateral_rms_error_m,
                "rebound_m": s.rebound_m,
                "ticks": s.ticks,
                "overruns": s.overruns,
                "lateness_max_s": s.lateness_max_s,
                "positions": s.positions,
            },
            "checks": checks,
            "recording": recording,
        })
    }
}
