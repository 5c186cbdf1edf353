//! Keys of a file as a page of documentation.

use std::fmt::Write as _;

use bench_rig::{
    keys::{Form, Key, Kind, Presence},
    visit::Range,
};

/// The page: words written by hand, then a table for each table of the file.
pub fn page(file: super::Kind) -> String {
    let head = match file {
        super::Kind::Rig => include_str!("rig.md"),
        super::Kind::Mission => include_str!("mission.md"),
        super::Kind::Suite => include_str!("suite.md"),
        super::Kind::Sweep => include_str!("sweep.md"),
        _ => "",
    };
    let mut sections = Vec::new();
    gather(&mut sections, "", file.title(), "", &file.keys(), None);
    sections.sort_by_key(|section| section.path == QUANTITY);
    let mut out = head.to_owned();
    // The import map's tables stand below a heading of docs/import.md.
    let level = if file == super::Kind::Map { "###" } else { "##" };
    for section in &sections {
        out += &section.in_words(level);
    }
    out.trim_start().to_owned()
}

/// Every quantity of an import map has one and the same table but for its units: it is told once.
const QUANTITY: &str = "quantity";
const QUANTITY_MEANING: &str =
    "A quantity that is no constant, such as `x = { column = \"pos_x\", unit = \"mm\" }`.";

/// The units of a quantity's columns, if these are the forms of one.
fn units_of(forms: &[Form]) -> Option<&[String]> {
    let several = forms.len() > 1 && forms.iter().all(|form| form.when.is_none());
    let unit = forms.first()?.keys.iter().find(|key| key.name == "unit")?;
    match &unit.kind {
        Kind::Choice(units) if several => Some(units),
        _ => None,
    }
}

fn without_units(forms: &[Form]) -> Vec<Form> {
    let mut forms = forms.to_vec();
    for key in forms.iter_mut().flat_map(|form| &mut form.keys).filter(|key| key.name == "unit") {
        key.kind = Kind::Text;
        "The unit that the columns are in; the tables above say which there are."
            .clone_into(&mut key.meaning);
    }
    forms
}

type When = Option<(String, String)>;

/// One table of the file, all its forms together.
struct Section {
    /// `tracker` of `[tracker]`, `[[` and `]]` with the arrays; empty at the top.
    heading: String,
    path: String,
    meaning: String,
    is_optional: bool,
    forms: Vec<When>,
    rows: Vec<Row>,
}

/// One key, or the keys of several forms that are one but for the unit in their names.
struct Row {
    names: Vec<String>,
    units: Vec<String>,
    meaning: String,
    kind: Kind,
    /// The form, and whether the key may be left out in it.
    presence: Vec<(When, Presence)>,
}

fn gather(
    sections: &mut Vec<Section>,
    path: &str,
    meaning: &str,
    heading: &str,
    forms: &[Form],
    outer: Option<&(When, Presence)>,
) {
    for form in forms {
        let when = form.when.clone().or_else(|| outer.and_then(|(when, _)| when.clone()));
        let index = sections.iter().position(|section| section.path == path).unwrap_or(sections.len());
        if index == sections.len() {
            sections.push(Section {
                heading: heading.to_owned(),
                path: path.to_owned(),
                meaning: meaning.to_owned(),
                is_optional: outer.is_some_and(|(_, presence)| *presence != Presence::Required),
                forms: Vec::new(),
                rows: Vec::new(),
            });
        }
        sections[index].forms.push(when.clone());
        for key in &form.keys {
            sections[index].add(key, &when);
        }
        for key in &form.keys {
            let (tables, heading) = inner(&key.kind, path, &key.name);
            let Some(tables) = tables else { continue };
            if units_of(tables).is_some() {
                let outer = (None, Presence::Required);
                gather(sections, QUANTITY, QUANTITY_MEANING, QUANTITY, &without_units(tables), Some(&outer));
            } else {
                let path = join(path, &key.name);
                let outer = (when.clone(), key.presence.clone());
                gather(sections, &path, &key.meaning, &heading, tables, Some(&outer));
            }
        }
    }
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// The tables that a key may hold and how their heading is written.
fn inner<'k>(kind: &'k Kind, path: &str, name: &str) -> (Option<&'k [Form]>, String) {
    let full = join(path, name);
    match kind {
        Kind::Table(forms) => (Some(forms), format!("[{full}]")),
        Kind::Tables(forms, _) => (Some(forms), format!("[[{full}]]")),
        Kind::AnyOf(kinds) => kinds
            .iter()
            .map(|kind| inner(kind, path, name))
            .find(|(forms, _)| forms.is_some())
            .unwrap_or((None, full)),
        _ => (None, full),
    }
}

impl Section {
    fn add(&mut self, key: &Key, when: &When) {
        // These have a section of their own, which says all of them.
        if matches!(key.kind, Kind::Table(_) | Kind::Tables(..)) {
            return;
        }
        let same = |row: &&mut Row| {
            row.meaning == key.meaning
                && row.kind == key.kind
                && row.presence.iter().all(|(other, _)| other != when || other.is_none())
                && (row.names.contains(&key.name) || when.is_some())
        };
        let unit = key.unit().unwrap_or("").to_owned();
        match self.rows.iter_mut().find(same) {
            Some(row) => {
                if !row.names.contains(&key.name) {
                    row.names.push(key.name.clone());
                }
                if !row.units.contains(&unit) {
                    row.units.push(unit);
                }
                row.presence.push((when.clone(), key.presence.clone()));
            }
            None => self.rows.push(Row {
                names: vec![key.name.clone()],
                units: vec![unit],
                meaning: key.meaning.clone(),
                kind: key.kind.clone(),
                presence: vec![(when.clone(), key.presence.clone())],
            }),
        }
    }

    fn in_words(&self, level: &str) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail.
        if self.heading.is_empty() && self.rows.is_empty() {
            return out;
        } else if self.heading.is_empty() {
            let _ = writeln!(out, "\n{level} At the top\n");
        } else {
            let _ = writeln!(out, "\n{level} `{}`", self.heading);
            let optional = if self.is_optional { " May be absent." } else { "" };
            let _ = writeln!(out, "{}{optional}\n", self.meaning);
        }
        if !self.rows.is_empty() {
            out += "| key | unit | value | when absent | meaning |\n|---|---|---|---|---|\n";
        }
        for row in &self.rows {
            let names: Vec<_> = row.names.iter().map(|name| format!("`{name}`")).collect();
            let _ = writeln!(
                out,
                "| {} | {} | {} | {} | {}{} |",
                names.join(", "),
                row.units.join(", "),
                value(&row.kind),
                self.absent(row),
                row.meaning,
                self.only(row)
            );
        }
        out
    }

    /// What becomes of a key that is absent.
    fn absent(&self, row: &Row) -> String {
        let needed: Vec<_> =
            row.presence.iter().filter(|(_, presence)| *presence == Presence::Required).collect();
        if needed.len() == row.presence.len() {
            let another =
                row.presence.len() < self.forms.len() && needed.iter().all(|(when, _)| when.is_none());
            return if another { "another key in its place" } else { "must be there" }.to_owned();
        }
        let of_rest = row.presence.iter().find(|(_, presence)| *presence != Presence::Required);
        let rest = match of_rest.map(|(_, presence)| presence) {
            Some(Presence::Number(number)) => format!("{number}"),
            Some(Presence::Text(text)) => format!("`\"{text}\"`"),
            Some(Presence::Along(other)) => format!("must be there with `{other}`"),
            Some(Presence::Beside(others)) => {
                let others: Vec<_> = others.iter().map(|other| format!("`{other}`")).collect();
                format!("none; must be there with {}", others.join(" or "))
            }
            _ => "none".to_owned(),
        };
        match needed.as_slice() {
            [] => rest,
            needed => {
                format!("{rest}; must be there with {}", conditions(needed.iter().map(|(when, _)| when)))
            }
        }
    }

    /// In which forms alone the key may stand.
    fn only(&self, row: &Row) -> String {
        let conditional = row.presence.iter().all(|(when, _)| when.is_some());
        let one_name = row.names.len() == 1;
        if one_name && conditional && row.presence.len() < self.forms.len() {
            format!(" Only with {}.", conditions(row.presence.iter().map(|(when, _)| when)))
        } else {
            String::new()
        }
    }
}

fn conditions<'w>(all: impl Iterator<Item = &'w When>) -> String {
    let all: Vec<_> = all.flatten().collect();
    let choices: Vec<_> = all.iter().map(|(_, choice)| format!("`\"{choice}\"`")).collect();
    let key = all.first().map_or("", |(key, _)| key);
    format!("`{key}` = {}", choices.join(" or "))
}

fn value(kind: &Kind) -> String {
    match kind {
        Kind::Number(range) => words(*range),
        Kind::Uncertain(range) => format!("{}, or `{{ value, sigma }}`", words(*range)),
        Kind::Integer(low, high) => format!("whole, {low} to {high}"),
        Kind::Text => "text".to_owned(),
        Kind::File => "name of a file".to_owned(),
        Kind::Flag => "true or false".to_owned(),
        Kind::Choice(names) => {
            let names: Vec<_> = names.iter().map(|name| format!("`\"{}\"`", name.escape_default())).collect();
            names.join(", ")
        }
        Kind::List(of, least, most) if *most == Some(*least) => format!("{least} of: {}", value(of)),
        Kind::List(of, ..) => format!("list of: {}", value(of)),
        Kind::Pair(first, second) => format!("[{}, {}]", value(first), value(second)),
        Kind::Points(range) => format!("{}, or points `[time_s, value]`", words(*range)),
        Kind::Table(forms) => match units_of(forms) {
            Some(units) => format!("columns in {}", units.join(", ")),
            None => "table, see below".to_owned(),
        },
        Kind::Tables(..) => "tables".to_owned(),
        Kind::Names(of) => format!("table of: {}", value(of)),
        Kind::Effects => "tables, each `[[effect]]`: `name` and parameters".to_owned(),
        Kind::AnyOf(kinds) => kinds.iter().map(value).collect::<Vec<_>>().join(", or "),
    }
}

fn words(range: Range) -> String {
    let high = range.high().map(number);
    match (range.low().map(number), high) {
        (Some(low), Some(high)) if range.is_low_open() => format!("above {low}, to {high}"),
        (Some(low), Some(high)) => format!("{low} to {high}"),
        (Some(low), None) if range.is_low_open() => format!("above {low}"),
        (Some(low), None) => format!("{low} or more"),
        (None, Some(high)) => format!("up to {high}"),
        (None, None) => "number".to_owned(),
    }
}

fn number(x: f64) -> String {
    if x != 0.0 && !(1e-3..1e5).contains(&x.abs()) { format!("{x:e}") } else { format!("{x}") }
}
