//! Gains for a rig: robust against its tolerances, with the margins of the loop that they make, and laws held against one
//! another.
//!
//! ```text
//! rig -> Models: rigs drawn from its tolerances -> flights of the controller's own code -> figures, their 95th percentiles
//!     -> search over the gains                                              -> tune(): the rig with better gains
//!     -> margins(): the loop's frequency response, by injection             -> gain, phase and delay margins
//! rigs -> compare(): the same draws and effects under every rig's laws
//! ```
//!
//! The controller is flown, not modelled: what is tuned is the code that flies. `docs/tune.md` has the method.

mod compare;
mod draw;
mod error;
mod figures;
mod flight;
mod gains;
mod margins;
mod page;
mod statistics;
mod tune;
mod verdict;
mod write;

pub use bench_statistics::Share;
pub use compare::{Achieved, Case, Comparison, Goals, compare};
pub use draw::{Models, add_to_drawn};
pub use error::TuneError;
pub use figures::Figures;
pub use flight::{Task, Traced, fly_traced};
pub use margins::{Margins, Response};
pub use page::{Made, page};
pub use statistics::percentile;
pub use tune::{Effort, Grown, Limits, LoopKind, Progress, Step, Trial, Tuned, Tuning, fly_models, tune};
pub use verdict::{HOLDING, Judged, Standing};
pub use write::with_gains;
