//! Names by the numbers that stand for them.

use std::collections::{BTreeMap, btree_map};

use super::law::Entry;
use crate::{Record, Value};

/// Most names that are kept for messages.
const NAMES_MAX: usize = 1000;

/// Names by the numbers that stand for them.
#[derive(Default)]
pub(super) struct Names {
    names: BTreeMap<u64, String>,
    /// By slot, the number that was learnt last: names come many times in a row.
    last: Vec<u64>,
}

impl Names {
    /// Takes note of a name; gives it if it is a new one.
    pub fn learn(&mut self, entries: &[Entry], slot: usize, number: f64, record: &Record) -> Option<&str> {
        let number = number.to_bits();
        self.last.resize(entries.len(), u64::MAX);
        if std::mem::replace(&mut self.last[slot], number) == number || self.names.len() >= NAMES_MAX {
            return None;
        }
        let Value::Text(text) = entries[slot].field.value(record) else { return None };
        match self.names.entry(number) {
            btree_map::Entry::Vacant(place) => Some(place.insert(text.to_owned())),
            btree_map::Entry::Occupied(_) => None,
        }
    }

    pub fn add(&mut self, names: Vec<(u64, String)>) {
        for (number, name) in names {
            if self.names.len() < NAMES_MAX {
                self.names.entry(number).or_insert(name);
            }
        }
    }

    pub fn get(&self, name: Option<f64>) -> String {
        let Some(name) = name else { return "nothing".to_owned() };
        self.names.get(&name.to_bits()).cloned().unwrap_or_else(|| "another text".to_owned())
    }
}
