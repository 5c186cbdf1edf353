mod recording;
mod toml;

use std::{
    fmt::Write as _,
    fs::File,
    io::{ErrorKind, Read as _},
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_rig::{Problem, RigError};
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::{arguments::Json, exit::Exit, schema::Kind, words};

/// Say whether rigs, airframes, missions, maps, calibrations, tolerance files, suites, sweeps and recordings are sound, without flying
#[derive(Args)]
#[command(after_help = "Examples:
  bench check my-rig.toml
  bench check airframes                every .toml and .mcap below the folder
  bench check flight.mcap && bench diff reference.mcap flight.mcap
  bench check --as airframe draft.toml --json

What a file is shows from its content. All that is wrong with it is told, a line each: file, line,
key, what, and what to do. Exit code 0: all are sound; 2: one has problems or is no file of the
bench; 3: a recording was not closed, or has lost data.")]
pub struct Arguments {
    /// Files, or folders of .toml and .mcap files
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// What the files are, where their content cannot tell
    #[arg(long = "as", value_name = "KIND")]
    kind: Option<Wanted>,
    #[command(flatten)]
    json: Json,
}

/// What a file can be said to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Wanted {
    Rig,
    Airframe,
    Mission,
    Map,
    Calibration,
    Tolerances,
    Suite,
    Sweep,
    Recording,
}

impl Wanted {
    const fn kind(self) -> Option<Kind> {
        match self {
            Self::Rig => Some(Kind::Rig),
            Self::Airframe => Some(Kind::Airframe),
            Self::Mission => Some(Kind::Mission),
            Self::Map => Some(Kind::Map),
            Self::Calibration => Some(Kind::Calibration),
            Self::Tolerances => Some(Kind::Tolerances),
            Self::Suite => Some(Kind::Suite),
            Self::Sweep => Some(Kind::Sweep),
            Self::Recording => None,
        }
    }
}

/// What is said of all files; as JSON it is `bench.check/1`.
#[derive(Serialize)]
struct Report {
    schema: &'static str,
    /// Whether all files are sound.
    sound: bool,
    /// The files, in the order in which they were checked.
    files: Vec<Checked>,
}

/// What is said of one file.
#[derive(Debug, Default, Serialize)]
struct Checked {
    /// The file.
    file: PathBuf,
    /// What it is: `rig`, `airframe`, `mission`, `map`, `calibration`, `tolerances`, `suite`, `sweep` or `recording`; null where
    /// it could not be told.
    kind: Option<&'static str>,
    #[serde(skip)]
    words: &'static str,
    /// Whether nothing is wrong with it.
    sound: bool,
    /// Whether it is a recording whose only problem is that it was not closed or has lost something.
    data_lost: bool,
    /// All that is wrong with it.
    problems: Vec<Told>,
    /// What is no fault, but good to know.
    notes: Vec<String>,
}

/// One thing that is wrong.
#[derive(Debug, Default, Serialize)]
struct Told {
    /// Where: the file, or one that it names, or one within a recording.
    file: PathBuf,
    /// The line, counted from one; null where it is about the whole file.
    line: Option<usize>,
    /// The key with its tables; null where it is about none.
    key: Option<String>,
    /// What is wrong.
    what: String,
    /// What to do, or what was expected; null where `what` says it.
    hint: Option<String>,
}

impl Told {
    /// About a file as a whole.
    fn of(file: &Path, what: impl Into<String>) -> Self {
        Self { file: file.to_owned(), what: what.into(), ..Self::default() }
    }

    /// The same, with what to do about it.
    fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    fn in_words(&self) -> String {
        let mut out = self.file.display().to_string();
        // Writing to a String cannot fail.
        if let Some(line) = self.line {
            let _ = write!(out, ":{line}");
        }
        if let Some(key) = &self.key {
            let _ = write!(out, ": {key}");
        }
        let _ = write!(out, ": {}", self.what);
        if let Some(hint) = &self.hint {
            let _ = write!(out, ": {hint}");
        }
        out
    }
}

impl From<&Problem> for Told {
    fn from(problem: &Problem) -> Self {
        Self {
            file: problem.at().file.clone(),
            line: Some(problem.at().line),
            key: Some(problem.key().to_owned()).filter(|key| !key.is_empty()),
            what: problem.what(),
            hint: problem.hint(),
        }
    }
}

/// All that a reader complains of.
fn told(error: &RigError) -> Vec<Told> {
    match error {
        RigError::Invalid(problems) => problems.iter().map(Told::from).collect(),
        RigError::Syntax { at, detail } => {
            let what = format!("not valid TOML: {}", detail.trim().replace('\n', "; "));
            vec![Told { line: Some(at.line), ..Told::of(&at.file, what) }]
        }
        RigError::Read { path, source, .. } => vec![Told::of(path, format!("cannot be read: {source}"))],
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut files = Vec::new();
    for path in &arguments.files {
        if path.is_dir() { below(path, &mut files)? } else { files.push(path.clone()) }
    }
    let files: Vec<_> = files.iter().map(|file| check(file, arguments.kind)).collect();
    let report = Report { schema: "bench.check/1", sound: files.iter().all(|file| file.sound), files };
    if arguments.json.json {
        words::print_json(&report)?;
    } else {
        words::print(&in_words(&report))?;
    }
    Ok(if report.files.iter().any(|file| !file.sound && !file.data_lost) {
        Exit::BadInput
    } else if report.sound {
        Exit::Done
    } else {
        Exit::DataLoss
    })
}

/// Every .toml and .mcap file below a folder, by name.
fn below(folder: &Path, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let before = files.len();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        let entries =
            std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
        for entry in entries {
            let entry = entry.with_context(|| format!("cannot read {}", folder.display()))?;
            let path = entry.path();
            let known = path.extension().is_some_and(|ending| ending == "toml" || ending == "mcap");
            // Not through links, which may go round in a circle.
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                folders.push(path);
            } else if known && path.is_file() {
                files.push(path);
            }
        }
    }
    if files.len() == before {
        bail!("{} holds no .toml or .mcap file; name the files to check", folder.display());
    }
    files[before..].sort();
    Ok(())
}

fn check(file: &Path, wanted: Option<Wanted>) -> Checked {
    let mut checked = match look(file) {
        Err(error) => Checked { problems: vec![error], ..Checked::default() },
        Ok(Content::Recording) if wanted.is_none_or(|wanted| wanted.kind().is_none()) => {
            recording::check(file)
        }
        Ok(Content::Text(text)) if wanted != Some(Wanted::Recording) => {
            toml::check(file, &text, wanted.and_then(Wanted::kind))
        }
        Ok(Content::Foreign(what, hint)) => {
            Checked { problems: vec![Told::of(file, what).hint(hint)], ..Checked::default() }
        }
        Ok(Content::Recording) => {
            let problem = Told::of(file, "is a recording").hint("leave out --as, or say --as recording");
            Checked { problems: vec![problem], ..Checked::default() }
        }
        Ok(Content::Text(_)) => {
            let problem = Told::of(file, "is a text, no recording").hint("leave out --as");
            Checked { problems: vec![problem], ..Checked::default() }
        }
    };
    file.clone_into(&mut checked.file);
    checked.sound = checked.problems.is_empty();
    // In the order of the file, then those of the files that it names.
    checked.problems.sort_by(|a, b| {
        let place = |problem: &Told| (problem.file != file, problem.file.clone(), problem.line);
        place(a).cmp(&place(b))
    });
    checked
}

/// What a file holds, by its first bytes.
enum Content {
    Recording,
    Text(String),
    /// What it is, and what to do with it.
    Foreign(&'static str, &'static str),
}

/// First bytes of files that come to a bench and are none of its own.
const FOREIGN: [(&[u8], &str, &str); 10] = [
    (
        b"PK\x03\x04",
        "is a spreadsheet or an archive",
        "save the sheet as CSV and use `bench import --map MAP`",
    ),
    (b"ULog\x01\x12\x35", "is a flight log of PX4 (ULog)", "`bench import` makes a recording of it"),
    (b"\xa3\x95", "is a flight log of ArduPilot", "`bench import` makes a recording of it"),
    (
        b"H Product:Black",
        "is a flight log of Betaflight or INAV (blackbox)",
        "`bench import` makes a recording of it",
    ),
    (b"\xbc\x02\x00", "is a flight log of the Crazyflie", "`bench import` makes a recording of it"),
    (b"PAR1", "is a Parquet table", "`bench import --map MAP` makes a recording of it"),
    (b"\x89HDF", "is an HDF5 file", "turn it into CSV and use `bench import --map MAP`"),
    (
        b"SQLite format 3",
        "is an SQLite file, perhaps a ROS 2 bag",
        "turn it into CSV and use `bench import --map MAP`",
    ),
    (b"#ROSBAG", "is a ROS bag", "turn it into CSV and use `bench import --map MAP`"),
    (b"\x1f\x8b", "is compressed with gzip", "unpack it first"),
];
/// The first bytes of an MCAP file.
const MCAP: &[u8] = b"\x89MCAP";
/// No file of keys is longer, bytes.
const TEXT_MAX: u64 = 16 << 20;

fn look(path: &Path) -> Result<Content, Told> {
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => Told::of(path, "there is no such file"),
        _ => Told::of(path, format!("cannot be read: {error}")),
    };
    let mut file = File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    file.by_ref().take(16).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.starts_with(MCAP) {
        return Ok(Content::Recording);
    }
    if let Some((_, what, hint)) = FOREIGN.iter().find(|(magic, ..)| bytes.starts_with(magic)) {
        return Ok(Content::Foreign(what, hint));
    }
    file.take(TEXT_MAX).read_to_end(&mut bytes).map_err(failed)?;
    match String::from_utf8(bytes) {
        Ok(text) => Ok(Content::Text(text)),
        Err(_) => Ok(Content::Foreign(
            "is of no kind that the bench knows",
            "flight logs come in as CSV, by `bench import --map MAP`",
        )),
    }
}

fn in_words(report: &Report) -> String {
    let mut out = String::new();
    for file in &report.files {
        let name = file.file.display();
        // Writing to a String cannot fail.
        let _ = match (file.kind, file.problems.len()) {
            (Some(_), 0) => writeln!(out, "{name}: {}, sound", file.words),
            (Some(_), count) => {
                writeln!(out, "{name}: {}, {}", file.words, words::count(count as u64, "problem"))
            }
            // The one problem says what it is instead.
            (None, _) => Ok(()),
        };
        for problem in &file.problems {
            let _ = writeln!(out, "{}", problem.in_words());
        }
        for note in &file.notes {
            let _ = writeln!(out, "{name}: note: {note}");
        }
    }
    out
}
