//! An emulated Kinect on a real kernel's USB, and two clients: the driver, and libfreenect, which knows nothing of either.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use bench_emulated_lab::{Faults, Reel, Settings};
use bench_kinect::fakenect::Replay;
use bench_rig::Rig;
use bench_usb_lab::host::{Lab, Outcome};
use tempfile::TempDir;

const SEED: u64 = 3;

fn rig() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml").canonicalize().unwrap()
}

fn reel() -> Reel {
    Reel::new(&Rig::load(rig()).unwrap(), SEED).unwrap()
}

fn variable(name: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| panic!("{name} is set by tests/run"))
}

/// Runs a script in the kernel with a Kinect plugged in; `$client` is the driver's client, `$work` the folder.
fn run(faults: Faults, script: &str, patience_s: u64) -> (TempDir, Outcome) {
    let work = tempfile::tempdir().unwrap();
    let settings = Settings {
        rig: rig(),
        effects: vec![],
        seed: SEED,
        board: None,
        board_drift_v: 0.0,
        truth: None,
        hidden_while: None,
        faults,
    };
    settings.write(work.path()).unwrap();
    let lab = Lab::from_env(env!("CARGO_BIN_EXE_emulated-lab"))
        .expect("BENCH_USB_KERNEL names the kernel (tests/run)");
    let prelude = format!(
        "client={}\nwork=$PWD\nappears() {{ until [ -e /dev/bus/usb/001/002 ]; do sleep 0.05; done; }}\nappears\n",
        env!("CARGO_BIN_EXE_kinect-client")
    );
    let outcome = lab.run(work.path(), &(prelude + script), Duration::from_secs(patience_s)).unwrap();
    (work, outcome)
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The files of a kind, by the number of their frame.
fn images(folder: &Path, kind: &str) -> BTreeMap<u64, Vec<u8>> {
    fs::read_dir(folder)
        .unwrap()
        .filter_map(|entry| {
            let path = entry.unwrap().path();
            let ticks = path.file_name()?.to_str()?.strip_prefix(kind)?.strip_prefix('-')?.parse().ok()?;
            Some((Reel::number(ticks, 0), fs::read(path).unwrap()))
        })
        .collect()
}

fn words(bytes: &[u8]) -> Vec<u16> {
    bytes.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect()
}

#[test]
#[ignore = "needs a user-mode kernel and libfreenect: tests/run"]
fn usb_both_clients_get_the_same_frames_and_the_same_depths() {
    let theirs = variable("BENCH_FREENECT_CLIENT");
    let script = format!(
        "mkdir ours theirs
        $client frames ours 8 || exit 1
        {theirs} theirs 8 bayer+raw || exit 2
        mkdir theirs/mm
        {theirs} theirs/mm 8 bayer+mm || exit 3"
    );
    let (work, outcome) = run(Faults::default(), &script, 600);
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    let reel = reel();
    let (ours, theirs) = (work.path().join("ours"), work.path().join("theirs"));
    for folder in [&ours, &theirs] {
        let (bayer, raw) = (images(folder, "bayer"), images(folder, "raw"));
        assert!(bayer.len() == 8 && raw.len() == 8, "{}", folder.display());
        for (number, image) in &bayer {
            assert!(image[..] == reel.content(*number).colour[..], "{} colour {number}", folder.display());
        }
        for (number, image) in &raw {
            assert!(words(image) == reel.content(*number).depth[..], "{} depth {number}", folder.display());
        }
    }
    // Millimetres of the same raw frames. Frames of the two runs differ in number, and repeat after six.
    let mut compared = 0;
    for (number, theirs) in images(&theirs.join("mm"), "mm") {
        for (_, ours) in images(&ours, "mm").into_iter().filter(|(other, _)| other % 6 == number % 6) {
            for (pixel, (ours, theirs)) in words(&ours).into_iter().zip(words(&theirs)).enumerate() {
                // libfreenect gives nothing beyond 10 m, and 0 without a reading.
                if ours > 0 && theirs > 0 {
                    assert!(
                        ours.abs_diff(theirs) <= 1,
                        "frame {number} pixel {pixel}: {ours} and {theirs} mm"
                    );
                    compared += 1;
                }
            }
        }
    }
    // A tenth of each image are holes, and the sides see past the room.
    assert!(compared > 8 * 150_000, "{compared}");
}

#[test]
#[ignore = "needs a user-mode kernel and libfreenect: tests/run"]
fn usb_recordings_by_libfreenects_own_recorder_are_read_here() {
    let script = "echo plug 1 > /run/usb-lab
        until [ $(ls /dev/bus/usb/001 | wc -l) -eq 3 ]; do sleep 0.05; done
        fakenect-record theirs > $work/talk 2>&1 &
        id=$!
        until [ $(ls theirs 2>/dev/null | grep -c ppm) -ge 12 ]; do sleep 0.1; done
        kill -INT $id
        wait $id";
    let (work, outcome) = run(Faults::default(), script, 600);
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    let reel = reel();
    let mut replay = Replay::open(work.path().join("theirs")).unwrap();
    assert!(replay.frames() >= 6, "{}", replay.frames());
    while let Some(frame) = replay.next_frame().unwrap() {
        let truth = reel.content(Reel::number(frame.colour_ticks, 0));
        assert!(frame.depth == truth.depth);
        // Its colours are interpolated; each pixel's own is as it was.
        assert!(frame.colour == truth.colour);
    }
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_two_percent_of_packets_lost_for_as_long_as_asked() {
    // Ten minutes: BENCH_SOAK_S=600.
    let seconds: u64 = std::env::var("BENCH_SOAK_S").map_or(15, |text| text.parse().unwrap());
    let script = format!("$client soak {} {SEED} {seconds} > $work/report.json", rig().display());
    let (work, outcome) = run(Faults { loss: 0.02, ..Faults::default() }, &script, seconds * 20 + 600);
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    let report = json(&work.path().join("report.json"));
    println!("{report}");
    let count = |stream: &str, what: &str| report[stream][what].as_u64().unwrap() as f64;
    assert_eq!((&report["wrong_pixels"], &report["ended"]), (&0.into(), &serde_json::Value::Null));
    for (stream, packets) in [("colour", 162.0), ("depth", 242.0)] {
        let (images, lost) = (count(stream, "images"), count(stream, "lost"));
        // Of 2 % of the packets, four deviations.
        let expected = 0.02 * images * packets;
        assert!(
            (lost - expected).abs() < 4.0 * expected.sqrt() + 10.0,
            "{stream}: {lost} of {expected}: {report}"
        );
        // Six or more in a row, or a broken beginning, are one in a million images.
        assert!(count(stream, "refused") <= 2.0, "{report}");
    }
    // All but those of the start.
    assert!(report["frames"].as_u64().unwrap() > (seconds - 1) * 30, "{report}");
    let memory = |when: &str| report["resident_kb"][when].as_u64().unwrap();
    // A frame's buffers are 1.3 MB; a leak of one packet in a hundred would be ten times this in ten minutes.
    assert!(memory("end") <= memory("early") + 512, "{report}");
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_jitter_and_a_stall_cost_frames_and_nothing_else() {
    let script = format!("$client soak {} {SEED} 6 > $work/report.json", rig().display());
    let faults = Faults { jitter_s: 0.02, stall_at_s: 2.0, stall_s: 1.0, ..Faults::default() };
    let (work, outcome) = run(faults, &script, 600);
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    let report = json(&work.path().join("report.json"));
    assert_eq!(
        (&report["wrong_pixels"], &report["ended"]),
        (&0.into(), &serde_json::Value::Null),
        "{report}"
    );
    // Five seconds of six, of which jitter costs some; not the sixth.
    let frames = report["frames"].as_u64().unwrap();
    assert!((60..=152).contains(&frames), "{report}");
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_a_kinect_that_is_unplugged_in_mid_stream_is_told_and_streams_again_once_it_is_back() {
    let script = format!(
        "$client soak {rig} {SEED} 60 > $work/first.json & 
        client_id=$!
        sleep 3
        echo unplug 0 > /run/usb-lab
        wait $client_id || exit 1
        while ls /dev/bus/usb/001 | grep -qv 001; do sleep 0.05; done
        $client frames $work 1 2> $work/missing
        [ $? -eq 2 ] || exit 2
        echo plug 1 > /run/usb-lab
        until [ $(ls /dev/bus/usb/001 | wc -l) -eq 2 ]; do sleep 0.05; done
        $client frames $work 1 2> $work/unpowered
        [ $? -eq 2 ] || exit 3
        echo plug 0 > /run/usb-lab
        until [ $(ls /dev/bus/usb/001 | wc -l) -eq 3 ]; do sleep 0.05; done
        $client soak {rig} {SEED} 2 > $work/second.json || exit 4",
        rig = rig().display()
    );
    let (work, outcome) = run(Faults::default(), &script, 600);
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    let first = json(&work.path().join("first.json"));
    assert!(first["ended"].as_str().is_some_and(|words| words.contains("the Kinect is gone")), "{first}");
    assert_eq!(first["wrong_pixels"], 0);
    let read = |name: &str| fs::read_to_string(work.path().join(name)).unwrap();
    assert!(read("missing").contains("not on the USB; plug in"), "{}", read("missing"));
    assert!(read("unpowered").contains("plug in the Kinect's own power supply"), "{}", read("unpowered"));
    assert!(json(&work.path().join("second.json"))["frames"].as_u64().unwrap() > 20);
}
