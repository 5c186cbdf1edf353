use std::path::Path;

use bench_device::Sticks;

use crate::{
    GRAVITY_M_S2, RigError, Uncertain,
    keys::{self, Form},
    rig::read_text,
    visit::{self, Range, Reader, Visitor},
};

/// The unit in which sticks are commanded; it is part of the keys' names in an airframe file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Actuation {
    /// Volts into the hand controller's stick inputs (`_v`).
    #[default]
    Volt,
    /// A fraction of full scale, 0 to 1 (`_fraction`).
    Fraction,
    /// Counts, such as a 16-bit PWM (`_count`).
    Count,
}

impl Actuation {
    /// All of them, by the names that files give them.
    pub const CHOICES: [(&'static str, Self); 3] =
        [("volt", Self::Volt), ("fraction", Self::Fraction), ("count", Self::Count)];

    /// The ending of keys and column names.
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::Volt => "v",
            Self::Fraction => "fraction",
            Self::Count => "count",
        }
    }

    /// The unit as printed.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Volt => "V",
            Self::Fraction => "1",
            Self::Count => "count",
        }
    }
}

/// One airframe with its hand controller: all of its numbers, from one file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Airframe {
    /// Its name.
    pub name: String,
    /// The unit of its sticks.
    pub actuation: Actuation,
    /// Mass with marker and battery, kg.
    pub mass_kg: Uncertain,
    /// Linear drag, N s/m (the paper's Cf).
    pub drag_n_s_per_m: Uncertain,
    /// Throttle to thrust out of the ground effect.
    pub thrust: Thrust,
    /// Thrust near the ground.
    pub ground_effect: GroundEffect,
    /// The hand controller's stick inputs.
    pub sticks: StickRange,
    /// Rotation: inertia and the on-board stabiliser.
    pub stabiliser: Stabiliser,
}

/// `thrust = gain (throttle - offset)`, not below zero (paper, section 3.4, figure 9).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Thrust {
    /// N per unit of throttle.
    pub gain_n_per_unit: Uncertain,
    /// Throttle at which thrust begins, in units of throttle.
    pub offset: Uncertain,
    /// One sigma of the throttle that hovers, in units of throttle, where flights have told it. Flights tell it much
    /// better than gain and offset, which make up for each other; where it is known, the gain is what carries the
    /// weight at that throttle, and the gain's own tolerance tells nothing more.
    pub hover_sigma: Option<f64>,
}

/// Thrust multiplier `1 + (multiplier - 1) max(0, 1 - z/height)` (paper, section 3.4, figure 10).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundEffect {
    /// Thrust at the ground over thrust far from it.
    pub multiplier: Uncertain,
    /// Altitude at which the effect ends, m.
    pub height_m: Uncertain,
}

/// What the stick inputs take and what they ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StickRange {
    /// Lowest input, in units of the actuation; throttle at rest.
    pub min: f64,
    /// Highest input.
    pub max: f64,
    /// Pitch, roll and yaw at rest.
    pub centre: f64,
    /// Tilt asked for by a unit of pitch or roll away from the centre, rad per unit.
    pub tilt_rad_per_unit: f64,
    /// Yaw rate asked for by a unit of yaw away from the centre, rad/s per unit.
    pub yaw_rate_rad_s_per_unit: f64,
}

/// Rotational dynamics under the on-board stabiliser: a second-order response of tilt, a first-order one of yaw rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stabiliser {
    /// Principal moments of inertia about body x, y, z, kg m^2.
    pub inertia_kg_m2: [f64; 3],
    /// Undamped natural frequency of the tilt response, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of the tilt response.
    pub damping_ratio: f64,
    /// Time constant of the yaw rate, s.
    pub yaw_time_constant_s: f64,
    /// Rotor axis to centre of gravity, m; with the thrust at hand it limits the torque.
    pub arm_m: f64,
}

impl StickRange {
    /// Throttle at rest, the others centred.
    pub fn at_rest(&self) -> Sticks {
        Sticks { throttle: self.min, pitch: self.centre, roll: self.centre, yaw: self.centre }
    }
}

impl Airframe {
    /// Weight at the nominal mass, N.
    pub fn weight_n(&self) -> f64 {
        self.mass_kg.value * GRAVITY_M_S2
    }

    /// Throttle whose nominal thrust out of the ground effect is `thrust_n`, in units of the actuation, unclamped.
    pub fn throttle_for(&self, thrust_n: f64) -> f64 {
        self.thrust.offset.value + thrust_n / self.thrust.gain_n_per_unit.value
    }

    /// Nominal thrust out of the ground effect at `throttle`, N.
    pub fn thrust_n(&self, throttle: f64) -> f64 {
        (self.thrust.gain_n_per_unit.value * (throttle - self.thrust.offset.value)).max(0.0)
    }

    /// Nominal ground-effect multiplier at altitude `z_m`; below the surface as on it.
    pub fn ground_effect(&self, z_m: f64) -> f64 {
        let depth = (1.0 - z_m.max(0.0) / self.ground_effect.height_m.value).max(0.0);
        1.0 + (self.ground_effect.multiplier.value - 1.0) * depth
    }

    /// Reads an airframe file, the same keys as the table `[airframe]` of a rig.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        let root = visit::parse(path, &read_text("airframe", path)?)?;
        let (mut airframe, mut problems) = (Self::default(), Vec::new());
        Reader::read(path, "", &root, &mut problems, |reader| {
            airframe.visit(reader);
            if reader.is_sound() {
                for (key, detail) in airframe.contradictions() {
                    reader.contradiction(key, detail);
                }
            }
        });
        if problems.is_empty() { Ok(airframe) } else { Err(RigError::Invalid(problems)) }
    }

    /// Every key of an airframe file, once for each unit of the sticks.
    pub fn keys() -> Vec<Form> {
        keys::collect(|collector| Self::default().visit(collector))
    }

    pub(crate) fn visit(&mut self, v: &mut impl Visitor) {
        v.text("name", "Name of the airframe, as recordings and pages give it.", &mut self.name);
        v.choice(
            "actuation",
            "Unit in which sticks are commanded; the endings of keys below follow it.",
            &Actuation::CHOICES,
            &mut self.actuation,
        );
        let unit = self.actuation.suffix();
        v.uncertain("mass_kg", "Mass with marker and battery.", Range::above(0.0, 1000.0), &mut self.mass_kg);
        v.uncertain(
            "drag_n_s_per_m",
            "Linear drag: force per speed.",
            Range::closed(0.0, 1000.0),
            &mut self.drag_n_s_per_m,
        );
        v.table(
            "thrust",
            "Throttle to thrust out of the ground effect: thrust = gain (throttle - offset), \
             not below zero.",
            |v| self.thrust.visit(v, unit),
        );
        v.table(
            "ground_effect",
            "Thrust near the ground: times 1 + (multiplier - 1) max(0, 1 - z/height).",
            |v| self.ground_effect.visit(v),
        );
        v.table("sticks", "What the hand controller's stick inputs take and what they ask for.", |v| {
            self.sticks.visit(v, unit);
        });
        v.table(
            "stabiliser",
            "Rotation under the on-board stabiliser: tilt of second order, yaw rate of first \
             order.",
            |v| self.stabiliser.visit(v),
        );
    }

    /// What is wrong with values that are fine one by one: key and why.
    pub(crate) fn contradictions(&self) -> Vec<(&'static str, String)> {
        let mut found = Vec::new();
        let StickRange { min, max, centre, .. } = self.sticks;
        if !(min < max && (min..=max).contains(&centre)) {
            found.push((
                "sticks",
                format!("min {min}, centre {centre}, max {max} must rise in this order, min below max"),
            ));
        } else if self.thrust.gain_n_per_unit.value > 0.0 {
            let hover = self.throttle_for(self.weight_n());
            if !(min..=max).contains(&hover) {
                found.push((
                    "thrust",
                    format!(
                        "{} g would hover at throttle {hover:.3} {}, outside the sticks' {min} to {max}; \
                         check mass, gain and offset and their units",
                        self.mass_kg.value * 1000.0,
                        self.actuation.unit()
                    ),
                ));
            }
        }
        found
    }
}

impl Thrust {
    fn visit(&mut self, v: &mut impl Visitor, unit: &str) {
        let range = Range::above(0.0, 1e6);
        v.uncertain(
            &format!("gain_n_per_{unit}"),
            "Thrust per unit of throttle.",
            range,
            &mut self.gain_n_per_unit,
        );
        v.uncertain(
            &format!("offset_{unit}"),
            "Throttle at which thrust begins.",
            Range::closed(-1e6, 1e6),
            &mut self.offset,
        );
        let hover_sigma = &mut self.hover_sigma;
        v.maybe(
            &format!("hover_sigma_{unit}"),
            "One sigma of the throttle that hovers, where flights have told it.",
            Range::above(0.0, 1e6),
            hover_sigma,
        );
    }
}

impl GroundEffect {
    fn visit(&mut self, v: &mut impl Visitor) {
        v.uncertain(
            "multiplier",
            "Thrust at the ground over thrust far from it.",
            Range::closed(1.0, 3.0),
            &mut self.multiplier,
        );
        v.uncertain(
            "height_m",
            "Altitude at which the ground effect ends.",
            Range::above(0.0, 10.0),
            &mut self.height_m,
        );
    }
}

impl StickRange {
    fn visit(&mut self, v: &mut impl Visitor, unit: &str) {
        let any = Range::closed(-1e6, 1e6);
        v.number(&format!("min_{unit}"), "Lowest input; throttle at rest.", any, &mut self.min);
        v.number(&format!("max_{unit}"), "Highest input.", any, &mut self.max);
        v.number(&format!("centre_{unit}"), "Pitch, roll and yaw at rest.", any, &mut self.centre);
        v.number(
            &format!("tilt_rad_per_{unit}"),
            "Tilt asked for by a unit of pitch or roll away from the centre.",
            any,
            &mut self.tilt_rad_per_unit,
        );
        v.number(
            &format!("yaw_rate_rad_s_per_{unit}"),
            "Yaw rate asked for by a unit of yaw away from the centre.",
            any,
            &mut self.yaw_rate_rad_s_per_unit,
        );
    }
}

impl Stabiliser {
    fn visit(&mut self, v: &mut impl Visitor) {
        v.triple(
            "inertia_kg_m2",
            "Principal moments of inertia about body x, y, z.",
            Range::above(0.0, 100.0),
            &mut self.inertia_kg_m2,
        );
        v.number(
            "natural_frequency_rad_s",
            "Undamped natural frequency of the tilt response.",
            Range::above(0.0, 200.0),
            &mut self.natural_frequency_rad_s,
        );
        v.number(
            "damping_ratio",
            "Damping ratio of the tilt response.",
            Range::above(0.0, 5.0),
            &mut self.damping_ratio,
        );
        v.number(
            "yaw_time_constant_s",
            "Time constant of the yaw rate.",
            Range::above(0.0, 10.0),
            &mut self.yaw_time_constant_s,
        );
        v.number(
            "arm_m",
            "Rotor axis to centre of gravity; with the thrust at hand it limits the torque.",
            Range::above(0.0, 10.0),
            &mut self.arm_m,
        );
    }
}
