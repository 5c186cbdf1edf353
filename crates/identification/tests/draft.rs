//! A rig drafted from flights alone comes near the rig that flew them, and says of each number what it was drawn from.

use std::path::Path;

use bench_identification::{Draft, DraftError, Known, Source};
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{
    Actuation, Mission, Model, Rig, Uncertain,
    visit::{self, Node, Value},
};
use bench_run::simulate;

fn rigs() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn flown(rig: &Rig, missions: &[&str]) -> Vec<(String, Flight)> {
    let fly = |(seed, mission): (usize, &&str)| {
        let plan = Mission::load(rigs().join("missions").join(mission).with_extension("toml")).unwrap();
        let mut records: Vec<Record> = Vec::new();
        simulate(rig, &plan, seed as u64, &mut records, |_| true).unwrap();
        ((*mission).to_owned(), Flight::from_records(Session::new(Mode::Import), records))
    };
    missions.iter().enumerate().map(fly).collect()
}

fn known(actuation: Actuation) -> Known {
    Known { name: "draft".to_owned(), actuation, mass_kg: None, arm_m: None }
}

fn vertical() -> Rig {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    rig
}

const MISSIONS: [&str; 4] = ["hop", "climb-040", "steps", "low-hover"];

fn within(found: Uncertain, truth: f64, name: &str) {
    assert!((found.value - truth).abs() <= 2.0 * found.sigma, "{name}: {found:?}, and it is {truth}");
}

#[test]
fn what_flights_tell_is_near_the_rig_that_flew_them() {
    // Whatever the lag between throttle and thrust, and the place where thrust begins.
    for (offset_v, latency_s) in [(0.5, 0.3), (0.9, 0.2)] {
        let mut real = vertical();
        let hover_v = real.airframe.throttle_for(real.airframe.weight_n());
        real.airframe.thrust.offset = Uncertain::exact(offset_v);
        real.airframe.thrust.gain_n_per_unit =
            Uncertain::exact(real.airframe.weight_n() / (hover_v - offset_v));
        real.tracker.latency_s.value = latency_s;
        let rig = Draft::of(&flown(&real, &MISSIONS), &known(Actuation::Volt)).unwrap().rig;
        let a = &rig.airframe;
        within(a.thrust.offset, offset_v, "offset");
        within(rig.tracker.latency_s, latency_s, "latency");
        let hover = Uncertain { value: a.throttle_for(a.weight_n()), sigma: a.thrust.hover_sigma.unwrap() };
        within(hover, hover_v, "hover");
        assert!(
            (rig.control_loop.period_s - 0.1).abs() < 1e-9 && rig.tracker.resolution_m == 0.005,
            "{rig:?}"
        );
        assert!((rig.tracker.frame_period_s - 1.0 / 30.0).abs() < 1e-4, "{rig:?}");
        // Of 0.002 m; rounding to 0.005 m hides some of it where the airframe hovers.
        assert!((0.0003..0.004).contains(&rig.tracker.noise_m), "{rig:?}");
    }
}

fn numbers(prefix: &str, node: &Node, out: &mut Vec<String>) {
    let Value::Table(entries) = &node.value else { panic!("a table") };
    let is_number = |entries: &[(String, Node)]| entries.iter().any(|(key, _)| key == "sigma");
    for (key, node) in entries {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match &node.value {
            Value::Table(inner) if !is_number(inner) => numbers(&path, node, out),
            Value::Text(_) => {}
            _ => out.push(path),
        }
    }
}

#[test]
fn every_number_says_what_it_was_drawn_from() {
    let flights = flown(&vertical(), &MISSIONS);
    for (mass_kg, actuation) in
        [(None, Actuation::Volt), (Some((0.015, "a balance".to_owned())), Actuation::Fraction)]
    {
        let draft = Draft::of(&flights, &Known { mass_kg: mass_kg.clone(), ..known(actuation) }).unwrap();
        let text = draft.to_toml("drafted");
        let read = Rig::read(Path::new("draft.toml"), &text).unwrap();
        assert_eq!(read, draft.rig);
        let mut there = Vec::new();
        numbers("", &visit::parse(Path::new("draft.toml"), &text).unwrap(), &mut there);
        let told: Vec<String> = draft.numbers().into_iter().map(|(note, _)| note.key).collect();
        assert_eq!(there, told);
        let comments = text.lines().filter(|line| line.starts_with("# ")).count();
        assert_eq!(comments, 1 + told.len());
        let mass = draft.notes.iter().find(|note| note.key == "airframe.mass_kg").unwrap();
        assert_eq!(mass.from, if mass_kg.is_some() { Source::Told } else { Source::Guess });
    }
}

#[test]
fn flights_that_tell_nothing_are_refused() {
    let drafted = |flights: &[(String, Flight)]| Draft::of(flights, &known(Actuation::Volt)).map(|_| ());
    let whole = flown(&vertical(), &["hop"]);
    let with = |change: &dyn Fn(&mut Flight)| {
        let mut flights = whole.clone();
        change(&mut flights[0].1);
        drafted(&flights).unwrap_err()
    };
    assert!(matches!(with(&|flight| flight.commands.clear()), DraftError::NoThrottle { .. }));
    assert!(matches!(with(&|flight| flight.positions.truncate(20)), DraftError::TooShort { .. }));
    assert_eq!(drafted(&[]).unwrap_err(), DraftError::NoFlights);
    let carried =
        with(&|flight| flight.commands.iter_mut().for_each(|command| command.sticks.throttle = 0.0));
    assert!(matches!(carried, DraftError::NoLift { .. }), "{carried}");
    let still = with(&|flight| flight.positions.iter_mut().for_each(|position| position.position_m[2] = 0.0));
    assert!(matches!(still, DraftError::NeverFlew { .. }), "{still}");
    let high = with(&|flight| flight.positions.iter_mut().for_each(|position| position.position_m[2] *= 1e5));
    assert!(matches!(high, DraftError::Altitude { .. }), "{high}");
}

#[test]
fn a_throttle_that_hardly_varies_leaves_wide_tolerances_and_says_so() {
    // A climb, as if the throttle had nothing to do with it.
    let mut flights = flown(&vertical(), &["climb-040"]);
    for command in &mut flights[0].1.commands {
        command.sticks.throttle = 1.9;
    }
    let draft = Draft::of(&flights, &known(Actuation::Volt)).unwrap();
    let note = |key: &str| draft.notes.iter().find(|note| note.key == key).unwrap().from;
    assert_eq!(note("airframe.thrust.offset_v"), Source::Guess);
    assert_eq!(note("tracker.latency_s"), Source::Guess);
    assert!(draft.rig.airframe.thrust.offset.sigma > 0.2);
}
