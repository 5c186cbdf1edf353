//! How well the loop keeps its time: a loopback flight through the real driver and an emulated board on a pty, recorded.
//!
//! `cargo bench -p bench-run --bench real_time -- --rate-hz 1000 --seconds 10` prints one line of JSON; without a rate, all three of
//! `docs/performance.md` for a short while. Times are in seconds.

use std::path::Path;

use bench_dac::{
    Psoc5,
    emulator::{EmulatedPsoc5, LinkFaults},
};
use bench_recording::{Mode, Options, Recorder, Session};
use bench_rig::{Mission, PhaseAction, Rig};
use bench_run::{Ending, Granted, Loopback, Percentiles, WallClock, await_marker, drain_truth, fly_guarded};

fn main() {
    let arguments: Vec<_> = std::env::args().collect();
    let value = |name: &str| -> Option<f64> {
        let at = arguments.iter().position(|argument| argument == name)?;
        Some(arguments.get(at + 1)?.parse().expect("a number"))
    };
    let rates = value("--rate-hz").map_or(vec![10.0, 100.0, 1000.0], |rate| vec![rate]);
    for rate_hz in rates {
        println!("{}", measure(rate_hz, value("--seconds").unwrap_or(3.0)));
    }
}

fn measure(rate_hz: f64, seconds: f64) -> String {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let mut rig = Rig::load(rigs.join("loopback.toml")).unwrap();
    rig.control_loop.period_s = 1.0 / rate_hz;
    rig.safety.overrun_streak = 10_000;
    let mut mission = Mission::load(rigs.join("missions/climb-040.toml")).unwrap();
    mission.phases.retain(|phase| !matches!(phase.action, PhaseAction::Land { .. }));
    let before_s = mission.duration_s() - mission.phases[2].duration_s;
    mission.phases[2].duration_s = (seconds - before_s).max(1.0);

    let folder = tempfile::tempdir().unwrap();
    let session = Session::new(Mode::Hil);
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(path, &session, Options::REAL_TIME).unwrap();
    let granted = Granted::ask();
    // After that, so that the board does not wait for other processes either.
    let board = EmulatedPsoc5::start(LinkFaults::default(), 1, None).unwrap();
    let mut driver = Psoc5::connect(board.port().to_str().unwrap(), &rig).unwrap();
    driver.calibrate().unwrap();
    let mut clock = WallClock::start();
    let (mut output, mut tracker) = Loopback::new(&rig, 1, clock).unwrap().ends(&mut driver);
    assert!(await_marker(&mut clock, &mut tracker, 5.0).unwrap(), "no marker");
    let world = output.world();
    output.inner().arm().unwrap();
    let ends = (&mut clock, &mut output, &mut tracker);
    let flown = fly_guarded(ends, &rig, &mission, &mut recorder, |_, recorder| {
        drain_truth(&world, recorder);
        true
    });
    assert_eq!(flown.ending, Ending::Complete);
    let dropped = recorder.finish().unwrap().dropped;
    let summary = flown.summary;
    let times = |p: Percentiles| format!(r#"{{"p50":{},"p99":{},"max":{}}}"#, p.p50, p.p99, p.max);
    format!(
        r#"{{"rate_hz":{rate_hz},"ticks":{},"lateness_s":{},"round_trip_s":{},"overruns":{},"unanswered":{},"dropped":{dropped},"fifo":{},"locked":{}}}"#,
        summary.ticks,
        times(summary.timing.lateness_s),
        times(summary.timing.round_trip_s),
        summary.overruns,
        summary.unanswered,
        granted.no_priority.is_none(),
        granted.no_lock.is_none(),
    )
}
