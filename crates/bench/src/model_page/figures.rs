//! The figures that pages and `bench paper` share: each is a plot of a page, and an SVG that stands alone.

use bench_identification::{FlightVerified, GroundIdentification, Law, ThrustIdentification, Use};
use bench_page::{Mark, Panel, Plot, SERIES, Series};
use bench_rig::Rig;

use super::grams;

/// The colour of what was seen, and of what is beside it.
const SEEN: usize = 1;
const ASIDE: usize = 5;

/// Throttle and thrust with a line a battery level (the paper's figure 9).
pub fn thrust_figure(found: &ThrustIdentification, rig: &Rig, title: &str) -> Plot {
    let throttles = || found.points.iter().map(|point| point.throttle);
    let (low, high) = (throttles().fold(f64::MAX, f64::min), throttles().fold(f64::MIN, f64::max));
    let weight = 1000.0 * rig.airframe.mass_kg.value;
    let mut panel = Panel::new("thrust, g").with(Series::new(
        "weight",
        Mark::Dashed,
        ASIDE,
        [(low, weight), (high, weight)],
    ));
    for (colour, level) in found.levels.iter().enumerate() {
        let (gain, offset) = (level.gain_n_per_unit.0, level.offset.0);
        let name = if level.name.is_empty() { "line" } else { &level.name };
        let start = offset.clamp(low, high);
        let line = [(low, 0.0), (start, 0.0), (high, grams(gain * (high - offset)))];
        panel =
            panel.with(Series::new(name, Mark::Line, colour, line.into_iter().filter(|(u, _)| *u >= low)));
    }
    // Colours follow the levels that are used, by their order in the file.
    let mut order: Vec<usize> = found.points.iter().map(|point| point.level).collect();
    order.sort_unstable();
    order.dedup();
    for (colour, level) in order.iter().enumerate() {
        let of = |refused: bool| {
            let is_wanted = |used: &Use| matches!(used, Use::Outlier | Use::Outside) == refused;
            by_x(
                found
                    .points
                    .iter()
                    .filter(|p| p.level == *level && is_wanted(&p.used))
                    .map(|p| (p.throttle, grams(p.thrust_n))),
            )
        };
        panel = panel.with(Series::new("", Mark::Dots, colour, of(false))).with(Series::new(
            "",
            Mark::Crosses,
            colour,
            of(true),
        ));
    }
    let mut off = Panel::new("reading \u{2212} line, g").level(0.0, "").low();
    for (colour, level) in order.iter().enumerate() {
        let Some(line) = found.levels.get(colour) else { continue };
        let (gain, offset) = (line.gain_n_per_unit.0, line.offset.0);
        let readings = found.points.iter().filter(|p| p.level == *level && p.used == Use::Line);
        let of = readings.map(|p| (p.throttle, grams(p.thrust_n - gain * (p.throttle - offset))));
        off = off.with(Series::new("", Mark::Dots, colour, by_x(of)));
    }
    Plot::new(title, format!("throttle, {}", found.throttle_unit)).panel(panel).panel(off)
}

/// Points in the order of x.
fn by_x(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = points.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// Altitude and thrust with the laws, a colour a throttle (the paper's figure 10).
pub fn ground_figure(found: &GroundIdentification, title: &str) -> Plot {
    let mut panel = Panel::new("thrust, g");
    let highest = found.points.iter().map(|point| point.altitude_m).fold(0.0, f64::max);
    let linear = found.laws.iter().find(|law| law.law == Law::Linear);
    let best = found.laws.first().filter(|law| law.law != Law::Linear);
    for (colour, told) in found.throttles.iter().enumerate() {
        for (law, mark) in
            linear.map(|law| (law, Mark::Line)).into_iter().chain(best.map(|law| (law, Mark::Dashed)))
        {
            let name = match mark {
                Mark::Line => format!("throttle {}", crate::words::short(told.throttle)),
                _ => String::new(),
            };
            let at = |i: i32| {
                let z = highest * f64::from(i) / 200.0;
                let ratio = law.law.ratio(z, law.multiplier.0, law.length_m.0);
                (100.0 * z, grams(told.free_thrust_n.0 * ratio))
            };
            panel = panel.with(Series::new(name, mark, colour % SERIES, (0..=200).map(at)));
        }
        let of = |used: bool| {
            by_x(
                found
                    .points
                    .iter()
                    .filter(|point| point.throttle == colour && point.used == used)
                    .map(|point| (100.0 * point.altitude_m, grams(point.thrust_n))),
            )
        };
        panel = panel.with(Series::new("", Mark::Dots, colour, of(true))).with(Series::new(
            "",
            Mark::Crosses,
            colour,
            of(false),
        ));
    }
    let mut off = Panel::new("reading \u{2212} linear law, g").level(0.0, "").low();
    for (colour, told) in found.throttles.iter().enumerate() {
        let Some(law) = linear else { continue };
        let readings = found.points.iter().filter(|point| point.throttle == colour && point.used);
        let of = readings.map(|point| {
            let ratio = law.law.ratio(point.altitude_m, law.multiplier.0, law.length_m.0);
            (100.0 * point.altitude_m, grams(point.thrust_n - told.free_thrust_n.0 * ratio))
        });
        off = off.with(Series::new("", Mark::Dots, colour, by_x(of)));
    }
    Plot::new(title, "altitude, cm").panel(panel).panel(off)
}

/// A flight over its prediction from the throttle alone (the paper's figure 11), and how far it is off. `before` is what another
/// model predicted.
pub fn trajectory_figure(flight: &FlightVerified, title: &str, before: Option<&FlightVerified>) -> Plot {
    let told = &flight.trajectory;
    let band = |ends: &[[f64; 2]]| {
        told.time_s.iter().zip(ends).map(|(t, [low, high])| [*t, *low, *high]).collect::<Vec<_>>()
    };
    let at = |z: &[f64]| told.time_s.iter().copied().zip(z.iter().copied()).collect::<Vec<_>>();
    // The band of a hop that one kick more would throw out of the room is not worth its height.
    let highest = told.seen_m.iter().chain(&told.nominal_m).copied().fold(0.0, f64::max);
    let mut panel = Panel::new("altitude, m")
        .with(Series::band("95 %", Mark::Zone, 0, band(&told.band_95_m)))
        .with(Series::band("50 %", Mark::Band, 0, band(&told.band_50_m)))
        .with(Series::new("model", Mark::Line, 0, at(&told.nominal_m)))
        .with(Series::new("seen", Mark::Dots, SEEN, at(&told.seen_m)));
    if let Some(before) = before.map(|flight| &flight.trajectory) {
        let line = before.time_s.iter().copied().zip(before.nominal_m.iter().copied());
        panel = panel.with(Series::new("balance alone", Mark::Dashed, 2, line));
    }
    let off = told.time_s.iter().zip(told.seen_m.iter().zip(&told.nominal_m));
    let off = off.map(|(t, (seen, model))| (*t, 100.0 * (seen - model)));
    Plot::new(title, "time from the first throttle, s")
        .panel(panel.y([-0.05 * highest - 0.01, 1.8 * highest]))
        .panel(
            Panel::new("seen \u{2212} model, cm")
                .with(Series::new("", Mark::Dots, SEEN, off))
                .level(0.0, "")
                .low(),
        )
}
