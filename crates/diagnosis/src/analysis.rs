//! From flights to what explains them, a value a step: `Prepared`, then `Analysis`, then [`Diagnosis`].
//!
//! Each owns what it holds, so that all that is asked after the verdict works on what the verdict used.

use std::borrow::Cow;

use bench_filter::Track;
use bench_inference::{Problem, Search};

use crate::{
    calibration::{Calibration, Told},
    diagnose::Diagnosis,
    direct::{Direct, direct},
    weigh::Weighed,
};

/// Flights as they are to be fitted: what their direct channels show is read, pins hold what is believed of them, and the
/// noise of each flight has its level.
pub(crate) struct Prepared<'a> {
    given: Problem<'a>,
    /// The given flights, or changed ones.
    tracks: Cow<'a, [Track]>,
    pub direct: Direct,
}

impl<'a> Prepared<'a> {
    fn of(given: &Problem<'a>) -> Self {
        let direct = direct(given.tracks, given.rig);
        let mut tracks = Cow::Borrowed(given.tracks);
        // Pins that are known not to hold what they were told are believed as they were read, noise and all, unless they
        // moved on afterwards.
        if direct.doubts_pins() {
            for track in tracks.to_mut() {
                if direct.lag_of_pins.is_some() {
                    track.as_commanded();
                    track.begin_with_thrust(given.rig);
                } else {
                    track.at_pins(|input, pin| input.throttle = pin.readback);
                }
            }
        }
        if let Some(levelled) = given.with_tracks(&tracks).levelled() {
            tracks = Cow::Owned(levelled);
        }
        Self { given: given.clone(), tracks, direct }
    }

    fn problem(&self) -> Problem<'_> {
        self.given.with_tracks(&self.tracks)
    }
}

/// Flights, the fits of all hypotheses, and what each weighs.
pub struct Analysis<'a> {
    pub(crate) prepared: Prepared<'a>,
    pub(crate) search: Search,
    pub(crate) weighed: Weighed,
    pub(crate) calibration: Calibration,
}

impl<'a> Analysis<'a> {
    /// Analyses flights that were all flown on one rig. There must be at least one.
    pub fn of(given: &Problem<'a>, calibration: &Calibration) -> Self {
        let prepared = Prepared::of(given);
        let problem = prepared.problem();
        let search = Search::of(&problem);
        let weighed = Weighed::of(&problem, &search, &prepared.direct, calibration);
        Self { prepared, search, weighed, calibration: calibration.clone() }
    }

    /// The problem that was solved, with flights as they were fitted: not always as they were given.
    pub fn problem(&self) -> Problem<'_> {
        self.prepared.problem()
    }

    /// The most probable hypothesis by itself, without all that goes with it.
    pub fn told(&self) -> Told {
        self.weighed.told()
    }

    /// The verdict with where the gap lies, how far it shrinks, and what to do next.
    pub fn diagnosis(&self) -> Diagnosis {
        Diagnosis::found(self)
    }
}
