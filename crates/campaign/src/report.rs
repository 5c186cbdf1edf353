//! What a sweep found, as sections of a page. The table is read twice, a group of rows at a time, so that its size takes no memory.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use bench_page::{
    Mark, Panel, Plot, Section, Series, Tone, Verdict, digits,
    parts::{Bar, Column as Head, Rows, Tile, cell, facts, table, tiles},
};
use bench_statistics::{Share, Sorted};
use maud::{Markup, html};

use crate::{
    CampaignError, Cells, Kind, Outcome, Store, Table, VERSION, draw::Draw, perform::parameter_column,
};

/// A page of a sweep: title, verdict, sections.
pub struct Report {
    /// The window's title.
    pub title: String,
    /// What it comes to.
    pub verdict: Verdict,
    /// In the order of the page.
    pub sections: Vec<Section>,
}

/// Values of a figure that are drawn of each group: enough that a percentile of the thousand is seen.
const VALUES_MAX: u64 = 20_000;
/// Stretches of an effect's size.
const BINS: usize = 12;
/// Rows of the worst runs.
const WORST: usize = 10;
/// Series of a plot that can be told apart.
const SERIES_MAX: usize = 8;

/// The figures whose distributions are drawn: column, words, unit.
const FIGURES: [(&str, &str, &str); 7] = [
    ("rms_error_m", "RMS error once settled", "m"),
    ("settling_time_s", "settling time", "s"),
    ("overshoot_m", "overshoot", "m"),
    ("peak_m", "highest altitude", "m"),
    ("gap_nominal", "gap of the rig as it is, nats a measurement", "1"),
    ("closure", "share of the gap that the named effect closes", "1"),
    ("confidence", "probability of the verdict", "1"),
];

/// The columns of a group of rows that a report looks at.
struct Group {
    texts: BTreeMap<&'static str, Vec<Option<String>>>,
    numbers: BTreeMap<String, Vec<Option<f64>>>,
    rows: usize,
}

const TEXTS: [&str; 10] =
    ["id", "rig", "mission", "variant", "effects", "recording", "outcome", "reason", "verdict", "missed"];

impl Group {
    fn of(names: &[String], wanted: &BTreeSet<String>, cells: &[Cells]) -> Self {
        let mut group = Self { texts: BTreeMap::new(), numbers: BTreeMap::new(), rows: 0 };
        for (name, cells) in names.iter().zip(cells) {
            if let Some(known) = TEXTS.iter().find(|known| *known == name) {
                let texts = cells.texts();
                group.rows = texts.len();
                group.texts.insert(known, texts);
            } else if wanted.contains(name) {
                group.numbers.insert(name.clone(), cells.numbers());
            }
        }
        group
    }

    fn text(&self, column: &str, row: usize) -> &str {
        self.texts.get(column).and_then(|texts| texts[row].as_deref()).unwrap_or("")
    }

    fn number(&self, column: &str, row: usize) -> Option<f64> {
        self.numbers.get(column).and_then(|numbers| numbers[row])
    }

    /// Whether the run did what it should, and `None` of what has no right and wrong.
    fn succeeded(&self, kind: Kind, row: usize) -> Option<bool> {
        match kind {
            Kind::Flights => Some(self.text("outcome", row) == Outcome::Passed.name()),
            Kind::Mix => Some(self.number("right", row) == Some(1.0)),
            Kind::Recordings => None,
        }
    }
}

/// What is told of the runs with one rig, mission and variant.
#[derive(Default)]
struct Tally {
    runs: usize,
    succeeded: usize,
    outcomes: BTreeMap<String, usize>,
    verdicts: BTreeMap<String, usize>,
    right: (usize, usize),
    values: BTreeMap<&'static str, Vec<f64>>,
}

/// A run that went badly: worse ones are less.
#[derive(PartialEq)]
struct Worst {
    rank: (u8, f64),
    run: u64,
    id: String,
    what: String,
    how: String,
}

/// One parameter that a variant draws or lists, on one rig.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Swept {
    variant: String,
    column: String,
    rig: String,
}

#[derive(Default)]
struct Bins {
    range: Option<[f64; 2]>,
    /// Succeeded and all, by stretch.
    counts: Vec<(usize, usize)>,
}

/// Reads a sweep's merged results and tells what they show. `folder` is the sweep's as a shell takes it, for command lines.
pub fn report(store: &Store, results: &Path, folder: &str) -> Result<Report, CampaignError> {
    let plan = store.plan();
    let kind = plan.file().kind;
    let found = Table::open(results)?;
    let names: Vec<String> = found.columns().iter().map(|column| column.name.clone()).collect();
    let swept = swept_columns(store);
    let mut wanted: BTreeSet<String> = swept.iter().map(|(_, column)| column.clone()).collect();
    wanted.extend(FIGURES.map(|(name, ..)| name.to_owned()));
    wanted.extend(["run", "right"].map(str::to_owned));
    let step = plan.runs().div_ceil(VALUES_MAX).max(1);

    let mut tallies: BTreeMap<(String, String, String), Tally> = BTreeMap::new();
    let mut bins: BTreeMap<Swept, Bins> = BTreeMap::new();
    let mut worst: Vec<Worst> = Vec::new();
    let mut run = 0_u64;
    found.for_each_group(|cells| {
        let group = Group::of(&names, &wanted, &cells);
        for row in 0..group.rows {
            let of = |column: &str| group.text(column, row).to_owned();
            let succeeded = group.succeeded(kind, row);
            let tally = tallies.entry((of("rig"), of("mission"), of("variant"))).or_default();
            tally.add(&group, row, succeeded, run.is_multiple_of(step));
            for swept in swept_of(&swept, &group, row) {
                if let Some(x) = group.number(&swept.column, row) {
                    let [low, high] = bins.entry(swept).or_default().range.get_or_insert([x, x]);
                    (*low, *high) = (low.min(x), high.max(x));
                }
            }
            if succeeded == Some(false) || of("outcome") == Outcome::Error.name() {
                keep_worst(&mut worst, Worst::of(&group, row, run));
            }
            run += 1;
        }
        Ok(())
    })?;
    found.for_each_group(|cells| {
        let group = Group::of(&names, &wanted, &cells);
        for row in 0..group.rows {
            for swept in swept_of(&swept, &group, row) {
                let (Some(x), Some(bins)) = (group.number(&swept.column, row), bins.get_mut(&swept)) else {
                    continue;
                };
                bins.add(x, group.succeeded(kind, row) == Some(true));
            }
        }
        Ok(())
    })?;
    Ok(Report {
        title: plan.file().name.clone(),
        verdict: verdict(store, &tallies),
        sections: sections(store, &tallies, &bins, &worst, folder),
    })
}

/// Variant and column of every parameter that takes more than one value; of a case mix, each effect's parameters.
fn swept_columns(store: &Store) -> Vec<(Option<String>, String)> {
    let plan = store.plan();
    if plan.file().kind == Kind::Mix {
        return plan.parameters().iter().map(|(effect, key)| (None, parameter_column(effect, key))).collect();
    }
    let mut columns = Vec::new();
    for variant in &plan.file().variants {
        for effect in &variant.effects {
            for (key, draw) in &effect.parameters {
                if !matches!(draw, Draw::Fixed(_)) && draw.points() != 0 {
                    columns.push((Some(variant.name.clone()), parameter_column(&effect.effect, key)));
                }
            }
        }
    }
    columns
}

fn swept_of(columns: &[(Option<String>, String)], group: &Group, row: usize) -> Vec<Swept> {
    let variant = group.text("variant", row);
    let of = |(of, column): &(Option<String>, String)| {
        let is_here = of.as_deref().is_none_or(|of| of == variant);
        is_here.then(|| Swept {
            variant: variant.to_owned(),
            column: column.clone(),
            rig: group.text("rig", row).to_owned(),
        })
    };
    columns.iter().filter_map(of).collect()
}

impl Bins {
    /// Sizes that span more than a factor of ten are told in equal ratios.
    fn is_log(&self) -> bool {
        self.range.is_some_and(|[low, high]| low > 0.0 && high > 10.0 * low)
    }

    fn ends(&self, place: usize) -> [f64; 2] {
        let [low, high] = self.range.unwrap_or([0.0, 1.0]);
        [place, place + 1].map(|place| {
            let share = place as f64 / BINS as f64;
            if self.is_log() { low * (high / low).powf(share) } else { low + (high - low) * share }
        })
    }

    fn add(&mut self, x: f64, succeeded: bool) {
        self.counts.resize(BINS, (0, 0));
        let place = (0..BINS - 1).find(|place| x < self.ends(*place)[1]).unwrap_or(BINS - 1);
        let (good, all) = &mut self.counts[place];
        *good += usize::from(succeeded);
        *all += 1;
    }

    /// Middle of each stretch that has runs, and the share of those that succeeded.
    fn shares(&self) -> Vec<(f64, Share)> {
        let with_runs = self.counts.iter().enumerate().filter(|(_, (_, all))| *all > 0);
        with_runs
            .map(|(place, (good, all))| {
                let [low, high] = self.ends(place);
                let middle = if self.is_log() { (low * high).sqrt() } else { f64::midpoint(low, high) };
                (middle, share(*good, *all))
            })
            .collect()
    }
}

fn share(count: usize, of: usize) -> Share {
    Share::wilson((0..of).map(|i| i < count))
}

impl Tally {
    fn add(&mut self, group: &Group, row: usize, succeeded: Option<bool>, is_drawn: bool) {
        self.runs += 1;
        self.succeeded += usize::from(succeeded == Some(true));
        *self.outcomes.entry(group.text("outcome", row).to_owned()).or_default() += 1;
        let verdict = group.text("verdict", row);
        if !verdict.is_empty() {
            *self.verdicts.entry(verdict.to_owned()).or_default() += 1;
        }
        if let Some(right) = group.number("right", row) {
            self.right.0 += usize::from(right == 1.0);
            self.right.1 += 1;
        }
        if is_drawn {
            for (name, ..) in FIGURES {
                self.values.entry(name).or_default().extend(group.number(name, row));
            }
        }
    }
}

impl Worst {
    fn of(group: &Group, row: usize, run: u64) -> Self {
        let outcome = group.text("outcome", row);
        let rank = match outcome {
            "error" => 0,
            "stopped" => 1,
            _ => 2,
        };
        // The greatest error of those that flew, the surest of those that were wrong.
        let size = group
            .number("rms_error_m", row)
            .or_else(|| group.number("confidence", row))
            .unwrap_or(f64::INFINITY);
        let of = |column: &str| group.text(column, row);
        let parts = [of("mission"), of("rig"), of("recording"), of("variant"), of("effects")];
        let mut how = vec![outcome.to_owned()];
        how.extend(
            [of("missed"), of("reason"), of("verdict")]
                .into_iter()
                .filter(|text| !text.is_empty())
                .map(str::to_owned),
        );
        Self {
            rank: (rank, -size),
            run,
            id: of("id").to_owned(),
            what: parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", "),
            how: how.join(": "),
        }
    }
}

fn keep_worst(worst: &mut Vec<Worst>, new: Worst) {
    let order = |a: &Worst, b: &Worst| {
        a.rank.0.cmp(&b.rank.0).then(a.rank.1.total_cmp(&b.rank.1)).then(a.run.cmp(&b.run))
    };
    let place = worst.partition_point(|known| order(known, &new).is_lt());
    if place < WORST {
        worst.insert(place, new);
        worst.truncate(WORST);
    }
}

fn percent(share: &Share) -> String {
    format!("{} %", digits(100.0 * share.value()))
}

fn interval(share: &Share) -> String {
    format!("{} to {} %", digits(100.0 * share.low), digits(100.0 * share.high))
}

fn verdict(store: &Store, tallies: &BTreeMap<(String, String, String), Tally>) -> Verdict {
    let plan = store.plan();
    let runs: usize = tallies.values().map(|tally| tally.runs).sum();
    let succeeded: usize = tallies.values().map(|tally| tally.succeeded).sum();
    let mut outcomes: BTreeMap<&str, usize> = BTreeMap::new();
    for (outcome, count) in tallies.values().flat_map(|tally| &tally.outcomes) {
        *outcomes.entry(outcome).or_default() += count;
    }
    let words = match plan.file().kind {
        Kind::Flights => format!("{succeeded} of {runs} flights met their missions' criteria"),
        Kind::Mix => format!("The cause was named rightly in {succeeded} of {runs} sets"),
        Kind::Recordings => format!("{runs} diagnoses of recordings"),
    };
    let mut shown: Vec<Tile> = outcomes
        .into_iter()
        .map(|(outcome, count)| Tile {
            value: count.to_string(),
            of: outcome.to_owned(),
            beside: String::new(),
        })
        .collect();
    if plan.file().kind != Kind::Recordings {
        let share = share(succeeded, runs);
        let of = if plan.file().kind == Kind::Mix { "right" } else { "passed" };
        shown.insert(0, Tile { value: percent(&share), of: of.to_owned(), beside: interval(&share) });
    }
    let particulars = vec![
        ("sweep", plan.file().name.clone()),
        ("id", plan.id().get(..16).unwrap_or_default().to_owned()),
        ("bench", VERSION.to_owned()),
    ];
    let below = html! {
        p.lead { (plan.file().description) }
        (facts(particulars))
        (tiles(shown))
    };
    Verdict::new(Tone::Plain, words).with(below)
}

fn sections(
    store: &Store,
    tallies: &BTreeMap<(String, String, String), Tally>,
    bins: &BTreeMap<Swept, Bins>,
    worst: &[Worst],
    folder: &str,
) -> Vec<Section> {
    let kind = store.plan().file().kind;
    let mut sections = Vec::new();
    if kind != Kind::Recordings {
        let mut rows = Rows::new([0.0, 100.0]);
        for (key, tally) in tallies {
            let share = share(tally.succeeded, tally.runs);
            let bar = Bar {
                value: 100.0 * share.value(),
                interval: Some([100.0 * share.low, 100.0 * share.high]),
                from: None,
                colour: 0,
            };
            rows.row(
                name(key),
                Some(bar),
                &format!("{} of {}, {}", tally.succeeded, tally.runs, interval(&share)),
            );
        }
        let what = if kind == Kind::Mix { "right, %" } else { "passed, %" };
        sections.push(
            Section::new("Success", rows.finish(what))
                .told("Intervals hold the probability in 95 % of cases (Wilson)."),
        );
    }
    sections.push(Section::new("All runs", all(tallies)));
    let sizes = sizes(bins);
    if !sizes.is_empty() {
        let body = html! { @for plot in &sizes { (plot) } };
        let words = "The share that succeeded over the size of what was added, in stretches of equal width or ratio, with intervals of 95 % (Wilson).";
        sections.push(Section::new("Success against size", body).told(words));
    }
    let distributions: Vec<Plot> = FIGURES
        .iter()
        .filter_map(|(column, words, unit)| distribution(tallies, column, words, unit))
        .collect();
    if !distributions.is_empty() {
        let body = html! { @for plot in &distributions { (plot) } };
        let words = format!(
            "The share of runs with a value up to the one below. Runs that do not define a figure are left out; at most {VALUES_MAX} evenly chosen ones are drawn."
        );
        sections.push(Section::new("Distributions", body).told(words));
    }
    if !worst.is_empty() {
        let can_replay = kind == Kind::Flights;
        let rows = worst.iter().map(|worst| {
            let command = format!(
                "bench sweep replay {folder} {} -o {}.mcap",
                worst.id,
                &worst.id[..worst.id.len().min(8)]
            );
            let again = if can_replay {
                html! { code { (command) } }
            } else {
                html! { code { (worst.id) } }
            };
            vec![cell(&worst.what), cell(&worst.how), again]
        });
        let again = if can_replay { "to fly and record it again" } else { "id" };
        let columns = [Head::Words("run"), Head::Words("what came of it"), Head::Words(again)];
        sections.push(Section::new("Worst runs", table(&columns, rows)));
    }
    sections
}

fn name((rig, mission, variant): &(String, String, String)) -> String {
    [rig, mission, variant]
        .into_iter()
        .filter(|part| !part.is_empty())
        .cloned()
        .collect::<Vec<_>>()
        .join(", ")
}

fn all(tallies: &BTreeMap<(String, String, String), Tally>) -> Markup {
    let outcomes: BTreeSet<&String> = tallies.values().flat_map(|tally| tally.outcomes.keys()).collect();
    let verdicts: BTreeSet<&String> = tallies.values().flat_map(|tally| tally.verdicts.keys()).collect();
    let is_judged = tallies.values().any(|tally| tally.right.1 > 0);
    let shown: Vec<&(&str, &str, &str)> = FIGURES
        .iter()
        .filter(|(column, ..)| tallies.values().any(|tally| !tally.values_of(column).is_empty()))
        .collect();
    let heads: Vec<String> = shown
        .iter()
        .map(
            |(_, words, unit)| {
                if *unit == "1" { format!("{words}: median") } else { format!("{words}, {unit}: median") }
            },
        )
        .collect();
    let verdict_heads: Vec<String> = verdicts.iter().map(|verdict| format!("verdict {verdict}")).collect();
    let mut columns =
        vec![Head::Words("rig"), Head::Words("mission"), Head::Words("variant"), Head::Number("runs")];
    columns.extend(outcomes.iter().map(|outcome| Head::Number(outcome)));
    columns.extend(verdict_heads.iter().map(|head| Head::Number(head)));
    columns.extend(is_judged.then_some(Head::Number("right")));
    columns.extend(heads.iter().map(|head| Head::Number(head)));
    let rows = tallies.iter().map(|((rig, mission, variant), tally)| {
        let mut row = vec![cell(rig), cell(mission), cell(variant), cell(tally.runs)];
        row.extend(outcomes.iter().map(|outcome| cell(tally.outcomes.get(*outcome).copied().unwrap_or(0))));
        row.extend(verdicts.iter().map(|verdict| cell(tally.verdicts.get(*verdict).copied().unwrap_or(0))));
        row.extend(is_judged.then(|| cell(format!("{} of {}", tally.right.0, tally.right.1))));
        row.extend(shown.iter().map(|(column, ..)| {
            let median = bench_statistics::median(tally.values_of(column).iter().copied());
            cell(median.map_or_else(|| "-".to_owned(), digits))
        }));
        row
    });
    table(&columns, rows)
}

impl Tally {
    fn values_of(&self, column: &str) -> &[f64] {
        self.values.get(column).map_or(&[], Vec::as_slice)
    }
}

/// A plot for each swept parameter of each variant, a series for each rig.
fn sizes(bins: &BTreeMap<Swept, Bins>) -> Vec<Plot> {
    let mut by_parameter: BTreeMap<(&str, &str), Vec<(&str, &Bins)>> = BTreeMap::new();
    for (swept, bins) in bins {
        by_parameter.entry((&swept.variant, &swept.column)).or_default().push((&swept.rig, bins));
    }
    by_parameter
        .into_iter()
        .map(|((variant, column), of)| {
            let before = if variant.is_empty() { String::new() } else { format!("{variant}: ") };
            let mut panel = Panel::new("succeeded, %").y_fixed([0.0, 100.0]);
            for (colour, (rig, bins)) in of.iter().take(SERIES_MAX).enumerate() {
                let shares = bins.shares();
                let band = shares.iter().map(|(x, share)| [*x, 100.0 * share.low, 100.0 * share.high]);
                let points = shares.iter().map(|(x, share)| (*x, 100.0 * share.value()));
                panel = panel.with(Series::band("", Mark::Band, colour, band)).with(Series::new(
                    *rig,
                    Mark::Line,
                    colour,
                    points,
                ));
            }
            let title = format!("{before}success against {column}");
            let plot = Plot::new(title, format!("{before}{column}"));
            let plot = if of.iter().all(|(_, bins)| bins.is_log()) { plot.log_x() } else { plot };
            plot.panel(panel)
        })
        .collect()
}

/// The empirical distribution of a figure, a series for each rig, mission and variant.
fn distribution(
    tallies: &BTreeMap<(String, String, String), Tally>,
    column: &str,
    words: &str,
    unit: &str,
) -> Option<Plot> {
    let x_title = if unit == "1" { words.to_owned() } else { format!("{words}, {unit}") };
    let mut panel = Panel::new("runs, %").y_fixed([0.0, 100.0]);
    let with_values = tallies.iter().filter(|(_, tally)| !tally.values_of(column).is_empty());
    for (colour, (key, tally)) in with_values.take(SERIES_MAX).enumerate() {
        let sorted = Sorted::of(tally.values_of(column).iter().copied());
        let n = sorted.values().len() as f64;
        let points = sorted.values().iter().enumerate().map(|(i, x)| (*x, 100.0 * (i + 1) as f64 / n));
        panel = panel.with(Series::new(name(key), Mark::Steps, colour, points));
    }
    (!panel.is_empty()).then(|| Plot::new(format!("distribution of {words}"), x_title).panel(panel))
}
