//! Recordings, and the rig that they are held against: the one given, or the one that all of them carry.

use std::{
    path::{Path, PathBuf},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use anyhow::{Context, bail};
use bench_device::PositionSample;
use bench_plant::effects::resolve_all;
use bench_recording::{Flight, Mode, Session};
use bench_rig::{
    Actuation, Rig,
    visit::{self, Node, Value},
};
use clap::Args;

use crate::{files, logs};

/// The rig of commands that hold recordings against a model.
#[derive(Args)]
#[group(skip)]
pub struct NominalRig {
    /// Nominal model with tolerances: a rig file, or the name of a built-in one [default: the rig attached to the recordings]
    #[arg(long, value_name = "RIG")]
    pub rig: Option<PathBuf>,
}

/// A nominal model, where it comes from, and what should be known of it.
#[derive(Debug)]
pub struct Nominal {
    pub rig: Rig,
    /// In words, such as `my-quad.toml` or `the rig virtual that the recordings carry`.
    pub from: String,
    /// How it differs from what the recordings carry, a line each.
    pub remarks: Vec<String>,
}

/// What was made of recordings, each flight once. The flights themselves are let go one by one: of a thousand only what is made
/// of them stays.
#[derive(Debug)]
pub struct Recorded<T> {
    /// In the order in which the flights were named.
    pub made: Vec<T>,
    /// Which files were left out, and why.
    pub remarks: Vec<String>,
}

impl<T> Recorded<T> {
    /// Reads recordings one after another. A flight that is given twice, under whatever name and in whatever container, is
    /// used once: of one that holds less of it, nothing is made.
    pub fn read(
        paths: &[PathBuf],
        map: Option<&Path>,
        mut make: impl FnMut(&Path, Flight) -> anyhow::Result<T>,
    ) -> anyhow::Result<Self> {
        let mut known: Vec<(&Path, Vec<PositionSample>, T)> = Vec::new();
        let mut remarks = Vec::new();
        for path in paths {
            let flight = logs::flight(path, map)?;
            let seen = flight.positions.clone();
            let Some((before, seen_before, made)) =
                known.iter_mut().find(|(_, before, _)| is_same_flight(before, &seen))
            else {
                known.push((path, seen, make(path, flight)?));
                continue;
            };
            let more = seen.len() > seen_before.len();
            let (used, left) = if more { (path.as_path(), *before) } else { (*before, path.as_path()) };
            remarks.push(format!(
                "{} holds the same flight as {}: it is counted once",
                left.display(),
                used.display()
            ));
            if more {
                (*before, *seen_before, *made) = (path, seen, make(path, flight)?);
            }
        }
        Ok(Self { made: known.into_iter().map(|(_, _, made)| made).collect(), remarks })
    }
}

/// Positions that agree to this are the same one, written twice: tables round to it.
const SAME_PLACE_M: f64 = 2e-6;
/// The same of the time between two of them.
const SAME_TIME_S: f64 = 2e-6;
/// Fewer positions tell no flight from another: trackers repeat themselves for a while.
const LEAST_POSITIONS: usize = 20;

/// Whether two series are of one flight: every position of the shorter is one of the longer, at the same time from its first
/// one. So are a copy, a recording that was cut, and a table that has not every frame.
fn is_same_flight(a: &[PositionSample], b: &[PositionSample]) -> bool {
    let (longer, shorter) = if a.len() >= b.len() { (a, b) } else { (b, a) };
    let same_place = |a: &PositionSample, b: &PositionSample| {
        let same = |(x, y): (f64, f64)| (x - y).abs() <= SAME_PLACE_M || (x.is_nan() && y.is_nan());
        a.status == b.status && a.position_m.into_iter().zip(b.position_m).all(same)
    };
    let Some(first) = shorter.first() else { return false };
    if shorter.len() < LEAST_POSITIONS || shorter.iter().all(|position| same_place(position, first)) {
        return false;
    }
    let since = |position: &PositionSample, first: &PositionSample| {
        position.exposed_at.seconds() - first.exposed_at.seconds()
    };
    // On the ground many positions are alike: each of them may be the one that the shorter begins with.
    longer.iter().enumerate().filter(|(_, start)| same_place(start, first)).any(|(place, start)| {
        let mut rest = longer[place..].iter();
        shorter.iter().all(|position| {
            let due_s = since(position, first);
            rest.by_ref().find(|candidate| since(candidate, start) >= due_s - SAME_TIME_S).is_some_and(
                |candidate| since(candidate, start) <= due_s + SAME_TIME_S && same_place(candidate, position),
            )
        })
    })
}

impl NominalRig {
    /// The model for these recordings: the one given, held against what they carry, or else the one that all of them carry.
    pub fn resolve(&self, paths: &[PathBuf], map: Option<&Path>) -> anyhow::Result<Nominal> {
        let sessions = paths
            .iter()
            .map(|path| Ok((path.as_path(), logs::session(path, map)?)))
            .collect::<anyhow::Result<Vec<(&Path, Session)>>>()?;
        let attached = attached(&sessions)?;
        let nominal = match &self.rig {
            Some(named) => given(named, &attached)?,
            None => carried(&sessions, attached)?,
        };
        // The rig's own effects are part of the model.
        resolve_all(&nominal.rig.effects).with_context(|| format!("the effects of {}", nominal.from))?;
        Ok(nominal)
    }
}

/// The rig that each recording carries, if it carries one.
fn attached<'a>(sessions: &[(&'a Path, Session)]) -> anyhow::Result<Vec<(&'a Path, Rig)>> {
    let mut rigs = Vec::new();
    for (path, session) in sessions {
        if let Some(text) = &session.rig_toml {
            let within = path.join("rig.toml");
            let rig = Rig::read(&within, text).with_context(|| {
                format!("the rig attached to {} cannot be read; name one with --rig", path.display())
            })?;
            rigs.push((*path, rig));
        }
    }
    Ok(rigs)
}

fn given(named: &Path, attached: &[(&Path, Rig)]) -> anyhow::Result<Nominal> {
    let rig = files::rig(named)?;
    let mut remarks: Vec<String> = Vec::new();
    let mut differing: Vec<(String, Vec<&Path>)> = Vec::new();
    for (path, own) in attached {
        refuse_another_airframe(named, &rig, path, own)?;
        for remark in differences(own, &rig).iter().filter(|difference| difference.matters()) {
            let words = remark.in_words();
            match differing.iter_mut().find(|(known, _)| *known == words) {
                Some((_, paths)) => paths.push(path),
                None => differing.push((words, vec![path])),
            }
        }
    }
    for (words, paths) in differing {
        let of = match paths.as_slice() {
            [path] => format!("the rig attached to {}", path.display()),
            [path, others @ ..] => {
                format!("the rigs attached to {} and {} more", path.display(), others.len())
            }
            [] => continue,
        };
        remarks.push(format!("{words} in {of}, which {} is not like", named.display()));
    }
    Ok(Nominal { rig, from: named.display().to_string(), remarks })
}

fn refuse_another_airframe(named: &Path, rig: &Rig, path: &Path, own: &Rig) -> anyhow::Result<()> {
    let (given, own) = (&rig.airframe, &own.airframe);
    let advice = "leave --rig out to use the attached rig, or name one of this airframe";
    if given.actuation != own.actuation {
        bail!(
            "{} was flown with sticks in {}, the rig {} has them in {}: it cannot be a model of that flight; {advice}",
            path.display(),
            sticks_in(own.actuation),
            named.display(),
            sticks_in(given.actuation)
        );
    }
    if given.name != own.name {
        bail!(
            "{} was flown by the airframe {}, the rig {} is of {}: it cannot be a model of that flight; {advice} \
             (if it is the same airframe, give it the same name)",
            path.display(),
            own.name,
            named.display(),
            given.name
        );
    }
    Ok(())
}

fn sticks_in(actuation: Actuation) -> &'static str {
    match actuation {
        Actuation::Volt => "volts",
        Actuation::Fraction => "fractions",
        Actuation::Count => "counts",
    }
}

fn carried(sessions: &[(&Path, Session)], attached: Vec<(&Path, Rig)>) -> anyhow::Result<Nominal> {
    let without = sessions.iter().find(|(_, session)| session.rig_toml.is_none());
    let mut attached = attached.into_iter();
    let Some((first, rig)) = attached.next() else {
        if let Some((path, kind)) = sessions.iter().find_map(|(path, _)| Some((path, logs::kind(path)?))) {
            bail!(
                "{} is {}, which carries no rig, so nobody knows what it should have done; name the nominal model with --rig. `bench rig \
                 from-log` drafts one from nominal logs, `bench import --rig` attaches one",
                path.display(),
                kind.name()
            );
        }
        bail!(
            "no rig is attached to these recordings, so nobody knows what they should have done; name the nominal model with --rig"
        );
    };
    if let Some((path, _)) = without {
        bail!(
            "{} carries a rig and {} does not; name the nominal model of all of them with --rig",
            first.display(),
            path.display()
        );
    }
    for (path, other) in attached {
        let differing: Vec<_> =
            differences(&rig, &other).into_iter().filter(Difference::is_of_model).collect();
        if !differing.is_empty() || rig.airframe.name != other.airframe.name {
            let what: Vec<String> = differing.iter().map(Difference::apart).take(6).collect();
            let more = differing.len().saturating_sub(what.len());
            bail!(
                "{} and {} were recorded on different rigs, {} and {} ({}{}); diagnose them apart, or name the nominal model of all with --rig",
                first.display(),
                path.display(),
                rig.name,
                other.name,
                if what.is_empty() { "another airframe".to_owned() } else { what.join("; ") },
                if more > 0 { format!("; and {more} more") } else { String::new() }
            );
        }
    }
    for (path, session) in sessions {
        let of_before = session.mode != Mode::Import && !session.extra.contains_key(Session::ADDED_EFFECTS);
        if of_before && !rig.effects.is_empty() {
            bail!(
                "{} was recorded by a version of the bench that did not tell a rig's own effects from added ones; name the nominal model with --rig",
                path.display()
            );
        }
    }
    let from = format!("the rig {} that the recordings carry", rig.name);
    Ok(Nominal { rig, from, remarks: Vec::new() })
}

/// The effects that a rig has beyond the nominal one, as `--effect` takes them.
pub fn added_effects(nominal: &Rig, rig: &Rig) -> Vec<String> {
    rig.effects[nominal.effects.len()..].iter().map(files::effect_in_words).collect()
}

/// What an operator changed of the mission before the flight, such as its altitude.
pub fn note_changes(session: &mut Session, changes: &[String]) {
    if !changes.is_empty() {
        session.extra.insert("mission_changes".to_owned(), changes.join("; "));
    }
}

/// A key that two rigs do not share.
#[derive(Debug)]
struct Difference {
    section: String,
    key: String,
    /// Value and one sigma as they stand in the file.
    of: [Option<String>; 2],
    numbers: Option<[(f64, f64); 2]>,
}

/// Values within so many of their joint tolerances are the same number, measured twice.
const SIGMAS: f64 = 3.0;
/// Noise that was measured twice agrees no better.
const NOISE_SHARE: f64 = 0.25;
/// Other numbers that differ by less are the same, rounded.
const ROUNDED_SHARE: f64 = 1e-3;

impl Difference {
    /// Whether it bears on what a flight should have done.
    fn is_of_model(&self) -> bool {
        ["airframe", "loop", "output", "tracker", "effect"].contains(&self.section.as_str())
            && self.key != "name"
    }

    /// Whether it is worth a line.
    fn matters(&self) -> bool {
        let beyond = self.numbers.is_none_or(|[(a, sigma_a), (b, sigma_b)]| {
            let sigma = sigma_a.hypot(sigma_b);
            // Numbers without a tolerance are those of the loop, of rounding and of noise: any difference counts, but not that
            // of a digit.
            if sigma > 0.0 {
                (a - b).abs() > SIGMAS * sigma
            } else {
                let share = if self.is_of_noise() { NOISE_SHARE } else { ROUNDED_SHARE };
                (a - b).abs() > share * a.abs().max(b.abs())
            }
        });
        // How well a throttle is known moves no flight.
        self.is_of_model() && beyond && !self.key.contains("hover_sigma")
    }

    fn is_of_noise(&self) -> bool {
        self.key.contains("noise") || self.key.contains("probability")
    }

    fn in_words(&self) -> String {
        let [own, given] = self.words();
        let beyond = match self.numbers {
            Some([(a, sigma_a), (b, sigma_b)]) if sigma_a.hypot(sigma_b) > 0.0 => {
                format!(", {:.0} tolerances off", (a - b).abs() / sigma_a.hypot(sigma_b))
            }
            _ => String::new(),
        };
        format!("{}.{} is {given}{beyond}, but {own}", self.section, self.key)
    }

    fn apart(&self) -> String {
        let [a, b] = self.words();
        format!("{}.{} {a} and {b}", self.section, self.key)
    }

    fn words(&self) -> [String; 2] {
        self.of.clone().map(|value| value.unwrap_or_else(|| "absent".to_owned()))
    }
}

/// What of two rigs differs, a line each: key, the first's and the second's.
pub fn rig_differences(a: &Rig, b: &Rig) -> Vec<String> {
    differences(a, b).iter().map(Difference::apart).collect()
}

/// Every key of two rigs that differs, by what stands in their files: new keys are compared without being named here.
fn differences(a: &Rig, b: &Rig) -> Vec<Difference> {
    let (mut of_a, mut of_b) = (Vec::new(), Vec::new());
    for (rig, leaves) in [(a, &mut of_a), (b, &mut of_b)] {
        // What a rig writes reads back.
        if let Ok(node) = visit::parse(Path::new("rig.toml"), &rig.to_toml()) {
            collect("", &node, leaves);
        }
    }
    let mut keys: Vec<&String> = of_a.iter().map(|(key, ..)| key).collect();
    keys.extend(of_b.iter().map(|(key, ..)| key).filter(|key| !of_a.iter().any(|(known, ..)| known == *key)));
    let leaf = |leaves: &[Leaf], key: &str| leaves.iter().find(|(known, ..)| known == key).cloned();
    keys.into_iter()
        .filter_map(|key| {
            let (in_a, in_b) = (leaf(&of_a, key), leaf(&of_b, key));
            let text = |leaf: &Option<Leaf>| leaf.as_ref().map(|(_, text, _)| text.clone());
            let number = |leaf: &Option<Leaf>| leaf.as_ref().and_then(|(_, _, number)| *number);
            if text(&in_a) == text(&in_b) {
                return None;
            }
            let (section, key) = key.split_once('.').unwrap_or(("", key));
            Some(Difference {
                section: section.to_owned(),
                key: key.to_owned(),
                of: [text(&in_a), text(&in_b)],
                numbers: number(&in_a).zip(number(&in_b)).map(|(a, b)| [a, b]),
            })
        })
        .collect()
}

/// Key with its tables, what stands there, and value with one sigma where it is a number.
type Leaf = (String, String, Option<(f64, f64)>);

fn collect(key: &str, node: &Node, leaves: &mut Vec<Leaf>) {
    let number = |node: &Node| if let Value::Number(x) = node.value { Some(x) } else { None };
    match &node.value {
        Value::Table(entries) => {
            let of =
                |name: &str| entries.iter().find(|(key, _)| key == name).and_then(|(_, node)| number(node));
            if let (2, Some(value), Some(sigma)) = (entries.len(), of("value"), of("sigma")) {
                leaves.push((key.to_owned(), format!("{value} ± {sigma}"), Some((value, sigma))));
                return;
            }
            for (name, node) in entries {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                collect(&key, node, leaves);
            }
        }
        Value::List(nodes) => {
            for (index, node) in nodes.iter().enumerate() {
                collect(&format!("{key}.{index}"), node, leaves);
            }
        }
        Value::Number(x) => leaves.push((key.to_owned(), x.to_string(), Some((*x, 0.0)))),
        Value::Text(text) => leaves.push((key.to_owned(), text.clone(), None)),
        Value::Flag(flag) => leaves.push((key.to_owned(), flag.to_string(), None)),
        Value::Other(what) => leaves.push((key.to_owned(), (*what).to_owned(), None)),
    }
}

/// Time since 1970 by the system's clock.
pub fn since_1970() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}
