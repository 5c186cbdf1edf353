//! MCAP recordings: what a loop, a simulation or an import leaves behind, and everything that reads it.
//!
//! - A [`Recorder`] takes [`Record`]s from the loop without allocating or locking and writes them on its own thread.
//! - What viewers draw ([`ViewerChannel`]) comes along: poses and a scene by the writer itself, images by [`Images`].
//! - A [`Recording`] reads them back one by one in bounded memory; a [`Flight`] holds them all as series for analysis.
//! - [`recover`] makes a whole recording of one that was cut or left open; [`export`] makes tables for other tools.
//! - [`Channel::fields`] lists every recorded quantity with its unit, once, for whoever compares or exports.
//!
//! Promises: a simulated recording repeats to the byte for the same records, session and version; what was flushed
//! survives the end of the process; damage is never read as data.

mod channel;
mod codec;
#[cfg(feature = "exchange")]
mod columns;
mod container;
pub mod diff;
mod error;
#[cfg_attr(
    not(feature = "exchange"),
    expect(dead_code, reason = "the formats that are left out use the rest")
)]
mod export;
mod field;
mod fields;
mod flight;
mod images;
#[cfg(feature = "exchange")]
pub mod import;
mod info;
mod kind;
mod layout;
mod observer;
#[cfg_attr(
    not(feature = "exchange"),
    expect(dead_code, reason = "the formats that are left out use the rest")
)]
mod partial;
mod proto;
mod record;
mod recorder;
mod recording;
mod recover;
mod session;
mod thin;
mod viewer;
mod writer;
mod writer_thread;
mod zstd_decoder;

pub use channel::Channel;
#[cfg(feature = "exchange")]
pub use columns::{CellKind, Cells, ColumnWriter};
pub use error::RecordingError;
pub use export::{ExportOptions, Exported, export};
pub use field::{Field, Kind, Value, Values};
pub use flight::{Flight, PhaseInterval};
pub use images::{Images, View};
pub use info::{AttachmentInfo, ChannelInfo, Info};
pub use kind::FileKind;
pub use observer::{Message, Observer};
pub use record::{
    Battery, Command, ControlState, Event, EventText, Level, Motion, ReadbackAt, Record, Rotor, Tick, Truth,
};
pub use recorder::{Finished, Options, Recorder, WhenFull};
pub use recording::{Recording, Records};
pub use recover::{RecoverReport, recover};
pub use session::{Mode, Session};
pub use thin::thin;
pub use viewer::ViewerChannel;
