//! Readers of other people's flight logs. Whatever the format, a log is topics with named fields, and samples in the order of the
//! file: [`scan`] hands them to a [`Visitor`] one by one, so that memory does not grow with the log.
//!
//! Promises:
//! - Bad bytes never panic. What can be read after them is read, and what was lost is counted ([`Losses`]).
//! - A number is handed over as the log's own documentation scales it, in the unit that [`Field::unit`] names where the log says so.
//! - Nothing here knows what a quantity means: maps do, elsewhere.
//!
//! Each format is one module with one function `scan`. All are read in pieces.

mod blackbox;
mod bytes;
mod cdr;
mod crazyflie;
mod dataflash;
mod error;
mod format;
mod json;
mod mcap;
mod parquet;
mod protobuf;
mod series;
mod survey;
mod ulog;

use std::path::Path;

pub use self::{
    error::LogError,
    format::Format,
    series::{Cell, Field, Losses, Sample, Topic, Visitor},
    survey::{Survey, Surveyed},
};

/// Reads a log from its beginning to its end, or until the visitor has had enough.
///
/// What cannot be read at all is an error. What is damaged, cut or left out is told in the losses, and all else was handed over.
pub fn scan(path: &Path, format: Format, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    match format {
        Format::Parquet => parquet::scan(path, visitor),
        Format::Ulog => ulog::scan(path, visitor),
        Format::Dataflash => dataflash::scan(path, visitor),
        Format::Blackbox => blackbox::scan(path, visitor),
        Format::Crazyflie => crazyflie::scan(path, visitor),
        Format::Mcap => mcap::scan(path, visitor),
    }
}
