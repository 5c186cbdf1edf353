use std::{io, path::PathBuf};

use thiserror::Error;

/// What can go wrong with frames, recordings of them, and calibration.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum KinectError {
    /// A frame's data has the wrong length.
    #[error("{what} has {found} bytes, expected {expected}; is it a 640 x 480 frame in this format?")]
    Length {
        /// What was handed over.
        what: &'static str,
        /// How many bytes it has.
        found: usize,
        /// How many it should have.
        expected: usize,
    },
    /// A file or folder could not be read or written.
    #[error("cannot {action} {}: {reason}", path.display())]
    File {
        /// Read, write or make.
        action: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        reason: io::Error,
    },
    /// A line of a fakenect index, or the file that it names, is not what it should be.
    #[error("{}:{line}: {detail}", path.display())]
    Recording {
        /// The index file.
        path: PathBuf,
        /// The line, counted from one.
        line: usize,
        /// What is wrong and what to do.
        detail: String,
    },
    /// A folder already holds a recording.
    #[error("{} already holds a recording of frames; name another folder", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// A table of measured positions cannot be used.
    #[error("{}:{line}: {detail}", path.display())]
    Table {
        /// The CSV file.
        path: PathBuf,
        /// The line, counted from one.
        line: u64,
        /// What is wrong and what to do.
        detail: String,
    },
    /// The measurements do not determine a calibration.
    #[error("cannot calibrate: {0}")]
    Calibration(
        /// Why, and what to do.
        String,
    ),
    /// An image could not be encoded.
    #[error("cannot write the image {}: {reason}", path.display())]
    Image {
        /// The image file.
        path: PathBuf,
        /// Why.
        reason: png::EncodingError,
    },
}
