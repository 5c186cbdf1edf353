use super::{Target, table::Table};
use crate::{RecordingError, Value};

/// Writes the table with a heading; returns the number of rows. Numbers in the shortest form that reads back to the
/// same value, times in seconds to the nanosecond, missing values empty.
pub(crate) fn write(table: &dyn Table, target: &mut Target) -> Result<u64, RecordingError> {
    let path = target.path;
    let failed = |error: csv::Error| match error.into_kind() {
        csv::ErrorKind::Io(source) => RecordingError::Io { action: "write", path: path.to_owned(), source },
        kind => RecordingError::Table { path: path.to_owned(), detail: format!("{kind:?}") },
    };
    let mut writer = csv::Writer::from_writer(&mut target.file);
    writer.write_record(table.columns().iter().map(|column| &column.name)).map_err(failed)?;
    let mut rows = 0;
    table.for_each_row(&mut |values| {
        rows += 1;
        writer.write_record(values.iter().map(|value| text(*value))).map_err(failed)
    })?;
    writer.flush().map_err(|source| failed(source.into()))?;
    Ok(rows)
}

fn text(value: Value) -> String {
    match value {
        Value::Missing => String::new(),
        Value::Float(x) => x.to_string(),
        Value::Integer(n) => n.to_string(),
        Value::Text(text) => text.to_owned(),
        Value::Bool(yes) => yes.to_string(),
        Value::Time(time) => {
            format!("{}.{:09}", time.nanos() / 1_000_000_000, time.nanos() % 1_000_000_000)
        }
    }
}
