//! Rust and C against the golden vectors, and the specification's examples against them.

use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

use firmware_proto::{Answer, Command};

use crate::c;
use crate::text::{Direction, transcript};

const FILES: [&str; 3] = ["host.txt", "board.txt", "rejected.txt"];

/// What the decoder is to say, and the stream it is to say it about.
#[derive(PartialEq)]
struct Record {
    lines: String,
    hex: String,
}

impl Record {
    fn stream(&self) -> Vec<u8> {
        self.hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("two digits")).collect()
    }

    fn is_one_frame(&self) -> bool {
        self.lines.lines().count() == 1 && !self.lines.contains(" rejected ")
    }

    /// What the Rust decoder says, in the record's own form.
    fn transcript(&self) -> String {
        if self.lines.starts_with(Command::SENDER) {
            transcript::<Command>(&self.stream(), self.is_one_frame())
        } else {
            transcript::<Answer>(&self.stream(), self.is_one_frame())
        }
    }
}

fn records(text: &str) -> Vec<Record> {
    let mut records = Vec::new();
    let mut lines = String::new();
    for line in text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
        if let Some(hex) = line.strip_prefix("  ") {
            records.push(Record { lines: std::mem::take(&mut lines), hex: hex.to_owned() });
        } else {
            lines += line;
            lines.push('\n');
        }
    }
    assert_eq!(lines, "", "the last record has no bytes");
    records
}

fn paths() -> [PathBuf; 3] {
    FILES.map(|file| c::package_dir().join("golden").join(file))
}

fn golden() -> Vec<Record> {
    paths().iter().flat_map(|path| records(&fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn rust_parses_and_produces_every_vector() {
    for record in golden() {
        let mut expected = record.lines.clone();
        if record.is_one_frame() {
            writeln!(expected, "  {}", record.hex).unwrap();
        }
        assert_eq!(record.transcript(), expected);
    }
}

#[test]
fn c_parses_and_produces_every_vector() {
    let summary = c::check_golden(&paths());
    for (path, line) in paths().iter().zip(summary.lines()) {
        let count = records(&fs::read_to_string(path).unwrap()).len();
        assert!(line.ends_with(&format!("{count} records, 0 failed")), "{line}");
    }
    assert_eq!(summary.lines().count(), FILES.len());
}

#[test]
fn the_specification_shows_golden_vectors_only() {
    let specification = fs::read_to_string(c::package_dir().join("../docs/protocol.md")).unwrap();
    let golden = golden();
    let examples: Vec<_> = specification
        .split("```")
        .filter_map(|block| block.strip_prefix("golden\n"))
        .flat_map(records)
        .collect();
    assert!(!examples.is_empty());
    for example in examples {
        assert!(golden.contains(&example), "not a golden vector: {}", example.lines);
    }
}
