//! Which effects these flights cannot tell apart: their expected responses point the same way once the rig's tolerances
//! have explained what they can. What cannot be told apart is one answer, with one probability.

use bench_filter::{Direction, Pairs, is_random, run_for};
use bench_inference::{Fit, Problem, directions, project};
use bench_plant::effects::LIBRARY;

use crate::diagnose::{Candidate, Likeness, PLAIN_NATS};

/// Cosine beyond which two effects count as one.
const SAME: f64 = 0.8;
/// The same of lags and delays: a lag of the pins, of the rotors, of the measurements differ by where they begin and by their
/// order, and those of an airframe are of any order. A pure delay of the pins is one of the measurements.
const SAME_LAG: f64 = 0.25;

/// Cosine beyond which these two count as one.
fn same(a: usize, b: usize) -> f64 {
    if [a, b].iter().all(|effect| LIBRARY[*effect].signature.lag) { SAME_LAG } else { SAME }
}

/// Effects whose responses look the same in these flights.
#[derive(Debug, Default)]
pub struct Likenesses {
    /// Two library indices, the first of which was fitted, and the cosine of their responses; highest first.
    pairs: Vec<(usize, usize, f64)>,
}

impl Likenesses {
    /// Those of effects as fitted, each with any other at sizes and shapes over its prior: finite differences of the laws.
    pub fn of(problem: &Problem<'_>, null: &Fit, fitted: &[(usize, Vec<f64>)], others: &[usize]) -> Self {
        let fitted: Vec<&(usize, Vec<f64>)> =
            fitted.iter().filter(|(effect, _)| !is_random(*effect)).collect();
        if fitted.is_empty() {
            return Self::default();
        }
        let mut directions = directions(&null.free, &null.point);
        directions.extend(fitted.iter().map(|(effect, values)| Direction::Added(*effect, values.clone())));
        let mut owners = Vec::new();
        for other in others.iter().filter(|other| !is_random(**other)) {
            for values in problem.start_values(*other) {
                directions.push(Direction::Added(*other, values));
                owners.push(*other);
            }
        }
        let noise = null.full_noise(problem);
        // Others are held against what was fitted alone, not against one another.
        let pairs = Pairs::Arrow { head: null.free.len() + fitted.len(), block: 1 };
        let pass = run_for(problem.tracks, problem.rig, &null.point, &noise, &directions, pairs);
        let Some((left, _)) = project(&null.free, &null.point, &pass) else { return Self::default() };
        let mut pairs: Vec<(usize, usize, f64)> = Vec::new();
        for (i, (effect, _)) in fitted.iter().enumerate() {
            for (j, other) in owners.iter().enumerate().filter(|(_, other)| *other != effect) {
                let k = fitted.len() + j;
                let scale = (left[(i, i)] * left[(k, k)]).sqrt();
                if scale.is_nan() || scale < 1e-9 {
                    continue;
                }
                let cosine = (left[(i, k)] / scale).abs();
                match pairs.iter_mut().find(|(a, b, _)| (a, b) == (effect, other)) {
                    Some((_, _, most)) => *most = most.max(cosine),
                    None => pairs.push((*effect, *other, cosine)),
                }
            }
        }
        pairs.retain(|(a, b, cosine)| *cosine > same(*a, *b));
        pairs.sort_by(|a, b| b.2.total_cmp(&a.2));
        Self { pairs }
    }

    /// Whether these are one effect, or two that look the same.
    fn alike(&self, a: usize, b: usize) -> bool {
        a == b || self.pairs.iter().any(|(i, j, _)| [*i, *j] == [a, b] || [*i, *j] == [b, a])
    }

    /// Whether each effect of one hypothesis has one of the other that looks the same.
    fn interchangeable(&self, a: &[usize], b: &[usize]) -> bool {
        match (a, b) {
            ([a], [b]) => self.alike(*a, *b),
            ([a, b], [c, d]) => {
                self.alike(*a, *c) && self.alike(*b, *d) || self.alike(*a, *d) && self.alike(*b, *c)
            }
            _ => false,
        }
    }

    /// Effects that look like the named ones and are not among them, highest cosine first.
    pub fn told(&self, named: &[usize]) -> Vec<Likeness> {
        let of_named = self.pairs.iter().filter(|(a, b, _)| named.contains(a) && !named.contains(b));
        let told = |(a, b, cosine): &(usize, usize, f64)| Likeness {
            effect: LIBRARY[*a].name,
            like: LIBRARY[*b].name,
            cosine: *cosine,
        };
        of_named.map(told).collect()
    }
}

/// What leads, once all that flights cannot tell apart counts as one answer.
#[derive(Debug, PartialEq)]
pub struct Answer {
    /// Which candidate stands for it, the most probable one of it.
    pub leading: usize,
    /// The other candidates that it may as well be, most probable first.
    pub alternatives: Vec<usize>,
    /// Probability that it is one of them.
    pub probability: f64,
}

/// The answer of candidates that are sorted, most probable first.
pub fn answer(candidates: &[Candidate], likenesses: &Likenesses) -> Answer {
    let effects = |i: usize| candidates[i].indices.as_deref().unwrap_or_default();
    let of = |leading: usize| {
        // Of what is not seen, all effects look alike.
        let seen = |i: usize| candidates[i].evidence_gain > PLAIN_NATS;
        let alternatives: Vec<usize> = (0..candidates.len())
            .filter(|i| *i != leading && seen(leading) && seen(*i))
            .filter(|i| likenesses.interchangeable(effects(leading), effects(*i)))
            .collect();
        let others: f64 = alternatives.iter().map(|i| candidates[*i].probability).sum();
        Answer { leading, probability: candidates[leading].probability + others, alternatives }
    };
    // Likeness is not transitive: what looks like two others does not lead for it where either is more probable. Of two answers
    // that are equally probable, the one whose own candidate is more so: the first.
    let leads = |answer: &Answer| answer.alternatives.iter().all(|other| *other > answer.leading);
    let more = |best: Answer, this: Answer| if this.probability > best.probability { this } else { best };
    (1..candidates.len()).map(of).filter(leads).fold(of(0), more)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Candidates of library indices; `None` is `unknown`.
    fn candidates(all: &[(Option<&[usize]>, f64)]) -> Vec<Candidate> {
        let one = |(indices, probability): &(Option<&[usize]>, f64)| Candidate {
            effects: Vec::new(),
            indices: indices.map(<[usize]>::to_vec),
            name: String::new(),
            probability: *probability,
            evidence_gain: 10.0,
            grounds: None,
            parameters: Vec::new(),
        };
        all.iter().map(one).collect()
    }

    #[test]
    fn what_cannot_be_told_apart_is_one_answer_with_one_probability() {
        let alike = Likenesses { pairs: vec![(3, 5, 0.99)] };
        let all = candidates(&[(Some(&[]), 0.3), (Some(&[3]), 0.29), (Some(&[5]), 0.28), (None, 0.13)]);
        let found = answer(&all, &alike);
        assert_eq!((found.leading, found.alternatives), (1, vec![2]));
        assert!((found.probability - 0.57).abs() < 1e-12);
        // What flights do not show is not an answer for being many.
        let mut hidden =
            candidates(&[(Some(&[]), 0.3), (Some(&[3]), 0.29), (Some(&[5]), 0.28), (None, 0.13)]);
        for candidate in &mut hidden {
            candidate.evidence_gain = 0.4;
        }
        assert_eq!(answer(&hidden, &alike).leading, 0);
        // Where nothing is alike, the most probable leads by itself.
        assert_eq!(
            answer(&all, &Likenesses::default()),
            Answer { leading: 0, alternatives: vec![], probability: 0.3 }
        );
    }

    #[test]
    fn the_most_probable_of_an_answer_stands_for_it() {
        // 5 looks like 3 and like 8, which do not look like one another.
        let alike = Likenesses { pairs: vec![(5, 3, 0.9), (5, 8, 0.9)] };
        let all = candidates(&[(Some(&[3]), 0.78), (Some(&[5]), 0.02), (Some(&[8]), 0.01), (None, 0.19)]);
        let found = answer(&all, &alike);
        assert_eq!((found.leading, found.alternatives), (0, vec![1]));
    }

    #[test]
    fn pairs_are_alike_effect_by_effect_and_not_with_a_single_one() {
        let alike = Likenesses { pairs: vec![(3, 5, 0.99)] };
        let all = candidates(&[
            (Some(&[3, 7]), 0.4),
            (Some(&[3]), 0.25),
            (Some(&[7, 5]), 0.2),
            (Some(&[5, 8]), 0.15),
        ]);
        let found = answer(&all, &alike);
        assert_eq!((found.leading, found.alternatives), (0, vec![2]));
        // `none` and `unknown` have no effects, and are not alike for it.
        let all = candidates(&[(Some(&[]), 0.6), (None, 0.4)]);
        assert!(answer(&all, &alike).alternatives.is_empty());
    }
}
