//! What terminal and page say in the same words.

pub use bench_diagnosis::PLAIN_NATS;
use bench_diagnosis::{Candidate, Diagnosis, Figure, Number, ParameterValue, RegionTold, Verdict};
use bench_page::digits;
use bench_plant::effects::{EffectSpec, LIBRARY, Parameter};
use bench_rig::Actuation;

/// The verdict in a sentence, without its probability.
pub fn sentence(diagnosis: &Diagnosis) -> String {
    match diagnosis.verdict {
        Verdict::Effect => {
            let apart = if or(diagnosis).is_empty() { "" } else { ", which these flights cannot tell apart" };
            format!("The gap comes from {}{apart}", answer(diagnosis))
        }
        Verdict::None => "No gap beyond tolerance and noise".to_owned(),
        // Where belief is spread over many causes, that none of them is it may be the likeliest without being likely.
        Verdict::Unknown if diagnosis.confidence < 0.5 => {
            "No cause stands out; likeliest is a gap that no known effect explains".to_owned()
        }
        Verdict::Unknown => "There is a gap that no known effect explains".to_owned(),
    }
}

/// An alternative is named beside what leads if it has such a share of their probability.
const WORTH_NAMING: f64 = 0.05;

/// What the verdict may as well be, where that is likely enough to be named.
fn or(diagnosis: &Diagnosis) -> Vec<String> {
    let likely =
        diagnosis.alternatives.iter().filter(|a| a.probability > WORTH_NAMING * diagnosis.confidence);
    likely.map(|alternative| alternative.name.replace('+', " and ")).collect()
}

/// What leads, with what it may as well be.
pub fn answer(diagnosis: &Diagnosis) -> String {
    [vec![diagnosis.leading.replace('+', " and ")], or(diagnosis)].concat().join(" or ")
}

/// What an effect is: its entry in the library.
pub fn spec(effect: &str) -> Option<&'static EffectSpec> {
    LIBRARY.iter().copied().find(|spec| spec.name == effect)
}

/// A parameter of an effect.
pub fn parameter(effect: &str, key: &str) -> Option<&'static Parameter> {
    spec(effect)?.parameters.iter().find(|parameter| parameter.key == key)
}

/// Whether a parameter is worth telling: not a form of a law that may as well be its plainest.
pub fn tells(p: &ParameterValue) -> bool {
    let default = parameter(p.effect, p.name).and_then(|parameter| parameter.default);
    default.is_none_or(|plainest| !(p.low..=p.high).contains(&plainest))
}

/// Effects that look like the named ones, each once.
pub fn alike(diagnosis: &Diagnosis) -> Vec<&'static str> {
    let mut names = Vec::new();
    for likeness in &diagnosis.group {
        if !names.contains(&likeness.like) {
            names.push(likeness.like);
        }
    }
    names
}

/// Effects with the probability that they take part, alone or beside another, most probable first: those of which that is at least
/// `least`. None where no pair is as probable as that, for then candidates say it already.
pub fn takes_part(candidates: &[Candidate], least: f64) -> Vec<(&'static str, f64)> {
    let pairs = candidates.iter().filter(|candidate| candidate.effects.len() > 1);
    if pairs.map(|pair| pair.probability).sum::<f64>() < least {
        return Vec::new();
    }
    let mut effects: Vec<&'static str> = Vec::new();
    for effect in candidates.iter().flat_map(|candidate| &candidate.effects) {
        if !effects.contains(effect) {
            effects.push(effect);
        }
    }
    let mut parts: Vec<(&'static str, f64)> =
        effects.into_iter().map(|effect| (effect, any_takes_part(candidates, &[effect]))).collect();
    parts.retain(|(_, probability)| *probability >= least);
    parts.sort_by(|a, b| b.1.total_cmp(&a.1));
    parts
}

/// Probability that one or more of these effects take part.
fn any_takes_part(candidates: &[Candidate], effects: &[&str]) -> f64 {
    let with = candidates.iter().filter(|c| c.effects.iter().any(|effect| effects.contains(effect)));
    with.map(|candidate| candidate.probability).sum()
}

/// Probability that the leading effect, or one that flights cannot tell from it, takes part, alone or beside another; of nothing but one
/// effect that leads.
pub fn leader_takes_part(diagnosis: &Diagnosis) -> Option<f64> {
    let leading = diagnosis.candidates.iter().find(|candidate| candidate.name == diagnosis.leading)?;
    let [effect] = leading.effects.as_slice() else { return None };
    let alike = diagnosis.alternatives.iter().map(|other| other.name.as_str());
    let effects: Vec<&str> = std::iter::once(*effect).chain(alike).collect();
    Some(any_takes_part(&diagnosis.candidates, &effects))
}

/// What the third level of the gap adds, where there is such a level.
pub fn best_effects(diagnosis: &Diagnosis) -> Option<String> {
    if diagnosis.verdict == Verdict::Effect {
        return Some(diagnosis.effects.join(" and "));
    }
    let best = diagnosis.candidates.iter().find(|candidate| candidate.name != "unknown")?;
    (!best.effects.is_empty()).then(|| best.effects.join(" and "))
}

/// A probability as people say it.
pub fn percent(probability: f64) -> String {
    if !probability.is_finite() {
        "-".to_owned()
    } else if probability > 0.995 {
        "over 99 %".to_owned()
    } else if probability < 0.005 {
        "under 1 %".to_owned()
    } else {
        format!("{:.0} %", 100.0 * probability)
    }
}

/// A number with its unit; ratios have none that is written.
pub fn with_unit(text: String, unit: &str) -> String {
    if unit == "1" || unit.is_empty() { text } else { format!("{text} {unit}") }
}

/// A figure and its interval with so many places; without the interval where it is a point.
pub fn figure(figure: &Figure, factor: f64, places: usize) -> String {
    let [value, low, high] = [figure.value, figure.low, figure.high].map(|x| factor * x);
    if low == high {
        fixed(value, places)
    } else {
        format!("{} ({} to {})", fixed(value, places), fixed(low, places), fixed(high, places))
    }
}

/// A number with so many places, never a negative zero; `-` for what is no number.
pub fn fixed(x: f64, places: usize) -> String {
    if !x.is_finite() {
        return "-".to_owned();
    }
    let text = format!("{x:.places$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        _ => text,
    }
}

/// The same with a plus before what is above zero.
pub fn signed(x: f64, places: usize) -> String {
    let text = fixed(x, places);
    if x > 0.0 { format!("+{text}") } else { text }
}

/// A value and its interval.
pub fn interval(value: f64, low: f64, high: f64) -> String {
    format!("{} ({} to {})", digits(value), digits(low), digits(high))
}

/// Name and unit of one of the rig's numbers, from its key.
pub fn number(key: &str, sticks: Actuation) -> (String, String) {
    let of_sticks = sticks.unit();
    let (name, unit) = match key {
        "thrust_gain" if of_sticks == "1" => (key, "N".to_owned()),
        "thrust_gain" => (key, format!("N/{of_sticks}")),
        "thrust_offset" => (key, of_sticks.to_owned()),
        _ => [("_n_s_per_m", "N s/m"), ("_kg", "kg"), ("_m", "m"), ("_s", "s")]
            .into_iter()
            .find_map(|(ending, unit)| Some((key.strip_suffix(ending)?, unit.to_owned())))
            .unwrap_or((key, "1".to_owned())),
    };
    (name.replace('_', " "), unit)
}

/// Misfit over what a right model would have against the same noise, nats a measurement; of a model that is as good, 0.
pub fn above_floor(misfit: f64, floor: f64) -> f64 {
    (misfit - floor).max(0.0)
}

/// The same of a figure with its interval.
pub fn figure_above_floor(misfit: &Figure, floor: &Figure) -> Figure {
    let [value, low, high] = [misfit.value, misfit.low, misfit.high].map(|x| above_floor(x, floor.value));
    Figure { value, low, high }
}

/// What of the gap is closed, or why not, as the rest of a sentence.
pub fn closure(diagnosis: &Diagnosis) -> Option<String> {
    let best = best_effects(diagnosis)?;
    if diagnosis.verdict != Verdict::Effect {
        return Some(format!("{best} comes nearest and does not explain it{}", left_over(diagnosis)));
    }
    let Some(closure) = diagnosis.gap.closure else {
        return Some(format!(
            "re-fitted numbers leave no gap above the floor that {best} could be seen to close"
        ));
    };
    let [value, low, high] = [closure.value, closure.low, closure.high].map(|share| fixed(100.0 * share, 0));
    let close = if diagnosis.effects.len() > 1 { "together close" } else { "closes" };
    Some(format!("{best} {close} {value} % ({low} to {high} %) of what re-fitting leaves above the floor"))
}

/// The plainest of what no hypothesis explains.
fn left_over(diagnosis: &Diagnosis) -> String {
    let place = &diagnosis.place;
    let wave = place.unexplained_frequency;
    let told = [
        (place.unexplained, "an acceleration of no known form".to_owned()),
        (wave.gain, format!("a swing at {} Hz", digits(wave.hz))),
        (place.unexplained_past, "a thrust that depends on where the airframe was of late".to_owned()),
        (place.unexplained_drift, "a thrust or a weight that changes from flight to flight".to_owned()),
        (place.unexplained_play, "a thrust that stays behind its changes, as through a play".to_owned()),
        (place.unexplained_pulses, "a thrust that is missing, or too much, for moments".to_owned()),
        (place.unexplained_readback, "a readback of no known law".to_owned()),
    ];
    let most = told.into_iter().filter(|(gain, _)| *gain > PLAIN_NATS).max_by(|a, b| a.0.total_cmp(&b.0));
    most.map_or_else(String::new, |(gain, what)| format!(": it leaves {what} ({} nats)", fixed(gain, 0)))
}

/// A stage as people call it.
pub fn stage(stage: &str) -> &str {
    match stage {
        "numbers" => "the rig's own numbers",
        "frames" => "times of the frames",
        "loop" => "times of the loop",
        other => other,
    }
}

/// From so many tolerances on a number of the rig is far off.
const FAR_SIGMAS: f64 = 3.0;

/// Whether a number would have to move further than tolerances go.
pub fn is_far(number: &Number) -> bool {
    number.sigmas.abs() > FAR_SIGMAS
}

/// Where along a region the acceleration stands out most of its band.
pub fn strongest(region: &RegionTold) -> Option<usize> {
    let clear = |k: usize| {
        let sigmas = region.acceleration_m_s2[k] / region.sigma_m_s2[k];
        if sigmas.is_finite() { sigmas.abs() } else { 0.0 }
    };
    (0..region.at.len()).max_by(|a, b| clear(*a).total_cmp(&clear(*b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_become_names_and_units() {
        let told = |key| number(key, Actuation::Volt);
        assert_eq!(told("mass_kg"), ("mass".to_owned(), "kg".to_owned()));
        assert_eq!(told("drag_n_s_per_m"), ("drag".to_owned(), "N s/m".to_owned()));
        assert_eq!(told("thrust_gain"), ("thrust gain".to_owned(), "N/V".to_owned()));
        assert_eq!(told("ground_effect_multiplier"), ("ground effect multiplier".to_owned(), "1".to_owned()));
        assert_eq!(number("thrust_gain", Actuation::Fraction).1, "N");
    }

    #[test]
    fn probabilities_do_not_claim_certainty() {
        let told = [1.0, 0.97, 0.001, f64::NAN].map(percent);
        assert_eq!(told, ["over 99 %", "97 %", "under 1 %", "-"]);
    }

    #[test]
    fn effects_take_part_alone_or_beside_another() {
        let candidate = |effects: &[&'static str], probability| Candidate {
            effects: effects.to_vec(),
            indices: None,
            name: String::new(),
            probability,
            evidence_gain: 0.0,
            grounds: None,
            parameters: Vec::new(),
        };
        let single = candidate(&["rotor-lag"], 0.6);
        let pair = candidate(&["updraft", "rotor-lag"], 0.3);
        let told = takes_part(&[single.clone(), pair, candidate(&["gusts"], 0.04)], 0.05);
        assert_eq!(told.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["rotor-lag", "updraft"]);
        assert!((told[0].1 - 0.9).abs() < 1e-12);
        assert!(takes_part(&[single], 0.05).is_empty(), "what candidates say already");
    }

    #[test]
    fn misfit_is_above_the_floor_and_never_below() {
        let at = |value, low, high| Figure { value, low, high };
        let above = figure_above_floor(&at(-5.37, -5.43, -5.3), &at(-5.42, -5.43, -5.41));
        assert!((above.value - 0.05).abs() < 1e-12 && (above.high - 0.12).abs() < 1e-12, "{above:?}");
        assert_eq!(above.low, 0.0);
    }

    #[test]
    fn figures_keep_their_places_and_have_no_negative_zero() {
        let told = |value, low, high| figure(&Figure { value, low, high }, 100.0, 1);
        assert_eq!(told(0.0123, -0.0001, 0.02), "1.2 (0.0 to 2.0)");
        assert_eq!(told(0.5, 0.5, 0.5), "50.0");
        assert_eq!(told(f64::NAN, 0.0, 1.0), "- (0.0 to 100.0)");
    }
}
