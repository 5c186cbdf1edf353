//! Thrust at static altitudes: multiplier and boundary are found with intervals that hold, laws are told apart, and readings
//! that tell nothing are refused in words.

use std::{fmt::Write as _, path::Path};

use bench_identification::{
    GroundIdentification, IdentifyError, Law, Readings, ThrustOptions, identify_ground_effect,
};
use bench_plant::{
    balance::HeldAirframe,
    effects::{Effects, parse_effect},
};
use bench_rig::{GRAVITY_M_S2, Rig};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

fn rig() -> Rig {
    Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
}

fn identify(text: &str, with_shape: bool) -> Result<GroundIdentification, IdentifyError> {
    let rig = rig();
    let readings = Readings::read(Path::new("ground.csv"), text, &rig)?;
    identify_ground_effect(&readings, &rig, &ThrustOptions::default(), with_shape)
}

const ALTITUDES_MM: [f64; 12] = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 120.0];

/// Three throttles at twelve altitudes, twice, and rest; one reading in fifteen is off.
fn table(law: Law, multiplier: f64, length_m: f64, noise_g: f64, seed: u64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut out = String::from("throttle_v,altitude_mm,reading_g\n");
    let mut row = |throttle: f64, altitude_mm: f64, thrust_g: f64| {
        let noise: f64 = rng.sample(StandardNormal);
        let mut shown = 21.37 - thrust_g + noise_g * noise;
        if rng.random::<f64>() < 1.0 / 15.0 {
            shown += 1.0 + 3.0 * rng.random::<f64>();
        }
        let _ = writeln!(out, "{throttle},{altitude_mm},{shown:.1}");
    };
    for _ in 0..9 {
        row(0.0, 120.0, 0.0);
    }
    for throttle in [1.7, 1.9, 2.1] {
        for altitude_mm in ALTITUDES_MM {
            for _ in 0..2 {
                let free_g = 0.1051 * (throttle - 0.5) * 1000.0 / GRAVITY_M_S2;
                row(throttle, altitude_mm, free_g * law.ratio(0.001 * altitude_mm, multiplier, length_m));
            }
        }
    }
    out
}

#[test]
fn intervals_of_95_percent_hold_in_500_draws() {
    let draws = 500;
    let mut inside = [0_u32; 2];
    for seed in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(7_000_000 + seed);
        let truth = [1.2 + 0.2 * rng.random::<f64>(), 0.04 + 0.02 * rng.random::<f64>()];
        let found = identify(&table(Law::Linear, truth[0], truth[1], 0.1, seed), false).unwrap();
        for ((count, truth), number) in inside.iter_mut().zip(truth).zip(&found.numbers) {
            *count += u32::from((number.interval_95[0]..=number.interval_95[1]).contains(&truth));
        }
    }
    let share = inside.map(|count| f64::from(count) / draws as f64);
    for (name, count) in ["multiplier", "boundary"].iter().zip(inside) {
        println!("coverage | {name}: noise 0.1 g | {count} | {draws}");
    }
    // Three deviations of a binomial share.
    let three = 3.0 * (0.95 * 0.05 / draws as f64).sqrt();
    assert!(share.iter().all(|share| (share - 0.95).abs() < three), "{share:?}");
}

#[test]
fn each_law_is_preferred_on_its_own_readings() {
    for (law, multiplier, length_m) in
        [(Law::Linear, 1.3, 0.05), (Law::Exponential, 1.35, 0.02), (Law::CheesemanBennett, 1.4, 0.02)]
    {
        let found = identify(&table(law, multiplier, length_m, 0.05, 1), false).unwrap();
        let best = &found.laws[0];
        assert_eq!(best.law, law, "{:?}", found.laws);
        assert!(best.probability > 0.9, "{:?}", found.laws);
        assert!((best.multiplier.0 - multiplier).abs() < 4.0 * best.multiplier.1, "{best:?}");
        assert!((best.length_m.0 - length_m).abs() < 4.0 * best.length_m.1, "{best:?}");
    }
}

#[test]
fn throttles_outliers_and_the_rig_are_told() {
    let found = identify(&table(Law::Linear, 1.3, 0.05, 0.05, 2), false).unwrap();
    assert_eq!(found.throttles.len(), 3);
    assert!(found.throttles_differ_p.unwrap() > 1e-3);
    for told in &found.throttles {
        assert!((told.free_thrust_n.0 - told.rig_thrust_n).abs() < 0.02 * told.rig_thrust_n, "{told:?}");
    }
    assert!(found.refused.iter().any(|refused| refused.why.contains("off the linear law by -")));
    let again = Rig::read(Path::new("out.toml"), &found.rig.to_toml()).unwrap();
    assert_eq!(again, found.rig);
    assert!((again.airframe.ground_effect.height_m.value - 0.05).abs() < 0.003);
}

#[test]
fn the_exponential_law_written_into_a_rig_gives_the_readings_again() {
    let found = identify(&table(Law::Exponential, 1.35, 0.02, 0.05, 3), true).unwrap();
    Effects::from_rig(&found.rig, 0).unwrap();
    let mut rig = found.rig.clone();
    rig.output.bits = 0;
    let mut airframe = HeldAirframe::new(&rig, 0).unwrap();
    let free_n = airframe.thrust_n(1.9, 1.0);
    for z_m in [0.0, 0.01, 0.02, 0.05] {
        let ratio = airframe.thrust_n(1.9, z_m) / free_n;
        let truth = Law::Exponential.ratio(z_m, 1.35, 0.02);
        // The form's own 1 % of the extra thrust, and the readings' scatter.
        assert!((ratio - truth).abs() < 0.012, "{z_m} m: {ratio}, {truth}");
    }
    // Not added where the line is preferred.
    let found = identify(&table(Law::Linear, 1.3, 0.05, 0.05, 3), true).unwrap();
    assert!(found.rig.effects.is_empty());
    assert!(parse_effect("ground-effect-shape:stretch=1,exponent=1").is_ok());
}

#[test]
fn readings_that_tell_nothing_are_refused_in_words() {
    let good = table(Law::Linear, 1.3, 0.05, 0.05, 4);
    let altered = |of: &dyn Fn(&str, f64, f64) -> (f64, f64)| {
        let mut out = String::from("throttle_v,altitude_m,reading_g\n");
        for row in good.lines().skip(1) {
            let cells: Vec<&str> = row.split(',').collect();
            let (altitude, reading) = of(cells[0], cells[1].parse().unwrap(), cells[2].parse().unwrap());
            let _ = writeln!(out, "{},{altitude},{reading}", cells[0]);
        }
        out
    };
    for (text, words) in [
        (altered(&|_, mm, g| (mm, g)), "as millimetres taken for metres"),
        (altered(&|_, mm, g| (1e-6 * mm, g)), "as metres taken for millimetres"),
        (altered(&|_, mm, g| (1e-3 * mm, 1000.0 * g)), "about 1000 times too much"),
        (altered(&|_, mm, g| (0.12 - 1e-3 * mm, g)), "it falls towards it"),
        (altered(&|_, mm, g| (0.3 + 1e-3 * mm, g)), "no ground effect"),
        ("throttle_v,reading_g\n1.9,3\n".to_owned(), "no column `altitude_m`"),
        (
            "throttle_v,altitude_m,reading_g\n0,0,15\n1.9,0,0\n1.9,0.1,3\n".to_owned(),
            "at 2 different altitudes",
        ),
        (good.lines().filter(|row| !row.starts_with("0,")).collect::<Vec<_>>().join("\n"), "--hanging-g"),
    ] {
        let told = identify(&text, false).unwrap_err().to_string();
        assert!(told.contains(words), "{words}: {told}");
    }
}
