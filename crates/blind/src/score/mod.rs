//! Answers against the key.

mod statistics;

use std::collections::BTreeMap;

use bench_statistics::{mean, median};
use serde::Serialize;

pub use self::statistics::{Figure, Rate};
use self::statistics::{auroc, found_at_5_percent};
use crate::{
    answers::{Answer, Answers, Verdict},
    cases::{Family, Truth},
    random,
    seal::{Key, Seal},
};

/// Schema of a score.
pub const SCORE_SCHEMA: &str = "bench.blind/1";

/// A probability below this counts as this in the log score: one wrong certainty shall not decide alone.
const LEAST_PROBABILITY: f64 = 1e-4;
/// From here on a case counts as one that can be seen.
pub const PLAIN: f64 = 10.0;
/// Edges of the bins of d' in the detection curve.
const BINS: [f64; 9] = [0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, f64::INFINITY];

/// How good answers are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// [`SCORE_SCHEMA`].
    pub schema: &'static str,
    /// Who answered.
    pub tool: String,
    /// `key_sha256` of the seal.
    pub seal: String,
    /// Hash of the answers.
    pub answers_sha256: String,
    /// The rig.
    pub rig: String,
    /// The generator's seed.
    pub seed: u64,
    /// How many cases were sealed.
    pub cases: usize,
    /// Cases without an answer: wrong in every score.
    pub missing: Vec<String>,
    /// Cases on which the tool says it failed: wrong in every score.
    pub failed: Vec<String>,
    /// The verdict's label is the true one.
    pub top_1: TopOne,
    /// Not the true label, but the truth is in the group that is said not to be told apart.
    pub group_hits: Rate,
    /// Of pairs: at least one of the two is named.
    pub half_of_pair: Rate,
    /// The truth is in the set, or is the verdict.
    pub set_coverage: Rate,
    /// Labels in the set, the verdict among them.
    pub set_size: Figure,
    /// Negative logarithm of the probability of the truth, nats.
    pub log_score: Figure,
    /// Squared distance of the probabilities from the truth, over all labels; 0 to 2.
    pub brier: Figure,
    /// Expected calibration error of the verdict's probability, ten bins of equal mass.
    pub ece: Figure,
    /// What of that right probabilities would show by chance, so many cases being in a bin: the mean, and where 95 % lie.
    pub ece_by_chance: Figure,
    /// Those bins.
    pub reliability: Vec<Bin>,
    /// Telling what is outside the library from all else by the probability of `unknown`.
    pub unknown: Unknown,
    /// Anything but `none` said of cases without a cause.
    pub false_alarms: Rate,
    /// The stage is that of something that was put in.
    pub stage: Rate,
    /// The axis is one along which it shows.
    pub region: Rate,
    /// Share of the gap closed, where effects are rightly named and a closure is told; the oracle, who fits the true law,
    /// closes all of it.
    pub closure: Closure,
    /// Parameters of effects rightly named.
    pub parameters: Parameters,
    /// How often something was seen, and rightly named, by detectability.
    pub detection: Vec<Detection>,
    /// By what was put in.
    pub by_label: Vec<ByLabel>,
    /// What was said of what.
    pub confusion: Confusion,
    /// Case by case.
    pub case: Vec<CaseScore>,
}

/// Share of right labels, by family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopOne {
    /// All cases.
    pub all: Rate,
    /// No cause.
    pub none: Rate,
    /// One effect.
    pub single: Rate,
    /// One effect, detectability of [`PLAIN`] or more.
    pub single_plain: Rate,
    /// Two effects, both to be named.
    pub pair: Rate,
    /// Two effects, each of detectability of [`PLAIN`] or more, both to be named.
    pub pair_plain: Rate,
    /// Outside the library.
    pub outside: Rate,
    /// Outside the library, detectability of [`PLAIN`] or more.
    pub outside_plain: Rate,
}

/// A bin of the reliability diagram.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Mean probability of the verdict.
    pub confidence: f64,
    /// How often it was right.
    pub right: Rate,
}

/// Telling the outside from the inside.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Unknown {
    /// Area under the receiver's curve.
    pub auroc: Figure,
    /// Share found with 5 % of all others taken for unknown.
    pub found_at_5_percent: Figure,
}

/// Closure as told.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Closure {
    /// Mean.
    pub told: Figure,
    /// What fitting the true law would close, by definition.
    pub oracle: f64,
    /// Of cases outside the library answered with an effect: it should be low.
    pub told_outside: Figure,
}

/// Parameters as told.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Parameters {
    /// Median of the error over the true value.
    pub relative_error: Figure,
    /// Intervals of 90 % that hold the true value.
    pub coverage: Rate,
}

/// A bin of the detection curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Detection {
    /// Detectability from here ...
    pub from: f64,
    /// ... to here; absent: to any.
    pub to: Option<f64>,
    /// Anything but `none` was said.
    pub seen: Rate,
    /// The label is right.
    pub named: Rate,
}

/// A label's cases.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ByLabel {
    /// The effect; for what is outside the library, the form.
    pub name: String,
    /// Family.
    pub family: Family,
    /// Right labels.
    pub named: Rate,
    /// Anything but `none` was said.
    pub seen: Rate,
    /// Median detectability.
    pub detectability: f64,
}

/// Truth by answer; pairs are one label, `other pair` where not both effects are right.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Confusion {
    /// Of rows (truth) and columns (answer).
    pub labels: Vec<String>,
    /// Counts, row by row.
    pub counts: Vec<Vec<usize>>,
}

/// One case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseScore {
    /// Its name.
    pub case: String,
    /// Its family.
    pub family: Family,
    /// The true label.
    pub truth: String,
    /// The forms that were put in.
    pub forms: Vec<String>,
    /// The label told; `missing` or `failed` without one.
    pub told: String,
    /// Whether that is right.
    pub right: bool,
    /// Probability given to the truth.
    pub probability: f64,
    /// Detectability.
    pub detectability: f64,
}

/// A case with its truth and answer; a failed answer is none.
struct Scored<'a> {
    name: &'a str,
    truth: &'a Truth,
    label: String,
    answer: Option<&'a Answer>,
    told: String,
}

impl Scored<'_> {
    fn right(&self) -> bool {
        self.told == self.label
    }

    /// Anything but `none` was said; of a case without an answer, the worse of the two.
    fn alarmed(&self) -> bool {
        match self.answer {
            Some(answer) => answer.verdict != Verdict::None,
            None => self.truth.family == Family::None,
        }
    }

    fn probability(&self) -> f64 {
        self.answer.map_or(0.0, |answer| answer.probability(&self.label))
    }

    /// Probability of `unknown`; without an answer, the worse.
    fn unknown(&self) -> f64 {
        let worst = f64::from(u8::from(self.truth.family != Family::Outside));
        self.answer.map_or(worst, |answer| answer.probability("unknown"))
    }

    fn brier(&self) -> f64 {
        let Some(answer) = self.answer else { return 2.0 };
        let others = answer.probabilities.iter().filter(|(label, _)| **label != self.label);
        (1.0 - self.probability()).powi(2) + others.map(|(_, p)| p * p).sum::<f64>()
    }

    /// Labels in the set, the verdict among them.
    fn set(&self) -> Vec<&str> {
        let mut set: Vec<&str> = self.answer.iter().flat_map(|a| &a.set).map(String::as_str).collect();
        set.push(&self.told);
        set.sort_unstable();
        set.dedup();
        set
    }
}

/// Scores answers; cases without one count as wrong throughout.
pub(crate) fn score(seal: &Seal, key: &Key, answers: &Answers) -> Score {
    let scored: Vec<Scored<'_>> = key
        .cases
        .iter()
        .map(|(name, truth)| {
            let given = answers.cases.get(name);
            Scored {
                name,
                truth,
                label: truth.label(),
                answer: given.filter(|answer| answer.verdict != Verdict::Failed),
                told: given.map_or("missing".to_owned(), Answer::label),
            }
        })
        .collect();
    let of = |family: Family| scored.iter().filter(move |case| case.truth.family == family);
    let plain = |case: &&Scored<'_>| case.truth.detectability >= PLAIN;
    let each_plain = |case: &&Scored<'_>| case.truth.ingredients.iter().all(|i| i.detectability >= PLAIN);
    let named = |told: &str| {
        scored.iter().filter(|case| case.told == told).map(|case| case.name.to_owned()).collect()
    };
    Score {
        schema: SCORE_SCHEMA,
        tool: answers.tool.clone(),
        seal: seal.key_sha256.clone(),
        answers_sha256: answers.sha256.clone(),
        rig: key.rig.clone(),
        seed: key.seed,
        cases: scored.len(),
        missing: named("missing"),
        failed: named("failed"),
        top_1: TopOne {
            all: Rate::of(scored.iter().map(Scored::right)),
            none: Rate::of(of(Family::None).map(Scored::right)),
            single: Rate::of(of(Family::Single).map(Scored::right)),
            single_plain: Rate::of(of(Family::Single).filter(plain).map(Scored::right)),
            pair: Rate::of(of(Family::Pair).map(Scored::right)),
            pair_plain: Rate::of(of(Family::Pair).filter(each_plain).map(Scored::right)),
            outside: Rate::of(of(Family::Outside).map(Scored::right)),
            outside_plain: Rate::of(of(Family::Outside).filter(plain).map(Scored::right)),
        },
        group_hits: Rate::of(scored.iter().map(|case| {
            !case.right() && case.answer.is_some_and(|answer| answer.group.contains(&case.label))
        })),
        half_of_pair: Rate::of(
            of(Family::Pair).map(|case| {
                case.told.split('+').any(|told| case.label.split('+').any(|effect| effect == told))
            }),
        ),
        set_coverage: Rate::of(scored.iter().map(|case| case.set().contains(&case.label.as_str()))),
        set_size: {
            let answered: Vec<f64> =
                scored.iter().filter(|c| c.answer.is_some()).map(|c| c.set().len() as f64).collect();
            Figure::of(&answered, |sizes| mean(sizes.iter().map(|x| **x)))
        },
        log_score: Figure::of(&scored, |cases| {
            mean(cases.iter().map(|case| -case.probability().max(LEAST_PROBABILITY).ln()))
        }),
        brier: Figure::of(&scored, |cases| mean(cases.iter().map(|case| case.brier()))),
        ece: Figure::of(&confidences(&scored), |cases| {
            calibration_error(&cases.iter().map(|case| **case).collect::<Vec<_>>())
        }),
        ece_by_chance: error_by_chance(&confidences(&scored)),
        reliability: reliability(&confidences(&scored)),
        unknown: unknown(&scored),
        false_alarms: Rate::of(of(Family::None).map(Scored::alarmed)),
        stage: stage(&scored),
        region: region(&scored),
        closure: closure(&scored),
        parameters: parameters(&scored),
        detection: detection(&scored),
        by_label: by_label(&scored),
        confusion: confusion(&scored),
        case: scored.iter().map(case_score).collect(),
    }
}

/// The verdict's probability and whether it was right; a case without an answer was certain and wrong.
fn confidences(scored: &[Scored<'_>]) -> Vec<(f64, bool)> {
    let confidence = |case: &Scored<'_>| case.answer.map_or(1.0, |answer| answer.probability(&case.told));
    scored.iter().map(|case| (confidence(case), case.right())).collect()
}

/// Ten bins of as equal a mass as the count allows.
fn bins(confidences: &[(f64, bool)]) -> Vec<Vec<(f64, bool)>> {
    const BINS: usize = 10;
    let mut sorted = confidences.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let edge = |bin: usize| bin * sorted.len() / BINS;
    (0..BINS).map(|bin| sorted[edge(bin)..edge(bin + 1)].to_vec()).filter(|bin| !bin.is_empty()).collect()
}

/// The calibration error of cases that are right as often as was told.
fn error_by_chance(confidences: &[(f64, bool)]) -> Figure {
    Figure::of_draws(confidences.len(), |random| {
        let drawn: Vec<(f64, bool)> =
            confidences.iter().map(|(p, _)| (*p, random::happens(random, *p))).collect();
        calibration_error(&drawn)
    })
}

fn calibration_error(confidences: &[(f64, bool)]) -> Option<f64> {
    let gap = |bin: &Vec<(f64, bool)>| {
        let told: f64 = bin.iter().map(|(confidence, _)| confidence).sum();
        let right = bin.iter().filter(|(_, right)| *right).count() as f64;
        (told - right).abs()
    };
    let total: f64 = bins(confidences).iter().map(gap).sum();
    (!confidences.is_empty()).then(|| total / confidences.len() as f64)
}

fn reliability(confidences: &[(f64, bool)]) -> Vec<Bin> {
    let of = |bin: &Vec<(f64, bool)>| Bin {
        confidence: mean(bin.iter().map(|(confidence, _)| *confidence)).unwrap_or(0.0),
        right: Rate::of(bin.iter().map(|(_, right)| *right)),
    };
    bins(confidences).iter().map(of).collect()
}

fn unknown(scored: &[Scored<'_>]) -> Unknown {
    let pairs = |cases: &[&Scored<'_>]| -> Vec<(f64, bool)> {
        cases.iter().map(|case| (case.unknown(), case.truth.family == Family::Outside)).collect()
    };
    Unknown {
        auroc: Figure::of(scored, |cases| auroc(&pairs(cases))),
        found_at_5_percent: Figure::of(scored, |cases| found_at_5_percent(&pairs(cases))),
    }
}

fn stage(scored: &[Scored<'_>]) -> Rate {
    let caused = scored.iter().filter(|case| case.truth.family != Family::None);
    Rate::of(caused.map(|case| {
        let told = case.answer.and_then(|answer| answer.stage.as_deref());
        case.truth.ingredients.iter().any(|ingredient| told == Some(&ingredient.stage))
    }))
}

fn region(scored: &[Scored<'_>]) -> Rate {
    let axes = |case: &Scored<'_>| -> Vec<String> {
        case.truth.ingredients.iter().flat_map(|ingredient| ingredient.regions.clone()).collect()
    };
    let shown = scored.iter().filter(|case| !axes(case).is_empty());
    Rate::of(shown.map(|case| {
        case.answer.and_then(|answer| answer.region.as_ref()).is_some_and(|axis| axes(case).contains(axis))
    }))
}

fn closure(scored: &[Scored<'_>]) -> Closure {
    let told = |wanted: &dyn Fn(&Scored<'_>) -> bool| -> Figure {
        let closures: Vec<f64> = scored
            .iter()
            .filter(|case| wanted(case))
            .filter_map(|case| Some(case.answer?.closure?.value))
            .collect();
        Figure::of(&closures, |values| mean(values.iter().map(|x| **x)))
    };
    let effect = |case: &Scored<'_>| case.answer.is_some_and(|answer| answer.verdict == Verdict::Effect);
    Closure {
        told: told(&|case| effect(case) && case.right()),
        oracle: 1.0,
        told_outside: told(&|case| effect(case) && case.truth.family == Family::Outside),
    }
}

fn parameters(scored: &[Scored<'_>]) -> Parameters {
    let mut errors = Vec::new();
    let mut held = Vec::new();
    for case in scored.iter().filter(|case| case.right()) {
        for told in case.answer.iter().flat_map(|answer| &answer.parameters) {
            let of_it = |truth: &&crate::Parameter| truth.effect == told.effect && truth.name == told.name;
            if let Some(truth) = case.truth.parameters.iter().find(of_it) {
                errors.push(((told.value - truth.value) / truth.value).abs());
                held.push((told.low..=told.high).contains(&truth.value));
            }
        }
    }
    let relative_error = Figure::of(&errors, |errors| median(errors.iter().map(|x| **x)));
    Parameters { relative_error, coverage: Rate::of(held) }
}

fn detection(scored: &[Scored<'_>]) -> Vec<Detection> {
    let caused: Vec<_> = scored.iter().filter(|case| case.truth.family != Family::None).collect();
    let bins = BINS.windows(2).map(|edges| {
        let inside = || caused.iter().filter(|case| (edges[0]..edges[1]).contains(&case.truth.detectability));
        Detection {
            from: edges[0],
            to: Some(edges[1]).filter(|edge| edge.is_finite()),
            seen: Rate::of(inside().map(|case| case.alarmed())),
            named: Rate::of(inside().map(|case| case.right())),
        }
    });
    bins.filter(|bin| bin.seen.of > 0).collect()
}

fn by_label(scored: &[Scored<'_>]) -> Vec<ByLabel> {
    let mut groups: BTreeMap<(Family, String), Vec<&Scored<'_>>> = BTreeMap::new();
    for case in scored {
        let name = match case.truth.family {
            Family::None | Family::Pair => case.truth.family.name().to_owned(),
            Family::Single => case.label.clone(),
            Family::Outside => case.truth.ingredients.iter().map(|i| i.form.as_str()).collect(),
        };
        groups.entry((case.truth.family, name)).or_default().push(case);
    }
    let of = |((family, name), cases): ((Family, String), Vec<&Scored<'_>>)| ByLabel {
        name,
        family,
        named: Rate::of(cases.iter().map(|case| case.right())),
        seen: Rate::of(cases.iter().map(|case| case.alarmed())),
        detectability: median(cases.iter().map(|case| case.truth.detectability)).unwrap_or(0.0),
    };
    groups.into_iter().map(of).collect()
}

/// Labels that stand behind the effects in the confusion table.
const LAST: [&str; 6] = ["pair", "other pair", "none", "unknown", "failed", "missing"];

fn confusion(scored: &[Scored<'_>]) -> Confusion {
    let short = |label: &str| if label.contains('+') { "pair".to_owned() } else { label.to_owned() };
    let told = |case: &Scored<'_>| {
        let wrong_pair = case.told.contains('+') && !case.right();
        if wrong_pair { "other pair".to_owned() } else { short(&case.told) }
    };
    let pairs: Vec<_> = scored.iter().map(|case| (short(&case.label), told(case))).collect();
    let mut labels: Vec<String> =
        pairs.iter().flat_map(|(truth, told)| [truth.clone(), told.clone()]).collect();
    labels.sort_by_key(|label| (LAST.iter().position(|last| last == label).map(|i| i + 1), label.clone()));
    labels.dedup();
    let place = |label: &str| labels.iter().position(|known| known == label).unwrap_or(0);
    let mut counts = vec![vec![0; labels.len()]; labels.len()];
    for (truth, told) in &pairs {
        counts[place(truth)][place(told)] += 1;
    }
    Confusion { labels, counts }
}

fn case_score(case: &Scored<'_>) -> CaseScore {
    CaseScore {
        case: case.name.to_owned(),
        family: case.truth.family,
        truth: case.label.clone(),
        forms: case.truth.ingredients.iter().map(|ingredient| ingredient.form.clone()).collect(),
        told: case.told.clone(),
        right: case.right(),
        probability: case.probability(),
        detectability: case.truth.detectability,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_probabilities_of_a_half_are_off_by_what_the_binomial_law_says() {
        // Of 30 in a bin, |share - 1/2| is sqrt(2/(30 pi))/2 = 0.073 in the mean (de Moivre; 1 % less for the discrete law).
        let by_chance = error_by_chance(&[(0.5, false); 300]);
        assert!((by_chance.value.unwrap() - 0.0725).abs() < 0.002, "{by_chance:?}");
        assert!(by_chance.low.unwrap() < 0.05 && by_chance.high.unwrap() > 0.095, "{by_chance:?}");
        assert_eq!(error_by_chance(&[(1.0, false); 20]).value, Some(0.0));
        assert_eq!(error_by_chance(&[]).value, None);
    }
}
