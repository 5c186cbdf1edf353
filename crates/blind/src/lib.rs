//! The blind check: cases whose cause is withheld, made by physics that nobody else here knows, sealed before anybody
//! answers, and scored by the key afterwards.
//!
//! - [`seal`] draws and flies cases into neutral recordings; what they are goes into a [`Key`] apart.
//! - [`Answers`] hold what a tool, any tool, says of them; the file carries its own hash. [`Unfinished`] collects them.
//! - [`open`] refuses a wrong key, changed recordings and changed answers, then gives a [`Score`]; [`page`] prints it.
//! - [`power`] tells what a rig's flights can show: how large an effect must be, and what is taken for what.
//!
//! This crate must never depend on `bench-plant` or `bench-diagnosis`, nor take a line from them: a diagnosis that is
//! only tried on its own model proves nothing. A test reads the dependency graph and fails if it does.

mod answers;
mod cases;
mod detect;
mod error;
mod flight;
mod hash;
mod open;
mod page;
mod physics;
mod power;
mod random;
mod score;
mod seal;
mod unfinished;

pub use answers::{ANSWERS_SCHEMA, Answer, Answers, Interval, Told, Verdict, stamp};
pub use cases::{Family, Ingredient, Parameter, Truth};
pub use error::BlindError;
pub use hash::of_file as sha256_of_file;
pub use open::open;
pub use page::page;
pub use power::{
    ALIKE, Cosine, FormPower, Group, POWER_SCHEMA, Point, Power, PowerPlan, SeenFrom, THRESHOLDS, power,
};
pub use score::{
    Bin, ByLabel, CaseScore, Closure, Confusion, Detection, Figure, PLAIN, Parameters, Rate, SCORE_SCHEMA,
    Score, TopOne, Unknown,
};
pub use seal::{KEY_SCHEMA, Key, Plan, SEAL_FILE, SEAL_SCHEMA, Seal, seal};
pub use unfinished::{UNFINISHED_SCHEMA, Unfinished};
