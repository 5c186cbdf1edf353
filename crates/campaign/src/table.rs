//! Tables of results as Parquet: columns that may be empty in any row, written whole and read column by column.

use std::{
    fs::File,
    io::Write,
    path::{Path, PathBuf},
};

use bench_recording::{CellKind, Cells, ColumnWriter};
use parquet::{
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        reader::{FileReader as _, SerializedFileReader},
    },
};

use crate::CampaignError;

/// A column: its name, as query languages take it without quotes, and its kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name, its unit included.
    pub name: String,
    /// What it holds.
    pub kind: CellKind,
}

impl Column {
    pub(crate) fn new(name: impl Into<String>, kind: CellKind) -> Self {
        Self { name: name.into(), kind }
    }
}

/// A value of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Nothing.
    Absent,
    /// A number; one that is not finite is written as nothing.
    Number(f64),
    /// A whole number.
    Integer(i64),
    /// A text.
    Text(String),
    /// Yes or no.
    Flag(bool),
}

impl Cell {
    pub(crate) fn number(x: Option<f64>) -> Self {
        x.filter(|x| x.is_finite()).map_or(Self::Absent, Self::Number)
    }

    fn push_to(&self, column: &mut Cells) {
        match self {
            Self::Number(x) if x.is_finite() => column.number(*x),
            Self::Integer(n) => column.integer(*n),
            Self::Text(text) => column.text(text),
            Self::Flag(yes) => column.flag(*yes),
            Self::Absent | Self::Number(_) => column.absent(),
        }
    }

    pub(crate) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// Nothing for an empty text.
    pub(crate) fn words(text: impl Into<String>) -> Self {
        let text = text.into();
        if text.is_empty() { Self::Absent } else { Self::Text(text) }
    }
}

/// Writes rows as Parquet, a group of rows at a time.
pub(crate) struct TableWriter<W: Write + Send>(ColumnWriter<W>);

impl<W: Write + Send> TableWriter<W> {
    /// `label` stands in the file's end, so that whoever finds it knows the table for whole and for his own.
    pub fn new(to: W, columns: &[Column], label: &str) -> Result<Self, ParquetError> {
        let columns: Vec<(&str, CellKind)> =
            columns.iter().map(|column| (column.name.as_str(), column.kind)).collect();
        let label = KeyValue::new(LABEL.to_owned(), label.to_owned());
        Ok(Self(ColumnWriter::new(to, &columns, Some(vec![label]))?))
    }

    pub fn row(&mut self, cells: &[Cell]) -> Result<(), ParquetError> {
        self.0.row(|group| {
            for (column, cell) in group.iter_mut().zip(cells) {
                cell.push_to(column);
            }
        })
    }

    /// Adds what was read of another table with the same columns.
    pub fn rows(&mut self, cells: Vec<Cells>) -> Result<(), ParquetError> {
        self.0.rows(cells)
    }

    pub fn finish(self) -> Result<W, ParquetError> {
        self.0.finish()
    }
}

/// The key of the label at a file's end.
const LABEL: &str = "bench.sweep";

/// The label of a whole Parquet file and how many rows it has; `None` of what is none, or was cut.
pub(crate) fn label(path: &Path) -> Option<(String, usize)> {
    let reader = SerializedFileReader::new(File::open(path).ok()?).ok()?;
    let metadata = reader.metadata().file_metadata();
    let entry = metadata.key_value_metadata()?.iter().find(|entry| entry.key == LABEL)?;
    Some((entry.value.clone()?, usize::try_from(metadata.num_rows()).ok()?))
}

/// A table that is read, a group of rows at a time.
pub struct Table {
    reader: SerializedFileReader<File>,
    path: PathBuf,
    columns: Vec<Column>,
}

impl Table {
    /// Opens a table that a sweep wrote.
    pub fn open(path: &Path) -> Result<Self, CampaignError> {
        let file = File::open(path).map_err(|source| CampaignError::Io {
            action: "read",
            path: path.to_owned(),
            source,
        })?;
        let damaged =
            |error: ParquetError| CampaignError::Damaged { path: path.to_owned(), detail: error.to_string() };
        let reader = SerializedFileReader::new(file).map_err(damaged)?;
        let schema = reader.metadata().file_metadata().schema_descr();
        let columns = schema
            .columns()
            .iter()
            .map(|column| Column::new(column.name(), CellKind::of(column.physical_type())));
        let columns = columns.collect();
        Ok(Self { reader, path: path.to_owned(), columns })
    }

    /// Its columns, in the order of the file.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Hands over all columns of each group of rows, in the order of the rows.
    pub fn for_each_group(
        &self,
        mut take: impl FnMut(Vec<Cells>) -> Result<(), CampaignError>,
    ) -> Result<(), CampaignError> {
        let damaged = |error: ParquetError| CampaignError::Damaged {
            path: self.path.clone(),
            detail: error.to_string(),
        };
        for index in 0..self.reader.num_row_groups() {
            let group = self.reader.get_row_group(index).map_err(damaged)?;
            let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            let mut all = Vec::with_capacity(self.columns.len());
            for (place, column) in self.columns.iter().enumerate() {
                let reader = group.get_column_reader(place).map_err(damaged)?;
                all.push(Cells::read(column.kind, reader, rows).map_err(damaged)?);
            }
            take(all)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_reads_back_as_it_was_written() {
        let columns = [
            Column::new("x_m", CellKind::Number),
            Column::new("n", CellKind::Integer),
            Column::new("id", CellKind::Text),
            Column::new("passed", CellKind::Flag),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let mut writer = TableWriter::new(File::create(&path).unwrap(), &columns, "mine").unwrap();
        writer.row(&[Cell::Number(0.5), Cell::Integer(-3), Cell::text("a"), Cell::Flag(true)]).unwrap();
        writer.row(&[Cell::Number(f64::NAN), Cell::Absent, Cell::words(""), Cell::Absent]).unwrap();
        writer.row(&[Cell::Absent, Cell::Integer(7), Cell::text("b"), Cell::Flag(false)]).unwrap();
        writer.finish().unwrap();
        assert_eq!(label(&path), Some(("mine".to_owned(), 3)));

        let table = Table::open(&path).unwrap();
        assert_eq!(table.columns(), columns);
        let mut groups = Vec::new();
        let mut take = |cells| {
            groups.push(cells);
            Ok(())
        };
        table.for_each_group(&mut take).unwrap();
        let [cells] = groups.as_slice() else { panic!("one group is expected") };
        assert_eq!(cells[0].numbers(), [Some(0.5), None, None]);
        assert_eq!(cells[1].numbers(), [Some(-3.0), None, Some(7.0)]);
        assert_eq!(cells[2].texts(), [Some("a".to_owned()), None, Some("b".to_owned())]);
        assert_eq!(cells[3].numbers(), [Some(1.0), None, Some(0.0)]);

        // A file that was cut has no end, and so no label.
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 10]).unwrap();
        assert_eq!(label(&path), None);
        assert!(Table::open(&path).is_err());
    }
}
