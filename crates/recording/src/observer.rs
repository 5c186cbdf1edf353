//! Whoever looks on while a recording is written.

/// A message as it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// The MCAP topic.
    pub topic: &'static str,
    /// Full name of the protobuf message.
    pub schema: &'static str,
    /// The schema as a serialised `FileDescriptorSet`.
    pub descriptor_set: &'static [u8],
    /// Log time, ns since 1970, or since the start in a simulation without an epoch.
    pub log_time_ns: u64,
    /// Whether it is the topic's one message and holds for all of the flight.
    pub is_static: bool,
    /// The message, serialised.
    pub data: &'a [u8],
}

/// Sees every message of a recording, in its order, on the recorder's thread: [`crate::Recorder::create_observed`].
///
/// The loop waits for none of it, but the recorder does: an observer must not block.
pub trait Observer: Send {
    /// Takes a look at the next message.
    fn see(&mut self, message: &Message<'_>);
}
