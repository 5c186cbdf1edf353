use std::fs;

use crate::support::{Scratch, bench, json, refused, root, stdout, unclosed};

#[test]
fn the_first_command_flies_passes_and_records() {
    let scratch = Scratch::new();
    let out = scratch.name("climb.mcap");
    let words = stdout(&bench(["sim", "-o", &out]).assert().success());
    assert!(words.contains("climb-040 with hubsan-q4 on rig virtual, seed 0"), "{words}");
    assert!(words.contains("passed  rms_error_max_m"), "{words}");
    let info = json(&bench(["info", &out, "--json"]).assert().success());
    assert_eq!(info["mode"], "sim");
    assert_eq!(info["seed"], 0);
    assert_eq!(info["rig"], "virtual");
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let scratch = Scratch::new();
    for arguments in [
        ["--mission", "climb-040"],
        ["--mission", "hold-3d"],
        ["--effect", "gusts:sigma_m_s=0.02,correlation_time_s=1"],
    ] {
        let first = fs::read(scratch.fly("a.mcap", &arguments)).unwrap();
        let again = fs::read(scratch.fly("b.mcap", &arguments)).unwrap();
        assert!(first == again, "two runs of {arguments:?} differ");
    }
    let first = fs::read(scratch.fly("a.mcap", &[])).unwrap();
    let other = fs::read(scratch.fly("c.mcap", &["--seed", "1"])).unwrap();
    assert!(first != other);
}

#[test]
fn effects_in_the_examples_of_the_help_are_ones_that_fly() {
    let scratch = Scratch::new();
    let out = scratch.name("f.mcap");
    let mut tried = 0;
    for arguments in [&["sim", "--help"][..], &["effects", "--help"], &["effects", "rotor-lag"], &["--help"]]
    {
        let words = stdout(&bench(arguments).assert().success());
        for example in words.lines().filter(|line| line.trim_start().starts_with("bench sim")) {
            let Some((_, after)) = example.split_once("--effect ") else { continue };
            let effect = after.split_whitespace().next().unwrap();
            let run = bench(["sim", "--effect", effect, "-o", &out, "--force"]).output().unwrap();
            // Whether the criteria are met (0) or missed (1) is the effect's matter.
            assert!(matches!(run.status.code(), Some(0 | 1)), "{example}: {run:?}");
            tried += 1;
        }
    }
    assert!(tried > 0);
}

#[test]
fn an_effect_may_leave_out_its_form_but_not_its_size() {
    let scratch = Scratch::new();
    let fly = |effect: &str| fs::read(scratch.fly("f.mcap", &["--effect", effect])).unwrap();
    let plain = fly("rotor-lag:time_constant_s=0.05");
    let given = fly("rotor-lag:time_constant_s=0.05,fall_ratio=2");
    assert!(plain != given);
    let words = refused(bench(["sim", "--effect", "rotor-lag:fall_ratio=2"]), 2);
    assert!(words.contains("effect rotor-lag needs `time_constant_s`"), "{words}");
}

#[test]
fn every_mission_of_the_rig_passes_its_own_criteria() {
    let scratch = Scratch::new();
    for mission in ["climb-040", "hop", "steps", "low-hover", "hold-3d"] {
        for seed in ["0", "1", "2"] {
            let out = scratch.name(&format!("{mission}-{seed}.mcap"));
            let result = json(
                &bench(["sim", "--mission", mission, "--seed", seed, "-o", &out, "--json"])
                    .assert()
                    .success(),
            );
            assert_eq!(result["passed"], true, "{result}");
        }
    }
}

#[test]
fn missed_criteria_are_exit_code_1_and_a_safety_stop_is_4() {
    let scratch = Scratch::new();
    let out = scratch.name("f.mcap");
    // A third of the thrust gone: it never leaves the ground effect.
    let weak = ["sim", "-o", &out, "--force", "--effect", "thrust-loss:fraction=0.35", "--json"];
    let result = json(&bench(weak).assert().code(1));
    assert_eq!(result["passed"], false);

    let rig = fs::read_to_string(root().join("rigs/virtual.toml")).unwrap();
    let airframe = root().join("rigs/airframes/hubsan-q4.toml");
    let rig = rig
        .replace("airframes/hubsan-q4.toml", airframe.to_str().unwrap())
        .replace("ceiling_m = 2.0", "ceiling_m = 0.3");
    fs::write(scratch.path("low.toml"), rig).unwrap();
    let mission = root().join("rigs/missions/climb-040.toml");
    let stopped = ["--rig", &scratch.name("low.toml"), "--mission", mission.to_str().unwrap()];
    let result = json(&bench(["sim", "-o", &out, "--force", "--json"]).args(stopped).assert().code(4));
    assert_eq!(result["ending"], "stopped");
    assert!(result["reason"].as_str().unwrap().contains("ceiling of 0.3 m"), "{result}");
    // The recording is whole, and says so itself.
    let events = scratch.name("events.csv");
    bench(["export", &out, "-o", &events, "--channel", "/bench/event"]).assert().success();
    assert!(fs::read_to_string(&events).unwrap().contains("ceiling"));
}

#[test]
fn an_effect_changes_the_flight_and_is_kept_in_the_recording() {
    let scratch = Scratch::new();
    let out = scratch.name("sag.mcap");
    let arguments = ["sim", "-o", &out, "--json", "--effect", "mass-change:fraction=0.05"];
    let result = json(&bench(arguments).assert());
    assert_eq!(result["effects"][0]["parameters"]["fraction"], 0.05);
    let plain = json(&bench(["sim", "-o", &scratch.name("p.mcap"), "--json"]).assert().success());
    assert_ne!(result["summary"]["peak_m"], plain["summary"]["peak_m"]);
}

#[test]
fn the_effects_are_listed_with_their_laws() {
    let listed = json(&bench(["effects", "--json"]).assert().success());
    let names: Vec<_> = listed["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["name"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(names.len(), 26);
    let words = stdout(&bench(["effects", "rotor-lag"]).assert().success());
    assert!(words.contains("time_constant_s") && words.contains("source"), "{words}");
    // Every example that the list gives flies.
    let scratch = Scratch::new();
    for effect in listed["effects"].as_array().unwrap() {
        let example = effect["example"].as_str().unwrap();
        let code = bench(["sim", "-o", &scratch.name("x.mcap"), "--force", "--effect", example])
            .assert()
            .get_output()
            .status
            .code();
        assert!(matches!(code, Some(0 | 1 | 4)), "{example}: {code:?}");
    }
}

#[test]
fn wrong_words_are_refused_with_what_to_do() {
    let scratch = Scratch::new();
    let out = scratch.name("x.mcap");
    let cases: [(&[&str], &str); 8] = [
        (&["--mission", "loop"], "climb-040, ground-hover, hold-3d, hop, low-hover, steps"),
        (&["--rig", "none.toml"], "none.toml"),
        (&["--effect", "rotor-lak:time_constant_s=1"], "rotor-lag"),
        (&["--effect", "rotor-lag"], "time_constant_s"),
        (&["--effect", "rotor-lag:tau=1"], "no parameter `tau`"),
        (&["--effect", "rotor-lag:time_constant_s=99"], "out of range"),
        (&["--effect", "rotor-lag:time_constant_s=fast"], "NAME:param=value"),
        (&["--effect", "rotor-lag:time_constant_s=nan"], "out of range"),
    ];
    for (arguments, expected) in cases {
        let mut command = bench(["sim", "-o", &out]);
        command.args(arguments);
        let words = refused(command, 2);
        assert!(words.contains(expected), "{arguments:?}: {words}");
        assert!(!scratch.path("x.mcap").exists(), "{arguments:?} left a recording");
    }
}

#[test]
fn a_rig_with_a_wrong_key_is_refused_with_file_line_and_key() {
    let scratch = Scratch::new();
    let rig = fs::read_to_string(root().join("rigs/virtual.toml")).unwrap();
    let airframe = root().join("rigs/airframes/hubsan-q4.toml");
    let rig = rig
        .replace("airframes/hubsan-q4.toml", airframe.to_str().unwrap())
        .replace("period_s = 0.1 ", "period_ms = 100 ");
    fs::write(scratch.path("wrong.toml"), rig).unwrap();
    let words = refused(
        bench(["sim", "--rig", &scratch.name("wrong.toml"), "--mission", "rigs/missions/hop.toml"]),
        2,
    );
    assert!(words.contains("wrong.toml:11: unknown key `loop.period_ms`"), "{words}");
}

#[test]
fn an_output_that_cannot_be_written_is_one_clear_error() {
    let words = refused(bench(["sim", "-o", "/proc/none/x.mcap"]), 2);
    assert!(words.contains("/proc/none"), "{words}");
}

#[test]
fn nothing_is_replaced_unless_told_to() {
    let scratch = Scratch::new();
    let notes = scratch.path("notes.mcap");
    fs::write(&notes, "not a recording").unwrap();
    let words = refused(bench(["sim", "-o", notes.to_str().unwrap()]), 2);
    assert!(words.contains("--force"), "{words}");
    assert_eq!(fs::read_to_string(&notes).unwrap(), "not a recording");
    bench(["sim", "-o", notes.to_str().unwrap(), "--force"]).assert().success();
    let flown = fs::read(&notes).unwrap();
    let words = refused(bench(["sim", "-o", notes.to_str().unwrap(), "--seed", "4"]), 2);
    assert!(words.contains("exists"), "{words}");
    assert!(fs::read(&notes).unwrap() == flown);
}

#[test]
fn flights_that_differ_are_recorded_under_names_that_differ() {
    let scratch = Scratch::new();
    let fly = |arguments: &[&str]| {
        let mut command = bench(["sim", "--mission", "hop"]);
        command.args(arguments).current_dir(scratch.path(""));
        command
    };
    let lag = ["--effect", "rotor-lag:time_constant_s=0.08"];
    for arguments in [&[][..], &["--seed", "1"], &["--model", "vertical"], &lag, &["--rig", "loopback"]] {
        fly(arguments).assert().code(vec![0, 1]);
    }
    let mut names: Vec<String> = fs::read_dir(scratch.path("recordings"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "loopback_hop_seed0.mcap",
            "virtual_hop_model=vertical_seed0.mcap",
            "virtual_hop_rotor-lag-time_constant_s=0.08_seed0.mcap",
            "virtual_hop_seed0.mcap",
            "virtual_hop_seed1.mcap",
        ]
    );
    assert!(refused(fly(&[]), 2).contains("--force"));
}

#[test]
fn a_disk_that_fills_up_is_told_and_leaves_nothing_that_claims_to_be_whole() {
    let scratch = Scratch::new();
    let out = scratch.name("full.mcap");
    // A file-size limit of 16 blocks of 512 bytes stands for a full disk: the recording needs more.
    let output = std::process::Command::new("sh")
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 16; exec \"$0\" sim -o \"$1\"",
            env!("CARGO_BIN_EXE_bench"),
            &out,
        ])
        .current_dir(root())
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(words.contains("not all of it recorded") && words.contains("full.mcap"), "{words}");
    unclosed(&out);
}
