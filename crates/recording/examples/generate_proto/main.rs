//! Makes `src/proto/` from `proto/`: Rust types and, for each message that is a channel, the `FileDescriptorSet` that a
//! recording carries as its schema. Needs no `protoc`. To be run after a change of a `.proto` file:
//!
//! ```console
//! cargo run -p bench-recording --example generate_proto
//! ```

mod generated;

use std::{error::Error, fs, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = package.join("src/proto");
    for (name, bytes) in generated::files(&package.join("proto"))? {
        let path = folder.join(name);
        fs::write(&path, bytes).map_err(|error| format!("cannot write {}: {error}", path.display()))?;
    }
    Ok(())
}
