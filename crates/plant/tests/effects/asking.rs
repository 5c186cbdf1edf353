//! Effects as people ask for them: what is wrong is told with its place and what to write instead.

use std::path::Path;

use bench_plant::effects::{EffectError, Effects, LIBRARY, parse_effect};
use bench_rig::{Model, Rig};

use crate::bench::rig;

/// Reads a rig file with these lines at its end; the first of them is line 201.
fn ask(lines: &str) -> Result<Effects, EffectError> {
    let mut text = rig(Model::Vertical).to_toml();
    let padding = 200 - text.lines().count();
    text += &"\n".repeat(padding);
    text += lines;
    Effects::from_rig(&Rig::read(Path::new("rigs/mine.toml"), &text).unwrap(), 1)
}

fn complaint(lines: &str) -> String {
    ask(lines).err().expect("a complaint").to_string()
}

#[test]
fn an_effect_of_a_rig_file_acts() {
    let effects = ask("[[effect]]\nname = \"rotor-lag\"\ntime_constant_s = 0.05\n").unwrap();
    assert_eq!(effects.propulsion.len(), 1);
}

#[test]
fn an_unknown_effect_is_pointed_at_with_the_nearest_name() {
    let text = complaint("[[effect]]\nname = \"rotr-lag\"\ntime_constant_s = 0.05\n");
    assert!(text.contains("rigs/mine.toml:201") && text.contains("did you mean rotor-lag?"), "{text}");
    let text = complaint("[[effect]]\nname = \"zzz\"\n");
    assert!(LIBRARY.iter().all(|spec| text.contains(spec.name)), "{text}");
}

#[test]
fn an_unknown_parameter_is_pointed_at_with_how_to_write_it() {
    let text = complaint("[[effect]]\nname = \"rotor-lag\"\ntime_constant_s = 0.05\ntau = 1\n");
    assert!(text.contains("rigs/mine.toml:204") && text.contains("`tau`"), "{text}");
    assert!(text.contains("rotor-lag:time_constant_s=0.05"), "{text}");
}

#[test]
fn a_missing_parameter_is_named_with_meaning_and_unit() {
    let text = complaint("[[effect]]\nname = \"battery-load\"\nsag = 0.05\n");
    assert!(text.contains("rigs/mine.toml:201") && text.contains("`time_constant_s`"), "{text}");
    assert!(text.contains("time constant of sag and recovery, s"), "{text}");
}

#[test]
fn a_value_out_of_range_is_told_with_the_range() {
    let text = complaint("[[effect]]\nname = \"thrust-loss\"\nfraction = 5\n");
    assert!(text.contains("rigs/mine.toml:203") && text.ends_with("expected -0.5 to 0.9"), "{text}");
    let text = complaint("[[effect]]\nname = \"updraft\"\nspeed_m_s = 50\n");
    assert!(text.ends_with("expected -20 to 20 m/s"), "{text}");
}

#[test]
fn an_effect_asked_for_twice_is_refused() {
    let one = "[[effect]]\nname = \"thrust-loss\"\nfraction = 0.1\n";
    let text = complaint(&format!("{one}{one}"));
    assert!(text.contains("rigs/mine.toml:204") && text.contains("thrust-loss is given twice"), "{text}");
}

#[test]
fn the_example_of_every_effect_can_be_asked_for_on_the_command_line() {
    for spec in LIBRARY.iter() {
        let mut rig = rig(Model::Vertical);
        rig.effects.push(parse_effect(&spec.example()).unwrap());
        assert!(Effects::from_rig(&rig, 1).is_ok(), "{}", spec.example());
    }
}

#[test]
fn what_is_no_effect_on_the_command_line_is_refused() {
    assert!(matches!(parse_effect("rotor-lag:time_constant_s"), Err(EffectError::Syntax { .. })));
    assert!(matches!(parse_effect("rotor-lag:time_constant_s=fast"), Err(EffectError::Syntax { .. })));
    for text in ["rotor-lag:time_constant_s=NaN", "rotor-lag:time_constant_s=inf"] {
        let mut rig = rig(Model::Vertical);
        rig.effects.push(parse_effect(text).unwrap());
        assert!(matches!(Effects::from_rig(&rig, 1), Err(EffectError::OutOfRange { .. })), "{text}");
    }
    let mut rig = rig(Model::Vertical);
    rig.effects.push(parse_effect("thrust-loss:fraction=0.1,fraction=0.2").unwrap());
    assert!(matches!(Effects::from_rig(&rig, 1), Err(EffectError::Repeated { .. })));
}
