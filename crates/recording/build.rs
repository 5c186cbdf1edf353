//! Compiles `proto/` to Rust types and, for each message that is a channel, to the `FileDescriptorSet` that a recording
//! carries as its schema. Needs no `protoc`.

use std::{collections::BTreeSet, env, error::Error, fs, path::Path};

use prost::Message;

/// Files whose messages are channels: the descriptor set of each is written to `OUT_DIR/<stem>.fds`.
const CHANNELS: [&str; 11] = [
    "bench/v1/battery.proto",
    "bench/v1/command.proto",
    "bench/v1/control_state.proto",
    "bench/v1/motion.proto",
    "bench/v1/position.proto",
    "bench/v1/readback.proto",
    "bench/v1/rotor.proto",
    "bench/v1/tick.proto",
    "bench/v1/truth.proto",
    "foxglove/Log.proto",
    "foxglove/PoseInFrame.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    let out = env::var("OUT_DIR")?;
    let all = protox::compile(CHANNELS, ["proto"])?;
    for channel in CHANNELS {
        let mut needed = BTreeSet::new();
        with_imports(channel, &all, &mut needed);
        let mut set = all.clone();
        set.file.retain(|file| needed.contains(file.name()));
        for file in &mut set.file {
            file.source_code_info = None;
        }
        let stem = Path::new(channel).file_stem().ok_or("a .proto file without a name")?;
        fs::write(Path::new(&out).join(stem).with_extension("fds"), set.encode_to_vec())?;
    }
    prost_build::Config::new().compile_fds(all)?;
    Ok(())
}

/// Adds `name` and, through its imports, every file that it needs.
fn with_imports(name: &str, all: &prost_types::FileDescriptorSet, needed: &mut BTreeSet<String>) {
    if !needed.insert(name.to_owned()) {
        return;
    }
    for file in all.file.iter().filter(|file| file.name() == name) {
        for import in &file.dependency {
            with_imports(import, all, needed);
        }
    }
}
