use bench_plant::effects::EffectError;
use thiserror::Error;

/// Why nothing was tuned.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TuneError {
    /// Percentiles of too few.
    #[error("{models} models are too few for a 95th percentile; 20 at least")]
    TooFewModels {
        /// How many were asked for.
        models: usize,
    },
    /// Where no task can be flown.
    #[error(
        "cannot hold {altitude_m} m and step up by {step_m} m: that must be above the ground and below the rig's ceiling_m = {ceiling_m} (its ground effect ends at {ground_m} m)"
    )]
    Altitude {
        /// Asked for, m.
        altitude_m: f64,
        /// The step, m.
        step_m: f64,
        /// Height of the ground effect, m.
        ground_m: f64,
        /// The rig's ceiling, m.
        ceiling_m: f64,
    },
    /// Pitch and roll do nothing.
    #[error(
        "airframe {airframe} does not tilt (its sticks' tilt_rad_per_... is 0): tune `--loops altitude` only"
    )]
    NoLateral {
        /// The airframe.
        airframe: String,
    },
    /// No gains fly it.
    #[error(
        "none of {tried} sets of gains of the {of} loop gets the rig's models through launch, hold and step; look at the rig: can it lift off at 1.08 of its weight, does its tracker see often enough?"
    )]
    NothingFlies {
        /// The loop.
        of: &'static str,
        /// How many were tried.
        tried: usize,
    },
    /// The rig's effects make no sense.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// Nothing to compare.
    #[error("no law to compare: name at least one rig")]
    TooFewLaws,
    /// No such effect.
    #[error("no effect is called {name:?}; `bench effects` lists them")]
    UnknownEffect {
        /// The name asked for.
        name: String,
    },
    /// Laws on different benches.
    #[error(
        "rigs {first} and {other} differ in more than name and [control]: laws are compared on one airframe, tracker and loop"
    )]
    OtherBench {
        /// The first rig's name.
        first: String,
        /// The one that differs.
        other: String,
    },
    /// The rig's text has no place for gains.
    #[error("cannot write the gains into the rig's text: {detail}")]
    Text {
        /// What is wrong.
        detail: String,
    },
}
