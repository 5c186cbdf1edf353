//! From flights to a verdict.

use bench_plant::effects::{LIBRARY, Stage};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    fit::{Fit, Problem},
    law::NUISANCES,
    pass::{Axis, run},
    predict::prediction_errors_m,
    region::{Regions, regions},
};

/// What a diagnosis says. As JSON it is `bench.diagnosis/1` (docs/diagnosis.md).
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// `bench.diagnosis/1`.
    pub schema: &'static str,
    /// What it comes to.
    pub verdict: Verdict,
    /// The effects named, where the verdict is [`Verdict::Effect`].
    pub effects: Vec<&'static str>,
    /// Probability of the verdict and, for an effect, of exactly these effects.
    pub confidence: f64,
    /// Whether probabilities were calibrated for this rig. Not yet: they rank, but their size is not to be trusted.
    pub calibrated: bool,
    /// Every hypothesis worth telling, most probable first.
    pub candidates: Vec<Candidate>,
    /// The rig's numbers after the fit without effects.
    pub numbers: Vec<Number>,
    /// How large the gap is, and how far it shrinks.
    pub gap: Gap,
    /// Where it lies.
    #[serde(rename = "where")]
    pub place: Place,
    /// What was used.
    pub flights: Vec<FlightUsed>,
    /// What could not be used, or cannot be told from these flights.
    pub warnings: Vec<String>,
}

/// What a diagnosis comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// One or two effects of the library explain the gap.
    Effect,
    /// No gap beyond tolerance and noise.
    None,
    /// A gap that no known effect explains.
    Unknown,
}

/// One hypothesis.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// Its effects; empty for `none` and `unknown`.
    pub effects: Vec<&'static str>,
    /// `none`, `unknown`, or the effects joined by `+`.
    pub name: String,
    /// Its probability.
    pub probability: f64,
    /// Gain of log-evidence over `none`, nats.
    pub evidence_gain: f64,
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
    /// One sigma.
    pub std: f64,
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

/// The gap at four levels: the rig as it is, its numbers re-fitted, with the effect, and what is left to noise.
#[derive(Clone, Debug, Serialize)]
pub struct Gap {
    /// Negative log-likelihood a sighting.
    pub metric: &'static str,
    /// The rig as it is.
    pub nominal: f64,
    /// The rig's numbers re-fitted within their tolerances.
    pub parameters_only: f64,
    /// With the best effect, numbers re-fitted.
    pub with_effect: f64,
    /// What a right model would score.
    pub floor: f64,
    /// Share of the gap above the floor that the effect closes beyond the re-fit.
    pub closure: Option<f64>,
    /// Whether these come from flights left out of the fit. Not yet.
    pub held_out: bool,
    /// RMS prediction errors, m, at 0.5, 1 and 2 s: nominal, re-fitted, with effect.
    pub k_step_m: KStep,
}

/// RMS prediction errors at 0.5, 1 and 2 s, m; `null` where flights are too short.
#[derive(Clone, Debug, Serialize)]
pub struct KStep {
    /// The rig as it is.
    pub nominal: [Option<f64>; 3],
    /// Its numbers re-fitted.
    pub parameters_only: [Option<f64>; 3],
    /// With the best effect.
    pub with_effect: [Option<f64>; 3],
}

/// Where the gap lies.
#[derive(Clone, Debug, Serialize)]
pub struct Place {
    /// The stage of the best candidate, where there is one.
    pub stage: Option<&'static str>,
    /// Free acceleration over each quantity on top of the re-fitted rig, strongest first.
    pub regions: Vec<RegionTold>,
    /// Evidence of a free acceleration on top of the best hypothesis, nats: what no known law explains.
    pub unexplained: f64,
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
    /// Sightings held against a prediction.
    pub sightings: usize,
}

/// Effects whose law acts on altitude or on the tracker's view of it. The others show directly in readbacks, ticks and
/// frames, or as noise.
const FITTED: [&str; 16] = [
    "tracker-latency",
    "tracker-scale",
    "actuator-lag",
    "rotor-lag",
    "thrust-curve",
    "thrust-loss",
    "battery-discharge",
    "battery-load",
    "ground-effect-shape",
    "ground-effect-dynamic",
    "ceiling-effect",
    "updraft",
    "mass-change",
    "quadratic-drag",
    "descent-thrust-loss",
    "inflow-damping",
];

/// Prior probabilities of the kinds of hypotheses, spread evenly within each.
const PRIOR_NONE: f64 = 0.3;
const PRIOR_SINGLE: f64 = 0.45;
const PRIOR_PAIR: f64 = 0.15;
const PRIOR_UNKNOWN: f64 = 0.1;
/// Evidence counts divided by this: sightings are not as independent, nor laws as exact, as the likelihood thinks.
const TEMPERATURE: f64 = 2.0;
/// A law of another form leaves structure behind even where its cause is named rightly: so many nats, and this share of
/// its own gain, are forgiven before a gap counts as unexplained. The same share is asked of a second effect.
const FORGIVEN_NATS: f64 = 25.0;
const FORGIVEN_SHARE: f64 = 0.1;
/// The best singles on which pairs are built.
const PAIR_BASES: usize = 3;

impl Diagnosis {
    /// Diagnoses flights that were all flown on one rig. There must be at least one.
    pub fn of(problem: &Problem<'_>) -> Self {
        let null = problem.fit_null();
        let effects: Vec<usize> =
            FITTED.iter().filter_map(|name| LIBRARY.iter().position(|spec| spec.name == *name)).collect();
        let mut singles: Vec<Fit> =
            effects.par_iter().map(|effect| problem.fit_with(&null, *effect)).collect();
        singles.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        let mut pairs = pairs(problem, &null, &singles, &effects);
        let field = Field { null: &null, singles: &singles, library: effects.len() };
        pairs.sort_by(|a, b| field.weight(b).total_cmp(&field.weight(a)));
        let best = [&null, &singles[0]]
            .into_iter()
            .chain(pairs.first())
            .max_by(|a, b| field.weight(a).total_cmp(&field.weight(b)))
            .unwrap_or(&null);
        let on_null = regions(problem, &null);
        let on_best = if best.effects.is_empty() { on_null.clone() } else { regions(problem, best) };

        let candidates = candidates(&field, &pairs, best, &on_best);
        let top = &candidates[0];
        let verdict = match top.name.as_str() {
            "none" => Verdict::None,
            "unknown" => Verdict::Unknown,
            _ => Verdict::Effect,
        };
        Self {
            schema: "bench.diagnosis/1",
            verdict,
            effects: top.effects.clone(),
            confidence: top.probability,
            calibrated: false,
            numbers: numbers(problem, &null),
            gap: gap(problem, &null, best),
            place: place(best, &on_null, on_best.ceiling),
            flights: problem
                .tracks
                .iter()
                .map(|track| FlightUsed {
                    name: track.name.clone(),
                    sightings: track.sightings.iter().filter(|sighting| sighting.counts).count(),
                })
                .collect(),
            warnings: Vec::new(),
            candidates,
        }
    }
}

/// Pairs built forward on the best singles.
fn pairs(problem: &Problem<'_>, null: &Fit, singles: &[Fit], effects: &[usize]) -> Vec<Fit> {
    // A second effect is worth a look only on top of a first one that is.
    let bases: Vec<&Fit> = singles
        .iter()
        .take(PAIR_BASES)
        .filter(|single| single.log_evidence > null.log_evidence + TEMPERATURE)
        .collect();
    let jobs: Vec<(&Fit, usize)> = bases
        .iter()
        .enumerate()
        .flat_map(|(rank, base)| {
            let earlier: Vec<usize> = bases[..=rank].iter().flat_map(|fit| fit.effects.clone()).collect();
            effects.iter().filter(move |effect| !earlier.contains(effect)).map(|effect| (*base, *effect))
        })
        .collect();
    jobs.into_par_iter().map(|(base, effect)| problem.fit_with(base, effect)).collect()
}

/// What hypotheses are weighed against.
struct Field<'a> {
    null: &'a Fit,
    singles: &'a [Fit],
    /// How many effects compete.
    library: usize,
}

impl Field<'_> {
    fn gain(&self, fit: &Fit) -> f64 {
        fit.log_evidence - self.null.log_evidence
    }

    /// Logarithm of a hypothesis' prior times its tempered evidence over the null's.
    fn weight(&self, fit: &Fit) -> f64 {
        let n = self.library as f64;
        let gain = self.gain(fit);
        match fit.effects.len() {
            0 => PRIOR_NONE.ln(),
            1 => (PRIOR_SINGLE / n).ln() + gain / TEMPERATURE,
            _ => {
                let alone = self
                    .singles
                    .iter()
                    .filter(|single| fit.effects.contains(&single.effects[0]))
                    .map(|single| self.gain(single).max(0.0))
                    .fold(0.0, f64::max);
                (PRIOR_PAIR / (n * (n - 1.0) / 2.0)).ln() + (gain - FORGIVEN_SHARE * alone) / TEMPERATURE
            }
        }
    }
}

fn candidates(field: &Field<'_>, pairs: &[Fit], best: &Fit, on_best: &Regions) -> Vec<Candidate> {
    let mut weighed: Vec<(f64, Candidate)> = std::iter::once(field.null)
        .chain(field.singles)
        .chain(pairs)
        .map(|fit| (field.weight(fit), candidate(fit, field.null)))
        .collect();
    let gain = field.gain(best);
    let unexplained = on_best.ceiling - FORGIVEN_NATS - FORGIVEN_SHARE * gain.max(0.0);
    let unknown = Candidate {
        effects: Vec::new(),
        name: "unknown".to_owned(),
        probability: 0.0,
        evidence_gain: gain + unexplained,
        parameters: Vec::new(),
    };
    weighed.push((PRIOR_UNKNOWN.ln() + (gain + unexplained) / TEMPERATURE, unknown));

    weighed.sort_by(|a, b| b.0.total_cmp(&a.0));
    let highest = weighed[0].0;
    let total: f64 = weighed.iter().map(|(weight, _)| (weight - highest).exp()).sum();
    weighed
        .into_iter()
        .map(|(weight, candidate)| Candidate { probability: (weight - highest).exp() / total, ..candidate })
        .filter(|candidate| candidate.probability > 1e-4 || candidate.effects.len() < 2)
        .collect()
}

fn candidate(fit: &Fit, null: &Fit) -> Candidate {
    let effects: Vec<&'static str> = fit.effects.iter().map(|index| LIBRARY[*index].name).collect();
    Candidate {
        name: if effects.is_empty() { "none".to_owned() } else { effects.join("+") },
        effects,
        probability: 0.0,
        evidence_gain: fit.log_evidence - null.log_evidence,
        parameters: fit
            .effect_parameters()
            .map(|(slot, parameter, value, std)| {
                let spec = LIBRARY[fit.effects[slot]];
                let p = spec.parameters[parameter];
                ParameterValue { effect: spec.name, name: p.key, unit: p.unit, value, std }
            })
            .collect(),
    }
}

fn numbers(problem: &Problem<'_>, null: &Fit) -> Vec<Number> {
    (0..NUISANCES.len())
        .filter(|i| problem.sigma[*i] > 0.0)
        .map(|i| {
            let (nominal, fitted) = (problem.nominal.nuisances[i], null.point.nuisances[i]);
            Number { name: NUISANCES[i], nominal, fitted, sigmas: (fitted - nominal) / problem.sigma[i] }
        })
        .collect()
}

fn gap(problem: &Problem<'_>, null: &Fit, best: &Fit) -> Gap {
    // All levels at the same noise, or a level could pay for its errors by calling them noise.
    let noise = best.noise;
    let mean_nll = |point| {
        let pass = run(problem.tracks, problem.rig, point, &noise, &[]);
        pass.nll / pass.innovations.len().max(1) as f64
    };
    let right = run(problem.tracks, problem.rig, &best.point, &noise, &[]);
    let floor = right.innovations.iter().map(|i| 0.5 + 0.5 * i.variance_m2.ln()).sum::<f64>()
        / right.innovations.len().max(1) as f64;
    let [nominal, parameters_only, with_effect] = [&problem.nominal, &null.point, &best.point].map(mean_nll);
    let above_floor = parameters_only - floor;
    let closure = (!best.effects.is_empty() && above_floor > 0.0)
        .then(|| ((parameters_only - with_effect) / above_floor).min(1.0));
    let k_step = |point| prediction_errors_m(problem, point, &noise);
    Gap {
        metric: "mean negative log-likelihood of a sighting, nats",
        nominal,
        parameters_only,
        with_effect,
        floor,
        closure,
        held_out: false,
        k_step_m: KStep {
            nominal: k_step(&problem.nominal),
            parameters_only: k_step(&null.point),
            with_effect: k_step(&best.point),
        },
    }
}

fn place(best: &Fit, on_null: &Regions, unexplained: f64) -> Place {
    let mut told: Vec<RegionTold> = on_null
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
    let stage = best.effects.first().map(|index| LIBRARY[*index].stage).map(Stage::name);
    Place { stage, regions: told, unexplained }
}

fn axis_words(axis: Axis) -> (&'static str, &'static str) {
    match axis {
        Axis::Altitude => ("altitude", "m"),
        Axis::Speed => ("vertical speed", "m/s"),
        Axis::ThrustToWeight => ("thrust over weight", "1"),
        Axis::ThrustChange => ("change of thrust over weight", "1"),
        Axis::Time => ("time in flight", "s"),
        Axis::Charge => ("charge drawn", "min of hover"),
    }
}
