use std::path::{Path, PathBuf};

use assert_cmd::{Command, assert::Assert};

/// The project's folder, where the README's commands are run.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// `bench` with arguments, from the project's folder.
pub fn bench<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(arguments: I) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bench"));
    command.current_dir(root()).args(arguments);
    command
}

/// A folder for one test's files.
pub struct Scratch(tempfile::TempDir);

impl Scratch {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The same as text, for command lines.
    pub fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// Flies a mission into a file and returns its name.
    pub fn fly(&self, file: &str, arguments: &[&str]) -> String {
        let name = self.name(file);
        bench(["sim", "-o", &name, "--force"]).args(arguments).assert().success();
        name
    }
}

/// Standard output as JSON, which must be as its schema says.
pub fn json(assert: &Assert) -> serde_json::Value {
    let value = serde_json::from_slice(&assert.get_output().stdout).unwrap();
    conforms(&value);
    value
}

/// Holds what a command printed against the schema in `docs/schemas` that it names.
pub fn conforms(value: &serde_json::Value) {
    let name = value["schema"].as_str().expect("an output names its schema");
    let file = root().join("docs/schemas").join(format!("{}.json", name.replace('/', ".")));
    let text = std::fs::read(&file).unwrap_or_else(|error| {
        panic!(
            "{name} has no schema: {}: {error}; docs/schemas/README.md tells how to write one",
            file.display()
        )
    });
    let schema = serde_json::from_slice(&text).unwrap();
    let wrong = violations(&schema, value);
    assert!(
        wrong.is_empty(),
        "the output is not as {} says; docs/schemas/README.md tells how to bring them together:\n{}",
        file.display(),
        wrong.join("\n")
    );
}

/// What a JSON Schema refuses about a value.
pub fn violations(schema: &serde_json::Value, value: &serde_json::Value) -> Vec<String> {
    let validator = jsonschema::draft202012::new(schema).expect("the schema is one");
    validator.iter_errors(value).map(|error| format!("{}: {error}", error.instance_path())).collect()
}

pub fn stdout(assert: &Assert) -> String {
    String::from_utf8(assert.get_output().stdout.clone()).unwrap()
}

/// Standard error of a command that must fail with `code`, without a panic.
pub fn refused(mut command: Command, code: i32) -> String {
    let assert = command.assert().code(code);
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(words.contains("error: ") && !words.contains("panicked"), "{words}");
    assert!(words.matches("os error").count() < 2, "a cause is told twice: {words}");
    words
}

/// A recording that was cut or never closed says so, with what to do.
pub fn unclosed(recording: &str) {
    let assert = bench(["info", recording]).assert().code(3);
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(words.contains("was not closed") && words.contains("bench recover"), "{words}");
}
