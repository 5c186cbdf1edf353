//! A diagnosis as it is reported: what it comes to, held to how sure it must be and to flights of one condition.

use bench_diagnosis::{Agreeing, Diagnosis, Disagreement, Verdict};
use bench_page::Tone;
use serde::Serialize;

use super::told;
use crate::{calibration::Choice, nominal::ModelTold, words::short};

/// What a diagnosis comes to once it must be sure enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Conclusion {
    /// One or two effects of the library explain the gap.
    Effect,
    /// No gap beyond tolerance and noise.
    None,
    /// A gap that no known effect explains.
    Unknown,
    /// Nothing is sure enough to be told.
    Inconclusive,
}

/// Why nothing is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Because {
    /// What leads is less probable than was asked for.
    Confidence,
    /// The flights are not of one condition: no one cause is that of all.
    FlightsDisagree,
}

/// A diagnosis and what is told of it. As JSON it is `bench.diagnosis/2` (docs/diagnosis.md).
#[derive(Debug, Serialize)]
pub struct Report {
    /// `bench.diagnosis/2`.
    pub schema: &'static str,
    /// What it comes to.
    pub verdict: Conclusion,
    /// Name of the candidate that leads, told or not.
    pub leading: String,
    /// The effects named, where the verdict is [`Conclusion::Effect`].
    pub effects: Vec<&'static str>,
    /// Probability of what leads, with all that these flights cannot tell from it.
    pub confidence: f64,
    /// How probable it must be to be told.
    pub min_confidence: f64,
    /// Why it is not told; empty where it is.
    pub inconclusive_because: Vec<Because>,
    /// Which calibration was used, and why.
    pub calibration_choice: Choice,
    /// The model, where nominal flights made it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelTold>,
    /// All else.
    #[serde(flatten)]
    pub diagnosis: Diagnosis,
}

impl Report {
    /// Holds a diagnosis to how probable what leads must be; 0 tells it whatever it is worth.
    pub fn new(mut diagnosis: Diagnosis, min_confidence: f64, choice: Choice) -> Self {
        let mut because = Vec::new();
        if diagnosis.confidence < min_confidence {
            because.push(Because::Confidence);
        }
        if let Some(found) = &diagnosis.disagreement {
            diagnosis.warnings.insert(0, apart(found));
            if min_confidence > 0.0 {
                because.push(Because::FlightsDisagree);
            }
        }
        let verdict = match diagnosis.verdict {
            _ if !because.is_empty() => Conclusion::Inconclusive,
            Verdict::Effect => Conclusion::Effect,
            Verdict::None => Conclusion::None,
            Verdict::Unknown => Conclusion::Unknown,
        };
        let report = Self {
            schema: diagnosis.schema,
            verdict,
            leading: diagnosis.leading.clone(),
            effects: if verdict == Conclusion::Effect { diagnosis.effects.clone() } else { Vec::new() },
            confidence: diagnosis.confidence,
            min_confidence,
            inconclusive_because: because,
            calibration_choice: choice,
            model: None,
            diagnosis,
        };
        report.with_next()
    }

    /// What would help, or what can be done with the verdict.
    fn with_next(mut self) -> Self {
        let next = &mut self.diagnosis.next;
        if self.inconclusive_because.contains(&Because::Confidence) {
            next.push(
                "what would help: more flights in the same condition, and richer ones (launches, steps, descents, low hover)"
                    .to_owned(),
            );
        }
        if self.inconclusive_because.contains(&Because::FlightsDisagree) {
            next.insert(0, "what would help: diagnose apart what was flown in different conditions; by `--json` the two groups that differ most are `disagreement.groups`".to_owned());
        }
        if self.verdict == Conclusion::Effect {
            next.push(
                "`--write-rig FILE` writes the rig with the effect, for `bench sim` and for checking"
                    .to_owned(),
            );
        }
        self
    }

    /// The verdict in a sentence, without its probability.
    pub fn sentence(&self) -> String {
        if self.verdict != Conclusion::Inconclusive {
            return told::sentence(&self.diagnosis);
        }
        let disagreement = self.diagnosis.disagreement.as_ref();
        match disagreement.filter(|_| self.inconclusive_because.contains(&Because::FlightsDisagree)) {
            Some(_) => format!("Inconclusive: {NOT_OF_ONE}"),
            None => format!(
                "Inconclusive: {} leads with {}, {} was asked for",
                told::answer(&self.diagnosis),
                told::percent(self.confidence),
                told::percent(self.min_confidence)
            ),
        }
    }

    /// What the verdict means to who reads it.
    pub fn tone(&self) -> Tone {
        match self.verdict {
            Conclusion::Effect => Tone::Plain,
            Conclusion::None => Tone::Good,
            Conclusion::Unknown | Conclusion::Inconclusive => Tone::Odd,
        }
    }

    /// The sentence and how sure it is.
    pub fn headline(&self) -> String {
        if self.verdict == Conclusion::Inconclusive {
            return self.sentence();
        }
        format!("{}: {} sure", self.sentence(), told::percent(self.confidence))
    }
}

const NOT_OF_ONE: &str = "the flights are not of one condition";

fn apart(found: &Disagreement) -> String {
    let says = |group: &Agreeing| {
        format!("{} ± {} by {}", short(group.value), short(group.sigma), numbered(&group.numbers))
    };
    let name = match found.effect {
        Some(effect) => format!("{effect} {}", found.name),
        None => found.name.to_owned(),
    };
    format!(
        "{NOT_OF_ONE}: {name} would be about {} and {} (chance in one condition {}, the least of {} tried; below {} counts)",
        says(&found.groups[0]),
        says(&found.groups[1]),
        short(found.p),
        found.tried,
        found.level,
    )
}

/// `flights 1 to 4, 7`.
fn numbered(numbers: &[usize]) -> String {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for number in numbers {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == *number => *last = *number,
            _ => runs.push((*number, *number)),
        }
    }
    let told: Vec<String> = runs
        .into_iter()
        .map(|(first, last)| if first == last { first.to_string() } else { format!("{first} to {last}") })
        .collect();
    format!("{} {}", if numbers.len() == 1 { "flight" } else { "flights" }, told.join(", "))
}

#[cfg(test)]
mod tests {
    use bench_diagnosis::Candidate;

    use super::*;

    fn choice() -> Choice {
        Choice { how: "built-in", why: "the default".to_owned(), again: "--calibration built-in".to_owned() }
    }

    fn said(confidence: f64, disagreement: Option<Disagreement>) -> Diagnosis {
        let candidate = Candidate {
            effects: Vec::new(),
            indices: Some(Vec::new()),
            name: "none".to_owned(),
            probability: confidence,
            evidence_gain: 0.0,
            grounds: None,
            parameters: Vec::new(),
        };
        Diagnosis {
            verdict: Verdict::None,
            leading: "none".to_owned(),
            confidence,
            candidates: vec![candidate],
            disagreement,
            ..Diagnosis::default()
        }
    }

    fn two_conditions() -> Disagreement {
        let group =
            |numbers: Vec<usize>, value| Agreeing { flights: Vec::new(), numbers, value, sigma: 0.01 };
        Disagreement {
            effect: Some("rotor-lag"),
            name: "time_constant_s",
            p: 2e-7,
            level: 1e-3,
            tried: 8,
            groups: [group(vec![1, 2, 3, 7], 0.05), group(vec![4, 5, 6], 0.15)],
        }
    }

    #[test]
    fn what_leads_is_told_from_the_probability_asked_for_on() {
        let verdict = |confidence, least| Report::new(said(confidence, None), least, choice()).verdict;
        assert_eq!(verdict(0.5, 0.5), Conclusion::None);
        assert_eq!(verdict(0.28, 0.0), Conclusion::None);
        let report = Report::new(said(0.28, None), 0.5, choice());
        assert_eq!(report.verdict, Conclusion::Inconclusive);
        assert_eq!(report.headline(), "Inconclusive: none leads with 28 %, 50 % was asked for");
        assert!(report.diagnosis.next.iter().any(|line| line.starts_with("what would help")));
    }

    #[test]
    fn flights_that_disagree_are_inconclusive_however_sure() {
        let report = Report::new(said(0.99, Some(two_conditions())), 0.5, choice());
        assert_eq!(report.inconclusive_because, [Because::FlightsDisagree]);
        assert_eq!(report.headline(), "Inconclusive: the flights are not of one condition");
        let told = "rotor-lag time_constant_s would be about 0.05 ± 0.01 by flights 1 to 3, 7 and 0.15 ± 0.01 by flights 4 to 6";
        assert!(report.diagnosis.warnings[0].contains(told), "{}", report.diagnosis.warnings[0]);
        // Asked to tell what leads whatever it is worth, it does, and warns.
        let report = Report::new(said(0.99, Some(two_conditions())), 0.0, choice());
        assert_eq!((report.verdict, report.diagnosis.warnings.len()), (Conclusion::None, 1));
    }

    #[test]
    fn a_report_has_each_key_once_and_hides_what_it_does_not_tell() {
        let mut diagnosis = said(0.4, None);
        diagnosis.verdict = Verdict::Effect;
        diagnosis.effects = vec!["gusts"];
        let text = serde_json::to_string(&Report::new(diagnosis, 0.5, choice())).unwrap();
        for key in ["\"schema\":", "\"verdict\":", "\"effects\":[]", "\"confidence\":0.4"] {
            assert!(text.contains(key), "{key}: {text}");
        }
        assert_eq!(text.matches("\"verdict\":").count(), 1);
        assert!(text.contains("\"verdict\":\"inconclusive\",\"leading\":\"none\""), "{text}");
    }
}
