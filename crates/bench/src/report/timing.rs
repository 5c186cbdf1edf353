//! How well time was kept.

use bench_page::{
    Mark, Panel, Plot, Section, Series,
    parts::{Column, cell, table},
};
use bench_recording::Flight;
use bench_rig::Rig;
use bench_run::{Percentiles, Summary};
use maud::html;

use super::traces;
use crate::words;

/// Colours of what is too long, and of usual times.
const LOOP: usize = 0;
const TRACKER: usize = 2;
const OVERRUN: usize = 1;

/// Timing of the loop and of the tracker; nothing where neither was recorded.
pub fn section(flight: &Flight, rig: Option<&Rig>, summary: &Summary, group: &str) -> Option<Section> {
    let ticks = &flight.ticks;
    let rows = [
        ("period from iteration to iteration", of_pairs(ticks.iter().map(|tick| tick.started.seconds()))),
        (
            "start of an iteration after its schedule",
            of(ticks.iter().map(|t| t.started.since_s(t.scheduled))),
        ),
        ("reading the tracker", of(ticks.iter().map(|tick| tick.sense_s))),
        ("controller", of(ticks.iter().map(|tick| tick.control_s))),
        ("writing and reading back the outputs", of(ticks.iter().map(|tick| tick.actuate_s))),
        (
            "position from exposure to arrival",
            of(flight.positions.iter().map(|p| p.arrived_at.since_s(p.exposed_at))),
        ),
        ("position to position", of_pairs(flight.positions.iter().map(|p| p.exposed_at.seconds()))),
    ];
    let rows: Vec<_> = rows
        .into_iter()
        .filter_map(|(what, times)| {
            // In lockstep, what is done takes no time.
            let times = times.filter(|times| times.max > 0.0)?;
            let ms = |s: f64| cell(bench_page::digits(1e3 * s));
            Some(vec![cell(what), ms(times.p50), ms(times.p99), ms(times.max)])
        })
        .collect();
    if rows.is_empty() {
        return None;
    }
    let columns = [
        Column::Words("time, ms"),
        Column::Number("median"),
        Column::Number("99 % below"),
        Column::Number("longest"),
    ];
    let lost = if ticks.is_empty() {
        Vec::new()
    } else {
        vec![format!(
            "{}, of which {} overran and {} had no readback in time.",
            words::count(summary.ticks, "iteration"),
            words::grouped(summary.overruns),
            words::grouped(summary.unanswered)
        )]
    };
    let body = html! {
        @for line in lost { p { (line) } }
        (table(&columns, rows))
        (plot(flight, rig, group))
    };
    Some(Section::new("Timing", body))
}

/// Percentiles of times, where there are any.
fn of(times: impl Iterator<Item = f64>) -> Option<Percentiles> {
    let times: Vec<f64> = times.collect();
    (!times.is_empty()).then(|| Percentiles::of(times))
}

fn of_pairs(instants: impl Iterator<Item = f64>) -> Option<Percentiles> {
    let mut instants: Vec<f64> = instants.collect();
    instants.sort_by(f64::total_cmp);
    of(instants.windows(2).map(|pair| pair[1] - pair[0]))
}

fn plot(flight: &Flight, rig: Option<&Rig>, group: &str) -> Plot {
    let ticks = || flight.ticks.iter();
    let late = ticks().map(|tick| (tick.started.seconds(), 1e3 * tick.started.since_s(tick.scheduled)));
    let took = ticks().map(|t| (t.started.seconds(), 1e3 * (t.sense_s + t.control_s + t.actuate_s)));
    let overran = ticks().filter(|tick| tick.overrun);
    let overran = overran.map(|t| (t.started.seconds(), 1e3 * (t.sense_s + t.control_s + t.actuate_s)));
    let latency = flight.positions.iter();
    let latency = latency.map(|p| (p.arrived_at.seconds(), 1e3 * p.arrived_at.since_s(p.exposed_at)));
    let is_timed = ticks().any(|tick| tick.started > tick.scheduled || tick.actuate_s > 0.0);
    let mut iterations = Panel::new("iteration, ms")
        .with(Series::new("start after schedule", Mark::Line, TRACKER, late))
        .with(Series::new("takes", Mark::Line, LOOP, took))
        .with(Series::new("overran", Mark::Crosses, OVERRUN, overran));
    if let Some(rig) = rig {
        iterations = iterations.level(1e3 * rig.control_loop.period_s, "period");
    }
    traces::over_time("Timing", flight, group)
        .panel(if is_timed { iterations.low() } else { Panel::new("") })
        .panel(
            Panel::new("position's delay, ms")
                .with(Series::new("", Mark::Line, TRACKER, traces::moving(latency.collect())))
                .low(),
        )
}
