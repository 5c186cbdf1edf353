//! Laws that nominal flights obey are found to belong to the model, and none where the rig has them all.

#[path = "support/flown.rs"]
mod flown;

use bench_identification::identify_nominal;
use bench_plant::effects::parse_effect;

use flown::{MISSIONS, fly, tracks, virtual_rig};

#[test]
fn a_law_that_nominal_flights_obey_belongs_to_the_model() {
    let prior = virtual_rig();
    let mut real = prior.clone();
    real.effects.push(parse_effect("quadratic-drag:coefficient_n_s2_per_m2=0.02").unwrap());
    let found = identify_nominal(&tracks(&fly(&real, 0..5, &MISSIONS), &prior), &prior).unwrap();
    let names: Vec<&str> = found.laws.iter().map(|law| law.name.as_str()).collect();
    assert_eq!(names, ["quadratic-drag"], "{:?}", found.laws);
    assert!(found.laws[0].held_out_gain > 3.0);
    // The rig lists it, so that flights held against the rig have it.
    let listed: Vec<&str> = found.rig.effects.iter().map(|effect| effect.name.as_str()).collect();
    assert_eq!(listed, names);
}

#[test]
fn no_law_is_added_to_a_model_that_has_them_all() {
    let prior = virtual_rig();
    let found = identify_nominal(&tracks(&fly(&prior, 0..5, &MISSIONS), &prior), &prior).unwrap();
    assert_eq!(found.laws, []);
    assert_eq!(found.rig.effects, []);
}
