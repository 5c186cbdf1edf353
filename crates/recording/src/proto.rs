//! The types generated from `proto/`, and the descriptor sets that recordings carry as schemas. They are committed, so that a
//! build needs no generator; `examples/generate_proto` makes them and a test compares.

/// Messages of this bench.
#[allow(missing_docs, clippy::pedantic, reason = "generated; documented in proto/")]
pub mod bench {
    include!("proto/bench.v1.rs");
}

/// Messages that Foxglove and its kin show natively.
#[allow(missing_docs, clippy::pedantic, reason = "generated; documented in proto/")]
#[cfg_attr(not(test), allow(dead_code, reason = "poses are written field by field; tests read them"))]
pub mod foxglove {
    include!("proto/foxglove.rs");
}

macro_rules! descriptor_set {
    ($stem:literal) => {
        include_bytes!(concat!("proto/", $stem, ".fds"))
    };
}
pub(crate) use descriptor_set;
