use std::fmt::Write as _;

use bench_dac::{LinkCounts, Safe};
use bench_recording::{Finished, RecordingError};
use bench_rig::{Mission, Rig};
use bench_run::{Check, Flown, Percentiles};
use bench_view::Outcome;
use serde_json::{Value, json};

use super::loop_thread::{Ready, Saw};
use crate::{exit::Exit, eyes, flight::Flight, live};

/// A flight on hardware as told to a person or a program.
pub struct Report<'a> {
    pub rig: &'a Rig,
    pub mission: &'a Mission,
    pub seed: u64,
    pub port: &'a str,
    pub ready: &'a Ready,
    pub flown: &'a Flown,
    pub safe: &'a Safe,
    pub counts: LinkCounts,
    pub saw: Option<&'a Saw>,
    pub checks: Vec<Check>,
}

impl Report<'_> {
    fn flight(&self) -> Flight<'_> {
        let Self { rig, mission, seed, flown, saw, ref checks, .. } = *self;
        Flight { rig, mission, seed, flown, checks, watch: saw.map(|saw| &saw.watch) }
    }

    /// A flight whose outputs nobody saw at zero in the end was no success.
    pub fn exit(&self) -> Exit {
        if matches!(self.safe, Safe::Unconfirmed(_)) { Exit::Stopped } else { self.flight().exit() }
    }

    /// The flight as the live page tells it.
    pub fn outcome(&self, finished: &Result<Finished, RecordingError>) -> Outcome {
        let outcome = live::outcome(&self.flight(), &self.in_words(finished));
        Outcome { passed: self.exit() == Exit::Done, ..outcome }
    }

    pub fn in_words(&self, finished: &Result<Finished, RecordingError>) -> String {
        let summary = &self.flown.summary;
        let mut out = format!("{}: {:.1} s flown in real time\n", self.flight().name(), summary.duration_s);
        let mut time = |name: &str, p: &Percentiles| {
            let [p50, p99, max] = [p.p50, p.p99, p.max].map(|s| s * 1e3);
            let _ = writeln!(out, "  {name:<18} p50 {p50:.3}, p99 {p99:.3}, max {max:.3} ms");
        };
        time("tick lateness", &summary.timing.lateness_s);
        time("round trip", &summary.timing.round_trip_s);
        let LinkCounts { asked, lost, late, stale, corrupt } = self.counts;
        let _ = writeln!(
            out,
            "  {:<18} {asked} commands, {lost} without answer, {late} too late, {stale} stale and {corrupt} corrupt answers",
            "link"
        );
        if let Some(saw) = self.saw {
            let _ = writeln!(out, "  {:<18} {}", "Kinect", eyes::in_words(&saw.statistics));
        }
        out.push_str(&self.flight().in_words(finished));
        match self.safe {
            Safe::Confirmed { reconnected, faults } => {
                let how = if *reconnected { "after opening the port again, " } else { "" };
                let _ = writeln!(out, "{how}outputs seen at zero, board disarmed");
                for (is, what) in [
                    (faults.watchdog, "no voltages reached it for 300 ms"),
                    (faults.brown_out, "its supply sagged; give it a better one"),
                    (faults.mismatch, "its outputs did not read what they were set to; check the wires"),
                ] {
                    if is {
                        let _ = writeln!(out, "the board says: {what}");
                    }
                }
            }
            Safe::Unconfirmed(error) => {
                let _ = writeln!(
                    out,
                    "outputs NOT seen at zero ({error}); the board zeroes them by itself 300 ms after the last voltages"
                );
            }
        }
        out
    }

    pub fn as_json(&self, finished: &Result<Finished, RecordingError>) -> Value {
        let mut value = self.flight().as_json("bench.hil/1", finished);
        let summary = &self.flown.summary;
        let times = |p: &Percentiles| json!({ "p50": p.p50, "p99": p.p99, "max": p.max });
        let safe = match self.safe {
            Safe::Confirmed { reconnected, faults } => json!({
                "confirmed": true, "reconnected": reconnected,
                "faults": { "watchdog": faults.watchdog, "brown_out": faults.brown_out, "mismatch": faults.mismatch },
            }),
            Safe::Unconfirmed(error) => json!({ "confirmed": false, "reason": error.to_string() }),
        };
        let more = json!({
            "port": self.port,
            "board": self.ready.identity.to_string(),
            "scheduling": {
                "real_time": self.ready.granted.no_priority.is_none(),
                "memory_locked": self.ready.granted.no_lock.is_none(),
            },
            "calibration": self.ready.calibration.0.map(|channel| json!({
                "gain": channel.gain, "offset_v": channel.offset_v, "residual_v": channel.residual_v,
            })),
            "timing": {
                "lateness_s": times(&summary.timing.lateness_s),
                "round_trip_s": times(&summary.timing.round_trip_s),
                "unanswered": summary.unanswered,
            },
            "link": {
                "asked": self.counts.asked, "lost": self.counts.lost, "late": self.counts.late,
                "stale": self.counts.stale, "corrupt": self.counts.corrupt,
            },
            "outputs_at_zero": safe,
            "kinect": self.saw.map(|saw| eyes::as_json(&saw.statistics)),
        });
        if let (Value::Object(value), Value::Object(more)) = (&mut value, more) {
            value.extend(more);
            value.insert("passed".to_owned(), json!(self.exit() == Exit::Done));
        }
        value
    }
}
