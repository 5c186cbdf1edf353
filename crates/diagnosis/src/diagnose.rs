//! From flights to a verdict.

use bench_plant::effects::{LIBRARY, Stage};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    direct::{Direct, Finding, direct},
    fit::{Fit, Problem, Promise},
    law::NUISANCES,
    pass::{Axis, Pass, run},
    random::{self, is_random},
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
    /// Noise as fitted without effects.
    pub noise: NoiseTold,
    /// How large the gap is, and how far it shrinks.
    pub gap: Gap,
    /// Where it lies.
    #[serde(rename = "where")]
    pub place: Place,
    /// What readbacks, ticks, frames and arrivals show without any model of flight.
    pub direct: Vec<Finding>,
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

/// Noise of tracker and air.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseTold {
    /// One sigma of the turbulence's acceleration, m/s^2.
    pub turbulence_m_s2: f64,
    /// One sigma of a sighting, m.
    pub sighting_m: f64,
    /// The same as the rig says, rounding included.
    pub sighting_nominal_m: f64,
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
    /// The same on top of the re-fitted rig.
    pub structure: f64,
    /// The frequency at which an acceleration swings most plainly on top of the best hypothesis, Hz, and its evidence,
    /// nats.
    pub wave: (f64, f64),
    /// The same on top of the re-fitted rig.
    pub wave_on_null: (f64, f64),
    /// The same of the readback.
    pub unexplained_pins: f64,
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
const FORGIVEN_NATS: f64 = 15.0;
const FORGIVEN_SHARE: f64 = 0.08;
/// The same of a random effect that comes second.
const RANDOM_SHARE: f64 = 0.25;
/// The best singles on which pairs are built.
const PAIR_BASES: usize = 3;
/// So many of the most promising are fitted.
const SINGLES_REFINED: usize = 14;
const PAIRS_REFINED: usize = 5;
/// Gain, nats, below which nothing is built on a single, or no second is tried.
const WORTH_A_SECOND: f64 = 2.0;

impl Diagnosis {
    /// Diagnoses flights that were all flown on one rig. There must be at least one.
    pub fn of(problem: &Problem<'_>) -> Self {
        let search = Search::of(problem);
        let direct = direct(problem.tracks, problem.rig);
        let null = &search.fits[0];
        let mut hypotheses = hypotheses(&search, &direct);
        let on_null = regions(problem, null);
        weigh_forms(problem, &search, &on_null, &mut hypotheses);
        // The best that has a fit of its own stands for "with the effect".
        let best = &search.fits[hypotheses[0].fit];
        let on_best = hypotheses[0].regions.clone().unwrap_or_else(|| on_null.clone());
        let left = unexplained(&hypotheses[0], best, &on_null, &on_best, &direct);
        let candidates = candidates(&search, &direct, hypotheses, left);
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
            numbers: numbers(problem, null),
            noise: NoiseTold {
                turbulence_m_s2: null.noise.turbulence,
                sighting_m: null.noise.sighting_m,
                sighting_nominal_m: problem.noise.sighting_m,
            },
            gap: gap(problem, null, best),
            direct: direct.findings.clone(),
            place: place(top, &on_null, &on_best, direct.unexplained_pins),
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

/// All fits of one diagnosis: the null first.
struct Search {
    fits: Vec<Fit>,
}

impl Search {
    fn of(problem: &Problem<'_>) -> Self {
        let null = problem.fit_null();
        let effects: Vec<usize> =
            FITTED.iter().filter_map(|name| LIBRARY.iter().position(|spec| spec.name == *name)).collect();
        // Where frames keep a clock, jitter shows in their arrivals or nowhere.
        let clocked = problem.tracks.iter().any(|track| !track.waits_s.is_empty());
        let random: Vec<usize> = (0..LIBRARY.len())
            .filter(|effect| is_random(*effect) && !(clocked && LIBRARY[*effect].name == "tracker-jitter"))
            .collect();
        let promises = problem.promises(&null, &effects, SINGLES_REFINED);
        let mut singles = refine_best(problem, &null, promises);
        singles.par_extend(random.par_iter().filter_map(|effect| random::fit_with(problem, &null, *effect)));
        singles.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));

        // A second effect is worth a look only on top of a first one that is.
        let bases: Vec<&Fit> = singles
            .iter()
            .filter(|single| !is_random(single.point.effects[0].0))
            .take(PAIR_BASES)
            .filter(|single| single.log_evidence > null.log_evidence + WORTH_A_SECOND)
            .collect();
        let mut done: Vec<usize> = Vec::new();
        let mut pairs: Vec<Fit> = Vec::new();
        for (rank, base) in bases.iter().enumerate() {
            done.extend(base.effects());
            let others: Vec<usize> =
                effects.iter().copied().filter(|effect| !done.contains(effect)).collect();
            let promises = problem.promises(base, &others, PAIRS_REFINED);
            let worth = promises.into_iter().filter(|promise| promise.gain > WORTH_A_SECOND).collect();
            pairs.extend(refine_best(problem, base, worth));
            if rank == 0 {
                pairs.par_extend(
                    random.par_iter().filter_map(|effect| random::fit_with(problem, base, *effect)),
                );
            }
        }
        let mut fits = vec![null];
        fits.extend(singles);
        fits.extend(pairs);
        Self { fits }
    }

    fn gain(&self, fit: usize) -> f64 {
        self.fits[fit].log_evidence - self.fits[0].log_evidence
    }

    /// What a second effect must gain, because the first one's law may be of another form.
    fn forgiven(&self, effects: &[usize], fit: &Fit) -> f64 {
        if fit.point.effects.len() < 2 {
            return 0.0;
        }
        let first = self.alone(effects);
        // Random effects take in whatever a law leaves.
        if effects.iter().any(|effect| is_random(*effect)) {
            FORGIVEN_NATS + RANDOM_SHARE * first
        } else {
            FORGIVEN_SHARE * first
        }
    }

    /// The best gain of any one of these effects alone.
    fn alone(&self, effects: &[usize]) -> f64 {
        (1..self.fits.len())
            .filter(|i| {
                let own = &self.fits[*i].point.effects;
                own.len() == 1 && effects.contains(&own[0].0)
            })
            .map(|i| self.gain(i))
            .fold(0.0, f64::max)
    }
}

/// Fits starts; of those of one effect, the better fit.
fn refine_best(problem: &Problem<'_>, base: &Fit, promises: Vec<Promise>) -> Vec<Fit> {
    let mut fits: Vec<Fit> =
        promises.into_par_iter().map(|promise| problem.refine(promise.start, base.noise)).collect();
    fits.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let mut seen: Vec<Vec<usize>> = Vec::new();
    fits.retain(|fit| {
        let effects = fit.effects();
        let new = !seen.contains(&effects);
        seen.push(effects);
        new
    });
    fits
}

/// A hypothesis with what speaks for it.
struct Hypothesis {
    /// Library indices.
    effects: Vec<usize>,
    /// The fit over its effects that the filter sees.
    fit: usize,
    /// Those of its effects that direct channels speak for.
    direct: Vec<usize>,
    /// Gain of log-evidence over none, all channels, and what another form of its laws would add.
    gain: f64,
    /// What its fit leaves, where that was looked at.
    regions: Option<Regions>,
    /// Logarithm of prior times tempered evidence.
    weight: f64,
}

/// All hypotheses of at most two effects that were fitted or read.
fn hypotheses(search: &Search, direct: &Direct) -> Vec<Hypothesis> {
    let n = LIBRARY.len() as f64;
    let mut all: Vec<Hypothesis> = Vec::new();
    let mut add = |fit: usize, direct_effects: &[usize]| {
        let mut effects = search.fits[fit].effects();
        for effect in direct_effects {
            if !effects.contains(effect) {
                effects.push(*effect);
            }
        }
        if effects.len() > 2 {
            return;
        }
        let read = |effect: &usize| {
            direct.effects.iter().find(|found| found.effect == *effect).map_or(0.0, |found| found.gain)
        };
        // An effect that the filter sees and a direct channel too has both for it.
        let gain = search.gain(fit) + effects.iter().map(read).sum::<f64>();
        let weight = match effects.len() {
            0 => PRIOR_NONE.ln(),
            1 => (PRIOR_SINGLE / n).ln() + gain / TEMPERATURE,
            _ => {
                let forgiven = search.forgiven(&effects, &search.fits[fit]);
                (PRIOR_PAIR / (n * (n - 1.0) / 2.0)).ln() + (gain - forgiven) / TEMPERATURE
            }
        };
        if all.iter().any(|other| same(&other.effects, &effects) && other.weight >= weight) {
            return;
        }
        all.retain(|other| !same(&other.effects, &effects));
        all.push(Hypothesis { effects, fit, direct: direct_effects.to_vec(), gain, regions: None, weight });
    };
    let read: Vec<usize> = direct.effects.iter().map(|found| found.effect).collect();
    for fit in 0..search.fits.len() {
        add(fit, &[]);
        for effect in &read {
            add(fit, &[*effect]);
        }
    }
    for (i, a) in direct.effects.iter().enumerate() {
        for b in direct.effects[i + 1..].iter().filter(|b| b.channel != a.channel) {
            add(0, &[a.effect, b.effect]);
        }
    }
    all
}

fn same(a: &[usize], b: &[usize]) -> bool {
    a.len() == b.len() && a.iter().all(|x| b.contains(x))
}

/// Hypotheses whose forms are looked at: those that others cannot overtake by form are left out.
const FORMS_WEIGHED: usize = 6;
/// A form may add this share of what its effect gains itself, and such a share of what is seen along its quantities.
const FORM_OF_GAIN: f64 = 0.35;
const FORM_BELIEVED: f64 = 0.9;

/// Adds to the leading hypotheses what their laws would gain in another form, and sorts all, best first.
fn weigh_forms(problem: &Problem<'_>, search: &Search, on_null: &Regions, hypotheses: &mut [Hypothesis]) {
    hypotheses.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let leading = hypotheses.len().min(FORMS_WEIGHED);
    let looked: Vec<Regions> = hypotheses[..leading]
        .par_iter()
        .map(|h| if h.fit == 0 { on_null.clone() } else { regions(problem, &search.fits[h.fit]) })
        .collect();
    for (h, found) in hypotheses.iter_mut().zip(looked) {
        let form = FORM_BELIEVED * found.form.min(FORM_OF_GAIN * h.gain.max(0.0));
        h.gain += form;
        h.weight += form / TEMPERATURE;
        h.regions = Some(found);
    }
    hypotheses.sort_by(|a, b| b.weight.total_cmp(&a.weight));
}

/// What no known law explains on top of a hypothesis, nats.
fn unexplained(best: &Hypothesis, fit: &Fit, on_null: &Regions, on_best: &Regions, direct: &Direct) -> f64 {
    let form = on_best.form.min(FORM_OF_GAIN * best.gain.max(0.0));
    let mut structure = on_best.ceiling - form;
    let mut wave = on_best.wave().1;
    if best.effects.iter().any(|effect| LIBRARY[*effect].name == "gusts") && fit.point.effects.len() == 1 {
        // Wind has no structure: what a law would have explained, no gust does.
        structure = structure.max(on_null.ceiling);
        wave = wave.max(on_null.wave().1 - 0.5 * best.gain);
    }
    let flight = structure.max(wave).max(0.7 * (structure + wave))
        - FORGIVEN_NATS
        - FORGIVEN_SHARE * best.gain.max(0.0);
    if direct.unexplained_pins > 0.0 { flight.max(0.0) + direct.unexplained_pins } else { flight }
}

fn candidates(search: &Search, direct: &Direct, hypotheses: Vec<Hypothesis>, left: f64) -> Vec<Candidate> {
    let gain = hypotheses[0].gain;
    let unknown = Candidate {
        effects: Vec::new(),
        name: "unknown".to_owned(),
        probability: 0.0,
        evidence_gain: gain + left,
        parameters: Vec::new(),
    };
    let mut weighed: Vec<(f64, Candidate)> =
        vec![(PRIOR_UNKNOWN.ln() + (gain + left) / TEMPERATURE, unknown)];
    weighed.extend(hypotheses.iter().map(|h| (h.weight, candidate(h, search, direct))));
    weighed.sort_by(|a, b| b.0.total_cmp(&a.0));
    let highest = weighed[0].0;
    let total: f64 = weighed.iter().map(|(weight, _)| (weight - highest).exp()).sum();
    weighed
        .into_iter()
        .map(|(weight, candidate)| Candidate { probability: (weight - highest).exp() / total, ..candidate })
        .filter(|candidate| candidate.probability > 1e-4 || candidate.effects.len() < 2)
        .collect()
}

fn candidate(h: &Hypothesis, search: &Search, direct: &Direct) -> Candidate {
    let effects: Vec<&'static str> = h.effects.iter().map(|index| LIBRARY[*index].name).collect();
    let fit = &search.fits[h.fit];
    let mut parameters: Vec<ParameterValue> = fit
        .effect_parameters(1.0)
        .map(|(slot, parameter, value, [low, high])| {
            let spec = LIBRARY[fit.point.effects[slot].0];
            let p = spec.parameters[parameter];
            ParameterValue { effect: spec.name, name: p.key, unit: p.unit, value, std: 0.5 * (high - low) }
        })
        .collect();
    for found in direct.effects.iter().filter(|found| h.direct.contains(&found.effect)) {
        let spec = LIBRARY[found.effect];
        parameters.retain(|p| p.effect != spec.name);
        parameters.extend(spec.parameters.iter().zip(&found.values).map(|(p, value)| ParameterValue {
            effect: spec.name,
            name: p.key,
            unit: p.unit,
            value: *value,
            std: (value * found.relative_sigma).abs(),
        }));
    }
    Candidate {
        name: if effects.is_empty() { "none".to_owned() } else { effects.join("+") },
        effects,
        probability: 0.0,
        evidence_gain: h.gain,
        parameters,
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
    let noise = best.full_noise(problem);
    let level = |point| {
        let pass = run(problem.tracks, problem.rig, point, &noise, &[]);
        (pass.nll / pass.innovations().count().max(1) as f64, k_step(&pass))
    };
    let right = run(problem.tracks, problem.rig, &best.point, &noise, &[]);
    let floor = right.innovations().map(|i| 0.5 + 0.5 * i.variance_m2.ln()).sum::<f64>()
        / right.innovations().count().max(1) as f64;
    let [nominal, parameters_only, with_effect] = [&problem.nominal, &null.point, &best.point].map(level);
    let above_floor = parameters_only.0 - floor;
    let closure = (!best.point.effects.is_empty() && above_floor > 0.0)
        .then(|| ((parameters_only.0 - with_effect.0) / above_floor).min(1.0));
    Gap {
        metric: "mean negative log-likelihood of a sighting, nats",
        nominal: nominal.0,
        parameters_only: parameters_only.0,
        with_effect: with_effect.0,
        floor,
        closure,
        held_out: false,
        k_step_m: KStep {
            nominal: nominal.1,
            parameters_only: parameters_only.1,
            with_effect: with_effect.1,
        },
    }
}

fn k_step(pass: &Pass) -> [Option<f64>; 3] {
    [0, 1, 2].map(|i| {
        let (sum, n) = pass
            .tracks
            .iter()
            .fold((0.0, 0), |(sum, n), track| (sum + track.predictions[i].0, n + track.predictions[i].1));
        (n > 0).then(|| (sum / f64::from(n)).sqrt())
    })
}

fn place(top: &Candidate, on_null: &Regions, on_best: &Regions, unexplained_pins: f64) -> Place {
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
    let stage = top
        .effects
        .first()
        .and_then(|name| LIBRARY.iter().find(|spec| spec.name == *name))
        .map(|spec| spec.stage)
        .map(Stage::name);
    Place {
        stage,
        regions: told,
        structure: on_null.ceiling,
        unexplained: on_best.ceiling - on_best.form,
        wave: on_best.wave(),
        wave_on_null: on_null.wave(),
        unexplained_pins,
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
    }
}
