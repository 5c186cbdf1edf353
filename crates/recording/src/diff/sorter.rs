//! Rows in order of time.

use std::{cmp::Ordering, collections::BinaryHeap};

use super::rows::Row;

/// Puts rows in order of time whose order falls behind by a known time at most. Holds the rows of that time.
pub(super) struct Sorter {
    behind_ns: i64,
    newest_ns: i64,
    heap: BinaryHeap<Waiting>,
    read: u64,
}

struct Waiting {
    t_ns: i64,
    place: u64,
    row: Row,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    /// The heap gives its greatest: the earliest, and the one read first among equals.
    fn cmp(&self, other: &Self) -> Ordering {
        (other.t_ns, other.place).cmp(&(self.t_ns, self.place))
    }
}

impl Sorter {
    pub fn new(behind_ns: i64) -> Self {
        Self { behind_ns, newest_ns: i64::MIN, heap: BinaryHeap::new(), read: 0 }
    }

    pub fn push(&mut self, row: Row) {
        let t_ns = row.t_ns();
        self.newest_ns = self.newest_ns.max(t_ns);
        self.heap.push(Waiting { t_ns, place: self.read, row });
        self.read += 1;
    }

    /// The next row, if no earlier one can come.
    pub fn pop_settled(&mut self) -> Option<Row> {
        let settled_ns = self.newest_ns.saturating_sub(self.behind_ns);
        let is_settled = self.heap.peek().is_some_and(|waiting| waiting.t_ns < settled_ns);
        if is_settled { self.heap.pop().map(|waiting| waiting.row) } else { None }
    }

    /// The rows that are left when no more come.
    pub fn into_rest(mut self) -> impl Iterator<Item = Row> {
        std::iter::from_fn(move || self.heap.pop().map(|waiting| waiting.row))
    }
}

#[cfg(test)]
mod tests {
    use bench_device::Time;

    use super::*;
    use crate::{Battery, Channel, Record, Tick, diff::rows::RowReader};

    #[test]
    fn rows_are_put_in_order_and_ties_keep_the_order_of_the_file() {
        let battery = |t_s, voltage_v| {
            Record::from(Battery { time: Time::from_seconds(t_s), voltage_v, current_a: None })
        };
        let tick = |t_s| Record::from(Tick { started: Time::from_seconds(t_s), ..Tick::default() });
        let (mut reader, mut sorter) = (RowReader::new(), Sorter::new(100_000_000));
        let mut sorted = Vec::new();
        for record in [battery(0.1, 1.0), tick(0.0), battery(0.2, 2.0), tick(0.1), battery(0.1, 3.0)] {
            sorter.push(*reader.record(&record));
            sorted.extend(std::iter::from_fn(|| sorter.pop_settled()));
        }
        sorted.extend(sorter.into_rest());
        let times: Vec<i64> = sorted.iter().map(|row| row.t_ns() / 1_000_000).collect();
        assert_eq!(times, [0, 100, 100, 100, 200]);
        assert_eq!(sorted[1].channel, Channel::Battery);
        assert_eq!(sorted[2].channel, Channel::Tick);
    }
}
