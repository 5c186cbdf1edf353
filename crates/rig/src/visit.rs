//! TOML files of the bench, for whoever reads one: [`parse`] keeps the line of every value, a [`Reader`] takes values
//! out by key, checks them and collects each [`Problem`] with file, line and key.
//!
//! One list of keys serves all directions: a struct's `visit` function names each key once, with its meaning and range.
//! The reader fills the struct from TOML; a writer, known to this crate alone, prints the struct as TOML; a collector makes
//! the list of [`crate::keys`], from which pages and JSON Schemas come.

use std::{collections::BTreeSet, fmt::Write as _, path::Path};

use toml::de::{DeTable, DeValue};

use crate::{
    Uncertain,
    error::{Location, Problem, RigError},
};

/// A closed or half-open interval and how to say it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    low: f64,
    high: f64,
    low_open: bool,
}

impl Range {
    /// From `low` to `high`, both included.
    pub const fn closed(low: f64, high: f64) -> Self {
        Self { low, high, low_open: false }
    }

    /// From above `low` (excluded) to `high`.
    pub const fn above(low: f64, high: f64) -> Self {
        Self { low, high, low_open: true }
    }

    /// Any number that is finite.
    pub const ANY: Self = Self::closed(f64::MIN, f64::MAX);

    /// The lower end; `None` where there is none.
    pub fn low(self) -> Option<f64> {
        (self.low > f64::MIN).then_some(self.low)
    }

    /// The upper end, which is included; `None` where there is none.
    pub fn high(self) -> Option<f64> {
        (self.high < f64::MAX).then_some(self.high)
    }

    /// Whether the lower end is left out.
    pub const fn is_low_open(self) -> bool {
        self.low_open
    }

    /// Whether `x` lies in it; NaN never does.
    pub fn contains(self, x: f64) -> bool {
        x <= self.high && if self.low_open { x > self.low } else { x >= self.low }
    }

    /// The range in words, for messages.
    pub fn words(self) -> String {
        if self == Self::ANY {
            "a finite number".to_owned()
        } else if self.low_open {
            format!("a number above {} and at most {}", self.low, self.high)
        } else {
            format!("a number from {} to {}", self.low, self.high)
        }
    }
}

/// Goes through the keys of a table, reading or writing each. A key's `meaning` is a sentence; its unit stands in the key.
pub trait Visitor {
    /// A number with its tolerance.
    fn uncertain(&mut self, key: &str, meaning: &str, range: Range, value: &mut Uncertain);
    /// A number.
    fn number(&mut self, key: &str, meaning: &str, range: Range, value: &mut f64);
    /// An optional number; absent and `None` are the same.
    fn maybe(&mut self, key: &str, meaning: &str, range: Range, value: &mut Option<f64>);
    /// A whole number from `low` to `high`.
    fn integer(&mut self, key: &str, meaning: &str, low: u32, high: u32, value: &mut u32);
    /// A text that is not empty.
    fn text(&mut self, key: &str, meaning: &str, value: &mut String);
    /// One of the named choices.
    fn choice<T: Copy + PartialEq>(&mut self, key: &str, meaning: &str, choices: &[(&str, T)], value: &mut T);
    /// One of the named choices; absent, the value stays what it is.
    fn choice_or<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        meaning: &str,
        choices: &[(&str, T)],
        value: &mut T,
    );
    /// One of the named choices, the first of which is meant where the key is absent, and is not written.
    fn choice_beside<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        meaning: &str,
        choices: &[(&str, T)],
        value: &mut T,
    );
    /// A list of three numbers.
    fn triple(&mut self, key: &str, meaning: &str, range: Range, value: &mut [f64; 3]);
    /// A number, or points `[time_s, number]` with times that do not fall.
    fn points(
        &mut self,
        key: &str,
        meaning: &str,
        range: Range,
        value: &mut Vec<[f64; 2]>,
        default: Option<f64>,
    );
    /// A table within the table.
    fn table(&mut self, key: &str, meaning: &str, visit: impl FnOnce(&mut Self));
    /// An optional table: not visited where it is absent, not written where nothing stands in it.
    fn maybe_table(&mut self, key: &str, meaning: &str, visit: impl FnOnce(&mut Self));
    /// Tables, so many at least (none or one), each written as `[[key]]`: each begins as what `blank` gives.
    fn tables<T>(
        &mut self,
        key: &str,
        least: usize,
        meaning: &str,
        items: &mut Vec<T>,
        blank: impl Fn() -> T,
        visit: impl Fn(&mut T, &mut Self),
    );
    /// Keys that are needed beside an optional `key` and make no sense without it; `given` says whether it has a value.
    fn along(&mut self, key: &str, given: bool, visit: impl FnOnce(&mut Self));
}

/// A TOML value with its line.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Counted from one.
    pub line: usize,
    /// What stands there.
    pub value: Value,
}

/// What a bench file may hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// An integer or a float.
    Number(f64),
    /// A string.
    Text(String),
    /// True or false.
    Flag(bool),
    /// Anything that no bench file uses, in words.
    Other(&'static str),
    /// An array.
    List(Vec<Node>),
    /// Keys and values in the order of their lines.
    Table(Vec<(String, Node)>),
}

impl Value {
    fn words(&self) -> String {
        match self {
            Self::Number(x) => format!("the number {x}"),
            Self::Text(s) => format!("the text {s:?}"),
            Self::Flag(flag) => flag.to_string(),
            Self::Other(kind) => (*kind).to_owned(),
            Self::List(_) => "a list".to_owned(),
            Self::Table(_) => "a table".to_owned(),
        }
    }
}

/// Parses TOML text; `file` is for the messages.
pub fn parse(file: &Path, text: &str) -> Result<Node, RigError> {
    let line_of = |offset: usize| text[..offset.min(text.len())].matches('\n').count() + 1;
    let table = DeTable::parse(text).map_err(|error| RigError::Syntax {
        at: Location { file: file.to_owned(), line: error.span().map_or(1, |span| line_of(span.start)) },
        detail: error.message().to_owned(),
    })?;
    Ok(Node { line: 1, value: convert_table(table.get_ref(), &line_of) })
}

fn convert_table(table: &DeTable<'_>, line_of: &impl Fn(usize) -> usize) -> Value {
    let mut entries: Vec<_> = table
        .iter()
        .map(|(key, value)| {
            let line = line_of(key.span().start);
            (key.get_ref().to_string(), Node { line, value: convert(value.get_ref(), line_of) })
        })
        .collect();
    entries.sort_by_key(|(_, node)| node.line);
    Value::Table(entries)
}

fn convert(value: &DeValue<'_>, line_of: &impl Fn(usize) -> usize) -> Value {
    match value {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .map_or(Value::Other("an integer too large to hold"), |x| Value::Number(x as f64)),
        DeValue::Float(number) => {
            number.as_str().parse().map_or(Value::Other("an odd number"), Value::Number)
        }
        DeValue::Boolean(flag) => Value::Flag(*flag),
        DeValue::Datetime(_) => Value::Other("a date"),
        DeValue::Array(items) => Value::List(
            items
                .iter()
                .map(|item| Node {
                    line: line_of(item.span().start),
                    value: convert(item.get_ref(), line_of),
                })
                .collect(),
        ),
        DeValue::Table(table) => convert_table(table, line_of),
    }
}

/// Reads one table; nested tables borrow the problems of the outermost.
#[derive(Debug)]
pub struct Reader<'a, 'p> {
    file: &'a Path,
    prefix: String,
    line: usize,
    entries: &'a [(String, Node)],
    known: BTreeSet<String>,
    problems: &'p mut Vec<Problem>,
}

impl<'a, 'p> Reader<'a, 'p> {
    /// Reads the table `node`, then complains of every key that `visit` did not ask for.
    pub fn read(
        file: &'a Path,
        prefix: &str,
        node: &'a Node,
        problems: &'p mut Vec<Problem>,
        visit: impl FnOnce(&mut Reader<'a, 'p>),
    ) {
        let Value::Table(entries) = &node.value else {
            problems.push(Problem::WrongType {
                at: Location { file: file.to_owned(), line: node.line },
                key: prefix.to_owned(),
                found: node.value.words(),
                expected: "a table".to_owned(),
            });
            return;
        };
        let mut reader = Reader {
            file,
            prefix: prefix.to_owned(),
            line: node.line,
            entries,
            known: BTreeSet::new(),
            problems,
        };
        visit(&mut reader);
        reader.complain_of_unknown_keys();
    }

    fn complain_of_unknown_keys(&mut self) {
        for (key, node) in self.entries {
            if self.known.contains(key) {
                continue;
            }
            let closest = self
                .known
                .iter()
                .map(|known| (strsim::jaro_winkler(key, known), known))
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(similarity, _)| *similarity > 0.8);
            let hint = match closest {
                Some((_, known)) => format!("did you mean `{known}`? (units are part of the key)"),
                None => {
                    format!("expected one of {}", self.known.iter().cloned().collect::<Vec<_>>().join(", "))
                }
            };
            let problem = Problem::UnknownKey { at: self.at(node.line), key: self.path(key), hint };
            self.problems.push(problem);
        }
    }

    /// A line of this file.
    pub fn at(&self, line: usize) -> Location {
        Location { file: self.file.to_owned(), line }
    }

    /// The key with the tables around it.
    pub fn path(&self, key: &str) -> String {
        if self.prefix.is_empty() { key.to_owned() } else { format!("{}.{key}", self.prefix) }
    }

    /// The value of `key`, which counts as known from now on.
    pub fn get(&mut self, key: &str) -> Option<&'a Node> {
        self.known.insert(key.to_owned());
        self.entries.iter().find(|(name, _)| name == key).map(|(_, node)| node)
    }

    /// The value of `key`; a problem if it is missing.
    pub fn require(&mut self, key: &str, expected: &str) -> Option<&'a Node> {
        let node = self.get(key);
        if node.is_none() {
            let problem = Problem::MissingKey {
                at: self.at(self.line),
                key: self.path(key),
                expected: expected.to_owned(),
            };
            self.problems.push(problem);
        }
        node
    }

    /// Whether `key` stands in the file; does not count as asking for it.
    pub fn has(&self, key: &str) -> bool {
        self.entries.iter().any(|(name, _)| name == key)
    }

    /// Whether nothing was wrong so far, in this file or before it.
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }

    /// Tells that `node` at `key` is not what was expected.
    pub fn wrong_type(&mut self, key: &str, node: &Node, expected: &str) {
        let problem = Problem::WrongType {
            at: self.at(node.line),
            key: self.path(key),
            found: node.value.words(),
            expected: expected.to_owned(),
        };
        self.problems.push(problem);
    }

    /// Tells what does not fit about `key`.
    pub fn contradiction(&mut self, key: &str, detail: String) {
        let line = self.entries.iter().find(|(name, _)| name == key).map_or(self.line, |(_, node)| node.line);
        let problem = Problem::Contradiction { at: self.at(line), key: self.path(key), detail };
        self.problems.push(problem);
    }

    /// The number `node` at `key`, if it is one and in range; a problem if not.
    pub fn number_in(&mut self, key: &str, node: &Node, range: Range) -> Option<f64> {
        match node.value {
            Value::Number(x) if range.contains(x) => Some(x),
            Value::Number(value) => {
                let problem = Problem::OutOfRange {
                    at: self.at(node.line),
                    key: self.path(key),
                    value,
                    expected: range.words(),
                };
                self.problems.push(problem);
                None
            }
            _ => {
                self.wrong_type(key, node, &range.words());
                None
            }
        }
    }

    /// Reads the table `node` at `key`, such as one element of an array of tables; complains of keys that `visit` did
    /// not ask for.
    pub fn within(&mut self, key: &str, node: &'a Node, visit: impl FnOnce(&mut Self)) {
        // The nested reader borrows what this one holds, so it takes this one's place while it reads.
        let Value::Table(entries) = &node.value else {
            self.wrong_type(key, node, "a table");
            return;
        };
        let prefix = self.path(key);
        let outer_prefix = std::mem::replace(&mut self.prefix, prefix);
        let outer_line = std::mem::replace(&mut self.line, node.line);
        let outer_entries = std::mem::replace(&mut self.entries, entries);
        let outer_known = std::mem::take(&mut self.known);
        visit(self);
        self.complain_of_unknown_keys();
        self.prefix = outer_prefix;
        self.line = outer_line;
        self.entries = outer_entries;
        self.known = outer_known;
    }

    fn point(&mut self, key: &str, node: &Node, range: Range) -> Option<[f64; 2]> {
        let Value::List(pair) = &node.value else {
            self.wrong_type(key, node, "a point [time_s, value]");
            return None;
        };
        let [time, value] = pair.as_slice() else {
            self.wrong_type(key, node, "a point [time_s, value]");
            return None;
        };
        let time = self.number_in(key, time, Range::closed(0.0, 86_400.0))?;
        Some([time, self.number_in(key, value, range)?])
    }
}

/// What a table may hold, key by key. `visit` functions reach them through [`Visitor`].
impl Reader<'_, '_> {
    fn uncertain(&mut self, key: &str, range: Range, value: &mut Uncertain) {
        let expected = format!("{}, or {{ value = ..., sigma = ... }}", range.words());
        let Some(node) = self.require(key, &expected) else { return };
        match &node.value {
            Value::Number(_) => {
                if let Some(x) = self.number_in(key, node, range) {
                    *value = Uncertain::exact(x);
                }
            }
            Value::Table(_) => {
                let prefix = self.path(key);
                Reader::read(self.file, &prefix, node, self.problems, |reader| {
                    reader.number("value", range, &mut value.value);
                    reader.number("sigma", Range::closed(0.0, 1e12), &mut value.sigma);
                });
            }
            _ => self.wrong_type(key, node, &expected),
        }
    }

    /// A number.
    pub fn number(&mut self, key: &str, range: Range, value: &mut f64) {
        if let Some(node) = self.require(key, &range.words())
            && let Some(x) = self.number_in(key, node, range)
        {
            *value = x;
        }
    }

    /// An optional number; absent and `None` are the same.
    pub fn maybe(&mut self, key: &str, range: Range, value: &mut Option<f64>) {
        *value = self.get(key).and_then(|node| self.number_in(key, node, range));
    }

    fn integer(&mut self, key: &str, low: u32, high: u32, value: &mut u32) {
        let mut x = f64::NAN;
        self.number(key, Range::closed(f64::from(low), f64::from(high)), &mut x);
        if x.fract() == 0.0 {
            *value = x as u32;
        } else if !x.is_nan() {
            self.contradiction(key, format!("{x} is not a whole number"));
        }
    }

    /// A text that is not empty.
    pub fn text(&mut self, key: &str, value: &mut String) {
        let Some(node) = self.require(key, "a text") else { return };
        match &node.value {
            Value::Text(text) if !text.is_empty() => value.clone_from(text),
            _ => self.wrong_type(key, node, "a text that is not empty"),
        }
    }

    /// A text or a list of texts; empty where the key is absent.
    pub fn texts(&mut self, key: &str) -> Vec<String> {
        const EXPECTED: &str = "a text that is not empty, or a list of such texts";
        let Some(node) = self.get(key) else { return Vec::new() };
        let items = match &node.value {
            Value::List(items) if !items.is_empty() => items.as_slice(),
            Value::Text(_) => std::slice::from_ref(node),
            _ => {
                self.wrong_type(key, node, EXPECTED);
                return Vec::new();
            }
        };
        let mut texts = Vec::new();
        for item in items {
            match &item.value {
                Value::Text(text) if !text.trim().is_empty() => texts.push(text.clone()),
                _ => self.wrong_type(key, item, EXPECTED),
            }
        }
        texts
    }

    /// True or false; absent, the value stays what it is.
    pub fn flag(&mut self, key: &str, value: &mut bool) {
        let Some(node) = self.get(key) else { return };
        match &node.value {
            Value::Flag(flag) => *value = *flag,
            _ => self.wrong_type(key, node, "true or false"),
        }
    }

    /// One of the named choices.
    pub fn choice<T: Copy + PartialEq>(&mut self, key: &str, choices: &[(&str, T)], value: &mut T) {
        let names: Vec<_> = choices.iter().map(|(name, _)| format!("{name:?}")).collect();
        let expected = format!("one of {}", names.join(", "));
        let Some(node) = self.require(key, &expected) else { return };
        let chosen = match &node.value {
            Value::Text(text) => choices.iter().find(|(name, _)| name == text),
            _ => None,
        };
        match chosen {
            Some((_, choice)) => *value = *choice,
            None => self.wrong_type(key, node, &expected),
        }
    }

    /// One of the named choices; absent, the value stays what it is.
    pub fn choice_or<T: Copy + PartialEq>(&mut self, key: &str, choices: &[(&str, T)], value: &mut T) {
        if self.get(key).is_some() {
            self.choice(key, choices, value);
        }
    }

    fn triple(&mut self, key: &str, range: Range, value: &mut [f64; 3]) {
        let expected = format!("a list of three: {}", range.words());
        let Some(node) = self.require(key, &expected) else { return };
        match &node.value {
            Value::List(items) if items.len() == 3 => {
                for (slot, item) in value.iter_mut().zip(items) {
                    if let Some(x) = self.number_in(key, item, range) {
                        *slot = x;
                    }
                }
            }
            _ => self.wrong_type(key, node, &expected),
        }
    }

    fn points(&mut self, key: &str, range: Range, value: &mut Vec<[f64; 2]>, default: Option<f64>) {
        let expected = format!("{}, or points [time_s, value]", range.words());
        let node = if default.is_some() { self.get(key) } else { self.require(key, &expected) };
        let Some(node) = node else {
            *value = default.map(|x| vec![[0.0, x]]).unwrap_or_default();
            return;
        };
        match &node.value {
            Value::Number(_) => {
                *value = self.number_in(key, node, range).map(|x| vec![[0.0, x]]).unwrap_or_default();
            }
            Value::List(items) if !items.is_empty() => {
                *value = items.iter().filter_map(|item| self.point(key, item, range)).collect();
                if !value.is_sorted_by(|a, b| a[0] <= b[0]) {
                    self.contradiction(key, "the points' times fall; they must rise or stay (a step)".into());
                }
            }
            _ => self.wrong_type(key, node, &expected),
        }
    }

    /// A table within the table.
    pub fn table(&mut self, key: &str, visit: impl FnOnce(&mut Self)) {
        if let Some(node) = self.require(key, "a table") {
            self.within(key, node, visit);
        }
    }

    fn maybe_table(&mut self, key: &str, visit: impl FnOnce(&mut Self)) {
        if let Some(node) = self.get(key) {
            self.within(key, node, visit);
        }
    }

    fn tables<T>(
        &mut self,
        key: &str,
        items: &mut Vec<T>,
        blank: impl Fn() -> T,
        visit: impl Fn(&mut T, &mut Self),
    ) {
        let Some(node) = self.require(key, &format!("at least one [[{key}]]")) else { return };
        match &node.value {
            Value::List(list) if !list.is_empty() => {
                for item in list {
                    let mut made = blank();
                    self.within(key, item, |reader| visit(&mut made, reader));
                    items.push(made);
                }
            }
            _ => self.wrong_type(key, node, &format!("tables, each written as [[{key}]]")),
        }
    }
}

impl Visitor for Reader<'_, '_> {
    fn uncertain(&mut self, key: &str, _: &str, range: Range, value: &mut Uncertain) {
        self.uncertain(key, range, value);
    }

    fn number(&mut self, key: &str, _: &str, range: Range, value: &mut f64) {
        self.number(key, range, value);
    }

    fn maybe(&mut self, key: &str, _: &str, range: Range, value: &mut Option<f64>) {
        self.maybe(key, range, value);
    }

    fn integer(&mut self, key: &str, _: &str, low: u32, high: u32, value: &mut u32) {
        self.integer(key, low, high, value);
    }

    fn text(&mut self, key: &str, _: &str, value: &mut String) {
        self.text(key, value);
    }

    fn choice<T: Copy + PartialEq>(&mut self, key: &str, _: &str, choices: &[(&str, T)], value: &mut T) {
        self.choice(key, choices, value);
    }

    fn choice_or<T: Copy + PartialEq>(&mut self, key: &str, _: &str, choices: &[(&str, T)], value: &mut T) {
        self.choice_or(key, choices, value);
    }

    fn choice_beside<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        _: &str,
        choices: &[(&str, T)],
        value: &mut T,
    ) {
        self.choice_or(key, choices, value);
    }

    fn triple(&mut self, key: &str, _: &str, range: Range, value: &mut [f64; 3]) {
        self.triple(key, range, value);
    }

    fn points(&mut self, key: &str, _: &str, range: Range, value: &mut Vec<[f64; 2]>, default: Option<f64>) {
        self.points(key, range, value, default);
    }

    fn table(&mut self, key: &str, _: &str, visit: impl FnOnce(&mut Self)) {
        self.table(key, visit);
    }

    fn maybe_table(&mut self, key: &str, _: &str, visit: impl FnOnce(&mut Self)) {
        self.maybe_table(key, visit);
    }

    fn tables<T>(
        &mut self,
        key: &str,
        least: usize,
        _: &str,
        items: &mut Vec<T>,
        blank: impl Fn() -> T,
        visit: impl Fn(&mut T, &mut Self),
    ) {
        if least > 0 || self.has(key) {
            self.tables(key, items, blank, visit);
        }
    }

    fn along(&mut self, key: &str, given: bool, visit: impl FnOnce(&mut Self)) {
        // A value that was refused is no reason to call its companions unknown.
        if given || self.has(key) {
            visit(self);
        }
    }
}

/// Prints tables as TOML. Scalars of a table must be visited before its sub-tables.
#[derive(Default)]
pub(crate) struct Writer {
    pub(crate) out: String,
    prefix: String,
}

impl Writer {
    pub(crate) fn line(&mut self, key: &str, value: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.out, "{key} = {value}");
    }

    /// Begins an element of an array of tables.
    pub(crate) fn element(&mut self, key: &str) {
        let _ = writeln!(self.out, "\n[[{key}]]");
    }
}

/// A float that reads back to the same bits and is a TOML float.
pub(crate) fn float(x: f64) -> String {
    format!("{x:?}")
}

pub(crate) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

impl Visitor for Writer {
    fn uncertain(&mut self, key: &str, _: &str, _: Range, value: &mut Uncertain) {
        if value.sigma == 0.0 {
            self.line(key, float(value.value));
        } else {
            self.line(key, format!("{{ value = {}, sigma = {} }}", float(value.value), float(value.sigma)));
        }
    }

    fn number(&mut self, key: &str, _: &str, _: Range, value: &mut f64) {
        self.line(key, float(*value));
    }

    fn maybe(&mut self, key: &str, _: &str, _: Range, value: &mut Option<f64>) {
        if let Some(x) = value {
            self.line(key, float(*x));
        }
    }

    fn integer(&mut self, key: &str, _: &str, _: u32, _: u32, value: &mut u32) {
        self.line(key, value);
    }

    fn text(&mut self, key: &str, _: &str, value: &mut String) {
        self.line(key, quoted(value));
    }

    fn choice<T: Copy + PartialEq>(&mut self, key: &str, _: &str, choices: &[(&str, T)], value: &mut T) {
        if let Some((name, _)) = choices.iter().find(|(_, choice)| choice == value) {
            self.line(key, quoted(name));
        }
    }

    fn choice_or<T: Copy + PartialEq>(&mut self, key: &str, _: &str, choices: &[(&str, T)], value: &mut T) {
        self.choice(key, "", choices, value);
    }

    fn choice_beside<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        _: &str,
        choices: &[(&str, T)],
        value: &mut T,
    ) {
        if choices.first().is_none_or(|(_, first)| first != value) {
            self.choice(key, "", choices, value);
        }
    }

    fn triple(&mut self, key: &str, _: &str, _: Range, value: &mut [f64; 3]) {
        self.line(key, format!("[{}, {}, {}]", float(value[0]), float(value[1]), float(value[2])));
    }

    fn points(&mut self, key: &str, _: &str, _: Range, value: &mut Vec<[f64; 2]>, _: Option<f64>) {
        match value.as_slice() {
            [[_, x]] => self.line(key, float(*x)),
            points => {
                let points: Vec<_> =
                    points.iter().map(|[t, x]| format!("[{}, {}]", float(*t), float(*x))).collect();
                self.line(key, format!("[{}]", points.join(", ")));
            }
        }
    }

    fn table(&mut self, key: &str, _: &str, visit: impl FnOnce(&mut Self)) {
        let prefix = if self.prefix.is_empty() { key.to_owned() } else { format!("{}.{key}", self.prefix) };
        let _ = writeln!(self.out, "\n[{prefix}]");
        let outer = std::mem::replace(&mut self.prefix, prefix);
        visit(self);
        self.prefix = outer;
    }

    fn maybe_table(&mut self, key: &str, _: &str, visit: impl FnOnce(&mut Self)) {
        let before = self.out.len();
        self.table(key, "", |_| ());
        let begun = self.out.len();
        let prefix = if self.prefix.is_empty() { key.to_owned() } else { format!("{}.{key}", self.prefix) };
        let outer = std::mem::replace(&mut self.prefix, prefix);
        visit(self);
        self.prefix = outer;
        if self.out.len() == begun {
            self.out.truncate(before);
        }
    }

    fn tables<T>(
        &mut self,
        key: &str,
        _: usize,
        _: &str,
        items: &mut Vec<T>,
        _: impl Fn() -> T,
        visit: impl Fn(&mut T, &mut Self),
    ) {
        for item in items {
            self.element(key);
            visit(item, self);
        }
    }

    fn along(&mut self, _: &str, given: bool, visit: impl FnOnce(&mut Self)) {
        if given {
            visit(self);
        }
    }
}
