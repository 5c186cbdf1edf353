//! A plan with all that it names, and its runs: each is made when it is asked for, so that a million of them take no memory.

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use bench_plant::effects::{LIBRARY, index_of, resolve_all};
use bench_rig::{EffectEntry, Location, Mission, Problem, Rig};
use bench_tuning::{Models, add_to_drawn};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::{
    CampaignError, VERSION,
    file::{Airframes, Diagnosing, Kind, PlanFile},
    keys::{MISSIONS, RECORDINGS, RIGS, VARIANT},
    mix,
};

/// Runs of a part where the plan does not say: some seconds of flights, some minutes of diagnoses.
const FLIGHTS_PER_PART: u64 = 1000;
const DIAGNOSES_PER_PART: u64 = 50;

/// Where a plan's rigs, missions and recordings are found by their names.
pub trait Library {
    /// A rig.
    fn rig(&self, name: &str) -> Result<Rig, Unfound>;
    /// The mission of this name for a rig, or those of a folder, each with its name.
    fn missions(&self, name: &str, rig: &str) -> Result<Vec<(String, Mission)>, Unfound>;
    /// A recording, or those of a folder.
    fn recordings(&self, name: &str) -> Result<Vec<PathBuf>, Unfound>;
}

/// Why something that a plan names cannot be used.
#[derive(Debug)]
pub enum Unfound {
    /// It is there and wrong.
    Problems(Vec<Problem>),
    /// In words.
    Words(String),
}

#[derive(Clone, Debug)]
struct Named<T> {
    name: String,
    content: T,
    /// SHA-256 of its content as text.
    sha256: String,
}

/// One combination of the lists that stand in a variant.
#[derive(Clone, Debug)]
struct Point {
    variant: usize,
    /// Which number of each parameter's list, in the order of the file; 0 for what is no list.
    places: Vec<u64>,
    definition: String,
}

/// A recording and what it holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Recorded {
    path: PathBuf,
    sha256: String,
}

/// A plan that can be run.
#[derive(Clone, Debug)]
pub struct Plan {
    file: PlanFile,
    text: String,
    rigs: Vec<Named<Rig>>,
    /// By rig, in the order of the plan.
    missions: Vec<Vec<Named<Mission>>>,
    recordings: Vec<Recorded>,
    points: Vec<Point>,
    /// Of a case mix, by rig: the effects of each set.
    causes: Vec<Vec<Vec<EffectEntry>>>,
    id: String,
}

/// One run.
#[derive(Clone, Debug)]
pub struct Run<'p> {
    /// Hash of all that is run: 32 hexadecimal digits, the same on every machine and in whatever order runs are done.
    pub id: String,
    /// Place in the plan, from 0.
    pub index: u64,
    /// What is run.
    pub work: Work<'p>,
}

/// What a run does.
#[derive(Clone, Debug)]
pub enum Work<'p> {
    /// A simulated flight.
    Flight(Box<FlightRun<'p>>),
    /// A diagnosis of a recording.
    Recording {
        /// Name and model; `None`: the rig that the recording carries.
        rig: Option<(&'p str, &'p Rig)>,
        /// The file.
        path: &'p Path,
        /// SHA-256 of its bytes when the plan was made.
        sha256: &'p str,
    },
    /// A diagnosis of a simulated set.
    Set {
        /// Name of the rig.
        rig_name: &'p str,
        /// The rig as it is thought to be.
        rig: &'p Rig,
        /// Flown in turn.
        missions: Vec<Mission>,
        /// Effects that the flights have beyond the rig.
        causes: &'p [EffectEntry],
        /// Seed of all else.
        set: u64,
    },
}

/// A simulated flight.
#[derive(Clone, Debug)]
pub struct FlightRun<'p> {
    /// Name of the rig in the plan.
    pub rig_name: &'p str,
    /// The rig as it is thought to be: what controller and diagnosis go by.
    pub nominal: &'p Rig,
    /// What flies.
    pub plant: Rig,
    /// Name of the mission in the plan.
    pub mission_name: &'p str,
    /// What is flown.
    pub mission: &'p Mission,
    /// Name of the variant.
    pub variant: &'p str,
    /// The effects that the variant adds.
    pub effects: Vec<EffectEntry>,
    /// Seed of everything random.
    pub seed: u64,
    /// Whether it is diagnosed too.
    pub is_diagnosed: bool,
}

/// SHA-256 in hexadecimal digits.
pub(crate) fn sha256(text: impl AsRef<[u8]>) -> String {
    Sha256::digest(text).iter().fold(String::new(), |mut out, byte| {
        // Writing to a String cannot fail.
        let _ = write!(out, "{byte:02x}");
        out
    })
}

fn id(parts: &[&str]) -> String {
    let mut hash = Sha256::new();
    hash.update("bench.run/1");
    for part in parts {
        // With its length before it no part can run into the next.
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.finalize().iter().take(16).fold(String::new(), |mut out, byte| {
        let _ = write!(out, "{byte:02x}");
        out
    })
}

/// A plan as it is kept beside its results: nothing of it is on another machine's disk but recordings.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StoredPlan {
    pub schema: String,
    pub bench_version: String,
    pub id: String,
    pub name: String,
    plan: String,
    /// Texts of rigs by name.
    rigs: BTreeMap<String, String>,
    /// Texts of missions, by rig and by the name in the plan: each with its own name.
    missions: BTreeMap<String, BTreeMap<String, Vec<(String, String)>>>,
    recordings: Vec<Recorded>,
}

pub(crate) const STORED: &str = "bench.sweep-plan/1";

impl Library for StoredPlan {
    fn rig(&self, name: &str) -> Result<Rig, Unfound> {
        let text = self.rigs.get(name).ok_or_else(|| absent("rig", name))?;
        Rig::read(Path::new(name), text).map_err(|error| Unfound::Words(error.to_string()))
    }

    fn missions(&self, name: &str, rig: &str) -> Result<Vec<(String, Mission)>, Unfound> {
        let texts =
            self.missions.get(rig).and_then(|of| of.get(name)).ok_or_else(|| absent("mission", name))?;
        let read = |(name, text): &(String, String)| {
            let mission =
                Mission::read(Path::new(name), text).map_err(|error| Unfound::Words(error.to_string()))?;
            Ok((name.clone(), mission))
        };
        texts.iter().map(read).collect()
    }

    fn recordings(&self, _name: &str) -> Result<Vec<PathBuf>, Unfound> {
        Ok(Vec::new())
    }
}

fn absent(what: &str, name: &str) -> Unfound {
    Unfound::Words(format!("the kept plan has no {what} {name}"))
}

impl Plan {
    /// Reads a plan and all that it names.
    pub fn read(file: &Path, text: &str, library: &dyn Library) -> Result<Self, CampaignError> {
        let (plan, problems) = Self::read_as_far_as_possible(file, text, library)?;
        if problems.is_empty() {
            Ok(plan)
        } else {
            Err(CampaignError::Plan { file: file.to_owned(), problems })
        }
    }

    /// The same with all that is wrong beside it, for who tells it in a way of his own.
    pub fn read_as_far_as_possible(
        file: &Path,
        text: &str,
        library: &dyn Library,
    ) -> Result<(Self, Vec<Problem>), CampaignError> {
        let (plan_file, mut problems) = PlanFile::read_as_far_as_possible(file, text)?;
        let mut plan = Self {
            points: points(&plan_file),
            file: plan_file,
            text: text.to_owned(),
            rigs: Vec::new(),
            missions: Vec::new(),
            recordings: Vec::new(),
            causes: Vec::new(),
            id: String::new(),
        };
        plan.find_rigs(library, &mut problems);
        plan.find_recordings(library, &mut problems);
        if problems.is_empty() {
            plan.check_together(&mut problems);
        }
        if problems.is_empty() && plan.file.kind == Kind::Mix {
            plan.causes =
                plan.rigs.iter().map(|rig| mix::planned(&rig.content, plan.file.sets as usize)).collect();
        }
        plan.id = plan.identify();
        Ok((plan, problems))
    }

    /// The plan as it was kept.
    pub(crate) fn restore(stored: &StoredPlan) -> Result<Self, CampaignError> {
        let mut plan = Self::read(Path::new("plan.toml"), &stored.plan, stored)?;
        plan.recordings.clone_from(&stored.recordings);
        plan.id = plan.identify();
        Ok(plan)
    }

    pub(crate) fn to_store(&self) -> StoredPlan {
        let mut missions: BTreeMap<String, BTreeMap<String, Vec<(String, String)>>> = BTreeMap::new();
        for (rig, of) in self.rigs.iter().zip(&self.missions) {
            let by_name = missions.entry(rig.name.clone()).or_default();
            for listed in &self.file.missions {
                let own = |full: &str| {
                    // A mission of a folder is named "folder: name".
                    let within = full.strip_prefix(listed.as_str()).and_then(|rest| rest.strip_prefix(": "));
                    if full == listed { Some(full.to_owned()) } else { within.map(str::to_owned) }
                };
                let found =
                    of.iter().filter_map(|mission| Some((own(&mission.name)?, mission.content.to_toml())));
                by_name.insert(listed.clone(), found.collect());
            }
        }
        StoredPlan {
            schema: STORED.to_owned(),
            bench_version: VERSION.to_owned(),
            id: self.id.clone(),
            name: self.file.name.clone(),
            plan: self.text.clone(),
            rigs: self.rigs.iter().map(|rig| (rig.name.clone(), rig.content.to_toml())).collect(),
            missions,
            recordings: self.recordings.clone(),
        }
    }

    fn find_rigs(&mut self, library: &dyn Library, problems: &mut Vec<Problem>) {
        let plan = &self.file;
        let tell = |problems: &mut Vec<Problem>, key: &str, unfound: Unfound| match unfound {
            Unfound::Problems(own) => problems.extend(own),
            Unfound::Words(words) => problems.push(plan.problem(key, words)),
        };
        for name in &plan.rigs {
            let rig = match library.rig(name) {
                Ok(rig) => rig,
                Err(unfound) => {
                    tell(problems, RIGS, unfound);
                    continue;
                }
            };
            let digest = sha256(rig.to_toml());
            if let Some(same) = self.rigs.iter().find(|known| known.sha256 == digest) {
                let detail =
                    format!("{name} is the same rig as {}: its runs would be counted twice", same.name);
                problems.push(plan.problem(RIGS, detail));
            }
            if let Err(error) = resolve_all(&rig.effects) {
                problems.push(plan.problem(RIGS, format!("{name}: {error}")));
            }
            let mut missions: Vec<Named<Mission>> = Vec::new();
            for named in &plan.missions {
                match library.missions(named, name) {
                    Ok(found) => {
                        for (own, mission) in found {
                            let full = if own == *named { own } else { format!("{named}: {own}") };
                            let digest = sha256(mission.to_toml());
                            let same = missions.iter().find(|known| known.sha256 == digest);
                            if let Some(same) = same.filter(|_| plan.kind == Kind::Flights) {
                                let detail = format!(
                                    "{full} is the same mission as {}: its runs would be counted twice",
                                    same.name
                                );
                                problems.push(plan.problem(MISSIONS, detail));
                            }
                            missions.push(Named { name: full, content: mission, sha256: digest });
                        }
                    }
                    Err(unfound) => tell(problems, MISSIONS, unfound),
                }
            }
            self.missions.push(missions);
            self.rigs.push(Named { name: name.clone(), content: rig, sha256: digest });
        }
        // What is wrong with a mission is told once, however many rigs fly it.
        let mut told = Vec::new();
        problems.retain(|problem| {
            let words = problem.to_string();
            let is_new = !told.contains(&words);
            told.push(words);
            is_new
        });
    }

    fn find_recordings(&mut self, library: &dyn Library, problems: &mut Vec<Problem>) {
        for name in &self.file.recordings {
            let paths = match library.recordings(name) {
                Ok(paths) => paths,
                Err(Unfound::Problems(own)) => {
                    problems.extend(own);
                    continue;
                }
                Err(Unfound::Words(words)) => {
                    problems.push(self.file.problem(RECORDINGS, words));
                    continue;
                }
            };
            for path in paths {
                let bytes = match fs::read(&path) {
                    Ok(bytes) => bytes,
                    Err(error) => {
                        let detail = format!("{} cannot be read: {error}", path.display());
                        problems.push(self.file.problem(RECORDINGS, detail));
                        continue;
                    }
                };
                let sha256 = sha256(bytes);
                if let Some(same) = self.recordings.iter().find(|known| known.sha256 == sha256) {
                    let detail = format!(
                        "{} holds the same bytes as {}: it would be counted twice",
                        path.display(),
                        same.path.display()
                    );
                    problems.push(self.file.problem(RECORDINGS, detail));
                }
                self.recordings.push(Recorded { path, sha256 });
            }
        }
    }

    /// Each variant on each rig: an effect that the rig has already is asked for twice.
    fn check_together(&self, problems: &mut Vec<Problem>) {
        for (rig, missions) in self.rigs.iter().zip(&self.missions) {
            if self.file.kind != Kind::Flights {
                break;
            }
            let Some(mission) = missions.first() else { continue };
            for (place, point) in self.points.iter().enumerate() {
                let flight = self.flight(rig, mission, place, self.file.seeds.at(0));
                let mut entries = rig.content.effects.clone();
                entries.extend(flight.effects);
                if let Err(error) = resolve_all(&entries) {
                    let variant = &self.file.variants[point.variant].name;
                    let detail = format!("variant {variant} on rig {}: {}", rig.name, error.detail());
                    let problem = self.file.problem(VARIANT, detail);
                    if !problems.contains(&problem) {
                        problems.push(problem);
                    }
                }
            }
        }
    }

    fn identify(&self) -> String {
        let f = &self.file;
        let mut text = format!(
            "bench.sweep/1\n{:?}\n{:?}\n{:?}\n{:?}\n{:?}\n{}\n{}\n",
            f.name,
            f.kind,
            f.seeds,
            f.airframes,
            f.diagnosis,
            f.sets,
            self.runs_per_part()
        );
        for (rig, missions) in self.rigs.iter().zip(&self.missions) {
            let _ = writeln!(text, "{:?} {}", rig.name, rig.sha256);
            for mission in missions {
                let _ = writeln!(text, "{:?} {}", mission.name, mission.sha256);
            }
        }
        for recording in &self.recordings {
            let _ = writeln!(text, "{}", recording.sha256);
        }
        for point in &self.points {
            let _ = writeln!(text, "{:?} {:?}", f.variants[point.variant].name, point.definition);
        }
        if f.kind == Kind::Mix {
            text += mix::TEXT;
        }
        sha256(text)
    }

    /// The plan's file as it was read.
    pub fn file(&self) -> &PlanFile {
        &self.file
    }

    /// SHA-256 of all that decides which runs there are and how they are named: the same plan gives the same id anywhere.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// How many runs there are.
    pub fn runs(&self) -> u64 {
        match self.file.kind {
            Kind::Flights => {
                let per_mission = self.points.len() as u64 * self.file.seeds.count();
                self.missions.iter().map(|missions| missions.len() as u64 * per_mission).sum()
            }
            Kind::Recordings => self.recordings.len() as u64 * self.rigs.len().max(1) as u64,
            Kind::Mix => self.rigs.len() as u64 * self.file.sets,
        }
    }

    /// Runs of a part, from 1.
    pub fn runs_per_part(&self) -> u64 {
        let is_flown_alone = self.file.kind == Kind::Flights && self.file.diagnosis == Diagnosing::None;
        self.file.runs_per_part.unwrap_or(if is_flown_alone { FLIGHTS_PER_PART } else { DIAGNOSES_PER_PART })
    }

    /// How many parts the results have.
    pub fn parts(&self) -> u64 {
        self.runs().div_ceil(self.runs_per_part())
    }

    /// The runs of a part, by their places in the plan.
    pub fn runs_of_part(&self, part: u64) -> std::ops::Range<u64> {
        let begin = part * self.runs_per_part();
        begin..(begin + self.runs_per_part()).min(self.runs())
    }

    /// Every parameter that a run may have beyond its rig: effect and key, in the order of the library.
    pub(crate) fn parameters(&self) -> Vec<(&'static str, &'static str)> {
        let effects: Vec<&str> = match self.file.kind {
            Kind::Flights => {
                let variants = self.file.variants.iter();
                variants.flat_map(|variant| &variant.effects).map(|effect| effect.effect.as_str()).collect()
            }
            Kind::Mix => LIBRARY.iter().map(|spec| spec.name).collect(),
            Kind::Recordings => Vec::new(),
        };
        let specs = LIBRARY.iter().filter(|spec| effects.contains(&spec.name));
        specs.flat_map(|spec| spec.parameters.iter().map(|parameter| (spec.name, parameter.key))).collect()
    }

    /// The run at a place below [`Plan::runs`]. Seeds change first, then variants, missions, rigs.
    pub fn run(&self, index: u64) -> Run<'_> {
        match self.file.kind {
            Kind::Flights => self.flight_run(index),
            Kind::Recordings => {
                let rigs = self.rigs.len().max(1) as u64;
                let recording = &self.recordings[(index / rigs) as usize];
                let rig = self.rigs.get((index % rigs) as usize);
                let digest = rig.map_or("carried", |rig| rig.sha256.as_str());
                let work = Work::Recording {
                    rig: rig.map(|rig| (rig.name.as_str(), &rig.content)),
                    path: &recording.path,
                    sha256: &recording.sha256,
                };
                Run { id: id(&["recording", &recording.sha256, digest]), index, work }
            }
            Kind::Mix => {
                let place = (index / self.file.sets) as usize;
                let case = index % self.file.sets;
                let rig = &self.rigs[place];
                let missions = &self.missions[place];
                let mut parts = vec!["set".to_owned(), sha256(mix::TEXT), rig.sha256.clone()];
                parts.extend(missions.iter().map(|mission| mission.sha256.clone()));
                parts.push(format!("{case} of {}", self.file.sets));
                let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
                let work = Work::Set {
                    rig_name: &rig.name,
                    rig: &rig.content,
                    missions: missions.iter().map(|mission| mission.content.clone()).collect(),
                    causes: &self.causes[place][case as usize],
                    set: mix::FIRST_WITH_CAUSES + case,
                };
                Run { id: id(&parts), index, work }
            }
        }
    }

    fn flight_run(&self, index: u64) -> Run<'_> {
        let (seeds, points) = (self.file.seeds.count(), self.points.len() as u64);
        let seed = self.file.seeds.at(index % seeds);
        let place = ((index / seeds) % points) as usize;
        let mut flight = index / (seeds * points);
        let mut of_rig = 0;
        while flight >= self.missions[of_rig].len() as u64 {
            flight -= self.missions[of_rig].len() as u64;
            of_rig += 1;
        }
        let (rig, mission) = (&self.rigs[of_rig], &self.missions[of_rig][flight as usize]);
        let id = id(&[
            "flight",
            &rig.sha256,
            &mission.sha256,
            &self.points[place].definition,
            &seed.to_string(),
            if self.file.airframes == Airframes::Drawn { "drawn" } else { "nominal" },
            if self.file.diagnosis == Diagnosing::Each { "diagnosed" } else { "flown" },
        ]);
        Run { id, index, work: Work::Flight(Box::new(self.flight(rig, mission, place, seed))) }
    }

    fn flight<'p>(
        &'p self,
        rig: &'p Named<Rig>,
        mission: &'p Named<Mission>,
        place: usize,
        seed: u64,
    ) -> FlightRun<'p> {
        let point = &self.points[place];
        let variant = &self.file.variants[point.variant];
        let mut places = point.places.iter();
        let mut effects = Vec::new();
        for planned in &variant.effects {
            let spec = index_of(&planned.effect).map(|index| LIBRARY[index]);
            let mut parameters = Vec::new();
            for (key, draw) in &planned.parameters {
                let point = places.next().copied().unwrap_or(0);
                let parameter =
                    spec.and_then(|spec| spec.parameters.iter().find(|parameter| parameter.key == *key));
                if let Some(parameter) = parameter {
                    parameters.push((
                        key.clone(),
                        draw.value(&planned.effect, parameter, seed, point),
                        planned.line,
                    ));
                }
            }
            let at = Location { file: self.file.file.clone(), line: planned.line };
            effects.push(EffectEntry { name: planned.effect.clone(), parameters, at });
        }
        let plant = match self.file.airframes {
            Airframes::Nominal => {
                let mut plant = rig.content.clone();
                plant.effects.extend(effects.iter().cloned());
                plant
            }
            Airframes::Drawn => {
                let (mut plant, _) = Models::new(&rig.content, 0).draw(seed);
                for effect in &effects {
                    let values: Vec<(&str, f64)> =
                        effect.parameters.iter().map(|(key, value, _)| (key.as_str(), *value)).collect();
                    add_to_drawn(&mut plant, &effect.name, &values);
                }
                plant
            }
        };
        FlightRun {
            rig_name: &rig.name,
            nominal: &rig.content,
            plant,
            mission_name: &mission.name,
            mission: &mission.content,
            variant: &variant.name,
            effects,
            seed,
            is_diagnosed: self.file.diagnosis == Diagnosing::Each,
        }
    }
}

/// Every combination of the numbers listed in each variant.
fn points(plan: &PlanFile) -> Vec<Point> {
    let variants = plan.variants.iter().enumerate();
    variants
        .flat_map(|(variant, content)| {
            content.points().map(move |places| Point {
                variant,
                definition: content.at(&places).definition(),
                places,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The rigs and missions of the repository.
    struct Repository;

    fn rigs() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
    }

    impl Library for Repository {
        fn rig(&self, name: &str) -> Result<Rig, Unfound> {
            Rig::load(rigs().join(format!("{name}.toml"))).map_err(|error| Unfound::Words(error.to_string()))
        }

        fn missions(&self, name: &str, _rig: &str) -> Result<Vec<(String, Mission)>, Unfound> {
            let path = rigs().join("missions").join(format!("{name}.toml"));
            let mission = Mission::load(path).map_err(|error| Unfound::Words(error.to_string()))?;
            Ok(vec![(name.to_owned(), mission)])
        }

        fn recordings(&self, name: &str) -> Result<Vec<PathBuf>, Unfound> {
            Ok(vec![PathBuf::from(name)])
        }
    }

    fn plan(text: &str) -> Plan {
        Plan::read(
            Path::new("plan.toml"),
            &("name = \"p\"\ndescription = \"d\"\n".to_owned() + text),
            &Repository,
        )
        .unwrap()
    }

    fn ids(plan: &Plan) -> BTreeSet<String> {
        (0..plan.runs()).map(|index| plan.run(index).id).collect()
    }

    const VARIANTS: &str = "[[variant]]\nname = \"lag\"\neffects.rotor-lag.time_constant_s = [0.05, 0.1]\n\
        [[variant]]\nname = \"tired\"\neffects.battery-discharge.loss_per_hover_minute = { log_uniform = [0.01, 0.1] }\n";

    #[test]
    fn runs_are_the_product_and_each_has_an_id_of_its_own() {
        let plan = plan(&format!(
            "rigs = [\"virtual\", \"virtual-model\"]\nmissions = [\"climb-040\", \"hop\"]\nseeds = {{ first = 5, count = 10 }}\n{VARIANTS}"
        ));
        assert_eq!(plan.runs(), 2 * 2 * 3 * 10);
        assert_eq!(ids(&plan).len(), 120);
        assert_eq!((plan.parts(), plan.runs_of_part(0)), (1, 0..120));
    }

    #[test]
    fn ids_go_by_content_and_not_by_place_or_name() {
        let one = plan(&format!("rigs = \"virtual\"\nmissions = \"hop\"\nseeds = [1, 2]\n{VARIANTS}"));
        let more = plan(&format!(
            "rigs = [\"virtual-model\", \"virtual\"]\nmissions = [\"climb-040\", \"hop\"]\nseeds = [3, 2, 1]\n{}",
            VARIANTS.replace("\"lag\"", "\"another name\"").replace("[0.05, 0.1]", "[0.1, 0.2, 0.05]")
        ));
        assert!(ids(&one).is_subset(&ids(&more)));
        let other = plan(&format!(
            "rigs = \"virtual\"\nmissions = \"hop\"\nseeds = [1, 2]\n{}",
            VARIANTS.replace("[0.01, 0.1]", "[0.01, 0.2]").replace("[0.05, 0.1]", "[0.06, 0.11]")
        ));
        assert!(ids(&one).is_disjoint(&ids(&other)));
    }

    #[test]
    fn ids_are_the_same_on_every_machine() {
        // By hand: SHA-256 of "bench.run/1" and of each part behind its length, in 8 bytes, the least first.
        let plan = plan(
            "rigs = \"virtual\"\nmissions = \"hop\"\nseeds = [7]\n[[variant]]\nname = \"lag\"\neffects.rotor-lag.time_constant_s = \"prior\"\n",
        );
        let known = id(&["a", "bc"]);
        assert_eq!(known, "b3e95ad79927c5f0fc38b076787b5931");
        assert_ne!(known, id(&["ab", "c"]), "parts do not run into one another");
        assert_eq!(plan.run(0).id.len(), 32);
    }

    #[test]
    fn the_same_seed_draws_the_same_whatever_else_is_planned() {
        let drawn = |text: &str| {
            let plan = plan(text);
            let Work::Flight(flight) = plan.run(0).work else { panic!("a flight is planned") };
            flight.effects[0].parameters[0].1
        };
        let lag = "effects.rotor-lag.time_constant_s = { uniform = [0.02, 0.2] }\n";
        let alone = drawn(&format!(
            "rigs = \"virtual\"\nmissions = \"hop\"\nseeds = [7]\n[[variant]]\nname = \"a\"\n{lag}"
        ));
        let among = drawn(&format!(
            "rigs = \"virtual-model\"\nmissions = \"climb-040\"\nseeds = [7, 8]\nairframes = \"drawn\"\n[[variant]]\nname = \"b\"\n{lag}effects.gusts = {{ sigma_m_s = 0.1, correlation_time_s = 1 }}\n"
        ));
        assert_eq!(alone, among);
    }

    #[test]
    fn a_kept_plan_is_the_same_plan() {
        for text in [
            format!(
                "rigs = [\"virtual\", \"virtual-model\"]\nmissions = [\"climb-040\", \"hop\"]\nairframes = \"drawn\"\n{VARIANTS}"
            ),
            "kind = \"mix\"\nrigs = \"virtual\"\nmissions = [\"hop\", \"steps\"]\nsets = 3\n".to_owned(),
        ] {
            let plan = plan(&text);
            let kept = serde_json::to_string(&plan.to_store()).unwrap();
            let back = Plan::restore(&serde_json::from_str(&kept).unwrap()).unwrap();
            assert_eq!(back.id(), plan.id());
            assert_eq!(ids(&back), ids(&plan));
        }
    }

    #[test]
    fn what_would_be_counted_twice_or_never_is_refused() {
        let refused = |text: &str| {
            let text = "name = \"p\"\ndescription = \"d\"\n".to_owned() + text;
            let (_, problems) =
                Plan::read_as_far_as_possible(Path::new("plan.toml"), &text, &Repository).unwrap();
            problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
        };
        let twice = "[[variant]]\nname = \"a\"\neffects.rotor-lag.time_constant_s = 0.1\n[[variant]]\nname = \"b\"\neffects.rotor-lag.time_constant_s = 0.1\n";
        let told = refused(&format!("rigs = \"virtual\"\nmissions = \"hop\"\n{twice}"));
        assert!(told.contains("counted twice") && told.contains("plan.toml:"), "{told}");
        assert!(refused("rigs = \"virtual\"\nmissions = \"hop\"\nseeds = []\n").contains("seeds"));
        assert!(refused("rigs = []\nmissions = \"hop\"\n").contains("rigs"));
        assert!(refused("rigs = \"virtual\"\nmissions = \"hop\"\nvariant = []\n").contains("variant"));
        assert!(refused("rigs = \"virtual\"\nmissions = \"absent\"\n").contains("absent"));
        let wrong = "rigs = \"virtual\"\nmissions = \"hop\"\n[[variant]]\nname = \"a\"\neffects.rotor-lagg.time_constant_s = 0.1\n";
        assert!(refused(wrong).contains("did you mean rotor-lag?"), "{}", refused(wrong));
        let far = wrong.replace("rotor-lagg", "rotor-lag").replace("0.1\n", "{ uniform = [0.1, 1e9] }\n");
        assert!(refused(&far).contains("out of range"), "{}", refused(&far));
    }
}
