//! A map proposed for a table of which nothing is known but itself: by the names of its columns, the units in them, and the ranges
//! of their numbers. Each line says that it is a guess and what it was guessed by.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    fs::File,
    io::{BufRead as _, BufReader},
    path::Path,
};

use super::{
    ImportError, ImportMap,
    log::read_error,
    number::{TimeUnit, nanos},
};
use crate::FileKind;

/// A map that was guessed.
#[derive(Clone, Debug)]
pub struct GuessedMap {
    /// The mapping file.
    pub text: String,
    /// What could not be guessed, and what to do about it, in sentences.
    pub unknown: Vec<String>,
}

/// So many rows are looked at.
const ROWS: usize = 200_000;
/// A column with more different words is no phase.
const WORDS: usize = 24;

/// A column and what stands in it.
#[derive(Debug, Default)]
struct Column {
    name: String,
    /// Its name in parts, in lower case, without the unit.
    parts: Vec<String>,
    /// The unit that its name ends with, as maps name it.
    unit: Option<&'static str>,
    numbers: u64,
    /// Dates and times; they rise and fall as numbers of seconds do.
    dates: u64,
    empty: u64,
    words: BTreeSet<String>,
    min: f64,
    max: f64,
    /// Sum of all numbers.
    sum: f64,
    last: Option<f64>,
    rises: u64,
    falls: u64,
    /// Steps between rows that rise, for their median.
    steps: Vec<f64>,
}

/// Endings of names, in parts, and the unit that they are.
const UNITS: &[(&[&str], &str)] = &[
    (&["m", "s", "2"], "m/s^2"),
    (&["m", "s2"], "m/s^2"),
    (&["mps2"], "m/s^2"),
    (&["cm", "s"], "cm/s"),
    (&["mm", "s"], "mm/s"),
    (&["m", "s"], "m/s"),
    (&["mps"], "m/s"),
    (&["rad", "s"], "rad/s"),
    (&["deg", "s"], "deg/s"),
    (&["seconds"], "s"),
    (&["secs"], "s"),
    (&["sec"], "s"),
    (&["millis"], "ms"),
    (&["ms"], "ms"),
    (&["micros"], "us"),
    (&["usec"], "us"),
    (&["us"], "us"),
    (&["ns"], "ns"),
    (&["s"], "s"),
    (&["mm"], "mm"),
    (&["cm"], "cm"),
    (&["meters"], "m"),
    (&["metres"], "m"),
    (&["m"], "m"),
    (&["degrees"], "deg"),
    (&["deg"], "deg"),
    (&["rad"], "rad"),
    (&["mv"], "mV"),
    (&["volts"], "V"),
    (&["volt"], "V"),
    (&["v"], "V"),
    (&["ma"], "mA"),
    (&["amps"], "A"),
    (&["amp"], "A"),
    (&["a"], "A"),
    (&["g"], "g"),
    (&["rpm"], "rpm"),
    (&["percent"], "%"),
    (&["pct"], "%"),
    (&["fraction"], "1"),
    (&["norm"], "1"),
    (&["counts"], "count"),
    (&["count"], "count"),
    (&["pwm"], "count"),
];

/// Parts of names that tell of what was wanted, not of what was.
const WANTED: &[&str] =
    &["setpoint", "sp", "ref", "reference", "target", "desired", "des", "goal", "wanted", "ctrltarget"];
/// Parts of names of what is no measurement.
const OTHERS: &[&str] = &[
    "truth",
    "true",
    "est",
    "estimate",
    "estimated",
    "hat",
    "error",
    "err",
    "std",
    "var",
    "cov",
    "bias",
    "raw",
    "filtered",
];

/// What the words of a phase mean, by parts of theirs; the first that fits.
const PHASES: &[(&[&str], &str)] = &[
    (&["abort", "fail", "emergency", "crash", "kill"], "abort"),
    (&["launch", "takeoff", "take-off", "take_off", "climb", "start"], "launch"),
    (&["land", "descend", "rtl", "return"], "land"),
    (&["idle", "disarm", "ground", "standby", "init", "off", "ready", "wait"], "idle"),
    (&["open"], "open"),
    (
        &[
            "hold", "hover", "fly", "flight", "air", "loiter", "position", "pos", "alt", "auto", "mission",
            "track", "on", "armed", "closed",
        ],
        "hold",
    ),
];

impl Column {
    fn new(name: &str) -> Self {
        let mut parts = parts(name);
        let ending = UNITS.iter().find(|(ending, _)| {
            parts.len() > ending.len()
                && parts.ends_with(&ending.iter().map(|part| (*part).to_owned()).collect::<Vec<_>>())
        });
        // A percent sign is no letter.
        let unit = if name.contains('%') { Some("%") } else { ending.map(|(_, unit)| *unit) };
        if let Some((ending, _)) = ending {
            parts.truncate(parts.len() - ending.len());
        }
        Self {
            name: name.to_owned(),
            parts,
            unit,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            ..Self::default()
        }
    }

    fn take(&mut self, cell: &str) {
        match cell.parse::<f64>() {
            Ok(number) if number.is_finite() => {
                self.numbers += 1;
                self.min = self.min.min(number);
                self.max = self.max.max(number);
                self.sum += number;
                self.follow(number);
            }
            _ if cell.is_empty() || cell.parse::<f64>().is_ok() => self.empty += 1,
            _ => {
                if let Ok(nanos) = nanos(cell, TimeUnit::Iso8601) {
                    self.dates += 1;
                    self.follow(nanos as f64 * 1e-9);
                }
                if self.words.len() <= WORDS {
                    self.words.insert(cell.to_owned());
                }
            }
        }
    }

    fn follow(&mut self, number: f64) {
        if let Some(last) = self.last.replace(number) {
            self.rises += u64::from(number > last);
            self.falls += u64::from(number < last);
            if number > last {
                self.steps.push(number - last);
            }
        }
    }

    fn is_number(&self) -> bool {
        self.numbers > 0 && self.words.is_empty()
    }

    /// Whether each cell is a date and time.
    fn is_date(&self) -> bool {
        let of = |word: &String| nanos(word, TimeUnit::Iso8601).is_ok();
        self.dates > 0 && self.numbers == 0 && self.words.iter().all(of)
    }

    fn largest(&self) -> f64 {
        self.min.abs().max(self.max.abs())
    }

    fn mean(&self) -> f64 {
        self.sum / self.numbers.max(1) as f64
    }

    fn has(&self, part: &str) -> bool {
        self.parts.iter().any(|own| own == part)
    }

    fn has_one_of(&self, parts: &[&str]) -> bool {
        parts.iter().any(|part| self.has(part))
    }

    fn is_measured(&self) -> bool {
        self.is_number() && !self.has_one_of(WANTED) && !self.has_one_of(OTHERS)
    }

    /// The range in words.
    fn range(&self) -> String {
        format!("{} to {}", short(self.min), short(self.max))
    }

    fn quoted(&self) -> String {
        quoted(&self.name)
    }
}

/// `posZ_mm` and `Pos Z [mm]` are `pos`, `z`, `mm`.
fn parts(name: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut before = ' ';
    for letter in name.chars() {
        let begins = before.is_lowercase() && letter.is_uppercase();
        if !letter.is_alphanumeric() || begins {
            parts.push(String::new());
        }
        if letter.is_alphanumeric() {
            parts.last_mut().into_iter().for_each(|part| part.extend(letter.to_lowercase()));
        }
        before = letter;
    }
    parts.retain(|part| !part.is_empty());
    parts
}

/// A text as TOML has it, which is as JSON has it.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// Three digits.
fn short(x: f64) -> String {
    let rounded: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    rounded.to_string()
}

/// Proposes a map for a CSV file.
///
/// An error is a file that is no table, or one in which neither a time nor an altitude is found: without them there is no flight.
pub fn guess(path: &Path) -> Result<GuessedMap, ImportError> {
    let unread = |source| ImportError::Read { path: path.to_owned(), source };
    let kind = FileKind::of(path).map_err(unread)?;
    match kind {
        FileKind::Csv | FileKind::OwnTable(_) | FileKind::Text => {}
        FileKind::Parquet => {
            let advice = "a map is guessed of CSV files alone; write it as CSV".to_owned();
            return Err(ImportError::NotCsv { path: path.to_owned(), kind, advice });
        }
        FileKind::Empty => return Err(ImportError::NoHeader { path: path.to_owned() }),
        kind => {
            let advice = kind.instead_of_log().unwrap_or_default();
            return Err(ImportError::NotCsv { path: path.to_owned(), kind, advice });
        }
    }
    let mut head = String::new();
    BufReader::new(File::open(path).map_err(unread)?).read_line(&mut head).map_err(unread)?;
    let count = |mark: char| head.matches(mark).count();
    let delimiter =
        [',', ';', '\t'].into_iter().max_by_key(|mark| (count(*mark), *mark == ',')).unwrap_or(',');
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(delimiter as u8)
        .flexible(true)
        .from_path(path)
        .map_err(|error| read_error(path, error))?;
    let header = reader.byte_headers().map_err(|error| read_error(path, error))?.clone();
    let mut columns: Vec<Column> =
        header.iter().map(|name| Column::new(String::from_utf8_lossy(name).trim())).collect();
    let mut row = csv::ByteRecord::new();
    for _ in 0..ROWS {
        if !reader.read_byte_record(&mut row).map_err(|error| read_error(path, error))? {
            break;
        }
        for (column, cell) in columns.iter_mut().zip(&row) {
            column.take(String::from_utf8_lossy(cell).trim());
        }
    }
    let name =
        path.file_stem().map_or_else(|| "guessed".to_owned(), |name| name.to_string_lossy().into_owned());
    let found = Guess { columns: &columns, used: Vec::new(), unknown: Vec::new() }.map(&name, delimiter);
    match found {
        Ok((text, unknown)) => {
            ImportMap::read(Path::new("the guessed map"), &text)?;
            Ok(GuessedMap { text, unknown })
        }
        Err(mut missing) => {
            if columns.iter().all(|column| column.name.parse::<f64>().is_ok()) {
                missing = vec![
                    "its first line is a row, and names no columns: write a map with header = false"
                        .to_owned(),
                ];
            }
            Err(ImportError::NotGuessed {
                path: path.to_owned(),
                missing,
                columns: columns.into_iter().map(|column| column.name).collect(),
            })
        }
    }
}

/// What is found, while it is found.
struct Guess<'a> {
    columns: &'a [Column],
    used: Vec<&'a str>,
    unknown: Vec<String>,
}

/// An axis or what else a family of names may end with, and the names of the family.
const PLACE: &[&str] = &["position", "pos", "p", "local", "enu", "ned", "vicon", "mocap"];
const SPEED: &[&str] = &["velocity", "vel", "v", "speed"];
const ACCELERATION: &[&str] = &["acceleration", "accel", "acc", "a"];

impl<'a> Guess<'a> {
    fn use_it(&mut self, column: &'a Column) -> &'a Column {
        self.used.push(&column.name);
        column
    }

    /// The first column that is not used yet and fits; of several, the one whose name has the fewest parts.
    fn find(&mut self, fits: impl Fn(&Column) -> bool) -> Option<&'a Column> {
        let free =
            self.columns.iter().filter(|column| !self.used.contains(&column.name.as_str()) && fits(column));
        let found = free.min_by_key(|column| column.parts.len())?;
        Some(self.use_it(found))
    }

    /// A column for an axis of a family: `z`, `pos_z`, `pz`.
    fn axis(&mut self, axis: &str, family: &[&str], alone: bool) -> Option<&'a Column> {
        let is = |column: &Column| {
            let joined = family.iter().any(|name| column.has(&format!("{name}{axis}")));
            let apart = column.has(axis) && column.has_one_of(family);
            joined || apart || alone && column.parts.last().is_some_and(|last| last == axis)
        };
        let others = [SPEED, ACCELERATION, &["q", "w", "gyro", "imu", "mag", "rate", "omega"]].concat();
        let foreign = |column: &Column| {
            !family.contains(&"v")
                && !family.contains(&"a")
                && column.parts.len() > 1
                && column.has_one_of(&others)
        };
        self.find(|column| column.is_measured() && is(column) && !foreign(column))
    }

    fn map(mut self, name: &str, delimiter: char) -> Result<(String, Vec<String>), Vec<String>> {
        let mut missing = Vec::new();
        let time = self.time();
        let altitude = self.altitude();
        if time.is_none() {
            missing.push(self.no_time());
        }
        if altitude.is_none() {
            missing.push(
                "no column is an altitude by its name (z, alt, altitude, height, pos_z, ...)".to_owned(),
            );
        }
        let (Some(time), Some((z, down))) = (time, altitude) else { return Err(missing) };
        let mut out = format!(
            "# Guessed by `bench import --guess` from names, units and ranges: look at every line, then take the comment off.\nname = {}\n",
            quoted(name)
        );
        let command = self.command();
        if let Some((actuation, ..)) = &command {
            let _ = writeln!(out, "actuation = {actuation:?}");
        }
        if delimiter != ',' {
            let _ = writeln!(out, "delimiter = {}", quoted(&delimiter.to_string()));
        }
        out += &time;
        let is_down = down.is_some();
        out += &self.position(z, down);
        out += &self.motion(is_down);
        out += &self.control(is_down, command.as_ref().map(|(_, columns, _)| columns.as_slice()));
        match &command {
            Some((actuation, columns, words)) => out += &self.sticks(actuation, columns, words),
            None => self.unknown.push(
                "The throttle: no column is one by its name (throttle, thrust, motor, pwm, ...). Without it a flight can be viewed and compared, not diagnosed"
                    .to_owned(),
            ),
        }
        out += &self.battery();
        let left: Vec<&str> = self
            .columns
            .iter()
            .map(|column| column.name.as_str())
            .filter(|name| !self.used.contains(name))
            .collect();
        if !left.is_empty() {
            let _ = writeln!(out, "\n# Not used: {}.", left.join(", ").replace(['\n', '\r'], " "));
        }
        for unknown in &self.unknown {
            let _ = writeln!(out, "# Not guessed: {unknown}.");
        }
        Ok((out, self.unknown))
    }

    fn time(&mut self) -> Option<String> {
        let names =
            ["t", "time", "timestamp", "stamp", "tick", "clock", "elapsed", "datetime", "date", "utc"];
        let rises = |column: &Column| {
            let is_time = column.is_number() || column.is_date();
            is_time && column.rises > 0 && 100 * column.falls <= column.rises
        };
        let of_name =
            |column: &Column| column.parts.first().is_some_and(|first| names.contains(&first.as_str()));
        let column = self.find(|column| of_name(column) && rises(column))?;
        let unit = column.unit.filter(|unit| ["s", "ms", "us", "ns"].contains(unit));
        let step = median(&column.steps);
        let (unit, words) = if column.is_date() {
            ("iso-8601", "it has dates and times as text".to_owned())
        } else if let Some(unit) = unit {
            (unit, "its name says the unit".to_owned())
        } else {
            // Rows of flight logs come every 1 ms to 1 s.
            let unit = [("s", 0.9), ("ms", 900.0), ("us", 9e5)].iter().find(|(_, most)| step < *most);
            (
                unit.map_or("ns", |(unit, _)| unit),
                format!("the unit by the step between rows, {}", short(step)),
            )
        };
        Some(format!(
            "\n[time]\ncolumn = {}   # guess: by its name\nunit = {unit:?}   # guess: {words}\n",
            column.quoted()
        ))
    }

    fn no_time(&self) -> String {
        let is_word = |column: &&Column| {
            !column.words.is_empty()
                && column.has_one_of(&["time", "datetime", "date", "timestamp", "stamp", "utc"])
        };
        match self.columns.iter().find(is_word) {
            Some(column) => format!(
                "column {:?} is a time as text, such as {:?}, and no dates and times by ISO 8601 that rise: write it so, or as seconds",
                column.name,
                column.words.first().map_or("", String::as_str)
            ),
            None => "no column is a time by its name (t, time, timestamp, ...) that rises from row to row"
                .to_owned(),
        }
    }

    /// Whether a column is one of an estimate on board, such as `stateEstimate.z`; `truth` and the like are none.
    fn estimated(column: &Column, axis: &str) -> bool {
        const NO_STATE: &[&str] = &["truth", "true", "error", "err", "std", "var", "cov", "bias"];
        let is_estimate = column.has_one_of(&["estimate", "est", "hat", "ekf", "kalman"]);
        let is_axis = column.parts.last().is_some_and(|last| last == axis);
        column.is_number()
            && is_estimate
            && is_axis
            && !column.has_one_of(WANTED)
            && !column.has_one_of(NO_STATE)
    }

    /// The altitude, and whether it counts downwards.
    fn altitude(&mut self) -> Option<(&'a Column, Option<String>)> {
        let names = ["alt", "altitude", "height", "baro", "range"];
        let found = self.find(|column| column.is_measured() && column.has_one_of(&names[..3]));
        let column = match found {
            Some(column) => column,
            None => self
                .axis("z", PLACE, true)
                .or_else(|| self.find(|column| column.is_measured() && column.has_one_of(&["down", "pd"])))
                .or_else(|| self.find(|column| column.is_measured() && column.has_one_of(&names[3..])))
                .or_else(|| self.find(|column| Self::estimated(column, "z")))?,
        };
        let down = if column.has_one_of(&["down", "pd", "ned"]) {
            Some("by its name it counts downwards".to_owned())
        } else if column.max < 0.2 * -column.min && column.mean() < 0.0 {
            Some(format!("it counts downwards by its range, {}", column.range()))
        } else {
            None
        };
        Some((column, down))
    }

    fn position(&mut self, z: &'a Column, down: Option<String>) -> String {
        let mut out = "\n[position]\n".to_owned();
        let exposed = self.find(|column| column.is_number() && column.has("exposed"));
        if let Some(column) = exposed {
            let unit = column.unit.filter(|unit| ["s", "ms", "us", "ns"].contains(unit)).unwrap_or("s");
            let _ = writeln!(
                out,
                "exposed_at = {{ column = {}, unit = {unit:?} }}   # guess: by its name",
                column.quoted()
            );
        } else {
            self.unknown.push(
                "How old a position is in the row that holds it: latency_s is 0, and a diagnosis finds what it lacks within the rig's tolerance"
                    .to_owned(),
            );
            out += "latency_s = 0.0   # guess: nothing tells how old a position is\n";
        }
        let (unit, words) = self.length(z);
        // Of one source: estimated on board, or measured.
        let mut of = |axis: &str| {
            if Self::estimated(z, "z") {
                self.find(|column| Self::estimated(column, axis))
            } else {
                self.axis(axis, PLACE, true)
            }
        };
        let (x, y) = (of("x"), of("y"));
        for (key, column) in [("x", x), ("y", y)] {
            if let Some(column) = column {
                let (unit, words) = match column.unit.filter(|unit| ["m", "cm", "mm"].contains(unit)) {
                    Some(unit) => (unit, "by name and unit".to_owned()),
                    None => (unit, "by its name, in the unit of the altitude".to_owned()),
                };
                let _ = writeln!(
                    out,
                    "{key} = {{ column = {}, unit = {unit:?} }}   # guess: {words}",
                    column.quoted()
                );
            }
        }
        let scale = if down.is_some() { ", scale = -1" } else { "" };
        let why = down.map(|words| format!("; {words}")).unwrap_or_default();
        let _ = writeln!(
            out,
            "z = {{ column = {}, unit = {unit:?}{scale} }}   # guess: {words}{why}",
            z.quoted()
        );
        let beside = [Some(z), exposed, x, y];
        out + empty(beside.into_iter().flatten())
    }

    /// The unit of an altitude.
    fn length(&mut self, column: &Column) -> (&'static str, String) {
        if let Some(unit) = column.unit.filter(|unit| ["m", "cm", "mm"].contains(unit)) {
            return (unit, "by name and unit".to_owned());
        }
        let unit = [("m", 30.0), ("cm", 1000.0)].iter().find(|(_, most)| column.largest() < *most);
        let unit = unit.map_or("mm", |(unit, _)| unit);
        self.unknown.push(format!(
            "The unit of {}: {unit} is by its range, {}, as of a flight in a room or a garden",
            column.name,
            column.range()
        ));
        (unit, format!("by its name; the unit by its range, {}", column.range()))
    }

    fn motion(&mut self, is_down: bool) -> String {
        let mut out = String::new();
        let mut used: Vec<&Column> = Vec::new();
        let turned = |key: &str| if is_down && key == "velocity_z" { ", scale = -1" } else { "" };
        for (axis, key) in [("x", "velocity_x"), ("y", "velocity_y"), ("z", "velocity_z")] {
            let Some(column) = self.axis(axis, SPEED, false) else { continue };
            let unit = column.unit.filter(|unit| ["m/s", "cm/s", "mm/s"].contains(unit));
            let words =
                if unit.is_some() { "by name and unit" } else { "by its name, and m/s as it has no unit" };
            let _ = writeln!(
                out,
                "{key} = {{ column = {}, unit = {:?}{} }}   # guess: {words}",
                column.quoted(),
                unit.unwrap_or("m/s"),
                turned(key)
            );
            used.push(column);
        }
        if let Some(column) = self.axis("z", ACCELERATION, false) {
            let unit = column.unit.filter(|unit| ["m/s^2", "g"].contains(unit));
            // One gravity in either unit, or else ordinary accelerations of a small aircraft.
            let unit = unit.unwrap_or(match column.mean().abs() {
                0.5..2.0 => "g",
                5.0.. => "m/s^2",
                _ if column.largest() < 4.0 => "g",
                _ => "m/s^2",
            });
            let one_g = if unit == "g" { 1.0 } else { 9.8 };
            let gravity = if column.mean().abs() > 0.5 * one_g { "included" } else { "removed" };
            let scale = if column.mean() < -0.5 * one_g { ", scale = -1" } else { "" };
            let _ = writeln!(
                out,
                "vertical_acceleration = {{ column = {}, unit = {unit:?}, gravity = {gravity:?}{scale} }}   # guess: by its name; unit and gravity by its mean, {}",
                column.quoted(),
                short(column.mean())
            );
            used.push(column);
        }
        for (key, names) in [
            ("roll", &["roll", "phi"][..]),
            ("pitch", &["pitch", "theta"]),
            ("yaw", &["yaw", "psi", "heading"]),
        ] {
            let is_stick =
                |column: &Column| column.has_one_of(&["command", "cmd", "readback", "stick", "rc", "rate"]);
            let Some(column) =
                self.find(|column| column.is_measured() && column.has_one_of(names) && !is_stick(column))
            else {
                continue;
            };
            let unit = column.unit.filter(|unit| ["rad", "deg"].contains(unit));
            let words =
                if unit.is_some() { "by name and unit" } else { "by its name; the unit by its range" };
            let unit = unit.unwrap_or(if column.largest() > 7.0 { "deg" } else { "rad" });
            let _ = writeln!(
                out,
                "{key} = {{ column = {}, unit = {unit:?} }}   # guess: {words}",
                column.quoted()
            );
            used.push(column);
        }
        if used.is_empty() {
            return out;
        }
        self.unknown.push("The signs of pitch and yaw, for which docs/import.md has the bench's".to_owned());
        format!("\n[motion]\n{out}{}", empty(used.into_iter()))
    }

    fn control(&mut self, is_down: bool, throttle: Option<&[&Column]>) -> String {
        let mut out = String::new();
        let names = ["phase", "mode", "state", "status"];
        let of_words =
            |column: &Column| !column.words.is_empty() && column.words.len() <= WORDS && column.numbers == 0;
        let mut used: Vec<&Column> = Vec::new();
        if let Some(column) = self.find(|column| column.has_one_of(&names) && of_words(column)) {
            let phase = |word: &String| {
                let lower = word.to_lowercase();
                let found = PHASES.iter().find(|(parts, _)| parts.iter().any(|part| lower.contains(part)));
                (word.clone(), found.map(|(_, phase)| *phase))
            };
            let phases: BTreeMap<String, Option<&str>> = column.words.iter().map(phase).collect();
            for (word, _) in phases.iter().filter(|(_, phase)| phase.is_none()) {
                self.unknown
                    .push(format!("Which phase {word:?} of column {} is: it is taken for hold", column.name));
            }
            let list: Vec<String> = phases
                .iter()
                .map(|(word, phase)| format!("{} = {:?}", quoted(word), phase.unwrap_or("hold")))
                .collect();
            let _ = writeln!(
                out,
                "phase = {{ column = {}, names = {{ {} }} }}   # guess: by its words",
                column.quoted(),
                list.join(", ")
            );
            used.push(column);
        } else if let Some([first, ..]) = throttle {
            let from = first.min + 0.05 * (first.max - first.min);
            let _ = writeln!(
                out,
                "phase = {{ column = {}, from = [[-1e9, \"idle\"], [{from:?}, \"hold\"]] }}   # guess: it flies above a twentieth of the throttle's range",
                first.quoted()
            );
        } else {
            out += "phase = \"hold\"   # guess: nothing tells when it flies\n";
        }
        let heights = ["z", "alt", "altitude", "height"];
        let joined = |column: &Column| {
            WANTED.iter().any(|name| column.has(&format!("{name}z")) || column.has(&format!("z{name}")))
        };
        let is_set = |column: &Column| {
            column.is_number() && (column.has_one_of(WANTED) && column.has_one_of(&heights) || joined(column))
        };
        let is_speed = |column: &Column| column.has_one_of(SPEED) || column.has("vz");
        if let Some(column) = self.find(|column| is_set(column) && !is_speed(column)) {
            let (unit, words) = self.length(column);
            let scale = if is_down { ", scale = -1" } else { "" };
            // The phase is told in every row.
            let optional = if column.empty > 0 { ", optional = true" } else { "" };
            let _ = writeln!(
                out,
                "setpoint_z = {{ column = {}, unit = {unit:?}{scale}{optional} }}   # guess: {words}",
                column.quoted()
            );
        }
        format!("\n[control]\n{out}keep = \"changes\"\n{}", empty(used.into_iter()))
    }

    /// The actuation, the columns of the throttle, and by what they were guessed.
    fn command(&mut self) -> Option<(&'static str, Vec<&'a Column>, &'static str)> {
        let wants = ["throttle", "thrust", "thr", "tau"];
        let is_read = |column: &Column| column.has_one_of(&["readback", "measured"]);
        let is_one = |column: &Column| {
            column.is_number() && column.has_one_of(&wants) && !is_read(column) && !column.has_one_of(OTHERS)
        };
        if let Some(column) = self.find(is_one) {
            return Some((actuation(column), vec![column], "by its name"));
        }
        let columns = self.columns;
        let is_motor = |column: &&Column| {
            let numbered = |name: &str| (0..=4).any(|k| column.has(&format!("{name}{k}")));
            let named =
                ["motor", "m", "pwm", "rotor", "esc", "output", "out"].iter().any(|name| numbered(name))
                    || column.has("motor") && (0..=4).any(|k| column.has(&k.to_string()));
            column.is_number() && named && !["rpm", "rad/s"].contains(&column.unit.unwrap_or_default())
        };
        let motors: Vec<&Column> = columns.iter().filter(is_motor).collect();
        if motors.len() >= 2 {
            for motor in &motors {
                self.use_it(motor);
            }
            let strongest = motors.iter().max_by(|a, b| a.largest().total_cmp(&b.largest()))?;
            return Some((actuation(strongest), motors, "the mean of what are motors by their names"));
        }
        let column = self.find(|column| {
            column.is_number() && (column.has("pwm") || column.has("motor") || column.unit == Some("count"))
        })?;
        Some((actuation(column), vec![column], "by its name"))
    }

    fn sticks(&mut self, actuation: &str, throttle: &[&Column], words: &str) -> String {
        let unit = |column: &Column| match actuation {
            "fraction" if column.unit == Some("%") || column.unit != Some("1") && column.largest() > 1.5 => {
                "%"
            }
            "fraction" => "1",
            "volt" if column.unit == Some("mV") || column.largest() > 100.0 => "mV",
            "volt" => "V",
            _ => "count",
        };
        let first = throttle[0];
        let known = first.unit.is_some();
        if !known {
            self.unknown.push(format!(
                "The unit of {}: {} is by its range, {}",
                first.name,
                unit(first),
                first.range()
            ));
        }
        let by = if known { "" } else { "; the unit by its range" };
        let names: Vec<String> = throttle.iter().map(|column| column.quoted()).collect();
        let source = match names.as_slice() {
            [one] => format!("column = {one}"),
            several => format!("columns = [{}]", several.join(", ")),
        };
        let mut out = format!(
            "\n[command]\nthrottle = {{ {source}, unit = {:?} }}   # guess: {words}{by}\n",
            unit(first)
        );
        let mut used = throttle.to_vec();
        let is_stick =
            |column: &Column| column.has_one_of(&["command", "cmd", "stick"]) && !column.has_one_of(OTHERS);
        for key in ["pitch", "roll", "yaw"] {
            // In the throttle's unit, or they are angles that were asked for.
            let found = self.find(|column| {
                column.is_number() && column.has(key) && is_stick(column) && column.unit == first.unit
            });
            if let Some(column) = found {
                let _ = writeln!(
                    out,
                    "{key} = {{ column = {}, unit = {:?} }}   # guess: by its name",
                    column.quoted(),
                    unit(first)
                );
                used.push(column);
            }
        }
        out += empty(used.into_iter());
        let is_read =
            |column: &Column| column.is_number() && column.has("readback") && column.unit == first.unit;
        if let Some(column) = self.find(|column| is_read(column) && column.has("throttle")) {
            let mut used = vec![column];
            let _ = write!(
                out,
                "\n[readback]\nthrottle = {{ column = {}, unit = {:?} }}   # guess: by its name\n",
                column.quoted(),
                unit(first)
            );
            for key in ["pitch", "roll", "yaw"] {
                if let Some(column) = self.find(|column| is_read(column) && column.has(key)) {
                    let _ = writeln!(
                        out,
                        "{key} = {{ column = {}, unit = {:?} }}   # guess: by its name",
                        column.quoted(),
                        unit(first)
                    );
                    used.push(column);
                }
            }
            out += empty(used.into_iter());
        }
        out
    }

    fn battery(&mut self) -> String {
        let names = ["vbat", "vbatt", "battery", "bat", "batt", "voltage"];
        let is_voltage = |column: &Column| {
            column.is_measured()
                && column.has_one_of(&names)
                && [None, Some("V"), Some("mV")].contains(&column.unit)
                && !column.has_one_of(&["current", "percent", "remaining", "temp"])
        };
        let Some(column) = self.find(is_voltage) else { return String::new() };
        let unit = column.unit.unwrap_or(if column.largest() > 100.0 { "mV" } else { "V" });
        let words =
            if column.unit.is_some() { "by name and unit" } else { "by its name; the unit by its range" };
        format!(
            "\n[battery]\nvoltage = {{ column = {}, unit = {unit:?} }}   # guess: {words}\nkeep = \"changes\"\n{}",
            column.quoted(),
            empty(std::iter::once(column))
        )
    }
}

/// The actuation of a throttle: by the unit in its name, else by its range.
fn actuation(column: &Column) -> &'static str {
    match column.unit {
        Some("V" | "mV") => "volt",
        Some("%" | "1") => "fraction",
        Some("count") => "count",
        _ if column.largest() <= 1.5 => "fraction",
        _ if column.largest() <= 100.0 && column.min >= 0.0 => "fraction",
        _ => "count",
    }
}

/// Whether cells may be empty.
fn empty<'c>(mut columns: impl Iterator<Item = &'c Column>) -> &'static str {
    if columns.any(|column| column.empty > 0) {
        "empty = \"absent\"   # guess: some cells are empty\n"
    } else {
        ""
    }
}

/// The middle value, or the upper of two; zero of none.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_taken_apart_and_their_units_found() {
        let of = |name: &str| {
            let column = Column::new(name);
            (column.parts.join(" "), column.unit)
        };
        assert_eq!(of("alt_cm"), ("alt".to_owned(), Some("cm")));
        assert_eq!(of("posZ [mm]"), ("pos z".to_owned(), Some("mm")));
        assert_eq!(of("vz_m_s"), ("vz".to_owned(), Some("m/s")));
        assert_eq!(of("vel.z (m/s)"), ("vel z".to_owned(), Some("m/s")));
        assert_eq!(of("Throttle %"), ("throttle".to_owned(), Some("%")));
        assert_eq!(of("t"), ("t".to_owned(), None));
        assert_eq!(of("command_throttle_v"), ("command throttle".to_owned(), Some("V")));
        assert_eq!(of("az_g"), ("az".to_owned(), Some("g")));
    }
}
