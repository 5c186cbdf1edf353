//! The keys of a tolerance file as a list.

use bench_rig::{
    keys::{Form, Key, Kind},
    visit::Range,
};

use super::tolerance::TIME_MAX_S;

/// Every key of a tolerance file.
pub fn tolerance_keys() -> Vec<Form> {
    let size = || Kind::Number(Range::closed(0.0, f64::MAX));
    let rule = vec![
        Key::optional(
            "field",
            "A field in every channel, or with a leading slash a channel's field; * stands \
             for any characters.",
            Kind::Text,
        ),
        Key::optional("unit", "Fields of this unit alone; with `field`, both must match.", Kind::Text),
        Key::optional("absolute", "What a field may differ by, in its own unit.", size()),
        Key::optional("relative", "What it may differ by, as a share of the larger magnitude.", size()),
        Key::optional(
            "time_s",
            "How far apart in time equal values may lie.",
            Kind::Number(Range::closed(0.0, TIME_MAX_S)),
        ),
        Key::optional("ignore", "Leave the fields out of the verdict.", Kind::Flag),
    ];
    let meaning = "Rules on what fields may differ by; later ones win, key by key.";
    Form::only(vec![Key::optional("tolerance", meaning, Kind::Tables(Form::only(rule), 0))])
}
