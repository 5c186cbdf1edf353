//! What the people who write rig and mission files rely on.

use std::path::{Path, PathBuf};

use bench_rig::{FeedForward, Mission, PhaseAction, Predictor, Problem, Profile, Rig, RigError};

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn virtual_rig_text() -> String {
    std::fs::read_to_string(rigs().join("virtual.toml")).unwrap()
}

/// Reads the virtual rig with one line replaced, which must fail.
fn problems_with(old: &str, new: &str) -> Vec<Problem> {
    let text = virtual_rig_text();
    assert!(text.contains(old), "{old:?} is gone from the rig");
    match Rig::read(&rigs().join("virtual.toml"), &text.replace(old, new)) {
        Err(RigError::Invalid(problems)) => problems,
        other => panic!("expected problems, got {other:?}"),
    }
}

#[test]
fn every_committed_rig_and_mission_reads_and_survives_being_written() {
    let rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    assert_eq!(rig.airframe.name, "hubsan-q4");
    assert_eq!(rig.airframe.mass_kg.sigma, 0.00015);
    assert_eq!(Rig::read(Path::new("copy.toml"), &rig.to_toml()).unwrap(), rig);

    let loopback = Rig::load(rigs().join("loopback.toml")).unwrap();
    assert_eq!(loopback.bench, bench_rig::Bench::Loopback);
    assert_eq!(Rig::read(Path::new("copy.toml"), &loopback.to_toml()).unwrap(), loopback);

    let mut missions = 0;
    let mut folders = vec![rigs().join("missions")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    for path in files {
        let mission = Mission::load(&path).unwrap();
        // A number before the name gives an order.
        assert!(path.file_stem().unwrap().to_str().unwrap().ends_with(&mission.name));
        assert_eq!(Mission::read(Path::new("copy.toml"), &mission.to_toml()).unwrap(), mission);
        missions += 1;
    }
    assert!(missions >= 5);
}

#[test]
fn the_hover_throttle_is_the_papers() {
    let airframe = Rig::load(rigs().join("virtual.toml")).unwrap().airframe;
    assert!((airframe.throttle_for(airframe.weight_n()) - 1.90).abs() < 0.005);
    assert_eq!(airframe.ground_effect(0.0), 1.3);
    assert_eq!(airframe.ground_effect(0.05), 1.0);
    assert_eq!(airframe.thrust_n(0.2), 0.0);
}

#[test]
fn a_wrong_unit_is_told_with_file_line_key_and_the_right_key() {
    let problems = problems_with("resolution_m = 0.005", "resolution_mm = 5");
    let words: Vec<_> = problems.iter().map(ToString::to_string).collect();
    let unknown = words.iter().find(|w| w.contains("resolution_mm")).expect("the unknown key is named");
    assert!(unknown.contains("virtual.toml:"), "{unknown}");
    assert!(unknown.contains("did you mean `resolution_m`"), "{unknown}");
    assert!(words.iter().any(|w| w.contains("key `tracker.resolution_m` is missing")), "{words:?}");
}

#[test]
fn lines_are_those_of_the_file() {
    let line = virtual_rig_text().lines().position(|line| line.starts_with("bits")).unwrap() + 1;
    match problems_with("bits = 8 ", "bits = 8.5 ").as_slice() {
        [Problem::Contradiction { at, key, .. }] => {
            assert_eq!((at.line, key.as_str()), (line, "output.bits"));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn wrong_range_type_choice_and_missing_keys_are_told_all_at_once() {
    let text = virtual_rig_text()
        .replace("dropout_probability = 0.002", "dropout_probability = 2")
        .replace("model = \"six-degree\"", "model = \"seven-degree\"")
        .replace("period_s = 0.1 ", "period_s = \"0.1\" ")
        .replace("ceiling_m = 2.0", "");
    let Err(RigError::Invalid(problems)) = Rig::read(&rigs().join("virtual.toml"), &text) else { panic!() };
    assert_eq!(problems.len(), 4, "{problems:?}");
    assert!(matches!(&problems[0], Problem::WrongType { key, .. } if key == "plant.model"));
    assert!(matches!(&problems[1], Problem::WrongType { key, .. } if key == "loop.period_s"));
    assert!(matches!(&problems[2], Problem::OutOfRange { key, .. } if key == "tracker.dropout_probability"));
    assert!(matches!(&problems[3], Problem::MissingKey { key, .. } if key == "safety.ceiling_m"));
}

#[test]
fn nan_and_infinity_are_out_of_range() {
    for absurd in ["nan", "inf", "-inf", "1e300"] {
        let problems = problems_with("noise_m = 0.002", &format!("noise_m = {absurd}"));
        assert!(matches!(problems.as_slice(), [Problem::OutOfRange { .. }]), "{absurd}: {problems:?}");
    }
}

#[test]
fn missing_files_and_broken_toml_are_told() {
    let missing = Rig::load("no/such.toml").unwrap_err().to_string();
    assert!(missing.contains("no/such.toml"), "{missing}");
    let airframe = problems_with("airframes/hubsan-q4.toml", "airframes/none.toml");
    assert!(airframe[0].to_string().contains("airframes/none.toml"), "{}", airframe[0]);
    let broken = Rig::read(Path::new("r.toml"), "name = \"x\"\n[loop\n").unwrap_err().to_string();
    assert!(broken.starts_with("r.toml:2: not valid TOML"), "{broken}");
    assert!(Rig::read(Path::new("r.toml"), "").is_err());
}

#[test]
fn an_airframe_that_cannot_hover_is_a_contradiction() {
    let text = Rig::load(rigs().join("virtual.toml")).unwrap().to_toml();
    let heavy = text.replace("mass_kg = { value = 0.015,", "mass_kg = { value = 15.0,");
    let error = Rig::read(Path::new("r.toml"), &heavy).unwrap_err().to_string();
    assert!(error.contains("outside the sticks"), "{error}");
}

#[test]
fn effects_keep_their_place() {
    let text = virtual_rig_text() + "\n[[effect]]\nname = \"rotor-lag\"\ntime_constant_s = 0.05\n";
    let rig = Rig::read(&rigs().join("virtual.toml"), &text).unwrap();
    let line = text.lines().count();
    assert_eq!(rig.effects[0].name, "rotor-lag");
    assert_eq!(rig.effects[0].parameters, [("time_constant_s".to_owned(), 0.05, line)]);
    let again = Rig::read(Path::new("copy.toml"), &rig.to_toml()).unwrap();
    assert_eq!(again.effects[0].parameters[0].1, 0.05);
}

#[test]
fn a_mission_phase_takes_only_its_own_keys() {
    let text =
        "name = \"m\"\ndescription = \"d\"\n[[phase]]\nkind = \"idle\"\nduration_s = 1\naltitude_m = 1\n";
    let error = Mission::read(Path::new("m.toml"), text).unwrap_err().to_string();
    assert!(error.contains("m.toml:6: unknown key `phase.altitude_m`"), "{error}");
    assert!(Mission::read(Path::new("m.toml"), "name = \"m\"\ndescription = \"d\"\n").is_err());
}

#[test]
fn a_profile_steps_ramps_and_holds() {
    let text = "name = \"m\"\ndescription = \"d\"\n[[phase]]\nkind = \"hold\"\nduration_s = 9\n\
                altitude_m = [[1, 0.4], [3, 0.8], [3, 0.2]]\n";
    let mission = Mission::read(Path::new("m.toml"), text).unwrap();
    let PhaseAction::Hold { altitude_m, x_m, .. } = &mission.phases[0].action else { panic!() };
    assert_eq!([0.0, 1.0, 3.0, 99.0].map(|t| altitude_m.at(t)), [0.4, 0.4, 0.2, 0.2]);
    assert!((altitude_m.at(2.0) - 0.6).abs() < 1e-12);
    assert_eq!(*x_m, Profile::constant(0.0));
    let falling = text.replace("[3, 0.8]", "[0, 0.8]");
    assert!(Mission::read(Path::new("m.toml"), &falling).is_err());
}

#[test]
fn what_disturbs_a_flight_is_optional_and_reads_back() {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    assert!(!rig.to_toml().contains("disturbance"));
    rig.disturbance.trim_m_s2 = Some(0.1);
    rig.disturbance.noise_spread_ln = Some(0.4);
    rig.airframe.thrust.hover_sigma = Some(0.02);
    let text = rig.to_toml();
    assert!(
        text.contains("[disturbance]\ntrim_m_s2 = 0.1\n") && text.contains("hover_sigma_v = 0.02"),
        "{text}"
    );
    assert_eq!(Rig::read(Path::new("copy.toml"), &text).unwrap(), rig);
}

#[test]
fn the_laws_are_chosen_by_key_and_the_papers_are_meant_where_none_is_named() {
    let rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    assert_eq!((rig.control.predictor, rig.control.feed_forward), (Predictor::Linear, FeedForward::Weight));
    // Recordings carry this text: what is not asked for leaves it as it was.
    let text = rig.to_toml();
    assert!(!text.contains("predictor") && !text.contains("feed_forward") && !text.contains("observer"));

    let chosen = "[control]\npredictor = \"model\"\nfeed_forward = \"ground-effect\"\n\
                  observer_white_m_s2_per_root_hz = 0.03\nobserver_drift_m_s2_per_root_s = 0.1\n";
    let read = |chosen: &str| {
        Rig::read(&rigs().join("virtual.toml"), &virtual_rig_text().replace("[control]\n", chosen))
    };
    let model = read(chosen).unwrap();
    assert_eq!(
        (model.control.predictor, model.control.feed_forward),
        (Predictor::Model, FeedForward::GroundEffect)
    );
    assert_eq!(model.control.observer.drift_m_s2_per_root_s, 0.1);
    assert_eq!(Rig::read(Path::new("copy.toml"), &model.to_toml()).unwrap(), model);

    // Its numbers may stay beside the linear predictor, but must be there for the model's.
    let kept = read(&chosen.replace("\"model\"", "\"linear\"")).unwrap();
    assert_eq!(kept.control.observer.white_m_s2_per_root_hz, 0.03);
    assert_eq!(Rig::read(Path::new("copy.toml"), &kept.to_toml()).unwrap(), kept);
    let missing = read("[control]\npredictor = \"model\"\n").unwrap_err().to_string();
    assert!(missing.contains("control.observer_white_m_s2_per_root_hz` is missing"), "{missing}");
    let wrong = read("[control]\npredictor = \"magic\"\n").unwrap_err().to_string();
    assert!(wrong.contains("one of \"linear\", \"model\""), "{wrong}");
}
