//! Suites of tests: what to fly, what each flight is held to, and what is told of the results.
//!
//! - A [`Suite`] is read from a TOML file. [`Suite::tests`] lays its cases out: a [`Test`] for each combination of what they list.
//! - [`Limit`]s are in the vocabulary of a mission's criteria, or name a field of the recording with a statistic and a phase.
//!   [`judge`] holds a recorded flight against them.
//! - A [`Report`] holds all results. It is the JSON of `bench test` (form `bench.test/1`), and becomes `JUnit` XML ([`junit`]), Markdown
//!   ([`markdown`]), words for a terminal ([`words`]) and sections of a page ([`page`]).
//! - A [`Journal`] keeps each finished run, so that a suite that was killed can go on.
//!
//! This crate flies nothing and knows no command line: who flies hands over recordings. The same results give the same bytes of every
//! report, apart from times of the clock.

mod file;
mod journal;
mod judge;
pub mod junit;
mod keys;
mod limit;
pub mod markdown;
pub mod page;
mod report;
mod test;
pub mod words;

pub use file::{Case, Compare, MissionCriteria, Suite};
pub use journal::{Journal, JournalError, Kept};
pub use judge::{HOVER_THROTTLE, Judged, judge, spread};
pub use keys::suite_keys;
pub use limit::{FieldLimit, Limit, MEASURES, Measure, Side, Statistic};
pub use report::{
    Attached, Check, Comparison, Counts, Diagnosed, Difference, Kind, Outcome, Report, Run, Tested, Times,
};
pub use test::{Mode, Test, file_stem};
