//! How evidence becomes probability.
//!
//! A hypothesis names effects, or none; beside them there may be a nameless part, which stands for all that is not in the library.
//! With `L` the gain of log-evidence of what is named and `U` that of the nameless part on top of it, nats:
//!
//! ```text
//! v(none)    = (1 - m) (1 + exp(S/T))/2 + m (exp(U/T - U/kappa) + exp(U/T - (U - S)/kappa))/2,   S what a slight part of U gains
//! v(effects) = exp(L/T) (1 - q + q exp(U/T) p(r))
//!              p(r) = exp(-r/mu)/(mu (1 - exp(-1/mu))),   r = U/(L + U)
//!
//! w(none)    = prior v(none)
//! w(effects) = prior ((1 - s) v(effects) + s sum over those with one effect less of v)
//! w(unknown) = prior sum over all of them of prior exp((L + U)/T)
//! T = 1 + tau max(L + U)                                      of flights alone, without direct evidence
//! ```
//!
//! - **Another form of a law.** With probability `q` reality's law is not quite the library's. What that leaves is a small share `r` of
//!   all that is explained: exponential with mean `mu`. A cause outside the library leaves any share: uniform.
//! - **Temperature.** Laws that are a little wrong are wrong by a share of what they explain. So differences of evidence count less the
//!   more nats are at stake (a power likelihood: Grünwald and van Ommen, *Inconsistency of Bayesian inference for misspecified linear
//!   models*, Bayesian Analysis 12, 2017). At small stakes `T` is 1, which is Bayes' rule.
//! - **Too small to see.** A share `s` of effects is so small that flights are as probable without them. So it is with effects of which
//!   flights say nothing at all.
//! - **Doubt.** With a small probability the evidence misleads by more: then `T` is ten times as high.
//! - **Nominal misfit.** With probability `m` the model of an airframe in order leaves a nameless part that is not slight, too, as real ones
//!   do. What it gains is exponential with mean `kappa`, where what a cause outside the library gains is as probable at any size.
//!   What readbacks gain is excused by no model of flight, and is not counted there.
//! - **Slight.** The model of an airframe in order is a little wrong, too: by up to 0.1 % of gravity, or by an offset within the tracker's
//!   noise; as often as not. What that explains is no gap. Beside effects it is part of another form.

use crate::calibration::Calibration;

/// In doubt, evidence counts so many times less.
const DOUBTFUL: f64 = 10.0;

/// What the decision knows of a hypothesis.
#[derive(Clone, Debug, PartialEq)]
pub struct Weighable {
    /// Library indices of what it names.
    pub effects: Vec<usize>,
    /// Gain of log-evidence over none, nats; of an effect of which flights say nothing as much as without it.
    pub gain: f64,
    /// What of it direct channels gain.
    pub direct: f64,
    /// Gain of a nameless part on top of it, where that was looked at.
    pub nameless: Option<f64>,
    /// What of that readbacks gain: a model of flight excuses none of it.
    pub readback: f64,
    /// Gain of what any model gets a little wrong; 0 where it was not looked at.
    pub slight: f64,
}

/// What the decision comes to.
#[derive(Clone, Debug, PartialEq)]
pub struct Decided {
    /// Of each hypothesis, in their order.
    pub probabilities: Vec<f64>,
    /// Of a cause that no effect of the library explains.
    pub unknown: f64,
    /// By what nats were divided.
    pub temperature: f64,
}

/// By what nats are divided where so many are at stake.
pub fn temperature(hypotheses: &[Weighable], calibration: &Calibration) -> f64 {
    let stake = |h: &Weighable| h.gain - h.direct + h.nameless.map_or(0.0, |nats| nats.max(0.0));
    1.0 + calibration.misfit_share * hypotheses.iter().map(stake).fold(0.0, f64::max)
}

/// Weighs hypotheses, among them none. What the model's own error gains a nameless cause of nominal flights is taken off that.
pub fn decide(hypotheses: &[Weighable], nominal_nameless: f64, calibration: &Calibration) -> Decided {
    let temperature = temperature(hypotheses, calibration);
    let at = |temperature: f64| {
        let seen: Vec<f64> = hypotheses.iter().map(|h| ln_seen(h, temperature, calibration)).collect();
        let weigh = |i: usize| ln_weight(hypotheses, &seen, i, calibration);
        let mut weights: Vec<f64> = (0..hypotheses.len()).map(weigh).collect();
        let with_nameless = hypotheses.iter().filter_map(|h| {
            let nameless = h.nameless? - if h.effects.is_empty() { nominal_nameless } else { 0.0 };
            let beside = if h.effects.is_empty() { 0.0 } else { calibration.ln_prior(h.effects.len()) };
            Some(beside + (h.gain + nameless) / temperature)
        });
        weights.push(calibration.ln_prior_unknown + ln_sum(with_nameless));
        let total = ln_sum(weights.iter().copied());
        weights.into_iter().map(move |weight| (weight - total).exp())
    };
    let doubt = calibration.doubt;
    let mut probabilities: Vec<f64> = at(temperature)
        .zip(at(DOUBTFUL * temperature))
        .map(|(p, doubted)| (1.0 - doubt) * p + doubt * doubted)
        .collect();
    let unknown = probabilities.pop().unwrap_or(0.0);
    Decided { probabilities, unknown, temperature }
}

/// Logarithm of the weight of a hypothesis, whose effects are seen or one of them is too small for that.
fn ln_weight(hypotheses: &[Weighable], seen: &[f64], i: usize, calibration: &Calibration) -> f64 {
    let h = &hypotheses[i];
    let hidden = calibration.hidden_share;
    let ln_prior = calibration.ln_prior(h.effects.len());
    if h.effects.is_empty() {
        return ln_prior + seen[i];
    }
    let one_less = |other: &Weighable| {
        other.effects.len() + 1 == h.effects.len() && other.effects.iter().all(|e| h.effects.contains(e))
    };
    let unseen = hypotheses.iter().zip(seen).filter(|(other, _)| one_less(other));
    let unseen = unseen.map(|(_, seen)| hidden.ln() + seen);
    ln_prior + ln_sum(unseen.chain([(1.0 - hidden).ln() + seen[i]]))
}

/// Logarithm of what the flights say of a hypothesis whose effects are all seen, or of none.
fn ln_seen(h: &Weighable, temperature: f64, calibration: &Calibration) -> f64 {
    let beside = match h.nameless {
        _ if h.effects.is_empty() => {
            let nats = h.nameless.map_or(0.0, |nats| (nats - h.readback).max(0.0));
            let m = calibration.nominal_misfit_probability;
            let few = |slight: f64| nats / temperature - (nats - slight) / calibration.nominal_misfit_nats;
            let [alone, misfit] = [(0.5 * (1.0 - m)).ln(), (0.5 * m).ln()];
            let slight = h.slight.clamp(0.0, nats);
            ln_sum([alone, alone + h.slight / temperature, misfit + few(0.0), misfit + few(slight)])
        }
        None => 0.0,
        Some(nameless) => {
            let nats = nameless.max(0.0);
            // One nat more keeps the share of next to nothing from being large.
            let share = nats / (h.gain.max(0.0) + nats + 1.0);
            let mean = calibration.form_share;
            let ln_density = -share / mean - mean.ln() - (-(-1.0 / mean).exp()).ln_1p();
            let q = calibration.form_probability;
            ln_sum([(1.0 - q).ln(), q.ln() + nameless / temperature + ln_density])
        }
    };
    h.gain / temperature + beside
}

/// Logarithm of a sum of numbers that are given by their logarithms.
fn ln_sum(ln: impl IntoIterator<Item = f64> + Clone) -> f64 {
    let most = ln.clone().into_iter().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return most;
    }
    most + ln.into_iter().map(|x| (x - most).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hypothesis(effects: &[usize], gain: f64, nameless: f64) -> Weighable {
        Weighable {
            effects: effects.to_vec(),
            gain,
            direct: 0.0,
            nameless: Some(nameless),
            readback: 0.0,
            slight: 0.0,
        }
    }

    fn none(nameless: f64) -> Weighable {
        hypothesis(&[], 0.0, nameless)
    }

    fn single(gain: f64, nameless: f64) -> Weighable {
        hypothesis(&[3], gain, nameless)
    }

    fn decided(hypotheses: &[Weighable], calibration: &Calibration) -> Decided {
        decide(hypotheses, 0.0, calibration)
    }

    #[test]
    fn without_misfit_doubt_forms_and_hidden_effects_it_is_bayes_rule() {
        let calibration = Calibration {
            doubt: 0.0,
            misfit_share: 0.0,
            form_probability: 0.0,
            hidden_share: 0.0,
            nominal_misfit_probability: 0.0,
            ..Calibration::built_in()
        };
        let found = decided(&[none(0.0), single(4.0, 0.0)], &calibration);
        let odds = (calibration.ln_prior_single - calibration.ln_prior_none + 4.0).exp();
        assert!((found.probabilities[1] / found.probabilities[0] / odds - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.probabilities.iter().sum::<f64>() + found.unknown - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_share_that_is_left_parts_another_form_from_an_unknown_cause() {
        let calibration = Calibration::built_in();
        let unknown = |gain, nameless| {
            let found = decided(&[none(0.5 * (gain + nameless)), single(gain, nameless)], &calibration);
            found.unknown / found.probabilities[1]
        };
        // The same twelve nats are left of a thousand, or of thirty.
        assert!(unknown(1000.0, 12.0) < 1.0, "{}", unknown(1000.0, 12.0));
        assert!(unknown(20.0, 12.0) > 1.0, "{}", unknown(20.0, 12.0));
        // More that is left is more that is unknown.
        assert!(unknown(100.0, 40.0) > unknown(100.0, 20.0));
    }

    #[test]
    fn what_a_model_gets_slightly_wrong_is_no_gap() {
        let calibration = Calibration::built_in();
        // An hour of nominal flight: sixty nats for an acceleration of a thousandth of gravity, as many for one of any size.
        let told = |slight, nominal| decide(&[Weighable { slight, ..none(60.0) }], nominal, &calibration);
        assert!(told(60.0, 0.0).probabilities[0] > 0.5, "{:?}", told(60.0, 0.0));
        assert!(told(0.0, 0.0).unknown > 0.5);
        // What nominal flights leave as well is none either.
        assert!(told(0.0, 60.0).probabilities[0] > 0.5);
    }

    #[test]
    fn readbacks_that_no_law_explains_are_no_matter_of_the_model() {
        let calibration = Calibration::built_in();
        let told = |readback| decided(&[Weighable { readback, ..none(9.0) }], &calibration);
        assert!(told(9.0).unknown > 0.8, "{:?}", told(9.0));
        assert!(told(0.0).unknown < 0.5, "{:?}", told(0.0));
    }

    #[test]
    fn a_few_nats_without_a_name_are_the_models_and_many_are_a_cause() {
        let calibration = Calibration::built_in();
        let told = |nameless| decided(&[none(nameless)], &calibration);
        assert!(told(5.0).probabilities[0] > told(5.0).unknown, "{:?}", told(5.0));
        assert!(told(60.0).unknown > 0.8, "{:?}", told(60.0));
    }

    #[test]
    fn differences_count_less_where_much_is_at_stake_in_the_air() {
        let calibration = Calibration { doubt: 0.0, ..Calibration::built_in() };
        let odds = |gain: f64, direct: f64| {
            let with = |effect, gain| Weighable { direct, ..hypothesis(&[effect], gain, 0.0) };
            let found = decided(&[none(0.0), with(3, gain), with(4, gain + 6.0)], &calibration);
            found.probabilities[2] / found.probabilities[1]
        };
        assert!(odds(1000.0, 0.0) < odds(10.0, 0.0));
        assert!(odds(1000.0, 0.0) > 1.0);
        // What was read directly is no matter of a law's form.
        assert!((odds(1000.0, 990.0) / odds(10.0, 0.0) - 1.0).abs() < 0.05);
    }

    #[test]
    fn effects_too_small_to_be_seen_are_not_excluded() {
        let calibration = Calibration::built_in();
        // An effect that was looked for in vain, however surely its usual size is excluded.
        let found = decided(&[none(0.0), single(-50.0, 0.0)], &calibration);
        let prior = (calibration.ln_prior_single - calibration.ln_prior_none).exp();
        assert!(found.probabilities[1] > 0.5 * calibration.hidden_share * prior, "{found:?}");
        // Beside one that is seen there may be any other.
        let second = Weighable { nameless: None, ..hypothesis(&[3, 4], f64::NEG_INFINITY, 0.0) };
        let found = decided(&[none(0.0), single(50.0, 0.0), second], &calibration);
        let odds = (calibration.ln_prior_pair - calibration.ln_prior_single).exp() * calibration.hidden_share;
        assert!((found.probabilities[2] / found.probabilities[1] / odds - 1.0).abs() < 0.3, "{found:?}");
    }

    #[test]
    fn it_is_what_is_learnt() {
        // `tools/test_learn.py` has the same decision in Python, and the same figures.
        let calibration = Calibration {
            ln_prior_none: 0.0,
            ln_prior_single: -3.5,
            ln_prior_pair: -8.5,
            ln_prior_unknown: -3.4,
            misfit_share: 0.01,
            doubt: 0.06,
            form_probability: 0.03,
            form_share: 0.19,
            hidden_share: 0.12,
            nominal_misfit_probability: 0.7,
            nominal_misfit_nats: 9.0,
            ..Calibration::built_in()
        };
        let pair = Weighable { nameless: None, ..hypothesis(&[3, 4], 33.0, 0.0) };
        let all = [none(20.0), hypothesis(&[3], 30.0, 12.0), hypothesis(&[4], 24.0, 14.0), pair];
        let found = decided(&all, &calibration);
        let told = [&found.probabilities[..], &[found.unknown]].concat();
        for (told, learnt) in told.iter().zip([0.0313, 0.4525, 0.0250, 0.0007, 0.4905]) {
            assert!((told - learnt).abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn nothing_looked_at_and_nothing_finite_keep_probabilities_whole() {
        let calibration = Calibration::built_in();
        let unseen = |h: Weighable| Weighable { nameless: None, slight: 0.0, ..h };
        let found = decided(&[unseen(none(0.0)), unseen(single(f64::NEG_INFINITY, 0.0))], &calibration);
        let whole = found.probabilities.iter().sum::<f64>() + found.unknown;
        assert!((whole - 1.0).abs() < 1e-9, "{found:?}");
        assert!(found.probabilities.iter().all(|p| p.is_finite()));
    }
}
