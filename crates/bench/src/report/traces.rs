//! What was recorded, over time.

use bench_device::TrackStatus;
use bench_page::{Mark, Panel, Plot, Section, Series, Span, parts::block};
use bench_recording::{Flight, Level};
use bench_rig::{Phase, Rig};
use maud::{Markup, html};

/// Colours, the same in all plots: what was seen, what was so, what was wanted, what is off.
const SEEN: usize = 4;
const TRUE: usize = 2;
const WANTED: usize = 5;
const ESTIMATED: usize = 0;
const OFF: usize = 3;
const AXES: [usize; 3] = [0, 1, 2];

/// A plot over the flight's time with its phases and what went wrong.
pub fn over_time(title: &str, flight: &Flight, group: &str) -> Plot {
    let phases = flight.phases().into_iter().map(|phase| Span {
        from: phase.from.seconds(),
        to: phase.to.seconds(),
        name: phase.phase.name().to_owned(),
    });
    let mut plot = Plot::new(title, "time, s").group(group).spans(phases);
    if let Some(event) = flight.events.iter().find(|event| event.level == Level::Error) {
        plot = plot.mark(event.time.seconds(), "error");
    }
    match ends(flight) {
        Some(ends) => plot.x(ends),
        None => plot,
    }
}

/// First and last instant of a flight, s.
fn ends(flight: &Flight) -> Option<[f64; 2]> {
    let instants = flight
        .positions
        .iter()
        .map(|position| position.exposed_at)
        .chain(flight.states.iter().map(|state| state.time))
        .chain(flight.commands.iter().map(|command| command.time))
        .chain(flight.truth.iter().map(|truth| truth.time))
        .chain(flight.motion.iter().map(|motion| motion.time));
    let (first, last) = instants.fold((None, None), |(first, last), time| {
        (Some(first.map_or(time, |first| time.min(first))), Some(last.map_or(time, |last| time.max(last))))
    });
    Some([first?.seconds(), last?.seconds()])
}

/// A value of each record of a series, over time; absent ones are gaps.
fn series<T>(items: &[T], of: impl Fn(&T) -> (f64, Option<f64>)) -> Vec<(f64, f64)> {
    items.iter().map(of).map(|(t, value)| (t, value.unwrap_or(f64::NAN))).collect()
}

/// All traces of a flight.
pub fn section(flight: &Flight, rig: Option<&Rig>, group: &str) -> Section {
    let unit = rig.map_or("", |rig| rig.airframe.actuation.unit());
    let plots = [
        ("Altitude", "", altitude(flight, group)),
        ("Sideways", "", sideways(flight, group)),
        (
            "Outputs",
            "What the board measured less what was asked for, where it was read back.",
            outputs(flight, unit, group),
        ),
        ("Airframe", "", airframe(flight, rig, group)),
    ];
    let blocks: Vec<Markup> = plots
        .into_iter()
        .filter(|(_, _, plot)| !plot.is_empty())
        .map(|(title, words, plot)| block(title, words, plot))
        .collect();
    if blocks.is_empty() {
        return Section::new("Traces", html! { p { "Nothing that has a trace was recorded." } });
    }
    Section::new("Traces", html! { @for block in blocks { (block) } })
        .told("Phases are shaded in turn. Where something is known twice, their difference is shown.")
}

fn seen(flight: &Flight, axis: usize) -> Vec<(f64, f64)> {
    series(&flight.positions, |p| {
        (p.exposed_at.seconds(), (p.status != TrackStatus::Lost).then_some(p.position_m[axis]))
    })
}

/// What was wanted while a position was held, and nothing otherwise.
fn wanted(flight: &Flight, axis: usize) -> Vec<(f64, f64)> {
    series(&flight.states, |s| {
        (s.time.seconds(), matches!(s.phase, Phase::Hold | Phase::Land).then_some(s.setpoint_m[axis]))
    })
}

/// Values less those of another series that held at the time.
fn less(values: &[(f64, f64)], held: &[(f64, f64)], scale: f64) -> Vec<(f64, f64)> {
    let mut next = 0;
    values
        .iter()
        .map(|(t, value)| {
            while held.get(next).is_some_and(|(at, _)| at <= t) {
                next += 1;
            }
            let held = next.checked_sub(1).map_or(f64::NAN, |last| held[last].1);
            (*t, scale * (value - held))
        })
        .collect()
}

/// Values less those of another series on the straight line between its samples.
pub fn less_between(values: &[(f64, f64)], line: &[(f64, f64)], scale: f64) -> Vec<(f64, f64)> {
    let mut next = 0;
    let at = |t: f64, next: &mut usize| {
        while line.get(*next).is_some_and(|(at, _)| *at < t) {
            *next += 1;
        }
        let (t1, y1) = *line.get(*next)?;
        let (t0, y0) = *line.get(next.saturating_sub(1))?;
        if t1 > t0 { Some(y0 + (y1 - y0) * (t - t0) / (t1 - t0)) } else { (t1 == t).then_some(y1) }
    };
    values.iter().map(|(t, value)| (*t, scale * (value - at(*t, &mut next).unwrap_or(f64::NAN)))).collect()
}

fn altitude(flight: &Flight, group: &str) -> Plot {
    let seen = seen(flight, 2);
    let wanted = wanted(flight, 2);
    let truth = series(&flight.truth, |t| (t.time.seconds(), Some(t.position_m[2])));
    let true_speed = series(&flight.truth, |t| (t.time.seconds(), Some(t.velocity_m_s[2])));
    let measured = series(&flight.motion, |m| (m.time.seconds(), m.velocity_m_s[2]));
    let estimated = series(&flight.states, |s| (s.time.seconds(), Some(s.estimate_m_s[2])));
    let estimate = series(&flight.states, |s| (s.time.seconds(), Some(s.estimate_m[2])));
    let positions = Panel::new("altitude, m")
        .with(Series::new("wanted", Mark::Steps, WANTED, wanted.clone()))
        .with(Series::new("seen", Mark::Line, SEEN, seen.clone()));
    let error = Panel::new("seen \u{2212} wanted, cm")
        .with(Series::new("", Mark::Line, OFF, less(&seen, &wanted, 100.0)))
        .level(0.0, "")
        .y_without_spikes(&[0.0]);
    let truly = Panel::new("off the truth, cm")
        .with(Series::new("seen", Mark::Line, SEEN, less_between(&seen, &truth, 100.0)))
        .with(Series::new(
            "predicted by the controller",
            Mark::Line,
            ESTIMATED,
            less_between(&estimate, &truth, 100.0),
        ))
        .level(0.0, "")
        .y_without_spikes(&[0.0]);
    let truly = if truth.is_empty() { Panel::new("") } else { truly };
    let mut speeds = Panel::new("vertical speed, m/s")
        .with(Series::new("true", Mark::Line, TRUE, true_speed))
        .with(Series::new("measured", Mark::Line, SEEN, finite(measured)));
    if speeds.is_empty() {
        speeds = speeds.with(Series::new("predicted by the controller", Mark::Line, ESTIMATED, estimated));
    }
    over_time("Altitude", flight, group)
        .panel(positions)
        .panel(has_values(error))
        .panel(has_values(truly))
        .panel(speeds.low())
}

/// A series without any value is none.
fn finite(values: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    if values.iter().any(|(_, value)| value.is_finite()) { values } else { Vec::new() }
}

/// A series that is zero throughout tells nothing.
pub fn moving(values: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    if values.iter().any(|(_, value)| value.is_finite() && *value != 0.0) { values } else { Vec::new() }
}

fn has_values(panel: Panel) -> Panel {
    if panel.has_values() { panel } else { Panel::new("") }
}

fn sideways(flight: &Flight, group: &str) -> Plot {
    let mut panel = Panel::new("position, cm");
    let mut error = Panel::new("seen \u{2212} wanted, cm");
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        let seen = seen(flight, axis);
        let error_of = finite(less(&seen, &wanted(flight, axis), 100.0));
        let cm = seen.into_iter().map(|(t, m)| (t, 100.0 * m));
        panel = panel.with(Series::new(name, Mark::Line, AXES[axis], cm));
        error = error.with(Series::new(name, Mark::Line, AXES[axis], error_of));
    }
    let heading = series(&flight.positions, |p| (p.exposed_at.seconds(), p.heading_rad.map(f64::to_degrees)));
    over_time("Horizontal position", flight, group)
        .panel(has_values(panel))
        .panel(error.level(0.0, "").low())
        .panel(Panel::new("heading, degrees").with(Series::new("", Mark::Line, TRUE, finite(heading))).low())
}

fn outputs(flight: &Flight, unit: &str, group: &str) -> Plot {
    let titled =
        |what: &str| if unit.is_empty() || unit == "1" { what.to_owned() } else { format!("{what}, {unit}") };
    let of =
        |stick: usize| series(&flight.commands, |c| (c.time.seconds(), Some(c.sticks.to_array()[stick])));
    let read = |stick: usize| {
        let read =
            series(&flight.readbacks, |r| (r.time.seconds(), Some(r.readback.sticks.to_array()[stick])));
        less(&read, &of(stick), 1.0)
    };
    let names = ["throttle", "pitch", "roll", "yaw"];
    let mut others = Panel::new(titled("pitch, roll, yaw"));
    let mut off = Panel::new(titled("measured \u{2212} asked for"));
    for (stick, name) in names.into_iter().enumerate() {
        if stick > 0 {
            others = others.with(Series::new(name, Mark::Steps, stick, moving(of(stick))));
        }
        off = off.with(Series::new(name, Mark::Line, stick, finite(read(stick))));
    }
    over_time("Outputs", flight, group)
        .panel(Panel::new(titled("throttle")).with(Series::new("", Mark::Steps, ESTIMATED, of(0))))
        .panel(others.low())
        .panel(off.low())
}

fn airframe(flight: &Flight, rig: Option<&Rig>, group: &str) -> Plot {
    let weight_n = rig.map_or(f64::NAN, |rig| rig.airframe.weight_n());
    let thrust = series(&flight.truth, |t| (t.time.seconds(), Some(t.thrust_n / weight_n)));
    let asked = series(&flight.states, |s| (s.time.seconds(), Some(s.thrust_n / weight_n)));
    let battery = series(&flight.battery, |b| (b.time.seconds(), Some(b.voltage_v)));
    let current = series(&flight.battery, |b| (b.time.seconds(), b.current_a));
    let acceleration = series(&flight.motion, |m| (m.time.seconds(), m.vertical_acceleration_m_s2));
    let mut rotors = Panel::new("rotor speed, rad/s");
    for rotor in 0..4 {
        let speed = series(&flight.rotor, |r| (r.time.seconds(), r.speed_rad_s[rotor]));
        rotors = rotors.with(Series::new(format!("{}", rotor + 1), Mark::Line, rotor, finite(speed)));
    }
    let mut attitude = Panel::new("attitude, degrees");
    for (axis, name) in ["roll", "pitch", "yaw"].into_iter().enumerate() {
        let angle = series(&flight.motion, |m| (m.time.seconds(), m.attitude_rad[axis].map(f64::to_degrees)));
        attitude = attitude.with(Series::new(name, Mark::Line, AXES[axis], finite(angle)));
    }
    over_time("Airframe", flight, group)
        .panel(
            Panel::new("thrust over weight")
                .with(Series::new("wanted by the controller", Mark::Steps, WANTED, finite(asked)))
                .with(Series::new("true", Mark::Line, TRUE, finite(thrust))),
        )
        .panel(
            Panel::new("acceleration, m/s\u{b2}")
                .with(Series::new("", Mark::Line, OFF, finite(acceleration)))
                .low(),
        )
        .panel(attitude.low())
        .panel(rotors.low())
        .panel(Panel::new("battery, V").with(Series::new("", Mark::Line, ESTIMATED, battery)).low())
        .panel(Panel::new("current, A").with(Series::new("", Mark::Line, ESTIMATED, finite(current))).low())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_taken_at_the_time_of_each_value() {
        let values = [(0.0, 1.0), (1.0, 2.0), (2.0, 5.0)];
        let told = less(&values, &[(0.5, 1.0), (2.0, 4.0)], 10.0);
        assert!(told[0].1.is_nan(), "nothing held yet");
        assert_eq!(told[1..], [(1.0, 10.0), (2.0, 10.0)]);
        let told = less_between(&values, &[(0.0, 0.0), (4.0, 4.0)], 1.0);
        assert_eq!(told, [(0.0, 1.0), (1.0, 1.0), (2.0, 3.0)]);
        assert!(less_between(&values, &[], 1.0).iter().all(|(_, y)| y.is_nan()));
    }
}
