use std::path::PathBuf;

use bench_rig::{Airframe, EffectEntry, Location};
use thiserror::Error;

use super::{Effect, EffectRng, LIBRARY, Signature};

/// The part of the loop in which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Position source.
    Tracker,
    /// Timing of the loop.
    Loop,
    /// Between the output's pin and the motors' command.
    Actuator,
    /// Motors, rotors and battery.
    Propulsion,
    /// Air and surfaces around the airframe.
    Environment,
    /// The airframe itself.
    Airframe,
}

impl Stage {
    /// Its name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tracker => "tracker",
            Self::Loop => "loop",
            Self::Actuator => "actuator",
            Self::Propulsion => "propulsion",
            Self::Environment => "environment",
            Self::Airframe => "airframe",
        }
    }
}

/// What is thought of a parameter before any flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prior {
    /// Normal, for parameters of either sign.
    Normal {
        /// Mean, in the parameter's unit.
        mean: f64,
        /// Standard deviation, in the parameter's unit.
        sigma: f64,
    },
    /// The logarithm is normal, for sizes and time constants.
    LogNormal {
        /// Median, in the parameter's unit.
        median: f64,
        /// Standard deviation of the natural logarithm.
        sigma_ln: f64,
    },
}

impl Prior {
    /// A value to show in examples: the median, or one sigma above a mean of zero.
    pub fn typical(self) -> f64 {
        match self {
            Self::Normal { mean: 0.0, sigma } => sigma,
            Self::Normal { mean, .. } => mean,
            Self::LogNormal { median, .. } => median,
        }
    }
}

/// One number of an effect's law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Its key in rig files, unit included.
    pub key: &'static str,
    /// Its unit; `1` for none.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// What is thought of it before any flight.
    pub prior: Prior,
    /// The value at which the effect vanishes, whatever its other parameters; `None` for one that only shapes it. Where
    /// several have one, the effect vanishes with all of them.
    pub neutral: Option<f64>,
    /// The value where it is not given: what makes of the law its plainest form. `None` for one that must be given.
    pub default: Option<f64>,
}

/// An effect of the library.
pub struct EffectSpec {
    /// The name on the command line, in rig files and results.
    pub name: &'static str,
    /// Where it acts.
    pub stage: Stage,
    /// What it is, in a phrase.
    pub summary: &'static str,
    /// Its equation.
    pub law: &'static str,
    /// Where the law is from.
    pub source: &'static str,
    /// Its numbers.
    pub parameters: &'static [Parameter],
    /// How flights show it.
    pub signature: Signature,
    /// Makes one from values in the order of `parameters`.
    pub build: fn(&[f64], &Airframe, EffectRng) -> Box<dyn Effect>,
}

impl EffectSpec {
    /// How to ask for it on the command line, with typical values of what must be given.
    pub fn example(&self) -> String {
        let needed = self.parameters.iter().filter(|p| p.default.is_none());
        let values: Vec<_> = needed.map(|p| format!("{}={}", p.key, p.prior.typical())).collect();
        format!("{}:{}", self.name, values.join(","))
    }
}

impl EffectError {
    /// Where the effect was asked for; `None` of one that could not be read.
    pub fn at(&self) -> Option<&Location> {
        match self {
            Self::UnknownEffect { at, .. }
            | Self::UnknownParameter { at, .. }
            | Self::MissingParameter { at, .. }
            | Self::OutOfRange { at, .. }
            | Self::Repeated { at, .. } => Some(at),
            Self::Syntax { .. } => None,
        }
    }

    /// The error in words, without the place.
    pub fn detail(&self) -> String {
        let words = self.to_string();
        let place = self.at().map(|at| format!("{at}: ")).unwrap_or_default();
        words.strip_prefix(&place).unwrap_or(&words).to_owned()
    }
}

/// Why an effect could not be switched on.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum EffectError {
    /// No such effect.
    #[error("{at}: no effect is called {name:?}; {hint}")]
    UnknownEffect {
        /// Where it was asked for.
        at: Location,
        /// The name asked for.
        name: String,
        /// What is close to it.
        hint: String,
    },
    /// No such parameter.
    #[error("{at}: effect {effect} has no parameter `{key}`; write {example}")]
    UnknownParameter {
        /// Where.
        at: Location,
        /// The effect.
        effect: &'static str,
        /// The key given.
        key: String,
        /// How it is asked for.
        example: String,
    },
    /// A parameter was not given.
    #[error("{at}: effect {effect} needs `{key}` ({meaning}{}); write {example}", unit_after(", ", unit))]
    MissingParameter {
        /// Where.
        at: Location,
        /// The effect.
        effect: &'static str,
        /// The key.
        key: &'static str,
        /// What it is.
        meaning: &'static str,
        /// Its unit.
        unit: &'static str,
        /// How it is asked for.
        example: String,
    },
    /// A value outside its range.
    #[error(
        "{at}: effect {effect}: `{key}` = {value} is out of range; expected {min} to {max}{}",
        unit_after(" ", unit)
    )]
    OutOfRange {
        /// Where.
        at: Location,
        /// The effect.
        effect: &'static str,
        /// The key.
        key: &'static str,
        /// The value given.
        value: f64,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// An effect, or a parameter of one, asked for twice.
    #[error("{at}: {what} is given twice; keep one of them")]
    Repeated {
        /// Where it was asked for again.
        at: Location,
        /// What it is.
        what: String,
    },
    /// Not of the form of an effect on the command line.
    #[error("--effect {text:?}: expected NAME:param=value,param=value, such as {example}")]
    Syntax {
        /// What was given.
        text: String,
        /// How it is done.
        example: String,
    },
}

/// A unit as the end of a phrase; nothing for a pure number.
fn unit_after(separator: &str, unit: &str) -> String {
    if unit == "1" { String::new() } else { format!("{separator}{unit}") }
}

/// An effect as written on the command line: `NAME:param=value,param=value`. Names and ranges are checked by
/// [`super::Effects::from_rig`].
pub fn parse_effect(text: &str) -> Result<EffectEntry, EffectError> {
    let syntax = || EffectError::Syntax { text: text.to_owned(), example: LIBRARY[0].example() };
    let (name, assignments) = text.split_once(':').unwrap_or((text, ""));
    let mut parameters = Vec::new();
    for assignment in assignments.split(',').filter(|part| !part.is_empty()) {
        let (key, value) = assignment.split_once('=').ok_or_else(syntax)?;
        parameters.push((key.trim().to_owned(), value.trim().parse().map_err(|_| syntax())?, 1));
    }
    let at = Location { file: PathBuf::from("--effect"), line: 1 };
    Ok(EffectEntry { name: name.to_owned(), parameters, at })
}

/// The library's index and the values, in the order of the spec, of each of a rig's entries; in the library's order.
pub fn resolve_all(entries: &[EffectEntry]) -> Result<Vec<(usize, Vec<f64>)>, EffectError> {
    let mut resolved: Vec<(usize, Vec<f64>)> = Vec::with_capacity(entries.len());
    for entry in entries {
        let (index, values) = resolve(entry)?;
        if resolved.iter().any(|(other, _)| *other == index) {
            let what = format!("effect {}", entry.name);
            return Err(EffectError::Repeated { at: entry.at.clone(), what });
        }
        resolved.push((index, values));
    }
    resolved.sort_by_key(|(index, _)| *index);
    Ok(resolved)
}

fn resolve(entry: &EffectEntry) -> Result<(usize, Vec<f64>), EffectError> {
    let index = super::index_of(&entry.name).ok_or_else(|| unknown(entry))?;
    let spec = LIBRARY[index];
    check_keys(entry, spec)?;
    let values = spec.parameters.iter().map(|parameter| value(entry, spec, parameter));
    Ok((index, values.collect::<Result<_, _>>()?))
}

/// Every key given is one of the effect's, and given once.
fn check_keys(entry: &EffectEntry, spec: &EffectSpec) -> Result<(), EffectError> {
    for (position, (key, _, line)) in entry.parameters.iter().enumerate() {
        let at = || Location { file: entry.at.file.clone(), line: *line };
        if spec.parameters.iter().all(|parameter| parameter.key != key) {
            let (key, example) = (key.clone(), spec.example());
            return Err(EffectError::UnknownParameter { at: at(), effect: spec.name, key, example });
        }
        if entry.parameters[..position].iter().any(|(other, ..)| other == key) {
            let what = format!("effect {}: `{key}`", spec.name);
            return Err(EffectError::Repeated { at: at(), what });
        }
    }
    Ok(())
}

fn value(entry: &EffectEntry, spec: &EffectSpec, parameter: &Parameter) -> Result<f64, EffectError> {
    let Parameter { key, unit, meaning, min, max, .. } = *parameter;
    let effect = spec.name;
    let Some((_, value, line)) = entry.parameters.iter().find(|(given, ..)| given == key) else {
        if let Some(default) = parameter.default {
            return Ok(default);
        }
        let (at, example) = (entry.at.clone(), spec.example());
        return Err(EffectError::MissingParameter { at, effect, key, meaning, unit, example });
    };
    if (min..=max).contains(value) {
        Ok(*value)
    } else {
        let at = Location { file: entry.at.file.clone(), line: *line };
        Err(EffectError::OutOfRange { at, effect, key, value: *value, min, max, unit })
    }
}

fn unknown(entry: &EffectEntry) -> EffectError {
    let closest = LIBRARY
        .iter()
        .map(|spec| (strsim::jaro_winkler(&entry.name, spec.name), spec.name))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(similarity, _)| *similarity > 0.8);
    let hint = if let Some((_, name)) = closest {
        format!("did you mean {name}? `bench effects` lists them all")
    } else {
        let names: Vec<_> = LIBRARY.iter().map(|spec| spec.name).collect();
        format!("there are {}", names.join(", "))
    };
    EffectError::UnknownEffect { at: entry.at.clone(), name: entry.name.clone(), hint }
}
