//! What a flight says of a model: the extended Kalman filter over the plant's laws, and its smoother.
//!
//! ```text
//! recording, rig -> Track: inputs held, measurements with the times of their exposures
//! Track, Point (numbers and effects), Noise -> Law, as it is stepped -> filter -> Pass: innovations, likelihood, sensitivities
//!                                                                              -> Knot at each measurement -> smoother
//! ```
//!
//! It predicts each measurement of altitude through the same laws that the simulator flies. The equations are in
//! `docs/diagnosis.md`.

mod frame_clock;
mod law;
mod noise;
mod pass;
mod pins;
mod sight;
mod smooth;
mod track;

pub use frame_clock::TOGETHER_S;
pub use law::{BIAS, Coordinate, DRAG, GAIN, LATENCY, Law, OFFSET, Point, Reach, View, known};
pub use noise::{Noise, added, is_random};
pub use pass::{
    AXES, Axis, Covariance, Direction, HORIZONS_S, Hat, Innovation, LIFT_OFF_M, NEAR_GROUND_M, PROBES, Pass,
    Seen, State, TrackPass, fly_track, run, trace_track,
};
pub use pins::{Pin, dragged, readback_sigma};
pub use sight::Scored;
pub use smooth::{Knot, backward};
pub use track::{Felt, Input, Sighting, Track, TrackError, held};
