//! The paper's figures 11 and 15, as properties of the true state.

use crate::support::{Scratch, bench};

/// Time and altitude of the true state, s and m.
fn truth(mission: &str, seed: u64) -> Vec<(f64, f64)> {
    let scratch = Scratch::new();
    let flight = scratch.name("f.mcap");
    bench(["sim", "--mission", mission, "--seed", &seed.to_string(), "-o", &flight]).assert().success();
    let table = scratch.name("truth.csv");
    bench(["export", &flight, "-o", &table, "--channel", "/plant/truth"]).assert().success();
    let mut reader = csv::Reader::from_path(&table).unwrap();
    let columns = reader.headers().unwrap().clone();
    let column = |name: &str| {
        columns.iter().position(|c| c == name).unwrap_or_else(|| panic!("no column {name} in {columns:?}"))
    };
    let (time, altitude) = (column("time_s"), column("position_m_z"));
    reader
        .records()
        .map(|row| row.unwrap())
        .map(|row| (row[time].parse().unwrap(), row[altitude].parse().unwrap()))
        .collect()
}

/// The highest and the following lowest altitude.
fn peak_and_trough(flight: &[(f64, f64)]) -> ((f64, f64), (f64, f64)) {
    let turns: Vec<_> = flight
        .windows(3)
        .filter(|w| w[1].1 > 0.01 && (w[1].1 - w[0].1) * (w[2].1 - w[1].1) < 0.0)
        .map(|w| w[1])
        .collect();
    (turns[0], turns[1])
}

#[test]
fn figure_11_a_fixed_throttle_hops_and_rebounds_before_it_touches() {
    for seed in 0..3 {
        let flight = truth("hop", seed);
        let (peak, trough) = peak_and_trough(&flight);
        // Launched out of the ground effect (5 cm), back into it, and up again above the ground.
        assert!(peak.1 > 0.1, "{peak:?}");
        assert!(trough.1 > 0.0 && trough.1 < 0.05, "{trough:?}");
        let after: f64 = flight.iter().filter(|(t, _)| *t > trough.0).map(|(_, z)| *z).fold(0.0, f64::max);
        assert!(after > trough.1 + 0.02, "rebounds from {trough:?} to {after}");
        assert!(after < peak.1, "each hop is lower than the last");
    }
}

#[test]
fn figure_15_a_climb_overshoots_loses_momentum_and_is_caught_at_40_cm() {
    for seed in 0..3 {
        let flight = truth("climb-040", seed);
        let speed = |t0: f64, t1: f64| {
            flight
                .windows(2)
                .filter(|w| w[0].0 >= t0 && w[1].0 <= t1)
                .map(|w| (w[1].1 - w[0].1) / (w[1].0 - w[0].0))
                .fold(f64::MIN, f64::max)
        };
        // The ground effect throws it up within the launch; then the momentum is lost.
        let launch = speed(1.0, 1.7);
        assert!(launch > 0.5, "{launch} m/s");
        assert!(speed(2.5, 6.0) < 0.5 * launch);
        let peak = flight.iter().map(|(_, z)| *z).fold(0.0, f64::max);
        assert!(peak > 0.41 && peak < 0.6, "{peak} m");
        let hold: Vec<f64> =
            flight.iter().filter(|(t, _)| (12.0..18.5).contains(t)).map(|(_, z)| *z).collect();
        let mean = hold.iter().sum::<f64>() / hold.len() as f64;
        assert!((mean - 0.4).abs() < 0.02, "held at {mean} m");
        let worst = hold.iter().map(|z| (z - 0.4).abs()).fold(0.0, f64::max);
        let rms = (hold.iter().map(|z| (z - 0.4).powi(2)).sum::<f64>() / hold.len() as f64).sqrt();
        assert!(rms < 0.02 && worst < 0.04, "rms {rms} m, worst {worst} m");
    }
}
