//! The cushion of air takes time to build up and to leave.

use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage, lag::mean_decay};
use crate::nominal::{Air, Nominal};

/// The extra thrust of the ground effect lags its static value.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "ground-effect-dynamic",
    stage: Stage::Environment,
    summary: "the ground effect takes time to build up and to fade",
    law: "d extra/dt = (extra_nominal(z) - extra)/tau",
    source: "Pitt and Peters, Theoretical Prediction of Dynamic-Inflow Derivatives, Vertica 5(1), 1981: inflow as a first-order state",
    parameters: &[Parameter {
        key: "time_constant_s",
        unit: "s",
        meaning: "time constant of the extra thrust",
        min: 0.0,
        max: 5.0,
        prior: Prior::LogNormal { median: 0.15, sigma_ln: 0.9 },
        neutral: Some(0.0),
    }],
    build,
};

fn build(values: &[f64], rig: &Rig, _: EffectRng) -> Box<dyn Effect> {
    Box::new(GroundEffectDynamic {
        nominal: Nominal::new(&rig.airframe),
        time_constant_s: values[0],
        previous: None,
        ahead: 0.0,
        mean_ahead: 0.0,
        path_mean: 0.0,
        stiffness: 0.0,
    })
}

/// Kept as what the lagged value is ahead of the static one, `d' = -d/tau - s'`, which is exact for a static value `s`
/// that changes evenly over a step, and adds to any static shape.
struct GroundEffectDynamic {
    nominal: Nominal,
    time_constant_s: f64,
    /// Static value at the beginning of the previous step and that step's length.
    previous: Option<(f64, f64)>,
    /// Lagged value less the static one, at the beginning of the present step.
    ahead: f64,
    /// The same, mean over the present step if the airframe keeps its speed.
    mean_ahead: f64,
    /// Static value, mean over the present step if the airframe keeps its speed.
    path_mean: f64,
    /// How little the lagged value follows when the airframe leaves that path, as it does when it accelerates: one for
    /// steps far shorter than the time constant, zero for steps far longer.
    stiffness: f64,
}

impl GroundEffectDynamic {
    /// `d` tends to this while the static value goes from `before` to `after` in `dt_s`.
    fn settled(&self, before: f64, after: f64, dt_s: f64) -> f64 {
        -(after - before) / dt_s * self.time_constant_s
    }
}

impl Effect for GroundEffectDynamic {
    fn advance(&mut self, dt_s: f64, air: &Air) {
        let now = self.nominal.ground_effect(air.height_m);
        // The step that has just ended, now that its end is known.
        if let Some((before, step_s)) = self.previous.replace((now, dt_s)) {
            let settled = self.settled(before, now, step_s);
            self.ahead = settled + (self.ahead - settled) * (-step_s / self.time_constant_s).exp();
        }
        // The step that begins, as far as the present speed tells.
        let next = self.nominal.ground_effect(air.height_m + air.velocity_m_s.z * dt_s);
        let settled = self.settled(now, next, dt_s);
        let ratio = dt_s / self.time_constant_s;
        let decay = mean_decay(ratio);
        self.mean_ahead = settled + (self.ahead - settled) * decay;
        self.path_mean = 0.5 * (now + next);
        self.stiffness = 2.0 * (1.0 - decay) / ratio;
    }

    fn ground_effect(&self, air: &Air, ground_effect: &mut f64) {
        let off_path = self.nominal.ground_effect(air.height_m) - self.path_mean;
        *ground_effect += self.mean_ahead - self.stiffness * off_path;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{air, effect};

    #[test]
    fn rising_evenly_the_lagged_value_is_ahead_by_rate_times_time_constant_and_then_fades() {
        let mut lag = effect("ground-effect-dynamic", &[0.02]);
        let mut extra_at = |height_m: f64, speed_m_s: f64| {
            lag.advance(0.01, &air(height_m, speed_m_s));
            let mut extra = 0.0;
            // In the middle of the step the airframe is where it is on average.
            lag.ground_effect(&air(height_m + 0.005 * speed_m_s, speed_m_s), &mut extra);
            extra
        };
        // 0.2 m/s up through 0.3 per 5 cm: the static value falls by 1.2/s, the lagged one follows 0.024 above.
        let mut ahead = 0.0;
        for step in 0..20 {
            ahead = extra_at(0.002 * f64::from(step), 0.2);
        }
        let settling = (-19.5_f64 * 0.5).exp();
        assert!((ahead - 0.024).abs() < 0.024 * 2.0 * settling, "{ahead}");
        // Held at rest it fades to 1/e in two steps.
        let first = extra_at(0.04, 0.0);
        let second = extra_at(0.04, 0.0);
        let third = extra_at(0.04, 0.0);
        assert!((third / first - (-1.0_f64).exp()).abs() < 1e-9 && second > third);
    }
}
