use std::{fmt, path::PathBuf};

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
    /// No model carries the weight at a throttle that is far from all that were flown.
    #[error(
        "by these numbers it hovers at {hover:.4} {unit}, and no throttle outside {low:.4} to {high:.4} was flown in the air: what carries the weight is thereby guessed; widen the tolerances of thrust gain and offset, check the mass and that the column is what the motors got, or fly a hover"
    )]
    HoverNeverFlown {
        /// Throttle that carries the weight.
        hover: f64,
        /// The lowest flown.
        low: f64,
        /// The highest flown.
        high: f64,
        /// The rig's unit.
        unit: &'static str,
    },
    /// What each flight keeps for itself is too much for one airframe in one condition.
    #[error(
        "each flight keeps an acceleration of its own of {trim_m_s2:.1} m/s^2 (one sigma; a tenth of gravity is the most): these are not flights of one airframe in one condition, or tolerances of thrust are too narrow; widen those, give the battery's voltage, or sort the flights by battery and load"
    )]
    Trim {
        /// One sigma over flights.
        trim_m_s2: f64,
    },
    /// The fit explains next to nothing.
    #[error(
        "the model does not describe these flights: what it leaves is an acceleration of {turbulence_m_s2:.1} m/s^2 and measurements off by {measurement_m:.3} m (one sigma), {outlier_percent:.0} % of them wrong; are they vertical flights of one airframe? Stretches near the ground can be left out with --above, a channel that is another signal with --without"
    )]
    Unexplained {
        /// What acts besides the model.
        turbulence_m_s2: f64,
        /// How far off measurements are.
        measurement_m: f64,
        /// Share of measurements at wrong places, %.
        outlier_percent: f64,
    },
    /// A table of readings could not be read at all.
    #[error("{}: {detail}", file.display())]
    Table {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        detail: String,
    },
    /// A cell of a table of readings is no number.
    #[error("{}:{line}: column `{column}` has {text:?}; a number is expected (empty: no reading)", file.display())]
    Cell {
        /// The file.
        file: PathBuf,
        /// Counted from one.
        line: u64,
        /// Name of the column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// Too little to tell a line from noise.
    #[error(
        "{usable} readings at {throttles} different throttles between dead zone and saturation{level}; at least {least} at 3 throttles are needed for a line and its tolerance"
    )]
    TooFewReadings {
        /// How many readings can be used.
        usable: usize,
        /// At how many throttles.
        throttles: usize,
        /// Of which battery level, where there are several.
        level: String,
        /// How many readings are needed.
        least: usize,
    },
    /// Another unit of the throttle, or another airframe.
    #[error(
        "{}:{line}: throttle {throttle} is outside the rig's {min} to {max} {unit}{hint}; check the column's unit and --rig", file.display()
    )]
    ThrottleOutside {
        /// The file.
        file: PathBuf,
        /// Counted from one.
        line: u64,
        /// The throttle.
        throttle: f64,
        /// The rig's range.
        min: f64,
        /// The rig's range.
        max: f64,
        /// The rig's unit.
        unit: &'static str,
        /// What the size of the factor suggests.
        hint: &'static str,
    },
    /// Another unit of the balance.
    #[error(
        "the greatest thrust is {ratio:.3} of the rig's weight of {weight_g:.1} g{hint}; check the column's unit (`reading_g`, `reading_n`) and the rig's mass"
    )]
    ForceScale {
        /// Greatest thrust over weight.
        ratio: f64,
        /// The weight as a mass, g.
        weight_g: f64,
        /// What the size of the factor suggests.
        hint: &'static str,
    },
    /// The other way round.
    #[error("thrust {how}: {slope_g:.2} g per {unit} (one sigma {sigma_g:.2}); {advice}")]
    ReadingsFall {
        /// Whether it falls, or does not change plainly.
        how: &'static str,
        /// Thrust per unit of throttle, g.
        slope_g: f64,
        /// Its standard error, g.
        sigma_g: f64,
        /// The rig's unit.
        unit: &'static str,
        /// What to try.
        advice: &'static str,
    },
    /// What hangs there is not known, so no weight can be taken off.
    #[error(
        "nothing says what the balance carries while the rotors rest: there is no reading at throttle {rest} or in the dead zone; add one, or give --hanging-g GRAMS"
    )]
    NoRest {
        /// Throttle at rest.
        rest: f64,
    },
    /// The readings are not of one relationship.
    #[error(
        "{refused} of {all} readings lie off any one {law}: they are not of one airframe in one condition, or columns are mixed up{first}"
    )]
    Scattered {
        /// How many would have to be refused.
        refused: usize,
        /// Of how many.
        all: usize,
        /// What was fitted.
        law: &'static str,
        /// The first of them.
        first: String,
    },
    /// Altitudes that no balance rig has.
    #[error(
        "altitudes reach {highest_m} m, while the rig's ground effect ends at {boundary_m} m: {hint}; the column is read as {unit}"
    )]
    AltitudeScale {
        /// The highest, m.
        highest_m: f64,
        /// The rig's boundary, m.
        boundary_m: f64,
        /// What the size suggests.
        hint: &'static str,
        /// The unit of the column.
        unit: &'static str,
    },
    /// Too little to tell a law of altitude.
    #[error(
        "{usable} readings with the rotors turning at {altitudes} different altitudes; at least {least} at 4 altitudes are needed, some of them above the ground effect"
    )]
    TooFewAltitudes {
        /// How many readings can be used.
        usable: usize,
        /// At how many altitudes.
        altitudes: usize,
        /// How many readings are needed.
        least: usize,
    },
    /// Thrust does not rise towards the ground.
    #[error(
        "these readings show no ground effect: thrust at the ground is {ratio:.3} of that far from it{hint}"
    )]
    NoGroundEffect {
        /// The multiplier found.
        ratio: f64,
        /// What to check.
        hint: &'static str,
    },
    /// The numbers found are none that a rig may have.
    #[error("{name} would be {value:.4}, which no rig may have ({range}); {advice}")]
    OutOfRange {
        /// The number.
        name: &'static str,
        /// What was found.
        value: f64,
        /// What is allowed.
        range: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// There is nothing to hold a model against.
    #[error("{flight}: {reason}")]
    NotVerifiable {
        /// The flight.
        flight: String,
        /// Why.
        reason: String,
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
