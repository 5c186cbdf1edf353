//! What flights say of hypotheses: their numbers by the posterior's mode, their evidence by Laplace's method, and what they leave.
//!
//! ```text
//! Problem (tracks, rig, tolerances, noise) -> Search: Fit of `none`, of every effect, of pairs
//!                                          -> Regions, Waves, pulses: what a fit leaves unexplained
//! ```
//!
//! The equations are in `docs/diagnosis.md`, under "Evidence".

mod consistency;
mod coordinate;
mod descent;
mod fit;
mod promise;
mod pulse;
mod random;
mod region;
mod search;
mod settle;

pub use consistency::Consistency;
pub use coordinate::{Free, directions, project};
pub use descent::limited_step;
pub use fit::{Fit, Problem};
pub use pulse::pulses;
pub use region::{Region, Regions, Waves, mean_evidence, own_axes, regions, waves};
pub use search::{Search, fitted_effects, with_one_law_more};
