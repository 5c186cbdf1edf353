//! What commands print with `--json`, one schema each: written by hand in `docs/schemas`, held against real output by
//! the tests.

/// The schema of a command's output.
pub struct Output {
    /// Its name, without `bench.` and version.
    pub name: &'static str,
    /// The JSON Schema, as it stands in `docs/schemas`.
    pub schema: &'static str,
}

impl Output {
    /// What it describes, in a line.
    pub fn title(&self) -> String {
        let schema: serde_json::Value = serde_json::from_str(self.schema).unwrap_or_default();
        schema["title"].as_str().unwrap_or_default().to_owned()
    }
}

macro_rules! outputs {
    ($($name:literal $version:literal),+ $(,)?) => {
        &[$(Output {
            name: $name,
            schema: include_str!(concat!("../../../../docs/schemas/bench.", $name, ".", $version, ".json")),
        }),+]
    };
}

/// All of them, by name.
pub const OUTPUTS: &[Output] = outputs! {
    "answered" "1",
    "blind-power" "1",
    "blind" "1",
    "calibrate" "1",
    "check" "1",
    "devices" "1",
    "diagnosis" "2",
    "diff" "1",
    "effects" "1",
    "hil" "1",
    "identification" "1",
    "identification.ground-effect" "1",
    "identification.thrust" "1",
    "import" "1",
    "info" "1",
    "laws" "1",
    "paper" "1",
    "record-frames" "1",
    "recover" "1",
    "sim" "1",
    "rig-draft" "1",
    "rigs" "1",
    "runs" "1",
    "sweep" "1",
    "test" "1",
    "track" "1",
    "trend" "1",
    "tune" "1",
    "verification" "1",
};
