//! CSV files: one topic, whose fields are the columns. Cells are handed over as the text that they are.

use std::{
    fs::File,
    io::{self, BufReader},
    ops::ControlFlow,
    path::Path,
};

use csv::ByteRecord;

use crate::{Cell, Field, LogError, Losses, Sample, TableForm, Topic, Visitor, bytes::unread};

pub(crate) fn scan(path: &Path, form: TableForm, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let file = File::open(path).map_err(|source| unread(path, source))?;
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(form.delimiter)
        .has_headers(form.has_header)
        // Rows of another width are counted, not fatal.
        .flexible(true)
        .from_reader(BufReader::new(file));
    let failed = |error: csv::Error| unread(path, io::Error::from(error));
    let first = reader.byte_headers().map_err(failed)?;
    let columns: Vec<String> = if form.has_header {
        first.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect()
    } else {
        (1..=first.len()).map(|place| place.to_string()).collect()
    };
    if columns.iter().all(String::is_empty) {
        return Err(LogError::NoHeader { path: path.to_owned() });
    }
    let width = columns.len();
    let fields = columns.into_iter().map(Field::new).collect();
    let topic = Topic { name: String::new(), kind: String::new(), fields };
    let Some(wanted) = visitor.topic(&topic) else { return Ok(Losses::default()) };
    let mut row = ByteRecord::new();
    while reader.read_byte_record(&mut row).map_err(failed)? {
        let line = row.position().map_or(0, csv::Position::line);
        let whole = row.len() == width;
        let cells: Vec<Cell<'_>> =
            if whole { wanted.iter().map(|&place| Cell::Text(&row[place])).collect() } else { Vec::new() };
        let torn = (!whole).then(|| row.as_slice());
        if let ControlFlow::Break(()) =
            visitor.sample(Sample { topic: 0, time_ns: None, cells: &cells, line, torn })
        {
            break;
        }
    }
    Ok(Losses::default())
}
