//! `bench sweep`: plans run, killed, shared, merged, drawn and handed to a cluster.

use std::{
    fs,
    fs::File,
    os::unix::fs::PermissionsExt as _,
    path::Path,
    process::{Command, Stdio},
};

use crate::support::{Page, Scratch, bench, json, refused, root, stdout};

/// A flight of a second, which some airframes fly too high.
const SHORT: &str = "name = \"short\"\ndescription = \"d\"\n[criteria]\npeak_max_m = 0.65\n[[phase]]\nkind = \"idle\"\n\
    duration_s = 0.3\n[[phase]]\nkind = \"launch\"\nthrust_to_weight = 1.2\nduration_s = 0.7\n";
const PLAN: &str = "name = \"short flights\"\ndescription = \"Some are too high.\"\nrigs = [\"virtual\", \"virtual-model\"]\n\
    missions = \"short.toml\"\nairframes = \"drawn\"\nseeds = { first = 0, count = 40 }\nruns_per_part = 10\n\
    [[variant]]\nname = \"as it is\"\n[[variant]]\nname = \"slow\"\n\
    effects.rotor-lag.time_constant_s = { log_uniform = [0.01, 0.3] }\n";
const RUNS: u64 = 160;

fn plan(scratch: &Scratch, text: &str) -> String {
    fs::write(scratch.path("short.toml"), SHORT).unwrap();
    fs::write(scratch.path("plan.toml"), text).unwrap();
    scratch.name("plan.toml")
}

fn bytes(scratch: &Scratch, folder: &str) -> Vec<u8> {
    fs::read(scratch.path(folder).join("results.parquet")).unwrap()
}

#[test]
fn a_plan_is_run_drawn_and_its_worst_run_replayed() {
    let scratch = Scratch::new();
    let plan = plan(&scratch, PLAN);
    let listed = stdout(&bench(["sweep", "list", &plan, "--cost", "--shards", "4"]).assert().success());
    assert!(listed.contains("160 runs in 16 parts") && listed.contains("core hours"), "{listed}");
    let folder = scratch.name("swept");
    let told = json(&bench(["sweep", "run", &plan, "-o", &folder, "--json"]).assert().success());
    assert_eq!((&told["runs"], &told["before"]), (&RUNS.into(), &0.into()));
    let missed = told["outcomes"]["missed"].as_u64().unwrap();
    assert!(missed > 0 && told["outcomes"]["passed"].as_u64().unwrap() + missed == RUNS, "{told}");

    bench(["sweep", "report", &folder]).assert().success();
    let page = Page::read(&scratch.name("swept/report.html"));
    assert!(page.headline().contains("of 160 flights met their missions' criteria"), "{}", page.headline());
    for section in ["Success", "Success against size", "Distributions", "Worst runs"] {
        assert!(!page.section(section).is_empty(), "{section}");
    }
    assert!(!page.plots().is_empty());
    let worst = page.texts("code").into_iter().find(|code| code.starts_with("bench sweep replay")).unwrap();
    let words: Vec<&str> = worst.split(' ').collect();
    let recording = scratch.name("worst.mcap");
    bench(["sweep", "replay", words[3], words[4], "-o", &recording]).assert().success();
    let flown = stdout(&bench(["info", &recording]).assert().success());
    assert!(flown.contains("drawn_airframe"), "{flown}");
    assert!(
        refused(bench(["sweep", "replay", &folder, "zz", "-o", &scratch.name("no.mcap")]), 2)
            .contains("no run")
    );
}

#[test]
fn a_killed_sweep_goes_on_and_shares_come_to_the_same_bytes() {
    let scratch = Scratch::new();
    let plan = plan(&scratch, &PLAN.replace("count = 40", "count = 200"));
    let run = |folder: &str, more: &[&str]| {
        json(
            &bench(["sweep", "run", &plan, "-o", &scratch.name(folder), "--json"])
                .args(more)
                .assert()
                .success(),
        )
    };
    run("whole", &[]);
    let mut process = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["sweep", "run", &plan, "-o", &scratch.name("killed"), "--jobs", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let first = scratch.path("killed/parts/part-00000000.parquet");
    while !first.exists() {
        assert!(process.try_wait().unwrap().is_none(), "it ended without its first part");
        std::thread::yield_now();
    }
    process.kill().unwrap();
    process.wait().unwrap();
    let told = json(&bench(["sweep", "run", &scratch.name("killed"), "--json"]).assert().success());
    let before = told["before"].as_u64().unwrap();
    assert!(before > 0 && before < 800, "{told}");
    assert_eq!(told["runs"], 800);
    assert!(bytes(&scratch, "killed") == bytes(&scratch, "whole"));

    for shard in ["3/3", "1/3", "1/2", "2/3"] {
        run("shared", &["--shard", shard]);
    }
    bench(["sweep", "merge", &scratch.name("shared")]).assert().success();
    assert!(bytes(&scratch, "shared") == bytes(&scratch, "whole"));
}

#[test]
fn a_shard_that_another_process_runs_is_refused() {
    let scratch = Scratch::new();
    let plan = plan(&scratch, PLAN);
    let folder = scratch.name("swept");
    bench(["sweep", "run", &plan, "-o", &folder, "--shard", "1/4"]).assert().success();
    let lock = File::create(scratch.path("swept/locks/shard-2-of-4.lock")).unwrap();
    lock.lock().unwrap();
    let said = refused(bench(["sweep", "run", &folder, "--shard", "2/4"]), 2);
    assert!(said.contains("shard 2/4") && said.contains("another process"), "{said}");
    drop(lock);
    bench(["sweep", "run", &folder, "--shard", "2/4"]).assert().success();
    let said = refused(bench(["sweep", "merge", &folder]), 2);
    assert!(said.contains("80 of 160 runs") && said.contains("run the sweep again"), "{said}");
}

#[test]
fn a_plan_that_is_wrong_is_told_in_full_and_nothing_is_run() {
    let scratch = Scratch::new();
    let wrong = "name = \"x\"\ndescription = \"d\"\nrigs = [\"vitual\", \"virtual\"]\nmissions = \"shortt\"\nseeds = []\n\
        [[variant]]\nname = \"a\"\neffects.rotor-lagg.time_constant_s = 0.1\n";
    let plan_file = plan(&scratch, wrong);
    let folder = scratch.name("swept");
    let said = refused(bench(["sweep", "run", &plan_file, "-o", &folder]), 2);
    for part in ["did you mean virtual?", "no built-in mission", "seeds", "nothing was run", "plan.toml:5"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(!Path::new(&folder).exists());
    let plan_file = plan(
        &scratch,
        &wrong.replace("vitual\", \"", "").replace("shortt", "short.toml").replace("[]", "[1]"),
    );
    assert!(
        refused(bench(["sweep", "run", &plan_file, "-o", &folder]), 2).contains("did you mean rotor-lag?")
    );
    let twice = plan(
        &scratch,
        &PLAN.replace(
            "name = \"slow\"\neffects.rotor-lag.time_constant_s = { log_uniform = [0.01, 0.3] }",
            "name = \"b\"",
        ),
    );
    assert!(refused(bench(["sweep", "run", &twice, "-o", &folder]), 2).contains("counted twice"));
    let suite = root().join("rigs/suites/paper.toml");
    let said = refused(bench(["sweep", "run", suite.to_str().unwrap(), "-o", &folder]), 2);
    assert!(said.contains("a suite of tests"), "{said}");
    assert!(
        refused(bench(["sweep", "run", "robustnes", "-o", &folder]), 2).contains("did you mean robustness?")
    );
    assert!(
        refused(bench(["sweep", "run", "robustness", "-o", &folder, "--shard", "0/4"]), 2)
            .contains("no shard")
    );
}

#[test]
fn a_folder_that_cannot_be_used_is_told_and_a_full_disk_loses_nothing() {
    let scratch = Scratch::new();
    let plan = plan(&scratch, &PLAN.replace("runs_per_part = 10", "runs_per_part = 80"));
    let said = refused(bench(["sweep", "run", &plan, "-o", "/proc/swept"]), 2);
    assert!(said.contains("/proc/swept"), "{said}");
    assert!(refused(bench(["sweep", "run", &plan, "-o", "/dev/full"]), 2).contains("/dev/full"));
    assert!(refused(bench(["sweep", "run", &plan]), 2).contains("--output is missing"));
    assert!(refused(bench(["sweep", "merge", &scratch.name("absent")]), 2).contains("holds no sweep"));

    // The system lets no file of the process grow beyond 8 blocks of 1024 bytes, as a full disk would: a part of 80 runs is longer.
    let folder = scratch.name("swept");
    bench(["sweep", "run", &plan, "-o", &folder, "--shard", "2/2"]).assert().success();
    let limited = Command::new("bash")
        .args(["-c", "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_bench")])
        .args(["sweep", "run", &folder])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&limited.stderr);
    assert_eq!(limited.status.code(), Some(2), "{said}");
    assert!(said.contains("cannot write") && said.contains("part-00000000"), "{said}");
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
    let told = json(&bench(["sweep", "run", &folder, "--json"]).assert().success());
    assert_eq!(told["before"], 80, "what was there before the disk was full is kept: {told}");
    bench(["sweep", "run", &plan, "-o", &scratch.name("whole")]).assert().success();
    assert!(bytes(&scratch, "swept") == bytes(&scratch, "whole"));
}

#[test]
fn what_is_submitted_to_slurm_runs_the_shards() {
    let scratch = Scratch::new();
    let plan = plan(&scratch, PLAN);
    let folder = scratch.name("a folder's");
    let said = refused(bench(["sweep", "slurm", &plan, "-o", &folder, "--shards", "17"]), 2);
    assert!(said.contains("16 parts"), "{said}");
    // A stand-in that notes how it was called; tests/slurm has the real one.
    let sbatch = scratch.path("sbatch");
    fs::write(&sbatch, "#!/bin/sh\necho \"$@\" >> \"${0%/*}/called\"\necho \"42;cluster\"\n").unwrap();
    fs::set_permissions(&sbatch, fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", scratch.name("."), std::env::var("PATH").unwrap());
    let submitted =
        bench(["sweep", "slurm", &plan, "-o", &folder, "--shards", "4", "--option=--time=01:00:00"])
            .env("PATH", path)
            .assert()
            .success();
    assert!(stdout(&submitted).contains("job 42"), "{}", stdout(&submitted));
    let called = fs::read_to_string(scratch.path("called")).unwrap();
    assert!(called.contains("--parsable") && called.contains("--dependency=afterok:42"), "{called}");
    let array = scratch.name("a folder's/slurm/array.sbatch");
    assert!(fs::read_to_string(&array).unwrap().contains("#SBATCH --time=01:00:00\n"));
    for task in 1..=4 {
        let status =
            Command::new("bash").arg(&array).env("SLURM_ARRAY_TASK_ID", task.to_string()).status().unwrap();
        assert!(status.success());
    }
    assert!(
        Command::new("bash").arg(scratch.name("a folder's/slurm/merge.sbatch")).status().unwrap().success()
    );
    bench(["sweep", "run", &plan, "-o", &scratch.name("whole")]).assert().success();
    assert!(bytes(&scratch, "a folder's") == bytes(&scratch, "whole"));

    let nowhere = scratch.path("nowhere");
    fs::create_dir(&nowhere).unwrap();
    let mut without = bench(["sweep", "slurm", &plan, "-o", &folder, "--shards", "4"]);
    without.env("PATH", &nowhere);
    assert!(refused(without, 2).contains("--no-submit"));
}

/// What hands a plan to Kubernetes, in four shards.
fn kubernetes<'a>(plan: &'a str, folder: &'a str) -> [&'a str; 11] {
    let image = "r.example/b:1";
    ["sweep", "kubernetes", plan, "-o", folder, "--shards", "4", "--image", image, "--claim", "c"]
}

#[test]
fn what_kubernetes_runs_names_the_shard_by_the_pods_index() {
    let scratch = Scratch::new();
    let plan = plan(&scratch, PLAN);
    let folder = scratch.name("swept");
    let arguments = kubernetes(&plan, &folder);
    bench(arguments).assert().success();
    let manifest = fs::read_to_string(scratch.path("swept/kubernetes/job.yaml")).unwrap();
    // What the pod's shell is told, as YAML quotes it.
    let line = manifest.lines().find_map(|line| line.trim().strip_prefix("command: ")).unwrap();
    let command: Vec<String> = serde_json::from_str(line).unwrap();
    let script = command[2]
        .replace("/usr/local/bin/bench", env!("CARGO_BIN_EXE_bench"))
        .replace("/sweep/swept", &folder);
    for index in 0..4 {
        let status = Command::new("/bin/sh")
            .args(["-c", &script])
            .env("JOB_COMPLETION_INDEX", index.to_string())
            .status();
        assert!(status.unwrap().success());
    }
    bench(["sweep", "merge", &folder]).assert().success();
    assert!(
        fs::read_to_string(scratch.path("swept/kubernetes/Containerfile")).unwrap().contains("COPY bench ")
    );
    assert!(refused(bench(arguments), 2).contains("--force"));
}

#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_reads_the_results_and_kubernetes_takes_the_manifest() {
    let python = std::env::var_os("BENCH_PYTHON")
        .expect("BENCH_PYTHON names a Python with duckdb and kubernetes-validate");
    let scratch = Scratch::new();
    let plan = plan(&scratch, PLAN);
    let folder = scratch.name("swept");
    let told = json(&bench(["sweep", "run", &plan, "-o", &folder, "--json"]).assert().success());
    bench(kubernetes(&plan, &folder)).assert().success();
    let script = root().join("tests/user/sweep.py");
    let output = Command::new(python).arg(script).arg(&folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(seen["runs"], RUNS);
    assert_eq!(seen["distinct"], RUNS);
    assert_eq!(seen["passed"], told["outcomes"]["passed"]);
    assert_eq!(seen["timed"], RUNS);
    // The variant alone has the effect, and within what the plan says.
    assert_eq!(seen["with_lag"], RUNS / 2);
    assert!(
        seen["least_lag"].as_f64().unwrap() >= 0.01 && seen["most_lag"].as_f64().unwrap() <= 0.3,
        "{seen}"
    );
    assert_eq!(seen["manifest_without_a_name"], "refused", "the validation can fail");
}
