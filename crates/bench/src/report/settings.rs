//! What a flight was flown with: rig and mission as tables of their keys, and what was recorded.

use std::path::Path;

use bench_page::parts::{Column, cell, folded, table};
use bench_recording::Info;
use bench_rig::{
    keys::{Form, Kind},
    visit::{self, Node, Value},
};
use maud::{Markup, html};

use crate::words;

/// What the key at a path means.
pub fn meaning(forms: &[Form], path: &[&str]) -> Option<String> {
    let (first, rest) = path.split_first()?;
    let mut keys = forms.iter().flat_map(|form| &form.keys).filter(|key| key.name == *first);
    if rest.is_empty() {
        return keys.next().map(|key| key.meaning.clone());
    }
    keys.find_map(|key| within(&key.kind, rest))
}

fn within(kind: &Kind, path: &[&str]) -> Option<String> {
    match kind {
        Kind::Table(forms) | Kind::Tables(forms, _) => meaning(forms, path),
        Kind::AnyOf(kinds) => kinds.iter().find_map(|kind| within(kind, path)),
        _ => None,
    }
}

/// A table of the file: its name, and its keys with values and meanings.
type Table = (String, Vec<[String; 3]>);

/// A file as tables of its keys, closed until it is wanted, with its text for who wants to fly it.
pub fn folded_file(what: &str, file: &Path, text: &str, forms: &[Form]) -> Markup {
    let mut tables: Vec<Table> = Vec::new();
    // A file that is none is shown as the text that it is.
    if let Ok(node) = visit::parse(file, text) {
        gather(&mut tables, forms, &mut Vec::new(), "", &node);
    }
    let columns = [Column::Words("key"), Column::Words("value"), Column::Words("meaning")];
    let content = html! {
        @for (name, rows) in &tables {
            @if !rows.is_empty() {
                div.block {
                    @if !name.is_empty() { h4 { (name) } }
                    (table(&columns, rows.iter().map(|[key, value, meaning]| vec![
                        html! { code { (key) } }, cell(value), html! { span.soft { (meaning) } },
                    ])))
                }
            }
        }
        div.block { (folded("As a file", "reads back the same", false, html! { pre { (text) } })) }
    };
    let keys: usize = tables.iter().map(|(_, rows)| rows.len()).sum();
    folded(bench_page::capitalised(what), &words::count(keys as u64, "key"), false, content)
}

fn gather(tables: &mut Vec<Table>, forms: &[Form], path: &mut Vec<String>, name: &str, node: &Node) {
    let Value::Table(entries) = &node.value else { return };
    let place = tables.len();
    tables.push((name.to_owned(), Vec::new()));
    let joined = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    for (key, node) in entries {
        path.push(key.clone());
        match &node.value {
            Value::Table(inner) if !is_uncertain(inner) => gather(tables, forms, path, &joined(key), node),
            Value::List(items) if items.iter().any(|item| matches!(item.value, Value::Table(_))) => {
                for (index, item) in items.iter().enumerate() {
                    gather(tables, forms, path, &format!("{} {}", joined(key), index + 1), item);
                }
            }
            _ => {
                let keys: Vec<&str> = path.iter().map(String::as_str).collect();
                let meaning = meaning(forms, &keys).unwrap_or_default();
                tables[place].1.push([key.clone(), told(node), meaning]);
            }
        }
        path.pop();
    }
}

fn is_uncertain(entries: &[(String, Node)]) -> bool {
    entries.iter().all(|(key, _)| key == "value" || key == "sigma")
}

fn told(node: &Node) -> String {
    match &node.value {
        Value::Number(x) => x.to_string(),
        Value::Text(text) => text.clone(),
        Value::Flag(flag) => flag.to_string(),
        Value::Other(what) => (*what).to_owned(),
        Value::List(items) => items.iter().map(told).collect::<Vec<_>>().join(", "),
        Value::Table(entries) => {
            entries.iter().map(|(_, node)| told(node)).collect::<Vec<_>>().join(" \u{b1} ")
        }
    }
}

/// What was recorded.
pub fn channels(info: &Info) -> Markup {
    let rows = info.channels.iter().map(|channel| {
        vec![cell(&channel.name), cell(words::grouped(channel.messages)), cell(&channel.message)]
    });
    let columns = [Column::Words("channel"), Column::Number("messages"), Column::Words("of type")];
    let count = words::count(info.messages, "message");
    folded("Channels", &count, false, table(&columns, rows))
}

#[cfg(test)]
mod tests {
    use bench_rig::{Mission, Rig};

    use super::*;

    #[test]
    fn every_key_of_the_rigs_and_missions_has_its_meaning() {
        for (kind, forms) in
            [(crate::library::Kind::Rig, Rig::keys()), (crate::library::Kind::Mission, Mission::keys())]
        {
            for name in kind.names() {
                let path = kind.find(&name).unwrap();
                let text = match kind {
                    crate::library::Kind::Rig => crate::files::rig(&path).unwrap().to_toml(),
                    _ => crate::library::read(&path).unwrap(),
                };
                let mut tables = Vec::new();
                gather(&mut tables, &forms, &mut Vec::new(), "", &visit::parse(&path, &text).unwrap());
                for (table, rows) in tables {
                    for [key, _, meaning] in rows {
                        assert!(!meaning.is_empty() || table.starts_with("effect"), "{name}: {table}.{key}");
                    }
                }
            }
        }
    }
}
