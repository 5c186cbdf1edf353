//! What a flight says of a model: the extended Kalman filter over the plant's laws, and its smoother.
//!
//! ```text
//! recording, rig -> Track: inputs held, measurements with the times of their exposures
//! Track, Point (numbers and effects), Noise -> Law, as it is stepped -> filter -> propagated | updated | reset
//! passengers on that stream: sensitivities, other noise, k-step predictors, innovations, knots of the smoother
//! ```
//!
//! It predicts each measurement of altitude through the same laws that the simulator flies. The equations are in
//! `docs/diagnosis.md`, under "State and measurement" and "Priors".

mod covariance;
mod direction;
mod filter;
mod frame_clock;
mod innovation;
mod k_step;
mod law;
mod measurement;
mod noise;
mod pass;
mod passenger;
mod perturbed;
mod pins;
mod probe;
mod smooth;
mod track;

pub use bench_plant::effects::{PerNumber, RigNumber};
pub use covariance::{Covariance, LIFT_OFF_M, State};
pub use direction::{Direction, Hat, Seen};
pub use filter::NEAR_GROUND_M;
pub use frame_clock::TOGETHER_S;
pub use innovation::Innovation;
pub use k_step::HORIZONS_S;
pub use law::{Coordinate, Hold, Law, Point, known};
pub use measurement::Scored;
pub use noise::{Noise, added, is_random, spread};
pub use pass::{Pass, Prediction, TrackPass, innovations, knots, nll, nll_of_all, predict, run, run_for};
pub use perturbed::Pairs;
pub use pins::{Pin, dragged, readback_sigma};
pub use probe::PROBES;
pub use smooth::{Knot, backward};
pub use track::{Felt, Input, Measurement, Track, TrackError, held};
