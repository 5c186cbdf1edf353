//! A run, done: its row in the table of results.

use std::{
    any::Any,
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    time::{Duration, Instant},
};

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_inference::Problem;
use bench_recording::{CellKind, Flight, Mode, Record, Session};
use bench_rig::{EffectEntry, Rig};
use bench_run::{Ending, Flown, Simulation, Summary, check, simulate_on, simulate_together};

use crate::{
    file::{Airframes, Diagnosing, Kind},
    learn::is_right,
    mix,
    plan::{FlightRun, Plan, Run, Work, sha256},
    table::{Cell, Column},
};

/// A run that was done.
#[derive(Clone, Debug)]
pub struct Done {
    /// Its cells, in the order of [`columns`].
    pub row: Vec<Cell>,
    /// What it came to.
    pub outcome: Outcome,
    /// How long it took, by this machine's clock.
    pub took: Duration,
}

/// What a run came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// A flight that met its mission's criteria.
    Passed,
    /// A flight that missed some.
    Missed,
    /// A flight that a safety limit stopped.
    Stopped,
    /// A diagnosis that was made.
    Diagnosed,
    /// It could not be done; the row says why.
    Error,
}

impl Outcome {
    /// All of them, in the order in which they are told.
    pub const ALL: [Self; 5] = [Self::Passed, Self::Missed, Self::Stopped, Self::Diagnosed, Self::Error];

    /// Its name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Missed => "missed",
            Self::Stopped => "stopped",
            Self::Diagnosed => "diagnosed",
            Self::Error => "error",
        }
    }
}

/// The name of a parameter's column.
pub(crate) fn parameter_column(effect: &str, key: &str) -> String {
    format!("{}_{key}", effect.replace('-', "_"))
}

/// What of a drawn airframe is told.
const DRAWN: [&str; 6] = [
    "drawn_mass_kg",
    "drawn_thrust_gain_n_per_unit",
    "drawn_thrust_offset",
    "drawn_ground_effect_multiplier",
    "drawn_ground_effect_height_m",
    "drawn_drag_n_s_per_m",
];

fn drawn(plant: &Rig) -> [f64; 6] {
    let a = &plant.airframe;
    [
        a.mass_kg.value,
        a.thrust.gain_n_per_unit.value,
        a.thrust.offset.value,
        a.ground_effect.multiplier.value,
        a.ground_effect.height_m.value,
        a.drag_n_s_per_m.value,
    ]
}

/// A drawn airframe in a line.
pub(crate) fn drawn_in_words(plant: &Rig) -> String {
    let numbers = DRAWN.iter().zip(drawn(plant));
    let of = |(name, value): (&&str, f64)| format!("{}={value}", name.trim_start_matches("drawn_"));
    numbers.map(of).collect::<Vec<_>>().join(", ")
}

/// Figures of a flight.
const FIGURES: [&str; 7] = [
    "duration_s",
    "peak_m",
    "overshoot_m",
    "settling_time_s",
    "rms_error_m",
    "lateral_rms_error_m",
    "rebound_m",
];

/// Numbers that a diagnosis tells.
const NUMBERS_TOLD: [&str; 6] =
    ["confidence", "gap_nominal", "gap_parameters_only", "gap_with_effect", "gap_floor", "closure"];

/// The columns of a plan's results: what was asked for, then what came of it. All plans have those that reports need.
pub fn columns(plan: &Plan) -> Vec<Column> {
    use CellKind::{Flag, Integer, Number, Text};
    let file = plan.file();
    let of = |names: &[&str], kind| names.iter().map(|name| Column::new(*name, kind)).collect::<Vec<_>>();
    let mut columns = of(&["id"], Text);
    columns.extend(of(&["run"], Integer));
    columns.extend(of(&["rig", "mission", "variant", "effects", "recording"], Text));
    columns.extend(of(&["seed"], Integer));
    let parameters = plan.parameters();
    columns.extend(parameters.iter().map(|(effect, key)| Column::new(parameter_column(effect, key), Number)));
    if file.airframes == Airframes::Drawn {
        columns.extend(of(&DRAWN, Number));
    }
    columns.extend(of(&["outcome", "reason"], Text));
    if file.kind == Kind::Flights {
        columns.extend(of(&["missed"], Text));
        columns.extend(of(&FIGURES, Number));
        columns.extend(of(&["ticks", "overruns", "positions"], Integer));
    }
    if is_diagnosed(plan) {
        columns.extend(of(&["verdict", "named"], Text));
        columns.extend(of(&["right"], Flag));
        columns.extend(of(&NUMBERS_TOLD, Number));
        columns.extend(of(&["flights_used"], Integer));
    }
    columns
}

fn is_diagnosed(plan: &Plan) -> bool {
    plan.file().kind != Kind::Flights || plan.file().diagnosis == Diagnosing::Each
}

/// What came of a run, before it is a row.
#[derive(Default)]
struct Found {
    outcome: Option<Outcome>,
    reason: String,
    missed: String,
    summary: Option<Summary>,
    told: Option<Told>,
}

struct Told {
    verdict: &'static str,
    named: String,
    right: Option<bool>,
    numbers: [Option<f64>; 6],
    flights: usize,
}

/// Does a run. Whatever goes wrong becomes its row.
pub fn perform(plan: &Plan, index: u64) -> Done {
    let began = Instant::now();
    let run = plan.run(index);
    let found = caught(|| found(&run)).unwrap_or_else(|words| {
        Err(format!("the program failed ({words}); please report it with the run's id"))
    });
    done(plan, &run, found, began.elapsed())
}

fn done(plan: &Plan, run: &Run<'_>, found: Result<Found, String>, took: Duration) -> Done {
    let found =
        found.unwrap_or_else(|reason| Found { outcome: Some(Outcome::Error), reason, ..Found::default() });
    let outcome = found.outcome.unwrap_or(Outcome::Diagnosed);
    Done { row: row(plan, run, &found, outcome), outcome, took }
}

/// How many runs [`perform_together`] is best given: flights enough to keep its lanes full, and diagnoses one by one.
pub fn runs_together(plan: &Plan) -> u64 {
    const FLIGHTS: u64 = 40;
    if is_diagnosed(plan) { 1 } else { FLIGHTS }
}

/// Does several runs, in the order given. Each comes to what [`perform`] makes of it; flights that nobody diagnoses are simulated
/// together, and took the same time each.
pub fn perform_together(plan: &Plan, indices: impl IntoIterator<Item = u64>) -> Vec<Done> {
    let indices: Vec<u64> = indices.into_iter().collect();
    let alone = || indices.iter().map(|index| perform(plan, *index)).collect();
    if is_diagnosed(plan) {
        return alone();
    }
    let began = Instant::now();
    let runs: Vec<Run<'_>> = indices.iter().map(|index| plan.run(*index)).collect();
    let mut flights = Vec::with_capacity(runs.len());
    for run in &runs {
        let Work::Flight(flight) = &run.work else { return alone() };
        flights.push(&**flight);
    }
    let simulations: Vec<Simulation<'_>> = flights
        .iter()
        .map(|FlightRun { plant, nominal: rig, mission, seed, .. }| Simulation {
            plant,
            rig,
            mission,
            seed: *seed,
        })
        .collect();
    // If the program fails, it fails in one of them: each is tried alone then, and that one's row says so.
    let Ok(flown) = caught(|| simulate_together(&simulations)) else { return alone() };
    let took = began.elapsed() / u32::try_from(runs.len()).unwrap_or(u32::MAX).max(1);
    let found = flown.into_iter().zip(flights);
    let found = found.map(|(flown, flight)| match flown {
        Ok(flown) => Ok(judged(flight, flown)),
        Err(error) => Err(error.to_string()),
    });
    runs.iter().zip(found).map(|(run, found)| done(plan, run, found, took)).collect()
}

/// What some work gives, or the words with which it panicked: one run among thousands that fails is no end of the others.
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    // Nothing that a panic left half done is looked at again.
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message").to_owned()
    })
}

fn found(run: &Run<'_>) -> Result<Found, String> {
    match &run.work {
        Work::Flight(flight) => flown(flight),
        Work::Recording { rig, path, sha256: expected } => {
            let flight = recorded(path, expected)?;
            let carried;
            let rig = if let Some((_, rig)) = rig {
                check_airframe(rig, &flight)?;
                *rig
            } else {
                carried = carried_rig(&flight)?;
                &carried
            };
            let track = Track::from_flight(&path.display().to_string(), &flight, rig)
                .map_err(|error| error.to_string())?;
            Ok(Found { told: Some(diagnosed(&[track], rig, None)), ..Found::default() })
        }
        Work::Set { rig, missions, causes, set, .. } => {
            let tracks = mix::tracks(rig, causes, missions, *set).map_err(|error| error.to_string())?;
            if tracks.is_empty() {
                return Err("none of the set's flights can be diagnosed".to_owned());
            }
            Ok(Found { told: Some(diagnosed(&tracks, rig, Some(causes))), ..Found::default() })
        }
    }
}

fn flown(flight: &FlightRun<'_>) -> Result<Found, String> {
    let mut records: Vec<Record> = Vec::new();
    let FlightRun { plant, nominal, mission, seed, .. } = flight;
    let flown = if flight.is_diagnosed {
        simulate_on(plant, nominal, mission, *seed, &mut records, |_| true)
    } else {
        simulate_on(plant, nominal, mission, *seed, &mut (), |_| true)
    };
    let mut found = judged(flight, flown.map_err(|error| error.to_string())?);
    if flight.is_diagnosed {
        let recorded = Flight::from_records(Session::new(Mode::Sim), records);
        match Track::from_flight(flight.mission_name, &recorded, nominal) {
            Ok(track) => found.told = Some(diagnosed(&[track], nominal, Some(&flight.effects))),
            Err(error) => found.reason = error.to_string(),
        }
    }
    Ok(found)
}

/// A flight held against its mission's criteria.
fn judged(flight: &FlightRun<'_>, flown: Flown) -> Found {
    let checks = check(&flight.mission.criteria, &flown.summary);
    let missed: Vec<&str> = checks.iter().filter(|check| !check.passed).map(|check| check.key).collect();
    let (outcome, reason) = match flown.ending {
        Ending::Complete if missed.is_empty() => (Outcome::Passed, String::new()),
        Ending::Complete => (Outcome::Missed, String::new()),
        Ending::Stopped(why) => (Outcome::Stopped, why.to_string()),
        Ending::Fault(error) => (Outcome::Error, error.to_string()),
        Ending::Panicked(words) => (Outcome::Error, words),
    };
    Found {
        outcome: Some(outcome),
        reason,
        missed: missed.join(","),
        summary: Some(flown.summary),
        told: None,
    }
}

fn recorded(path: &Path, expected: &str) -> Result<Flight, String> {
    let bytes = fs::read(path).map_err(|error| format!("{} cannot be read: {error}", path.display()))?;
    if sha256(bytes) != expected {
        return Err(format!("{} was changed since the sweep was begun", path.display()));
    }
    Flight::load(path).map_err(|error| error.to_string())
}

fn carried_rig(flight: &Flight) -> Result<Rig, String> {
    let text = flight
        .session
        .rig_toml
        .as_deref()
        .ok_or("it carries no rig; name the nominal model in the plan's `rigs`")?;
    Rig::read(Path::new("rig.toml"), text).map_err(|error| error.to_string())
}

/// A model of another airframe is no model of the flight.
fn check_airframe(rig: &Rig, flight: &Flight) -> Result<(), String> {
    let Ok(own) = carried_rig(flight) else { return Ok(()) };
    if own.airframe.name != rig.airframe.name || own.airframe.actuation != rig.airframe.actuation {
        return Err(format!(
            "it was flown by the airframe {}, the rig {} is of {}: it cannot be a model of that flight",
            own.airframe.name, rig.name, rig.airframe.name
        ));
    }
    Ok(())
}

/// One flight or set; `causes` are its effects, where they are known.
fn diagnosed(tracks: &[Track], rig: &Rig, causes: Option<&[EffectEntry]>) -> Told {
    let found = Diagnosis::of(&Problem::new(tracks, rig), &Calibration::built_in());
    let gap = &found.gap;
    let figures =
        [&gap.nominal, &gap.parameters_only, &gap.with_effect, &gap.floor].map(|figure| Some(figure.value));
    Told {
        verdict: match found.verdict {
            Verdict::Effect => "effect",
            Verdict::None => "none",
            Verdict::Unknown => "unknown",
        },
        named: found.effects.join("+"),
        right: causes.map(|causes| is_right(found.verdict, &found.effects, causes)),
        numbers: [
            Some(found.confidence),
            figures[0],
            figures[1],
            figures[2],
            figures[3],
            gap.closure.as_ref().map(|closure| closure.value),
        ],
        flights: tracks.len(),
    }
}

/// An effect as `--effect` takes it.
pub(crate) fn effect_in_words(effect: &EffectEntry) -> String {
    let values: Vec<_> = effect.parameters.iter().map(|(key, x, _)| format!("{key}={x}")).collect();
    format!("{}:{}", effect.name, values.join(","))
}

fn row(plan: &Plan, run: &Run<'_>, found: &Found, outcome: Outcome) -> Vec<Cell> {
    let none: &[EffectEntry] = &[];
    let absent = String::new;
    let (rig, mission, variant, effects, recording, seed) = match &run.work {
        Work::Flight(flight) => (
            flight.rig_name,
            flight.mission_name.to_owned(),
            flight.variant,
            flight.effects.as_slice(),
            absent(),
            Some(flight.seed),
        ),
        Work::Recording { rig, path, .. } => {
            (rig.map_or("", |(name, _)| name), absent(), "", none, path.display().to_string(), None)
        }
        Work::Set { rig_name, causes, set, .. } => (*rig_name, absent(), "", *causes, absent(), Some(*set)),
    };
    let integer = |n: Option<u64>| n.and_then(|n| i64::try_from(n).ok()).map_or(Cell::Absent, Cell::Integer);
    let mut row = vec![
        Cell::text(run.id.as_str()),
        integer(Some(run.index)),
        Cell::words(rig),
        Cell::words(mission),
        Cell::words(variant),
        Cell::words(effects.iter().map(effect_in_words).collect::<Vec<_>>().join(" + ")),
        Cell::words(recording),
        integer(seed),
    ];
    for (name, key) in plan.parameters() {
        let effect = effects.iter().find(|effect| effect.name == name);
        let value = effect.and_then(|effect| effect.parameters.iter().find(|(given, ..)| given == key));
        row.push(Cell::number(value.map(|(_, value, _)| *value)));
    }
    if let (Airframes::Drawn, Work::Flight(flight)) = (plan.file().airframes, &run.work) {
        row.extend(drawn(&flight.plant).map(|value| Cell::number(Some(value))));
    }
    row.push(Cell::text(outcome.name()));
    row.push(Cell::words(found.reason.as_str()));
    if plan.file().kind == Kind::Flights {
        row.push(Cell::words(found.missed.as_str()));
        let s = found.summary.as_ref();
        row.extend([
            Cell::number(s.map(|s| s.duration_s)),
            Cell::number(s.and_then(|s| s.peak_m)),
            Cell::number(s.and_then(|s| s.overshoot_m)),
            Cell::number(s.and_then(|s| s.settling_time_s)),
            Cell::number(s.and_then(|s| s.rms_error_m)),
            Cell::number(s.and_then(|s| s.lateral_rms_error_m)),
            Cell::number(s.and_then(|s| s.rebound_m)),
        ]);
        row.extend([s.map(|s| s.ticks), s.map(|s| s.overruns), s.map(|s| s.positions)].map(integer));
    }
    if is_diagnosed(plan) {
        let told = found.told.as_ref();
        row.push(told.map_or(Cell::Absent, |told| Cell::text(told.verdict)));
        row.push(told.map_or(Cell::Absent, |told| Cell::words(told.named.as_str())));
        row.push(told.and_then(|told| told.right).map_or(Cell::Absent, Cell::Flag));
        row.extend(told.map_or([None; 6], |told| told.numbers).map(Cell::number));
        row.push(integer(told.map(|told| told.flights as u64)));
    }
    row
}
