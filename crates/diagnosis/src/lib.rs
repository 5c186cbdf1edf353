//! Where the sim-to-real gap lies, which unmodelled effect causes it, and how far it shrinks once that effect is added.
//!
//! ```text
//! recordings -> Track -> Problem (rig, tolerances, noise) -> Fit of `none`, of every effect, of pairs
//!                                                         -> regions: what a fit leaves unexplained
//!                                                         -> Diagnosis: verdict, candidates, gap, place
//! ```
//!
//! A Kalman filter (`pass`) predicts each sighting through the same laws that the simulator flies (`law`), and its
//! innovations score a hypothesis. `docs/diagnosis.md` has the equations.

mod agree;
mod allowed;
mod calibration;
mod chain;
mod cycle;
mod diagnose;
mod direct;
mod fit;
mod frame_clock;
mod gap;
mod groups;
mod law;
mod next_flight;
mod pass;
mod pulse;
mod random;
mod readback;
mod region;
mod search;
mod settle;
mod sight;
mod smooth;
mod stage;
mod track;
mod weigh;

pub use agree::{Agreeing, Disagreement};
pub use allowed::{Ahead, Off};
pub use calibration::{Calibration, Outcome, Telling, Told, ToldByKind};
pub use diagnose::{
    Candidate, Diagnosis, FlightUsed, Frequency, Likeness, NoiseTold, Number, ParameterValue, Place,
    RegionTold, Verdict, verdict,
};
pub use direct::Finding;
pub use fit::{Fit, Free, Problem};
pub use gap::{Consistency, Figure, FlightGap, Gap, KStep};
pub use law::{BIAS, Coordinate, GAIN, LATENCY, Law, OFFSET, Point};
pub use next_flight::{MARK, NextFlight, NextFlightError, Repeat};
pub use pass::{HORIZONS_S, Innovation, LIFT_OFF_M, NEAR_GROUND_M, Noise, Pass, TrackPass};
pub use smooth::Trace;
pub use stage::StageShare;
pub use track::{Input, Sighting, Track, TrackError};
pub use weigh::alarm_margin;
