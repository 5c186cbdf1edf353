//! What is planted in flights: the mix of `docs/results/diagnosis.md`, which `tools/diagnosis` draws.

use bench_plant::effects::{EffectSpec, LIBRARY, Parameter, Prior};
use bench_rig::{EffectEntry, Location, Rig};
use rand::{Rng, RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::{FIRST_WITH_CAUSES, log_uniform, numbers::MIX};

/// The effects of each case. Every effect comes alone as often as any other, one more at most.
/// Those that the rig has are part of its model, and no causes.
pub fn planned(rig: &Rig, cases: usize) -> Vec<Vec<EffectEntry>> {
    let mut rng = ChaCha8Rng::seed_from_u64(FIRST_WITH_CAUSES);
    let known = |name: &str| rig.effects.iter().any(|effect| effect.name == name);
    let mut library: Vec<&EffectSpec> =
        LIBRARY.iter().copied().filter(|spec| is_seen(spec.name) && !known(spec.name)).collect();
    let [none, single] = MIX.parts.none_and_single(cases);
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

/// Whether flights of the mix can show an effect.
fn is_seen(effect: &str) -> bool {
    MIX.never_seen.iter().all(|never| never != effect)
}

/// An effect, from invisible to plain.
fn drawn(rng: &mut impl Rng, spec: &EffectSpec) -> EffectEntry {
    let parameters = spec.parameters.iter().map(|parameter| {
        let value = if parameter.default.is_some() {
            form(rng, parameter.prior)
        } else {
            size(rng, spec.name, parameter)
        };
        let most = if parameter.key == "low_thrust_to_weight" {
            MIX.thrust_to_weight.most_floor
        } else {
            parameter.max
        };
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
fn size(rng: &mut impl Rng, effect: &str, parameter: &Parameter) -> f64 {
    let sizes = &MIX.size;
    let (median, sigma_ln) = match parameter.prior {
        Prior::Normal { mean, sigma } => {
            let sign = if rng.random() { 1.0 } else { -1.0 };
            return parameter.neutral.unwrap_or(mean) + sign * sigma * log_uniform(rng, sizes.normal);
        }
        Prior::LogNormal { median, sigma_ln } => (median, sigma_ln),
    };
    let at = |deviations: f64| median * (sigma_ln * deviations).exp();
    match parameter.neutral {
        // What only shapes the effect.
        None => log_uniform(rng, sizes.shape.map(at)),
        Some(0.0) => {
            let [least, most] = sizes.zero.map(at);
            let least = if effect == "gusts" {
                MIX.ordinary_air.sigma_m_s[1]
            } else {
                least.min(median / sizes.least_is_median_over)
            };
            log_uniform(rng, [least, most])
        }
        // A limit, which is stronger the lower it is.
        Some(neutral) if (neutral / median).ln().abs() > sizes.limit * sigma_ln => {
            log_uniform(rng, [MIX.thrust_to_weight.least_ceiling, at(sizes.limit)])
        }
        Some(neutral) => {
            let plain = log_uniform(rng, sizes.other.map(at));
            neutral * (plain / neutral).powf(log_uniform(rng, sizes.share_of_other))
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
                assert!(key != "low_thrust_to_weight" || *value <= MIX.thrust_to_weight.most_floor);
                assert!(key != "high_thrust_to_weight" || *value >= MIX.thrust_to_weight.least_ceiling);
            }
        }
    }

    #[test]
    fn effects_of_the_rig_are_no_causes() {
        let mut rig = rig();
        rig.effects.push(parse_effect("mass-change:fraction=0.05").unwrap());
        assert!(planned(&rig, 300).iter().flatten().all(|effect| effect.name != "mass-change"));
        for spec in LIBRARY.iter().filter(|spec| is_seen(spec.name)) {
            rig.effects.push(parse_effect(&spec.example()).unwrap());
        }
        assert!(planned(&rig, 300).iter().all(Vec::is_empty));
    }
}
