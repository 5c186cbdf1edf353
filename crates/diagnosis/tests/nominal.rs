//! What the model gets wrong alike in flights that were fine is no gap, and where a log begins is no matter.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Calibration, Diagnosis, Fold, Gain, Verdict, held_out};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use bench_recording::Flight;
use bench_rig::Rig;
use support::rig;

use flown::fly;

/// Flights of an airframe with an effect, as the rig without it sees them.
fn flights(effects: &[&str], first_seed: u64) -> Vec<Flight> {
    let mut real = rig();
    real.effects.extend(effects.iter().map(|effect| parse_effect(effect).unwrap()));
    let missions = ["climb-040", "hop", "steps"];
    missions.into_iter().zip(first_seed..).map(|(mission, seed)| fly(&real, mission, seed)).collect()
}

fn tracks(flights: &[Flight], rig: &Rig) -> Vec<Track> {
    flights.iter().enumerate().map(|(i, f)| Track::from_flight(&format!("{i}"), f, rig).unwrap()).collect()
}

fn diagnosed(flights: &[Flight], rig: &Rig) -> Diagnosis {
    let tracks = tracks(flights, rig);
    Diagnosis::of(&Problem::new(&tracks, rig), &Calibration::built_in())
}

#[test]
fn what_nominal_flights_gain_is_no_gap_and_what_is_beyond_is() {
    const WRONG_IN_BOTH: &str = "quadratic-drag:coefficient_n_s2_per_m2=0.03";
    let mut rig = rig();
    let nominal = flights(&[WRONG_IN_BOTH], 1);
    let tracks = tracks(&nominal, &rig);
    let fold = Fold::of(&Problem::new(&tracks, &rig), &Calibration::built_in());
    assert_eq!((fold.leading.as_str(), fold.is_none()), ("quadratic-drag", false));
    rig.held_out = held_out(&[fold]);
    // The same in other flights is what the model gets wrong.
    let same = diagnosed(&flights(&[WRONG_IN_BOTH], 11), &rig);
    assert_eq!(same.verdict, Verdict::None, "{:?}", same.candidates.first());
    // A lag is none of it.
    let other = diagnosed(&flights(&[WRONG_IN_BOTH, "rotor-lag:time_constant_s=0.15"], 21), &rig);
    assert_eq!(other.verdict, Verdict::Effect);
    assert!(other.effects.iter().any(|effect| effect.ends_with("-lag")), "{:?}", other.effects);
}

#[test]
fn what_is_held_out_reads_back() {
    let mut rig = rig();
    let fold = |hypothesis: &str, gain: f64, measurements: usize| Fold {
        flights: vec!["a".to_owned()],
        measurements,
        leading: hypothesis.to_owned(),
        probability: 0.5,
        gains: [hypothesis.to_owned(), format!("{hypothesis}+gusts")]
            .map(|hypothesis| Gain { hypothesis, nats: gain })
            .to_vec(),
    };
    // The most of any block; a pair that gains no more than what it is made of is not told.
    rig.held_out =
        held_out(&[fold("updraft", 20.0, 200), fold("updraft", 20.0, 400), fold("unknown", 8.0, 100)]);
    let told: Vec<(&str, f64)> =
        rig.held_out.iter().map(|told| (told.hypothesis.as_str(), told.nats_per_measurement)).collect();
    assert_eq!(told, [("updraft", 0.1), ("unknown", 0.08)]);
    let again = Rig::read(std::path::Path::new("rig.toml"), &rig.to_toml()).unwrap();
    assert_eq!(again.held_out, rig.held_out);
}

/// A log of a flight that begins so late, s.
fn from(flight: &Flight, begin_s: f64) -> Flight {
    let mut cut = flight.clone();
    cut.commands.retain(|record| record.time.seconds() >= begin_s);
    cut.readbacks.retain(|record| record.time.seconds() >= begin_s);
    cut.ticks.retain(|record| record.started.seconds() >= begin_s);
    cut.positions.retain(|record| record.arrived_at.seconds() >= begin_s);
    cut
}

#[test]
fn logs_that_begin_aloft_say_what_whole_ones_say() {
    let rig = rig();
    // The missions hold their altitude from some 6 s on.
    for begin_s in [6.0, 9.0] {
        for (effects, first_seed) in [(&[] as &[&str], 1), (&["rotor-lag:time_constant_s=0.2"], 31)] {
            let whole = flights(effects, first_seed);
            let cut: Vec<Flight> = whole.iter().map(|flight| from(flight, begin_s)).collect();
            let begins_aloft = tracks(&cut, &rig).iter().map(|track| track.begins_aloft).collect::<Vec<_>>();
            assert_eq!(begins_aloft, [true; 3]);
            let found = diagnosed(&cut, &rig);
            let lags =
                found.effects.iter().all(|effect| effect.contains("lag") || effect.contains("latency"));
            let right = if effects.is_empty() { found.verdict == Verdict::None } else { lags };
            assert!(right, "from {begin_s} s on, {effects:?}: {} {:.2}", found.leading, found.confidence);
        }
    }
    assert!(tracks(&flights(&[], 1), &rig).iter().all(|track| !track.begins_aloft));
}
