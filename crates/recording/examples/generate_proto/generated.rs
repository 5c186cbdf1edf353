//! What is made of `proto/`: for the program that writes it and for the test that compares it with what is there.

use std::{
    collections::{BTreeMap, BTreeSet},
    error::Error,
    fs,
    path::Path,
};

use prost::Message;

/// Files whose messages are channels: the descriptor set of each is `<stem>.fds`.
const CHANNELS: [&str; 16] = [
    "bench/v1/battery.proto",
    "bench/v1/command.proto",
    "bench/v1/control_state.proto",
    "bench/v1/motion.proto",
    "bench/v1/position.proto",
    "bench/v1/readback.proto",
    "bench/v1/rotor.proto",
    "bench/v1/tick.proto",
    "bench/v1/truth.proto",
    "foxglove/CameraCalibration.proto",
    "foxglove/CompressedImage.proto",
    "foxglove/FrameTransform.proto",
    "foxglove/FrameTransforms.proto",
    "foxglove/Log.proto",
    "foxglove/PoseInFrame.proto",
    "foxglove/SceneUpdate.proto",
];

/// The generated files by name, from the `.proto` files in `proto`.
pub fn files(proto: &Path) -> Result<BTreeMap<String, Vec<u8>>, Box<dyn Error>> {
    let mut files = BTreeMap::new();
    let all = protox::compile(CHANNELS, [proto])?;
    for channel in CHANNELS {
        let mut needed = BTreeSet::new();
        with_imports(channel, &all, &mut needed);
        let mut set = all.clone();
        set.file.retain(|file| needed.contains(file.name()));
        for file in &mut set.file {
            file.source_code_info = None;
        }
        let stem = Path::new(channel).file_stem().ok_or("a .proto file without a name")?;
        files.insert(format!("{}.fds", stem.to_string_lossy()), set.encode_to_vec());
    }
    let folder = tempfile::tempdir()?;
    prost_build::Config::new().out_dir(folder.path()).compile_fds(all)?;
    for entry in fs::read_dir(folder.path())? {
        let entry = entry?;
        files.insert(entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path())?);
    }
    Ok(files)
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
