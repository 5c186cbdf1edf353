//! The C implementation, built once with the system's compiler and run as a program.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Undefined behaviour (an index beyond an array, a bad shift) ends the program instead of passing unnoticed.
const FLAGS: [&str; 9] = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-pedantic",
    "-Wconversion",
    "-O1",
    "-fsanitize=undefined",
    "-fsanitize-undefined-trap-on-error",
];

pub fn package_dir() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn scratch(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()))
}

fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let sources = package_dir().join("c");
        let built = scratch("bench_proto_test");
        let mut cc = Command::new("cc");
        cc.args(FLAGS).arg(sources.join("bench_proto.c")).arg(sources.join("bench_proto_test.c"));
        let output = cc.arg("-o").arg(&built).output().expect("a C compiler called `cc` is on the path");
        assert_succeeded(&output);
        // One name for good: test processes that run at once replace each other's program with an equal one.
        let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench_proto_test");
        fs::rename(built, &program).unwrap();
        program
    })
}

fn assert_succeeded(output: &Output) {
    assert!(output.status.success(), "{}: {}", output.status, String::from_utf8_lossy(&output.stderr));
}

/// Checks golden files and gives the program's summary.
pub fn check_golden(files: &[PathBuf]) -> String {
    let output = Command::new(program()).arg("golden").args(files).output().unwrap();
    assert_succeeded(&output);
    String::from_utf8(output.stdout).unwrap()
}

/// What the C decoder makes of a stream, as records.
pub fn decode(sender: &str, stream: &[u8]) -> String {
    static CALLS: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    let call = CALLS.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let path = scratch(&format!("stream-{call}"));
    fs::write(&path, stream).unwrap();
    let stdin = File::open(&path).unwrap();
    let output = Command::new(program()).args(["decode", sender]).stdin(stdin).output().unwrap();
    fs::remove_file(path).unwrap();
    assert_succeeded(&output);
    String::from_utf8(output.stdout).unwrap()
}
