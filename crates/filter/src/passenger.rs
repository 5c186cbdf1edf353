//! What goes along with the filter: it hears each step, measurement and reset, and never changes the filter.

use bench_plant::effects::Axis;

use crate::{
    covariance::{Covariance, State, Transition},
    law::{Hold, Law},
    measurement::{AltitudeMeasurement, Scored},
    track::Measurement,
};

/// What goes along with the filter. Statically dispatched: [`crate::filter::fly`] is compiled for each set of passengers, and what a set
/// does not need costs nothing.
pub(crate) trait Passenger {
    /// The state has moved over a step, or the effects' states alone have, where the airframe stands or is carried.
    fn propagated(&mut self, _step: &Propagated<'_>) {}
    /// A measurement was taken in.
    fn updated(&mut self, _update: &Updated<'_>) {}
    /// What was known of the state is no longer.
    fn reset(&mut self, _reset: &Reset<'_>) {}
}

/// A step of the filter.
pub(crate) struct Propagated<'a> {
    /// How long it was, s.
    pub h: f64,
    /// What the pin held over it.
    pub holds: &'a [Hold],
    /// The law, after its effects' states have moved on.
    pub law: &'a Law,
    /// Altitude, m, and speed, m/s, before.
    pub from: [f64; 2],
    /// Nominal thrust over weight.
    pub ratio: f64,
    /// How the airframe moved; `None` where it did not follow the law.
    pub flown: Option<Flown<'a>>,
}

/// How the airframe moved over a step.
pub(crate) struct Flown<'a> {
    /// Altitude, m, and speed, m/s, in the middle of the step.
    pub middle: [f64; 2],
    /// The law's acceleration there, m/s^2.
    pub force: f64,
    pub transition: &'a Transition,
    /// Whether the ground effect's kink makes the model uncertain.
    pub near_ground: bool,
    /// The quantities of [`Axis::ALL`].
    pub axes: &'a [f64; Axis::COUNT],
}

/// A measurement that the filter has learnt from.
pub(crate) struct Updated<'a> {
    pub measured: Measured<'a>,
    /// Measured less predicted.
    pub residual: f64,
    pub scored: Scored,
    /// Whether it is held against the prediction, or only learnt from.
    pub counts: bool,
    pub law: &'a Law,
    /// State and covariance before it.
    pub before: (&'a State, &'a Covariance),
    /// After it.
    pub after: (&'a State, &'a Covariance),
    /// By how much the state moves for each unit of what it learns from.
    pub gain: State,
    /// The quantities of [`Axis::ALL`] before.
    pub axes: &'a [f64; Axis::COUNT],
}

/// What was measured.
pub(crate) enum Measured<'a> {
    /// The altitude, by the tracker.
    Altitude {
        measurement: &'a Measurement,
        of: &'a AltitudeMeasurement,
        /// As predicted, m.
        predicted_m: f64,
        /// How far below where a ceiling stops it the airframe was thought to be, m.
        below_ceiling_m: f64,
    },
    /// On board: a speed or an acceleration.
    OnBoard {
        /// Slopes by the state.
        slopes: State,
        /// One sigma of its noise.
        sigma: f64,
        /// Of an acceleration: the law's, m/s^2.
        force: Option<f64>,
    },
}

/// What is no longer known of the state.
pub(crate) enum Reset<'a> {
    /// It stands on the ground.
    Standing,
    /// It leaves the ground with such a spread of its speed, m/s.
    LiftOff(f64),
    /// Ground or ceiling have stopped it; the height at which the law's ceiling did.
    Stopped { ceiling_m: Option<f64> },
    /// It is taken to be where it is seen.
    Carried {
        law: &'a Law,
        /// When it was seen, s.
        exposed_s: f64,
        /// Altitude, m, and speed, m/s.
        at: [f64; 2],
    },
}

impl Passenger for () {}

impl<A: Passenger, B: Passenger> Passenger for (A, B) {
    #[inline]
    fn propagated(&mut self, step: &Propagated<'_>) {
        self.0.propagated(step);
        self.1.propagated(step);
    }

    #[inline]
    fn updated(&mut self, update: &Updated<'_>) {
        self.0.updated(update);
        self.1.updated(update);
    }

    #[inline]
    fn reset(&mut self, reset: &Reset<'_>) {
        self.0.reset(reset);
        self.1.reset(reset);
    }
}
