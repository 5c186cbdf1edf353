//! The bench as a user meets it: commands, files, words and exit codes.

mod back_to_back;
mod blind;
mod check;
mod ci;
mod colours;
mod compare;
mod diagnose;
mod examples;
mod figures;
mod foreign;
#[cfg(feature = "foxglove")]
mod foxglove;
mod frames;
mod hil;
mod identify;
mod import;
mod lean;
mod live;
mod logs;
mod model;
mod own_logs;
mod packaging;
mod progress;
mod record;
mod recorded;
mod report;
mod rigs;
mod schema;
mod sim;
mod suites;
mod support;
mod sweep;
mod tune;
mod viewing;
mod wrong;
