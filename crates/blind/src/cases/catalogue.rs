//! Every kind of case: what it is called, where it shows, and how it is drawn.
//!
//! Sizes are uniform in the logarithm, from what no one can see to what no one can miss; what can be seen in a drawn
//! case is computed, not guessed ([`crate::detect`]).

use std::ops::{Deref, DerefMut};

use bench_rig::Rig;

use super::{Fault, Parameter};
use crate::{
    physics::{
        actuator::{OutputFault, RadioFault, TwoPole},
        air::{Gust, Miss},
        airframe::{LaggedInflow, MomentumInflow, Payload, PowerDrag, RingVortex, WakeRamp},
        environment::{
            BellCeiling, ExponentialGround, ImageCeiling, ImageGround, Plume, Rising, SlowCushion,
            StickyCushion,
        },
        law::Law,
        outside::{
            Attraction, DeadBand, Fan, HangingLoad, HotMotor, HurriedStall, Layer, Leak, MissingMotor,
            Recirculation, Resonance, Tether, ThrustHysteresis,
        },
        propulsion::{
            AsymmetricRotor, FreshCell, LevellingCurve, PowerCurve, SecondOrderRotor, Shepherd, TwoPairs,
            WeakMotor, Worn,
        },
        timing::LoopFault,
        tracker::TrackerFault,
    },
    random::{Random, happens, log_uniform, sign, uniform},
};

/// What a kind needs to know of the rig.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    /// Sticks' range, in units of the sticks.
    pub range: f64,
    /// Throttle at rest.
    pub rest: f64,
    /// Nominal throttle that hovers.
    pub hover: f64,
    /// Units of the sticks for a thrust of the weight.
    pub per_weight: f64,
    /// The linear drag, N s/m.
    pub drag: f64,
    /// Ground effect's nominal gain at the ground, and height, m.
    pub ground: [f64; 2],
}

impl Scale {
    pub(crate) fn of(rig: &Rig) -> Self {
        let a = &rig.airframe;
        let weight_n = a.weight_n();
        Self {
            range: a.sticks.max - a.sticks.min,
            rest: a.sticks.min,
            hover: a.throttle_for(weight_n),
            per_weight: weight_n / a.thrust.gain_n_per_unit.value,
            drag: a.drag_n_s_per_m.value,
            ground: [a.ground_effect.multiplier.value - 1.0, a.ground_effect.height_m.value],
        }
    }

    /// Throttle of a nominal thrust-to-weight ratio.
    fn throttle(&self, thrust_to_weight: f64) -> f64 {
        self.hover + self.per_weight * (thrust_to_weight - 1.0)
    }
}

/// A drawn fault with what its key tells.
pub(crate) struct Made {
    pub fault: Fault,
    /// Its size in the unit of its kind.
    pub size: f64,
    /// The same in the words of the library, where the library has words for it.
    pub parameters: Vec<Parameter>,
}

impl Made {
    fn law(law: impl Law + 'static, size: f64) -> Self {
        Self::of(Fault::Law(Box::new(law)), size)
    }

    fn of(fault: Fault, size: f64) -> Self {
        Self { fault, size, parameters: Vec::new() }
    }

    fn with(mut self, name: &'static str, value: f64) -> Self {
        self.parameters.push(Parameter { effect: String::new(), name: name.to_owned(), value });
        self
    }
}

/// What a flight of half a minute draws, in minutes of hover: losses are told as their mean over it.
const FLIGHT_MIN: f64 = 0.45;

/// Random numbers of one case, in which the size may be chosen instead of drawn.
pub(crate) struct Draw<'a> {
    random: &'a mut Random,
    /// Place of the size between the smallest (0) and the largest (1), on a logarithmic scale; drawn without one.
    at: Option<f64>,
}

impl<'a> Draw<'a> {
    pub(crate) fn any(random: &'a mut Random) -> Self {
        Self { random, at: None }
    }

    pub(crate) fn of_size(random: &'a mut Random, at: f64) -> Self {
        Self { random, at: Some(at) }
    }

    /// A size, uniform in the logarithm; all else that is drawn is the same whether it is chosen or not.
    fn size(&mut self, smallest: f64, largest: f64) -> f64 {
        let drawn = log_uniform(self.random, smallest, largest);
        self.at.map_or(drawn, |at| smallest * (largest / smallest).powf(at))
    }
}

impl Deref for Draw<'_> {
    type Target = Random;

    fn deref(&self) -> &Random {
        self.random
    }
}

impl DerefMut for Draw<'_> {
    fn deref_mut(&mut self) -> &mut Random {
        self.random
    }
}

/// A kind of case.
pub(crate) struct Kind {
    /// The foreign form's own name.
    pub form: &'static str,
    /// The library's name of the effect; empty for what is outside of it.
    pub effect: &'static str,
    /// What `size` is, with its unit.
    pub size_of: &'static str,
    pub stage: &'static str,
    /// Axes along which it shows; empty where none can be told.
    pub regions: &'static [&'static str],
    /// Kept for a seal whose scores are published.
    pub reserved: bool,
    pub make: fn(&mut Draw<'_>, &Scale) -> Made,
}

impl Kind {
    /// Whether a smaller size is the stronger effect: a limit bites the more, the lower it is.
    pub(crate) fn is_stronger_when_small(&self) -> bool {
        self.effect == "actuator-saturation"
    }
}

const fn known(
    effect: &'static str,
    form: &'static str,
    [size_of, stage]: [&'static str; 2],
    regions: &'static [&'static str],
    make: fn(&mut Draw<'_>, &Scale) -> Made,
) -> Kind {
    Kind { form, effect, size_of, stage, regions, reserved: false, make }
}

const fn outside(
    form: &'static str,
    [size_of, stage]: [&'static str; 2],
    regions: &'static [&'static str],
    make: fn(&mut Draw<'_>, &Scale) -> Made,
) -> Kind {
    Kind { form, effect: "", size_of, stage, regions, reserved: false, make }
}

const fn reserved(kind: &Kind) -> Kind {
    Kind { reserved: true, ..*kind }
}

/// All kinds.
pub(crate) const KINDS: &[Kind] = &[
    // Tracker
    known("tracker-latency", "late-frames", ["extra latency, s", "tracker"], &[], |r, _| {
        let extra_s = r.size(0.004, 0.15);
        Made::of(Fault::Tracker(TrackerFault::Late { extra_s }), extra_s).with("extra_s", extra_s)
    }),
    known("tracker-latency", "beating-clocks", ["mean extra latency, s", "tracker"], &[], |r, _| {
        let mean_s = r.size(0.0015, 0.08);
        // The beat alone must stay below half a frame, or it would be jitter.
        let frames = uniform(r, 200.0, 500.0);
        let fault = TrackerFault::Beat { mean_s, frames };
        Made::of(Fault::Tracker(fault), mean_s).with("extra_s", mean_s)
    }),
    known("tracker-jitter", "queue", ["deviation of the wait, s", "tracker"], &[], |r, _| {
        let (mean_s, shape) = (r.size(0.0002, 0.03), uniform(r, 1.5, 3.0));
        let sigma_s = mean_s / shape.sqrt();
        Made::of(Fault::Tracker(TrackerFault::Queue { mean_s, shape }), sigma_s).with("sigma_s", sigma_s)
    }),
    known("tracker-jitter", "held-up-frames", ["deviation of the wait, s", "tracker"], &[], |r, _| {
        let (probability, wait_s) = (uniform(r, 0.1, 0.4), r.size(0.0004, 0.06));
        let sigma_s = wait_s * (probability * (1.0 - probability)).sqrt();
        let fault = TrackerFault::HeldUp { probability, wait_s };
        Made::of(Fault::Tracker(fault), sigma_s).with("sigma_s", sigma_s)
    }),
    known("tracker-scale", "scale", ["scale error, 1", "tracker"], &["altitude"], |r, _| {
        let error = sign(r) * r.size(0.002, 0.12);
        let bias_m = sign(r) * r.size(0.0005, 0.015);
        Made::of(Fault::Tracker(TrackerFault::Scale { error, bias_m }), error)
            .with("scale_error", error)
            .with("bias_m", bias_m)
    }),
    known("tracker-scale", "bent-lens", ["scale error, 1", "tracker"], &["altitude"], |r, _| {
        let error = sign(r) * r.size(0.002, 0.12);
        let bias_m = sign(r) * r.size(0.0005, 0.01);
        let fault = TrackerFault::Lens { error, bias_m, bend_per_m: 0.15 * error };
        Made::of(Fault::Tracker(fault), error).with("scale_error", error)
    }),
    known("tracker-noise", "heavy-tails", ["noise, m", "tracker"], &[], |r, _| {
        let sigma_m = r.size(0.0004, 0.012);
        Made::of(Fault::Tracker(TrackerFault::HeavyTails { sigma_m }), sigma_m).with("sigma_m", sigma_m)
    }),
    known("tracker-noise", "wandering-mark", ["noise, m", "tracker"], &[], |r, _| {
        let (sigma_m, frames) = (r.size(0.0004, 0.012), uniform(r, 0.4, 1.5));
        let fault = TrackerFault::Wander { sigma_m, frames };
        Made::of(Fault::Tracker(fault), sigma_m).with("sigma_m", sigma_m)
    }),
    known("tracker-dropout", "bursts", ["share of frames, 1", "tracker"], &[], |r, _| {
        let (probability, mean_frames) = (r.size(0.0005, 0.15), uniform(r, 2.0, 8.0));
        Made::of(Fault::Tracker(TrackerFault::Bursts { probability, mean_frames }), probability)
            .with("probability", probability)
            .with("mean_burst_frames", mean_frames)
    }),
    known("tracker-dropout", "occlusions", ["share of frames, 1", "tracker"], &[], |r, _| {
        let (probability, mean_frames) = (r.size(0.001, 0.15), uniform(r, 3.0, 10.0));
        Made::of(Fault::Tracker(TrackerFault::Occlusions { probability, mean_frames }), probability)
            .with("probability", probability)
            .with("mean_burst_frames", mean_frames)
    }),
    known("tracker-outliers", "strays", ["share of frames, 1", "tracker"], &[], |r, _| {
        let (probability, sigma_m) = (r.size(0.0002, 0.04), log_uniform(r, 0.012, 0.25));
        Made::of(Fault::Tracker(TrackerFault::Strays { probability, sigma_m }), probability)
            .with("probability", probability)
            .with("sigma_m", sigma_m)
    }),
    known("tracker-outliers", "wrong-mark", ["share of frames, 1", "tracker"], &[], |r, _| {
        let (probability, offset_m) = (r.size(0.0002, 0.04), sign(r) * log_uniform(r, 0.012, 0.25));
        Made::of(Fault::Tracker(TrackerFault::WrongMark { probability, offset_m }), probability)
            .with("probability", probability)
    }),
    // Loop
    known("loop-overrun", "long-tail", ["share of iterations, 1", "loop"], &[], |r, _| {
        let (probability, mean_s) = (r.size(0.001, 0.2), log_uniform(r, 0.004, 0.06));
        Made::of(Fault::Loop(LoopFault::LongTail { probability, mean_s }), probability)
            .with("probability", probability)
            .with("mean_s", mean_s)
    }),
    known("loop-overrun", "collector", ["pause, s", "loop"], &[], |r, _| {
        let (every, pause_s) = (uniform(r, 5.0, 50.0).round(), r.size(0.0005, 0.09));
        Made::of(Fault::Loop(LoopFault::Collector { every, pause_s }), pause_s)
            .with("probability", 1.0 / every)
            .with("mean_s", pause_s)
    }),
    // Actuator
    known("actuator-lag", "radio-delay", ["delay, s", "actuator"], &["lagged-throttle"], |r, _| {
        let delay_s = r.size(0.0018, 0.15);
        Made::of(Fault::Radio(RadioFault::Delay { delay_s }), delay_s).with("time_constant_s", delay_s)
    }),
    known("actuator-lag", "radio-frames", ["mean delay, s", "actuator"], &["lagged-throttle"], |r, _| {
        let period_s = r.size(0.0022, 0.12);
        let fault = RadioFault::Frames { period_s, phase_s: uniform(r, 0.0, period_s) };
        Made::of(Fault::Radio(fault), period_s).with("time_constant_s", period_s)
    }),
    known(
        "actuator-lag",
        "two-pole",
        ["sum of time constants, s", "actuator"],
        &["lagged-throttle"],
        |r, s| {
            let total_s = r.size(0.0025, 0.2);
            Made::law(TwoPole { pole_s: 0.5 * total_s, rest: s.rest }, total_s)
                .with("time_constant_s", total_s)
        },
    ),
    known(
        "actuator-saturation",
        "soft-limit",
        ["thrust to weight less one, 1", "actuator"],
        &["throttle"],
        |r, s| {
            let margin = r.size(0.04, 0.22);
            let fault = OutputFault::SoftLimit { level: s.throttle(1.0 + margin), softness: 0.004 * s.range };
            Made::of(Fault::Output(fault), margin).with("high_thrust_to_weight", 1.0 + margin)
        },
    ),
    known(
        "actuator-saturation",
        "falling-limit",
        ["thrust to weight less one, 1", "actuator"],
        &["throttle"],
        |r, s| {
            let margin = r.size(0.04, 0.22);
            let level = s.throttle(1.0 + margin);
            let fault = OutputFault::FallingLimit { level, fall_per_min: 0.002 * s.per_weight };
            Made::of(Fault::Output(fault), margin).with("high_thrust_to_weight", 1.0 + margin)
        },
    ),
    known("actuator-quantisation", "floor-steps", ["step over range, 1", "actuator"], &[], |r, s| {
        let fraction = r.size(0.0045, 0.03);
        Made::of(Fault::Output(OutputFault::Floor { step: fraction * s.range }), fraction)
            .with("step_fraction", fraction)
    }),
    known("actuator-quantisation", "uneven-steps", ["step over range, 1", "actuator"], &[], |r, s| {
        let fraction = r.size(0.0045, 0.03);
        Made::of(Fault::Output(OutputFault::Uneven { step: fraction * s.range }), fraction)
            .with("step_fraction", fraction)
    }),
    known("actuator-backlash", "stiction", ["play over range, 1", "actuator"], &[], |r, s| {
        let fraction = r.size(0.0025, 0.05);
        Made::of(Fault::Output(OutputFault::Stiction { width: fraction * s.range }), fraction)
            .with("width_fraction", fraction)
    }),
    known("actuator-backlash", "creeping-play", ["play over range, 1", "actuator"], &[], |r, s| {
        let fraction = r.size(0.0025, 0.05);
        let fault = OutputFault::CreepingPlay { width: fraction * s.range, creep: uniform(r, 0.0, 0.15) };
        Made::of(Fault::Output(fault), fraction).with("width_fraction", fraction)
    }),
    // Propulsion
    known("rotor-lag", "second-order", ["2 zeta / omega, s", "propulsion"], &["lagged-throttle"], |r, _| {
        let (lag_s, damping) = (r.size(0.0025, 0.2), uniform(r, 0.6, 1.4));
        let natural_rad_s = 2.0 * damping / lag_s;
        Made::law(SecondOrderRotor { natural_rad_s, damping }, lag_s).with("time_constant_s", lag_s)
    }),
    known(
        "rotor-lag",
        "asymmetric",
        ["mean time constant, s", "propulsion"],
        &["lagged-throttle"],
        |r, _| {
            let (lag_s, skew) = (r.size(0.0025, 0.2), uniform(r, 0.1, 0.6));
            let law = AsymmetricRotor { rise_s: lag_s * (1.0 - skew), fall_s: lag_s * (1.0 + skew) };
            Made::law(law, lag_s).with("time_constant_s", lag_s)
        },
    ),
    known("thrust-curve", "power", ["exponent less one, 1", "propulsion"], &["throttle"], |r, _| {
        let bend = r.size(0.012, 0.6);
        let bend = if happens(r, 0.7) { bend } else { -0.7 * bend };
        Made::law(PowerCurve { exponent: 1.0 + bend }, bend).with("curvature", bend)
    }),
    known("thrust-curve", "levelling", ["loss of slope at hover, 1", "propulsion"], &["throttle"], |r, _| {
        let knee = r.size(0.013, 1.0);
        let lost = knee / (1.0 + knee);
        Made::law(LevellingCurve { knee }, lost).with("curvature", -lost)
    }),
    known("thrust-loss", "worn", ["fraction of thrust, 1", "propulsion"], &[], |r, _| {
        let fraction = r.size(0.01, 0.18);
        Made::law(Worn { fraction }, fraction).with("fraction", fraction)
    }),
    known("thrust-loss", "weak-motor", ["fraction of thrust at hover, 1", "propulsion"], &[], |r, _| {
        let fraction = r.size(0.01, 0.18);
        Made::law(WeakMotor { fraction }, fraction).with("fraction", fraction)
    }),
    known(
        "battery-discharge",
        "shepherd",
        ["loss of thrust, 1/min", "propulsion"],
        &["charge", "time"],
        |r, _| {
            let (loss_per_min, full_min) = (r.size(0.003, 0.2), uniform(r, 1.5, 5.0));
            Made::law(Shepherd { loss_per_min, full_min }, loss_per_min)
                .with("loss_per_hover_minute", loss_per_min)
        },
    ),
    known(
        "battery-discharge",
        "fresh-cell",
        ["mean loss of thrust, 1/min", "propulsion"],
        &["charge", "time"],
        |r, _| {
            let (loss, zone_share, zone_min) =
                (r.size(0.003, 0.2), uniform(r, 0.2, 0.7), uniform(r, 0.1, 0.25));
            let zone = loss * FLIGHT_MIN * zone_share / (1.0 - (-FLIGHT_MIN / zone_min).exp());
            let law = FreshCell { zone, zone_min, slope_per_min: loss * (1.0 - zone_share) };
            Made::law(law, loss).with("loss_per_hover_minute", loss)
        },
    ),
    known(
        "battery-load",
        "two-pairs",
        ["loss of thrust in hover, 1", "propulsion"],
        &["lagged-throttle", "throttle", "time"],
        |r, _| {
            let (sag, fast_s, slow_s, fast_share) = (
                r.size(0.0025, 0.2),
                log_uniform(r, 0.15, 0.6),
                log_uniform(r, 1.0, 5.0),
                uniform(r, 0.3, 0.7),
            );
            let mean_s = fast_share * fast_s + (1.0 - fast_share) * slow_s;
            Made::law(TwoPairs { sag, fast_s, slow_s, fast_share }, sag)
                .with("sag", sag)
                .with("time_constant_s", mean_s)
        },
    ),
    // Environment
    known(
        "ground-effect-shape",
        "exponential",
        ["share of the other shape, 1", "environment"],
        &["altitude"],
        |r, s| {
            let (share, length) = (r.size(0.02, 1.0), uniform(r, 0.6, 2.2));
            let law = ExponentialGround { share, gain: s.ground[0], length_m: length * s.ground[1] };
            Made::law(law, share).with("blend", share).with("length_m", length * s.ground[1])
        },
    ),
    known(
        "ground-effect-shape",
        "image-rotor",
        ["share of the other shape, 1", "environment"],
        &["altitude"],
        |r, s| {
            let (share, radius) = (r.size(0.03, 1.0), uniform(r, 0.8, 3.5));
            Made::law(ImageGround { share, radius_m: radius * s.ground[1] }, share)
        },
    ),
    known("ground-effect-dynamic", "slow-cushion", ["delay, s", "environment"], &["altitude"], |r, _| {
        let delay_s = r.size(0.005, 0.4);
        Made::law(SlowCushion { delay_s }, delay_s).with("time_constant_s", delay_s)
    }),
    known(
        "ground-effect-dynamic",
        "sticky-cushion",
        ["mean time constant, s", "environment"],
        &["altitude"],
        |r, _| {
            let lag_s = r.size(0.005, 0.4);
            let law = StickyCushion { rise_s: 0.5 * lag_s, fall_s: 1.5 * lag_s };
            Made::law(law, lag_s).with("time_constant_s", lag_s)
        },
    ),
    known(
        "ceiling-effect",
        "image-ceiling",
        ["gain of thrust at the ceiling, 1", "environment"],
        &["altitude"],
        |r, _| {
            let (gain, ceiling_m) = (r.size(0.002, 0.35), uniform(r, 0.75, 1.15));
            let law = ImageCeiling { gain, ceiling_m, radius_m: uniform(r, 0.04, 0.12) };
            Made::law(law, gain).with("gain", gain).with("ceiling_m", ceiling_m)
        },
    ),
    known(
        "ceiling-effect",
        "bell-ceiling",
        ["gain of thrust at the ceiling, 1", "environment"],
        &["altitude"],
        |r, _| {
            let (gain, ceiling_m) = (r.size(0.002, 0.35), uniform(r, 0.75, 1.15));
            let law = BellCeiling { gain, ceiling_m, reach_m: uniform(r, 0.06, 0.2) };
            Made::law(law, gain).with("gain", gain).with("ceiling_m", ceiling_m)
        },
    ),
    known("gusts", "dryden", ["deviation of the wind, m/s", "environment"], &["time"], |r, _| {
        let (sigma_m_s, correlation_s) = (r.size(0.05, 1.0), log_uniform(r, 0.4, 2.5));
        Made::of(Fault::Gust(Gust::Dryden { sigma_m_s, correlation_s }), sigma_m_s)
            .with("sigma_m_s", sigma_m_s)
    }),
    known("gusts", "karman", ["deviation of the wind, m/s", "environment"], &["time"], |r, _| {
        let (sigma_m_s, correlation_s) = (r.size(0.05, 1.0), log_uniform(r, 0.4, 2.5));
        Made::of(Fault::Gust(Gust::Karman { sigma_m_s, correlation_s }), sigma_m_s)
            .with("sigma_m_s", sigma_m_s)
    }),
    known("gusts", "bumps", ["deviation of the wind, m/s", "environment"], &["time"], |r, _| {
        let (sigma_m_s, length_s) = (r.size(0.05, 1.0), log_uniform(r, 0.6, 3.0));
        Made::of(Fault::Gust(Gust::Bumps { sigma_m_s, length_s }), sigma_m_s).with("sigma_m_s", sigma_m_s)
    }),
    known("updraft", "rising-air", ["speed of the air, m/s", "environment"], &[], |r, _| {
        let speed_m_s = sign(r) * r.size(0.06, 1.2);
        Made::law(Rising { speed_m_s }, speed_m_s).with("speed_m_s", speed_m_s)
    }),
    known("updraft", "plume", ["speed of the air, m/s", "environment"], &["altitude"], |r, _| {
        let speed_m_s = sign(r) * r.size(0.06, 1.2);
        Made::law(Plume { speed_m_s, depth_m: uniform(r, 0.01, 0.06) }, speed_m_s)
            .with("speed_m_s", speed_m_s)
    }),
    // Airframe
    known("mass-change", "payload", ["mass over mass, 1", "airframe"], &[], |r, _| {
        let size = r.size(0.012, 0.16);
        let fraction = if happens(r, 0.75) { size } else { -0.6 * size };
        Made::law(Payload { fraction }, fraction).with("fraction", fraction)
    }),
    known(
        "quadratic-drag",
        "power-drag",
        ["drag at 1 m/s over linear drag, 1", "airframe"],
        &["speed"],
        |r, s| {
            let (ratio, exponent) = (r.size(0.06, 6.0), uniform(r, 1.7, 2.4));
            let at_1_m_s_n = ratio * s.drag;
            Made::law(PowerDrag { at_1_m_s_n, exponent }, ratio).with("coefficient_n_s2_per_m2", at_1_m_s_n)
        },
    ),
    known("descent-thrust-loss", "ring-vortex", ["loss of thrust, 1", "airframe"], &["speed"], |r, _| {
        let (depth, centre_m_s) = (r.size(0.003, 0.35), uniform(r, 0.3, 0.7));
        let law = RingVortex { depth, centre_m_s, width_m_s: 0.55 * centre_m_s };
        Made::law(law, depth).with("fraction", depth)
    }),
    known("descent-thrust-loss", "wake-ramp", ["loss of thrust, 1", "airframe"], &["speed"], |r, _| {
        let (depth, onset_m_s) = (r.size(0.003, 0.35), uniform(r, 0.05, 0.25));
        let law = WakeRamp { depth, onset_m_s, full_m_s: onset_m_s + uniform(r, 0.3, 0.7) };
        Made::law(law, depth).with("fraction", depth)
    }),
    known("inflow-damping", "lagged-inflow", ["loss of thrust, s/m", "airframe"], &["speed"], |r, _| {
        let slope_s_per_m = r.size(0.008, 0.4);
        let law =
            LaggedInflow { slope_s_per_m, level_m_s: uniform(r, 0.8, 2.0), lag_s: uniform(r, 0.02, 0.06) };
        Made::law(law, slope_s_per_m).with("coefficient_s_per_m", slope_s_per_m)
    }),
    known("inflow-damping", "momentum-inflow", ["loss of thrust, s/m", "airframe"], &["speed"], |r, _| {
        let slope_s_per_m = r.size(0.008, 0.4);
        let law = MomentumInflow { slope_s_per_m, hover_m_s: uniform(r, 1.2, 2.5) };
        Made::law(law, slope_s_per_m).with("coefficient_s_per_m", slope_s_per_m)
    }),
    // Outside the library
    outside(
        "thrust-hysteresis",
        ["play over weight, 1", "propulsion"],
        &["throttle", "lagged-throttle"],
        |r, _| {
            let width = r.size(0.0015, 0.1);
            Made::law(ThrustHysteresis { width }, width)
        },
    ),
    outside(
        "hot-motor",
        ["loss of thrust when hot, 1", "propulsion"],
        &["time", "lagged-throttle", "charge"],
        |r, _| {
            let (fade, warm_up_s) = (r.size(0.003, 0.25), uniform(r, 4.0, 12.0));
            Made::law(HotMotor { fade, warm_up_s }, fade)
        },
    ),
    outside("resonance", ["share of thrust, 1", "airframe"], &["lagged-throttle"], |r, _| {
        let (share, hertz) = (r.size(0.008, 0.5), uniform(r, 0.8, 3.0));
        let law = Resonance {
            share,
            natural_rad_s: std::f64::consts::TAU * hertz,
            damping: uniform(r, 0.03, 0.12),
        };
        Made::law(law, share)
    }),
    outside("recirculation", ["loss of thrust, 1", "environment"], &["altitude", "time"], |r, _| {
        let (loss, build_up_s) = (r.size(0.006, 0.25), uniform(r, 0.8, 4.0));
        Made::law(Recirculation { loss, build_up_s, height_m: uniform(r, 0.12, 0.35) }, loss)
    }),
    outside("attraction", ["pull over weight, 1", "environment"], &["altitude"], |r, _| {
        let pull = sign(r) * r.size(0.001, 0.06);
        let law = Attraction { pull, height_m: uniform(r, 0.3, 0.8), reach_m: uniform(r, 0.04, 0.12) };
        Made::law(law, pull)
    }),
    outside("fan", ["pull over weight, 1", "environment"], &["time"], |r, _| {
        let (pull, frequency_hz) = (r.size(0.0006, 0.03), log_uniform(r, 0.2, 2.0));
        let phase_rad = uniform(r, 0.0, std::f64::consts::TAU);
        Made::law(Fan { pull, frequency_hz, phase_rad }, pull)
    }),
    outside("growing-latency", ["growth of latency, s/min", "tracker"], &["time"], |r, _| {
        let extra_s_per_min = r.size(0.006, 0.4);
        Made::of(Fault::Tracker(TrackerFault::GrowingLatency { extra_s_per_min }), extra_s_per_min)
    }),
    outside("warm-reference", ["drift, 1", "actuator"], &["time"], |r, _| {
        let drift = sign(r) * r.size(0.0001, 0.02);
        let fault = OutputFault::WarmReference { drift, warm_up_min: uniform(r, 1.0, 3.0) };
        Made::of(Fault::Output(fault), drift)
    }),
    outside("leak", ["loss of mass, 1/min", "airframe"], &["time"], |r, _| {
        let loss_per_min = r.size(0.0007, 0.02);
        Made::law(Leak { loss_per_min }, loss_per_min)
    }),
    outside("dead-band", ["half-width over weight, 1", "actuator"], &["throttle"], |r, s| {
        let half = r.size(0.0008, 0.05);
        Made::law(DeadBand { half_width: half * s.per_weight }, half)
    }),
    outside(
        "hurried-stall",
        ["loss of thrust, 1", "propulsion"],
        &["lagged-throttle", "throttle"],
        |r, _| {
            let loss = r.size(0.003, 0.25);
            Made::law(HurriedStall { loss, memory_s: uniform(r, 0.1, 0.4) }, loss)
        },
    ),
    outside("missing-motor", ["loss of thrust, 1", "propulsion"], &["time"], |r, _| {
        let depth = r.size(0.003, 0.2);
        let miss = Miss { per_s: uniform(r, 0.1, 0.5), length_s: uniform(r, 0.1, 0.6) };
        Made::of(Fault::Miss(miss, MissingMotor { depth }), depth)
    }),
    reserved(&outside("tether", ["pull over weight, 1/m", "environment"], &["altitude"], |r, _| {
        let stiffness_per_m = r.size(0.005, 0.3);
        Made::law(Tether { stiffness_per_m, free_m: uniform(r, 0.25, 0.6) }, stiffness_per_m)
    })),
    reserved(&outside("layer", ["speed of the air, m/s", "environment"], &["altitude"], |r, _| {
        let speed_m_s = sign(r) * r.size(0.02, 1.2);
        let law = Layer { speed_m_s, centre_m: uniform(r, 0.3, 0.7), depth_m: uniform(r, 0.06, 0.15) };
        Made::law(law, speed_m_s)
    })),
    reserved(&outside(
        "hanging-load",
        ["mass over mass, 1", "airframe"],
        &["speed", "lagged-throttle"],
        |r, _| {
            let (share, hertz) = (r.size(0.008, 0.3), uniform(r, 0.6, 2.5));
            let law = HangingLoad {
                share,
                natural_rad_s: std::f64::consts::TAU * hertz,
                damping: uniform(r, 0.03, 0.1),
            };
            Made::law(law, share)
        },
    )),
    reserved(&outside("ripple", ["amplitude, m", "tracker"], &["altitude"], |r, _| {
        let (amplitude_m, wavelength_m) = (r.size(0.0002, 0.01), uniform(r, 0.05, 0.15));
        Made::of(Fault::Tracker(TrackerFault::Ripple { amplitude_m, wavelength_m }), amplitude_m)
    })),
    reserved(&outside("shaken-mark", ["shift at twice the weight, m", "tracker"], &["throttle"], |r, _| {
        let gain_m = sign(r) * r.size(0.002, 0.1);
        Made::of(Fault::Tracker(TrackerFault::Shaken { gain_m }), gain_m)
    })),
];

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, path::Path};

    use super::*;
    use crate::random;

    /// Effects that the library names and a vertical flight can show (all but tilt-loss).
    const LIBRARY: [&str; 25] = [
        "actuator-backlash",
        "actuator-lag",
        "actuator-quantisation",
        "actuator-saturation",
        "battery-discharge",
        "battery-load",
        "ceiling-effect",
        "descent-thrust-loss",
        "ground-effect-dynamic",
        "ground-effect-shape",
        "gusts",
        "inflow-damping",
        "loop-overrun",
        "mass-change",
        "quadratic-drag",
        "rotor-lag",
        "thrust-curve",
        "thrust-loss",
        "tracker-dropout",
        "tracker-jitter",
        "tracker-latency",
        "tracker-noise",
        "tracker-outliers",
        "tracker-scale",
        "updraft",
    ];

    #[test]
    fn every_effect_of_the_library_has_a_form_and_much_is_outside() {
        let known: BTreeSet<&str> =
            KINDS.iter().map(|kind| kind.effect).filter(|effect| !effect.is_empty()).collect();
        assert_eq!(known, BTreeSet::from(LIBRARY));
        let outside = |reserved| {
            KINDS.iter().filter(|kind| kind.effect.is_empty() && kind.reserved == reserved).count()
        };
        assert!(outside(false) >= 10 && outside(true) >= 4);
        let forms: BTreeSet<&str> = KINDS.iter().map(|kind| kind.form).collect();
        assert_eq!(forms.len(), KINDS.len(), "forms have names of their own");
    }

    #[test]
    fn sizes_are_finite_and_spread_over_a_decade_or_more() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let scale = Scale::of(&rig);
        for kind in KINDS {
            let mut random = random::stream(1, 0, 0, 0);
            let sizes: Vec<f64> =
                (0..400).map(|_| (kind.make)(&mut Draw::any(&mut random), &scale).size.abs()).collect();
            let (low, high) =
                sizes.iter().fold((f64::MAX, 0.0_f64), |(low, high), x| (low.min(*x), high.max(*x)));
            assert!(high.is_finite() && low > 0.0 && high / low > 5.0, "{}: {low} to {high}", kind.form);
        }
    }

    #[test]
    fn a_chosen_size_changes_the_size_and_nothing_else() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let scale = Scale::of(&rig);
        for kind in KINDS {
            let of_size = |at| {
                let mut random = random::stream(1, 0, 0, 0);
                let size = (kind.make)(&mut Draw::of_size(&mut random, at), &scale).size;
                (size, random::uniform(&mut random, 0.0, 1.0))
            };
            let ((small, after), (large, after_large)) = (of_size(0.0), of_size(1.0));
            assert!(large / small > 5.0, "{}: {small} to {large}", kind.form);
            assert_eq!(after, after_large, "{}", kind.form);
        }
    }
}
