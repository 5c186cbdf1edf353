//! The driver against the emulated board, over a pty: what `bench hil` and its user rely on. Nothing here depends on how fast the machine
//! is, but for time-outs that are long.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use bench_dac::{
    DacError, Psoc5, Safe,
    emulator::{EmulatedPsoc5, LinkFaults},
};
use bench_device::{DeviceError, Sticks, VoltageOutput};
use bench_rig::{Actuation, Rig};
use firmware_proto::ArmState;

const HOVER: Sticks = Sticks { throttle: 1.9, pitch: 1.65, roll: 1.7, yaw: 1.6 };

/// The loopback rig at 1 Hz: deadlines and time-outs that a busy machine keeps.
fn rig() -> Rig {
    let mut rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/loopback.toml")).unwrap();
    rig.control_loop.period_s = 1.0;
    rig
}

fn emulated(faults: LinkFaults) -> EmulatedPsoc5 {
    EmulatedPsoc5::start(faults, 3, None).unwrap()
}

fn port(board: &EmulatedPsoc5) -> &str {
    board.port().to_str().unwrap()
}

fn connected(board: &EmulatedPsoc5) -> Psoc5 {
    Psoc5::connect(port(board), &rig()).unwrap()
}

/// Sets voltages until they are read back: on a busy machine an answer may come too late.
fn set(driver: &mut Psoc5, sticks: Sticks) -> Result<bench_device::Readback, DeviceError> {
    loop {
        driver.write(sticks)?;
        if let Some(readback) = driver.read_back()? {
            return Ok(readback);
        }
    }
}

/// The last error of a driver that writes until it fails.
fn failure(driver: &mut Psoc5) -> DeviceError {
    loop {
        if let Err(error) = set(driver, HOVER) {
            return error;
        }
    }
}

#[test]
fn what_is_asked_for_is_read_back_once_the_loop_is_calibrated() {
    let board = emulated(LinkFaults::default());
    let mut driver = connected(&board);
    let calibration = driver.calibrate().unwrap();
    // The emulated loop's own errors (emulator/board.rs); 0.5 mV of noise over levels 3 V apart.
    for (channel, (gain, offset_v)) in
        calibration.0.iter().zip([(0.985, 0.009), (1.012, -0.006), (0.995, 0.004), (1.02, 0.011)])
    {
        assert!(
            (channel.gain - gain).abs() < 0.001 && (channel.offset_v - offset_v).abs() < 0.002,
            "{channel:?}"
        );
    }
    driver.arm().unwrap();
    let readback = set(&mut driver, HOVER).unwrap();
    // Half a step of 16 mV at the largest gain, noise, and what the calibration may be off.
    for (wanted, read) in HOVER.to_array().into_iter().zip(readback.sticks.to_array()) {
        assert!((wanted - read).abs() < 0.008 * 1.02 + 0.0005 + 0.003, "{wanted} {read}");
    }
    assert_eq!(readback.faults.bits(), 0);
    // Rest asks of some channels less than they can do; that is no fault of the caller's.
    assert!(!set(&mut driver, Sticks::default()).unwrap().faults.clamped);
    assert!(set(&mut driver, Sticks { throttle: 4.0, ..HOVER }).unwrap().faults.clamped);
}

#[test]
fn nothing_leaves_zero_before_arming_and_all_is_at_zero_after() {
    let board = emulated(LinkFaults::default());
    let mut driver = connected(&board);
    driver.write(HOVER).unwrap();
    assert!(matches!(driver.read_back(), Err(DeviceError::Failed { .. })));
    assert!(board.history().iter().all(|moment| moment.set_uv == [0; 4]));
    driver.arm().unwrap();
    set(&mut driver, HOVER).unwrap();
    assert!(matches!(driver.make_safe(Duration::ZERO), Safe::Confirmed { reconnected: false, .. }));
    // A driver that is dropped while armed, by a panic for instance, leaves the outputs at zero too.
    driver.arm().unwrap();
    set(&mut driver, HOVER).unwrap();
    drop(driver);
    let last = *board.history().last().unwrap();
    assert_eq!((last.set_uv, last.state), ([0; 4], ArmState::Disarmed));
}

#[test]
fn a_command_that_is_no_number_is_refused_and_changes_nothing() {
    let board = emulated(LinkFaults::default());
    let mut driver = connected(&board);
    driver.arm().unwrap();
    set(&mut driver, HOVER).unwrap();
    let before = board.history().last().unwrap().set_uv;
    for bad in [f64::NAN, f64::INFINITY] {
        let error = driver.write(Sticks { roll: bad, ..HOVER }).unwrap_err();
        assert!(matches!(error, DeviceError::BadCommand { channel: "roll", .. }), "{error}");
    }
    assert_eq!(board.history().last().unwrap().set_uv, before);
    // What no wire could say is clamped by the board, not wrapped around.
    assert!(set(&mut driver, Sticks { throttle: -1e12, ..HOVER }).unwrap().faults.clamped);
    assert_eq!(board.history().last().unwrap().set_uv[0], 0);
}

#[test]
fn ports_that_are_not_there_busy_or_no_ports_are_told_apart() {
    let connect = |port: &str| Psoc5::connect(port, &rig()).unwrap_err();
    assert!(matches!(connect("/dev/ttyNONE"), DacError::NotThere { .. }));
    assert!(matches!(connect("/dev/null"), DacError::CannotOpen { .. }));
    let board = emulated(LinkFaults::default());
    let _first = connected(&board);
    let DacError::Busy { holder, .. } = connect(port(&board)) else { panic!("not busy") };
    assert!(!holder.is_empty());
    let mut other = rig();
    other.airframe.actuation = Actuation::Fraction;
    assert!(matches!(Psoc5::connect(port(&board), &other), Err(DacError::NotVolts { .. })));
}

#[test]
fn firmware_of_another_version_is_named() {
    let board = emulated(LinkFaults { protocol_version: Some(2), ..LinkFaults::default() });
    let error = Psoc5::connect(port(&board), &rig()).unwrap_err();
    assert!(matches!(error, DacError::WrongFirmware { .. }), "{error}");
    assert!(error.to_string().contains("protocol 2"), "{error}");
}

#[test]
fn silence_and_gibberish_are_told_apart() {
    let silent = emulated(LinkFaults { drop: 1.0, ..LinkFaults::default() });
    let error = Psoc5::connect(port(&silent), &rig()).unwrap_err();
    assert!(matches!(error, DacError::Timeout { command: "hello", .. }), "{error}");
    let garbled = emulated(LinkFaults { corrupt: 1.0, ..LinkFaults::default() });
    let error = Psoc5::connect(port(&garbled), &rig()).unwrap_err();
    assert!(matches!(error, DacError::Corrupt { .. } | DacError::Timeout { .. }), "{error}");
}

#[test]
fn a_bad_link_costs_answers_and_nothing_else() {
    let board = emulated(LinkFaults { drop: 0.1, corrupt: 0.1, ..LinkFaults::default() });
    let mut driver = connected(&board);
    driver.arm().unwrap();
    let (mut answered, mut ended) = (0, None);
    for i in 0..300 {
        let throttle = 1.0 + f64::from(i) * 0.001;
        driver.write(Sticks { throttle, ..HOVER }).unwrap();
        match driver.read_back() {
            Ok(readback) => answered += u32::from(readback.is_some()),
            // Several in a row were lost: the board has tripped, or will.
            Err(error) => {
                ended = Some(error);
                break;
            }
        }
    }
    let counts = driver.counts();
    assert!(answered > 0 && counts.lost > 0, "{answered} {counts:?} {ended:?}");
    // Nothing was ever applied that was not asked for, but for the correction, which is none here.
    for moment in board.history().iter().filter(|moment| moment.applied) {
        assert!((1_000_000..=1_300_000).contains(&moment.set_uv[0]), "{moment:?}");
        assert_eq!(moment.set_uv[1..], [1_650_000, 1_700_000, 1_600_000]);
    }
    assert!(matches!(driver.make_safe(Duration::from_secs(30)), Safe::Confirmed { .. }));
}

#[test]
fn a_board_that_hangs_is_given_up_and_has_zeroed_its_outputs() {
    let board = emulated(LinkFaults { stall: Some((0.2, 1.0)), ..LinkFaults::default() });
    let mut driver = connected(&board);
    driver.arm().unwrap();
    let error = failure(&mut driver);
    assert!(matches!(error, DeviceError::TimedOut { .. } | DeviceError::Failed { .. }), "{error}");
    assert!(matches!(driver.make_safe(Duration::from_secs(30)), Safe::Confirmed { .. }));
    let history = board.history();
    assert!(history.iter().any(|moment| moment.state == ArmState::Tripped && moment.set_uv == [0; 4]));
}

#[test]
fn a_supply_that_sags_ends_the_flight_and_is_named_afterwards() {
    let board = emulated(LinkFaults { brown_out: Some(0.1), ..LinkFaults::default() });
    let mut driver = connected(&board);
    driver.arm().unwrap();
    let error = failure(&mut driver);
    assert!(error.to_string().contains("supply"), "{error}");
    let Safe::Confirmed { faults, .. } = driver.make_safe(Duration::ZERO) else { panic!("not confirmed") };
    assert!(faults.brown_out);
}

#[test]
fn an_unplugged_board_is_gone_and_is_found_again_at_zero() {
    let folder = Folder::new("unplug");
    let link = folder.0.join("psoc5");
    let faults = LinkFaults { unplug: Some((0.1, Some(0.3))), ..LinkFaults::default() };
    let board = EmulatedPsoc5::start(faults, 3, Some(&link)).unwrap();
    let mut driver = connected(&board);
    driver.arm().unwrap();
    let error = failure(&mut driver);
    assert!(matches!(error, DeviceError::Gone { .. }), "{error}");
    let safe = driver.make_safe(Duration::from_secs(60));
    assert!(matches!(safe, Safe::Confirmed { reconnected: true, .. }), "{safe:?}");
    // And can be flown again.
    driver.arm().unwrap();
    set(&mut driver, HOVER).unwrap();
}

#[test]
fn a_board_that_stays_away_is_not_said_to_be_safe() {
    let board = emulated(LinkFaults { unplug: Some((0.1, None)), ..LinkFaults::default() });
    let mut driver = connected(&board);
    driver.arm().unwrap();
    failure(&mut driver);
    assert!(matches!(driver.make_safe(Duration::from_millis(200)), Safe::Unconfirmed(_)));
}

/// A folder that goes with its test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
