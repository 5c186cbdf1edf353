//! Nothing on the loop's path allocates after start-up: with the real driver, an emulated board, the recorder, somebody who watches, and the
//! virtual airframe.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
    path::{Path, PathBuf},
};

use bench_dac::{
    Psoc5,
    emulator::{EmulatedPsoc5, LinkFaults},
};
use bench_recording::{Mode, Options, Recorder, Session, WhenFull};
use bench_rig::{Mission, Predictor, Rig};
use bench_run::{Directive, Ending, Loopback, Tee, WallClock, Watcher, await_marker, drain_truth, fly};

/// Counts what the loop's thread allocates; other threads may.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: hands everything on to the system's allocator and only counts.
#[allow(unsafe_code, reason = "an allocator cannot be written without")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // A thread that ends has no counter any more.
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise is handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is handed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn no_iteration_of_a_loopback_flight_allocates() {
    let rigs: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let mut rig = Rig::load(rigs.join("loopback.toml")).unwrap();
    fly_and_count(rig.clone(), &rigs);
    let model = Rig::load(rigs.join("virtual-model.toml")).unwrap();
    rig.control = model.control;
    assert_eq!(rig.control.predictor, Predictor::Model);
    fly_and_count(rig, &rigs);
}

fn fly_and_count(mut rig: Rig, rigs: &Path) {
    // Lost answers and overruns of a busy machine are not what is looked at.
    rig.safety.overrun_streak = 10_000;
    let mut mission = Mission::load(rigs.join("missions/climb-040.toml")).unwrap();
    for phase in &mut mission.phases {
        phase.duration_s = phase.duration_s.min(1.0);
    }
    let board = EmulatedPsoc5::start(LinkFaults::default(), 1, None).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let session = Session::new(Mode::Hil);
    let recorder = Recorder::create(folder.path().join("a.mcap"), &session, Options::REAL_TIME).unwrap();
    // Room for a part of the flight: the rest is dropped, which must not cost either.
    let (watcher, _records, missed) = Watcher::new(100, WhenFull::Drop);
    let mut sink = Tee::new(recorder, Some(watcher));
    let mut driver = Psoc5::connect(board.port().to_str().unwrap(), &rig).unwrap();
    driver.calibrate().unwrap();
    let mut clock = WallClock::start();
    let (mut output, mut tracker) = Loopback::new(&rig, 1, clock).unwrap().ends(&mut driver);
    assert!(await_marker(&mut clock, &mut tracker, 5.0).unwrap());
    let world = output.world();
    output.inner().arm().unwrap();
    let mut counted = Vec::with_capacity(1000);
    let ends = (&mut clock, &mut output, &mut tracker);
    let flown = fly(ends, &rig, &mission, &mut sink, |progress, sink| {
        drain_truth(&world, sink);
        counted.push((progress.phase, ALLOCATIONS.get()));
        // One that is flown, and one that is refused.
        match counted.len() {
            20 => Directive::FlyAt(0.5),
            22 => Directive::FlyAt(50.0),
            26 => Directive::Land,
            _ => Directive::GoOn,
        }
    });
    assert!(matches!(flown.ending, Ending::Complete), "{:?}", flown.ending);
    assert!(counted.len() > 30);
    assert!(missed.load(std::sync::atomic::Ordering::Relaxed) > 0);
    let first = counted[0].1;
    assert!(first > 0, "what was set up before is counted");
    assert!(counted.iter().all(|(_, count)| *count == first), "{counted:?}");
}
