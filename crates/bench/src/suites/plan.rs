//! A suite with its rigs and missions read, and all that is wrong with it.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use anyhow::bail;
use bench_plant::effects::{EffectError, Effects, parse_effect};
use bench_recording::diff::Tolerances;
use bench_rig::{Actuation, Bench, Mission, Problem, Rig, RigError};
use bench_suite::{Case, Limit, MissionCriteria, Mode, Side, Suite, Test};

use super::{Ports, sha256};
use crate::{
    files,
    library::{self, Kind},
    recorded, seen, words,
};

/// A test with all that it needs to be flown.
#[derive(Clone, Debug)]
pub struct Planned {
    pub test: Test,
    /// The rig as it is thought to be.
    pub nominal: Rig,
    /// The rig with the effects of the test and of the command line.
    pub rig: Rig,
    pub mission: Mission,
    pub rig_path: PathBuf,
    pub mission_path: PathBuf,
}

impl Planned {
    /// Effects beyond the nominal rig, as `--effect` takes them.
    pub fn added(&self) -> Vec<String> {
        recorded::added_effects(&self.nominal, &self.rig)
    }
}

/// Which tests are wanted.
#[derive(Debug, Default)]
pub struct Selected<'a> {
    pub tags: &'a [String],
    pub tests: &'a [String],
    pub modes: Vec<Mode>,
}

impl Selected<'_> {
    fn picks(&self, case: &Case, test: &Test) -> bool {
        let tagged = self.tags.is_empty() || case.tags.iter().any(|tag| self.tags.contains(tag));
        let named = self.tests.is_empty() || self.tests.iter().any(|part| test.id.contains(part.as_str()));
        let mode = self.modes.is_empty() || self.modes.contains(&test.mode);
        tagged && named && mode
    }
}

/// A suite that can be flown.
#[derive(Debug)]
pub struct Plan {
    pub suite: Suite,
    /// Its file.
    pub path: PathBuf,
    pub tests: Vec<Planned>,
    /// Tolerances of each case that has some, by its place in the suite.
    pub tolerances: BTreeMap<usize, Tolerances>,
    /// The boards.
    pub ports: Ports,
    /// Whether tests were left out by what was selected.
    pub is_part: bool,
    text: String,
}

impl Plan {
    /// Reads a suite and all that it names, and picks tests. `ports` are the command line's; `None` where nothing is to be flown.
    /// `effects` are added to every test.
    pub fn read(
        named: &Path,
        selected: &Selected<'_>,
        ports: Option<&[String]>,
        effects: &[String],
    ) -> anyhow::Result<(Self, Vec<Problem>)> {
        let (path, text) = files::text_of(Kind::Suite, named)?;
        let (suite, mut problems) = Suite::read_as_far_as_possible(&path, &text)?;
        let all = suite.tests();
        let whole = all.len();
        let picked: Vec<Test> =
            all.into_iter().filter(|test| selected.picks(&suite.cases[test.case], test)).collect();
        if picked.is_empty() && problems.is_empty() {
            bail!(
                "no test of {} is as --tag, --test and --mode ask; `bench test {} --list` lists them",
                path.display(),
                named.display()
            );
        }
        let is_part = picked.len() < whole;
        let ports = ports.map(|named| Ports::new(named, suite.port.as_deref())).transpose()?;
        let mut resolver =
            Resolver { suite: &suite, path: &path, effects, rigs: BTreeMap::new(), problems: &mut problems };
        let tests = resolver.tests(picked, ports.as_ref());
        let mut tolerances = BTreeMap::new();
        for (index, case) in suite.cases.iter().enumerate() {
            let Some(file) = &case.tolerances else { continue };
            match Tolerances::load(beside(&path, file)) {
                Ok(read) => _ = tolerances.insert(index, read),
                Err(error) => problems.push(case.problem(&path, "tolerances", &error.to_string())),
            }
        }
        let ports = ports.unwrap_or_default();
        Ok((Self { suite, path, tests, tolerances, ports, is_part, text }, problems))
    }

    /// Says all that is wrong, if something is.
    pub fn refuse(&self, problems: &[Problem]) -> anyhow::Result<()> {
        if problems.is_empty() {
            return Ok(());
        }
        let mut sorted: Vec<&Problem> = problems.iter().collect();
        // The suite's own first, from top to bottom.
        sorted.sort_by_key(|problem| (problem.at().file != self.path, &problem.at().file, problem.at().line));
        let lines: Vec<String> = sorted.iter().map(ToString::to_string).collect();
        bail!(
            "{} in {}; nothing was flown\n{}",
            words::count(problems.len() as u64, "problem"),
            self.path.display(),
            lines.join("\n")
        )
    }

    /// Leaves out all tests that no baseline is wanted of.
    pub fn keep_those_with_baselines(&mut self) {
        let cases = &self.suite.cases;
        self.tests.retain(|planned| cases[planned.test.case].compare.baseline);
    }

    /// A case's name of a file, from the suite's folder.
    pub fn beside(&self, name: &str) -> PathBuf {
        beside(&self.path, name)
    }

    /// Stands for all that decides what is flown: two plans with the same give the same results.
    pub fn digest(&self, meta: &BTreeMap<String, String>) -> String {
        let mut text = format!("{}\n{}\n{meta:?}\n", env!("CARGO_PKG_VERSION"), self.text);
        for planned in &self.tests {
            for part in [&planned.test.id, &planned.rig.to_toml(), &planned.mission.to_toml()] {
                text += part;
                text.push('\n');
            }
        }
        sha256(text)
    }
}

/// A file that a suite names stands beside it; beside an embedded suite nothing stands but the library.
fn beside(suite: &Path, name: &str) -> PathBuf {
    let folder = if library::is_embedded(suite) { None } else { suite.parent() };
    folder.map_or_else(|| PathBuf::from(name), |folder| folder.join(name))
}

/// What is wrong with an effect. Its place is that of the suite's key, not that of a flag.
fn of_effect(error: &EffectError) -> String {
    let words = error.to_string();
    words.strip_prefix("--effect:1: ").unwrap_or(&words).to_owned()
}

struct Resolver<'a> {
    suite: &'a Suite,
    path: &'a Path,
    /// Added to every test.
    effects: &'a [String],
    /// By name: path and rig, or nothing where it was told what is wrong.
    rigs: BTreeMap<String, Option<(PathBuf, Rig)>>,
    problems: &'a mut Vec<Problem>,
}

impl Resolver<'_> {
    fn tests(&mut self, tests: Vec<Test>, ports: Option<&Ports>) -> Vec<Planned> {
        let mut missions: BTreeMap<(String, String), Option<(PathBuf, Mission)>> = BTreeMap::new();
        let mut checked: Vec<(usize, String, String, Mode, Vec<String>)> = Vec::new();
        let mut planned = Vec::new();
        for test in tests {
            let case = &self.suite.cases[test.case];
            // Tests that differ by their seed alone have the same problems.
            let same = (test.case, test.rig.clone(), test.mission.clone(), test.mode, test.effects.clone());
            let is_first = !checked.contains(&same);
            if is_first {
                checked.push(same);
            }
            let Some((rig_path, nominal)) = self.rig(case, &test.rig) else { continue };
            let key = (test.rig.clone(), test.mission.clone());
            if !missions.contains_key(&key) {
                let read = self.mission(case, &test.mission, &rig_path);
                missions.insert(key.clone(), read);
            }
            let Some(Some((mission_path, mission))) = missions.get(&key).cloned() else { continue };
            if is_first {
                self.check(case, &test, &nominal, &mission, &rig_path, ports);
            }
            let mut rig = nominal.clone();
            let mut is_sound = true;
            for text in test.effects.iter().chain(self.effects) {
                match parse_effect(text) {
                    Ok(effect) => rig.effects.push(effect),
                    Err(error) => {
                        is_sound = false;
                        if is_first {
                            self.problems.push(case.problem(self.path, "effects", &of_effect(&error)));
                        }
                    }
                }
            }
            if let Err(error) = Effects::from_rig(&rig, test.seed)
                && is_sound
                && is_first
            {
                self.problems.push(case.problem(self.path, "effects", &of_effect(&error)));
            }
            planned.push(Planned { test, nominal, rig, mission, rig_path, mission_path });
        }
        planned
    }

    /// The file of what a suite names: beside it, or in the library.
    fn place(&self, name: &str) -> PathBuf {
        let place = beside(self.path, name);
        if place.is_file() { place } else { PathBuf::from(name) }
    }

    fn rig(&mut self, case: &Case, name: &str) -> Option<(PathBuf, Rig)> {
        if !self.rigs.contains_key(name) {
            let read = files::rig_path(&self.place(name)).and_then(|path| Ok((files::rig(&path)?, path)));
            let read = match read {
                Ok((rig, path)) => Some((path, rig)),
                Err(error) => {
                    self.tell(case, "rig", &error);
                    None
                }
            };
            self.rigs.insert(name.to_owned(), read);
        }
        self.rigs.get(name).cloned().flatten()
    }

    fn mission(&mut self, case: &Case, name: &str, rig: &Path) -> Option<(PathBuf, Mission)> {
        let place = self.place(name);
        let read = files::mission_path(&place.to_string_lossy(), rig)
            .and_then(|path| Ok((path.clone(), files::mission(&path.to_string_lossy(), rig)?)));
        match read {
            Ok(read) => Some(read),
            Err(error) => {
                self.tell(case, "mission", &error);
                None
            }
        }
    }

    /// What is wrong with a file that the suite names: its own problems where it has such.
    fn tell(&mut self, case: &Case, key: &str, error: &anyhow::Error) {
        match error.downcast_ref::<RigError>() {
            Some(RigError::Invalid(own)) => self.problems.extend(own.iter().cloned()),
            _ => self.problems.push(case.problem(self.path, key, &words::causes(error))),
        }
    }

    fn check(
        &mut self,
        case: &Case,
        test: &Test,
        rig: &Rig,
        mission: &Mission,
        rig_path: &Path,
        ports: Option<&Ports>,
    ) {
        let mut problem = |key: &str, detail: &str| {
            let problem = case.problem(self.path, key, detail);
            if !self.problems.contains(&problem) {
                self.problems.push(problem);
            }
        };
        if test.mode.is_hardware() && ports.is_some_and(|ports| ports.of(test.mode).is_none()) {
            problem(
                "mode",
                &format!(
                    "{} needs the board's port; name it with --port, or by `port` at the suite's top",
                    test.mode
                ),
            );
        }
        let wanted = match test.mode {
            Mode::Loopback => Some(Bench::Loopback),
            Mode::Transmitter => Some(Bench::Transmitter),
            Mode::Sim | Mode::Frames => None,
        };
        if wanted.is_some_and(|wanted| wanted != rig.bench) {
            problem(
                "mode",
                &format!(
                    "the rig {} is not of a {} bench, so it cannot be flown in this mode",
                    test.rig, test.mode
                ),
            );
        }
        if test.mode == Mode::Frames {
            for error in [seen::calibration(rig, rig_path).err(), seen::check_mission(mission).err()]
                .into_iter()
                .flatten()
            {
                problem("mode", &words::causes(&error));
            }
        }
        if test.mode == Mode::Transmitter
            && !(rig.effects.is_empty() && test.effects.is_empty() && self.effects.is_empty())
        {
            problem(
                "effects",
                "no effect can be added to the real airframe; leave effects out, or fly in another mode",
            );
        }
        let stick_unit = match rig.airframe.actuation {
            Actuation::Volt => "V",
            Actuation::Fraction => "fraction",
            Actuation::Count => "count",
        };
        for limit in &case.limits {
            match limit {
                Limit::Measure { name: "settling_time", side, .. }
                    if mission.criteria.settle_band_m.is_none() =>
                {
                    let key =
                        if *side == Side::Spread { "a spread of settling times" } else { "a settling time" };
                    problem(
                        "limits",
                        &format!(
                            "{key} needs a band, and the mission {} has no `settle_band_m` in its [criteria]",
                            test.mission
                        ),
                    );
                }
                Limit::Measure { .. } => {}
                Limit::Field(limit) => {
                    let of_sticks =
                        limit.field().unit == bench_recording::Field::ACTUATION && limit.statistic.has_unit();
                    if of_sticks && limit.unit != stick_unit {
                        problem(
                            "limit",
                            &format!(
                                "sticks of the rig {} are in {stick_unit}, not in {}: {}",
                                test.rig,
                                limit.unit,
                                limit.about()
                            ),
                        );
                    }
                }
            }
        }
        let compares = case.compare.baseline || case.compare.back_to_back;
        let criteria = &mission.criteria;
        let has_criteria = bench_run::check(criteria, &bench_run::Summary::default()).is_empty();
        if case.limits.is_empty()
            && !compares
            && case.mission_criteria == MissionCriteria::Count
            && has_criteria
        {
            problem(
                "mission",
                &format!(
                    "the mission {} has no criteria, and the case has neither limits nor `compare`: nothing could fail",
                    test.mission
                ),
            );
        }
    }
}
