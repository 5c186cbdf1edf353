use parquet::errors::ParquetError;

use super::{Target, table::Table};
use crate::{
    Kind, RecordingError, Value,
    columns::{CellKind, Cells, ColumnWriter},
};

/// Writes the table with zstd compression; returns the number of rows. Times are seconds, missing values null.
pub(crate) fn write(table: &dyn Table, target: &mut Target) -> Result<u64, RecordingError> {
    let path = target.path;
    let failed =
        |error: ParquetError| RecordingError::Table { path: path.to_owned(), detail: error.to_string() };
    let columns: Vec<(&str, CellKind)> = table
        .columns()
        .iter()
        .map(|column| {
            let kind = match column.kind {
                Kind::Float | Kind::Time => CellKind::Number,
                Kind::Integer => CellKind::Integer,
                Kind::Text => CellKind::Text,
                Kind::Bool => CellKind::Flag,
            };
            (column.name.as_str(), kind)
        })
        .collect();
    let mut writer = ColumnWriter::new(&mut target.file, &columns, None).map_err(failed)?;
    let mut rows = 0;
    table.for_each_row(&mut |values| {
        rows += 1;
        let fill = |group: &mut [Cells]| {
            for (cells, value) in group.iter_mut().zip(values) {
                push(cells, *value);
            }
        };
        writer.row(fill).map_err(failed)
    })?;
    writer.finish().map_err(failed)?;
    Ok(rows)
}

fn push(cells: &mut Cells, value: Value) {
    match value {
        Value::Float(x) => cells.number(x),
        Value::Time(time) => cells.number(time.seconds()),
        Value::Integer(n) => cells.integer(n.cast_signed()),
        Value::Text(text) => cells.text(text),
        Value::Bool(yes) => cells.flag(yes),
        Value::Missing => cells.absent(),
    }
}
