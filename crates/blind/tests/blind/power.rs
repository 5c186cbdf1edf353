//! What flights can show, against what must be so.

use std::path::Path;

use crate::common::rig;
use bench_blind::{BlindError, Power, PowerPlan, power};
use bench_rig::Mission;

fn held(name: &str, altitude_m: &str) -> Mission {
    let text = format!(
        "name = \"{name}\"\ndescription = \"{name}\"\n[[phase]]\nkind = \"launch\"\nthrust_to_weight = 1.12\n\
         duration_s = 0.8\n[[phase]]\nkind = \"hold\"\naltitude_m = {altitude_m}\nduration_s = 12.0\n"
    );
    Mission::read(Path::new("test.toml"), &text).unwrap()
}

fn plan(missions: Vec<Mission>, effects: &[&str]) -> PowerPlan {
    let effects = effects.iter().map(|&effect| effect.to_owned()).collect();
    PowerPlan { rig: rig(), missions, effects, draws: 2, seed: 3 }
}

fn shown(missions: Vec<Mission>, effects: &[&str]) -> Power {
    power(&plan(missions, effects), |_| {}).unwrap()
}

#[test]
fn a_mission_shows_what_acts_where_it_flies() {
    let missions = vec![
        held("low", "[[0.0, 0.3], [3.0, 0.3], [5.0, 0.03]]"),
        held("high", "[[0.0, 0.6], [3.0, 0.6], [4.0, 0.9]]"),
    ];
    let power = shown(missions, &["ground-effect-shape", "ceiling-effect"]);
    let best = |effect: &str| {
        let forms = power.forms.iter().filter(|form| form.effect == effect);
        forms.map(|form| form.best_mission).collect::<Vec<_>>()
    };
    assert_eq!(best("ceiling-effect"), [Some(1), Some(1)]);
    assert_eq!(best("ground-effect-shape"), [Some(0), Some(0)]);
    for form in power.forms.iter().filter(|form| form.effect == "ceiling-effect") {
        // The ceiling hangs at 0.75 m or higher: its gain at 0.3 m is a twentieth of that at 0.7 m or less.
        let [low, high] = [0, 1].map(|mission| form.by_mission[mission][1].size.unwrap_or(f64::INFINITY));
        assert!(low > 4.0 * high, "{form:?}");
        // More flights never show less.
        assert!(form.seen_from[1].size.unwrap_or(f64::INFINITY) <= 1.001 * high, "{form:?}");
    }
    for form in power.forms.iter().filter(|form| form.effect == "ground-effect-shape") {
        // Up high it shows while the airframe rises through it and never again.
        let [low, high] = [0, 1].map(|mission| form.by_mission[mission][0].size.unwrap_or(f64::INFINITY));
        assert!(low < 0.7 * high, "{low} {high}");
    }
    // What acts at the floor is not taken for what acts at the ceiling.
    assert!(power.groups.is_empty(), "{:?}", power.groups);
}

#[test]
fn lags_between_command_and_sight_are_one_group() {
    let steps = held("steps", "[[0.0, 0.3], [4.0, 0.3], [4.0, 0.6], [8.0, 0.6], [8.0, 0.35]]");
    let power = shown(vec![steps], &["tracker-latency", "actuator-lag", "quadratic-drag"]);
    let groups: Vec<_> = power.groups.iter().map(|group| group.effects.join(" ")).collect();
    assert_eq!(groups, ["actuator-lag tracker-latency"], "{:?}", power.cosines);
    // They differ by less than can be seen; drag is another matter.
    assert!(power.groups[0].apart_with_all < 2.0, "{:?}", power.groups);
}

#[test]
fn thresholds_lie_on_the_curve_and_the_same_seed_gives_the_same() {
    let steps = || vec![held("steps", "[[0.0, 0.3], [4.0, 0.3], [4.0, 0.6]]")];
    let one = shown(steps(), &["tracker-latency"]);
    for form in &one.forms {
        for seen in &form.seen_from {
            let Some(size) = seen.size.filter(|_| !seen.or_weaker) else { continue };
            let below = form.curve.iter().filter(|point| point.size < 0.99 * size);
            let above = form.curve.iter().filter(|point| point.size > 1.01 * size);
            assert!(below.clone().all(|point| point.low < seen.detectability), "{form:?}");
            assert!(above.clone().all(|point| point.high > seen.detectability), "{form:?}");
            assert!(seen.low <= seen.size && seen.size <= seen.high);
        }
    }
    assert_eq!(one, shown(steps(), &["tracker-latency"]));
}

#[test]
fn a_limit_is_seen_up_to_where_it_bites_and_not_beyond() {
    let steps = held("steps", "[[0.0, 0.3], [4.0, 0.3], [4.0, 0.6]]");
    let power = shown(vec![steps], &["actuator-saturation"]);
    for form in &power.forms {
        assert!(form.stronger_when_small);
        let (weakest, strongest) = (form.curve[0], form.curve[form.curve.len() - 1]);
        assert!(weakest.size > strongest.size && strongest.detectability > 5.0, "{form:?}");
        // The launch asks for 12 % above the weight: a limit above that cuts little, one far below it much.
        let size = form.seen_from[1].size.unwrap();
        assert!((0.08..0.22).contains(&size), "{form:?}");
    }
}

#[test]
fn what_cannot_be_asked_is_refused_with_what_can() {
    let steps = || vec![held("steps", "0.3")];
    let refused = |plan: PowerPlan| match power(&plan, |_| {}) {
        Err(BlindError::Power { detail }) => detail,
        other => panic!("{other:?}"),
    };
    let words = refused(plan(steps(), &["rotor-leg"]));
    assert!(words.contains("rotor-leg") && words.contains("rotor-lag"), "{words}");
    assert!(refused(plan(Vec::new(), &[])).contains("no mission"));
    assert!(refused(PowerPlan { draws: 0, ..plan(steps(), &[]) }).contains("1 to 99"));
}
