//! All results of a suite. Serialised, they are the form `bench.test/1`.

use std::collections::BTreeMap;

use bench_rig::keys::unit;
use serde::{Deserialize, Serialize};

use crate::{Side, Suite, Test};

/// What a test, or one flight of it, comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// All limits are kept and all comparisons are within tolerance.
    Passed,
    /// A limit is not kept, or a comparison is beyond tolerance.
    Failed,
    /// It could not be flown to its end, or not be recorded whole.
    Error,
    /// Some repeats passed and some did not.
    Flaky,
    /// It was not flown, because the suite was stopped before.
    NotRun,
}

impl Outcome {
    /// As told.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "failed",
            Self::Error => "error",
            Self::Flaky => "flaky",
            Self::NotRun => "not run",
        }
    }
}

/// The results of a suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`Report::SCHEMA`].
    pub schema: String,
    /// The suite's name.
    pub suite: String,
    /// What it is for.
    pub description: String,
    /// Version of the bench that flew it.
    pub bench_version: String,
    /// What is known of the station, from `--meta`.
    pub meta: BTreeMap<String, String>,
    /// What all tests together come to: passed where all are.
    pub outcome: Outcome,
    /// How many tests came to what.
    pub counts: Counts,
    /// The tests, in the order of the file.
    pub tests: Vec<Tested>,
    /// What the diagnosis says where two modes differ.
    pub diagnoses: Vec<Diagnosed>,
    /// When it was flown.
    pub times: Times,
}

/// How many came to what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Passed.
    pub passed: usize,
    /// Failed.
    pub failed: usize,
    /// Errors.
    pub errors: usize,
    /// Flaky.
    pub flaky: usize,
    /// Not run.
    pub not_run: usize,
}

impl Counts {
    /// Counts outcomes.
    pub fn of(outcomes: impl IntoIterator<Item = Outcome>) -> Self {
        let mut counts = Self::default();
        for outcome in outcomes {
            *match outcome {
                Outcome::Passed => &mut counts.passed,
                Outcome::Failed => &mut counts.failed,
                Outcome::Error => &mut counts.errors,
                Outcome::Flaky => &mut counts.flaky,
                Outcome::NotRun => &mut counts.not_run,
            } += 1;
        }
        counts
    }

    /// All of them.
    pub const fn all(&self) -> usize {
        self.passed + self.failed + self.errors + self.flaky + self.not_run
    }
}

/// When something was done, by the wall clock. Everything else of a report repeats to the byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// When it began, seconds since 1970 (UTC).
    pub started_unix_s: f64,
    /// How long it took, s.
    pub took_s: f64,
}

impl Times {
    /// When it began, as ISO 8601 writes it, in UTC and to the second.
    pub fn began_utc(&self) -> String {
        let seconds = if self.started_unix_s.is_finite() { self.started_unix_s as i64 } else { 0 };
        let instant = jiff::Timestamp::from_second(seconds).unwrap_or_default();
        instant.strftime("%Y-%m-%dT%H:%M:%S").to_string()
    }
}

/// One test with all its flights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tested {
    /// Names it within the suite.
    pub id: String,
    /// The case that it is of.
    pub case: String,
    /// What the case is for; may be empty.
    pub description: String,
    /// The rig's name.
    pub rig: String,
    /// The mission's name.
    pub mission: String,
    /// `sim`, `frames`, `loopback` or `transmitter`.
    pub mode: String,
    /// Effects that were added, as `--effect` takes them.
    pub effects: Vec<String>,
    /// Seed of the first repeat.
    pub seed: u64,
    /// The case's tags.
    pub tags: Vec<String>,
    /// The case's requirements.
    pub requirements: Vec<String>,
    /// What it comes to.
    pub outcome: Outcome,
    /// How many of its flights came to what.
    pub counts: Counts,
    /// Its flights, in their order.
    pub runs: Vec<Run>,
    /// Limits on the spread of the flights.
    pub spread: Vec<Check>,
}

/// One flight of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Which repeat it is, from zero.
    pub repeat: u32,
    /// Seed of its noise.
    pub seed: u64,
    /// Passed, failed or error.
    pub outcome: Outcome,
    /// Why it is an error, in words.
    pub reason: Option<String>,
    /// Whether a device failed or a safety limit ended the flight.
    pub stopped: bool,
    /// Whether records are missing in the recording.
    pub data_lost: bool,
    /// Figures of the flight by name; their units stand in docs/test.md.
    pub figures: BTreeMap<String, f64>,
    /// The limits.
    pub checks: Vec<Check>,
    /// What repeats may have a spread of; for the reports of a suite that goes on.
    pub spread: Vec<Option<f64>>,
    /// What it was held against.
    pub comparisons: Vec<Comparison>,
    /// Its recording, where there is one.
    pub recording: Option<Attached>,
    /// When it was flown.
    pub times: Times,
}

impl Run {
    /// A flight of which nothing is known yet but that it could not be judged.
    pub fn error(repeat: u32, seed: u64, reason: String) -> Self {
        Self {
            repeat,
            seed,
            outcome: Outcome::Error,
            reason: Some(reason),
            stopped: false,
            data_lost: false,
            figures: BTreeMap::new(),
            checks: Vec::new(),
            spread: Vec::new(),
            comparisons: Vec::new(),
            recording: None,
            times: Times::default(),
        }
    }

    /// Settles what it comes to, from its reason, its limits and its comparisons.
    pub fn settle(&mut self) {
        let kept = self.checks.iter().all(|check| check.passed);
        let like = self.comparisons.iter().all(|comparison| comparison.passed);
        self.outcome = if self.reason.is_some() {
            Outcome::Error
        } else if kept && like {
            Outcome::Passed
        } else {
            Outcome::Failed
        };
    }

    /// All that keeps it from passing, a line each.
    pub fn faults(&self) -> Vec<String> {
        let checks = self.checks.iter().filter(|check| !check.passed).map(Check::in_words);
        let different = self.comparisons.iter().filter(|comparison| !comparison.passed);
        self.reason.iter().cloned().chain(checks).chain(different.map(Comparison::in_words)).collect()
    }
}

/// A recording as a report names it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Attached {
    /// The file, from the folder of the results.
    pub file: String,
    /// SHA-256 of the file, in hexadecimal digits.
    pub sha256: String,
    /// Its size.
    pub bytes: u64,
}

/// One limit, held against a flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// What is limited: a key such as `peak_max_m`, or a statistic of a field.
    pub about: String,
    /// What the flight came to; null where it does not define it, which fails.
    pub value: Option<f64>,
    /// The unit of both; empty for a number without unit.
    pub unit: String,
    /// `at least` or `at most`.
    pub relation: String,
    /// The limit.
    pub limit: f64,
    /// Whether it is kept.
    pub passed: bool,
}

impl Check {
    /// A value against its limit. `unit` as keys end in it, or as fields have it.
    pub fn new(about: String, value: Option<f64>, unit: &str, side: Side, limit: f64) -> Self {
        Self {
            about,
            passed: value.is_some_and(|value| side.holds(value, limit)),
            value,
            unit: unit.to_owned(),
            relation: side.words().to_owned(),
            limit,
        }
    }

    /// A criterion of the mission.
    pub(crate) fn of_mission(check: &bench_run::Check) -> Self {
        let side = if check.at_least { Side::Least } else { Side::Most };
        Self::new(check.key.to_owned(), check.value, unit(check.key).unwrap_or(""), side, check.limit)
    }

    /// In a line: `peak_max_m: 0.52 m, at most 0.5 m`.
    pub fn in_words(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        let value = match self.value {
            Some(value) => format!("{}{unit}", bench_page::digits(value)),
            None => "not reached".to_owned(),
        };
        format!("{}: {value}, {} {}{unit}", self.about, self.relation, self.limit)
    }
}

/// What a recording was held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The stored recording of the same test.
    Baseline,
    /// The same test in another mode or with other effects.
    BackToBack,
}

impl Kind {
    /// As told.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::BackToBack => "back-to-back",
        }
    }
}

/// A recording held against another one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Baseline or back-to-back.
    pub kind: Kind,
    /// The baseline's file, or the id of the other test.
    pub with: String,
    /// Whether they are the same or within tolerance.
    pub passed: bool,
    /// What `bench diff` says, in a line.
    pub summary: String,
    /// The fields that differ beyond tolerance, worst first, a dozen at most.
    pub differences: Vec<Difference>,
}

impl Comparison {
    /// In a line.
    pub fn in_words(&self) -> String {
        let against = match self.kind {
            Kind::Baseline => "against the baseline",
            Kind::BackToBack => "against",
        };
        format!("{against} {}: {}", self.with, self.summary)
    }
}

/// A field that differs beyond its tolerance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// Topic and name.
    pub field: String,
    /// Its unit; empty where there is none.
    pub unit: String,
    /// The size of the difference over its tolerance; null where that is 0, or where the field is missing in one of them.
    pub times_tolerance: Option<f64>,
    /// Largest difference at one instant, in the field's unit; null where it has none.
    pub largest: Option<f64>,
    /// Mean difference with its sign, in the field's unit: the test's less the other's.
    pub mean: Option<f64>,
}

/// What the diagnosis says of flights that differ from their partners.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Diagnosed {
    /// The tests whose flights were diagnosed.
    pub tests: Vec<String>,
    /// Effects, `none`, `unknown` or `inconclusive`; null where the flights could not be diagnosed.
    pub verdict: Option<String>,
    /// What these flights cannot tell from what leads; most probable first.
    pub alternatives: Vec<String>,
    /// How probable what leads is together with these, from 0 to 1; null without a verdict.
    pub probability: Option<f64>,
    /// What is most probable, told or not: name and probability from 0 to 1, three at most.
    pub leading: Vec<(String, f64)>,
    /// The verdict in a sentence, or why there is none.
    pub words: String,
}

impl Diagnosed {
    /// Which tests it is of, short.
    pub fn of(&self) -> String {
        match self.tests.as_slice() {
            [] => String::new(),
            [test] => test.clone(),
            [first, others @ ..] => format!("{first} and {} more", others.len()),
        }
    }
}

impl Tested {
    /// A test that nothing was flown of yet.
    pub fn new(suite: &Suite, test: &Test, rig: &str, mission: &str) -> Self {
        let case = &suite.cases[test.case];
        Self {
            id: test.id.clone(),
            case: case.name.clone(),
            description: case.description.clone(),
            rig: rig.to_owned(),
            mission: mission.to_owned(),
            mode: test.mode.name().to_owned(),
            effects: test.effects.clone(),
            seed: test.seed,
            tags: case.tags.clone(),
            requirements: case.requirements.clone(),
            outcome: Outcome::NotRun,
            counts: Counts::default(),
            runs: Vec::new(),
            spread: Vec::new(),
        }
    }

    /// Settles what it comes to from its flights, of which there should be so many.
    pub fn settle(&mut self, suite: &Suite, repeats: u32) {
        let outcomes = || self.runs.iter().map(|run| run.outcome);
        self.counts = Counts { not_run: repeats as usize - self.runs.len(), ..Counts::of(outcomes()) };
        let limits =
            suite.cases.iter().find(|case| case.name == self.case).map_or(&[][..], |case| &case.limits);
        let judged: Vec<_> =
            self.runs.iter().filter(|run| run.reason.is_none()).map(|run| run.spread.clone()).collect();
        self.spread = if self.counts.not_run == 0 { crate::spread(limits, &judged) } else { Vec::new() };
        let is_spread = self.spread.iter().any(|check| !check.passed);
        self.outcome = match self.counts {
            Counts { not_run: 1.., .. } => Outcome::NotRun,
            Counts { failed: 0, errors: 0, .. } if is_spread => Outcome::Failed,
            Counts { failed: 0, errors: 0, .. } => Outcome::Passed,
            Counts { passed: 1.., .. } => Outcome::Flaky,
            Counts { errors: 1.., .. } => Outcome::Error,
            _ => Outcome::Failed,
        };
    }

    /// All that keeps it from passing, a line each; with several flights each line says which.
    pub fn faults(&self) -> Vec<String> {
        let several = self.runs.len() > 1;
        let mut lines = Vec::new();
        for run in &self.runs {
            for fault in run.faults() {
                lines.push(if several {
                    format!("repeat {} (seed {}): {fault}", run.repeat + 1, run.seed)
                } else {
                    fault
                });
            }
        }
        lines.extend(self.spread.iter().filter(|check| !check.passed).map(Check::in_words));
        lines
    }

    /// How many of its flights passed, in words; empty where there is one.
    pub fn share(&self) -> String {
        match self.counts.all() {
            0 | 1 => String::new(),
            all => format!("{} of {all} passed", self.counts.passed),
        }
    }
}

impl Report {
    /// Name and version of the JSON form.
    pub const SCHEMA: &'static str = "bench.test/1";

    /// Settles what all tests together come to.
    pub fn settle(&mut self) {
        self.counts = Counts::of(self.tests.iter().map(|test| test.outcome));
        self.outcome = match self.counts {
            Counts { errors: 1.., .. } => Outcome::Error,
            Counts { failed: 1.., .. } => Outcome::Failed,
            Counts { flaky: 1.., .. } => Outcome::Flaky,
            Counts { not_run: 1.., .. } => Outcome::NotRun,
            _ => Outcome::Passed,
        };
    }

    /// What all tests come to, in a sentence.
    pub fn headline(&self) -> String {
        let all = self.counts.all();
        if self.outcome == Outcome::Passed {
            return match all {
                1 => "The test passed".to_owned(),
                all => format!("All {all} tests passed"),
            };
        }
        let told = [
            (self.counts.failed, "failed"),
            (self.counts.errors, "ended in an error"),
            (self.counts.flaky, if self.counts.flaky == 1 { "is flaky" } else { "are flaky" }),
            (self.counts.not_run, if self.counts.not_run == 1 { "was not run" } else { "were not run" }),
        ];
        let told: Vec<String> = told
            .into_iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        format!("{} of {all} tests passed: {}", self.counts.passed, told.join(", "))
    }
}
