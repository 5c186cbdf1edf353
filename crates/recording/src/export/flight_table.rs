use bench_device::{PositionSample, Sticks, Time, TrackStatus};

use super::table::{Column, Table, TakeRow, actuation_suffix};
use crate::{
    ControlState, Flight, Kind, RecordingError, Tick, Truth, Value,
    flight::{latest, within},
};

/// A row for each control tick, as the paper's spreadsheet at the end of a flight.
pub(crate) struct FlightTable<'a> {
    flight: &'a Flight,
    columns: Vec<Column>,
    /// The last positions that are valid, by arrival.
    positions: Vec<PositionSample>,
}

impl<'a> FlightTable<'a> {
    pub fn new(flight: &'a Flight) -> Self {
        let positions =
            flight.positions.iter().filter(|position| position.status != TrackStatus::Lost).copied();
        Self { flight, columns: columns(flight), positions: positions.collect() }
    }

    /// The row of an iteration that lasts until `next`.
    fn row(&self, tick: &Tick, next: Time) -> Vec<Value<'_>> {
        let Flight { commands, readbacks, states, truth, .. } = self.flight;
        let (from, to) = (tick.started, next);
        let state = within(states, |state| state.time, from, to);
        let command = within(commands, |command| command.time, from, to).map(|command| command.sticks);
        let readback = within(readbacks, |readback| readback.time, from, to).map(|at| at.readback.sticks);
        let sensed = tick.started.shifted(tick.sense_s);
        let position = latest(&self.positions, |position| position.arrived_at, sensed);

        let mut row = vec![tick.started.into(), state.map(|state| state.phase.name()).into()];
        push_sticks(&mut row, command);
        push_sticks(&mut row, readback);
        push_position(&mut row, position);
        push_state(&mut row, state);
        row.push(tick.started.since_s(tick.scheduled).into());
        row.push(tick.overrun.into());
        if !truth.is_empty() {
            push_truth(&mut row, latest(truth, |truth| truth.time, tick.started));
        }
        row
    }
}

fn columns(flight: &Flight) -> Vec<Column> {
    let actuation = actuation_suffix(&flight.session);
    let mut columns = Vec::new();
    let mut add = |name: &str, kind| columns.push(Column { name: name.to_owned(), kind });
    add("time_s", Kind::Time);
    add("phase", Kind::Text);
    for of in ["command", "readback"] {
        for stick in ["throttle", "pitch", "roll", "yaw"] {
            add(&format!("{of}_{stick}_{actuation}"), Kind::Float);
        }
    }
    for axis in ["x", "y", "z"] {
        add(&format!("position_{axis}_m"), Kind::Float);
    }
    add("exposed_at_s", Kind::Time);
    add("estimate_z_m", Kind::Float);
    add("estimate_vz_m_s", Kind::Float);
    add("setpoint_z_m", Kind::Float);
    add("lateness_s", Kind::Float);
    add("overrun", Kind::Bool);
    if !flight.truth.is_empty() {
        for axis in ["x", "y", "z"] {
            add(&format!("truth_{axis}_m"), Kind::Float);
        }
        add("truth_vz_m_s", Kind::Float);
    }
    columns
}

fn push_sticks(row: &mut Vec<Value>, sticks: Option<Sticks>) {
    match sticks {
        Some(sticks) => row.extend(sticks.to_array().map(Value::Float)),
        None => row.extend([Value::Missing; 4]),
    }
}

fn push_position(row: &mut Vec<Value>, position: Option<&PositionSample>) {
    match position {
        Some(position) => {
            row.extend(position.position_m.map(Value::Float));
            row.push(position.exposed_at.into());
        }
        None => row.extend([Value::Missing; 4]),
    }
}

fn push_state(row: &mut Vec<Value>, state: Option<&ControlState>) {
    row.push(state.map(|state| state.estimate_m[2]).into());
    row.push(state.map(|state| state.estimate_m_s[2]).into());
    row.push(state.map(|state| state.setpoint_m[2]).into());
}

fn push_truth(row: &mut Vec<Value>, truth: Option<&Truth>) {
    match truth {
        Some(truth) => {
            row.extend(truth.position_m.map(Value::Float));
            row.push(truth.velocity_m_s[2].into());
        }
        None => row.extend([Value::Missing; 4]),
    }
}

impl Table for FlightTable<'_> {
    fn name(&self) -> &'static str {
        "flight"
    }

    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn row_count(&self) -> u64 {
        self.flight.ticks.len() as u64
    }

    fn for_each_row(&self, take: &mut TakeRow) -> Result<(), RecordingError> {
        let ticks = &self.flight.ticks;
        let ends = ticks.iter().skip(1).map(|tick| tick.started).chain([Time::from_nanos(u64::MAX)]);
        for (tick, next) in ticks.iter().zip(ends) {
            take(&self.row(tick, next))?;
        }
        Ok(())
    }
}
