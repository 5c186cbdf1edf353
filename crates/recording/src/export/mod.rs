//! Tables for other tools.

mod csv;
mod flight_table;
#[cfg(feature = "exchange")]
mod parquet;
mod table;
#[cfg(feature = "exchange")]
mod xlsx;

use std::{
    fmt,
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

use crate::{Channel, Flight, Recording, RecordingError, partial::PartialFile};
use flight_table::FlightTable;
use table::{ChannelTable, Table};

/// What [`export`] writes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportOptions {
    /// One channel as recorded, by its topic, instead of the flight by control ticks.
    pub channel: Option<String>,
}

/// What [`export`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// Name and number of rows of each table, the heading not counted.
    pub tables: Vec<(String, u64)>,
}

/// Writes a closed recording as a table; the kind goes by `output`'s extension: `.csv`, `.xlsx` or `.parquet`.
///
/// The table has a row for each control tick (what was commanded, read back, seen and wanted), or the messages of one
/// channel. A workbook has the flight, every channel and the session as sheets. Column names carry units. `output`
/// appears only when it is whole; an ordinary file there is replaced.
pub fn export(
    input: impl AsRef<Path>,
    output: impl AsRef<Path>,
    options: &ExportOptions,
) -> Result<Exported, RecordingError> {
    let output = output.as_ref();
    let format = Format::of(output)?;
    let recording = Recording::open(input)?;
    let flight;
    let tables: Vec<Box<dyn Table>> = if let Some(name) = &options.channel {
        vec![Box::new(ChannelTable::new(&recording, channel(&recording, name)?))]
    } else {
        flight = Flight::from_recording(&recording)?;
        default_tables(&recording, &flight, format)?
    };
    let (partial, file) = PartialFile::create(output)?;
    let mut target = Target { path: output, file: BufWriter::new(file) };
    let rows = match format {
        Format::Csv => vec![csv::write(tables[0].as_ref(), &mut target)?],
        #[cfg(feature = "exchange")]
        Format::Parquet => vec![parquet::write(tables[0].as_ref(), &mut target)?],
        #[cfg(feature = "exchange")]
        Format::Xlsx => xlsx::write(&tables, &recording, &mut target)?,
        #[cfg(not(feature = "exchange"))]
        Format::Parquet | Format::Xlsx => {
            return Err(RecordingError::TableNotBuilt { path: output.to_owned() });
        }
    };
    target.file.flush().map_err(|error| partial.error(error))?;
    partial.complete(target.file.get_ref())?;
    Ok(Exported { tables: tables.iter().map(|table| table.name().to_owned()).zip(rows).collect() })
}

/// The kinds of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Csv,
    Xlsx,
    Parquet,
}

impl Format {
    fn of(path: &Path) -> Result<Self, RecordingError> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("xlsx") => Ok(Self::Xlsx),
            Some("parquet") => Ok(Self::Parquet),
            _ => Err(RecordingError::UnknownTable { path: path.to_owned() }),
        }
    }
}

/// The file being written and its name for errors.
struct Target<'a> {
    path: &'a Path,
    file: BufWriter<File>,
}

impl Target<'_> {
    /// The error for what the format's library says.
    fn error(&self, error: &impl fmt::Display) -> RecordingError {
        RecordingError::Table { path: self.path.to_owned(), detail: error.to_string() }
    }
}

/// The flight by control ticks, and in a workbook every channel. A workbook of a recording without ticks, such as an
/// import, has the channels alone.
fn default_tables<'a>(
    recording: &'a Recording,
    flight: &'a Flight,
    format: Format,
) -> Result<Vec<Box<dyn Table + 'a>>, RecordingError> {
    let mut tables: Vec<Box<dyn Table>> = Vec::new();
    if flight.ticks.is_empty() && format != Format::Xlsx {
        return Err(no_messages(recording, Channel::Tick.topic()));
    }
    if !flight.ticks.is_empty() {
        tables.push(Box::new(FlightTable::new(flight)));
    }
    if format == Format::Xlsx {
        for channel in Channel::ALL.into_iter().filter(|channel| recording.count(*channel) > 0) {
            tables.push(Box::new(ChannelTable::new(recording, channel)));
        }
    }
    Ok(tables)
}

/// The channel of a name, if it has messages.
fn channel(recording: &Recording, name: &str) -> Result<Channel, RecordingError> {
    Channel::from_topic(name)
        .filter(|channel| recording.count(*channel) > 0)
        .ok_or_else(|| no_messages(recording, name))
}

fn no_messages(recording: &Recording, channel: &str) -> RecordingError {
    let present = Channel::ALL.into_iter().filter(|channel| recording.count(*channel) > 0);
    RecordingError::NoMessages {
        path: recording.path().to_owned(),
        channel: channel.to_owned(),
        present: present.map(|channel| channel.topic().to_owned()).collect(),
    }
}
