use std::{fmt::Write as _, fs};

use crate::support::{Scratch, bench, json, refused, root, stdout};

#[test]
fn a_flight_by_rendered_frames_passes_repeats_and_is_drawn() {
    let scratch = Scratch::new();
    let (out, views) = (scratch.name("f.mcap"), scratch.name("views"));
    let arguments = ["sim", "--frames", "--mission", "hop", "--json", "-o", &out];
    let result = json(&bench(arguments).args(["--views", &views, "--views-every", "100"]).assert().success());
    assert_eq!(result["passed"], true, "{result}");
    let (frames, found) =
        (result["tracking"]["frames"].as_u64().unwrap(), result["tracking"]["found"].as_u64().unwrap());
    // All but the first, which is not believed, and 0.5 % (the goal for clear frames).
    assert!(found + 1 + frames / 200 >= frames, "{found} of {frames}");
    let mut drawn: Vec<_> = fs::read_dir(&views)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    drawn.sort();
    assert_eq!(drawn[..3], ["frame-000000-depth.png", "frame-000000-full.png", "frame-000000-red.png"]);
    assert_eq!(drawn.len() as u64, 3 * frames.div_ceil(100));

    let first = fs::read(&out).unwrap();
    bench(arguments).arg("--force").assert().success();
    assert!(first == fs::read(&out).unwrap(), "two runs differ");
    let words = stdout(&bench(["info", &out]).assert().success());
    assert!(words.contains("rendered frames"), "{words}");
    // Rendered and positions-only flights differ, and diff says so.
    let plain = scratch.fly("plain.mcap", &["--mission", "hop"]);
    bench(["diff", &plain, &out]).assert().code(1);
}

#[test]
fn frames_are_recorded_tracked_and_calibrated_from() {
    let scratch = Scratch::new();
    let table = scratch.path("places.csv");
    let mut text = String::from("folder,x_m,y_m,z_m\n");
    for (number, (x, y, z)) in [
        (-0.9, -0.2, 0.4),
        (-0.8, 0.2, 0.8),
        (-0.2, 0.4, 0.3),
        (0.0, -0.5, 0.9),
        (0.5, 0.5, 1.0),
        (0.6, -0.4, 0.3),
        (0.9, 0.0, 0.6),
    ]
    .into_iter()
    .enumerate()
    {
        writeln!(text, "p{number},{x},{y},{z}").unwrap();
    }
    fs::write(&table, text).unwrap();
    let table = table.to_str().unwrap();
    let recorded = json(
        &bench(["record-frames", "--positions", table, "--bare", "--frames", "7", "--json"])
            .assert()
            .success(),
    );
    assert_eq!(recorded["folders"].as_array().unwrap().len(), 7);
    let tracked = json(&bench(["track", &scratch.name("p3"), "--json"]).assert().success());
    assert_eq!(tracked["tracking"]["found"], 6, "{tracked}");
    assert_eq!(tracked["positions"][0]["status"], "lost");
    let y = tracked["positions"][6]["position_m"][1].as_f64().unwrap();
    assert!((y + 0.5).abs() < 0.005, "{y}");

    let (out, rig) = (scratch.name("k.toml"), scratch.path("rig.toml"));
    let result =
        json(&bench(["calibrate", table, "-o", &out, "--latency-s", "0.3", "--json"]).assert().success());
    assert_eq!(result["met"], true, "{result}");
    // The rig names the file, above its tables.
    let text = fs::read_to_string(root().join("rigs/virtual.toml")).unwrap();
    let airframe = root().join("rigs/airframes/hubsan-q4.toml");
    let text = text
        .split("\n[calibration]")
        .next()
        .unwrap()
        .replace("airframes/hubsan-q4.toml", airframe.to_str().unwrap());
    let with_file = text.replacen("name = \"virtual\"", "name = \"virtual\"\ncalibration = \"k.toml\"", 1);
    fs::write(&rig, &with_file).unwrap();
    let rig = rig.to_str().unwrap();
    bench(["track", &scratch.name("p3"), "--rig", rig]).assert().success();

    fs::write(rig, with_file.replace("value = 0.3,", "value = 0.25,")).unwrap();
    let words = refused(bench(["track", &scratch.name("p3"), "--rig", rig]), 2);
    assert!(words.contains("k.toml:1") && words.contains("measured 0.3 s"), "{words}");
    fs::write(rig, text).unwrap();
    let words = refused(bench(["track", &scratch.name("p3"), "--rig", rig]), 2);
    assert!(words.contains("has no calibration"), "{words}");
}

#[test]
fn wrong_frames_are_refused_with_what_to_do() {
    let scratch = Scratch::new();
    let words = refused(bench(["sim", "--frames", "--mission", "hold-3d", "-o", &scratch.name("x.mcap")]), 2);
    assert!(words.contains("turns the heading"), "{words}");
    assert!(!scratch.path("x.mcap").exists());
    let words = refused(bench(["track", &scratch.name("none")]), 2);
    assert!(words.contains("INDEX.txt"), "{words}");
    fs::write(scratch.path("INDEX.txt"), "r-1.0-1.ppm\nd-1.0-2.pgm\n").unwrap();
    let words = refused(bench(["track", &scratch.name(""), "--rig", "virtual"]), 2);
    assert!(words.contains("INDEX.txt:1: r-1.0-1.ppm cannot be read"), "{words}");
    fs::write(scratch.path("few.csv"), "folder,x_m,y_m,z_m\n").unwrap();
    let words = refused(bench(["calibrate", &scratch.name("few.csv"), "-o", &scratch.name("k.toml")]), 2);
    assert!(words.contains("at least 6"), "{words}");
}

/// Effects on the tracker, put into the frames, and what of them is found. Wrong places that are far off do not pass the tracker's gates:
/// those come out as lost frames.
#[test]
fn what_is_wrong_with_the_frames_is_diagnosed_and_nothing_where_nothing_is() {
    let cases = [
        (None, None),
        (Some("tracker-latency:extra_s=0.06"), Some("tracker-latency")),
        (Some("tracker-jitter:sigma_s=0.01"), Some("tracker-jitter")),
        (Some("tracker-scale:scale_error=0.08,bias_m=0.01"), Some("tracker-scale")),
        (Some("tracker-noise:sigma_m=0.006"), Some("tracker-noise")),
        (Some("tracker-dropout:probability=0.1,mean_burst_frames=4"), Some("tracker-dropout")),
        (Some("tracker-outliers:probability=0.03,sigma_m=0.15"), Some("tracker-outliers")),
    ];
    for (effect, expected) in cases {
        let scratch = Scratch::new();
        let flights: Vec<String> = ["climb-040", "steps", "low-hover", "hop"]
            .iter()
            .map(|mission| {
                let flight = scratch.name(&format!("{mission}.mcap"));
                let mut command = bench(["sim", "--frames", "--mission", mission, "-o", &flight]);
                command.args(effect.iter().flat_map(|effect| ["--effect", effect]));
                // A mission's criteria are not what is asked here.
                command.assert().code(vec![0, 1]);
                flight
            })
            .collect();
        let mut command =
            bench(["diagnose", "--rig", "rigs/virtual.toml", "--json", "--min-confidence", "0"]);
        let report = json(&command.args(&flights).assert().success());
        let named: Vec<&str> =
            report["effects"].as_array().unwrap().iter().filter_map(|name| name.as_str()).collect();
        match expected {
            Some(expected) => assert!(named.contains(&expected), "{effect:?}: {named:?}"),
            None => assert_eq!(report["verdict"], "none", "{named:?}"),
        }
    }
}

#[test]
fn a_flight_by_frames_differs_from_one_by_positions_in_what_the_tracker_says() {
    let scratch = Scratch::new();
    let (frames, positions) = (scratch.name("frames.mcap"), scratch.name("positions.mcap"));
    bench(["sim", "--frames", "-o", &frames]).assert().success();
    bench(["sim", "-o", &positions]).assert().success();
    let report = json(&bench(["diff", &frames, &positions, "--json"]).assert().code(vec![0, 1]));
    let fields = report["fields"].as_array().unwrap();
    let rms = |channel: &str| {
        let z = fields.iter().find(|f| f["channel"] == channel && f["field"] == "position_m.z").unwrap();
        z["difference"]["rms"].as_f64().unwrap()
    };
    // The same airframe on the same mission; steps of 5 mm and 2 mm of noise on one side, a fraction of that on the other.
    assert!(rms("/tracker/position") < 0.03 && rms("/plant/truth") < 0.03, "{report}");
    assert!(rms("/tracker/position") > 0.001, "{report}");
}
