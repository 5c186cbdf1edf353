//! What a file is, by what is in it: endings lie.

use std::{
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
};

#[cfg(feature = "exchange")]
use bench_logs::Format;
use bench_rig::{
    Actuation,
    visit::{self, Value},
};
use mcap::MAGIC;

/// What a file, or a folder, is.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileKind {
    /// A folder, with the names of the recordings in it.
    Folder {
        /// Sorted; those that end in `.mcap`.
        recordings: Vec<String>,
    },
    /// No bytes at all.
    Empty,
    /// An MCAP file, of this bench or of others.
    Mcap,
    /// The table of a flight that `bench export` wrote, with the unit of its sticks where it was known.
    OwnTable(Option<Actuation>),
    /// A text of several columns.
    Csv,
    /// A rig file.
    Rig,
    /// An airframe file.
    Airframe,
    /// A mission file.
    Mission,
    /// An import map.
    ImportMap,
    /// A suite of tests.
    Suite,
    /// A plan of a sweep.
    Sweep,
    /// Another TOML file.
    Toml,
    /// An Excel workbook.
    Xlsx,
    /// A zip archive.
    Zip,
    /// A PX4 log.
    Ulog,
    /// A log of the autopilot `ArduPilot`.
    Dataflash,
    /// A log of Betaflight or INAV.
    Blackbox,
    /// A log of the Crazyflie: of its card, or of its client.
    Crazyflie,
    /// An Apache Parquet table.
    Parquet,
    /// A bag of ROS 1.
    Rosbag1,
    /// A database of `SQLite`, as bags of ROS 2 were before they were MCAP.
    Sqlite,
    /// Something packed.
    Compressed,
    /// A JSON text.
    Json,
    /// Some other text.
    Text,
    /// Some other bytes.
    Binary,
}

/// The logs that `bench import` reads.
const READ: &str = "of PX4 (ULog), of ArduPilot (dataflash), of Betaflight (blackbox), of the Crazyflie, MCAP (bags of ROS 2, protobuf, JSON), Parquet, or a table (CSV) whose first line names the columns";

/// Enough of a file to tell what it is.
const LOOKED_AT: u64 = 64 << 10;

impl FileKind {
    /// Looks into a file.
    pub fn of(path: impl AsRef<Path>) -> io::Result<Self> {
        let path = path.as_ref();
        if path.is_dir() {
            return Self::of_folder(path);
        }
        let mut head = Vec::new();
        let file = File::open(path)?;
        file.take(LOOKED_AT).read_to_end(&mut head)?;
        Ok(Self::of_bytes(&head))
    }

    fn of_folder(path: &Path) -> io::Result<Self> {
        let mut recordings = Vec::new();
        for entry in path.read_dir()? {
            let name = PathBuf::from(entry?.file_name());
            if name.extension().is_some_and(|ending| ending == "mcap") {
                recordings.push(name.to_string_lossy().into_owned());
            }
        }
        recordings.sort();
        Ok(Self::Folder { recordings })
    }

    /// By the beginning of a file.
    fn of_bytes(head: &[u8]) -> Self {
        let has = |word: &[u8]| head.windows(word.len()).any(|part| part == word);
        match head {
            [] => Self::Empty,
            _ if head.starts_with(MAGIC) => Self::Mcap,
            // The names of a zip's members stand in clear.
            _ if head.starts_with(b"PK\x03\x04") && (has(b"xl/") || has(b"[Content_Types].xml")) => {
                Self::Xlsx
            }
            _ if head.starts_with(b"PK\x03\x04") => Self::Zip,
            _ if head.starts_with(b"ULog\x01\x12\x35") => Self::Ulog,
            _ if head.starts_with(b"\xa3\x95\x80\x80") => Self::Dataflash,
            _ if head.starts_with(b"H Product:Blackbox") => Self::Blackbox,
            [0xbc, 1 | 2, 0, ..] => Self::Crazyflie,
            _ if head.starts_with(b"PAR1") => Self::Parquet,
            _ if head.starts_with(b"#ROSBAG V") => Self::Rosbag1,
            _ if head.starts_with(b"SQLite format 3\0") => Self::Sqlite,
            _ if [&b"\x1f\x8b"[..], b"\x28\xb5\x2f\xfd", b"BZh", b"\xfd7zXZ"]
                .iter()
                .any(|magic| head.starts_with(magic)) =>
            {
                Self::Compressed
            }
            _ => Self::of_text(head),
        }
    }

    fn of_text(head: &[u8]) -> Self {
        let cut = head.len() as u64 == LOOKED_AT;
        let text = match str::from_utf8(head) {
            Ok(text) => text,
            // A letter may be cut in two at the end.
            Err(error) if cut && error.error_len().is_none() => {
                str::from_utf8(&head[..error.valid_up_to()]).unwrap_or_default()
            }
            Err(_) => return Self::Binary,
        };
        if text.contains('\0') {
            return Self::Binary;
        }
        let first = text.trim_start_matches('\u{feff}').lines().next().unwrap_or_default();
        if first.starts_with("time_s,phase,command_throttle_") {
            let ending = first.split(',').nth(2).and_then(|name| name.strip_prefix("command_throttle_"));
            let of = [Actuation::Volt, Actuation::Fraction, Actuation::Count];
            return Self::OwnTable(of.into_iter().find(|actuation| Some(actuation.suffix()) == ending));
        }
        // The client writes variables of the firmware, which stand in groups.
        if first
            .strip_prefix("Timestamp,")
            .is_some_and(|names| names.split(',').all(|name| name.contains('.')))
        {
            return Self::Crazyflie;
        }
        if let Ok(visit::Node { value: Value::Table(entries), .. }) = visit::parse(Path::new(""), text)
            && !entries.is_empty()
        {
            let has = |key: &str| entries.iter().any(|(known, _)| known == key);
            return match () {
                () if has("rigs") || has("recordings") => Self::Sweep,
                () if has("case") => Self::Suite,
                () if has("phase") => Self::Mission,
                () if has("airframe") || has("tracker") => Self::Rig,
                () if has("thrust") => Self::Airframe,
                () if has("time") || has("log") => Self::ImportMap,
                () => Self::Toml,
            };
        }
        match text.trim_start().as_bytes() {
            [b'{' | b'[', ..] => Self::Json,
            _ if [',', ';', '\t'].iter().any(|mark| first.contains(*mark)) => Self::Csv,
            _ => Self::Text,
        }
    }

    /// What it is, such as `a PX4 log (ULog)`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Folder { .. } => "a folder",
            Self::Empty => "empty",
            Self::Mcap => "an MCAP file",
            Self::OwnTable(_) => "a table that `bench export` wrote",
            Self::Csv => "a table (CSV)",
            Self::Rig => "a rig",
            Self::Airframe => "an airframe",
            Self::Mission => "a mission",
            Self::ImportMap => "an import map",
            Self::Suite => "a suite of tests",
            Self::Sweep => "a plan of a sweep",
            Self::Toml => "a TOML file",
            Self::Xlsx => "an Excel workbook",
            Self::Zip => "a zip archive",
            Self::Ulog => "a PX4 log (ULog)",
            Self::Dataflash => "an ArduPilot log (dataflash)",
            Self::Blackbox => "a Betaflight log (blackbox)",
            Self::Crazyflie => "a log of the Crazyflie",
            Self::Parquet => "a Parquet table",
            Self::Rosbag1 => "a bag of ROS 1",
            Self::Sqlite => "an SQLite database, such as a bag of ROS 2",
            Self::Compressed => "a compressed file",
            Self::Json => "a JSON text",
            Self::Text => "a text",
            Self::Binary => "none of the kinds of file that are known here",
        }
    }

    /// Whether it is another program's log that is read without being told how.
    pub const fn is_log(&self) -> bool {
        matches!(self, Self::Ulog | Self::Dataflash | Self::Blackbox | Self::Crazyflie)
    }

    /// How it is read as a log of topics; `None` of what is none.
    #[cfg(feature = "exchange")]
    pub const fn log_format(&self) -> Option<Format> {
        match self {
            Self::Ulog => Some(Format::Ulog),
            Self::Dataflash => Some(Format::Dataflash),
            Self::Blackbox => Some(Format::Blackbox),
            Self::Crazyflie => Some(Format::Crazyflie),
            Self::Mcap => Some(Format::Mcap),
            _ => None,
        }
    }

    /// How a log of this kind becomes a CSV file; `None` of what holds no flight.
    fn to_csv(&self) -> Option<&'static str> {
        Some(match self {
            Self::Xlsx => "save the sheet with the flight as CSV from the spreadsheet",
            Self::Sqlite => {
                "`ros2 bag convert` turns a bag into MCAP, which is read as it is; or write the topics with position and throttle as one CSV file, for instance with PlotJuggler"
            }
            Self::Rosbag1 | Self::Mcap => {
                "write the topics with position and throttle as one CSV file, for instance with PlotJuggler"
            }
            _ => return None,
        })
    }

    /// What to do with it where a recording is wanted; `file` is its name.
    pub fn instead_of_recording(&self, file: &Path) -> String {
        let file = file.display();
        match self {
            Self::Folder { recordings } if recordings.is_empty() => {
                "there are no recordings in it".to_owned()
            }
            Self::Folder { recordings } => name_them(recordings),
            Self::Empty => "nothing was ever recorded into it".to_owned(),
            Self::OwnTable(Some(_)) => {
                format!("`bench import {file} --rig RIG -o flight.mcap` makes a recording of it")
            }
            Self::Ulog | Self::Dataflash | Self::Blackbox | Self::Crazyflie => {
                format!("`bench import {file} -o flight.mcap` makes a recording of it")
            }
            Self::OwnTable(None) | Self::Csv | Self::Parquet => format!(
                "`bench import --map MAP {file} -o flight.mcap` makes a recording of it; docs/import.md says how a map is written"
            ),
            Self::Rig | Self::Airframe => "name recordings here, and a rig with --rig".to_owned(),
            Self::Mission => "`bench sim --mission` flies it and records the flight".to_owned(),
            Self::ImportMap => "`bench import --map` reads logs by it".to_owned(),
            Self::Suite => "`bench test` flies it".to_owned(),
            Self::Sweep => "`bench sweep run` runs it".to_owned(),
            Self::Zip | Self::Compressed => "unpack it, and name what is in it".to_owned(),
            Self::Toml | Self::Json | Self::Text | Self::Binary => {
                "name a recording (.mcap); `bench import` makes one of a flight log (ULog, dataflash, MCAP, Parquet, CSV)".to_owned()
            }
            other => match other.to_csv() {
                Some(how) => format!("{how}, then `bench import --map MAP` makes a recording of that"),
                None => "name a recording".to_owned(),
            },
        }
    }

    /// What to do with it where a table of a flight is wanted; `None` for what may be one.
    pub fn instead_of_log(&self) -> Option<String> {
        Some(match self {
            Self::OwnTable(_) | Self::Csv | Self::Text | Self::Parquet => return None,
            Self::Ulog | Self::Dataflash | Self::Blackbox | Self::Crazyflie => {
                "leave out --map and --guess, for `bench import` has maps for it, or name a map whose `log` is of this kind".to_owned()
            }
            Self::Empty => "expected a CSV file whose first line names the columns".to_owned(),
            Self::Mcap => {
                "if this bench recorded it, it needs no import: name it where a recording is wanted; otherwise leave out --map, or name a map with log = \"mcap\"".to_owned()
            }
            Self::Folder { .. } => "name one log in it".to_owned(),
            Self::ImportMap => "name it with --map, and the log without".to_owned(),
            Self::Rig => "name it with --rig, and the log without".to_owned(),
            Self::Zip | Self::Compressed => "unpack it, and name the CSV file in it".to_owned(),
            other => match other.to_csv() {
                Some(how) => format!("{how}, and import that"),
                None => format!("a flight log is wanted: {READ}"),
            },
        })
    }
}

fn name_them(recordings: &[String]) -> String {
    const MOST: usize = 5;
    let named = recordings.iter().take(MOST).cloned().collect::<Vec<_>>().join(", ");
    let more = match recordings.len().saturating_sub(MOST) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!("name the recordings in it: {named}{more}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_their_content() {
        let of = |text: &str| FileKind::of_bytes(text.as_bytes());
        assert_eq!(FileKind::of_bytes(b"ULog\x01\x12\x35\x01rest"), FileKind::Ulog);
        assert_eq!(FileKind::of_bytes(b"PK\x03\x04....[Content_Types].xml"), FileKind::Xlsx);
        assert_eq!(FileKind::of_bytes(b"PK\x03\x04....notes.txt"), FileKind::Zip);
        assert_eq!(FileKind::of_bytes(b"\xff\xfe\x00\x01"), FileKind::Binary);
        assert_eq!(of("H Product:Blackbox flight data recorder\n"), FileKind::Blackbox);
        assert_eq!(of("t,z\n0,1\n"), FileKind::Csv);
        assert_eq!(FileKind::of_bytes(b"\xbc\x02\x00\x01\x00rest"), FileKind::Crazyflie);
        assert_eq!(of("Timestamp,stateEstimate.z,pm.vbat\n12,0,4\n"), FileKind::Crazyflie);
        assert_eq!(of("Timestamp,altitude\n12,0\n"), FileKind::Csv);
        assert_eq!(of("time_s,phase,command_throttle_count,x\n"), FileKind::OwnTable(Some(Actuation::Count)));
        assert_eq!(of("time_s,phase,command_throttle_actuation,x\n"), FileKind::OwnTable(None));
        assert_eq!(of("name = \"x\"\n[[phase]]\nkind = \"idle\"\n"), FileKind::Mission);
        assert_eq!(of("airframe = \"a.toml\"\n"), FileKind::Rig);
        assert_eq!(of("[time]\ncolumn = \"t\"\n"), FileKind::ImportMap);
        assert_eq!(
            [of(""), of("hello\n"), of("{ \"a\": 1 }")],
            [FileKind::Empty, FileKind::Text, FileKind::Json]
        );
    }

    #[test]
    fn a_letter_cut_in_two_at_the_end_is_text() {
        let text = "t,z\n".to_owned() + &"ä".repeat(40_000);
        assert_eq!(FileKind::of_bytes(&text.as_bytes()[..LOOKED_AT as usize - 1]), FileKind::Binary);
        let odd = "t,zz\n".to_owned() + &"ä".repeat(40_000);
        assert_eq!(FileKind::of_bytes(&odd.as_bytes()[..LOOKED_AT as usize]), FileKind::Csv);
    }
}
