//! What a hypothesis leaves that no effect of the library explains: its evidence, by kind.

use bench_inference::{Fit, Problem, Regions, Waves, mean_evidence, pulses, waves};
use serde::Serialize;

/// Gain of log-evidence of a cause without a name on top of a hypothesis, nats, for each kind that it may be of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Nameless {
    /// An acceleration over quantities of the moment.
    pub structure: f64,
    /// One that swings.
    pub swing: f64,
    /// Thrust that is missing for moments.
    pub pulses: f64,
    /// One over the altitude of late.
    pub past: f64,
    /// One that grows from flight to flight.
    pub drift: f64,
    /// A play of the thrust.
    pub play: f64,
    /// An offset of the tracker.
    pub tracker: f64,
    /// An acceleration of up to 0.1 % of gravity, or an offset within the tracker's noise: what any model gets wrong. It is no part of
    /// [`Self::evidence`].
    pub slight: f64,
    /// Readbacks that no law of a pin explains. It adds to the others, for it is of another channel.
    pub readback: f64,
}

impl Nameless {
    /// Looks for each kind on top of a fit; for swings and pulses only where `closely`, for they take the longest.
    pub fn of(
        problem: &Problem<'_>,
        fit: &Fit,
        regions: &Regions,
        closely: bool,
        readback: f64,
    ) -> (Self, Option<Waves>) {
        let waves = closely.then(|| waves(problem, fit));
        let found = Self {
            structure: regions.nameless,
            swing: waves.as_ref().map_or(0.0, |waves| waves.highest().1),
            pulses: if closely { pulses(problem, fit) } else { 0.0 },
            past: regions.past,
            drift: regions.drift,
            play: regions.play,
            tracker: regions.offset(),
            slight: regions.slight,
            readback,
        };
        (found, waves)
    }

    /// Evidence of a cause of any one kind, each as likely before the flights, nats; a little below 0 where there is nothing.
    pub fn evidence(&self) -> f64 {
        let Self { structure, swing, pulses, past, drift, play, tracker, readback, .. } = *self;
        mean_evidence([structure, swing, pulses, past, drift, play, tracker]) + readback
    }
}
