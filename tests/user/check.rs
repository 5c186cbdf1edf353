//! Files checked without flying.

use std::fs;

use crate::support::{Scratch, bench, json, root, stdout};

fn rig(change: impl FnOnce(String) -> String) -> String {
    let folder = root().join("rigs");
    let text = fs::read_to_string(folder.join("virtual.toml")).unwrap();
    let airframe = folder.join("airframes/hubsan-q4.toml");
    change(text.replace("airframes/hubsan-q4.toml", airframe.to_str().unwrap()))
}

#[test]
fn all_files_of_the_project_are_sound_and_known_by_their_content() {
    let words = stdout(&bench(["check", "rigs"]).assert().success());
    for line in [
        "rigs/virtual.toml: a rig, sound",
        "rigs/airframes/hubsan-q4.toml: an airframe, sound",
        "rigs/missions/hop.toml: a mission, sound",
        "rigs/import/crazypad.toml: an import map, sound",
    ] {
        assert!(words.contains(line), "{words}");
    }
    assert!(words.lines().count() > 25 && words.lines().all(|line| line.ends_with(", sound")), "{words}");
}

#[test]
fn calibrations_and_tolerances_are_known_too() {
    let scratch = Scratch::new();
    let text = fs::read_to_string(root().join("rigs/virtual.toml")).unwrap();
    let calibration = text.split("[calibration]\n").nth(1).unwrap().replace("[calibration.", "[");
    fs::write(scratch.path("kinect.toml"), calibration).unwrap();
    fs::write(scratch.path("t.toml"), "[[tolerance]]\nfield = \"position_m.z\"\nabsolute = 0.1\n").unwrap();
    let words =
        stdout(&bench(["check", &scratch.name("kinect.toml"), &scratch.name("t.toml")]).assert().success());
    assert!(words.contains("a calibration, sound") && words.contains("a tolerance file, sound"), "{words}");

    fs::write(scratch.path("t.toml"), "[[tolerance]]\nfield = \"position_m.z\"\nabsolut = 0.1\n").unwrap();
    let words = stdout(&bench(["check", &scratch.name("t.toml")]).assert().code(2));
    assert!(words.contains("t.toml:3:") && words.contains("absolut"), "{words}");
    fs::write(scratch.path("t.toml"), "[[tolerance]]\nfield = \"positon_m.z\"\nabsolute = 0.1\n").unwrap();
    let words = stdout(&bench(["check", &scratch.name("t.toml")]).assert().code(2));
    assert!(words.contains("the closest is"), "{words}");
}

#[test]
fn every_problem_is_told_with_file_line_key_and_what_to_do() {
    let scratch = Scratch::new();
    let broken = rig(|text| {
        text.replace("resolution_m = 0.005", "resolution_mm = 5")
            .replace("ceiling_m = 2.0", "ceiling_m = -2.0")
    });
    fs::write(scratch.path("mine.toml"), &broken).unwrap();
    let name = scratch.name("mine.toml");
    let line = |key: &str| broken.lines().position(|line| line.starts_with(key)).unwrap() + 1;
    let words = stdout(&bench(["check", &name]).assert().code(2));
    for told in [
        format!("{name}: a rig, 3 problems"),
        format!(
            "{name}:{}: tracker.resolution_mm: unknown key: did you mean `resolution_m`",
            line("resolution_mm")
        ),
        format!("{name}:{}: tracker.resolution_m: missing: expected", line("[tracker]")),
        format!(
            "{name}:{}: safety.ceiling_m: -2 is out of range: expected a number above 0",
            line("ceiling_m")
        ),
    ] {
        assert!(words.contains(&told), "{told}\nin\n{words}");
    }
    let report = json(&bench(["check", &name, "rigs/virtual.toml", "--json"]).assert().code(2));
    assert_eq!(report["sound"], false);
    let [mine, other] = report["files"].as_array().unwrap().as_slice() else { panic!("two files") };
    let lines: Vec<_> =
        mine["problems"].as_array().unwrap().iter().map(|told| told["line"].clone()).collect();
    assert_eq!(lines, [line("[tracker]"), line("resolution_mm"), line("ceiling_m")]);
    assert_eq!(mine["kind"], "rig");
    assert_eq!((&other["kind"], &other["sound"]), (&"rig".into(), &true.into()));
}

#[test]
fn effects_named_files_and_contradictions_are_checked() {
    let scratch = Scratch::new();
    let name = scratch.name("mine.toml");
    let effect = "\n[[effect]]\nname = \"rotor-leg\"\n\n[[effect]]\nname = \"gusts\"\nsigma_m_s = -1.0\ncorrelation_time_s = 0.7\n";
    let cases = [
        (rig(|text| text + effect), vec!["did you mean rotor-lag", "`sigma_m_s` = -1 is out of range"]),
        (
            rig(|text| text.replace("hubsan-q4.toml", "hubsan-q5.toml")),
            vec!["mine.toml:3: airframe: cannot read"],
        ),
        (
            rig(|text| {
                text.replace("step_s = 0.001", "step_s = 0.02").replace("period_s = 0.1 ", "period_s = 0.01 ")
            }),
            vec!["step_s is longer than the loop's period_s"],
        ),
        (rig(|text| text + "\n[loop"), vec!["not valid TOML"]),
    ];
    for (text, expected) in cases {
        fs::write(&name, text).unwrap();
        let words = stdout(&bench(["check", &name]).assert().code(2));
        assert!(expected.iter().all(|told| words.contains(told)), "{expected:?} in {words}");
    }
    // The map's rig is read, and must command in the map's unit.
    let map = fs::read_to_string(root().join("rigs/import/foreign.toml")).unwrap();
    let rigs = root().join("rigs");
    for (rig, expected) in [("nosuch.toml", "cannot be read"), ("crazyflie-2.toml", "actuation")] {
        let rig = rigs.join(rig);
        fs::write(&name, map.replace("../foreign.toml", rig.to_str().unwrap())).unwrap();
        let words = stdout(&bench(["check", &name]).assert().code(2));
        assert!(words.contains(expected), "{words}");
    }
}

#[test]
fn recordings_are_read_to_the_end() {
    let scratch = Scratch::new();
    let whole = scratch.fly("whole.mcap", &[]);
    let bytes = fs::read(&whole).unwrap();
    let words = stdout(&bench(["check", &whole]).assert().success());
    assert_eq!(words, format!("{whole}: a recording, sound\n"));

    fs::write(scratch.path("cut.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    let words = stdout(&bench(["check", &scratch.name("cut.mcap")]).assert().code(3));
    assert!(words.contains("was not closed") && words.contains("bench recover"), "{words}");

    let mut damaged = bytes.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0xff;
    fs::write(scratch.path("damaged.mcap"), damaged).unwrap();
    let report = json(&bench(["check", &whole, &scratch.name("damaged.mcap"), "--json"]).assert().code(3));
    let [sound, damaged] = report["files"].as_array().unwrap().as_slice() else { panic!("two files") };
    assert_eq!(
        (&sound["sound"], &damaged["sound"], &damaged["data_lost"]),
        (&true.into(), &false.into(), &true.into())
    );
    assert_eq!(damaged["kind"], "recording");

    // What came back of the cut one is whole, and says what it is.
    let back = scratch.name("back.mcap");
    bench(["recover", &scratch.name("cut.mcap"), "-o", &back]).assert().code(3);
    let words = stdout(&bench(["check", &back]).assert().success());
    assert!(words.contains("sound") && words.contains("note: it was recovered"), "{words}");
}

#[test]
fn what_is_no_file_of_the_bench_gets_advice() {
    let scratch = Scratch::new();
    let foreign = mcap_from_elsewhere();
    let cases: [(&str, &[u8], &str); 9] = [
        ("log.csv", b"time_s,z_m\n0,0\n", "bench import"),
        ("readings.csv", b"# balance\nthrottle;thrust\n1;2\n", "bench identify"),
        ("sheet.xlsx", b"PK\x03\x04\x14\0\0\0", "CSV"),
        ("px4.ulg", b"ULog\x01\x12\x35\x01", "ULog"),
        ("out.json", b"{ \"schema\": \"bench.sim/1\" }", "bench schema"),
        ("other.mcap", &foreign, "bench import"),
        ("empty.toml", b"", "is empty"),
        ("other.toml", b"[package]\nedition = \"2024\"\n", "no file of the bench"),
        ("name.toml", b"name = \"x\"\n", "--as"),
    ];
    for (name, bytes, advice) in cases {
        fs::write(scratch.path(name), bytes).unwrap();
        let words = stdout(&bench(["check", &scratch.name(name)]).assert().code(2));
        assert!(words.contains(name) && words.contains(advice), "{words}");
    }
    let words = stdout(&bench(["check", &scratch.name("absent.toml")]).assert().code(2));
    assert!(words.contains("no such file"), "{words}");
    let words = stdout(&bench(["check", "--as", "mission", &scratch.name("name.toml")]).assert().code(2));
    assert!(words.contains("a mission, 2 problems") && words.contains("phase: missing"), "{words}");
    let report = json(&bench(["check", &scratch.name("log.csv"), "--json"]).assert().code(2));
    assert_eq!(report["files"][0]["kind"], serde_json::Value::Null);
    fs::create_dir(scratch.path("none")).unwrap();
    bench(["check", &scratch.name("none")]).assert().code(2);
}

/// An MCAP file without a session of the bench: no records but header, data end and footer.
fn mcap_from_elsewhere() -> Vec<u8> {
    const MAGIC: &[u8] = b"\x89MCAP0\r\n";
    let record = |opcode: u8, body: &[u8]| [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat();
    [MAGIC, &record(0x01, &[0; 8]), &record(0x0f, &[0; 4]), &record(0x02, &[0; 20]), MAGIC].concat()
}
