use thiserror::Error;

/// What can go wrong with a device at the end of the loop.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DeviceError {
    /// A command was NaN or infinite.
    #[error(
        "{device}: command {channel} is {value}, which no output can hold; this is a fault of the caller"
    )]
    BadCommand {
        /// Which device.
        device: &'static str,
        /// Which of throttle, pitch, roll, yaw.
        channel: &'static str,
        /// The value refused.
        value: f64,
    },
    /// The device says that it cannot go on.
    #[error("{device} failed: {detail}")]
    Failed {
        /// Which device.
        device: &'static str,
        /// What it says, and what to do.
        detail: String,
    },
    /// The device went away.
    #[error("{device} is gone ({detail}); check the cable and power, then start again")]
    Gone {
        /// Which device.
        device: &'static str,
        /// What was seen of it.
        detail: String,
    },
    /// The device did not answer in time.
    #[error(
        "{device} gave no answer for {waited_s:.3} s; check that it is powered and not in use by another program"
    )]
    TimedOut {
        /// Which device.
        device: &'static str,
        /// How long it was waited for, seconds.
        waited_s: f64,
    },
}
