//! What a calibration plants in flights: the mix of `docs/results/diagnosis.md`, which `tools/diagnosis` draws.

use bench_plant::effects::{EffectSpec, LIBRARY, Parameter, Prior, Shows, Spread};
use bench_rig::{EffectEntry, Location, Rig};
use rand::{Rng, RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::{FIRST_WITH_CAUSES, TURBULENCE_M_S, log_uniform};

/// Shares of the cases; the rest have two effects.
const NONE_SHARE: f64 = 0.25;
const SINGLE_SHARE: f64 = 7.0 / 12.0;
/// Below this thrust to weight nothing takes off, and above that nothing comes down: there is no flight to diagnose.
const LEAST_THRUST_TO_WEIGHT: f64 = 1.03;
const MOST_FLOOR_TO_WEIGHT: f64 = 0.97;

/// The effects of each case: a quarter have none, a sixth two. Every effect comes alone as often as any other, one more at most.
/// Those that the rig has are part of its model, and no causes.
pub fn planned(rig: &Rig, cases: usize) -> Vec<Vec<EffectEntry>> {
    let mut rng = ChaCha8Rng::seed_from_u64(FIRST_WITH_CAUSES);
    let known = |name: &str| rig.effects.iter().any(|effect| effect.name == name);
    // Vertical flights never tilt.
    let shown = |spec: &EffectSpec| spec.signature.shows != Shows::LawWhenTilted;
    let mut library: Vec<&EffectSpec> =
        LIBRARY.iter().copied().filter(|spec| shown(spec) && !known(spec.name)).collect();
    let share = |share: f64| (share * cases as f64).round() as usize;
    let (none, single) = (share(NONE_SHARE), share(SINGLE_SHARE));
    let mut causes: Vec<Vec<&EffectSpec>> = vec![Vec::new(); none];
    let mut turn: Vec<&EffectSpec> = Vec::new();
    for _ in 0..single {
        if turn.is_empty() {
            turn.clone_from(&library);
            turn.shuffle(&mut rng);
        }
        causes.push(turn.pop().into_iter().collect());
    }
    while causes.len() < cases {
        library.shuffle(&mut rng);
        causes.push(library.iter().take(2).copied().collect());
    }
    causes.into_iter().map(|specs| specs.into_iter().map(|spec| drawn(&mut rng, spec)).collect()).collect()
}

/// An effect, from invisible to plain.
fn drawn(rng: &mut impl Rng, spec: &EffectSpec) -> EffectEntry {
    let parameters = spec.parameters.iter().map(|parameter| {
        let value =
            if parameter.default.is_some() { form(rng, parameter.prior) } else { size(rng, spec, parameter) };
        let most = if parameter.key == "low_thrust_to_weight" { MOST_FLOOR_TO_WEIGHT } else { parameter.max };
        (parameter.key.to_owned(), value.clamp(parameter.min, most), 0)
    });
    EffectEntry {
        name: spec.name.to_owned(),
        parameters: parameters.collect(),
        at: Location { file: "calibration".into(), line: 0 },
    }
}

/// A form is drawn as likely as it is thought to be.
fn form(rng: &mut impl Rng, prior: Prior) -> f64 {
    let deviations: f64 = rng.sample(StandardNormal);
    match prior {
        Prior::Normal { mean, sigma } => mean + sigma * deviations,
        Prior::LogNormal { median, sigma_ln } => median * (sigma_ln * deviations).exp(),
    }
}

/// A size is drawn evenly in the logarithm.
fn size(rng: &mut impl Rng, spec: &EffectSpec, parameter: &Parameter) -> f64 {
    let (median, sigma_ln) = match parameter.prior {
        Prior::Normal { mean, sigma } => {
            let sign = if rng.random() { 1.0 } else { -1.0 };
            return parameter.neutral.unwrap_or(mean) + sign * sigma * log_uniform(rng, 0.1, 2.5);
        }
        Prior::LogNormal { median, sigma_ln } => (median, sigma_ln),
    };
    let at = |deviations: f64| median * (sigma_ln * deviations).exp();
    match parameter.neutral {
        // What only shapes the effect.
        None => log_uniform(rng, at(-1.0), at(1.0)),
        Some(0.0) => {
            // Every flight has some wind: a cause is more than that.
            let blows = spec.signature.shows == Shows::Spread(Spread::Turbulence);
            let least = if blows { TURBULENCE_M_S.1 } else { at(-2.0).min(median / 10.0) };
            log_uniform(rng, least, at(1.5))
        }
        // A limit, which is stronger the lower it is.
        Some(neutral) if (neutral / median).ln().abs() > 2.0 * sigma_ln => {
            log_uniform(rng, LEAST_THRUST_TO_WEIGHT, at(2.0))
        }
        Some(neutral) => {
            let plain = log_uniform(rng, at(-1.5), at(1.5));
            neutral * (plain / neutral).powf(log_uniform(rng, 0.1, 1.0))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::HashMap, path::Path};

    use bench_plant::effects::{parse_effect, resolve_all};

    use super::*;

    fn rig() -> Rig {
        Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
    }

    #[test]
    fn causes_come_in_the_mix_of_the_results() {
        let cases = planned(&rig(), 300);
        let with = |effects: usize| cases.iter().filter(|case| case.len() == effects).count();
        assert_eq!([with(0), with(1), with(2)], [75, 175, 50]);
        let mut alone: HashMap<&str, usize> = HashMap::new();
        for case in cases.iter().filter(|case| case.len() == 1) {
            *alone.entry(&case[0].name).or_default() += 1;
        }
        assert_eq!(alone.len(), LIBRARY.len() - 1);
        assert!(alone.values().all(|times| *times == 7), "{alone:?}");
        assert!(cases.iter().filter(|case| case.len() == 2).all(|case| case[0].name != case[1].name));
        assert_eq!(planned(&rig(), 300), cases);
    }

    #[test]
    fn what_is_drawn_can_be_flown() {
        for case in planned(&rig(), 3000) {
            resolve_all(&case).unwrap();
            for (key, value, _) in case.iter().flat_map(|effect| &effect.parameters) {
                assert!(key != "low_thrust_to_weight" || *value <= MOST_FLOOR_TO_WEIGHT);
                assert!(key != "high_thrust_to_weight" || *value >= LEAST_THRUST_TO_WEIGHT);
            }
        }
    }

    #[test]
    fn effects_of_the_rig_are_no_causes() {
        let mut rig = rig();
        rig.effects.push(parse_effect("mass-change:fraction=0.05").unwrap());
        assert!(planned(&rig, 300).iter().flatten().all(|effect| effect.name != "mass-change"));
        for spec in LIBRARY.iter().filter(|spec| spec.signature.shows != Shows::LawWhenTilted) {
            rig.effects.push(parse_effect(&spec.example()).unwrap());
        }
        assert!(planned(&rig, 300).iter().all(Vec::is_empty));
    }
}
