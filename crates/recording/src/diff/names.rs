//! Names by the numbers that stand for them.

use std::collections::BTreeMap;

use crate::{Record, Value};

/// Most names that are kept for messages.
const NAMES_MAX: usize = 1000;

/// Names by the numbers that stand for them.
#[derive(Default)]
pub(super) struct Names(BTreeMap<u64, String>);

impl Names {
    /// Takes note of a record's names, for which these numbers stand.
    pub fn learn(&mut self, record: &Record, numbers: &[f64]) {
        for (value, number) in record.values().into_iter().zip(numbers) {
            if let Value::Text(text) = value
                && self.0.len() < NAMES_MAX
            {
                self.0.entry(number.to_bits()).or_insert_with(|| text.to_owned());
            }
        }
    }

    /// The name that a number stands for.
    pub fn get(&self, number: f64) -> Option<&str> {
        self.0.get(&number.to_bits()).map(String::as_str)
    }
}
