use crate::support::{Scratch, bench, refused};

fn stderr(mut command: assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stderr.clone()).unwrap()
}

#[test]
fn short_work_tells_nothing_and_notes_are_silenced() {
    let scratch = Scratch::new();
    let sim = |name: &str, more: &[&str]| {
        let mut command = bench(["sim", "--mission", "hop", "-o", &scratch.name(&format!("{name}.mcap"))]);
        command.args(more);
        stderr(command)
    };
    assert_eq!(sim("plain", &[]), "", "work under ten seconds");
    let noted = sim("noted", &["--export", &scratch.name("noted.csv")]);
    assert!(noted.contains("exported") && noted.contains("noted.csv"), "{noted}");
    assert_eq!(sim("quiet", &["--quiet", "--export", &scratch.name("quiet.csv")]), "");
    // It stands before the command as well.
    let copy = ["--quiet", "rigs", "copy", "missions/hop", "-o", &scratch.name("hop.toml")];
    assert_eq!(stderr(bench(copy)), "");
    assert!(scratch.path("hop.toml").exists());
}

#[test]
fn warnings_and_errors_are_told_all_the_same() {
    let scratch = Scratch::new();
    let flight = scratch.fly("whole.mcap", &["--mission", "hop"]);
    let bytes = std::fs::read(&flight).unwrap();
    std::fs::write(scratch.path("cut.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    let told = bench(["--quiet", "info", &scratch.name("cut.mcap")]).assert().code(3);
    assert!(String::from_utf8_lossy(&told.get_output().stderr).contains("warning: "));
    assert!(refused(bench(["--quiet", "info", &scratch.name("absent.mcap")]), 2).contains("absent.mcap"));
}
