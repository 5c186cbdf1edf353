//! Columns whose cells may be empty in any row, as Parquet: filled a group of rows at a time, and read back so.

use std::{io::Write, sync::Arc};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel},
    column::reader::{ColumnReader, get_typed_column_reader},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{metadata::KeyValue, properties::WriterProperties, writer::SerializedFileWriter},
    schema::types::{Type, TypePtr},
};

use crate::session::BENCH_VERSION;

/// Rows held in memory before they are written as a group.
const GROUP_ROWS: usize = 64 * 1024;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKind {
    /// A number.
    Number,
    /// A whole number.
    Integer,
    /// A text.
    Text,
    /// Yes or no.
    Flag,
}

impl CellKind {
    /// The kind of a column that a file holds.
    pub fn of(physical: Physical) -> Self {
        match physical {
            Physical::INT64 => Self::Integer,
            Physical::BYTE_ARRAY => Self::Text,
            Physical::BOOLEAN => Self::Flag,
            _ => Self::Number,
        }
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

    /// Reads a column of a group of so many rows.
    pub fn read(kind: CellKind, reader: ColumnReader, rows: usize) -> Result<Self, ParquetError> {
        let mut cells = Self::new(kind);
        let defined = &mut cells.defined;
        match &mut cells.values {
            Values::Number(values) => read_column::<DoubleType>(reader, rows, defined, values),
            Values::Integer(values) => read_column::<Int64Type>(reader, rows, defined, values),
            Values::Text(values) => read_column::<ByteArrayType>(reader, rows, defined, values),
            Values::Flag(values) => read_column::<BoolType>(reader, rows, defined, values),
        }?;
        Ok(cells)
    }

    /// A row with nothing.
    pub fn absent(&mut self) {
        self.defined.push(0);
    }

    /// A row with a number; nothing in a column of another kind, as for the following.
    pub fn number(&mut self, x: f64) {
        let Values::Number(values) = &mut self.values else { return self.absent() };
        values.push(x);
        self.defined.push(1);
    }

    /// A row with a whole number.
    pub fn integer(&mut self, n: i64) {
        let Values::Integer(values) = &mut self.values else { return self.absent() };
        values.push(n);
        self.defined.push(1);
    }

    /// A row with a text.
    pub fn text(&mut self, text: &str) {
        let Values::Text(values) = &mut self.values else { return self.absent() };
        values.push(text.as_bytes().to_vec().into());
        self.defined.push(1);
    }

    /// A row with yes or no.
    pub fn flag(&mut self, yes: bool) {
        let Values::Flag(values) = &mut self.values else { return self.absent() };
        values.push(yes);
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

    fn append(&mut self, more: &mut Self) -> Result<(), ParquetError> {
        self.defined.append(&mut more.defined);
        match (&mut self.values, &mut more.values) {
            (Values::Number(values), Values::Number(more)) => values.append(more),
            (Values::Integer(values), Values::Integer(more)) => values.append(more),
            (Values::Text(values), Values::Text(more)) => values.append(more),
            (Values::Flag(values), Values::Flag(more)) => values.append(more),
            _ => return Err(ParquetError::General("columns of another kind".to_owned())),
        }
        Ok(())
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

fn read_column<T: DataType>(
    reader: ColumnReader,
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

fn schema(columns: &[(&str, CellKind)]) -> Result<TypePtr, ParquetError> {
    let fields = columns.iter().map(|(name, kind)| {
        let (physical, logical) = match kind {
            CellKind::Number => (Physical::DOUBLE, None),
            CellKind::Integer => (Physical::INT64, None),
            CellKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            CellKind::Flag => (Physical::BOOLEAN, None),
        };
        let field = Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()?;
        Ok(Arc::new(field))
    });
    let fields = fields.collect::<Result<Vec<_>, ParquetError>>()?;
    Ok(Arc::new(Type::group_type_builder("table").with_fields(fields).build()?))
}

/// Writes rows as Parquet with zstd compression, a group of rows at a time.
pub struct ColumnWriter<W: Write + Send> {
    writer: SerializedFileWriter<W>,
    group: Vec<Cells>,
}

impl<W: Write + Send> ColumnWriter<W> {
    /// Columns by name and kind; `metadata` stands in the file's end.
    pub fn new(
        to: W,
        columns: &[(&str, CellKind)],
        metadata: Option<Vec<KeyValue>>,
    ) -> Result<Self, ParquetError> {
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_created_by(format!("bench {BENCH_VERSION}"))
            .set_key_value_metadata(metadata)
            .build();
        let writer = SerializedFileWriter::new(to, schema(columns)?, Arc::new(properties))?;
        Ok(Self { writer, group: columns.iter().map(|(_, kind)| Cells::new(*kind)).collect() })
    }

    /// Adds a row: `fill` gives each column one cell.
    pub fn row(&mut self, fill: impl FnOnce(&mut [Cells])) -> Result<(), ParquetError> {
        fill(&mut self.group);
        self.flush_full()
    }

    /// Adds what was read of another table with the same columns.
    pub fn rows(&mut self, mut cells: Vec<Cells>) -> Result<(), ParquetError> {
        for (column, more) in self.group.iter_mut().zip(&mut cells) {
            column.append(more)?;
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

    /// Writes the last rows and the file's end.
    pub fn finish(mut self) -> Result<W, ParquetError> {
        self.flush()?;
        self.writer.into_inner()
    }
}
