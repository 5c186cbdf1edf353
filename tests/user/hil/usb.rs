//! A real kernel's `/dev/ttyACM0`, in user mode; behind it the C firmware as a Linux program.

use std::{fs, os::unix::fs::PermissionsExt, time::Duration};

use bench_usb_lab::host::{Lab, Outcome};

use super::short_mission;
use crate::support::{Scratch, json, root};

/// Runs a shell script in the kernel, with the board in port 0.
fn run(scratch: &Scratch, script: &str) -> Outcome {
    let variable = |name| std::env::var(name).unwrap_or_else(|_| panic!("{name} is set by tests/run"));
    let lab =
        Lab::from_env(variable("BENCH_USB_INIT")).expect("BENCH_USB_KERNEL names the kernel (tests/run)");
    let board = format!(
        "#!/bin/sh\nBOARD_TRACE={} exec {}\n",
        scratch.name("trace"),
        variable("BENCH_FIRMWARE_HOST")
    );
    fs::write(scratch.path("board"), board).unwrap();
    fs::set_permissions(scratch.path("board"), fs::Permissions::from_mode(0o755)).unwrap();
    fs::write(scratch.path("device"), scratch.name("board")).unwrap();
    let prelude = format!(
        "bench={}\nwork=$PWD\ncd {}\nappears() {{ until [ -e /dev/ttyACM0 ]; do sleep 0.05; done; }}\n",
        env!("CARGO_BIN_EXE_bench"),
        root().display()
    );
    let outcome = lab.run(&scratch.path(""), &(prelude + script), Duration::from_secs(1200)).unwrap();
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    outcome
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_flight_through_a_cdc_acm_port() {
    let scratch = Scratch::new();
    short_mission(&scratch);
    run(
        &scratch,
        "appears
        $bench devices --json > $work/devices.json
        $bench hil --port /dev/ttyACM0 --mission $work/short.toml -o $work/flown.mcap --json > $work/report.json",
    );
    let read = |name: &str| -> serde_json::Value {
        let told = serde_json::from_str(&fs::read_to_string(scratch.path(name)).unwrap()).unwrap();
        crate::support::conforms(&told);
        told
    };
    let devices = read("devices.json");
    let port = &devices["ports"][0];
    assert_eq!((&port["path"], &port["usb"]["vendor"]), (&"/dev/ttyACM0".into(), &"04b4".into()));
    let report = read("report.json");
    assert_eq!((&report["ending"], &report["passed"]), (&"complete".into(), &true.into()));
    assert_eq!(report["outputs_at_zero"]["confirmed"], true);
    let info =
        json(&crate::support::bench(["info", &scratch.name("flown.mcap"), "--json"]).assert().success());
    assert_eq!(info["mode"], "hil");
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_board_that_is_unplugged_in_flight_stops_it_and_flies_again_once_it_is_back() {
    let scratch = Scratch::new();
    short_mission(&scratch);
    run(
        &scratch,
        "appears
        $bench hil --port /dev/ttyACM0 --mission $work/short.toml -o $work/first.mcap > $work/first 2>&1 &
        until [ $(grep -c applied $work/trace) -ge 20 ]; do sleep 0.05; done
        echo unplug 0 > /run/usb-lab
        while [ -e /dev/ttyACM0 ]; do sleep 0.05; done
        sleep 1
        echo plug 0 > /run/usb-lab
        wait $!
        echo $? > $work/first.code
        appears
        $bench hil --port /dev/ttyACM0 --mission $work/short.toml -o $work/second.mcap > $work/second 2>&1",
    );
    let read = |name: &str| fs::read_to_string(scratch.path(name)).unwrap();
    let first = read("first");
    assert_eq!(read("first.code").trim(), "4", "{first}");
    assert!(first.contains("fault: the PSoC5 is gone (/dev/ttyACM0"), "{first}");
    assert!(first.contains("after opening the port again, outputs seen at zero"), "{first}");
    crate::support::bench(["info", &scratch.name("first.mcap")]).assert().success();
    assert!(read("second").contains("outputs seen at zero, board disarmed"));
}
