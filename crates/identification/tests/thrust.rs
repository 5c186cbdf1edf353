//! Readings of a balance: numbers planted in them are found with intervals that hold, and readings that tell nothing are
//! refused in words.

use std::{fmt::Write as _, path::Path};

use bench_identification::{
    IdentifyError, Mounting, Readings, ThrustIdentification, ThrustOptions, Use, identify_thrust,
};
use bench_plant::{balance::HeldAirframe, effects::parse_effect};
use bench_rig::{GRAVITY_M_S2, Rig};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

fn rig() -> Rig {
    Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
}

fn identify(text: &str, options: &ThrustOptions) -> Result<ThrustIdentification, IdentifyError> {
    let rig = rig();
    identify_thrust(&Readings::read(Path::new("balance.csv"), text, &rig)?, &rig, options)
}

fn grams(newtons: f64) -> f64 {
    newtons * 1000.0 / GRAVITY_M_S2
}

/// What is planted in one table.
#[derive(Clone, Copy)]
struct Plan {
    gain_n_per_v: f64,
    offset_v: f64,
    noise_g: f64,
    outliers: f64,
    repeats: usize,
}

const NOMINAL: Plan = Plan { gain_n_per_v: 0.1051, offset_v: 0.5, noise_g: 0.08, outliers: 0.08, repeats: 3 };

/// Rest, and the range of flight up to 2.4 V; the second level gives 3 % less. Readings of the suspended rig, to 0.1 g.
fn table(plan: Plan, levels: &[(&str, f64)], seed: u64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut out = String::from("throttle_v,reading_g,battery\n");
    for (name, factor) in levels {
        for throttle in [0.0, 0.2, 0.4, 0.9, 1.1, 1.3, 1.5, 1.7, 1.9, 2.1, 2.3] {
            for _ in 0..plan.repeats {
                let thrust_n = factor * plan.gain_n_per_v * f64::max(0.0, throttle - plan.offset_v);
                let noise: f64 = rng.sample(StandardNormal);
                let mut shown = 21.37 - grams(thrust_n) + plan.noise_g * noise;
                if rng.random::<f64>() < plan.outliers {
                    shown += (0.6 + 4.0 * rng.random::<f64>()) * if rng.random() { 1.0 } else { -1.0 };
                }
                let _ = writeln!(out, "{throttle},{shown:.1},{name}");
            }
        }
    }
    out
}

/// How often of `draws` each of gain, offset and hover lies in its interval of 95 %.
fn coverage(draws: u64, plan: Plan, levels: &[(&str, f64)]) -> [f64; 3] {
    let weight_n = rig().airframe.weight_n();
    let factor = levels.iter().map(|(_, factor)| factor).sum::<f64>() / levels.len() as f64;
    let mut inside = [0_u32; 3];
    for seed in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(1_000_000 + seed);
        let drawn = Plan {
            gain_n_per_v: plan.gain_n_per_v * (0.9 + 0.2 * rng.random::<f64>()),
            offset_v: plan.offset_v + 0.2 * rng.random::<f64>(),
            ..plan
        };
        let found = identify(&table(drawn, levels, seed), &ThrustOptions::default()).unwrap();
        let gain = factor * drawn.gain_n_per_v;
        let truth = [gain, drawn.offset_v, drawn.offset_v + weight_n / gain];
        for ((count, truth), number) in inside.iter_mut().zip(truth).zip(&found.numbers) {
            let [low, high] = number.interval_95;
            *count += u32::from((low..=high).contains(&truth));
        }
    }
    let share = inside.map(|count| f64::from(count) / draws as f64);
    for (name, count) in ["gain", "offset", "throttle that hovers"].iter().zip(inside) {
        println!("coverage | {name}: {} levels, noise {} g | {count} | {draws}", levels.len(), plan.noise_g);
    }
    share
}

/// 90 to 98 %, and three deviations of a share counted in so many draws.
fn near_95_percent(draws: f64) -> std::ops::RangeInclusive<f64> {
    let three = |share: f64| 3.0 * (share * (1.0 - share) / draws).sqrt();
    0.90 - three(0.90)..=0.98 + three(0.98)
}

#[test]
fn intervals_of_95_percent_hold_in_500_draws_with_outliers_and_rounding() {
    let both = [("full", 1.0), ("half", 0.97)];
    let share = coverage(500, NOMINAL, &both);
    assert!(share.iter().all(|share| near_95_percent(500.0).contains(share)), "{share:?}");
}

#[test]
fn intervals_hold_where_rounding_hides_the_noise_and_where_noise_hides_the_rounding() {
    for noise_g in [0.005, 0.3] {
        let share = coverage(500, Plan { noise_g, ..NOMINAL }, &[("", 1.0)]);
        assert!(share.iter().all(|share| near_95_percent(500.0).contains(share)), "{noise_g} g: {share:?}");
    }
}

#[test]
fn levels_outliers_dead_zone_and_rest_are_told() {
    let found =
        identify(&table(NOMINAL, &[("full", 1.0), ("half", 0.97)], 3), &ThrustOptions::default()).unwrap();
    assert!((found.levels[0].rest_g - 21.37).abs() < 0.1);
    // The offset of 0.5 V lies between the last throttle without and the first with thrust.
    assert_eq!(found.levels[0].dead_zone, Some([0.4, 0.9]));
    assert_eq!(found.levels[0].saturation, None);
    let change = found.levels[1].thrust_change;
    assert!((change.0 + 0.03).abs() < 4.0 * change.1, "{change:?}");
    assert!(found.levels_differ.unwrap().p < 1e-3);
    assert!(found.linearity.linear, "{:?}", found.linearity);
    assert!(found.refused.iter().any(|r| r.why.contains("off the line by") && r.why.contains("sigma")));
    // The tolerance covers both levels: 3 % apart are 2.1 % as a deviation.
    let gain = found.rig.airframe.thrust.gain_n_per_unit;
    assert!((0.015..0.03).contains(&(gain.sigma / gain.value)), "{gain:?}");
    // What is written reads back, hovering where the readings say.
    let again = Rig::read(Path::new("out.toml"), &found.rig.to_toml()).unwrap();
    assert_eq!(again, found.rig);
    let hover = again.airframe.throttle_for(again.airframe.weight_n());
    assert!((hover - found.numbers[2].after.0).abs() < 1e-9);
}

#[test]
fn all_mountings_and_units_give_the_same_line() {
    let plan = Plan { outliers: 0.0, noise_g: 0.0, ..NOMINAL };
    let hanging = table(plan, &[("", 1.0)], 0);
    let convert = |head: &str, of: fn(f64) -> f64| {
        let mut out = format!("{head}\n");
        for row in hanging.lines().skip(1) {
            let cells: Vec<&str> = row.split(',').collect();
            let shown: f64 = cells[1].parse().unwrap();
            let _ = writeln!(out, "{},{:.4}", cells[0], of(shown));
        }
        out
    };
    let first = identify(&hanging, &ThrustOptions::default()).unwrap();
    let tared = convert("throttle_v,reading_g", |g| g - 21.4);
    let pressing = convert("throttle,reading_n", |g| (21.4 - g) * GRAVITY_M_S2 / 1000.0);
    let thrust = convert("throttle_v,thrust_g", |g| 21.4 - g);
    for (text, mounting) in
        [(tared, Mounting::Tared), (pressing, Mounting::Pressing), (thrust, Mounting::Suspended)]
    {
        let found = identify(&text, &ThrustOptions { mounting, ..ThrustOptions::default() }).unwrap();
        for (a, b) in first.numbers.iter().zip(&found.numbers) {
            assert!((a.after.0 - b.after.0).abs() < 2e-3 * a.after.0, "{mounting:?}: {a:?} {b:?}");
        }
    }
}

#[test]
fn saturation_and_curvature_are_found_in_the_plants_own_readings() {
    let sweep = |effect: &str| {
        let mut rig = rig();
        rig.effects.push(parse_effect(effect).unwrap());
        let mut airframe = HeldAirframe::new(&rig, 0).unwrap();
        let mut out = String::from("throttle_v,reading_g\n");
        for step in 0..34 {
            let throttle = 0.1 * f64::from(step);
            let _ = writeln!(out, "{throttle:.1},{:.1}", 40.0 - grams(airframe.thrust_n(throttle, 1.0)));
        }
        identify(&out, &ThrustOptions::default()).unwrap()
    };
    let saturated = sweep("actuator-saturation:high_thrust_to_weight=1.4");
    let (edge, thrust_n) = saturated.levels[0].saturation.unwrap();
    // 1.4 times the weight, which 2.46 V carry.
    assert!(edge[0] < 2.46 && edge[1] > 2.46, "{edge:?}");
    assert!((thrust_n / rig().airframe.weight_n() - 1.4).abs() < 0.02, "{thrust_n}");
    assert!((saturated.numbers[0].after.0 - 0.1051).abs() < 0.002);
    assert!(saturated.points.iter().any(|point| point.used == Use::Saturated));

    let bent = sweep("thrust-curve:curvature=0.15");
    assert!(
        !bent.linearity.linear && bent.warnings.iter().any(|w| w.contains("--from and --to")),
        "{bent:?}"
    );
    let (curvature, sigma) = bent.linearity.curvature;
    assert!((curvature - 0.15).abs() < 4.0 * sigma + 0.03, "{curvature} ± {sigma}");
}

#[test]
fn readings_that_tell_nothing_are_refused_in_words() {
    let scaled = |by: f64| {
        let hanging = table(Plan { outliers: 0.0, ..NOMINAL }, &[("", 1.0)], 1);
        let mut out = String::from("throttle_v,reading_g\n");
        for row in hanging.lines().skip(1) {
            let cells: Vec<&str> = row.split(',').collect();
            let _ = writeln!(out, "{},{}", cells[0], by * cells[1].parse::<f64>().unwrap());
        }
        out
    };
    let mut wild = String::from("throttle_v,reading_g\n");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for i in 0..30 {
        let _ = writeln!(wild, "{},{:.1}", 0.1 * f64::from(i), 20.0 * rng.random::<f64>());
    }
    for (text, words) in [
        ("throttle_v,reading_g\n0,15\n1.9,0\n".to_owned(), "2 readings at 2 different throttles"),
        (
            "throttle_v,reading_g\n1.9,1.0\n1.9,1.1\n1.9,0.9\n1.9,1.0\n1.9,1.1\n".to_owned(),
            "1 different throttles",
        ),
        (scaled(1000.0), "about 1000 times too much"),
        (scaled(0.001), "about 1000 times too little"),
        (scaled(-1.0), "thrust falls as the throttle rises"),
        ("throttle_v,reading_g\n1.0,15.7\n1.2,13.6\n1.4,11.3\n1.6,9.3\n1.8,7.0\n".to_owned(), "--hanging-g"),
        (wild, "throttle"),
    ] {
        let told = identify(&text, &ThrustOptions::default()).unwrap_err().to_string();
        assert!(told.contains(words), "{words}: {told}");
    }
}

#[test]
fn a_throttle_below_the_offset_gives_no_thrust_whatever_its_readings_are_taken_for_first() {
    // One throttle in the dead zone besides rest, its readings off by chance.
    let mut text = String::from("throttle_v,reading_g\n");
    for (throttle, shown) in [(0.0, 21.4), (0.25, 21.6), (0.25, 21.5), (0.25, 19.8)] {
        let _ = writeln!(text, "{throttle},{shown}");
    }
    for step in 0..10 {
        let throttle = 0.75 + 0.2 * f64::from(step);
        let _ = writeln!(text, "{throttle:.2},{:.1}", 21.4 - grams(0.1051 * (throttle - 0.5)));
    }
    let found = identify(&text, &ThrustOptions::default()).unwrap();
    assert_eq!(found.levels[0].dead_zone, Some([0.25, 0.75]));
    assert!((found.numbers[1].after.0 - 0.5).abs() < 0.02, "{:?}", found.numbers[1]);
}
