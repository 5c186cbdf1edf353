//! Colours on the terminal: only where they are wanted, and never in data.

use crate::support::{Scratch, bench};

/// How every colour on a terminal begins.
const ESCAPE: &str = "\u{1b}[";

/// Standard output and standard error of a command that ends with `code`, with and without colours asked for.
fn said(arguments: &[&str], variables: &[(&str, &str)], code: i32) -> [String; 2] {
    let mut command = bench(arguments);
    for name in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE"] {
        command.env_remove(name);
    }
    let assert = command.envs(variables.iter().copied()).assert().code(code);
    let output = assert.get_output();
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8(bytes.clone()).unwrap())
}

#[test]
fn colours_are_for_terminals_or_where_they_are_asked_for() {
    let scratch = Scratch::new();
    let (a, b) = (scratch.fly("a.mcap", &["--seed", "1"]), scratch.fly("b.mcap", &["--seed", "2"]));
    let diff = ["diff", &a, &b, "--exact"];
    let [plain, _] = said(&diff, &[], 1);
    assert!(plain.starts_with("differ: ") && !plain.contains(ESCAPE), "{plain}");

    let force = [("CLICOLOR_FORCE", "1")];
    let [coloured, _] = said(&diff, &force, 1);
    assert!(coloured.starts_with(ESCAPE) && coloured.contains("differ: "), "{coloured}");
    // Without its colours it says the same.
    let bare: String = coloured
        .split(ESCAPE)
        .enumerate()
        .map(|(i, part)| if i == 0 { part } else { part.split_once('m').unwrap().1 })
        .collect();
    assert_eq!(bare, plain);

    let [json, _] = said(&["diff", &a, &b, "--exact", "--json"], &force, 1);
    assert!(!json.contains(ESCAPE), "{json}");
    let [_, error] = said(&["diff", &a, "none.mcap"], &force, 2);
    assert!(error.starts_with(ESCAPE) && error.contains("error"), "{error}");
    for variables in [&[("NO_COLOR", "1")][..], &[("CLICOLOR", "0")]] {
        let [_, error] = said(&["diff", &a, "none.mcap"], variables, 2);
        assert!(error.starts_with("error: "), "{error}");
    }
    // Wrong usage, which is told before any command begins.
    assert!(said(&["diff", "--wrong"], &force, 2)[1].contains(ESCAPE));
    assert!(!said(&["diff", "--wrong"], &[], 2)[1].contains(ESCAPE));
}
