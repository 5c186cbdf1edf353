//! From records to what traces need: batches of rows, thinned to what a screen can show.

use std::{collections::VecDeque, fmt::Write as _};

use bench_device::{PositionSample, TrackStatus};
use bench_recording::{Level, Record};
use bench_rig::{Phase, Rig};
use serde_json::json;

/// Rows of one kind are at least so far apart in flight time, s: 100 Hz of traces.
pub(crate) const GRID_S: f64 = 0.01;
/// Rows of one kind in a batch; a flight faster than real time is thinned to them.
const ROWS: usize = 500;
/// Events in a batch.
const EVENTS: usize = 50;

/// Rows of one kind since the last batch. The first column is the time, s.
struct Rows<const N: usize> {
    rows: Vec<[f64; N]>,
    /// Brings together two rows of one cell of the grid, the later one second.
    merge: fn([f64; N], [f64; N]) -> [f64; N],
}

impl<const N: usize> Rows<N> {
    fn new(merge: fn([f64; N], [f64; N]) -> [f64; N]) -> Self {
        Self { rows: Vec::new(), merge }
    }

    fn add(&mut self, row: [f64; N]) {
        let cell = |row: &[f64; N]| (row[0] / GRID_S).floor();
        match self.rows.last_mut() {
            Some(last) if cell(last) == cell(&row) => *last = (self.merge)(*last, row),
            _ => self.rows.push(row),
        }
    }

    /// Writes the rows as a member of a JSON object, and forgets them.
    fn write(&mut self, name: &str, out: &mut String) {
        if self.rows.is_empty() {
            return;
        }
        let together = self.rows.len().div_ceil(ROWS);
        // Writing to a String cannot fail.
        let _ = write!(out, ",\"{name}\":[");
        for (index, rows) in self.rows.chunks(together).enumerate() {
            let Some(row) = rows.iter().copied().reduce(self.merge) else { continue };
            out.push_str(if index == 0 { "[" } else { ",[" });
            for (column, value) in row.into_iter().enumerate() {
                if column > 0 {
                    out.push(',');
                }
                number(value, out);
            }
            out.push(']');
        }
        out.push(']');
        self.rows.clear();
    }
}

fn later<const N: usize>(_: [f64; N], later: [f64; N]) -> [f64; N] {
    later
}

/// Of iterations that share a cell, the worst is shown.
fn worst<const N: usize>(mut row: [f64; N], later: [f64; N]) -> [f64; N] {
    for (value, other) in row.iter_mut().zip(later) {
        *value = value.max(other);
    }
    row
}

/// Four decimals as far as they are needed; what is no number is `null`.
fn number(value: f64, out: &mut String) {
    if !value.is_finite() {
        out.push_str("null");
        return;
    }
    let from = out.len();
    let _ = write!(out, "{value:.4}");
    let kept = out[from..].trim_end_matches('0').trim_end_matches('.').len();
    out.truncate(from + kept);
    if out.get(from..) == Some("-0") {
        out.truncate(from);
        out.push('0');
    }
}

/// The records of a flight on their way to the traces.
pub(crate) struct Telemetry {
    /// Over which the measured velocity is taken, s.
    window_s: f64,
    period_s: f64,
    seen: VecDeque<(f64, [f64; 3])>,
    position: Rows<10>,
    control: Rows<12>,
    command: Rows<5>,
    readback: Rows<6>,
    truth: Rows<11>,
    tick: Rows<5>,
    events: Vec<String>,
    events_left_out: u64,
    ticks: u64,
    overruns: u64,
    lost: u64,
    lateness_max_s: f64,
    phase: Option<Phase>,
}

impl Telemetry {
    pub(crate) fn new(rig: &Rig) -> Self {
        Self {
            // Two frames at least, so that there is a slope.
            window_s: rig.control.velocity_window_s.max(2.5 * rig.tracker.frame_period_s),
            period_s: rig.control_loop.period_s,
            seen: VecDeque::new(),
            position: Rows::new(later),
            control: Rows::new(later),
            command: Rows::new(later),
            readback: Rows::new(later),
            truth: Rows::new(later),
            tick: Rows::new(worst),
            events: Vec::new(),
            events_left_out: 0,
            ticks: 0,
            overruns: 0,
            lost: 0,
            lateness_max_s: 0.0,
            phase: None,
        }
    }

    pub(crate) fn take(&mut self, record: &Record) {
        match record {
            Record::Position(sample) => self.sighted(sample),
            Record::ControlState(state) => {
                self.phase = Some(state.phase);
                let phase = Phase::ALL.iter().position(|phase| *phase == state.phase).unwrap_or_default();
                let [sx, sy, sz] = if state.phase == Phase::Hold || state.phase == Phase::Land {
                    state.setpoint_m
                } else {
                    [f64::NAN; 3]
                };
                let ([ex, ey, ez], [u, v, w]) = (state.estimate_m, state.estimate_m_s);
                let climb_m_s = if sz.is_nan() { sz } else { state.vertical_speed_setpoint_m_s };
                self.control.add([
                    state.time.seconds(),
                    phase as f64,
                    sx,
                    sy,
                    sz,
                    ex,
                    ey,
                    ez,
                    u,
                    v,
                    w,
                    climb_m_s,
                ]);
            }
            Record::Command(command) => {
                let [throttle, pitch, roll, yaw] = command.sticks.to_array();
                self.command.add([command.time.seconds(), throttle, pitch, roll, yaw]);
            }
            Record::Readback(at) => {
                let [throttle, pitch, roll, yaw] = at.readback.sticks.to_array();
                let faults = f64::from(at.readback.faults.bits());
                self.readback.add([at.time.seconds(), throttle, pitch, roll, yaw, faults]);
            }
            Record::Truth(truth) => {
                let ([x, y, z], [u, v, w], [qw, qx, qy, qz]) =
                    (truth.position_m, truth.velocity_m_s, truth.attitude);
                self.truth.add([truth.time.seconds(), x, y, z, u, v, w, qw, qx, qy, qz]);
            }
            Record::Tick(tick) => {
                let lateness_s = tick.started.since_s(tick.scheduled);
                let took_s = tick.sense_s + tick.control_s + tick.actuate_s;
                self.ticks += 1;
                self.overruns += u64::from(tick.overrun);
                self.lateness_max_s = self.lateness_max_s.max(lateness_s);
                let [lateness_ms, took_ms, actuate_ms] =
                    [lateness_s, took_s, tick.actuate_s].map(|s| s * 1e3);
                let overrun = f64::from(u8::from(tick.overrun));
                self.tick.add([tick.scheduled.seconds(), lateness_ms, took_ms, actuate_ms, overrun]);
            }
            Record::Event(event) => {
                let level = match event.level {
                    Level::Info => "info",
                    Level::Warning => "warning",
                    Level::Error => "error",
                };
                if self.events.len() < EVENTS {
                    self.events.push(json!([event.time.seconds(), level, event.text.as_str()]).to_string());
                } else {
                    self.events_left_out += 1;
                }
            }
            // What a flight of ours does not record.
            Record::Motion(_) | Record::Battery(_) | Record::Rotor(_) => {}
        }
    }

    /// The phase of the last iteration.
    pub(crate) fn phase(&self) -> Option<Phase> {
        self.phase
    }

    fn sighted(&mut self, sample: &PositionSample) {
        let time_s = sample.exposed_at.seconds();
        let [px, py] = sample.pixel;
        if sample.status == TrackStatus::Lost {
            self.lost += 1;
            let nowhere = f64::NAN;
            self.position.add([time_s, nowhere, nowhere, nowhere, nowhere, nowhere, nowhere, 1.0, px, py]);
            return;
        }
        self.seen.push_back((time_s, sample.position_m));
        while self.seen.front().is_some_and(|(before_s, _)| time_s - before_s > self.window_s) {
            self.seen.pop_front();
        }
        let [x, y, z] = sample.position_m;
        let [u, v, w] = [0, 1, 2].map(|axis| self.slope(axis));
        let status = if sample.status == TrackStatus::Ambiguous { 2.0 } else { 0.0 };
        self.position.add([time_s, x, y, z, u, v, w, status, px, py]);
    }

    /// Velocity of an axis over the window by least squares, m/s; NaN while there are too few positions.
    fn slope(&self, axis: usize) -> f64 {
        let count = self.seen.len() as f64;
        if count < 3.0 {
            return f64::NAN;
        }
        let mean_s = self.seen.iter().map(|(time_s, _)| time_s).sum::<f64>() / count;
        let (over, under) = self.seen.iter().fold((0.0, 0.0), |(over, under), (time_s, position_m)| {
            let away_s = time_s - mean_s;
            (over + away_s * position_m[axis], under + away_s * away_s)
        });
        over / under
    }

    /// What came since the last batch, as JSON; `None` if nothing did.
    pub(crate) fn batch(&mut self, missed: u64) -> Option<String> {
        let mut rows = String::new();
        self.position.write("position", &mut rows);
        self.control.write("control", &mut rows);
        self.command.write("outputs", &mut rows);
        self.readback.write("readback", &mut rows);
        self.truth.write("truth", &mut rows);
        self.tick.write("tick", &mut rows);
        if !self.events.is_empty() {
            let _ = write!(rows, ",\"event\":[{}]", self.events.join(","));
            self.events.clear();
        }
        if rows.is_empty() {
            return None;
        }
        let totals = json!({
            "ticks": self.ticks, "overruns": self.overruns, "lost": self.lost, "missed": missed,
            "events_left_out": self.events_left_out,
            "lateness_max_ms": self.lateness_max_s * 1e3, "period_ms": self.period_s * 1e3,
        });
        Some(format!("{{\"type\":\"batch\",\"totals\":{totals}{rows}}}"))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_device::Time;
    use bench_recording::{Event, EventText, Tick, Truth};
    use serde_json::Value;

    use super::*;

    fn telemetry() -> Telemetry {
        let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
        Telemetry::new(&Rig::load(rig).unwrap())
    }

    fn batch(telemetry: &mut Telemetry) -> Value {
        serde_json::from_str(&telemetry.batch(0).unwrap()).unwrap()
    }

    #[test]
    fn measured_velocity_is_the_slope_of_what_was_seen() {
        let mut telemetry = telemetry();
        for i in 0..10 {
            let time_s = f64::from(i) / 30.0;
            let sample = PositionSample {
                exposed_at: Time::from_seconds(time_s),
                position_m: [0.1, -0.2 * time_s, 0.5 * time_s],
                status: if i == 5 { TrackStatus::Lost } else { TrackStatus::Found },
                ..PositionSample::default()
            };
            telemetry.take(&sample.into());
        }
        let batch = batch(&mut telemetry);
        let rows = batch["position"].as_array().unwrap();
        assert_eq!((rows.len(), &rows[1][4], &rows[5][1]), (10, &Value::Null, &Value::Null));
        assert_eq!([4, 5, 6].map(|column| rows[9][column].as_f64()), [0.0, -0.2, 0.5].map(Some));
        assert_eq!(batch["totals"]["lost"], 1);
        assert_eq!(telemetry.batch(0), None, "nothing came since");
    }

    #[test]
    fn a_fast_loop_is_thinned_to_the_grid_and_its_worst_iteration_shown() {
        let mut telemetry = telemetry();
        for index in 0..1000 {
            let scheduled = Time::from_seconds(index as f64 / 1000.0);
            let lateness_s = if index == 503 { 0.0007 } else { 0.00001 };
            let started = scheduled.shifted(lateness_s);
            telemetry
                .take(&Tick { index, scheduled, started, overrun: index == 777, ..Tick::default() }.into());
        }
        let batch = batch(&mut telemetry);
        let rows = batch["tick"].as_array().unwrap();
        assert_eq!(rows.len(), 100);
        assert_eq!((&rows[50][1], &rows[49][1], &rows[77][4]), (&0.7.into(), &0.01.into(), &1.into()));
        let totals = &batch["totals"];
        assert_eq!((&totals["ticks"], &totals["overruns"]), (&1000.into(), &1.into()));
    }

    #[test]
    fn a_flight_faster_than_time_fits_into_a_batch() {
        let mut telemetry = telemetry();
        for i in 0..20_000 {
            let time = Time::from_seconds(f64::from(i) * 0.02);
            telemetry.take(&Truth { time, position_m: [0.0, 0.0, f64::NAN], ..Truth::default() }.into());
            let text = EventText::from("so it \"goes\"").unwrap();
            telemetry.take(&Event { time, level: Level::Info, text }.into());
        }
        let batch = batch(&mut telemetry);
        assert_eq!(batch["truth"].as_array().unwrap().len(), 500);
        assert_eq!(batch["truth"][499][0], 399.98);
        assert_eq!(batch["truth"][0][3], Value::Null);
        assert_eq!(batch["event"].as_array().unwrap().len(), 50);
        assert_eq!(batch["totals"]["events_left_out"], 19_950);
    }

    #[test]
    fn numbers_are_short() {
        let told = [1.0, 0.5, -0.00001, 12.34567, f64::NAN, 65_535.0, 100.0].map(|value| {
            let mut out = String::new();
            number(value, &mut out);
            out
        });
        assert_eq!(told, ["1", "0.5", "0", "12.3457", "null", "65535", "100"]);
    }
}
