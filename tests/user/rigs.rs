//! The files that are built in: found in any folder, copied with what they name, and never over a file of the user's.

use std::fs;

use crate::support::{Scratch, bench, json, refused, stdout};

fn in_empty_folder(scratch: &Scratch, arguments: &[&str]) -> assert_cmd::Command {
    let mut command = bench(arguments);
    command.current_dir(scratch.path(""));
    command
}

#[test]
fn everything_that_is_listed_can_be_copied_and_used() {
    let scratch = Scratch::new();
    let listed = json(&in_empty_folder(&scratch, &["rigs", "--json"]).assert().success());
    let words = stdout(&in_empty_folder(&scratch, &["rigs"]).assert().success());
    for file in listed["files"].as_array().unwrap() {
        let [kind, name] = ["kind", "name"].map(|key| file[key].as_str().unwrap());
        assert!(words.contains(name), "{name} is not in {words}");
        in_empty_folder(&scratch, &["rigs", "copy", name, "--force"]).assert().success();
        if kind == "rig" {
            // By the copy and by its name it is the same rig, and the same flight.
            let (copy, by_copy, by_name) =
                (format!("{name}.toml"), format!("{name}-copy.mcap"), format!("{name}.mcap"));
            for (rig, output) in [(copy.as_str(), &by_copy), (name, &by_name)] {
                in_empty_folder(&scratch, &["sim", "--rig", rig, "--mission", "hop", "-o", output])
                    .assert()
                    .code(vec![0, 1, 4]);
            }
            assert!(
                fs::read(scratch.path(&by_copy)).unwrap() == fs::read(scratch.path(&by_name)).unwrap(),
                "{name}"
            );
        }
    }
}

#[test]
fn a_copy_never_replaces_what_is_there() {
    let scratch = Scratch::new();
    in_empty_folder(&scratch, &["rigs", "copy", "virtual"]).assert().success();
    // The same once more changes nothing, and is no error.
    in_empty_folder(&scratch, &["rigs", "copy", "virtual"]).assert().success();
    let mine = "# mine\n";
    fs::write(scratch.path("airframes/hubsan-q4.toml"), mine).unwrap();
    let words = refused(in_empty_folder(&scratch, &["rigs", "copy", "loopback"]), 2);
    assert!(words.contains("airframes/hubsan-q4.toml exists") && words.contains("--force"), "{words}");
    assert!(!scratch.path("loopback.toml").exists(), "half a rig was written");
    assert_eq!(fs::read_to_string(scratch.path("airframes/hubsan-q4.toml")).unwrap(), mine);
}

#[test]
fn a_file_wins_over_a_name_of_the_library() {
    let scratch = Scratch::new();
    in_empty_folder(&scratch, &["rigs", "copy", "loopback", "-o", "virtual"]).assert().success();
    let words = stdout(&in_empty_folder(&scratch, &["sim", "--rig", "virtual", "--mission", "hop"]).assert());
    assert!(words.contains("on rig loopback"), "{words}");
}
