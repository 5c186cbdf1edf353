//! Messages as rows of numbers, one a field of their channel.

use std::cmp::Ordering;

use bench_device::{Time, TrackStatus};

use super::{
    law::{Entry, Measure, catalogue, name_number},
    names::Names,
    wire::Layout,
};
use crate::{
    Channel, Kind, Record, RecordingError, Value,
    field::FIELDS_MAX,
    recording::{Decoder, Message},
};

/// Numbers beyond this are taken as damage: their squares would not be finite.
const LARGEST: f64 = 1e100;
/// Stands for what was not measured: no number, and unlike those that arithmetic makes.
pub(super) const MISSING: f64 = f64::from_bits(0x7ff8_6d69_7373_696e);
/// Layouts of a channel that are kept: fields that are zero now and then make several.
const LAYOUTS_MAX: usize = 16;

/// What became of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    Missing,
    /// Not a finite number, or an absurd one.
    Unusable,
    Number,
}

impl Cell {
    pub fn of(number: f64) -> Self {
        if is_usable(number) {
            Self::Number
        } else if number.to_bits() == MISSING.to_bits() {
            Self::Missing
        } else {
            Self::Unusable
        }
    }
}

/// Whether a number can be compared.
pub(super) fn is_usable(number: f64) -> bool {
    number.abs() <= LARGEST
}

/// The whole numbers of a record, from which others are made: by place its own time [ns], a counter or an instant on another clock
/// [ns], and an instant that belongs to the record [ns].
pub(super) type Counts = [u64; 3];
const OWN: usize = 0;
const COUNTER: usize = 1;
const INSTANT: usize = 2;

/// The numbers of one record, by column: that is, in the order of its channel's fields.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub channel: Channel,
    /// [`Cell`] tells what they are worth.
    pub numbers: [f64; FIELDS_MAX],
    pub counts: Counts,
}

impl Row {
    pub fn new(channel: Channel) -> Self {
        Self { channel, numbers: [0.0; FIELDS_MAX], counts: Counts::default() }
    }

    /// Nanoseconds since the origin, signed; instants that do not fit (292 years on) are cut.
    pub fn t_ns(&self) -> i64 {
        i64::try_from(self.counts[OWN]).unwrap_or(i64::MAX)
    }

    pub fn is_as(&self, other: &Self) -> bool {
        self.channel == other.channel
            && self.counts == other.counts
            && self.numbers.map(f64::to_bits) == other.numbers.map(f64::to_bits)
    }
}

/// Where a channel's whole numbers belong.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// By place among [`Counts`], the column that it is for.
    columns: [Option<usize>; 3],
    /// What a step of the counter counts.
    counter_unit: f64,
}

impl Shape {
    fn of(channel: Channel, entries: &[Entry]) -> Self {
        let mut shape = Self { columns: [None; 3], counter_unit: 1.0 };
        let of_channel = entries.iter().filter(|entry| entry.channel == channel);
        for (column, entry) in of_channel.enumerate() {
            let place = match entry.law.measure {
                Measure::Value => continue,
                Measure::Age => INSTANT,
                Measure::Increment if column == 0 => OWN,
                Measure::Increment => COUNTER,
            };
            shape.columns[place] = Some(column);
            if place == COUNTER && entry.field.kind == Kind::Time {
                shape.counter_unit = NANO;
            }
        }
        shape
    }

    /// The place of a column's whole number; `None` if it has none.
    pub fn place(&self, column: usize) -> Option<usize> {
        self.columns.iter().position(|of| *of == Some(column))
    }

    /// Makes the number that needs no other record.
    pub fn set_age(&self, row: &mut Row) {
        if let Some(column) = self.columns[INSTANT] {
            let [own, _, instant] = row.counts.map(Time::from_nanos);
            row.numbers[column] = instant.since_s(own);
        }
    }

    fn row(&self, record: &Record) -> Row {
        let mut row = Row::new(record.channel());
        let lost = matches!(record, Record::Position(position) if position.status == TrackStatus::Lost);
        for (column, value) in record.values().into_iter().enumerate() {
            row.numbers[column] = match value {
                Value::Float(x) if !lost => x,
                Value::Bool(flag) => f64::from(u8::from(flag)),
                Value::Text(text) => name_number(text),
                Value::Missing | Value::Float(_) => MISSING,
                Value::Time(_) | Value::Integer(_) => 0.0,
            };
            let count = match value {
                Value::Time(time) => time.nanos(),
                Value::Integer(count) => count,
                _ => continue,
            };
            if let Some(place) = self.place(column) {
                row.counts[place] = count;
            }
        }
        self.set_age(&mut row);
        row
    }
}

/// Seconds.
const NANO: f64 = 1e-9;

/// Makes rows of a recording's messages. Most lie as one before them did, and are read by that one's layout.
pub(super) struct RowReader {
    shapes: [Shape; Channel::ALL.len()],
    /// By channel, the one that was used last first.
    layouts: [Vec<Layout>; Channel::ALL.len()],
    /// What was made last of a message that lies in its own way, or of a record.
    row: Row,
    /// The names among all that was read.
    pub names: Names,
}

impl RowReader {
    pub fn new() -> Self {
        let entries = catalogue();
        Self {
            shapes: Channel::ALL.map(|channel| Shape::of(channel, &entries)),
            layouts: Default::default(),
            row: Row::new(Channel::Event),
            names: Names::default(),
        }
    }

    /// Makes a row of a message.
    pub fn message(&mut self, message: Message, decoder: &Decoder) -> Result<&mut Row, RecordingError> {
        let place = message.channel as usize;
        let shape = self.shapes[place];
        let known = self.layouts[place].iter().position(|layout| layout.fits(message.data));
        if let Some(known) = known {
            let layouts = &mut self.layouts[place];
            layouts[..=known].rotate_right(1);
            return Ok(layouts[0].read(message.data, &shape));
        }
        self.record(&decoder.decode(message)?);
        if let Some(layout) = Layout::of(message.data, &shape, &self.row) {
            let layouts = &mut self.layouts[place];
            layouts.truncate(LAYOUTS_MAX - 1);
            layouts.insert(0, layout);
        }
        Ok(&mut self.row)
    }

    /// Makes a row of a record.
    pub fn record(&mut self, record: &Record) -> &mut Row {
        self.row = self.shapes[record.channel() as usize].row(record);
        self.names.learn(record, &self.row.numbers);
        &mut self.row
    }
}

/// Makes the numbers that tell what changed since the record before.
pub(super) struct Steps {
    shapes: [Shape; Channel::ALL.len()],
    before: [Option<Counts>; Channel::ALL.len()],
}

impl Steps {
    pub fn new() -> Self {
        let entries = catalogue();
        Self { shapes: Channel::ALL.map(|channel| Shape::of(channel, &entries)), before: Default::default() }
    }

    /// `row` is the next one of its channel.
    pub fn set(&mut self, row: &mut Row) {
        let shape = &self.shapes[row.channel as usize];
        let before = self.before[row.channel as usize].replace(row.counts);
        for (place, unit) in [(OWN, NANO), (COUNTER, shape.counter_unit)] {
            if let Some(column) = shape.columns[place] {
                let now = row.counts[place];
                row.numbers[column] = before.map_or(MISSING, |before| step(before[place], now) * unit);
            }
        }
    }
}

fn step(before: u64, now: u64) -> f64 {
    match now.cmp(&before) {
        Ordering::Less => -((before - now) as f64),
        _ => (now - before) as f64,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_device::{Faults, PositionSample, Readback, Sticks};
    use bench_rig::Phase;

    use super::*;
    use crate::{
        Battery, Command, ControlState, Event, EventText, Level, Motion, ReadbackAt, Rotor, Tick, Truth,
        codec,
    };

    /// A record of each channel. Every third number is zero, every fifth absent where it may be, and what has names goes through all.
    fn records(i: u64) -> Vec<Record> {
        let mut n = i * 7;
        let mut x = || {
            n += 1;
            if n.is_multiple_of(3) { 0.0 } else { n as f64 * 0.37 - 5.0 }
        };
        let mut three = || [x(), x(), x()];
        let (a, b, c, d) = (three(), three(), three(), three());
        let maybe = |x: f64| (!i.is_multiple_of(5)).then_some(x);
        let (time, other) = (Time::from_nanos(i * i * 1_000_003), Time::from_nanos(i * 999));
        let sticks = Sticks { throttle: a[0], pitch: a[1], roll: a[2], yaw: b[0] };
        let status = [TrackStatus::Found, TrackStatus::Lost, TrackStatus::Ambiguous][i as usize % 3];
        let flag = i % 4 == 1;
        vec![
            PositionSample {
                exposed_at: other,
                arrived_at: time,
                position_m: a,
                heading_rad: maybe(b[0]),
                pixel: [b[1], b[2]],
                size_px: c[0],
                status,
            }
            .into(),
            Motion {
                time,
                velocity_m_s: a.map(maybe),
                vertical_acceleration_m_s2: maybe(b[0]),
                attitude_rad: c.map(Some),
            }
            .into(),
            ControlState {
                time,
                phase: Phase::ALL[i as usize % Phase::ALL.len()],
                setpoint_m: a,
                setpoint_heading_rad: b[0],
                estimate_m: c,
                estimate_m_s: d,
                vertical_speed_setpoint_m_s: b[1],
                vertical_speed_error_m_s: b[2],
                integral_n: f64::NAN,
                thrust_n: 1e200,
            }
            .into(),
            Command { time, sticks }.into(),
            ReadbackAt {
                time,
                readback: Readback {
                    device_time: other,
                    sticks,
                    faults: Faults { watchdog: flag, clamped: !flag, mismatch: false, brown_out: flag },
                },
            }
            .into(),
            Truth {
                time,
                position_m: a,
                velocity_m_s: b,
                attitude: [c[0], c[1], c[2], 0.5],
                body_rate_rad_s: d,
                thrust_n: a[0],
                rotor_speed_ratio: a[1],
                charge_hover_min: a[2],
            }
            .into(),
            Tick {
                index: i,
                scheduled: other,
                started: time,
                sense_s: a[0],
                control_s: a[1],
                actuate_s: a[2],
                overrun: flag,
            }
            .into(),
            Event { time, level: Level::Warning, text: EventText::from("text").expect("it is short") }.into(),
            Battery { time, voltage_v: a[0], current_a: maybe(a[1]) }.into(),
            Rotor { time, speed_rad_s: [maybe(a[0]), Some(b[0]), None, Some(c[0])] }.into(),
        ]
    }

    #[test]
    fn a_message_makes_the_row_of_its_record_however_it_lies() {
        let (mut by_message, mut by_record) = (RowReader::new(), RowReader::new());
        let decoder = Decoder::new(Path::new("a.mcap"), 5);
        let mut check = |record: &Record, more: &[u8]| {
            let channel = record.channel();
            let mut data = Vec::new();
            codec::encode(record, 5, false, &mut data);
            data.extend_from_slice(more);
            let message = Message { channel, log_time: 0, data: &data };
            let row = by_message.message(message, &decoder).expect("a row");
            assert!(row.is_as(by_record.record(record)), "{row:?} of {record:?}");
        };
        // A field that no message has: its layout is not learnt.
        let unknown = [15 << 3, 1];
        for i in 0..200 {
            for (record, next) in records(i).into_iter().zip(records(i + 1)) {
                // The second one is read as the first one lay, and so is the last, whatever came between.
                check(&record, &[]);
                check(&record, &[]);
                check(&next, &unknown);
                check(&record, &[]);
            }
        }
        for (channel, layouts) in Channel::ALL.into_iter().zip(&by_message.layouts) {
            assert_eq!(layouts.is_empty(), channel == Channel::Event, "{channel:?}");
        }
    }

    #[test]
    fn steps_are_those_from_the_record_before() {
        let tick = |index: u64, started_s: f64| Tick {
            index,
            started: Time::from_seconds(started_s),
            ..Tick::default()
        };
        let (mut reader, mut steps) = (RowReader::new(), Steps::new());
        let mut step = |tick: Tick| {
            let row = reader.record(&tick.into());
            steps.set(row);
            [row.numbers[0], row.numbers[1]]
        };
        assert!(step(tick(7, 1.0)).iter().all(|number| Cell::of(*number) == Cell::Missing));
        assert_eq!(step(tick(9, 1.5)), [0.5, 2.0]);
        assert_eq!(step(tick(4, 1.25)), [-0.25, -5.0]);
    }
}
