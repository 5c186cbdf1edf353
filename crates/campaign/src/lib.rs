//! Campaigns: thousands of flights and diagnoses that depend on one another in nothing.
//!
//! ```text
//! plan file -> Plan: rigs, missions, variants, seeds; recordings; the case mix -> Run: made when it is asked for, its id a hash of its content
//! Run -> perform -> a row, whatever happens -> Store: parts that are whole or absent -> merge -> one table -> report
//! ```
//!
//! [`execute`] fills the cores of one machine; a [`Shard`] is what one of several does, in a folder that all of them share. What a run
//! comes to depends on nothing but its content, so that it does not matter who does it, when, how often and in which order.
//!
//! Names are looked for by whoever calls, through [`Library`]. What calibrations learn is here too ([`learn()`]), for it is learnt from the
//! same case [`mix`].

mod cluster;
mod cost;
mod draw;
mod error;
mod execute;
mod file;
mod keys;
mod learn;
pub mod mix;
mod perform;
mod plan;
mod record;
mod report;
mod store;
mod table;

pub use bench_recording::{CellKind, Cells};
pub use cluster::{CONTAINER_FILE, Handed};
pub use cost::{Cost, Workload};
pub use draw::Draw;
pub use error::CampaignError;
pub use execute::{Executed, Keep, Shard, Step, execute};
pub use file::{Airframes, Diagnosing, EffectPlan, Kind, PlanFile, Seeds, Variant};
pub use keys::sweep_keys;
pub use learn::{LEAST_SETS, learn};
pub use perform::{Done, Outcome, caught, columns, perform, perform_together, runs_together};
pub use plan::{FlightRun, Library, Plan, Run, Unfound, Work};
pub use record::record;
pub use report::{Report, report};
pub use store::{RESULTS, ShardLock, Store, TIMES, encoded};
pub use table::{Cell, Column, Table};

/// The version whose results these are.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
