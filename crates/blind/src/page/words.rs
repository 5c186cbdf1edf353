//! Scores in words.

use std::fmt::Write as _;

use crate::score::{Figure, Rate, Score};

pub(crate) fn percent(share: Option<f64>) -> String {
    share.map_or("-".to_owned(), |share| format!("{:.0} %", 100.0 * share))
}

/// Counts and interval of a rate.
pub(crate) fn rate(rate: &Rate) -> String {
    if rate.of == 0 {
        return "no cases".to_owned();
    }
    format!("{} of {}, {:.0} to {:.0} %", rate.count, rate.of, 100.0 * rate.low, 100.0 * rate.high)
}

/// A figure and its interval.
pub(crate) fn figure(figure: &Figure, digits: usize) -> (String, String) {
    match (figure.value, figure.low, figure.high) {
        (Some(value), Some(low), Some(high)) => {
            (format!("{value:.digits$}"), format!("{low:.digits$} to {high:.digits$}"))
        }
        _ => ("-".to_owned(), "no cases".to_owned()),
    }
}

/// Name, value and interval of every figure.
pub(crate) fn lines(score: &Score) -> Vec<(&'static str, String, String)> {
    let top = &score.top_1;
    let mut lines = Vec::new();
    for (name, of) in [
        ("named rightly, all cases", &top.all),
        ("  no cause", &top.none),
        ("  single effects", &top.single),
        ("  single effects, d' 10 or more", &top.single_plain),
        ("  pairs", &top.pair),
        ("  pairs, each of d' 10 or more", &top.pair_plain),
        ("  outside the library", &top.outside),
        ("  outside the library, d' 10 or more", &top.outside_plain),
        ("pairs with one of two named", &score.half_of_pair),
        ("group hits, not counted as named", &score.group_hits),
        ("truth in the set", &score.set_coverage),
        ("false alarms on no cause", &score.false_alarms),
        ("stage right", &score.stage),
        ("axis right", &score.region),
        ("90 % intervals that hold", &score.parameters.coverage),
    ] {
        lines.push((name, percent(of.value), rate(of)));
    }
    for (name, of, digits) in [
        ("labels in the set", &score.set_size, 2),
        ("log score, nats", &score.log_score, 3),
        ("Brier score", &score.brier, 3),
        ("expected calibration error", &score.ece, 3),
        ("  of right probabilities, by chance", &score.ece_by_chance, 3),
        ("unknown: AUROC", &score.unknown.auroc, 3),
        ("unknown: found at 5 % false", &score.unknown.found_at_5_percent, 2),
        ("closure, effect rightly named (oracle 1)", &score.closure.told, 2),
        ("closure, outside the library", &score.closure.told_outside, 2),
        ("median relative error of parameters", &score.parameters.relative_error, 2),
    ] {
        let (value, interval) = figure(of, digits);
        lines.push((name, value, interval));
    }
    lines
}

impl Score {
    /// The score as lines for a terminal.
    pub fn in_words(&self) -> String {
        let mut out = format!("{} on {} sealed cases of rig {}\n", self.tool, self.cases, self.rig);
        // Writing to a String cannot fail.
        for (cases, what) in [(&self.missing, "without an answer"), (&self.failed, "failed")] {
            if !cases.is_empty() {
                let _ = writeln!(out, "  {} {what}, counted as wrong: {}", cases.len(), cases.join(", "));
            }
        }
        for (name, value, interval) in lines(self) {
            let _ = writeln!(out, "  {name:<42} {value:>7}   {interval}");
        }
        out
    }
}
