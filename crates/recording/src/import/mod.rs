//! Flight logs of other benches and airframes to recordings of the same shape as a simulated one.
//!
//! An [`ImportMap`] says which column is what, in which unit; [`import`] applies it. What is not a number, lies outside
//! the range that the map declares or goes back in time is counted and told in the [`ImportReport`], never used.
//! `docs/import.md` tells how to write a map.

mod angle;
mod convert;
mod error;
mod guess;
mod keys;
mod log;
mod map;
mod number;
mod output;
mod read;
mod report;
mod target;
mod topics;

use std::{borrow::Cow, cmp::Ordering, path::Path};

use bench_device::Time;
use bench_logs::{Format, Survey};
use bench_rig::{Phase, Rig, RigError};

use self::{
    convert::{Converter, Samples},
    log::{Fault, Log, Row},
    map::{Setting, sticks_at_rest},
    output::Output,
    topics::{read_table, read_topics},
};
pub use self::{
    error::{ColumnProblem, ImportError},
    guess::{GuessedMap, guess},
    map::ImportMap,
    report::{ColumnsReport, ImportReport, LossReport, QuantityRange, SkipReason, Skipped, TopicsReport},
};
use crate::{Channel, Event, EventText, FileKind, Level, Record, RecordingError, recover::same_file};

/// Imports the flight log `log` into the recording `out`, with `rig` or else the map's own rig attached.
///
/// Time zero is the first row that can be used. `out` appears only when it is whole; an ordinary file there is replaced.
/// The same log, map and rig give the same bytes.
pub fn import(
    map: &ImportMap,
    log: &Path,
    out: &Path,
    rig: Option<&Rig>,
) -> Result<ImportReport, ImportError> {
    let unread = |source| ImportError::Read { path: log.to_owned(), source };
    let kind = FileKind::of(log).map_err(unread)?;
    let (fitted, topics) = match map.log {
        None => (Cow::Borrowed(map), None),
        Some(format) if kind.log_format() == Some(format) => {
            let (map, topics) = fit(map, format, log)?;
            (Cow::Owned(map), Some(topics))
        }
        Some(format) => {
            let (path, map) = (log.to_owned(), map.name.clone());
            return Err(ImportError::OtherLog { path, kind, map, expected: format.words() });
        }
    };
    let map = &*fitted;
    let own_rig = if rig.is_none() { map.load_rig()? } else { None };
    let rig = rig.or(own_rig.as_ref());
    check_actuation(map, rig)?;
    if same_file(log, out) {
        return Err(RecordingError::OutputIsInput { path: out.to_owned() }.into());
    }
    let mut rows = match (map.log, &kind) {
        (None, FileKind::Parquet) | (Some(_), _) => None,
        (None, _) => Some(Log::open(map, log)?),
    };
    let mut import = Import {
        map,
        rig,
        converter: converter(map, rig)?,
        output: None,
        latest_ns: None,
        phase: None,
        end: Time::ZERO,
        records: Vec::new(),
        report: ImportReport::new(log, &map.name, rig.map(|rig| rig.name.as_str()), out),
    };
    import.report.topics = topics;
    match (&mut rows, map.log) {
        (Some(rows), _) => {
            import.report.columns = Some(rows.columns.clone());
            while let Some(row) = rows.next_row(log)? {
                import.take(row)?;
            }
        }
        (None, None) => {
            let columns = read_table(map, log, &mut |row| import.take(row))?;
            import.report.columns = Some(columns);
        }
        (None, Some(format)) => {
            let (losses, wild) = read_topics(map, format, log, &mut |row| import.take(row))?;
            if let Some(topics) = &mut import.report.topics {
                (topics.losses, topics.wild_stamps) = (losses.into(), wild);
            }
        }
    }
    import.finish()
}

/// Fits a map to what a log of topics holds.
fn fit(map: &ImportMap, format: Format, log: &Path) -> Result<(ImportMap, TopicsReport), ImportError> {
    let survey = Survey::of(log, format)?;
    let mut map = map.clone();
    let missing = map.fit(&survey);
    if !map.channels.iter().any(|channel| channel.table.channel == Channel::Position) {
        return Err(ImportError::NoAltitude {
            path: log.to_owned(),
            maps: vec![map.name],
            topics: topics::words(&survey, &missing),
            missing,
            instead: instead(format),
        });
    }
    let used = map.used_names();
    if let Some((column, topics)) = topics::several(&survey, &used) {
        let (path, column) = (log.to_owned(), column.to_owned());
        return Err(ImportError::SeveralTopics { path, map: map.name, column, topics });
    }
    let topics = TopicsReport::new(format, &survey, used, missing, map.has_sticks());
    Ok((map, topics))
}

/// Which of some maps suits a log of topics: the first that finds altitude and throttle in it, else the first that finds an altitude.
pub fn choose(maps: &[ImportMap], format: Format, log: &Path) -> Result<usize, ImportError> {
    let survey = Survey::of(log, format)?;
    let suits = |map: &ImportMap, channels: &[Channel]| {
        map.log == Some(format) && map.needed(channels).all(|column| topics::has(&survey, column))
    };
    let all = [Channel::Position, Channel::Command];
    let whole = maps.iter().position(|map| suits(map, &all));
    let found = whole.or_else(|| maps.iter().position(|map| suits(map, &[Channel::Position])));
    found.ok_or_else(|| {
        let for_it = || maps.iter().filter(|map| map.log == Some(format));
        let mut missing: Vec<String> =
            for_it().flat_map(|map| map.needed(&[Channel::Position]).map(str::to_owned)).collect();
        missing.retain(|column| !topics::has(&survey, column));
        missing.sort();
        missing.dedup();
        ImportError::NoAltitude {
            path: log.to_owned(),
            maps: for_it().map(|map| map.name.clone()).collect(),
            topics: topics::words(&survey, &missing),
            missing,
            instead: instead(format),
        }
    })
}

/// What can be done without an altitude in a log of a format.
const fn instead(format: Format) -> &'static str {
    match format {
        Format::Blackbox => {
            "the craft needs a barometer that is switched on and logged (Betaflight), or an estimate of its position (INAV). Throttle, \
             battery and motors are there all the same: where motion capture saw the flight, `blackbox_decode` makes a table of them that \
             can be joined with its positions, and imported. Or "
        }
        Format::Crazyflie => {
            "log stateEstimate.z and stabilizer.thrust together, in one block of the client. Or "
        }
        _ => "",
    }
}

/// Says whether the rig that a map names can be read and suits it. A map that names none suits any.
pub fn check_rig(map: &ImportMap) -> Result<(), ImportError> {
    let Some(rig) = map.load_rig()? else { return Ok(()) };
    check_actuation(map, Some(&rig))?;
    converter(map, Some(&rig))?;
    Ok(())
}

fn check_actuation(map: &ImportMap, rig: Option<&Rig>) -> Result<(), ImportError> {
    match rig {
        Some(rig) if map.has_sticks() && rig.airframe.actuation != map.actuation => {
            Err(ImportError::Actuation {
                file: map.file.clone(),
                map: map.actuation,
                rig: rig.name.clone(),
                expected: rig.airframe.actuation,
            })
        }
        _ => Ok(()),
    }
}

fn converter<'m>(map: &'m ImportMap, rig: Option<&Rig>) -> Result<Converter<'m>, RigError> {
    let resolve = |setting: &Setting, from_rig: fn(&Rig) -> f64| {
        setting.resolve(rig, from_rig).map_err(|problem| RigError::Invalid(vec![problem]))
    };
    let optional = |setting: &Option<Setting>, from_rig: fn(&Rig) -> f64| {
        setting.as_ref().map(|setting| resolve(setting, from_rig)).transpose()
    };
    let latency_s = resolve(&map.latency, |rig| rig.tracker.latency_s.value)?;
    let frame_period_s = optional(&map.frame_period, |rig| rig.tracker.frame_period_s)?;
    let tick_period_s = optional(&map.tick_period, |rig| rig.control_loop.period_s)?;
    // The newest frame at hand has waited for anything up to a frame period: half of one on average.
    let age_s = latency_s + frame_period_s.unwrap_or(0.0) / 2.0;
    Ok(Converter::new(map, age_s, tick_period_s, sticks_at_rest(rig)))
}

/// One import while it runs.
struct Import<'a> {
    map: &'a ImportMap,
    rig: Option<&'a Rig>,
    converter: Converter<'a>,
    /// There from the first used row on.
    output: Option<Output>,
    /// The log's time at the latest row whose time could be used, ns.
    latest_ns: Option<i128>,
    phase: Option<Phase>,
    /// The latest used row.
    end: Time,
    /// Those of the row at hand.
    records: Vec<Record>,
    report: ImportReport,
}

impl Import<'_> {
    /// Uses, filters or skips a row.
    fn take(&mut self, row: Row<'_>) -> Result<(), ImportError> {
        self.report.rows += 1;
        match self.time_of(row) {
            Ok(Some(nanos)) => match self.converter.read(row) {
                Ok(samples) => self.record(nanos, samples)?,
                Err(fault) => {
                    self.skip(row, fault);
                    if let Some(output) = &self.output {
                        self.converter.started(output.time(nanos));
                    }
                }
            },
            Ok(None) => {
                self.report.filtered += 1;
                self.converter.forget_start();
            }
            Err(fault) => {
                self.skip(row, fault);
                self.converter.forget_start();
            }
        }
        Ok(())
    }

    fn skip(&mut self, row: Row<'_>, fault: Fault) {
        let column = fault.column.map_or("", |id| self.map.columns[id.0].name.as_str());
        self.report.skip(fault.reason, column, row.line(), &row.found(fault.column));
    }

    /// The log's time at a row, ns; `None` if the map's filters leave the row out.
    fn time_of(&mut self, row: Row<'_>) -> Result<Option<i128>, Fault> {
        if !row.is_whole() {
            return Err(Fault { reason: SkipReason::CellCount, column: None });
        }
        if !self.converter.keeps(row)? {
            return Ok(None);
        }
        let column = self.map.time.as_ref().map(|time| time.column);
        let nanos = self.map.time_ns(row)?;
        let reason = match self.latest_ns.map(|latest| nanos.cmp(&latest)) {
            Some(Ordering::Less) => Some(SkipReason::TimeBack),
            Some(Ordering::Equal) => Some(SkipReason::TimeRepeated),
            _ if self.output.as_ref().is_some_and(|output| !output.reaches(nanos)) => {
                Some(SkipReason::OutOfRange)
            }
            _ => None,
        };
        if let Some(reason) = reason {
            return Err(Fault { reason, column });
        }
        self.latest_ns = Some(nanos);
        Ok(Some(nanos))
    }

    /// Records what a row says.
    fn record(&mut self, nanos: i128, samples: Samples) -> Result<(), ImportError> {
        let output = match &mut self.output {
            Some(output) => output,
            None => self.output.insert(Output::open(&self.report, self.map, self.rig, nanos)?),
        };
        let time = output.time(nanos);
        let origin_ns = output.origin_ns;
        self.converter.convert(time, origin_ns, samples, &mut self.records);
        self.records.extend(self.converter.tick(time));
        let phase = self.records.iter().find_map(|record| match record {
            Record::ControlState(state) => Some(state.phase),
            _ => None,
        });
        if let Some(phase) = phase.filter(|phase| self.phase != Some(*phase)) {
            self.phase = Some(phase);
            self.records.push(event(time, Level::Info, &format!("phase {phase}")));
        }
        for record in self.records.drain(..) {
            output.put(record, &mut self.report);
        }
        self.report.used += 1;
        self.report.time_offset_s = output.origin_ns as f64 * 1e-9;
        self.report.duration_s = time.seconds();
        self.end = time;
        Ok(())
    }

    fn finish(self) -> Result<ImportReport, ImportError> {
        let mut report = self.report;
        let Some(mut output) = self.output else {
            return Err(ImportError::NoUsableRow {
                path: report.log,
                rows: report.rows,
                filtered: report.filtered,
                skipped: report.skipped,
            });
        };
        for skipped in report.skipped.clone() {
            output.put(event(self.end, Level::Warning, &format!("import: {skipped}")), &mut report);
        }
        if let Some(topics) = report.topics.clone() {
            for lost in topics.lost() {
                output.put(event(self.end, Level::Warning, &format!("import: {lost}")), &mut report);
            }
        }
        output.finish()?;
        report.positions_before_origin = self.converter.positions_before_origin;
        report.quantities = self
            .converter
            .ranges()
            .map(|(table, quantity, [min, max])| QuantityRange {
                name: format!("{table}.{}", quantity.target.key),
                unit: quantity.target.dimension.unit(self.map.actuation),
                min,
                max,
            })
            .collect();
        Ok(report)
    }
}

/// A text that is too long is cut, which is better than none.
fn event(time: Time, level: Level, words: &str) -> Record {
    let mut text = EventText::new();
    for character in words.chars() {
        if text.try_push(character).is_err() {
            break;
        }
    }
    Event { time, level, text }.into()
}
