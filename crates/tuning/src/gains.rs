//! The numbers that are tuned.

use bench_rig::{Control, Predictor, Rig};

/// One of the controller's numbers.
#[derive(Clone, Copy)]
pub(crate) struct Gain {
    /// Its key in a rig's `[control]`.
    pub(crate) key: &'static str,
    /// Where it is looked for.
    pub(crate) range: [f64; 2],
    slot: fn(&mut Control) -> &mut f64,
}

impl Gain {
    pub(crate) fn get(&self, control: &Control) -> f64 {
        let mut control = *control;
        *(self.slot)(&mut control)
    }

    pub(crate) fn set(&self, control: &mut Control, value: f64) {
        *(self.slot)(control) = value;
    }

    /// The value at a share of the range's logarithm, to three digits: more would be noise.
    pub(crate) fn at(&self, share: f64) -> f64 {
        let [low, high] = self.range;
        three_digits(low * (high / low).powf(share.clamp(0.0, 1.0))).clamp(low, high)
    }

    /// Where in the range's logarithm a value stands.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        ((value.clamp(low, high) / low).ln() / (high / low).ln()).clamp(0.0, 1.0)
    }
}

fn three_digits(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}

/// The tolerances know no disturbance that changes during a flight, and would have the observer look for none. Batteries sag,
/// though: with a third of this drift, two in five of the airframes of `bench laws` under `battery-load` leave 2 cm, with this
/// one in ten.
const LEAST_DRIFT: f64 = 0.02;

/// From an exposure to the middle of the throttle that answers it, s.
pub(crate) fn delay_s(rig: &Rig) -> f64 {
    rig.tracker.latency_s.value + 0.5 * rig.tracker.frame_period_s + rig.control_loop.period_s
}

/// Those of the altitude loop, its predictor among them. Ranges follow the delay, by which any loop's speed goes.
pub(crate) fn of_altitude(rig: &Rig) -> Vec<Gain> {
    let (d, frame_s) = (delay_s(rig), rig.tracker.frame_period_s);
    let gain = |key, range, slot| Gain { key, range, slot };
    let mut gains = vec![
        gain("position_gain_per_s", [0.05 / d, 0.8 / d], |c| &mut c.position_gain_per_s),
        gain("speed_gain_per_s", [0.05 / d, 1.6 / d], |c| &mut c.speed_gain_per_s),
    ];
    match rig.control.predictor {
        Predictor::Linear => gains.extend([
            gain("integral_gain_per_s2", [0.005 / (d * d), 0.5 / (d * d)], |c| &mut c.integral_gain_per_s2),
            gain("extrapolation_s", [0.3 * d, 2.0 * d], |c| &mut c.extrapolation_s),
            // Less than two frames tell no velocity.
            gain("velocity_window_s", [(2.05 * frame_s).min(0.9), (12.0 * frame_s).clamp(0.3, 1.0)], |c| {
                &mut c.velocity_window_s
            }),
        ]),
        Predictor::Model => gains.extend([
            gain("observer_white_m_s2_per_root_hz", [0.003, 1.0], |c| &mut c.observer.white_m_s2_per_root_hz),
            gain("observer_drift_m_s2_per_root_s", [LEAST_DRIFT, 1.0], |c| {
                &mut c.observer.drift_m_s2_per_root_s
            }),
        ]),
    }
    gains
}

/// Those of the lateral loop; its predictor is the altitude's.
pub(crate) fn of_lateral(rig: &Rig) -> Vec<Gain> {
    let d = delay_s(rig)
        + 2.0 * rig.airframe.stabiliser.damping_ratio / rig.airframe.stabiliser.natural_frequency_rad_s;
    let gain = |key, range, slot| Gain { key, range, slot };
    let mut gains = vec![
        gain("lateral_position_gain_per_s", [0.05 / d, 0.8 / d], |c: &mut Control| {
            &mut c.lateral_position_gain_per_s
        }),
        gain("lateral_speed_gain_per_s", [0.05 / d, 1.6 / d], |c| &mut c.lateral_speed_gain_per_s),
    ];
    if rig.control.predictor == Predictor::Linear {
        gains.push(gain("lateral_integral_gain_per_s2", [0.002 / (d * d), 0.2 / (d * d)], |c| {
            &mut c.lateral_integral_gain_per_s2
        }));
    }
    gains
}
