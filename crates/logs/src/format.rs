/// A format that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Apache Parquet: one table, whose rows have their time in a column.
    Parquet,
    /// PX4's log, by its simulators too.
    Ulog,
    /// `ArduPilot`'s log.
    Dataflash,
    /// Betaflight's and INAV's log.
    Blackbox,
    /// The log of a Crazyflie's card, or a log block that its client wrote.
    Crazyflie,
    /// MCAP: bags of ROS 2 in CDR, and any protobuf or JSON.
    Mcap,
}

impl Format {
    /// What it is, such as `a PX4 log (ULog)`.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Parquet => "a Parquet table",
            Self::Ulog => "a PX4 log (ULog)",
            Self::Dataflash => "an ArduPilot log (dataflash)",
            Self::Blackbox => "a Betaflight log (blackbox)",
            Self::Crazyflie => "a log of the Crazyflie (uSD or client)",
            Self::Mcap => "an MCAP file",
        }
    }
}
