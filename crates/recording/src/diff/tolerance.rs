//! What a field may differ by: built-in values by unit, the floor of repeat recordings, files and flags.

use std::{fs, path::Path};

use serde::Deserialize;

use super::{
    DiffError,
    derived::Derived,
    law::{Entry, Interpolation, catalogue},
    merge::Outcome,
    report::{Tolerance, ToleranceOrigin},
};

/// Built-in tolerances: unit, absolute, relative. What the paper's rig resolves, or 1 % where it says nothing.
const DEFAULTS: [(&str, f64, f64); 14] = [
    // The tracker's resolution (paper, section 2).
    ("m", 0.005, 0.0),
    // That over the 0.2 s window in which velocity is taken.
    ("m/s", 0.025, 0.0),
    ("m/s^2", 0.1, 0.01),
    ("rad", 0.02, 0.0),
    ("rad/s", 0.05, 0.01),
    ("px", 1.0, 0.0),
    ("N", 0.0015, 0.01),
    // One step of an 8-bit output over 3.3 V.
    ("V", 0.013, 0.0),
    // One such step of full scale: fractions and counts of sticks, ratios.
    ("1", 0.004, 0.0),
    ("count", 0.0, 0.004),
    ("actuation", 0.0, 0.01),
    ("A", 0.01, 0.01),
    ("min", 0.01, 0.0),
    ("s", 0.001, 0.0),
];

/// The largest time tolerance, s: two recordings are held in memory for a few times as long.
pub(super) const TIME_MAX_S: f64 = 10.0;
/// Differences up to so many times the largest among repeats, in size and in RMS, are taken as repeats.
const FLOOR_FACTOR: f64 = 1.5;

/// Which tolerance a flag sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToleranceKey {
    /// In the field's unit.
    Absolute,
    /// A share of the larger of the two magnitudes.
    Relative,
    /// s
    Time,
}

impl ToleranceKey {
    const fn name(self) -> &'static str {
        match self {
            Self::Absolute => "absolute",
            Self::Relative => "relative",
            Self::Time => "time_s",
        }
    }
}

/// Rules on what fields may differ by, on top of the built-in ones. Later rules win, key by key.
///
/// A rule's pattern names a field (`position_m.z`, in every channel) or, with a leading slash, a channel's field
/// (`/tracker/position/position_m.*`); `*` stands for any characters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerances {
    rules: Vec<Rule>,
}

#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rule {
    field: Option<String>,
    unit: Option<String>,
    absolute: Option<f64>,
    relative: Option<f64>,
    time_s: Option<f64>,
    ignore: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleFile {
    #[serde(default)]
    tolerance: Vec<Rule>,
}

impl Tolerances {
    /// Reads a file of `[[tolerance]]` tables (docs/diff.md).
    pub fn load(path: impl AsRef<Path>) -> Result<Self, DiffError> {
        let path = path.as_ref();
        let text =
            fs::read_to_string(path).map_err(|source| DiffError::Read { path: path.to_owned(), source })?;
        Self::read(path, &text)
    }

    /// Reads such a file's text; `file` serves messages.
    pub fn read(file: &Path, text: &str) -> Result<Self, DiffError> {
        let RuleFile { tolerance: rules } = toml::from_str(text)
            .map_err(|error| DiffError::BadFile { path: file.to_owned(), detail: error.to_string() })?;
        let origin = file.display().to_string();
        rules.iter().try_for_each(|rule| rule.check(&origin))?;
        Ok(Self { rules })
    }

    /// Whether there are no rules.
    pub fn is_empty(&self) -> bool {
        self.rules.is_empty()
    }

    /// Adds the rules of another set, which win over those already there.
    pub fn extend(&mut self, others: Self) {
        self.rules.extend(others.rules);
    }

    /// Adds a flag's `FIELD=NUMBER`.
    pub fn add_flag(&mut self, key: ToleranceKey, text: &str) -> Result<(), DiffError> {
        let parts = text.rsplit_once('=').filter(|(field, _)| !field.is_empty());
        let number = |text: &str| text.trim().parse::<f64>().ok();
        let Some((field, number)) = parts.and_then(|(field, value)| Some((field, number(value)?))) else {
            return Err(DiffError::BadFlag { text: text.to_owned() });
        };
        let mut rule = Rule { field: Some(field.trim().to_owned()), ..Rule::default() };
        *match key {
            ToleranceKey::Absolute => &mut rule.absolute,
            ToleranceKey::Relative => &mut rule.relative,
            ToleranceKey::Time => &mut rule.time_s,
        } = Some(number);
        self.add(rule)
    }

    /// Leaves the fields of a pattern out of the verdict.
    pub fn ignore(&mut self, pattern: &str) -> Result<(), DiffError> {
        self.add(Rule { field: Some(pattern.to_owned()), ignore: Some(true), ..Rule::default() })
    }

    fn add(&mut self, rule: Rule) -> Result<(), DiffError> {
        rule.check("the command line")?;
        self.rules.push(rule);
        Ok(())
    }

    /// What holds for a field. `sampling_s` is the time tolerance unless a rule sets one.
    pub(super) fn limits(
        &self,
        entry: &Entry,
        unit: &str,
        sampling_s: f64,
        measured: Measured<'_>,
    ) -> Limits {
        let mut limits = Limits { tolerance: default_tolerance(entry, unit, sampling_s), ignored: false };
        match measured {
            Measured::Nothing => {}
            Measured::Floor(floor) => floor.apply(entry, &mut limits.tolerance),
            Measured::Derived(derived) => derived.apply(entry, sampling_s, &mut limits.tolerance),
        }
        for rule in self.rules.iter().filter(|rule| rule.matches(entry, unit)) {
            rule.apply(&mut limits);
        }
        limits
    }
}

/// What is known of a field beyond what is built in.
#[derive(Clone, Copy, Debug)]
pub(super) enum Measured<'a> {
    Nothing,
    Floor(&'a Floor),
    Derived(&'a Derived),
}

/// What holds for a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limits {
    pub tolerance: Tolerance,
    pub ignored: bool,
}

pub(super) fn default_tolerance(entry: &Entry, unit: &str, sampling_s: f64) -> Tolerance {
    let by_unit = DEFAULTS.iter().find(|(of, ..)| *of == unit && !entry.law.exact);
    let (absolute, relative) = by_unit.map_or((0.0, 0.0), |(_, absolute, relative)| (*absolute, *relative));
    Tolerance { absolute, relative, time_s: sampling_s, ..Tolerance::exact(ToleranceOrigin::Default) }
}

impl Rule {
    fn check(&self, origin: &str) -> Result<(), DiffError> {
        let field = self.field.clone().or_else(|| self.unit.clone()).unwrap_or_else(|| "*".to_owned());
        let bounds = [
            (ToleranceKey::Absolute, self.absolute, f64::MAX, "0 or more"),
            (ToleranceKey::Relative, self.relative, f64::MAX, "0 or more"),
            (ToleranceKey::Time, self.time_s, TIME_MAX_S, "from 0 to 10 s"),
        ];
        for (key, value, most, expected) in bounds {
            if let Some(value) = value.filter(|value| !(0.0..=most).contains(value)) {
                let (origin, key) = (origin.to_owned(), key.name());
                return Err(DiffError::BadTolerance { origin, key, value, field, expected });
            }
        }
        let Some(pattern) = &self.field else { return Ok(()) };
        let entries = catalogue();
        if entries.iter().any(|entry| names(pattern, entry)) {
            return Ok(());
        }
        let likeness = |entry: &Entry| {
            let name = if pattern.starts_with('/') { entry.path.as_str() } else { entry.field.name };
            (strsim::jaro_winkler(pattern, name) * 1e6) as u64
        };
        let closest = entries.iter().max_by_key(|entry| likeness(entry));
        Err(DiffError::NoSuchField {
            origin: origin.to_owned(),
            pattern: pattern.clone(),
            closest: closest.map_or_else(String::new, |entry| entry.path.clone()),
        })
    }

    fn matches(&self, entry: &Entry, unit: &str) -> bool {
        self.field.as_ref().is_none_or(|pattern| names(pattern, entry))
            && self.unit.as_ref().is_none_or(|wanted| wanted == unit)
    }

    fn apply(&self, limits: &mut Limits) {
        let tolerance = &mut limits.tolerance;
        if self.absolute.is_some() || self.relative.is_some() {
            // Whoever gives a tolerance means all of it: nothing built in or measured is left beside it.
            if tolerance.origin != ToleranceOrigin::Given {
                (tolerance.absolute, tolerance.relative) = (0.0, 0.0);
                (tolerance.rms, tolerance.mean, tolerance.share) = (None, None, None);
            }
            tolerance.origin = ToleranceOrigin::Given;
        }
        tolerance.absolute = self.absolute.unwrap_or(tolerance.absolute);
        tolerance.relative = self.relative.unwrap_or(tolerance.relative);
        tolerance.time_s = self.time_s.unwrap_or(tolerance.time_s);
        limits.ignored = self.ignore.unwrap_or(limits.ignored);
    }
}

fn names(pattern: &str, entry: &Entry) -> bool {
    let name = if pattern.starts_with('/') { entry.path.as_str() } else { entry.field.name };
    glob(pattern.as_bytes(), name.as_bytes())
}

fn glob(pattern: &[u8], name: &[u8]) -> bool {
    match pattern.split_first() {
        None => name.is_empty(),
        Some((b'*', rest)) => (0..=name.len()).any(|skipped| glob(rest, &name[skipped..])),
        Some((first, rest)) => name.split_first().is_some_and(|(n, names)| n == first && glob(rest, names)),
    }
}

/// The differences of one field among repeat recordings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Floor {
    largest: f64,
    rms: f64,
    share: f64,
}

impl Floor {
    /// Adds what one pair of repeats differs by, compared without tolerance.
    pub fn add(&mut self, pair: &Outcome) {
        let compared = pair.compared[0] + pair.compared[1];
        self.largest = self.largest.max(pair.tally.largest_off);
        self.rms = self.rms.max(pair.tally.rms_off());
        self.share = self.share.max(pair.tally.beyond as f64 / compared.max(1) as f64);
    }

    fn apply(&self, entry: &Entry, tolerance: &mut Tolerance) {
        tolerance.origin = ToleranceOrigin::Floor;
        tolerance.relative = 0.0;
        if entry.law.exact || entry.law.interpolation == Interpolation::None {
            tolerance.share = Some((FLOOR_FACTOR * self.share).min(1.0));
        }
        if !entry.law.exact {
            tolerance.absolute = FLOOR_FACTOR * self.largest;
            tolerance.rms = Some(FLOOR_FACTOR * self.rms);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(path: &str) -> Entry {
        catalogue().into_iter().find(|entry| entry.path == path).expect("a field")
    }

    #[test]
    fn every_unit_of_a_number_has_a_tolerance() {
        for entry in catalogue() {
            let unit = entry.field.unit;
            assert!(unit.is_empty() || DEFAULTS.iter().any(|(of, ..)| *of == unit), "{}: {unit}", entry.path);
        }
    }

    #[test]
    fn later_rules_win_and_a_given_tolerance_stands_alone() {
        let text = "[[tolerance]]\nfield = \"position_m.*\"\nabsolute = 0.1\n\
                    [[tolerance]]\nfield = \"/tracker/position/position_m.z\"\nrelative = 0.2\ntime_s = 0.3\n";
        let mut tolerances = Tolerances::read(Path::new("t.toml"), text).expect("sound");
        tolerances.add_flag(ToleranceKey::Absolute, "position_m.x=0.7").expect("sound");
        let z = tolerances
            .limits(&entry("/tracker/position/position_m.z"), "m", 0.0, Measured::Nothing)
            .tolerance;
        assert_eq!((z.absolute, z.relative, z.time_s), (0.1, 0.2, 0.3));
        let x = tolerances.limits(&entry("/plant/truth/position_m.x"), "m", 0.0, Measured::Nothing).tolerance;
        assert_eq!((x.absolute, x.relative, x.origin), (0.7, 0.0, ToleranceOrigin::Given));
        let speed =
            tolerances.limits(&entry("/plant/truth/velocity_m_s.x"), "m/s", 0.0, Measured::Nothing).tolerance;
        assert_eq!(speed.origin, ToleranceOrigin::Default);
    }

    #[test]
    fn mistakes_are_told_where_they_are() {
        let read = |text: &str| Tolerances::read(Path::new("t.toml"), text).expect_err("wrong").to_string();
        assert!(
            read("[[tolerance]]\nabsolut = 1").contains("line 2"),
            "{}",
            read("[[tolerance]]\nabsolut = 1")
        );
        let negative = read("[[tolerance]]\nfield = \"position_m.z\"\nabsolute = -1.0");
        assert!(negative.contains("position_m.z") && negative.contains("0 or more"), "{negative}");
        assert!(read("[[tolerance]]\nabsolute = nan").contains("NaN"));
        let unknown = read("[[tolerance]]\nfield = \"positon_m.z\"\nabsolute = 1.0");
        assert!(unknown.contains("position_m.z"), "{unknown}");
        let flag = Tolerances::default().add_flag(ToleranceKey::Time, "position_m.z").expect_err("no number");
        assert!(flag.to_string().contains("FIELD=NUMBER"));
    }
}
