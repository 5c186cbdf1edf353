//! Which format a log is in, by its first bytes.

use std::{fs::File, io::Read as _, path::Path};

use crate::LogError;

/// A format that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Text in columns.
    Csv,
    /// Apache Parquet.
    Parquet,
    /// PX4's log, by its simulators too.
    Ulog,
    /// `ArduPilot`'s log.
    Dataflash,
    /// Betaflight's and INAV's log.
    Blackbox,
    /// What a Crazyflie writes on its micro-SD card.
    Crazyflie,
    /// MCAP: bags of ROS 2 in CDR, and any protobuf or JSON.
    Mcap,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 7] = [
        Self::Csv,
        Self::Parquet,
        Self::Ulog,
        Self::Dataflash,
        Self::Blackbox,
        Self::Crazyflie,
        Self::Mcap,
    ];

    /// Its name in maps and on the screen.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
            Self::Ulog => "ulog",
            Self::Dataflash => "dataflash",
            Self::Blackbox => "blackbox",
            Self::Crazyflie => "crazyflie",
            Self::Mcap => "mcap",
        }
    }

    /// What it is, such as `a PX4 log (ULog)`.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Csv => "a table (CSV)",
            Self::Parquet => "a Parquet table",
            Self::Ulog => "a PX4 log (ULog)",
            Self::Dataflash => "an ArduPilot log (dataflash)",
            Self::Blackbox => "a Betaflight log (blackbox)",
            Self::Crazyflie => "a Crazyflie's micro-SD log",
            Self::Mcap => "an MCAP file",
        }
    }

    /// Whether it is one table whose rows have their time in a column, and no topics with stamps.
    pub const fn is_table(self) -> bool {
        matches!(self, Self::Csv | Self::Parquet)
    }

    /// By the first bytes of a file. Text is for others to tell: a table has no mark of its own.
    pub fn of_head(head: &[u8]) -> Option<Self> {
        let marks: [(&[u8], Self); 6] = [
            (b"ULog\x01\x12\x35", Self::Ulog),
            // A log may begin with any message, and begins with the format of formats when it is whole.
            (b"\xa3\x95", Self::Dataflash),
            (b"H Product:Blackbox", Self::Blackbox),
            (b"PAR1", Self::Parquet),
            (b"\x89MCAP0\r\n", Self::Mcap),
            (b"\xbc", Self::Crazyflie),
        ];
        let (_, format) = marks.into_iter().find(|(mark, _)| head.starts_with(mark))?;
        match format {
            // One byte is little to go by; the version and a number of events that may be follow.
            Self::Crazyflie => (head.len() >= 5
                && matches!(head[1], 1 | 2)
                && head[2] == 0
                && (1..=64).contains(&u16::from_le_bytes([head[3], head[4]])))
            .then_some(format),
            format => Some(format),
        }
    }

    /// Looks into a file; what has no mark is taken for a table.
    pub fn of(path: &Path) -> Result<Self, LogError> {
        let mut head = Vec::new();
        File::open(path)
            .and_then(|file| file.take(64).read_to_end(&mut head))
            .map_err(|source| LogError::Read { path: path.to_owned(), source })?;
        Ok(Self::of_head(&head).unwrap_or(Self::Csv))
    }
}
