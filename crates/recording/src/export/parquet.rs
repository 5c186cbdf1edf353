use std::{fs::File, io::BufWriter, sync::Arc};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel},
    data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{properties::WriterProperties, writer::SerializedFileWriter},
    schema::types::{Type, TypePtr},
};

use super::{
    Target,
    table::{Column, Table},
};
use crate::{Kind, RecordingError, Value};

/// Rows held in memory before they are written as a group.
const GROUP_ROWS: usize = 64 * 1024;

type Writer<'a> = SerializedFileWriter<&'a mut BufWriter<File>>;

/// Writes the table with zstd compression; returns the number of rows. Times are seconds, missing values null.
pub(crate) fn write(table: &dyn Table, target: &mut Target) -> Result<u64, RecordingError> {
    let path = target.path;
    let failed =
        |error: ParquetError| RecordingError::Table { path: path.to_owned(), detail: error.to_string() };
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(format!("bench {}", crate::session::BENCH_VERSION))
        .build();
    let schema = schema(table.columns()).map_err(failed)?;
    let mut writer =
        SerializedFileWriter::new(&mut target.file, schema, Arc::new(properties)).map_err(failed)?;
    let mut group: Vec<Cells> = table.columns().iter().map(|column| Cells::new(column.kind)).collect();
    let mut rows = 0;
    table.for_each_row(&mut |values| {
        for (cells, value) in group.iter_mut().zip(values) {
            cells.push(*value);
        }
        rows += 1;
        if rows % GROUP_ROWS == 0 { write_group(&mut writer, &mut group).map_err(failed) } else { Ok(()) }
    })?;
    write_group(&mut writer, &mut group).map_err(failed)?;
    writer.close().map_err(failed)?;
    Ok(rows as u64)
}

fn schema(columns: &[Column]) -> Result<TypePtr, ParquetError> {
    let fields = columns.iter().map(|column| {
        let (physical, logical) = match column.kind {
            Kind::Float | Kind::Time => (Physical::DOUBLE, None),
            Kind::Integer => (Physical::INT64, None),
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Bool => (Physical::BOOLEAN, None),
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

fn write_group(writer: &mut Writer, group: &mut [Cells]) -> Result<(), ParquetError> {
    if group.iter().all(|cells| cells.defined.is_empty()) {
        return Ok(());
    }
    let mut row_group = writer.next_row_group()?;
    for cells in group.iter_mut() {
        let Some(mut column) = row_group.next_column()? else { break };
        let defined = Some(cells.defined.as_slice());
        match &cells.values {
            Values::Double(values) => column.typed::<DoubleType>().write_batch(values, defined, None)?,
            Values::Integer(values) => column.typed::<Int64Type>().write_batch(values, defined, None)?,
            Values::Text(values) => column.typed::<ByteArrayType>().write_batch(values, defined, None)?,
            Values::Bool(values) => column.typed::<BoolType>().write_batch(values, defined, None)?,
        };
        column.close()?;
        cells.clear();
    }
    row_group.close()?;
    Ok(())
}

/// A column of the group that is being filled.
struct Cells {
    values: Values,
    /// One for each row: 1 where there is a value, 0 where it is missing.
    defined: Vec<i16>,
}

enum Values {
    Double(Vec<f64>),
    Integer(Vec<i64>),
    Text(Vec<ByteArray>),
    Bool(Vec<bool>),
}

impl Cells {
    fn new(kind: Kind) -> Self {
        let values = match kind {
            Kind::Float | Kind::Time => Values::Double(Vec::new()),
            Kind::Integer => Values::Integer(Vec::new()),
            Kind::Text => Values::Text(Vec::new()),
            Kind::Bool => Values::Bool(Vec::new()),
        };
        Self { values, defined: Vec::new() }
    }

    fn push(&mut self, value: Value) {
        match (&mut self.values, value) {
            (Values::Double(values), Value::Float(x)) => values.push(x),
            (Values::Double(values), Value::Time(time)) => values.push(time.seconds()),
            (Values::Integer(values), Value::Integer(n)) => values.push(n.cast_signed()),
            (Values::Text(values), Value::Text(text)) => values.push(text.as_bytes().to_vec().into()),
            (Values::Bool(values), Value::Bool(yes)) => values.push(yes),
            // The field table gives each field values of its own kind only.
            _ => return self.defined.push(0),
        }
        self.defined.push(1);
    }

    fn clear(&mut self) {
        self.defined.clear();
        match &mut self.values {
            Values::Double(values) => values.clear(),
            Values::Integer(values) => values.clear(),
            Values::Text(values) => values.clear(),
            Values::Bool(values) => values.clear(),
        }
    }
}
