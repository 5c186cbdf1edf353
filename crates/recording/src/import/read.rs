//! Keys of a mapping file to an [`ImportMap`].

use std::path::Path;

use bench_logs::Format;
use bench_rig::{
    Actuation, GRAVITY_M_S2, Phase,
    visit::{Node, Range, Reader, Value},
};

use super::{
    angle::Angle,
    map::{
        ChannelMap, ColumnId, ColumnUse, Filter, ImportMap, Make, PhaseSource, Quantity, Setting, Source,
        TimeColumn,
    },
    number::TimeUnit,
    target::{Dimension, TABLES, Table, Target},
};
use crate::Channel;

const ANY: Range = Range::ANY;
pub(super) const PERIOD: Range = Range::closed(1e-6, 3600.0);
pub(super) const LATENCY: Range = Range::closed(0.0, 10.0);
pub(super) const DELIMITERS: [(&str, u8); 3] = [(",", b','), (";", b';'), ("\t", b'\t')];
/// Logs of topics.
pub(super) const LOGS: [(&str, Option<Format>); 5] = [
    ("ulog", Some(Format::Ulog)),
    ("dataflash", Some(Format::Dataflash)),
    ("mcap", Some(Format::Mcap)),
    ("blackbox", Some(Format::Blackbox)),
    ("crazyflie", Some(Format::Crazyflie)),
];
/// Whether only changes are kept.
pub(super) const KEEP: [(&str, bool); 2] = [("all", false), ("changes", true)];
/// Whether an empty cell only means that there is no message.
pub(super) const EMPTY: [(&str, bool); 2] = [("bad", false), ("absent", true)];
/// The sign of y, z, pitch and yaw in frames that a map may name; x, y, z are north, west, up, or as the letters say.
pub(super) const FRAMES: [(&str, f64); 3] = [("nwu", 1.0), ("enu", 1.0), ("ned", -1.0)];
/// What is added to an acceleration, m/s^2.
pub(super) const GRAVITY: [(&str, f64); 2] = [("included", -GRAVITY_M_S2), ("removed", 0.0)];

impl ImportMap {
    /// Reads all keys of the file.
    pub(super) fn fill(&mut self, reader: &mut Reader<'_, '_>) {
        reader.text("name", &mut self.name);
        if let Some(rig) = optional_text(reader, "rig") {
            self.rig = Some(self.file.parent().unwrap_or(Path::new("")).join(rig));
        }
        if reader.get("delimiter").is_some() {
            reader.choice("delimiter", &DELIMITERS, &mut self.delimiter);
        }
        if ["actuation", "command", "readback"].iter().any(|key| reader.has(key)) {
            reader.choice("actuation", &Actuation::CHOICES, &mut self.actuation);
        }
        if reader.get("log").is_some() {
            reader.choice("log", &LOGS, &mut self.log);
        }
        // Samples of a log of topics have their own stamps, and are no iterations of a loop.
        if self.log.is_none() {
            reader.flag("header", &mut self.has_header);
            reader.table("time", |reader| {
                let column = self.column(reader, "column");
                let mut unit = TimeUnit::CHOICES[0].1;
                reader.choice("unit", &TimeUnit::CHOICES, &mut unit);
                self.time = column.map(|column| TimeColumn { column, unit });
            });
            self.read_filters(reader);
            if reader.get("tick").is_some() {
                reader.table("tick", |reader| self.tick_period = setting(reader, "period_s", PERIOD));
            }
        }
        for table in TABLES {
            if reader.get(table.name).is_some() {
                reader.table(table.name, |reader| self.read_channel(reader, table));
            }
        }
        if reader.is_sound() && self.channels.is_empty() {
            let names: Vec<_> = TABLES.iter().map(|table| format!("[{}]", table.name)).collect();
            reader.contradiction(
                "time",
                format!("nothing but time is mapped; add one or more of {}", names.join(", ")),
            );
        }
    }

    fn read_channel(&mut self, reader: &mut Reader<'_, '_>, table: &'static Table) {
        match table.channel {
            Channel::Position => {
                if reader.get("exposed_at").is_some() {
                    reader.table("exposed_at", |reader| {
                        let column = self.column(reader, "column");
                        let mut unit = TimeUnit::CHOICES[0].1;
                        reader.choice("unit", &TimeUnit::CHOICES, &mut unit);
                        self.exposed = column.map(|column| TimeColumn { column, unit });
                    });
                } else {
                    if let Some(latency) = setting(reader, "latency_s", LATENCY) {
                        self.latency = latency;
                    }
                    if reader.get("newest_of_frames_s").is_some() {
                        self.frame_period = setting(reader, "newest_of_frames_s", PERIOD);
                    }
                }
            }
            Channel::ControlState => self.read_phase(reader),
            _ => {}
        }
        let mut quantities = Vec::new();
        let mut frame = 1.0;
        if table.has_frame() {
            reader.choice_or("frame", &FRAMES, &mut frame);
        }
        for target in table.targets {
            let node = if target.required {
                reader.require(target.key, "a number, or { column = ..., unit = ... }")
            } else {
                reader.get(target.key)
            };
            let sign = if target.is_turned() { frame } else { 1.0 };
            if let Some(source) = node.and_then(|node| self.source(reader, target, sign, node)) {
                quantities.push(Quantity { target, source });
            }
        }
        let mut changes_only = false;
        if reader.get("keep").is_some() {
            reader.choice("keep", &KEEP, &mut changes_only);
        }
        let mut every_s = None;
        reader.maybe("every_s", PERIOD, &mut every_s);
        // A sample that a log of topics does not have is no fault.
        let mut may_be_absent = self.log.is_some();
        if reader.get("empty").is_some() {
            reader.choice("empty", &EMPTY, &mut may_be_absent);
        }
        if quantities.is_empty() && table.channel != Channel::ControlState && reader.is_sound() {
            reader.contradiction(table.targets[0].key, "the table maps no quantity".to_owned());
        }
        self.channels.push(ChannelMap { table, quantities, changes_only, every_s, may_be_absent });
    }

    fn source(
        &mut self,
        reader: &mut Reader<'_, '_>,
        target: &Target,
        sign: f64,
        node: &Node,
    ) -> Option<Source> {
        match &node.value {
            Value::Number(_) => {
                reader.number_in(target.key, node, ANY).map(|number| Source::Constant(sign * number))
            }
            Value::Table(_) => {
                let mut source = None;
                reader.table(target.key, |reader| source = self.columns_source(reader, target, sign));
                source
            }
            _ => {
                reader.wrong_type(target.key, node, "a number, or { column = ..., unit = ... }");
                None
            }
        }
    }

    fn columns_source(&mut self, reader: &mut Reader<'_, '_>, target: &Target, sign: f64) -> Option<Source> {
        let is_angle = target.dimension == Dimension::Angle;
        let is_quaternion = is_angle && reader.get("quaternion").is_some();
        let columns = if is_quaternion {
            self.quaternion(reader)?
        } else if reader.get("columns").is_some() {
            self.column_list(reader, "columns")?
        } else {
            vec![self.column(reader, "column")?]
        };
        self.read_optional(reader, &columns);
        let mut square = false;
        if target.dimension == Dimension::Stick {
            reader.flag("square", &mut square);
        }
        let make = match target.key {
            _ if square => Make::MeanOfSquares,
            _ if !is_quaternion => Make::Mean,
            "roll" => Make::Angle(Angle::Roll),
            "pitch" => Make::Angle(Angle::Pitch),
            _ => Make::Angle(Angle::Yaw),
        };
        let mut unit = is_quaternion.then_some(1.0);
        if !is_quaternion {
            let units: Vec<_> = target
                .dimension
                .units(self.actuation)
                .iter()
                .map(|&(name, factor)| (name, Some(factor)))
                .collect();
            reader.choice("unit", &units, &mut unit);
        }
        let (mut scale, mut offset) = (None, None);
        reader.maybe("scale", ANY, &mut scale);
        reader.maybe("offset", ANY, &mut offset);
        let mut shift = 0.0;
        if target.dimension == Dimension::Acceleration {
            reader.choice("gravity", &GRAVITY, &mut shift);
        }
        let valid = valid_range(reader);
        let unit = sign * unit?;
        Some(Source::Columns {
            columns,
            make,
            valid,
            factor: scale.unwrap_or(1.0) * unit,
            shift: offset.unwrap_or(0.0) * unit + shift,
        })
    }

    fn read_phase(&mut self, reader: &mut Reader<'_, '_>) {
        const EXPECTED: &str =
            "a phase, { column = ..., names = { ... } }, or { column = ..., from = [[number, phase], ...] }";
        let Some(node) = reader.require("phase", EXPECTED) else { return };
        match &node.value {
            Value::Text(_) => {
                let mut phase = Phase::Idle;
                reader.choice("phase", &phases(), &mut phase);
                self.phase = PhaseSource::Constant(phase);
            }
            Value::Table(_) => reader.table("phase", |reader| {
                let Some(column) = self.column(reader, "column") else { return };
                self.read_optional(reader, &[column]);
                if reader.get("from").is_some() {
                    self.phase = PhaseSource::Thresholds(column, thresholds(reader));
                } else {
                    self.phase = PhaseSource::Names(column, phase_names(reader));
                }
            }),
            _ => reader.wrong_type("phase", node, EXPECTED),
        }
    }

    fn read_filters(&mut self, reader: &mut Reader<'_, '_>) {
        const EXPECTED: &str = "tables, each written as [[filter]]";
        let Some(list) = reader.get("filter") else { return };
        let Value::List(items) = &list.value else {
            reader.wrong_type("filter", list, EXPECTED);
            return;
        };
        for item in items {
            reader.within("filter", item, |reader| {
                let (mut at_least, mut below) = (None, None);
                let column = self.column(reader, "column");
                reader.maybe("at_least", ANY, &mut at_least);
                reader.maybe("below", ANY, &mut below);
                if at_least.is_none() && below.is_none() {
                    reader.contradiction("column", "give at_least, below or both".to_owned());
                }
                if let Some(column) = column {
                    self.filters.push(Filter {
                        column,
                        at_least: at_least.unwrap_or(f64::NEG_INFINITY),
                        below: below.unwrap_or(f64::INFINITY),
                    });
                }
            });
        }
    }

    fn column(&mut self, reader: &mut Reader<'_, '_>, key: &str) -> Option<ColumnId> {
        let node = reader.require(key, "the name of a column")?;
        self.column_at(reader, key, node)
    }

    fn column_list(&mut self, reader: &mut Reader<'_, '_>, key: &str) -> Option<Vec<ColumnId>> {
        let node = reader.require(key, "a list of columns")?;
        match &node.value {
            Value::List(items) if !items.is_empty() => {
                items.iter().map(|item| self.column_at(reader, key, item)).collect()
            }
            _ => {
                reader.wrong_type(key, node, "a list of columns");
                None
            }
        }
    }

    /// The four columns of a quaternion.
    fn quaternion(&mut self, reader: &mut Reader<'_, '_>) -> Option<Vec<ColumnId>> {
        let columns = self.column_list(reader, "quaternion")?;
        if columns.len() != 4 {
            let detail = format!("expected four columns, real part first, found {}", columns.len());
            reader.contradiction("quaternion", detail);
        }
        Some(columns)
    }

    /// Whether a table may lack these columns.
    fn read_optional(&mut self, reader: &mut Reader<'_, '_>, columns: &[ColumnId]) {
        let mut optional = false;
        reader.flag("optional", &mut optional);
        for column in columns {
            self.columns[column.0].optional = optional;
        }
    }

    fn column_at(&mut self, reader: &mut Reader<'_, '_>, key: &str, node: &Node) -> Option<ColumnId> {
        let Value::Text(name) = &node.value else {
            reader.wrong_type(key, node, "the name of a column");
            return None;
        };
        self.columns.push(ColumnUse {
            name: name.trim().to_owned(),
            at: reader.at(node.line),
            key: reader.path(key),
            optional: false,
        });
        Some(ColumnId(self.columns.len() - 1))
    }
}

fn optional_text(reader: &mut Reader<'_, '_>, key: &str) -> Option<String> {
    reader.get(key)?;
    let mut text = String::new();
    reader.text(key, &mut text);
    (!text.is_empty()).then_some(text)
}

/// A number of seconds, or "rig".
fn setting(reader: &mut Reader<'_, '_>, key: &str, range: Range) -> Option<Setting> {
    let node = reader.require(key, &format!("{}, or \"rig\"", range.words()))?;
    match &node.value {
        Value::Text(text) if text == "rig" => Some(Setting::FromRig(reader.at(node.line), reader.path(key))),
        _ => reader.number_in(key, node, range).map(Setting::Given),
    }
}

/// `valid = [low, high]`.
fn valid_range(reader: &mut Reader<'_, '_>) -> Option<Range> {
    let node = reader.get("valid")?;
    if let Value::List(items) = &node.value
        && let [low, high] = items.as_slice()
    {
        let low = reader.number_in("valid", low, ANY)?;
        let high = reader.number_in("valid", high, ANY)?;
        if low > high {
            reader.contradiction("valid", format!("{low} is above {high}"));
        }
        return Some(Range::closed(low, high));
    }
    reader.wrong_type("valid", node, "[low, high] in the column's own numbers");
    None
}

fn phases() -> [(&'static str, Phase); Phase::ALL.len()] {
    Phase::ALL.map(|phase| (phase.name(), phase))
}

/// `names = { theirs = "ours", ... }`.
fn phase_names(reader: &mut Reader<'_, '_>) -> Vec<(String, Phase)> {
    let mut names = Vec::new();
    let Some(node) = reader.require("names", "a table of the column's phases, such as { flying = \"hold\" }")
    else {
        return names;
    };
    let theirs: Vec<_> = match &node.value {
        Value::Table(entries) => entries.iter().map(|(name, _)| name.clone()).collect(),
        _ => Vec::new(),
    };
    reader.table("names", |reader| {
        for name in theirs {
            let mut phase = Phase::Idle;
            reader.choice(&name, &phases(), &mut phase);
            names.push((name, phase));
        }
    });
    names
}

/// `from = [[number, phase], ...]`.
fn thresholds(reader: &mut Reader<'_, '_>) -> Vec<(f64, Phase)> {
    const EXPECTED: &str = "a list of [number, phase] whose numbers rise";
    let Some(node) = reader.require("from", EXPECTED) else { return Vec::new() };
    let mut found = Vec::new();
    let Value::List(items) = &node.value else {
        reader.wrong_type("from", node, EXPECTED);
        return found;
    };
    for item in items {
        match threshold(item) {
            Some(threshold) => found.push(threshold),
            None => reader.wrong_type("from", item, "[number, phase], the phase being one of bench's"),
        }
    }
    if found.is_empty() || !found.is_sorted_by(|a, b| a.0 < b.0) {
        reader.contradiction("from", format!("expected {EXPECTED}"));
    }
    found
}

fn threshold(item: &Node) -> Option<(f64, Phase)> {
    let Value::List(pair) = &item.value else { return None };
    let [Node { value: Value::Number(number), .. }, Node { value: Value::Text(phase), .. }] = pair.as_slice()
    else {
        return None;
    };
    Some((*number, phase.parse().ok()?)).filter(|(number, _)| number.is_finite())
}
