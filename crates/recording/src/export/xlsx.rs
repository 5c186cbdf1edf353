use rust_xlsxwriter::{DocProperties, ExcelDateTime, Format, Workbook, Worksheet, XlsxError};

use super::{Target, table::Table};
use crate::{Recording, RecordingError, Value};

/// Rows of a sheet without its heading.
const ROW_LIMIT: u64 = 1_048_576 - 1;

/// Writes each table as a sheet and the session as the last one; returns the tables' numbers of rows.
pub(crate) fn write(
    tables: &[Box<dyn Table + '_>],
    recording: &Recording,
    target: &mut Target,
) -> Result<Vec<u64>, RecordingError> {
    for table in tables {
        check_rows(table.as_ref())?;
    }
    let failed = |error: XlsxError| target.error(&error);
    let mut workbook = Workbook::new();
    // A workbook tells when it was made; the same recording shall give the same bytes.
    let epoch = ExcelDateTime::from_ymd(2000, 1, 1).map_err(failed)?;
    workbook.set_properties(&DocProperties::new().set_creation_datetime(&epoch));
    let mut rows = Vec::new();
    for table in tables {
        let sheet = workbook.add_worksheet();
        sheet.set_name(sheet_name(table.name())).map_err(failed)?;
        rows.push(write_table(table.as_ref(), sheet, target)?);
    }
    let sheet = workbook.add_worksheet();
    write_session(recording, sheet).map_err(failed)?;
    workbook.save_to_writer(&mut target.file).map_err(|error| target.error(&error))?;
    Ok(rows)
}

fn check_rows(table: &dyn Table) -> Result<(), RecordingError> {
    let rows = table.row_count();
    if rows > ROW_LIMIT {
        let channel = table.name().to_owned();
        return Err(RecordingError::TooManyRows { channel, rows, limit: ROW_LIMIT });
    }
    Ok(())
}

/// Sheets may not have slashes in their names.
fn sheet_name(table: &str) -> String {
    table.trim_start_matches('/').replace('/', " ")
}

fn write_table(table: &dyn Table, sheet: &mut Worksheet, target: &Target) -> Result<u64, RecordingError> {
    let failed = |error: XlsxError| target.error(&error);
    let heading = Format::new().set_bold();
    for (column, number) in table.columns().iter().zip(0..) {
        sheet.write_with_format(0, number, &column.name, &heading).map_err(failed)?;
    }
    sheet.set_freeze_panes(1, 0).map_err(failed)?;
    let mut row = 0;
    table.for_each_row(&mut |values| {
        row += 1;
        for (value, column) in values.iter().zip(0..) {
            write_value(sheet, row, column, *value).map_err(failed)?;
        }
        Ok(())
    })?;
    Ok(u64::from(row))
}

fn write_value(sheet: &mut Worksheet, row: u32, column: u16, value: Value) -> Result<(), XlsxError> {
    match value {
        Value::Missing => return Ok(()),
        // A cell holds finite numbers only.
        Value::Float(x) if !x.is_finite() => sheet.write(row, column, x.to_string())?,
        Value::Float(x) => sheet.write(row, column, x)?,
        Value::Integer(n) => sheet.write(row, column, n)?,
        Value::Text(text) => sheet.write(row, column, text)?,
        Value::Bool(yes) => sheet.write(row, column, yes)?,
        Value::Time(time) => sheet.write(row, column, time.seconds())?,
    };
    Ok(())
}

/// What the recording is, then the rig and mission files line by line.
fn write_session(recording: &Recording, sheet: &mut Worksheet) -> Result<(), XlsxError> {
    sheet.set_name("session")?;
    let info = recording.info();
    let session = recording.session();
    let seed = info.seed.map(|seed| seed.to_string()).unwrap_or_default();
    let mut lines = vec![
        ("mode", info.mode.as_str()),
        ("rig", &info.rig),
        ("mission", &info.mission),
        ("seed", &seed),
        ("bench_version", &info.bench_version),
        ("platform", &info.platform),
    ];
    lines.extend(info.extra.iter().map(|(key, value)| (key.as_str(), value.as_str())));
    for (name, text) in [("rig.toml", &session.rig_toml), ("mission.toml", &session.mission_toml)] {
        lines.extend(text.iter().flat_map(|text| text.lines()).map(|line| (name, line)));
    }
    for ((key, value), row) in lines.into_iter().zip(0..) {
        sheet.write(row, 0, key)?;
        sheet.write_string(row, 1, value)?;
    }
    Ok(())
}
