//! The keys of bench files as a list: what pages and JSON Schemas are made of.
//!
//! [`crate::Rig::keys`] and its like go through the same `visit` functions as reader and writer. Where a choice decides
//! which other keys there are (the `kind` of a phase, the `actuation` of an airframe), its table has a [`Form`] for each.

use crate::{
    Uncertain,
    visit::{Range, Visitor},
};

/// One key of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// As written in the file, its unit included.
    pub name: String,
    /// What it is, in a sentence.
    pub meaning: String,
    /// Whether it may be left out.
    pub presence: Presence,
    /// What it may hold.
    pub kind: Kind,
}

/// Whether a key may be left out, and what is meant then.
#[derive(Clone, Debug, PartialEq)]
pub enum Presence {
    /// It must be there.
    Required,
    /// It may be absent; its meaning says what that means.
    Optional,
    /// Absent, it is this number.
    Number(f64),
    /// Absent, it is this text.
    Text(String),
    /// It must be there with the key named here, and not without.
    Along(String),
    /// It must be there with any of the keys named here, and may be without.
    Beside(Vec<String>),
}

/// What a key may hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A number.
    Number(Range),
    /// A number, or `{ value = ..., sigma = ... }`.
    Uncertain(Range),
    /// A whole number from the first to the second.
    Integer(u32, u32),
    /// A text that is not empty.
    Text,
    /// The name of a file.
    File,
    /// True or false.
    Flag,
    /// One of these texts.
    Choice(Vec<String>),
    /// So many of a kind, from the first to the second number.
    List(Box<Kind>, usize, Option<usize>),
    /// Two values.
    Pair(Box<Kind>, Box<Kind>),
    /// A number, or points `[time_s, number]`.
    Points(Range),
    /// A table of one of these forms.
    Table(Vec<Form>),
    /// At least so many tables, each written as `[[key]]`.
    Tables(Vec<Form>, usize),
    /// A table with keys of the user's own.
    Names(Box<Kind>),
    /// `[[effect]]` tables: a name and the parameters that the effect has.
    Effects,
    /// One of several kinds.
    AnyOf(Vec<Kind>),
}

/// The keys that a table has, under a condition if it has several forms.
#[derive(Clone, Debug, PartialEq)]
pub struct Form {
    /// The choice that makes the table take this form: key and value.
    pub when: Option<(String, String)>,
    /// Its keys, in the order of a file.
    pub keys: Vec<Key>,
}

impl Form {
    /// The only form of a table.
    pub fn only(keys: Vec<Key>) -> Vec<Self> {
        vec![Self { when: None, keys }]
    }

    /// Forms that no choice tells apart, but which keys there are.
    pub fn any(forms: impl IntoIterator<Item = Vec<Key>>) -> Vec<Self> {
        forms.into_iter().map(|keys| Self { when: None, keys }).collect()
    }
}

impl Key {
    /// A key that must be there.
    pub fn required(name: &str, meaning: &str, kind: Kind) -> Self {
        Self { name: name.to_owned(), meaning: meaning.to_owned(), presence: Presence::Required, kind }
    }

    /// A key that may be absent.
    pub fn optional(name: &str, meaning: &str, kind: Kind) -> Self {
        Self { presence: Presence::Optional, ..Self::required(name, meaning, kind) }
    }

    /// The same key, which is `text` where it is absent.
    #[must_use]
    pub fn or_text(self, text: &str) -> Self {
        Self { presence: Presence::Text(text.to_owned()), ..self }
    }

    /// The same key, which is `number` where it is absent.
    #[must_use]
    pub fn or_number(self, number: f64) -> Self {
        Self { presence: Presence::Number(number), ..self }
    }

    /// The same key, which must be there with any of these.
    #[must_use]
    pub fn beside(self, others: &[&str]) -> Self {
        let others = others.iter().map(|other| (*other).to_owned()).collect();
        Self { presence: Presence::Beside(others), ..self }
    }

    /// The unit that its name tells; `None` for what is a pure number or no number.
    pub fn unit(&self) -> Option<&'static str> {
        let numeric = matches!(
            self.kind,
            Kind::Number(_) | Kind::Uncertain(_) | Kind::Points(_) | Kind::List(..) | Kind::AnyOf(_)
        );
        if numeric { unit(&self.name) } else { None }
    }
}

/// Endings of keys and the units that they stand for.
const UNITS: [(&str, &str); 32] = [
    ("m_s2_per_root_s", "m/s^2 per root s"),
    ("m_s2_per_root_hz", "m/s^2 per root Hz"),
    ("rad_s_per_v", "rad/s per V"),
    ("rad_s_per_fraction", "rad/s per full scale"),
    ("rad_s_per_count", "rad/s per count"),
    ("rad_per_v", "rad/V"),
    ("rad_per_fraction", "rad per full scale"),
    ("rad_per_count", "rad/count"),
    ("n_per_v", "N/V"),
    ("n_per_fraction", "N per full scale"),
    ("n_per_count", "N/count"),
    ("n_s_per_m", "N s/m"),
    ("per_s2", "1/s^2"),
    ("per_s", "1/s"),
    ("kg_m2", "kg m^2"),
    ("rad_s", "rad/s"),
    ("m_s2", "m/s^2"),
    ("m_s", "m/s"),
    ("rad", "rad"),
    ("kg", "kg"),
    ("px", "px"),
    ("cm", "cm"),
    ("hz", "Hz"),
    ("ln", "1"),
    ("fraction", "1"),
    ("probability", "1"),
    ("ratio", "1"),
    ("count", "count"),
    ("own_step", "the actuation's"),
    ("v", "V"),
    ("m", "m"),
    ("s", "s"),
];

/// The unit that a key's name ends in.
pub fn unit(key: &str) -> Option<&'static str> {
    UNITS
        .iter()
        .filter(|(ending, _)| {
            key.strip_suffix(ending).is_some_and(|before| before.is_empty() || before.ends_with('_'))
        })
        .max_by_key(|(ending, _)| ending.len())
        .map(|(_, unit)| *unit)
}

/// The forms of the table that `visit` goes through: it is called once for each value of each choice, and a choice that
/// changes which keys there are gives its table a form for each.
pub(crate) fn collect(mut visit: impl FnMut(&mut Collector)) -> Vec<Form> {
    let mut run = |forced| {
        let mut collector = Collector { forced, ..Collector::default() };
        visit(&mut collector);
        collector
    };
    let plain = run(None);
    let mut root = Kind::Table(Form::only(plain.keys));
    for choice in &plain.choices {
        let forms = choice.names.iter().enumerate().filter_map(|(index, name)| {
            let keys = run(Some((choice.table.clone(), choice.key.clone(), index))).keys;
            let mut forced = Kind::Table(Form::only(keys));
            let form = forms_at(&mut forced, &choice.table)?.pop()?;
            Some(Form { when: Some((choice.key.clone(), name.clone())), keys: form.keys })
        });
        let forms: Vec<_> = forms.collect();
        if forms.iter().any(|form| form.keys != forms[0].keys)
            && let Some(place) = forms_at(&mut root, &choice.table)
        {
            *place = forms;
        }
    }
    match root {
        Kind::Table(forms) => forms,
        _ => Vec::new(),
    }
}

/// The forms of the table at `path` below `kind`.
fn forms_at<'k>(kind: &'k mut Kind, path: &[String]) -> Option<&'k mut Vec<Form>> {
    let (Kind::Table(forms) | Kind::Tables(forms, _)) = kind else { return None };
    let Some((first, rest)) = path.split_first() else { return Some(forms) };
    let key = forms.first_mut()?.keys.iter_mut().find(|key| key.name == *first)?;
    forms_at(&mut key.kind, rest)
}

/// A choice and the table that it stands in.
#[derive(Debug)]
struct Choice {
    table: Vec<String>,
    key: String,
    names: Vec<String>,
}

/// Makes the list of keys that a `visit` function names.
#[derive(Debug, Default)]
pub(crate) struct Collector {
    /// Of the table that is visited.
    keys: Vec<Key>,
    path: Vec<String>,
    choices: Vec<Choice>,
    /// Table, key and the place among its choices of the value to take.
    forced: Option<(Vec<String>, String, usize)>,
    along: Option<String>,
}

impl Collector {
    fn add(&mut self, key: &str, meaning: &str, presence: Presence, kind: Kind) {
        let presence = match (&self.along, presence) {
            (Some(other), Presence::Required) => Presence::Along(other.clone()),
            (_, presence) => presence,
        };
        self.keys.push(Key { name: key.to_owned(), meaning: meaning.to_owned(), presence, kind });
    }

    fn choose<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        meaning: &str,
        choices: &[(&str, T)],
        value: &mut T,
        presence: Presence,
    ) {
        let names: Vec<_> = choices.iter().map(|(name, _)| (*name).to_owned()).collect();
        self.choices.push(Choice { table: self.path.clone(), key: key.to_owned(), names: names.clone() });
        if let Some((table, forced, index)) = &self.forced
            && *table == self.path
            && forced == key
        {
            *value = choices[*index].1;
        }
        self.add(key, meaning, presence, Kind::Choice(names));
    }

    /// The keys that `visit` names within the table `key`.
    fn inside(&mut self, key: &str, visit: impl FnOnce(&mut Self)) -> Vec<Form> {
        self.path.push(key.to_owned());
        let outer = std::mem::take(&mut self.keys);
        visit(self);
        self.path.pop();
        Form::only(std::mem::replace(&mut self.keys, outer))
    }
}

impl Visitor for Collector {
    fn uncertain(&mut self, key: &str, meaning: &str, range: Range, _: &mut Uncertain) {
        self.add(key, meaning, Presence::Required, Kind::Uncertain(range));
    }

    fn number(&mut self, key: &str, meaning: &str, range: Range, _: &mut f64) {
        self.add(key, meaning, Presence::Required, Kind::Number(range));
    }

    fn maybe(&mut self, key: &str, meaning: &str, range: Range, _: &mut Option<f64>) {
        self.add(key, meaning, Presence::Optional, Kind::Number(range));
    }

    fn integer(&mut self, key: &str, meaning: &str, low: u32, high: u32, _: &mut u32) {
        self.add(key, meaning, Presence::Required, Kind::Integer(low, high));
    }

    fn text(&mut self, key: &str, meaning: &str, _: &mut String) {
        self.add(key, meaning, Presence::Required, Kind::Text);
    }

    fn choice<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        meaning: &str,
        choices: &[(&str, T)],
        value: &mut T,
    ) {
        self.choose(key, meaning, choices, value, Presence::Required);
    }

    fn choice_or<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        meaning: &str,
        choices: &[(&str, T)],
        value: &mut T,
    ) {
        let default = choices.iter().find(|(_, choice)| choice == value);
        let presence = default.map_or(Presence::Optional, |(name, _)| Presence::Text((*name).to_owned()));
        self.choose(key, meaning, choices, value, presence);
    }

    fn choice_beside<T: Copy + PartialEq>(
        &mut self,
        key: &str,
        meaning: &str,
        choices: &[(&str, T)],
        value: &mut T,
    ) {
        let presence =
            choices.first().map_or(Presence::Optional, |(name, _)| Presence::Text((*name).to_owned()));
        self.choose(key, meaning, choices, value, presence);
    }

    fn triple(&mut self, key: &str, meaning: &str, range: Range, _: &mut [f64; 3]) {
        let kind = Kind::List(Box::new(Kind::Number(range)), 3, Some(3));
        self.add(key, meaning, Presence::Required, kind);
    }

    fn points(
        &mut self,
        key: &str,
        meaning: &str,
        range: Range,
        _: &mut Vec<[f64; 2]>,
        default: Option<f64>,
    ) {
        let presence = default.map_or(Presence::Required, Presence::Number);
        self.add(key, meaning, presence, Kind::Points(range));
    }

    fn table(&mut self, key: &str, meaning: &str, visit: impl FnOnce(&mut Self)) {
        let forms = self.inside(key, visit);
        self.add(key, meaning, Presence::Required, Kind::Table(forms));
    }

    fn maybe_table(&mut self, key: &str, meaning: &str, visit: impl FnOnce(&mut Self)) {
        let forms = self.inside(key, visit);
        self.add(key, meaning, Presence::Optional, Kind::Table(forms));
    }

    fn tables<T>(
        &mut self,
        key: &str,
        least: usize,
        meaning: &str,
        _: &mut Vec<T>,
        blank: impl Fn() -> T,
        visit: impl Fn(&mut T, &mut Self),
    ) {
        let forms = self.inside(key, |collector| visit(&mut blank(), collector));
        let presence = if least > 0 { Presence::Required } else { Presence::Optional };
        self.add(key, meaning, presence, Kind::Tables(forms, least));
    }

    fn along(&mut self, key: &str, _: bool, visit: impl FnOnce(&mut Self)) {
        let outer = self.along.replace(key.to_owned());
        visit(self);
        self.along = outer;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Airframe, Calibration, Mission, Rig};

    fn every_key(forms: &[Form], into: &mut Vec<Key>) {
        fn within(kind: &Kind, into: &mut Vec<Key>) {
            match kind {
                Kind::Table(forms) | Kind::Tables(forms, _) => every_key(forms, into),
                Kind::AnyOf(kinds) => kinds.iter().for_each(|kind| within(kind, into)),
                _ => {}
            }
        }
        for key in forms.iter().flat_map(|form| &form.keys) {
            within(&key.kind, into);
            into.push(key.clone());
        }
    }

    fn names(form: &Form) -> Vec<&str> {
        form.keys.iter().map(|key| key.name.as_str()).collect()
    }

    #[test]
    fn every_number_has_a_unit_in_its_key_or_is_known_to_have_none() {
        const PURE: [&str; 10] = [
            "multiplier",
            "k",
            "p1",
            "p2",
            "depth_scale",
            "const_shift",
            "thrust_to_weight",
            "chirp_amplitude",
            "overruns_max",
            "nats_per_measurement",
        ];
        let mut keys = Vec::new();
        for forms in [Rig::keys(), Airframe::keys(), Mission::keys(), Calibration::keys()] {
            every_key(&forms, &mut keys);
        }
        assert!(keys.len() > 200, "{}", keys.len());
        for key in keys {
            let number =
                matches!(key.kind, Kind::Number(_) | Kind::Uncertain(_) | Kind::Points(_) | Kind::List(..));
            let told = key.unit().is_some() || PURE.contains(&key.name.as_str());
            assert!(told || !number, "{} has no unit", key.name);
            assert!(key.meaning.ends_with('.') && key.meaning.len() > 8, "{}: {:?}", key.name, key.meaning);
        }
    }

    #[test]
    fn a_choice_that_changes_the_keys_gives_its_table_a_form_for_each() {
        let forms = Airframe::keys();
        let when: Vec<_> = forms.iter().map(|form| form.when.clone().unwrap().1).collect();
        assert_eq!(when, ["volt", "fraction", "count"]);
        let Kind::Table(sticks) = &forms[2].keys.iter().find(|key| key.name == "sticks").unwrap().kind else {
            panic!("sticks are a table")
        };
        assert!(names(&sticks[0]).contains(&"tilt_rad_per_count"));

        let rig = Rig::keys();
        let [rig] = rig.as_slice() else { panic!("no choice changes the keys at the top") };
        let Kind::Table(control) = &rig.keys.iter().find(|key| key.name == "control").unwrap().kind else {
            panic!("control is a table")
        };
        let observer = |form: &Form| {
            let key = form.keys.iter().find(|key| key.name.starts_with("observer_white")).unwrap();
            key.presence.clone()
        };
        assert_eq!(control.len(), 2, "a predictor that needs its observer, and one that does not");
        assert_eq!([0, 1].map(|i| observer(&control[i])), [Presence::Optional, Presence::Required]);

        let mission = Mission::keys();
        let Kind::Tables(phases, 1) = &mission[0].keys.last().unwrap().kind else {
            panic!("phases are tables")
        };
        assert_eq!(phases.len(), 5);
        assert_eq!(names(&phases[4]), ["kind", "duration_s", "descent_m_s", "cut_below_m"]);
        let chirp = phases[2].keys.iter().find(|key| key.name == "chirp_to_hz").unwrap();
        assert_eq!(chirp.presence, Presence::Along("chirp_amplitude".to_owned()));
    }
}
