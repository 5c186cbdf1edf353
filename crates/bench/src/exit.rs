use std::process::ExitCode;

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done and, for a check, passed.
    Done = 0,
    /// The check failed: recordings differ, criteria were missed.
    CheckFailed = 1,
    /// Wrong usage or bad input.
    BadInput = 2,
    /// Done, but data was lost on the way.
    DataLoss = 3,
    /// A device failed or a safety limit stopped the flight.
    Stopped = 4,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
