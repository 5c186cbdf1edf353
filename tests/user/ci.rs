//! The files of docs/ci: held against the schemas of their services, and every shell command in them run as the services run it.

use std::{collections::BTreeMap, fs, os::unix::fs::PermissionsExt as _, path::PathBuf, process::Command};

use serde::{Deserialize, de::DeserializeOwned};

use crate::{
    hil::{Emulated, short_mission},
    support::{Scratch, root},
};

/// A user's suite: one test for CI, and a pair for the lab.
const SUITE: &str = r#"
name = "flight"
description = "It climbs, and hardware flies as simulated."

[[case]]
name = "climb"
rig = "virtual"
mission = "climb-040"
tags = ["ci"]

[[case]]
name = "board"
rig = "loopback"
mission = "short.toml"
mode = ["sim", "loopback"]
compare = "back-to-back"
tags = ["lab"]
"#;

/// `/dev/ttyACM0` of the lab's jobs, which nobody has here.
const BOARD: &str = "/dev/ttyACM0";

#[derive(Deserialize)]
struct GitHub {
    jobs: BTreeMap<String, GitHubJob>,
}

#[derive(Deserialize)]
struct GitHubJob {
    steps: Vec<Step>,
}

#[derive(Deserialize)]
struct Step {
    #[serde(default)]
    uses: String,
    run: Option<String>,
    #[serde(default)]
    env: BTreeMap<String, String>,
    #[serde(default)]
    with: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct GitLabJob {
    script: Vec<String>,
    #[serde(default)]
    variables: BTreeMap<String, String>,
    artifacts: Artifacts,
}

#[derive(Deserialize)]
struct Artifacts {
    paths: Vec<String>,
    reports: BTreeMap<String, String>,
}

fn text(file: &str) -> String {
    fs::read_to_string(root().join("docs/ci").join(file)).unwrap()
}

fn read<T: DeserializeOwned>(text: &str) -> T {
    serde_saphyr::from_str(text).unwrap()
}

/// A workflow with its commented-out job for the lab in it.
fn with_lab(workflow: &str) -> String {
    let mut in_lab = false;
    let lines = workflow.lines().map(|line| {
        let Some((indent, rest)) = line.split_once("# ") else { return line.to_owned() };
        in_lab |= rest == "lab:";
        if in_lab && indent.trim().is_empty() { format!("{indent}{rest}") } else { line.to_owned() }
    });
    let text: Vec<String> = lines.collect();
    assert!(in_lab, "{workflow}");
    text.join("\n") + "\n"
}

/// A machine that a job runs on: a folder with the checked-out repository, a home, and nothing of this machine's environment.
struct Runner {
    scratch: Scratch,
    /// What `$GITHUB_PATH` names; also where it is looked for commands first.
    path: PathBuf,
    environment: BTreeMap<String, String>,
}

impl Runner {
    fn new() -> Self {
        let scratch = Scratch::new();
        for folder in ["repository/tests", "home", "commands"] {
            fs::create_dir_all(scratch.path(folder)).unwrap();
        }
        fs::write(scratch.path("repository/tests/flight.toml"), SUITE).unwrap();
        short_mission(&scratch);
        fs::rename(scratch.path("short.toml"), scratch.path("repository/tests/short.toml")).unwrap();
        let path = scratch.path("added-to-path");
        fs::write(&path, "").unwrap();
        let set = |name: &str, file: &str| (name.to_owned(), scratch.name(file));
        let environment = [
            set("HOME", "home"),
            set("GITHUB_PATH", "added-to-path"),
            set("GITHUB_STEP_SUMMARY", "summary.md"),
            set("CI_PROJECT_DIR", "repository"),
        ];
        Self { scratch, path, environment: environment.into() }
    }

    fn repository(&self, file: &str) -> PathBuf {
        self.scratch.path("repository").join(file)
    }

    /// Puts the built program on the path, as the image has it, or the machine beside the bench.
    fn install(&self) {
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_bench"), self.scratch.path("commands/bench")).unwrap();
    }

    /// GitHub's command line, which has the built program in the release that the workflow takes it from, and nothing else.
    fn install_gh(&self) {
        let gh = format!(
            "#!/bin/sh\n[ -n \"$GH_TOKEN\" ] || {{ echo 'gh: set GH_TOKEN' >&2; exit 4; }}\n\
             [ \"$1 $2 $3 $4 $5 $6\" = 'release download bench --pattern bench --output' ] && [ \"$8\" = --clobber ] && [ $# -eq 8 ] || exit 1\n\
             exec cp '{}' \"$7\"\n",
            env!("CARGO_BIN_EXE_bench")
        );
        fs::write(self.scratch.path("commands/gh"), gh).unwrap();
        fs::set_permissions(self.scratch.path("commands/gh"), fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Runs a script by the shell and the options that both services use.
    fn run(&self, script: &str, own: &BTreeMap<String, String>) {
        assert!(!script.contains("${{"), "an expression of the service, which this does not know: {script}");
        let file = self.scratch.path("script");
        fs::write(&file, script).unwrap();
        let added = fs::read_to_string(&self.path).unwrap();
        let mut path: Vec<&str> = added.lines().collect();
        let commands = self.scratch.name("commands");
        path.extend([commands.as_str(), "/usr/bin", "/bin"]);
        let output = Command::new("bash")
            .args(["--noprofile", "--norc", "-eo", "pipefail"])
            .arg(&file)
            .current_dir(self.repository(""))
            .env_clear()
            .envs(&self.environment)
            .envs(own)
            .env("PATH", path.join(":"))
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{script}\n{}{}",
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
    }

    /// Runs the steps of a job on GitHub; how many shell scripts that were.
    fn run_github(&self, job: &GitHubJob) -> usize {
        let mut scripts = 0;
        for step in &job.steps {
            let own = step.env.iter().map(|(name, value)| {
                let value = value.replace("${{ github.token }}", "a token");
                assert!(!value.contains("${{"), "{name}: {value}");
                (name.clone(), value)
            });
            if let Some(script) = &step.run {
                self.run(script, &own.collect());
                scripts += 1;
            } else if step.uses.starts_with("actions/upload-artifact@") {
                self.has_results(&step.with["path"]);
            }
        }
        scripts
    }

    fn run_gitlab(&self, job: &GitLabJob) {
        let project = &self.environment["CI_PROJECT_DIR"];
        let own = job
            .variables
            .iter()
            .map(|(name, value)| (name.clone(), value.replace("$CI_PROJECT_DIR", project)))
            .collect();
        self.run(&job.script.join("\n"), &own);
        for path in &job.artifacts.paths {
            self.has_results(path);
        }
        let junit = fs::read_to_string(self.repository(&job.artifacts.reports["junit"])).unwrap();
        assert!(junit.contains("<testsuite "), "{junit}");
    }

    fn has_results(&self, folder: &str) {
        for file in ["junit.xml", "report.html", "results.json"] {
            assert!(self.repository(folder).join(file).is_file(), "{folder}/{file}");
        }
    }
}

/// Names of the jobs of a workflow.
fn jobs<T>(jobs: &BTreeMap<String, T>) -> Vec<&str> {
    jobs.keys().map(String::as_str).collect()
}

#[test]
fn the_github_workflow_installs_the_bench_and_flies_a_suite() {
    let workflow: GitHub = read(&text("github.yml"));
    assert_eq!(jobs(&workflow.jobs), ["simulated"]);
    let runner = Runner::new();
    runner.install_gh();
    assert_eq!(runner.run_github(&workflow.jobs["simulated"]), 2);
    assert!(runner.scratch.path("home/.local/bin/bench").is_file());
    let summary = fs::read_to_string(runner.scratch.path("summary.md")).unwrap();
    assert!(summary.contains("climb") && !summary.contains("board"), "{summary}");
}

#[test]
fn a_github_workflow_without_the_release_says_so_and_flies_nothing() {
    let workflow: GitHub = read(&text("github.yml"));
    let runner = Runner::new();
    fs::write(runner.scratch.path("commands/gh"), "#!/bin/sh\necho 'release not found' >&2\nexit 1\n")
        .unwrap();
    fs::set_permissions(runner.scratch.path("commands/gh"), fs::Permissions::from_mode(0o755)).unwrap();
    let run = std::panic::AssertUnwindSafe(|| runner.run_github(&workflow.jobs["simulated"]));
    let panic = std::panic::catch_unwind(run).unwrap_err();
    assert!(panic.downcast_ref::<String>().unwrap().contains("release not found"));
    assert!(!runner.repository("test-results").exists());
}

#[test]
fn the_gitlab_pipeline_flies_a_suite() {
    let pipeline: BTreeMap<String, GitLabJob> = read(&text("gitlab.yml"));
    assert_eq!(jobs(&pipeline), ["simulated"]);
    let runner = Runner::new();
    runner.install();
    runner.run_gitlab(&pipeline["simulated"]);
}

#[test]
fn the_jobs_for_the_lab_fly_a_suite_through_a_board() {
    let scratch = Scratch::new();
    let board = Emulated::start(&scratch, &[]);
    let on_board = |file: &str| {
        let text = with_lab(&text(file));
        assert_eq!(text.matches(BOARD).count(), 1, "{text}");
        text.replace(BOARD, &board.port)
    };
    let logged = |runner: &Runner| {
        assert!(runner.scratch.path("home/station/runs.sqlite").is_file());
        // Tolerances were derived, and are kept where the workflow keeps them.
        assert!(runner.scratch.path("home/.cache/bench/repeats").is_dir());
    };
    let runner = Runner::new();
    runner.install();
    let workflow: GitHub = read(&on_board("github.yml"));
    assert_eq!(runner.run_github(&workflow.jobs["lab"]), 1);
    logged(&runner);
    let runner = Runner::new();
    runner.install();
    let pipeline: BTreeMap<String, GitLabJob> = read(&on_board("gitlab.yml"));
    runner.run_gitlab(&pipeline["lab"]);
    logged(&runner);
}

#[test]
#[ignore = "needs Python's check-jsonschema: tests/run"]
fn python_ci_files_are_as_their_services_want() {
    let scratch = Scratch::new();
    let python = std::env::var("BENCH_PYTHON").expect("BENCH_PYTHON is set by tests/run");
    let services: [(&str, &[&str]); 2] = [
        ("github.yml", &["vendor.github-workflows"]),
        ("gitlab.yml", &["vendor.gitlab-ci", "--data-transform", "gitlab-ci"]),
    ];
    for (file, schema) in services {
        let text = text(file);
        let with_lab = with_lab(&text);
        assert!(with_lab.matches("bench test ").count() == 2, "{with_lab}");
        let check = |name: &str, text: &str| {
            let path = scratch.name(name);
            fs::write(&path, text).unwrap();
            let mut check = Command::new(&python);
            check
                .args(["-m", "check_jsonschema", "--builtin-schema"])
                .args(schema)
                .arg(path)
                .output()
                .unwrap()
        };
        for text in [&text, &with_lab] {
            let checked = check(file, text);
            assert!(checked.status.success(), "{file}: {}", String::from_utf8_lossy(&checked.stdout));
        }
        // It does refuse.
        assert!(
            !check(file, &with_lab.replace("tags:", "tag:").replace("runs-on:", "run-on:")).status.success()
        );
    }
}

#[test]
fn the_image_is_built_by_the_rust_that_all_is_tested_with() {
    let read = |file: &str| fs::read_to_string(root().join(file)).unwrap();
    let toolchain: toml::Value = toml::from_str(&read("rust-toolchain.toml")).unwrap();
    let version = toolchain["toolchain"]["channel"].as_str().unwrap().rsplit_once('.').unwrap().0;
    let image = read("docs/ci/Containerfile");
    assert!(image.contains(&format!("/rust:{version}-slim-bookworm AS build\n")), "{version}: {image}");
}
