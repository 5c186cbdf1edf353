//! The mix of cases as a file, which `tools/diagnosis` reads too: `mix.toml` says what each number means.

use std::sync::LazyLock;

use serde::Deserialize;

/// What is drawn for a case: effects, air, tolerances.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mix {
    pub never_seen: Vec<String>,
    pub most_deviations: f64,
    pub parts: Parts,
    pub ordinary_air: OrdinaryAir,
    pub thrust_to_weight: ThrustToWeight,
    pub size: Size,
}

/// Parts of the cases by their number of effects.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parts {
    none: u32,
    single: u32,
    pair: u32,
}

impl Parts {
    /// How many of so many cases have no effect, and how many one; the rest have two.
    pub fn none_and_single(&self, cases: usize) -> [usize; 2] {
        let all = f64::from(self.none + self.single + self.pair);
        [self.none, self.single].map(|part| (f64::from(part) / all * cases as f64).round() as usize)
    }
}

/// Air of a case without gusts among its effects: the least and the most.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OrdinaryAir {
    pub sigma_m_s: [f64; 2],
    pub correlation_time_s: [f64; 2],
}

/// Limits of thrust over weight within which there is a flight to diagnose.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ThrustToWeight {
    pub least_ceiling: f64,
    pub most_floor: f64,
}

/// Ends of what sizes are drawn between, in deviations of the prior but for the two that are named otherwise.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Size {
    pub normal: [f64; 2],
    pub shape: [f64; 2],
    pub zero: [f64; 2],
    pub least_is_median_over: f64,
    pub limit: f64,
    pub other: [f64; 2],
    pub share_of_other: [f64; 2],
}

/// The mix of `mix.toml`.
pub(super) static MIX: LazyLock<Mix> =
    LazyLock::new(|| toml::from_str(super::TEXT).expect("a test has read it"));

#[cfg(test)]
mod tests {
    use bench_plant::effects::{EffectSpec, LIBRARY, Shows, index_of};

    use super::*;

    #[test]
    fn the_file_can_be_drawn_from() {
        let mix: Mix = toml::from_str(super::super::TEXT).unwrap();
        let Size { normal, shape, zero, other, share_of_other, .. } = mix.size;
        let OrdinaryAir { sigma_m_s, correlation_time_s } = mix.ordinary_air;
        for [low, high] in [normal, share_of_other, sigma_m_s, correlation_time_s] {
            assert!(0.0 < low && low < high, "{low} to {high}");
        }
        for [low, high] in [shape, zero, other] {
            assert!(low < high, "{low} to {high}");
        }
        assert!(mix.thrust_to_weight.most_floor < 1.0 && mix.thrust_to_weight.least_ceiling > 1.0);
        assert!(mix.never_seen.iter().all(|effect| index_of(effect).is_some()), "{:?}", mix.never_seen);
        // The library says it too, of each effect.
        let level = |spec: &&&EffectSpec| spec.signature.shows == Shows::LawWhenTilted;
        assert!(
            LIBRARY.iter().filter(level).map(|spec| spec.name).eq(mix.never_seen.iter().map(String::as_str))
        );
        assert_eq!(mix.parts.none_and_single(240), [60, 140]);
    }
}
