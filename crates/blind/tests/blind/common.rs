//! What the tests of seals share.

use std::{collections::BTreeMap, path::Path};

use bench_blind::{Answer, Answers, Key, Plan, Seal, Verdict, seal};
use bench_rig::{Mission, Rig};

pub(crate) fn rig() -> Rig {
    Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
}

/// A short flight: launch and hold.
pub(crate) fn mission(name: &str, hold_s: f64) -> Mission {
    let text = format!(
        "name = \"{name}\"\ndescription = \"short\"\n[[phase]]\nkind = \"idle\"\nduration_s = 0.5\n\
         [[phase]]\nkind = \"launch\"\nthrust_to_weight = 1.1\nduration_s = 0.7\n\
         [[phase]]\nkind = \"hold\"\naltitude_m = 0.4\nduration_s = {hold_s:?}\n"
    );
    Mission::read(Path::new("test.toml"), &text).unwrap()
}

pub(crate) fn plan(cases: usize, seed: u64) -> Plan {
    let missions = vec![mission("first", 2.0), mission("second", 3.0)];
    Plan { rig: rig(), missions, cases, seed, with_reserved: false }
}

/// A folder with a seal in `cases` and its key in `key.json`.
pub(crate) fn sealed(plan: &Plan) -> (tempfile::TempDir, Seal, Key) {
    let folder = tempfile::tempdir().unwrap();
    let seal = seal(plan, &folder.path().join("cases"), &folder.path().join("key.json"), |_| {}).unwrap();
    let key = serde_json::from_slice(&std::fs::read(folder.path().join("key.json")).unwrap()).unwrap();
    (folder, seal, key)
}

/// The right answer to every case, with certainty.
pub(crate) fn right_answers(key: &Key) -> BTreeMap<String, Answer> {
    key.cases
        .iter()
        .map(|(name, truth)| {
            let label = truth.label();
            let (verdict, effects) = match label.as_str() {
                "none" => (Verdict::None, Vec::new()),
                "unknown" => (Verdict::Unknown, Vec::new()),
                effects => (Verdict::Effect, effects.split('+').map(str::to_owned).collect()),
            };
            let answer =
                Answer { effects, probabilities: BTreeMap::from([(label, 1.0)]), ..Answer::bare(verdict) };
            (name.clone(), answer)
        })
        .collect()
}

/// Writes answers beside the seal and returns where.
pub(crate) fn answered(
    folder: &tempfile::TempDir,
    seal: &Seal,
    cases: BTreeMap<String, Answer>,
) -> std::path::PathBuf {
    let path = folder.path().join("answers.json");
    Answers::new("test 1", &seal.key_sha256, cases).write(&path).unwrap();
    path
}
