//! What is generated from `proto/` and committed is what the generator makes of it today.

#[path = "../examples/generate_proto/generated.rs"]
mod generated;

use std::{collections::BTreeMap, fs, path::Path};

#[test]
fn committed_types_and_schemas_are_what_the_proto_files_make() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let made = generated::files(&package.join("proto")).unwrap();
    let there: BTreeMap<_, _> = fs::read_dir(package.join("src/proto"))
        .unwrap()
        .map(Result::unwrap)
        .map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap()))
        .collect();
    let differing: Vec<_> =
        made.keys().chain(there.keys()).filter(|name| made.get(*name) != there.get(*name)).collect();
    assert!(
        differing.is_empty(),
        "{differing:?} in src/proto/ differ: cargo run -p bench-recording --example generate_proto"
    );
}
