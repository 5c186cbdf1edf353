use std::{
    io::{self, BufWriter, Write as _},
    path::Path,
};

use bench_device::Time;

use crate::{
    Channel, Record, Recording, RecordingError, partial::PartialFile, recover::same_file, session::DROPPED,
    writer::MessageWriter,
};

/// In the session's `extra` of a thinned recording: the interval, s.
const THINNED_TO: &str = "thinned_to_s";

/// Writes a recording's thinned form, to hold later flights against: of each channel a record per `interval_s`, all events, numbers of
/// single precision, and nothing for viewers. The same recording gives the same bytes. `output` appears only when it is whole; an ordinary
/// file there is replaced.
///
/// With half of the loop's period as interval, all of the loop's own records stay, and what a command does, which holds for a period, is
/// seen at least twice.
pub fn thin(
    input: impl AsRef<Path>,
    output: impl AsRef<Path>,
    interval_s: f64,
) -> Result<(), RecordingError> {
    let (input, output) = (input.as_ref(), output.as_ref());
    if !(interval_s >= 0.0 && interval_s.is_finite()) {
        return Err(RecordingError::BadOption {
            option: "interval_s",
            value: interval_s.to_string(),
            expected: "a time of 0 s or more",
        });
    }
    let recording = Recording::open(input)?;
    if same_file(input, output) {
        return Err(RecordingError::OutputIsInput { path: output.to_owned() });
    }
    let mut session = recording.session().clone();
    session.extra.insert(THINNED_TO.to_owned(), interval_s.to_string());
    let (partial, file) = PartialFile::create(output)?;
    let failed = |error: io::Error| partial.error(error);
    let mut writer = MessageWriter::start(BufWriter::new(file), &session, None).map_err(failed)?.bare();
    let mut pace = Pace { interval_s, channels: [None; Channel::ALL.len()] };
    for record in recording.records()? {
        let record = record?;
        if pace.keeps(&record) {
            writer.write(&record).map_err(failed)?;
        }
    }
    let dropped = recording.info().dropped.map(|dropped| (DROPPED.to_owned(), dropped.to_string()));
    let (_, _, mut file) = writer.finish(dropped.into_iter().collect()).map_err(failed)?;
    file.flush().map_err(failed)?;
    let file = file.into_inner().map_err(|error| partial.error(error.into_error()))?;
    partial.complete(&file)
}

/// Lets a record of each channel through per interval.
struct Pace {
    interval_s: f64,
    /// Of each channel when the last record came, and the last one that was kept.
    channels: [Option<(Time, Time)>; Channel::ALL.len()],
}

impl Pace {
    fn keeps(&mut self, record: &Record) -> bool {
        let time = record.time();
        let channel = &mut self.channels[record.channel() as usize];
        let Some((last, kept)) = *channel else {
            *channel = Some((time, time));
            return true;
        };
        // The one nearest to the interval's end, so that a loop that jitters keeps each of its records.
        let keeps = record.channel() == Channel::Event
            || time < kept
            || time.since_s(kept) + 0.5 * time.since_s(last) >= self.interval_s;
        *channel = Some((time, if keeps { time } else { kept }));
        keeps
    }
}
