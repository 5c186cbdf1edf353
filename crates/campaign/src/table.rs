//! Tables of results as Parquet: columns that may be empty in any row, written whole and read column by column.

use std::{
    fs::File,
    io::Write,
    path::{Path, PathBuf},
    sync::Arc,
};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel},
    column::reader::get_typed_column_reader,
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::WriterProperties,
        reader::{FileReader as _, SerializedFileReader},
        writer::SerializedFileWriter,
    },
    schema::types::{Type, TypePtr},
};

use crate::{CampaignError, VERSION};

/// Rows of a group of a merged table.
const GROUP_ROWS: usize = 64 * 1024;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKind {
    /// A finite number.
    Number,
    /// A whole number.
    Integer,
    /// A text.
    Text,
    /// Yes or no.
    Flag,
}

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

    pub(crate) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// Nothing for an empty text.
    pub(crate) fn words(text: impl Into<String>) -> Self {
        let text = text.into();
        if text.is_empty() { Self::Absent } else { Self::Text(text) }
    }
}

/// The values of a column that are there, in the order of their rows.
#[derive(Debug)]
enum Values {
    Number(Vec<f64>),
    Integer(Vec<i64>),
    Text(Vec<ByteArray>),
    Flag(Vec<bool>),
}

/// One column of some rows.
#[derive(Debug)]
pub struct Cells {
    values: Values,
    /// One for each row: 1 where there is a value, 0 where there is none.
    defined: Vec<i16>,
}

impl Cells {
    fn new(kind: CellKind) -> Self {
        let values = match kind {
            CellKind::Number => Values::Number(Vec::new()),
            CellKind::Integer => Values::Integer(Vec::new()),
            CellKind::Text => Values::Text(Vec::new()),
            CellKind::Flag => Values::Flag(Vec::new()),
        };
        Self { values, defined: Vec::new() }
    }

    fn push(&mut self, cell: &Cell) {
        match (&mut self.values, cell) {
            (Values::Number(values), Cell::Number(x)) if x.is_finite() => values.push(*x),
            (Values::Integer(values), Cell::Integer(n)) => values.push(*n),
            (Values::Text(values), Cell::Text(text)) => values.push(text.as_bytes().to_vec().into()),
            (Values::Flag(values), Cell::Flag(yes)) => values.push(*yes),
            // Rows give each column values of its own kind, or nothing.
            _ => return self.defined.push(0),
        }
        self.defined.push(1);
    }

    fn clear(&mut self) {
        self.defined.clear();
        match &mut self.values {
            Values::Number(values) => values.clear(),
            Values::Integer(values) => values.clear(),
            Values::Text(values) => values.clear(),
            Values::Flag(values) => values.clear(),
        }
    }

    fn each<T: Clone>(&self, values: &[T]) -> Vec<Option<T>> {
        let mut values = values.iter();
        self.defined.iter().map(|defined| if *defined == 1 { values.next().cloned() } else { None }).collect()
    }

    /// A number a row; a flag is 0 or 1. Nothing in all rows of a column of texts.
    pub fn numbers(&self) -> Vec<Option<f64>> {
        match &self.values {
            Values::Number(values) => self.each(values),
            Values::Integer(values) => self.each(&values.iter().map(|n| *n as f64).collect::<Vec<_>>()),
            Values::Flag(values) => {
                self.each(&values.iter().map(|yes| f64::from(u8::from(*yes))).collect::<Vec<_>>())
            }
            Values::Text(_) => vec![None; self.defined.len()],
        }
    }

    /// A text a row. Nothing in all rows of a column of another kind.
    pub fn texts(&self) -> Vec<Option<String>> {
        match &self.values {
            Values::Text(values) => {
                let texts: Vec<String> =
                    values.iter().map(|text| String::from_utf8_lossy(text.data()).into_owned()).collect();
                self.each(&texts)
            }
            _ => vec![None; self.defined.len()],
        }
    }
}

fn schema(columns: &[Column]) -> Result<TypePtr, ParquetError> {
    let fields = columns.iter().map(|column| {
        let (physical, logical) = match column.kind {
            CellKind::Number => (Physical::DOUBLE, None),
            CellKind::Integer => (Physical::INT64, None),
            CellKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            CellKind::Flag => (Physical::BOOLEAN, None),
        };
        let field = Type::primitive_type_builder(&column.name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()?;
        Ok(Arc::new(field))
    });
    let fields = fields.collect::<Result<Vec<_>, ParquetError>>()?;
    Ok(Arc::new(Type::group_type_builder("table").with_fields(fields).build()?))
}

/// Writes rows as Parquet, a group of rows at a time.
pub(crate) struct TableWriter<W: Write + Send> {
    writer: SerializedFileWriter<W>,
    group: Vec<Cells>,
}

impl<W: Write + Send> TableWriter<W> {
    /// `label` stands in the file's end, so that whoever finds it knows the table for whole and for his own.
    pub fn new(to: W, columns: &[Column], label: &str) -> Result<Self, ParquetError> {
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_created_by(format!("bench {VERSION}"))
            .set_key_value_metadata(Some(vec![KeyValue::new(LABEL.to_owned(), label.to_owned())]))
            .build();
        let writer = SerializedFileWriter::new(to, schema(columns)?, Arc::new(properties))?;
        Ok(Self { writer, group: columns.iter().map(|column| Cells::new(column.kind)).collect() })
    }

    pub fn row(&mut self, cells: &[Cell]) -> Result<(), ParquetError> {
        for (column, cell) in self.group.iter_mut().zip(cells) {
            column.push(cell);
        }
        self.flush_full()
    }

    /// Adds what was read of another table with the same columns.
    pub fn rows(&mut self, mut cells: Vec<Cells>) -> Result<(), ParquetError> {
        for (column, more) in self.group.iter_mut().zip(&mut cells) {
            column.defined.append(&mut more.defined);
            match (&mut column.values, &mut more.values) {
                (Values::Number(values), Values::Number(more)) => values.append(more),
                (Values::Integer(values), Values::Integer(more)) => values.append(more),
                (Values::Text(values), Values::Text(more)) => values.append(more),
                (Values::Flag(values), Values::Flag(more)) => values.append(more),
                _ => return Err(ParquetError::General("columns of another kind".to_owned())),
            }
        }
        self.flush_full()
    }

    fn flush_full(&mut self) -> Result<(), ParquetError> {
        let rows = self.group.first().map_or(0, |column| column.defined.len());
        if rows >= GROUP_ROWS { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ParquetError> {
        if self.group.iter().all(|column| column.defined.is_empty()) {
            return Ok(());
        }
        let mut rows = self.writer.next_row_group()?;
        for cells in &mut self.group {
            let Some(mut column) = rows.next_column()? else { break };
            let defined = Some(cells.defined.as_slice());
            match &cells.values {
                Values::Number(values) => column.typed::<DoubleType>().write_batch(values, defined, None)?,
                Values::Integer(values) => column.typed::<Int64Type>().write_batch(values, defined, None)?,
                Values::Text(values) => column.typed::<ByteArrayType>().write_batch(values, defined, None)?,
                Values::Flag(values) => column.typed::<BoolType>().write_batch(values, defined, None)?,
            };
            column.close()?;
            cells.clear();
        }
        rows.close()?;
        Ok(())
    }

    pub fn finish(mut self) -> Result<W, ParquetError> {
        self.flush()?;
        self.writer.into_inner()
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
        let columns = schema.columns().iter().map(|column| {
            let kind = match column.physical_type() {
                Physical::INT64 => CellKind::Integer,
                Physical::BYTE_ARRAY => CellKind::Text,
                Physical::BOOLEAN => CellKind::Flag,
                _ => CellKind::Number,
            };
            Column::new(column.name(), kind)
        });
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
                let mut cells = Cells::new(column.kind);
                let reader = group.get_column_reader(place).map_err(damaged)?;
                let defined = &mut cells.defined;
                match &mut cells.values {
                    Values::Number(values) => read_column::<DoubleType>(reader, rows, defined, values),
                    Values::Integer(values) => read_column::<Int64Type>(reader, rows, defined, values),
                    Values::Text(values) => read_column::<ByteArrayType>(reader, rows, defined, values),
                    Values::Flag(values) => read_column::<BoolType>(reader, rows, defined, values),
                }
                .map_err(damaged)?;
                all.push(cells);
            }
            take(all)?;
        }
        Ok(())
    }
}

fn read_column<T: DataType>(
    reader: parquet::column::reader::ColumnReader,
    rows: usize,
    defined: &mut Vec<i16>,
    values: &mut Vec<T::T>,
) -> Result<(), ParquetError> {
    let mut reader = get_typed_column_reader::<T>(reader);
    while defined.len() < rows {
        let (read, ..) = reader.read_records(rows - defined.len(), Some(defined), None, values)?;
        if read == 0 {
            return Err(ParquetError::EOF(format!("{} of {rows} rows", defined.len())));
        }
    }
    Ok(())
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
