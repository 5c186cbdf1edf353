//! The types generated from `proto/`, and the descriptor sets that recordings carry as schemas.

/// Messages of this bench.
#[allow(missing_docs, clippy::pedantic, reason = "generated; documented in proto/")]
pub mod bench {
    include!(concat!(env!("OUT_DIR"), "/bench.v1.rs"));
}

/// Messages that Foxglove and its kin show natively.
#[allow(missing_docs, clippy::pedantic, reason = "generated; documented in proto/")]
#[cfg_attr(not(test), allow(dead_code, reason = "poses are written field by field; tests read them"))]
pub mod foxglove {
    include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
}

macro_rules! descriptor_set {
    ($stem:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $stem, ".fds"))
    };
}
pub(crate) use descriptor_set;
