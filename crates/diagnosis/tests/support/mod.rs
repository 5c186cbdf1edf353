//! The rig and the missions of the tests of filter, inference and diagnosis.

use std::path::{Path, PathBuf};

use bench_rig::{Mission, Model, Rig};

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

/// The virtual rig with the vertical model, which flies fast.
pub fn rig() -> Rig {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    rig
}

/// A mission that comes with the bench.
pub fn mission(name: &str) -> Mission {
    Mission::load(rigs().join("missions").join(name).with_extension("toml")).unwrap()
}
