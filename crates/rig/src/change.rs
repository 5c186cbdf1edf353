//! What an operator may change of a mission before it is flown: its altitude and its flight time.

use thiserror::Error;

use crate::{Mission, PhaseAction, Profile, Rig};

/// Share of the ceiling that set-points may reach: the rest is room to overshoot.
const CEILING_SHARE: f64 = 0.8;

/// The shortest that a hold can be made, s.
const HOLD_MIN_S: f64 = 1.0;

/// The shortest that a landing is made, s.
const LANDING_MIN_S: f64 = 1.0;

/// Why a mission cannot be changed as asked.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ChangeError {
    /// Without a hold there is neither an altitude nor a time to change.
    #[error(
        "mission {mission} holds no altitude, so neither altitude nor flight time can be set; choose one with a hold"
    )]
    NoHold {
        /// The mission.
        mission: String,
    },
    /// Its holds differ, or move.
    #[error(
        "mission {mission} flies set-points from {low_m} to {high_m} m, which no single altitude replaces; choose one that \
         holds one altitude, or edit it"
    )]
    ManyAltitudes {
        /// The mission.
        mission: String,
        /// Its lowest set-point, m.
        low_m: f64,
        /// Its highest set-point, m.
        high_m: f64,
    },
    /// Outside of what the rig allows.
    #[error("an altitude of {altitude_m} m is outside of the rig's {low_m:.2} to {high_m:.2} m")]
    Altitude {
        /// What was asked for, m.
        altitude_m: f64,
        /// Lowest set-point that the rig allows, m.
        low_m: f64,
        /// Highest set-point that the rig allows, m.
        high_m: f64,
    },
    /// Shorter than the phases that stay as they are, or longer than the rig's limit.
    #[error(
        "a flight time of {flight_time_s} s is outside of the {low_s:.1} to {high_s:.1} s that mission and rig allow"
    )]
    FlightTime {
        /// What was asked for, s.
        flight_time_s: f64,
        /// Shortest, s.
        low_s: f64,
        /// Longest, s.
        high_s: f64,
    },
    /// The last hold has a sine that sweeps over all of it.
    #[error(
        "mission {mission} sweeps a sine over its last hold, whose duration belongs to it; choose another mission, or edit it"
    )]
    Sweeps {
        /// The mission.
        mission: String,
    },
}

impl Rig {
    /// Lowest and highest altitude that an operator may ask for, m: above the ground effect, and with room below the ceiling.
    pub fn altitude_envelope_m(&self) -> [f64; 2] {
        [self.airframe.ground_effect.height_m.value, CEILING_SHARE * self.safety.ceiling_m]
    }
}

impl Mission {
    /// The one altitude that all holds fly, m.
    pub fn altitude_m(&self) -> Result<f64, ChangeError> {
        let set_points = || {
            self.phases
                .iter()
                .filter_map(|plan| altitude_of(&plan.action))
                .flat_map(Profile::points)
                .map(|point| point[1])
        };
        let low_m = set_points()
            .reduce(f64::min)
            .ok_or_else(|| ChangeError::NoHold { mission: self.name.clone() })?;
        let high_m = set_points().fold(low_m, f64::max);
        if low_m == high_m {
            Ok(low_m)
        } else {
            Err(ChangeError::ManyAltitudes { mission: self.name.clone(), low_m, high_m })
        }
    }

    /// The mission with another altitude in all of its holds, if it has one and the rig allows the other. Criteria on the peak move along, and
    /// landings get the time that the other way down takes.
    pub fn at_altitude(mut self, altitude_m: f64, rig: &Rig) -> Result<Self, ChangeError> {
        let before_m = self.altitude_m()?;
        let [low_m, high_m] = rig.altitude_envelope_m();
        if altitude_m != before_m && !(low_m..=high_m).contains(&altitude_m) {
            return Err(ChangeError::Altitude { altitude_m, low_m, high_m });
        }
        for plan in &mut self.phases {
            match &mut plan.action {
                PhaseAction::Hold { altitude_m: profile, .. } => *profile = Profile::constant(altitude_m),
                // Out of its time the throttle would go to rest in the air.
                PhaseAction::Land { descent_m_s, .. } => {
                    let longest_s = plan.duration_s + (altitude_m - before_m) / *descent_m_s;
                    plan.duration_s = longest_s.max(plan.duration_s.min(LANDING_MIN_S));
                }
                _ => {}
            }
        }
        for peak_m in [&mut self.criteria.peak_min_m, &mut self.criteria.peak_max_m].into_iter().flatten() {
            *peak_m = (*peak_m + altitude_m - before_m).max(0.0);
        }
        Ok(self)
    }

    /// From take-off to the beginning of the landing, s: all that is neither idle nor landing.
    pub fn flight_time_s(&self) -> f64 {
        self.phases.iter().filter(|plan| is_flown(&plan.action)).map(|plan| plan.duration_s).sum()
    }

    /// Shortest and longest flight time that [`Mission::with_flight_time`] takes, s.
    pub fn flight_time_limits_s(&self, rig: &Rig) -> Result<[f64; 2], ChangeError> {
        let hold = &self.phases[self.last_hold()?];
        let landing_s: f64 = self
            .phases
            .iter()
            .filter(|plan| matches!(plan.action, PhaseAction::Land { .. }))
            .map(|plan| plan.duration_s)
            .sum();
        Ok([self.flight_time_s() - hold.duration_s + HOLD_MIN_S, rig.safety.flight_time_max_s - landing_s])
    }

    /// The mission with its last hold made shorter or longer, so that the flight takes so long from take-off to landing.
    pub fn with_flight_time(mut self, flight_time_s: f64, rig: &Rig) -> Result<Self, ChangeError> {
        let [low_s, high_s] = self.flight_time_limits_s(rig)?;
        let before_s = self.flight_time_s();
        if flight_time_s == before_s {
            return Ok(self);
        }
        if !(low_s..=high_s).contains(&flight_time_s) {
            return Err(ChangeError::FlightTime { flight_time_s, low_s, high_s });
        }
        let last = self.last_hold()?;
        let hold = &mut self.phases[last];
        if matches!(hold.action, PhaseAction::Hold { chirp: Some(_), .. }) {
            return Err(ChangeError::Sweeps { mission: self.name });
        }
        hold.duration_s += flight_time_s - before_s;
        Ok(self)
    }

    /// Index of the last hold.
    fn last_hold(&self) -> Result<usize, ChangeError> {
        self.phases
            .iter()
            .rposition(|plan| matches!(plan.action, PhaseAction::Hold { .. }))
            .ok_or_else(|| ChangeError::NoHold { mission: self.name.clone() })
    }
}

fn altitude_of(action: &PhaseAction) -> Option<&Profile> {
    match action {
        PhaseAction::Hold { altitude_m, .. } => Some(altitude_m),
        _ => None,
    }
}

fn is_flown(action: &PhaseAction) -> bool {
    !matches!(action, PhaseAction::Idle | PhaseAction::Land { .. })
}
