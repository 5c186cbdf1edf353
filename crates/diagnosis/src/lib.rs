//! Where the sim-to-real gap lies, which unmodelled effect causes it, and how far it shrinks once that effect is added.
//!
//! ```text
//! Problem -> Prepared: readbacks, ticks, frames, arrivals read; flights as they are to be fitted
//!         -> Analysis: fits (bench-inference) and what each hypothesis weighs
//!         -> Diagnosis: verdict, candidates, gap, place
//!         -> next flight, rig with the effect: of the same Analysis
//! ```
//!
//! `docs/diagnosis.md` has the flow and, under "What a probability is made of", what `decision.rs` does. Every key of the
//! output is in `docs/diagnosis-json.md`, and how the next flight is found in `docs/next-flight.md`.

mod agree;
mod allowed;
mod analysis;
mod calibration;
mod chain;
mod control;
mod cycle;
mod decision;
mod diagnose;
mod direct;
mod gap;
mod groups;
mod hypothesis;
mod nameless;
mod next_flight;
mod readback;
mod stage;
mod trace;
mod weigh;

pub use agree::{Agreeing, Disagreement};
pub use allowed::{Ahead, Off};
pub use analysis::Analysis;
pub use calibration::{Calibration, Told};
pub use control::{Fold, Gain, held_out};
pub use diagnose::{
    Alternative, Candidate, Diagnosis, FlightUsed, Frequency, Likeness, NoiseTold, Number, PLAIN_NATS,
    ParameterValue, Place, RegionTold, Verdict,
};
pub use direct::Finding;
pub use gap::{Figure, FlightGap, Gap, KStep};
pub use hypothesis::Grounds;
pub use nameless::Nameless;
pub use next_flight::{MARK, NextFlight, NextFlightError, Repeat};
pub use stage::StageShare;
pub use trace::Trace;
pub use weigh::alarm_margin;
