//! What comes with the program: completions, manual pages, udev rules, and the Debian package (`deb_`, marked `ignored`: tests/run builds it
//! and a minimal Debian to try it in).

use std::{collections::BTreeSet, env, fs, process::Command};

use crate::support::{Scratch, bench, refused, root, stdout};

/// The commands that `bench help` lists.
fn commands() -> BTreeSet<String> {
    let help = stdout(&bench(["--help"]).assert().success());
    let list = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    list.lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .map(|line| line.split_whitespace().next().unwrap().to_owned())
        .filter(|name| name != "help")
        .collect()
}

#[test]
fn bash_completes_commands_and_arguments() {
    let scratch = Scratch::new();
    let script = scratch.path("bench.bash");
    fs::write(&script, stdout(&bench(["completions", "bash"]).assert().success())).unwrap();
    let complete = |words: &[&str]| -> BTreeSet<String> {
        // As bash calls it: the words of the line, and which of them is being completed.
        let ask = format!(
            "source {}; COMP_WORDS=({}); COMP_CWORD={}; _bench bench '{}' '{}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
            script.display(),
            words.join(" "),
            words.len() - 1,
            words[words.len() - 1],
            words[words.len() - 2],
        );
        let output = Command::new("bash").args(["--norc", "-c", &ask]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().lines().map(|line| line.trim().to_owned()).collect()
    };
    assert_eq!(complete(&["bench", "si"]), BTreeSet::from(["sim".to_owned()]));
    assert_eq!(complete(&["bench", "sim", "--missio"]), BTreeSet::from(["--mission".to_owned()]));
    let missing: Vec<_> = commands().difference(&complete(&["bench", "''"])).cloned().collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn zsh_and_fish_know_every_command() {
    for (shell, head) in [("zsh", "#compdef bench"), ("fish", "# Print an optspec")] {
        let script = stdout(&bench(["completions", shell]).assert().success());
        assert!(script.starts_with(head), "{shell}: {}", script.lines().next().unwrap());
        for command in commands() {
            assert!(
                script.contains(&format!("{command}\"")) || script.contains(&format!("'{command}:")),
                "{shell}: {command}"
            );
        }
    }
    refused(bench(["completions", "cmd"]), 2);
}

#[test]
fn each_command_has_a_manual_page_with_its_examples() {
    let scratch = Scratch::new();
    let folder = scratch.name("man1");
    bench(["man", "-o", &folder]).assert().success();
    for command in commands() {
        let page = fs::read_to_string(scratch.path("man1").join(format!("bench-{command}.1"))).unwrap();
        assert!(page.lines().any(|line| line.starts_with(".TH")), "{command}");
        assert!(page.contains(&format!("bench {command}").replace('-', "\\-")), "{command} has no example");
    }
    assert!(scratch.path("man1/bench-identify-thrust.1").exists(), "commands of commands have theirs");

    // The same again is fine; a page of somebody else is not replaced.
    bench(["man", "-o", &folder]).assert().success();
    fs::write(scratch.path("man1/bench-sim.1"), ".TH mine\n").unwrap();
    let words = refused(bench(["man", "-o", &folder]), 2);
    assert!(words.contains("bench-sim.1 exists and differs") && words.contains("--force"), "{words}");
    bench(["man", "-o", &folder, "--force"]).assert().success();
    assert!(fs::read_to_string(scratch.path("man1/bench-sim.1")).unwrap().contains("bench"));
}

#[test]
fn udev_rules_are_installed_once_and_never_over_others() {
    let scratch = Scratch::new();
    let rules = stdout(&bench(["udev"]).assert().success());
    for number in ["045e", "02ae", "02ad", "02b0", "04b4", "f232"] {
        assert!(rules.contains(number), "{number}");
    }
    let folder = scratch.name("rules.d");
    let words = refused(bench(["udev", "--install", "--folder", &folder]), 2);
    assert!(words.contains("is udev installed here?"), "{words}");
    fs::create_dir(&folder).unwrap();
    bench(["udev", "--install", "--folder", &folder]).assert().success();
    let path = scratch.path("rules.d/60-bench.rules");
    assert_eq!(fs::read_to_string(&path).unwrap(), rules);
    bench(["udev", "--install", "--folder", &folder])
        .assert()
        .success()
        .stderr(format!("{} is there already\n", path.display()));

    fs::write(&path, "# mine\n").unwrap();
    let words = refused(bench(["udev", "--install", "--folder", &folder]), 2);
    assert!(words.contains("differs") && words.contains("--force"), "{words}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "# mine\n");
    bench(["udev", "--install", "--folder", &folder, "--force"]).assert().success();
    assert_eq!(fs::read_to_string(&path).unwrap(), rules);
}

#[test]
fn who_may_not_write_the_rules_is_told_how() {
    // Nobody may write there, not even root.
    let words = refused(bench(["udev", "--install", "--folder", "/proc/sys"]), 2);
    assert!(words.contains("cannot write /proc/sys/60-bench.rules") && words.contains("sudo"), "{words}");
}

/// A command in a clean root without a network; its output if it succeeds.
fn in_root(clean: &std::path::Path, command: &str) -> String {
    let output = Command::new("unshare")
        .arg("--net")
        .arg("chroot")
        .arg(clean)
        .args(["/bin/sh", "-ec", command])
        .env_clear()
        .env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin")
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{command}: {}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout) + &text(&output.stderr)
}

#[test]
#[ignore = "needs the Debian package and a minimal Debian; tests/run makes both"]
fn deb_installs_into_a_clean_debian_and_flies() {
    let package = env::var("BENCH_DEB").expect("BENCH_DEB names the package");
    let minimal = env::var("BENCH_DEB_ROOT").expect("BENCH_DEB_ROOT names the root of a minimal Debian");
    let scratch = Scratch::new();
    let clean = scratch.path("root");
    assert!(Command::new("cp").arg("--archive").arg(&minimal).arg(&clean).status().unwrap().success());
    fs::copy(&package, clean.join("bench.deb")).unwrap();

    in_root(&clean, "dpkg --install /bench.deb");
    assert!(in_root(&clean, "bench --version").starts_with("bench "));
    in_root(&clean, "bench sim -o /tmp/first.mcap --export /tmp/first.xlsx");
    assert!(in_root(&clean, "bench info /tmp/first.mcap").contains("climb-040"));
    for file in [
        "usr/lib/udev/rules.d/60-bench.rules",
        "usr/share/bash-completion/completions/bench",
        "usr/share/zsh/vendor-completions/_bench",
        "usr/share/fish/vendor_completions.d/bench.fish",
        "usr/share/man/man1/bench-sim.1.gz",
    ] {
        // A minimal Debian may leave out documentation; the package has it.
        let listed = in_root(&clean, "dpkg --listfiles bench");
        assert!(listed.lines().any(|line| line.trim_start_matches('/') == file), "{file} is not in {listed}");
    }
    let rules = fs::read(clean.join("usr/lib/udev/rules.d/60-bench.rules")).unwrap();
    assert_eq!(rules, fs::read(root().join("crates/bench/packaging/60-bench.rules")).unwrap());
    in_root(&clean, "dpkg --purge bench && ! command -v bench");
}
