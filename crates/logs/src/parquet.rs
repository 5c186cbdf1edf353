//! Parquet tables: one topic, whose fields are the columns that hold numbers, texts or times.

use std::{fs::File, ops::ControlFlow, path::Path};

use parquet::{
    file::reader::{FileReader as _, SerializedFileReader},
    record::Field as Value,
};

use crate::{Cell, Field, Format, LogError, Losses, Sample, Topic, Visitor, bytes::unread};

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let malformed = |source: parquet::errors::ParquetError| LogError::Malformed {
        path: path.to_owned(),
        format: Format::Parquet.words(),
        detail: "a table is written last of all, so one that was cut cannot be read".to_owned(),
        source: Some(source.into()),
    };
    let file = File::open(path).map_err(|source| unread(path, source))?;
    let reader = SerializedFileReader::new(file).map_err(malformed)?;
    let columns = reader.metadata().file_metadata().schema().get_fields().to_vec();
    let fields = columns.iter().map(|column| Field::new(column.name())).collect();
    let Some(wanted) = visitor.topic(&Topic { name: String::new(), kind: String::new(), fields }) else {
        return Ok(Losses::default());
    };
    let mut losses = Losses::default();
    for (number, row) in (1..).zip(reader.get_row_iter(None).map_err(malformed)?) {
        let Ok(row) = row else {
            losses.damaged += 1;
            break;
        };
        let values: Vec<&Value> = row.get_column_iter().map(|(_, value)| value).collect();
        let cells: Vec<Cell<'_>> =
            wanted.iter().map(|place| values.get(*place).map_or(Cell::Absent, |value| cell(value))).collect();
        let sample = Sample { topic: 0, time_ns: None, cells: &cells, line: number };
        if visitor.sample(sample) == ControlFlow::Break(()) {
            break;
        }
    }
    Ok(losses)
}

fn cell(value: &Value) -> Cell<'_> {
    match value {
        Value::Bool(is) => Cell::Integer(i128::from(*is)),
        Value::Byte(number) => Cell::Integer((*number).into()),
        Value::Short(number) => Cell::Integer((*number).into()),
        Value::Int(number) => Cell::Integer((*number).into()),
        Value::Long(number) => Cell::Integer((*number).into()),
        Value::UByte(number) => Cell::Integer((*number).into()),
        Value::UShort(number) => Cell::Integer((*number).into()),
        Value::UInt(number) => Cell::Integer((*number).into()),
        Value::ULong(number) => Cell::Integer((*number).into()),
        Value::Float16(number) => Cell::Number(number.to_f64()),
        Value::Float(number) => Cell::Number((*number).into()),
        Value::Double(number) => Cell::Number(*number),
        // Times are handed over in nanoseconds, whatever the table counts in.
        Value::TimestampMillis(time) => Cell::Integer(i128::from(*time) * 1_000_000),
        Value::TimestampMicros(time) => Cell::Integer(i128::from(*time) * 1000),
        Value::Str(text) => Cell::Text(text.as_bytes()),
        Value::Bytes(bytes) => Cell::Text(bytes.data()),
        _ => Cell::Absent,
    }
}
