//! The figures that pages and `bench paper` share.

use bench_identification::{FlightVerified, GroundIdentification, Law, ThrustIdentification, Use};
use bench_page::{Figure, Mark};
use bench_rig::Rig;

use super::grams;

/// Throttle and thrust with a line a battery level (the paper's figure 9).
pub fn thrust_figure(found: &ThrustIdentification, rig: &Rig) -> Figure {
    let title = "Thrust over throttle";
    let mut figure = Figure::new(title, &format!("throttle, {}", found.throttle_unit), "thrust, g");
    let throttles = || found.points.iter().map(|point| point.throttle);
    let (low, high) = (throttles().fold(f64::MAX, f64::min), throttles().fold(f64::MIN, f64::max));
    let weight = 1000.0 * rig.airframe.mass_kg.value;
    figure.add("weight", Mark::Dashed, 5, [(low, weight), (high, weight)]);
    for (colour, level) in found.levels.iter().enumerate() {
        let (gain, offset) = (level.gain_n_per_unit.0, level.offset.0);
        let name = if level.name.is_empty() { "line" } else { &level.name };
        let start = offset.clamp(low, high);
        let line = [(low, 0.0), (start, 0.0), (high, grams(gain * (high - offset)))];
        figure.add(name, Mark::Line, colour, line.into_iter().filter(|(u, _)| *u >= low));
    }
    // Colours follow the levels that are used, by their order in the file.
    let mut order: Vec<usize> = found.points.iter().map(|point| point.level).collect();
    order.sort_unstable();
    order.dedup();
    for (colour, level) in order.iter().enumerate() {
        let of = |refused: bool| {
            found
                .points
                .iter()
                .filter(move |p| {
                    p.level == *level && matches!(p.used, Use::Outlier | Use::Outside) == refused
                })
                .map(|p| (p.throttle, grams(p.thrust_n)))
        };
        figure.add("", Mark::Dots, colour, of(false));
        figure.add("", Mark::Crosses, colour, of(true));
    }
    figure
}

/// Altitude and thrust with the laws, a colour a throttle (the paper's figure 10).
pub fn ground_figure(found: &GroundIdentification) -> Figure {
    let mut figure = Figure::new("Thrust over altitude", "altitude, cm", "thrust, g");
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
            figure.add(&name, mark, colour, (0..=200).map(at));
        }
        let of = |used: bool| {
            found
                .points
                .iter()
                .filter(move |point| point.throttle == colour && point.used == used)
                .map(|point| (100.0 * point.altitude_m, grams(point.thrust_n)))
        };
        figure.add("", Mark::Dots, colour, of(true));
        figure.add("", Mark::Crosses, colour, of(false));
    }
    figure
}

/// A flight over its prediction from the throttle alone (the paper's figure 11).
pub fn trajectory_figure(flight: &FlightVerified) -> Figure {
    let told = &flight.trajectory;
    let mut figure = Figure::new(&flight.name, "time from the first throttle, s", "altitude, m");
    let band = |ends: &[[f64; 2]]| {
        told.time_s.iter().zip(ends).map(|(t, [low, high])| [*t, *low, *high]).collect::<Vec<_>>()
    };
    figure.add_between("95 %", Mark::Zone, 0, band(&told.band_95_m));
    figure.add_between("50 %", Mark::Band, 0, band(&told.band_50_m));
    let at = |z: &[f64]| told.time_s.iter().copied().zip(z.iter().copied()).collect::<Vec<_>>();
    figure.add("model", Mark::Line, 0, at(&told.nominal_m));
    figure.add("seen", Mark::Dots, 1, at(&told.seen_m));
    // The band of a hop that one kick more would throw out of the room is not worth its height.
    let highest = told.seen_m.iter().chain(&told.nominal_m).copied().fold(0.0, f64::max);
    figure.axes(None, Some([-0.05 * highest - 0.01, 1.8 * highest]))
}
