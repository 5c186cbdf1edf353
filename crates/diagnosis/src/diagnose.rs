//! From flights to a verdict, and what is told of it.

use bench_filter::Point;
use bench_inference::{Fit, Problem, Regions, Search, fitted_effects};
use bench_plant::effects::{Axis, LIBRARY};
use bench_rig::{EffectEntry, Location, Rig};
use serde::Serialize;

use crate::{
    agree::{Disagreement, disagreement},
    allowed::{Ahead, ahead},
    analysis::Analysis,
    calibration::Calibration,
    direct::{Direct, Finding},
    gap::{Gap, gap},
    groups::{Answer, Likenesses, answer},
    hypothesis::{Grounds, Hypothesis},
    next_flight::{NextFlight, close},
    stage::{StageShare, stages},
    trace::{Trace, traces},
    weigh::{UNKNOWN, Weighed},
};

/// What a diagnosis says: the evidence, and what it comes to. How sure it must be to be told is for those who report it, who put
/// the first four keys of `bench.diagnosis/2` (docs/diagnosis.md) before the others.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Diagnosis {
    /// `bench.diagnosis/2`.
    #[serde(skip)]
    pub schema: &'static str,
    /// What it comes to.
    #[serde(skip)]
    pub verdict: Verdict,
    /// The effects named, where the verdict is [`Verdict::Effect`].
    #[serde(skip)]
    pub effects: Vec<&'static str>,
    /// Name of the candidate that leads.
    #[serde(skip)]
    pub leading: String,
    /// Probability of the verdict and, for an effect, that it is of these effects or of one of [`Self::alternatives`].
    #[serde(skip)]
    pub confidence: f64,
    /// What leads may as well be these, by the same flights; most probable first.
    pub alternatives: Vec<Alternative>,
    /// What made probabilities of evidence.
    pub calibration: Calibration,
    /// By what evidence was divided: 1, and more where more nats are at stake.
    pub temperature: f64,
    /// Labels one of which is true with a probability of nine in ten or more: candidates' names, most probable first.
    pub set: Vec<String>,
    /// Effects that these flights cannot tell from a named one.
    pub group: Vec<Likeness>,
    /// Every hypothesis worth telling, most probable first.
    pub candidates: Vec<Candidate>,
    /// The rig's numbers after the fit without effects.
    pub numbers: Vec<Number>,
    /// The same with the best effects.
    pub numbers_with_effect: Vec<Number>,
    /// Noise as fitted without effects.
    pub noise: NoiseTold,
    /// What shows that the flights are not of one condition, where something does.
    pub disagreement: Option<Disagreement>,
    /// How far off the rig as it is predicts, and how far its tolerances and noise allow; absent where flights are too short.
    pub ahead: Option<Ahead>,
    /// How large the gap is, and how far it shrinks.
    pub gap: Gap,
    /// Where it lies.
    #[serde(rename = "where")]
    pub place: Place,
    /// What readbacks, ticks, frames and arrivals show without any model of flight.
    pub direct: Vec<Finding>,
    /// The disturbance that the re-fitted rig leaves, flight by flight.
    pub traces: Vec<Trace>,
    /// What was used.
    pub flights: Vec<FlightUsed>,
    /// What to do next, in words.
    pub next: Vec<String>,
    /// The mission that tells the leading hypotheses apart, where one was asked for and found.
    pub next_flight: Option<NextFlight>,
    /// What could not be used, or cannot be told from these flights.
    pub warnings: Vec<String>,
}

/// What a diagnosis comes to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// One or two effects of the library explain the gap.
    Effect,
    /// No gap beyond tolerance and noise.
    #[default]
    None,
    /// A gap that no known effect explains.
    Unknown,
}

impl Verdict {
    /// What it is of effects; none for a cause that nobody knows.
    pub(crate) fn of(effects: Option<&[usize]>) -> Self {
        match effects {
            None => Self::Unknown,
            Some([]) => Self::None,
            Some(_) => Self::Effect,
        }
    }
}

/// One hypothesis.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// Its effects; empty for `none` and `unknown`.
    pub effects: Vec<&'static str>,
    /// Library indices of these, in the same order; none for `unknown`, of which nobody knows them.
    #[serde(skip)]
    pub indices: Option<Vec<usize>>,
    /// `none`, `unknown`, or the effects joined by `+`.
    pub name: String,
    /// Its probability.
    pub probability: f64,
    /// Gain of log-evidence over `none`, nats.
    pub evidence_gain: f64,
    /// That gain by kind of evidence, and what its laws leave; absent for `unknown`, and where one of its effects is too small to be
    /// seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grounds: Option<Grounds>,
    /// Its effects' parameters.
    pub parameters: Vec<ParameterValue>,
}

/// A fitted parameter.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterValue {
    /// The effect.
    pub effect: &'static str,
    /// Its key in a rig file.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The most probable value.
    pub value: f64,
    /// Lower end of an interval of 90 %.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// What a verdict may as well be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Alternative {
    /// The candidate's name.
    pub name: String,
    /// Its own probability.
    pub probability: f64,
}

/// An effect whose response these flights cannot tell from another's.
#[derive(Clone, Debug, Serialize)]
pub struct Likeness {
    /// The effect that is named.
    pub effect: &'static str,
    /// The one that looks the same.
    pub like: &'static str,
    /// Cosine of their responses, tolerances projected out.
    pub cosine: f64,
}

/// One of the rig's numbers.
#[derive(Clone, Debug, Serialize)]
pub struct Number {
    /// Which.
    pub name: &'static str,
    /// The rig's value.
    pub nominal: f64,
    /// The value that fits without effects.
    pub fitted: f64,
    /// How many tolerances lie between.
    pub sigmas: f64,
}

/// Noise of tracker and air.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NoiseTold {
    /// One sigma of the turbulence's acceleration, m/s^2.
    pub turbulence_m_s2: f64,
    /// For how long it remembers, s.
    pub turbulence_time_s: f64,
    /// One sigma of a measurement, m.
    pub measurement_m: f64,
    /// The same as the rig says, rounding included.
    pub measurement_nominal_m: f64,
}

/// Where the gap lies.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Place {
    /// The stage of the best candidate, where there is one.
    pub stage: Option<&'static str>,
    /// Shares of the stages, largest first.
    pub stages: Vec<StageShare>,
    /// Free acceleration over each quantity on top of the re-fitted rig, strongest first.
    pub regions: Vec<RegionTold>,
    /// Evidence of all of it at once, nats.
    pub structure: f64,
    /// Evidence of an acceleration that swings at a frequency, on top of the re-fitted rig.
    pub frequencies: Vec<Frequency>,
    /// Among how many frequencies those were chosen.
    pub frequencies_tried: usize,
    /// Evidence of a free acceleration on top of the best hypothesis, beyond another form of its laws, nats: what no
    /// known law explains.
    pub unexplained: f64,
    /// The same of the most plain frequency.
    pub unexplained_frequency: Frequency,
    /// The same of an acceleration over the altitude of late: air or motors that remember where the airframe was.
    pub unexplained_past: f64,
    /// The same of an acceleration that grows from flight to flight.
    pub unexplained_drift: f64,
    /// The same of a play of the thrust, which no readback shows.
    pub unexplained_play: f64,
    /// The same of thrust that is missing for moments.
    pub unexplained_pulses: f64,
    /// The same of the readback.
    pub unexplained_readback: f64,
}

/// Evidence of an acceleration that swings.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Frequency {
    /// Frequency, Hz.
    pub hz: f64,
    /// Gain of log-evidence, nats.
    pub gain: f64,
}

/// A free acceleration over one quantity.
#[derive(Clone, Debug, Serialize)]
pub struct RegionTold {
    /// The quantity.
    pub axis: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Evidence of it, nats.
    pub gain: f64,
    /// Where it is told.
    pub at: Vec<f64>,
    /// Acceleration there, m/s^2.
    pub acceleration_m_s2: Vec<f64>,
    /// One sigma.
    pub sigma_m_s2: Vec<f64>,
}

/// A flight that was used.
#[derive(Clone, Debug, Serialize)]
pub struct FlightUsed {
    /// Its name.
    pub name: String,
    /// Measurements held against a prediction.
    pub measurements: usize,
}

/// Evidence from which something counts as seen and is worth telling, nats: odds of 20 to 1.
pub const PLAIN_NATS: f64 = 3.0;

/// Sigmas of an interval of 90 %,
const INTERVAL_SIGMAS: f64 = 1.645; // unit
/// and by how much sigma is wider, for measurements that are not quite independent.
const WIDENED: f64 = 1.2;
/// One sigma of what another form of a law makes of its parameters, as a fraction: learnt with the calibration.
pub(crate) const FORM_SIGMA: f64 = 0.25;
/// How sure a set is to hold the truth.
const SET_PROBABILITY: f64 = 0.9; // unit

/// What is said of a fit whose posterior has no width.
fn undetermined(fit: &Fit) -> String {
    let names: Vec<&str> = fit.effects().iter().map(|effect| LIBRARY[*effect].name).collect();
    let of = if names.is_empty() { "the rig without an effect".to_owned() } else { names.join(" and ") };
    format!(
        "these flights do not determine the numbers of {of}: their information has no inverse, so intervals are those before any flight and there is no evidence; give tolerances that are not zero, or flights that move"
    )
}

impl Diagnosis {
    /// Diagnoses flights that were all flown on one rig. There must be at least one.
    pub fn of(problem: &Problem<'_>, calibration: &Calibration) -> Self {
        Analysis::of(problem, calibration).diagnosis()
    }

    pub(crate) fn found(analysis: &Analysis<'_>) -> Self {
        let Analysis { prepared, search, weighed, calibration } = analysis;
        let (problem, direct) = (&analysis.problem(), &prepared.direct);
        let null = &search.fits[0];
        let candidates = candidates(problem, weighed, search, direct);
        let likenesses = likenesses(problem, search, &candidates);
        let Answer { leading, alternatives, probability } = answer(&candidates, &likenesses);
        let top = &candidates[leading];
        let verdict = Verdict::of(top.indices.as_deref());
        // What is named, or else the best that has a fit of its own, stands for "with the effect".
        let named =
            weighed.hypotheses.iter().find(|h| verdict == Verdict::Effect && h.names() == top.effects);
        let best = &search.fits[named.unwrap_or(&weighed.hypotheses[0]).fit];
        let pair = best.effects();
        let simpler: Vec<&Fit> = search
            .fits
            .iter()
            .filter(|fit| pair.len() == 2 && matches!(fit.effects().as_slice(), [one] if pair.contains(one)))
            .collect();
        let nameless = if verdict == Verdict::Unknown {
            (weighed.unknown_gain - weighed.hypotheses[0].gain()).max(0.0)
        } else {
            0.0
        };
        let group = likenesses.told(top.indices.as_deref().unwrap_or_default());
        let mut told = 0.0;
        let set = candidates
            .iter()
            .take_while(|candidate| {
                let short = told < SET_PROBABILITY;
                told += candidate.probability;
                short
            })
            .map(|candidate| candidate.name.clone())
            .collect();
        Self {
            schema: "bench.diagnosis/2",
            verdict,
            effects: top.effects.clone(),
            leading: top.name.clone(),
            confidence: probability,
            alternatives: alternatives
                .iter()
                .map(|i| &candidates[*i])
                .filter(|other| other.probability > TOLD_PROBABILITY)
                .map(|other| Alternative { name: other.name.clone(), probability: other.probability })
                .collect(),
            calibration: calibration.clone(),
            temperature: weighed.temperature,
            set,
            numbers: numbers(problem, null),
            numbers_with_effect: numbers(problem, best),
            noise: NoiseTold {
                turbulence_m_s2: null.noise.turbulence,
                turbulence_time_s: null.noise.turbulence_time_s,
                measurement_m: null.noise.measurement_m,
                measurement_nominal_m: problem.noise.measurement_m,
            },
            disagreement: disagreement(problem, best, &simpler, nameless),
            ahead: ahead(problem, best),
            gap: gap(problem, null, best),
            place: place(problem, top, weighed, search),
            direct: direct.findings.clone(),
            traces: traces(problem, null),
            flights: problem
                .tracks
                .iter()
                .map(|track| FlightUsed { name: track.name.clone(), measurements: track.counted() })
                .collect(),
            next: next(verdict, &candidates, &group).into_iter().chain(windy(problem, null)).collect(),
            next_flight: None,
            group,
            warnings: if std::ptr::eq(null, best) { vec![best] } else { vec![null, best] }
                .into_iter()
                .filter(|fit| fit.is_singular())
                .map(undetermined)
                .collect(),
            candidates,
        }
    }
}

impl Diagnosis {
    /// The rig with the named effects added and its numbers as fitted beside them; `None` where no effect is named.
    pub fn rig_with_effect(&self, rig: &Rig) -> Option<Rig> {
        if self.verdict != Verdict::Effect {
            return None;
        }
        let told = self.candidates.iter().find(|candidate| candidate.effects == self.effects)?;
        let mut rig = rig.clone();
        let a = &mut rig.airframe;
        for number in &self.numbers_with_effect {
            let value = match number.name {
                "mass_kg" => &mut a.mass_kg.value,
                "thrust_gain" => &mut a.thrust.gain_n_per_unit.value,
                "thrust_offset" => &mut a.thrust.offset.value,
                "ground_effect_multiplier" => &mut a.ground_effect.multiplier.value,
                "ground_effect_height_m" => &mut a.ground_effect.height_m.value,
                "drag_n_s_per_m" => &mut a.drag_n_s_per_m.value,
                "tracker_latency_s" => &mut rig.tracker.latency_s.value,
                _ => continue,
            };
            *value = six_digits(number.fitted);
        }
        if let Some(hover) = self.numbers_with_effect.iter().find(|number| number.name == "thrust_hover") {
            // The gain is what carries the weight there.
            let a = &mut rig.airframe;
            a.thrust.gain_n_per_unit.value =
                six_digits(a.weight_n() / (hover.fitted - a.thrust.offset.value));
        }
        for effect in &self.effects {
            let own = told.parameters.iter().filter(|p| p.effect == *effect);
            rig.effects.push(EffectEntry {
                name: (*effect).to_owned(),
                parameters: own.map(|p| (p.name.to_owned(), six_digits(p.value), 0)).collect(),
                at: Location { file: "diagnosis".into(), line: 0 },
            });
        }
        Some(rig)
    }
}

/// More digits than a fit knows, fewer than a file wants.
fn six_digits(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

/// Pairs less probable are not told.
const TOLD_PROBABILITY: f64 = 1e-4; // unit

fn candidates(problem: &Problem<'_>, weighed: &Weighed, search: &Search, direct: &Direct) -> Vec<Candidate> {
    let mut all: Vec<Candidate> = weighed
        .hypotheses
        .iter()
        .zip(&weighed.probabilities)
        .map(|(h, probability)| candidate(problem, h, *probability, search, direct))
        .collect();
    all.push(Candidate {
        effects: Vec::new(),
        indices: None,
        name: UNKNOWN.to_owned(),
        probability: weighed.unknown,
        evidence_gain: weighed.unknown_gain,
        grounds: None,
        parameters: Vec::new(),
    });
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    all.retain(|candidate| candidate.probability > TOLD_PROBABILITY || candidate.effects.len() < 2);
    all
}

fn candidate(
    problem: &Problem<'_>,
    h: &Hypothesis,
    probability: f64,
    search: &Search,
    direct: &Direct,
) -> Candidate {
    let effects = h.names();
    let fit = &search.fits[h.fit];
    let mut parameters: Vec<ParameterValue> = fit
        .effect_parameters(problem, INTERVAL_SIGMAS, WIDENED, FORM_SIGMA)
        .map(|(slot, parameter, value, [low, high])| {
            let spec = LIBRARY[fit.point.effects[slot].0];
            let p = spec.parameters[parameter];
            ParameterValue { effect: spec.name, name: p.key, unit: p.unit, value, low, high }
        })
        .collect();
    for found in direct.effects.iter().filter(|found| h.direct.contains(&found.effect)) {
        let spec = LIBRARY[found.effect];
        // Read directly: nearer than what the flight tells.
        parameters.retain(|p| p.effect != spec.name);
        parameters.extend(spec.parameters.iter().zip(&found.values).map(|(p, value)| {
            let half = INTERVAL_SIGMAS * WIDENED * (value * found.relative_sigma.hypot(FORM_SIGMA)).abs();
            ParameterValue {
                effect: spec.name,
                name: p.key,
                unit: p.unit,
                value: *value,
                low: (value - half).max(p.min),
                high: (value + half).min(p.max),
            }
        }));
    }
    let name = if effects.is_empty() { "none".to_owned() } else { effects.join("+") };
    let (indices, evidence_gain) = (Some(h.effects.clone()), h.gain());
    Candidate {
        effects,
        indices,
        name,
        probability,
        evidence_gain,
        grounds: (!h.hidden).then_some(h.grounds),
        parameters,
    }
}

/// What less probable candidates look like does not change what leads.
const LIKELY_TO_LEAD: f64 = 0.02;

/// What the effects of all candidates look like that may lead.
fn likenesses(problem: &Problem<'_>, search: &Search, candidates: &[Candidate]) -> Likenesses {
    // The first leads where nothing else is seen.
    let may_lead = |(i, candidate): &(usize, &Candidate)| {
        candidate.probability > LIKELY_TO_LEAD && (*i == 0 || candidate.evidence_gain > PLAIN_NATS)
    };
    let likely = candidates.iter().enumerate().filter(may_lead).map(|(_, candidate)| candidate);
    let mut fitted: Vec<(usize, Vec<f64>)> = Vec::new();
    for effect in likely.flat_map(|candidate| candidate.indices.iter().flatten()) {
        // Alone, or where it was first fitted beside another.
        let slots = search.fits.iter().map(|fit| &fit.point.effects);
        let fits =
            slots.filter_map(|slots| Some((slots.len(), slots.iter().find(|(own, _)| own == effect)?)));
        if let Some((_, own)) = fits.min_by_key(|(effects, _)| *effects)
            && fitted.iter().all(|(other, _)| other != effect)
        {
            fitted.push(own.clone());
        }
    }
    Likenesses::of(problem, &search.fits[0], &fitted, &fitted_effects())
}

fn numbers(problem: &Problem<'_>, null: &Fit) -> Vec<Number> {
    let names = Point::names(problem.rig);
    problem
        .uncertain()
        .map(|(number, sigma)| {
            let (nominal, fitted) = (problem.nominal.nuisances[number], null.point.nuisances[number]);
            Number { name: names[number], nominal, fitted, sigmas: (fitted - nominal) / sigma }
        })
        .collect()
}

fn place(problem: &Problem<'_>, top: &Candidate, weighed: &Weighed, search: &Search) -> Place {
    let mut told: Vec<RegionTold> = weighed
        .on_null
        .axes
        .iter()
        .map(|region| {
            let (axis, unit) = axis_words(region.axis);
            RegionTold {
                axis,
                unit,
                gain: region.gain,
                at: region.knots.clone(),
                acceleration_m_s2: region.acceleration_m_s2.clone(),
                sigma_m_s2: region.sigma_m_s2.clone(),
            }
        })
        .collect();
    told.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let leading = top.indices.as_ref().and_then(|indices| indices.first());
    let stage = leading.map(|index| LIBRARY[*index].stage.name());
    let best = &weighed.hypotheses[0];
    let on_best: &Regions = best.regions.as_ref().unwrap_or(&weighed.on_null);
    let (hz, gain) = weighed.waves_on_best.highest();
    Place {
        stage,
        stages: stages(problem, &search.fits[0], &search.fits[best.fit]),
        regions: told,
        structure: weighed.on_null.ceiling,
        frequencies: weighed
            .waves_on_null
            .gains
            .iter()
            .map(|(hz, gain)| Frequency { hz: *hz, gain: *gain })
            .collect(),
        frequencies_tried: weighed.waves_on_null.tried,
        unexplained: (on_best.ceiling - on_best.form).max(0.0),
        unexplained_frequency: Frequency { hz, gain },
        unexplained_past: weighed.left.past,
        unexplained_drift: weighed.left.drift,
        unexplained_play: weighed.left.play,
        unexplained_pulses: weighed.left.pulses,
        unexplained_readback: weighed.left.readback,
    }
}

fn axis_words(axis: Axis) -> (&'static str, &'static str) {
    match axis {
        Axis::Altitude => ("altitude", "m"),
        Axis::Speed => ("vertical speed", "m/s"),
        Axis::ThrustToWeight => ("thrust over weight", "1"),
        Axis::ThrustChange => ("change of thrust over weight", "1"),
        Axis::Time => ("time in flight", "s"),
        Axis::Charge => ("charge drawn", "min of hover"),
        Axis::Voltage => ("battery voltage", "V"),
        Axis::Past => ("altitude of late", "m"),
    }
}

/// So many times the usual turbulence is worth a word.
const WINDY: f64 = 2.0;

/// What to do about air that is rougher than usual where the rig does not say what is ordinary there.
fn windy(problem: &Problem<'_>, null: &Fit) -> Option<String> {
    let told = problem.rig.disturbance.turbulence_m_s2.is_some();
    let rough = null.noise.turbulence > WINDY * problem.noise.turbulence;
    (rough && !told).then(|| {
        format!(
            "the turbulence of these flights is {:.2} m/s^2, and the rig does not say what is ordinary: `bench identify flight` on flights that were fine writes its `[disturbance]`, and gusts beyond that can be told",
            null.noise.turbulence
        )
    })
}

fn next(verdict: Verdict, candidates: &[Candidate], group: &[Likeness]) -> Vec<String> {
    let mut words = Vec::new();
    if let Some([first, second]) = close(candidates) {
        words.push(format!(
            "{} and {} stay close: `--next-flight FILE` writes the mission that separates them best",
            first.name, second.name
        ));
    }
    if !group.is_empty() {
        let others: Vec<_> = group.iter().map(|likeness| likeness.like).collect();
        words.push(format!(
            "{} would look nearly the same in these flights: check by a measurement of another kind",
            others.join(", ")
        ));
    }
    if verdict == Verdict::Unknown {
        words.push(
            "look at where it lies, and fly more there; no effect of the library is like it".to_owned(),
        );
    }
    words
}
