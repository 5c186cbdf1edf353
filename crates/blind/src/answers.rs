//! What somebody says of sealed cases, in a form that any tool can write (`docs/blind.md`).

use std::{collections::BTreeMap, fs, path::Path};

use serde::{Deserialize, Serialize};

use crate::{
    BlindError,
    cases::label,
    hash,
    seal::{json, write},
};

/// Schema of a file of answers.
pub const ANSWERS_SCHEMA: &str = "bench.answers/1";

/// Answers to the cases of one seal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answers {
    /// [`ANSWERS_SCHEMA`].
    pub schema: String,
    /// Who answers, with version.
    pub tool: String,
    /// `key_sha256` of the seal that is answered.
    pub seal: String,
    /// SHA-256 of this file with these 64 digits as zeros, made when it was written.
    pub sha256: String,
    /// Case to answer. A case that is not here counts as wrong.
    pub cases: BTreeMap<String, Answer>,
}

/// What is said of a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answer {
    /// The verdict.
    pub verdict: Verdict,
    /// One or two effects with the verdict `effect`, else none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<String>,
    /// Label to probability. A label is `none`, `unknown`, an effect, or two effects joined by `+`. What is missing to one
    /// is on no label.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub probabilities: BTreeMap<String, f64>,
    /// Labels, one of which is said to be true (the verdict counts as one of them).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// Labels that these flights cannot tell from the verdict.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub group: Vec<String>,
    /// Parameters of the verdict's effects.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<Told>,
    /// Where the gap lies: tracker, loop, actuator, propulsion, environment or airframe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stage: Option<String>,
    /// Along which axis: altitude, speed, throttle, lagged-throttle, charge or time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<String>,
    /// Share of the gap that the effects close on flights not used for the fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closure: Option<Interval>,
    /// Anything worth telling a person, such as why the case failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// A verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Known effects explain the gap.
    Effect,
    /// There is no gap beyond tolerance.
    None,
    /// There is a gap that no known effect explains.
    Unknown,
    /// The tool failed on this case; it counts as wrong.
    Failed,
}

/// A number with its interval of 90 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Most probable.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// A parameter as told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// The effect.
    pub effect: String,
    /// The parameter's key, which ends in its unit.
    pub name: String,
    /// Most probable.
    pub value: f64,
    /// Lower end of the interval of 90 %.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Answer {
    /// An answer that says no more than its verdict.
    pub fn bare(verdict: Verdict) -> Self {
        Self {
            verdict,
            effects: Vec::new(),
            probabilities: BTreeMap::new(),
            set: Vec::new(),
            group: Vec::new(),
            parameters: Vec::new(),
            stage: None,
            region: None,
            closure: None,
            note: None,
        }
    }

    /// The label of the verdict; `failed` without one.
    pub fn label(&self) -> String {
        match self.verdict {
            Verdict::Effect => label(self.effects.iter().map(String::as_str)),
            Verdict::None => "none".to_owned(),
            Verdict::Unknown => "unknown".to_owned(),
            Verdict::Failed => "failed".to_owned(),
        }
    }

    /// The probability of a label.
    pub fn probability(&self, label: &str) -> f64 {
        self.probabilities.get(label).copied().unwrap_or(0.0)
    }

    /// Whether a scorer would take it; if not, why.
    pub fn check(&self) -> Result<(), String> {
        let expected = if self.verdict == Verdict::Effect { 1..=2 } else { 0..=0 };
        if !expected.contains(&self.effects.len()) {
            return Err(format!("{} effects do not go with verdict {:?}", self.effects.len(), self.verdict));
        }
        if let Some((label, p)) = self.probabilities.iter().find(|(_, p)| !(0.0..=1.0).contains(*p)) {
            return Err(format!("probability of {label} is {p}"));
        }
        let sum: f64 = self.probabilities.values().sum();
        if sum > 1.001 {
            return Err(format!("probabilities add up to {sum}"));
        }
        let intervals =
            self.parameters.iter().map(|told| (told.name.as_str(), told.low, told.value, told.high));
        let closure = self.closure.iter().map(|c| ("closure", c.low, c.value, c.high));
        for (name, low, value, high) in intervals.chain(closure) {
            if !(low <= value && value <= high && low.is_finite() && high.is_finite()) {
                return Err(format!("{name}: low {low}, value {value}, high {high} do not rise"));
            }
        }
        Ok(())
    }

    /// Labels with two effects in the order of the alphabet, whatever their writer's order.
    fn in_order(mut self) -> Self {
        let ordered = |text: &String| label(text.split('+'));
        let mut probabilities = BTreeMap::new();
        for (label, p) in &self.probabilities {
            *probabilities.entry(ordered(label)).or_insert(0.0) += p;
        }
        self.probabilities = probabilities;
        for labels in [&mut self.set, &mut self.group] {
            *labels = labels.iter().map(ordered).collect();
        }
        self
    }
}

const NO_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000000";

impl Answers {
    /// Answers to the seal whose `key_sha256` is given.
    pub fn new(tool: impl Into<String>, seal: impl Into<String>, cases: BTreeMap<String, Answer>) -> Self {
        Self {
            schema: ANSWERS_SCHEMA.to_owned(),
            tool: tool.into(),
            seal: seal.into(),
            sha256: NO_HASH.to_owned(),
            cases: cases.into_iter().map(|(case, answer)| (case, answer.in_order())).collect(),
        }
    }

    /// Writes the file with its hash, which is returned: publish it before the key is opened.
    pub fn write(&self, path: &Path) -> Result<String, BlindError> {
        let text = json(&Self { sha256: NO_HASH.to_owned(), ..self.clone() });
        let (text, hash) = stamped(path, &text)?;
        write(path, &text)?;
        Ok(hash)
    }

    /// Reads a file and checks that it is as it was hashed.
    pub fn load(path: &Path) -> Result<Self, BlindError> {
        let text = fs::read_to_string(path).map_err(BlindError::io("read", path))?;
        let answers = Self::parse(path, &text)?;
        let (_, found) = stamped(path, &text)?;
        if found != answers.sha256 {
            return Err(BlindError::ChangedAnswers { path: path.to_owned(), told: answers.sha256, found });
        }
        Ok(answers)
    }

    fn parse(path: &Path, text: &str) -> Result<Self, BlindError> {
        let malformed = |detail: String| BlindError::Malformed { path: path.to_owned(), detail };
        let mut answers: Self = serde_json::from_str(text).map_err(|error| malformed(error.to_string()))?;
        if answers.schema != ANSWERS_SCHEMA {
            return Err(malformed(format!("schema is {:?}, expected {ANSWERS_SCHEMA}", answers.schema)));
        }
        for (case, answer) in &answers.cases {
            answer.check().map_err(|detail| malformed(format!("{case}: {detail}")))?;
        }
        answers.cases = answers.cases.into_iter().map(|(case, answer)| (case, answer.in_order())).collect();
        Ok(answers)
    }
}

/// Puts the hash into a file of answers that another tool wrote with 64 zeros (or an older hash) in its place. Returns
/// the hash.
pub fn stamp(path: &Path) -> Result<String, BlindError> {
    let text = fs::read_to_string(path).map_err(BlindError::io("read", path))?;
    Answers::parse(path, &text)?;
    let (text, hash) = stamped(path, &text)?;
    write(path, &text)?;
    Ok(hash)
}

/// The text with its own hash in it, and the hash.
fn stamped(path: &Path, text: &str) -> Result<(String, String), BlindError> {
    let malformed = || BlindError::Malformed {
        path: path.to_owned(),
        detail: "no \"sha256\" with 64 hexadecimal digits stands before its cases".to_owned(),
    };
    let digits = own_hash(text).ok_or_else(malformed)?;
    let blank = [&text[..digits.start], NO_HASH, &text[digits.end..]].concat();
    let hash = hash::of(blank.as_bytes());
    Ok(([&text[..digits.start], &hash, &text[digits.end..]].concat(), hash))
}

/// Where the file's hash stands in it.
fn own_hash(text: &str) -> Option<std::ops::Range<usize>> {
    const KEY: &str = "\"sha256\"";
    let after_key = text.find(KEY)? + KEY.len();
    let colon = text[after_key..].trim_start().strip_prefix(':')?.trim_start();
    let start = text.len() - colon.strip_prefix('"')?.len();
    let digits = text.get(start..start + 64)?;
    let closed = text[start + 64..].starts_with('"');
    (closed && digits.bytes().all(|byte| byte.is_ascii_hexdigit())).then_some(start..start + 64)
}
