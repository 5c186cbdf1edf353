//! Recordings as viewers open them.

use std::{collections::BTreeSet, env, fs, path::Path, process::Command};

use bench_recording::{Channel, ViewerChannel};
use serde_json::Value;

use crate::support::{Scratch, bench, conforms, json, root, stdout};

#[test]
fn an_epoch_moves_what_viewers_see_and_no_figure_of_the_flight() {
    let scratch = Scratch::new();
    let plain = scratch.fly("plain.mcap", &["--mission", "hop"]);
    let [moved, again] = ["moved.mcap", "again.mcap"]
        .map(|file| scratch.fly(file, &["--mission", "hop", "--epoch", "1700000000.5"]));
    assert!(fs::read(&moved).unwrap() == fs::read(again).unwrap(), "two runs differ");
    let info = |file: &str| json(&bench(["info", file, "--json"]).assert().success());
    let (with, without) = (info(&moved), info(&plain));
    conforms(&with);
    assert_eq!(
        (&with["epoch_unix_s"], &without["epoch_unix_s"]),
        (&Value::from(1_700_000_000.5), &Value::Null)
    );
    for key in ["first_time_s", "last_time_s", "duration_s", "messages"] {
        assert_eq!(with[key], without[key], "{key}");
    }
    let words = stdout(&bench(["diff", &plain, &moved, "--exact"]).assert().success());
    assert!(words.starts_with("same"), "{words}");
    bench(["check", &moved]).assert().success();
}

/// Every string of a layout that begins as a topic does.
fn topics(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::String(text) if text.starts_with('/') => _ = found.insert(text.clone()),
        Value::Array(items) => items.iter().for_each(|item| topics(item, found)),
        Value::Object(entries) => {
            found.extend(entries.keys().filter(|key| key.starts_with('/')).cloned());
            entries.values().for_each(|value| topics(value, found));
        }
        _ => {}
    }
}

#[test]
fn the_layout_names_channels_and_fields_that_there_are() {
    let text = fs::read_to_string(root().join("docs/viewing/foxglove.json")).unwrap();
    let mut found = BTreeSet::new();
    topics(&serde_json::from_str(&text).unwrap(), &mut found);
    assert!(found.len() > 10, "{found:?}");
    let known = |name: &str| {
        let (topic, field) = name.split_once('.').map_or((name, None), |(topic, field)| (topic, Some(field)));
        match (Channel::from_topic(topic), field) {
            (Some(channel), Some(name)) => channel.fields().iter().any(|field| field.name == name),
            (Some(_), None) => true,
            (None, _) => ViewerChannel::ALL.iter().any(|channel| channel.topic() == name),
        }
    };
    let unknown: Vec<_> = found.iter().filter(|name| !known(name)).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}

/// The viewers' own readers: Foxglove's schemas decode each message, Rerun knows poses, images and cameras for what they are.
#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_viewers_open_a_flight_with_its_views() {
    let python =
        env::var_os("BENCH_PYTHON").expect("BENCH_PYTHON names a Python with foxglove-sdk and rerun-sdk");
    let scratch = Scratch::new();
    let arguments = ["--mission", "hop", "--frames", "--record-views", "2", "--epoch", "1700000000"];
    let flight = scratch.fly("views.mcap", &arguments);
    let plain = scratch.fly("plain.mcap", &["--mission", "hop", "--frames"]);
    let words = stdout(&bench(["diff", &plain, &flight, "--exact"]).assert().success());
    assert!(words.starts_with("same"), "{words}");

    let script: &Path = &root().join("crates/recording/tests/python_viewers.py");
    let output = Command::new(python)
        .arg(script)
        .arg(&flight)
        .args([scratch.path(""), root().join("docs/viewing/rerun_view.py")])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (foxglove, rerun) = (&seen["foxglove"], &seen["rerun"]);
    assert_eq!(foxglove["unknown"], Value::Array(Vec::new()));
    let count = |topic: &str| foxglove["counts"][topic].as_u64().unwrap_or(0);
    // Some ten seconds of flight.
    let (poses, images) = (count("/plant/pose"), count("/camera/full"));
    assert!(poses > 200 && (18..=30).contains(&images), "{poses} poses, {images} images");
    assert_eq!([count("/scene"), count("/tf_static"), count("/camera/calibration")], [1; 3]);
    let full = &foxglove["first"]["/camera/full"];
    assert_eq!(full["schema"], "foxglove.CompressedImage");
    // A PNG in base 64.
    assert!(full["fields"]["data"].as_str().unwrap().starts_with("iVBORw0KGgo"));
    let at = full["log_time"].as_u64().unwrap();
    assert!((1_700_000_000_000_000_000..1_700_000_001_000_000_000).contains(&at), "{at}");
    let rows = |entity: &str, component: &str| rerun[entity][component].as_u64().unwrap_or(0);
    assert_eq!(rows("/plant/pose", "InstancePoses3D:translations"), poses);
    assert_eq!(rows("/tf", "Transform3D:translation"), count("/tf"));
    for view in ["/camera/full", "/camera/red", "/camera/depth"] {
        assert_eq!(rows(view, "EncodedImage:blob"), images, "{view}");
    }
    assert_eq!(rows("/tf_static", "Transform3D:quaternion"), 2);
    assert_eq!(rows("/camera/calibration", "Pinhole:image_from_camera"), 1);
    assert_eq!(rows("/bench/event", "TextLog:text"), count("/bench/event"));
    // The scene is drawn by our script: floor and ceiling where they are, airframe and marker where the airframe is.
    let script = &seen["script"];
    for entity in ["floor/cubes", "ceiling/cubes", "airframe/cubes", "airframe/cylinders", "marker/cubes"] {
        let drawn = &script[format!("/room/{entity}")];
        assert_eq!(drawn["CoordinateFrame:frame"], 1, "{entity}: {drawn}");
    }
    assert_eq!(script["/tf"], rerun["/tf"], "all else is there as well");
}
