//! The CSV file: columns found by name, cells given out as checked values.

use std::{
    borrow::Cow,
    fs::File,
    io::{self, BufRead as _, BufReader, Read as _},
    path::Path,
};

use bench_rig::visit::Range;
use csv::ByteRecord;

use super::{
    ImportError, ImportMap,
    error::ColumnProblem,
    map::ColumnId,
    number::{TimeUnit, finite, nanos},
    report::{ColumnsReport, SkipReason},
    topics::{Held, Value},
};
use crate::FileKind;

/// A CSV file that has every column that the map asks for.
pub(super) struct Log {
    reader: csv::Reader<File>,
    /// The place in a row of each of the map's columns.
    places: Vec<Option<usize>>,
    width: usize,
    record: ByteRecord,
    pub columns: ColumnsReport,
}

/// Why a row cannot be used, and which of its columns is at fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub reason: SkipReason,
    /// `None`: the row as a whole.
    pub column: Option<ColumnId>,
}

impl Fault {
    /// Whether there is nothing, which is not to say that something is wrong.
    pub fn is_lack(&self) -> bool {
        matches!(self.reason, SkipReason::Empty | SkipReason::Nan)
    }
}

/// One row.
#[derive(Clone, Copy)]
pub(super) struct Row<'a>(Kind<'a>);

#[derive(Clone, Copy)]
enum Kind<'a> {
    Text {
        record: &'a ByteRecord,
        places: &'a [Option<usize>],
        width: usize,
    },
    /// In the order of the map's columns.
    Cells {
        held: &'a [Held],
        line: u64,
        /// The log's time, ns, where it is in no column.
        stamp_ns: Option<i128>,
    },
}

fn begins_with_text(path: &Path) -> io::Result<bool> {
    const LONGEST: u64 = 65_536;
    let mut line = Vec::new();
    BufReader::new(File::open(path)?.take(LONGEST)).read_until(b'\n', &mut line)?;
    Ok(line.ends_with(b"\n") && !line.contains(&0) && str::from_utf8(&line).is_ok())
}

impl Log {
    pub fn open(map: &ImportMap, path: &Path) -> Result<Self, ImportError> {
        let unread = |source| ImportError::Read { path: path.to_owned(), source };
        match FileKind::of(path).map_err(unread)? {
            FileKind::Empty => return Err(ImportError::NoHeader { path: path.to_owned() }),
            // Bytes that are no text in a row are that row's fault, where the first line names columns.
            FileKind::Binary if begins_with_text(path).map_err(unread)? => {}
            kind => {
                if let Some(advice) = kind.instead_of_log() {
                    return Err(ImportError::NotCsv { path: path.to_owned(), kind, advice });
                }
            }
        }
        let file = File::open(path).map_err(unread)?;
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(map.delimiter)
            .has_headers(map.has_header)
            // Rows of another width are counted, not fatal.
            .flexible(true)
            .from_reader(file);
        let first = reader.byte_headers().map_err(|error| read_error(path, error))?;
        let name = |(place, name): (usize, &[u8])| {
            if map.has_header {
                String::from_utf8_lossy(name).trim().to_owned()
            } else {
                (place + 1).to_string()
            }
        };
        let columns: Vec<String> = first.iter().enumerate().map(name).collect();
        if columns.iter().all(String::is_empty) {
            return Err(ImportError::NoHeader { path: path.to_owned() });
        }
        let places = find_columns(map, path, &columns)?;
        let width = columns.len();
        let columns = ColumnsReport::new(map, columns);
        Ok(Self { reader, places, width, record: ByteRecord::new(), columns })
    }

    /// The next row below the header, if there is one.
    pub fn next_row(&mut self, path: &Path) -> Result<Option<Row<'_>>, ImportError> {
        let more = self.reader.read_byte_record(&mut self.record).map_err(|error| read_error(path, error))?;
        let row = Kind::Text { record: &self.record, places: &self.places, width: self.width };
        Ok(more.then_some(Row(row)))
    }
}

/// The places of the map's columns in a table; `None` for an optional one that it does not have.
pub(super) fn find_columns(
    map: &ImportMap,
    path: &Path,
    columns: &[String],
) -> Result<Vec<Option<usize>>, ImportError> {
    let mut problems = Vec::new();
    let mut places = Vec::with_capacity(map.columns.len());
    for column in &map.columns {
        let mut found = (0..columns.len()).filter(|&place| columns[place] == column.name);
        match (found.next(), found.count()) {
            (Some(place), 0) => places.push(Some(place)),
            (None, _) if column.optional => places.push(None),
            (first, more) => problems.push(ColumnProblem {
                at: column.at.clone(),
                key: column.key.clone(),
                column: column.name.clone(),
                count: usize::from(first.is_some()) + more,
            }),
        }
    }
    if problems.is_empty() {
        Ok(places)
    } else {
        Err(ImportError::Columns { path: path.to_owned(), problems, columns: columns.to_vec() })
    }
}

pub(super) fn read_error(path: &Path, error: csv::Error) -> ImportError {
    ImportError::Read { path: path.to_owned(), source: error.into() }
}

impl<'a> Row<'a> {
    /// A row that is no text.
    pub fn of_cells(held: &'a [Held], line: u64, stamp_ns: Option<i128>) -> Self {
        Self(Kind::Cells { held, line, stamp_ns })
    }

    /// Line in the file, or which row it is; counted from one.
    pub fn line(&self) -> u64 {
        match self.0 {
            Kind::Text { record, .. } => record.position().map_or(0, csv::Position::line),
            Kind::Cells { line, .. } => line,
        }
    }

    /// Whether it is as wide as the header.
    pub fn is_whole(&self) -> bool {
        match self.0 {
            Kind::Text { record, width, .. } => record.len() == width,
            Kind::Cells { .. } => true,
        }
    }

    /// The log's time, ns, where it is in no column.
    pub fn stamp_ns(&self) -> Option<i128> {
        match self.0 {
            Kind::Text { .. } => None,
            Kind::Cells { stamp_ns, .. } => stamp_ns,
        }
    }

    /// Whether a column's value came with this row; else it is the last one before.
    pub fn brings(&self, column: ColumnId) -> bool {
        match self.0 {
            Kind::Text { .. } => true,
            Kind::Cells { held, .. } => held[column.0].is_new,
        }
    }

    /// The bytes of a cell of a CSV file; none of a column that it does not have.
    fn cell(record: &'a ByteRecord, places: &[Option<usize>], column: ColumnId) -> &'a [u8] {
        places[column.0].map_or(&[], |place| &record[place])
    }

    /// What stands in a column, for messages; of a row of the wrong width, all of it.
    pub fn found(&self, column: Option<ColumnId>) -> String {
        match (self.0, column) {
            (Kind::Text { record, places, .. }, Some(column)) => {
                String::from_utf8_lossy(Self::cell(record, places, column)).into_owned()
            }
            (Kind::Text { record, .. }, None) => String::from_utf8_lossy(record.as_slice()).into_owned(),
            (Kind::Cells { held, .. }, Some(column)) => held[column.0].value.to_string(),
            (Kind::Cells { stamp_ns, .. }, None) => {
                stamp_ns.map_or_else(String::new, |nanos| format!("{nanos} ns"))
            }
        }
    }

    /// The text of a cell without surrounding space. The row must be whole.
    pub fn text(&self, column: ColumnId) -> Result<Cow<'a, str>, Fault> {
        match self.0 {
            Kind::Text { record, places, .. } => str::from_utf8(Self::cell(record, places, column))
                .map(|text| Cow::Borrowed(text.trim()))
                .map_err(|_| SkipReason::NotANumber.in_column(column)),
            Kind::Cells { held, .. } => Ok(match &held[column.0].value {
                Value::Text(text) => Cow::Borrowed(text),
                other => Cow::Owned(other.to_string()),
            }),
        }
    }

    /// The number of a cell, within `valid` where that is given.
    pub fn number(&self, column: ColumnId, valid: Option<Range>) -> Result<f64, Fault> {
        let number = match self.0 {
            Kind::Cells { held, .. } => held[column.0].value.finite(),
            Kind::Text { .. } => finite(&self.text(column)?),
        };
        let number = number.map_err(|reason| reason.in_column(column))?;
        if valid.is_none_or(|valid| valid.contains(number)) {
            Ok(number)
        } else {
            Err(SkipReason::OutOfRange.in_column(column))
        }
    }

    /// The time of a cell, ns.
    pub fn nanos(&self, column: ColumnId, unit: TimeUnit) -> Result<i128, Fault> {
        nanos(&self.text(column)?, unit).map_err(|reason| reason.in_column(column))
    }
}

impl SkipReason {
    pub(super) fn in_column(self, column: ColumnId) -> Fault {
        Fault { reason: self, column: Some(column) }
    }
}
