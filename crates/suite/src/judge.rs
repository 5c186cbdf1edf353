//! A recorded flight held against limits.

use bench_recording::{Channel, Command, Flight, Record, Value};
use bench_rig::{Criteria, Phase};
use bench_run::Summary;
use bench_statistics::{Sorted, mean, median, root_mean_square};

use crate::{Check, FieldLimit, Limit, MEASURES, Measure, MissionCriteria, Side, Statistic};

/// What a flight came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Every figure that the flight defines: each measure by its name, [`HOVER_THROTTLE`], and the statistic of each field that the case
    /// limits, by what it is about with its unit behind a comma.
    pub figures: Vec<(String, f64)>,
    /// Every limit, those of the mission first.
    pub checks: Vec<Check>,
    /// The values of which repeats may have a spread, in the order of the case's limits: `None` where the flight has none.
    pub spread: Vec<Option<f64>>,
}

/// Holds a flight against the limits of a case and the criteria of its mission.
pub fn judge(flight: &Flight, limits: &[Limit], own: MissionCriteria, criteria: &Criteria) -> Judged {
    let summary = Summary::of_flight(flight, criteria.settle_band_m);
    let mut figures: Vec<(String, f64)> = MEASURES
        .iter()
        .filter_map(|measure| {
            Some((measure.name.to_owned(), (measure.of)(&summary).filter(|value| value.is_finite())?))
        })
        .collect();
    figures.extend(hover_throttle(flight).map(|throttle| (HOVER_THROTTLE.to_owned(), throttle)));
    let mut checks = Vec::new();
    if own == MissionCriteria::Count {
        for check in bench_run::check(criteria, &summary) {
            let is_replaced = limits.iter().any(|limit| match limit {
                Limit::Measure { name, side, .. } => {
                    Measure::named(name).is_some_and(|measure| measure.key(*side) == check.key)
                }
                Limit::Field(_) => false,
            });
            if !is_replaced {
                checks.push(Check::of_mission(&check));
            }
        }
    }
    let mut spread = Vec::new();
    for limit in limits {
        match limit {
            Limit::Measure { name, side, limit } => {
                let Some(measure) = Measure::named(name) else { continue };
                let value = (measure.of)(&summary).filter(|value| value.is_finite());
                if *side == Side::Spread {
                    spread.push(value);
                } else {
                    checks.push(Check::new(measure.key(*side), value, measure.unit, *side, *limit));
                }
            }
            Limit::Field(limit) => {
                let value = statistic(flight, limit);
                let unit = if limit.unit.is_empty() { String::new() } else { format!(", {}", limit.unit) };
                figures.extend(value.map(|value| (limit.about() + &unit, value)));
                for (side, number) in &limit.sides {
                    if *side == Side::Spread {
                        spread.push(value);
                    } else {
                        checks.push(Check::new(limit.about(), value, &limit.unit, *side, *number));
                    }
                }
            }
        }
    }
    Judged { figures, checks, spread }
}

/// The name of the median throttle over the mission's holds, in the unit of the rig's sticks: what it takes to hover tells of battery,
/// weight and rotors.
pub const HOVER_THROTTLE: &str = "hover_throttle";

fn hover_throttle(flight: &Flight) -> Option<f64> {
    let holds: Vec<_> = flight.phases().into_iter().filter(|span| span.phase == Phase::Hold).collect();
    let within = |command: &&Command| holds.iter().any(|hold| (hold.from..hold.to).contains(&command.time));
    let throttle = flight.commands.iter().filter(within).map(|command| command.sticks.throttle);
    median(throttle.filter(|throttle| throttle.is_finite()))
}

/// Holds the repeats of a test against the limits on their spread. `repeats[i]` is [`Judged::spread`] of repeat i.
pub fn spread(limits: &[Limit], repeats: &[Vec<Option<f64>>]) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut place = 0;
    let mut add = |about: String, unit: &str, limit: f64| {
        let values: Option<Vec<f64>> =
            repeats.iter().map(|repeat| repeat.get(place).copied().flatten()).collect();
        place += 1;
        let range = values.filter(|values| values.len() > 1).and_then(|values| {
            let least = values.iter().copied().reduce(f64::min)?;
            Some(values.iter().copied().reduce(f64::max)? - least)
        });
        checks.push(Check::new(about, range, unit, Side::Spread, limit));
    };
    for limit in limits {
        match limit {
            Limit::Measure { name, side: Side::Spread, limit } => {
                if let Some(measure) = Measure::named(name) {
                    add(measure.key(Side::Spread), measure.unit, *limit);
                }
            }
            Limit::Measure { .. } => {}
            Limit::Field(limit) => {
                for (_, number) in limit.sides.iter().filter(|(side, _)| *side == Side::Spread) {
                    add(format!("spread of {}", limit.about()), &limit.unit, *number);
                }
            }
        }
    }
    checks
}

/// The statistic of a field in a flight; `None` where there is no sample to make it of.
fn statistic(flight: &Flight, limit: &FieldLimit) -> Option<f64> {
    let field = limit.field();
    let phases = flight.phases();
    let (mut numbers, mut samples, mut equal) = (Vec::new(), 0_u64, 0_u64);
    each(flight, limit.channel, |record| {
        let time = record.time();
        let is_within = limit.phase.is_none_or(|wanted| {
            phases.iter().any(|span| span.phase == wanted && (span.from..span.to).contains(&time))
        });
        if !is_within {
            return;
        }
        let value = field.value(record);
        let is = |text: &str| limit.equals.as_deref() == Some(text);
        samples += 1;
        match value {
            Value::Float(x) if x.is_finite() => numbers.push(x),
            // What was not measured may be no number as well.
            Value::Missing | Value::Float(_) => samples -= 1,
            Value::Integer(x) => numbers.push(x as f64),
            Value::Time(time) => numbers.push(time.seconds()),
            Value::Text(text) => equal += u64::from(is(text)),
            Value::Bool(flag) => equal += u64::from(is(if flag { "true" } else { "false" })),
        }
    });
    let least = || numbers.iter().copied().reduce(f64::min);
    let greatest = || numbers.iter().copied().reduce(f64::max);
    let ranked = |share| Sorted::of(numbers.iter().copied()).nearest_rank(share);
    let value = match limit.statistic {
        Statistic::Min => least(),
        Statistic::Max => greatest(),
        Statistic::Range => Some(greatest()? - least()?),
        Statistic::Mean => mean(numbers.iter().copied()),
        Statistic::Rms => root_mean_square(numbers.iter().copied()),
        Statistic::Deviation => {
            let mean = mean(numbers.iter().copied())?;
            root_mean_square(numbers.iter().map(|x| x - mean))
        }
        Statistic::Median => median(numbers.iter().copied()),
        Statistic::P95 => ranked(0.95),
        Statistic::P99 => ranked(0.99),
        Statistic::First => numbers.first().copied(),
        Statistic::Last => numbers.last().copied(),
        Statistic::Count => Some(samples as f64),
        Statistic::Share => (samples > 0).then(|| equal as f64 / samples as f64),
    };
    value.filter(|value| value.is_finite())
}

/// Every record of a channel, in order of time.
fn each(flight: &Flight, channel: Channel, mut see: impl FnMut(&Record)) {
    fn all<T: Copy + Into<Record>>(series: &[T], see: &mut impl FnMut(&Record)) {
        for item in series {
            see(&(*item).into());
        }
    }
    let see = &mut see;
    match channel {
        Channel::Position => all(&flight.positions, see),
        Channel::Motion => all(&flight.motion, see),
        Channel::ControlState => all(&flight.states, see),
        Channel::Command => all(&flight.commands, see),
        Channel::Readback => all(&flight.readbacks, see),
        Channel::Truth => all(&flight.truth, see),
        Channel::Tick => all(&flight.ticks, see),
        Channel::Event => all(&flight.events, see),
        Channel::Battery => all(&flight.battery, see),
        Channel::Rotor => all(&flight.rotor, see),
    }
}
