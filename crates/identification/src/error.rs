use std::fmt;

use thiserror::Error;

/// Why nothing was identified.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum IdentifyError {
    /// Too little to tell the spread between flights.
    #[error(
        "{usable} of the flights can be used; at least {least} are needed, or nothing could be said of how flights differ"
    )]
    TooFewFlights {
        /// How many there are.
        usable: usize,
        /// How many are needed.
        least: usize,
    },
    /// Nothing left the ground.
    #[error(
        "{flight}: it was never seen above {height_m} m: no flight to identify anything from; leave it out"
    )]
    NeverAirborne {
        /// The flight.
        flight: String,
        /// What counts as airborne.
        height_m: f64,
    },
    /// Altitudes that no such airframe reaches.
    #[error(
        "{flight}: seen at {height_m:.0} m, while the rig's ceiling is {ceiling_m} m: wrong units? 1000 times too much is millimetres taken for metres"
    )]
    Altitude {
        /// The flight.
        flight: String,
        /// The altitude.
        height_m: f64,
        /// The rig's ceiling.
        ceiling_m: f64,
    },
    /// Gain and offset cannot be told apart, nor anything else.
    #[error(
        "the throttle is constant: it varies by {percent:.2} % of what hovers in all of these flights; without at least {least_percent} % nothing tells how thrust follows it"
    )]
    ConstantThrottle {
        /// One sigma, % of the range from offset to hover.
        percent: f64,
        /// How much is needed, %.
        least_percent: f64,
    },
    /// The rig does not carry itself, or flies away.
    #[error(
        "the rig contradicts the flights by far: by its numbers the thrust was {ratio:.3} of the weight on average, and yet it flew{hint}; check mass, gain, offset and the unit of the throttle"
    )]
    Thrust {
        /// Mean of thrust over weight.
        ratio: f64,
        /// What the size of the factor suggests.
        hint: &'static str,
    },
    /// The other way round.
    #[error(
        "thrust falls as the throttle rises in these flights (by {nats:.0} nats more likely than the rig's way): is the column upside down, or another one?"
    )]
    ThrustFalls {
        /// How much more likely.
        nats: f64,
    },
    /// Numbers far beyond their tolerances.
    #[error("the rig contradicts the flights by far:{}; widen the tolerances that are too narrow, or check the recordings", listed(.0))]
    Contradicts(Vec<Contradiction>),
    /// The fit explains next to nothing.
    #[error(
        "the model does not describe these flights: what it leaves is an acceleration of {turbulence_m_s2:.1} m/s^2 and sightings off by {sighting_m:.3} m (one sigma), {outlier_percent:.0} % of them wrong; are they vertical flights of one airframe? Stretches near the ground can be left out with --above, a channel that is another signal with --without"
    )]
    Unexplained {
        /// What acts besides the model.
        turbulence_m_s2: f64,
        /// How far off sightings are.
        sighting_m: f64,
        /// Share of sightings at wrong places, %.
        outlier_percent: f64,
    },
}

/// A number of the rig that flights move far beyond its tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// The number.
    pub name: &'static str,
    /// The rig's value.
    pub nominal: f64,
    /// The flights' value.
    pub fitted: f64,
    /// How many tolerances lie between.
    pub sigmas: f64,
}

impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, nominal, fitted, sigmas } = self;
        write!(f, "{name} would be {fitted:.4} instead of {nominal:.4}, {:.0} tolerances away", sigmas.abs())
    }
}

fn listed(all: &[Contradiction]) -> String {
    all.iter().fold(String::new(), |text, one| format!("{text}\n  {one}"))
}
