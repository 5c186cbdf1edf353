//! The table of crates in `docs/architecture.md` is the workspace's dependency graph.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    process::Command,
};

type Graph = BTreeMap<String, BTreeSet<String>>;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Crate to what it may know, from the table; `bench` may know all.
fn documented() -> Graph {
    let page = std::fs::read_to_string(root().join("docs/architecture.md")).unwrap();
    let table = page.split("| crate | what lives there | may know |").nth(1).expect("the table is there");
    let rows: Vec<Vec<&str>> = table
        .lines()
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    let all: BTreeSet<String> = rows.iter().map(|row| row[0].to_owned()).collect();
    rows.iter()
        .map(|row| {
            let known = match row[2] {
                "nothing" => BTreeSet::new(),
                "all" => all.iter().filter(|name| *name != row[0]).cloned().collect(),
                list => list.split(", ").map(str::to_owned).collect(),
            };
            (row[0].to_owned(), known)
        })
        .collect()
}

/// Crate to the workspace's crates that it depends on, dev-dependencies left out.
fn actual() -> Graph {
    dependencies(false)
}

fn dependencies(with_tests: bool) -> Graph {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(root())
        .output()
        .unwrap();
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let names: BTreeSet<_> = packages.iter().map(|p| p["name"].as_str().unwrap().to_owned()).collect();
    packages
        .iter()
        .map(|package| {
            let dependencies = package["dependencies"].as_array().unwrap();
            let inside = dependencies
                .iter()
                .filter(|dependency| with_tests || dependency["kind"] != "dev")
                .map(|dependency| dependency["name"].as_str().unwrap().to_owned())
                .filter(|name| names.contains(name))
                .collect();
            (package["name"].as_str().unwrap().to_owned(), inside)
        })
        .collect()
}

#[test]
fn every_crate_is_in_the_table_and_knows_only_what_the_table_allows() {
    let (documented, actual) = (documented(), actual());
    let crates = |graph: &Graph| graph.keys().cloned().collect::<Vec<_>>();
    assert_eq!(crates(&documented), crates(&actual));
    for (name, known) in &actual {
        let forbidden: Vec<_> = known.difference(&documented[name]).collect();
        assert!(
            forbidden.is_empty(),
            "{name} depends on {forbidden:?}, which docs/architecture.md does not allow"
        );
    }
}

#[test]
fn the_controller_cannot_see_the_plant() {
    // The promise behind "the same controller flies the virtual and the real airframe".
    let actual = actual();
    for end in ["bench-plant", "bench-recording"] {
        assert!(!actual["bench-control"].contains(end));
    }
}

#[test]
fn the_blind_check_reaches_neither_the_plant_nor_the_diagnosis() {
    // The promise behind its scores: a diagnosis tried on its own model proves nothing. Its tests may not know them either.
    let graph = dependencies(true);
    let mut reached = BTreeSet::new();
    let mut ahead = vec!["bench-blind".to_owned()];
    while let Some(name) = ahead.pop() {
        if reached.insert(name.clone()) {
            ahead.extend(graph[&name].iter().cloned());
        }
    }
    for forbidden in ["bench-plant", "bench-diagnosis"] {
        assert!(!reached.contains(forbidden), "bench-blind reaches {forbidden} through {reached:?}");
    }
}
