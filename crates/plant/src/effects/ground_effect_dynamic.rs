//! The cushion of air takes time to build up and to leave.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, lag::mean_decay};
use crate::nominal::{Air, Nominal};

/// The extra thrust of the ground effect lags its static value.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "ground-effect-dynamic",
    stage: Stage::Environment,
    summary: "the ground effect takes time to build up and to fade",
    law: "d extra/dt = (extra_nominal(z) - extra)/tau; tau sqrt(r) going up, tau/sqrt(r) coming down",
    source: "Pitt and Peters, Theoretical Prediction of Dynamic-Inflow Derivatives, Vertica 5(1), 1981: inflow as a first-order state",
    parameters: &[
        Parameter {
            key: "time_constant_s",
            unit: "s",
            meaning: "time constant of the extra thrust",
            min: 0.0,
            max: 5.0,
            prior: Prior::LogNormal { median: 0.15, sigma_ln: 0.9 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "fade_ratio",
            unit: "1",
            meaning: "time constant of fading over that of building up",
            min: 0.1,
            max: 10.0,
            prior: Prior::LogNormal { median: 1.0, sigma_ln: 0.75 },
            neutral: None,
            default: Some(1.0),
        },
        Parameter {
            key: "second_share",
            unit: "1",
            meaning: "share of the time constant that is a second lag, behind the first",
            min: 0.0,
            max: 0.45,
            prior: Prior::Normal { mean: 0.0, sigma: 0.2 },
            neutral: None,
            default: Some(0.0),
        },
    ],
    signature: Signature { axes: &[Axis::Altitude, Axis::Speed, Axis::Past], ..Signature::LAW },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let [time_constant_s, fade_ratio, second_share] = [values[0], values[1], values[2]];
    // Two lags in series are the weighted difference of two alone (partial fractions).
    let cushion = |share: f64, weight: f64| Cushion {
        time_constants_s: [fade_ratio.sqrt().recip(), fade_ratio.sqrt()].map(|r| time_constant_s * share * r),
        weight,
        ..Cushion::default()
    };
    let beyond = second_share / (1.0 - 2.0 * second_share);
    let mut cushions = vec![cushion(1.0 - second_share, 1.0 + beyond)];
    if second_share > 0.0 {
        cushions.push(cushion(second_share, -beyond));
    }
    Box::new(GroundEffectDynamic {
        nominal: Nominal::new(airframe),
        cushions,
        previous: None,
        path_mean: 0.0,
    })
}

/// Kept as what the lagged value is ahead of the static one, `d' = -d/tau - s'`, which is exact for a static value `s`
/// that changes evenly over a step, and adds to any static shape.
struct GroundEffectDynamic {
    nominal: Nominal,
    cushions: Vec<Cushion>,
    /// Static value at the beginning of the previous step and that step's length.
    previous: Option<(f64, f64)>,
    /// Static value, mean over the present step if the airframe keeps its speed.
    path_mean: f64,
}

/// A cushion with one time constant each way.
#[derive(Clone, Copy, Default)]
struct Cushion {
    /// Of building up and of fading.
    time_constants_s: [f64; 2],
    weight: f64,
    /// Lagged value less the static one, at the beginning of the present step.
    ahead: f64,
    /// The same, mean over the present step if the airframe keeps its speed.
    mean_ahead: f64,
    /// How little the lagged value follows when the airframe leaves that path, as it does when it accelerates: one for
    /// steps far shorter than the time constant, zero for steps far longer.
    stiffness: f64,
}

impl Cushion {
    /// The step that has just ended, now that its end is known.
    fn end(&mut self, slope_per_s: f64, dt_s: f64, fades: bool) {
        let time_constant_s = self.time_constants_s[usize::from(fades)];
        // It tends to this while the static value changes evenly.
        let settled = -slope_per_s * time_constant_s;
        self.ahead = settled + (self.ahead - settled) * (-dt_s / time_constant_s).exp();
    }

    /// The step that begins, as far as the present speed tells.
    fn begin(&mut self, slope_per_s: f64, dt_s: f64, fades: bool) {
        let time_constant_s = self.time_constants_s[usize::from(fades)];
        let settled = -slope_per_s * time_constant_s;
        let ratio = dt_s / time_constant_s;
        let decay = mean_decay(ratio);
        self.mean_ahead = settled + (self.ahead - settled) * decay;
        self.stiffness = 2.0 * (1.0 - decay) / ratio;
    }
}

impl GroundEffectDynamic {
    fn sum(&self, of: impl Fn(&Cushion) -> f64) -> f64 {
        self.cushions.iter().map(|cushion| cushion.weight * of(cushion)).sum()
    }

    /// Whether the cushion is stronger than it would be at rest, or about to be.
    fn fades(&self, slope_per_s: f64) -> bool {
        let ahead = self.sum(|cushion| cushion.ahead);
        ahead > 0.0 || ahead == 0.0 && slope_per_s < 0.0
    }
}

impl Effect for GroundEffectDynamic {
    fn advance(&mut self, dt_s: f64, air: &Air) {
        let now = self.nominal.ground_effect(air.height_m);
        if let Some((before, step_s)) = self.previous.replace((now, dt_s)) {
            let slope_per_s = (now - before) / step_s;
            let fades = self.fades(slope_per_s);
            for cushion in &mut self.cushions {
                cushion.end(slope_per_s, step_s, fades);
            }
        }
        let next = self.nominal.ground_effect(air.height_m + air.velocity_m_s.z * dt_s);
        let slope_per_s = (next - now) / dt_s;
        let fades = self.fades(slope_per_s);
        for cushion in &mut self.cushions {
            cushion.begin(slope_per_s, dt_s, fades);
        }
        self.path_mean = 0.5 * (now + next);
    }

    fn ground_effect(&self, air: &Air, ground_effect: &mut f64) {
        let off_path = self.nominal.ground_effect(air.height_m) - self.path_mean;
        *ground_effect += self.sum(|cushion| cushion.mean_ahead - cushion.stiffness * off_path);
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        effects::testing::{air, effect, rig},
        nominal::Nominal,
    };

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

    #[test]
    fn the_cushion_may_fade_later_than_it_builds_up_and_through_two_stages() {
        // Up and down between ground and free air, long enough to settle; what it has of the whole after 0.1 s.
        let part = |values: &[f64], fading: bool| {
            let mut dynamic = effect("ground-effect-dynamic", values);
            let nominal = Nominal::new(&rig().airframe);
            let whole = nominal.ground_effect(0.0);
            let (from_m, to_m) = if fading { (0.0, 1.0) } else { (1.0, 0.0) };
            let mut extra = 0.0;
            for step in 0..3100 {
                let height_m = if step < 3000 { from_m } else { to_m };
                let air = air(height_m, 0.0);
                dynamic.advance(1e-3, &air);
                extra = nominal.ground_effect(height_m);
                dynamic.ground_effect(&air, &mut extra);
            }
            extra / whole
        };
        let left = (-1.0_f64).exp();
        // 0.1 s up and 0.4 s down; values are means of the last of 100 steps.
        assert!((part(&[0.2, 4.0], false) - (1.0 - left)).abs() < 0.01);
        assert!((part(&[0.2, 4.0], true) - (-0.25_f64).exp()).abs() < 0.01);
        // 60 and 40 ms in series.
        let (a, b): (f64, f64) = (0.06, 0.04);
        let still = (a * (-0.1 / a).exp() - b * (-0.1 / b).exp()) / (a - b);
        assert!((part(&[0.1, 1.0, 0.4], true) - still).abs() < 0.015);
    }
}
