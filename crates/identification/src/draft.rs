//! A rig drafted from flights of which nothing is known but their logs.
//!
//! A draft is a rig to begin with: the prior of [`crate::identify_flights`]. Its tolerances are wide, and each of its keys has a
//! [`Note`] that says what it was drawn from.

mod response;
mod sightings;

use std::fmt::Write as _;

use bench_device::TrackStatus;
use bench_recording::Flight;
use bench_rig::{
    Actuation, Airframe, Control, Disturbance, GRAVITY_M_S2, GroundEffect, Loop, Model, Output, Plant, Rig,
    Safety, Stabiliser, StickRange, Thrust, Tracker, Uncertain,
};
use bench_statistics::median;
use serde::Serialize;
use thiserror::Error;

use self::{
    response::{Response, Told},
    sightings::Sightings,
};

/// A rig and what each of its numbers was drawn from.
#[derive(Clone, Debug)]
pub struct Draft {
    /// The rig.
    pub rig: Rig,
    /// One for each key of the rig that holds a number.
    pub notes: Vec<Note>,
}

/// What a number of a draft was drawn from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Note {
    /// The key with the tables around it, as in the rig's file.
    pub key: String,
    /// Where it comes from.
    pub from: Source,
    /// What it was drawn from, in words.
    pub words: String,
}

/// Where a number of a draft comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Measured in the flights.
    Flights,
    /// A parameter that the log holds, or what was said beside the logs.
    Told,
    /// Nothing in the logs tells it.
    Guess,
}

impl Source {
    /// As it stands before the words in the file.
    const fn word(self) -> &'static str {
        match self {
            Self::Flights => "from the flights",
            Self::Told => "as told",
            Self::Guess => "guess",
        }
    }
}

/// What is known beside the flights.
#[derive(Clone, Debug)]
pub struct Known {
    /// What rig and airframe are to be called.
    pub name: String,
    /// The unit of the throttle.
    pub actuation: Actuation,
    /// The mass, kg, and who says so.
    pub mass_kg: Option<(f64, String)>,
    /// Distance of a rotor's axis from the centre of gravity, m, and who says so.
    pub arm_m: Option<(f64, String)>,
}

/// Why nothing can be drafted.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DraftError {
    /// There is no throttle.
    #[error("{flight}: there is no throttle in it, and without one no rig can be drafted")]
    NoThrottle {
        /// The flight.
        flight: String,
    },
    /// The tracker saw too little of it.
    #[error("{flight}: only {positions} positions are in it; at least {least} are needed")]
    TooShort {
        /// The flight.
        flight: String,
        /// How many there are.
        positions: usize,
        /// How many are needed.
        least: usize,
    },
    /// It never flew.
    #[error(
        "{flight}: it never flew: its altitude stays within {range_m:.3} m and its throttle below {throttle:.4}. Name flights that leave the \
         ground; `bench info` tells what a recording holds"
    )]
    NeverFlew {
        /// The flight.
        flight: String,
        /// From the lowest to the highest altitude, m.
        range_m: f64,
        /// The highest throttle, in units of the actuation.
        throttle: f64,
    },
    /// There are no flights.
    #[error("a rig is drafted from one flight at least")]
    NoFlights,
    /// The throttle that it flies with is none.
    #[error(
        "it flies at a throttle of {throttle}, as if nothing carried it: the throttle is another column, or the aircraft was carried by hand"
    )]
    NoLift {
        /// The throttle that hovers, in units of the actuation.
        throttle: f64,
    },
    /// Altitudes that no small aircraft reaches.
    #[error(
        "{flight}: its highest altitude is {height_m:.0} m: is it in millimetres? Look at the map by which it was imported"
    )]
    Altitude {
        /// The flight.
        flight: String,
        /// The highest altitude, m.
        height_m: f64,
    },
}

/// Fewer positions tell nothing.
const LEAST_POSITIONS: usize = 50;
/// The highest altitude that a rig's ceiling may stand above.
const HIGHEST_M: f64 = 900.0;
/// Above the lowest altitude by so much it is taken to fly clear of the ground, m.
const CLEAR_M: f64 = 0.15;
/// Throttle that is a smaller share of the usual one in flight carries nothing.
const CARRIES: f64 = 0.4;

/// A flight as a draft needs it.
struct Flown {
    /// Exposure and altitude of each sighting that is new, times rising: s, m.
    seen: Vec<[f64; 2]>,
    /// Throttle from each instant, s, on.
    throttle: Vec<[f64; 2]>,
    /// Stretches in which it flies clear of the ground: from, to, s.
    aloft: Vec<[f64; 2]>,
}

impl Draft {
    /// Drafts a rig from flights with their names.
    pub fn of(flights: &[(String, Flight)], known: &Known) -> Result<Self, DraftError> {
        if flights.is_empty() {
            return Err(DraftError::NoFlights);
        }
        let flown = flights
            .iter()
            .map(|(name, flight)| Flown::of(name, flight))
            .collect::<Result<Vec<Flown>, DraftError>>()?;
        let recorded: Vec<&Flight> = flights.iter().map(|(_, flight)| flight).collect();
        let mut notes = Notes::default();
        let sightings = Sightings::of(&recorded, &flown);
        let response = Response::of(&flown, &sightings);
        let lowest =
            flown.iter().flat_map(|of| &of.throttle).map(|[_, throttle]| *throttle).fold(0.0, f64::min);
        if response.hover.is_nan() || response.hover <= lowest {
            return Err(DraftError::NoLift { throttle: response.hover });
        }
        let mut rig = Rig { name: known.name.clone(), ..Rig::default() };
        rig.control_loop = control_loop(&recorded, &mut notes);
        rig.plant = plant(rig.control_loop, &mut notes);
        rig.output = output(&flown, known.actuation, &mut notes);
        rig.tracker = tracker(&sightings, &response, &mut notes);
        rig.control = control(&rig, &mut notes);
        rig.safety = safety(&recorded, &mut notes);
        rig.airframe = airframe(&flown, &response, known, &mut notes);
        rig.disturbance = disturbance(&response, &rig.airframe, &mut notes);
        Ok(Self { rig, notes: notes.0 })
    }

    /// The rig's file, with what each number was drawn from above it, below lines that say how it was made.
    pub fn to_toml(&self, head: &str) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail, here and below.
        for line in head.lines() {
            let _ = writeln!(out, "# {line}");
        }
        for (key, line) in self.lines() {
            for note in self.notes.iter().filter(|note| note.key == key) {
                let _ = writeln!(out, "# {}: {}", note.from.word(), note.words);
            }
            let _ = writeln!(out, "{line}");
        }
        out
    }

    /// Each number with its key and what stands behind it in the file, and what it was drawn from.
    pub fn numbers(&self) -> Vec<(Note, String)> {
        let lines = self.lines();
        let value = |note: &Note| {
            let (_, line) = lines.iter().find(|(key, _)| *key == note.key)?;
            Some((note.clone(), line.split_once(" = ")?.1.to_owned()))
        };
        // In the order of the file, not in that of drawing.
        let place = |note: &Note| lines.iter().position(|(key, _)| *key == note.key);
        let mut notes: Vec<&Note> = self.notes.iter().collect();
        notes.sort_by_key(|note| place(note));
        notes.into_iter().filter_map(value).collect()
    }

    /// The lines of the rig's file, each with its key and the tables around it; empty of lines that hold no key.
    fn lines(&self) -> Vec<(String, String)> {
        let mut table = String::new();
        let lines = self.rig.to_toml();
        let with_key = |line: &str| {
            if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
                table = format!("{name}.");
            }
            let key = line.split_once(" = ").map(|(key, _)| format!("{table}{key}"));
            (key.unwrap_or_default(), line.to_owned())
        };
        lines.lines().map(with_key).collect()
    }
}

#[derive(Default)]
struct Notes(Vec<Note>);

impl Notes {
    fn say(&mut self, key: &str, from: Source, words: impl Into<String>) {
        self.0.push(Note { key: key.to_owned(), from, words: words.into() });
    }

    /// The same words for several keys of a table.
    fn guess(&mut self, table: &str, keys: &[&str], words: &str) {
        for key in keys {
            self.say(&format!("{table}.{key}"), Source::Guess, words);
        }
    }
}

impl Flown {
    fn of(name: &str, flight: &Flight) -> Result<Self, DraftError> {
        let name = || name.to_owned();
        let mut seen: Vec<[f64; 2]> = flight
            .positions
            .iter()
            .filter(|position| position.status != TrackStatus::Lost && position.position_m[2].is_finite())
            .map(|position| [position.exposed_at.seconds(), position.position_m[2]])
            .collect();
        seen.sort_by(|a, b| a[0].total_cmp(&b[0]));
        // A log that is faster than its tracker repeats what it saw.
        let repeats = seen.windows(2).filter(|pair| pair[0][1].to_bits() == pair[1][1].to_bits()).count();
        if 3 * repeats > seen.len() && sightings::step(&seen).is_none() {
            let mut new = seen.clone();
            new.dedup_by(|next, before| next[1].to_bits() == before[1].to_bits());
            // What does not move at all repeats itself, too.
            if new.len() >= LEAST_POSITIONS {
                seen = new;
            }
        }
        seen.dedup_by(|next, before| next[0] <= before[0]);
        if seen.len() < LEAST_POSITIONS {
            return Err(DraftError::TooShort {
                flight: name(),
                positions: seen.len(),
                least: LEAST_POSITIONS,
            });
        }
        let throttle: Vec<[f64; 2]> = flight
            .commands
            .iter()
            .filter(|command| command.sticks.throttle.is_finite())
            .map(|command| [command.time.seconds(), command.sticks.throttle])
            .collect();
        if throttle.is_empty() {
            return Err(DraftError::NoThrottle { flight: name() });
        }
        let height_m = seen.iter().map(|[_, z]| z.abs()).fold(0.0, f64::max);
        if height_m > HIGHEST_M {
            return Err(DraftError::Altitude { flight: name(), height_m });
        }
        let mut flown = Self { seen, throttle, aloft: Vec::new() };
        flown.aloft = flown.aloft();
        if flown.aloft.is_empty() {
            let range = |values: &[[f64; 2]]| {
                let (low, high) = values
                    .iter()
                    .fold((f64::MAX, f64::MIN), |(low, high), [_, x]| (low.min(*x), high.max(*x)));
                (high - low, high)
            };
            let (range_m, (_, throttle)) = (range(&flown.seen).0, range(&flown.throttle));
            return Err(DraftError::NeverFlew { flight: name(), range_m, throttle });
        }
        Ok(flown)
    }

    /// Throttle at an instant; `None` before the first.
    fn throttle_at(&self, time_s: f64) -> Option<f64> {
        let after = self.throttle.partition_point(|[from_s, _]| *from_s <= time_s);
        after.checked_sub(1).map(|place| self.throttle[place][1])
    }

    fn aloft(&self) -> Vec<[f64; 2]> {
        const LEAST_S: f64 = 0.5;
        let ground_m = self.ground_m();
        let high = |z: f64| z > ground_m + CLEAR_M;
        let usual = median(
            self.seen.iter().filter(|[_, z]| high(*z)).filter_map(|[time, _]| self.throttle_at(*time)),
        );
        let Some(usual) = usual else { return Vec::new() };
        let rest = self.throttle.iter().map(|[_, throttle]| *throttle).fold(usual, f64::min).max(0.0);
        let carries = |time: f64| {
            self.throttle_at(time).is_some_and(|throttle| throttle > rest + CARRIES * (usual - rest).max(0.0))
        };
        let mut stretches: Vec<[f64; 2]> = Vec::new();
        let mut flies = false;
        for [time, z] in &self.seen {
            let flew = std::mem::replace(&mut flies, high(*z) && (usual <= rest || carries(*time)));
            match (flew, flies, stretches.last_mut()) {
                (false, true, _) => stretches.push([*time; 2]),
                (true, true, Some(stretch)) => stretch[1] = *time,
                _ => {}
            }
        }
        stretches.retain(|[from, to]| to - from > LEAST_S);
        stretches
    }

    /// The altitude at which it stands; below all altitudes where it begins in the air.
    fn ground_m(&self) -> f64 {
        let low_m = self.seen.iter().map(|[_, z]| *z).fold(f64::MAX, f64::min);
        let first = median(self.seen.iter().take(10).map(|[_, z]| *z)).unwrap_or(low_m);
        let last = median(self.seen.iter().rev().take(10).map(|[_, z]| *z)).unwrap_or(low_m);
        let stands = first.min(last);
        // Who flies from the first sample to the last never comes near the lowest altitude by standing.
        if self.throttle_at(self.seen[0][0]).is_some_and(|throttle| throttle > 0.0)
            && stands > low_m + CLEAR_M
        {
            return low_m - 2.0 * CLEAR_M;
        }
        stands.min(low_m + CLEAR_M)
    }
}

fn control_loop(flights: &[&Flight], notes: &mut Notes) -> Loop {
    let periods = flights.iter().flat_map(|flight| {
        flight
            .commands
            .windows(2)
            .map(|pair| pair[1].time.since_s(pair[0].time))
            .filter(|period| *period > 0.0)
    });
    let period_s = rounded(median(periods).unwrap_or(0.01)).clamp(0.001, 1.0);
    notes.say("loop.period_s", Source::Flights, "the median time between two throttles");
    Loop { period_s }
}

fn plant(of: Loop, notes: &mut Notes) -> Plant {
    notes.guess("plant", &["step_s", "truth_period_s"], "a choice of how to simulate, not of the aircraft");
    Plant { model: Model::Vertical, step_s: of.period_s.min(0.001), truth_period_s: 0.02 }
}

fn output(flown: &[Flown], actuation: Actuation, notes: &mut Notes) -> Output {
    let whole = flown.iter().flat_map(|flight| &flight.throttle).all(|[_, throttle]| throttle.fract() == 0.0);
    let bits = if actuation == Actuation::Count && whole { 16 } else { 0 };
    notes.say(
        "output.bits",
        Source::Flights,
        if bits == 0 { "the throttles are no whole counts" } else { "the throttles are whole counts" },
    );
    notes.guess("output", &["readback_noise_fraction"], "nothing reads back what the motors got");
    Output { bits, own_step: None, readback_noise_fraction: 0.0 }
}

/// One sigma of a lag that the flights tell, and of one that they do not, s.
const LAG_SIGMA_S: [f64; 2] = [0.03, 0.06];

fn tracker(sightings: &Sightings, response: &Response, notes: &mut Notes) -> Tracker {
    let believed = format!(
        "positions arrive {:.3} s after they are exposed, as the log or its map has it",
        sightings.age_s
    );
    let (latency_s, words) = match response.lag_s {
        Some(lag_s) => (
            Uncertain { value: sightings.age_s + lag_s, sigma: LAG_SIGMA_S[0] },
            format!(
                "{believed}; the vertical acceleration follows the throttle {lag_s:.3} s later still (cross-correlation, r = {:.2})",
                response.correlation
            ),
        ),
        None => (
            Uncertain { value: sightings.age_s + 0.05, sigma: LAG_SIGMA_S[1] },
            format!(
                "{believed}; by how much the acceleration follows the throttle is not told, 0.05 s is a guess"
            ),
        ),
    };
    let from = if response.lag_s.is_some() { Source::Flights } else { Source::Guess };
    notes.say("tracker.latency_s", from, words);
    notes.say("tracker.frame_period_s", sightings.source(), sightings.period_words());
    notes.say(
        "tracker.resolution_m",
        Source::Flights,
        if sightings.resolution_m > 0.0 {
            "the altitudes come in steps of this"
        } else {
            "the altitudes come in no steps"
        },
    );
    notes.say("tracker.noise_m", sightings.source(), sightings.noise_words());
    notes.say(
        "tracker.dropout_probability",
        Source::Flights,
        "the share of frames that are missing between the others",
    );
    Tracker {
        latency_s: Uncertain { value: rounded(latency_s.value.clamp(0.0, 1.0)), ..latency_s },
        frame_period_s: sightings.frame_period_s,
        resolution_m: sightings.resolution_m,
        noise_m: rounded(sightings.noise_m),
        heading_noise_rad: None,
        dropout_probability: rounded(sightings.dropouts),
    }
}

fn control(rig: &Rig, notes: &mut Notes) -> Control {
    let window_s = rounded((3.0 * rig.tracker.frame_period_s).clamp(0.1, 1.0));
    let ahead_s = rig.tracker.latency_s.value + 0.5 * (rig.control_loop.period_s + window_s);
    notes.guess(
        "control",
        &[
            "position_gain_per_s",
            "speed_gain_per_s",
            "integral_gain_per_s2",
            "lateral_position_gain_per_s",
            "lateral_speed_gain_per_s",
            "lateral_integral_gain_per_s2",
            "tilt_max_rad",
            "heading_gain_per_s",
        ],
        "a gain of the virtual rig, so that this one can be simulated; the logs were flown by another controller",
    );
    notes.guess(
        "control",
        &["extrapolation_s", "velocity_window_s"],
        "from latency, loop period and frame period above",
    );
    Control {
        position_gain_per_s: 0.8,
        speed_gain_per_s: 1.2,
        integral_gain_per_s2: 1.0,
        extrapolation_s: rounded(ahead_s.min(2.0)),
        velocity_window_s: window_s,
        lateral_position_gain_per_s: 0.4,
        lateral_speed_gain_per_s: 1.2,
        lateral_integral_gain_per_s2: 0.15,
        tilt_max_rad: 0.15,
        heading_gain_per_s: 0.8,
        ..Control::default()
    }
}

fn safety(flights: &[&Flight], notes: &mut Notes) -> Safety {
    let positions =
        || flights.iter().flat_map(|flight| &flight.positions).map(|position| position.position_m);
    let highest_m = positions().map(|[.., z]| z).filter(|z| z.is_finite()).fold(1.0, f64::max);
    let farthest_m = positions().map(|[x, y, _]| x.hypot(y)).filter(|r| r.is_finite()).fold(1.0, f64::max);
    notes.say(
        "safety.ceiling_m",
        Source::Flights,
        "a tenth above the highest altitude of the flights, 2 m at least",
    );
    notes.say(
        "safety.radius_m",
        Source::Flights,
        "a tenth beyond the farthest place of the flights, 3 m at least",
    );
    notes.guess(
        "safety",
        &["tracker_timeout_s", "flight_time_max_s", "overrun_streak"],
        "when a simulated flight is stopped",
    );
    Safety {
        ceiling_m: rounded((1.1 * highest_m).clamp(2.0, 1000.0)),
        radius_m: rounded((1.1 * farthest_m).clamp(3.0, 1000.0)),
        tracker_timeout_s: 1.0,
        flight_time_max_s: 600.0,
        overrun_streak: 10,
    }
}

/// A mass that stands for one that nobody told, kg.
const PLACE_HOLDER_KG: f64 = 1.0;
/// Size and mass of a small quadcopter, a Crazyflie, from which others are scaled: arm in m, mass in kg.
const SMALL: [f64; 2] = [0.046, 0.027];
/// One sigma of the throttle that hovers, as a share of the way up to it from where thrust begins.
const HOVER_SHARE: f64 = 0.1;

fn airframe(flown: &[Flown], response: &Response, known: &Known, notes: &mut Notes) -> Airframe {
    let unit = known.actuation.suffix();
    let mass_kg = if let Some((mass_kg, who)) = &known.mass_kg {
        notes.say("airframe.mass_kg", Source::Told, who);
        *mass_kg
    } else {
        notes.say(
                "airframe.mass_kg",
                Source::Guess,
                "a place-holder, as no log holds it. Flights tell thrust over weight, so all forces below go with it. Weigh the aircraft and give --mass-kg",
            );
        PLACE_HOLDER_KG
    };
    notes.guess("airframe", &["drag_n_s_per_m"], "0.7 of the mass each second, as of a small quadcopter");
    let sticks = sticks(flown, known.actuation, unit, notes);
    let thrust = thrust(response, &sticks, mass_kg, unit, notes);
    notes.guess("airframe.ground_effect", &["multiplier"], "as of small quadcopters");
    let arm_m = if let Some((arm_m, who)) = &known.arm_m {
        notes.say("airframe.stabiliser.arm_m", Source::Told, who);
        *arm_m
    } else {
        notes.guess(
            "airframe.stabiliser",
            &["arm_m"],
            "a Crazyflie's, scaled with the cube root of the mass",
        );
        rounded(SMALL[0] * (mass_kg / SMALL[1]).cbrt())
    };
    notes.guess("airframe.ground_effect", &["height_m"], "1.5 arms");
    notes.guess("airframe.stabiliser", &["inertia_kg_m2"], "a disc as wide as the arms, of this mass");
    notes.guess(
        "airframe.stabiliser",
        &["natural_frequency_rad_s", "damping_ratio", "yaw_time_constant_s"],
        "as of small quadcopters; vertical flights use none of it",
    );
    // No rig takes more than twice as much.
    let inertia = (mass_kg * arm_m * arm_m / 4.0).min(50.0);
    Airframe {
        name: known.name.clone(),
        actuation: known.actuation,
        mass_kg: Uncertain::exact(mass_kg),
        drag_n_s_per_m: Uncertain { value: rounded(0.7 * mass_kg), sigma: rounded(0.6 * mass_kg) },
        thrust,
        ground_effect: GroundEffect {
            multiplier: Uncertain { value: 1.2, sigma: 0.1 },
            height_m: Uncertain { value: rounded(1.5 * arm_m), sigma: rounded(0.5 * arm_m) },
        },
        sticks,
        stabiliser: Stabiliser {
            inertia_kg_m2: [inertia, inertia, 2.0 * inertia].map(rounded),
            natural_frequency_rad_s: 15.0,
            damping_ratio: 0.8,
            yaw_time_constant_s: 0.15,
            arm_m,
        },
    }
}

fn sticks(flown: &[Flown], actuation: Actuation, unit: &str, notes: &mut Notes) -> StickRange {
    let (usual_max, range) = match actuation {
        Actuation::Volt => (3.3, "3.3 V"),
        Actuation::Fraction => (1.0, "a fraction"),
        Actuation::Count => (65535.0, "16 bits"),
    };
    let throttles = || flown.iter().flat_map(|flight| &flight.throttle).map(|[_, throttle]| *throttle);
    let (min, max) = (throttles().fold(0.0, f64::min), throttles().fold(usual_max, f64::max));
    let words = format!("the range of {range}, and of the throttles where they go beyond it");
    notes.guess("airframe.sticks", &[&format!("min_{unit}"), &format!("max_{unit}")], &words);
    notes.guess(
        "airframe.sticks",
        &[&format!("centre_{unit}")],
        "the middle; vertical flights use no other stick",
    );
    notes.guess(
        "airframe.sticks",
        &[&format!("tilt_rad_per_{unit}"), &format!("yaw_rate_rad_s_per_{unit}")],
        "half a radian, and a turn in two seconds, at full stick",
    );
    let half = 0.5 * (max - min);
    StickRange {
        min,
        max,
        centre: min + half,
        tilt_rad_per_unit: rounded(0.5 / half),
        yaw_rate_rad_s_per_unit: rounded(std::f64::consts::PI / half),
    }
}

fn thrust(response: &Response, sticks: &StickRange, mass_kg: f64, unit: &str, notes: &mut Notes) -> Thrust {
    let hover = response.hover;
    let above_rest = hover - sticks.min;
    let (way, way_sigma) = match response.slope {
        Some(Told { value, sigma }) => {
            let way = (GRAVITY_M_S2 / value).clamp(0.2 * above_rest, 2.0 * above_rest);
            (way, (way * sigma / value).max(0.15 * above_rest))
        }
        None => (0.75 * above_rest, 0.25 * above_rest),
    };
    let (from, words) = match response.slope {
        Some(Told { value, .. }) => (
            Source::Flights,
            format!(
                "from the throttle that hovers, {}, less g over {} m/s^2 per unit of throttle",
                short(hover),
                short(value)
            ),
        ),
        None => (
            Source::Guess,
            format!("a quarter of the throttle that hovers, {}: the flights hardly vary it", short(hover)),
        ),
    };
    notes.say(
        &format!("airframe.thrust.gain_n_per_{unit}"),
        from,
        format!("what carries the weight at the throttle that hovers, {}", short(hover)),
    );
    notes.say(&format!("airframe.thrust.offset_{unit}"), from, words);
    notes.say(
        &format!("airframe.thrust.hover_sigma_{unit}"),
        Source::Flights,
        format!(
            "a tenth of the way from thrust's beginning to hover; it differed by {} from flight to flight",
            short(response.hover_spread)
        ),
    );
    let offset = rounded(hover - way);
    // The gain makes up for the offset's rounding, so that it hovers where it did.
    let gain = digits(mass_kg * GRAVITY_M_S2 / (hover - offset), 4);
    Thrust {
        gain_n_per_unit: Uncertain { value: gain, sigma: rounded(0.2 * gain) },
        offset: Uncertain { value: offset, sigma: rounded(way_sigma) },
        hover_sigma: Some(rounded((HOVER_SHARE * way).max(2.0 * response.hover_spread))),
    }
}

fn disturbance(response: &Response, airframe: &Airframe, notes: &mut Notes) -> Disturbance {
    /// What the diagnosis takes for ordinary where a rig does not say (docs/diagnosis.md).
    const LEAST_M_S2: f64 = 0.05;
    const UNTOLD_M_S2: f64 = 0.3;
    let way = airframe.throttle_for(airframe.weight_n()) - airframe.thrust.offset.value;
    let spread_m_s2 = GRAVITY_M_S2 * response.hover_spread / way;
    let (trim_m_s2, from, words) = if response.flights > 1 {
        (
            spread_m_s2.max(LEAST_M_S2),
            Source::Flights,
            "by how much the throttle that hovers differs from flight to flight, 0.05 at least",
        )
    } else {
        (UNTOLD_M_S2, Source::Guess, "one flight does not tell how flights differ")
    };
    notes.say("disturbance.trim_m_s2", from, words);
    Disturbance { trim_m_s2: Some(rounded(trim_m_s2)), ..Disturbance::default() }
}

/// To three digits: a draft knows no more.
fn rounded(x: f64) -> f64 {
    digits(x, 3)
}

fn digits(x: f64, count: usize) -> f64 {
    format!("{x:.0$e}", count - 1).parse().unwrap_or(x)
}

/// A number in words.
fn short(x: f64) -> String {
    rounded(x).to_string()
}
