//! The table of crates in `docs/architecture.md` is the workspace's dependency graph, and what else holds of the sources.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    process::Command,
};

use bench_plant::effects::LIBRARY;

mod constants;

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

/// All that a crate reaches, itself included.
fn reached(graph: &Graph, from: &str) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut ahead = vec![from.to_owned()];
    while let Some(name) = ahead.pop() {
        if reached.insert(name.clone()) {
            ahead.extend(graph[&name].iter().cloned());
        }
    }
    reached
}

#[test]
fn the_table_of_crates_is_the_dependency_graph() {
    let (documented, actual) = (documented(), actual());
    let crates = |graph: &Graph| graph.keys().cloned().collect::<Vec<_>>();
    assert_eq!(crates(&documented), crates(&actual));
    for (name, known) in actual.iter().filter(|(name, _)| *name != "bench") {
        assert_eq!(known, &documented[name], "{name}: its Cargo.toml, then docs/architecture.md");
    }
}

#[test]
fn what_must_not_be_known_is_not_reached_by_way_of_others_either() {
    for (from, forbidden) in [
        // The same controller flies the virtual and the real airframe.
        ("bench-control", &["bench-plant", "bench-recording"][..]),
        // No arrow back from the estimator to what is made of it.
        ("bench-filter", &["bench-inference", "bench-diagnosis"]),
        ("bench-inference", &["bench-diagnosis"]),
        ("bench-identification", &["bench-diagnosis"]),
    ] {
        let reached = reached(&actual(), from);
        for name in forbidden {
            assert!(!reached.contains(*name), "{from} reaches {name} through {reached:?}");
        }
    }
}

#[test]
fn the_blind_check_reaches_neither_the_plant_nor_the_diagnosis() {
    // The promise behind its scores: a diagnosis tried on its own model proves nothing. Its tests may not know them either.
    let reached = reached(&dependencies(true), "bench-blind");
    for forbidden in ["bench-plant", "bench-diagnosis"] {
        assert!(!reached.contains(forbidden), "bench-blind reaches {forbidden} through {reached:?}");
    }
}

#[test]
fn the_estimator_names_no_effect() {
    // What the filter, the fits and the diagnosis know of an effect stands in its row of the library.
    let names = LIBRARY.iter().map(|spec| format!("\"{}\"", spec.name)).collect::<Vec<_>>();
    for path in sources_of_the_estimator() {
        let text = std::fs::read_to_string(&path).unwrap();
        let program = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        for name in &names {
            assert!(!program.contains(name.as_str()), "{} names {name}", path.display());
        }
    }
}

/// All files of the filter, the fits and the diagnosis.
fn sources_of_the_estimator() -> Vec<PathBuf> {
    let mut files = Vec::new();
    let of = |package| root().join("crates").join(package).join("src");
    let mut folders = ["filter", "inference", "diagnosis"].map(of).to_vec();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    assert!(files.len() > 35, "the sources are there");
    files.sort();
    files
}
