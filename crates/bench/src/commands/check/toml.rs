//! Files of keys.

use std::{collections::BTreeSet, path::Path};

use bench_campaign::CampaignError;
use bench_plant::effects::{EffectError, resolve_all};
use bench_recording::{
    diff::{DiffError, Tolerances},
    import::{ImportError, ImportMap, check_rig},
};
use bench_rig::{
    Airframe, Calibration, EffectEntry, Mission, Rig, RigError,
    visit::{self, Value},
};

use super::{Checked, Told, told};
use crate::{
    schema::Kind,
    suites::{Plan, Selected},
    sweeps,
    words::causes,
};

/// Checks a text that is a file of keys, if it is one.
pub fn check(file: &Path, text: &str, wanted: Option<Kind>) -> Checked {
    let kind = match wanted.map_or_else(|| recognise(file, text), Ok) {
        Ok(kind) => kind,
        Err(problem) => return Checked { problems: vec![problem], ..Checked::default() },
    };
    let problems = match kind {
        Kind::Rig => rig(file, text),
        Kind::Airframe => Airframe::load(file).map_or_else(|error| told(&error), |_| Vec::new()),
        Kind::Mission => Mission::read(file, text).map_or_else(|error| told(&error), |_| Vec::new()),
        Kind::Map => map(file, text),
        Kind::Calibration => Calibration::load(file).map_or_else(|error| told(&error), |_| Vec::new()),
        Kind::Tolerances => {
            Tolerances::read(file, text).map_or_else(|error| vec![tolerance(file, &error)], |_| Vec::new())
        }
        Kind::Suite => suite(file),
        Kind::Sweep => sweep(file, text),
    };
    Checked { kind: Some(kind.name()), words: kind.words(), problems, ..Checked::default() }
}

/// What a text is: the kind that knows most of its keys.
fn recognise(file: &Path, text: &str) -> Result<Kind, Told> {
    if text.trim().is_empty() {
        return Err(Told::of(file, "is empty"));
    }
    let root = match visit::parse(file, text) {
        Ok(root) => root,
        Err(error) => return Err(no_toml(file, text, &error)),
    };
    let Value::Table(entries) = &root.value else { return Err(unknown(file)) };
    let mut known = Kind::ALL.map(|kind| {
        let forms = kind.keys();
        let names: BTreeSet<_> = forms.iter().flat_map(|form| &form.keys).map(|key| &key.name).collect();
        (entries.iter().filter(|(name, _)| names.contains(name)).count(), kind)
    });
    known.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    match known {
        [(0, _), ..] => Err(unknown(file)),
        [(first, kind), (second, _), ..] if first > second => Ok(kind),
        _ => {
            let kinds = Kind::ALL.map(Kind::name).join(", ");
            Err(Told::of(file, "its keys do not tell what it is").hint(format!("say it by --as: {kinds}")))
        }
    }
}

fn unknown(file: &Path) -> Told {
    let kinds = Kind::ALL.map(Kind::name).join(", ");
    Told::of(file, "is no file of the bench").hint(format!("if it should be one, say which by --as: {kinds}"))
}

/// What a text is that cannot be read as TOML.
fn no_toml(file: &Path, text: &str, error: &RigError) -> Told {
    let named_toml = file.extension().is_some_and(|ending| ending == "toml");
    let first = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
    let first = first.unwrap_or_default();
    let separated = [',', ';', '\t'].iter().any(|separator| first.contains(*separator));
    if named_toml {
        told(error).into_iter().next().unwrap_or_else(|| unknown(file))
    } else if first.starts_with(['{', '[']) && serde_json::from_str::<serde::de::IgnoredAny>(text).is_ok() {
        Told::of(file, "is JSON")
            .hint("`bench schema NAME` prints the form of what commands print with --json")
    } else if separated {
        Told::of(file, "is a table of text").hint(
            "`bench import --map MAP` makes a recording of a flight log; `bench identify` takes balance readings",
        )
    } else {
        unknown(file)
    }
}

/// All that is wrong with a rig, its effects included.
pub fn rig(file: &Path, text: &str) -> Vec<Told> {
    match Rig::read(file, text) {
        Ok(rig) => effects(&rig.effects),
        Err(error) => told(&error),
    }
}

fn effects(entries: &[EffectEntry]) -> Vec<Told> {
    // One by one, so that all of them are told; together, so that repetitions are.
    let each = entries.iter().filter_map(|entry| resolve_all(std::slice::from_ref(entry)).err());
    let mut problems: Vec<_> = each.map(|error| effect(&error)).collect();
    if problems.is_empty() {
        problems.extend(resolve_all(entries).err().map(|error| effect(&error)));
    }
    problems
}

fn effect(error: &EffectError) -> Told {
    let at = error.at().cloned().unwrap_or_default();
    let what = error.detail();
    let (what, hint) = match what.split_once("; ") {
        Some((what, hint)) => (what.to_owned(), Some(hint.to_owned())),
        None => (what, None),
    };
    Told { file: at.file, line: Some(at.line), key: Some("effect".to_owned()), what, hint }
}

/// All that is wrong with a suite and with the rigs and missions that it names. That a board's port is not known yet is no fault of it.
fn suite(file: &Path) -> Vec<Told> {
    match Plan::read(file, &Selected::default(), None, &[]) {
        Ok((_, problems)) => problems.iter().map(Told::from).collect(),
        Err(error) => match error.downcast_ref::<RigError>() {
            Some(error) => told(error),
            None => vec![Told::of(file, causes(&error))],
        },
    }
}

/// All that is wrong with a sweep and with the rigs, missions and recordings that it names.
fn sweep(file: &Path, text: &str) -> Vec<Told> {
    match bench_campaign::Plan::read_as_far_as_possible(file, text, &sweeps::Names { file }) {
        Ok((_, problems)) => problems.iter().map(Told::from).collect(),
        Err(CampaignError::File(error)) => told(&error),
        Err(error) => vec![Told::of(file, error.to_string())],
    }
}

fn map(file: &Path, text: &str) -> Vec<Told> {
    let map = match ImportMap::read(file, text) {
        Ok(map) => map,
        Err(error) => return told(&error),
    };
    match check_rig(&map) {
        Ok(()) => Vec::new(),
        Err(ImportError::Map(error)) => told(&error),
        Err(error) => {
            let words = error.to_string();
            let what = words.strip_prefix(&format!("{}: ", file.display())).unwrap_or(&words);
            vec![Told { key: Some("actuation".to_owned()), ..Told::of(file, what) }]
        }
    }
}

fn tolerance(file: &Path, error: &DiffError) -> Told {
    let words = error.to_string();
    let what = words.strip_prefix(&format!("{}: ", file.display())).unwrap_or(&words);
    // The TOML reader says the line in words, and draws it.
    let line = what.split_once("at line ").and_then(|(_, rest)| {
        rest.split(|c: char| !c.is_ascii_digit()).next().and_then(|digits| digits.parse().ok())
    });
    let (what, hint) =
        what.split_once("; ").map_or((what, None), |(what, hint)| (what, Some(hint.to_owned())));
    let last = what.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or(what);
    Told { line, hint, ..Told::of(file, last) }
}
